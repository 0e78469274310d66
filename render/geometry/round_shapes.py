"""Ray intersection in closed form, in lanes: spheres, cylinders, cones, capsules and quadrics.

A convex solid is an interval (lo, hi) of t, empty as (inf, -inf): a ray that enters it leaves it, in spite of rounding. The roots of
a t² - 2 b t + c = 0 are c/q and q/a with q = b ± √D of the sign of b, which avoids cancellation (Numerical Recipes §5.6; Haines et al.,
Ray Tracing Gems, chapter 7).
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from .flat_shapes import nearest, slab

INF = math.inf


@helper
def ordered_roots(a: Lane, b: Lane, c: Lane, discriminant: Lane) -> tuple[Lane, Lane]:
    """Roots of a t² - 2 b t + c = 0, lower first; NaN where the discriminant (b² - a c) is negative."""
    root = ops.sqrt(discriminant)
    q = ops.where(b < 0.0, b - root, b + root)
    far = q / a
    near = ops.where(q == 0.0, far, c / q)
    return ops.where(near < far, near, far), ops.where(near < far, far, near)


@helper
def sphere_interval(radius: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane]:
    """The interval of t inside a sphere centered at the origin.

    The discriminant is r² minus the squared distance of the line, not b² - a c, which cancels for a distant sphere.
    """
    a = ops.dot(direction, direction)
    b = -ops.dot(origin, direction)
    foot = b / a
    x = origin[0] + foot * direction[0]
    y = origin[1] + foot * direction[1]
    z = origin[2] + foot * direction[2]
    distance = ops.sqrt(x * x + y * y + z * z)
    away = ops.sqrt(ops.dot(origin, origin))
    discriminant = a * (radius - distance) * (radius + distance)
    lo, hi = ordered_roots(a, b, (away - radius) * (away + radius), discriminant)
    hit = discriminant >= 0.0
    return ops.where(hit, lo, INF), ops.where(hit, hi, -INF)


@helper
def sphere(radius: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> Lane:
    """t of a sphere centered at the origin."""
    lo, hi = sphere_interval(radius, origin, direction)
    return nearest(lo, hi, t_min, t_max)


@helper
def _side_roots(middle: Lane, slope: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(lo, hi, a, c) of x² + z² = w², w = middle + slope y: an infinite double cone, a cylinder for slope 0.

    It is solved at the ray's point nearest to the frame's origin, which limits the loss of precision to that of the eye's distance. With
    d and o the direction and that point in the xz plane, D = |w d - slope d_y o|² - (o × d)². `c` is the constant term there.
    """
    shift = -ops.dot(origin, direction) / ops.dot(direction, direction)
    ox, oy, oz = ops.along(origin, direction, shift)
    dx, dy, dz = direction
    w = middle + slope * oy
    change = slope * dy
    a = dx * dx + dz * dz - change * change
    b = change * w - ox * dx - oz * dz
    rho = ops.sqrt(ox * ox + oz * oz)
    c = (rho - w) * (rho + w)
    vx, vz = w * dx - change * ox, w * dz - change * oz
    reach = ops.sqrt(vx * vx + vz * vz)
    side = abs(ox * dz - oz * dx)
    discriminant = (reach - side) * (reach + side)
    # steeper than the cone: a line through the apex touches both halves, and only rounding makes D negative
    discriminant = ops.where((a < 0.0) & (discriminant < 0.0), 0.0, discriminant)
    lo, hi = ordered_roots(a, b, c, discriminant)
    return lo + shift, hi + shift, a, c


