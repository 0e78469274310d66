"""What rays that go one way meet of a leaf's triangles: in single precision as far as that is sure, else in double.

Triangles are sieved as the rays' middle sees them, with a rectangle that holds the others. What passes is met by all rays side by side
in single precision, with what rounding may do to it: a ray that is sure to pass through a triangle, before all it has met, keeps its
place alone, and meets it in double precision at the end, when it is the first; where that is not sure, rays meet it in double precision
at once. So what each meets is, to the last bit, what it would meet by itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from . import across, lanes, simd, walk
from . import shapes_flat as flat
from .bundle import Core, Group, Way, pick
from .kernels import HELPER, helper, replacing
from .records import Lane, Vec
from .wide import LEAF, WIDTH, spread32

_FAR, _BEYOND = np.float32(walk.FAR), np.float32(1e30)
_ROUNDED = np.float32(2.0**-21)  # of t: what single precision does to it


class Rays(NamedTuple):
    """Rays as triangles want them: in single precision from where they enter the mesh's box, in double from their origins."""

    rows: tuple[int, int, int]  # of a leaf, for the shear's axes
    near: Vec  # origin
    slopes: Vec  # the shear
    begins: Lane  # t within which what is met is sure to count
    ends: Lane
    off: Lane  # by how much a corner may be off
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
    nearest: Lane  # float32: t before which nothing of it lies, from where a ray enters
    limits: Lane  # float32: how far each is still to go


_sure_of = replacing(Found, "place", "nearest", "limits")
_exact_of = replacing(Found, "t", "triangle", "v", "w", "total", "limits")


@helper
def rays_of(group: Group, go: Way, core: Core, o: Vec, enters: Lane, t_min: Lane, t_max: Lane) -> Rays:
    kx, ky, kz = go.axes
    begins, ends = simd.to_f32(t_min - enters), simd.minimum(simd.to_f32(t_max - enters), lanes.full_like(group.limits, _BEYOND))
    return Rays(
        (WIDTH * kx, WIDTH * ky, WIDTH * kz),
        (pick(group.origin, kx), pick(group.origin, ky), pick(group.origin, kz)),
        (simd.to_f32(go.slopes[0]), simd.to_f32(go.slopes[1]), simd.to_f32(go.slopes[2])),
        begins + abs(begins) * _ROUNDED, ends - abs(ends) * _ROUNDED, lanes.full_like(begins, core.off),
        (pick(o, kx), pick(o, ky), pick(o, kz)), go.slopes, t_min,
        lanes.where(simd.mask_from_bits(group.left, enters), t_max, -np.inf), enters,
    )  # fmt: skip


@helper
def nothing(rays: Rays, limits: Lane) -> Found:
    zero = 0.0 * rays.enters
    return Found(
        zero + np.inf, lanes.int_like(zero, -1), zero, zero, zero + 1.0, simd.to_i32(lanes.full_like(limits, np.float32(-1.0))),
        lanes.full_like(limits, np.float32(np.inf)), limits,
    )  # fmt: skip


@helper
def sieve(core: Core) -> walk.Sieve:
    kx, ky, kz = core.axes
    x, y, z = core.origin
    return walk.Sieve(
        WIDTH * kx, WIDTH * ky, WIDTH * kz, (spread32(x), spread32(y), spread32(z)), (spread32(core.shear[0]), spread32(core.shear[1])),
        spread32(core.off), spread32(np.float32(0.0)), 0,
    )  # fmt: skip


@helper
def sifted(leaves: Any, leaf: int, core: Core, ray: walk.Sieve, limit: Any) -> int:
    """Bits of a leaf's triangles that one of the rays may meet before `limit`.

    Seen along the middle ray the others pass through a rectangle, as large as it is where the farther end of a triangle lies; a
    triangle is left out where one of the rectangle's axes or one of its own edges parts the two. What the rays go apart along the
    triangle itself counts with rounding, as what may move its corners.
    """
    at, half = leaf * LEAF, np.float32(0.5)
    a, b, c = walk.aside(leaves, at, ray), walk.aside(leaves, at + 3 * WIDTH, ray), walk.aside(leaves, at + 6 * WIDTH, ray)
    low, high = _least_of(a[2], b[2], c[2]), _most_of(a[2], b[2], c[2])
    away, long = half * abs(low + high), half * (high - low)
    wide, tall = simd.fma(away, core.flare[0], spread32(core.apart[0])), simd.fma(away, core.flare[1], spread32(core.apart[1]))
    off = simd.fma(long, max(core.flare[0], core.flare[1]), ray.off)
    hits = simd.bits(_spans(a[0], b[0], c[0], wide + off) & _spans(a[1], b[1], c[1], tall + off) & _parted(a, b, c, wide, tall, off))
    first = low if core.scale > np.float32(0.0) else high
    return hits & simd.bits((first * core.scale - core.early * abs(core.scale)) <= limit * _FAR)


