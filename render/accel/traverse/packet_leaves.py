"""What rays that go one way meet of a leaf's triangles: in single precision as far as that is sure, else in double.

Triangles are sieved as the rays' middle sees them, with a rectangle that holds the others. What passes is met by all rays side by side
in single precision, with what rounding may do to it: a ray that is sure to pass through a triangle, before all it has met, keeps its
place alone, and meets it in double precision at the end, when it is the first; where that is not sure, rays meet it in double precision
as soon as the leaf is done. So what each meets is, to the last bit, what it would meet by itself.

Depth is along the main axis, the way the rays go, from where the middle one begins. The loop over triangles has no branch but its own:
processors guess what a ray meets wrong as often as not.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from ... import simd
from ...geometry import flat_shapes as flat
from ...jit.kernel import HELPER, helper, make_replace
from ...lanes import crosslane, ops
from ...types import Lane, Vec
from ..build.wide_bvh import LEAF, WHICH, WIDTH, spread32, triangle_of
from . import single_ray, triangle_filter
from .packet import Core, Group, Way, pick

_FAR = np.float32(single_ray.FAR)
_EDGE = 6 * WIDTH  # numbers of an edge of a leaf's triangles: see `_keep_edge`
_ERROR, _FIRST, _LAST = 3 * _EDGE, 3 * _EDGE + WIDTH, 3 * _EDGE + 2 * WIDTH  # how far off edges may be; depths a triangle lies between
_CORNERS = _LAST + WIDTH  # depths of corners a, b, c
EDGES = _CORNERS + 3 * WIDTH  # float32 numbers of a leaf's triangles as the middle ray sees them


class Middle(NamedTuple):
    """The middle ray as a leaf's triangles want it; see sieve.Sieve."""

    x: int
    y: int
    z: int
    way: Lane
    origin: Vec
    shear: tuple[Lane, Lane]
    off: Lane


class Rays(NamedTuple):
    """Rays as triangles want them: in single precision beside the middle one, in double from their origins."""

    rows: tuple[int, int, int]  # of a leaf, for the shear's axes
    aside: tuple[Lane, Lane]  # x and -y of where a ray passes at depth 0
    slant: tuple[Lane, Lane]  # x and -y of how much that grows for each unit of the main axis
    turn: Lane  # their cross product
    ahead: Lane  # the depth at which it enters the mesh's box
    scale: Lane  # t of a unit of depth
    along: Lane  # depth of a unit of t
    begins: Lane  # depth from which on what is met is sure to count
    far: Vec  # origin, in double precision
    shear: Vec
    t_min: Lane
    t_max: Lane
    enters: Lane


class Found(NamedTuple):
    """What rays have met so far: in double precision, and what is sure to come first but has yet to be met so."""

    t: Lane
    triangle: Lane
    v: Lane  # weights of the second and the third corner, times `total`
    w: Lane
    total: Lane
    place: Lane  # int32: the leaf · WIDTH + triangle that is sure, or -1
    nearest: Lane  # float32: depth before which nothing of it lies; or beyond which nothing is sure to count
    deepest: Lane  # float32: down to which depth each is still to go
    limits: Lane  # float32: and to which t, from where it enters


_sure_of = make_replace(Found, "place", "nearest", "deepest", "limits")
_exact_of = make_replace(Found, "t", "triangle", "v", "w", "total", "deepest", "limits")


@helper
def rays_of(group: Group, go: Way, core: Core, o: Vec, d: Vec, enters: Lane, t_min: Lane, t_max: Lane) -> Rays:
    kx, ky, kz = go.axes
    far = pick(o, kx), pick(o, ky), pick(o, kz)
    x, dx = _beside(far, go.slopes, core, 0)
    y, dy = _beside(far, go.slopes, core, 1)
    deep, along = far[2] + enters * pick(d, kz) - np.float64(core.origin[2]), abs(simd.to_f32(pick(d, kz)))
    ahead = simd.to_f32(deep if core.scale > np.float32(0.0) else -deep)
    return Rays(
        (WIDTH * kx, WIDTH * ky, WIDTH * kz), (x, -y), (dx, -dy), simd.fma(x, dy, -(y * dx)), ahead, abs(simd.to_f32(go.slopes[2])), along,
        simd.fma(simd.to_f32(t_min - enters), along, ahead + core.off),
        far, go.slopes, t_min, ops.where(simd.mask_from_bits(group.left, enters), t_max, -np.inf), enters,
    )  # fmt: skip


