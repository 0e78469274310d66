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
from .band_memory import BufferPool


class RasterScene(NamedTuple):
    """Everything that the rasterizer prepares of a view; read by all its pictures."""

    model: Handle  # of a view_geometry.Model
    ranges: NDArray[np.int64]  # (instances, 2) triangles of the model
    meshlets: Any  # a Handle of meshlets.Meshlets, or None for pictures by tiles
    meshlet_ranges: NDArray[np.int64]  # (instances, 2) meshlets
    projection: Handle  # of a band_buffer.Projection
    shading_tables: Handle  # see deferred_shading.to_float32
    sources: Handle  # of a deferred_shading.LightSources
    rays: Handle  # of a triangle_planes.PixelRays
    untessellated: NDArray[np.intp]  # rows of visible instances without triangles, which a ray for each sample enters
    boxes: NDArray[np.int32]  # (len(untessellated), 4) their pixel bounds
    textured: Any  # True or None: a material has a texture, or a mesh vertex colours
    colored: Any  # True or None: shading needs more than uv: vertex colours, or textures that are no images by uv
    flat: Any  # True or None: see deferred_shading.shades_flat_runs
    pool: BufferPool


def build(
    tables: ir.Tables, view: View, tessellations: dict[int, Any], general: bool = False, by_tiles: bool = False
) -> RasterScene:  # fmt: skip
    """The data of a view; `tessellations` are the analytic shapes', by instance. With `general`, kernels handle textures and colours.

    Pictures `by_tiles` need no meshlets.
    """
    model, ranges = view_geometry.build_model(tables, view, tessellations)
    meshlet_handle, meshlet_ranges = None, np.zeros_like(ranges)
    if not by_tiles:
        built, meshlet_ranges = meshlets.build(tables, model.positions, model.triangles, ranges, tessellations)
        meshlet_handle = Handle(built)
    near, far = view_geometry.depth_range(tables, view)
    projection = band_buffer.Projection(model.matrix, model.planes, model.perspective, near, far, model.positions, model.triangles)
    eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
    shading_tables, sources, rays = (
        Handle(deferred_shading.to_float32(tables, eye)),
        Handle(deferred_shading.light_sources(tables)),
        Handle(pixel_rays(tables, view, eye)),
    )
    untessellated = view_geometry.untessellated(tables, tessellations)
    textured, colored = (True, True) if general else used_attributes(tables)
    return RasterScene(
        Handle(model), ranges, meshlet_handle, meshlet_ranges, Handle(projection), shading_tables, sources, rays, untessellated,
        view_geometry.pixel_boxes(tables, view, untessellated), textured, colored,
        deferred_shading.shades_flat_runs(tables, sources.tables, textured is not None) or None, BufferPool(),
    )  # fmt: skip


def used_attributes(tables: ir.Tables) -> tuple[Any, Any]:
    """`RasterScene.textured` and `colored` of tables."""
    more = (tables.textures.mapping != UV) | (tables.textures.kind != IMAGE)
    colored = bool((tables.geometries.colors >= 0).any() or more.any())
    return (True if colored or (tables.materials.textures >= 0).any() else None), (True if colored else None)


def pixel_rays(tables: ir.Tables, view: View, eye: NDArray[np.float64]) -> triangle_planes.PixelRays:
    """The rays through pixels, in the world relative to the eye."""
    ray = camera.generate_pinhole_ray(tables, view, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    start, direction = (np.stack([np.broadcast_to(c, 3) for c in vector], axis=1) for vector in (ray.origin, ray.direction))
    axis = -tables.transforms.inverse[tables.cameras.transform[view.camera], 2, :3]
    direction = direction / (direction @ axis)[:, None]
    start = start - eye - direction * ((start - eye) @ axis)[:, None]  # from the plane of the eye, where depth is 0
    steps = np.array([[1.0, 0.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    inverse = tables.transforms.inverse[tables.instances.transform]
    local = inverse.copy()
    local[:, :, 3] += np.einsum("nij,j->ni", inverse[:, :, :3], eye)
    return triangle_planes.PixelRays(*(np.ascontiguousarray(a, np.float32) for a in (steps @ direction, steps @ start, local)))
