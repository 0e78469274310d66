"""Polygon triangulation: fans where valid, ear clipping (mapbox earcut) for concave faces and faces with holes."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..ir import F64, I32, I64
from . import polygon_split

FLAT = 1e-12  # 2 · area / extent² below which a face or triangle counts as degenerate
_LEAST = 1e-280  # squared area that is far from underflow
REPEATED = 3  # corners for each point, from which a face of over 500 corners is not clipped, which takes cubic time
FEW = 64  # most corners of faces that are examined a coordinate at a time
FAN_APEXES = 8  # most corners of a face for which every fan apex is tried; larger faces try the first corner only, then ear clipping


class Cut(NamedTuple):
    """Triangles of a mesh's faces. `corners` are rows of the flat corner list, so that per-corner data follows."""

    corners: I32  # (m, 3)
    faces: I32  # (m,) source face of each triangle, ascending
    dropped: int  # faces without area or with fewer than three corners


def triangulate(points: F64, loops: Sequence[Sequence[int]]) -> I32:
    """Triangles (m, 3) of one nearly planar polygon: an outline and its holes, as rows of `points` (n, 3).

    Triangles wind like the outline. The plane is Newell's (Graphics Gems III, V.5): robust for collinear and repeated corners, and the
    best
    fit for nearly planar corners. A polygon without area gives no triangles.
    """
    outline = np.asarray(loops[0], dtype=np.int64)
    if len(loops) == 1:
        cut = faces(points, outline, np.array([len(outline)]))
        return outline[cut.corners].astype(np.int32)
    return _clip(np.asarray(points, dtype=np.float64), [np.asarray(loop, dtype=np.int64) for loop in loops])


