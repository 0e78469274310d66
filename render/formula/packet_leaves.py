"""Segments of a packet's vectors: certain hits, certain misses, and undecided rays, which are searched one by one."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..simd.atomics import count_up
from . import root_isolation
from .evaluate import RayFunction, value_on
from .hit_geometry import MANIFOLD, bracket_error, gradient_at
from .packet_roots import (
    Segments,
    Traversal,
    append_segments,
    correct_at_discontinuity,
    refine_brackets,
    write_hits,
    write_occlusion,
)
from .packet_state import (
    ANY,
    END,
    ENTER,
    FINEST,
    GROUP,
    LEAVE,
    MAX_PIECES,
    PARTS_OF_SPAN,
    SPACED,
    SPANS,
    STEP,
    VALUE_AT_BEGIN,
    VECTOR,
    U,
    evaluate,
    evaluate_points,
    load_single,
    ray_function,
    set_known_bounds,
    sign_in_float64,
    value_error,
)
from .tables import IS_SHEET, LARGEST_COORDINATE, RESULT

COUNTED = 1 << 40  # added to a ray's rounds once it is counted as unproved

# --- segments of listed vectors ------------------------------------------------------------------------------------------


@noinline_helper
def intersect_vectors(trace, tape, count, a, b):
    """Intersect the listed vectors in a … b with one tape."""
    packet, are_carried = trace.packet, True
    for i in range(count):  # the value of a ray that begins in here is not known yet
        first = simd.load(packet.rays, ENTER + packet.list[i] * VECTOR, VECTOR)
        are_carried = are_carried and packet.carried_at[packet.list[i]] == np.float32(a) and simd.none_of((first > a) & (first < b))
    if are_carried:
        for i in range(count):
            simd.store(packet.values, i * VECTOR, simd.load(packet.carried, packet.list[i] * VECTOR, VECTOR))
    else:
        _write_values(trace, tape, count, a, a, b, 0)
    if _all_stay_outside(packet, count, a, b):
        return
    _write_values(trace, tape, count, b, a, b, GROUP)
    opened, held = _classify(packet, count, a, b)
    if opened > 0:
        held = _search_open(trace, tape, opened, held)
    if held > 0 and trace.hits.number == ANY:
        for k in range(held):
            write_occlusion(trace, np.int64(packet.bracket_ray[k]))
    elif held > 0:
        refine_brackets(trace, tape, held)


@helper
def _classify(packet: Any, count: int, a: float, b: float) -> tuple[int, int]:
    """Append the listed vectors' rays to the open segments or the brackets, by their values: (open segments, brackets)."""
    opened, held = 0, 0
    for i in range(count):
        vector = packet.list[i]
        first_ray = vector * VECTOR
        first, last = simd.load(packet.rays, ENTER + first_ray, VECTOR), simd.load(packet.rays, LEAVE + first_ray, VECTOR)
        fa, fb = simd.load(packet.values, i * VECTOR, VECTOR), simd.load(packet.values, GROUP + i * VECTOR, VECTOR)
        simd.store(packet.carried, first_ray, fb)
        packet.carried_at[vector] = b
        begin, end = simd.maximum(first, a), simd.minimum(last, b)
        live = simd.mask_from_bits(packet.alive[vector], first) & (begin < end)
        least, most = np.float32(packet.slopes[i]), np.float32(packet.slopes[VECTOR + i])
        monotonic, error = packet.slopes[2 * VECTOR + i] > 0.0, np.float32(packet.slopes[3 * VECTOR + i])
        change = (fa <= 0.0) ^ (fb <= 0.0)
        if monotonic:
            certain, open_ = live & change, live & ~live
        else:
            certain = live & ~live
            open_ = live & ~(~change & excludes_root_single(fa, fb, least, most, end - begin, error))
        ray = first_ray + simd.iota(simd.i32x16(0))
        zero = first * 0.0
        if simd.any_of(certain):
            steep = zero + min(abs(least), abs(most))
            segments = Segments(begin, end, fa, fb, steep, zero, zero + error, ray)
            held = append_segments(packet.brackets, packet.bracket_ray, held, certain, segments)
        if simd.any_of(open_):
            segments = Segments(begin, end, fa, fb, end - begin, zero, zero + error, ray)
            opened = append_segments(packet.open, packet.open_ray, opened, open_, segments)
    return opened, held


