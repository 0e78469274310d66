"""A stretch of some vectors of a bundle: which rays surely meet the surface there, which do not, and which are looked at by themselves."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..jit.kernel import noinline_helper as apart_
from ..lanes import crosslane, ops
from ..simd.atomics import count_up
from . import root_isolation
from .evaluate import value_at
from .intersect import MANIFOLD, closed_in, gradient_at
from .packet_roots import faced, finished, keep, met, stopped
from .packet_state import (
    ANY,
    FINEST,
    GROUP,
    MOST_PIECES,
    OPEN,
    PARTS_OF_SPAN,
    SPACED,
    SPANS,
    VECTOR,
    U,
    error_of,
    evaluate,
    evaluate_points,
    exact,
    set_known_bounds,
    signed,
    single,
    tapes_of,
)

STEP = 4  # row of a stretch that is open: how long the next piece of it is
COUNTED = 1 << 40  # is added to what a ray has spent once it counts as unproved

# --- leaves: a stretch of some vectors ----------------------------------------------------------------------------------


@apart_
def leaf(room, memory, tape, count, a, b, start, reach, slack, hits):
    """Meet the vectors of the room's list between a and b, with one tape."""
    known = True
    for i in range(count):  # a ray that begins here has been asked nothing yet
        first = simd.load(room.rays, 6 * SPACED + room.list[i] * VECTOR, VECTOR)
        known = known and room.carried_at[room.list[i]] == np.float32(a) and simd.none_of((first > a) & (first < b))
    if known:
        for i in range(count):
            simd.store(room.values, i * VECTOR, simd.load(room.carried, room.list[i] * VECTOR, VECTOR))
    else:
        _values(room, memory, tape, count, a, a, b, 0)
    if _all_rise(room, count, a, b):
        return
    _values(room, memory, tape, count, b, a, b, GROUP)
    opened, held = 0, 0
    for i in range(count):
        vector = room.list[i]
        at = vector * VECTOR
        first, last = simd.load(room.rays, 6 * SPACED + at, VECTOR), simd.load(room.rays, 7 * SPACED + at, VECTOR)
        fa, fb = simd.load(room.values, i * VECTOR, VECTOR), simd.load(room.values, GROUP + i * VECTOR, VECTOR)
        simd.store(room.carried, at, fb)
        room.carried_at[vector] = b
        begin, end = simd.maximum(first, a), simd.minimum(last, b)
        live = simd.mask_from_bits(room.alive[vector], first) & (begin < end)
        least, most = np.float32(room.slopes[i]), np.float32(room.slopes[VECTOR + i])
        one_way, error = room.slopes[2 * VECTOR + i] > 0.0, np.float32(room.slopes[3 * VECTOR + i])
        change = (fa <= 0.0) ^ (fb <= 0.0)
        if one_way:
            certain, open_ = live & change, live & ~live
        else:
            certain = live & ~live
            open_ = live & ~(~change & far_from_zero(fa, fb, least, most, end - begin, error))
        ray = at + simd.iota(simd.i32x16(0))
        zero = first * 0.0
        if simd.any_of(certain):
            steep = zero + min(abs(least), abs(most))
            held = keep(room.brackets, room.bracket_ray, held, certain, begin, end, fa, fb, steep, zero, zero + error, ray)
        if simd.any_of(open_):
            opened = keep(room.open, room.open_ray, opened, open_, begin, end, fa, fb, end - begin, zero, zero + error, ray)
    if opened > 0:
        held = alone(room, memory, tape, opened, held, start, reach, slack, hits)
    if held > 0 and hits.number == ANY:
        for k in range(held):
            stopped(room, hits, np.int64(room.bracket_ray[k]))
    elif held > 0:
        finished(room, memory, tape, held, start, reach, hits)


@helper
def rises(room: Any, vector: int, a: float, b: float) -> bool:
    """Whether a vector's rays are all known to be outside at a, so that they have no root before b: for where values rise in between.

    What is known of their values, a lower bound, is then so at b.
    """
    if room.carried_at[vector] != np.float32(a):
        return False
    at = vector * VECTOR
    first, known = simd.load(room.rays, 6 * SPACED + at, VECTOR), simd.load(room.carried, at, VECTOR)
    live = simd.mask_from_bits(room.alive[vector], first)
    if simd.any_of(live & (((first >= a) & (first < b)) | ~(known > 0.0))):
        return False
    room.carried_at[vector] = b
    return True


