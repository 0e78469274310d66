"""Roots of a bundle's rays, each in a bracket of its own: closed in on in float32 side by side, then brought to rounding in float64."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..jit.kernel import noinline_helper as apart_
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .discontinuities import discontinuity_normal
from .evaluate import Room, turns_at, value_at
from .intersect import MANIFOLD, bracketed, finish_hit, gradient_at
from .llvm_math import LANES
from .packet_state import OPEN, SPACED, VECTOR, U, evaluate_points, exact, in_a_row, numbers_of, own_origin, single, tapes_of

MOST_TURNS = 12
MOST_STEPS = 5  # of Newton's
STRAIGHT = 2.0**-18  # of a value, that a step leaves at the most where the slope hardly changes: the gradient then neither does
SHARE = 0.125  # of how far values may be off, below which float32 has no more to say: bounds of that are wide


@helper
def keep(rows: Any, rays: Any, count: int, mask: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, off: Any, ray: Any) -> int:
    """Write lanes of a mask behind the first `count`; how many there are then."""
    simd.compress_store(rows, count, a, mask)
    simd.compress_store(rows, OPEN + count, b, mask)
    simd.compress_store(rows, 2 * OPEN + count, c, mask)
    simd.compress_store(rows, 3 * OPEN + count, d, mask)
    simd.compress_store(rows, 4 * OPEN + count, e, mask)
    simd.compress_store(rows, 5 * OPEN + count, f, mask)
    simd.compress_store(rows, 8 * OPEN + count, off, mask)
    return count + simd.compress_store(rays, count, ray, mask)


@apart_
def finished(room, memory, tape, count, start, reach, hits):
    """Bring the one root in each bracket to rounding, and write what is met."""
    rows, registers = room.brackets, room.registers
    many = (count + VECTOR - 1) // VECTOR
    for k in range(count, many * VECTOR):  # lanes beyond repeat the last bracket
        room.bracket_ray[k] = room.bracket_ray[count - 1]
        for row in range(9):
            rows[row * OPEN + k] = rows[row * OPEN + count - 1]
    for k in range(many):
        ray = simd.load(room.bracket_ray, k * VECTOR, VECTOR)
        for row in range(6):
            simd.store(room.packed, row * OPEN + k * VECTOR, single(room.rays, row, ray))
        for row in range(2):
            simd.store(rows, (6 + row) * OPEN + k * VECTOR, simd.load(rows, row * OPEN + k * VECTOR, VECTOR))
    enough = 8.0 * U * reach
    for turn in range(MOST_TURNS):
        working = False
        for k in range(many):
            s = _guess(rows, k * VECTOR, turn)
            for axis in range(3):
                o = simd.load(room.packed, axis * OPEN + k * VECTOR, VECTOR)
                d = simd.load(room.packed, (3 + axis) * OPEN + k * VECTOR, VECTOR)
                simd.store(registers, (axis * many + k) * VECTOR, simd.fma(d, s, o))
        evaluate_points(room, tape, many)
        out = room.tapes[tape, 2] * many
        for k in range(many):
            f = simd.load(registers, (out + k) * VECTOR, VECTOR)
            working = _narrowed(rows, k * VECTOR, turn, f, enough) or working
        if not working:
            break
    for first in range(0, count, LANES):
        _polished(room, memory, tape, first, count, start, reach, hits)


@helper
def _guess(rows: Any, at: int, turn: int) -> Any:
    """Where the line through both ends of a bracket meets 0, or now and then its middle."""
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * OPEN + at, VECTOR), simd.load(rows, 3 * OPEN + at, VECTOR)
    if turn % 6 == 5:
        return 0.5 * (a + b)
    share = fa / (fa - fb)
    share = simd.select((share >= 0.0) & (share <= 1.0), share, 0.5)
    return simd.minimum(simd.maximum(simd.fma(b - a, share, a), a), b)


@helper
def _narrowed(rows: Any, at: int, turn: int, f: Any, enough: float) -> bool:
    """Replace one end of a bracket by the guess, by the Illinois method; whether any lane is not there yet.

    Where the value at the guess says nothing any more, the bracket closes on it.
    """
    s = _guess(rows, at, turn)
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * OPEN + at, VECTOR), simd.load(rows, 3 * OPEN + at, VECTOR)
    side = simd.load(rows, 5 * OPEN + at, VECTOR)
    done = (b - a <= enough) | (side == 2.0)
    close = 0.4 * enough * simd.load(rows, 4 * OPEN + at, VECTOR)  # as steep as it is, the root is not farther than this
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


@apart_
def _polished(room, memory, tape, first, count, start, reach, hits):
    """Steps of Newton's from where float32 says, in float64, until one leaves next to nothing; bracketing where these do not suffice.

    Near places where the gradient vanishes it changes within a step: how far off a root still is, only the value there tells.
    """
    rows = room.brackets
    ray = numbers_of(room.bracket_ray, first)
    mask = crosslane.lane_indices(first) < count
    o, d = exact(room, ray)
    a, b = crosslane.load_row(rows, first), crosslane.load_row(rows, OPEN + first)
    fa, fb = crosslane.load_row(rows, 2 * OPEN + first), crosslane.load_row(rows, 3 * OPEN + first)
    steep, side = crosslane.load_row(rows, 4 * OPEN + first), crosslane.load_row(rows, 5 * OPEN + first)
    low, high = room.exact[6 * SPACED + ray], room.exact[7 * SPACED + ray]
    there = side == 2.0
    share = fa / (fa - fb)
    at = ops.where(there, a, a + (b - a) * ops.where((share >= 0.0) & (share <= 1.0), share, 0.5))
    tapes = tapes_of(at, tape)
    begin, end = crosslane.load_row(rows, 6 * OPEN + first), crosslane.load_row(rows, 7 * OPEN + first)
    rounding, least = 2.0**-28 * crosslane.load_row(rows, 8 * OPEN + first), 0.99 * steep
    slope, gradient = 0.0 * at, d
    far, off, good, settled = 0.0 * at + 1e-4 * reach, 0.0 * at, mask, mask
    for turn in range(MOST_STEPS):
        value, gx, gy, gz = turns_at(room, 0, tapes, memory, ops.along(o, d, at), mask)
        gradient = (gx, gy, gz)
        slope = ops.dot(gradient, d)
        if turn == 0:
            far = ops.minimum(2.0 * abs(value) / steep, far)
        step = ops.clip(-value / slope, -far, far)
        good = good & (abs(slope) >= least) & (abs(at + step - 0.5 * (begin + end)) <= 0.5 * (end - begin) + far)
        at = at + ops.where(good, step, 0.0)
        rest = value_at(room, 0, tapes, memory, ops.along(o, d, at), mask)
        straight = abs(rest) <= STRAIGHT * abs(value)
        settled = (straight | (abs(rest) <= rounding)) & (abs(rest) <= 1e-9 * reach * steep)  # so steep everywhere, it is not farther
        off = ops.where(straight, 4.0 * STRAIGHT, 1.0) * abs(rest) + rounding
        at = at - ops.where(good & straight, rest / slope, 0.0)
        if not ops.any_lane(mask & good & ops.not_(settled)):
            break
    good = good & settled
    bad = mask & ops.not_(good)
    if room.places[0, 5] != 0:  # the slope says nothing of a jump
        bad = mask
    if ops.any_lane(bad):
        f_begin = value_at(room, 0, tapes, memory, ops.along(o, d, begin), bad)
        f_end = value_at(room, 0, tapes, memory, ops.along(o, d, end), bad)
        root = bracketed(room, 0, tape + ops.int_like(at, 0), memory, o, d, begin, end, f_begin, f_end, at * 0.0 + start, reach, bad)
        at = ops.where(bad, root, at)
        value = value_at(room, 0, tapes, memory, ops.along(o, d, at), bad)
        gradient = ops.where3(bad, gradient_at(room, 0, tapes, memory, o, d, at, start + at + reach, bad), gradient)
        off = ops.where(bad, MANIFOLD * abs(value), off)
        inside = ops.where(bad, f_begin, -slope) <= 0.0
        at, gradient, off = faced(room, memory, ray, at, inside, gradient, off, bad, start, hits)
        met(room, ray, d, at, off, gradient, inside, mask & (at >= low) & (at <= high), start, hits)
    else:
        met(room, ray, d, at, off, gradient, slope > 0.0, mask & (at >= low) & (at <= high), start, hits)


@helper
def faced(
    room: Any, memory: Room, ray: Lane, at: Lane, inside: Lane, gradient: Vec, off: Lane, mask: Lane, start: float, hits: Any
) -> tuple[Lane, Vec, Lane]:
    """(where a root is, the gradient there, how far from 0 it may be), if the formula may jump as jumps.face has them."""
    if room.places[0, 5] != 0:
        origin, way = own_origin(hits.rays, hits.first + ray, hits.inverse), exact(room, ray)[1]
        found = discontinuity_normal(room, 0, memory, origin, way, start + at, inside, gradient, off, mask)
        at, gradient, off = ops.where(found.settled, found.at - start, at), found.gradient, found.off
    return at, gradient, off


@helper
def met(
    room: Any, ray: Lane, way: Vec, at: Lane, off: Lane, gradient: Vec, inside: Lane, mask: Lane, start: float, hits: Any
) -> None:
    """Write what rays have met, and let them rest."""
    units, u, v = finish_hit(room, 0, way, gradient, inside, off)
    number, column = ops.int_like(at, hits.number), hits.first + ray
    if in_a_row(ray) and ops.not_(ops.any_lane(ops.not_(mask))):
        begin = crosslane.lane(column, 0)
        t = (start + at) / crosslane.load_row(room.exact, 8 * SPACED + crosslane.lane(ray, 0))
        crosslane.store_row(hits.t, begin, t)
        crosslane.store_row(hits.instance, begin, number)
        crosslane.store_row(hits.spacing, begin, units)
        crosslane.store_row(hits.u, begin, u)
        crosslane.store_row(hits.v, begin, v)
    else:
        crosslane.put_at(hits.t, column, (start + at) / room.exact[8 * SPACED + ray], mask)
        crosslane.put_at(hits.instance, column, number, mask)
        crosslane.put_at(hits.spacing, column, units, mask)
        crosslane.put_at(hits.u, column, u, mask)
        crosslane.put_at(hits.v, column, v, mask)
    bit, rest = ops.int_like(at, 1) << (ray & (VECTOR - 1)), mask
    while ops.any_lane(rest):
        first, here = crosslane.uniform_group(ray & -VECTOR, rest)
        room.alive[first // VECTOR] &= ~crosslane.total(ops.where(here, bit, 0))
        rest = rest & ops.not_(here)


@helper
def stopped(room: Any, hits: Any, ray: int) -> None:
    """Write that a ray has met something, and let it rest."""
    hits.t[hits.first + ray] = -np.inf
    room.alive[ray // VECTOR] &= ~(1 << (ray % VECTOR))
