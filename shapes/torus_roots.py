"""Ray/torus intersection, in lanes: extrema of the quartic divide the ray into parts with at most one root.

Ferrari's formula loses all precision for thin rings and distant eyes. Here the ray starts at its point nearest the center, where the
quartic has no cubic term. The quartic (ρ² + y² + R² - r²)² = 4 R² ρ² only gives the parts. Roots are refined on (ρ - R)² + y² - r², which
does not cancel for a thin tube.
"""

from __future__ import annotations

import math

from .contract import Lane, Vec
from .lanes import helper, ops

INF = math.inf
STEPS = 100  # enough for bisection alone; Newton takes five or six
CLOSE = 4.5e-16  # tolerance relative to the torus' size: two units in the last place


@helper
def torus(ring: Lane, tube: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> Lane:
    """t of a torus about y with ring radius `ring` and tube radius `tube`; the outer surface where tube > ring."""
    speed = ops.sqrt(ops.dot(direction, direction))
    d = ops.scale(direction, 1.0 / speed)
    shift = -ops.dot(origin, d)
    o = (origin[0] + shift * d[0], origin[1] + shift * d[1], origin[2] + shift * d[2])
    outer = (1.0 + 1e-9) * (ring + tube)  # so the ends are outside
    m = ops.dot(o, o)
    found = INF + 0.0 * m
    if ops.any_lane(m < outer * outer):
        reach = ops.sqrt(ops.maximum(outer * outer - m, 0.0))
        c1, c2, c3 = _turning_points(ring, tube, o, d, reach, outer)
        span = (shift, speed, t_min, t_max)
        found = _first_root(ring, tube, o, d, -reach, c1, span, found)
        found = _first_root(ring, tube, o, d, c1, c2, span, found)
        found = _first_root(ring, tube, o, d, c2, c3, span, found)
        found = _first_root(ring, tube, o, d, c3, reach, span, found)
    return ops.where(m < outer * outer, found, INF)


@helper
def _turning_points(ring: Lane, tube: Lane, o: Vec, d: Vec, reach: Lane, size: Lane) -> Vec:
    """Ordered points within ±reach: the roots of 4 t³ + 2 a t + b. Between them t⁴ + a t² + b t + c is monotonic."""
    level = 1.0 - d[1] * d[1]
    a = 2.0 * (ops.dot(o, o) + (ring - tube) * (ring + tube)) - 4.0 * ring * ring * level
    b = 8.0 * ring * ring * o[1] * d[1]
    bend = ops.minimum(ops.sqrt(ops.maximum(-a / 6.0, 0.0)), reach)
    c1 = _cubic_root(a, b, -reach, -bend, size)
    c2 = _cubic_root(a, b, -bend, bend, size)
    c3 = _cubic_root(a, b, bend, reach, size)
    return c1, c2, c3


@helper
def _cubic_root(a: Lane, b: Lane, lo: Lane, hi: Lane, size: Lane) -> Lane:
    """The root of 4 t³ + 2 a t + b in an interval where it is monotonic; hi without a root."""
    below = (4.0 * lo * lo + 2.0 * a) * lo + b < 0.0
    above = (4.0 * hi * hi + 2.0 * a) * hi + b < 0.0
    crosses = below != above
    x = ops.where(crosses, 0.5 * (lo + hi), hi)
    open_ = crosses
    for _ in range(STEPS):
        if not ops.any_lane(open_):
            break
        value = (4.0 * x * x + 2.0 * a) * x + b
        slope = 12.0 * x * x + 2.0 * a
        before = (value < 0.0) == below
        lo, hi = ops.where(before, x, lo), ops.where(before, hi, x)
        x, open_ = _step(x, value, slope, lo, hi, open_, size)
    return x


@helper
def _step(x: Lane, value: Lane, slope: Lane, lo: Lane, hi: Lane, open_: Lane, size: Lane) -> tuple[Lane, Lane]:
    """(a Newton step where it stays between lo and hi, otherwise bisection; the lanes that go on)."""
    newton = x - value / slope
    ends = abs(newton - x) <= CLOSE * size
    inside = (newton > lo) & (newton < hi)
    new = ops.where(ends, x, ops.where(inside, newton, 0.5 * (lo + hi)))
    going = open_ & ops.not_(ends) & (hi - lo > CLOSE * size)
    return ops.where(open_, new, x), going


@helper
def _tube_value(ring: Lane, tube: Lane, o: Vec, d: Vec, t: Lane) -> tuple[Lane, Lane]:
    """(ρ - R)² + y² - r² at o + t d, and its derivative."""
    x, y, z = o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]
    rho = ops.sqrt(x * x + z * z)
    off = rho - ring
    value = (ops.sqrt(off * off + y * y) - tube) * (ops.sqrt(off * off + y * y) + tube)
    return value, 2.0 * (off * (x * d[0] + z * d[2]) / rho + y * d[1])


