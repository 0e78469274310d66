"""The distance of points from a triangle mesh, by a binary tree of boxes over triangles in Morton order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

GROUP = 4  # triangles in a leaf of the tree
_BITS = 10  # of a Morton code along each axis
PIECES, MOST_PIECES = 64, 1 << 20  # triangles longer than this share of the mesh are divided, into this many at most
_BATCH = 1 << 11  # points, or groups of triangles, at a time
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class TriangleTree:
    """Triangles of a mesh: positions (n, 3), triangles (m, 3), of which there is at least one."""

    def __init__(self, positions: Floats, triangles: Ints) -> None:
        corners = divided(positions[triangles], float(np.ptp(positions, axis=0).max()) / PIECES)
        corners = corners[np.argsort(_morton(corners.mean(axis=1)), kind="stable")]
        depth = max(int(np.ceil(np.log2(max(len(corners) / GROUP, 1.0)))), 0)
        missing = GROUP * (1 << depth) - len(corners)
        self._corners = np.concatenate([corners, np.repeat(corners[-1:], missing, axis=0)]).reshape(-1, GROUP, 3, 3)
        levels = [(self._corners.min(axis=(1, 2)), self._corners.max(axis=(1, 2)))]
        while len(levels[0][0]) > 1:
            low, high = levels[0]
            levels.insert(0, (np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])))
        self._levels = levels

    def distance(self, points: Floats, enough: float = 0.0) -> Floats:
        """(n,) distances of points (n, 3) from the nearest triangle: bounds of them where these are at most `enough`."""
        found = [self._distance(points[k : k + _BATCH], enough) for k in range(0, len(points), _BATCH)]
        return np.concatenate(found) if found else np.zeros(0)

    def _distance(self, points: Floats, enough: float) -> Floats:
        node = np.zeros(len(points), np.int64)
        for level in range(1, len(self._levels)):
            node = 2 * node + (self._to_middle(level, 2 * node + 1, points) < self._to_middle(level, 2 * node, points))
        best = self._to_group(node, points)
        point = np.flatnonzero(best > enough)
        node = np.zeros(len(point), np.int64)
        for level in range(1, len(self._levels)):
            point, node = np.repeat(point, 2), (2 * node[:, None] + np.arange(2)).ravel()
            near = self._to_box(level, node, points[point]) < best[point]
            point, node = point[near], node[near]
            low, high = self._levels[level]
            apart = np.maximum(points[point] - low[node], high[node] - points[point])  # every box has a whole triangle
            np.minimum.at(best, point, np.sqrt(_dot(apart, apart)))
            left = best[point] > enough
            point, node = point[left], node[left]
        for k in range(0, len(node), _BATCH):
            part = k + np.flatnonzero(best[point[k : k + _BATCH]] > enough)
            np.minimum.at(best, point[part], self._to_group(node[part], points[point[part]]))
        return best

    def _to_box(self, level: int, node: Ints, points: Floats) -> Floats:
        low, high = self._levels[level]
        apart = np.maximum(np.maximum(low[node] - points, points - high[node]), 0.0)
        return np.sqrt(_dot(apart, apart))

    def _to_middle(self, level: int, node: Ints, points: Floats) -> Floats:
        low, high = self._levels[level]
        apart = 0.5 * (low[node] + high[node]) - points
        return _dot(apart, apart)

    def _to_group(self, node: Ints, points: Floats) -> Floats:
        corners = self._corners[node].reshape(-1, 3, 3)
        found = to_triangles(np.repeat(points, GROUP, axis=0), corners).reshape(-1, GROUP)
        return np.minimum(np.minimum(found[:, 0], found[:, 1]), np.minimum(found[:, 2], found[:, 3]))


def divided(corners: Floats, longest: float, wanted: Callable[[Floats], NDArray[np.bool_]] | None = None) -> Floats:
    """Triangles (n, 3, 3) whose longest sides are halved until they have the length `longest`; of the pieces those that are `wanted`."""
    done = []
    while len(corners):
        if wanted is not None:
            corners = corners[wanted(corners)]
        length = np.stack([_dot(d, d) for d in (corners[:, (k + 1) % 3] - corners[:, k] for k in range(3))], axis=1)
        long = length.max(axis=1) > longest**2
        if len(corners) + int(long.sum()) + sum(map(len, done)) > MOST_PIECES:
            break
        done.append(corners[~long])
        first = length[long].argmax(axis=1)[:, None, None]
        a, b, c = (np.take_along_axis(corners[long], (first + k) % 3, axis=1)[:, 0] for k in range(3))
        middle = 0.5 * (a + b)
        corners = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate([*done, corners])


def _morton(places: Floats) -> Ints:
    """(n,) codes of places (n, 3): bits of the three coordinates in turn."""
    low, extent = places.min(axis=0), max(float(np.ptp(places, axis=0).max()), 1e-300)
    cell = ((places - low) / extent * ((1 << _BITS) - 1)).astype(np.int64)
    code = np.zeros(len(places), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return code


def to_triangles(points: Floats, corners: Floats) -> Floats:
    """(n,) distances of points (n, 3) from triangles (n, 3, 3), one each."""
    a, b, c = (corners[:, k] for k in range(3))
    sides, ways = (b - a, c - b, a - c), (points - a, points - b, points - c)
    normal = _cross(sides[0], sides[1])
    area = _dot(normal, normal)
    best, inside = np.full(len(points), np.inf), area > 0
    for side, way in zip(sides, ways, strict=True):
        length = _dot(side, side)
        share = np.clip(_dot(way, side) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        apart = way - share[:, None] * side
        best = np.minimum(best, _dot(apart, apart))
        inside &= _dot(_cross(side, way), normal) >= 0.0
    height = _dot(ways[0], normal) ** 2 / np.where(area > 0, area, 1.0)
    return np.sqrt(np.where(inside, np.minimum(best, height), best))


def _dot(one: Floats, other: Floats) -> Floats:
    return np.einsum("ij,ij->i", one, other)


def _cross(one: Floats, other: Floats) -> Floats:
    made = np.empty_like(one)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        made[:, k] = one[:, i] * other[:, j] - one[:, j] * other[:, i]
    return made