@helper
def _beside(origin: Vec, slopes: Vec, core: Core, axis: int) -> tuple[Lane, Lane]:
    """How far rays are from the middle one, along an axis of the shear, where that begins; and how much that grows."""
    middle, slope = np.float64(core.origin[axis]), np.float64(core.shear[axis])
    at = simd.fma(slopes[axis], np.float64(core.origin[2]) - origin[2], origin[axis])
    return simd.to_f32(at - middle), simd.to_f32(slopes[axis] - slope)


@helper
def nothing(rays: Rays, core: Core, limits: Lane) -> Found:
    zero = 0.0 * rays.enters
    return Found(
        zero + np.inf, ops.int_like(zero, -1), zero, zero, zero + 1.0, simd.to_i32(ops.full_like(limits, np.float32(-1.0))),
        simd.fma(simd.to_f32(rays.t_max - rays.enters), rays.along, rays.ahead - core.off), _depth(rays, core, limits), limits,
    )  # fmt: skip


@helper
def _depth(rays: Rays, core: Core, t: Lane) -> Lane:
    """The depth that rays have reached at t, at most."""
    return simd.fma(t, rays.along, rays.ahead + core.off)


@helper
def middle(core: Core) -> Middle:
    kx, ky, kz = core.axes
    x, y, z = core.origin
    shear = spread32(core.shear[0]), spread32(core.shear[1])
    return Middle(WIDTH * kx, WIDTH * ky, WIDTH * kz, spread32(1.0), (spread32(x), spread32(y), spread32(z)), shear, spread32(core.off))


@helper
def cull_triangles(leaves: Any, leaf: int, core: Core, ray: Middle, limit: Any, edges: Any) -> int:
    """Bits of a leaf's triangles that one of the rays may meet before `limit`, of which `edges` then holds what `_passed` wants.

    Seen along the middle ray the others pass through a rectangle, as large as it is where the farther end of a triangle lies; a
    triangle is left out where one of the rectangle's axes or one of its own edges parts the two. What the rays go apart along the
    triangle itself counts with rounding, as what may move its corners.
    """
    at, half = leaf * LEAF, np.float32(0.5)
    a, b, c = (
        triangle_filter.aside(leaves, at, ray),
        triangle_filter.aside(leaves, at + 3 * WIDTH, ray),
        triangle_filter.aside(leaves, at + 6 * WIDTH, ray),
    )
    low, high = triangle_filter.least_of(a[2], b[2], c[2]), triangle_filter.most_of(a[2], b[2], c[2])
    away, long = half * abs(low + high), half * (high - low)
    wide, tall = simd.fma(away, core.flare[0], spread32(core.apart[0])), simd.fma(away, core.flare[1], spread32(core.apart[1]))
    off = simd.fma(long, max(core.flare[0], core.flare[1]), ray.off)
    hits = simd.bits(_spans(a[0], b[0], c[0], wide + off) & _spans(a[1], b[1], c[1], tall + off) & _parted(a, b, c, wide, tall, off))
    up = core.scale > np.float32(0.0)
    first = low if up else high
    hits &= simd.bits((first * core.scale - core.early * abs(core.scale)) <= limit * _FAR)
    if hits != 0:
        _keep_edge(edges, 0, c, b)
        _keep_edge(edges, _EDGE, a, c)
        _keep_edge(edges, 2 * _EDGE, b, a)
        simd.store(edges, _ERROR, _error(a, b, c, simd.fma(long, core.flare[0], wide) + simd.fma(long, core.flare[1], tall), ray.off))
        simd.store(edges, _FIRST, (low if up else -high) - ray.off)
        simd.store(edges, _LAST, (high if up else -low) + ray.off)
        simd.store(edges, _CORNERS, a[2] if up else -a[2])
        simd.store(edges, _CORNERS + WIDTH, b[2] if up else -b[2])
        simd.store(edges, _CORNERS + 2 * WIDTH, c[2] if up else -c[2])
    return hits