def faces(points: F64, indices: I32 | I64, counts: I32 | I64) -> Cut:
    """Triangles of faces without holes: face k has the next counts[k] rows of `indices` as its corners.

    Faces that a fan covers are triangulated by array operations, one group for each corner count.
    """
    points = np.asarray(points, dtype=np.float64)
    counts = np.asarray(counts, dtype=np.int64)
    indices = np.asarray(indices, dtype=np.int64)
    firsts = np.cumsum(counts) - counts
    parts: list[tuple[np.ndarray, np.ndarray]] = []
    dropped = int(np.count_nonzero(counts < 3))
    for n in np.unique(counts[counts >= 3]):
        rows = np.flatnonzero(counts == n)
        corners = firsts[rows][:, None] + np.arange(n)
        if n <= FEW and (simple := _simple(points, indices, corners)) is not None:
            solid, covered = simple
            parts.append((_fan(corners[covered], 0).reshape(-1, 3), np.repeat(rows[covered], n - 2)))
            if n == 3:
                dropped += int(np.count_nonzero(~solid))
                continue
            rows, corners = rows[~covered], corners[~covered]
            if not len(rows):
                continue
        shape = points[indices[corners]]
        shape = shape - shape[:, :1]
        normal = newell(shape)
        extent = np.ptp(shape, axis=1).max(axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            solid = np.linalg.norm(normal, axis=1) > FLAT * extent**2
        lost = _crossing(shape, ~solid, extent) if n > 3 else []
        dropped += int(np.count_nonzero(~solid)) - len(lost)
        parts += _fans(shape, normal, solid, rows, corners, points, indices)
        parts += [(_fan(corners[k : k + 1], 0)[0], np.full(n - 2, rows[k])) for k in lost]
    if not parts:
        return Cut(np.zeros((0, 3), np.int32), np.zeros(0, np.int32), dropped)
    triangles = np.concatenate([m[0] for m in parts])
    owners = np.concatenate([m[1] for m in parts])
    if len(parts) > 1:
        order = np.argsort(owners, kind="stable")
        triangles, owners = triangles[order], owners[order]
    return Cut(triangles.astype(np.int32), owners.astype(np.int32), dropped)


def _simple(points: F64, indices: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Whether faces (k, n) have area, and whether the fan from their first corner covers them, by the rules of `faces`.

    One coordinate at a time, which is several times as fast; None if some area is too small or large to square.
    """
    shape = [np.ascontiguousarray(points[indices[corners[:, k]]].T) for k in range(corners.shape[1])]
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        spokes = [corner - shape[0] for corner in shape[1:]]
        areas = [_cross(u, v) for u, v in itertools.pairwise(spokes)]
        normal = functools.reduce(np.add, areas)
        square = _dot(normal, normal)
        highest, lowest = functools.reduce(np.maximum, spokes, np.float64(0.0)), functools.reduce(np.minimum, spokes, np.float64(0.0))
        extent = np.maximum.reduce(highest - lowest)
        solid = np.sqrt(square) > FLAT * extent**2
        if not ((square[solid] > _LEAST).all() and np.isfinite(square).all()):
            return None
        least = 1e-9 * square
        covered = solid if len(areas) == 1 else functools.reduce(np.logical_and, (_dot(area, normal) > least for area in areas), solid)
    return solid, covered


def _cross(u: F64, v: F64) -> F64:
    """Cross products of vectors (3, k)."""
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def _dot(u: F64, v: F64) -> F64:
    """Dot products of vectors (3, k)."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def newell(shape: F64) -> F64:
    """Newell normals (k, 3) of polygons (k, n, 3), twice as long as their area."""
    following = np.roll(shape, -1, axis=1)
    return np.cross(shape, following).sum(axis=1)


def _fan(corners: np.ndarray, apex: int) -> np.ndarray:
    """(k, n-2, 3) fan triangles from the corner `apex` of faces `corners` (k, n)."""
    turned = np.roll(corners, -apex, axis=1)
    first = np.broadcast_to(turned[:, :1], turned[:, 1:-1].shape)
    return np.stack([first, turned[:, 1:-1], turned[:, 2:]], axis=-1)


def _fans(
    shape: F64, normal: F64, solid: np.ndarray, rows: np.ndarray, corners: np.ndarray, points: F64, indices: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Triangles and rows of faces of equal size: fans from the first apex with a view of all corners, ear clipping otherwise."""
    n = corners.shape[1]
    parts = []
    remaining = np.flatnonzero(solid)
    for apex in range(1 if n == 3 else n if n <= FAN_APEXES else 1):
        if not len(remaining):
            break
        spokes = np.roll(shape[remaining], -apex, axis=1)
        spokes = spokes[:, 1:] - spokes[:, :1]
        doubled = np.einsum("kni,ki->kn", np.cross(spokes[:, :-1], spokes[:, 1:]), normal[remaining])
        covered = (doubled > 1e-9 * np.einsum("ki,ki->k", normal[remaining], normal[remaining])[:, None]).all(axis=1)
        taken = remaining[covered]
        if len(taken):
            parts.append((_fan(corners[taken], apex).reshape(-1, 3), np.repeat(rows[taken], n - 2)))
        remaining = remaining[~covered]
    for k in remaining:
        ears = _ears(points[indices[corners[k]]], [n], normal[k])
        parts.append((corners[k][ears], np.full(len(ears), rows[k])))
    return parts


def _crossing(shape: F64, flat: np.ndarray, extent: F64) -> list[int]:
    """Rows of self-intersecting faces (figures of eight): zero signed area, non-zero extent. They are fanned."""
    rows = np.flatnonzero(flat)
    spokes = shape[rows, 1:] - shape[rows, :1]
    areas = np.linalg.norm(np.cross(spokes[:, :-1], spokes[:, 1:]), axis=2)
    return rows[(areas > 1e-6 * extent[rows, None] ** 2).any(axis=1)].tolist()


def _clip(points: F64, loops: list[np.ndarray]) -> I32:
    """Triangles of an outline with holes, as rows of `points`."""
    rows = np.concatenate(loops)
    shape = points[rows]
    outline = shape[: len(loops[0])]
    normal = newell((outline - outline[:1])[None])[0] if len(outline) > 2 else np.zeros(3)
    if np.linalg.norm(normal) <= FLAT * np.ptp(shape, axis=0).max() ** 2:
        return np.zeros((0, 3), np.int32)
    ears = _ears(shape, [int(e) for e in np.cumsum([len(loop) for loop in loops])], normal)
    return rows[ears].astype(np.int32)


def _ears(shape: F64, ends: list[int], normal: F64) -> np.ndarray:
    """Ear clipping in the plane perpendicular to `normal`: triangles (m, 3) as rows of `shape`, counter-clockwise about it."""
    axis = normal / np.linalg.norm(normal)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    u = np.cross(helper, axis)
    u /= np.linalg.norm(u)
    flat = (shape - shape[0]) @ np.stack([u, np.cross(axis, u)], axis=1)
    if len(ends) == 1:
        ears = np.concatenate([rows[_clipped(flat[rows], [len(rows)])] for rows in polygon_split.pieces(flat)])
    else:
        ears = _clipped(flat, ends)
    a, b, c = flat[ears[:, 0]], flat[ears[:, 1]], flat[ears[:, 2]]
    doubled = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    ears = np.where((doubled < 0)[:, None], ears[:, ::-1], ears)
    extents = np.maximum.reduce([np.abs(b - a).max(axis=1), np.abs(c - b).max(axis=1), np.abs(a - c).max(axis=1)])
    return ears[np.abs(doubled) > FLAT * extents**2]


def _clipped(loops: F64, ends: list[int]) -> I64:
    """Triangles (m, 3) of an outline and its holes in a plane, by ear clipping; a fan where this would take minutes."""
    if ends[0] > 500 and ends[0] > REPEATED * len(np.unique(loops, axis=0)):
        return _fan(np.arange(ends[0])[None], 0)[0]
    import mapbox_earcut

    return mapbox_earcut.triangulate_float64(np.ascontiguousarray(loops), np.array(ends, np.uint32)).reshape(-1, 3).astype(np.int64)
