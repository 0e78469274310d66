"""Triangles in place of analytic shapes and formulas, for programs that do not have them, and of whole scenes, for printers."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import contour, ir, mesh_solids, tapes
from ..compiler.export_meshes import Part
from ..compiler.plan import Plan
from ..lang.diagnostics import Diagnostic
from . import prepare, shapes, tessellate
from .records import View


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
    made = prepare.Shapes(scene.tables, View(plan["camera"], width, height), plan["tolerance"])
    geometries = scene.tables.geometries

    def triangles(instance: int) -> Triangles:
        g = int(scene.tables.instances.geometry[instance])
        mesh = made.of(instance)
        parts = mesh.parts.astype(np.int64)
        kind, row = np.full(len(parts), int(geometries.kind[g])), np.full(len(parts), g)
        x, y, z = mesh.positions[mesh.triangles, :3].mean(axis=1).T
        with np.errstate(all="ignore"):
            _, metric = shapes.uv(kind, geometries.parameters, row, parts, (x, y, z))
        return Triangles(mesh.positions[:, :3], mesh.triangles, mesh.normals, mesh.uvs, np.stack(metric, axis=1))

    return triangles


FINER = 0.75  # of a tolerance, that a formula's contour is to keep before it is simplified by the rest
FINENESS = 2000  # of the scene's extent, that triangles are off at the most when nothing else is asked


def parts(scene: ir.Scene, tolerance: float | None = None) -> tuple[list[Part], list[Diagnostic]]:
    """Everything in a scene that has an end as triangles in the world, off the true surfaces by `tolerance` metres at the most where
    that can be reached, and what is said of what is left out."""
    tables, found, made = scene.tables, [], []
    boxes = prepare.bvh.world_bounds(tables)
    ends: list[bool] = np.asarray(np.isfinite(boxes).all(axis=1)).tolist()
    if tolerance is None and any(ends):
        tolerance = float((boxes[ends, 3:].max(axis=0) - boxes[ends, :3].min(axis=0)).max()) / FINENESS
    for i in range(len(tables.instances.geometry)):
        name = scene.names.instances[i] if i < len(scene.names.instances) else ""
        if not ends[i]:
            message = f"{f'`{name}`' if name else 'a thing'} is endless: it is left out"
            found.append(Diagnostic("note", message, scene.spans.at("instances", i)))
            continue
        made.append(_part(tables, i, name or f"part{i}", tolerance or 0.0))
    return made, found


def _part(tables: ir.Tables, i: int, name: str, tolerance: float) -> Part:
    g, row = int(tables.instances.geometry[i]), int(tables.instances.transform[i])
    matrix = tables.transforms.matrix[row]
    largest = float(np.linalg.norm(matrix[:, :3], 2))
    positions, triangles, off = _local(tables, g, tolerance / largest)
    positions, index = np.unique(np.round(positions, 15) @ matrix[:, :3].T + matrix[:, 3], axis=0, return_inverse=True)
    triangles = index.reshape(-1)[triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    if tables.transforms.flips[row]:
        triangles = triangles[:, ::-1]
    return Part(name, positions, triangles, off * largest, contour.open_edges(triangles))


def _local(tables: ir.Tables, g: int, tolerance: float) -> tuple[NDArray[np.float64], NDArray[np.int64], float]:
    """(positions, triangles, how far they are off at the most) of a geometry in its own frame."""
    geometries, kind = tables.geometries, int(tables.geometries.kind[g])
    if kind == ir.GeometryKind.MESH:
        first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
        start, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
        positions = tables.pools.positions[start : start + vertices].astype(np.float64) + geometries.origin[g]
        return positions, tables.pools.triangles[first : first + count].astype(np.int64) - start, 0.0
    if kind == ir.GeometryKind.FORMULA:
        tape, made = tapes.stored(tables, int(geometries.tape[g])), prepare.contoured(tables, g, FINER * tolerance)
        return mesh_solids.simplified(tape, made, tolerance)
    mesh = tessellate.tessellate(kind, geometries.parameters[g].tolist(), tolerance)
    exact = kind in (ir.GeometryKind.BOX, ir.GeometryKind.RECTANGLE)
    return mesh.positions[:, :3], mesh.triangles.astype(np.int64), 0.0 if exact else tolerance
