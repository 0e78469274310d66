"""Kernels that look at all pixels of a finished picture, rows of it on each thread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import thread_pool
from ..jit.kernel import kernel

ROWS = 64  # of pixels, that a thread takes at a time


def squares(values: NDArray[np.float32], threads: int) -> NDArray[np.float64]:
    """Return the squares of numbers (h, w, 3) in float64."""
    out = np.empty(values.shape)
    thread_pool.parallel_for(lambda top: square_rows(values, top, top + ROWS, out), range(0, len(out), ROWS), threads)
    return out


def brightest(rgba: NDArray[np.float32], transparent: bool, threads: int) -> tuple[float, bool]:
    """Return (the greatest finite red, green or blue, or -inf; whether any pixel is covered).

    A pixel with a component that is not finite does not count, of a `transparent` picture pixels without coverage as well.
    """
    maxima: list[tuple[float, bool]] = []
    thread_pool.parallel_for(
        lambda top: maxima.append(brightest_of_rows(rgba, top, top + ROWS, transparent)), range(0, len(rgba), ROWS), threads
    )
    return max((light for light, _ in maxima), default=-np.inf), any(covered for _, covered in maxima)


@kernel
def square_rows(values, top, bottom, out):
    """Write the squares of rows `top` to `bottom` of (h, w, 3) numbers."""
    for y in range(top, min(bottom, values.shape[0])):
        for x in range(values.shape[1]):
            for k in range(3):
                value = np.float64(values[y, x, k])
                out[y, x, k] = value * value


@kernel
def brightest_of_rows(rgba, top, bottom, transparent):
    """`brightest` for rows `top` to `bottom`."""
    most, covered = -np.inf, False
    for y in range(top, min(bottom, rgba.shape[0])):
        for x in range(rgba.shape[1]):
            red, green, blue = np.float64(rgba[y, x, 0]), np.float64(rgba[y, x, 1]), np.float64(rgba[y, x, 2])
            seen = rgba[y, x, 3] > 0.0
            covered = covered or seen
            light = max(red, green, blue)
            is_finite = red == red and green == green and blue == blue and abs(light) < np.inf
            if is_finite and light > most and (seen or not transparent):
                most = light
    return most, covered
