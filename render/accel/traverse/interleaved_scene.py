"""Rays through the tree over instances, each for itself and in turns: what they meet there, however far apart they go."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....compiler import ir
from ... import simd
from ...jit.kernel import helper, noinline_helper
from ...jit.packed_struct import skip_when_tagged
from ...lanes import affine, crosslane, ops, row_gather
from ...types import Hit, Lane, Vec
from ..build.scene_layout import NO_MESHES, PLACED, REACH
from . import ray_box, shape_hit, single_ray

MESH = int(ir.GeometryKind.MESH)
_LANES = crosslane.WIDTH
_ROWS = 10 * _LANES
_D, _T_MIN, _UNTIL, _ENTERS, _PACE = 3, 6, 7, 8, 9  # rows of what is kept, after origins
_CUBE = (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)  # what a tree holds
ENOUGH = (5 * _LANES + 7) // 8  # rays that wait at instances until they are brought into their frames


@helper
def trace_incoherent(
    accel: Any, ray: ray_box.BoxRay, o: Vec, d: Vec, origin: Vec, direction: Vec, t_min: Lane, until: Lane, left: int,
    visible_bit: int, any_hit: bool, best: Hit,
) -> Hit:  # fmt: skip
    """`best`, or what the rays whose bits are set in `left` meet first in the tree where that comes first: a step of each in turn.

    In the tree's frame they are o + t d.
    """
    kept, upper = simd.stack_array(np.float64, _ROWS), single_ray.room()
    nearest = ops.minimum(until, best.t)
    enters = ray_box.enter(_CUBE, ray, t_min, nearest)
    enters, entered = ops.where(enters < np.inf, enters, 0.0), enters < np.inf
    entry, pace = ops.add(o, ops.scale(d, enters)), ops.largest((abs(d[0]), abs(d[1]), abs(d[2])))
    sound = (abs(entry[0]) + abs(entry[1]) + abs(entry[2]) < 4.0) & (pace > 0.0)  # not of rays that are no numbers or go nowhere
    left &= crosslane.bits(entered & sound)
    _store3(kept, 0, origin)
    _store3(kept, _D, direction)
    crosslane.store(kept, _T_MIN, t_min)
    crosslane.store(kept, _UNTIL, until)
    crosslane.store(kept, _ENTERS, enters)
    crosslane.store(kept, _PACE, pace)
    single_ray.keep_boxes(upper, entry, ops.scale(ray.inverse, pace), (nearest - enters) * pace)
    steps, inside = single_ray.allocate_state(), simd.stack_array(np.int64, _LANES)
    single_ray.set_out(steps, 0, best.t, best.instance, best.primitive, best.u, best.v)
    todo = left
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        simd.write(inside, k, -1)
        single_ray.go(steps, k, 0, k * single_ray.STACK)
    trace_interleaved(accel, kept, upper, single_ray.room(), steps, inside, left, visible_bit, any_hit)
    return single_ray.met(steps, 0)


@noinline_helper
def trace_interleaved(accel, kept, upper, rays, steps, inside, left, visible_bit, any_hit):
    """Let rays whose bits are set in `left` go on to their ends; `inside` tells the instances in whose meshes they are, or -1.

    Those that have come to an instance wait for others there, so that several are brought into its frame at a time.
    """
    wait = np.int64(0)
    while left != 0:
        todo = left & ~wait
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            instance = simd.read(inside, k)
            if instance >= 0:
                if _in_mesh(accel, rays, steps, k, instance, any_hit):
                    continue
                simd.write(inside, k, -1)
                more = _next(accel, kept, upper, steps, k, simd.read(steps.place, 2 * single_ray.RAYS + k), any_hit)
            else:
                more = _step(accel, upper, steps, k, any_hit)
            if not more:
                left &= ~(1 << k)
            elif simd.read(steps.place, k) < 0:
                wait |= 1 << k
        if wait != 0 and (wait == left or simd.population(wait) >= ENOUGH):
            left, wait = _attempt(accel, kept, upper, rays, steps, inside, left, wait, visible_bit, any_hit)


@helper
def _no_more(accel: Any, rays: single_ray.Rays, steps: single_ray.TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    return False


@skip_when_tagged(NO_MESHES, _no_more)
@helper
def _in_mesh(accel: Any, rays: single_ray.Rays, steps: single_ray.TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    """One step of ray k in a mesh; whether there is more of it."""
    return single_ray.traverse_step(accel.wide, rays, steps, k, instance, any_hit)


@helper
def _store3(table: Any, row: int, value: Vec) -> None:
    crosslane.store(table, row, value[0])
    crosslane.store(table, row + 1, value[1])
    crosslane.store(table, row + 2, value[2])


@helper
def _step(accel: Any, upper: single_ray.Rays, steps: single_ray.TraversalState, k: int, any_hit: bool) -> bool:
    """One node of ray k's way, or two; whether there is more of it."""
    node, top = simd.read(steps.place, k), simd.read(steps.place, single_ray.RAYS + k)
    ray, limit = single_ray.box(upper, k), single_ray.limit_of(upper, k)
    node, top = single_ray.pass_things(accel.top.nodes, accel.top.links, node, ray, limit, steps, top, any_hit)
    if node >= 0 and top >= k * single_ray.STACK:
        node, top = single_ray.pass_things(accel.top.nodes, accel.top.links, node, ray, limit, steps, top, any_hit)
    return _go(accel, steps, k, node, top)


