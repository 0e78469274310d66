"""Rasterizes large, steep and clipped triangles one by one, in float64 and 64-bit integers, tile by tile.

In a tile of 64×64 pixels an edge is decided for the whole tile, then for sixteen blocks at a time, then for samples. A lower bound of each
tile's keys culls triangles behind it (hierarchical z).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..types import Tile
from . import coverage, scalar_raster
from .band_buffer import TILE, in_block
from .meshlets import SHIFT
from .view_geometry import to_clip

NARROW = 1 << 24  # edge functions of shorter edges fit in 32 bits in a tile
BLOCKS = TILE // 4


class EdgeFunctions(NamedTuple):
    """Edge functions at a sample, in whole pixels, >= 0 inside; each grows by -dy a pixel right and dx a pixel down."""

    e0: int
    e1: int
    e2: int
    dx0: int
    dy0: int
    dx1: int
    dy1: int
    dx2: int
    dy2: int


class DepthPlane(NamedTuple):
    """The key a x + b y + c at pixel coordinates (x, y), clamped to the range of the corners' keys."""

    a: float
    b: float
    c: float
    low: float
    high: float


class TileSample(NamedTuple):
    """One sample of each pixel of a tile."""

    index: int  # of the pattern's
    count: int
    x: int  # the tile's first pixel in the band
    y: int
    at_x: float  # the first pixel's sample in the picture, in pixels
    at_y: float


@noinline_helper
def fill_large(projection, pattern, meshlets, visible, band, count):
    """Fill the queue of large triangles."""
    work = band.work
    place = Tile(0, 0, 0, 0)
    for n in range(count):
        number = band.large[n]
        row, k = number >> SHIFT, number & ((1 << SHIFT) - 1)
        i, slot = visible.instance[row], meshlets.first_triangle[visible.meshlet[row]] + k
        triangle = meshlets.corner[slot, 3]
        for c in range(3):
            to_clip(projection.matrix, i, projection.positions, projection.triangles[triangle, c], work.corners, c)
        corner_count = scalar_raster.clip_triangle(projection.planes, work)
        if corner_count < 3 or not scalar_raster.snap(work.first, corner_count, projection.perspective, work, 0):
            continue
        if not scalar_raster.key_plane(work.corners, place, projection.perspective, work.plane, 0):
            continue
        for c in range(1, corner_count - 1):
            fill_triangle(pattern, band, number, work.x[0], work.y[0], work.x[c], work.y[c], work.x[c + 1], work.y[c + 1])


