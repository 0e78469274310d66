"""Control points → Bézier pieces → polylines: linear, Bézier, Catmull-Rom and B-spline curves of any dimension."""

from __future__ import annotations

import math

import numpy as np

from ...lang.input_error import InputError
from ..ir import F64

KINDS = ("linear", "bezier", "catmull_rom", "bspline")
MOST_STEPS = 4096  # of one Bézier piece


class SplineError(InputError):
    """Control points that make no curve of their kind."""


def pieces(points: F64, kind: str, closed: bool) -> list[F64]:
    """The Bézier pieces (degree + 1, d) of control points (n, d), end to end; the curve of a closed one ends where it begins.

    "bezier" takes two to four points as one piece, more as cubic pieces that share their ends. "catmull_rom" is the centripetal one
    (Yuksel, Schaefer and Keyser 2011), whose curve has neither cusps nor loops between two points. "bspline" is cubic and uniform; an
    open one begins and ends at its first and last point. Raises SplineError for too few points, or a count that leaves a piece over.
    """
    least = 2 if not closed else 3
    if len(points) < least:
        what = "a closed curve" if closed else "a curve"
        raise SplineError(f"{what} has {'three' if closed else 'two'} points or more, got {len(points)}")
    if kind == "bezier":
        return _bezier(points, closed)
    if kind == "bspline":
        return _closed_bspline(points) if closed else _open_bspline(points)
    points = _distinct(points, closed)
    if len(points) < least:
        raise SplineError(f"the points are the same: a curve has {'three' if closed else 'two'} different ones or more")
    ends = np.concatenate([points, points[:1]]) if closed else points
    if kind == "linear":
        return list(np.stack([ends[:-1], ends[1:]], axis=1))
    return _catmull_rom(points, closed)


def polyline(points: F64, kind: str, closed: bool, tolerance: float, turn: float = math.inf) -> F64:
    """The curve of control points as a polyline (m, d) that is off it by `tolerance` at most; a closed one does not repeat its start.

    `turn`: most radians by which a piece turns from one step to the next, on average over the piece.
    """
    parts = []
    for piece in pieces(points, kind, closed):
        steps = _steps(piece, tolerance, turn)
        parts.append(_at(piece, np.arange(steps) / steps))
        last = piece[-1:]
    return np.concatenate(parts if closed else [*parts, last])


def deviation(points: F64, kind: str, closed: bool, tolerance: float) -> float:
    """Largest distance of the polyline of `tolerance` from its curve: less than that, or more where MOST_STEPS are too few."""
    return max((_bend(piece) / _steps(piece, tolerance, math.inf) ** 2 for piece in pieces(points, kind, closed)), default=0.0)


def points_after_first(piece: F64, tolerance: float) -> F64:
    """The points (m, d) after the first of the polyline of one Bézier piece."""
    steps = _steps(piece, tolerance, math.inf)
    return _at(piece, np.arange(1, steps + 1) / steps)


def _distinct(points: F64, closed: bool) -> F64:
    """The points without repetitions of the one before."""
    before = np.roll(points, 1, axis=0)
    new = (points != before).any(axis=1)
    if not closed or not new.any():
        new[0] = True
    return points[new]


def _bezier(points: F64, closed: bool) -> list[F64]:
    count = len(points)
    if closed:
        if count % 3:
            hint = "each piece has a point on the curve and two handles after it"
            raise SplineError(f"a closed Bézier curve has 3, 6, 9, … points, got {count}", hint)
        points = np.concatenate([points, points[:1]])
    elif count <= 4:
        return [points]
    elif count % 3 != 1:
        hint = "pieces share their ends: a point on the curve, two handles, a point on the curve, …"
        raise SplineError(f"a Bézier curve has 2, 3, 4, 7, 10, 13, … points, got {count}", hint)
    return [points[k : k + 4] for k in range(0, len(points) - 1, 3)]


def _catmull_rom(points: F64, closed: bool) -> list[F64]:
    if closed:
        around = np.concatenate([points[-1:], points, points[:2]])
    else:
        around = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    legs = np.diff(around, axis=0)
    times = np.sqrt(np.linalg.norm(legs, axis=1))[:, None]  # the centripetal parameter
    slopes = legs / times
    # The tangent of the quadratic through three points, at the middle one.
    tangents = slopes[:-1] + slopes[1:] - (around[2:] - around[:-2]) / (times[:-1] + times[1:])
    first, last, span = around[1:-2], around[2:-1], times[1:-1]
    return list(np.stack([first, first + tangents[:-1] * span / 3, last - tangents[1:] * span / 3, last], axis=1))


def _closed_bspline(points: F64) -> list[F64]:
    before, after, next_one = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0), np.roll(points, -2, axis=0)
    first, last = (before + 4 * points + after) / 6, (points + 4 * after + next_one) / 6
    return list(np.stack([first, (2 * points + after) / 3, (points + 2 * after) / 3, last], axis=1))


def _open_bspline(points: F64) -> list[F64]:
    degree = min(3, len(points) - 1)
    spans = len(points) - degree
    knots = np.clip(np.arange(len(points) + degree + 1) - degree, 0, spans).astype(np.float64)
    return [_span(points, knots, degree, degree + k) for k in range(spans)]


def _span(points: F64, knots: F64, degree: int, span: int) -> F64:
    """The Bézier points of a knot span: its blossom at the span's ends (Ramshaw 1987), by de Boor's algorithm."""
    low, high = knots[span], knots[span + 1]
    bezier = []
    for highs in range(degree + 1):
        controls = points[span - degree : span + 1]
        for level in range(degree):
            parameter = high if level < highs else low
            begin = knots[span - degree + 1 + level : span + 1][:, None]
            end = knots[span + 1 : span + 1 + degree - level][:, None]
            share = (parameter - begin) / (end - begin)
            controls = (1 - share) * controls[:-1] + share * controls[1:]
        bezier.append(controls[0])
    return np.array(bezier)


def _steps(piece: F64, tolerance: float, turn: float) -> int:
    """Steps of one length of the parameter that keep the tolerance (Wang, Song and Wang 1984) and the turn."""
    degree = len(piece) - 1
    if degree == 1:
        return 1
    needed = math.sqrt(_bend(piece) / tolerance)
    if math.isfinite(turn):
        legs = np.diff(piece, axis=0)
        legs = legs[(legs != 0).any(axis=1)]
        ways = legs / np.linalg.norm(legs, axis=1)[:, None]
        needed = max(needed, float(np.arccos(np.clip((ways[1:] * ways[:-1]).sum(axis=1), -1, 1)).sum()) / turn)
    return min(max(1, math.ceil(needed)), MOST_STEPS)


def _bend(piece: F64) -> float:
    """The distance of a Bézier piece from its chord, at most; of one of n equal steps of its parameter the n²-th part."""
    degree = len(piece) - 1
    return degree * (degree - 1) / 8 * float(np.linalg.norm(np.diff(piece, n=2, axis=0), axis=1).max()) if degree > 1 else 0.0


def _at(piece: F64, t: F64) -> F64:
    """The points (m, d) of a Bézier piece at parameters (m,), by de Casteljau's algorithm."""
    controls = np.broadcast_to(piece, (len(t), *piece.shape))
    share = t[:, None, None]
    while controls.shape[1] > 1:
        controls = (1 - share) * controls[:, :-1] + share * controls[:, 1:]
    return controls[:, 0]