@helper
def _next(accel: Any, kept: Any, upper: single_ray.Rays, steps: single_ray.TraversalState, k: int, top: int, any_hit: bool) -> bool:
    """Take the next node or instance from ray k's stack, which ends at `top`; whether there is one."""
    if any_hit:
        if simd.read(steps.numbers, k) >= 0:
            return False
    else:
        limit = np.float32(
            (min(simd.read(steps.found, k), _at(kept, _UNTIL, k)) - _at(kept, _ENTERS, k)) * _at(kept, _PACE, k) * single_ray.FAR
        )
        single_ray.set_limit(upper, k, limit)
        top = single_ray.sifted(steps.children, steps.reaches, k * single_ray.STACK, top, limit)
    node, top = single_ray.last_of(steps.children, top)
    return _go(accel, steps, k, node, top)


@helper
def _go(accel: Any, steps: single_ray.TraversalState, k: int, node: int, top: int) -> bool:
    """Let ray k be at a node or an instance, and ask for what will be read of an instance; not where its stack had ended."""
    if top < k * single_ray.STACK:
        return False
    instance = max(~node, 0)
    simd.prefetch(accel.placed, instance * PLACED)
    simd.prefetch(accel.inverse, instance * 16)
    simd.prefetch(accel.inverse, instance * 16 + 8)
    single_ray.go(steps, k, node, top)
    return True


@helper
def _no_entry(
    accel: Any, kept: Any, rays: single_ray.Rays, steps: single_ray.TraversalState, g: Lane, o: Vec, d: Vec, t_min: Lane, here: Lane
) -> Lane:
    return here & (t_min < -np.inf)


@skip_when_tagged(NO_MESHES, _no_entry)
@helper
def _enter_mesh(
    accel: Any, kept: Any, rays: single_ray.Rays, steps: single_ray.TraversalState, g: Lane, o: Vec, d: Vec, t_min: Lane, here: Lane
) -> Lane:
    """Make rays ready for meshes g, in whose frames they are: those that enter their boxes."""
    t_max = crosslane.load(kept, _UNTIL)
    until = ops.minimum(crosslane.load(steps.found, single_ray.vector(0, 0)), t_max)
    ray, box = ray_box.local_ray(o, d), row_gather.eight_at(accel.boxes, g, 0)
    enters = ray_box.enter(box, ray, t_min, until)
    go = here & (enters < np.inf)
    single_ray.keep(rays, 0, go, o, d, ray.inverse, enters, t_min, t_max, until, box[REACH])
    return go