@helper
def _first_root(ring: Lane, tube: Lane, o: Vec, d: Vec, p0: Lane, p1: Lane, span: tuple[Lane, Lane, Lane, Lane], found: Lane) -> Lane:
    """`found`, or where that is inf, t of the crossing between p0 and p1, if it is in range.

    `span` is (shift, speed, t_min, t_max); t is (x + shift) / speed for a position x on the ray.
    """
    shift, speed, t_min, t_max = span
    outside0 = _tube_value(ring, tube, o, d, p0)[0] > 0.0
    outside1 = _tube_value(ring, tube, o, d, p1)[0] > 0.0
    open_ = (outside0 != outside1) & ((p1 + shift) / speed >= t_min) & ((p0 + shift) / speed <= t_max) & (found == INF)
    wanted = open_
    if ops.any_lane(wanted):
        lo, hi = p0, p1
        x = 0.5 * (lo + hi)
        for _ in range(STEPS):
            if not ops.any_lane(open_):
                break
            value, slope = _tube_value(ring, tube, o, d, x)
            before = (value > 0.0) == outside0
            lo, hi = ops.where(before, x, lo), ops.where(before, hi, x)
            x, open_ = _step(x, value, slope, lo, hi, open_, ring + tube)
        t = (x + shift) / speed
        found = ops.where(wanted & (t > t_min) & (t < t_max), t, found)
    return found


@helper
def crossings(ring: Lane, tube: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """Intervals t0 … t1 and t2 … t3 of a ray inside a torus; inf without; directions may have any length."""
    speed = ops.sqrt(ops.dot(direction, direction))
    d = ops.scale(direction, 1.0 / speed)
    shift = -ops.dot(origin, d)
    o = (origin[0] + shift * d[0], origin[1] + shift * d[1], origin[2] + shift * d[2])
    outer = (1.0 + 1e-9) * (ring + tube)
    m = ops.dot(o, o)
    none = INF + 0.0 * m
    near = m < outer * outer
    if not ops.any_lane(near):
        return none, none, none, none
    reach = ops.sqrt(ops.maximum(outer * outer - m, 0.0))
    c1, c2, c3 = _turning_points(ring, tube, o, d, reach, outer)
    span = (shift, speed, -none, none)
    t0 = _first_root(ring, tube, o, d, -reach, c1, span, none)
    t1 = _first_root(ring, tube, o, d, c1, c2, span, none)
    t2 = _first_root(ring, tube, o, d, c2, c3, span, none)
    t3 = _first_root(ring, tube, o, d, c3, reach, span, none)
    t0, t1 = ops.minimum(t0, t1), ops.maximum(t0, t1)  # moves parts without a crossing to the end
    t2, t3 = ops.minimum(t2, t3), ops.maximum(t2, t3)
    t0, t2 = ops.minimum(t0, t2), ops.maximum(t0, t2)
    t1, t3 = ops.minimum(t1, t3), ops.maximum(t1, t3)
    t1, t2 = ops.minimum(t1, t2), ops.maximum(t1, t2)
    return ops.where(near, t0, INF), ops.where(near, t1, INF), ops.where(near, t2, INF), ops.where(near, t3, INF)