@helper
def cone_interval(bottom: Lane, top: Lane, half: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(lo, hi, part at lo, part at hi) of t inside a capped cone; parts 0 side, 1 bottom, 2 top."""
    middle = 0.5 * (bottom + top)
    slope = 0.5 * (top - bottom) / half
    lo, hi, a, c = _side_roots(middle, slope, origin, direction)
    # a < 0: the two half-lines beyond the roots are inside; the slab keeps the one where the radius is positive
    upward = slope * direction[1] > 0.0
    inside_lo = ops.where(a < 0.0, ops.where(upward, hi, -INF), lo)
    inside_hi = ops.where(a < 0.0, ops.where(upward, INF, lo), hi)
    along = (direction[0] == 0.0) & (direction[2] == 0.0) & (a == 0.0)  # a cylinder's axis
    inside_lo = ops.where(along, ops.where(c <= 0.0, -INF, INF), inside_lo)
    inside_hi = ops.where(along, ops.where(c <= 0.0, INF, -INF), inside_hi)
    y0, y1 = slab(origin[1], direction[1], half)
    start = ops.where(y0 > inside_lo, y0, inside_lo)
    end = ops.where(y1 < inside_hi, y1, inside_hi)
    hit = start <= end
    rising = direction[1] > 0.0
    part_lo = ops.where(y0 > inside_lo, ops.where(rising, 1, 2), 0)
    part_hi = ops.where(y1 < inside_hi, ops.where(rising, 2, 1), 0)
    return ops.where(hit, start, INF), ops.where(hit, end, -INF), part_lo, part_hi


@helper
def cone(bottom: Lane, top: Lane, half: Lane, capped: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """(t, part) of a cone or cylinder about y with radius `bottom` at -half and `top` at +half."""
    lo, hi, part_lo, part_hi = cone_interval(bottom, top, half, origin, direction)
    solid = nearest(lo, hi, t_min, t_max)
    part = ops.where(solid == lo, part_lo, part_hi)
    s0, s1, _, _ = _side_roots(0.5 * (bottom + top), 0.5 * (top - bottom) / half, origin, direction)
    y0 = origin[1] + s0 * direction[1]
    y1 = origin[1] + s1 * direction[1]
    s0 = ops.where(abs(y0) <= half, s0, INF)
    s1 = ops.where(abs(y1) <= half, s1, INF)
    closed = capped != 0.0
    return ops.where(closed, solid, nearest(s0, s1, t_min, t_max)), ops.where(closed, part, 0)


@helper
def capsule(radius: Lane, half: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> Lane:
    """t of a capsule: its interval is the hull of those of the cylinder and the two spheres, since it is convex."""
    lo, hi, _, _ = cone_interval(radius, radius, half, origin, direction)
    lo_top, hi_top = sphere_interval(radius, (origin[0], origin[1] - half, origin[2]), direction)
    lo_bottom, hi_bottom = sphere_interval(radius, (origin[0], origin[1] + half, origin[2]), direction)
    lo = ops.minimum(lo, ops.minimum(lo_top, lo_bottom))
    hi = ops.maximum(hi, ops.maximum(hi_top, hi_bottom))
    return nearest(lo, hi, t_min, t_max)


@helper
def quadric_value(parameters, g: Lane, p: Vec) -> Lane:
    """A x² + B y² + C z² + D x y + E y z + F x z + G x + H y + I z + J."""
    x, y, z = p
    return _quadratic_part(parameters, g, p) + parameters[g, 6] * x + parameters[g, 7] * y + parameters[g, 8] * z + parameters[g, 9]


@helper
def _quadratic_part(parameters, g: Lane, p: Vec) -> Lane:
    x, y, z = p
    second = parameters[g, 0] * x * x + parameters[g, 1] * y * y + parameters[g, 2] * z * z
    return second + (parameters[g, 3] * x * y + parameters[g, 4] * y * z + parameters[g, 5] * x * z)


@helper
def quadric_gradient(parameters, g: Lane, p: Vec) -> Vec:
    """The gradient of `quadric_value`."""
    x, y, z = p
    d, e, f = parameters[g, 3], parameters[g, 4], parameters[g, 5]
    return (
        2.0 * parameters[g, 0] * x + d * y + f * z + parameters[g, 6],
        2.0 * parameters[g, 1] * y + d * x + e * z + parameters[g, 7],
        2.0 * parameters[g, 2] * z + e * y + f * x + parameters[g, 8],
    )


@helper
def quadric(parameters, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> Lane:
    """t of a quadric inside its box: the nearest root in range that lies in the box."""
    shift = -ops.dot(origin, direction) / ops.dot(direction, direction)
    o = (origin[0] + shift * direction[0], origin[1] + shift * direction[1], origin[2] + shift * direction[2])
    c = quadric_value(parameters, g, o)
    b = -0.5 * ops.dot(quadric_gradient(parameters, g, o), direction)
    a = _quadratic_part(parameters, g, direction)  # not from values, whose constant term would cancel it
    lo, hi = ordered_roots(a, b, c, b * b - a * c)
    lo = ops.where(_in_box(parameters, g, o, direction, lo), lo + shift, INF)
    hi = ops.where(_in_box(parameters, g, o, direction, hi), hi + shift, INF)
    return nearest(lo, hi, t_min, t_max)


@helper
def _in_box(parameters, g: Lane, o: Vec, d: Vec, t: Lane) -> Lane:
    x = abs(o[0] + t * d[0]) <= parameters[g, 10]
    y = abs(o[1] + t * d[1]) <= parameters[g, 11]
    z = abs(o[2] + t * d[2]) <= parameters[g, 12]
    return x & y & z & (abs(t) < INF)
