"""Rays through the tree over instances one by one: what each meets there, however far apart they go."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from . import across, boxes, lanes, meeting, simd, walk
from .boxes import Bundle
from .kernels import apart, helper
from .records import Hit, Lane, Vec
from .wide import DEPTH

MESH = int(ir.GeometryKind.MESH)
_LANES = across.WIDTH
_ROWS, _FOUND, _NUMBERS = 17 * _LANES, 3 * _LANES, 2 * _LANES


@helper
def each(
    accel: Any, ray: boxes.BoxRay, origin: Vec, direction: Vec, t_min: Lane, until: Lane, left: int,
    visible_bit: int, any_hit: bool, best: Hit,
) -> Hit:  # fmt: skip
    """`best`, or what the rays whose bits are set in `left` meet first in the tree where that comes first."""
    kept, found, numbers = simd.stack_array(np.float64, _ROWS), simd.stack_array(np.float64, _FOUND), simd.stack_array(np.int64, _NUMBERS)
    _store3(kept, 0, ray.near)
    _store3(kept, 3, ray.far)
    _store3(kept, 6, ray.inverse)
    _store3(kept, 9, origin)
    _store3(kept, 12, direction)
    across.store(kept, 15, t_min)
    across.store(kept, 16, until)
    across.store(found, 0, best.t)
    across.store(found, 1, best.u)
    across.store(found, 2, best.v)
    across.store(numbers, 0, best.instance)
    across.store(numbers, 1, best.primitive)
    rays = walk.room()
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
        _one(accel, kept, found, numbers, rays, k, visible_bit, any_hit)
    return Hit(across.load(found, 0), across.load(numbers, 0), across.load(numbers, 1), across.load(found, 1), across.load(found, 2))


@helper
def _store3(table: Any, row: int, value: Vec) -> None:
    across.store(table, row, value[0])
    across.store(table, row + 1, value[1])
    across.store(table, row + 2, value[2])


@helper
def _one(accel: Any, kept: Any, found: Any, numbers: Any, rays: walk.Rays, k: int, visible_bit: int, any_hit: bool) -> None:
    """Write what ray k meets in the tree to its places in `found` and `numbers`, where that comes before what stands there."""
    nodes, links = accel.top.nodes, accel.top.links
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float64, DEPTH)
    ray, t_min = _bundle(kept, k), _at(kept, 15, k)
    limit = min(simd.read(found, k), _at(kept, 16, k))
    top, node = np.int64(0), np.int64(0)
    while True:
        if node >= 0:
            near, hits = boxes.enter_eight(nodes, node, ray, t_min, limit)
            if hits != 0:
                node, top = walk.nearest_first(links, node, near, hits, children, reaches, top)
                continue
        elif (accel.placed[~node, 0] & visible_bit) != 0:
            i = ~node
            t, primitive, u, v = _meet(accel, i, kept, rays, k, t_min, limit, any_hit)
            if t < np.inf and (t < simd.read(found, k) or (t == simd.read(found, k) and i < simd.read(numbers, k))):
                limit = t
                simd.write(found, k, t)
                simd.write(found, _LANES + k, u)
                simd.write(found, 2 * _LANES + k, v)
                simd.write(numbers, k, i)
                simd.write(numbers, _LANES + k, primitive)
                if any_hit:
                    return
        while top > 0 and simd.read(reaches, top - 1) > limit:
            top -= 1
        if top == 0:
            return
        top -= 1
        node = np.int64(simd.read(children, top))


@helper
def _meet(accel: Any, i: int, kept: Any, rays: walk.Rays, k: int, t_min: Any, until: Any, any_hit: bool) -> tuple[Any, Any, Any, Any]:
    """(t, primitive, u, v) of ray k's first meeting with instance i, not beyond `until`."""
    row, g, kind = accel.placed[i, 1], accel.placed[i, 2], accel.placed[i, 3]
    origin, direction = (_at(kept, 9, k), _at(kept, 10, k), _at(kept, 11, k)), (_at(kept, 12, k), _at(kept, 13, k), _at(kept, 14, k))
    if kind == MESH:
        o = lanes.sub(lanes.transform_point(accel.inverse, row, origin), (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
        d = lanes.transform_vector(accel.inverse, row, direction)
        ray = boxes.local_ray(o, d)
        enters = boxes.enter(accel.boxes, g, ray, t_min, until)
        if not enters < np.inf:
            return np.inf, np.int64(-1), 0.0, 0.0
        walk.keep(rays, k, o, d, ray.inverse, enters, t_min, _at(kept, 16, k), until)
        met = walk.down(accel.wide, np.int64(accel.placed[i, 4]), rays, k, any_hit)
        return met.t, met.triangle, met.u, met.v
    zero = across.load(kept, 15)
    wide_origin, wide_direction = lanes.like3(zero, *origin), lanes.like3(zero, *direction)
    o = lanes.transform_point(accel.inverse, row, wide_origin)
    d = lanes.transform_vector(accel.inverse, row, wide_direction)
    t, part, u, v = _meet_shape(accel, kind, g, o, d, lanes.full_like(zero, t_min), lanes.full_like(zero, _at(kept, 16, k)))
    return across.lane(t, 0), np.int64(across.lane(part, 0)), across.lane(u, 0), across.lane(v, 0)


@apart
def _meet_shape(accel, kind, g, o, d, t_min, t_max):
    """meeting.shape as a function of its own: rays one by one call it with one ray in all lanes."""
    return meeting.shape(accel, kind, g, o, d, t_min, t_max)


@helper
def _bundle(kept: Any, k: int) -> Bundle:
    x, y, z = _at(kept, 6, k), _at(kept, 7, k), _at(kept, 8, k)
    inverse = (simd.f64x8(x), simd.f64x8(y), simd.f64x8(z))
    near = (simd.f64x8(_at(kept, 0, k)), simd.f64x8(_at(kept, 1, k)), simd.f64x8(_at(kept, 2, k)))
    far = (simd.f64x8(_at(kept, 3, k)), simd.f64x8(_at(kept, 4, k)), simd.f64x8(_at(kept, 5, k)))
    return Bundle(near, far, inverse, inverse, boxes.rows_of(x > 0.0, y > 0.0, z > 0.0))


@helper
def _at(kept: Any, row: int, k: int) -> Any:
    return simd.read(kept, row * _LANES + k)
