"""Triangles in place of analytic shapes and formulas, for programs that do not have them."""

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


class Triangles(NamedTuple):
    """A shape in its own frame, counter-clockwise from outside."""

    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    normals: NDArray[np.float64]  # (n, 3)
    uvs: NDArray[np.float64]  # (n, 2)
    metric: NDArray[np.float64]  # (m, 2) metres, in the shape's frame, that one unit of u and of v spans


def tessellator(scene: ir.Scene, plan: Plan) -> Callable[[int], Triangles]:
    """A function from an instance (a row; no mesh, and nothing endless) to its triangles, plan["tolerance"] pixels off at most."""
    width, height = plan["size"]
    made = ViewTessellator(scene.tables, View(plan["camera"], width, height), plan["tolerance"])
    geometries = scene.tables.geometries

    def triangles(instance: int) -> Triangles:
        g = int(scene.tables.instances.geometry[instance])
        mesh = made.tessellate(instance)
        parts = mesh.parts.astype(np.int64)
        kind, row = np.full(len(parts), int(geometries.kind[g])), np.full(len(parts), g)
        x, y, z = mesh.positions[mesh.triangles, :3].mean(axis=1).T
        with np.errstate(all="ignore"):
            _, metric = analytic_shapes.uv(kind, geometries.parameters, row, parts, (x, y, z))
        return Triangles(mesh.positions[:, :3], mesh.triangles, mesh.normals, mesh.uvs, np.stack(metric, axis=1))

    return triangles
