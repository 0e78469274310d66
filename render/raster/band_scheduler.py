"""Bands that threads take by turns: each draws as many as it gets, in one call, without going back to Python between them.

Threads that do go back wait for each other at Python's lock, and a processor that waits goes to sleep: of a frame of three
milliseconds that takes a third.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from ..jit.function_pointer import DeclaredPointer, compiled_address
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..simd import target
from ..simd.atomics import fetch_add
from . import deferred_shading, triangle_setup

call_fill, call_shade = DeclaredPointer(types.none).call, DeclaredPointer(types.none).call
CROP, PICTURE = types.int64[::1], types.float32[:, :, ::1]
AT_ONCE = 0.02  # seconds after which a thread looks whether it shall stop


class BandQueue:
    """The bands of one picture, taken by any number of threads."""

    def __init__(self, layout: tuple[int, ...], threads: int, cost: float, how: tuple[Any, ...]) -> None:
        """`layout` and `how` as `draw` takes them; `cost` in seconds of one thread; `threads` is 0 for one a core."""
        self.layout, self.how, bands = layout, how, layout[1]
        self.most = -(-bands // max(1, round(cost / AT_ONCE)))
        self.jobs = max(-(-bands // self.most), min(threads or target.cores(), bands))  # calls of `draw` that are enough
        self.kinds = *(types.none if value is None else types.boolean for value in how[:-2]), CROP, PICTURE
        self.next_band = np.zeros(1, np.int64)

    def draw(self, filling: Handle, shading: Handle) -> tuple[NDArray[np.int64], int]:
        """Draw what a turn gets: the bands' numbers, and how many of their items were not finite and left out."""
        fill = compiled_address(triangle_setup.draw_band, filling.numba_type, types.int64)
        shade = compiled_address(deferred_shading.shade_band, shading.numba_type, *self.kinds)
        numbers = np.empty(self.most, np.int64)
        found, issues = draw(fill, shade, filling, shading, self.layout, self.next_band, numbers, *self.how)
        return numbers[:found], issues


@helper
def aim(band: Any, job: int, rows: int, margin: int, reach: int, crop: Any) -> None:
    """Let a buffer stand for band `job` of a picture, of so many rows, of which `crop` (x0, y0, x1, y1) is drawn."""
    top, bottom = max(job * rows, crop[1]), min((job + 1) * rows, crop[3])
    band.place[0], band.place[1] = (crop[0] & ~3) - margin, job * rows - margin  # on a grid of blocks that no crop moves
    band.clip[0], band.clip[1], band.clip[2], band.clip[3] = crop[0] - reach, top - reach, crop[2] + reach, bottom + reach
    band.rows[0], band.rows[1] = top, bottom


@kernel
def draw(fill, shade, filling, shading, layout, next_band, numbers, each, fresh, patterned, colored, flat, crop, rgba):
    """Fill and light bands as long as there are any, up to as many as `numbers` takes, and write which.

    How many, and how many of their items were not finite. `fill` and `shade` are addresses of setup.draw_band and deferred.shade_band,
    which says what the last arguments are; `layout` is the first band's number, how many there are, their rows, margin and reach;
    `next_band` a counter that threads share.
    """
    first, bands, rows, margin, reach = layout
    found = issues = 0
    while found < len(numbers):
        number = fetch_add(next_band, 0, 1)
        if number >= bands:
            break
        aim(filling.band, first + number, rows, margin, reach, crop)
        call_fill(fill, (filling, number))
        call_shade(shade, (shading, each, fresh, patterned, colored, flat, crop, rgba))
        issues += shading.items.counts[3]
        numbers[found] = number
        found += 1
    return found, issues
