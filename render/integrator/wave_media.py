"""Stages of the wavefront path tracer for participating media: light that media emit, and shadow rays through them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper, specialize_either, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, compress_store, compress_store3, load3, scatter_add, store3
from ..material import medium_stack
from ..medium import emitting_cells, free_flight, tracking
from ..sampling import sobol
from ..types import Lane, Tables, Vec
from . import path_reuse
from .state import flights
from .wave_intersection import intersect_stage, load_hits, surface_at
from .wave_memory import STATE, load_body, store_body

COLLECTING = 4096  # depths from which the rays that collect light have random numbers


@helper
def _add_light(memory: Any, i: int, lit: Lane, waits: Lane) -> None:
    if ops.any_lane(lit):
        scatter_add(memory.light, ops.where(lit, simd.load(memory.shadow_slot, i), 0), load3(memory.shadow, 0, 7, i), lit)


@helper
def _keep_light(table: Any, memory: Any, i: int, lit: Lane, waits: Lane) -> None:
    light = load3(memory.shadow, 0, 7, i)
    zero = 0.0 * light[0]
    store3(memory.shadow, 0, 7, i, ops.where3(lit | waits, light, (zero, zero, zero)))


@helper
def _add_share(memory: Any, k: Lane, slot: Lane, share: Lane, valid: Lane) -> None:
    lit = (share > 0.0) & valid
    if ops.any_lane(lit):
        for c in range(3):
            element = slot + c * ROW
            light = memory.shadow[k + (7 + c) * ROW] * share
            simd.scatter(memory.light, element, memory.light[element] + light, lit)


@helper
def _keep_share(table: Any, memory: Any, k: Lane, slot: Lane, share: Lane, valid: Lane) -> None:
    for c in range(3):
        element = k + (7 + c) * ROW
        simd.scatter(memory.shadow, element, memory.shadow[element] * share, valid)


deliver = specialize_either(_keep_light, _add_light)
"""(scattering media, memory, i, lit, waits): add the light of unblocked shadow rays i … to their paths; with media keep it for
`transmit_stage`. Rays that wait are searched in the BVH."""
deliver_share = specialize_either(_keep_share, _add_share)
"""(scattering media, memory, rays, slots, share, valid): likewise for shadow rays through the BVH, of which a share passes."""


@helper
def _glow(flown: flights.Flown, default: Any, memory: Any, slot: Lane, active: Lane, depth: int) -> Any:
    bright = active & (ops.largest(flown.emitted) > 0.0)
    if ops.any_lane(bright):
        path_reuse.add_light(memory.shared, memory.light, slot, flown.emitted, bright, depth)
    return default


add_glow = specialize_if_present(_glow)  # (flown, None, memory, slots, active, depth): add the light that media on the way emit


@helper
def _transmit(table: Any, default: Any, accel: Any, scene: Any, frame: Any, memory: Any, source: int, n: int, depth: int) -> Any:
    if n > 0:
        _pass_media(accel, scene, frame, memory, source, n, depth)
    return default


transmit_stage = specialize_if_present(_transmit)
"""(scattering media, None, accel, scene, frame, memory, source, n, depth): add the light of n shadow rays that passes media.

