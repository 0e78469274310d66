"""The items of a band lit by the integrator of all backends, with shadow rays: for whatever a scene may hold.

Where a triangle stands for a shape, the item is put where its ray meets the shape itself.
"""

from __future__ import annotations

import numpy as np

from .. import camera
from ..integrator import whitted
from ..jit.kernel import helper, kernel, noinline_helper
from ..lanes import crosslane, ops
from ..sampling import sobol
from ..types import Lane
from . import coverage
from .band_buffer import in_block
from .fragments import build_fragments, resolve_fragments
from .meshlets import SHIFT, place_of
from .sample_hits import along_axis, hits_of, meet

EXACT = (1 << 30) - 1  # ids above it: instances without triangles


@kernel
def shade_band(made, pattern, each, sample, meshlets, drawn, tables, accel, gouraud, frame, splat, band, items, stack, crop, rgba):
    """Light what a band shows and add it to the picture, (h, w, 4), of the pixels of `crop`; `sample` is the pattern's first."""
    items.counts[3] = 0
    for row in range(band.place[3] >> 2):
        build_fragments(pattern, each, False, None, band, row, items)
        for k in range(0, items.counts[0], 16):
            light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, 16)
            resolve_fragments(pattern, splat, band, items, k, 16, crop, rgba)
        for k in range(items.half, items.half + items.counts[1], 16):
            count = min(items.half + items.counts[1] - k, 16)
            light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, count)
            resolve_fragments(pattern, splat, band, items, k, count, crop, rgba)


@noinline_helper
def light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, start, count):
    """The light of `count` items from `start` on, as r, g, b, coverage into items.light."""
    view = frame.picture
    for first in range(0, count, crosslane.WIDTH):
        k = start + ops.minimum(crosslane.lane_indices(first), count - 1)
        ids = ops.to_int(items.ids[k])
        x, y = ops.to_float(items.at_x[k]), ops.to_float(items.at_y[k])
        exact = ids > EXACT
        row = ops.where(exact, 0, ids >> SHIFT)
        slot = ops.to_int(drawn.first[row]) + (ids & ((1 << SHIFT) - 1))
        instance = ops.where(exact, ids & EXACT, ops.to_int(drawn.instance[row]))
        triangle = ops.where(exact, -1, ops.to_int(meshlets.corner[ops.where(exact, 0, slot), 3]))
        ray = camera.ray(tables, view, x / coverage.ONE, y / coverage.ONE)
        hit = hits_of(made, tables, accel, view, ray, x, y, instance, triangle)
        number = sample + lowest(ops.to_int(items.samples[k]))
        pixel, index = sobol.zorder_index(ops.to_int(items.x[k]), ops.to_int(items.y[k]), number, view.width, frame.order)
        color, alpha, sound = whitted.call(  # pyright: ignore[reportCallIssue]
            frame.radiance,
            (
                tables, accel, gouraud, frame.options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive,
                hit.u, hit.v, pixel, index, stack, None, None,
            ),
        )  # fmt: skip
        for j in range(min(count - first, crosslane.WIDTH)):
            place = place_of(first + j)
            for c in range(3):
                items.light[place, c] = crosslane.lane(color[c], j)
            items.light[place, 3] = crosslane.lane(alpha, j)
            items.counts[3] += 0 if crosslane.lane(sound, j) else 1


@helper
def lowest(bits: Lane) -> Lane:
    """The number of the lowest of sixteen bits that is set."""
    found = bits * 0
    for k in range(1, 16):
        found = found + ops.where((bits & ((1 << k) - 1)) == 0, 1, 0)
    return found


@kernel
def draw_exact(made, exact, boxes, tables, accel, view, pattern, band):
    """Draw shapes that have no triangles into the visibility buffer: at every sample where its ray meets one of them.

    `boxes` are the pixels (x0, y0, x1, y1) that each may be seen in.
    """
    samples, columns = len(pattern.x), band.place[2] >> 2
    for e in range(len(exact)):
        instance = exact[e]
        left, right = max(boxes[e, 0] - band.place[0], 0) >> 2, (min(boxes[e, 2] - band.place[0], band.place[2]) + 3) >> 2
        above, below = max(boxes[e, 1] - band.place[1], 0) >> 2, (min(boxes[e, 3] - band.place[1], band.place[3]) + 3) >> 2
        for row in range(above, below):
            for block in range(left, right):
                x, y = band.place[0] + 4 * block, band.place[1] + 4 * row
                for s in range(samples):
                    place = ((row * columns + block) * samples + s) * 16
                    draw_block(
                        made, instance, tables, accel, view, band, place, x * coverage.ONE + pattern.x[s], y * coverage.ONE + pattern.y[s]
                    )


@noinline_helper
def draw_block(made, instance, tables, accel, view, band, place, x, y):
    """Sixteen samples of a block, the first of them at (x, y), from `place` in the buffer on."""
    for start in range(0, 16, crosslane.WIDTH):
        column, line = in_block(crosslane.lane_indices(start))
        px, py = ops.to_float(x + column * coverage.ONE), ops.to_float(y + line * coverage.ONE)
        ray = camera.ray(tables, view, px / coverage.ONE, py / coverage.ONE)
        met = meet(accel, instance, ray, ops.bool_like(ray.t_max, True))
        depth = met.t * along_axis(tables, view, ray)
        for j in range(crosslane.WIDTH):
            if crosslane.lane(met.instance, j) >= 0:
                far = crosslane.lane(depth, j)
                key = np.float32(1.0 / far if made.perspective else -far)
                if key > band.key[place + start + j]:
                    band.key[place + start + j], band.ids[place + start + j] = key, EXACT + 1 + instance


@kernel
def sky_behind(tables, frame, x0, y0, width, rgba):
    """Put what the camera sees where nothing is behind the pixels of `rgba`, rows of `width` pixels, the first of which is (x0, y0)."""
    for y in range(len(rgba) // (4 * width)):
        for start in range(0, width, crosslane.WIDTH):
            k = ops.minimum(crosslane.lane_indices(start), width - 1)
            clear = 1.0 - ops.to_float(rgba[4 * (y * width + k) + 3])
            if not ops.any_lane(clear > 0.0):
                continue
            ray = camera.ray(tables, frame.picture, ops.to_float(k + x0) + 0.5, ops.to_float(k * 0 + y0 + y) + 0.5)
            color = whitted.camera_background(tables, frame.options, ray.direction)
            for j in range(min(width - start, crosslane.WIDTH)):
                for c in range(3):
                    rgba[4 * (y * width + start + j) + c] += crosslane.lane(clear, j) * crosslane.lane(color[c], j)