@noinline_helper
def fill_triangle(pattern, band, number, x0, y0, x1, y1, x2, y2):
    """Fill one triangle of fixed-point corners in either order; band.work.plane[0] holds its depth plane."""
    area = coverage.doubled_area(x0, y0, x1, y1, x2, y2)
    if area == 0:
        return
    if area < 0:
        x1, y1, x2, y2 = x2, y2, x1, y1
    first_column = max((min(x0, min(x1, x2)) + 255 - pattern.high_x) >> 8, band.clip[0]) - band.window[0]
    last_column = min((max(x0, max(x1, x2)) - pattern.low_x) >> 8, band.clip[2] - 1) - band.window[0]
    first_row = max((min(y0, min(y1, y2)) + 255 - pattern.high_y) >> 8, band.clip[1]) - band.window[1]
    last_row = min((max(y0, max(y1, y2)) - pattern.low_y) >> 8, band.clip[3] - 1) - band.window[1]
    if first_column > last_column or first_row > last_row:
        return
    ox, oy = band.window[0] << 8, band.window[1] << 8
    x0, y0, x1, y1, x2, y2 = x0 - ox, y0 - oy, x1 - ox, y1 - oy, x2 - ox, y2 - oy
    widest = max(max(abs(x2 - x1), abs(x0 - x2)), max(abs(x1 - x0), max(max(abs(y2 - y1), abs(y0 - y2)), abs(y1 - y0))))
    tiles = -(-band.window[2] // TILE)
    plane = band.work.plane
    depth = DepthPlane(plane[0, 0], plane[0, 1], plane[0, 2], plane[0, 3], plane[0, 4])
    for ty in range(first_row // TILE, last_row // TILE + 1):
        for tx in range(first_column // TILE, last_column // TILE + 1):
            x, y = tx * TILE, ty * TILE
            wx, wy = x + band.window[0], y + band.window[1]
            middle = depth.c + depth.a * (wx + 0.5 * TILE) + depth.b * (wy + 0.5 * TILE)
            reach = 0.5 * TILE * (abs(depth.a) + abs(depth.b))
            nearest = min(max(middle + reach, depth.low), depth.high)
            farthest = max(min(middle - reach, depth.high), depth.low)
            if np.float32(nearest) < band.tile_key[ty * tiles + tx]:
                continue
            covered = 0
            for s in range(len(pattern.x)):
                px, py = (x << 8) + pattern.x[s], (y << 8) + pattern.y[s]
                e0 = edge(x1, y1, x2, y2, px, py)
                e1 = edge(x2, y2, x0, y0, px, py)
                e2 = edge(x0, y0, x1, y1, px, py)
                edges = EdgeFunctions(e0, e1, e2, x2 - x1, y2 - y1, x0 - x2, y0 - y2, x1 - x0, y1 - y0)
                sample = TileSample(s, len(pattern.x), x, y, wx + pattern.x[s] / 256.0, wy + pattern.y[s] / 256.0)
                if widest < NARROW:
                    covered += fill_tile(band, number, simd.i32x16(0), sample, edges, depth)
                else:
                    covered += fill_tile(band, number, simd.i64x16(0), sample, edges, depth)
            if covered == len(pattern.x):
                band.tile_key[ty * tiles + tx] = max(band.tile_key[ty * tiles + tx], np.float32(farthest))


@helper
def edge(ax: int, ay: int, bx: int, by: int, px: int, py: int) -> int:
    """The edge function of a → b at a sample, in whole pixels: >= 0 inside."""
    dx, dy = bx - ax, by - ay
    e = dx * (py - ay) - dy * (px - ax)
    return (e if coverage.owns(dx, dy) else e - 1) >> 8


@helper
def edge_range(dx: int, dy: int) -> tuple[int, int]:
    """The greatest growth of an edge function, and its greatest decrease, a pixel right and a pixel down."""
    return max(dx, 0) + max(-dy, 0), min(dx, 0) + min(-dy, 0)


@noinline_helper
def fill_tile(band, number, zero, sample, edges, depth):
    """Depth-test a triangle at one sample of each pixel of a tile; 1 if it covers all of them, else 0.

    `zero` is a vector of the integer type that holds the edge functions.
    """
    s, samples, x, y, sx, sy = sample
    e0, e1, e2, dx0, dy0, dx1, dy1, dx2, dy2 = edges
    most0, least0 = edge_range(dx0, dy0)
    most1, least1 = edge_range(dx1, dy1)
    most2, least2 = edge_range(dx2, dy2)
    last = TILE - 1
    if e0 + last * most0 < 0 or e1 + last * most1 < 0 or e2 + last * most2 < 0:
        return 0
    all_in = e0 + last * least0 >= 0 and e1 + last * least1 >= 0 and e2 + last * least2 >= 0
    if e0 + last * least0 >= 0:  # the whole tile is inside this edge, whose function may not fit in 32 bits
        e0, dx0, dy0, most0, least0 = 0, 0, 0, 0, 0
    if e1 + last * least1 >= 0:
        e1, dx1, dy1, most1, least1 = 0, 0, 0, 0, 0
    if e2 + last * least2 >= 0:
        e2, dx2, dy2, most2, least2 = 0, 0, 0, 0, 0
    columns = band.window[2] >> 2
    wide, tall = min(BLOCKS, columns - (x >> 2)), min(BLOCKS, (band.window[3] - y) >> 2)
    lane = simd.iota(zero)
    column, line = in_block(lane)
    inner0, inner1, inner2 = line * dx0 - column * dy0, line * dx1 - column * dy1, line * dx2 - column * dy2
    right, down = in_block(simd.iota(simd.i32x16(0)))
    slope = simd.fma(simd.to_f32(right), simd.f32x16(depth.a), simd.to_f32(down) * simd.f32x16(depth.b))
    every = (1 << wide) - 1
    ids, floor, ceiling = simd.i32x16(number), simd.f32x16(depth.low), simd.f32x16(depth.high)
    for row in range(tall):
        g0, g1, g2 = e0 + 4 * row * dx0, e1 + 4 * row * dx1, e2 + 4 * row * dx2
        touched, full = every, every
        if not all_in:
            v0, v1, v2 = lane * (-4 * dy0) + g0, lane * (-4 * dy1) + g1, lane * (-4 * dy2) + g2
            touched &= simd.bits(((v0 + 3 * most0) | (v1 + 3 * most1) | (v2 + 3 * most2)) >= 0)
            full &= simd.bits(((v0 + 3 * least0) | (v1 + 3 * least1) | (v2 + 3 * least2)) >= 0)
        first_block = (((y >> 2) + row) * columns + (x >> 2)) * samples + s
        while touched:
            k = simd.trailing_zeros(touched)
            touched &= touched - 1
            key = slope + simd.f32x16(depth.c + depth.a * (sx + 4 * k) + depth.b * (sy + 4 * row))
            key = simd.maximum(simd.minimum(key, ceiling), floor)
            place = (first_block + k * samples) * 16
            old, old_ids = simd.load_aligned(band.key, place, simd.f32x16), simd.load_aligned(band.ids, place, simd.i32x16)
            nearer = (key > old) | ((key == old) & (ids < old_ids))
            if not full >> k & 1:
                inside = ((inner0 + (g0 - 4 * k * dy0)) | (inner1 + (g1 - 4 * k * dy1)) | (inner2 + (g2 - 4 * k * dy2))) >= 0
                nearer = nearer & simd.mask_from_bits(simd.bits(inside), key)
            simd.store_aligned(band.key, place, simd.select(nearer, key, old))
            simd.store_aligned(band.ids, place, simd.select(nearer, ids, old_ids))
    return 1 if all_in else 0