@helper
def _keep_edge(edges: Any, at: int, p: Vec, q: Vec) -> None:
    """Of an edge from p to q of all triangles, what `_passed` wants."""
    simd.store(edges, at, triangle_filter.cross(p, q))
    simd.store(edges, at + WIDTH, p[1] - q[1])
    simd.store(edges, at + 2 * WIDTH, p[0] - q[0])
    simd.store(edges, at + 3 * WIDTH, simd.fma(q[2], p[1], -(p[2] * q[1])))
    simd.store(edges, at + 4 * WIDTH, simd.fma(q[2], p[0], -(p[2] * q[0])))
    simd.store(edges, at + 5 * WIDTH, q[2] - p[2])


@helper
def _passed(edges: Any, at: int, rays: Rays) -> Lane:
    """Twice the area of where rays pass and an edge from p to q, which are as the middle ray sees them.

    A ray that is `aside` by s and slants by d sees a corner at p - s - d z. The cross product of two of those is
    p × q + s × (p - q) + d × (q_z p - p_z q) + (s × d) (q_z - p_z).
    """
    area = simd.fma(rays.turn, simd.read(edges, at + 5 * WIDTH), simd.read(edges, at))
    area = simd.fma(rays.aside[0], simd.read(edges, at + WIDTH), area)
    area = simd.fma(rays.aside[1], simd.read(edges, at + 2 * WIDTH), area)
    area = simd.fma(rays.slant[0], simd.read(edges, at + 3 * WIDTH), area)
    return simd.fma(rays.slant[1], simd.read(edges, at + 4 * WIDTH), area)


@helper
def _error(a: Vec, b: Vec, c: Vec, apart: Lane, off: Lane) -> Lane:
    """How far off the area of two corners and a ray may be that passes `apart` from the middle one at most (the sum of both axes).

    Its four terms come to at most a quarter of the square of what is `far`, and are rounded ten times; each corner may be off by `off`.
    """
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1])) + np.float32(4.0) * apart
    return simd.fma(far, simd.fma(far, np.float32(2.0**-21), off), np.float32(2.0) * off * off)


@helper
def _spans(a: Lane, b: Lane, c: Lane, half: Lane) -> Lane:
    """Whether what lies around a, b, c meets -half … half."""
    return triangle_filter.inside(a, b, c) <= half


@helper
def _parted(a: Vec, b: Vec, c: Vec, wide: Lane, tall: Lane, off: Lane) -> Lane:
    """Whether no edge has a rectangle around 0, 0 wholly on the other side than the triangle, whose corners may be off by `off`."""
    error = _error(a, b, c, wide + tall, off)
    u, eu = _edge(c, b, wide, tall, error)
    v, ev = _edge(a, c, wide, tall, error)
    w, ew = _edge(b, a, wide, tall, error)
    low, high = triangle_filter.least_of(u + eu, v + ev, w + ew), triangle_filter.most_of(u - eu, v - ev, w - ew)
    return (low >= np.float32(0.0)) | (high <= np.float32(0.0))


@helper
def _edge(p: Vec, q: Vec, wide: Lane, tall: Lane, error: Lane) -> tuple[Lane, Lane]:
    """Twice the area of 0, 0 and an edge, and by how much it may be off for the rectangle's other points."""
    return triangle_filter.cross(p, q), simd.fma(abs(p[1] - q[1]), wide, simd.fma(abs(p[0] - q[0]), tall, error))


