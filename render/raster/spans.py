"""Blocks of pixels that one face fills, run by run along a row of blocks: what all of a run share is looked up once.

Where a face is flat, lamps are far away and nothing has a pattern, only highlights differ from pixel to pixel: such a run is lit and
written at once. Others become points like all else that is seen.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..material import bsdf
from . import fragments, precise_planes, triangle_planes
from .band_buffer import in_block
from .meshlet_culling import EVERYWHERE
from .meshlets import SHIFT
from .shading_points import CAPACITY, keep, over_picture


@helper
def see(shading: Any, patterned: Any, colored: Any, flat: Any, group: int, y: int, middle: tuple[float, float]) -> tuple[int, int]:
    """Have the points of blocks from `group` on, as many as there is room for: the next one, and how many. It stops at a `flat` run.

    `y`: where the row of blocks begins; `middle`: where in pixels that one face fills it is lit.
    """
    found, listed = shading.faces, shading.items
    column, line = in_block(simd.iota(simd.i32x16(0)))
    across, at_y = simd.to_f32(column) + np.float32(middle[0]), simd.to_f32(line) + np.float32(y + middle[1])
    every = column >= 0
    count = 0
    while group < listed.counts[2] and count < CAPACITY:
        face = simd.read(listed.even, group)
        i = instance_of(shading, face)
        if flat is not None and is_flat(shading, i, face):
            break
        row, end = record_of(shading, patterned, colored, i, face, simd.read(listed.even_x, group), y)
        if row < 0:
            at_x = across + np.float32(simd.read(listed.even_x, group))
            point = precise_planes.seen(
                shading.shown, shading.meshlets, shading.drawn, shading.lit, found, patterned, colored, i, face, at_x, at_y
            )
            keep(shading, patterned, colored, count, point, at_x, at_y, i, every, group)
            count += 1
            group += 1
            continue
        record = triangle_planes.spread(found, patterned, colored, row)
        last = end_of(listed, face, end, group, group + CAPACITY - count)
        for k in range(group, last):
            at_x = across + np.float32(simd.read(listed.even_x, k))
            point = triangle_planes.interpolate(shading.shown, patterned, colored, record, at_x, at_y)
            keep(shading, patterned, colored, count + k - group, point, at_x, at_y, i, every, k)
        count += last - group
        group = last
    return group, count


@helper
def instance_of(shading: Any, face: int) -> int:
    return shading.drawn.instance[simd.read(shading.faces.owner, face) >> SHIFT]


@helper
def is_flat(shading: Any, i: int, face: int) -> bool:
    """Whether a face's corners have one normal."""
    if not triangle_planes.is_single(shading.faces, face):
        return triangle_planes.is_flat(shading.faces, face)
    return precise_planes.is_flat(shading.shown, shading.meshlets, shading.drawn, shading.lit, shading.faces, i, face)


@helper
def record_of(shading: Any, patterned: Any, colored: Any, i: int, face: int, x: int, y: int) -> tuple[int, int]:
    """The row of a face's record that holds in the block from (x, y) on, or -1, and up to which x it holds there."""
    if not triangle_planes.is_single(shading.faces, face):
        return face, EVERYWHERE
    row = precise_planes.near(
        shading.shown, shading.meshlets, shading.drawn, shading.lit, shading.faces, patterned, colored, i, face, x, y
    )  # fmt: skip
    return row, precise_planes.end_of(shading.faces, face)


@helper
def end_of(listed: Any, face: int, end: int, group: int, most: int) -> int:
    """The first block after `group` that another face fills, or that lies at `end` or beyond; `most` at the most."""
    most = min(most, listed.counts[2])
    last = group + 1
    while last < most and simd.read(listed.even, last) == face and simd.read(listed.even_x, last) < end:
        last += 1
    return last


@noinline_helper
def light_flat(shading, shader, group, y, middle, crop, full, rgba):
    """Light a flat face's run of blocks from `group` on into the picture; the next one. Its material is `shader`, in numbers."""
    found, listed, lamps, look = shading.faces, shading.items, shading.lamps, shading.look
    face = simd.read(listed.even, group)
    last = end_of(listed, face, EVERYWHERE, group, EVERYWHERE)
    normal = _unit_normal(found, face)
    even = ops.add(shader.emission, ops.mul(shader.ambient, (lamps.ambient[0], lamps.ambient[1], lamps.ambient[2])))
    for k in range(len(lamps.row)):
        cosine = ops.dot(normal, (lamps.direction[k, 0], lamps.direction[k, 1], lamps.direction[k, 2]))
        even = ops.add(even, ops.mul(bsdf.matt(shader, cosine), (lamps.color[k, 0], lamps.color[k, 1], lamps.color[k, 2])))
    red, green, blue = simd.f32x16(even[0]), simd.f32x16(even[1]), simd.f32x16(even[2])
    column, line = in_block(simd.iota(simd.i32x16(0)))
    start = over_picture(look.direction, simd.to_f32(column) + np.float32(middle[0]), simd.to_f32(line) + np.float32(y + middle[1]))
    for block in range(group, last):
        x = simd.read(listed.even_x, block)
        along = _moved(start, look.direction, np.float32(x))
        viewer = ops.scale(along, -simd.reciprocal_sqrt(ops.dot(along, along)))
        color = (red, green, blue)
        for k in range(len(lamps.row)):
            direction = (lamps.direction[k, 0], lamps.direction[k, 1], lamps.direction[k, 2])
            cosine = ops.dot(normal, direction)
            if bsdf.has_highlight(shader, cosine):
                tint = ops.mul(shader.specular, (lamps.color[k, 0], lamps.color[k, 1], lamps.color[k, 2]))
                lobe = bsdf.highlight(shader, normal, direction, viewer, cosine)
                color = (simd.fma(lobe, tint[0], color[0]), simd.fma(lobe, tint[1], color[1]), simd.fma(lobe, tint[2], color[2]))
        fragments.write_block(fragments.rows_of(color[0], color[1], color[2], 16, listed), x, y, crop, full, rgba)
    return last


@helper
def _moved(start: Any, table: Any, x: float) -> Any:
    """Rays' directions x pixels farther right."""
    return start[0] + x * table[1, 0], start[1] + x * table[1, 1], start[2] + x * table[1, 2]


@helper
def _unit_normal(found: Any, face: int) -> tuple[float, float, float]:
    """A flat face's normal, which its record has over the distance."""
    at = face * found.record.shape[1]
    x, y, z = simd.read(found.record, at), simd.read(found.record, at + 1), simd.read(found.record, at + 2)
    if triangle_planes.is_single(found, face):
        x, y, z = precise_planes.normal_of(found, face)
    scale = np.float32(1.0) / np.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale
