"""Kernels that draw the samples of a tile for the `ray` backend: camera rays, first hits, and Whitted's light along them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import camera
from ..accel import intersect
from ..accel.formula_packets import hits
from ..accel.formula_packets.hits import (
    COLUMNS,
    PACKET,
    REST,
    ROUNDS,
    SAMPLES,
    closer_hit,
    first_samples,
    is_used,
    load_pixels,
    load_slots,
    slot_of,
)
from ..integrator import ray_stack, whitted
from ..jit.kernel import helper, kernel, noinline_helper
from ..lanes import crosslane, ops, ray_soa
from ..sampling import sobol
from ..simd.registration import overload
from ..types import Film, Hit, Lane, Options, Ray, Tile

CAMERA = int(ir.Visibility.CAMERA)


class Workspace(NamedTuple):
    """Memory of one thread: a vector of samples, their light, and the ray stack."""

    items: NDArray[np.int64]  # (3, lanes) x, y and number of each sample
    light: NDArray[np.float64]  # (5, lanes) red, green, blue, coverage, and 1 if finite
    stack: NDArray[np.float64]
    primed: Any = hits.Nothing()  # or a hits.TileHits

    @classmethod
    def allocate(cls, options: Options) -> Workspace:
        """A workspace of zeros."""
        width = crosslane.WIDTH
        return cls(np.zeros((3, width), np.int64), np.zeros((5, width)), ray_stack.stack_for(options, width))


@kernel
def draw_tile(tables, accel, vertex_light, frame, tile, first, count, total, film, workspace):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film.

    A pixel's samples fill whole vectors; those left over share vectors with other pixels'.
    """
    if draw_primed(workspace.primed, tables, accel, vertex_light, frame, film, workspace):
        return
    waiting = 0
    for y in range(tile.y0, tile.y1):
        for x in range(tile.x0, tile.x1):
            row, column = y - tile.y0, x - tile.x0
            s, end = first[row, column], first[row, column] + count[row, column]
            if end - s >= crosslane.WIDTH:
                lanes = crosslane.lane_indices(s)
                column_x, row_y = ops.int_like(lanes, x), ops.int_like(lanes, y)
                red, green, blue = ops.like3(lanes, 0.0, 0.0, 0.0)
                cover = red
                bad = 0
                while end - s >= crosslane.WIDTH:
                    number = crosslane.lane_indices(s)
                    color, alpha, sound = shade_samples(tables, accel, vertex_light, frame, total, column_x, row_y, number, workspace)
                    red, green, blue, cover = red + color[0], green + color[1], blue + color[2], cover + alpha
                    bad += crosslane.WIDTH - crosslane.count(sound)
                    s += crosslane.WIDTH
                film.color[row, column, 0] += crosslane.total(red)
                film.color[row, column, 1] += crosslane.total(green)
                film.color[row, column, 2] += crosslane.total(blue)
                film.alpha[row, column] += crosslane.total(cover)
                film.issues[row, column] += bad
            while s < end:
                workspace.items[0, waiting], workspace.items[1, waiting], workspace.items[2, waiting] = x, y, s
                waiting += 1
                s += 1
                if waiting == crosslane.WIDTH:
                    shade_queue(tables, accel, vertex_light, frame, total, workspace)
                    _add_queue(tile, film, workspace, waiting)
                    waiting = 0
    if waiting > 0:  # the other lanes hold earlier samples, or (0, 0)
        shade_queue(tables, accel, vertex_light, frame, total, workspace)
        _add_queue(tile, film, workspace, waiting)


def draw_primed(primed: Any, tables: Any, accel: Any, vertex_light: Any, frame: Any, film: Film, workspace: Any) -> bool:
    """Draw a tile whose pixels have one sample each with known implicit-surface hits, in packet order; False for other tiles."""
    raise NotImplementedError("in kernels only")


@overload(draw_primed)
def _draw_primed(primed, tables, accel, vertex_light, frame, film, workspace):
    if not is_used(primed):
        return lambda primed, tables, accel, vertex_light, frame, film, workspace: False

    def drawn(primed, tables, accel, vertex_light, frame, film, workspace):
        if primed.extent[ROUNDS] != 1:
            return False
        n = primed.extent[SAMPLES]
        for start in range(0, n, crosslane.WIDTH):
            if primed.black and not ops.any_lane(load_slots(primed.t, start) < np.inf):
                continue
            if shade_primed(tables, accel, vertex_light, frame, start, workspace):
                many, place = packet_place(n, start)
                for k in range(min(crosslane.WIDTH, n - start)):
                    _add_sample(film, workspace, k, primed.items[place + many + k], primed.items[place + k])
        return True

    return drawn


@helper
def packet_place(samples: int, start: int) -> tuple[int, int]:
    """(samples of the packet that holds sample `start` of so many, place of its column in TileHits.items)."""
    packet = start // PACKET
    return min(samples - packet * PACKET, PACKET), 3 * packet * PACKET + start % PACKET


@noinline_helper
def shade_primed(tables, accel, vertex_light, frame, start, workspace):
    """Write the light of samples with known rays and implicit-surface hits, from number `start` on, to the workspace.

    Returns whether any of it is not black.
    """
    view, options, hits = frame.picture, frame.options, workspace.primed
    many, place = packet_place(hits.extent[SAMPLES], start)
    offset = start % PACKET
    x, y, _ = load_pixels(hits.items[place - offset : place - offset + 3 * many], offset)
    s = first_samples(hits.corner, hits.first, hits.extent[COLUMNS], x, y)
    pixel, s = sobol.zorder_index(x + hits.corner[0], y + hits.corner[1], s, view.width, frame.order)
    origin, direction, t_min, t_max = ray_soa.get(hits.rays[start // PACKET], offset)
    ray = Ray(origin, direction, t_min, t_max, sobol.sample_time(pixel, s, options.seed, frame.shutter))
    hit, hidden = merge_first_hits(accel, tables, ray, hits, start)
    return _store_light(workspace, whitted.linked_radiance(frame, tables, accel, vertex_light, ray, hit, pixel, s, workspace.stack, hidden))


@helper
def _store_light(workspace: Any, light: Any) -> bool:
    """Write samples' light to the workspace; returns whether adding it changes the film."""
    color, alpha, sound = light
    for k in range(3):
        crosslane.store(workspace.light, k, color[k])
    crosslane.store(workspace.light, 3, alpha)
    crosslane.store(workspace.light, 4, ops.where(sound, 1.0, 0.0))
    dark = (color[0] == 0.0) & (color[1] == 0.0) & (color[2] == 0.0) & (alpha == 0.0) & sound
    return ops.any_lane(ops.not_(dark))


@noinline_helper
def shade_queue(tables, accel, vertex_light, frame, total, workspace):
    """Shade the workspace's samples and write their light there."""
    x, y, s = crosslane.load(workspace.items, 0), crosslane.load(workspace.items, 1), crosslane.load(workspace.items, 2)
    _store_light(workspace, shade_samples(tables, accel, vertex_light, frame, total, x, y, s, workspace))


@helper
def _add_queue(tile: Tile, film: Film, workspace: Any, count: int) -> None:
    """Add the light of the workspace's first `count` samples to the film, in their order."""
    for k in range(count):
        _add_sample(film, workspace, k, workspace.items[1, k] - tile.y0, workspace.items[0, k] - tile.x0)


@helper
def _add_sample(film: Film, workspace: Any, k: int, row: int, column: int) -> None:
    """Add the light of the workspace's sample k to a pixel."""
    film.color[row, column, 0] += workspace.light[0, k]
    film.color[row, column, 1] += workspace.light[1, k]
    film.color[row, column, 2] += workspace.light[2, k]
    film.alpha[row, column] += workspace.light[3, k]
    if not workspace.light[4, k] > 0.5:  # rare: otherwise the array stays out of the cache
        film.issues[row, column] += 1


def find_first_hits(primed: Any, accel: Any, tables: Any, ray: Ray, x: Lane, y: Lane, s: Lane) -> tuple[Hit, Any]:
    """The first hits of the rays of samples s of pixels (x, y), and what is known of lights' shadows there, or None."""
    raise NotImplementedError("in kernels only")


@overload(find_first_hits)
def _find_first_hits(primed, accel, tables, ray, x, y, s):
    if not is_used(primed):
        return lambda primed, accel, tables, ray, x, y, s: (intersect.closest_hit(accel, tables, ray, ops.bool_like(x, True), CAMERA), None)

    def merged(primed, accel, tables, ray, x, y, s):
        near, far = ops.full_like(ray.direction[0], ray.t_min), ops.full_like(ray.direction[0], ray.t_max)
        origin = ops.add(ray.origin, ops.like3(near, 0.0, 0.0, 0.0))
        return merge_first_hits(accel, tables, Ray(origin, ray.direction, near, far, ray.time), primed, slot_of(primed, x, y, s))

    return merged


@noinline_helper
def merge_first_hits(accel, tables, ray, hits, slot):
    """The nearer of known implicit-surface hits, in these slots, and BVH hits."""
    zero, none = ops.full_like(ray.t_min, 0.0), ops.int_like(ray.t_min, -1)
    hit = Hit(zero + np.inf, none, none, zero, zero)
    if accel.rest_bits & REST != 0:
        hit = intersect.closest_hit(accel, tables, ray, ops.bool_like(ray.t_min, True), REST)
    return closer_hit(hits, slot, hit)


@noinline_helper
def shade_samples(tables, accel, vertex_light, frame, total, x, y, s, workspace):
    """(radiance, coverage, sound) of samples s of pixels x, y."""
    view, options = frame.picture, frame.options
    column, row, number = x, y, s
    pixel, s = sobol.zorder_index(x, y, s, view.width, frame.order)
    dx, dy = sobol.offset(pixel, s, total, options.seed, frame.filter)
    time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
    x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
    ray = camera.generate_ray(tables, view, frame.lens, x, y, pixel, s, options.seed, time)
    hit, hidden = find_first_hits(workspace.primed, accel, tables, ray, column, row, number)
    return whitted.linked_radiance(frame, tables, accel, vertex_light, ray, hit, pixel, s, workspace.stack, hidden)
