"""Traversal of a mesh's BVH by a packet: one interval test of a node's boxes for all its rays.

Intervals of origins and inverse directions hold all rays, so one test decides whether any ray may enter a box (Reshetov, Soupikov & Hurley,
"Multi-Level Ray Tracing Algorithm", 2005).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import ops
from ...types import Lane, Vec
from ..bvh_build.scene_layout import EXTENT, LEAF_EXTENT
from ..bvh_build.wide_bvh import DEPTH, NODE, WIDTH, spread32
from . import node_stack, packet, packet_leaves, ray_box, ray_state, single_ray, triangle_filter
from .packet_leaves import EDGES

_FAR = np.float32(ray_state.FAR)


class Beam(NamedTuple):
    """Intervals of rays for the boxes of a node: lower and upper bounds of t at a plane ahead, as scale · plane + shift."""

    first: Vec  # scale of the lower bound
    first_shift: Vec
    last: Vec  # scale of the upper bound
    last_shift: Vec
    near: tuple[int, int, int]  # rows of the node's near planes


@helper
def make_beam(rays: packet.Packet) -> Beam:
    """The intervals of a packet for node tests."""
    ax, bx, cx, dx = _bounds(rays, 0)
    ay, by, cy, dy = _bounds(rays, 1)
    az, bz, cz, dz = _bounds(rays, 2)
    return Beam((ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), ray_box.near_rows(rays.up[0], rays.up[1], rays.up[2]))


@helper
def _bounds(rays: packet.Packet, axis: int) -> tuple[Lane, Lane, Lane, Lane]:
    """The scales and shifts of an axis. t of a plane ahead is least for the nearest origin and the smallest inverse direction."""
    origin, inverse = rays.origin[axis], rays.inverse[axis]
    mask = simd.mask_from_bits(rays.active, origin)
    origin, inverse = simd.select(mask, origin, simd.lane(origin, rays.k)), simd.select(mask, inverse, simd.lane(inverse, rays.k))
    low, high, least, most = simd.min_of(origin), simd.max_of(origin), simd.min_of(inverse), simd.max_of(inverse)
    if not rays.up[axis]:
        low, high, least, most = high, low, most, least
    return spread32(least), spread32(-high * least), spread32(most), spread32(-low * most)


@helper
def intersect_boxes(nodes: Any, node: int, beam: Beam, limit: Any) -> tuple[Lane, int]:
    """(earliest entry distance of each box of a node, bits of the boxes that a ray may enter before `limit`)."""
    start = node * NODE
    x, y, z = beam.near
    near = simd.maximum(
        simd.maximum(_plane(nodes, start + x, beam.first, beam.first_shift, 0), _plane(nodes, start + y, beam.first, beam.first_shift, 1)),
        simd.maximum(_plane(nodes, start + z, beam.first, beam.first_shift, 2), spread32(0.0)),
    )
    far = simd.minimum(
        simd.minimum(
            _plane(nodes, start + (x ^ WIDTH), beam.last, beam.last_shift, 0),
            _plane(nodes, start + (y ^ WIDTH), beam.last, beam.last_shift, 1)
        ),
        _plane(nodes, start + (z ^ WIDTH), beam.last, beam.last_shift, 2),
    )
    return near, simd.bits(near <= simd.minimum(far * _FAR, spread32(limit)))


@helper
def _plane(nodes: Any, element: int, scale: Vec, shift: Vec, axis: int) -> Lane:
    return simd.fma(simd.load(nodes, element, WIDTH), scale[axis], shift[axis])


@helper
def intersect_mesh_packet(
    accel: Any, g: int, root: int, rays: ray_box.MeshRays, active: int, any_hit: bool
) -> tuple[Lane, Lane, Lane, Lane, bool]:
    """(t, triangle, u, v, whether the packet was traced) of coherent rays with mesh g, whose BVH starts at `root`.

    A packet is not traced where its rays are too far apart. Only rays whose bits are set in `active` count. With `any_hit`, only t < inf
    and the triangle are valid.
    """
    tree, leaf_extent, extent = accel.wide, accel.boxes[g, LEAF_EXTENT], accel.boxes[g, EXTENT]
    none, shear = no_hits(rays.enters), packet.shear_packet(active, rays.direction, rays.box)
    if not packet.may_share_leaves(shear, active, rays.origin, leaf_extent, any_hit):
        return *none, False
    group = packet.make_packet(active, shear.k, rays)
    limits = simd.select(simd.mask_from_bits(active, group.limits), group.limits, np.float32(-np.inf))
    beam = make_beam(group)
    near, hits = intersect_boxes(tree.nodes, root, beam, simd.max_of(limits))
    if hits == 0:
        return *none, True
    central = packet.central_ray(group, shear, np.float32(2.0 * triangle_filter.OFF) * np.float32(extent))
    if not packet.share_leaves(central, active, extent, leaf_extent, any_hit):
        return *none, False
    leaf_rays = packet_leaves.prepare_rays(group, shear, central, rays)
    best = _traverse(tree, root, near, hits, beam, central, leaf_rays, packet_leaves.no_hits(leaf_rays, central, limits), any_hit)
    return best.t, best.triangle, best.v / best.total, best.w / best.total, True


@helper
def _traverse(
    tree: Any, root: int, near: Lane, hits: int, beam: Beam, central: packet.CentralRay, rays: packet_leaves.LeafRays,
    best: packet_leaves.PacketHits, any_hit: bool,
) -> packet_leaves.PacketHits:  # fmt: skip
    """The hits of a packet that enters the boxes `hits` of the root at `near`."""
    central_filter, limit = packet_leaves.central_filter(central), simd.max_of(best.limits)
    edges = simd.stack_array(np.float32, EDGES)
    stack, distances = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    node, top = node_stack.descend_nearest(tree.links, root, near, hits, stack, distances, np.int64(0))
    while top >= 0:
        if node >= 0:
            near, hits = intersect_boxes(tree.nodes, node, beam, limit)
            node, top = node_stack.descend_nearest(tree.links, node, near, hits, stack, distances, top)
            _prefetch_top(tree, stack, top)
        else:
            leaf, before = ~node, limit
            _prefetch_top(tree, stack, top)
            hits = packet_leaves.cull_triangles(tree.leaves, leaf, central, central_filter, limit, edges)
            best = packet_leaves.intersect_triangles(tree.leaves, leaf, hits, rays, central, best, any_hit, edges)
            limit = simd.max_of(best.limits)
            if limit < before:
                top = node_stack.cull(stack, distances, 0, top, limit)
            node, top = node_stack.pop(stack, top)
    return packet_leaves.finish_any(tree.leaves, rays, best) if any_hit else best


@helper
def _prefetch_top(tree: Any, stack: Any, top: int) -> None:
    """Prefetch the last entry of the stack, if it is a leaf."""
    single_ray.prefetch_leaf(tree, np.int64(simd.read(stack, max(top - 1, 0))) if top > 0 else 0)


@helper
def no_hits(enters: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, triangle, u, v) of rays without a hit."""
    zero = 0.0 * enters
    return zero + np.inf, ops.int_like(zero, -1), zero, zero
