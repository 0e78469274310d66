"""Rays through one mesh, each for itself and in turns, from a root that they share."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import lanes, shared_root, simd, walk
from .kernels import apart, helper
from .records import Hit, Lane


@helper
def one(tree: Any, root: shared_root.Root, rays: walk.Rays, left: int, like: Lane, any_hit: bool) -> Hit:
    """What the rays whose bits are set in `left` meet, all in the first vector; of which instance nobody asks."""
    steps = walk.ways()
    _unmet(steps, 0, like)
    _through(tree, root, rays, steps, left, any_hit)
    return walk.met(steps, 0)


@helper
def two(tree: Any, root: shared_root.Root, rays: walk.Rays, left: int, like: Lane, any_hit: bool) -> tuple[Hit, Hit]:
    """The same of two vectors of rays."""
    steps = walk.ways()
    _unmet(steps, 0, like)
    _unmet(steps, 1, like)
    _through(tree, root, rays, steps, left, any_hit)
    return walk.met(steps, 0), walk.met(steps, 1)


@helper
def _unmet(steps: walk.Walks, part: int, like: Lane) -> None:
    zero = 0.0 * like
    nothing = lanes.int_like(zero, -1)
    walk.set_out(steps, part, zero + np.inf, nothing, nothing, zero, zero)


@helper
def _through(tree: Any, root: shared_root.Root, rays: walk.Rays, steps: walk.Walks, left: int, any_hit: bool) -> None:
    todo = left
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if not walk.begin(tree, root.nodes, root.links, rays, steps, k, any_hit):
            left &= ~(1 << k)
    _turns(tree, rays, steps, left, any_hit)


@apart
def _turns(tree, rays, steps, left, any_hit):
    """Let rays whose bits are set in `left` go on to their ends: a step of each, and again."""
    while left != 0:
        todo = left
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            if not walk.step(tree, rays, steps, k, 0, any_hit):
                left &= ~(1 << k)
