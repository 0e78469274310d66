"""Detects T-junctions of a mesh: vertices on another triangle's edge, where rounding opens cracks for rays and samples.

In a closed mesh each edge occurs in both directions. The remaining edges form the border. Where a vertex lies on a border edge, its
border edge and the other edge leave a common vertex in the same direction.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BESIDE = 1e-5  # distance tolerance, relative to the longer edge
ULPS = 4.0  # distance tolerance in units of float32 rounding of the coordinates
_EDGES_COMPARED = 4  # border edges at a vertex that are compared with each other


def count(positions: NDArray[np.float32], triangles: NDArray[np.int32]) -> int:
    """Number of vertices that lie on another triangle's edge. `positions` (n, 3) are finite; `triangles` (m, 3) are their rows."""
    border = _open_edges(triangles.astype(np.int64), len(positions))
    if not len(border):
        return 0
    used, ends = np.unique(border, return_inverse=True)
    places, same = np.unique(positions[used], axis=0, return_inverse=True)  # merges vertices split at seams of normals or coordinates
    border = _open_edges(same.reshape(-1)[ends.reshape(-1, 2)], len(places))
    if len(border) < 3:
        return 0
    both = np.concatenate([border, border[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    place = places.astype(np.float64)
    near = ULPS * 2.0**-23 * float(np.abs(place).max())
    junctions = [_ends_on_edges(place, both[:-k], both[k:], near) for k in range(1, _EDGES_COMPARED)]
    junctions += [_ends_on_edges(place, both[k:], both[:-k], near) for k in range(1, _EDGES_COMPARED)]
    return len(np.unique(np.concatenate(junctions)))


def _open_edges(faces: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """(k, 2) directed edges of faces, or of edges (m, 2), that outnumber their reverses."""
    a, b = (faces[:, 0], faces[:, 1]) if faces.shape[1] == 2 else (faces.ravel(), np.roll(faces, -1, axis=1).ravel())
    low, high = np.minimum(a, b), np.maximum(a, b)
    key, sign = low * n + high, np.where(a < b, 1, np.where(a > b, -1, 0))
    with np.errstate(over="ignore"):
        mixed = (key ^ (key >> 29)) * np.int64(-7046029254386353131)
        if int(np.sum((mixed ^ (mixed >> 32)) * sign)) == 0:  # closed, most likely: skip the sort
            return np.zeros((0, 2), np.int64)
    order = np.argsort(key, kind="stable")
    key, sign = key[order], sign[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    balance = np.add.reduceat(sign, first)
    key, balance = key[first[balance != 0]], balance[balance != 0]
    edges = np.stack([key // n, key % n], axis=1)
    return np.where(balance[:, None] > 0, edges, edges[:, ::-1])


def _ends_on_edges(place: NDArray[np.float64], short: NDArray[np.int64], long: NDArray[np.int64], near: float) -> NDArray[np.int64]:
    """End vertices of the edges `short` that lie on the edges `long` from the same vertex."""
    shared = short[:, 0] == long[:, 0]
    short, long = short[shared], long[shared]
    a = place[short[:, 0]]
    way, edge = place[short[:, 1]] - a, place[long[:, 1]] - a
    length = np.sqrt((edge * edge).sum(axis=1))
    along = (way * edge).sum(axis=1) / np.maximum(length, 1e-300)
    beside = np.sqrt(np.maximum((way * way).sum(axis=1) - along * along, 0.0))
    limit = np.maximum(BESIDE * length, near)
    return short[(along > limit) & (along < length - limit) & (beside <= limit), 1]
