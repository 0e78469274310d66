"""Traversal of a mesh's BVH by one ray at a time, a node or a leaf a step.

Triangles are filtered in float32, with bounds on the rounding error. The remaining ones are tested in float64, one by one, so that each ray
finds the hit that brute force finds. Several rays are interleaved, a step each, which hides memory latency and branch mispredictions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ... import simd
from ...geometry import triangle_hit as flat
from ...jit.kernel import helper
from ...types import Vec
from ..bvh_build.wide_bvh import LEAF, WIDTH, triangle_of
from . import node_stack, ray_state, triangle_filter
from .ray_state import FAR, RAYS, STACK, NodeRay, ShearedRay, StoredRays, TraversalState


@helper
def start_ray(tree: Any, nodes: Any, links: Any, rays: StoredRays, state: TraversalState, k: int, any_hit: bool) -> bool:
    """Visit node 0 of `nodes`, whose links lead into `tree`; return whether ray k enters any child."""
    bottom = k * STACK
    node, top = visit_node(nodes, links, 0, ray_state.node_ray(rays, k), ray_state.limit(rays, k), state, bottom, any_hit)
    prefetch_leaf(tree, node)
    ray_state.set_position(state, k, node, top)
    simd.write(state.position, 2 * RAYS + k, bottom)
    return top >= bottom


@helper
def traverse_step(tree: Any, rays: StoredRays, state: TraversalState, k: int, instance: int, any_hit: bool) -> bool:
    """Visit one node or leaf of ray k, or two nodes for any hit; return whether the traversal goes on."""
    node, top, bottom = simd.read(state.position, k), simd.read(state.position, RAYS + k), simd.read(state.position, 2 * RAYS + k)
    if node >= 0:
        ray, limit = ray_state.node_ray(rays, k), ray_state.limit(rays, k)
        node, top = visit_node(tree.nodes, tree.links, node, ray, limit, state, top, any_hit)
        if any_hit and node >= 0 and top >= bottom:
            node, top = visit_node(tree.nodes, tree.links, node, ray, limit, state, top, any_hit)
    else:
        node, top = _visit_leaf(tree, ~node, rays, state, k, instance, bottom, top, any_hit)
    if top < bottom:
        return False
    prefetch_leaf(tree, node)
    ray_state.set_position(state, k, node, top)
    return True


@helper
def visit_node(
    nodes: Any, links: Any, node: int, ray: NodeRay, limit: Any, state: TraversalState, top: int, any_hit: bool
) -> tuple[Any, int]:
    """(next node, new top of the stack) after a node."""
    near, _, hits = node_stack.intersect_boxes(nodes, node, ray, limit)
    if any_hit:
        return node_stack.descend_any(links, node, hits, state.stack, top)
    return node_stack.descend_nearest(links, node, near, hits, state.stack, state.distances, top)


@helper
def visit_instance_node(
    nodes: Any, links: Any, node: int, ray: NodeRay, limit: Any, state: TraversalState, top: int, any_hit: bool
) -> tuple[Any, int]:
    """`visit_node` in the BVH over instances."""
    near, far, hits = node_stack.intersect_boxes(nodes, node, ray, limit)
    return node_stack.descend_instances(links, node, near, far, hits, state.stack, state.distances, top, any_hit)


@helper
def _visit_leaf(
    tree: Any, leaf: int, rays: StoredRays, state: TraversalState, k: int, instance: int, bottom: int, top: int, any_hit: bool
) -> tuple[Any, int]:
    """(next node, new top) after a leaf; the stack of the mesh starts at `bottom`."""
    if any_hit:
        return _visit_leaf_any(tree, leaf, rays, state, k, instance, top)
    limit = ray_state.limit(rays, k)
    hits, before = triangle_filter.candidates(tree.leaves, leaf, ray_state.filter_ray(rays, k), limit), limit
    limit = _intersect_triangles(tree, leaf, hits, rays, state, k, instance, any_hit, limit)
    if limit < before:
        ray_state.set_limit(rays, k, limit)
        top = node_stack.cull(state.stack, state.distances, bottom, top, limit)
    return node_stack.pop(state.stack, top)


@helper
def _visit_leaf_any(tree: Any, leaf: int, rays: StoredRays, state: TraversalState, k: int, instance: int, top: int) -> tuple[Any, int]:
    """`_visit_leaf` for any hit, without a branch in the usual case."""
    limit, ray = ray_state.limit(rays, k), ray_state.filter_ray(rays, k)
    seen = triangle_filter.evaluate(tree.leaves, leaf, ray)
    may, sure = triangle_filter.may_hit(seen, ray, limit), triangle_filter.surely_hits(seen, ray, limit)
    ends = sure != 0
    before = simd.read(state.hits, k), simd.read(state.ids, k), simd.read(state.ids, RAYS + k)
    number = np.int64(triangle_of(tree.leaves, leaf, simd.trailing_zeros(sure) & (WIDTH - 1)))
    simd.write(state.hits, k, ray_state.entry(rays, k) if ends else before[0])
    simd.write(state.ids, k, instance if ends else before[1])
    simd.write(state.ids, RAYS + k, number if ends else before[2])
    if may != 0 and sure == 0:
        ends = _intersect_triangles(tree, leaf, may, rays, state, k, instance, True, limit) < limit
    node, top = node_stack.pop(state.stack, top)
    return node, -1 if ends else top


@helper
def _intersect_triangles(
    tree: Any, leaf: int, which: int, rays: StoredRays, state: TraversalState, k: int, instance: int, any_hit: bool, limit: Any
) -> Any:
    """Test ray k against the triangles of a leaf whose bits are set; return its new limit."""
    while which != 0:
        j = simd.trailing_zeros(which)
        which &= which - 1
        limit = _intersect_triangle(tree, leaf, j, rays, state, k, instance, any_hit, limit)
    return limit


@helper
def _intersect_triangle(
    tree: Any, leaf: int, j: int, rays: StoredRays, state: TraversalState, k: int, instance: int, any_hit: bool, limit: Any
) -> Any:
    """Test ray k against triangle j of a leaf and record a closer hit; return its new limit."""
    ray = ray_state.sheared_ray(rays, k)
    hit = crossing(tree.leaves, leaf, j, ray)
    if not flat.is_ahead(hit, ray.shear[2]):
        return limit
    t_min, t_max = ray_state.interval(rays, k)
    t = flat.hit_t(hit, ray.shear[2], t_min, t_max)
    number = np.int64(triangle_of(tree.leaves, leaf, j))
    if not ray_state.is_closer(state, k, t, instance, number):
        return limit
    ray_state.set_hit(state, k, t, (hit.v, hit.w, hit.total), instance, number)
    return np.float32(-np.inf) if any_hit else np.float32((t - ray_state.entry(rays, k)) * FAR)


@helper
def crossing(leaves: Any, leaf: int, j: int, ray: ShearedRay) -> flat.Crossing:
    """Where a ray crosses triangle j of a leaf, in double precision."""
    corner = leaf * LEAF + j
    return flat.crossing(
        _corner(leaves, corner, ray), _corner(leaves, corner + 3 * WIDTH, ray), _corner(leaves, corner + 6 * WIDTH, ray), ray.shear[0],
        ray.shear[1],
    )  # fmt: skip


@helper
def _corner(leaves: Any, corner: int, ray: ShearedRay) -> Vec:
    return (
        np.float64(simd.read(leaves, corner + ray.x)) - ray.origin[0], np.float64(simd.read(leaves, corner + ray.y)) - ray.origin[1],
        np.float64(simd.read(leaves, corner + ray.z)) - ray.origin[2],
    )  # fmt: skip


@helper
def prefetch_leaf(tree: Any, node: int) -> None:
    """Prefetch a leaf that is read soon; nothing of a node, which other rays have read before."""
    leaf_start = max(~node, 0) * LEAF
    for line in range((LEAF + 15) // 16):
        simd.prefetch(tree.leaves, leaf_start + line * 16)
