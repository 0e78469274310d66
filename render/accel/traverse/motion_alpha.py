"""Things that stand aside from the tree over instances, in one of their own: those that move, or are not wholly there.

A ray first goes through the other things, as in scenes without such; then, as far as it got, by itself through this tree. A surface's
opacity is asked inside of the walk: where it is 0 nothing is met, and to a shadow ray each surface is a share of the light that it
lets through, in whatever order they are found. Nothing of this is compiled for scenes that do not need it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from ... import simd
from ...geometry import analytic_shapes, instance_transform
from ...geometry import flat_shapes as flat
from ...jit.function_pointer import KernelPointer
from ...jit.kernel import HELPER, helper
from ...jit.packed_struct import Handle, HandleType, with_type_tags
from ...lanes import affine, crosslane, ops, row_gather
from ...lanes.kinds import FLOAT
from ...surface import alpha, interaction
from ...types import Hit, Lane, Ray, Vec
from ..build import tlas as over
from ..build.scene_layout import REACH, absent_features
from ..build.wide_bvh import DEPTH, spread64, triangle_of
from . import ray_box, shape_hit, single_ray, triangle_filter, two_level
from .interleaved_scene import MESH

_LANES = crosslane.WIDTH
_KEPT, _FOUND, _NUMBERS = 9 * _LANES, 3 * _LANES, 2 * _LANES
_VEC = types.UniTuple(types.float64, 3)


def is_used(accel: Any) -> bool:
    """Whether kernels' trees of this Numba type have something aside."""
    found = accel.field("aside") if isinstance(accel, HandleType) else None
    return found is not None and found[1] != ()


def asks(accel: Any) -> bool:
    """Whether some of it has an opacity that is asked."""
    return is_used(accel) and accel.field("aside.cover")[1] != ()


def moves(accel: Any) -> bool:
    """Whether some of it moves."""
    return is_used(accel) and accel.field("aside.moving")[1] != ()


def link(accel: Handle) -> None:
    """Compile or load what goes through packed trees, and tell them where it is."""
    shape_hit.link(accel)
    search = two_level.search.link(with_type_tags(accel.numba_type, *absent_features(accel.tables)), *two_level.SEARCH)
    if is_used(accel.numba_type):
        accel.put("aside.plain", search)
        if asks(accel.numba_type):
            hit = types.float64, types.int64, types.int64, types.float64, types.float64, types.float64
            accel.put("aside.cover.address", covering.link(accel.numba_type, _VEC, _VEC, *hit))
        if moves(accel.numba_type):
            accel.put("aside.moving.address", through_moving.link(accel.numba_type, *two_level.SEARCH, FLOAT))
        search = through_all.link(accel.numba_type, *two_level.SEARCH)
    accel.put("search", search)


# --- how much of a surface is there ---------------------------------------------------------------------------------------


def _cover(accel, origin, direction, t, instance, primitive, u, v, time):
    """How much of instance's surface is there where a ray meets it."""
    tables = accel.aside.tables
    point = interaction.make_interaction(tables, Ray(origin, direction, 0.0, np.inf, time), Hit(t, instance, primitive, u, v))
    return alpha.at(tables, point)


covering = KernelPointer(_cover)
cover = covering.call


def _there(accel: Any, ray: One, t: Any, i: int, primitive: Any, u: Any, v: Any) -> Any:
    """How much of instance i is there where a ray meets it, in kernels."""
    raise NotImplementedError


@overload(_there, jit_options=HELPER)
def _there_in_kernels(accel, ray, t, i, primitive, u, v):
    if not asks(accel):
        return lambda accel, ray, t, i, primitive, u, v: 1.0

    def ask(accel, ray, t, i, primitive, u, v):
        if not accel.aside.partial[i]:
            return 1.0
        when = _known(ray.time)
        return cover(accel.aside.cover.address, (accel, ray.origin, ray.direction, t, i, primitive, u, v, when))  # pyright: ignore

    return ask


