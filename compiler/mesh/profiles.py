"""Plane profiles: outlines and holes as simple polygons, checked for crossings, area and nesting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...lang.input_error import InputError
from ..ir import F64
from . import splines
from .polygon_split import cross

FINENESS = 4000  # extent / FINENESS is the largest distance of a polygon from its curve
NO_AREA = 1e-9  # of its extent squared, below which a profile has no area
_ROWS = 512  # edges compared with all others at a time


class ProfileError(InputError):
    """A profile that encloses no area."""


def extent(points: F64) -> float:
    """The larger side of the bounding rectangle of points (n, d)."""
    return float(np.ptp(points, axis=0).max())


def fineness(control: F64, tolerance: float | None) -> float:
    """The largest distance asked for of a polygon from its curve; by default a share of the extent of its control points."""
    return extent(control) / FINENESS if tolerance is None else tolerance


def deviation(points: Sequence[Sequence[float]], kind: str, closed: bool, tolerance: float | None) -> float:
    """The largest distance of the polyline of `curve` from its curve."""
    control = np.array(points, dtype=np.float64).reshape(-1, 2)
    return 0.0 if kind == "linear" else splines.deviation(control, kind, closed, fineness(control, tolerance))


def curve(points: Sequence[Sequence[float]], kind: str, closed: bool, what: str = "the profile", tolerance: float | None = None) -> F64:
    """The polyline (m, 2) of a profile's control points, see `fineness`. Raises ProfileError for too few of them."""
    control = np.array(points, dtype=np.float64).reshape(-1, 2)
    least = 3 if closed else 2
    if len(control) < least:
        raise ProfileError(f"{what} has {'three' if closed else 'two'} points or more, got {len(control)}")
    if not extent(control):
        raise ProfileError(f"the points of {what} are the same")
    try:
        line = splines.polyline(control, kind, closed, fineness(control, tolerance))
    except splines.SplineError as unfit:
        raise ProfileError(f"{what}: {unfit}", unfit.hint) from None
    return _distinct(line, closed)


def outline(points: Sequence[Sequence[float]], kind: str = "linear", what: str = "the profile", tolerance: float | None = None) -> F64:
    """The counter-clockwise polygon (m, 2) of a closed profile. Raises ProfileError unless it is simple and has an area."""
    loop = curve(points, kind, True, what, tolerance)
    _check_simple(loop, what)
    area = signed_area(loop)
    return loop if area > 0 else loop[::-1].copy()


def signed_area(loop: F64) -> float:
    """The area of a polygon (n, 2), negative if it is clockwise."""
    x, y = (loop - loop.mean(axis=0)).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def with_holes(outer: F64, holes: Sequence[F64]) -> list[F64]:
    """The outline, then the holes clockwise. Raises ProfileError unless each hole lies inside the outline and outside the others."""
    for number, hole in enumerate(holes, 1):
        place = crossing(outer, hole)
        if place is not None:
            raise ProfileError(f"hole {number} meets the outline near {show(place)}", "keep each hole inside the outline")
        if not inside(outer, hole[0]):
            raise ProfileError(f"hole {number} lies outside of the outline", "keep each hole inside the outline")
        for before, other in enumerate(holes[: number - 1], 1):
            place = crossing(other, hole)
            if place is not None:
                raise ProfileError(f"holes {before} and {number} meet near {show(place)}", "make one hole of them")
            if inside(other, hole[0]) or inside(hole, other[0]):
                inner, outside = (number, before) if inside(other, hole[0]) else (before, number)
                raise ProfileError(f"hole {inner} lies inside hole {outside}", f"leave out hole {inner}")
    return [outer, *(hole[::-1].copy() for hole in holes)]


def inside(loop: F64, point: F64) -> bool:
    """Whether a point lies inside a polygon (n, 2), by the number of its edges that a ray along x crosses."""
    a, b = loop, np.roll(loop, -1, axis=0)
    over = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
    a, b = a[over], b[over]
    crossings = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return bool(np.count_nonzero(crossings > point[0]) % 2)


