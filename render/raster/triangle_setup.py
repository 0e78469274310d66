"""Rasterizes meshlets into a band's visibility buffer: transforms vertices, sets up sixteen triangles at a time, fills them.

Tiny triangles, of two by two pixels at most, are tested at their samples sixteen triangles at a time. Small ones are filled in 32-bit
integers, block by block of 4×4 pixels. Large, steep and clipped ones go to large_triangles.py. All cover exactly the samples of
coverage.py: vertices and samples are multiples of 1/256 pixel, and edges follow the top-left rule. Keys are linear on the screen between
the snapped corners, so that they stay in the range of the corners' keys.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, kernel, noinline_helper
from ..types import Lane
from . import large_triangles
from .band_buffer import LARGE, NO_KEY, QUEUE, in_block
from .meshlets import SHIFT

SMALL = 62 * 256  # largest width and height of a small triangle, in 1/256 pixel: products fit in 32 bits
STEEP = np.float32(4.0)  # largest ratio of the corners' keys of a small triangle
OUTSIDE = 1 << 28  # larger coordinates need clipping
CLIPPED = -(1 << 31)  # x of vertices that need clipping
STRIDE = QUEUE + 32
E0, E1, E2, DX0, DY0, DX1, DY1, DX2, DY2, BLOCK, START, ID, SIZE = (k * STRIDE for k in range(13))
"""First elements of columns of `small_ints`: edge functions, edges, first block, its place, the triangle's id, blocks across and down."""
KEY, STEP_X, STEP_Y, LOW, HIGH = (k * STRIDE for k in range(5))
"""First elements of columns of `small_floats`: the depth plane and the range of keys."""


class PixelBox(NamedTuple):
    """The pixels with samples that sixteen triangles may cover: first and last columns and rows."""

    left: Lane
    above: Lane
    right: Lane
    below: Lane


class TriangleSetup(NamedTuple):
    """Sixteen triangles, clockwise on the screen. Edge k lies opposite corner k; its function is dx (y - y') - dy (x - x')."""

    ids: Lane
    x0: Lane  # corners, in 1/256 pixel
    y0: Lane
    x1: Lane
    y1: Lane
    x2: Lane
    y2: Lane
    dx0: Lane  # edges
    dy0: Lane
    dx1: Lane
    dy1: Lane
    dx2: Lane
    dy2: Lane
    h0: Lane  # to add to an edge function, see `not_owned`
    h1: Lane
    h2: Lane
    k0: Lane  # the key is k0 + k1 · edge function 1 + k2 · edge function 2
    k1: Lane
    k2: Lane


@kernel
def draw_band(filling, number):
    """Fill the buffer of band `number` from its visible meshlets; `filling` is a handle of band_buffer.Filling."""
    projection, pattern, meshlets, visible, band = filling.projection, filling.pattern, filling.meshlets, filling.visible, filling.band
    samples = len(pattern.x)
    nothing, none = simd.f32x16(NO_KEY), simd.i32x16(-1)
    for k in range(0, band.window[2] * band.window[3] * samples, 16):
        simd.store_aligned(band.key, k, nothing)
        simd.store_aligned(band.ids, k, none)
    for k in range(len(band.tile_key)):
        band.tile_key[k] = NO_KEY
    small, large = 0, 0
    for n in range(visible.start[number], visible.start[number + 1]):
        row = visible.order[n]
        i, m = visible.instance[row], visible.meshlet[row]
        count = meshlets.triangles[m]
        if meshlets.vertices[m] == 0:
            for k in range(count):
                band.large[large] = row << SHIFT | k
                large += 1
        else:
            if not transform_vertices(projection, pattern, meshlets, i, m, band):
                continue
            first = meshlets.first_triangle[m]
            for k in range(0, count, 16):
                first_id = row << SHIFT | k
                small, large = setup_triangles(projection, pattern, meshlets, first + k, count - k, first_id, band, small, large)
                if small > QUEUE:
                    fill_small(pattern, band, small)
                    small = 0
        if large > LARGE - 128:
            large_triangles.fill_large(projection, pattern, meshlets, visible, band, large)
            large = 0
    fill_small(pattern, band, small)
    large_triangles.fill_large(projection, pattern, meshlets, visible, band, large)


