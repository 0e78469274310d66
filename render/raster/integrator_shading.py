"""Shades the fragments of a band with the Whitted integrator, for all features of a scene.

A fragment of a tessellated shape moves to the point where its ray hits the true surface.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import camera
from ..integrator import background, whitted
from ..jit.kernel import helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..light import airlight
from ..sampling import sobol
from ..types import Lane
from . import coverage
from .band_buffer import in_block
from .fragments import FULL, NOT_FINITE, PARTIAL, build_fragments, resolve_fragments
from .meshlets import SHIFT, transposed_index
from .sample_hits import axis_cosine, find_hits, intersect

UNTESSELLATED = (1 << 30) - 1  # larger ids are of instances without triangles


class IntegratorShading(NamedTuple):
    """Inputs and buffers of `shade_band` of one thread: a Handle each."""

    model: Handle
    pattern: Handle
    meshlets: Handle
    visible: Handle
    tables: Handle
    accel: Handle
    vertex_light: Handle
    frame: Handle
    splat: Handle
    band: Handle
    fragments: Handle
    stack: NDArray[np.float64]  # of rays, see `ray_stack.stack_for`


@kernel
def shade_band(shading, per_sample, sample, crop, rgba):
    """Add the light of a band to the pixels of `crop` of the picture, (h, w, 4); the pattern's first sample has number `sample`."""
    pattern, splat, band, buffer = shading.pattern, shading.splat, shading.band, shading.fragments
    buffer.counts[NOT_FINITE] = 0
    for row in range(band.window[3] >> 2):
        build_fragments(pattern, per_sample, False, None, band, row, buffer)
        for k in range(0, buffer.counts[FULL], 16):
            shade_fragments(shading, sample, k, 16)
            resolve_fragments(pattern, splat, band, buffer, k, 16, crop, rgba)
        for k in range(buffer.half, buffer.half + buffer.counts[PARTIAL], 16):
            count = min(buffer.half + buffer.counts[PARTIAL] - k, 16)
            shade_fragments(shading, sample, k, count)
            resolve_fragments(pattern, splat, band, buffer, k, count, crop, rgba)


@noinline_helper
def shade_fragments(shading, sample, start, count):
    """Write the light of `count` fragments from `start` on to fragments.light, as red, green, blue and coverage."""
    meshlets, visible, tables, accel = shading.meshlets, shading.visible, shading.tables, shading.accel
    frame, buffer = shading.frame, shading.fragments
    view = frame.picture
    for first in range(0, count, crosslane.WIDTH):
        k = start + ops.minimum(crosslane.lane_indices(first), count - 1)
        ids = ops.to_int(buffer.ids[k])
        x, y = ops.to_float(buffer.at_x[k]), ops.to_float(buffer.at_y[k])
        untessellated = ids > UNTESSELLATED
        row = ops.where(untessellated, 0, ids >> SHIFT)
        slot = ops.to_int(visible.first[row]) + (ids & ((1 << SHIFT) - 1))
        instance = ops.where(untessellated, ids & UNTESSELLATED, ops.to_int(visible.instance[row]))
        triangle = ops.where(untessellated, -1, ops.to_int(meshlets.corner[ops.where(untessellated, 0, slot), 3]))
        ray = camera.generate_pinhole_ray(tables, view, x / coverage.ONE, y / coverage.ONE)
        hit = find_hits(shading.model, tables, accel, view, ray, x, y, instance, triangle)
        number = sample + lowest_bit(ops.to_int(buffer.samples[k]))
        pixel, index = sobol.zorder_index(ops.to_int(buffer.x[k]), ops.to_int(buffer.y[k]), number, view.width, frame.order)
        light = shading.vertex_light
        color, alpha, sound = whitted.linked_radiance(frame, tables, accel, light, ray, hit, pixel, index, shading.stack, None)
        if ops.any_lane(alpha < 1.0):  # the background is added to finished bands
            behind = background.camera_background(tables, frame.options, ray.direction)
            behind = airlight.seen_through(frame.options.airlight, behind, tables, ray.origin, ray.direction, 0.0 * alpha + math.inf)
            color = ops.sub(color, ops.scale(behind, 1.0 - alpha))
        for j in range(min(count - first, crosslane.WIDTH)):
            place = transposed_index(first + j)
            for c in range(3):
                buffer.light[place, c] = crosslane.lane(color[c], j)
            buffer.light[place, 3] = crosslane.lane(alpha, j)
            buffer.counts[NOT_FINITE] += 0 if crosslane.lane(sound, j) else 1


