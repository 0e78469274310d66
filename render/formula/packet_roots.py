"""Roots of a packet's rays in their brackets: narrowed in float32 side by side, then refined to rounding in float64."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .bracketing import Bracket, refine_bracket
from .discontinuities import discontinuity_normal, whole_tape
from .evaluate import EvalBuffers, RayFunction, gradient_and_value_at, value_on
from .hit_geometry import MANIFOLD, gradient_at, normal_and_spacing
from .llvm_math import LANES
from .packet_state import OPEN, SPACED, VECTOR, U, are_consecutive, evaluate_points, load_numbers, load_single, ray_function, to_surface

MAX_ITERATIONS = 12
MAX_NEWTON_STEPS = 5
STRAIGHT = 2.0**-18  # share of the value that a Newton step leaves where the slope hardly changes; then the gradient hardly changes either
SHARE = 0.125  # of the error of values, below which float32 values are insignificant: bounds of the error are wide


class Hits(NamedTuple):
    """A HitColumns, and the rays of a packet: columns of `rays` from `first` on, in the frame to which `inverse` transforms."""

    t: Any
    instance: Any
    spacing: Any
    u: Any
    v: Any
    number: int
    rays: Any
    first: int
    inverse: Any


class Traversal(NamedTuple):
    """A packet on its way through a surface, and what its slabs share."""

    packet: Any  # a Handle of PacketState
    memory: EvalBuffers
    groups: int
    vectors: int
    start: float  # distance of the packet's begin from the rays' origins
    reach: float  # largest coordinate
    slack: float  # by which boxes grow for rounding
    hits: Hits


class Segments(NamedTuple):
    """Sixteen segments of rays, as rows of PacketState.brackets and open."""

    begin: Any
    end: Any
    at_begin: Any  # values
    at_end: Any
    slope: Any  # least slope; of an open segment the length of its next piece
    side: Any
    error: Any  # of values
    ray: Any


@helper
def append_segments(rows: Any, rays: Any, count: int, mask: Any, x: Segments) -> int:
    """Append segments in the lanes of a mask to the first `count`; return the new count."""
    simd.compress_store(rows, count, x.begin, mask)
    simd.compress_store(rows, OPEN + count, x.end, mask)
    simd.compress_store(rows, 2 * OPEN + count, x.at_begin, mask)
    simd.compress_store(rows, 3 * OPEN + count, x.at_end, mask)
    simd.compress_store(rows, 4 * OPEN + count, x.slope, mask)
    simd.compress_store(rows, 5 * OPEN + count, x.side, mask)
    simd.compress_store(rows, 8 * OPEN + count, x.error, mask)
    return count + simd.compress_store(rays, count, x.ray, mask)


@noinline_helper
def refine_brackets(trace, tape, count):
    """Refine the root in each bracket and write the hits."""
    packet = trace.packet
    rows, registers = packet.brackets, packet.registers
    many = (count + VECTOR - 1) // VECTOR
    for k in range(count, many * VECTOR):  # the lanes beyond repeat the last bracket
        packet.bracket_ray[k] = packet.bracket_ray[count - 1]
        for row in range(9):
            rows[row * OPEN + k] = rows[row * OPEN + count - 1]
    for k in range(many):
        ray = simd.load(packet.bracket_ray, k * VECTOR, VECTOR)
        for row in range(6):
            simd.store(packet.packed, row * OPEN + k * VECTOR, load_single(packet.rays, row, ray))
        for row in range(2):
            simd.store(rows, (6 + row) * OPEN + k * VECTOR, simd.load(rows, row * OPEN + k * VECTOR, VECTOR))
    enough = 8.0 * U * trace.reach
    for turn in range(MAX_ITERATIONS):
        working = False
        for k in range(many):
            s = _guess(rows, k * VECTOR, turn)
            for axis in range(3):
                o = simd.load(packet.packed, axis * OPEN + k * VECTOR, VECTOR)
                d = simd.load(packet.packed, (3 + axis) * OPEN + k * VECTOR, VECTOR)
                simd.store(registers, (axis * many + k) * VECTOR, simd.fma(d, s, o))
        evaluate_points(packet, tape, many)
        out = packet.tapes[tape, 2] * many
        for k in range(many):
            f = simd.load(registers, (out + k) * VECTOR, VECTOR)
            working = _narrow(rows, k * VECTOR, turn, f, enough) or working
        if not working:
            break
    for first in range(0, count, LANES):
        _polish(trace, tape, first, count)


@helper
def _guess(rows: Any, at: int, turn: int) -> Any:
    """Where the secant of a bracket crosses 0; in every sixth iteration the middle."""
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * OPEN + at, VECTOR), simd.load(rows, 3 * OPEN + at, VECTOR)
    if turn % 6 == 5:
        return 0.5 * (a + b)
    share = fa / (fa - fb)
    share = simd.select((share >= 0.0) & (share <= 1.0), share, 0.5)
    return simd.minimum(simd.maximum(simd.fma(b - a, share, a), a), b)


@helper
def _narrow(rows: Any, at: int, turn: int, f: Any, enough: float) -> bool:
    """Replace one end of a bracket by the guess, by the Illinois method; return whether any lane needs more iterations.

    Where the value at the guess is insignificant, the bracket shrinks to the guess.
    """
    s = _guess(rows, at, turn)
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * OPEN + at, VECTOR), simd.load(rows, 3 * OPEN + at, VECTOR)
    side = simd.load(rows, 5 * OPEN + at, VECTOR)
    done = (b - a <= enough) | (side == 2.0)
    close = 0.4 * enough * simd.load(rows, 4 * OPEN + at, VECTOR)  # by the least slope, the root is then within 0.4 · enough
    there = ~done & ~(abs(f) > simd.maximum(SHARE * simd.load(rows, 8 * OPEN + at, VECTOR), close))
    same = (f <= 0.0) == (fa <= 0.0)
    on_a, on_b = ~done & ~there & same, ~done & ~there & ~same
    fb = simd.select(on_a & (side > 0.0), 0.5 * fb, fb)
    fa = simd.select(on_b & (side < 0.0), 0.5 * fa, fa)
    simd.store(rows, at, simd.select(on_a | there, s, a))
    simd.store(rows, OPEN + at, simd.select(on_b | there, s, b))
    simd.store(rows, 2 * OPEN + at, simd.select(on_a, f, fa))
    simd.store(rows, 3 * OPEN + at, simd.select(on_b, f, fb))
    side = simd.select(on_a, 1.0, simd.select(on_b, -1.0, side))
    simd.store(rows, 5 * OPEN + at, simd.select(there, 2.0, side))
    return simd.any_of(~done & ~there)


@noinline_helper
def _polish(trace, tape, first, count):
    """Refine LANES float32 roots in float64 by Newton steps until the value is negligible, else by bracketing.

    Near points where the gradient vanishes it changes within a step: only the value there bounds the distance of the root.
    """
    packet, start, reach = trace.packet, trace.start, trace.reach
    rows = packet.brackets
    index = load_numbers(packet.bracket_ray, first)
    mask = crosslane.lane_indices(first) < count
    ray = ray_function(packet, trace.memory, tape, index)
    d = ray.direction
    a, b = crosslane.load_row(rows, first), crosslane.load_row(rows, OPEN + first)
    fa, fb = crosslane.load_row(rows, 2 * OPEN + first), crosslane.load_row(rows, 3 * OPEN + first)
    steep, side = crosslane.load_row(rows, 4 * OPEN + first), crosslane.load_row(rows, 5 * OPEN + first)
    low, high = packet.exact[6 * SPACED + index], packet.exact[7 * SPACED + index]
    there = side == 2.0
    share = fa / (fa - fb)
    at = ops.where(there, a, a + (b - a) * ops.where((share >= 0.0) & (share <= 1.0), share, 0.5))
    begin, end = crosslane.load_row(rows, 6 * OPEN + first), crosslane.load_row(rows, 7 * OPEN + first)
    rounding = 2.0**-28 * crosslane.load_row(rows, 8 * OPEN + first)
    at, slope, gradient, off, good = _newton(ray, at, begin, end, steep, rounding, reach, mask)
    bad = mask & ops.not_(good)
    if packet.places[0, 5] != 0:  # the slope does not bound a jump
        bad = mask
    if ops.any_lane(bad):
        f_begin, f_end = value_on(ray, begin, bad), value_on(ray, end, bad)
        root = refine_bracket(ray, Bracket(begin, end, f_begin, f_end), at * 0.0 + start, reach, bad)
        at = ops.where(bad, root, at)
        value = value_on(ray, at, bad)
        gradient = ops.where3(bad, gradient_at(ray, at, start + at + reach, bad), gradient)
        off = ops.where(bad, MANIFOLD * abs(value), off)
        inside = ops.where(bad, f_begin, -slope) <= 0.0
        at, gradient, off = correct_at_discontinuity(trace, index, d, at, inside, gradient, off, bad)
        write_hits(trace, index, d, at, off, gradient, inside, mask & (at >= low) & (at <= high))
    else:
        write_hits(trace, index, d, at, off, gradient, slope > 0.0, mask & (at >= low) & (at <= high))


@helper
def _newton(
    ray: RayFunction, at: Lane, begin: Lane, end: Lane, steep: Lane, rounding: Lane, reach: float, mask: Lane
) -> tuple[Lane, Lane, Vec, Lane, Lane]:
    """(distance, slope, gradient, bound of the value, lanes that converged) after Newton steps from distances `at`."""
    least, d = 0.99 * steep, ray.direction
    slope, gradient = 0.0 * at, d
    far, off, good, settled = 0.0 * at + 1e-4 * reach, 0.0 * at, mask, mask
    for turn in range(MAX_NEWTON_STEPS):
        p = ops.along(ray.start, d, at)
        value, gx, gy, gz = gradient_and_value_at(ray.forms, ray.k, ray.tape, ray.memory, p, mask)
        gradient = (gx, gy, gz)
        slope = ops.dot(gradient, d)
        if turn == 0:
            far = ops.minimum(2.0 * abs(value) / steep, far)
        step = ops.clip(-value / slope, -far, far)
        good = good & (abs(slope) >= least) & (abs(at + step - 0.5 * (begin + end)) <= 0.5 * (end - begin) + far)
        at = at + ops.where(good, step, 0.0)
        rest = value_on(ray, at, mask)
        straight = abs(rest) <= STRAIGHT * abs(value)
        settled = (straight | (abs(rest) <= rounding)) & (abs(rest) <= 1e-9 * reach * steep)  # so near by the least slope
        off = ops.where(straight, 4.0 * STRAIGHT, 1.0) * abs(rest) + rounding
        at = at - ops.where(good & straight, rest / slope, 0.0)
        if not ops.any_lane(mask & good & ops.not_(settled)):
            break
    return at, slope, gradient, off, good & settled


@helper
def correct_at_discontinuity(
    trace: Traversal, ray: Lane, direction: Vec, at: Lane, inside: Lane, gradient: Vec, off: Lane, mask: Lane
) -> tuple[Lane, Vec, Lane]:
    """(distance, gradient, bound of the value) of roots, corrected where the formula may jump or end."""
    packet, hits = trace.packet, trace.hits
    if packet.places[0, 5] != 0:
        origin = to_surface(hits.rays, hits.first + ray, hits.inverse)
        whole = whole_tape(packet, 0, trace.memory, origin, direction, at)
        face = discontinuity_normal(whole, trace.start + at, inside, gradient, off, mask)
        at, gradient, off = ops.where(face.settled, face.at - trace.start, at), face.gradient, face.off
    return at, gradient, off


@helper
def write_hits(trace: Traversal, ray: Lane, direction: Vec, at: Lane, off: Lane, gradient: Vec, inside: Lane, mask: Lane) -> None:
    """Write the hits of rays in the lanes of a mask, and deactivate these rays."""
    packet, hits = trace.packet, trace.hits
    units, u, v = normal_and_spacing(packet, 0, direction, gradient, inside, off)
    number, column = ops.int_like(at, hits.number), hits.first + ray
    if are_consecutive(ray) and ops.not_(ops.any_lane(ops.not_(mask))):
        begin = crosslane.lane(column, 0)
        t = (trace.start + at) / crosslane.load_row(packet.exact, 8 * SPACED + crosslane.lane(ray, 0))
        crosslane.store_row(hits.t, begin, t)
        crosslane.store_row(hits.instance, begin, number)
        crosslane.store_row(hits.spacing, begin, units)
        crosslane.store_row(hits.u, begin, u)
        crosslane.store_row(hits.v, begin, v)
    else:
        crosslane.scatter_masked(hits.t, column, (trace.start + at) / packet.exact[8 * SPACED + ray], mask)
        crosslane.scatter_masked(hits.instance, column, number, mask)
        crosslane.scatter_masked(hits.spacing, column, units, mask)
        crosslane.scatter_masked(hits.u, column, u, mask)
        crosslane.scatter_masked(hits.v, column, v, mask)
    bit, rest = ops.int_like(at, 1) << (ray & (VECTOR - 1)), mask
    while ops.any_lane(rest):
        first, here = crosslane.uniform_group(ray & -VECTOR, rest)
        packet.alive[first // VECTOR] &= ~crosslane.total(ops.where(here, bit, 0))
        rest = rest & ops.not_(here)


@helper
def write_occlusion(trace: Traversal, ray: int) -> None:
    """Write that a ray has hit anything, and deactivate it."""
    trace.hits.t[trace.hits.first + ray] = -np.inf
    trace.packet.alive[ray // VECTOR] &= ~(1 << (ray % VECTOR))