@helper
def alpha_at_hit(accel: Any, ray: Ray, hit: Hit) -> tuple[Lane, Lane]:
    """(How much of what rays met is there, 1 where they met nothing; where those that pass may meet the next thing), in kernels of scenes
    where some is not."""
    there, onward = ops.full_like(hit.t, 1.0), hit.t
    left = crosslane.bits(hit.instance >= 0)
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
        i = crosslane.lane(hit.instance, k)
        if accel.aside.partial[i]:
            origin, direction = crosslane.lane3(ray.origin, k), crosslane.lane3(ray.direction, k)
            one = One(origin, direction, 0.0, np.inf, _of(ray.time, k))
            t, primitive = crosslane.lane(hit.t, k), crosslane.lane(hit.primitive, k)
            share = _there(accel, one, t, i, primitive, crosslane.lane(hit.u, k), crosslane.lane(hit.v, k))
            there = crosslane.with_lane(there, k, share)
            if accel.placed[i, 3] == shape_hit.FORMULA:
                d = affine.transform_vector12(
                    instance_transform.transform_at(accel.aside.tables, accel.placed[i, 1], one.time).inverse, direction
                )
                onward = crosslane.with_lane(onward, k, shape_hit.after(accel.parameters[accel.placed[i, 2], 5], d, t, primitive))
    return there, onward


def _known(time: Any) -> Any:
    """The time, the opening's where there is none."""
    raise NotImplementedError


@overload(_known, jit_options=HELPER)
def _known_in_kernels(time):
    return (lambda time: 0.0) if isinstance(time, types.NoneType) else lambda time: time


# --- one ray ----------------------------------------------------------------------------------------------------------------


class One(NamedTuple):
    """A ray by itself."""

    origin: Vec
    direction: Vec
    t_min: Any
    t_max: Any
    time: Any  # None: as at the shutter's opening


class First(NamedTuple):
    """What one ray meets first, and what share of light passes all that it meets."""

    t: Any
    instance: Any
    primitive: Any
    u: Any
    v: Any
    share: Any


@helper
def _nothing(share: Any) -> First:
    return First(np.inf, np.int64(-1), np.int64(-1), 0.0, 0.0, share)


@helper
def _through(accel: Any, ray: One, limit: Any, visible_bit: int, any_hit: bool, rays: single_ray.Rays) -> First:
    """What a ray meets first, not beyond `limit`; with `any_hit`, how much light passes what it meets."""
    best = _nothing(1.0)
    for k in range(len(accel.aside.endless)):
        best = _nearer(best, _meet(accel, np.int64(accel.aside.endless[k]), ray, limit, visible_bit, any_hit, best.share, rays))
        limit = min(limit, best.t)
    nodes, links = accel.aside.top.nodes, accel.aside.top.links
    if len(links) == 0 or best.share <= 0.0:
        return best
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    ready = _bundle(ray_box.world_ray(*over.local(accel.aside.top, ray.origin, ray.direction)))
    top, node = np.int64(0), np.int64(0)
    while True:
        if node >= 0:
            near, _, hits = ray_box.enter_node(nodes, node, ready, ray.t_min, limit)
            node, top = single_ray.nearest_first(links, node, near, hits, children, reaches, top)
        else:
            best = _nearer(best, _meet(accel, ~node, ray, limit, visible_bit, any_hit, best.share, rays))
            if best.share <= 0.0:
                return best
            if best.t < limit:
                limit = best.t
                top = single_ray.sifted(children, reaches, 0, top, limit)
            node, top = single_ray.last_of(children, top)
        if top < 0:
            return best


@helper
def _nearer(a: First, b: First) -> First:
    """The nearer of two meetings, of instances' order where they are as near; with the share that passes the later one."""
    later = b.t < a.t or (b.t == a.t and b.t < np.inf and b.instance < a.instance)
    return First(
        b.t if later else a.t, b.instance if later else a.instance, b.primitive if later else a.primitive,
        b.u if later else a.u, b.v if later else a.v, b.share,
    )  # fmt: skip


@helper
def _bundle(ray: ray_box.BoxRay) -> ray_box.Bundle:
    inverse = _spread(ray.inverse)
    return ray_box.Bundle(_spread(ray.near), _spread(ray.far), inverse, inverse, ray_box.rows_of(ray.x, ray.y, ray.z))


@helper
def _spread(v: Vec) -> Vec:
    return spread64(v[0]), spread64(v[1]), spread64(v[2])


