"""Triangle meshes of heights on a rectangular grid, as surfaces or as solids with walls and a base."""

from __future__ import annotations

import numpy as np

from ..ir import F64, I64
from ..scene.row_records import MeshAttribute, MeshData
from . import mesh_csg, polygon_mesh


def surface(heights: F64, size: tuple[float, float]) -> MeshData:
    """The surface of heights (rows, columns) over a rectangle about the origin: rows from -z to +z, columns from -x to +x.

    It is smooth. u runs with x, v against z, so that a picture lies as its heights do.
    """
    points, triangles, uv = _top(heights, size)
    mesh = polygon_mesh.PolyMesh(points, np.full(len(triangles), 3), triangles.reshape(-1), uvs=MeshAttribute(uv))
    return polygon_mesh.assemble(mesh, crease=np.pi)[0]


def solid(heights: F64, size: tuple[float, float], base: float) -> MeshData:
    """The same with vertical walls and a floor at y = -base, below all heights."""
    points, triangles, uv = _top(heights, size)
    around = _boundary(*heights.shape)
    below = len(points) + np.arange(len(around))
    floor = points[around] * (1.0, 0.0, 1.0) - (0.0, base, 0.0)
    after, below_after = np.roll(around, -1), np.roll(below, -1)
    walls = np.concatenate([np.stack([below, below_after, after], axis=1), np.stack([below, after, around], axis=1)])
    bottom = below[mesh_csg.triangulate([floor[:, [0, 2]] * (1.0, -1.0)])[:, ::-1]]
    faces = np.concatenate([triangles, walls, bottom])
    groups = np.concatenate([np.ones(len(triangles), np.int64), np.zeros(len(walls) + len(bottom), np.int64)])
    coordinates = MeshAttribute(np.concatenate([uv, uv[around]]))
    mesh = polygon_mesh.PolyMesh(np.concatenate([points, floor]), np.full(len(faces), 3), faces.reshape(-1), uvs=coordinates, groups=groups)
    return polygon_mesh.assemble(mesh)[0]


def _top(heights: F64, size: tuple[float, float]) -> tuple[F64, I64, np.ndarray]:
    """Vertices, triangles that face +y, and texture coordinates."""
    rows, columns = heights.shape
    u, v = np.meshgrid(np.arange(columns) / (columns - 1), 1.0 - np.arange(rows) / (rows - 1))
    points = np.stack([(u - 0.5) * size[0], heights, (0.5 - v) * size[1]], axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    far_left, far_right, near_left, near_right = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    triangles = np.stack([near_left, near_right, far_right, near_left, far_right, far_left], axis=2).reshape(-1, 3)
    return points, triangles, np.stack([u, v], axis=2).reshape(-1, 2).astype(np.float32)


def _boundary(rows: int, columns: int) -> I64:
    """The vertices around the grid, counter-clockwise seen from +y."""
    index = np.arange(rows * columns).reshape(rows, columns)
    return np.concatenate([index[-1, :-1], index[:0:-1, -1], index[0, :0:-1], index[:-1, 0]])