@helper
def transform_vertices(projection: Any, pattern: Any, meshlets: Any, i: int, m: int, band: Any) -> bool:
    """Write a meshlet's vertices as (x, y, key, 0) to band.vertices, in the order of meshlets.transposed_index.

    Returns whether the band may show it; the vector's rest after the last vertex counts, too.
    """
    first = meshlets.first_vertex[m]
    zero = simd.i32x16(0)
    north, south, west = simd.i32x16(OUTSIDE), simd.i32x16(-OUTSIDE), zero
    for k in range(0, meshlets.vertices[m], 16):
        ax, ay, ak = snap_vertices(projection, meshlets, i, first + k)
        bx, by, bk = snap_vertices(projection, meshlets, i, first + k + 8)
        x, y = simd.concatenate(ax, bx), simd.concatenate(ay, by)
        north, south, west = simd.minimum(north, y), simd.maximum(south, y), simd.minimum(west, x)
        rows = simd.transpose((x, y, simd.float_bits(simd.concatenate(ak, bk)), zero))
        simd.store_aligned(band.vertices, 4 * k, rows[0])
        simd.store_aligned(band.vertices, 4 * k + 16, rows[1])
        simd.store_aligned(band.vertices, 4 * k + 32, rows[2])
        simd.store_aligned(band.vertices, 4 * k + 48, rows[3])
    above, below = simd.min_of(north) - pattern.high_y, simd.max_of(south) - pattern.low_y
    return simd.any_of(west == CLIPPED) or (above < band.clip[3] << 8 and below >= band.clip[1] << 8)


@helper
def snap_vertices(projection: Any, meshlets: Any, i: int, first_vertex: int) -> Any:
    """x, y in 1/256 pixel and key of eight vertices, bit for bit as view_geometry.to_clip and scalar_raster.snap."""
    x, y, z = (
        simd.load(meshlets.x, first_vertex, simd.f64x8),
        simd.load(meshlets.y, first_vertex, simd.f64x8),
        simd.load(meshlets.z, first_vertex, simd.f64x8),
    )
    m = projection.matrix
    cx = m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z + m[i, 0, 3]
    cy = m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z + m[i, 1, 3]
    d = m[i, 3, 0] * x + m[i, 3, 1] * y + m[i, 3, 2] * z + m[i, 3, 3]
    w = d if projection.perspective else simd.f64x8(1.0)
    fx, fy = simd.floor(cx / w * 256.0 + 0.5), simd.floor(cy / w * 256.0 + 0.5)
    good = (d >= projection.near) & (d <= projection.far) & (abs(fx) < float(OUTSIDE)) & (abs(fy) < float(OUTSIDE))
    key = 1.0 / d if projection.perspective else -d
    return simd.to_i32(simd.select(good, fx, float(CLIPPED))), simd.to_i32(simd.select(good, fy, 0.0)), simd.to_f32(key)


