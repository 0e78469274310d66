"""Traversal of the two-level BVH in kernels: coherent rays as a packet over the instances, incoherent ones interleaved."""

from __future__ import annotations

from typing import Any

import numpy as np

from ... import simd
from ...jit.function_pointer import DeclaredKernel
from ...jit.kernel import helper, noinline_helper
from ...jit.packed_struct import skip_when_tagged
from ...jit.value_types import BOOL, INT64, tuple_type
from ...lanes import affine, crosslane, ops, row_gather
from ...lanes.kinds import FLOAT, INT, MASK, VEC
from ...types import Hit, Lane, Vec
from ..bvh_build import tlas
from ..bvh_build.scene_layout import EXTENT, GEOMETRY, KIND, MESH, NO_MESHES, NO_TREE, ROOT, VISIBILITY
from ..bvh_build.wide_bvh import DEPTH
from . import interleaved_mesh, interleaved_scene, node_stack, packet, packet_nodes, ray_box, shape_hit
from .packet import PACKETS
from .ray_box import MeshRays, SceneRays

NARROW = 0.0005  # square of the largest angle, in radians, between the directions of coherent rays
WIDE = 0.5  # square of the largest angle between rays that are traced as one packet in a small tree
SMALL = 32  # nodes of a small tree
SMALLEST = 8  # nodes of a tree up to which all rays are traced as one packet
MIN_RAYS = 3  # of a packet


def _search(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit):
    """The first hit of each active lane's ray with instances that have `visible_bit`; with `any_hit`, the first one found."""
    zero = ops.full_like(t_min, 0.0)
    nothing = ops.int_like(zero, -1)
    best = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = ops.where(active & is_sound(origin, direction), t_max, zero - np.inf)
    unbounded = len(accel.unbounded)
    for k in range(unbounded + (1 if accel.only >= 0 else 0)):  # a single instance needs no tree: its own box is tested
        i = np.int64(accel.unbounded[k]) if k < unbounded else np.int64(accel.only)
        best = intersect_instance(accel, i, origin, direction, t_min, until, visible_bit, any_hit, best)
        if any_hit:
            until = ops.where(best.instance >= 0, zero - np.inf, until)
    pending = crosslane.bits(until > t_min)
    if accel.only >= 0 or len(accel.top.links) == 0 or pending == 0:
        return best
    return _traverse_top(accel, origin, direction, t_min, until, pending, visible_bit, any_hit, best)


SEARCH = (VEC, VEC, FLOAT, FLOAT, MASK, INT64, BOOL)  # arguments of `search` after the BVH
HIT: Any = tuple_type(Hit, (FLOAT, INT, INT, FLOAT, FLOAT))
search = DeclaredKernel(_search, HIT, SEARCH)
find = search.call  # called in kernels, with the kernel's address and its arguments


@helper
def is_sound(origin: Vec, direction: Vec) -> Lane:
    """Whether rays are finite. Others hit nothing: no box test excludes NaN, and not even the empty boxes of a node."""
    return ops.is_finite((origin[0] + origin[1] + origin[2]) + (direction[0] + direction[1] + direction[2]))


