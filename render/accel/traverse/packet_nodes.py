"""Rays that go one way through a mesh's tree: boxes and triangles are tested against all of them at once.

Intervals of origins and of inverse directions hold all rays, so that one test says whether any of them may enter a box (Reshetov,
Soupikov & Hurley, "Multi-Level Ray Tracing Algorithm", 2005). What they meet in leaves: bundle_leaves.py.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import ops
from ...types import Lane, Vec
from ..build.scene_layout import FINE, REACH
from ..build.wide_bvh import DEPTH, NODE, WIDTH, spread32
from . import packet, ray_box, single_ray, triangle_filter
from . import packet_leaves as triangles
from .packet_leaves import EDGES

_FAR = np.float32(single_ray.FAR)


class Beam(NamedTuple):
    """Rays as intervals, for a node's boxes: t of a plane from below and from above where it is not behind; see walk.Box for the rows."""

    first: Vec  # least 1 / direction
    first_shift: Vec
    last: Vec
    last_shift: Vec
    near: tuple[int, int, int]


@helper
def beam_of(rays: packet.Group) -> Beam:
    ax, bx, cx, dx = _interval(rays, 0)
    ay, by, cy, dy = _interval(rays, 1)
    az, bz, cz, dz = _interval(rays, 2)
    return Beam((ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), ray_box.rows_of(rays.up[0], rays.up[1], rays.up[2]))


@helper
def _interval(rays: packet.Group, axis: int) -> tuple[Lane, Lane, Lane, Lane]:
    """What a beam holds of an axis. t of a plane ahead is least for the ray that begins nearest to it and is the steepest."""
    origin, inverse = rays.origin[axis], rays.inverse[axis]
    mine = simd.mask_from_bits(rays.left, origin)
    origin, inverse = simd.select(mine, origin, simd.lane(origin, rays.k)), simd.select(mine, inverse, simd.lane(inverse, rays.k))
    low, high, least, most = simd.min_of(origin), simd.max_of(origin), simd.min_of(inverse), simd.max_of(inverse)
    if not rays.up[axis]:
        low, high, least, most = high, low, most, least
    return spread32(least), spread32(-high * least), spread32(most), spread32(-low * most)


@helper
def enter(nodes: Any, node: int, beam: Beam, limit: Any) -> tuple[Lane, int]:
    """Where the first ray may enter a node's boxes, and bits of those that one may enter before `limit`."""
    at = node * NODE
    x, y, z = beam.near
    near = simd.maximum(
        simd.maximum(_plane(nodes, at + x, beam.first, beam.first_shift, 0), _plane(nodes, at + y, beam.first, beam.first_shift, 1)),
        simd.maximum(_plane(nodes, at + z, beam.first, beam.first_shift, 2), spread32(0.0)),
    )
    far = simd.minimum(
        simd.minimum(
            _plane(nodes, at + (x ^ WIDTH), beam.last, beam.last_shift, 0), _plane(nodes, at + (y ^ WIDTH), beam.last, beam.last_shift, 1)
        ),
        _plane(nodes, at + (z ^ WIDTH), beam.last, beam.last_shift, 2),
    )
    return near, simd.bits(near <= simd.minimum(far * _FAR, spread32(limit)))


@helper
def _plane(nodes: Any, at: int, scale: Vec, shift: Vec, axis: int) -> Lane:
    return simd.fma(simd.load(nodes, at, WIDTH), scale[axis], shift[axis])


@helper
def intersect_mesh_packet(
    accel: Any, g: int, root: int, o: Vec, d: Vec, ray: ray_box.BoxRay, enters: Lane, t_min: Lane, t_max: Lane, until: Lane, left: int,
    any_hit: bool,
) -> tuple[Lane, Lane, Lane, Lane, bool]:  # fmt: skip
    """(t, triangle, u, v) of what rays that are `bundle.alike` meet first of mesh g, and whether they were asked: not if too far apart.

    Those count whose bits are set in `left`, and enter the mesh's box at `enters`; its tree begins at `root`. Nothing beyond `until` is
    asked for. With `any_hit`, t < inf and the triangle tell that something is met.
    """
    tree, fine, reach = accel.wide, accel.boxes[g, FINE], accel.boxes[g, REACH]
    unmet, go = nothing(enters), packet.way(left, d, ray)
    if not packet.may_be_close(go, left, o, fine, any_hit):
        return *unmet, False
    rays = packet.group(left, go.k, o, d, ray, enters, until)
    limits = simd.select(simd.mask_from_bits(left, rays.limits), rays.limits, np.float32(-np.inf))
    beam, limit = beam_of(rays), simd.max_of(limits)
    near, hits = enter(tree.nodes, root, beam, limit)
    if hits == 0:
        return *unmet, True
    core = packet.core_of(rays, go, np.float32(2.0 * triangle_filter.OFF) * np.float32(reach))
    if not packet.share_leaves(core, left, reach, fine, any_hit):
        return *unmet, False
    middle, asked = triangles.middle(core), triangles.rays_of(rays, go, core, o, d, enters, t_min, t_max)
    found = triangles.nothing(asked, core, limits)
    edges = simd.stack_array(np.float32, EDGES)
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    node, top = single_ray.nearest_first(tree.links, root, near, hits, children, reaches, np.int64(0))
    while top >= 0:
        if node >= 0:
            near, hits = enter(tree.nodes, node, beam, limit)
            node, top = single_ray.nearest_first(tree.links, node, near, hits, children, reaches, top)
            _fetch_last(tree, children, top)
        else:
            leaf, before = ~node, limit
            _fetch_last(tree, children, top)
            hits = triangles.cull_triangles(tree.leaves, leaf, core, middle, limit, edges)
            found = triangles.take(tree.leaves, leaf, hits, asked, core, found, any_hit, edges)
            limit = simd.max_of(found.limits)
            if limit < before:
                top = single_ray.sifted(children, reaches, 0, top, limit)
            node, top = single_ray.last_of(children, top)
    found = triangles.settled(tree.leaves, asked, core, found, any_hit)
    return found.t, found.triangle, found.v / found.total, found.w / found.total, True


@helper
def _fetch_last(tree: Any, children: Any, top: int) -> None:
    """Ask for what is last on the stack, which will be read soon."""
    single_ray.prefetch_node(tree, np.int64(simd.read(children, max(top - 1, 0))) if top > 0 else 0)


@helper
def nothing(enters: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(t, triangle, u, v) of rays that meet nothing."""
    zero = 0.0 * enters
    return zero + np.inf, ops.int_like(zero, -1), zero, zero
