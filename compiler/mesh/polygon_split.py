"""Splits large polygons along diagonals, because ear clipping takes quadratic time."""

from __future__ import annotations

import numpy as np

from ..ir import F64, I64

LARGE = 5000  # most corners of a piece that can be split
WHOLE = 30_000  # most corners of one that cannot
_SHARES = (4, 16, 64)  # a diagonal has 1 / share of the corners on either side, or more; tried in this order
_TRIES = 32  # corners from which a diagonal is searched
_STRIDE = 0.6180339887498949  # of the polygon, from one such corner to the next
_SLACK = 1e-12  # of the extents: distance from a diagonal that counts as 0


def pieces(loop: F64) -> list[I64]:
    """Rows of the corners of the pieces of a polygon (n, 2), counter-clockwise.

    A large polygon without diagonals, as one that crosses itself everywhere, is split at any corners.
    """
    parts = []
    waiting = [np.arange(len(loop))]
    while waiting:
        rows = waiting.pop()
        if len(rows) <= LARGE:
            parts.append(rows)
            continue
        split = next(filter(None, (_diagonal(loop[rows], share) for share in _SHARES)), None)
        if split is None and len(rows) <= WHOLE:
            parts.append(rows)
            continue
        first, last = split or (0, len(rows) // 2)
        waiting += [rows[first : last + 1], np.concatenate([rows[last:], rows[: first + 1]])]
    return parts


def _diagonal(loop: F64, share: int) -> tuple[int, int] | None:
    """Two corners, first < last, whose connection lies inside of a polygon and leaves 1 / share of the corners on either side."""
    count = len(loop)
    rows = np.arange(count)
    for k in range(_TRIES):
        first = int(k * _STRIDE * count) % count
        ways = loop - loop[first]
        apart = np.abs(rows - first)
        far = (np.minimum(apart, count - apart) >= count // share) & _is_inside(ways, ways[first - 1], ways[(first + 1) % count])
        if not far.any():
            continue
        second = int(np.argmin(np.where(far, (ways * ways).sum(axis=1), np.inf)))
        if not _crosses(loop, ways, first, second):
            return min(first, second), max(first, second)
    return None


def _is_inside(ways: F64, before: F64, after: F64) -> np.ndarray:
    """Whether directions (n, 2) at a corner lead inside; `before` and `after` lead to its neighbours."""
    left, right = cross(after, ways) > 0, cross(ways, before) > 0
    return left & right if cross(after, before) > 0 else left | right


def _crosses(loop: F64, ways: F64, first: int, second: int) -> bool:
    """Whether the diagonal between two corners crosses an edge; corners may touch it. `ways` (n, 2) lead from its start."""
    slack = _SLACK * np.ptp(loop, axis=0).max() ** 2
    sides = cross(ways[second], ways)
    sides[np.abs(sides) <= slack] = 0.0
    sides[[first, second]] = 0.0
    following = np.roll(sides, -1)
    rows = np.flatnonzero(sides * following < 0)
    edges = loop[(rows + 1) % len(loop)] - loop[rows]
    if (cross(edges, loop[first] - loop[rows]) * cross(edges, loop[second] - loop[rows]) < 0).any():
        return True
    along = (ways @ ways[second]) / (ways[second] @ ways[second])
    through = (sides == 0) & (np.roll(sides, 1) * following < 0) & (along > 0) & (along < 1)
    return bool(through.any())


def cross(a: F64, b: F64) -> F64:
    """The z component (…,) of the cross product of vectors (…, 2) in a plane."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
