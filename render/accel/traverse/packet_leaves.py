"""Intersection of a packet with the triangles of a leaf: culling for the whole packet, then tests of all rays side by side.

Triangles are culled against the packet, seen along its central ray as a rectangle. For the closest hit, all rays are then tested in double
precision. For any hit, all rays are tested in single precision with error bounds first; only undecided cases go on to double precision. So
each ray's hit is, to the last bit, the hit that it finds alone.

Depth is measured along the main axis, in the rays' direction, from the start of the central ray. The loop over triangles does not branch
on hits: half of such branches are mispredicted.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...geometry import triangle_hit as flat
from ...jit.kernel import helper, make_replace
from ...lanes import ops
from ...types import Lane, Vec
from ..bvh_build.wide_bvh import LEAF, WHICH, WIDTH, spread32, triangle_of
from . import ray_box, ray_state, triangle_filter
from .packet import CentralRay, Packet, PacketShear, component

_FAR = np.float32(ray_state.FAR)
_EDGE = 6 * WIDTH  # floats of one edge of a leaf's triangles, see `_store_edge`
_ERROR, _FIRST, _LAST = 3 * _EDGE, 3 * _EDGE + WIDTH, 3 * _EDGE + 2 * WIDTH  # errors of edge functions; depths of the triangles
_CORNERS = _LAST + WIDTH  # depths of corners a, b, c
EDGES = _CORNERS + 3 * WIDTH  # floats of a leaf's triangles as seen along the central ray


class CentralFilter(NamedTuple):
    """The central ray for triangle_filter.shear_corners."""

    x: int
    y: int
    z: int
    sign: Lane
    origin: Vec
    shear: tuple[Lane, Lane]
    off: Lane


class LeafRays(NamedTuple):
    """A packet for the triangles of leaves: single precision relative to the central ray, double precision from the origins."""

    rows: tuple[int, int, int]  # of a leaf for the shear's axes
    offset: tuple[Lane, Lane]  # x and -y of a ray at depth 0
    slant: tuple[Lane, Lane]  # x and -y growth of `offset` per unit of depth
    twist: Lane  # cross product of offset and slant
    entry_depth: Lane  # of the entry into the mesh's box
    scale: Lane  # t of a unit of depth
    along: Lane  # depth of a unit of t
    first_depth: Lane  # depth from which on a hit certainly has t > t_min
    origin: Vec  # double precision, in the shear's axes
    shear: Vec
    t_min: Lane
    t_max: Lane
    enters: Lane


class PacketHits(NamedTuple):
    """Hits of a packet so far: exact ones, and for any hit those that are certain in single precision."""

    t: Lane
    triangle: Lane
    v: Lane  # weights of the second and third corner, times `total`
    w: Lane
    total: Lane
    certain: Lane  # int32: leaf · WIDTH + triangle of a certain hit, or -1
    nearest: Lane  # float32: depth of a certain hit, or beyond which no hit is certain
    deepest: Lane  # float32: depth up to which each ray goes on
    limits: Lane  # float32: distance from the entry up to which each ray goes on


_replace_certain = make_replace(PacketHits, "certain", "nearest", "deepest", "limits")
_replace_exact = make_replace(PacketHits, "t", "triangle", "v", "w", "total", "deepest", "limits")


@helper
def prepare_rays(group: Packet, shear: PacketShear, central: CentralRay, rays: ray_box.MeshRays) -> LeafRays:
    """Prepare a packet for the triangles of leaves."""
    kx, ky, kz = shear.axes
    o, d, enters = rays.origin, rays.direction, rays.enters
    origin = component(o, kx), component(o, ky), component(o, kz)
    x, dx = _relative_to_central(origin, shear.factors, central, 0)
    y, dy = _relative_to_central(origin, shear.factors, central, 1)
    deep, along = origin[2] + enters * component(d, kz) - np.float64(central.origin[2]), abs(simd.to_f32(component(d, kz)))
    entry_depth = simd.to_f32(deep if central.scale > np.float32(0.0) else -deep)
    return LeafRays(
        (WIDTH * kx, WIDTH * ky, WIDTH * kz), (x, -y), (dx, -dy), simd.fma(x, dy, -(y * dx)), entry_depth,
        abs(simd.to_f32(shear.factors[2])), along, simd.fma(simd.to_f32(rays.t_min - enters), along, entry_depth + central.off),
        origin, shear.factors, rays.t_min, ops.where(simd.mask_from_bits(group.active, enters), rays.t_max, -np.inf), enters,
    )  # fmt: skip


@helper
def _relative_to_central(origin: Vec, factors: Vec, central: CentralRay, axis: int) -> tuple[Lane, Lane]:
    """(offset of rays from the central ray at its start along an axis of the shear, growth of that per unit of depth)."""
    middle, slope = np.float64(central.origin[axis]), np.float64(central.shear[axis])
    position = simd.fma(factors[axis], np.float64(central.origin[2]) - origin[2], origin[axis])
    return simd.to_f32(position - middle), simd.to_f32(factors[axis] - slope)


@helper
def no_hits(rays: LeafRays, central: CentralRay, limits: Lane) -> PacketHits:
    """The state of a packet before the first leaf."""
    zero = 0.0 * rays.enters
    return PacketHits(
        zero + np.inf, ops.int_like(zero, -1), zero, zero, zero + 1.0, simd.to_i32(ops.full_like(limits, np.float32(-1.0))),
        simd.fma(simd.to_f32(rays.t_max - rays.enters), rays.along, rays.entry_depth - central.off), _depth(rays, central, limits), limits,
    )  # fmt: skip


@helper
def _depth(rays: LeafRays, central: CentralRay, t: Lane) -> Lane:
    """Upper bound of the depth at distance t from the entry."""
    return simd.fma(t, rays.along, rays.entry_depth + central.off)


@helper
def central_filter(central: CentralRay) -> CentralFilter:
    """Prepare the central ray for triangle_filter.shear_corners."""
    kx, ky, kz = central.axes
    x, y, z = central.origin
    shear = spread32(central.shear[0]), spread32(central.shear[1])
    origin = spread32(x), spread32(y), spread32(z)
    return CentralFilter(WIDTH * kx, WIDTH * ky, WIDTH * kz, spread32(1.0), origin, shear, spread32(central.off))


# --- culling ---


@helper
def cull_triangles(leaves: Any, leaf: int, central: CentralRay, ray: CentralFilter, limit: Any, edges: Any) -> int:
    """Bits of the triangles of a leaf that a ray of the packet may hit before `limit`; fills `edges` for `_edge_function`.

    Seen along the central ray the packet is a rectangle, of the size that it has at the farther end of a triangle. A triangle is culled
    where one of the rectangle's axes or of its own edges separates the two. The packet's growth along the triangle counts as an error of
    its corners.
    """
    leaf_start, half = leaf * LEAF, np.float32(0.5)
    a, b, c = (
        triangle_filter.shear_corners(leaves, leaf_start, ray),
        triangle_filter.shear_corners(leaves, leaf_start + 3 * WIDTH, ray),
        triangle_filter.shear_corners(leaves, leaf_start + 6 * WIDTH, ray),
    )
    low, high = triangle_filter.min_of_three(a[2], b[2], c[2]), triangle_filter.max_of_three(a[2], b[2], c[2])
    away, long = half * abs(low + high), half * (high - low)
    flare, spread = central.flare, central.spread
    wide, tall = simd.fma(away, flare[0], spread32(spread[0])), simd.fma(away, flare[1], spread32(spread[1]))
    off = simd.fma(long, max(flare[0], flare[1]), ray.off)
    hits = simd.bits(_overlaps(a[0], b[0], c[0], wide + off) & _overlaps(a[1], b[1], c[1], tall + off) & _crosses(a, b, c, wide, tall, off))
    up = central.scale > np.float32(0.0)
    first = low if up else high
    hits &= simd.bits((first * central.scale - central.early * abs(central.scale)) <= limit * _FAR)
    if hits != 0:
        _store_edge(edges, 0, c, b)
        _store_edge(edges, _EDGE, a, c)
        _store_edge(edges, 2 * _EDGE, b, a)
        simd.store(edges, _ERROR, _area_error(a, b, c, simd.fma(long, flare[0], wide) + simd.fma(long, flare[1], tall), ray.off))
        simd.store(edges, _FIRST, (low if up else -high) - ray.off)
        simd.store(edges, _LAST, (high if up else -low) + ray.off)
        simd.store(edges, _CORNERS, a[2] if up else -a[2])
        simd.store(edges, _CORNERS + WIDTH, b[2] if up else -b[2])
        simd.store(edges, _CORNERS + 2 * WIDTH, c[2] if up else -c[2])
    return hits


@helper
def _store_edge(edges: Any, edge: int, p: Vec, q: Vec) -> None:
    """Store the coefficients of `_edge_function` of the edges from p to q."""
    simd.store(edges, edge, triangle_filter.cross(p, q))
    simd.store(edges, edge + WIDTH, p[1] - q[1])
    simd.store(edges, edge + 2 * WIDTH, p[0] - q[0])
    simd.store(edges, edge + 3 * WIDTH, simd.fma(q[2], p[1], -(p[2] * q[1])))
    simd.store(edges, edge + 4 * WIDTH, simd.fma(q[2], p[0], -(p[2] * q[0])))
    simd.store(edges, edge + 5 * WIDTH, q[2] - p[2])


@helper
def _edge_function(edges: Any, edge: int, rays: LeafRays) -> Lane:
    """Twice the area of each ray's crossing point and an edge from p to q, given as the central ray sees them.

    Relative to a ray of offset s and slant d, a corner p is at p - s - d z. The cross product of two corners is
    p × q + s × (p - q) + d × (q_z p - p_z q) + (s × d) (q_z - p_z).
    """
    area = simd.fma(rays.twist, simd.read(edges, edge + 5 * WIDTH), simd.read(edges, edge))
    area = simd.fma(rays.offset[0], simd.read(edges, edge + WIDTH), area)
    area = simd.fma(rays.offset[1], simd.read(edges, edge + 2 * WIDTH), area)
    area = simd.fma(rays.slant[0], simd.read(edges, edge + 3 * WIDTH), area)
    return simd.fma(rays.slant[1], simd.read(edges, edge + 4 * WIDTH), area)


@helper
def _area_error(a: Vec, b: Vec, c: Vec, spread: Lane, off: Lane) -> Lane:
    """Error of the edge functions of rays up to `spread` from the central one (sum over both axes), with corners of error `off`.

    The four terms of an edge function add up to at most a quarter of the square of `far`; ten roundings apply.
    """
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1])) + np.float32(4.0) * spread
    return simd.fma(far, simd.fma(far, np.float32(2.0**-21), off), np.float32(2.0) * off * off)


@helper
def _overlaps(a: Lane, b: Lane, c: Lane, half: Lane) -> Lane:
    """Whether the interval around a, b, c overlaps -half … half."""
    return triangle_filter.inside(a, b, c) <= half


@helper
def _crosses(a: Vec, b: Vec, c: Vec, wide: Lane, tall: Lane, off: Lane) -> Lane:
    """Whether no edge of a triangle, whose corners have the error `off`, separates it from a rectangle around 0, 0."""
    error = _area_error(a, b, c, wide + tall, off)
    u, eu = _rectangle_edge(c, b, wide, tall, error)
    v, ev = _rectangle_edge(a, c, wide, tall, error)
    w, ew = _rectangle_edge(b, a, wide, tall, error)
    low, high = triangle_filter.min_of_three(u + eu, v + ev, w + ew), triangle_filter.max_of_three(u - eu, v - ev, w - ew)
    return (low >= np.float32(0.0)) | (high <= np.float32(0.0))


@helper
def _rectangle_edge(p: Vec, q: Vec, wide: Lane, tall: Lane, error: Lane) -> tuple[Lane, Lane]:
    """(twice the area of 0, 0 and an edge, the largest deviation from that over the rectangle)."""
    return triangle_filter.cross(p, q), simd.fma(abs(p[1] - q[1]), wide, simd.fma(abs(p[0] - q[0]), tall, error))


# --- hits ---


@helper
def intersect_triangles(
    leaves: Any, leaf: int, which: int, rays: LeafRays, central: CentralRay, best: PacketHits, any_hit: bool, edges: Any
) -> PacketHits:
    """Test all rays against the triangles of a leaf whose bits are set in `which`."""
    if any_hit:
        return _intersect_any(leaves, leaf, which, rays, central, best, edges)
    return _intersect_exactly(leaves, leaf, which, rays, central, best, any_hit)


@helper
def _intersect_exactly(
    leaves: Any, leaf: int, which: int, rays: LeafRays, central: CentralRay, best: PacketHits, any_hit: bool
) -> PacketHits:
    """Test in double precision."""
    while which != 0:
        k = simd.trailing_zeros(which)
        which &= which - 1
        best = _intersect_triangle(leaves, leaf, k, rays, central, best, any_hit)
    return best


@helper
def _intersect_triangle(
    leaves: Any, leaf: int, j: int, rays: LeafRays, central: CentralRay, best: PacketHits, any_hit: bool
) -> PacketHits:
    hit = _crossing(leaves, leaf * LEAF + j, rays)
    if any_hit and not ops.any_lane(flat.is_ahead(hit, rays.shear[2])):
        return best
    number = ops.int_like(rays.enters, np.int64(triangle_of(leaves, leaf, j)))
    return _closer_hits(best, rays, central, hit, number, any_hit)


@helper
def _intersect_any(
    leaves: Any, leaf: int, which: int, rays: LeafRays, central: CentralRay, best: PacketHits, edges: Any
) -> PacketHits:
    """Test in single precision, and in double precision the triangles for which a ray is undecided."""
    certain, nearest, deepest, undecided = best.certain, best.nearest, best.deepest, 0
    while which != 0:
        k = simd.trailing_zeros(which)
        which &= which - 1
        u, v, w = _edge_function(edges, k, rays), _edge_function(edges, _EDGE + k, rays), _edge_function(edges, 2 * _EDGE + k, rays)
        inside, error = triangle_filter.inside(u, v, w), simd.read(edges, _ERROR + k)
        first, last = simd.read(edges, _FIRST + k), simd.read(edges, _LAST + k)
        depth, blur = _plane_depth(edges, k, u, v, w, error, first, last, rays, central)
        may = (inside >= -error) & (deepest >= first) & (depth >= -blur)
        sure = may & (inside > error) & ((rays.first_depth < first) | (depth > blur)) & (nearest > last)
        undecided |= (1 if ops.any_lane(may & ops.not_(sure)) else 0) << k
        certain = simd.select(sure, np.int32(leaf * WIDTH + k), certain)
        nearest = simd.select(sure, first, nearest)
        deepest = simd.select(sure, ops.full_like(nearest, np.float32(-np.inf)), deepest)
    ends = (deepest - (rays.entry_depth - central.off)) * (rays.scale * _FAR)
    limits = simd.minimum(ends, best.limits)  # in this order: `ends` may be NaN in lanes outside the packet, whose limits are -inf
    best = _replace_certain(best, certain, nearest, deepest, limits)
    if undecided != 0:
        best = _intersect_exactly(leaves, leaf, undecided, rays, central, best, True)
    return best


@helper
def _plane_depth(
    edges: Any, k: int, u: Lane, v: Lane, w: Lane, error: Lane, first: Lane, last: Lane, rays: LeafRays, central: CentralRay
) -> tuple[Lane, Lane]:
    """triangle_filter.plane_depth of triangle k, from where rays enter the mesh's box."""
    a, b, c = simd.read(edges, _CORNERS + k), simd.read(edges, _CORNERS + WIDTH + k), simd.read(edges, _CORNERS + 2 * WIDTH + k)
    start = rays.entry_depth
    depth = simd.fma(w, c - start, simd.fma(v, b - start, u * (a - start)))
    return triangle_filter.plane_depth(u, v, w, error, depth, simd.maximum(last - start, start - first), central.off)


