"""Rectangles by the solid angle they fill: directions drawn evenly over it, and how large it is.

Ureña, Fajardo, King 2013, "An Area-Preserving Parametrization for Spherical Rectangles" (EGSR). A rectangle seen from a place is cut by
great circles; one number chooses the strip, the other the height in it. Angles are differences of arcs, whose digits go where a rectangle
is small or far: callers take those by their area, which is as good there (`is_near`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane, Vec

NEAR = 2.0
TINY = 1e-30


class Seen(NamedTuple):
    """A rectangle as seen from a place, which is the origin of a frame along its sides."""

    x0: Lane
    x1: Lane
    y0: Lane
    y1: Lane
    z: Lane  # distance of its plane, > 0 toward the side it is seen from, negated
    b0: Lane  # heights of the normals of its first and third arc
    b1: Lane
    k: Lane
    solid: Lane  # steradians


@helper
def is_near(way: Vec, area: Lane) -> Lane:
    """Whether a rectangle whose middle is `way` off fills so much that its solid angle is worth its price."""
    return ops.dot(way, way) < NEAR * area


@helper
def seen(way: Vec, unit_u: Vec, unit_v: Vec, half_u: Lane, half_v: Lane) -> Seen:
    """A rectangle with its middle `way` off, unit directions of its sides at right angles, and half their lengths."""
    z = -ops.absolute(ops.dot(way, ops.cross(unit_u, unit_v)))
    z = ops.minimum(z, -1e-9 * (half_u + half_v))
    x, y = ops.dot(way, unit_u), ops.dot(way, unit_v)
    x0, x1, y0, y1 = x - half_u, x + half_u, y - half_v, y + half_v
    # Heights of the unit normals of the four arcs; cosines of the angles between neighbours are their products.
    n0, n2 = -y0 * ops.rsqrt(z * z + y0 * y0), y1 * ops.rsqrt(z * z + y1 * y1)
    n1, n3 = x1 * ops.rsqrt(z * z + x1 * x1), -x0 * ops.rsqrt(z * z + x0 * x0)
    g0, g1 = ops.acos(_unit(-n0 * n1)), ops.acos(_unit(-n1 * n2))
    g2, g3 = ops.acos(_unit(-n2 * n3)), ops.acos(_unit(-n3 * n0))
    k = 2.0 * math.pi - g2 - g3
    return Seen(x0, x1, y0, y1, z, n0, n2, k, ops.maximum(g0 + g1 - k, TINY))


@helper
def _unit(x: Lane) -> Lane:
    return ops.clip(x, -1.0, 1.0)


@helper
def draw(rect: Seen, u: Lane, v: Lane) -> tuple[Lane, Lane]:
    """Where on it, from -1 to 1 along each side, two numbers in [0, 1) fall, evenly over its solid angle."""
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


seen_apart, draw_apart = noinline_helper(seen), noinline_helper(draw)