@helper
def _least_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.minimum(simd.minimum(a, b), c)


@helper
def _most_of(a: Lane, b: Lane, c: Lane) -> Lane:
    return simd.maximum(simd.maximum(a, b), c)


@helper
def _spans(a: Lane, b: Lane, c: Lane, half: Lane) -> Lane:
    """Whether what lies around a, b, c meets -half … half."""
    return simd.maximum(_least_of(a, b, c), -_most_of(a, b, c)) <= half


@helper
def _parted(a: Vec, b: Vec, c: Vec, wide: Lane, tall: Lane, off: Lane) -> Lane:
    """Whether no edge has a rectangle around 0, 0 wholly on the other side than the triangle, whose corners may be off by `off`."""
    far = (abs(a[0]) + abs(a[1])) + (abs(b[0]) + abs(b[1])) + (abs(c[0]) + abs(c[1])) + np.float32(4.0) * (wide + tall)
    error = simd.fma(far, simd.fma(far, np.float32(2.0**-21), off), np.float32(2.0) * off * off)
    u, eu = _edge(c, b, wide, tall, error)
    v, ev = _edge(a, c, wide, tall, error)
    w, ew = _edge(b, a, wide, tall, error)
    low, high = _least_of(u + eu, v + ev, w + ew), _most_of(u - eu, v - ev, w - ew)
    return (low >= np.float32(0.0)) | (high <= np.float32(0.0))


@helper
def _edge(p: Vec, q: Vec, wide: Lane, tall: Lane, error: Lane) -> tuple[Lane, Lane]:
    """Twice the area of 0, 0 and an edge, and by how much it may be off for the rectangle's other points."""
    return simd.fma(p[0], q[1], -(p[1] * q[0])), simd.fma(abs(p[1] - q[1]), wide, simd.fma(abs(p[0] - q[0]), tall, error))


def take(leaves: Any, numbers: Any, leaf: int, j: int, rays: Rays, found: Found, any_hit: bool) -> Found:
    """What rays have met, with triangle j of a leaf: in kernels."""
    raise NotImplementedError


@overload(take, jit_options=HELPER)
def _take(leaves, numbers, leaf, j, rays, found, any_hit):
    """As many rays as a vector has doubles are met in double precision as fast as in single."""
    if rays.types[Rays._fields.index("enters")].lanes <= across.WIDTH:
        return lambda leaves, numbers, leaf, j, rays, found, any_hit: _take_exactly(leaves, numbers, leaf, j, rays, found, any_hit)
    return lambda leaves, numbers, leaf, j, rays, found, any_hit: _take_if_sure(leaves, numbers, leaf, j, rays, found, any_hit)


@helper
def _take_exactly(leaves: Any, numbers: Any, leaf: int, j: int, rays: Rays, found: Found, any_hit: bool) -> Found:
    met = _crossing_of(leaves, leaf * LEAF + j, rays)
    if any_hit and not lanes.any_lane(flat.ahead(met, rays.shear[2])):
        return found
    number = lanes.int_like(rays.enters, np.int64(simd.read(numbers, leaf * WIDTH + j)))
    return _taken(found, rays, met, number, any_hit)


@helper
def _take_if_sure(leaves: Any, numbers: Any, leaf: int, j: int, rays: Rays, found: Found, any_hit: bool) -> Found:
    may, sure, first, last = _judged(leaves, leaf * LEAF + j, rays)
    may = may & (first <= found.limits)
    if not lanes.any_lane(may):
        return found
    sure = sure & may & (last < found.nearest)
    if lanes.any_lane(may & lanes.not_(sure)):
        found = _take_exactly(leaves, numbers, leaf, j, rays, found, any_hit)
    until = last * _FAR if not any_hit else lanes.full_like(last, np.float32(-np.inf))
    return _sure_of(
        found, simd.select(sure, np.int32(leaf * WIDTH + j), found.place), simd.select(sure, first, found.nearest),
        simd.select(sure, simd.minimum(found.limits, until), found.limits),
    )  # fmt: skip


