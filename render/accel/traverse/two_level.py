"""Walking the trees of bvh.py, in kernels: over instances all lanes go together where they go one way, in meshes each for itself."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from ... import simd
from ...jit.function_pointer import DeclaredKernel
from ...jit.kernel import HELPER, helper, noinline_helper
from ...jit.packed_struct import skip_when_tagged
from ...lanes import affine, crosslane, ops, row_gather
from ...lanes.kinds import FLOAT, INT, MASK, VEC
from ...types import Hit, Lane, Vec
from ..build import tlas as over
from ..build.scene_layout import NO_MESHES, NO_TREE, REACH
from ..build.wide_bvh import DEPTH
from . import interleaved_mesh, interleaved_scene, packet, packet_nodes, ray_box, shape_hit, single_ray
from .interleaved_scene import MESH
from .packet import BUNDLES

NARROW = 0.0005  # square of the angle, in radians, that directions may stray from the first lane's to go together
SMALL = 32  # nodes of a tree up to which rays that go apart, too, share the tests of shapes
FEW = 3  # active lanes from which on that is worth it


def _search(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit):
    """The first hit of each active lane's ray with what has `visible_bit`; with `any_hit`, the first one found."""
    zero = ops.full_like(t_min, 0.0)
    nothing = ops.int_like(zero, -1)
    best = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = ops.where(active, t_max, zero - np.inf)
    endless = len(accel.endless)
    for k in range(endless + (1 if accel.only >= 0 else 0)):  # a single thing in the tree: its own box is asked
        i = np.int64(accel.endless[k]) if k < endless else np.int64(accel.only)
        best = intersect_instance(accel, i, origin, direction, t_min, until, visible_bit, any_hit, best)
        if any_hit:
            until = ops.where(best.instance >= 0, zero - np.inf, until)
    left = crosslane.bits(until > t_min)
    if accel.only >= 0 or len(accel.top.links) == 0 or left == 0:
        return best
    return _below(accel, origin, direction, t_min, until, left, visible_bit, any_hit, best)


SEARCH = (VEC, VEC, FLOAT, FLOAT, MASK, types.int64, types.boolean)  # what `search` takes beside the trees; aside.link makes it ready
HIT: Any = types.NamedTuple([FLOAT, INT, INT, FLOAT, FLOAT], Hit)
search = DeclaredKernel(_search, HIT, SEARCH)
find = search.call  # what kernels call, with its address and its arguments


