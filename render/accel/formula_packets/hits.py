"""What camera rays were found beforehand to meet of formula surfaces (bundled.py), beside what trees find of everything else.

The trees are asked for what has the bit bvh.CAMERA_REST, and the nearer of both counts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from ....compiler import ir
from ...jit.kernel import HELPER, helper, kernel
from ...jit.packed_struct import HandleType
from ...lanes import crosslane, ops
from ...types import Hit, Lane
from ..build import scene_layout

SIDE = 64  # pixels of a tile's side, so that its rays fill a bundle
QUICK = 2  # samples of a pixel, up to which tiles of large pictures hold four bundles: there is Python between tiles
CAMERA, REST = int(ir.Visibility.CAMERA), scene_layout.CAMERA_REST


class Nothing(NamedTuple):
    """No formula surface is seen by camera rays."""


class Primed(NamedTuple):
    """What was found: for sample s of a pixel in slots[(s − its first) · pixels + row · columns + column]."""

    rounds: int
    rows: int
    columns: int
    slots: NDArray[np.int64]
    first: NDArray[np.int64]  # (pixels,) number of the first sample
    corner: NDArray[np.int64]  # x0, y0 of the tile; the number of all pixels' first sample, or -1
    items: NDArray[np.int64]  # (3 · samples,) columns, rows and numbers of samples, from the tile's corner and first ones
    rays: NDArray[np.float64]  # of samples, as columns.py has them, one column behind the other: shapes of rows are types
    t: NDArray[np.float64]
    instance: NDArray[np.int64]
    spacing: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    black: bool = False  # whether a camera ray that meets none of these brings no light, and meets nothing else
    hidden: Any = Nothing()  # (samples,) lamps, as hidden.py has them, where these are asked for


def is_needed(trees: scene_layout.Bvh) -> bool:
    """Whether any formula surface is seen by camera rays, and is not one that moves or is partly there."""
    return len(instances(trees)) > 0


def instances(trees: scene_layout.Bvh) -> NDArray[np.intp]:
    """Those surfaces."""
    return np.flatnonzero((trees.instance_rows[:, 0] & (CAMERA | REST)) == CAMERA)


def is_used(primed: Any) -> bool:
    """Whether kernels' record of this Numba type has anything that was found beforehand."""
    return isinstance(primed, HandleType) and primed.field("slots") is not None


@helper
def slot_of(primed: Any, x: Lane, y: Lane, s: Lane) -> Lane:
    """The slots of samples s of pixels x, y."""
    row = _clipped(y - primed.corner[1], primed.rows)
    column = _clipped(x - primed.corner[0], primed.columns)
    at = row * primed.columns + column
    k = _clipped(s - primed.first[at], primed.rounds)
    return ops.maximum(primed.slots[k * len(primed.first) + at], 0)


def taken(column: Any, slot: Any) -> Lane:
    """What stands in the slots of a column; of a number, in as many as there are lanes from there on, the last again beyond the end."""
    raise NotImplementedError("in kernels only")


@overload(taken, jit_options=HELPER)
def _taken(column, slot):
    if not isinstance(slot, types.Integer):
        return lambda column, slot: column[slot]
    return lambda column, slot: _in_a_row(column, slot)


@helper
def _in_a_row(column: Any, start: int) -> Lane:
    n = len(column)
    if start + crosslane.WIDTH <= n:  # several times as fast as from places of lanes
        return crosslane.load_at(column, start)
    return column[ops.minimum(crosslane.lane_indices(start), n - 1)]


@helper
def pixels(items: Any, start: int) -> tuple[Lane, Lane, Lane]:
    """The columns, rows and numbers of samples from `start` on; the last again beyond the end."""
    n = len(items) // 3
    if start + crosslane.WIDTH <= n:
        return crosslane.load_at(items, start), crosslane.load_at(items, n + start), crosslane.load_at(items, 2 * n + start)
    slot = ops.minimum(crosslane.lane_indices(start), n - 1)
    return items[slot], items[n + slot], items[2 * n + slot]


@helper
def first_samples(corner: Any, first: Any, columns: int, x: Lane, y: Lane) -> Lane:
    """Numbers of the first samples of a tile's pixels, by these parts of a Primed."""
    found = ops.int_like(x, corner[2])
    if corner[2] < 0:
        found = first[y * columns + x]
    return found


@kernel
def begin(firsts, left, top, first, corner, t, instance):
    """Set parts of a Primed for a tile with this corner, nothing met yet; `firsts` (rows, columns) are its pixels' first samples."""
    rows, columns = firsts.shape
    same = firsts[0, 0] if rows * columns > 0 else -1
    for row in range(rows):
        for column in range(columns):
            number = firsts[row, column]
            first[row * columns + column] = number
            same = same if number == same else -1
    corner[0], corner[1], corner[2] = left, top, same
    for i in range(len(t)):
        t[i], instance[i] = np.inf, -1


@helper
def nearer_in(primed: Any, slot: Any, hit: Hit) -> tuple[Hit, Any]:
    """`hit`, or what samples in these slots, or from this one on, were found beforehand to meet, where that comes first; what is known
    there of lamps."""
    t = taken(primed.t, slot)
    first = (t <= hit.t) & (t < np.inf)
    if ops.any_lane(first):
        i = taken(primed.instance, slot)
        first = first & ((t < hit.t) | (i < hit.instance))
        spacing, u, v = taken(primed.spacing, slot), taken(primed.u, slot), taken(primed.v, slot)
        hit = Hit(
            ops.where(first, t, hit.t), ops.where(first, i, hit.instance), ops.where(first, spacing, hit.primitive),
            ops.where(first, u, hit.u), ops.where(first, v, hit.v),
        )  # fmt: skip
    return hit, _known(primed, first, slot)


def _known(primed: Any, first: Lane, slot: Lane) -> Any:
    """What is known of lamps in the lanes of a mask, in kernels."""
    raise NotImplementedError


@overload(_known, jit_options=HELPER)
def _known_in_kernels(primed, first, slot):
    if primed.field("hidden")[1] == ():
        return lambda primed, first, slot: None
    return lambda primed, first, slot: ops.where(first, taken(primed.hidden, slot), 0)


@helper
def _clipped(number: Lane, count: int) -> Lane:
    """Lanes beyond a tile's samples are drawn, too, and thrown away."""
    return ops.maximum(ops.minimum(number, count - 1), 0)


def side(width: int, height: int, samples: int) -> int:
    """Pixels of a tile's side in a picture."""
    return 2 * SIDE if min(width, height) >= 8 * SIDE and samples <= QUICK else SIDE
