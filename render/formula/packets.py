"""Packets of coherent rays through an implicit surface: bounds shared by all rays of a packet.

A packet has up to 4096 rays: vectors of 16 rays, groups of 16 vectors (a group covers 16 × 16 pixels, a vector 4 × 4). The interval in
which the rays may hit the surface's box is cut into 8 slabs. Bounds over the box around all rays in a slab exclude slabs without a surface,
and simplify the tape for the others. Those are cut into groups and quarters, which are bounded alike, with bounds of the slopes along their
rays. Where a slope has one sign, the values at both ends of a ray decide. Other groups are cut into vectors and quarters again, and rays
that stay undecided are searched one by one (Duff, "Interval Arithmetic and Recursive Subdivision for Implicit Functions and Constructive
Solid Geometry", SIGGRAPH 1992. Keeter 2020, see interval_grid.py).

This is done in float32 with bounds rounded outward. Each bound comes with an error of the values: where a value is nearer to 0 than its
error, float64 gives its sign. A bracketed root is refined in float64.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, kernel, noinline_helper
from .evaluate import eval_buffers
from .interpreter import KNOWN
from .interval_grid import allocate_registers
from .packet_leaves import intersect_vectors, stays_outside
from .packet_roots import Hits, Traversal
from .packet_state import (
    BOXES,
    GROUP,
    HULLS,
    LONG_TAPE,
    PARTS_OF_SPAN,
    QUARTERS,
    RAYS,
    SLABS,
    SPANS,
    VECTOR,
    WIDEST,
    U,
    begin_packet,
    evaluate,
    hull_groups,
    hull_vectors,
    quarter_inputs,
    same_choices,
    set_known_bounds,
    simplify_for_lane,
    slab_inputs,
    span_input,
    span_inputs,
    value_error,
)
from .tables import FIRST_ROW, HIGH, LARGEST_COORDINATE, RESULT, ROW_COUNT


class HitColumns(NamedTuple):
    """Hits of rays: columns (n,), written where a hit is nearer than `t`."""

    t: Any
    instance: Any
    spacing: Any
    u: Any
    v: Any
    number: int  # value for the column `instance`, or packet_state.ANY


ALIKE = 2  # preceding lanes whose tape may be reused


@kernel
def trace(packet, rays, first, n, inverse, out):
    """Intersect columns first … n − 1 of `rays` (packet_state.ray_columns) with the packet's surface, up to RAYS at a time.

    `inverse` (3, 4) transforms to the surface's frame; hits are as of intersect.first_hit. Returns n, or the first column of rays that are
    too incoherent for a packet.
    """
    memory = eval_buffers()
    while first < n:
        hits = Hits(out.t, out.instance, out.spacing, out.u, out.v, out.number, rays, first, inverse)
        if not _trace_packet(packet, memory, min(RAYS, n - first), hits):
            return first
        first += RAYS
    return n


@noinline_helper
def _trace_packet(packet, memory, n, hits):
    """Intersect n ≤ RAYS rays; False if they are too incoherent."""
    begin, length = begin_packet(packet, hits.rays, hits.first, n, hits.inverse, hits.t)
    if length < 0.0:
        return True
    numbers = packet.numbers
    size = math.sqrt(
        (numbers[0, HIGH] - numbers[0, 0]) ** 2 + (numbers[0, HIGH + 1] - numbers[0, 1]) ** 2 + (numbers[0, HIGH + 2] - numbers[0, 2]) ** 2
    )
    if length > WIDEST * size:
        return False
    rows = len(packet.whole_tape)
    for i in range(rows):
        for c in range(4):
            packet.names[i, c] = packet.whole_tape[i, c]
    packet.tapes[0, FIRST_ROW], packet.tapes[0, ROW_COUNT] = 0, rows
    allocate_registers(packet.names, packet.code, packet.tapes, 0)
    vectors = (n + VECTOR - 1) // VECTOR
    hull_vectors(packet, vectors)
    groups = (n + GROUP - 1) // GROUP
    for vector in range(vectors, groups * (GROUP // VECTOR)):
        packet.alive[vector] = 0  # its box is of an earlier packet
    packet.ends[2] = groups
    slab = _round_up(length / SLABS)
    reach = numbers[0, LARGEST_COORDINATE] + length
    slack = 32.0 * U * reach
    hull_groups(packet, groups)
    trace = Traversal(packet, memory, groups, vectors, begin, reach, slack, hits)
    slabs = _bound_slabs(packet, rows, slab, slack)
    # the choices in slabs are read later, after other bounds
    choices = len(packet.state)
    slab_state = packet.slab_state
    for i in range(choices):
        slab_state[i] = packet.state[i]
    while slabs != 0:
        i = simd.trailing_zeros(slabs)
        slabs &= slabs - 1
        if i * slab > length:
            break
        packet.ends[0], packet.ends[1] = 1, rows
        for c in range(choices):
            packet.state[c] = slab_state[c]
        tape = simplify_for_lane(packet, 0, i)
        set_known_bounds(packet, PARTS_OF_SPAN, QUARTERS, simd.f32x16(packet.results[i]), simd.f32x16(packet.results[VECTOR + i]))
        if not _trace_slab(trace, tape, i * slab, slab):
            break
    return True


@helper
def _bound_slabs(packet: Any, rows: int, slab: float, slack: float) -> int:
    """Bound the whole tape over all slabs: bits of slabs that may hold a part of the surface."""
    slab_inputs(packet, HULLS, slab, slack)
    low, high = simd.f32x16(-np.inf), simd.f32x16(np.inf)
    for _ in range(2):  # known bounds of the result decide more minima in the second run
        set_known_bounds(packet, 2, 1, low, high)
        packet.state[0] = 0
        evaluate(packet, BOXES, 0, 1)
        out = packet.tapes[0, RESULT] * 2 * VECTOR
        low, high = simd.load(packet.registers, out, VECTOR), simd.load(packet.registers, out + VECTOR, VECTOR)
        if packet.code[rows - 1, 6] == 0:
            break
    simd.store(packet.results, 0, low)
    simd.store(packet.results, VECTOR, high)
    maybe = packet.state[0]
    return simd.bits((low <= 0.0) & (high >= 0.0)) | (maybe & 0xFFFF)


@helper
def _round_up(x: float) -> float:
    """Round a positive number up to eight binary digits, so that multiples are exact in float32."""
    low_bits = (1 << 45) - 1  # bits of the mantissa after them
    return np.int64((np.float64(x).view(np.int64) + low_bits) & ~low_bits).view(np.float64)


# --- slabs --------------------------------------------------------------------------------------------------------------


@noinline_helper
def _trace_slab(trace, tape, begin, length):
    """Intersect all groups in one slab; return whether any ray is left."""
    packet, quarter = trace.packet, length / QUARTERS
    span_inputs(packet, HULLS, begin, quarter, trace.slack)
    _set_result_bounds(packet, tape)
    packet.state[0] = 0
    evaluate(packet, SPANS, tape, QUARTERS)
    maybe = packet.state[0]
    _store_bounds(packet, tape)
    _simplify_groups(packet, tape, trace.groups, maybe)
    stored, tapes, any_alive = packet.bounds, packet.tape_of, False
    for group in range(trace.groups):
        count = min(VECTOR, trace.vectors - group * VECTOR)
        alive = _any_alive(packet, group, count)
        for k in range(QUARTERS):
            lane = k * VECTOR + group
            if not alive or tapes[lane] < 0:
                continue
            a = begin + k * quarter
            least, most = np.float64(stored[2, lane]), np.float64(stored[3, lane])
            if (least > 0.0 or most < 0.0) and (maybe >> lane) & 1 == 0:
                listed = 0
                for vector in range(group * VECTOR, group * VECTOR + count):
                    if packet.alive[vector] != 0 and not (least > 0.0 and stays_outside(packet, vector, a, a + quarter)):
                        packet.list[listed] = vector
                        packet.slopes[listed], packet.slopes[VECTOR + listed], packet.slopes[2 * VECTOR + listed] = least, most, 1.0
                        packet.slopes[3 * VECTOR + listed] = value_error(stored[0, lane], stored[1, lane], stored[4, lane])
                        listed += 1
                if listed > 0:
                    intersect_vectors(trace, tapes[lane], listed, a, a + quarter)
            else:
                _trace_group(trace, tapes[lane], group, a, quarter / QUARTERS)
            alive = _any_alive(packet, group, count)
        any_alive = any_alive or alive
    return any_alive


@helper
def _simplify_groups(packet: Any, tape: int, groups: int, maybe: int) -> None:
    """Set the tape of each group in each quarter, or −1 where bounds exclude the surface."""
    stored, tapes = packet.bounds, packet.tape_of
    for lane in range(QUARTERS * VECTOR):
        tapes[lane] = -1
        if lane % VECTOR < groups and ((stored[0, lane] <= 0.0 and stored[1, lane] >= 0.0) or (maybe >> lane) & 1 != 0):
            shared_tape = -1
            for k in range(1, ALIKE + 1):
                other = lane - k
                fits = shared_tape < 0 and other >= 0 and tapes[other] >= 0 and (maybe >> other) & 1 == (maybe >> lane) & 1
                if fits and same_choices(packet, tape, lane, other):
                    shared_tape = tapes[other]
            tapes[lane] = shared_tape if shared_tape >= 0 else simplify_for_lane(packet, tape, lane)


@helper
def _set_result_bounds(packet: Any, tape: int) -> None:
    """Bound the result of a long tape that ends with minima and maxima first: known bounds decide more of these."""
    first, rows = packet.tapes[tape, FIRST_ROW], packet.tapes[tape, ROW_COUNT]
    if rows < LONG_TAPE or packet.code[first + rows - 1, 6] == 0:
        return
    registers, wide = packet.registers, QUARTERS * VECTOR
    for part in range(2):  # inputs of boxes from those of spans
        for axis in range(3):
            for k in range(0, wide, VECTOR):
                x = simd.load(registers, (PARTS_OF_SPAN * axis + part) * wide + k, VECTOR)
                simd.store(packet.inputs, (2 * axis + part) * wide + k, x)
    for k in range(0, 15 * wide, VECTOR):
        x = simd.load(registers, k, VECTOR)
        simd.store(packet.inputs, 6 * wide + k, x)
    for k in range(0, 6 * wide, VECTOR):
        simd.store(registers, k, simd.load(packet.inputs, k, VECTOR))
    low, high = simd.load(registers, KNOWN * PARTS_OF_SPAN * wide, VECTOR), simd.load(registers, (KNOWN * PARTS_OF_SPAN + 1) * wide, VECTOR)
    set_known_bounds(packet, 2, QUARTERS, low, high)
    packet.state[0] = 0
    evaluate(packet, BOXES, tape, QUARTERS)
    out = packet.tapes[tape, RESULT] * 2 * wide
    for k in range(0, 2 * wide, VECTOR):
        simd.store(packet.inputs, k, simd.load(registers, out + k, VECTOR))
    for k in range(0, 15 * wide, VECTOR):
        simd.store(registers, k, simd.load(packet.inputs, 6 * wide + k, VECTOR))
    set_known_bounds(packet, PARTS_OF_SPAN, QUARTERS, low, high)
    for k in range(0, 2 * wide, VECTOR):
        simd.store(registers, KNOWN * PARTS_OF_SPAN * wide + k, simd.load(packet.inputs, k, VECTOR))


@helper
def _any_alive(packet: Any, group: int, count: int) -> bool:
    alive = np.int32(0)
    for vector in range(group * VECTOR, group * VECTOR + count):
        alive |= packet.alive[vector]
    return alive != 0


@helper
def _store_bounds(packet: Any, tape: int) -> None:
    """Copy the results of `spans32` to `bounds`."""
    rows = QUARTERS * VECTOR
    out = packet.tapes[tape, RESULT] * PARTS_OF_SPAN * rows
    for k in range(0, PARTS_OF_SPAN * rows, VECTOR):
        simd.store(packet.bounds, k, simd.load(packet.registers, out + k, VECTOR))


@noinline_helper
def _trace_group(trace, tape, group, begin, length):
    """Intersect the vectors of a group in four intervals from `begin` on; slopes are bounded only where a root is possible."""
    packet, slack = trace.packet, trace.slack
    set_known_bounds(packet, 2, QUARTERS, simd.f32x16(-np.inf), simd.f32x16(np.inf))
    quarter_inputs(packet, group * VECTOR, begin, length, slack)
    packet.state[0] = 0
    evaluate(packet, BOXES, tape, QUARTERS)
    maybe, out = packet.state[0], packet.tapes[tape, RESULT] * 2 * QUARTERS
    for k in range(QUARTERS):  # the registers are reused below
        simd.store(packet.inputs, k * VECTOR, simd.load(packet.registers, (out + k) * VECTOR, VECTOR))
        simd.store(packet.inputs, (QUARTERS + k) * VECTOR, simd.load(packet.registers, (out + QUARTERS + k) * VECTOR, VECTOR))
    for k in range(QUARTERS):
        low, high = simd.load(packet.inputs, k * VECTOR, VECTOR), simd.load(packet.inputs, (QUARTERS + k) * VECTOR, VECTOR)
        candidates = simd.bits((low <= 0.0) & (high >= 0.0)) | ((maybe >> (k * VECTOR)) & 0xFFFF)
        a = begin + k * length
        if candidates & _alive_vectors(trace, group) == 0:
            continue
        span_input(packet, group * VECTOR, a, length, slack)
        set_known_bounds(packet, PARTS_OF_SPAN, 1, low, high)
        packet.state[0] = 0
        evaluate(packet, SPANS, tape, 1)
        out = packet.tapes[tape, RESULT] * PARTS_OF_SPAN * VECTOR
        for part in range(PARTS_OF_SPAN):
            bound = simd.load(packet.registers, out + part * VECTOR, VECTOR)
            simd.store(packet.bounds, (PARTS_OF_SPAN + part) * QUARTERS * VECTOR, bound)
        listed = _list_vectors(packet, group, candidates & _alive_vectors(trace, group), packet.state[0], a, length)
        if listed > 0:
            intersect_vectors(trace, tape, listed, a, a + length)


@helper
def _list_vectors(packet: Any, group: int, candidates: int, unsure_of: int, a: float, length: float) -> int:
    """List the vectors of a group, of those in the bits `candidates`, that may hit the surface in a … a + length; return how many."""
    stored, count = packet.bounds, 0
    while candidates != 0:
        lane = simd.trailing_zeros(candidates)
        candidates &= candidates - 1
        unsure = (unsure_of >> lane) & 1 != 0
        if (stored[5, lane] <= 0.0 and stored[6, lane] >= 0.0) or unsure:
            least, most = stored[7, lane], stored[8, lane]
            if least > 0.0 and not unsure and stays_outside(packet, group * VECTOR + lane, a, a + length):
                continue
            packet.list[count] = group * VECTOR + lane
            packet.slopes[count], packet.slopes[VECTOR + count] = (-np.inf, np.inf) if unsure else (least, most)
            packet.slopes[2 * VECTOR + count] = 1.0 if (least > 0.0 or most < 0.0) and not unsure else 0.0
            error = value_error(stored[5, lane], stored[6, lane], stored[9, lane])
            packet.slopes[3 * VECTOR + count] = np.inf if unsure else error
            count += 1
    return count


@helper
def _alive_vectors(trace: Traversal, group: int) -> int:
    """Bits of a group's vectors that have rays without a hit."""
    alive = 0
    for number in range(min(VECTOR, trace.vectors - group * VECTOR)):
        if trace.packet.alive[group * VECTOR + number] != 0:
            alive |= 1 << number
    return alive
