"""Intersection stage of the wavefront path tracer: closest hits of a wave's rays, and the surfaces at them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler import ir
from .. import simd
from ..accel import intersect, primitive_hits
from ..accel.traverse import motion_alpha
from ..jit.kernel import helper, noinline_helper, separate_helper, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, gather3, load3
from ..material import medium_stack
from ..sampling import sobol
from ..simd.registration import overload
from ..surface import interaction, triangle_records
from ..types import Hit, Lane, Ray, Surface, Vec
from .ray_queue import as_searched, enters, for_search, from_search, pad, queue_up
from .state.path_state import OTHER_RAY, PathSample, alpha_number
from .wave_memory import STATE, load_near

CAMERA = int(ir.Visibility.CAMERA)
_WIDTH64 = simd.WIDTH64


@helper
def _gather_near(table: Any, default: Lane, memory: Any, element: Lane) -> Lane:
    return memory.near[element]


gather_near = specialize_if_present(_gather_near)


@noinline_helper
def intersect_stage(accel, scene, frame, memory, source, n, depth):
    """Find the closest hits of n rays: in the primitive list, then in the BVH those nearer than that."""
    base, seed = source * STATE * ROW, frame.options.seed
    like = simd.load(memory.state, 0)
    step = crosslane.width(like)
    queued = 0
    for i in range(0, n, step):
        origin, direction = load3(memory.state, base, 0, i), load3(memory.state, base, 3, i)
        near, far = 0.0 * like, 0.0 * like + np.inf
        if depth == 0:
            near, far = simd.load(memory.near, i), simd.load(memory.hit, i)
        near = load_near(medium_stack.scattering(scene.tables), near, memory, source * ROW + i)
        t, piece, a, b = primitive_hits.closest(scene.primitives.seen, origin, direction, near, far)
        simd.store(memory.hit, i, t)
        simd.store(memory.hit, ROW + i, a)
        simd.store(memory.hit, 2 * ROW + i, b)
        simd.store(memory.hit_ids, i, piece)
        simd.store(memory.hit_ids, ROW + i, ops.int_like(t, -1))
        if scene.trees:
            inside = simd.first_lanes(n - i, like) & enters(scene, origin, direction, t)
            queued += queue_up(memory, queued, i, inside)
    pad(memory, queued)
    wide = simd.load(memory.queue, 0)
    for j in range(0, queued, _WIDTH64):
        k = simd.load(memory.queue, j)
        origin, direction = gather3(memory.state, base, 0, k), gather3(memory.state, base, 3, k)
        near = 0.0 * origin[0]
        if depth == 0:
            near = memory.near[k]
        near = gather_near(medium_stack.scattering(scene.tables), near, memory, k + source * ROW)
        visible = CAMERA if depth == 0 else OTHER_RAY
        pixel, sample = memory.index[k + (source * 3 + 1) * ROW], memory.index[k + (source * 3 + 2) * ROW]
        time = sobol.sample_time(pixel, sample, seed, frame.shutter)
        ray = as_searched(origin, direction, near, memory.hit[k], time)
        hit = closest_visible(accel, ray, np.int64(visible), PathSample(for_search(pixel), for_search(sample), depth, seed))
        nearer = from_search(hit.instance, wide) >= 0
        simd.scatter(memory.hit, k, from_search(hit.t, near), nearer)
        simd.scatter(memory.hit, k + ROW, from_search(hit.u, near), nearer)
        simd.scatter(memory.hit, k + 2 * ROW, from_search(hit.v, near), nearer)
        instance, primitive = from_search(hit.instance, wide), from_search(hit.primitive, wide)
        simd.scatter(memory.hit_ids, k, row_of(scene, instance, primitive), nearer)
        simd.scatter(memory.hit_ids, k + ROW, instance, nearer)
        simd.scatter(memory.hit_ids, k + 2 * ROW, primitive, nearer)


@helper
def row_of(scene: Any, instance: Lane, primitive: Lane) -> Lane:
    """The row of triangle_records.Records of a hit in the BVH, or -1; the primitive of an implicit surface numbers its root."""
    first = scene.primitives.records.first[ops.maximum(instance, 0)]
    return ops.where(first == triangle_records.NONE, -1, first + primitive)


def closest_visible(accel: Any, ray: Ray, visible: Any, index: PathSample) -> Hit:
    """Return the closest hits in the BVH; rays pass partly transparent surfaces by chance."""
    raise NotImplementedError


@overload(closest_visible)
def _closest_in_kernels(accel, ray, visible, index):
    """Not compiled in scenes without a BVH."""
    if accel.field("search") is None:

        def no_bvh(accel, ray, visible, index):
            zero = 0.0 * ray.t_min
            none = ops.int_like(zero, -1)
            return Hit(zero, none, none, zero, zero)

        return no_bvh

    def closest(accel, ray, visible, index):
        return intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, False)

    def closest_by_chance(accel, ray, visible, index):
        hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, False)
        if motion_alpha.has_no_instances(accel):
            return hit
        passed, layer = ops.bool_like(ray.t_min, True), 0
        while True:
            opacity, onward = motion_alpha.alpha_at_hit(accel, ray, hit)
            passed = passed & (alpha_number(index, layer) >= opacity)
            if ops.not_(ops.any_lane(passed)):
                return hit
            ray = Ray(ray.origin, ray.direction, ops.where(passed, onward, ray.t_min), ray.t_max, ray.time)
            again = intersect.find(accel, ray, passed, visible, False)
            hit = Hit(
                ops.where(passed, again.t, hit.t), ops.where(passed, again.instance, hit.instance),
                ops.where(passed, again.primitive, hit.primitive), ops.where(passed, again.u, hit.u),
                ops.where(passed, again.v, hit.v),
            )  # fmt: skip
            layer += 1

    return closest_by_chance if motion_alpha.has_opacity(accel) else closest


@helper
def load_hits(memory: Any, i: int, active: Lane) -> tuple[Hit, Lane, Lane]:
    """(hits of rays i …, their rows in the primitive list or -1, whether they hit anything)."""
    piece, instance = simd.load(memory.hit_ids, i), simd.load(memory.hit_ids, ROW + i)
    t, u, v = load3(memory.hit, 0, 0, i)
    return Hit(t, instance, simd.load(memory.hit_ids, 2 * ROW + i), u, v), piece, active & ((piece >= 0) | (instance >= 0))


@separate_helper
def _full_interaction(tables, ray, hit):
    return interaction.make_interaction(tables, ray, hit)


@helper
def surface_at(
    tables: Any, records: Any, origin: Vec, direction: Vec, hit: Hit, piece: Lane, lanes: Lane, time: Any
) -> tuple[Surface, Hit]:  # fmt: skip
    """(surface, hit) of rays; hits in the primitive list get their instance and primitive here.

    `piece` is a hit's row in the primitive list or -1, `records` are triangle_records.Records.
    """
    row = ops.maximum(piece, 0)
    of_piece = lanes & (piece >= 0)
    x, y, z, inverse, of_instance, of_primitive, of_material, is_plain = simd.gather_rows(records.rows, row * 8, 8)
    instance = ops.where(of_piece, ops.to_int(of_instance), ops.where(lanes, hit.instance, -1))
    hit = Hit(hit.t, instance, ops.where(of_piece, ops.to_int(of_primitive), hit.primitive), hit.u, hit.v)
    by_record = of_piece & (is_plain > 0.5)
    t = ops.where(of_piece, hit.t, 0.0)
    position = ops.along(origin, direction, t)
    outward = (x, y, z)
    if ops.any_lane(inverse > 0.0):
        curved = ops.scale(ops.sub(position, outward), inverse)
        # Normalized, or each surface doubles the error of the one before, and after four of them rays leave a sphere from inside.
        curved = ops.scale(curved, 1.5 - 0.5 * ops.dot(curved, curved))
        outward = ops.where3(inverse > 0.0, curved, outward)
    front = ops.dot(direction, outward) < 0.0
    zero = ops.full_like(t, 0.0)
    side = ops.where(front, zero + 1.0, zero - 1.0)
    facing = ops.scale(outward, side)
    rounded = by_record & (is_plain > triangle_records.PLAIN)
    shaded, lift = triangle_records.interpolate_normal(records.rounded, outward, row, rounded, hit.u, hit.v, side)
    shaded = ops.scale(shaded, side)
    size = abs(outward[0]) * (abs(origin[0]) + abs(position[0])) + abs(outward[1]) * (abs(origin[1]) + abs(position[1]))
    size = size + abs(outward[2]) * (abs(origin[2]) + abs(position[2])) + ops.maximum(-inverse, 0.0)
    white = (zero + 1.0, zero + 1.0, zero + 1.0)
    point = Surface(
        position, position, facing, shaded, outward, (zero, zero), (zero + 1.0, zero + 1.0), front, ops.maximum(instance, 0),
        ops.to_int(of_material), white, size * (interaction.ROUNDING * ops.roundoff(zero)), time, None, lift, None, None,
    )  # fmt: skip
    others = lanes & ops.not_(by_record)
    if ops.any_lane(others):
        ray = Ray(origin, direction, zero, zero + np.inf, time)
        full = _full_interaction(tables, ray, Hit(hit.t, ops.where(others, instance, -1), hit.primitive, hit.u, hit.v))
        point = Surface(
            ops.where3(others, full.position, position), full.local, ops.where3(others, full.geometric, facing),
            ops.where3(others, full.normal, shaded), full.local_normal, full.uv, full.metric, ops.where(others, full.front, front),
            point.instance, ops.where(others, full.material, point.material), ops.where3(others, full.color, white),
            ops.where(others, full.offset, point.offset), time, None, ops.where3(others, full.lift, lift), None, None,
        )  # fmt: skip
    return point, hit
