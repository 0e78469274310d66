"""Rays through the tree over instances, each for itself and in turns: what they meet there, however far apart they go."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from . import across, boxes, gather, lanes, meeting, simd, walk
from .boxes import Bundle
from .bvh import NO_MESHES, PLACED, REACH
from .handles import unless
from .kernels import apart, helper
from .records import Hit, Lane, Vec
from .wide import spread64

MESH = int(ir.GeometryKind.MESH)
_LANES = across.WIDTH
_ROWS = 17 * _LANES
ENOUGH = (5 * _LANES + 7) // 8  # rays that wait at instances until they are brought into their frames


@helper
def each(
    accel: Any, ray: boxes.BoxRay, origin: Vec, direction: Vec, t_min: Lane, until: Lane, left: int,
    visible_bit: int, any_hit: bool, best: Hit,
) -> Hit:  # fmt: skip
    """`best`, or what the rays whose bits are set in `left` meet first in the tree where that comes first: a step of each in turn."""
    kept = simd.stack_array(np.float64, _ROWS)
    _store3(kept, 0, ray.near)
    _store3(kept, 3, ray.far)
    _store3(kept, 6, ray.inverse)
    _store3(kept, 9, origin)
    _store3(kept, 12, direction)
    across.store(kept, 15, t_min)
    across.store(kept, 16, until)
    steps, inside = walk.ways(), simd.stack_array(np.int64, _LANES)
    walk.set_out(steps, 0, best.t, best.instance, best.primitive, best.u, best.v)
    todo = left
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        simd.write(inside, k, -1)
        walk.go(steps, k, 0, k * walk.STACK)
    turns(accel, kept, walk.room(), steps, inside, left, visible_bit, any_hit)
    return walk.met(steps, 0)


@apart
def turns(accel, kept, rays, steps, inside, left, visible_bit, any_hit):
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
                more = _next(accel, kept, steps, k, simd.read(steps.place, 2 * walk.RAYS + k), any_hit)
            else:
                more = _step(accel, kept, steps, k)
            if not more:
                left &= ~(1 << k)
            elif simd.read(steps.place, k) < 0:
                wait |= 1 << k
        if wait != 0 and (wait == left or simd.population(wait) >= ENOUGH):
            left, wait = _attempt(accel, kept, rays, steps, inside, left, wait, visible_bit, any_hit)


@helper
def _no_more(accel: Any, rays: walk.Rays, steps: walk.Walks, k: int, instance: int, any_hit: bool) -> bool:
    return False


@unless(NO_MESHES, _no_more)
@helper
def _in_mesh(accel: Any, rays: walk.Rays, steps: walk.Walks, k: int, instance: int, any_hit: bool) -> bool:
    """One step of ray k in a mesh; whether there is more of it."""
    return walk.step(accel.wide, rays, steps, k, instance, any_hit)


@helper
def _store3(table: Any, row: int, value: Vec) -> None:
    across.store(table, row, value[0])
    across.store(table, row + 1, value[1])
    across.store(table, row + 2, value[2])


@helper
def _step(accel: Any, kept: Any, steps: walk.Walks, k: int) -> bool:
    """One node of ray k's way; whether there is more of it."""
    node, top = simd.read(steps.place, k), simd.read(steps.place, walk.RAYS + k)
    near, hits = boxes.enter_node(accel.top.nodes, node, _bundle(kept, k), _at(kept, 15, k), _limit(kept, steps, k))
    node, top = walk.nearest_first(accel.top.links, node, near, hits, steps.children, steps.reaches, top)
    return _go(accel, steps, k, node, top)


@helper
def _next(accel: Any, kept: Any, steps: walk.Walks, k: int, top: int, any_hit: bool) -> bool:
    """Take the next node or instance from ray k's stack, which ends at `top`; whether there is one."""
    if any_hit and simd.read(steps.numbers, k) >= 0:
        return False
    top = walk.sifted(steps.children, steps.reaches, k * walk.STACK, top, _limit(kept, steps, k))
    node, top = walk.last_of(steps.children, top)
    return _go(accel, steps, k, node, top)


@helper
def _go(accel: Any, steps: walk.Walks, k: int, node: int, top: int) -> bool:
    """Let ray k be at a node or an instance, and ask for what will be read of an instance; not where its stack had ended."""
    if top < k * walk.STACK:
        return False
    instance = max(~node, 0)
    simd.prefetch(accel.placed, instance * PLACED)
    simd.prefetch(accel.inverse, instance * 16)
    simd.prefetch(accel.inverse, instance * 16 + 8)
    walk.go(steps, k, node, top)
    return True


@helper
def _limit(kept: Any, steps: walk.Walks, k: int) -> Any:
    return min(simd.read(steps.found, k), _at(kept, 16, k))


@helper
def _no_entry(accel: Any, kept: Any, rays: walk.Rays, steps: walk.Walks, g: Lane, o: Vec, d: Vec, t_min: Lane, here: Lane) -> Lane:
    return here & (t_min < -np.inf)