@helper
def setup_triangles(projection: Any, pattern: Any, meshlets: Any, slot: int, count: int, number: int, band: Any, small: int,
                    large: int) -> tuple[int, int]:  # fmt: skip
    """Set up sixteen triangles from slot `slot` on, of which `count` exist: fills tiny ones, queues others.

    `number` is the id of the first. Returns the lengths of the queues of small and large triangles.
    """
    corner0 = simd.gather_rows(band.vertices, simd.load(meshlets.a, slot, 16) * 4, 4)
    corner1 = simd.gather_rows(band.vertices, simd.load(meshlets.b, slot, 16) * 4, 4)
    corner2 = simd.gather_rows(band.vertices, simd.load(meshlets.c, slot, 16) * 4, 4)
    x0, y0, x1, y1, x2, y2 = corner0[0], corner0[1], corner1[0], corner1[1], corner2[0], corner2[1]
    k0, k1, k2 = simd.bits_float(corner0[2]), simd.bits_float(corner1[2]), simd.bits_float(corner2[2])
    exists = simd.first_lanes(count, x0)
    west, east = simd.minimum(x0, simd.minimum(x1, x2)), simd.maximum(x0, simd.maximum(x1, x2))
    north, south = simd.minimum(y0, simd.minimum(y1, y2)), simd.maximum(y0, simd.maximum(y1, y2))
    ids = number + simd.iota(x0)
    cut = (west == CLIPPED) & exists
    first_column, first_row = (west + (255 - pattern.high_x)) >> 8, (north + (255 - pattern.high_y)) >> 8
    box = PixelBox(first_column, first_row, (east - pattern.low_x) >> 8, (south - pattern.low_y) >> 8)
    active = exists & ~cut & (simd.maximum(box.left, band.clip[0]) <= simd.minimum(box.right, band.clip[2] - 1))
    active = active & (simd.maximum(box.above, band.clip[1]) <= simd.minimum(box.below, band.clip[3] - 1))
    if not simd.any_of(active | cut):
        return small, large
    low, high = simd.minimum(k0, simd.minimum(k1, k2)), simd.maximum(k0, simd.maximum(k1, k2))
    fits = (east - west < SMALL) & (south - north < SMALL)
    if projection.perspective:
        fits = fits & (high <= low * STEEP)
    far = (active & ~fits) | cut
    if simd.any_of(far):
        large += simd.compress_store(band.large, large, ids, far)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    active = active & fits & (area != 0)
    if not simd.any_of(active):
        return small, large
    triangles = orient(ids, corner0, corner1, corner2, area)
    tiny = active & (box.right - box.left <= 1) & (box.below - box.above <= 1)
    if simd.any_of(tiny):
        fill_tiny(pattern, band, triangles, tiny, box)
    queued = active & ~tiny
    if simd.any_of(queued):
        simd.write(band.small_mask, small >> 4, simd.bits(queued))
        queue_small(band, small, triangles, box, low, high)
        small += 16
    return small, large


@helper
def orient(ids: Lane, corner0: Any, corner1: Any, corner2: Any, area: Lane) -> TriangleSetup:
    """The setup of triangles of three corners (x, y, bits of the key) each; those of negative `area` swap the second and third."""
    turned = area < 0
    x0, y0, k0 = corner0[0], corner0[1], simd.bits_float(corner0[2])
    x1, x2 = simd.select(turned, corner2[0], corner1[0]), simd.select(turned, corner1[0], corner2[0])
    y1, y2 = simd.select(turned, corner2[1], corner1[1]), simd.select(turned, corner1[1], corner2[1])
    second, third = simd.bits_float(corner1[2]), simd.bits_float(corner2[2])
    k1, k2 = simd.select(turned, third, second), simd.select(turned, second, third)
    scale = 1.0 / simd.to_f32(abs(area))
    k1, k2 = (k1 - k0) * scale, (k2 - k0) * scale
    dx0, dy0, dx1, dy1, dx2, dy2 = x2 - x1, y2 - y1, x0 - x2, y0 - y2, x1 - x0, y1 - y0
    h0, h1, h2 = not_owned(dx0, dy0), not_owned(dx1, dy1), not_owned(dx2, dy2)
    return TriangleSetup(ids, x0, y0, x1, y1, x2, y2, dx0, dy0, dx1, dy1, dx2, dy2, h0, h1, h2, k0, k1, k2)


@helper
def edge_functions(t: TriangleSetup, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane]:
    """The edge functions at points in 1/256 pixel."""
    return (
        t.dx0 * (y - t.y1) - t.dy0 * (x - t.x1), t.dx1 * (y - t.y2) - t.dy1 * (x - t.x2), t.dx2 * (y - t.y0) - t.dy2 * (x - t.x0)
    )  # fmt: skip


@helper
def not_owned(dx: Any, dy: Any) -> Any:
    """-1 where an edge does not own the samples on it (coverage.owns), else 0: with it added, edge functions are >= 0 inside."""
    return simd.select((dy < 0) | ((dy == 0) & (dx > 0)), simd.i32x16(0), -1)


