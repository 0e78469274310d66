"""Triangles into a band's visibility buffer: vertices to fixed point, sixteen triangles set up at a time, and three ways to fill.

Tiny triangles, which reach over two by two pixels at most, are tested at their few samples sixteen triangles at a time; small ones, in
32-bit numbers, block by block of 4×4 pixels; large, steep and clipped ones tile by tile, from float64 (large.py). All cover the
samples that fill.py says, exactly: vertices and samples are multiples of 1/256 pixel, an edge owns its samples if top or left.
Keys are linear on the screen between the snapped corners, so that they are never outside of what the corners have.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, kernel, noinline_helper
from . import large_triangles
from .band_buffer import LARGE, NOTHING, QUEUE, in_block
from .meshlets import SHIFT

SMALL = 62 * 256  # fixed-point units that a small triangle is wide and high at the most: products stay in 32 bits
STEEP = np.float32(4.0)  # how many times the nearest corner's key may be the farthest's
OUTSIDE = 1 << 28  # coordinates beyond go through the clipper
CUT = -(1 << 31)  # stands for x where a vertex does
STRIDE = QUEUE + 32


@kernel
def draw_band(filling, number):
    """Fill a buffer with what the meshlets of band `number` show; `filling` is a handle of bands.Filling."""
    shown, pattern, meshlets, drawn, band = filling.shown, filling.pattern, filling.meshlets, filling.drawn, filling.band
    samples = len(pattern.x)
    nothing, none = simd.f32x16(NOTHING), simd.i32x16(-1)
    for k in range(0, band.place[2] * band.place[3] * samples, 16):
        simd.store_aligned(band.key, k, nothing)
        simd.store_aligned(band.ids, k, none)
    for k in range(len(band.hidden)):
        band.hidden[k] = NOTHING
    waiting, big = 0, 0
    for n in range(drawn.start[number], drawn.start[number + 1]):
        row = drawn.order[n]
        i, m = drawn.instance[row], drawn.meshlet[row]
        count = meshlets.triangles[m]
        if meshlets.vertices[m] == 0:
            for k in range(count):
                band.large[big] = row << SHIFT | k
                big += 1
        else:
            if not transform(shown, pattern, meshlets, i, m, band):
                continue
            first = meshlets.first_triangle[m]
            for k in range(0, count, 16):
                waiting, big = set_up(shown, pattern, meshlets, first + k, count - k, row << SHIFT | k, band, waiting, big)
                if waiting > QUEUE:
                    fill_small(pattern, band, waiting)
                    waiting = 0
        if big > LARGE - 128:
            large_triangles.fill(shown, pattern, meshlets, drawn, band, big)
            big = 0
    fill_small(pattern, band, waiting)
    large_triangles.fill(shown, pattern, meshlets, drawn, band, big)


@helper
def transform(shown: Any, pattern: Any, meshlets: Any, i: int, m: int, band: Any) -> bool:
    """The vertices of a meshlet as (x, y, key, 0) in band.local, at the places that meshlets.place_of says.

    Whether the band may show any of it: what stands behind the last vertex counts as well.
    """
    first = meshlets.first_vertex[m]
    zero = simd.i32x16(0)
    north, south, west = simd.i32x16(OUTSIDE), simd.i32x16(-OUTSIDE), zero
    for k in range(0, meshlets.vertices[m], 16):
        ax, ay, ak = snapped(shown, meshlets, i, first + k)
        bx, by, bk = snapped(shown, meshlets, i, first + k + 8)
        x, y = simd.joined(ax, bx), simd.joined(ay, by)
        north, south, west = simd.minimum(north, y), simd.maximum(south, y), simd.minimum(west, x)
        rows = simd.transpose((x, y, simd.float_bits(simd.joined(ak, bk)), zero))
        simd.store_aligned(band.local, 4 * k, rows[0])
        simd.store_aligned(band.local, 4 * k + 16, rows[1])
        simd.store_aligned(band.local, 4 * k + 32, rows[2])
        simd.store_aligned(band.local, 4 * k + 48, rows[3])
    above, below = simd.min_of(north) - pattern.high_y, simd.max_of(south) - pattern.low_y
    return simd.any_of(west == CUT) or (above < band.clip[3] << 8 and below >= band.clip[1] << 8)


@helper
def snapped(shown: Any, meshlets: Any, i: int, at: int) -> Any:
    """x, y in 1/256 pixel and the key of eight vertices: bit for bit what raster_setup.to_clip and visibility.snapped give."""
    x, y, z = simd.load(meshlets.x, at, simd.f64x8), simd.load(meshlets.y, at, simd.f64x8), simd.load(meshlets.z, at, simd.f64x8)
    m = shown.matrix
    cx = m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z + m[i, 0, 3]
    cy = m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z + m[i, 1, 3]
    d = m[i, 3, 0] * x + m[i, 3, 1] * y + m[i, 3, 2] * z + m[i, 3, 3]
    w = d if shown.perspective else simd.f64x8(1.0)
    fx, fy = simd.floor(cx / w * 256.0 + 0.5), simd.floor(cy / w * 256.0 + 0.5)
    good = (d >= shown.near) & (d <= shown.far) & (abs(fx) < float(OUTSIDE)) & (abs(fy) < float(OUTSIDE))
    key = 1.0 / d if shown.perspective else -d
    return simd.to_i32(simd.select(good, fx, float(CUT))), simd.to_i32(simd.select(good, fy, 0.0)), simd.to_f32(key)


@helper
def set_up(shown: Any, pattern: Any, meshlets: Any, at: int, count: int, number: int, band: Any, waiting: int, big: int) -> Any:
    """Sixteen triangles from slot `at` on, of which `count` are there: tiny ones are filled, others join their queues.

    `number` is the first one's id. Returns how many small and large ones wait then.
    """
    one = simd.gather_rows(band.local, simd.load(meshlets.a, at, 16) * 4, 4)
    two = simd.gather_rows(band.local, simd.load(meshlets.b, at, 16) * 4, 4)
    three = simd.gather_rows(band.local, simd.load(meshlets.c, at, 16) * 4, 4)
    x0, y0, x1, y1, x2, y2 = one[0], one[1], two[0], two[1], three[0], three[1]
    k0, k1, k2 = simd.bits_float(one[2]), simd.bits_float(two[2]), simd.bits_float(three[2])
    there = simd.first_lanes(count, x0)
    west, east = simd.minimum(x0, simd.minimum(x1, x2)), simd.maximum(x0, simd.maximum(x1, x2))
    north, south = simd.minimum(y0, simd.minimum(y1, y2)), simd.maximum(y0, simd.maximum(y1, y2))
    ids = number + simd.iota(x0)
    cut = (west == CUT) & there
    left, right = (west + (255 - pattern.high_x)) >> 8, (east - pattern.low_x) >> 8
    above, below = (north + (255 - pattern.high_y)) >> 8, (south - pattern.low_y) >> 8
    few = (right - left <= 1) & (below - above <= 1)
    seen = there & ~cut & (simd.maximum(left, band.clip[0]) <= simd.minimum(right, band.clip[2] - 1))
    seen = seen & (simd.maximum(above, band.clip[1]) <= simd.minimum(below, band.clip[3] - 1))
    if not simd.any_of(seen | cut):
        return waiting, big
    low, high = simd.minimum(k0, simd.minimum(k1, k2)), simd.maximum(k0, simd.maximum(k1, k2))
    small = (east - west < SMALL) & (south - north < SMALL)
    if shown.perspective:
        small = small & (high <= low * STEEP)
    far = (seen & ~small) | cut
    if simd.any_of(far):
        big += simd.compress_store(band.large, big, ids, far)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    seen = seen & small & (area != 0)
    if not simd.any_of(seen):
        return waiting, big
    turned = area < 0  # the other way round: its second and third corner change places
    x1, x2 = simd.select(turned, x2, x1), simd.select(turned, x1, x2)
    y1, y2 = simd.select(turned, y2, y1), simd.select(turned, y1, y2)
    k1, k2 = simd.select(turned, k2, k1), simd.select(turned, k1, k2)
    scale = 1.0 / simd.to_f32(abs(area))
    k1, k2 = (k1 - k0) * scale, (k2 - k0) * scale
    dx0, dy0, dx1, dy1, dx2, dy2 = x2 - x1, y2 - y1, x0 - x2, y0 - y2, x1 - x0, y1 - y0
    h0, h1, h2 = not_owned(dx0, dy0), not_owned(dx1, dy1), not_owned(dx2, dy2)
    tiny = seen & few
    if simd.any_of(tiny):
        for s in range(len(pattern.x)):
            px, py = (left << 8) + pattern.x[s], (above << 8) + pattern.y[s]
            e0 = dx0 * (py - y1) - dy0 * (px - x1)
            e1 = dx1 * (py - y2) - dy1 * (px - x2)
            e2 = dx2 * (py - y0) - dy2 * (px - x0)
            fill_tiny(band, len(pattern.x), s, tiny, ids, left, above, k0, k1, k2,
                      e0 + h0, e1 + h1, e2 + h2, h1, h2, dx0, dy0, dx1, dy1, dx2, dy2)  # fmt: skip
    rest = seen & ~tiny
    if simd.any_of(rest):
        px, py = left >> 2, above >> 2  # where keys are counted from must not depend on the band, nor on the crop
        bx, by = px - (band.place[0] >> 2), py - (band.place[1] >> 2)
        right, below = simd.minimum((right >> 2) - px + bx, (band.place[2] >> 2) - 1), (below >> 2) - py + by
        below = simd.minimum(below, (band.place[3] >> 2) - 1)
        cx, cy = simd.maximum(-bx, 0), simd.maximum(-by, 0)  # blocks on the left and above that are not in the band
        x, y = px << 10, py << 10
        e1, e2 = dx1 * (y - y2) - dy1 * (x - x2), dx2 * (y - y0) - dy2 * (x - x0)
        key = k0 + (simd.to_f32(e1) * k1 + simd.to_f32(e2) * k2)
        x, y = x + (cx << 10), y + (cy << 10)
        e0 = dx0 * (y - y1) - dy0 * (x - x1) + h0
        e1 = dx1 * (y - y2) - dy1 * (x - x2) + h1
        e2 = dx2 * (y - y0) - dy2 * (x - x0) + h2
        bx, by = bx + cx, by + cy
        simd.write(band.waiting, waiting >> 4, simd.bits(rest))
        step_x, step_y = simd.to_f32(dy1) * k1 + simd.to_f32(dy2) * k2, simd.to_f32(dx1) * k1 + simd.to_f32(dx2) * k2
        _queue(band.real, waiting, (key, step_x * -256.0, step_y * 256.0, low, high))
        _queue(band.whole, waiting, (e0, e1, e2, dx0, dy0, dx1, dy1, dx2, dy2))
        _queue(band.whole, waiting + 9 * STRIDE, (
            by * (band.place[2] >> 2) + bx, cx | (cy << 16), ids, (right - bx) | ((below - by) << 16)
        ))  # fmt: skip
        waiting += 16
    return waiting, big


@helper
def _queue(array: Any, at: int, columns: Any) -> None:
    """Write vectors to columns of the queue from place `at` on."""
    for k in range(len(columns)):
        simd.store(array, at + k * STRIDE, columns[k])


@helper
def not_owned(dx: Any, dy: Any) -> Any:
    """-1 where an edge does not own the samples on it (fill.owns), so that inside is where the edge function is >= 0; else 0."""
    return simd.select((dy < 0) | ((dy == 0) & (dx > 0)), simd.i32x16(0), -1)


@helper
def fill_tiny(band: Any, samples: int, s: int, tiny: Any, ids: Any, left: Any, above: Any, k0: Any, k1: Any, k2: Any,
              e0: Any, e1: Any, e2: Any, h1: Any, h2: Any, dx0: Any, dy0: Any, dx1: Any, dy1: Any, dx2: Any, dy2: Any) -> None:  # fmt: skip
    """Sample s of the two by two pixels from (left, above) on, of sixteen triangles with edge functions e0, e1, e2 there."""
    x, y = left - band.place[0], above - band.place[1]
    sx0, sx1, sx2, sy0, sy1, sy2 = dy0 << 8, dy1 << 8, dy2 << 8, dx0 << 8, dx1 << 8, dx2 << 8
    for k in range(4):
        right, down = k & 1, k >> 1
        f0, f1, f2, px, py = e0, e1, e2, x + right, y + down
        if right:
            f0, f1, f2 = f0 - sx0, f1 - sx1, f2 - sx2
        if down:
            f0, f1, f2 = f0 + sy0, f1 + sy1, f2 + sy2
        on = tiny & ((f0 | f1 | f2) >= 0) & (px >= 0) & (px < band.place[2]) & (py >= 0) & (py < band.place[3])
        if simd.any_of(on):
            key = k0 + (simd.to_f32(f1 - h1) * k1 + simd.to_f32(f2 - h2) * k2)
            block = ((py >> 2) * (band.place[2] >> 2) + (px >> 2)) * samples + s
            simd.store(band.tiny, 0, simd.float_bits(key))
            simd.store(band.tiny, 16, (block << 4) + ((px & 3) << 2) + (py & 3))
            simd.store(band.tiny, 32, ids)
            keep_tiny(band, simd.bits(on))


@helper
def keep_tiny(band: Any, left: int) -> None:
    """Keep those of sixteen samples in band.tiny, of the lanes `left`, that are nearest."""
    while left:
        k = simd.trailing_zeros(left)
        left &= left - 1
        key = simd.bits_float(simd.read(band.tiny, k))
        place, number = simd.read(band.tiny, k + 16), simd.read(band.tiny, k + 32)
        old = simd.read(band.key, place)
        if key > old or (key == old and number < simd.read(band.ids, place)):
            simd.write(band.key, place, key)
            simd.write(band.ids, place, number)


@noinline_helper
def fill_small(pattern, band, count):
    """Fill the small triangles that wait."""
    for start in range(0, count, 16):
        left = simd.read(band.waiting, start >> 4)
        while left:
            fill_blocks(pattern, band, start + simd.trailing_zeros(left))
            left &= left - 1


@helper
def fill_blocks(pattern: Any, band: Any, n: int) -> None:
    """Fill small triangle n of the queue, block by block."""
    samples = len(pattern.x)
    whole, real = band.whole, band.real
    column, line = in_block(simd.iota(simd.i32x16(0)))
    across, down = simd.to_f32(column), simd.to_f32(line)
    columns = band.place[2] >> 2
    dx0, dy0 = simd.read(whole, n + 3 * STRIDE), simd.read(whole, n + 4 * STRIDE)
    dx1, dy1 = simd.read(whole, n + 5 * STRIDE), simd.read(whole, n + 6 * STRIDE)
    dx2, dy2 = simd.read(whole, n + 7 * STRIDE), simd.read(whole, n + 8 * STRIDE)
    block, start, size = simd.read(whole, n + 9 * STRIDE), simd.read(whole, n + 10 * STRIDE), simd.read(whole, n + 12 * STRIDE)
    number = simd.i32x16(simd.read(whole, n + 11 * STRIDE))
    step_x, step_y = simd.f32x16(simd.read(real, n + STRIDE)), simd.f32x16(simd.read(real, n + 2 * STRIDE))
    low, high = simd.f32x16(simd.read(real, n + 3 * STRIDE)), simd.f32x16(simd.read(real, n + 4 * STRIDE))
    right0, right1, right2 = simd.i32x16(dy0), simd.i32x16(dy1), simd.i32x16(dy2)
    below0, below1, below2 = simd.i32x16(dx0), simd.i32x16(dx1), simd.i32x16(dx2)
    inner0, inner1, inner2 = line * below0 - column * right0, line * below1 - column * right1, line * below2 - column * right2
    right0, right1, right2 = right0 << 2, right1 << 2, right2 << 2
    below0, below1, below2 = below0 << 2, below1 << 2, below2 << 2
    plane = simd.fma(across, step_x, simd.fma(down, step_y, simd.f32x16(simd.read(real, n))))
    column_0, row_0 = start & 0xFFFF, start >> 16
    for s in range(samples):
        sx, sy = pattern.x[s], pattern.y[s]
        row0 = inner0 + ((simd.read(whole, n) + sy * dx0 - sx * dy0) >> 8)
        row1 = inner1 + ((simd.read(whole, n + STRIDE) + sy * dx1 - sx * dy1) >> 8)
        row2 = inner2 + ((simd.read(whole, n + 2 * STRIDE) + sy * dx2 - sx * dy2) >> 8)
        in_row = simd.fma(step_y, simd.f32x16(np.float32(sy / 256.0)), simd.fma(step_x, simd.f32x16(np.float32(sx / 256.0)), plane))
        first = (block * samples + s) * 16
        for row in range((size >> 16) + 1):
            e0, e1, e2, place = row0, row1, row2, first
            key_row = simd.fma(step_y, simd.f32x16(simd.read(band.fours, row_0 + row)), in_row)
            for at in range(column_0, column_0 + (size & 0xFFFF) + 1):
                key = simd.fma(step_x, simd.f32x16(simd.read(band.fours, at)), key_row)
                put(band, place, (e0 | e1 | e2) >= 0, simd.maximum(simd.minimum(key, high), low), number)
                e0, e1, e2 = e0 - right0, e1 - right1, e2 - right2
                place += samples * 16
            row0, row1, row2 = row0 + below0, row1 + below1, row2 + below2
            first += columns * samples * 16


@helper
def put(band: Any, place: int, covered: Any, key: Any, number: Any) -> None:
    """Keep a triangle at the covered samples of a block where it is nearest; of equal keys the lowest id."""
    old, there = simd.load_aligned(band.key, place, simd.f32x16), simd.load_aligned(band.ids, place, simd.i32x16)
    nearer = covered & ((key > old) | ((key == old) & (number < there)))
    simd.store_aligned(band.key, place, simd.select(nearer, key, old))
    simd.store_aligned(band.ids, place, simd.select(nearer, number, there))
