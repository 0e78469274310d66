"""The items of a band lit by the integrator of all backends, with shadow rays: for whatever a scene may hold.

Where a triangle stands for a shape, the item is put where its ray meets the shape itself.
"""

from __future__ import annotations

import numpy as np

from . import across, camera, deferred, fill, integrate, lanes
from .hits import along_axis, hits_of, meet
from .kernels import apart, kernel
from .meshlets import SHIFT, place_of

ENDLESS = (1 << 30) - 1  # ids above 1 << 30: instances without triangles


@kernel
def shade_band(made, pattern, each, meshlets, drawn, tables, accel, gouraud, frame, splat, band, items, stack, crop, rgba):
    """Light what a band shows and add it to the picture, (h, w, 4), of the pixels of `crop`."""
    items.counts[3] = 0
    for row in range(band.place[3] >> 2):
        deferred.collect(pattern, each, None, band, row, items)
        for k in range(0, items.counts[0], 16):
            light_items(made, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, 16)
            deferred.keep_items(pattern, splat, band, items, k, 16, crop, rgba)
        for k in range(items.half, items.half + items.counts[1], 16):
            count = min(items.half + items.counts[1] - k, 16)
            light_items(made, meshlets, drawn, tables, accel, gouraud, frame, items, stack, k, count)
            deferred.keep_items(pattern, splat, band, items, k, count, crop, rgba)


@apart
def light_items(made, meshlets, drawn, tables, accel, gouraud, frame, items, stack, start, count):
    """The light of `count` items from `start` on, as r, g, b, coverage into items.light."""
    view = frame.picture
    for first in range(0, count, across.WIDTH):
        k = start + lanes.minimum(across.numbered(first), count - 1)
        ids = lanes.to_int(items.ids[k])
        x, y = lanes.to_float(items.at_x[k]), lanes.to_float(items.at_y[k])
        endless = ids > ENDLESS
        row = lanes.where(endless, 0, ids >> SHIFT)
        slot = lanes.to_int(drawn.first[row]) + (ids & ((1 << SHIFT) - 1))
        instance = lanes.where(endless, ids & ENDLESS, lanes.to_int(drawn.instance[row]))
        triangle = lanes.where(endless, -1, lanes.to_int(meshlets.corner[lanes.where(endless, 0, slot), 3]))
        ray = camera.ray(tables, view, x / fill.ONE, y / fill.ONE)
        hit = hits_of(made, tables, accel, view, ray, x, y, instance, triangle)
        pixel = lanes.to_int(items.y[k]) * view.width + lanes.to_int(items.x[k])
        sample = lanes.to_int(items.samples[k])  # its bits: one number for each item of a pixel
        color, alpha, sound = integrate.call(  # pyright: ignore[reportCallIssue]
            frame.radiance,
            (
                tables, accel, gouraud, frame.options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive,
                hit.u, hit.v, pixel, sample, stack,
            ),
        )  # fmt: skip
        for j in range(min(count - first, across.WIDTH)):
            place = place_of(first + j)
            for c in range(3):
                items.light[place, c] = across.lane(color[c], j)
            items.light[place, 3] = across.lane(alpha, j)
            items.counts[3] += 0 if across.lane(sound, j) else 1


@kernel
def draw_endless(made, endless, tables, accel, view, pattern, band):
    """Draw quadrics without a box into the visibility buffer: at every sample where its ray meets one of them."""
    samples, columns = len(pattern.x), band.place[2] >> 2
    for start in range(0, len(band.ids), across.WIDTH):
        place = lanes.minimum(across.numbered(start), len(band.ids) - 1)
        lane, rest = place & 15, place >> 4
        s, block = rest % samples, rest // samples
        px = (band.place[0] + 4 * (block % columns) + (lane & 3)) * fill.ONE + lanes.to_int(pattern.x[s])
        py = (band.place[1] + 4 * (block // columns) + (lane >> 2)) * fill.ONE + lanes.to_int(pattern.y[s])
        ray = camera.ray(tables, view, lanes.to_float(px) / fill.ONE, lanes.to_float(py) / fill.ONE)
        for instance in endless:
            met = meet(accel, instance, ray, lanes.bool_like(ray.t_max, True))
            depth = met.t * along_axis(tables, view, ray)
            for j in range(min(len(band.ids) - start, across.WIDTH)):
                if across.lane(met.instance, j) >= 0:
                    far = across.lane(depth, j)
                    key = np.float32(1.0 / far if made.perspective else -far)
                    if key > band.key[start + j]:
                        band.key[start + j], band.ids[start + j] = key, ENDLESS + 1 + instance


@kernel
def sky_behind(tables, frame, x0, y0, rgba):
    """Put what the camera sees where nothing is behind the pixels of `rgba`, the first of which is (x0, y0)."""
    height, width = rgba.shape[0], rgba.shape[1]
    for y in range(height):
        for start in range(0, width, across.WIDTH):
            k = lanes.minimum(across.numbered(start), width - 1)
            clear = 1.0 - lanes.to_float(rgba[y, :, 3][k])
            if not lanes.any_lane(clear > 0.0):
                continue
            ray = camera.ray(tables, frame.picture, lanes.to_float(k + x0) + 0.5, lanes.to_float(k * 0 + y0 + y) + 0.5)
            color = integrate.camera_background(tables, frame.options, ray.direction)
            for j in range(min(width - start, across.WIDTH)):
                for c in range(3):
                    rgba[y, start + j, c] += across.lane(clear, j) * across.lane(color[c], j)