@helper
def _meet(accel: Any, i: int, ray: One, limit: Any, visible_bit: int, any_hit: bool, share: Any, rays: single_ray.Rays) -> First:
    """A ray's first meeting with instance i, not beyond `limit`; with `any_hit`, `share` times what passes it."""
    if (accel.placed[i, 0] & visible_bit) == 0:
        return _nothing(share)
    row, g, kind = accel.placed[i, 1], accel.placed[i, 2], accel.placed[i, 3]
    inverse = instance_transform.transform_at(accel.aside.tables, row, ray.time).inverse
    o, d = affine.transform_point12(inverse, ray.origin), affine.transform_vector12(inverse, ray.direction)
    if kind == MESH:
        o = ops.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
        ready = ray_box.local_ray(o, d)
        box = row_gather.eight_at(accel.boxes, g, 0)
        enters = ray_box.enter(box, ready, ray.t_min, limit)
        if not enters < np.inf:
            return _nothing(share)
        single_ray.keep(rays, 0, True, o, d, ready.inverse, enters, ray.t_min, ray.t_max, limit, box[REACH])
        return _in_mesh(accel, i, ray, enters, any_hit, share, rays)
    return _on_shape(accel, i, kind, g, o, d, ray, limit, any_hit, share)


@helper
def _on_shape(accel: Any, i: int, kind: int, g: int, o: Vec, d: Vec, ray: One, limit: Any, any_hit: bool, share: Any) -> First:
    """`_meet` for a shape in whose frame the ray is o + t d: one meeting after the other, until one counts."""
    onward, u, v = ray.t_min, 0.0, 0.0
    while True:
        if kind == shape_hit.FORMULA:
            t, part, u, v, onward = shape_hit.formula(accel, g, o, d, onward, ray.t_max)
        else:
            t, part = analytic_shapes.intersect(kind, accel.parameters, g, o, d, onward, ray.t_max)
            onward = t
        if not t <= limit or t == np.inf:
            return _nothing(share)
        there = _there(accel, ray, t, i, np.int64(part), u, v)
        if any_hit:
            share *= 1.0 - there
            if share > 0.0:
                continue
        if there > 0.0:
            return First(t, i, np.int64(part), u, v, share)


@helper
def _in_mesh(accel: Any, i: int, ray: One, enters: Any, any_hit: bool, share: Any, rays: single_ray.Rays) -> First:
    """`_meet` for a mesh's tree, as walk.step goes through it."""
    tree, root = accel.wide, np.int64(accel.placed[i, 4])
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    box, sifted, sheared, limit = (
        single_ray.box(rays, 0),
        single_ray.sieve_of(rays, 0),
        single_ray.sheared(rays, 0),
        single_ray.limit_of(rays, 0),
    )
    best = _nothing(share)
    top, node = np.int64(0), root
    while True:
        if node >= 0:
            near, _, hits = single_ray.enter_boxes(tree.nodes, node, box, limit)
            node, top = single_ray.nearest_first(tree.links, node, near, hits, children, reaches, top)
        else:
            leaf, before = ~node, limit
            hits = triangle_filter.touched(tree.leaves, leaf, sifted, limit)
            while hits != 0:
                j = simd.trailing_zeros(hits)
                hits &= hits - 1
                met = single_ray.crossing(tree.leaves, leaf, j, sheared)
                t = flat.reached(met, sheared.shear[2], ray.t_min, ray.t_max)
                number = np.int64(triangle_of(tree.leaves, leaf, j))
                if t == np.inf or not (any_hit or t < best.t or (t == best.t and number < best.primitive)):
                    continue
                u, v = met.v / met.total, met.w / met.total
                there = _there(accel, ray, t, i, number, u, v)
                if any_hit:
                    share *= 1.0 - there
                    if share <= 0.0:
                        return First(t, i, number, u, v, share)
                elif there > 0.0:
                    best = First(t, i, number, u, v, share)
                    limit = np.float32((t - enters) * single_ray.FAR)
            if limit < before:
                top = single_ray.sifted(children, reaches, 0, top, limit)
            node, top = single_ray.last_of(children, top)
        if top < 0:
            return First(best.t, best.instance, best.primitive, best.u, best.v, share)


# --- rays as traverse.search takes them -----------------------------------------------------------------------------------


def _search(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit):
    """As traverse.search, through all things; with `any_hit`, u is the share of light that passes where instance is -1."""
    return _at_opening(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit)