@helper
def _nothing_below(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, until: Lane, left: int, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:  # fmt: skip
    return best


@skip_when_tagged(NO_TREE, _nothing_below)
@helper
def _below(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, until: Lane, left: int, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:  # fmt: skip
    """`best`, or what rays whose bits are set in `left` meet first in the tree over instances where that comes first."""
    o, d = over.local(accel.top, origin, direction)
    ray = ray_box.world_ray(o, d)
    narrow = is_narrow(ray, direction, until > t_min, left)
    if narrow or len(accel.top.links) <= SMALL:
        return traverse_packet(accel, ray, origin, direction, t_min, until, visible_bit, any_hit, narrow, best)
    return interleaved_scene.trace_incoherent(accel, ray, o, d, origin, direction, t_min, until, left, visible_bit, any_hit, best)


@helper
def is_narrow(ray: ray_box.BoxRay, direction: Vec, active: Lane, left: int) -> bool:
    """Whether the active lanes, bits of `left`, are several rays of one octant that go nearly the same way."""
    if simd.population(left) < FEW:
        return False
    k = simd.trailing_zeros(left)
    first = crosslane.lane3(direction, k)
    apart_ = ops.sub(direction, first)
    near = ops.dot(apart_, apart_) <= NARROW * ops.dot(first, first)
    x, y, z = ray.x == crosslane.lane(ray.x, k), ray.y == crosslane.lane(ray.y, k), ray.z == crosslane.lane(ray.z, k)
    return ops.not_(ops.any_lane(active & ops.not_(near & x & y & z)))


@helper
def traverse_packet(
    accel: Any, ray: ray_box.BoxRay, origin: Vec, direction: Vec, t_min: Lane, until: Lane,
    visible_bit: int, any_hit: bool, narrow: bool, best: Hit,
) -> Hit:  # fmt: skip
    """The first hits of rays that all go where any of them does; those of one octant are tested as a bundle."""
    nodes, links = accel.top.nodes, accel.top.links
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    active = until > t_min
    rays = ray_box.bundle(ray, active, simd.trailing_zeros(crosslane.bits(active)))
    begin = crosslane.reduce_min(ops.where(active, t_min, np.inf))
    top, node = np.int64(0), np.int64(0)
    while True:
        limit = crosslane.reduce_max(ops.minimum(best.t, until))
        if node >= 0 and narrow:
            near, far, hits = ray_box.enter_node(nodes, node, rays, begin, limit)
            node, top = single_ray.nearest_instance_first(links, node, near, far, hits, children, reaches, top, any_hit)
        elif node >= 0:
            near, hits = ray_box.enter_each(nodes, node, ray, t_min, ops.minimum(best.t, until))
            node, top = single_ray.nearest_first(links, node, near, hits, children, reaches, top)
        else:
            best = intersect_instance(accel, ~node, origin, direction, t_min, until, visible_bit, any_hit, best)
            if any_hit:
                until = ops.where(best.instance >= 0, -np.inf, until)
                top = top if crosslane.reduce_max(until) > -np.inf else 0
            else:
                nearer = crosslane.reduce_max(ops.minimum(best.t, until))
                top = single_ray.sifted(children, reaches, 0, top, nearer) if nearer < limit else top
            node, top = single_ray.last_of(children, top)
        if top < 0:
            return best


@helper
def intersect_instance(
    accel: Any, i: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, visible_bit: int, any_hit: bool, best: Hit
) -> Hit:
    """`best`, or the hits with instance i in the lanes where that comes first."""
    if (accel.placed[i, 0] & visible_bit) == 0:
        return best
    g, kind = accel.placed[i, 2], accel.placed[i, 3]
    o, d = in_frame(accel, i, origin, direction)
    zero = ops.full_like(t_min, 0.0)
    found = Hit(zero + np.inf, ops.int_like(zero, i), ops.int_like(zero, -1), zero, zero)
    if kind == MESH:
        found = _on_mesh(accel, i, g, o, d, t_min, t_max, best.t, any_hit, found)
    else:
        until = ops.minimum(t_max, best.t + 1e-15 * abs(best.t))  # and no less: of equal meetings the lowest instance counts
        t, part, u, v = _of_shape(accel, kind, g, o, d, t_min, until)
        found = Hit(t, found.instance, part, u, v)
    nearer = (found.t < best.t) | ((found.t == best.t) & (found.t < np.inf) & (i < best.instance))
    return Hit(
        ops.where(nearer, found.t, best.t), ops.where(nearer, found.instance, best.instance),
        ops.where(nearer, found.primitive, best.primitive), ops.where(nearer, found.u, best.u), ops.where(nearer, found.v, best.v),
    )  # fmt: skip


def _of_shape(accel: Any, kind: int, g: int, o: Vec, d: Vec, t_min: Lane, until: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """meeting.shape of one vector of rays, or of two side by side, in kernels."""
    raise NotImplementedError


@overload(_of_shape, jit_options=HELPER)
def _of_shape_in_kernels(accel, kind, g, o, d, t_min, until):
    if not crosslane.is_twice(t_min):
        return lambda accel, kind, g, o, d, t_min, until: shape_hit.shape(accel, kind, g, o, d, t_min, until)

    def of_two(accel, kind, g, o, d, t_min, until):
        low, high, join = simd.low_half, simd.high_half, simd.joined
        t, part, u, v = shape_hit.shape(accel, kind, g, crosslane.low3(o), crosslane.low3(d), low(t_min), low(until))
        t2, part2, u2, v2 = shape_hit.shape(accel, kind, g, crosslane.high3(o), crosslane.high3(d), high(t_min), high(until))
        return join(t, t2), join(part, part2), join(u, u2), join(v, v2)

    return of_two


@helper
def _no_mesh(
    accel: Any, i: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane, nearest: Lane, any_hit: bool, nothing: Hit
) -> Hit:  # fmt: skip
    return nothing


@skip_when_tagged(NO_MESHES, _no_mesh)
@helper
def _on_mesh(
    accel: Any, i: int, g: int, o: Vec, d: Vec, t_min: Lane, t_max: Lane, nearest: Lane, any_hit: bool, nothing: Hit
) -> Hit:  # fmt: skip
    """What rays in the frame of instance i meet of its mesh."""
    t, primitive, u, v = _mesh(accel, g, np.int64(accel.placed[i, 4]), from_middle(accel, g, o), d, t_min, t_max, nearest, any_hit)
    return Hit(t, nothing.instance, primitive, u, v)


@noinline_helper
def _mesh(accel, g, root, o, d, t_min, t_max, nearest, any_hit):
    """(t, triangle, u, v) of the first meeting with mesh g, whose tree begins at `root`, not beyond `nearest`."""
    until = ops.minimum(nearest, t_max)
    ray, enters, left = entering(accel, g, o, d, t_min, until)
    if left == 0:
        return packet_nodes.nothing(enters)
    alike = BUNDLES and packet.is_coherent(left, d, ray)
    if BUNDLES and alike:
        t, triangle, u, v, asked = packet_nodes.intersect_mesh_packet(accel, g, root, o, d, ray, enters, t_min, t_max, until, left, any_hit)
        if asked:
            return t, triangle, u, v
    hit = interleaved_mesh.intersect_mesh(
        accel.wide, root, o, d, ray, enters, t_min, t_max, until, accel.boxes[g, REACH], left, alike, any_hit
    )
    return hit.t, hit.primitive, hit.u, hit.v


@helper
def in_frame(accel: Any, i: int, origin: Vec, direction: Vec) -> tuple[Vec, Vec]:
    """Origins and directions of rays in the frame of instance i."""
    return affine.transform_point(accel.inverse, i, origin), affine.transform_vector(accel.inverse, i, direction)


@helper
def from_middle(accel: Any, g: int, o: Vec) -> Vec:
    """Origins relative to that of mesh g, as its boxes and corners are."""
    return ops.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))


@helper
def entering(accel: Any, g: int, o: Vec, d: Vec, t_min: Lane, until: Lane) -> tuple[ray_box.BoxRay, Lane, int]:
    """(rays made ready for the boxes of mesh g, where they enter the one around it, 0 where they don't, bits of those that do)."""
    ray = ray_box.local_ray(o, d)
    enters = ray_box.enter(row_gather.eight_at(accel.boxes, g, 0), ray, t_min, until)
    there = enters < np.inf
    return ray, ops.where(there, enters, 0.0), crosslane.bits(there)
