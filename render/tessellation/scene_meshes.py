"""Meshes of analytic shapes and implicit surfaces, for exporters to programs that lack these."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.mesh.shells import Converters
from ...compiler.plan.plan import Plan
from ..geometry import analytic_shapes
from ..image import encoded
from ..types import View
from . import analytic_shapes as tessellation
from . import implicit_surfaces
from .part_materials import triangle_materials
from .printable_mesh import default_tolerance
from .surface_textures import make_texture_look_up
from .view import ViewTessellator


class ShapeMesh(NamedTuple):
    """A shape in its own frame, counterclockwise from outside."""

    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    normals: NDArray[np.float64]  # (n, 3)
    uvs: NDArray[np.float64]  # (n, 2)
    metric: NDArray[np.float64]  # (m, 2) metres a unit of u and of v, in the shape's frame


def make_tessellator(scene: ir.Scene, plan: Plan) -> Callable[[int], ShapeMesh]:
    """A function from an instance (its row) to its mesh, within plan["tolerance"] pixels; not for meshes and unbounded shapes."""
    width, height = plan["size"]
    tessellator = ViewTessellator(scene.tables, View(plan["camera"], width, height), plan["tolerance"])
    return lambda instance: _with_metric(scene.tables, instance, tessellator.tessellate(instance))


def make_converters(scene: ir.Scene, tolerance: float | None = None) -> Converters:
    """The renderer's functions for exporters; triangles are within `tolerance` metres of the surface, by default default_tolerance."""
    tables = scene.tables
    within = default_tolerance(scene) if tolerance is None else tolerance

    errors: dict[tuple[int, float], float] = {}

    def key(instance: int) -> tuple[int, float]:
        """The geometry of an instance and the largest factor of its transform: equal ones have one mesh."""
        matrix = tables.transforms.matrix[tables.instances.transform[instance]]
        return int(tables.instances.geometry[instance]), float(np.linalg.norm(matrix[:, :3], 2))

    def error(instance: int) -> float:
        g, size = key(instance)
        if tables.geometries.kind[g] == ir.GeometryKind.MESH:
            return float(tables.geometries.parameters[g, 0])
        return errors.get((g, size), 0.0)

    def triangles(instance: int) -> ShapeMesh:
        g, size = key(instance)
        local, kind = within / size, int(tables.geometries.kind[g])
        if kind == ir.GeometryKind.FORMULA:
            contour = implicit_surfaces.contour(tables, g, local)
            errors[g, size] = contour.furthest
            return _with_metric(tables, instance, implicit_surfaces.with_edges(tables, g, implicit_surfaces.as_tessellation(contour)))
        parameters = tables.geometries.parameters[g].tolist()
        shape = tessellation.tessellate(kind, parameters, local)
        errors[g, size] = tessellation.deviation(kind, parameters, local, shape)
        return _with_metric(tables, instance, shape)

    return Converters(triangles, error, triangle_materials, encoded.png, encoded.exr, make_texture_look_up(tables))


def _with_metric(tables: ir.Tables, instance: int, mesh: tessellation.Tessellation) -> ShapeMesh:
    geometries, g = tables.geometries, int(tables.instances.geometry[instance])
    parts = mesh.parts.astype(np.int64)
    kind, row = np.full(len(parts), int(geometries.kind[g])), np.full(len(parts), g)
    x, y, z = mesh.positions[mesh.triangles, :3].mean(axis=1).T
    with np.errstate(all="ignore"):
        _, metric = analytic_shapes.uv(kind, geometries.parameters, row, parts, (x, y, z))
    return ShapeMesh(mesh.positions[:, :3], mesh.triangles, mesh.normals, mesh.uvs, np.stack(metric, axis=1))