@unless(NO_MESHES, _no_entry)
@helper
def _enter_mesh(accel: Any, kept: Any, rays: walk.Rays, steps: walk.Walks, g: Lane, o: Vec, d: Vec, t_min: Lane, here: Lane) -> Lane:
    """Make rays ready for meshes g, in whose frames they are: those that enter their boxes."""
    t_max = across.load(kept, 16)
    until = lanes.minimum(across.load(steps.found, walk.vector(0, 0)), t_max)
    ray, box = boxes.local_ray(o, d), gather.eight_at(accel.boxes, g, 0)
    enters = boxes.enter(box, ray, t_min, until)
    go = here & (enters < np.inf)
    walk.keep(rays, 0, go, o, d, ray.inverse, enters, t_min, t_max, until, box[REACH])
    return go


@helper
def _attempt(
    accel: Any, kept: Any, rays: walk.Rays, steps: walk.Walks, inside: Any, left: int, wait: int, visible_bit: int, any_hit: bool
) -> tuple[int, int]:
    """Let the rays whose bits are set in `wait` enter the meshes they have come to; (`left`, `wait`) then."""
    place = across.load(steps.place, walk.vector(0, 0))
    here = across.mask_of(wait, place)
    i = lanes.where(here, ~place, 0)
    visible, _, g, kind, root, _, _, _ = gather.eight_at(accel.placed, i, 0)
    here = here & ((visible & visible_bit) != 0)
    meshes = kind == MESH
    (a, b, c, x, e, f, h, y), (p, q, r, z, u, v, w, _) = gather.eight_at(accel.inverse, i, 0), gather.eight_at(accel.inverse, i, 8)
    matrix, t_min = (a, b, c, x, e, f, h, y, p, q, r, z), across.load(kept, 15)
    o = lanes.point_by(matrix, (across.load(kept, 9), across.load(kept, 10), across.load(kept, 11)))
    d = lanes.vector_by(matrix, (across.load(kept, 12), across.load(kept, 13), across.load(kept, 14)))
    go = _enter_mesh(accel, kept, rays, steps, g, lanes.sub(o, (u, v, w)), d, t_min, here & meshes)
    across.write_lanes(inside, 0, 0, i, go)
    across.write_lanes(steps.place, walk.vector(0, 0), 0, root, go)
    across.write_lanes(steps.place, walk.vector(2, 0), 0, across.load(steps.place, walk.vector(1, 0)), go)
    shapes, todo, wait = across.bits(here & lanes.not_(meshes)), wait & ~across.bits(go), 0
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if (shapes >> k) & 1:
            _meet_shape(accel, ~simd.read(steps.place, k), kept, steps, k)
        if not _next(accel, kept, steps, k, simd.read(steps.place, walk.RAYS + k), any_hit):
            left &= ~(1 << k)
        elif simd.read(steps.place, k) < 0:
            wait |= 1 << k
    return left, wait


@helper
def _meet_shape(accel: Any, i: int, kept: Any, steps: walk.Walks, k: int) -> None:
    """Take in instance i, a shape, where ray k meets it first."""
    g = accel.placed[i, 2]
    zero = across.load(kept, 15)
    o = lanes.transform_point(accel.inverse, i, lanes.like3(zero, _at(kept, 9, k), _at(kept, 10, k), _at(kept, 11, k)))
    d = lanes.transform_vector(accel.inverse, i, lanes.like3(zero, _at(kept, 12, k), _at(kept, 13, k), _at(kept, 14, k)))
    t_min, t_max = lanes.full_like(zero, _at(kept, 15, k)), lanes.full_like(zero, _at(kept, 16, k))
    at_t, part, u, v = _of_shape(accel, accel.placed[i, 3], g, o, d, t_min, t_max)
    t, primitive = across.lane(at_t, 0), np.int64(across.lane(part, 0))
    if walk.sooner(steps, k, t, i, primitive):
        simd.write(steps.found, k, t)
        simd.write(steps.found, walk.RAYS + k, across.lane(u, 0))
        simd.write(steps.found, 2 * walk.RAYS + k, across.lane(v, 0))
        simd.write(steps.found, 3 * walk.RAYS + k, 1.0)
        simd.write(steps.numbers, k, i)
        simd.write(steps.numbers, walk.RAYS + k, primitive)


@apart
def _of_shape(accel, kind, g, o, d, t_min, t_max):
    """meeting.shape as a function of its own: rays one by one call it with one ray in all lanes."""
    return meeting.shape(accel, kind, g, o, d, t_min, t_max)


@helper
def _bundle(kept: Any, k: int) -> Bundle:
    x, y, z = _at(kept, 6, k), _at(kept, 7, k), _at(kept, 8, k)
    inverse = (spread64(x), spread64(y), spread64(z))
    near = (spread64(_at(kept, 0, k)), spread64(_at(kept, 1, k)), spread64(_at(kept, 2, k)))
    far = (spread64(_at(kept, 3, k)), spread64(_at(kept, 4, k)), spread64(_at(kept, 5, k)))
    return Bundle(near, far, inverse, inverse, boxes.rows_of(x > 0.0, y > 0.0, z > 0.0))


@helper
def _at(kept: Any, row: int, k: int) -> Any:
    return simd.read(kept, row * _LANES + k)