def take(leaves: Any, leaf: int, hits: int, rays: Rays, core: Core, found: Found, any_hit: bool, edges: Any) -> Found:
    """What rays have met, with those triangles of a leaf whose bits are set in `hits`: in kernels."""
    raise NotImplementedError


@overload(take, jit_options=HELPER)
def _take(leaves, leaf, hits, rays, core, found, any_hit, edges):
    if rays.types[Rays._fields.index("enters")].lanes <= crosslane.WIDTH:
        return lambda leaves, leaf, hits, rays, core, found, any_hit, edges: _few(leaves, leaf, hits, rays, core, found, any_hit, edges)
    return lambda leaves, leaf, hits, rays, core, found, any_hit, edges: _if_sure(leaves, leaf, hits, rays, core, found, any_hit, edges)


@helper
def _few(leaves: Any, leaf: int, hits: int, rays: Rays, core: Core, found: Found, any_hit: bool, edges: Any) -> Found:
    """`take` for no more rays than a vector has doubles, which are met in double precision as fast as in single: only ends are sooner."""
    if any_hit:
        return _if_sure(leaves, leaf, hits, rays, core, found, any_hit, edges)
    return _exactly(leaves, leaf, hits, rays, core, found, any_hit)


@helper
def _exactly(leaves: Any, leaf: int, hits: int, rays: Rays, core: Core, found: Found, any_hit: bool) -> Found:
    """`take` in double precision."""
    while hits != 0:
        k = simd.trailing_zeros(hits)
        hits &= hits - 1
        found = _take_exactly(leaves, leaf, k, rays, core, found, any_hit)
    return found


@helper
def _take_exactly(leaves: Any, leaf: int, j: int, rays: Rays, core: Core, found: Found, any_hit: bool) -> Found:
    met = _crossing_of(leaves, leaf * LEAF + j, rays)
    if any_hit and not ops.any_lane(flat.ahead(met, rays.shear[2])):
        return found
    number = ops.int_like(rays.enters, np.int64(triangle_of(leaves, leaf, j)))
    return _taken(found, rays, core, met, number, any_hit)


@helper
def _if_sure(leaves: Any, leaf: int, hits: int, rays: Rays, core: Core, found: Found, any_hit: bool, edges: Any) -> Found:
    """`take` in single precision where that is sure."""
    place, nearest, deepest, unsure = found.place, found.nearest, found.deepest, 0
    while hits != 0:
        k = simd.trailing_zeros(hits)
        hits &= hits - 1
        u, v, w = _passed(edges, k, rays), _passed(edges, _EDGE + k, rays), _passed(edges, 2 * _EDGE + k, rays)
        inside, error = triangle_filter.inside(u, v, w), simd.read(edges, _ERROR + k)
        first, last = simd.read(edges, _FIRST + k), simd.read(edges, _LAST + k)
        may = (inside >= -error) & (deepest >= first)
        ahead = rays.begins < first
        if any_hit:
            lead, blur = _lead(edges, k, u, v, w, error, first, last, rays, core)
            may, ahead = may & (lead >= -blur), ahead | (lead > blur)
        sure = may & (inside > error) & ahead & (nearest > last)
        unsure |= (1 if ops.any_lane(may & ops.not_(sure)) else 0) << k
        place = simd.select(sure, np.int32(leaf * WIDTH + k), place)
        nearest = simd.select(sure, first, nearest)
        deepest = simd.select(sure, simd.minimum(deepest, last) if not any_hit else ops.full_like(nearest, np.float32(-np.inf)), deepest)
    limits = simd.minimum(found.limits, (deepest - (rays.ahead - core.off)) * (rays.scale * _FAR))
    found = _sure_of(found, place, nearest, deepest, limits)
    if unsure != 0:
        found = _exactly(leaves, leaf, unsure, rays, core, found, any_hit)
    return found


