"""Spans: runs of blocks that one triangle covers, along a row of blocks; shared lookups are made once a span.

A span of a flat triangle lit by far lights, without textures, varies only in highlights: it is shaded and written at once. Other spans
become points like all fragments.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..material import phong
from . import fragments, precise_planes, triangle_planes
from .band_buffer import in_block
from .fragments import UNIFORM
from .meshlet_culling import EVERYWHERE
from .meshlets import SHIFT
from .shading_points import CAPACITY, at_pixel, store_point


@helper
def interpolate_run(shading: Any, textured: Any, colored: Any, flat_runs: Any, group: int, y: int,
                    middle: tuple[float, float]) -> tuple[int, int]:  # fmt: skip
    """Interpolate the points of blocks from `group` on, up to CAPACITY; returns the next block and the number of points.

    Stops at a flat triangle if `flat_runs`. `y` is the first row of the blocks, `middle` the shading position in a pixel.
    """
    cache, buffer = shading.planes, shading.fragments
    column, line = in_block(simd.iota(simd.i32x16(0)))
    across, at_y = simd.to_f32(column) + np.float32(middle[0]), simd.to_f32(line) + np.float32(y + middle[1])
    every = column >= 0
    count = 0
    while group < buffer.counts[UNIFORM] and count < CAPACITY:
        face = simd.read(buffer.blocks, group)
        i = instance_of(shading, face)
        if flat_runs is not None and is_flat(shading, i, face):
            break
        row, end = block_record(shading, textured, colored, i, face, simd.read(buffer.block_x, group), y)
        if row < 0:
            at_x = across + np.float32(simd.read(buffer.block_x, group))
            point = precise_planes.interpolate(shading, textured, colored, i, face, at_x, at_y)
            store_point(shading, textured, colored, count, point, at_x, at_y, i, every, group)
            count += 1
            group += 1
            continue
        record = triangle_planes.broadcast_record(cache, textured, colored, row)
        last = run_end(buffer, face, end, group, group + CAPACITY - count)
        for k in range(group, last):
            at_x = across + np.float32(simd.read(buffer.block_x, k))
            point = triangle_planes.interpolate(shading.projection, textured, colored, record, at_x, at_y)
            store_point(shading, textured, colored, count + k - group, point, at_x, at_y, i, every, k)
        count += last - group
        group = last
    return group, count


@helper
def instance_of(shading: Any, face: int) -> int:
    """The instance of a record's triangle."""
    return shading.visible.instance[simd.read(shading.planes.owner, face) >> SHIFT]


@helper
def is_flat(shading: Any, i: int, face: int) -> bool:
    """Whether a triangle's corners have one normal."""
    if not triangle_planes.is_precise(shading.planes, face):
        return triangle_planes.is_flat(shading.planes, face)
    return precise_planes.is_flat(shading, i, face)


@helper
def block_record(shading: Any, textured: Any, colored: Any, i: int, face: int, x: int, y: int) -> tuple[int, int]:
    """The row of a triangle's record for the block at (x, y), or -1; and the x at which its validity ends."""
    if not triangle_planes.is_precise(shading.planes, face):
        return face, EVERYWHERE
    row = precise_planes.block_record(shading, textured, colored, i, face, x, y)
    return row, precise_planes.block_record_end(shading.planes, face)


@helper
def run_end(buffer: Any, face: int, end: int, group: int, most: int) -> int:
    """The end of the run of blocks of one triangle from `group` on, before x = `end` and before block `most`."""
    most = min(most, buffer.counts[UNIFORM])
    last = group + 1
    while last < most and simd.read(buffer.blocks, last) == face and simd.read(buffer.block_x, last) < end:
        last += 1
    return last


@noinline_helper
def shade_flat_run(shading, shader, group, y, middle, crop, full, rgba):
    """Shade and write the run of a flat triangle from block `group` on; returns the next block. `shader` is its scalar shader."""
    cache, buffer, sources, rays = shading.planes, shading.fragments, shading.sources, shading.rays
    face = simd.read(buffer.blocks, group)
    last = run_end(buffer, face, EVERYWHERE, group, EVERYWHERE)
    normal = flat_normal(cache, face)
    even = ops.add(shader.emission, ops.mul(shader.ambient, (sources.ambient[0], sources.ambient[1], sources.ambient[2])))
    for k in range(len(sources.row)):
        cosine = ops.dot(normal, (sources.direction[k, 0], sources.direction[k, 1], sources.direction[k, 2]))
        even = ops.add(even, ops.mul(phong.eval_diffuse(shader, cosine), (sources.color[k, 0], sources.color[k, 1], sources.color[k, 2])))
    red, green, blue = simd.f32x16(even[0]), simd.f32x16(even[1]), simd.f32x16(even[2])
    column, line = in_block(simd.iota(simd.i32x16(0)))
    start = at_pixel(rays.direction, simd.to_f32(column) + np.float32(middle[0]), simd.to_f32(line) + np.float32(y + middle[1]))
    for block in range(group, last):
        x = simd.read(buffer.block_x, block)
        along = shift_right(start, rays.direction, np.float32(x))
        viewer = ops.scale(along, -simd.reciprocal_sqrt(ops.dot(along, along)))
        color = (red, green, blue)
        for k in range(len(sources.row)):
            direction = (sources.direction[k, 0], sources.direction[k, 1], sources.direction[k, 2])
            cosine = ops.dot(normal, direction)
            if phong.has_highlight(shader, cosine):
                tint = ops.mul(shader.specular, (sources.color[k, 0], sources.color[k, 1], sources.color[k, 2]))
                lobe = phong.highlight(shader, normal, direction, viewer, cosine)
                color = (simd.fma(lobe, tint[0], color[0]), simd.fma(lobe, tint[1], color[1]), simd.fma(lobe, tint[2], color[2]))
        fragments.write_block(fragments.to_rgba_rows(color[0], color[1], color[2], 16, buffer), x, y, crop, full, rgba)
    return last


@helper
def shift_right(start: Any, table: Any, x: float) -> Any:
    """Ray directions x pixels farther right."""
    return start[0] + x * table[1, 0], start[1] + x * table[1, 1], start[2] + x * table[1, 2]


@helper
def flat_normal(cache: Any, face: int) -> tuple[float, float, float]:
    """The unit normal of a flat triangle; its record holds it over the distance."""
    offset = face * cache.record.shape[1]
    x, y, z = simd.read(cache.record, offset), simd.read(cache.record, offset + 1), simd.read(cache.record, offset + 2)
    if triangle_planes.is_precise(cache, face):
        x, y, z = precise_planes.flat_normal(cache, face)
    scale = np.float32(1.0) / np.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale
