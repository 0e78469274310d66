"""The items of a band lit by the integrator of all backends, with shadow rays: for whatever a scene may hold.

Where a triangle stands for a shape, the item is put where its ray meets the shape itself.
"""

from __future__ import annotations

import numpy as np

from . import across, camera, fill, integrate, lanes, sampler
from .bands import in_block
from .hits import along_axis, hits_of, meet
from .items import collect, keep_items
from .kernels import apart, helper, kernel
from .meshlets import SHIFT, place_of
from .records import Lane

EXACT = (1 << 30) - 1  # ids above it: instances without triangles


@kernel
def shade_band(made, pattern, each, sample, meshlets, drawn, tables, accel, gouraud, frame, splat, band, items, stack, crop, rgba):
    """Light what a band shows and add it to the picture, (h, w, 4), of the pixels of `crop`; `sample` is the pattern's first."""
    items.counts[3] = 0
    for row in range(band.place[3] >> 2):
        collect(pattern, each, False, None, band, row, items)
        for k in range(0, items.counts[0], 16):
            light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, 16)
            keep_items(pattern, splat, band, items, k, 16, crop, rgba)
        for k in range(items.half, items.half + items.counts[1], 16):
            count = min(items.half + items.counts[1] - k, 16)
            light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, count)
            keep_items(pattern, splat, band, items, k, count, crop, rgba)


@apart
def light_items(made, sample, meshlets, drawn, tables, accel, gouraud, frame, items, stack, start, count):
    """The light of `count` items from `start` on, as r, g, b, coverage into items.light."""
    view = frame.picture
    for first in range(0, count, across.WIDTH):
        k = start + lanes.minimum(across.numbered(first), count - 1)
        ids = lanes.to_int(items.ids[k])
        x, y = lanes.to_float(items.at_x[k]), lanes.to_float(items.at_y[k])
        exact = ids > EXACT
        row = lanes.where(exact, 0, ids >> SHIFT)
        slot = lanes.to_int(drawn.first[row]) + (ids & ((1 << SHIFT) - 1))
        instance = lanes.where(exact, ids & EXACT, lanes.to_int(drawn.instance[row]))
        triangle = lanes.where(exact, -1, lanes.to_int(meshlets.corner[lanes.where(exact, 0, slot), 3]))
        ray = camera.ray(tables, view, x / fill.ONE, y / fill.ONE)
        hit = hits_of(made, tables, accel, view, ray, x, y, instance, triangle)
        number = sample + lowest(lanes.to_int(items.samples[k]))
        pixel, index = sampler.place(lanes.to_int(items.x[k]), lanes.to_int(items.y[k]), number, view.width, frame.order)
        color, alpha, sound = integrate.call(  # pyright: ignore[reportCallIssue]
            frame.radiance,
            (
                tables, accel, gouraud, frame.options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive,
                hit.u, hit.v, pixel, index, stack, None, None,
            ),
        )  # fmt: skip
        for j in range(min(count - first, across.WIDTH)):
            place = place_of(first + j)
            for c in range(3):
                items.light[place, c] = across.lane(color[c], j)
            items.light[place, 3] = across.lane(alpha, j)
            items.counts[3] += 0 if across.lane(sound, j) else 1


@helper
def lowest(bits: Lane) -> Lane:
    """The number of the lowest of sixteen bits that is set."""
    found = bits * 0
    for k in range(1, 16):
        found = found + lanes.where((bits & ((1 << k) - 1)) == 0, 1, 0)
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
                    draw_block(made, instance, tables, accel, view, band, place, x * fill.ONE + pattern.x[s], y * fill.ONE + pattern.y[s])


@apart
def draw_block(made, instance, tables, accel, view, band, place, x, y):
    """Sixteen samples of a block, the first of them at (x, y), from `place` in the buffer on."""
    for start in range(0, 16, across.WIDTH):
        column, line = in_block(across.numbered(start))
        px, py = lanes.to_float(x + column * fill.ONE), lanes.to_float(y + line * fill.ONE)
        ray = camera.ray(tables, view, px / fill.ONE, py / fill.ONE)
        met = meet(accel, instance, ray, lanes.bool_like(ray.t_max, True))
        depth = met.t * along_axis(tables, view, ray)
        for j in range(across.WIDTH):
            if across.lane(met.instance, j) >= 0:
                far = across.lane(depth, j)
                key = np.float32(1.0 / far if made.perspective else -far)
                if key > band.key[place + start + j]:
                    band.key[place + start + j], band.ids[place + start + j] = key, EXACT + 1 + instance


@kernel
def sky_behind(tables, frame, x0, y0, width, rgba):
    """Put what the camera sees where nothing is behind the pixels of `rgba`, rows of `width` pixels, the first of which is (x0, y0)."""
    for y in range(len(rgba) // (4 * width)):
        for start in range(0, width, across.WIDTH):
            k = lanes.minimum(across.numbered(start), width - 1)
            clear = 1.0 - lanes.to_float(rgba[4 * (y * width + k) + 3])
            if not lanes.any_lane(clear > 0.0):
                continue
            ray = camera.ray(tables, frame.picture, lanes.to_float(k + x0) + 0.5, lanes.to_float(k * 0 + y0 + y) + 0.5)
            color = integrate.camera_background(tables, frame.options, ray.direction)
            for j in range(min(width - start, across.WIDTH)):
                for c in range(3):
                    rgba[4 * (y * width + start + j) + c] += across.lane(clear, j) * across.lane(color[c], j)