@helper
def _skip_top(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, until: Lane, pending: int, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:  # fmt: skip
    return best


@skip_when_tagged(NO_TREE, _skip_top)
@helper
def _traverse_top(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, until: Lane, pending: int, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:  # fmt: skip
    """`best`, or closer hits in the BVH over instances of the rays whose bits are set in `pending`."""
    o, d = tlas.to_frame(accel.top, origin, direction)
    rays = SceneRays(origin, direction, t_min, until, o, d, ray_box.world_ray(o, d))
    narrow = is_narrow(rays, pending)
    nodes = len(accel.top.links)
    if narrow or nodes <= SMALLEST or (nodes <= SMALL and is_within(rays, pending, WIDE)):
        return traverse_packet(accel, rays, visible_bit, any_hit, narrow, best)
    return interleaved_scene.trace_incoherent(accel, rays, pending, visible_bit, any_hit, best)


@helper
def is_narrow(rays: SceneRays, active: int) -> bool:
    """Whether the active rays, bits of `active`, are at least MIN_RAYS, of one octant, within the angle of NARROW."""
    if simd.population(active) < MIN_RAYS:
        return False
    k, ray, direction = simd.trailing_zeros(active), rays.box, rays.direction
    first = crosslane.lane3(direction, k)
    difference = ops.sub(direction, first)
    near = ops.dot(difference, difference) <= NARROW * ops.dot(first, first)
    x, y, z = ray.x == crosslane.lane(ray.x, k), ray.y == crosslane.lane(ray.y, k), ray.z == crosslane.lane(ray.z, k)
    return ops.not_(ops.any_lane((rays.until > rays.t_min) & ops.not_(near & x & y & z)))


@helper
def is_within(rays: SceneRays, active: int, most: Any) -> bool:
    """Whether no active ray, bits of `active`, differs from the first one by more than an angle, the square root of `most`."""
    first = crosslane.lane3(rays.direction, simd.trailing_zeros(active))
    difference = ops.sub(rays.direction, first)
    apart = ops.dot(difference, difference) > most * ops.dot(first, first)
    return ops.not_(ops.any_lane((rays.until > rays.t_min) & apart))


@helper
def traverse_packet(accel: Any, rays: SceneRays, visible_bit: int, any_hit: bool, narrow: bool, best: Hit) -> Hit:
    """`best`, or closer hits of rays that visit each node that any of them enters; `narrow` rays are tested as one interval."""
    nodes, links, t_min, until = accel.top.nodes, accel.top.links, rays.t_min, rays.until
    stack, distances = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    active = until > t_min
    interval = ray_box.interval_of(rays.box, active, simd.trailing_zeros(crosslane.bits(active)))
    begin = crosslane.reduce_min(ops.where(active, t_min, np.inf))
    top, node = np.int64(0), np.int64(0)
    while True:
        limit = crosslane.reduce_max(ops.minimum(best.t, until))
        if node >= 0 and narrow:
            near, far, hits = ray_box.intersect_node(nodes, node, interval, begin, limit)
            node, top = node_stack.descend_instances(links, node, near, far, hits, stack, distances, top, any_hit)
        elif node >= 0:
            near, hits = ray_box.intersect_node_each(nodes, node, rays.box, t_min, ops.minimum(best.t, until))
            node, top = node_stack.descend_nearest(links, node, near, hits, stack, distances, top)
        else:
            best = intersect_instance(accel, ~node, rays.origin, rays.direction, t_min, until, visible_bit, any_hit, best)
            if any_hit:
                until = ops.where(best.instance >= 0, -np.inf, until)
                top = top if crosslane.reduce_max(until) > -np.inf else 0
            else:
                nearer = crosslane.reduce_max(ops.minimum(best.t, until))
                top = node_stack.cull(stack, distances, 0, top, nearer) if nearer < limit else top
            node, top = node_stack.pop(stack, top)
        if top < 0:
            return best


@helper
def intersect_instance(
    accel: Any, i: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:
    """`best`, or the hits with instance i in the lanes where those are closer."""
    if (accel.instance_rows[i, VISIBILITY] & visible_bit) == 0:
        return best
    g, kind = accel.instance_rows[i, GEOMETRY], accel.instance_rows[i, KIND]
    o, d = affine.transform_point(accel.inverse, i, origin), affine.transform_vector(accel.inverse, i, direction)
    zero = ops.full_like(t_min, 0.0)
    hit = Hit(zero + np.inf, ops.int_like(zero, i), ops.int_like(zero, -1), zero, zero)
    if kind == MESH:
        hit = _intersect_mesh_instance(accel, i, g, o, d, t_min, t_max, best.t, any_hit, hit)
    else:
        until = ops.minimum(t_max, best.t + 1e-15 * abs(best.t))  # not less: of hits at the same t the lowest instance wins
        t, part, u, v = shape_hit.intersect_shape(accel, kind, g, o, d, t_min, until)
        hit = Hit(t, hit.instance, part, u, v)
    nearer = (hit.t < best.t) | ((hit.t == best.t) & (hit.t < np.inf) & (i < best.instance))
    return Hit(
        ops.where(nearer, hit.t, best.t), ops.where(nearer, hit.instance, best.instance),
        ops.where(nearer, hit.primitive, best.primitive), ops.where(nearer, hit.u, best.u), ops.where(nearer, hit.v, best.v),
    )  # fmt: skip


@helper
def _skip_mesh(
    accel: Any, i: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane, nearest: Lane, any_hit: bool, nothing: Hit
) -> Hit:  # fmt: skip
    return nothing


@skip_when_tagged(NO_MESHES, _skip_mesh)
@helper
def _intersect_mesh_instance(
    accel: Any, i: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane, nearest: Lane, any_hit: bool, nothing: Hit
) -> Hit:  # fmt: skip
    """The hits of rays in the frame of instance i with its mesh, or `nothing`."""
    o = ops.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
    t, primitive, u, v = _intersect_mesh(accel, g, np.int64(accel.instance_rows[i, ROOT]), o, d, t_min, t_max, nearest, any_hit)
    return Hit(t, nothing.instance, primitive, u, v)


@noinline_helper
def _intersect_mesh(accel, g, root, o, d, t_min, t_max, nearest, any_hit):
    """(t, triangle, u, v) of the first hits with mesh g, whose BVH starts at `root`; hits beyond `nearest` are not needed."""
    rays, active = enter_mesh(accel, g, o, d, t_min, t_max, ops.minimum(nearest, t_max))
    if active == 0:
        return packet_nodes.no_hits(rays.enters)
    coherent = PACKETS and packet.is_coherent(active, d, rays.box)
    if PACKETS and coherent:
        t, triangle, u, v, traced = packet_nodes.intersect_mesh_packet(accel, g, root, rays, active, any_hit)
        if traced:
            return t, triangle, u, v
    hit = interleaved_mesh.intersect_mesh(accel.wide, root, rays, active, accel.boxes[g, EXTENT], coherent, any_hit)
    return hit.t, hit.primitive, hit.u, hit.v


@helper
def enter_mesh(accel: Any, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane, until: Lane) -> tuple[MeshRays, int]:
    """(rays prepared for mesh g, bits of those that enter its box)."""
    box = ray_box.local_ray(o, d)
    enters = ray_box.intersect_box(row_gather.eight_at(accel.boxes, g, 0), box, t_min, until)
    enters_box = enters < np.inf
    return MeshRays(o, d, box, ops.where(enters_box, enters, 0.0), t_min, t_max, until), crosslane.bits(enters_box)
