"""Rays through one mesh, each for itself and in turns, from a root that they share."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import lanes, shared_root, simd, walk
from .kernels import apart, helper
from .records import Hit, Lane

MANY = 5 * walk.RAYS // 8  # rays that wait at leaves until these are met


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
    todo, leaves = left, 0
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        start = k * walk.STACK
        walk.enter(steps, k, 0, start)
        node, more = walk.pass_boxes(tree, root.nodes, root.links, 0, rays, steps, k, start, any_hit)
        left &= ~(_bit(not more) << k)
        leaves |= _bit(node < 0) << k
    _turns(tree, rays, steps, left, leaves & left, any_hit)


@helper
def _bit(true: Any) -> int:
    return 1 if true else 0


@apart
def _turns(tree, rays, steps, left, leaves, any_hit):
    """Let rays whose bits are set in `left` go on to their ends, of which those in `leaves` are at one.

    Those that come to a leaf wait for others there: in either loop nothing is to be guessed.
    """
    while left != 0:
        todo = left & ~leaves
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            node, more = walk.pass_node(tree, rays, steps, k, any_hit)
            left &= ~(_bit(not more) << k)
            leaves |= _bit(node < 0) << k
        leaves &= left
        if leaves != left and simd.population(leaves) < MANY:
            continue
        todo = leaves
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            node, more = walk.pass_leaf(tree, rays, steps, k, 0, any_hit)
            left &= ~(_bit(not more) << k)
            leaves &= ~(_bit(node >= 0) << k)
        leaves &= left
