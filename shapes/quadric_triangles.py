"""Tessellates quadrics by marching tetrahedra on a grid; each vertex is an exact root on its edge.

On a line a quadric is a quadratic polynomial, so vertices need no iteration. Source: Doi and Koide, An Efficient Method of Triangulating
Equi-Valued Surfaces by Using Tetrahedral Cells, 1991, with Kuhn's six tetrahedra a cell, which match across cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
MAX_CELLS = 96  # along an axis of a box
_COARSE = 12  # cells along an axis of the grid that samples curvature
_REACH = 0.375  # triangles of Kuhn tetrahedra of edge h lie within 0.375 h² κ of a surface of curvature κ


def matrix(parameters: Sequence[float]) -> F64:
    """(4, 4) symmetric Q with f(p) = pᵀ Q p for homogeneous p, from the coefficients A … J of ir.GeometryKind.QUADRIC."""
    a, b, c, d, e, f, g, h, i, j = parameters[:10]
    return np.array([[a, d / 2, f / 2, g / 2], [d / 2, b, e / 2, h / 2], [f / 2, e / 2, c, i / 2], [g / 2, h / 2, i / 2, j]])


def normals(q: F64, positions: F64) -> F64:
    """(n, 3) unit gradients at (n, 3) positions; (0, 1, 0) at a tip, which has none."""
    gradient = gradients(q, positions)
    size = np.linalg.norm(gradient, axis=1, keepdims=True)
    return np.where(size > 0, gradient / np.where(size > 0, size, 1.0), [0.0, 1.0, 0.0])


def gradients(q: F64, positions: F64) -> F64:
    """(n, 3) gradients of f at (n, 3) positions."""
    return 2 * (positions @ q[:3, :3] + q[3, :3])


def curvature(q: F64, positions: F64) -> F64:
    """(n,) an upper bound of the normal curvatures at (n, 3) positions: largest |eigenvalue| of the Hessian / |gradient|."""
    bend = np.abs(np.linalg.eigvalsh(2 * q[:3, :3])).max()
    slope = np.linalg.norm(gradients(q, positions), axis=1)
    return bend / np.maximum(slope, 1e-300)


def deviation(q: F64, positions: F64, triangles: NDArray[np.int32]) -> float:
    """The largest distance of the centres of triangles and edges from the surface, to first order, times 4/3 for places between."""
    if not len(triangles):
        return 0.0
    corners = positions[triangles]
    places = np.concatenate([corners.mean(axis=1), 0.5 * (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3)])
    value = np.einsum("ni,ij,nj->n", places, q[:3, :3], places) + 2 * places @ q[3, :3] + q[3, 3]
    slope = np.linalg.norm(gradients(q, places), axis=1)
    steep = slope > 1e-6 * slope.max(initial=0.0)  # elsewhere is a tip
    return 4 / 3 * float((np.abs(value[steep]) / slope[steep]).max(initial=0.0))


def box_grid(parameters: Sequence[float], tolerance: float, bounds: F64) -> F64:
    """(nx, ny, nz, 3) grid over the quadric's box, fine enough for `tolerance` (metres), at most MAX_CELLS an axis.

    A quadric without a box has a grid over its `bounds` (2, 3), which are finite, and a margin, so that it changes its sign in the grid.
    """
    half = np.asarray(parameters[10:13], np.float64)
    box = np.stack([-half, half])
    if not np.isfinite(half).all():
        margin = np.maximum(bounds[1] - bounds[0], 1e-9) / _COARSE
        box = np.stack([bounds[0] - margin, bounds[1] + margin])
    q = matrix(parameters)
    coarse, _ = march(q, _lattice(box, (box[1] - box[0]) / _COARSE))
    bend = curvature(q, coarse).max(initial=0.0)
    edge = np.sqrt(tolerance / (_REACH * bend)) if bend > 0 else np.inf
    return _lattice(box, np.full(3, edge))


def _lattice(box: F64, edge: F64) -> F64:
    counts = np.clip(np.ceil((box[1] - box[0]) / edge), 4, MAX_CELLS).astype(int)
    axes = [np.linspace(low, high, n + 1) for low, high, n in zip(*box, counts, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def march(q: F64, grid: F64) -> tuple[F64, NDArray[np.int32]]:
    """Vertices (n, 3) and triangles (m, 3) of pᵀ Q p = 0 in the cells of `grid`, (nx, ny, nz, 3) points.

    Cells share the vertices on common edges. The orientation of triangles is arbitrary. Parts that change no sign at a grid point are
    missed.
    """
    points = grid.reshape(-1, 3)
    value = np.einsum("ni,ij,nj->n", points, q[:3, :3], points) + 2 * points @ q[3, :3] + q[3, 3]
    inside = (value < 0).reshape(grid.shape[:3])
    tets, key = _active_tetrahedra(inside), np.int64(len(points))
    edges = _crossed_edges(tets, inside.ravel())
    low, high = np.minimum(edges[..., 0], edges[..., 1]), np.maximum(edges[..., 0], edges[..., 1])
    unique, index = np.unique((low * key + high).ravel(), return_inverse=True)
    a, b = unique // key, unique % key
    positions = _roots(q, points[a], points[b], value[a], value[b])
    return positions, _drop_degenerate(positions, index.reshape(-1, 3)).astype(np.int32)


def _active_tetrahedra(inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(t, 4) point indices of the tetrahedra of all cells with corners on both sides."""
    nx, ny, nz = (n - 1 for n in inside.shape)
    corners = [inside[i : i + nx, j : j + ny, k : k + nz] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    count = np.sum(corners, axis=0, dtype=np.int8)
    i, j, k = np.nonzero((count > 0) & (count < 8))
    strides = np.array([inside.shape[1] * inside.shape[2], inside.shape[2], 1], np.int64)
    first = i * strides[0] + j * strides[1] + k * strides[2]
    # Kuhn: paths from the cell's first corner to its last along the axes, in each of the six orders
    paths = np.array([np.cumsum([0, *strides[list(order)]]) for order in permutations(range(3))])
    return (first[:, None, None] + paths).reshape(-1, 4)


def _crossed_edges(tets: NDArray[np.int64], inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(m, 3, 2) the edges with each triangle's vertices: one triangle where one corner is apart, else two."""
    order = np.argsort(~inside[tets], axis=1, kind="stable")  # inside corners first
    sorted_tets = np.take_along_axis(tets, order, axis=1)
    count = inside[tets].sum(axis=1)
    one_inside, two_inside, three_inside = (sorted_tets[count == n] for n in (1, 2, 3))
    alone = [t[:, [[p, q0], [p, q1], [p, q2]]] for t, (p, q0, q1, q2) in ((one_inside, (0, 1, 2, 3)), (three_inside, (3, 0, 1, 2)))]
    quads = [two_inside[:, [[0, 2], [0, 3], [1, 3]]], two_inside[:, [[0, 2], [1, 3], [1, 2]]]]
    return np.concatenate([*alone, *quads])


def _roots(q: F64, a: F64, b: F64, at_a: F64, at_b: F64) -> F64:
    """The root on each edge a-b: the stable solution s of the quadratic at a + s (b - a)."""
    step = b - a
    square = np.einsum("ni,ij,nj->n", step, q[:3, :3], step)
    half_linear = 0.5 * np.einsum("ni,ni->n", gradients(q, a), step)
    root = np.sqrt(np.maximum(half_linear**2 - square * at_a, 0.0))
    big = -(half_linear + np.where(half_linear < 0, -root, root))
    with np.errstate(all="ignore"):
        first, second = at_a / big, big / square
    inside = np.isfinite(first) & (first >= 0) & (first <= 1)
    s = np.where(inside, first, np.where(np.isfinite(second), np.clip(second, 0, 1), at_a / (at_a - at_b)))
    return a + s[:, None] * step


def _drop_degenerate(positions: F64, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """The triangles with three distinct corners: at grid points on the surface, several edges have the same vertex."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    same = (a == b).all(axis=1) | (b == c).all(axis=1) | (c == a).all(axis=1)
    return triangles[~same]
