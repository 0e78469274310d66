"""How far a formula's surface reaches, by bounds of the formula over ever smaller boxes."""

from __future__ import annotations

import numpy as np

from . import tape_walks
from .tapes import Tape

FARTHEST = 1e6  # units of the formula: what reaches farther counts as endless
ROUNDS = 48
MOST_BOXES = 20_000
STALE = 5  # rounds in which it does not shrink, after which it is as small as it gets; of a box that was given one is enough
_TIGHT = 0.02  # of the extent: rounds that shrink it by less are the last
_PLACES, _SOME = 256, 4  # where a field is asked whether it is 0, and how many of these are more than chance
_NOUGHT = 1e-9  # of what is usual: values below this may be 0
_SPREAD = 0.8191725133961645 ** np.arange(1, 4)  # an additive recurrence that fills boxes evenly (Roberts 2018)
_FACE = 8  # pieces along the edge of a face, to begin with


def find(tape: Tape) -> np.ndarray | None:
    """(2, 3) a box around all points where a field is not above 0, or None where it reaches farther than FARTHEST, or that is not known."""
    found = tightened(tape, np.array([[-FARTHEST] * 3, [FARTHEST] * 3]), STALE)
    if found is None or np.abs(found).max() >= FARTHEST:
        return None
    return found


def tightened(tape: Tape, bounds: np.ndarray, patience: int = 1) -> np.ndarray | None:
    """(2, 3) a box, within `bounds`, around all points there where a field is not above 0; None where there are none.

    Of the boxes that may hold such points only those on the outside of all of them are cut up further, until that has been of no use for
    more than `patience` rounds.
    """
    low, high = (bounds[k][:, None] for k in range(2))
    before, stale = np.inf, 0
    extent = bounds
    for _ in range(ROUNDS):
        keep = _may_hold(tape, low, high)
        low, high = low[:, keep], high[:, keep]
        if not low.shape[1]:
            return None
        extent = np.stack([low.min(axis=1), high.max(axis=1)])
        size = float((extent[1] - extent[0]).sum())
        stale = stale + 1 if size > (1 - _TIGHT) * before else 0
        if stale > patience:
            break
        before = min(size, before)
        outer = ((low <= extent[0][:, None]) | (high >= extent[1][:, None])).any(axis=0)
        if low.shape[1] + 7 * int(outer.sum()) > MOST_BOXES:
            break
        low, high = _cut(low, high, outer)
    margin = 0.01 * (extent[1] - extent[0]) + 1e-9
    return np.stack([np.maximum(extent[0] - margin, bounds[0]), np.minimum(extent[1] + margin, bounds[1])])


def leaves_open(tape: Tape, bounds: np.ndarray) -> bool:
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
        keep = _may_hold(tape, a, b)
        a, b = a[:, keep], b[:, keep]
        if not a.shape[1]:
            return False
        middle = tape_walks.points(tape, *(0.5 * (a + b)))[0]
        if (middle <= 0).any() or a.shape[1] > MOST_BOXES // 8:
            return True
        a, b = _cut(a, b, np.ones(a.shape[1], bool))
        flat = a == b  # of a face's own axis both halves are the same
        odd = np.zeros(a.shape[1], bool)
        for axis in range(3):
            odd |= flat[axis] & ((np.arange(a.shape[1]) >> axis) & 1 == 1)
        a, b = a[:, ~odd], b[:, ~odd]
    return True


def _may_hold(tape: Tape, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    (least, _), _, _ = tape_walks.boxes(tape, low, high)
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
    lows, highs = [], []
    for part in range(8):
        bit = (part >> np.arange(3)[:, None]) & 1
        lows.append(np.where(bit, middle, a))
        highs.append(np.where(bit, b, middle))
    a, b = (np.stack(rows, axis=2).reshape(3, -1) for rows in (lows, highs))
    return np.concatenate([a, low[:, ~chosen]], axis=1), np.concatenate([b, high[:, ~chosen]], axis=1)


def zero_all_over(tape: Tape, bounds: np.ndarray) -> bool:
    """Whether a field is 0 in a part of a box (2, 3): for all that can be told it is at some of a few places spread over it."""
    share = (np.arange(_PLACES)[:, None] * _SPREAD + 0.5) % 1.0
    place = (bounds[0] + share * (bounds[1] - bounds[0])).T
    with np.errstate(invalid="ignore"):
        value = np.abs(tape_walks.points(tape, *place)[0])
        near = place[:, value <= _NOUGHT * np.median(value[np.isfinite(value)])] if np.isfinite(value).any() else place[:, :0]
    if near.shape[1] < _SOME:
        return False
    (low, high), _, _ = tape_walks.boxes(tape, near, near)
    return int(((low <= 0) & (high >= 0)).sum()) >= _SOME
