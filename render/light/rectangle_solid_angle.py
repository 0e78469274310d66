"""Uniform sampling of rectangles by solid angle.

Ureña, Fajardo, King 2013, "An Area-Preserving Parametrization for Spherical Rectangles" (EGSR). One random number chooses a great circle
across the spherical rectangle, the other the position on it. Angles are differences of arcs and lose precision for small or distant
rectangles: callers sample those by area, which is as good there (`is_near`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

NEAR = 2.0
TINY = 1e-30


class SphericalRectangle(NamedTuple):
    """A spherical rectangle, in a frame along its sides with the viewpoint as origin."""

    x0: Lane
    x1: Lane
    y0: Lane
    y1: Lane
    z: Lane  # minus the distance of its plane
    b0: Lane  # heights of the normals of its first and third arc
    b1: Lane
    k: Lane
    solid: Lane  # steradians


@helper
def is_near(way: Vec, area: Lane) -> Lane:
    """Whether a rectangle centered at `way` is so near that solid angle sampling pays."""
    return ops.dot(way, way) < NEAR * area


@helper
def spherical_rectangle(way: Vec, unit_u: Vec, unit_v: Vec, half_u: Lane, half_v: Lane) -> SphericalRectangle:
    """Return the spherical rectangle of one centered at `way`, with unit side directions and half side lengths."""
    z = -ops.absolute(ops.dot(way, ops.cross(unit_u, unit_v)))
    z = ops.minimum(z, -1e-9 * (half_u + half_v))
    x, y = ops.dot(way, unit_u), ops.dot(way, unit_v)
    x0, x1, y0, y1 = x - half_u, x + half_u, y - half_v, y + half_v
    # Heights of the unit normals of the four arcs; cosines of the angles between neighbors are their products.
    n0, n2 = -y0 * ops.rsqrt(z * z + y0 * y0), y1 * ops.rsqrt(z * z + y1 * y1)
    n1, n3 = x1 * ops.rsqrt(z * z + x1 * x1), -x0 * ops.rsqrt(z * z + x0 * x0)
    g0, g1 = ops.acos(_unit(-n0 * n1)), ops.acos(_unit(-n1 * n2))
    g2, g3 = ops.acos(_unit(-n2 * n3)), ops.acos(_unit(-n3 * n0))
    k = 2.0 * math.pi - g2 - g3
    return SphericalRectangle(x0, x1, y0, y1, z, n0, n2, k, ops.maximum(g0 + g1 - k, TINY))


@helper
def _unit(x: Lane) -> Lane:
    return ops.clip(x, -1.0, 1.0)


@helper
def sample(rect: SphericalRectangle, u: Lane, v: Lane) -> tuple[Lane, Lane]:
    """Map u, v in [0, 1) uniformly over the solid angle; return coordinates from -1 to 1 along each side."""
    arc = u * rect.solid + rect.k
    sine, cosine = ops.sin(arc), ops.cos(arc)
    bent = (cosine * rect.b0 - rect.b1) / ops.where(ops.absolute(sine) > 1e-20, sine, 1e-20)
    height = ops.clip(ops.rsqrt(ops.maximum(bent * bent + rect.b0 * rect.b0, TINY)), 0.0, 1.0)
    height = ops.where(bent > 0.0, height, -height)
    x = -(height * rect.z) * ops.rsqrt(ops.maximum(1.0 - height * height, 1e-12))
    x = ops.maximum(ops.minimum(x, rect.x1), rect.x0)
    away2 = x * x + rect.z * rect.z
    h0, h1 = rect.y0 * ops.rsqrt(away2 + rect.y0 * rect.y0), rect.y1 * ops.rsqrt(away2 + rect.y1 * rect.y1)
    h = h0 + v * (h1 - h0)
    y = h * ops.sqrt(away2) * ops.rsqrt(ops.maximum(1.0 - h * h, 1e-12))
    y = ops.maximum(ops.minimum(y, rect.y1), rect.y0)
    return 2.0 * (x - rect.x0) / (rect.x1 - rect.x0) - 1.0, 2.0 * (y - rect.y0) / (rect.y1 - rect.y0) - 1.0