@helper
def stays_outside(packet: Any, vector: int, a: float, b: float) -> bool:
    """Whether all rays of a vector are known to be outside at a, for values that rise up to b: then they have no root in between.

    The known values, lower bounds, then hold at b.
    """
    if packet.carried_at[vector] != np.float32(a):
        return False
    first_ray = vector * VECTOR
    first, carried = simd.load(packet.rays, ENTER + first_ray, VECTOR), simd.load(packet.carried, first_ray, VECTOR)
    live = simd.mask_from_bits(packet.alive[vector], first)
    if simd.any_of(live & (((first >= a) & (first < b)) | ~(carried > 0.0))):
        return False
    packet.carried_at[vector] = b
    return True


@helper
def _all_stay_outside(packet: Any, count: int, a: float, b: float) -> bool:
    """`stays_outside` for all listed vectors, by the values at a or at the rays' begins behind it."""
    for i in range(count):
        if not (packet.slopes[i] > 0.0 and packet.slopes[2 * VECTOR + i] > 0.0):
            return False
        first_ray = packet.list[i] * VECTOR
        first, last = simd.load(packet.rays, ENTER + first_ray, VECTOR), simd.load(packet.rays, LEAVE + first_ray, VECTOR)
        live = simd.mask_from_bits(packet.alive[packet.list[i]], first) & (first < b) & (last > a)
        if simd.any_of(live & ~(simd.load(packet.values, i * VECTOR, VECTOR) > 0.0)):
            return False
    for i in range(count):
        simd.store(packet.carried, packet.list[i] * VECTOR, simd.load(packet.values, i * VECTOR, VECTOR))
        packet.carried_at[packet.list[i]] = b
    return True


@helper
def excludes_root_single(fa: Any, fb: Any, least: Any, most: Any, length: Any, error: Any) -> Any:
    """bracketing.excludes_root in float32."""
    up = fa > 0.0
    falls, rises = simd.select(up, least, -most), simd.select(up, most, -least)
    size_a, size_b = abs(fa), abs(fb)
    steep = rises - falls
    x = (size_a - size_b + rises * length) / simd.select(steep > 0.0, steep, 1.0)
    x = simd.minimum(simd.maximum(x, 0.0), length)
    lowest = size_a + falls * x
    return lowest > 4.0 * error + 1e-5 * (size_a + size_b)


@noinline_helper
def _write_values(trace, tape, count, s, a, b, to):
    """Write the values of the listed vectors at s, clamped to the rays' own begin and end, from element `to` of `values` on."""
    packet = trace.packet
    for i in range(count):
        first_ray = packet.list[i] * VECTOR
        first, last = simd.load(packet.rays, ENTER + first_ray, VECTOR), simd.load(packet.rays, LEAVE + first_ray, VECTOR)
        distance = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
        distance = simd.select(first < last, distance, 0.0)
        for axis in range(3):
            o, d = (
                simd.load(packet.rays, axis * SPACED + first_ray, VECTOR),
                simd.load(packet.rays, (3 + axis) * SPACED + first_ray, VECTOR),
            )
            simd.store(packet.registers, (axis * count + i) * VECTOR, simd.fma(d, distance, o))
    evaluate_points(packet, tape, count)
    out = packet.tapes[tape, RESULT] * count
    for i in range(count):
        f = simd.load(packet.registers, (out + i) * VECTOR, VECTOR)
        simd.store(packet.values, to + i * VECTOR, f)
    for i in range(count):
        f = simd.load(packet.values, to + i * VECTOR, VECTOR)
        first_ray = packet.list[i] * VECTOR
        first, last = simd.load(packet.rays, ENTER + first_ray, VECTOR), simd.load(packet.rays, LEAVE + first_ray, VECTOR)
        near = ~(abs(f) > np.float32(packet.slopes[3 * VECTOR + i])) & (first < b) & (last > a)
        near = near & simd.mask_from_bits(packet.alive[packet.list[i]], f)
        if simd.any_of(near):
            distance = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
            f = sign_in_float64(packet, trace.memory, tape, first_ray + simd.iota(simd.i32x16(0)), distance, f, near)
            simd.store(packet.values, to + i * VECTOR, f)