@helper
def _all_rise(room: Any, count: int, a: float, b: float) -> bool:
    """`rises` for the list's vectors, in all of which values do, by what has been found at a or where rays begin after that."""
    for i in range(count):
        if not (room.slopes[i] > 0.0 and room.slopes[2 * VECTOR + i] > 0.0):
            return False
        at = room.list[i] * VECTOR
        first, last = simd.load(room.rays, 6 * SPACED + at, VECTOR), simd.load(room.rays, 7 * SPACED + at, VECTOR)
        live = simd.mask_from_bits(room.alive[room.list[i]], first) & (first < b) & (last > a)
        if simd.any_of(live & ~(simd.load(room.values, i * VECTOR, VECTOR) > 0.0)):
            return False
    for i in range(count):
        simd.store(room.carried, room.list[i] * VECTOR, simd.load(room.values, i * VECTOR, VECTOR))
        room.carried_at[room.list[i]] = b
    return True


@helper
def far_from_zero(fa: Any, fb: Any, least: Any, most: Any, length: Any, error: float) -> Any:
    """meet.apart in float32."""
    up = fa > 0.0
    falls, rises = simd.select(up, least, -most), simd.select(up, most, -least)
    size_a, size_b = abs(fa), abs(fb)
    steep = rises - falls
    x = (size_a - size_b + rises * length) / simd.select(steep > 0.0, steep, 1.0)
    x = simd.minimum(simd.maximum(x, 0.0), length)
    meeting = size_a + falls * x
    return meeting > 4.0 * error + 1e-5 * (size_a + size_b)


@apart_
def _values(room, memory, tape, count, s, a, b, to):
    """Write the values of the list's vectors at s, or where rays begin or end between a and b, from element `to` on."""
    for i in range(count):
        at = room.list[i] * VECTOR
        first, last = simd.load(room.rays, 6 * SPACED + at, VECTOR), simd.load(room.rays, 7 * SPACED + at, VECTOR)
        here = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
        here = simd.select(first < last, here, 0.0)
        for axis in range(3):
            o, d = simd.load(room.rays, axis * SPACED + at, VECTOR), simd.load(room.rays, (3 + axis) * SPACED + at, VECTOR)
            simd.store(room.registers, (axis * count + i) * VECTOR, simd.fma(d, here, o))
    evaluate_points(room, tape, count)
    out = room.tapes[tape, 2] * count
    for i in range(count):
        f = simd.load(room.registers, (out + i) * VECTOR, VECTOR)
        simd.store(room.values, to + i * VECTOR, f)
    for i in range(count):
        f = simd.load(room.values, to + i * VECTOR, VECTOR)
        at = room.list[i] * VECTOR
        first, last = simd.load(room.rays, 6 * SPACED + at, VECTOR), simd.load(room.rays, 7 * SPACED + at, VECTOR)
        near = ~(abs(f) > np.float32(room.slopes[3 * VECTOR + i])) & (first < b) & (last > a)
        near = near & simd.mask_from_bits(room.alive[room.list[i]], f)
        if simd.any_of(near):
            here = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
            simd.store(room.values, to + i * VECTOR, signed(room, memory, tape, at + simd.iota(simd.i32x16(0)), here, f, near))


# --- rays by themselves -------------------------------------------------------------------------------------------------


@apart_
def alone(room, memory, tape, opened, count, start, reach, slack, hits):
    """Look for the first root in each open stretch; how many brackets there are then. Round by round: what is still open closes up."""
    turns = 0
    while opened > 0:
        left = 0
        for first in range(0, opened, VECTOR):
            working = simd.iota(simd.i32x16(0)) < opened - first
            ray = simd.select(working, simd.load(room.open_ray, first, VECTOR), room.open_ray[first])
            at = simd.select(working, simd.load(room.open, first, VECTOR), 0.0)
            end = simd.select(working, simd.load(room.open, OPEN + first, VECTOR), 1.0)
            f, step = simd.load(room.open, 2 * OPEN + first, VECTOR), simd.load(room.open, STEP * OPEN + first, VECTOR)
            to = simd.minimum(at + step, end)
            to = simd.select(end - to < 0.25 * step, end, to)
            low, high, least, most, error, far, sure = _piece(room, tape, ray, at, to, slack)
            near = working & ~(sure & (abs(far) > error))
            if simd.any_of(near):
                far = signed(room, memory, tape, ray, to, far, near)
            change = (f <= 0.0) ^ (far <= 0.0)
            one_way = sure & ((least > 0.0) | (most < 0.0))
            away = sure & ((low > 0.0) | (high < 0.0))
            passed = working & ~change & (away | one_way | (sure & far_from_zero(f, far, least, most, to - at, error)))
            certain = working & change & one_way
            if simd.any_of(certain):
                steep = simd.minimum(abs(least), abs(most))
                count = keep(room.brackets, room.bracket_ray, count, certain, at, to, f, far, steep, steep * 0.0, error, ray)
            at, f = simd.select(passed, to, at), simd.select(passed, far, f)
            step = simd.select(passed, 2.0 * step, 0.25 * step)
            working = working & ~certain & ~(passed & (at >= end))
            given_up = working & ~passed & (step < FINEST * reach) if turns < MOST_PIECES else working
            working = working & ~given_up
            simd.compress_store(room.open, left, at, working)
            simd.compress_store(room.open, OPEN + left, end, working)
            simd.compress_store(room.open, 2 * OPEN + left, f, working)
            simd.compress_store(room.open, STEP * OPEN + left, step, working)
            left += simd.compress_store(room.open_ray, left, ray, working)
            bits = simd.bits(given_up)
            while bits != 0:
                j = simd.trailing_zeros(bits)
                bits &= bits - 1
                _by_search(room, memory, tape, np.int64(simd.lane(ray, j)), simd.lane(at, j), simd.lane(end, j), start, hits)
        opened, turns = left, turns + 1
    return count


