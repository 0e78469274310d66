"""Culls meshlets against the picture and bins them into bands."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle

EVERYWHERE = 1 << 28  # pixels


class VisibleMeshlets(NamedTuple):
    """Visible meshlets of instances, in the order of ids, binned into bands; the arrays have capacity for all meshlets."""

    instance: NDArray[np.int32]
    meshlet: NDArray[np.int32]
    first: NDArray[np.int32]  # the meshlet's first triangle
    top: NDArray[np.int32]  # first row of pixels it may overlap
    bottom: NDArray[np.int32]  # last row
    start: NDArray[np.int64]  # (bands + 1,) start of each band in `order`
    order: NDArray[np.int32]  # rows of this table, band by band
    count: NDArray[np.int64]  # (1,) number of meshlets


def find_visible(
    projection: Handle,
    meshlets: Handle,
    ranges: NDArray[np.int64],
    crop: tuple[int, ...],
    margin: int,
    rows: int,
    reused: Handle | None = None,
) -> Handle:
    """The meshlets that may overlap a crop grown by `margin` pixels, binned into bands of `rows` rows of pixels.

    Reuses the memory of `reused`, an earlier result for the same meshlets and number of bands, if it is large enough.
    """
    first, bands = crop[1] // rows, count_bands(crop, rows)
    visible = reused or Handle(_allocate(int(ranges[:, 1].sum()), bands, 0))
    window = crop[0] - margin, crop[1] - margin, crop[2] + margin, crop[3] + margin
    needed = list_meshlets(projection, meshlets, ranges, window, first * rows, margin, rows, visible)
    if needed > len(visible.tables.order):
        visible = Handle(_allocate(len(visible.tables.instance) - 16, bands, needed + needed // 4))
        list_meshlets(projection, meshlets, ranges, window, first * rows, margin, rows, visible)
    return visible


def count_bands(crop: tuple[int, ...], rows: int) -> int:
    """The number of bands of `rows` rows that a crop overlaps."""
    return -(-crop[3] // rows) - crop[1] // rows


def _allocate(most: int, bands: int, places: int) -> VisibleMeshlets:
    instance, meshlet, first, top, bottom = np.zeros((5, most + 16), np.int32)  # vector stores may write past the end
    start, order = np.zeros(bands + 1, np.int64), np.empty(max(places, most + bands), np.int32)
    return VisibleMeshlets(instance, meshlet, first, top, bottom, start, order, np.zeros(1, np.int64))


@kernel
def list_meshlets(projection, meshlets, ranges, window, y0, margin, rows, visible):
    """Fill a VisibleMeshlets whose first band begins at row y0; returns the length that `order` needs. A shorter one stays unfilled."""
    visible_count, start, order = cull(projection, meshlets, ranges, window, visible), visible.start, visible.order
    visible.count[0] = visible_count
    bands = len(start) - 1
    start[:] = 0
    for n in range(visible_count):
        first, last = band_range(visible, n, y0, margin, rows, bands)
        for band in range(first, last + 1):
            start[band + 1] += 1
    for band in range(bands):
        start[band + 1] += start[band]
    needed = start[bands]
    if needed <= len(order):
        for n in range(visible_count):
            first, last = band_range(visible, n, y0, margin, rows, bands)
            for band in range(first, last + 1):
                order[start[band]] = n
                start[band] += 1
        for band in range(bands, 0, -1):
            start[band] = start[band - 1]
        start[0] = 0
    return needed


@helper
def band_range(visible, n: int, y0: int, margin: int, rows: int, bands: int):
    """The first and the last band that a meshlet may overlap."""
    first = (max(visible.top[n], y0 - margin) - margin - y0) // rows
    return max(first, 0), min((visible.bottom[n] + margin - y0) // rows, bands - 1)


@helper
def cull(projection, meshlets, ranges, window, visible):
    """Write the meshlets that may overlap the window, and their rows of pixels; returns their number."""
    visible_count = 0
    for i in range(len(ranges)):
        first, last = ranges[i, 0], ranges[i, 0] + ranges[i, 1]
        for m in range(first, last, 8):
            inside, top, bottom = test_boxes(projection, meshlets.box, i, m, window)
            numbers = simd.i32x8(m) + simd.iota(simd.i32x8(0))
            inside = inside & (numbers < last)
            simd.compress_store(visible.top, visible_count, top, inside)
            simd.compress_store(visible.bottom, visible_count, bottom, inside)
            count = simd.compress_store(visible.meshlet, visible_count, numbers, inside)
            for k in range(visible_count, visible_count + count):
                visible.instance[k], visible.first[k] = i, meshlets.first_triangle[visible.meshlet[k]]
            visible_count += count
    return visible_count


@helper
def test_boxes(projection, box, i: int, m: int, window):
    """(whether visible, first row of pixels, last row) of eight boxes."""
    count = len(box) // 6
    matrix = projection.matrix
    far, near = simd.f64x8(-np.inf), simd.f64x8(np.inf)
    left, right, above, below = near, near, near, near  # distance of the innermost corner inside each border; negative: outside
    left, right, above, below = far, far, far, far
    top, bottom = near, far
    for k in range(8):
        x = simd.load(box, (3 if k & 1 else 0) * count + m, simd.f64x8)
        y = simd.load(box, (4 if k & 2 else 1) * count + m, simd.f64x8)
        z = simd.load(box, (5 if k & 4 else 2) * count + m, simd.f64x8)
        px = matrix[i, 0, 0] * x + matrix[i, 0, 1] * y + matrix[i, 0, 2] * z + matrix[i, 0, 3]
        py = matrix[i, 1, 0] * x + matrix[i, 1, 1] * y + matrix[i, 1, 2] * z + matrix[i, 1, 3]
        d = matrix[i, 3, 0] * x + matrix[i, 3, 1] * y + matrix[i, 3, 2] * z + matrix[i, 3, 3]
        w = d if projection.perspective else simd.f64x8(1.0)
        left, right = simd.maximum(left, px - window[0] * w), simd.maximum(right, window[2] * w - px)
        above, below = simd.maximum(above, py - window[1] * w), simd.maximum(below, window[3] * w - py)
        near, far = simd.minimum(near, d), simd.maximum(far, d)
        row = py / w
        top, bottom = simd.minimum(top, row), simd.maximum(bottom, row)
    slack = -1e-9 * (abs(near) + abs(far)) - 2.0
    inside = (left >= slack) & (right >= slack) & (above >= slack) & (below >= slack) & (far >= projection.near) & (near <= projection.far)
    endless = simd.load(box, m, simd.f64x8) == -np.inf
    unbounded = endless | (near < projection.near) if projection.perspective else endless
    top = simd.select(unbounded, float(-EVERYWHERE), simd.maximum(top - 2.0, float(-EVERYWHERE)))
    bottom = simd.select(unbounded, float(EVERYWHERE), simd.minimum(bottom + 2.0, float(EVERYWHERE)))
    return inside | endless, simd.to_i32(simd.floor(top)), simd.to_i32(simd.floor(bottom))