# --- open segments of single rays ----------------------------------------------------------------------------------------


@noinline_helper
def _search_open(trace, tape, opened, count):
    """Search the first root in each open segment, piece by piece; return the number of brackets. Decided segments leave the list."""
    turns = 0
    while opened > 0:
        still_open = 0
        for first in range(0, opened, VECTOR):
            still_open, count = _search_vector(trace, tape, first, opened, still_open, count, turns)
        opened, turns = still_open, turns + 1
    return count


@helper
def _search_vector(trace: Traversal, tape: int, first: int, opened: int, still_open: int, count: int, turns: int) -> tuple[int, int]:
    """Bound the next piece of sixteen open segments from `first` on: (segments that stay open so far, brackets)."""
    packet = trace.packet
    working = simd.iota(simd.i32x16(0)) < opened - first
    ray = simd.select(working, simd.load(packet.open_ray, first, VECTOR), packet.open_ray[first])
    begin = simd.select(working, simd.load(packet.open, first, VECTOR), 0.0)
    end = simd.select(working, simd.load(packet.open, END + first, VECTOR), 1.0)
    f, step = simd.load(packet.open, VALUE_AT_BEGIN + first, VECTOR), simd.load(packet.open, STEP + first, VECTOR)
    to = simd.minimum(begin + step, end)
    to = simd.select(end - to < 0.25 * step, end, to)
    low, high, least, most, error, far, sure = _bound_piece(packet, tape, ray, begin, to, trace.slack)
    near = working & ~(sure & (abs(far) > error))
    if simd.any_of(near):
        far = sign_in_float64(packet, trace.memory, tape, ray, to, far, near)
    change = (f <= 0.0) ^ (far <= 0.0)
    monotonic = sure & ((least > 0.0) | (most < 0.0))
    away = sure & ((low > 0.0) | (high < 0.0))
    passed = working & ~change & (away | monotonic | (sure & excludes_root_single(f, far, least, most, to - begin, error)))
    certain = working & change & monotonic
    if simd.any_of(certain):
        steep = simd.minimum(abs(least), abs(most))
        segments = Segments(begin, to, f, far, steep, steep * 0.0, error, ray)
        count = append_segments(packet.brackets, packet.bracket_ray, count, certain, segments)
    begin, f = simd.select(passed, to, begin), simd.select(passed, far, f)
    step = simd.select(passed, 2.0 * step, 0.25 * step)
    working = working & ~certain & ~(passed & (begin >= end))
    given_up = working & ~passed & (step < FINEST * trace.reach) if turns < MAX_PIECES else working
    working = working & ~given_up
    simd.compress_store(packet.open, still_open, begin, working)
    simd.compress_store(packet.open, END + still_open, end, working)
    simd.compress_store(packet.open, VALUE_AT_BEGIN + still_open, f, working)
    simd.compress_store(packet.open, STEP + still_open, step, working)
    still_open += simd.compress_store(packet.open_ray, still_open, ray, working)
    bits = simd.bits(given_up)
    while bits != 0:
        j = simd.trailing_zeros(bits)
        bits &= bits - 1
        _isolate_in_float64(trace, tape, np.int64(simd.lane(ray, j)), simd.lane(begin, j), simd.lane(end, j))
    return still_open, count