@helper
def _piece(room: Any, tape: int, ray: Any, at: Any, to: Any, slack: float) -> Any:
    """(low, high, least, most, error, far, sure) of values and slopes between distances of sixteen rays, and the values at the ends."""
    registers = room.registers
    for axis in range(3):
        o, d = single(room.rays, axis, ray), single(room.rays, 3 + axis, ray)
        p, q = simd.fma(d, at, o), simd.fma(d, to, o)
        row = PARTS_OF_SPAN * axis
        simd.store(registers, row * VECTOR, simd.minimum(p, q) - slack)
        simd.store(registers, (row + 1) * VECTOR, simd.maximum(p, q) + slack)
        simd.store(registers, (row + 2) * VECTOR, d - 2.0 * U)
        simd.store(registers, (row + 3) * VECTOR, d + 2.0 * U)
        simd.store(registers, (row + 4) * VECTOR, d * 0.0 + slack)
        simd.store(room.packed, axis * VECTOR, q)
    set_known_bounds(room, PARTS_OF_SPAN, 1, simd.f32x16(-np.inf), simd.f32x16(np.inf))
    room.state[0] = 0
    evaluate(room, SPANS, tape, 1)
    out = room.tapes[tape, 2] * PARTS_OF_SPAN * VECTOR
    low, high = simd.load(registers, out, VECTOR), simd.load(registers, out + VECTOR, VECTOR)
    least, most = simd.load(registers, out + 2 * VECTOR, VECTOR), simd.load(registers, out + 3 * VECTOR, VECTOR)
    error = error_of(low, high, simd.load(registers, out + 4 * VECTOR, VECTOR))
    sure = ~simd.mask_from_bits(room.state[0], low)
    for axis in range(3):
        simd.store(registers, axis * VECTOR, simd.load(room.packed, axis * VECTOR, VECTOR))
    evaluate_points(room, tape, 1)
    return low, high, least, most, error, simd.load(registers, room.tapes[tape, 2] * VECTOR, VECTOR), sure


@apart_
def _by_search(room, memory, tape, ray, a, b, start, hits):
    """Meet one ray between a and b in float64."""
    like = ops.to_float(crosslane.lane_indices(0)) * 0.0
    x = room.exact
    o, d = (x[ray], x[SPACED + ray], x[2 * SPACED + ray]), (x[3 * SPACED + ray], x[4 * SPACED + ray], x[5 * SPACED + ray])
    low, high = max(np.float64(a), x[6 * SPACED + ray]), min(np.float64(b), x[7 * SPACED + ray])
    rounds = max(root_isolation.MOST_ROUNDS - room.spent[ray] % COUNTED, root_isolation.FEW)
    root, inside, doubt, used = root_isolation.isolate_first_root(
        room, 0, tape, memory, o, d, low, high, x[6 * SPACED + ray], start, room.places[0, 1] != 0, like, rounds
    )
    room.spent[ray] += used
    if doubt > 0 and room.spent[ray] < COUNTED:
        room.spent[ray] += COUNTED
        count_up(room.unproved, 0, 1)
    if root < np.inf and hits.number == ANY:
        stopped(room, hits, ray)
    elif root < np.inf:
        one = crosslane.lane_indices(0) < 1
        rays, at = ops.int_like(like, ray), like + root
        origin, way = exact(room, rays)
        tapes, far = tapes_of(like, tape), start + at + room.numbers[0, 13]
        value = value_at(room, 0, tapes, memory, ops.along(origin, way, at), one)
        gradient = gradient_at(room, 0, tapes, memory, origin, way, at, far, one)
        within, off = ops.bool_like(like, inside), MANIFOLD * abs(value) + closed_in(gradient, far)
        at, gradient, off = faced(room, memory, rays, at, within, gradient, off, one, start, hits)
        met(room, rays, way, at, off, gradient, within, one, start, hits)
