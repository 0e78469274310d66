"""Where bundles of rays that go much the same way meet a formula's surface: as rays of cells.py do, bounds shared by all of a bundle.

A bundle is up to 4096 rays: vectors of 16 rays, groups of 16 vectors (a group is a square of 16 × 16 pixels, a vector one of 4 × 4).
The stretch in which they may meet the box is cut into 8 slabs. Bounds over the box around all rays in a slab say where there is no
surface, and which rows of the tape matter in the others; these are cut into groups and quarters, of which the same is asked, and bounds
of the slopes along all their rays. Where these have one sign, the values at a ray's both ends decide; groups where they do not are cut
into vectors and quarters again, and rays that then are still open go on by themselves. (Duff, "Interval Arithmetic and Recursive
Subdivision for Implicit Functions and Constructive Solid Geometry", SIGGRAPH 1992; Keeter 2020, see cells.py.)

All this is float32, bounds rounded outward. With the bounds comes how much values may be off there: where one is nearer to 0 than that,
its sign is that of float64; and a root that is bracketed is brought to rounding in float64.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, kernel
from ..jit.kernel import noinline_helper as apart_
from .evaluate import room as room_of_values
from .interpreter import KNOWN
from .interval_grid import place
from .packet_leaves import leaf, rises
from .packet_state import (
    BOXES,
    GROUP,
    HULLS,
    LONG,
    PARTS_OF_SPAN,
    QUARTERS,
    RAYS,
    SLABS,
    SPANS,
    VECTOR,
    WIDEST,
    U,
    around,
    begin_packet,
    box_inputs,
    decides_alike,
    error_of,
    evaluate,
    hulled,
    quarter_inputs,
    set_known_bounds,
    simpler,
    span_input,
    span_inputs,
)


class Out(NamedTuple):
    """What rays meet: columns (n,) of which those are written that meet the surface nearer than `t` says."""

    t: Any
    instance: Any
    spacing: Any
    u: Any
    v: Any
    number: int  # for the column `instance`; or tile_room.ANY


class Meeting(NamedTuple):
    """An Out, and the rays of the bundle: those of `rays` from the column `first` on, in the frame to which `inverse` leads."""

    t: Any
    instance: Any
    spacing: Any
    u: Any
    v: Any
    number: int
    rays: Any
    first: int
    inverse: Any


ALIKE = 2  # lanes before one in which the same of a tape may be needed


@kernel
def trace(room, rays, first, n, inverse, out):
    """Meet the columns first … n − 1 of tile_room.columns with the room's surface, to whose frame (3, 4) `inverse` leads, as meet.meet
    does, up to RAYS at a time; n, or the first column of some that go too far apart to be a bundle."""
    memory = room_of_values()
    while first < n:
        hits = Meeting(out.t, out.instance, out.spacing, out.u, out.v, out.number, rays, first, inverse)
        if not _bundle(room, memory, min(RAYS, n - first), hits):
            return first
        first += RAYS
    return n


@apart_
def _bundle(room, memory, n, hits):
    """Meet n ≤ RAYS; False where they go too far apart."""
    begin, length = begin_packet(room, hits.rays, hits.first, n, hits.inverse, hits.t)
    if length < 0.0:
        return True
    numbers = room.numbers
    size = math.sqrt((numbers[0, 3] - numbers[0, 0]) ** 2 + (numbers[0, 4] - numbers[0, 1]) ** 2 + (numbers[0, 5] - numbers[0, 2]) ** 2)
    if length > WIDEST * size:
        return False
    rows = len(room.whole)
    for i in range(rows):
        for c in range(4):
            room.names[i, c] = room.whole[i, c]
    room.tapes[0, 0], room.tapes[0, 1] = 0, rows
    place(room.names, room.code, room.tapes, 0)
    vectors = (n + VECTOR - 1) // VECTOR
    hulled(room, vectors)
    groups = (n + GROUP - 1) // GROUP
    room.ends[2] = groups
    slab = _rounded(length / SLABS)
    reach = numbers[0, 13] + length
    slack = 32.0 * U * reach
    around(room, groups)
    box_inputs(room, HULLS, slab, slack)
    low, high = simd.f32x16(-np.inf), simd.f32x16(np.inf)
    for _ in range(2):  # what is known of the result then says more of minima on the way to it
        set_known_bounds(room, 2, 1, low, high)
        room.state[0] = 0
        evaluate(room, BOXES, 0, 1)
        out = room.tapes[0, 2] * 2 * VECTOR
        low, high = simd.load(room.registers, out, VECTOR), simd.load(room.registers, out + VECTOR, VECTOR)
        if room.code[rows - 1, 6] == 0:
            break
    simd.store(room.results, 0, low)
    simd.store(room.results, VECTOR, high)
    maybe = room.state[0]
    left = simd.bits((low <= 0.0) & (high >= 0.0)) | (maybe & 0xFFFF)
    # which choices are known in which slab is needed for long, while others are asked
    choices = len(room.state)
    kept = room.kept
    for i in range(choices):
        kept[i] = room.state[i]
    while left != 0:
        i = simd.trailing_zeros(left)
        left &= left - 1
        if i * slab > length:
            break
        room.ends[0], room.ends[1] = 1, rows
        for c in range(choices):
            room.state[c] = kept[c]
        tape = simpler(room, 0, i)
        set_known_bounds(room, PARTS_OF_SPAN, QUARTERS, simd.f32x16(room.results[i]), simd.f32x16(room.results[VECTOR + i]))
        if not _slab(room, memory, tape, i * slab, slab, groups, vectors, begin, slack, reach, hits):
            break
    return True


@helper
def _rounded(x: float) -> float:
    """No less, in eight binary digits: so multiples are exact in float32."""
    mantissa, exponent = math.frexp(x)
    return math.ldexp(math.ceil(mantissa * 256.0), exponent - 8)


# --- slabs --------------------------------------------------------------------------------------------------------------


@apart_
def _slab(room, memory, tape, begin, length, groups, vectors, start, slack, reach, hits):
    """Meet all groups in one slab; whether any ray is left."""
    quarter = length / QUARTERS
    span_inputs(room, HULLS, begin, quarter, slack)
    _known_first(room, tape)
    room.state[0] = 0
    evaluate(room, SPANS, tape, QUARTERS)
    maybe = room.state[0]
    stored, tapes = room.bounds, room.tape_of
    _store_bounds(room, tape)
    for lane in range(QUARTERS * VECTOR):
        tapes[lane] = -1
        if lane % VECTOR < groups and ((stored[0, lane] <= 0.0 and stored[1, lane] >= 0.0) or (maybe >> lane) & 1 != 0):
            known = -1
            for k in range(1, ALIKE + 1):
                other = lane - k
                fits = known < 0 and other >= 0 and tapes[other] >= 0 and (maybe >> other) & 1 == (maybe >> lane) & 1
                if fits and decides_alike(room, tape, lane, other):
                    known = tapes[other]
            tapes[lane] = known if known >= 0 else simpler(room, tape, lane)
    left = False
    for group in range(groups):
        many = min(VECTOR, vectors - group * VECTOR)
        alive = _any_alive(room, group, many)
        for k in range(QUARTERS):
            lane = k * VECTOR + group
            if not alive or tapes[lane] < 0:
                continue
            a = begin + k * quarter
            least, most = np.float64(stored[2, lane]), np.float64(stored[3, lane])
            if (least > 0.0 or most < 0.0) and (maybe >> lane) & 1 == 0:
                count = 0
                for vector in range(group * VECTOR, group * VECTOR + many):
                    if room.alive[vector] != 0 and not (least > 0.0 and rises(room, vector, a, a + quarter)):
                        room.list[count] = vector
                        room.slopes[count], room.slopes[VECTOR + count], room.slopes[2 * VECTOR + count] = least, most, 1.0
                        room.slopes[3 * VECTOR + count] = error_of(stored[0, lane], stored[1, lane], stored[4, lane])
                        count += 1
                if count > 0:
                    leaf(room, memory, tapes[lane], count, a, a + quarter, start, reach, slack, hits)
            else:
                _finer(room, memory, tapes[lane], group, many, a, quarter / QUARTERS, start, slack, reach, hits)
            alive = _any_alive(room, group, many)
        left = left or alive
    return left


@helper
def _known_first(room: Any, tape: int) -> None:
    """Of long tapes that end with minima and maxima, ask for the result first: what it is decides more of these."""
    first, rows = room.tapes[tape, 0], room.tapes[tape, 1]
    if rows < LONG or room.code[first + rows - 1, 6] == 0:
        return
    registers, wide = room.registers, QUARTERS * VECTOR
    for part in range(2):  # spans' inputs give those of boxes
        for axis in range(3):
            for k in range(0, wide, VECTOR):
                x = simd.load(registers, (PARTS_OF_SPAN * axis + part) * wide + k, VECTOR)
                simd.store(room.inputs, (2 * axis + part) * wide + k, x)
    for k in range(0, 15 * wide, VECTOR):
        x = simd.load(registers, k, VECTOR)
        simd.store(room.inputs, 6 * wide + k, x)
    for k in range(0, 6 * wide, VECTOR):
        simd.store(registers, k, simd.load(room.inputs, k, VECTOR))
    low, high = simd.load(registers, KNOWN * PARTS_OF_SPAN * wide, VECTOR), simd.load(registers, (KNOWN * PARTS_OF_SPAN + 1) * wide, VECTOR)
    set_known_bounds(room, 2, QUARTERS, low, high)
    room.state[0] = 0
    evaluate(room, BOXES, tape, QUARTERS)
    out = room.tapes[tape, 2] * 2 * wide
    for k in range(0, 2 * wide, VECTOR):
        simd.store(room.inputs, k, simd.load(registers, out + k, VECTOR))
    for k in range(0, 15 * wide, VECTOR):
        simd.store(registers, k, simd.load(room.inputs, 6 * wide + k, VECTOR))
    set_known_bounds(room, PARTS_OF_SPAN, QUARTERS, low, high)
    for k in range(0, 2 * wide, VECTOR):
        simd.store(registers, KNOWN * PARTS_OF_SPAN * wide + k, simd.load(room.inputs, k, VECTOR))


@helper
def _any_alive(room: Any, group: int, many: int) -> bool:
    found = np.int32(0)
    for vector in range(group * VECTOR, group * VECTOR + many):
        found |= room.alive[vector]
    return found != 0


@helper
def _store_bounds(room: Any, tape: int) -> None:
    """Keep what `spans32` found."""
    rows = QUARTERS * VECTOR
    out = room.tapes[tape, 2] * PARTS_OF_SPAN * rows
    for k in range(0, PARTS_OF_SPAN * rows, VECTOR):
        simd.store(room.bounds, k, simd.load(room.registers, out + k, VECTOR))


@apart_
def _finer(room, memory, tape, group, many, begin, length, start, slack, reach, hits):
    """Meet the vectors of a group in the quarters of a stretch: bounds of slopes are asked for where there may be a root at all."""
    set_known_bounds(room, 2, QUARTERS, simd.f32x16(-np.inf), simd.f32x16(np.inf))
    quarter_inputs(room, group * VECTOR, begin, length, slack)
    room.state[0] = 0
    evaluate(room, BOXES, tape, QUARTERS)
    maybe, out = room.state[0], room.tapes[tape, 2] * 2 * QUARTERS
    for k in range(QUARTERS):  # put aside
        simd.store(room.inputs, k * VECTOR, simd.load(room.registers, (out + k) * VECTOR, VECTOR))
        simd.store(room.inputs, (QUARTERS + k) * VECTOR, simd.load(room.registers, (out + QUARTERS + k) * VECTOR, VECTOR))
    stored = room.bounds
    for k in range(QUARTERS):
        low, high = simd.load(room.inputs, k * VECTOR, VECTOR), simd.load(room.inputs, (QUARTERS + k) * VECTOR, VECTOR)
        left = simd.bits((low <= 0.0) & (high >= 0.0)) | ((maybe >> (k * VECTOR)) & 0xFFFF)
        a = begin + k * length
        if left & _alive_of(room, group, many) == 0:
            continue
        span_input(room, group * VECTOR, a, length, slack)
        set_known_bounds(room, PARTS_OF_SPAN, 1, low, high)
        room.state[0] = 0
        evaluate(room, SPANS, tape, 1)
        out = room.tapes[tape, 2] * PARTS_OF_SPAN * VECTOR
        for part in range(PARTS_OF_SPAN):
            simd.store(stored, (PARTS_OF_SPAN + part) * QUARTERS * VECTOR, simd.load(room.registers, out + part * VECTOR, VECTOR))
        count, unsure_of = 0, room.state[0]
        left &= _alive_of(room, group, many)
        while left != 0:
            lane = simd.trailing_zeros(left)
            left &= left - 1
            unsure = (unsure_of >> lane) & 1 != 0
            if (stored[5, lane] <= 0.0 and stored[6, lane] >= 0.0) or unsure:
                least, most = stored[7, lane], stored[8, lane]
                if least > 0.0 and not unsure and rises(room, group * VECTOR + lane, a, a + length):
                    continue
                room.list[count] = group * VECTOR + lane
                room.slopes[count], room.slopes[VECTOR + count] = (-np.inf, np.inf) if unsure else (least, most)
                room.slopes[2 * VECTOR + count] = 1.0 if (least > 0.0 or most < 0.0) and not unsure else 0.0
                error = error_of(stored[5, lane], stored[6, lane], stored[9, lane])
                room.slopes[3 * VECTOR + count] = np.inf if unsure else error
                count += 1
        if count > 0:
            leaf(room, memory, tape, count, a, a + length, start, reach, slack, hits)


@helper
def _alive_of(room: Any, group: int, many: int) -> int:
    """Bits of a group's vectors that have rays yet to meet something."""
    found = 0
    for number in range(many):
        if room.alive[group * VECTOR + number] != 0:
            found |= 1 << number
    return found
