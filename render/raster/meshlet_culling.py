"""Which meshlets the bands of a picture show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle

EVERYWHERE = 1 << 28  # pixels


class Drawn(NamedTuple):
    """Meshlets of instances that may be seen, in the order of ids, and room for as many as there are."""

    instance: NDArray[np.int32]
    meshlet: NDArray[np.int32]
    first: NDArray[np.int32]  # the meshlet's first triangle
    top: NDArray[np.int32]  # the first and the last row of pixels it may touch
    bottom: NDArray[np.int32]
    start: NDArray[np.int64]  # (bands + 1,) where each band's begin
    order: NDArray[np.int32]  # rows of this table, band by band
    count: NDArray[np.int64]  # (1,) how many there are


def drawn(
    shown: Handle, meshlets: Handle, placed: NDArray[np.int64], crop: tuple[int, ...], margin: int, rows: int, room: Handle | None = None
) -> Handle:  # fmt: skip
    """The meshlets of all instances that may touch a crop grown by `margin` pixels, in bands of `rows` rows from the picture's top on.

    They are written into `room`, an earlier answer for the same meshlets and as many bands, unless they do not fit.
    """
    first, bands = crop[1] // rows, bands_of(crop, rows)
    made = room or Handle(_room(int(placed[:, 1].sum()), bands, 0))
    window = crop[0] - margin, crop[1] - margin, crop[2] + margin, crop[3] + margin
    needed = list_meshlets(shown, meshlets, placed, window, first * rows, margin, rows, made)
    if needed > len(made.tables.order):
        made = Handle(_room(len(made.tables.instance) - 16, bands, needed + needed // 4))
        list_meshlets(shown, meshlets, placed, window, first * rows, margin, rows, made)
    return made


def bands_of(crop: tuple[int, ...], rows: int) -> int:
    """How many bands of so many rows a crop lies in."""
    return -(-crop[3] // rows) - crop[1] // rows


def _room(most: int, bands: int, places: int) -> Drawn:
    instance, meshlet, first, top, bottom = np.zeros((5, most + 16), np.int32)  # what is stored may go beyond the end
    start, order = np.zeros(bands + 1, np.int64), np.empty(max(places, most + bands), np.int32)
    return Drawn(instance, meshlet, first, top, bottom, start, order, np.zeros(1, np.int64))


@kernel
def list_meshlets(shown, meshlets, placed, window, y0, margin, rows, drawn):
    """Fill a Drawn, whose first band begins at row y0; how many places its `order` needs, which is not filled where there are fewer."""
    found, start, order = cull(shown, meshlets, placed, window, drawn), drawn.start, drawn.order
    drawn.count[0] = found
    bands = len(start) - 1
    start[:] = 0
    for n in range(found):
        first, last = bands_touched(drawn, n, y0, margin, rows, bands)
        for band in range(first, last + 1):
            start[band + 1] += 1
    for band in range(bands):
        start[band + 1] += start[band]
    needed = start[bands]
    if needed <= len(order):
        for n in range(found):
            first, last = bands_touched(drawn, n, y0, margin, rows, bands)
            for band in range(first, last + 1):
                order[start[band]] = n
                start[band] += 1
        for band in range(bands, 0, -1):
            start[band] = start[band - 1]
        start[0] = 0
    return needed


@helper
def bands_touched(drawn, n: int, y0: int, margin: int, rows: int, bands: int):
    """The first and the last band that a meshlet may touch."""
    first = (max(drawn.top[n], y0 - margin) - margin - y0) // rows
    return max(first, 0), min((drawn.bottom[n] + margin - y0) // rows, bands - 1)


@helper
def cull(shown, meshlets, placed, window, drawn):
    """List meshlets of which something may lie inside the window, with the rows of pixels they touch; how many."""
    found = 0
    for i in range(len(placed)):
        first, last = placed[i, 0], placed[i, 0] + placed[i, 1]
        for m in range(first, last, 8):
            seen, top, bottom = in_window(shown, meshlets.box, i, m, window)
            numbers = simd.i32x8(m) + simd.iota(simd.i32x8(0))
            seen = seen & (numbers < last)
            simd.compress_store(drawn.top, found, top, seen)
            simd.compress_store(drawn.bottom, found, bottom, seen)
            count = simd.compress_store(drawn.meshlet, found, numbers, seen)
            for k in range(found, found + count):
                drawn.instance[k], drawn.first[k] = i, meshlets.first_triangle[drawn.meshlet[k]]
            found += count
    return found


@helper
def in_window(shown, box, i: int, m: int, window):
    """Whether each of eight boxes may be seen, and its first and last row of pixels."""
    count = len(box) // 6
    matrix = shown.matrix
    far, near = simd.f64x8(-np.inf), simd.f64x8(np.inf)
    left, right, above, below = near, near, near, near  # how far inside each border the innermost corner is, negative: outside
    left, right, above, below = far, far, far, far
    top, bottom = near, far
    for k in range(8):
        x = simd.load(box, (3 if k & 1 else 0) * count + m, simd.f64x8)
        y = simd.load(box, (4 if k & 2 else 1) * count + m, simd.f64x8)
        z = simd.load(box, (5 if k & 4 else 2) * count + m, simd.f64x8)
        px = matrix[i, 0, 0] * x + matrix[i, 0, 1] * y + matrix[i, 0, 2] * z + matrix[i, 0, 3]
        py = matrix[i, 1, 0] * x + matrix[i, 1, 1] * y + matrix[i, 1, 2] * z + matrix[i, 1, 3]
        d = matrix[i, 3, 0] * x + matrix[i, 3, 1] * y + matrix[i, 3, 2] * z + matrix[i, 3, 3]
        w = d if shown.perspective else simd.f64x8(1.0)
        left, right = simd.maximum(left, px - window[0] * w), simd.maximum(right, window[2] * w - px)
        above, below = simd.maximum(above, py - window[1] * w), simd.maximum(below, window[3] * w - py)
        near, far = simd.minimum(near, d), simd.maximum(far, d)
        row = py / w
        top, bottom = simd.minimum(top, row), simd.maximum(bottom, row)
    slack = -1e-9 * (abs(near) + abs(far)) - 2.0
    seen = (left >= slack) & (right >= slack) & (above >= slack) & (below >= slack) & (far >= shown.near) & (near <= shown.far)
    endless = simd.load(box, m, simd.f64x8) == -np.inf
    whole = endless | (near < shown.near) if shown.perspective else endless
    top = simd.select(whole, float(-EVERYWHERE), simd.maximum(top - 2.0, float(-EVERYWHERE)))
    bottom = simd.select(whole, float(EVERYWHERE), simd.minimum(bottom + 2.0, float(EVERYWHERE)))
    return seen | endless, simd.to_i32(simd.floor(top)), simd.to_i32(simd.floor(bottom))