@helper
def _crossing(leaves: Any, corner: int, rays: LeafRays) -> flat.Crossing:
    """Where all rays cross one triangle, in double precision."""
    b, c = corner + 3 * WIDTH, corner + 6 * WIDTH
    return flat.crossing(_corner(leaves, corner, rays), _corner(leaves, b, rays), _corner(leaves, c, rays), rays.shear[0], rays.shear[1])


@helper
def _corner(leaves: Any, corner: int, rays: LeafRays) -> Vec:
    kx, ky, kz = rays.rows
    x, y, z = rays.origin
    a, b, c = simd.read(leaves, corner + kx), simd.read(leaves, corner + ky), simd.read(leaves, corner + kz)
    return np.float64(a) - x, np.float64(b) - y, np.float64(c) - z


@helper
def _closer_hits(
    best: PacketHits, rays: LeafRays, central: CentralRay, hit: flat.Crossing, number: Lane, any_hit: bool
) -> PacketHits:
    """The hits so far, or those with triangle `number` where they are closer."""
    t = flat.hit_t(hit, rays.shear[2], rays.t_min, rays.t_max)
    nearer = (t < best.t) | ((t == best.t) & (t < np.inf) & (number < best.triangle))
    t = ops.where(nearer, t, best.t)
    until = simd.to_f32((t - rays.enters) * ray_state.FAR) if not any_hit else simd.to_f32(ops.where(t < np.inf, -np.inf, t))
    return _replace_exact(
        best, t, ops.where(nearer, number, best.triangle), ops.where(nearer, hit.v, best.v), ops.where(nearer, hit.w, best.w),
        ops.where(nearer, hit.total, best.total), simd.minimum(best.deepest, _depth(rays, central, until)),
        simd.minimum(until, best.limits),
    )  # fmt: skip


@helper
def finish_any(leaves: Any, rays: LeafRays, best: PacketHits) -> PacketHits:
    """Add the certain hits to the exact ones, with their triangles; t is that of the entry."""
    certain = best.certain >= np.int32(0)
    if not ops.any_lane(certain):
        return best
    place = simd.maximum(best.certain, 0 * best.certain)
    element = place // np.int32(WIDTH) * np.int32(LEAF) + (place & np.int32(WIDTH - 1))
    number = simd.to_i64(simd.float_bits(simd.gather(leaves, element + np.int32(WHICH))))
    mask = simd.mask_from_bits(simd.bits(certain), rays.enters)
    return _replace_exact(
        best, ops.where(mask, rays.enters, best.t), ops.where(mask, number, best.triangle), best.v, best.w, best.total,
        best.deepest, best.limits,
    )  # fmt: skip
