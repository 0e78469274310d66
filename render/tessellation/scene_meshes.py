"""Meshes of analytic shapes and implicit surfaces, for exporters to programs that lack these."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ..geometry import analytic_shapes
from ..types import View
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
    made = ViewTessellator(scene.tables, View(plan["camera"], width, height), plan["tolerance"])
    geometries = scene.tables.geometries

    def triangles(instance: int) -> ShapeMesh:
        g = int(scene.tables.instances.geometry[instance])
        mesh = made.tessellate(instance)
        parts = mesh.parts.astype(np.int64)
        kind, row = np.full(len(parts), int(geometries.kind[g])), np.full(len(parts), g)
        x, y, z = mesh.positions[mesh.triangles, :3].mean(axis=1).T
        with np.errstate(all="ignore"):
            _, metric = analytic_shapes.uv(kind, geometries.parameters, row, parts, (x, y, z))
        return ShapeMesh(mesh.positions[:, :3], mesh.triangles, mesh.normals, mesh.uvs, np.stack(metric, axis=1))

    return triangles
