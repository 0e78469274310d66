"""Hits of camera rays with formula surfaces, found by packets before shading (camera_rays.py).

The BVH traversal of a camera ray then tests only instances with the bit CAMERA_REST; the closer of both hits counts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiler import ir
from ...jit.kernel import helper
from ...jit.packed_struct import HandleType
from ...lanes import crosslane, ops
from ...simd.registration import overload, types
from ...types import Hit, Lane
from ..bvh_build import scene_layout
from ..bvh_build.scene_layout import VISIBILITY

SIDE = 64  # pixels of a tile's side, so that its rays fill a packet
PACKET = SIDE**2  # samples of a packet: formula.packet_state.RAYS, which only scenes with formulas load
QUICK = 2  # samples a pixel up to which tiles of large pictures hold four packets
ROUNDS, ROWS, COLUMNS, SAMPLES = range(4)  # of TileHits.extent
CAMERA, REST = int(ir.Visibility.CAMERA), scene_layout.CAMERA_REST


class Nothing(NamedTuple):
    """The absence of formula surfaces visible to camera rays."""


class TileHits(NamedTuple):
    """Hits of a tile: sample s of a pixel p = row · columns + column has the slot start[p] + s − first[p].

    Where each pixel has one sample at most, slots are in the order of packets, of PACKET samples each.
    """

    extent: NDArray[np.int64]  # (4,) greatest number of samples of a pixel, rows, columns, samples of all pixels
    start: NDArray[np.int64]  # (pixels,)
    first: NDArray[np.int64]  # (pixels,) number of the first sample
    corner: NDArray[np.int64]  # x0, y0 of the tile; the first sample of all pixels, or -1 where it differs
    items: NDArray[np.int64]  # of each packet its samples' columns, rows and numbers, relative to the tile's corner and first samples
    rays: NDArray[np.float64]  # (packets, 8, …) in the layout of ray_soa
    t: NDArray[np.float64]  # (slots,)
    instance: NDArray[np.int32]
    spacing: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    black: bool = False  # whether a camera ray without such a hit hits nothing and is black
    hidden: Any = Nothing()  # (slots,) hidden lights, see shadow_rays, where they are computed


def is_needed(bvh: scene_layout.Bvh) -> bool:
    """Whether packets can trace any formula surface: visible to camera rays, without motion or partial opacity."""
    return len(packet_instances(bvh)) > 0


def packet_instances(bvh: scene_layout.Bvh) -> NDArray[np.intp]:
    """The instances of those surfaces."""
    return np.flatnonzero((bvh.instance_rows[:, VISIBILITY] & (CAMERA | REST)) == CAMERA)


def is_used(primed: Any) -> bool:
    """Whether a record of this Numba type holds packet hits."""
    return isinstance(primed, HandleType) and primed.field("start") is not None


@helper
def slot_of(primed: Any, x: Lane, y: Lane, s: Lane) -> Lane:
    """The slots of samples s of pixels x, y."""
    extent = primed.extent
    row, column = _clip(y - primed.corner[1], extent[ROWS]), _clip(x - primed.corner[0], extent[COLUMNS])
    pixel = row * extent[COLUMNS] + column
    return _clip(primed.start[pixel] + _clip(s - primed.first[pixel], extent[ROUNDS]), extent[SAMPLES])


def load_slots(column: Any, slot: Any) -> Lane:
    """Values of a column in slots; a number is the first of consecutive slots, and lanes beyond the end repeat the last value."""
    raise NotImplementedError("in kernels only")


@overload(load_slots)
def _load_slots_in_kernels(column, slot):
    if not isinstance(slot, types.Integer):
        return lambda column, slot: column[slot]
    return lambda column, slot: _load_row(column, slot)


@helper
def _load_row(column: Any, start: int) -> Lane:
    n = len(column)
    if start + crosslane.WIDTH <= n:  # several times as fast as a gather
        return crosslane.load_at(column, start)
    return column[ops.minimum(crosslane.lane_indices(start), n - 1)]


@helper
def load_pixels(items: Any, start: int) -> tuple[Lane, Lane, Lane]:
    """(columns, rows, numbers) of samples from `start` on; lanes beyond the end repeat the last one."""
    n = len(items) // 3
    if start + crosslane.WIDTH <= n:
        return crosslane.load_at(items, start), crosslane.load_at(items, n + start), crosslane.load_at(items, 2 * n + start)
    slot = ops.minimum(crosslane.lane_indices(start), n - 1)
    return items[slot], items[n + slot], items[2 * n + slot]


@helper
def first_samples(corner: Any, first: Any, columns: int, x: Lane, y: Lane) -> Lane:
    """Numbers of the first samples of a tile's pixels, from parts of TileHits."""
    numbers = ops.int_like(x, corner[2])
    if corner[2] < 0:
        numbers = first[y * columns + x]
    return numbers


def gather(column: Any, slot: Any) -> Lane:
    """`load_slots` for a column of any type."""
    raise NotImplementedError("in kernels only")


@overload(gather)
def _gather_in_kernels(column, slot):
    if not isinstance(slot, types.Integer):
        return lambda column, slot: column[slot]
    return lambda column, slot: column[ops.minimum(crosslane.lane_indices(slot), len(column) - 1)]


@helper
def closer_hit(primed: Any, slot: Any, hit: Hit) -> tuple[Hit, Any]:
    """(`hit` or the packet hits in slots, or from one slot on, where those are closer; the hidden lights known there)."""
    t = load_slots(primed.t, slot)
    first = (t <= hit.t) & (t < np.inf)
    if ops.any_lane(first):
        i = ops.to_int(gather(primed.instance, slot))
        first = first & ((t < hit.t) | (i < hit.instance))
        spacing, u, v = load_slots(primed.spacing, slot), load_slots(primed.u, slot), load_slots(primed.v, slot)
        hit = Hit(
            ops.where(first, t, hit.t), ops.where(first, i, hit.instance), ops.where(first, spacing, hit.primitive),
            ops.where(first, u, hit.u), ops.where(first, v, hit.v),
        )  # fmt: skip
    return hit, _known(primed, first, slot)


def _known(primed: Any, first: Lane, slot: Lane) -> Any:
    """Hidden lights in the lanes of a mask, in kernels."""
    raise NotImplementedError


@overload(_known)
def _known_in_kernels(primed, first, slot):
    if primed.field("hidden")[1] == ():
        return lambda primed, first, slot: None
    return lambda primed, first, slot: ops.where(first, load_slots(primed.hidden, slot), 0)


@helper
def _clip(number: Lane, count: int) -> Lane:
    """Clip indices: lanes beyond a tile's samples are drawn and discarded."""
    return ops.maximum(ops.minimum(number, count - 1), 0)


def tile_side(width: int, height: int, samples: int) -> int:
    """Pixels of a tile's side for a picture."""
    return 2 * SIDE if min(width, height) >= 8 * SIDE and samples <= QUICK else SIDE
