"""Bounding box of an implicit surface, by interval subdivision."""

from __future__ import annotations

import numpy as np

from .batched_interpreter import batches
from .tape import Tape

FARTHEST = 1e6  # units of the formula: a larger surface counts as unbounded
ROUNDS = 48
MOST_BOXES = 20_000
STALE = 5  # rounds without progress, after which the search ends
_GRID, _FINER, _MOST_OUTER = 8, 2, 256  # boxes along an axis of a given box; subdivisions of the outer ones, and their largest number
_CELLS = np.indices((_GRID,) * 3).reshape(3, -1)
_EIGHTHS = ((np.arange(8) >> np.arange(3)[:, None]) & 1)[:, None]  # the half of each axis of each octant
_SMALL = 0.6  # of the extent: a smaller remainder gets a new grid
_TIGHT = 0.02  # of the extent: the search ends when a round shrinks it by less
_PARTS = 4  # along each axis of a box, for is_full
_PLACES, _SOME = 256, 4  # sample points of a field, and the number of zeros that chance does not explain
_NOUGHT = 1e-9  # of the median magnitude: smaller values may be 0
_SPREAD = 0.8191725133961645 ** np.arange(1, 4)  # low-discrepancy additive recurrence (Roberts 2018)
_FACE = 8  # initial pieces along the edge of a face


def find_bounds(tape: Tape) -> np.ndarray | None:
    """A box (2, 3) of all points where a field is at most 0; None if it reaches farther than FARTHEST, or may.

    Of the boxes that may hold such points only those on the outside of all of them are cut up further, until that is of no use any more.
    """
    low, high = np.full((3, 1), -FARTHEST), np.full((3, 1), FARTHEST)
    before, stale = np.inf, 0
    bounds = np.stack([low[:, 0], high[:, 0]])
    extent = bounds
    for _ in range(ROUNDS):
        keep = _may_hold(tape, low, high)
        low, high = low[:, keep], high[:, keep]
        if not low.shape[1]:
            return None
        extent = _around(low, high)
        size = _size(extent)
        stale = stale + 1 if size > (1 - _TIGHT) * before else 0
        if stale > STALE:
            break
        before = min(size, before)
        outer = _outer(low, high, extent)
        if low.shape[1] + 7 * int(outer.sum()) > MOST_BOXES:
            break
        low, high = _cut(low, high, outer)
    widened = _wider(extent, bounds)
    return None if np.abs(widened).max() >= FARTHEST else widened


def shrink_bounds(tape: Tape, bounds: np.ndarray, limits: np.ndarray | None = None) -> np.ndarray | None:
    """A box (2, 3), within `limits` or `bounds`, of all points in `bounds` where a field is at most 0; None without such points.

    A grid says which parts may hold such points; another does where these are but a small part of the whole. Of its cells, those on the
    outside of all of them are cut up further, where these are few.
    """
    low, high = bounds[0][:, None], bounds[1][:, None]
    for _ in range(ROUNDS):
        around = _around(low, high)
        low, high = _gridded(around)
        keep = _may_hold(tape, low, high)
        low, high = low[:, keep], high[:, keep]
        if not low.shape[1]:
            return None
        if _size(_around(low, high)) > _SMALL * _size(around):
            break
    for _ in range(_FINER):
        outer = _outer(low, high, _around(low, high)) if low.shape[1] else np.zeros(0, bool)
        if not 0 < outer.sum() <= _MOST_OUTER:
            break
        a, b = _halved(low[:, outer], high[:, outer])
        keep = _may_hold(tape, a, b)
        low, high = (np.concatenate([p[:, ~outer], part[:, keep]], axis=1) for p, part in ((low, a), (high, b)))
    return _wider(_around(low, high), bounds if limits is None else limits) if low.shape[1] else None


