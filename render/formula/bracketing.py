"""Roots of a formula along ray segments: sphere-tracing steps, bounds that exclude a root, and refinement of a bracket."""

from __future__ import annotations

from typing import NamedTuple

from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane
from .evaluate import RayFunction, value_on

ULP = 2.0**-52
MAX_ITERATIONS = 80  # of bracketing; bisection alone needs 52
MAX_ILLINOIS = 24  # iterations before pure bisection: for values such as 1e-19 before a face and 0.1 behind it, secants do not converge
MAX_STEPS, MIN_STEP = 16, 0.02  # of sphere tracing through a cell; the shortest step as a share of the segment
MAX_SLOPE = 1e90
NEAR = 1e-6  # share of both ends' values: bounds above it exceed rounding
LARGEST = 1e290  # of values: bounds do not separate larger ones, and give no slopes


class SegmentBounds(NamedTuple):
    """Values at both ends of a segment, and bounds of the slope in between."""

    near: Lane
    far: Lane
    low: Lane
    high: Lane


class Bracket(NamedTuple):
    """A segment a … b with one root, and the values at its ends."""

    a: Lane
    b: Lane
    at_a: Lane
    at_b: Lane


@helper
def excludes_root(ends: SegmentBounds, length: Lane) -> Lane:
    """Whether end values of one sign and slope bounds exclude a root in segments of a length.

    The slope bounds limit how fast |f| falls from both ends. A root is excluded where the two lines intersect above 0 (Piyavskii 1972;
    Shubert 1972).
    """
    a, b, low, high = ends.near, ends.far, ends.low, ends.high
    up = a > 0.0
    least, most = ops.where(up, low, -high), ops.where(up, high, -low)
    size_a, size_b = abs(a), abs(b)
    steep = most - least
    x = ops.where(steep > 0.0, (size_a - size_b + most * length) / ops.where(steep > 0.0, steep, 1.0), 0.0)
    lowest = size_a + least * ops.clip(x, 0.0, length)
    sizes = size_a + size_b
    return (lowest > NEAR * sizes) & (sizes < LARGEST) & (((a > 0.0) & (b > 0.0)) | ((a < 0.0) & (b < 0.0)))


@noinline_helper
def sphere_trace(ray, a, b, ends, mask):
    """(new begin, lanes that may still have a root) of segments a … b after steps in which slope bounds exclude a root.

    Hart, "Sphere Tracing", The Visual Computer 1996, with a proved slope bound.
    """
    up = ends.near > 0.0
    steep = ops.where(up, -ends.low, ends.high)
    steep = ops.where(steep > 0.0, steep, 0.0)
    distance, f = a, ends.near
    least = MIN_STEP * (b - a)
    working = mask & (steep > 0.0) & (steep < MAX_SLOPE)
    for _ in range(MAX_STEPS):
        step = (1.0 - 1e-9) * abs(f) / ops.where(working, steep, 1.0)
        working = working & (step > least)
        if ops.not_(ops.any_lane(working)):
            break
        distance = ops.where(working, distance + step, distance)
        passed = working & (distance >= b)
        mask, working = mask & ops.not_(passed), working & ops.not_(passed)
        f = ops.where(working, value_on(ray, ops.minimum(distance, b), working), f)
    return distance, mask


@helper
def refine_bracket(ray: RayFunction, bracket: Bracket, begin: Lane, reach: float, mask: Lane) -> Lane:
    """The root in a bracket, by the Illinois method (Dowell and Jarratt 1971), with bisection where that is slow.

    `begin` is the distance of the rays' starts from their origins, `reach` the surface's largest coordinate: they set the tolerance.
    """
    a, b, fa, fb = bracket
    enough = 4.0 * ULP * (begin + b + reach)
    side = 0.0 * a
    working = mask & (b - a > enough)
    for turn in range(MAX_ITERATIONS):
        if ops.not_(ops.any_lane(working)):
            break
        width = b - a
        share = fa / (fa - fb)
        good = (share > 0.0) & (share < 1.0) & (turn % 8 != 7) & (turn < MAX_ILLINOIS)
        step = ops.clip(width * ops.where(good, share, 0.5), 0.25 * enough, width - 0.25 * enough)
        middle = a + step
        f = value_on(ray, middle, working)
        same = ((f <= 0.0) & (fa <= 0.0)) | (ops.not_(f <= 0.0) & ops.not_(fa <= 0.0))
        on_a, on_b = working & same, working & ops.not_(same)
        fb = ops.where(on_a & (side > 0.0), 0.5 * fb, fb)
        fa = ops.where(on_b & (side < 0.0), 0.5 * fa, fa)
        a, fa = ops.where(on_a, middle, a), ops.where(on_a, f, fa)
        b, fb = ops.where(on_b, middle, b), ops.where(on_b, f, fb)
        side = ops.where(on_a, 1.0, ops.where(on_b, -1.0, side))
        working = working & (b - a > enough) & (f != 0.0)
    return ops.where(fb == 0.0, b, ops.where(fa == 0.0, a, 0.5 * (a + b)))
