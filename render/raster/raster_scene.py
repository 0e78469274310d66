"""Everything that the rasterizer prepares of one view: triangles, meshlets, projection and lights."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import camera
from ..jit.packed_struct import Handle
from ..texture.textures import IMAGE, UV
from ..types import View
from . import band_buffer, deferred_shading, meshlets, triangle_planes, view_geometry
from .buffer_pool import BufferPool


class RasterScene(NamedTuple):
    """What a view draws as triangles: made once, kept with what else is prepared."""

    model: Handle  # of a raster_setup.Model
    ranges: NDArray[np.int64]  # (instances, 2) triangles of the model
    meshlets: Handle
    placed: NDArray[np.int64]  # (instances, 2) meshlets
    shown: Handle  # of a bands.Projection
    lit: Handle  # what deferred.py reads of the tables
    lamps: Handle
    look: Handle
    exact: NDArray[np.intp]  # rows of instances that enter the z-buffer where each sample's ray meets them
    boxes: NDArray[np.int32]  # (those, 4) pixels where they may be seen
    patterned: Any  # True or None: whether a material has a texture or a mesh colours
    colored: Any  # True or None: whether any is more than a picture by coordinates
    flat: Any  # True or None: deferred.lights_flat
    kept: BufferPool


def build(tables: ir.Tables, view: View, shells: dict[int, Any]) -> RasterScene:
    """The triangles of meshes and of tessellated shapes, as a model and as meshlets."""
    model, ranges = view_geometry.model(tables, view, shells)
    made, placed = meshlets.build(tables, model.positions, model.triangles, ranges, shells)
    near, far = view_geometry.ends(tables, view)
    shown = band_buffer.Projection(model.matrix, model.planes, model.perspective, near, far, model.positions, model.triangles)
    eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
    lit, lamps, look = (
        Handle(deferred_shading.single(tables, eye)),
        Handle(deferred_shading.lamps(tables)),
        Handle(_look(tables, view, eye)),
    )
    exact = view_geometry.untessellated(tables, shells)
    patterned, colored = _patterned(tables)
    return RasterScene(
        Handle(model), ranges, Handle(made), placed, Handle(shown), lit, lamps, look, exact, view_geometry.pixel_boxes(tables, view, exact),
        patterned, colored, deferred_shading.lights_flat(tables, lamps.tables, patterned is not None) or None, BufferPool(),
    )  # fmt: skip


def _patterned(tables: ir.Tables) -> tuple[Any, Any]:
    """Two of True or None: whether a material has a texture or a mesh colours, and whether any is more than a picture by coordinates."""
    more = (tables.textures.mapping != UV) | (tables.textures.kind != IMAGE)
    colored = bool((tables.geometries.colors >= 0).any() or more.any())
    return (True if colored or (tables.materials.textures >= 0).any() else None), (True if colored else None)


def _look(tables: ir.Tables, view: View, eye: NDArray[np.float64]) -> triangle_planes.Look:
    """Rays through three pixel corners, in the world about the eye."""
    ray = camera.ray(tables, view, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    start, direction = (np.stack([np.broadcast_to(c, 3) for c in vector], axis=1) for vector in (ray.origin, ray.direction))
    axis = -tables.transforms.inverse[tables.cameras.transform[view.camera], 2, :3]
    direction = direction / (direction @ axis)[:, None]
    start = start - eye - direction * ((start - eye) @ axis)[:, None]  # from the plane of the eye on, as depths count
    steps = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    inverse = tables.transforms.inverse[tables.instances.transform]
    local = inverse.copy()
    local[:, :, 3] += np.einsum("nij,j->ni", inverse[:, :, :3], eye)
    return triangle_planes.Look(*(np.ascontiguousarray(a, np.float32) for a in (steps @ direction, steps @ start, local)))
