"""Interleaved traversal of the BVH over instances by incoherent rays: one node of each ray in turn hides memory latency.

Rays that arrive at an instance wait there until several can be transformed into instance frames at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ... import simd
from ...jit.kernel import helper, noinline_helper
from ...jit.packed_struct import skip_when_tagged
from ...lanes import affine, crosslane, ops, row_gather
from ...types import Hit, Lane, Vec
from ..bvh_build.scene_layout import EXTENT, GEOMETRY, INSTANCE_ROW, KIND, MESH, NO_MESHES
from . import node_stack, ray_box, ray_state, shape_hit, single_ray
from .ray_box import MeshRays, SceneRays
from .ray_state import RAYS, STACK, StoredRays, TraversalState

_ROWS = 10 * RAYS
_DIRECTION, _T_MIN, _UNTIL, _ENTERS, _PACE = 3, 6, 7, 8, 9  # rows of the world rays, after the origins
_CUBE = (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)  # the box of the BVH in its frame
ENOUGH = (5 * RAYS + 7) // 8  # rays waiting at instances before these are entered


@helper
def trace_incoherent(accel: Any, rays: SceneRays, active: int, visible_bit: int, any_hit: bool, best: Hit) -> Hit:
    """`best`, or closer hits in the BVH over instances of the rays whose bits are set in `active`."""
    world, upper = simd.stack_array(np.float64, _ROWS), ray_state.allocate_rays()
    nearest, d = ops.minimum(rays.until, best.t), rays.top_direction
    enters = ray_box.intersect_box(_CUBE, rays.box, rays.t_min, nearest)
    enters, entered = ops.where(enters < np.inf, enters, 0.0), enters < np.inf
    entry, pace = ops.add(rays.top_origin, ops.scale(d, enters)), ops.largest((abs(d[0]), abs(d[1]), abs(d[2])))
    sound = (abs(entry[0]) + abs(entry[1]) + abs(entry[2]) < 4.0) & (pace > 0.0)  # excludes NaN and zero directions
    active &= crosslane.bits(entered & sound)
    _store3(world, 0, rays.origin)
    _store3(world, _DIRECTION, rays.direction)
    crosslane.store(world, _T_MIN, rays.t_min)
    crosslane.store(world, _UNTIL, rays.until)
    crosslane.store(world, _ENTERS, enters)
    crosslane.store(world, _PACE, pace)
    ray_state.store_box_rays(upper, entry, ops.scale(rays.box.inverse, pace), (nearest - enters) * pace)
    state, inside = ray_state.allocate_state(), simd.stack_array(np.int64, RAYS)
    ray_state.set_hits(state, best)
    todo = active
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        simd.write(inside, k, -1)
        ray_state.set_position(state, k, 0, k * STACK)
    trace_interleaved(accel, world, upper, ray_state.allocate_rays(), state, inside, active, visible_bit, any_hit)
    return ray_state.load_hits(state)


@noinline_helper
def trace_interleaved(accel, world, upper, rays, state, inside, active, visible_bit, any_hit):
    """Advance the rays whose bits are set in `active` in turn until all have ended.

    `inside` holds the instance whose mesh each ray is in, or -1; `upper` the rays in the BVH over instances, `rays` those in meshes.
    """
    wait = np.int64(0)
    while active != 0:
        todo = active & ~wait
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            instance = simd.read(inside, k)
            if instance >= 0:
                if _step_in_mesh(accel, rays, state, k, instance, any_hit):
                    continue
                simd.write(inside, k, -1)
                more = _pop_node(accel, world, upper, state, k, simd.read(state.position, 2 * RAYS + k), any_hit)
            else:
                more = _step(accel, upper, state, k, any_hit)
            if not more:
                active &= ~(1 << k)
            elif simd.read(state.position, k) < 0:
                wait |= 1 << k
        if wait != 0 and (wait == active or simd.population(wait) >= ENOUGH):
            active, wait = _enter_instances(accel, world, upper, rays, state, inside, active, wait, visible_bit, any_hit)


@helper
def _end_in_mesh(accel: Any, rays: StoredRays, state: TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    return False


@skip_when_tagged(NO_MESHES, _end_in_mesh)
@helper
def _step_in_mesh(accel: Any, rays: StoredRays, state: TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    """One step of ray k in a mesh; return whether it goes on there."""
    return single_ray.traverse_step(accel.wide, rays, state, k, instance, any_hit)


@helper
def _store3(table: Any, row: int, value: Vec) -> None:
    crosslane.store(table, row, value[0])
    crosslane.store(table, row + 1, value[1])
    crosslane.store(table, row + 2, value[2])


@helper
def _step(accel: Any, upper: StoredRays, state: TraversalState, k: int, any_hit: bool) -> bool:
    """Visit one or two nodes with ray k; return whether it goes on."""
    node, top = simd.read(state.position, k), simd.read(state.position, RAYS + k)
    ray, limit = ray_state.node_ray(upper, k), ray_state.limit(upper, k)
    node, top = single_ray.visit_instance_node(accel.top.nodes, accel.top.links, node, ray, limit, state, top, any_hit)
    if node >= 0 and top >= k * STACK:
        node, top = single_ray.visit_instance_node(accel.top.nodes, accel.top.links, node, ray, limit, state, top, any_hit)
    return _move_to(accel, state, k, node, top)


@helper
def _pop_node(accel: Any, world: Any, upper: StoredRays, state: TraversalState, k: int, top: int, any_hit: bool) -> bool:
    """Move ray k to the next node or instance of its stack, which ends at `top`; return whether there is one."""
    if any_hit:
        if simd.read(state.ids, k) >= 0:
            return False
    else:
        limit = np.float32(
            (min(simd.read(state.hits, k), _at(world, _UNTIL, k)) - _at(world, _ENTERS, k)) * _at(world, _PACE, k) * ray_state.FAR
        )
        ray_state.set_limit(upper, k, limit)
        top = node_stack.cull(state.stack, state.distances, k * STACK, top, limit)
    node, top = node_stack.pop(state.stack, top)
    return _move_to(accel, state, k, node, top)


@helper
def _move_to(accel: Any, state: TraversalState, k: int, node: int, top: int) -> bool:
    """Move ray k to a node or ~ instance and prefetch the instance; return False where its stack was empty."""
    if top < k * STACK:
        return False
    instance = max(~node, 0)
    simd.prefetch(accel.instance_rows, instance * INSTANCE_ROW)
    simd.prefetch(accel.inverse, instance * 16)
    simd.prefetch(accel.inverse, instance * 16 + 8)
    ray_state.set_position(state, k, node, top)
    return True


@helper
def _enter_no_mesh(
    accel: Any, world: Any, rays: StoredRays, state: TraversalState, g: Lane, o: Vec, d: Vec, t_min: Lane, lanes: Lane
) -> Lane:
    return lanes & (t_min < -np.inf)


@skip_when_tagged(NO_MESHES, _enter_no_mesh)
@helper
def _enter_mesh(
    accel: Any, world: Any, rays: StoredRays, state: TraversalState, g: Lane, o: Vec, d: Vec, t_min: Lane, lanes: Lane
) -> Lane:
    """Store rays in the frames of meshes g; return the mask of those that enter the boxes."""
    t_max = crosslane.load(world, _UNTIL)
    until = ops.minimum(crosslane.load(state.hits, 0), t_max)
    ray, box = ray_box.local_ray(o, d), row_gather.eight_at(accel.boxes, g, 0)
    enters = ray_box.intersect_box(box, ray, t_min, until)
    enter = lanes & (enters < np.inf)
    ray_state.store_rays(rays, enter, MeshRays(o, d, ray, enters, t_min, t_max, until), box[EXTENT])
    return enter


@helper
def _enter_instances(
    accel: Any, world: Any, upper: StoredRays, rays: StoredRays, state: TraversalState, inside: Any, active: int, wait: int,
    visible_bit: int, any_hit: bool,
) -> tuple[int, int]:  # fmt: skip
    """Let the rays whose bits are set in `wait` enter the instances they have reached; return the new (`active`, `wait`)."""
    position = crosslane.load(state.position, 0)
    lanes = crosslane.mask_of(wait, position)
    i = ops.where(lanes, ~position, 0)
    visible, _, g, kind, root, _, _, _ = row_gather.eight_at(accel.instance_rows, i, 0)
    lanes = lanes & ((visible & visible_bit) != 0)
    meshes = kind == MESH
    (a, b, c, x, e, f, h, y), (p, q, r, z, u, v, w, _) = row_gather.eight_at(accel.inverse, i, 0), row_gather.eight_at(accel.inverse, i, 8)
    matrix, t_min = (a, b, c, x, e, f, h, y, p, q, r, z), crosslane.load(world, _T_MIN)
    o = affine.transform_point12(matrix, (crosslane.load(world, 0), crosslane.load(world, 1), crosslane.load(world, 2)))
    d = affine.transform_vector12(
        matrix, (crosslane.load(world, _DIRECTION), crosslane.load(world, _DIRECTION + 1), crosslane.load(world, _DIRECTION + 2))
    )
    enter = _enter_mesh(accel, world, rays, state, g, ops.sub(o, (u, v, w)), d, t_min, lanes & meshes)
    crosslane.write_lanes(inside, 0, 0, i, enter)
    crosslane.write_lanes(state.position, 0, 0, root, enter)
    crosslane.write_lanes(state.position, 2, 0, crosslane.load(state.position, 1), enter)
    shapes, todo, wait = crosslane.bits(lanes & ops.not_(meshes)), wait & ~crosslane.bits(enter), 0
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if (shapes >> k) & 1:
            _intersect_shape_instance(accel, ~simd.read(state.position, k), world, state, k)
        if not _pop_node(accel, world, upper, state, k, simd.read(state.position, RAYS + k), any_hit):
            active &= ~(1 << k)
        elif simd.read(state.position, k) < 0:
            wait |= 1 << k
    return active, wait


@helper
def _intersect_shape_instance(accel: Any, i: int, world: Any, state: TraversalState, k: int) -> None:
    """Test ray k against instance i, a shape, and record a closer hit."""
    g = accel.instance_rows[i, GEOMETRY]
    zero = crosslane.load(world, _T_MIN)
    o = affine.transform_point(accel.inverse, i, ops.like3(zero, _at(world, 0, k), _at(world, 1, k), _at(world, 2, k)))
    d = affine.transform_vector(
        accel.inverse, i, ops.like3(zero, _at(world, _DIRECTION, k), _at(world, _DIRECTION + 1, k), _at(world, _DIRECTION + 2, k))
    )
    t_min, t_max = ops.full_like(zero, _at(world, _T_MIN, k)), ops.full_like(zero, _at(world, _UNTIL, k))
    all_t, part, u, v = _intersect_shape(accel, accel.instance_rows[i, KIND], g, o, d, t_min, t_max)
    t, primitive = crosslane.lane(all_t, 0), np.int64(crosslane.lane(part, 0))
    if ray_state.is_closer(state, k, t, i, primitive):
        ray_state.set_hit(state, k, t, (crosslane.lane(u, 0), crosslane.lane(v, 0), 1.0), i, primitive)


@noinline_helper
def _intersect_shape(accel, kind, g, o, d, t_min, t_max):
    """shape_hit.intersect_shape, not inlined: each ray calls it alone, with that ray in all lanes."""
    return shape_hit.intersect_shape(accel, kind, g, o, d, t_min, t_max)


@helper
def _at(world: Any, row: int, k: int) -> Any:
    return simd.read(world, row * RAYS + k)
