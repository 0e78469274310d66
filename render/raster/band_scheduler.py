"""Work queue of bands: each call draws many bands of a picture without a return to Python.

Returns to Python contend for its lock, and a waiting processor goes to sleep: this costs a third of a frame of three milliseconds.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.function_pointer import DeclaredPointer, compiled_address
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..jit.value_types import BOOL, INT64, NONE, array_type
from ..simd import target
from ..simd.atomics import fetch_add
from . import deferred_shading, triangle_setup
from .fragments import NOT_FINITE

call_fill, call_shade = DeclaredPointer(NONE).call, DeclaredPointer(NONE).call
CROP, PICTURE = array_type(np.int64, 1), array_type(np.float32, 3)
CALL_SECONDS = 0.02  # length of a call, after which a thread checks for cancellation


class BandLayout(NamedTuple):
    """The bands of a picture."""

    first: int  # number of the first
    count: int
    rows: int  # of pixels, of a band
    margin: int  # pixels around a band in its buffer
    reach: int  # pixels around a band that its samples count for


class ShadingTarget(NamedTuple):
    """The arguments of `deferred_shading.shade_band` after the first."""

    per_sample: bool
    textured: Any
    colored: Any
    flat: Any
    crop: NDArray[np.int64]
    rgba: NDArray[np.float32]


class BandQueue:
    """The bands of one picture, drawn by any number of threads."""

    def __init__(self, layout: BandLayout, threads: int, cost: float, output: ShadingTarget) -> None:
        """`cost` is in seconds of one thread; `threads` is 0 for one a core."""
        self.layout, self.output = layout, output
        self.most = -(-layout.count // max(1, round(cost / CALL_SECONDS)))
        self.jobs = max(-(-layout.count // self.most), min(threads or target.cores(), layout.count))  # calls of `draw`
        kinds = (NONE if value is None else BOOL for value in (output.textured, output.colored, output.flat))
        self.kinds = BOOL, BOOL, *kinds, CROP, PICTURE
        self.next_band = np.zeros(1, np.int64)

    def draw(self, filling: Handle, shading: Handle) -> tuple[NDArray[np.int64], int]:
        """Draw bands until the queue is empty or the call's limit is reached: their numbers, and the number of fragments not finite."""
        fill = compiled_address(triangle_setup.draw_band, filling.type, INT64)
        shade = compiled_address(deferred_shading.shade_band, shading.type, *self.kinds)
        numbers = np.empty(self.most, np.int64)
        drawn, issues = draw_bands(fill, shade, filling, shading, self.layout, self.output, self.next_band, numbers)
        return numbers[:drawn], issues


@helper
def set_band(band: Any, job: int, rows: int, margin: int, reach: int, crop: Any) -> None:
    """Assign a buffer to band `job` of a picture; bands have `rows` rows, `crop` (x0, y0, x1, y1) is drawn."""
    top, bottom = max(job * rows, crop[1]), min((job + 1) * rows, crop[3])
    band.window[0], band.window[1] = (crop[0] & ~3) - margin, job * rows - margin  # the grid of blocks is independent of the crop
    band.clip[0], band.clip[1], band.clip[2], band.clip[3] = crop[0] - reach, top - reach, crop[2] + reach, bottom + reach
    band.rows[0], band.rows[1] = top, bottom


@kernel
def draw_bands(fill, shade, filling, shading, layout, output, next_band, numbers):
    """Fill and shade bands until none is left or `numbers` is full; writes their numbers.

    `fill` and `shade` are addresses of triangle_setup.draw_band and deferred_shading.shade_band, `next_band` a counter that all threads
    share. Returns how many bands were drawn, and how many of their fragments were not finite.
    """
    drawn = issues = 0
    while drawn < len(numbers):
        number = fetch_add(next_band, 0, 1)
        if number >= layout.count:
            break
        set_band(filling.band, layout.first + number, layout.rows, layout.margin, layout.reach, output.crop)
        call_fill(fill, (filling, number))
        call_shade(shade, (shading, output.per_sample, True, output.textured, output.colored, output.flat, output.crop, output.rgba))
        issues += shading.fragments.counts[NOT_FINITE]
        numbers[drawn] = number
        drawn += 1
    return drawn, issues