@helper
def _bound_piece(packet: Any, tape: int, ray: Any, begin: Any, to: Any, slack: float) -> Any:
    """(low, high, least slope, most, error, value at the end, lanes that are defined) over the segments at … to of sixteen rays."""
    registers = packet.registers
    for axis in range(3):
        o, d = load_single(packet.rays, axis, ray), load_single(packet.rays, 3 + axis, ray)
        p, q = simd.fma(d, begin, o), simd.fma(d, to, o)
        row = PARTS_OF_SPAN * axis
        simd.store(registers, row * VECTOR, simd.minimum(p, q) - slack)
        simd.store(registers, (row + 1) * VECTOR, simd.maximum(p, q) + slack)
        simd.store(registers, (row + 2) * VECTOR, d - 2.0 * U)
        simd.store(registers, (row + 3) * VECTOR, d + 2.0 * U)
        simd.store(registers, (row + 4) * VECTOR, d * 0.0 + slack)
        simd.store(packet.packed, axis * VECTOR, q)
    set_known_bounds(packet, PARTS_OF_SPAN, 1, simd.f32x16(-np.inf), simd.f32x16(np.inf))
    packet.state[0] = 0
    evaluate(packet, SPANS, tape, 1)
    out = packet.tapes[tape, RESULT] * PARTS_OF_SPAN * VECTOR
    low, high = simd.load(registers, out, VECTOR), simd.load(registers, out + VECTOR, VECTOR)
    least, most = simd.load(registers, out + 2 * VECTOR, VECTOR), simd.load(registers, out + 3 * VECTOR, VECTOR)
    error = value_error(low, high, simd.load(registers, out + 4 * VECTOR, VECTOR))
    sure = ~simd.mask_from_bits(packet.state[0], low)
    for axis in range(3):
        simd.store(registers, axis * VECTOR, simd.load(packet.packed, axis * VECTOR, VECTOR))
    evaluate_points(packet, tape, 1)
    return low, high, least, most, error, simd.load(registers, packet.tapes[tape, RESULT] * VECTOR, VECTOR), sure


@noinline_helper
def _isolate_in_float64(trace, tape, ray, a, b):
    """Find the first root of one ray in a … b in float64, and write its hit."""
    packet, start = trace.packet, trace.start
    zero = ops.to_float(crosslane.lane_indices(0)) * 0.0
    x = packet.exact
    o, d = (x[ray], x[SPACED + ray], x[2 * SPACED + ray]), (x[3 * SPACED + ray], x[4 * SPACED + ray], x[5 * SPACED + ray])
    low, high = max(np.float64(a), x[ENTER + ray]), min(np.float64(b), x[LEAVE + ray])
    rounds = max(root_isolation.MAX_ROUNDS - packet.spent[ray] % COUNTED, root_isolation.MIN_ROUNDS)
    function = RayFunction(packet, 0, tape, trace.memory, o, d)
    root, inside, doubt, used = root_isolation.isolate_first_root(
        function, low, high, x[ENTER + ray], start, packet.places[0, IS_SHEET] != 0, zero, rounds
    )  # fmt: skip
    packet.spent[ray] += used
    if doubt > 0 and packet.spent[ray] < COUNTED:
        packet.spent[ray] += COUNTED
        count_up(packet.unproved, 0, 1)
    if root < np.inf and trace.hits.number == ANY:
        write_occlusion(trace, ray)
    elif root < np.inf:
        first_lane = crosslane.lane_indices(0) < 1
        rays, distance = ops.int_like(zero, ray), zero + root
        lanes, far = ray_function(packet, trace.memory, tape, rays), start + distance + packet.numbers[0, LARGEST_COORDINATE]
        value = value_on(lanes, distance, first_lane)
        gradient = gradient_at(lanes, distance, far, first_lane)
        within, off = ops.bool_like(zero, inside), MANIFOLD * abs(value) + bracket_error(gradient, far)
        distance, gradient, off = correct_at_discontinuity(trace, rays, lanes.direction, distance, within, gradient, off, first_lane)
        write_hits(trace, rays, lanes.direction, distance, off, gradient, within, first_lane)