Uses the rows of `source`, whose rays have been shaded."""


@noinline_helper
def _pass_media(accel, scene, frame, memory, source, n, depth):
    table = medium_stack.scattering(scene.tables)
    collecting = emitting_cells.exist(scene.light.emitters.media, False)
    count = _queue_rays(scene.tables, frame, memory, source, n)
    segment = 0
    while count > 0:
        if table.walled[0] or collecting:
            intersect_stage(accel, scene, frame, memory, source, count, COLLECTING + depth if collecting else 1)
        count = _pass_segment(table, scene, frame, memory, source, count, tracking.depth_of_segment(depth, segment))
        segment += 1


@helper
def _queue_rays(tables: Any, frame: Any, memory: Any, source: int, n: int) -> int:
    """Write the unblocked shadow rays to the rows of paths; return their number."""
    base, queued = source * STATE * ROW, 0
    like = simd.load(memory.state, 0)
    for i in range(0, n, crosslane.width(like)):
        light, distance = load3(memory.shadow, 0, 7, i), simd.load(memory.shadow, 6 * ROW + i)
        unblocked = simd.first_lanes(n - i, like) & (ops.largest(light) > 0.0)
        slot = ops.where(unblocked, simd.load(memory.shadow_slot, i), 0)
        x, y, s = memory.items[slot + 4 * ROW], memory.items[slot + 5 * ROW], memory.items[slot + 2 * ROW]
        pixel, sample = sobol.zorder_index(x, y, s, frame.picture.width, frame.order)
        zero = 0.0 * light[0]
        compress_store3(memory.state, base + queued, load3(memory.shadow, 0, 0, i), unblocked)
        compress_store3(memory.state, base + 3 * ROW + queued, load3(memory.shadow, 0, 3, i), unblocked)
        compress_store3(memory.state, base + 6 * ROW + queued, light, unblocked)
        compress_store(memory.state, base + 9 * ROW + queued, ops.absolute(distance), unblocked)
        compress_store3(memory.index, source * 3 * ROW + queued, (slot, pixel, sample), unblocked)
        compress_store(memory.inside, source * ROW + queued, simd.load(memory.shadow_inside, i), unblocked)
        compress_store(memory.near, source * ROW + queued, zero, unblocked)
        body = load_body(medium_stack.initial_body(tables, zero), None, memory.shadow_body, i, 1)
        store_body(body, None, memory.body, source * 4 * ROW + queued, unblocked)
        queued += simd.count(unblocked)
    return queued


@helper
def _is_collecting(media: Any, default: Lane, distance: Lane) -> Lane:
    return emitting_cells.collected(distance) > 0


@helper
def _add_collected(media: Any, default: Vec, table: Any, tables: Tables, memory: Any, rays: Any, ray: Any, key: tracking.Key) -> Vec:
    """Add the light of one medium on a segment of rays that collect it; return the share of light that passes, `default` for others."""
    number, distance, light, slot = rays
    collected_number = emitting_cells.collected(distance)
    collects = collected_number > 0
    if ops.not_(ops.any_lane(collects & (number > 0))):
        return default
    passed, emitted = pass_and_collect(table, tables, ops.where(collects, number, 0), ray, key)
    lit = collects & (number == collected_number) & (ops.largest(emitted) > 0.0)
    if ops.any_lane(lit):
        scatter_add(memory.light, ops.where(lit, slot, 0), ops.mul(light, emitted), lit)
    return ops.where3(collects, passed, default)


@helper
def pass_and_collect(table: Any, tables: Tables, number: Lane, ray: Any, key: tracking.Key) -> tuple[Vec, Vec]:
    """(share of light that passes a segment of a ray, radiance that its medium adds); nothing scatters."""
    origin, direction, near, far = ray
    zero = 0.0 * near
    black, white = (zero, zero, zero), (zero + 1.0, zero + 1.0, zero + 1.0)
    none = tracking.Flight(ops.bool_like(zero, False), far, white, black)
    flight = free_flight.fly(table, none, tables, number, origin, direction, near, far, black, key)
    return flight.factor, flight.emitted


collecting = specialize_if_present(_is_collecting)  # (emitting cells, no lane, distance): whether rays collect the light of a medium
_collect = specialize_if_present(_add_collected)


@helper
def _pass_segment(table: Any, scene: Any, frame: Any, memory: Any, source: int, n: int, key: int) -> int:
    """Take n rays to their next boundary, or to their end, where they add their light; return the number of those that go on."""
    tables, base, going_count = scene.tables, source * STATE * ROW, 0
    media = scene.light.emitters.media
    intersects = table.walled[0] or emitting_cells.exist(media, False)
    like = simd.load(memory.state, 0)
    for i in range(0, n, crosslane.width(like)):
        active = simd.first_lanes(n - i, like)
        origin, direction, light = load3(memory.state, base, 0, i), load3(memory.state, base, 3, i), load3(memory.state, base, 6, i)
        distance, near = simd.load(memory.state, base + 9 * ROW + i), simd.load(memory.near, source * ROW + i)
        slot, pixel, sample = load3(memory.index, source * 3 * ROW, 0, i)
        inside = simd.load(memory.inside, source * ROW + i)
        body = load_body(medium_stack.initial_body(tables, near), None, memory.body, source * 4 * ROW + i, 1)
        hit, piece, hits = load_hits(memory, i, active)
        hits = hits & ops.bool_like(like, intersects)
        t = ops.where(hits, hit.t, np.inf)
        hits = hits & (t < distance)
        far = ops.maximum(ops.minimum(t, distance), near)
        number = ops.where(active, medium_stack.top(inside), 0)
        white = (0.0 * like + 1.0, 0.0 * like + 1.0, 0.0 * like + 1.0)
        collects = collecting(media, ops.bool_like(like, False), distance)
        time = sobol.sample_time(pixel, sample, frame.options.seed, frame.shutter)
        if ops.any_lane(number > 0):
            of_ray = tracking.Key(pixel, sample, key, frame.options.seed, 1, body, time, None)
            ray = origin, direction, near, far
            passed = free_flight.transmit(table, white, tables, ops.where(collects, 0, number), origin, direction, near, far, of_ray)
            passed = _collect(media, passed, table, tables, memory, (number, distance, light, slot), ray, of_ray)
            light = ops.where3(number > 0, ops.mul(light, passed), light)
        ends = active & ops.not_(hits | collects)
        if ops.any_lane(ends):
            scatter_add(memory.light, ops.where(ends, slot, 0), light, ends)
        going = hits & (ops.largest(light) > 0.0)
        if ops.not_(ops.any_lane(going)):
            continue
        point, hit = surface_at(tables, scene.primitives.records, origin, direction, hit, piece, hits, time)
        inside = medium_stack.cross_boundary(inside, None, tables, point, direction)
        going = going & ops.not_(collects & ops.not_(table.clear[point.material]))
        compress_store3(memory.state, base + going_count, origin, going)
        compress_store3(memory.state, base + 3 * ROW + going_count, direction, going)
        compress_store3(memory.state, base + 6 * ROW + going_count, light, going)
        compress_store(memory.state, base + 9 * ROW + going_count, distance, going)
        compress_store3(memory.index, source * 3 * ROW + going_count, (slot, pixel, sample), going)
        compress_store(memory.inside, source * ROW + going_count, inside, going)
        store_body(body, None, memory.body, source * 4 * ROW + going_count, going)
        compress_store(memory.near, source * ROW + going_count, flights.behind(point, direction, t), going)
        going_count += simd.count(going)
    return going_count
