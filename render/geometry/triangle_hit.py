"""Watertight ray/triangle intersection, in lanes."""

from __future__ import annotations

import math
from typing import NamedTuple

from ...shapes.lanes import component
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

INF = math.inf


@helper
def shear(direction: Vec) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    """(kx, ky, kz, sx, sy, sz): axes and factors of the shear that takes a direction to +z.

    kz is the direction's largest axis; kx and ky are swapped where that component is negative, which keeps the winding.
    """
    kx, ky, kz = _axes(direction)
    return _shear_factors(direction, kx, ky, kz, 1.0 / component(direction, kz))


@helper
def shear_with_inverse(direction: Vec, inverse: Vec) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    """`shear` with a given 1 / direction."""
    kx, ky, kz = _axes(direction)
    return _shear_factors(direction, kx, ky, kz, component(inverse, kz))


@helper
def _shear_factors(direction: Vec, kx: Lane, ky: Lane, kz: Lane, scale: Lane) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    return kx, ky, kz, component(direction, kx) * scale, component(direction, ky) * scale, scale


@helper
def _axes(direction: Vec) -> tuple[Lane, Lane, Lane]:
    ax, ay, az = abs(direction[0]), abs(direction[1]), abs(direction[2])
    kz = ops.where((ax >= ay) & (ax >= az), 0, ops.where(ay >= az, 1, 2))
    along = component(direction, kz)
    after = ops.where(kz == 2, 0, kz + 1)
    before = ops.where(kz == 0, 2, kz - 1)
    return ops.where(along < 0.0, before, after), ops.where(along < 0.0, after, before), kz


class Crossing(NamedTuple):
    """Crossings of sheared rays with triangles."""

    v: Lane  # weights of the second and the third corner, times `total`
    w: Lane
    total: Lane
    depth: Lane  # times `total`, before the shear's own scale
    inside: Lane  # bool


@helper
def crossing(a: Vec, b: Vec, c: Vec, sx: Lane, sy: Lane) -> Crossing:
    """The crossing with a triangle whose corners are relative to the ray's origin, with axes in the order kx, ky, kz."""
    ax, ay = a[0] - sx * a[2], a[1] - sy * a[2]
    bx, by = b[0] - sx * b[2], b[1] - sy * b[2]
    cx, cy = c[0] - sx * c[2], c[1] - sy * c[2]
    u = cx * by - cy * bx
    v = ax * cy - ay * cx
    w = bx * ay - by * ax
    total = u + v + w
    outside = ((u < 0.0) | (v < 0.0) | (w < 0.0)) & ((u > 0.0) | (v > 0.0) | (w > 0.0))
    return Crossing(v, w, total, u * a[2] + v * b[2] + w * c[2], ops.not_(outside) & (total != 0.0))


@helper
def is_ahead(hit: Crossing, sz: Lane) -> Lane:
    """Whether a crossing is inside its triangle and not behind the ray's origin, without a division."""
    return hit.inside & ops.not_((sz * hit.depth < 0.0) ^ (hit.total < 0.0))


@helper
def hit_t(hit: Crossing, sz: Lane, t_min: Lane, t_max: Lane) -> Lane:
    """t of a crossing, inf outside of its triangle and where t is not between t_min and t_max."""
    t = sz * hit.depth / hit.total
    return ops.where(hit.inside & (t > t_min) & (t < t_max), t, INF)


@helper
def sheared_triangle(a: Vec, b: Vec, c: Vec, sx: Lane, sy: Lane, sz: Lane, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane, Lane]:
    """`triangle` for corners relative to the ray's origin with their axes in the order kx, ky, kz of `shear`."""
    hit = crossing(a, b, c, sx, sy)
    return hit_t(hit, sz, t_min, t_max), hit.v / hit.total, hit.w / hit.total


@helper
def triangle(a: Vec, b: Vec, c: Vec, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane, Lane]:
    """(t, u, v) of a two-sided triangle; u and v are the weights of b and c, t is inf where it is missed.

    Woop, Benthin, Wald, "Watertight Ray/Triangle Intersection", JCGT 2013. Two triangles that share an edge compute
    the same two products with opposite signs. Rounding keeps their order, so no ray passes between the triangles.
    """
    kx, ky, kz, sx, sy, sz = shear(direction)
    o = (component(origin, kx), component(origin, ky), component(origin, kz))
    pa = (component(a, kx) - o[0], component(a, ky) - o[1], component(a, kz) - o[2])
    pb = (component(b, kx) - o[0], component(b, ky) - o[1], component(b, kz) - o[2])
    pc = (component(c, kx) - o[0], component(c, ky) - o[1], component(c, kz) - o[2])
    return sheared_triangle(pa, pb, pc, sx, sy, sz, t_min, t_max)
