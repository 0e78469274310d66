"""Clips polygons against planes in homogeneous coordinates (Sutherland and Hodgman, Reentrant Polygon Clipping, 1974).

A polygon is an array of vertices. A plane through the origin of their first columns keeps the non-negative side; the other columns are
attributes and are interpolated. Homogeneous coordinates include points behind the eye and points at infinity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper


@helper
def distance(polygon, row: int, plane) -> float:
    """The signed, unscaled distance of a vertex from a plane; negative is outside."""
    d = 0.0
    for k in range(len(plane)):
        d += plane[k] * polygon[row, k]
    return d


@helper
def clip_to_plane(polygon, count: int, plane, out) -> int:
    """Clip the first `count` vertices of `polygon` against one plane into `out`; returns their number (at most count + 1
    for convex polygons, 3/2 count for others).

    An edge with its end inside adds that end; an edge that crosses the plane adds the crossing before. Crossings are computed from the
    vertex inside, so that two polygons with a common edge get the same point.
    """
    vertex_count = 0
    width = polygon.shape[1]
    for start in range(count):
        end = start + 1 if start + 1 < count else 0
        from_start, from_end = distance(polygon, start, plane), distance(polygon, end, plane)
        if (from_start >= 0.0) != (from_end >= 0.0):
            inside, outside = (start, end) if from_start >= 0.0 else (end, start)
            near, far = (from_start, from_end) if from_start >= 0.0 else (from_end, from_start)
            share = near / (near - far)
            for k in range(width):
                out[vertex_count, k] = polygon[inside, k] + share * (polygon[outside, k] - polygon[inside, k])
            vertex_count += 1
        if from_end >= 0.0:
            for k in range(width):
                out[vertex_count, k] = polygon[end, k]
            vertex_count += 1
    return vertex_count


@helper
def clip_to_planes(first, count: int, planes, second) -> int:
    """Clip `first` in place against each plane, with `second` as temporary memory; returns the number of vertices."""
    for p in range(len(planes)):
        if count == 0:
            return 0
        count = clip_to_plane(first, count, planes[p], second)
        for row in range(count):
            for k in range(first.shape[1]):
                first[row, k] = second[row, k]
    return count


def clip_polygon(vertices: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of a polygon, (n, d), inside all `planes`, (m, c) with c <= d; (0, d) if none is.

    For a rectangle, with vertices (x, y, 1), the planes are [1, 0, -left], [-1, 0, right] and so on.
    """
    buffer = np.empty((max(4, len(vertices) * 2 ** len(planes)), vertices.shape[1]))
    buffer[: len(vertices)] = vertices
    count = clip_to_planes(buffer, len(vertices), planes, np.empty_like(buffer))
    return buffer[:count].copy()
