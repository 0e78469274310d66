"""Thickness of the shapes around media: twice the volume over the area. That is the distance between the sides of a plate or a shell."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...shapes import SHAPES

F64 = NDArray[np.float64]


def of_media(tables: ir.Tables, rows: NDArray[np.int64]) -> F64:
    """(n,) metres, of the thinnest shape around each of these rows of ir.Media; 0 if one of its shapes has no triangles."""
    inside = tables.materials.medium[tables.instances.material]
    return np.array([_thinnest(tables, np.flatnonzero(inside == row).tolist()) for row in rows.tolist()], float)


def _thinnest(tables: ir.Tables, instances: list[int]) -> float:
    meshes = [_triangles(tables, i) for i in instances]
    if not meshes or any(len(corners) == 0 for corners in meshes):
        return 0.0
    middle = 0.5 * (np.min([c.min(axis=(0, 1)) for c in meshes], axis=0) + np.max([c.max(axis=(0, 1)) for c in meshes], axis=0))
    return min(_thickness(corners - middle) for corners in meshes)


def _thickness(corners: F64) -> float:
    """Of triangles (n, 3, 3). Those of one part of a body count as pyramids up to the origin."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volume = abs(float(np.sum(a * np.cross(b, c)))) / 6.0
    area = 0.5 * float(np.sum(np.linalg.norm(np.cross(b - a, c - a), axis=1)))
    return 2.0 * volume / area if area > 0.0 else 0.0


def _triangles(tables: ir.Tables, instance: int) -> F64:
    """The corners (n, 3, 3) of an instance in the world; none of formulas and shapes without an inside."""
    row = int(tables.instances.geometry[instance])
    kind = tables.geometries.kind[row]
    if kind == ir.GeometryKind.MESH:
        positions, triangles = ir.mesh_arrays(tables, row)
        points = positions.astype(float) + tables.geometries.origin[row]
    else:
        closed = None if kind == ir.GeometryKind.FORMULA else SHAPES[kind].closed_mesh
        mesh = closed(tables.geometries.parameters[row].tolist(), math.inf) if closed is not None else None
        if mesh is None:
            return np.zeros((0, 3, 3))
        points, triangles, _ = mesh
    matrix = tables.transforms.matrix[tables.instances.transform[instance]]
    return (points @ matrix[:, :3].T + matrix[:, 3])[triangles]
