"""Two vectors of rays at once: where a scene is one mesh, those that go one way through it are one bundle, twice as large.

A node's boxes and most triangles are then tested in single precision against all of them, at what one vector of doubles costs. Others
go each for itself, in twice as many turns, so that there is more to do while one waits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from .. import simd
from ..jit.kernel import HELPER, helper
from ..jit.packed_struct import skip_when_tagged
from ..lanes import crosslane, ops
from ..types import Hit, Lane, Ray, Vec
from . import intersect
from .build import tlas as over
from .build.scene_layout import NO_MESHES, REACH
from .traverse import interleaved_mesh, motion_alpha, packet, packet_nodes, ray_box, two_level


def find(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    """What two vectors of rays meet, each as trace.find tells for itself: in kernels."""
    raise NotImplementedError


@overload(find, jit_options=HELPER)
def _find(accel, first, second, visible_bit, any_hit):
    if crosslane.WIDTH == 1 or motion_alpha.is_used(accel):
        return lambda accel, first, second, visible_bit, any_hit: _each(accel, first, second, visible_bit, any_hit)
    return lambda accel, first, second, visible_bit, any_hit: _both(accel, first, second, visible_bit, any_hit)


@helper
def _each(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    all_ = ops.bool_like(first.t_min, True)
    return intersect.find(accel, first, all_, visible_bit, any_hit), intersect.find(accel, second, all_, visible_bit, any_hit)


class Seen(NamedTuple):
    """Two vectors of rays as a mesh sees them; those whose bits are set in `left` enter its box."""

    o: Vec
    d: Vec
    ray: ray_box.BoxRay
    enters: Lane
    t_min: Lane
    t_max: Lane
    left: int
    alike: bool  # see bundle.py


@skip_when_tagged(NO_MESHES, _each)
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
    origin, direction = crosslane.joined3(first.origin, second.origin), crosslane.joined3(first.direction, second.direction)
    t_min, t_max = simd.joined(first.t_min, second.t_min), simd.joined(first.t_max, second.t_max)
    o, d = over.local(accel.top, origin, direction)
    ray, active = ray_box.world_ray(o, d), t_max > t_min
    if not two_level.is_narrow(ray, direction, active, crosslane.bits(active)):
        return _each(accel, first, second, visible_bit, any_hit)
    zero = 0.0 * t_min
    nothing = Hit(zero + np.inf, ops.int_like(zero, -1), ops.int_like(zero, -1), zero, zero)
    until = ops.where(active, t_max, zero - np.inf)
    return _halves(two_level.traverse_packet(accel, ray, origin, direction, t_min, until, visible_bit, any_hit, True, nothing))


@helper
def seen(accel: Any, i: int, first: Ray, second: Ray) -> Seen:
    """Rays as the mesh of instance i sees them."""
    g = np.int64(accel.placed[i, 2])
    o, d = two_level.in_frame(
        accel, i, crosslane.joined3(first.origin, second.origin), crosslane.joined3(first.direction, second.direction)
    )
    o = two_level.from_middle(accel, g, o)
    t_min, t_max = simd.joined(first.t_min, second.t_min), simd.joined(first.t_max, second.t_max)
    ray, enters, left = two_level.entering(accel, g, o, d, t_min, t_max)
    return Seen(o, d, ray, enters, t_min, t_max, left, packet.is_coherent(left, d, ray))


@helper
def as_bundle(accel: Any, i: int, rays: Seen, any_hit: bool) -> tuple[Hit, bool]:
    """(What rays meet of the mesh of instance i, if they go as one; whether they do, or there are none.)"""
    t, triangle, u, v = packet_nodes.nothing(rays.enters)
    asked = rays.left == 0
    if rays.alike:
        g, root = np.int64(accel.placed[i, 2]), np.int64(accel.placed[i, 4])
        t, triangle, u, v, asked = packet_nodes.intersect_mesh_packet(
            accel, g, root, rays.o, rays.d, rays.ray, rays.enters, rays.t_min, rays.t_max, rays.t_max, rays.left, any_hit
        )
    return Hit(t, triangle, triangle, u, v), asked


@helper
def _in_turns(accel: Any, i: int, rays: Seen, any_hit: bool) -> Hit:
    """The same of each for itself."""
    root, reach = np.int64(accel.placed[i, 4]), accel.boxes[np.int64(accel.placed[i, 2]), REACH]
    return interleaved_mesh.intersect_mesh(
        accel.wide, root, rays.o, rays.d, rays.ray, rays.enters, rays.t_min, rays.t_max, rays.t_max, reach, rays.left, rays.alike, any_hit
    )


@helper
def _of_instance(hit: Hit, i: int) -> Hit:
    return Hit(hit.t, ops.where(hit.t < np.inf, ops.int_like(hit.t, i), ops.int_like(hit.t, -1)), hit.primitive, hit.u, hit.v)


@helper
def _halves(hit: Hit) -> tuple[Hit, Hit]:
    low, high = simd.low_half, simd.high_half
    return (
        Hit(low(hit.t), low(hit.instance), low(hit.primitive), low(hit.u), low(hit.v)),
        Hit(high(hit.t), high(hit.instance), high(hit.primitive), high(hit.u), high(hit.v)),
    )
