"""Surfaces as triangles: meshes of the scene, planes, and shapes that a format lacks."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import ir
from ..ir import F64


class Shell(NamedTuple):
    """The surface of an instance as triangles, in its own frame; counter-clockwise from outside."""

    positions: F64  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    normals: F64 | None = None  # (n, 3)
    uvs: F64 | None = None  # (n, 2)
    metric: F64 | None = None  # (m, 2) metres in the instance's frame per unit of u and of v, on each triangle
    colors: F64 | None = None  # (n, 3) linear


class SurfacePoints(NamedTuple):
    """Points of a surface in the frame of its instance."""

    local: F64  # (k, 3)
    normals: F64  # (k, 3) unit, for shading
    faces: F64  # (k, 3) unit, of the surface
    uvs: F64  # (k, 2)


Tessellate = Callable[[int], tuple[F64, NDArray[np.int32], F64, F64, F64]]
"""Tessellates an instance (a row) whose shape a format lacks: positions, triangles, normals, uvs, metric as in Shell."""


class Converters(NamedTuple):
    """Functions of the renderer that exporters need."""

    tessellate: Tessellate
    error: Callable[[int], float]  # largest distance of an instance's triangles from its surface, in its frame, once they are made
    materials: Callable[[ir.Tables, int, F64], NDArray[np.int64]]  # rows of the materials of an instance at world points (m, 3)
    png: Callable[..., bytes]  # (height, width, 3) values from 0 to 1, color: whether they are colours, alpha: (height, width) or None
    exr: Callable[[NDArray[np.float32]], bytes]  # (height, width, 3)
    texture: Callable[[int, int, SurfacePoints], F64]  # (k, 3) values of a texture (a row) on an instance (a row)


def mesh(tables: ir.Tables, g: int) -> Shell:
    """A MESH geometry with normals (flipped to its faces' side), coordinates and colours, indexed where possible."""
    geometries = tables.geometries
    positions, triangles = ir.mesh_arrays(tables, g)
    positions, count = positions.astype(np.float64) + geometries.origin[g], len(triangles)
    rows = [int(column[g]) for column in (geometries.normals, geometries.uvs, geometries.colors)]
    by_vertex = all(row < 0 or tables.attributes.interpolation[row] == ir.Interpolation.VERTEX for row in rows)
    corner = [None if row < 0 else at_corners(tables, row, triangles) for row in rows]
    normals = corner[0]
    if normals is not None:
        face = np.cross(*(positions[triangles[:, k]] - positions[triangles[:, 0]] for k in (1, 2)))
        away = np.einsum("mkc,mc->mk", normals, face) < 0.0
        by_vertex = by_vertex and not away.any()
        normals = np.where(away[..., None], -normals, normals)
    metric = metric_of(positions, triangles, corner[1]) if corner[1] is not None else np.ones((count, 2))
    if by_vertex:
        normals, uvs, colors = (None if row < 0 else _by_vertex(tables, row) for row in rows)
        return Shell(positions, triangles, normals, uvs, metric, colors)
    flat = [None if values is None else values.reshape(3 * count, -1) for values in (normals, corner[1], corner[2])]
    return Shell(positions[triangles].reshape(-1, 3), _corner_numbers(count), flat[0], flat[1], metric, flat[2])


def at_corners(tables: ir.Tables, row: int, triangles: NDArray[np.int32]) -> F64:
    """Values (triangles, 3, width) of an attribute at the corners of triangles (local vertex numbers)."""
    attributes, count = tables.attributes, len(triangles)
    how, width, first = attributes.interpolation[row], int(attributes.width[row]), int(attributes.first[row])
    if how == ir.Interpolation.CONSTANT:
        index = np.zeros((count, 3), np.int64)
    elif how == ir.Interpolation.FACE:
        index = np.repeat(np.arange(count)[:, None], 3, axis=1)
    else:
        index = triangles if how == ir.Interpolation.VERTEX else np.arange(3 * count).reshape(-1, 3)
    values = tables.pools.values[first : first + width * int(attributes.count[row])].reshape(-1, width)
    return values[index].astype(np.float64)


def _by_vertex(tables: ir.Tables, row: int) -> F64:
    first, width = int(tables.attributes.first[row]), int(tables.attributes.width[row])
    count = int(tables.attributes.count[row])
    return tables.pools.values[first : first + width * count].reshape(-1, width).astype(np.float64)


def _corner_numbers(count: int) -> NDArray[np.int32]:
    return np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def metric_of(positions: F64, triangles: NDArray[np.int32], uvs: F64) -> F64:
    """(m, 2) metres per unit of u and of v on each triangle; 1 for degenerate coordinates. uvs: (m, 3, 2)."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    d1, d2 = uvs[:, 1] - uvs[:, 0], uvs[:, 2] - uvs[:, 0]
    det = d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]
    safe = np.where(det == 0.0, 1.0, det)[:, None]
    du = np.linalg.norm((d2[:, 1:] * e1 - d1[:, 1:] * e2) / safe, axis=1)
    dv = np.linalg.norm((d1[:, :1] * e2 - d2[:, :1] * e1) / safe, axis=1)
    return np.where(det[:, None] == 0.0, 1.0, np.stack([du, dv], axis=1))


def plane(x: float, z: float, radius: float) -> Shell:
    """An infinite plane as a square grid about (x, z) that ends 10⁵ `radius` away; u = x and v = -z as on the plane.

    The grid spacing grows with distance, so that coordinates near the center keep their precision in float32.
    """
    steps = radius * 10.0 ** np.arange(1, 6)
    line = np.concatenate([-steps[::-1], [0.0], steps])
    n = len(line)
    gz, gx = np.meshgrid(line + z, line + x, indexing="ij")
    positions = np.stack([gx.ravel(), np.zeros(n * n), gz.ravel()], axis=1)
    row, column = (k.ravel() for k in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = row * n + column
    quads = np.stack([a, a + n, a + n + 1, a + 1], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    normals = np.tile([0.0, 1.0, 0.0], (n * n, 1))
    return Shell(positions, triangles, normals, positions[:, [0, 2]] * [1.0, -1.0], np.ones((len(triangles), 2)))


def divided(shell: Shell) -> Shell:
    """The shell with three vertices for each triangle."""
    corner = shell.triangles.ravel()
    positions, normals, uvs, colors = (None if v is None else v[corner] for v in (shell.positions, shell.normals, shell.uvs, shell.colors))
    assert positions is not None
    return Shell(positions, _corner_numbers(len(shell.triangles)), normals, uvs, shell.metric, colors)


def flip(shell: Shell) -> Shell:
    """The shell with reversed winding, for a mirroring frame."""
    return shell._replace(triangles=np.ascontiguousarray(shell.triangles[:, ::-1]))
