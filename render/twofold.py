"""Two vectors of rays at once: where a scene is one mesh, those that go one way through it are one bundle, twice as large.

A node's boxes and most triangles are then tested in single precision against all of them, at what one vector of doubles costs. Others
go each for itself, in twice as many turns, so that there is more to do while one waits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from . import across, aside, boxes, bundle, bundle_walk, in_mesh, lanes, simd, trace, traverse
from . import top as over
from .bvh import NO_MESHES, REACH
from .handles import unless
from .kernels import HELPER, helper
from .records import Hit, Lane, Ray, Vec


def find(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    """What two vectors of rays meet, each as trace.find tells for itself: in kernels."""
    raise NotImplementedError


@overload(find, jit_options=HELPER)
def _find(accel, first, second, visible_bit, any_hit):
    if across.WIDTH == 1 or aside.is_used(accel):
        return lambda accel, first, second, visible_bit, any_hit: _each(accel, first, second, visible_bit, any_hit)
    return lambda accel, first, second, visible_bit, any_hit: _both(accel, first, second, visible_bit, any_hit)


@helper
def _each(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    all_ = lanes.bool_like(first.t_min, True)
    return trace.find(accel, first, all_, visible_bit, any_hit), trace.find(accel, second, all_, visible_bit, any_hit)


class Seen(NamedTuple):
    """Two vectors of rays as a mesh sees them; those whose bits are set in `left` enter its box."""

    o: Vec
    d: Vec
    ray: boxes.BoxRay
    enters: Lane
    t_min: Lane
    t_max: Lane
    left: int
    alike: bool  # see bundle.py


@unless(NO_MESHES, _each)
@helper
def _both(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    i = np.int64(accel.alone)
    if i < 0:
        return _among(accel, first, second, visible_bit, any_hit)
    if accel.placed[i, 0] & visible_bit == 0:
        return _each(accel, first, second, visible_bit, any_hit)
    rays = seen(accel, i, first, second)
    hit, asked = as_bundle(accel, i, rays, any_hit)
    if not asked:
        hit = _in_turns(accel, i, rays, any_hit)
    one, two = _halves(hit)
    return _of_instance(one, i), _of_instance(two, i)


@helper
def _among(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    """What they meet among many things: shadow rays that go one way, both together; of others nearest things are not the same."""
    if not any_hit or len(accel.endless) > 0 or accel.only >= 0 or len(accel.top.links) == 0:
        return _each(accel, first, second, visible_bit, any_hit)
    origin, direction = across.joined3(first.origin, second.origin), across.joined3(first.direction, second.direction)
    t_min, t_max = simd.joined(first.t_min, second.t_min), simd.joined(first.t_max, second.t_max)
    o, d = over.local(accel.top, origin, direction)
    ray, active = boxes.world_ray(o, d), t_max > t_min
    if not traverse.is_narrow(ray, direction, active, across.bits(active)):
        return _each(accel, first, second, visible_bit, any_hit)
    zero = 0.0 * t_min
    nothing = Hit(zero + np.inf, lanes.int_like(zero, -1), lanes.int_like(zero, -1), zero, zero)
    until = lanes.where(active, t_max, zero - np.inf)
    return _halves(traverse.together(accel, ray, origin, direction, t_min, until, visible_bit, any_hit, True, nothing))


@helper
def seen(accel: Any, i: int, first: Ray, second: Ray) -> Seen:
    """Rays as the mesh of instance i sees them."""
    g = np.int64(accel.placed[i, 2])
    o, d = traverse.in_frame(accel, i, across.joined3(first.origin, second.origin), across.joined3(first.direction, second.direction))
    o = traverse.from_middle(accel, g, o)
    t_min, t_max = simd.joined(first.t_min, second.t_min), simd.joined(first.t_max, second.t_max)
    ray, enters, left = traverse.entering(accel, g, o, d, t_min, t_max)
    return Seen(o, d, ray, enters, t_min, t_max, left, bundle.alike(left, d, ray))


@helper
def as_bundle(accel: Any, i: int, rays: Seen, any_hit: bool) -> tuple[Hit, bool]:
    """(What rays meet of the mesh of instance i, if they go as one; whether they do, or there are none.)"""
    t, triangle, u, v = bundle_walk.nothing(rays.enters)
    asked = rays.left == 0
    if rays.alike:
        g, root = np.int64(accel.placed[i, 2]), np.int64(accel.placed[i, 4])
        t, triangle, u, v, asked = bundle_walk.meet(
            accel, g, root, rays.o, rays.d, rays.ray, rays.enters, rays.t_min, rays.t_max, rays.t_max, rays.left, any_hit
        )
    return Hit(t, triangle, triangle, u, v), asked


@helper
def _in_turns(accel: Any, i: int, rays: Seen, any_hit: bool) -> Hit:
    """The same of each for itself."""
    root, reach = np.int64(accel.placed[i, 4]), accel.boxes[np.int64(accel.placed[i, 2]), REACH]
    return in_mesh.meet(
        accel.wide, root, rays.o, rays.d, rays.ray, rays.enters, rays.t_min, rays.t_max, rays.t_max, reach, rays.left, rays.alike, any_hit
    )


@helper
def _of_instance(hit: Hit, i: int) -> Hit:
    return Hit(hit.t, lanes.where(hit.t < np.inf, lanes.int_like(hit.t, i), lanes.int_like(hit.t, -1)), hit.primitive, hit.u, hit.v)


@helper
def _halves(hit: Hit) -> tuple[Hit, Hit]:
    low, high = simd.low_half, simd.high_half
    return (
        Hit(low(hit.t), low(hit.instance), low(hit.primitive), low(hit.u), low(hit.v)),
        Hit(high(hit.t), high(hit.instance), high(hit.primitive), high(hit.u), high(hit.v)),
    )
