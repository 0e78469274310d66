"""Rays of an array in an order in which those side by side begin near each other, whatever the order they came in.

At the edges of what is seen neighbours stand on different things, far apart; sorted, most vectors of rays go one way and share what
they do. Blocks are sorted by Morton codes of where rays begin (Morton, "A Computer Oriented Geodetic Data Base", 1966).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..lanes import crosslane, ops
from ..types import Lane, Vec

BLOCK = 256  # rays that are sorted at a time
BITS = 4  # of a code for each axis
_SIDE, _CELLS = 1 << BITS, 1 << (3 * BITS // 2)  # and numbers that are counted at a time


@helper
def order(origin: Any, first: int, n: int, rows: Any) -> None:
    """Set the first n numbers of `rows`, of BLOCK, to first … first + n - 1, the rows of origins (…, 3), in their order.

    What is left of the last two vectors of them is set to the last one.
    """
    codes, passed = simd.stack_array(np.int64, BLOCK), simd.stack_array(np.int64, BLOCK)
    _codes(origin, first, n, codes)
    for k in range(n):
        simd.write(passed, k, k)
    _sorted(codes, passed, rows, n, 0)
    _sorted(codes, rows, passed, n, 3 * BITS // 2)
    last = first + simd.read(passed, n - 1)
    for k in range(n):
        simd.write(rows, k, first + simd.read(passed, k))
    for k in range(n, (n + 2 * crosslane.WIDTH - 1) // (2 * crosslane.WIDTH) * 2 * crosslane.WIDTH):
        simd.write(rows, k, last)


@helper
def _codes(origin: Any, first: int, n: int, codes: Any) -> None:
    """The Morton codes of n origins within the box around them."""
    x, y, z = _origins(origin, first, 0, n)
    low, high = (x, y, z), (x, y, z)
    for k in range(crosslane.WIDTH, n, crosslane.WIDTH):
        x, y, z = _origins(origin, first, k, n)
        low = ops.minimum(low[0], x), ops.minimum(low[1], y), ops.minimum(low[2], z)
        high = ops.maximum(high[0], x), ops.maximum(high[1], y), ops.maximum(high[2], z)
    left, under, before = crosslane.reduce_min(low[0]), crosslane.reduce_min(low[1]), crosslane.reduce_min(low[2])
    size = max(crosslane.reduce_max(high[0]) - left, max(crosslane.reduce_max(high[1]) - under, crosslane.reduce_max(high[2]) - before))
    scale = _SIDE / size if size > 0.0 else 0.0
    for k in range(0, n, crosslane.WIDTH):
        x, y, z = _origins(origin, first, k, n)
        code = _parted((x - left) * scale) | (_parted((y - under) * scale) << 1) | (_parted((z - before) * scale) << 2)
        crosslane.store(codes, k // crosslane.WIDTH, code)


@helper
def _origins(origin: Any, first: int, k: int, n: int) -> Vec:
    row = first + ops.minimum(crosslane.lane_indices(k), n - 1)
    return ops.to_float(origin[row, 0]), ops.to_float(origin[row, 1]), ops.to_float(origin[row, 2])


@helper
def _parted(x: Lane) -> Lane:
    """The bits of the whole part of 0 … 16, the last one of these included, each the third from the next."""
    bits = ops.to_int(ops.where(x < _SIDE, ops.maximum(x, 0.0), _SIDE - 1.0)) & (_SIDE - 1)
    bits = (bits | (bits << 4)) & 0xC3
    return (bits | (bits << 2)) & 0x249


@helper
def _sorted(codes: Any, places: Any, into: Any, n: int, shift: int) -> None:
    """Put n places into an array in the order of six bits of their codes; equal ones stay in order."""
    ends = simd.stack_array(np.int64, _CELLS)
    for cell in range(_CELLS):
        simd.write(ends, cell, 0)
    for k in range(n):
        cell = (simd.read(codes, k) >> shift) & (_CELLS - 1)
        simd.write(ends, cell, simd.read(ends, cell) + 1)
    before = np.int64(0)
    for cell in range(_CELLS):
        count = simd.read(ends, cell)
        simd.write(ends, cell, before)
        before += count
    for k in range(n):
        place = simd.read(places, k)
        cell = (simd.read(codes, place) >> shift) & (_CELLS - 1)
        end = simd.read(ends, cell)
        simd.write(into, end, place)
        simd.write(ends, cell, end + 1)
