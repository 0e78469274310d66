"""What camera rays were found beforehand to meet of formula surfaces (bundled.py), beside what trees find of everything else.

The trees are asked for what has the bit bvh.CAMERA_REST, and the nearer of both counts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ..compiler import ir
from . import bvh, lanes
from .handles import HandleType
from .kernels import HELPER, helper
from .records import Hit, Lane

SIDE = 64  # pixels of a tile's side, so that its rays fill a bundle
QUICK = 2  # samples of a pixel, up to which tiles of large pictures hold four bundles: there is Python between tiles
CAMERA, REST = int(ir.Visibility.CAMERA), bvh.CAMERA_REST


class Nothing(NamedTuple):
    """No formula surface is seen by camera rays."""


class Primed(NamedTuple):
    """What was found: for sample s of a pixel in slots[(s − its first) · pixels + row · columns + column]."""

    rounds: int
    rows: int
    columns: int
    slots: NDArray[np.int64]
    first: NDArray[np.int64]  # (pixels,) number of the first sample
    corner: NDArray[np.int64]  # x0, y0 of the tile
    items: NDArray[np.int64]  # (3, samples) column, row and number of samples, from the tile's corner and first ones
    rays: NDArray[np.float64]  # of samples, as columns.py has them
    t: NDArray[np.float64]
    instance: NDArray[np.int64]
    spacing: NDArray[np.int64]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    hidden: Any = Nothing()  # (samples,) lamps, as hidden.py has them, where these are asked for


def is_needed(trees: bvh.Bvh) -> bool:
    """Whether any formula surface is seen by camera rays, and is not one that moves or is partly there."""
    return len(instances(trees)) > 0


def instances(trees: bvh.Bvh) -> NDArray[np.intp]:
    """Those surfaces."""
    return np.flatnonzero((trees.placed[:, 0] & (CAMERA | REST)) == CAMERA)


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
    return lanes.maximum(primed.slots[k * len(primed.first) + at], 0)


@helper
def nearer_in(primed: Any, slot: Lane, hit: Hit) -> tuple[Hit, Any]:
    """`hit`, or what samples in these slots were found beforehand to meet, where that comes first; what is known there of lamps."""
    t = primed.t[slot]
    first = (t <= hit.t) & (t < np.inf)
    if lanes.any_lane(first):
        i = primed.instance[slot]
        first = first & ((t < hit.t) | (i < hit.instance))
        hit = Hit(
            lanes.where(first, t, hit.t), lanes.where(first, i, hit.instance), lanes.where(first, primed.spacing[slot], hit.primitive),
            lanes.where(first, primed.u[slot], hit.u), lanes.where(first, primed.v[slot], hit.v),
        )  # fmt: skip
    return hit, _known(primed, first, slot)


def _known(primed: Any, first: Lane, slot: Lane) -> Any:
    """What is known of lamps in the lanes of a mask, in kernels."""
    raise NotImplementedError


@overload(_known, jit_options=HELPER)
def _known_in_kernels(primed, first, slot):
    if primed.field("hidden")[1] == ():
        return lambda primed, first, slot: None
    return lambda primed, first, slot: lanes.where(first, primed.hidden[slot], 0)


@helper
def _clipped(number: Lane, count: int) -> Lane:
    """Lanes beyond a tile's samples are drawn, too, and thrown away."""
    return lanes.maximum(lanes.minimum(number, count - 1), 0)


def side(width: int, height: int, samples: int) -> int:
    """Pixels of a tile's side in a picture."""
    return 2 * SIDE if min(width, height) >= 8 * SIDE and samples <= QUICK else SIDE
