"""Two vectors of rays at once: where a scene is one mesh, those that go one way through it are one bundle, twice as large.

A node's boxes and most triangles are then tested in single precision against all of them, at what one vector of doubles costs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from . import across, bundle, bundle_walk, lanes, simd, trace, traverse
from .bvh import NO_MESHES
from .handles import unless
from .kernels import HELPER, helper
from .records import Hit, Lane, Ray, Vec


def find(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    """What two vectors of rays meet, each as trace.find tells for itself: in kernels."""
    raise NotImplementedError


@overload(find, jit_options=HELPER)
def _find(accel, first, second, visible_bit, any_hit):
    if across.WIDTH == 1:
        return lambda accel, first, second, visible_bit, any_hit: _each(accel, first, second, visible_bit, any_hit)
    return lambda accel, first, second, visible_bit, any_hit: _both(accel, first, second, visible_bit, any_hit)


@helper
def _each(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    all_ = lanes.bool_like(first.t_min, True)
    return trace.find(accel, first, all_, visible_bit, any_hit), trace.find(accel, second, all_, visible_bit, any_hit)


@unless(NO_MESHES, _each)
@helper
def _both(accel: Any, first: Ray, second: Ray, visible_bit: int, any_hit: bool) -> tuple[Hit, Hit]:
    i = np.int64(accel.alone)
    if i >= 0 and accel.placed[i, 0] & visible_bit != 0:
        t_min, t_max = simd.joined(first.t_min, second.t_min), simd.joined(first.t_max, second.t_max)
        o, d = joined3(first.origin, second.origin), joined3(first.direction, second.direction)
        hit, asked = as_bundle(accel, i, o, d, t_min, t_max, any_hit)
        if asked:
            return _halves(hit)
    return _each(accel, first, second, visible_bit, any_hit)


@helper
def as_bundle(accel: Any, i: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, any_hit: bool) -> tuple[Hit, bool]:
    """(What rays meet of instance i, a mesh; whether they were asked.)"""
    g = np.int64(accel.placed[i, 2])
    o, d = traverse.in_frame(accel, i, origin, direction)
    o = traverse.from_middle(accel, g, o)
    ray, enters, left = traverse.entering(accel, g, o, d, t_min, t_max)
    t, triangle, u, v = bundle_walk.nothing(enters)
    asked = left == 0
    if not asked and bundle.alike(left, d, ray):
        root = np.int64(accel.placed[i, 4])
        t, triangle, u, v, asked = bundle_walk.meet(accel, g, root, o, d, ray, enters, t_min, t_max, t_max, left, any_hit)
    instance = lanes.where(t < np.inf, lanes.int_like(t, i), lanes.int_like(t, -1))
    return Hit(t, instance, triangle, u, v), asked


@helper
def joined3(a: Vec, b: Vec) -> Vec:
    return simd.joined(a[0], b[0]), simd.joined(a[1], b[1]), simd.joined(a[2], b[2])


@helper
def _halves(hit: Hit) -> tuple[Hit, Hit]:
    low, high = simd.low_half, simd.high_half
    return (
        Hit(low(hit.t), low(hit.instance), low(hit.primitive), low(hit.u), low(hit.v)),
        Hit(high(hit.t), high(hit.instance), high(hit.primitive), high(hit.u), high(hit.v)),
    )