def crossing(first: F64, second: F64) -> F64 | None:
    """A point where an edge of one polygon meets an edge of another; None if none does."""
    return _meeting(_edges(first), _edges(second), None)


def _edges(loop: F64) -> F64:
    return np.stack([loop, np.roll(loop, -1, axis=0)], axis=1)


def _distinct(line: F64, closed: bool) -> F64:
    """The points of a polyline without repetitions, as far as float64 distinguishes them at its extent."""
    near = np.abs(line - np.roll(line, 1, axis=0)).max(axis=1) <= 1e-12 * extent(line)
    if not closed:
        near[0] = False
    return line[~near]


def _check_simple(loop: F64, what: str) -> None:
    size = extent(loop)
    if len(loop) < 3 or np.linalg.svd(loop - loop.mean(axis=0), compute_uv=False)[1] <= NO_AREA * size * len(loop) ** 0.5:
        raise ProfileError(f"{what} has no area: its points lie on one line", "write the corners of an area, one after the other")
    place = crossing_of(loop)
    if place is not None:
        hint = "write its points in order around the area, none of them twice"
        raise ProfileError(f"{what} crosses or touches itself near {show(place)}", hint)


def crossing_of(loop: F64, but: np.ndarray | None = None) -> F64 | None:
    """A point where two edges of a polygon meet other than as neighbours at their common end; `but` (n,): edges left out."""
    edges = _edges(loop)
    ways = edges[:, 1] - edges[:, 0]
    after = np.roll(ways, -1, axis=0)
    folded = (np.abs(cross(ways, after)) <= 1e-12 * extent(loop) ** 2) & ((ways * after).sum(axis=1) < 0)
    if folded.any():
        return edges[int(np.flatnonzero(folded)[0]), 1]
    rows = np.arange(len(loop)) if but is None else np.flatnonzero(~but)
    return _meeting(edges[rows], edges[rows], (rows, len(loop)))


def _meeting(first: F64, second: F64, shared: tuple[np.ndarray, int] | None) -> F64 | None:
    """A point where segments (n, 2, 2) of one list meet those of another.

    `shared`: both lists are these rows of one polygon of so many edges, of which neighbours do not count.
    """
    slack = 1e-12 * extent(np.concatenate([first, second]).reshape(-1, 2)) ** 2
    low, high = second.min(axis=1), second.max(axis=1)
    for begin in range(0, len(first), _ROWS):
        a, b = (first[begin : begin + _ROWS, None, k] for k in range(2))
        c, d = second[None, :, 0], second[None, :, 1]
        near = ((np.minimum(a, b) <= high) & (np.maximum(a, b) >= low)).all(axis=2)
        if shared is not None:
            apart = np.abs(shared[0][begin : begin + _ROWS, None] - shared[0][None])
            near &= (apart > 1) & (apart < shared[1] - 1)
        rows, columns = np.nonzero(near)
        if not len(rows):
            continue
        a, b, c, d = a[rows, 0], b[rows, 0], c[0, columns], d[0, columns]
        offsets = (cross(b - a, c - a), cross(b - a, d - a), cross(d - c, a - c), cross(d - c, b - c))
        sides = [np.where(np.abs(offset) <= slack, 0.0, offset) for offset in offsets]
        meets = np.flatnonzero((sides[0] * sides[1] <= 0) & (sides[2] * sides[3] <= 0))
        if len(meets):
            k = int(meets[0])
            turn = sides[2][k] - sides[3][k]
            return a[k] + (sides[2][k] / turn if turn else 0.0) * (b[k] - a[k])
    return None


def show(point: F64) -> str:
    """A point of a profile in a message."""
    return f"[{', '.join(f'{float(c) + 0.0:.4g}' for c in point)}] m"