def _gridded(bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The cells (3, n) of a grid in a box, their lowest and highest corners."""
    edges, axes = np.linspace(bounds[0], bounds[1], _GRID + 1, axis=1), np.arange(3)[:, None]
    return edges[axes, _CELLS], edges[axes, _CELLS + 1]


def _around(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The union (2, 3) of boxes."""
    return np.stack([np.minimum.reduce(low, axis=1), np.maximum.reduce(high, axis=1)])


def _size(box: np.ndarray) -> float:
    return float((box[1] - box[0]).sum())


def _outer(low: np.ndarray, high: np.ndarray, extent: np.ndarray) -> np.ndarray:
    """Whether each box touches the union of all."""
    return ((low <= extent[0][:, None]) | (high >= extent[1][:, None])).any(axis=0)


def _wider(extent: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    margin = 0.01 * (extent[1] - extent[0]) + 1e-9
    return np.stack([np.maximum(extent[0] - margin, bounds[0]), np.minimum(extent[1] + margin, bounds[1])])


def crosses_faces(tape: Tape, bounds: np.ndarray) -> bool:
    """Whether a field may be 0 or less somewhere on the faces of a box (2, 3)."""
    low, high = [], []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        edges = [np.linspace(bounds[0, k], bounds[1, k], _FACE + 1) for k in others]
        u, v = (p.ravel() for p in np.meshgrid(np.arange(_FACE), np.arange(_FACE)))
        for side in range(2):
            a, b = np.empty((3, _FACE**2)), np.empty((3, _FACE**2))
            a[axis] = b[axis] = bounds[side, axis]
            for k, edge, index in ((others[0], edges[0], u), (others[1], edges[1], v)):
                a[k], b[k] = edge[index], edge[index + 1]
            low.append(a)
            high.append(b)
    a, b = np.concatenate(low, axis=1), np.concatenate(high, axis=1)
    for _ in range(5):
        if (batches(tape).points(0.5 * (a + b)) <= 0).any():
            return True
        keep = _may_hold(tape, a, b)
        a, b = a[:, keep], b[:, keep]
        if not a.shape[1] or a.shape[1] > MOST_BOXES // 8:
            return a.shape[1] > 0
        a, b = _cut(a, b, np.ones(a.shape[1], bool))
        flat = a == b  # along the face's normal both halves are the same
        odd = np.zeros(a.shape[1], bool)
        for axis in range(3):
            odd |= flat[axis] & ((np.arange(a.shape[1]) >> axis) & 1 == 1)
        a, b = a[:, ~odd], b[:, ~odd]
    return True


def _may_hold(tape: Tape, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    (least, _), _ = batches(tape).boxes(low, high)
    return least <= 0.0


def _cut(low: np.ndarray, high: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes with the chosen ones in eight: each edge cut at 0 if it holds that, else at the geometric mean, in the middle if it is short.

    The eighths of one box stand side by side, axis 0 first in the bits of their place.
    """
    a, b = low[:, chosen], high[:, chosen]
    near, far = np.minimum(np.abs(a), np.abs(b)), np.maximum(np.abs(a), np.abs(b))
    geometric = np.sign(a + b) * np.sqrt(np.maximum(near, far / 64) * far)
    middle = np.where(
        (a < 0) & (b > 0), np.where((a + b == 0) | (far < 8 * near), 0.0, 0.5 * (a + b)), np.where(far > 4 * near, geometric, 0.5 * (a + b))
    )
    middle = np.where((middle > a) & (middle < b), middle, 0.5 * (a + b))
    a, b = _eighths(a, middle, b)
    return np.concatenate([a, low[:, ~chosen]], axis=1), np.concatenate([b, high[:, ~chosen]], axis=1)


def _halved(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Boxes, each subdivided into octants."""
    return _eighths(low, 0.5 * (low + high), high)


def _eighths(low: np.ndarray, middle: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The eighths of boxes that are cut there, those of each side by side."""
    (a, b), cut = (p[:, :, None] for p in (low, high)), middle[:, :, None]
    return np.where(_EIGHTHS == 0, a, cut).reshape(3, -1), np.where(_EIGHTHS == 1, b, cut).reshape(3, -1)


def sample_field(tape: Tape, bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, n) that fill a box (2, 3) evenly, and the values of a field there."""
    share = (np.arange(_PLACES)[:, None] * _SPREAD + 0.5) % 1.0
    place = (bounds[0] + share * (bounds[1] - bounds[0])).T
    return place, batches(tape).points(place)


def is_full(tape: Tape, bounds: np.ndarray, some: np.ndarray) -> bool:
    """Whether a field is proved to be at most 0 all over a box (2, 3): by its sampled values `some`, then by interval bounds of parts."""
    if not (some <= 0).all():
        return False
    edges = bounds[0] + np.linspace(0.0, 1.0, _PARTS + 1)[:, None] * (bounds[1] - bounds[0])
    cells = np.stack(np.meshgrid(*[np.arange(_PARTS)] * 3, indexing="ij")).reshape(3, -1)
    low, high = (np.stack([edges[cells[axis] + side, axis] for axis in range(3)]) for side in (0, 1))
    (_, most), maybe = batches(tape).boxes(low, high)
    return bool(((most <= 0) & ~maybe).all())


def is_zero_over_region(tape: Tape, place: np.ndarray, values: np.ndarray) -> bool:
    """Whether a field seems to be 0 over a part of a box, by its `values` at sample points (3, n)."""
    size = np.abs(values)
    finite = size[np.isfinite(size)]
    if not len(finite):
        return False
    middle = len(finite) // 2
    near = place[:, size <= _NOUGHT * np.partition(finite, middle)[middle]]
    if near.shape[1] < _SOME:
        return False
    (low, high), _ = batches(tape).boxes(near, near)
    return int(((low <= 0) & (high >= 0)).sum()) >= _SOME
