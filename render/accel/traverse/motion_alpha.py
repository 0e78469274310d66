"""Traversal of moving or partly transparent instances, which have a BVH of their own.

A ray first traverses the BVH of all other instances. It then traverses this BVH alone, up to the hit so far. Opacity is looked up in maps
of triangles (bvh_build/opacity_maps.py) or evaluated during the traversal: a hit of opacity 0 does not count. A shadow ray multiplies the
transmittance of all surfaces, in the order of traversal.
Scenes without such instances compile none of this.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...geometry import analytic_shapes, instance_transform
from ...geometry import triangle_hit as flat
from ...jit.function_pointer import KernelPointer
from ...jit.kernel import helper
from ...jit.packed_struct import Handle, HandleType, with_type_tags
from ...jit.value_types import FLOAT64, INT64, tuple_of
from ...lanes import affine, crosslane, ops, row_gather
from ...lanes.kinds import FLOAT
from ...simd.registration import overload, types
from ...surface import alpha, interaction
from ...types import Hit, Lane, Ray, Vec
from ..bvh_build import opacity_maps, tlas
from ..bvh_build.scene_layout import EXTENT, GEOMETRY, KIND, MESH, NO_MESHES, ROOT, TRANSFORM, VISIBILITY, absent_features
from ..bvh_build.wide_bvh import DEPTH, spread64, triangle_of
from . import node_stack, ray_box, ray_state, shape_hit, single_ray, triangle_filter, two_level

_LANES = crosslane.WIDTH
_RAYS, _HITS, _IDS = 9 * _LANES, 3 * _LANES, 2 * _LANES
_VEC = tuple_of(FLOAT64, FLOAT64, FLOAT64)


def is_used(accel: Any) -> bool:
    """Whether a BVH of this Numba type has moving or partly transparent instances."""
    field = accel.field("motion_alpha") if isinstance(accel, HandleType) else None
    return field is not None and field[1] != ()


def has_opacity(accel: Any) -> bool:
    """Whether a BVH of this Numba type has partly transparent instances."""
    return is_used(accel) and accel.field("motion_alpha.opacity")[1] != ()


def has_motion(accel: Any) -> bool:
    """Whether a BVH of this Numba type has moving instances."""
    return is_used(accel) and accel.field("motion_alpha.moving")[1] != ()


def link(accel: Handle, general: bool = False) -> None:
    """Compile or load the traversal kernels of a packed BVH and store their addresses in it.

    With `general`, they traverse the tree over instances even if the scene has none.
    """
    shape_hit.link(accel)
    absent = absent_features(accel.tables)
    if general:
        absent = tuple(tag for tag in absent if tag == NO_MESHES)  # rays that step through meshes in turn take half as long again without
    search = two_level.search.link(with_type_tags(accel.type, *absent), *two_level.SEARCH)
    if is_used(accel.type):
        accel.put("motion_alpha.opaque_search", search)
        if has_opacity(accel.type):
            hit = FLOAT64, INT64, INT64, FLOAT64, FLOAT64, FLOAT64
            accel.put("motion_alpha.opacity.address", opacity_kernel.link(accel.type, _VEC, _VEC, *hit))
        if has_motion(accel.type):
            accel.put("motion_alpha.moving.address", search_moving.link(accel.type, *two_level.SEARCH, FLOAT))
        every = search_all.link(accel.type, *two_level.SEARCH)
        unusual = accel.tables.motion_alpha
        search = every if len(unusual.top.links) + len(unusual.unbounded) else search
    accel.put("search", search)


def has_no_instances(accel: Any) -> bool:
    """Whether no instance moves or is partly transparent; general kernels also serve such scenes. False in numpy, which has no BVH."""
    return False


@overload(has_no_instances)
def _has_no_instances_in_kernels(accel):
    return lambda accel: len(accel.motion_alpha.top.links) + len(accel.motion_alpha.unbounded) == 0


# --- opacity --------------------------------------------------------------------------------------------------------------


def _hit_opacity(accel, origin, direction, t, instance, primitive, u, v, time):
    """Opacity of an instance where a ray hits it."""
    tables = accel.motion_alpha.tables
    point = interaction.make_interaction(tables, Ray(origin, direction, 0.0, np.inf, time), Hit(t, instance, primitive, u, v))
    return alpha.opacity_at(tables, point)


opacity_kernel = KernelPointer(_hit_opacity)
call_opacity = opacity_kernel.call


def _opacity(accel: Any, ray: Ray, t: Any, i: int, primitive: Any, u: Any, v: Any) -> Any:
    """Opacity of instance i where a scalar ray hits it, in kernels."""
    raise NotImplementedError


@overload(_opacity)
def _opacity_in_kernels(accel, ray, t, i, primitive, u, v):
    if not has_opacity(accel):
        return lambda accel, ray, t, i, primitive, u, v: 1.0

    def evaluate(accel, ray, t, i, primitive, u, v):
        if not accel.motion_alpha.partial[i]:
            return 1.0
        state = _state_of(accel.motion_alpha.maps, i, primitive, u, v)
        if state != opacity_maps.UNKNOWN:
            return 1.0 if state == opacity_maps.OPAQUE else 0.0
        time = _time_or_opening(ray.time)
        return call_opacity(accel.motion_alpha.opacity.address, (accel, ray.origin, ray.direction, t, i, primitive, u, v, time))  # pyright: ignore

    return evaluate


@helper
def _state_of(maps: Any, i: int, primitive: Any, u: Any, v: Any) -> Any:
    """The state of the cell of an opacity map at barycentrics of a triangle of instance i."""
    first = maps.first[i]
    if first == opacity_maps.NONE:
        return opacity_maps.UNKNOWN
    size = np.int64(maps.size)
    column, row = min(max(np.int64(u * size), 0), size - 1), min(max(np.int64(v * size), 0), size - 1)
    return np.int64(maps.cells[(np.int64(maps.of_triangle[first + primitive]) * size + row) * size + column])


@helper
def alpha_at_hit(accel: Any, ray: Ray, hit: Hit) -> tuple[Lane, Lane]:
    """(opacity at the hits of rays, 1 without a hit; smallest t of the next hits), in kernels with partial opacity."""
    opacities, onward = ops.full_like(hit.t, 1.0), hit.t
    pending = crosslane.bits(hit.instance >= 0)
    while pending != 0:
        k = simd.trailing_zeros(pending)
        pending &= pending - 1
        i = crosslane.lane(hit.instance, k)
        if accel.motion_alpha.partial[i]:
            origin, direction = crosslane.lane3(ray.origin, k), crosslane.lane3(ray.direction, k)
            lane_ray = Ray(origin, direction, 0.0, np.inf, _lane_of_time(ray.time, k))
            t, primitive = crosslane.lane(hit.t, k), crosslane.lane(hit.primitive, k)
            opacity = _opacity(accel, lane_ray, t, i, primitive, crosslane.lane(hit.u, k), crosslane.lane(hit.v, k))
            opacities = crosslane.with_lane(opacities, k, opacity)
            if accel.instance_rows[i, KIND] == shape_hit.FORMULA:
                d = affine.transform_vector12(
                    instance_transform.transform_at(accel.motion_alpha.tables, accel.instance_rows[i, TRANSFORM], lane_ray.time).inverse,
                    direction,
                )
                extent = accel.parameters[accel.instance_rows[i, GEOMETRY], 5]
                onward = crosslane.with_lane(onward, k, shape_hit.next_t(extent, d, t, primitive))
    return opacities, onward


def _time_or_opening(time: Any) -> Any:
    """The time of a ray, 0 (the shutter's opening) without one."""
    raise NotImplementedError


@overload(_time_or_opening)
def _time_or_opening_in_kernels(time):
    return (lambda time: 0.0) if isinstance(time, types.NoneType) else lambda time: time


# --- one ray ----------------------------------------------------------------------------------------------------------------


class RayHit(NamedTuple):
    """First hit of one ray, and the transmittance of all surfaces on its way."""

    t: Any
    instance: Any
    primitive: Any
    u: Any
    v: Any
    transmittance: Any


@helper
def _no_hit(transmittance: Any) -> RayHit:
    return RayHit(np.inf, np.int64(-1), np.int64(-1), 0.0, 0.0, transmittance)


@helper
def _trace_ray(accel: Any, ray: Ray, limit: Any, visible_bit: int, any_hit: bool, stored: ray_state.StoredRays) -> RayHit:
    """First hit of a ray up to `limit`; with `any_hit`, the transmittance of the surfaces that it hits."""
    best = _no_hit(1.0)
    for k in range(len(accel.motion_alpha.unbounded)):
        i = np.int64(accel.motion_alpha.unbounded[k])
        best = _closer_hit(best, _intersect_instance(accel, i, ray, limit, visible_bit, any_hit, best.transmittance, stored))
        limit = min(limit, best.t)
    nodes, links = accel.motion_alpha.top.nodes, accel.motion_alpha.top.links
    if len(links) == 0 or best.transmittance <= 0.0:
        return best
    stack, distances = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    interval = _interval_of(ray_box.world_ray(*tlas.to_frame(accel.motion_alpha.top, ray.origin, ray.direction)))
    top, node = np.int64(0), np.int64(0)
    while True:
        if node >= 0:
            near, _, hits = ray_box.intersect_node(nodes, node, interval, ray.t_min, limit)
            node, top = node_stack.descend_nearest(links, node, near, hits, stack, distances, top)
        else:
            best = _closer_hit(best, _intersect_instance(accel, ~node, ray, limit, visible_bit, any_hit, best.transmittance, stored))
            if best.transmittance <= 0.0:
                return best
            if best.t < limit:
                limit = best.t
                top = node_stack.cull(stack, distances, 0, top, limit)
            node, top = node_stack.pop(stack, top)
        if top < 0:
            return best


@helper
def _closer_hit(a: RayHit, b: RayHit) -> RayHit:
    """The closer of two hits, at equal t that of the lower instance, with the transmittance of the second."""
    second = b.t < a.t or (b.t == a.t and b.t < np.inf and b.instance < a.instance)
    return RayHit(
        b.t if second else a.t, b.instance if second else a.instance, b.primitive if second else a.primitive,
        b.u if second else a.u, b.v if second else a.v, b.transmittance,
    )  # fmt: skip


@helper
def _interval_of(ray: ray_box.BoxRay) -> ray_box.RayInterval:
    inverse = _spread(ray.inverse)
    return ray_box.RayInterval(_spread(ray.near), _spread(ray.far), inverse, inverse, ray_box.near_rows(ray.x, ray.y, ray.z))


@helper
def _spread(v: Vec) -> Vec:
    return spread64(v[0]), spread64(v[1]), spread64(v[2])


@helper
def _intersect_instance(
    accel: Any, i: int, ray: Ray, limit: Any, visible_bit: int, any_hit: bool, transmittance: Any, stored: ray_state.StoredRays
) -> RayHit:
    """First hit of a ray with instance i up to `limit`; with `any_hit`, `transmittance` times that of the instance."""
    if (accel.instance_rows[i, VISIBILITY] & visible_bit) == 0:
        return _no_hit(transmittance)
    row, g, kind = accel.instance_rows[i, TRANSFORM], accel.instance_rows[i, GEOMETRY], accel.instance_rows[i, KIND]
    inverse = instance_transform.transform_at(accel.motion_alpha.tables, row, ray.time).inverse
    o, d = affine.transform_point12(inverse, ray.origin), affine.transform_vector12(inverse, ray.direction)
    if kind == MESH:
        o = ops.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
        ready = ray_box.local_ray(o, d)
        box = row_gather.eight_at(accel.boxes, g, 0)
        enters = ray_box.intersect_box(box, ready, ray.t_min, limit)
        if not enters < np.inf:
            return _no_hit(transmittance)
        ray_state.store_rays(stored, True, ray_box.MeshRays(o, d, ready, enters, ray.t_min, ray.t_max, limit), box[EXTENT])
        return _intersect_mesh(accel, i, ray, enters, any_hit, transmittance, stored)
    return _intersect_shape(accel, i, o, d, ray, limit, any_hit, transmittance)


@helper
def _intersect_shape(accel: Any, i: int, o: Vec, d: Vec, ray: Ray, limit: Any, any_hit: bool, transmittance: Any) -> RayHit:
    """`_intersect_instance` for a shape in whose frame the ray is o + t d: one hit after another until one counts."""
    g, kind = accel.instance_rows[i, GEOMETRY], accel.instance_rows[i, KIND]
    onward, u, v = ray.t_min, 0.0, 0.0
    while True:
        if kind == shape_hit.FORMULA:
            t, part, u, v, onward = shape_hit.intersect_formula(accel, g, o, d, onward, ray.t_max)
        else:
            t, part = analytic_shapes.intersect(kind, accel.parameters, g, o, d, onward, ray.t_max)
            onward = t
        if not t <= limit or t == np.inf:
            return _no_hit(transmittance)
        opacity = _opacity(accel, ray, t, i, np.int64(part), u, v)
        if any_hit:
            transmittance *= 1.0 - opacity
            if transmittance > 0.0:
                continue
        if opacity > 0.0:
            return RayHit(t, i, np.int64(part), u, v, transmittance)


@helper
def _intersect_mesh(
    accel: Any, i: int, ray: Ray, enters: Any, any_hit: bool, transmittance: Any, stored: ray_state.StoredRays
) -> RayHit:
    """`_intersect_instance` for a mesh, which the stored ray enters at t = `enters`."""
    tree, root = accel.wide, np.int64(accel.instance_rows[i, ROOT])
    stack, distances = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    node_ray, filter_ray = ray_state.node_ray(stored, 0), ray_state.filter_ray(stored, 0)
    sheared, limit = ray_state.sheared_ray(stored, 0), ray_state.limit(stored, 0)
    best = _no_hit(transmittance)
    top, node = np.int64(0), root
    while True:
        if node >= 0:
            near, _, hits = node_stack.intersect_boxes(tree.nodes, node, node_ray, limit)
            node, top = node_stack.descend_nearest(tree.links, node, near, hits, stack, distances, top)
        else:
            leaf, before = ~node, limit
            hits = triangle_filter.candidates(tree.leaves, leaf, filter_ray, limit)
            while hits != 0:
                j = simd.trailing_zeros(hits)
                hits &= hits - 1
                triangle_hit = single_ray.crossing(tree.leaves, leaf, j, sheared)
                t = flat.hit_t(triangle_hit, sheared.shear[2], ray.t_min, ray.t_max)
                number = np.int64(triangle_of(tree.leaves, leaf, j))
                if t == np.inf or not (any_hit or t < best.t or (t == best.t and number < best.primitive)):
                    continue
                u, v = triangle_hit.v / triangle_hit.total, triangle_hit.w / triangle_hit.total
                opacity = _opacity(accel, ray, t, i, number, u, v)
                if any_hit:
                    transmittance *= 1.0 - opacity
                    if transmittance <= 0.0:
                        return RayHit(t, i, number, u, v, transmittance)
                elif opacity > 0.0:
                    best = RayHit(t, i, number, u, v, transmittance)
                    limit = np.float32((t - enters) * ray_state.FAR)
            if limit < before:
                top = node_stack.cull(stack, distances, 0, top, limit)
            node, top = node_stack.pop(stack, top)
        if top < 0:
            return RayHit(best.t, best.instance, best.primitive, best.u, best.v, transmittance)


# --- rays as two_level.search takes them ----------------------------------------------------------------------------------


def _search_all(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit):
    """two_level.search through all instances; with `any_hit`, u is the transmittance where instance is -1."""
    return _search_at_opening(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit)


def _search_at_opening(accel: Any, *ray: Any) -> Hit:
    """`_search` for rays without a time, in kernels. With motion it calls the linked kernel for rays with a time."""
    raise NotImplementedError


@overload(_search_at_opening)
def _search_at_opening_in_kernels(accel, *ray):
    if not has_motion(accel):

        def search_still(accel, *ray):
            origin, direction, t_min, t_max, active, visible_bit, any_hit = ray
            return _search(accel, Ray(origin, direction, t_min, t_max, None), active, visible_bit, any_hit)

        return search_still

    def search_at_opening(accel, *ray):
        return find_moving(accel.motion_alpha.moving.address, (accel,) + ray + (0.0 * ray[2],))  # pyright: ignore

    return search_at_opening


def _search_moving(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit, time):
    """`_search_all` for rays that have a time."""
    return _search(accel, Ray(origin, direction, t_min, t_max, time), active, visible_bit, any_hit)


@helper
def _search(accel: Any, ray: Ray, active: Lane, visible_bit: int, any_hit: bool) -> Hit:
    t_min, t_max = ray.t_min, ray.t_max
    best = two_level.find(  # pyright: ignore[reportCallIssue]
        accel.motion_alpha.opaque_search, (accel, ray.origin, ray.direction, t_min, t_max, active, visible_bit, any_hit)
    )
    until = ops.where(active & two_level.is_sound(ray.origin, ray.direction), ops.minimum(best.t, t_max), -np.inf)
    zero = ops.full_like(t_min, 0.0)
    if any_hit:
        until = ops.where(best.instance >= 0, zero - np.inf, until)
        best = Hit(best.t, best.instance, best.primitive, ops.where(best.instance >= 0, zero, zero + 1.0), best.v)
    pending = crosslane.bits(until > t_min)
    if pending == 0 or has_no_instances(accel):
        return best
    return _trace_each(accel, ray, until, pending, visible_bit, any_hit, best)


search_all, search_moving = KernelPointer(_search_all), KernelPointer(_search_moving)
find_moving = search_moving.call


@helper
def _trace_each(accel: Any, ray: Ray, until: Lane, pending: int, visible_bit: int, any_hit: bool, best: Hit) -> Hit:
    """`best`, or closer hits of the rays whose bits are set in `pending`, traced one by one up to `until`."""
    rays, hits = simd.stack_array(np.float64, _RAYS), simd.stack_array(np.float64, _HITS)
    ids, (origin, direction) = simd.stack_array(np.int64, _IDS), (ray.origin, ray.direction)
    for j, x in ((0, origin[0]), (1, origin[1]), (2, origin[2]), (3, direction[0]), (4, direction[1]), (5, direction[2])):
        crosslane.store(rays, j, x)
    crosslane.store(rays, 6, ray.t_min)
    crosslane.store(rays, 7, ray.t_max)
    crosslane.store(rays, 8, until)
    crosslane.store(hits, 0, best.t)
    crosslane.store(hits, 1, best.u)
    crosslane.store(hits, 2, best.v)
    crosslane.store(ids, 0, best.instance)
    crosslane.store(ids, 1, best.primitive)
    stored = ray_state.allocate_rays()
    while pending != 0:
        k = simd.trailing_zeros(pending)
        pending &= pending - 1
        lane_ray = Ray(_at3(rays, 0, k), _at3(rays, 3, k), _at(rays, 6, k), _at(rays, 7, k), _lane_of_time(ray.time, k))
        first = _trace_ray(accel, lane_ray, _at(rays, 8, k), visible_bit, any_hit, stored)
        t = simd.read(hits, k)
        if any_hit:
            simd.write(hits, _LANES + k, first.transmittance)
            if first.transmittance > 0.0:
                continue
        elif not (first.t < t or (first.t == t and first.t < np.inf and first.instance < simd.read(ids, k))):
            continue
        else:
            simd.write(hits, _LANES + k, first.u)
        simd.write(hits, k, first.t)
        simd.write(hits, 2 * _LANES + k, first.v)
        simd.write(ids, k, first.instance)
        simd.write(ids, _LANES + k, first.primitive)
    return Hit(crosslane.load(hits, 0), crosslane.load(ids, 0), crosslane.load(ids, 1), crosslane.load(hits, 1), crosslane.load(hits, 2))


def _lane_of_time(time: Lane | None, k: int) -> Any:
    """Lane k of the rays' times, None without times, in kernels."""
    raise NotImplementedError


@overload(_lane_of_time)
def _lane_of_time_in_kernels(time, k):
    return (lambda time, k: None) if isinstance(time, types.NoneType) else lambda time, k: crosslane.lane(time, k)


@helper
def _at3(rays: Any, row: int, k: int) -> Vec:
    return _at(rays, row, k), _at(rays, row + 1, k), _at(rays, row + 2, k)


@helper
def _at(rays: Any, row: int, k: int) -> Any:
    return simd.read(rays, row * _LANES + k)