@helper
def lowest_bit(bits: Lane) -> Lane:
    """The number of the lowest set bit of sixteen."""
    position = bits * 0
    for k in range(1, 16):
        position = position + ops.where((bits & ((1 << k) - 1)) == 0, 1, 0)
    return position


@kernel
def draw_untessellated(model, untessellated, boxes, tables, accel, view, pattern, band):
    """Draw shapes without triangles into the visibility buffer: intersects a ray for each sample.

    `boxes` are the pixel bounds (x0, y0, x1, y1) of each.
    """
    samples, columns = len(pattern.x), band.window[2] >> 2
    for e in range(len(untessellated)):
        instance = untessellated[e]
        first_block, end_block = max(boxes[e, 0] - band.window[0], 0) >> 2, (min(boxes[e, 2] - band.window[0], band.window[2]) + 3) >> 2
        first_row, end_row = max(boxes[e, 1] - band.window[1], 0) >> 2, (min(boxes[e, 3] - band.window[1], band.window[3]) + 3) >> 2
        for row in range(first_row, end_row):
            for block in range(first_block, end_block):
                x, y = band.window[0] + 4 * block, band.window[1] + 4 * row
                for s in range(samples):
                    place = ((row * columns + block) * samples + s) * 16
                    draw_block(
                        model, instance, tables, accel, view, band, place, x * coverage.ONE + pattern.x[s], y * coverage.ONE + pattern.y[s]
                    )


@noinline_helper
def draw_block(model, instance, tables, accel, view, band, place, x, y):
    """Draw an instance into sixteen samples of a block, the first at (x, y) in 1/256 pixel, from `place` of the buffer on."""
    for start in range(0, 16, crosslane.WIDTH):
        column, line = in_block(crosslane.lane_indices(start))
        px, py = ops.to_float(x + column * coverage.ONE), ops.to_float(y + line * coverage.ONE)
        ray = camera.generate_pinhole_ray(tables, view, px / coverage.ONE, py / coverage.ONE)
        hit = intersect(accel, instance, ray, ops.bool_like(ray.t_max, True))
        depth = hit.t * axis_cosine(tables, view, ray)
        for j in range(crosslane.WIDTH):
            if crosslane.lane(hit.instance, j) >= 0:
                far = crosslane.lane(depth, j)
                key = np.float32(1.0 / far if model.perspective else -far)
                if key > band.key[place + start + j]:
                    band.key[place + start + j], band.ids[place + start + j] = key, UNTESSELLATED + 1 + instance


@kernel
def composite_sky(tables, frame, x0, y0, width, rgba):
    """Composite the pixels of `rgba` over the sky: rows of `width` pixels, the first at (x0, y0)."""
    for y in range(len(rgba) // (4 * width)):
        for start in range(0, width, crosslane.WIDTH):
            k = ops.minimum(crosslane.lane_indices(start), width - 1)
            clear = 1.0 - ops.to_float(rgba[4 * (y * width + k) + 3])
            if not ops.any_lane(clear > 0.0):
                continue
            ray = camera.generate_pinhole_ray(tables, frame.picture, ops.to_float(k + x0) + 0.5, ops.to_float(k * 0 + y0 + y) + 0.5)
            color = background.camera_background(tables, frame.options, ray.direction)
            color = airlight.seen_through(frame.options.airlight, color, tables, ray.origin, ray.direction, 0.0 * clear + math.inf)
            veiled = clear * airlight.opacity(frame.options.airlight, 0.0 * clear, ray.origin, ray.direction, 0.0 * clear + math.inf)
            for j in range(min(width - start, crosslane.WIDTH)):
                for c in range(3):
                    rgba[4 * (y * width + start + j) + c] += crosslane.lane(clear, j) * crosslane.lane(color[c], j)
                rgba[4 * (y * width + start + j) + 3] += crosslane.lane(veiled, j)
