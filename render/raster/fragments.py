"""Fragments of a band: each visible triangle once in each pixel; and their resolve into the picture.

A fragment is shaded at the mean position of the samples in which its triangle is visible. The triangle covers that position. Its light
goes to the pixels whose filter includes these samples.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..types import Lane
from . import triangle_planes
from .band_buffer import in_block
from .meshlets import transposed_index

REACH = 2  # pixels, largest filter radius
SIDE = 2 * REACH + 1
FULL, PARTIAL, UNIFORM, NOT_FINITE = range(4)  # of `counts`: fragments of full blocks, of others, blocks of one triangle, bad fragments


class Splat(NamedTuple):
    """Filter weights: weights[part, bits, pixel] is the sum of weights, in a nearby pixel, of the set `bits` of four samples."""

    weights: NDArray[np.float32]  # (4, 16, SIDE · SIDE), row by row; the centre is the pixel itself
    reach: int  # pixels
    parts: int  # groups of four samples in use
    single_pixel: bool  # whether a pixel's light comes from its own samples alone, all of this pass


class Fragment(NamedTuple):
    """Sixteen fragments of a block."""

    triangle: Lane  # its planes' row, or its id for the integrator
    x: Lane  # pixel
    y: Lane
    samples: Lane  # bits: the samples that it covers
    at_x: Lane  # where it is shaded, in 1/256 pixel
    at_y: Lane


class FragmentBuffer(NamedTuple):
    """A thread's fragments of four rows of pixels.

    Blocks that one triangle covers are listed apart if Splat.single_pixel. With one sample a pixel, blocks covered by several triangles
    come first, sixteen fragments each. The other fragments follow from `half` on, in the order of blocks and samples.
    """

    ids: NDArray[np.int32]  # triangle ids, for the integrator
    rows: NDArray[np.int32]  # rows of triangle_planes.PlaneCache, for deferred shading
    x: NDArray[np.int32]
    y: NDArray[np.int32]
    samples: NDArray[np.int32]  # bits: the pixel's samples in which the triangle is visible
    at_x: NDArray[np.int32]  # shading position, in 1/256 pixel
    at_y: NDArray[np.int32]
    light: NDArray[np.float32]  # (16, 4) of sixteen fragments, k at transposed_index(k)
    blocks: NDArray[np.int32]  # row of the triangle that covers a block
    block_x: NDArray[np.int32]  # the block's first pixel
    counts: NDArray[np.int64]  # (4,) fragments in full blocks, other fragments, entries of `blocks`, fragments not finite
    half: int


def fragment_buffer(columns: int, samples: int) -> FragmentBuffer:
    """A buffer for all fragments of four rows of `columns` pixels."""
    half = ((columns + 3) & ~3) * 4 * samples + 16
    ids, rows, x, y, bits, at_x, at_y = (simd.aligned_empty(2 * half, np.int32) for _ in range(7))
    even, block_x = np.empty((columns >> 2) + 32, np.int32), np.empty((columns >> 2) + 32, np.int32)
    light = simd.aligned_empty((16, 4), np.float32)
    return FragmentBuffer(ids, rows, x, y, bits, at_x, at_y, light, even, block_x, np.zeros(4, np.int64), half)


@noinline_helper
def build_fragments(pattern, per_sample, single_pixel, cache, band, row, buffer):
    """Write the fragments of a row of blocks; with `per_sample`, one for each sample.

    They refer to records of `cache`, a PlaneCache, or to triangle ids if it is None. `single_pixel` is Splat's: blocks that one triangle
    covers are listed apart.
    """
    samples = len(pattern.x)
    columns = band.window[2] >> 2
    column, line = in_block(simd.iota(simd.i32x16(0)))
    y = line + (band.window[1] + 4 * row)
    inside_y = (y >= band.clip[1]) & (y < band.clip[3])
    full_fragments, part, even = 0, buffer.half, 0
    for block in range(columns):
        block_start = (row * columns + block) * samples * 16
        ids = simd.load_aligned(band.ids, block_start, simd.i32x16)
        if samples == 1 and simd.none_of(ids >= 0):
            continue
        block_x = band.window[0] + 4 * block
        x = column + block_x
        inside = inside_y & (x >= band.clip[0]) & (x < band.clip[2])
        if cache is not None and single_pixel and not per_sample:
            triangle = simd.lane(ids, 0)
            if covers_block(band, block_start, samples, inside, triangle):
                buffer.blocks[even], buffer.block_x[even] = triangle_planes.find_row(cache, triangle), block_x
                even += 1
                continue
        for s in range(samples):
            ids = simd.load_aligned(band.ids, block_start + 16 * s, simd.i32x16)
            active = inside & (ids >= 0)
            for t in range(0 if per_sample else s):
                active = active & (ids != simd.load_aligned(band.ids, block_start + 16 * t, simd.i32x16))
            if simd.none_of(active):
                continue
            bits, at_x, at_y = merge_samples(pattern, per_sample, band, block_start, s, ids)
            rows = ids
            if cache is not None:
                rows = triangle_planes.find_rows(cache, band.ids, block_start + 16 * s, active)
            fragment = Fragment(rows, x, y, bits, at_x + (x << 8), at_y + (y << 8))
            if samples == 1 and simd.all_of(active):
                store_fragments(buffer, cache, full_fragments, fragment)
                full_fragments += 16
            else:
                part += append_fragments(buffer, cache, part, fragment, active)
    buffer.counts[FULL], buffer.counts[PARTIAL], buffer.counts[UNIFORM] = full_fragments, part - buffer.half, even


@helper
def covers_block(band: Any, block_start: int, samples: int, inside: Lane, number: int) -> bool:
    """Whether triangle `number` covers all samples of the block from place `block_start` on, inside the clip rectangle."""
    ids = simd.load_aligned(band.ids, block_start, simd.i32x16)
    same = inside & (ids == number) & (ids >= 0)
    for s in range(1, samples):
        same = same & (simd.load_aligned(band.ids, block_start + 16 * s, simd.i32x16) == number)
    return simd.all_of(same)


@helper
def merge_samples(pattern: Any, per_sample: bool, band: Any, block_start: int, s: int, ids: Lane) -> tuple[Lane, Lane, Lane]:
    """The samples from `s` on that see triangles `ids`, as bits, and their mean position; with `per_sample`, sample s alone."""
    samples = len(pattern.x)
    bits, count = simd.i32x16(1 << s), simd.i32x16(1)
    at_x, at_y = simd.i32x16(pattern.x[s]), simd.i32x16(pattern.y[s])
    if not per_sample and samples > 1:
        for t in range(s + 1, samples):
            too = ids == simd.load_aligned(band.ids, block_start + 16 * t, simd.i32x16)
            bits, count = simd.select(too, bits | (1 << t), bits), simd.select(too, count + 1, count)
            at_x, at_y = simd.select(too, at_x + pattern.x[t], at_x), simd.select(too, at_y + pattern.y[t], at_y)
        at_x, at_y = rounded_mean(at_x, count), rounded_mean(at_y, count)
    return bits, at_x, at_y


@helper
def store_fragments(buffer: Any, cache: Any, start: int, fragment: Fragment) -> None:
    """Write a full block's fragments at `start`; deferred shading needs neither their y nor their samples."""
    if cache is not None:
        simd.store_aligned(buffer.rows, start, fragment.triangle)
    simd.store_aligned(buffer.at_x, start, fragment.at_x)
    simd.store_aligned(buffer.at_y, start, fragment.at_y)
    simd.store_aligned(buffer.x, start, fragment.x)
    if cache is None:
        simd.store_aligned(buffer.ids, start, fragment.triangle)
        simd.store_aligned(buffer.y, start, fragment.y)
        simd.store_aligned(buffer.samples, start, fragment.samples)


@helper
def append_fragments(buffer: Any, cache: Any, start: int, fragment: Fragment, active: Lane) -> int:
    """Write the fragments of the lanes `active` from `start` on; returns their number."""
    if cache is not None:
        simd.compress_store(buffer.rows, start, fragment.triangle, active)
    else:
        simd.compress_store(buffer.ids, start, fragment.triangle, active)
    simd.compress_store(buffer.at_x, start, fragment.at_x, active)
    simd.compress_store(buffer.at_y, start, fragment.at_y, active)
    simd.compress_store(buffer.x, start, fragment.x, active)
    simd.compress_store(buffer.y, start, fragment.y, active)
    return simd.compress_store(buffer.samples, start, fragment.samples, active)


@helper
def fragment_start(listed: Any, group: int) -> int:
    """The first fragment of a group of sixteen. Groups are numbered: single-triangle blocks, full blocks, others."""
    start = 16 * (group - listed.counts[UNIFORM])
    return start if start < listed.counts[FULL] else listed.half + start - listed.counts[FULL]


@helper
def mean_position(pattern: Any) -> tuple[float, float]:
    """The mean position of all samples in a pixel, rounded like `rounded_mean`, in pixels."""
    count, x, y = len(pattern.x), 0, 0
    for s in range(count):
        x, y = x + pattern.x[s], y + pattern.y[s]
    return ((2 * x + count) // (2 * count)) / 256.0, ((2 * y + count) // (2 * count)) / 256.0


@helper
def rounded_mean(total: Lane, count: Lane) -> Lane:
    """total / count, rounded to the nearest integer."""
    return simd.to_i32(simd.to_f32(2 * total + count) / simd.to_f32(2 * count))


@noinline_helper
def clear_rows(rgba, band, crop, y0, y1):
    """Clear the rows of pixels y0 <= y < y1 that a band writes."""
    width = 4 * (crop[2] - crop[0])
    first, last = (max(y0, band.rows[0]) - crop[1]) * width, (min(y1, band.rows[1]) - crop[1]) * width
    nothing = simd.f32x16(0.0)
    for k in range(first, last - 15, 16):
        simd.store(rgba, k, nothing)
    for k in range(max(last - 15, first), last):
        simd.write(rgba, k, np.float32(0.0))


@noinline_helper
def resolve_fragments(pattern, splat, band, buffer, start, count, crop, rgba):
    """Add the light of up to sixteen fragments to the picture."""
    if len(pattern.x) > 1:
        splat_fragments(splat, band, buffer, start, count, crop, rgba)
    else:
        write_fragments(buffer, start, count, crop, rgba)


@helper
def to_rgba_rows(red: Lane, green: Lane, blue: Lane, count: int, listed: Any) -> Any:
    """The colours of sixteen fragments as r, g, b, 1 in four vectors, every fourth fragment's, see meshlets.transposed_index.

    Colours that are not finite become 0; those of the first `count` are counted.
    """
    sound = simd.is_finite(red + green + blue)
    if not simd.all_of(sound):
        listed.counts[NOT_FINITE] += simd.count(simd.first_lanes(count, red) & ~sound)
        red, green, blue = simd.select(sound, red, 0.0), simd.select(sound, green, 0.0), simd.select(sound, blue, 0.0)
    return simd.transpose((red, green, blue, simd.f32x16(1.0)))


@helper
def write_block(rows: Any, x: int, y: int, crop: Any, past: bool, rgba: Any) -> None:
    """Write a block's four rows of pixels from (x, y) on; `past`: with non-temporal stores, if nothing was written there."""
    width = 4 * (crop[2] - crop[0])
    place = (y - crop[1]) * width + 4 * (x - crop[0])
    if past and ((width | place) & 15) == 0:
        simd.store_past(rgba, place, rows[0])
        simd.store_past(rgba, place + width, rows[1])
        simd.store_past(rgba, place + 2 * width, rows[2])
        simd.store_past(rgba, place + 3 * width, rows[3])
        return
    simd.store(rgba, place, rows[0])
    simd.store(rgba, place + width, rows[1])
    simd.store(rgba, place + 2 * width, rows[2])
    simd.store(rgba, place + 3 * width, rows[3])


@helper
def write_fragments(buffer: Any, start: int, count: int, crop: Any, rgba: Any) -> None:
    """Write up to sixteen pixels of one sample each."""
    for k in range(count):
        place = ((buffer.y[start + k] - crop[1]) * (crop[2] - crop[0]) + buffer.x[start + k] - crop[0]) * 4
        simd.store(rgba, place, simd.load(buffer.light, 4 * transposed_index(k), simd.f32x4))


@helper
def splat_fragments(splat: Any, band: Any, buffer: Any, start: int, count: int, crop: Any, rgba: Any) -> None:
    """Add up to sixteen fragments to the pixels around them, in this band's rows, by filter weights."""
    reach, width = splat.reach, crop[2] - crop[0]
    for k in range(count):
        light, bits = simd.load(buffer.light, 4 * transposed_index(k), simd.f32x4), buffer.samples[start + k]
        x, y = buffer.x[start + k], buffer.y[start + k]
        for dy in range(-reach, reach + 1):
            if y + dy < band.rows[0] or y + dy >= band.rows[1]:
                continue
            for dx in range(-reach, reach + 1):
                if x + dx < crop[0] or x + dx >= crop[2]:
                    continue
                pixel = (dy + REACH) * SIDE + dx + REACH
                weight = splat.weights[0, bits & 15, pixel]
                for part in range(1, splat.parts):
                    weight += splat.weights[part, bits >> (4 * part) & 15, pixel]
                place = ((y + dy - crop[1]) * width + x + dx - crop[0]) * 4
                simd.store(rgba, place, simd.fma(light, simd.f32x4(weight), simd.load(rgba, place, simd.f32x4)))


@helper
def store_fragment_light(light: Any, rows: Any) -> None:
    """Store the transposed light of sixteen fragments."""
    simd.store_aligned(light, 0, rows[0])
    simd.store_aligned(light, 16, rows[1])
    simd.store_aligned(light, 32, rows[2])
    simd.store_aligned(light, 48, rows[3])