@helper
def _attempt(
    accel: Any,
    kept: Any,
    upper: single_ray.Rays,
    rays: single_ray.Rays,
    steps: single_ray.TraversalState,
    inside: Any,
    left: int,
    wait: int,
    visible_bit: int,
    any_hit: bool,
) -> tuple[int, int]:
    """Let the rays whose bits are set in `wait` enter the meshes they have come to; (`left`, `wait`) then."""
    place = crosslane.load(steps.place, single_ray.vector(0, 0))
    here = crosslane.mask_of(wait, place)
    i = ops.where(here, ~place, 0)
    visible, _, g, kind, root, _, _, _ = row_gather.eight_at(accel.placed, i, 0)
    here = here & ((visible & visible_bit) != 0)
    meshes = kind == MESH
    (a, b, c, x, e, f, h, y), (p, q, r, z, u, v, w, _) = row_gather.eight_at(accel.inverse, i, 0), row_gather.eight_at(accel.inverse, i, 8)
    matrix, t_min = (a, b, c, x, e, f, h, y, p, q, r, z), crosslane.load(kept, _T_MIN)
    o = affine.transform_point12(matrix, (crosslane.load(kept, 0), crosslane.load(kept, 1), crosslane.load(kept, 2)))
    d = affine.transform_vector12(matrix, (crosslane.load(kept, _D), crosslane.load(kept, _D + 1), crosslane.load(kept, _D + 2)))
    go = _enter_mesh(accel, kept, rays, steps, g, ops.sub(o, (u, v, w)), d, t_min, here & meshes)
    crosslane.write_lanes(inside, 0, 0, i, go)
    crosslane.write_lanes(steps.place, single_ray.vector(0, 0), 0, root, go)
    crosslane.write_lanes(steps.place, single_ray.vector(2, 0), 0, crosslane.load(steps.place, single_ray.vector(1, 0)), go)
    shapes, todo, wait = crosslane.bits(here & ops.not_(meshes)), wait & ~crosslane.bits(go), 0
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if (shapes >> k) & 1:
            _meet_shape(accel, ~simd.read(steps.place, k), kept, steps, k)
        if not _next(accel, kept, upper, steps, k, simd.read(steps.place, single_ray.RAYS + k), any_hit):
            left &= ~(1 << k)
        elif simd.read(steps.place, k) < 0:
            wait |= 1 << k
    return left, wait


@helper
def _meet_shape(accel: Any, i: int, kept: Any, steps: single_ray.TraversalState, k: int) -> None:
    """Take in instance i, a shape, where ray k meets it first."""
    g = accel.placed[i, 2]
    zero = crosslane.load(kept, _T_MIN)
    o = affine.transform_point(accel.inverse, i, ops.like3(zero, _at(kept, 0, k), _at(kept, 1, k), _at(kept, 2, k)))
    d = affine.transform_vector(accel.inverse, i, ops.like3(zero, _at(kept, _D, k), _at(kept, _D + 1, k), _at(kept, _D + 2, k)))
    t_min, t_max = ops.full_like(zero, _at(kept, _T_MIN, k)), ops.full_like(zero, _at(kept, _UNTIL, k))
    at_t, part, u, v = _of_shape(accel, accel.placed[i, 3], g, o, d, t_min, t_max)
    t, primitive = crosslane.lane(at_t, 0), np.int64(crosslane.lane(part, 0))
    if single_ray.is_closer(steps, k, t, i, primitive):
        simd.write(steps.found, k, t)
        simd.write(steps.found, single_ray.RAYS + k, crosslane.lane(u, 0))
        simd.write(steps.found, 2 * single_ray.RAYS + k, crosslane.lane(v, 0))
        simd.write(steps.found, 3 * single_ray.RAYS + k, 1.0)
        simd.write(steps.numbers, k, i)
        simd.write(steps.numbers, single_ray.RAYS + k, primitive)


@noinline_helper
def _of_shape(accel, kind, g, o, d, t_min, t_max):
    """meeting.shape as a function of its own: rays one by one call it with one ray in all lanes."""
    return shape_hit.shape(accel, kind, g, o, d, t_min, t_max)


@helper
def _at(kept: Any, row: int, k: int) -> Any:
    return simd.read(kept, row * _LANES + k)
