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
from .packet_state import (
    END,
    ENTER,
    ERROR,
    FIRST_BEGIN,
    FIRST_END,
    LEAVE,
    LENGTH,
    OPEN,
    SIDE,
    SLOPE,
    VALUE_AT_BEGIN,
    VALUE_AT_END,
    VECTOR,
    U,
    are_consecutive,
    evaluate_points,
    load_numbers,
    load_single,
    ray_function,
    to_surface,
)
from .tables import DISCONTINUITY, RESULT

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
    simd.compress_store(rows, END + count, x.end, mask)
    simd.compress_store(rows, VALUE_AT_BEGIN + count, x.at_begin, mask)
    simd.compress_store(rows, VALUE_AT_END + count, x.at_end, mask)
    simd.compress_store(rows, SLOPE + count, x.slope, mask)
    simd.compress_store(rows, SIDE + count, x.side, mask)
    simd.compress_store(rows, ERROR + count, x.error, mask)
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
        out = packet.tapes[tape, RESULT] * many
        for k in range(many):
            f = simd.load(registers, (out + k) * VECTOR, VECTOR)
            working = _narrow(rows, k * VECTOR, turn, f, enough) or working
        if not working:
            break
    for first in range(0, count, LANES):
        _polish(trace, tape, first, count)


@helper
def _guess(rows: Any, column: int, turn: int) -> Any:
    """Where the secant of a bracket crosses 0; in every sixth iteration the middle."""
    a, b = simd.load(rows, column, VECTOR), simd.load(rows, END + column, VECTOR)
    fa, fb = simd.load(rows, VALUE_AT_BEGIN + column, VECTOR), simd.load(rows, VALUE_AT_END + column, VECTOR)
    if turn % 6 == 5:
        return 0.5 * (a + b)
    share = fa / (fa - fb)
    share = simd.select((share >= 0.0) & (share <= 1.0), share, 0.5)
    return simd.minimum(simd.maximum(simd.fma(b - a, share, a), a), b)


@helper
def _narrow(rows: Any, column: int, turn: int, f: Any, enough: float) -> bool:
    """Replace one end of a bracket by the guess, by the Illinois method; return whether any lane needs more iterations.

    Where the value at the guess is insignificant, the bracket shrinks to the guess.
    """
    s = _guess(rows, column, turn)
    a, b = simd.load(rows, column, VECTOR), simd.load(rows, END + column, VECTOR)
    fa, fb = simd.load(rows, VALUE_AT_BEGIN + column, VECTOR), simd.load(rows, VALUE_AT_END + column, VECTOR)
    side = simd.load(rows, SIDE + column, VECTOR)
    done = (b - a <= enough) | (side == 2.0)
    close = 0.4 * enough * simd.load(rows, SLOPE + column, VECTOR)  # by the least slope, the root is then within 0.4 · enough
    negligible = ~done & ~(abs(f) > simd.maximum(SHARE * simd.load(rows, ERROR + column, VECTOR), close))
    same = (f <= 0.0) == (fa <= 0.0)
    on_a, on_b = ~done & ~negligible & same, ~done & ~negligible & ~same
    fb = simd.select(on_a & (side > 0.0), 0.5 * fb, fb)
    fa = simd.select(on_b & (side < 0.0), 0.5 * fa, fa)
    simd.store(rows, column, simd.select(on_a | negligible, s, a))
    simd.store(rows, END + column, simd.select(on_b | negligible, s, b))
    simd.store(rows, VALUE_AT_BEGIN + column, simd.select(on_a, f, fa))
    simd.store(rows, VALUE_AT_END + column, simd.select(on_b, f, fb))
    side = simd.select(on_a, 1.0, simd.select(on_b, -1.0, side))
    simd.store(rows, SIDE + column, simd.select(negligible, 2.0, side))
    return simd.any_of(~done & ~negligible)


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
    a, b = crosslane.load_row(rows, first), crosslane.load_row(rows, END + first)
    fa, fb = crosslane.load_row(rows, VALUE_AT_BEGIN + first), crosslane.load_row(rows, VALUE_AT_END + first)
    steep, side = crosslane.load_row(rows, SLOPE + first), crosslane.load_row(rows, SIDE + first)
    low, high = packet.exact[ENTER + index], packet.exact[LEAVE + index]
    settled = side == 2.0
    share = fa / (fa - fb)
    distance = ops.where(settled, a, a + (b - a) * ops.where((share >= 0.0) & (share <= 1.0), share, 0.5))
    begin, end = crosslane.load_row(rows, FIRST_BEGIN + first), crosslane.load_row(rows, FIRST_END + first)
    rounding = 2.0**-28 * crosslane.load_row(rows, ERROR + first)
    distance, slope, gradient, off, good = _newton(ray, distance, begin, end, steep, rounding, reach, mask)
    bad = mask & ops.not_(good)
    if packet.places[0, DISCONTINUITY] != 0:  # the slope does not bound a jump
        bad = mask
    if ops.any_lane(bad):
        f_begin, f_end = value_on(ray, begin, bad), value_on(ray, end, bad)
        root = refine_bracket(ray, Bracket(begin, end, f_begin, f_end), distance * 0.0 + start, reach, bad)
        distance = ops.where(bad, root, distance)
        value = value_on(ray, distance, bad)
        gradient = ops.where3(bad, gradient_at(ray, distance, start + distance + reach, bad), gradient)
        off = ops.where(bad, MANIFOLD * abs(value), off)
        inside = ops.where(bad, f_begin, -slope) <= 0.0
        distance, gradient, off = correct_at_discontinuity(trace, index, d, distance, inside, gradient, off, bad)
        write_hits(trace, index, d, distance, off, gradient, inside, mask & (distance >= low) & (distance <= high))
    else:
        write_hits(trace, index, d, distance, off, gradient, slope > 0.0, mask & (distance >= low) & (distance <= high))