def _at_opening(accel: Any, *ray: Any) -> Hit:
    """`_both` for rays without a time, in kernels: where things move, as at the shutter's opening, without compiling all of it again."""
    raise NotImplementedError


@overload(_at_opening, jit_options=HELPER)
def _at_opening_in_kernels(accel, *ray):
    if not moves(accel):
        return lambda accel, *ray: _both(accel, *ray, None)

    def at_opening(accel, *ray):
        return find_moving(accel.aside.moving.address, (accel,) + ray + (0.0 * ray[2],))  # pyright: ignore

    return at_opening


def _search_moving(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit, time):
    """The same for rays that have a time."""
    return _both(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit, time)


@helper
def _both(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, active: Lane, visible_bit: int, any_hit: bool, time: Lane | None
) -> Hit:
    best = two_level.find(accel.aside.plain, (accel, origin, direction, t_min, t_max, active, visible_bit, any_hit))  # pyright: ignore
    until = ops.where(active, ops.minimum(best.t, t_max), -np.inf)
    zero = ops.full_like(t_min, 0.0)
    if any_hit:
        until = ops.where(best.instance >= 0, zero - np.inf, until)
        best = Hit(best.t, best.instance, best.primitive, ops.where(best.instance >= 0, zero, zero + 1.0), best.v)
    left = crosslane.bits(until > t_min)
    if left == 0:
        return best
    return _each(accel, origin, direction, t_min, t_max, until, left, visible_bit, any_hit, time, best)


through_all, through_moving = KernelPointer(_search), KernelPointer(_search_moving)
find_moving = through_moving.call


@helper
def _each(
    accel: Any, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, until: Lane, left: int, visible_bit: int, any_hit: bool,
    time: Lane | None, best: Hit,
) -> Hit:  # fmt: skip
    """`best`, or what the rays whose bits are set in `left` meet aside, where that comes first."""
    kept, found = simd.stack_array(np.float64, _KEPT), simd.stack_array(np.float64, _FOUND)
    numbers = simd.stack_array(np.int64, _NUMBERS)
    for j, x in ((0, origin[0]), (1, origin[1]), (2, origin[2]), (3, direction[0]), (4, direction[1]), (5, direction[2])):
        crosslane.store(kept, j, x)
    crosslane.store(kept, 6, t_min)
    crosslane.store(kept, 7, t_max)
    crosslane.store(kept, 8, until)
    crosslane.store(found, 0, best.t)
    crosslane.store(found, 1, best.u)
    crosslane.store(found, 2, best.v)
    crosslane.store(numbers, 0, best.instance)
    crosslane.store(numbers, 1, best.primitive)
    rays = single_ray.room()
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
        ray = One(_at3(kept, 0, k), _at3(kept, 3, k), _at(kept, 6, k), _at(kept, 7, k), _of(time, k))
        first = _through(accel, ray, _at(kept, 8, k), visible_bit, any_hit, rays)
        t = simd.read(found, k)
        if any_hit:
            simd.write(found, _LANES + k, first.share)
            if first.share > 0.0:
                continue
        elif not (first.t < t or (first.t == t and first.t < np.inf and first.instance < simd.read(numbers, k))):
            continue
        else:
            simd.write(found, _LANES + k, first.u)
        simd.write(found, k, first.t)
        simd.write(found, 2 * _LANES + k, first.v)
        simd.write(numbers, k, first.instance)
        simd.write(numbers, _LANES + k, first.primitive)
    return Hit(
        crosslane.load(found, 0), crosslane.load(numbers, 0), crosslane.load(numbers, 1), crosslane.load(found, 1), crosslane.load(found, 2)
    )


def _of(time: Lane | None, k: int) -> Any:
    """Lane k of rays' times, in kernels."""
    raise NotImplementedError


@overload(_of, jit_options=HELPER)
def _of_in_kernels(time, k):
    return (lambda time, k: None) if isinstance(time, types.NoneType) else lambda time, k: crosslane.lane(time, k)


@helper
def _at3(kept: Any, row: int, k: int) -> Vec:
    return _at(kept, row, k), _at(kept, row + 1, k), _at(kept, row + 2, k)


@helper
def _at(kept: Any, row: int, k: int) -> Any:
    return simd.read(kept, row * _LANES + k)