@helper
def _judged(leaves: Any, at: int, rays: Rays) -> tuple[Lane, Lane, Lane, Lane]:
    """(which rays may pass through a triangle, which are sure to and before what they may go to, t it lies between) in single precision."""
    kx, ky, kz = rays.rows
    x, y, z = rays.near
    az, bz, cz = simd.read(leaves, at + kz), simd.read(leaves, at + 3 * WIDTH + kz), simd.read(leaves, at + 6 * WIDTH + kz)
    a = _sheared(rays, simd.read(leaves, at + kx) - x, simd.read(leaves, at + ky) - y, az - z)
    b = _sheared(rays, simd.read(leaves, at + 3 * WIDTH + kx) - x, simd.read(leaves, at + 3 * WIDTH + ky) - y, bz - z)
    c = _sheared(rays, simd.read(leaves, at + 6 * WIDTH + kx) - x, simd.read(leaves, at + 6 * WIDTH + ky) - y, cz - z)
    u, v, w, error = walk.weights(a, b, c, rays.off, np.float32(2.0) * rays.off * rays.off)
    low, high = _least_of(u, v, w), _most_of(u, v, w)
    scale = rays.slopes[2]
    one, other = (min(min(az, bz), cz) - (z + rays.off)) * scale, (max(max(az, bz), cz) - (z - rays.off)) * scale
    first, last = simd.minimum(one, other), simd.maximum(one, other)
    first, last = first - abs(first) * _ROUNDED, last + abs(last) * _ROUNDED
    sure = ((low > error) | (high < -error)) & (first > rays.begins) & (last < rays.ends)
    return (low >= -error) | (high <= error), sure, first, last


@helper
def _sheared(rays: Rays, x: Lane, y: Lane, z: Lane) -> tuple[Lane, Lane]:
    return simd.fma(-rays.slopes[0], z, x), simd.fma(-rays.slopes[1], z, y)


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
def _taken(found: Found, rays: Rays, met: flat.Crossing, number: Lane, any_hit: bool) -> Found:
    """What rays have met, with where each passes a triangle."""
    t = flat.reached(met, rays.shear[2], rays.t_min, rays.t_max)
    nearer = (t < found.t) | ((t == found.t) & (t < np.inf) & (number < found.triangle))
    t = lanes.where(nearer, t, found.t)
    until = simd.to_f32((t - rays.enters) * walk.FAR) if not any_hit else simd.to_f32(lanes.where(t < np.inf, -np.inf, t))
    return _exact_of(
        found, t, lanes.where(nearer, number, found.triangle), lanes.where(nearer, met.v, found.v), lanes.where(nearer, met.w, found.w),
        lanes.where(nearer, met.total, found.total), simd.minimum(found.limits, until),
    )  # fmt: skip


@helper
def settled(leaves: Any, numbers: Any, rays: Rays, found: Found, any_hit: bool) -> Found:
    """What rays have met, with what was sure, each its own triangle, in double precision. With `any_hit`, only that there is something."""
    mine = found.place >= np.int32(0)
    if not lanes.any_lane(mine):
        return found
    place = simd.maximum(found.place, 0 * found.place)
    number = simd.to_i64(simd.gather(numbers, place))
    mine64 = simd.mask_from_bits(simd.bits(mine), rays.enters)
    if any_hit:
        return _exact_of(
            found, lanes.where(mine64, rays.enters, found.t), lanes.where(mine64, number, found.triangle), found.v, found.w, found.total,
            found.limits,
        )  # fmt: skip
    at = place // np.int32(WIDTH) * np.int32(LEAF) + (place & np.int32(WIDTH - 1))
    b, c = at + np.int32(3 * WIDTH), at + np.int32(6 * WIDTH)
    met = flat.crossing(_corners(leaves, at, rays), _corners(leaves, b, rays), _corners(leaves, c, rays), rays.shear[0], rays.shear[1])
    return _taken(found, rays, flat.Crossing(met.v, met.w, met.total, met.depth, met.inside & mine64), number, any_hit)


@helper
def _corners(leaves: Any, at: Lane, rays: Rays) -> Vec:
    """The same of each ray's own triangle."""
    kx, ky, kz = rays.rows
    x, y, z = rays.far
    return _each(leaves, at, kx) - x, _each(leaves, at, ky) - y, _each(leaves, at, kz) - z


@helper
def _each(leaves: Any, at: Lane, row: int) -> Lane:
    return simd.to_f64(simd.gather(leaves, at + np.int32(row)))