@helper
def _newton(
    ray: RayFunction, distance: Lane, begin: Lane, end: Lane, steep: Lane, rounding: Lane, reach: float, mask: Lane
) -> tuple[Lane, Lane, Vec, Lane, Lane]:
    """(distance, slope, gradient, bound of the value, lanes that converged) after Newton steps from distances `distance`."""
    least, d = 0.99 * steep, ray.direction
    slope, gradient = 0.0 * distance, d
    far, off, good, settled = 0.0 * distance + 1e-4 * reach, 0.0 * distance, mask, mask
    for turn in range(MAX_NEWTON_STEPS):
        p = ops.along(ray.start, d, distance)
        value, gx, gy, gz = gradient_and_value_at(ray.forms, ray.k, ray.tape, ray.memory, p, mask)
        gradient = (gx, gy, gz)
        slope = ops.dot(gradient, d)
        if turn == 0:
            far = ops.minimum(2.0 * abs(value) / steep, far)
        step = ops.clip(-value / slope, -far, far)
        good = good & (abs(slope) >= least) & (abs(distance + step - 0.5 * (begin + end)) <= 0.5 * (end - begin) + far)
        distance = distance + ops.where(good, step, 0.0)
        residual = value_on(ray, distance, mask)
        straight = abs(residual) <= STRAIGHT * abs(value)
        settled = (straight | (abs(residual) <= rounding)) & (abs(residual) <= 1e-9 * reach * steep)  # so near by the least slope
        off = ops.where(straight, 4.0 * STRAIGHT, 1.0) * abs(residual) + rounding
        distance = distance - ops.where(good & straight, residual / slope, 0.0)
        if not ops.any_lane(mask & good & ops.not_(settled)):
            break
    return distance, slope, gradient, off, good & settled


@helper
def correct_at_discontinuity(
    trace: Traversal, ray: Lane, direction: Vec, distance: Lane, inside: Lane, gradient: Vec, off: Lane, mask: Lane
) -> tuple[Lane, Vec, Lane]:
    """(distance, gradient, bound of the value) of roots, corrected where the formula may jump or end."""
    packet, hits = trace.packet, trace.hits
    if packet.places[0, DISCONTINUITY] != 0:
        origin = to_surface(hits.rays, hits.first + ray, hits.inverse)
        surface_function = whole_tape(packet, 0, trace.memory, origin, direction, distance)
        face = discontinuity_normal(surface_function, trace.start + distance, inside, gradient, off, mask)
        distance, gradient, off = ops.where(face.settled, face.distance - trace.start, distance), face.gradient, face.off
    return distance, gradient, off


@helper
def write_hits(trace: Traversal, ray: Lane, direction: Vec, distance: Lane, off: Lane, gradient: Vec, inside: Lane, mask: Lane) -> None:
    """Write the hits of rays in the lanes of a mask, and deactivate these rays."""
    packet, hits = trace.packet, trace.hits
    units, u, v = normal_and_spacing(packet, 0, direction, gradient, inside, off)
    number, column = ops.int_like(distance, hits.number), hits.first + ray
    if are_consecutive(ray) and ops.not_(ops.any_lane(ops.not_(mask))):
        begin = crosslane.lane(column, 0)
        t = (trace.start + distance) / crosslane.load_row(packet.exact, LENGTH + crosslane.lane(ray, 0))
        crosslane.store_row(hits.t, begin, t)
        crosslane.store_row(hits.instance, begin, number)
        crosslane.store_row(hits.spacing, begin, units)
        crosslane.store_row(hits.u, begin, u)
        crosslane.store_row(hits.v, begin, v)
    else:
        crosslane.scatter_masked(hits.t, column, (trace.start + distance) / packet.exact[LENGTH + ray], mask)
        crosslane.scatter_masked(hits.instance, column, number, mask)
        crosslane.scatter_masked(hits.spacing, column, units, mask)
        crosslane.scatter_masked(hits.u, column, u, mask)
        crosslane.scatter_masked(hits.v, column, v, mask)
    bit, pending = ops.int_like(distance, 1) << (ray & (VECTOR - 1)), mask
    while ops.any_lane(pending):
        first, group = crosslane.uniform_group(ray & -VECTOR, pending)
        packet.alive[first // VECTOR] &= ~crosslane.total(ops.where(group, bit, 0))
        pending = pending & ops.not_(group)


@helper
def write_occlusion(trace: Traversal, ray: int) -> None:
    """Write that a ray has hit anything, and deactivate it."""
    trace.hits.t[trace.hits.first + ray] = -np.inf
    trace.packet.alive[ray // VECTOR] &= ~(1 << (ray % VECTOR))