@helper
def queue_small(band: Any, small: int, t: TriangleSetup, box: PixelBox, low: Lane, high: Lane) -> None:
    """Write sixteen triangles to the queue from place `small` on: edge functions, depth plane, blocks. `low`, `high`: range of keys."""
    px, py = box.left >> 2, box.above >> 2  # the origin of keys must depend neither on the band nor on the crop
    bx, by = px - (band.window[0] >> 2), py - (band.window[1] >> 2)
    right, below = simd.minimum((box.right >> 2) - px + bx, (band.window[2] >> 2) - 1), (box.below >> 2) - py + by
    below = simd.minimum(below, (band.window[3] >> 2) - 1)
    cx, cy = simd.maximum(-bx, 0), simd.maximum(-by, 0)  # blocks left of the band and above it
    x, y = px << 10, py << 10
    _, e1, e2 = edge_functions(t, x, y)
    key = t.k0 + (simd.to_f32(e1) * t.k1 + simd.to_f32(e2) * t.k2)
    e0, e1, e2 = edge_functions(t, x + (cx << 10), y + (cy << 10))
    bx, by = bx + cx, by + cy
    step_x = simd.to_f32(t.dy1) * t.k1 + simd.to_f32(t.dy2) * t.k2
    step_y = simd.to_f32(t.dx1) * t.k1 + simd.to_f32(t.dx2) * t.k2
    write_columns(band.small_floats, small, (key, step_x * -256.0, step_y * 256.0, low, high))
    write_columns(band.small_ints, small, (e0 + t.h0, e1 + t.h1, e2 + t.h2, t.dx0, t.dy0, t.dx1, t.dy1, t.dx2, t.dy2))
    write_columns(band.small_ints, small + BLOCK, (
        by * (band.window[2] >> 2) + bx, cx | (cy << 16), t.ids, (right - bx) | ((below - by) << 16)
    ))  # fmt: skip


@helper
def write_columns(array: Any, place: int, columns: Any) -> None:
    """Write vectors to columns of the queue from place `place` on."""
    for k in range(len(columns)):
        simd.store(array, place + k * STRIDE, columns[k])


@helper
def fill_tiny(pattern: Any, band: Any, t: TriangleSetup, tiny: Lane, box: PixelBox) -> None:
    """Depth-test the triangles `tiny` of sixteen at all samples of their two by two pixels."""
    samples = len(pattern.x)
    x, y = box.left - band.window[0], box.above - band.window[1]
    sx0, sx1, sx2, sy0, sy1, sy2 = t.dy0 << 8, t.dy1 << 8, t.dy2 << 8, t.dx0 << 8, t.dx1 << 8, t.dx2 << 8
    for s in range(samples):
        e0, e1, e2 = edge_functions(t, (box.left << 8) + pattern.x[s], (box.above << 8) + pattern.y[s])
        e0, e1, e2 = e0 + t.h0, e1 + t.h1, e2 + t.h2
        for k in range(4):
            right, down = k & 1, k >> 1
            f0, f1, f2, px, py = e0, e1, e2, x + right, y + down
            if right:
                f0, f1, f2 = f0 - sx0, f1 - sx1, f2 - sx2
            if down:
                f0, f1, f2 = f0 + sy0, f1 + sy1, f2 + sy2
            on = tiny & ((f0 | f1 | f2) >= 0) & (px >= 0) & (px < band.window[2]) & (py >= 0) & (py < band.window[3])
            if simd.any_of(on):
                key = t.k0 + (simd.to_f32(f1 - t.h1) * t.k1 + simd.to_f32(f2 - t.h2) * t.k2)
                block = ((py >> 2) * (band.window[2] >> 2) + (px >> 2)) * samples + s
                simd.store(band.tiny, 0, simd.float_bits(key))
                simd.store(band.tiny, 16, (block << 4) + ((px & 3) << 2) + (py & 3))
                simd.store(band.tiny, 32, t.ids)
                depth_test_lanes(band, simd.bits(on))


@helper
def depth_test_lanes(band: Any, lanes: int) -> None:
    """Depth-test the samples in band.tiny, of the lanes `lanes` (bits)."""
    while lanes:
        k = simd.trailing_zeros(lanes)
        lanes &= lanes - 1
        key = simd.bits_float(simd.read(band.tiny, k))
        place, number = simd.read(band.tiny, k + 16), simd.read(band.tiny, k + 32)
        old = simd.read(band.key, place)
        if key > old or (key == old and number < simd.read(band.ids, place)):
            simd.write(band.key, place, key)
            simd.write(band.ids, place, number)


