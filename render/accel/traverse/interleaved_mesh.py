"""Rays through one mesh, each for itself and in turns, from a root that they share."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from ... import simd
from ...jit.kernel import HELPER, helper, noinline_helper
from ...lanes import crosslane, ops
from ...types import Hit, Lane, Vec
from . import entry_point, ray_box, single_ray


def intersect_mesh(
    tree: Any, begins: Any, o: Vec, d: Vec, ray: ray_box.BoxRay, enters: Lane, t_min: Lane, t_max: Lane, until: Lane, reach: Lane,
    left: int, alike: bool, any_hit: bool,
) -> Hit:  # fmt: skip
    """What the rays whose bits are set in `left` meet, of a vector or two side by side; of which instance nobody asks. In kernels.

    The mesh's tree begins at `begins`; the rest is as shared_root.make and walk.keep want it.
    """
    raise NotImplementedError


@overload(intersect_mesh, jit_options=HELPER)
def _meet(tree, begins, o, d, ray, enters, t_min, t_max, until, reach, left, alike, any_hit):
    if crosslane.is_twice(enters):

        def of_two(tree, begins, o, d, ray, enters, t_min, t_max, until, reach, left, alike, any_hit):
            root, rays, low, high = entry_point.room(), single_ray.room(), simd.low_half, simd.high_half
            entry_point.make(root, tree, begins, o, d, ray, enters, until, left, alike)
            like, steep = low(enters), crosslane.low3(ray.inverse)
            mine = crosslane.mask_of(left & ((1 << crosslane.WIDTH) - 1), like)
            single_ray.keep(rays, 0, mine, crosslane.low3(o), crosslane.low3(d), steep, like, low(t_min), low(t_max), low(until), reach)
            mine, steep = crosslane.mask_of(left >> crosslane.WIDTH, like), crosslane.high3(ray.inverse)
            single_ray.keep(
                rays, 1, mine, crosslane.high3(o), crosslane.high3(d), steep, high(enters), high(t_min), high(t_max), high(until), reach
            )
            return _two(tree, root, rays, left, like, any_hit)

        return of_two

    def of_one(tree, begins, o, d, ray, enters, t_min, t_max, until, reach, left, alike, any_hit):
        root, rays = entry_point.room(), single_ray.room()
        entry_point.make(root, tree, begins, o, d, ray, enters, until, left, alike)
        single_ray.keep(rays, 0, crosslane.mask_of(left, enters), o, d, ray.inverse, enters, t_min, t_max, until, reach)
        return _one(tree, root, rays, left, enters, any_hit)

    return of_one


@helper
def _one(tree: Any, root: entry_point.Root, rays: single_ray.Rays, left: int, like: Lane, any_hit: bool) -> Hit:
    steps = single_ray.allocate_state()
    _unmet(steps, 0, like)
    _through(tree, root, rays, steps, left, any_hit)
    return single_ray.met(steps, 0)


@helper
def _two(tree: Any, root: entry_point.Root, rays: single_ray.Rays, left: int, like: Lane, any_hit: bool) -> Hit:
    steps = single_ray.allocate_state()
    _unmet(steps, 0, like)
    _unmet(steps, 1, like)
    _through(tree, root, rays, steps, left, any_hit)
    a, b = single_ray.met(steps, 0), single_ray.met(steps, 1)
    return Hit(
        simd.joined(a.t, b.t), simd.joined(a.instance, b.instance), simd.joined(a.primitive, b.primitive), simd.joined(a.u, b.u),
        simd.joined(a.v, b.v),
    )  # fmt: skip


@helper
def _unmet(steps: single_ray.TraversalState, part: int, like: Lane) -> None:
    zero = 0.0 * like
    nothing = ops.int_like(zero, -1)
    single_ray.set_out(steps, part, zero + np.inf, nothing, nothing, zero, zero)


@helper
def _through(tree: Any, root: entry_point.Root, rays: single_ray.Rays, steps: single_ray.TraversalState, left: int, any_hit: bool) -> None:
    todo = left
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if not single_ray.begin(tree, root.nodes, root.links, rays, steps, k, any_hit):
            left &= ~(1 << k)
    _turns(tree, rays, steps, left, any_hit)


@noinline_helper
def _turns(tree, rays, steps, left, any_hit):
    """Let rays whose bits are set in `left` go on to their ends: a step of each, and again."""
    while left != 0:
        todo = left
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            if not single_ray.traverse_step(tree, rays, steps, k, 0, any_hit):
                left &= ~(1 << k)