@helper
def _lead(edges: Any, k: int, u: Lane, v: Lane, w: Lane, error: Lane, first: Lane, last: Lane, rays: Rays, core: Core) -> tuple[Lane, Lane]:
    """sieve.lead_of for triangle k, from where rays enter the mesh's box."""
    a, b, c = simd.read(edges, _CORNERS + k), simd.read(edges, _CORNERS + WIDTH + k), simd.read(edges, _CORNERS + 2 * WIDTH + k)
    depth = simd.fma(w, c - rays.ahead, simd.fma(v, b - rays.ahead, u * (a - rays.ahead)))
    return triangle_filter.lead_of(u, v, w, error, depth, simd.maximum(last - rays.ahead, rays.ahead - first), core.off)


@helper
def _crossing_of(leaves: Any, at: int, rays: Rays) -> flat.Crossing:
    """Where rays pass one triangle, in double precision."""
    b, c = at + 3 * WIDTH, at + 6 * WIDTH
    return flat.crossing(_corner(leaves, at, rays), _corner(leaves, b, rays), _corner(leaves, c, rays), rays.shear[0], rays.shear[1])


@helper
def _corner(leaves: Any, at: int, rays: Rays) -> Vec:
    kx, ky, kz = rays.rows
    x, y, z = rays.far
    a, b, c = simd.read(leaves, at + kx), simd.read(leaves, at + ky), simd.read(leaves, at + kz)
    return np.float64(a) - x, np.float64(b) - y, np.float64(c) - z


@helper
def _taken(found: Found, rays: Rays, core: Core, met: flat.Crossing, number: Lane, any_hit: bool) -> Found:
    """What rays have met, with where each passes a triangle."""
    t = flat.reached(met, rays.shear[2], rays.t_min, rays.t_max)
    nearer = (t < found.t) | ((t == found.t) & (t < np.inf) & (number < found.triangle))
    t = ops.where(nearer, t, found.t)
    until = simd.to_f32((t - rays.enters) * single_ray.FAR) if not any_hit else simd.to_f32(ops.where(t < np.inf, -np.inf, t))
    return _exact_of(
        found, t, ops.where(nearer, number, found.triangle), ops.where(nearer, met.v, found.v), ops.where(nearer, met.w, found.w),
        ops.where(nearer, met.total, found.total), simd.minimum(found.deepest, _depth(rays, core, until)),
        simd.minimum(found.limits, until),
    )  # fmt: skip


@helper
def settled(leaves: Any, rays: Rays, core: Core, found: Found, any_hit: bool) -> Found:
    """What rays have met, with what was sure, each its own triangle, in double precision. With `any_hit`, only that there is something."""
    mine = found.place >= np.int32(0)
    if not ops.any_lane(mine):
        return found
    place = simd.maximum(found.place, 0 * found.place)
    at = place // np.int32(WIDTH) * np.int32(LEAF) + (place & np.int32(WIDTH - 1))
    number = simd.to_i64(simd.float_bits(simd.gather(leaves, at + np.int32(WHICH))))
    mine64 = simd.mask_from_bits(simd.bits(mine), rays.enters)
    if any_hit:
        return _exact_of(
            found, ops.where(mine64, rays.enters, found.t), ops.where(mine64, number, found.triangle), found.v, found.w, found.total,
            found.deepest, found.limits,
        )  # fmt: skip
    b, c = at + np.int32(3 * WIDTH), at + np.int32(6 * WIDTH)
    met = flat.crossing(_corners(leaves, at, rays), _corners(leaves, b, rays), _corners(leaves, c, rays), rays.shear[0], rays.shear[1])
    return _taken(found, rays, core, flat.Crossing(met.v, met.w, met.total, met.depth, met.inside & mine64), number, any_hit)


@helper
def _corners(leaves: Any, at: Lane, rays: Rays) -> Vec:
    """The same of each ray's own triangle."""
    kx, ky, kz = rays.rows
    x, y, z = rays.far
    return _each(leaves, at, kx) - x, _each(leaves, at, ky) - y, _each(leaves, at, kz) - z


@helper
def _each(leaves: Any, at: Lane, row: int) -> Lane:
    return simd.to_f64(simd.gather(leaves, at + np.int32(row)))