@noinline_helper
def fill_small(pattern, band, count):
    """Fill the queue of small triangles."""
    for start in range(0, count, 16):
        lanes = simd.read(band.small_mask, start >> 4)
        while lanes:
            fill_blocks(pattern, band, start + simd.trailing_zeros(lanes))
            lanes &= lanes - 1


@helper
def fill_blocks(pattern: Any, band: Any, n: int) -> None:
    """Fill small triangle n of the queue, block by block."""
    samples = len(pattern.x)
    ints, floats = band.small_ints, band.small_floats
    column, line = in_block(simd.iota(simd.i32x16(0)))
    across, down = simd.to_f32(column), simd.to_f32(line)
    columns = band.window[2] >> 2
    dx0, dy0 = simd.read(ints, n + DX0), simd.read(ints, n + DY0)
    dx1, dy1 = simd.read(ints, n + DX1), simd.read(ints, n + DY1)
    dx2, dy2 = simd.read(ints, n + DX2), simd.read(ints, n + DY2)
    block, start, size = simd.read(ints, n + BLOCK), simd.read(ints, n + START), simd.read(ints, n + SIZE)
    number = simd.i32x16(simd.read(ints, n + ID))
    step_x, step_y = simd.f32x16(simd.read(floats, n + STEP_X)), simd.f32x16(simd.read(floats, n + STEP_Y))
    low, high = simd.f32x16(simd.read(floats, n + LOW)), simd.f32x16(simd.read(floats, n + HIGH))
    right0, right1, right2 = simd.i32x16(dy0), simd.i32x16(dy1), simd.i32x16(dy2)
    below0, below1, below2 = simd.i32x16(dx0), simd.i32x16(dx1), simd.i32x16(dx2)
    inner0, inner1, inner2 = line * below0 - column * right0, line * below1 - column * right1, line * below2 - column * right2
    right0, right1, right2 = right0 << 2, right1 << 2, right2 << 2
    below0, below1, below2 = below0 << 2, below1 << 2, below2 << 2
    plane = simd.fma(across, step_x, simd.fma(down, step_y, simd.f32x16(simd.read(floats, n))))
    column_0, row_0 = start & 0xFFFF, start >> 16
    for s in range(samples):
        sx, sy = pattern.x[s], pattern.y[s]
        row0 = inner0 + ((simd.read(ints, n) + sy * dx0 - sx * dy0) >> 8)
        row1 = inner1 + ((simd.read(ints, n + E1) + sy * dx1 - sx * dy1) >> 8)
        row2 = inner2 + ((simd.read(ints, n + E2) + sy * dx2 - sx * dy2) >> 8)
        in_row = simd.fma(step_y, simd.f32x16(np.float32(sy / 256.0)), simd.fma(step_x, simd.f32x16(np.float32(sx / 256.0)), plane))
        first = (block * samples + s) * 16
        for row in range((size >> 16) + 1):
            e0, e1, e2, place = row0, row1, row2, first
            key_row = simd.fma(step_y, simd.f32x16(simd.read(band.offsets, row_0 + row)), in_row)
            for block_column in range(column_0, column_0 + (size & 0xFFFF) + 1):
                key = simd.fma(step_x, simd.f32x16(simd.read(band.offsets, block_column)), key_row)
                depth_test_block(band, place, (e0 | e1 | e2) >= 0, simd.maximum(simd.minimum(key, high), low), number)
                e0, e1, e2 = e0 - right0, e1 - right1, e2 - right2
                place += samples * 16
            row0, row1, row2 = row0 + below0, row1 + below1, row2 + below2
            first += columns * samples * 16


@helper
def depth_test_block(band: Any, place: int, covered: Any, key: Any, number: Any) -> None:
    """Depth-test a triangle at the covered samples of a block; at equal keys the lowest id wins."""
    old, old_ids = simd.load_aligned(band.key, place, simd.f32x16), simd.load_aligned(band.ids, place, simd.i32x16)
    nearer = covered & ((key > old) | ((key == old) & (number < old_ids)))
    simd.store_aligned(band.key, place, simd.select(nearer, key, old))
    simd.store_aligned(band.ids, place, simd.select(nearer, number, old_ids))
