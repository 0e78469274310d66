"""Where bundles of rays that go much the same way meet a formula's surface: as rays of cells.py do, bounds shared by all of a bundle.

A bundle is up to 4096 rays: vectors of 16 rays, groups of 16 vectors (a group is a square of 16 × 16 pixels, a vector one of 4 × 4).
The stretch in which they may meet the box is cut into 16 slabs. Bounds over the box around all rays in a slab say where there is no
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
from numpy.typing import NDArray

from .. import across, lanes, simd
from ..kernels import apart as apart_
from ..kernels import helper, kernel
from ..records import Lane, Vec
from . import search
from .calls import count_up, interpret
from .cells import CHOICE, place, simplify
from .evaluate import room as room_of_values
from .evaluate import turns_at, value_at
from .fields import PROGRAMS, Forms
from .interpreter import KNOWN, PARTS, UNKNOWN
from .meet import bracketed, clipped, dressed
from .programs import WIDTHS
from .vectors import LANES, ROW, SINGLE

RAYS = 4096
VECTOR, GROUP, SLABS, QUARTERS = 16, 256, 16, 4
PARTS_OF_SPAN = WIDTHS["spans32"]
_POINTS, _BOXES, _SPANS = (PROGRAMS.index(name) for name in ("points32", "boxes32", "spans32"))
_HULLS = RAYS // VECTOR  # of vectors; those of groups stand behind them
_STRIDE = _HULLS + GROUP // VECTOR
_OPEN = GROUP + VECTOR
FINEST = 2.0**-17  # of the largest coordinate: pieces of a ray that float32 does not cut
WIDEST = 8.0  # times its diagonal, in which rays of a bundle may enter the box
MOST_TURNS = 12
LONG = 40  # rows of a tape for which it pays to ask for the result first
MOST_PIECES = 400
U = 2.0**-24


class Room(NamedTuple):
    """What a thread works with on one surface: its row of fields.Forms, and memory."""

    programs: NDArray[np.int64]
    constants: NDArray[np.float64]
    constants32: NDArray[np.float32]
    compiled: NDArray[np.int64]
    numbers: NDArray[np.float64]
    places: NDArray[np.int64]
    unproved: NDArray[np.int64]
    whole: NDArray[np.int32]  # rows of the whole tape, as names
    names: NDArray[np.int32]
    code: NDArray[np.int32]
    tapes: NDArray[np.int64]
    ends: NDArray[np.int64]
    scratch: NDArray[np.int64]
    state: NDArray[np.int64]
    registers: NDArray[np.float32]
    rays: NDArray[np.float32]  # x y z of the start, x y z of the way, first and last distance
    exact: NDArray[np.float64]  # the same, and how long directions were
    hulls: NDArray[np.float32]  # (12, _STRIDE) lowest x y z of starts, highest; of ways
    alive: NDArray[np.int32]  # bits of each vector's rays that have met nothing yet
    carried_at: NDArray[np.float32]  # where each vector's values are known
    carried: NDArray[np.float32]
    list: NDArray[np.int64]  # vectors that are looked at
    slopes: NDArray[np.float32]  # (4, …) their bounds: least, most; 1 where these have one sign; by how much values may be off
    values: NDArray[np.float32]  # (2, …) at both ends
    open: NDArray[np.float32]  # (9, …) stretches of single rays, as brackets
    open_ray: NDArray[np.int32]
    brackets: NDArray[np.float32]  # (11, …) ends, values there, least slope, side, values as they were, how far off they are, first ends
    bracket_ray: NDArray[np.int32]
    packed: NDArray[np.float32]  # (6, …) rays
    kept: NDArray[np.int64]  # the state after bounds of slabs
    bounds: NDArray[np.float32]  # (10, 64) of groups in quarters, and of vectors in theirs: what `spans32` found
    results: NDArray[np.float32]  # (2, 16) what is known of the result in slabs
    inputs: NDArray[np.float32]  # what is put aside
    tape_of: NDArray[np.int64]  # groups' tapes in quarters, or -1


def room(forms: Forms, k: int) -> Room:
    """Room for surface k."""
    places = forms.places[k]
    first, rows = int(places[7]), int(forms.tapes[places[6], 1])
    begin = int(places[5])
    wide = begin // (PARTS * LANES) * PARTS * SINGLE.lanes
    whole = forms.names[first : first + rows]
    choices = int(CHOICE[whole[:, 0]].sum())
    many = 24 * rows + 2048
    single, double, whole_number = np.float32, np.float64, np.int64
    here = np.zeros((1, 8), np.int64)
    here[0, 1] = places[1]
    return Room(
        forms.programs, forms.constants[begin:], forms.constants32[wide:], forms.compiled[k : k + 1], forms.numbers[k : k + 1], here,
        forms.unproved, np.ascontiguousarray(whole), np.zeros((many, 4), np.int32), np.zeros((many, ROW), np.int32),
        np.zeros((512, 4), whole_number), np.zeros(3, whole_number), np.zeros(3 * rows + 8, whole_number),
        np.zeros(1 + 2 * max(choices, 1), whole_number), np.zeros((KNOWN + 1) * PARTS_OF_SPAN * QUARTERS * VECTOR, single),
        np.zeros(8 * RAYS, single), np.zeros(9 * RAYS, double), np.zeros(12 * _STRIDE, single), np.zeros(_HULLS, np.int32),
        np.zeros(_HULLS, single), np.zeros(RAYS, single), np.zeros(VECTOR, whole_number), np.zeros(4 * VECTOR, single),
        np.zeros(2 * GROUP, single), np.zeros(9 * _OPEN, single), np.zeros(_OPEN, np.int32), np.zeros(11 * _OPEN, single),
        np.zeros(_OPEN, np.int32), np.zeros(6 * _OPEN, single), np.zeros(1 + 2 * max(choices, 1), whole_number),
        np.zeros((2 * PARTS_OF_SPAN, QUARTERS * VECTOR), single), np.zeros(2 * VECTOR, single), np.zeros(21 * QUARTERS * VECTOR, single),
        np.zeros(QUARTERS * VECTOR, whole_number),
    )  # fmt: skip


@kernel
def trace(room, origin, direction, t_min, t_max, t, spacing, u, v):
    """Meet rays (n, 3), n ≤ RAYS, with the room's surface, as meet.meet does; False where they go too far apart to be a bundle."""
    n = len(t_min)
    memory = room_of_values()
    begin, length = _begun(room, origin, direction, t_min, t_max, n)
    for i in range(n):
        t[i] = np.inf
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
    _hulled(room, vectors)
    groups = (n + GROUP - 1) // GROUP
    room.ends[2] = groups
    slab = _rounded(length / SLABS)
    reach = numbers[0, 13] + length
    slack = 32.0 * U * reach
    _around(room, groups)
    _box_inputs(room, _HULLS, slab, slack)
    low, high = simd.f32x16(-np.inf), simd.f32x16(np.inf)
    for _ in range(2):  # what is known of the result then says more of minima on the way to it
        _known(room, 2, 1, low, high)
        room.state[0] = 0
        _run(room, _BOXES, 0, 1)
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
        tape = _simpler(room, 0, i)
        _known(room, PARTS_OF_SPAN, QUARTERS, simd.f32x16(room.results[i]), simd.f32x16(room.results[VECTOR + i]))
        if not _slab(room, memory, origin, tape, i * slab, slab, groups, vectors, begin, slack, reach, t, spacing, u, v):
            break
    return True


@helper
def _rounded(x: float) -> float:
    """No less, in eight binary digits: so multiples are exact in float32."""
    mantissa, exponent = math.frexp(x)
    return math.ldexp(math.ceil(mantissa * 256.0), exponent - 8)


@helper
def _run(room: Any, program: int, tape: int, vectors: int) -> None:
    tapes = room.tapes
    first, rows = tapes[tape, 0], tapes[tape, 1]
    interpret(room.programs[program], room.code, first, rows, room.registers, room.constants32, 0, room.state, np.int64(vectors))


@helper
def _known(room: Any, parts: int, vectors: int, low: Any, high: Any) -> None:
    """Tell programs whose values have so many parts the bounds of the result."""
    for vector in range(vectors):
        unknown, known = UNKNOWN * parts * vectors + vector, KNOWN * parts * vectors + vector
        simd.store(room.registers, unknown * VECTOR, simd.f32x16(-np.inf))
        simd.store(room.registers, (unknown + vectors) * VECTOR, simd.f32x16(np.inf))
        simd.store(room.registers, known * VECTOR, low)
        simd.store(room.registers, (known + vectors) * VECTOR, high)


@helper
def _simpler(room: Any, tape: int, lane: int) -> int:
    """The tape that a lane of the last bounds needs; the same where it may be undefined there, or there is no room."""
    if (room.state[0] >> lane) & 1 != 0:
        return tape
    found = simplify(room.names, room.code, room.tapes, room.ends, tape, room.state, lane, room.scratch)
    return found if found >= 0 else tape


# --- the rays -----------------------------------------------------------------------------------------------------------


@apart_
def _begun(room, origin, direction, t_min, t_max, n):
    """(where the bundle begins, how long the stretch is in which it may meet the box; −1 if none does); sets the rays."""
    exact, rays = room.exact, room.rays
    begin, end = np.inf, -np.inf
    padded = (n + VECTOR - 1) // VECTOR * VECTOR
    for first in range(0, padded, LANES):
        o, d, low, high = _given(origin, direction, t_min, t_max, first, n)
        size = lanes.length(d)
        size = lanes.where(size > 0.0, size, 1.0)
        way = lanes.scale(d, 1.0 / size)
        enter, leave = clipped(room, 0, o, way, low * size, high * size)
        active = (enter < leave) & (across.numbered(first) < n)
        enter, leave = lanes.where(active, enter, np.inf), lanes.where(active, leave, -np.inf)
        begin, end = min(begin, across.least(enter)), max(end, across.most(leave))
        for axis in range(3):
            across.store_row(exact, axis * RAYS + first, o[0] if axis == 0 else o[1] if axis == 1 else o[2])
            across.store_row(exact, (3 + axis) * RAYS + first, way[0] if axis == 0 else way[1] if axis == 1 else way[2])
        across.store_row(exact, 6 * RAYS + first, enter)
        across.store_row(exact, 7 * RAYS + first, leave)
        across.store_row(exact, 8 * RAYS + first, size)
    if not begin < end:
        return 0.0, -1.0
    for first in range(0, padded, LANES):
        for axis in range(3):
            way = across.load_row(exact, (3 + axis) * RAYS + first)
            start = across.load_row(exact, axis * RAYS + first) + begin * way
            across.store_row(exact, axis * RAYS + first, start)
            across.store_row(rays, axis * RAYS + first, start)
            across.store_row(rays, (3 + axis) * RAYS + first, way)
        enter, leave = across.load_row(exact, 6 * RAYS + first) - begin, across.load_row(exact, 7 * RAYS + first) - begin
        across.store_row(exact, 6 * RAYS + first, enter)
        across.store_row(exact, 7 * RAYS + first, leave)
        across.store_row(rays, 6 * RAYS + first, enter * (1.0 - 4.0 * U))
        across.store_row(rays, 7 * RAYS + first, leave * (1.0 + 4.0 * U))
    return begin, end - begin


@helper
def _given(origin: Any, direction: Any, t_min: Any, t_max: Any, first: int, n: int) -> tuple[Vec, Vec, Lane, Lane]:
    """Rays from the first on; beyond the end the last one again."""
    if first + LANES <= n:
        o, d = across.load_rows3(origin, first), across.load_rows3(direction, first)
        return o, d, across.load_row(t_min, first), across.load_row(t_max, first)
    rows = lanes.minimum(across.numbered(first), n - 1)
    o, d = (origin[rows, 0], origin[rows, 1], origin[rows, 2]), (direction[rows, 0], direction[rows, 1], direction[rows, 2])
    return o, d, t_min[rows], t_max[rows]


@apart_
def _hulled(room, vectors):
    """Boxes around the starts and ways of each vector's rays; which rays are alive."""
    for vector in range(vectors):
        at = vector * VECTOR
        there = simd.load(room.rays, 6 * RAYS + at, VECTOR) < simd.load(room.rays, 7 * RAYS + at, VECTOR)
        room.alive[vector] = simd.bits(there)
        room.carried_at[vector] = -1.0
        if room.alive[vector] == 0:
            continue
        for part in range(2):
            for axis in range(3):
                x = simd.load(room.rays, (3 * part + axis) * RAYS + at, VECTOR)
                room.hulls[(6 * part + axis) * _STRIDE + vector] = simd.min_of(simd.select(there, x, np.inf))
                room.hulls[(6 * part + 3 + axis) * _STRIDE + vector] = simd.max_of(simd.select(there, x, -np.inf))


@helper
def _around(room: Any, groups: int) -> None:
    """Boxes around groups, which stand behind those of vectors; then, in all lanes of the inputs' first place, around all."""
    for row in range(12):
        high = row % 6 >= 3
        for group in range(groups):
            found = -np.inf if high else np.inf
            for k in range(VECTOR):
                vector = group * VECTOR + k
                if room.alive[vector] != 0:
                    x = np.float64(room.hulls[row * _STRIDE + vector])
                    found = max(found, x) if high else min(found, x)
            room.hulls[row * _STRIDE + _HULLS + group] = found


@helper
def _box_inputs(room: Any, groups_at: int, slab: float, slack: float) -> None:
    """The boxes around all rays in each slab, as inputs of `boxes32`."""
    number = simd.f32x16(simd.iota(simd.i32x16(0)))
    a, b = number * slab, (number + 1.0) * slab
    for axis in range(3):
        o_low = simd.min_of(_groups(room, axis, groups_at, np.inf))
        o_high = simd.max_of(_groups(room, 3 + axis, groups_at, -np.inf))
        d_low = simd.min_of(_groups(room, 6 + axis, groups_at, np.inf))
        d_high = simd.max_of(_groups(room, 9 + axis, groups_at, -np.inf))
        simd.store(room.registers, (2 * axis) * VECTOR, o_low + simd.minimum(a * d_low, b * d_low) - slack)
        simd.store(room.registers, (2 * axis + 1) * VECTOR, o_high + simd.maximum(a * d_high, b * d_high) + slack)


@helper
def _groups(room: Any, row: int, at: int, empty: float) -> Any:
    x = simd.load(room.hulls, row * _STRIDE + at, VECTOR)
    return simd.select(simd.iota(simd.i32x16(0)) < room.ends[2], x, empty)


@helper
def _span_inputs(room: Any, at: int, begin: float, length: float, slack: float) -> None:
    """The boxes around sixteen hulls from `at` on, in each quarter of a slab, as inputs of `spans32`."""
    for axis in range(3):
        o_low = simd.load(room.hulls, axis * _STRIDE + at, VECTOR) - slack
        o_high = simd.load(room.hulls, (3 + axis) * _STRIDE + at, VECTOR) + slack
        d_low = simd.load(room.hulls, (6 + axis) * _STRIDE + at, VECTOR) - 2.0 * U
        d_high = simd.load(room.hulls, (9 + axis) * _STRIDE + at, VECTOR) + 2.0 * U
        for quarter in range(QUARTERS):
            a, b = begin + quarter * length, begin + (quarter + 1) * length
            row = (PARTS_OF_SPAN * axis * QUARTERS + quarter) * VECTOR
            simd.store(room.registers, row, o_low + simd.minimum(d_low * a, d_low * b))
            simd.store(room.registers, row + QUARTERS * VECTOR, o_high + simd.maximum(d_high * a, d_high * b))
            simd.store(room.registers, row + 2 * QUARTERS * VECTOR, d_low)
            simd.store(room.registers, row + 3 * QUARTERS * VECTOR, d_high)
            simd.store(room.registers, row + 4 * QUARTERS * VECTOR, d_high * 0.0 + slack)


# --- slabs --------------------------------------------------------------------------------------------------------------


@apart_
def _slab(room, memory, origin, tape, begin, length, groups, vectors, start, slack, reach, t, spacing, u, v):
    """Meet all groups in one slab; whether any ray is left."""
    quarter = length / QUARTERS
    _span_inputs(room, _HULLS, begin, quarter, slack)
    _known_first(room, tape)
    room.state[0] = 0
    _run(room, _SPANS, tape, QUARTERS)
    maybe = room.state[0]
    stored, tapes = room.bounds, room.tape_of
    _store_bounds(room, tape, 0)
    for lane in range(QUARTERS * VECTOR):
        tapes[lane] = -1
        if lane % VECTOR < groups and ((stored[0, lane] <= 0.0 and stored[1, lane] >= 0.0) or (maybe >> lane) & 1 != 0):
            tapes[lane] = _simpler(room, tape, lane)
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
                    if room.alive[vector] != 0:
                        room.list[count] = vector
                        room.slopes[count], room.slopes[VECTOR + count], room.slopes[2 * VECTOR + count] = least, most, 1.0
                        room.slopes[3 * VECTOR + count] = _error(stored[0, lane], stored[1, lane], stored[4, lane])
                        count += 1
                _leaf(room, memory, origin, tapes[lane], count, a, a + quarter, start, reach, slack, t, spacing, u, v)
            else:
                _finer(room, memory, origin, tapes[lane], group, many, a, quarter / QUARTERS, start, slack, reach, t, spacing, u, v)
            alive = _any_alive(room, group, many)
        left = left or alive
    return left


@helper
def _error(low: Any, high: Any, off: Any) -> Any:
    """By how much values between bounds may be off, with their own rounding."""
    return off * 1.01 + 2.0 * U * (abs(low) + abs(high))


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
    _known(room, 2, QUARTERS, low, high)
    room.state[0] = 0
    _run(room, _BOXES, tape, QUARTERS)
    out = room.tapes[tape, 2] * 2 * wide
    for k in range(0, 2 * wide, VECTOR):
        simd.store(room.inputs, k, simd.load(registers, out + k, VECTOR))
    for k in range(0, 15 * wide, VECTOR):
        simd.store(registers, k, simd.load(room.inputs, 6 * wide + k, VECTOR))
    _known(room, PARTS_OF_SPAN, QUARTERS, low, high)
    for k in range(0, 2 * wide, VECTOR):
        simd.store(registers, KNOWN * PARTS_OF_SPAN * wide + k, simd.load(room.inputs, k, VECTOR))


@helper
def _any_alive(room: Any, group: int, many: int) -> bool:
    found = np.int32(0)
    for vector in range(group * VECTOR, group * VECTOR + many):
        found |= room.alive[vector]
    return found != 0


@helper
def _store_bounds(room: Any, tape: int, to: int) -> None:
    """Keep what `spans32` found, in rows from `to` on."""
    rows = QUARTERS * VECTOR
    out = room.tapes[tape, 2] * PARTS_OF_SPAN * rows
    for k in range(0, PARTS_OF_SPAN * rows, VECTOR):
        simd.store(room.bounds, to * rows + k, simd.load(room.registers, out + k, VECTOR))


@apart_
def _finer(room, memory, origin, tape, group, many, begin, length, start, slack, reach, t, spacing, u, v):
    """Meet the vectors of a group in the quarters of a stretch."""
    _known(room, PARTS_OF_SPAN, QUARTERS, simd.f32x16(-np.inf), simd.f32x16(np.inf))
    _span_inputs(room, group * VECTOR, begin, length, slack)
    room.state[0] = 0
    _run(room, _SPANS, tape, QUARTERS)
    maybe = room.state[0]
    stored = room.bounds
    _store_bounds(room, tape, PARTS_OF_SPAN)
    for k in range(QUARTERS):
        count = 0
        for number in range(many):
            lane, vector = k * VECTOR + number, group * VECTOR + number
            unsure = (maybe >> lane) & 1 != 0
            if room.alive[vector] != 0 and ((stored[5, lane] <= 0.0 and stored[6, lane] >= 0.0) or unsure):
                least, most = stored[7, lane], stored[8, lane]
                room.list[count] = vector
                room.slopes[count], room.slopes[VECTOR + count] = (-np.inf, np.inf) if unsure else (least, most)
                room.slopes[2 * VECTOR + count] = 1.0 if (least > 0.0 or most < 0.0) and not unsure else 0.0
                error = _error(stored[5, lane], stored[6, lane], stored[9, lane])
                room.slopes[3 * VECTOR + count] = np.inf if unsure else error
                count += 1
        if count > 0:
            a = begin + k * length
            _leaf(room, memory, origin, tape, count, a, a + length, start, reach, slack, t, spacing, u, v)


# --- leaves: a stretch of some vectors ----------------------------------------------------------------------------------


@apart_
def _leaf(room, memory, origin, tape, count, a, b, start, reach, slack, t, spacing, u, v):
    """Meet the vectors of the room's list between a and b, with one tape."""
    known = True
    for i in range(count):  # a ray that begins here has been asked nothing yet
        first = simd.load(room.rays, 6 * RAYS + room.list[i] * VECTOR, VECTOR)
        known = known and room.carried_at[room.list[i]] == np.float32(a) and simd.none_of((first > a) & (first < b))
    if known:
        for i in range(count):
            simd.store(room.values, i * VECTOR, simd.load(room.carried, room.list[i] * VECTOR, VECTOR))
    else:
        _values(room, memory, tape, count, a, a, b, 0)
    _values(room, memory, tape, count, b, a, b, GROUP)
    opened, held = 0, 0
    for i in range(count):
        vector = room.list[i]
        at = vector * VECTOR
        first, last = simd.load(room.rays, 6 * RAYS + at, VECTOR), simd.load(room.rays, 7 * RAYS + at, VECTOR)
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
            open_ = live & ~(~change & _apart(fa, fb, least, most, end - begin, error))
        ray = at + simd.iota(simd.i32x16(0))
        zero = first * 0.0
        if simd.any_of(certain):
            steep = zero + min(abs(least), abs(most))
            held = _keep(room.brackets, room.bracket_ray, held, certain, begin, end, fa, fb, steep, zero, zero + error, ray)
        if simd.any_of(open_):
            opened = _keep(room.open, room.open_ray, opened, open_, begin, end, fa, fb, zero, zero, zero + error, ray)
    if opened > 0:
        held = _alone(room, memory, tape, opened, held, start, reach, slack, t, spacing, u, v)
    if held > 0:
        _finished(room, memory, tape, held, start, reach, t, spacing, u, v)


@helper
def _keep(rows: Any, rays: Any, count: int, mask: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, off: Any, ray: Any) -> int:
    """Write lanes of a mask behind the first `count`; how many there are then."""
    simd.compress_store(rows, count, a, mask)
    simd.compress_store(rows, _OPEN + count, b, mask)
    simd.compress_store(rows, 2 * _OPEN + count, c, mask)
    simd.compress_store(rows, 3 * _OPEN + count, d, mask)
    simd.compress_store(rows, 4 * _OPEN + count, e, mask)
    simd.compress_store(rows, 5 * _OPEN + count, f, mask)
    simd.compress_store(rows, 8 * _OPEN + count, off, mask)
    return count + simd.compress_store(rays, count, ray, mask)


@helper
def _apart(fa: Any, fb: Any, least: Any, most: Any, length: Any, error: float) -> Any:
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
        first, last = simd.load(room.rays, 6 * RAYS + at, VECTOR), simd.load(room.rays, 7 * RAYS + at, VECTOR)
        here = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
        here = simd.select(first < last, here, 0.0)
        for axis in range(3):
            o, d = simd.load(room.rays, axis * RAYS + at, VECTOR), simd.load(room.rays, (3 + axis) * RAYS + at, VECTOR)
            simd.store(room.registers, (axis * count + i) * VECTOR, simd.fma(d, here, o))
    _run(room, _POINTS, tape, count)
    out = room.tapes[tape, 2] * count
    for i in range(count):
        f = simd.load(room.registers, (out + i) * VECTOR, VECTOR)
        simd.store(room.values, to + i * VECTOR, f)
    for i in range(count):
        f = simd.load(room.values, to + i * VECTOR, VECTOR)
        at = room.list[i] * VECTOR
        first, last = simd.load(room.rays, 6 * RAYS + at, VECTOR), simd.load(room.rays, 7 * RAYS + at, VECTOR)
        near = ~(abs(f) > np.float32(room.slopes[3 * VECTOR + i])) & (first < b) & (last > a)
        near = near & simd.mask_from_bits(room.alive[room.list[i]], f)
        if simd.any_of(near):
            here = simd.minimum(simd.maximum(first * 0.0 + s, first), last)
            simd.store(room.values, to + i * VECTOR, _signed(room, memory, tape, at + simd.iota(simd.i32x16(0)), here, f, near))


@apart_
def _signed(room, memory, tape, ray, s, f, mask):
    """f, in the lanes of a mask with the sign that float64 gives at distances s of rays."""
    places, numbers, found = simd.stack_array(np.int32, 16), simd.stack_array(np.float32, 16), simd.stack_array(np.float32, 16)
    simd.store(places, 0, ray)
    simd.store(numbers, 0, s)
    simd.store(found, 0, f)
    bits = simd.bits(mask)
    for first in range(0, VECTOR, LANES):
        if (bits >> first) & ((1 << LANES) - 1) == 0:
            continue
        o, d = _exact(room, _rays(places, first))
        at = across.load_row(numbers, first)
        value = value_at(room, 0, _tapes(at, tape), memory, lanes.along(o, d, lanes.where(abs(at) < np.inf, at, 0.0)), at == at)
        size = lanes.maximum(abs(value), 1e-30)
        across.store_row(found, first, lanes.where(value <= 0.0, -size, size))
    return simd.select(mask, simd.load(found, 0, VECTOR), f)


@helper
def _tapes(like: Lane, tape: int) -> Lane:
    return lanes.int_like(like, tape)


@helper
def _rays(places: Any, first: int) -> Lane:
    return lanes.to_int(across.load_row(places, first))


@helper
def _exact(room: Any, ray: Lane) -> tuple[Vec, Vec]:
    """Starts and ways of rays in float64."""
    x = room.exact
    return (x[ray], x[RAYS + ray], x[2 * RAYS + ray]), (x[3 * RAYS + ray], x[4 * RAYS + ray], x[5 * RAYS + ray])


# --- rays by themselves -------------------------------------------------------------------------------------------------


@apart_
def _alone(room, memory, tape, opened, count, start, reach, slack, t, spacing, u, v):
    """Look for the first root in each open stretch; how many brackets there are then."""
    number = simd.iota(simd.i32x16(0))
    finest = FINEST * reach
    registers = room.registers
    for first in range(0, opened, VECTOR):
        working = number < opened - first
        ray = simd.select(working, simd.load(room.open_ray, first, VECTOR), room.open_ray[first])
        at = simd.select(working, simd.load(room.open, first, VECTOR), 0.0)
        end = simd.select(working, simd.load(room.open, _OPEN + first, VECTOR), 1.0)
        f = simd.load(room.open, 2 * _OPEN + first, VECTOR)
        ox, oy, oz = room.rays[ray], room.rays[RAYS + ray], room.rays[2 * RAYS + ray]
        dx, dy, dz = room.rays[3 * RAYS + ray], room.rays[4 * RAYS + ray], room.rays[5 * RAYS + ray]
        step = end - at
        given_up = working & ~working
        for _ in range(MOST_PIECES):
            to = simd.minimum(at + step, end)
            to = simd.select(end - to < 0.25 * step, end, to)
            for axis in range(3):
                o, d = (ox, dx) if axis == 0 else (oy, dy) if axis == 1 else (oz, dz)
                p, q = simd.fma(d, at, o), simd.fma(d, to, o)
                row = PARTS_OF_SPAN * axis
                simd.store(registers, row * VECTOR, simd.minimum(p, q) - slack)
                simd.store(registers, (row + 1) * VECTOR, simd.maximum(p, q) + slack)
                simd.store(registers, (row + 2) * VECTOR, d - 2.0 * U)
                simd.store(registers, (row + 3) * VECTOR, d + 2.0 * U)
                simd.store(registers, (row + 4) * VECTOR, d * 0.0 + slack)
            _known(room, PARTS_OF_SPAN, 1, simd.f32x16(-np.inf), simd.f32x16(np.inf))
            room.state[0] = 0
            _run(room, _SPANS, tape, 1)
            out = room.tapes[tape, 2] * PARTS_OF_SPAN * VECTOR
            low, high = simd.load(registers, out, VECTOR), simd.load(registers, out + VECTOR, VECTOR)
            least, most = simd.load(registers, out + 2 * VECTOR, VECTOR), simd.load(registers, out + 3 * VECTOR, VECTOR)
            error = _error(low, high, simd.load(registers, out + 4 * VECTOR, VECTOR))
            sure = ~simd.mask_from_bits(room.state[0], low)
            for axis in range(3):
                o, d = (ox, dx) if axis == 0 else (oy, dy) if axis == 1 else (oz, dz)
                simd.store(registers, axis * VECTOR, simd.fma(d, to, o))
            _run(room, _POINTS, tape, 1)
            far = simd.load(registers, room.tapes[tape, 2] * VECTOR, VECTOR)
            near = working & ~(sure & (abs(far) > error))
            if simd.any_of(near):
                far = _signed(room, memory, tape, ray, to, far, near)
            change = (f <= 0.0) ^ (far <= 0.0)
            one_way = sure & ((least > 0.0) | (most < 0.0))
            away = sure & ((low > 0.0) | (high < 0.0))
            none = ~change & (away | one_way | (sure & _apart(f, far, least, most, to - at, error)))
            certain = working & change & one_way
            if simd.any_of(certain):
                steep = simd.minimum(abs(least), abs(most))
                count = _keep(room.brackets, room.bracket_ray, count, certain, at, to, f, far, steep, steep * 0.0, error, ray)
                working = working & ~certain
            passed = working & none
            at, f = simd.select(passed, to, at), simd.select(passed, far, f)
            step = simd.select(passed, 2.0 * step, 0.25 * step)
            working = working & ~(passed & (at >= end))
            tiny = working & ~passed & (step < finest)
            given_up = given_up | tiny
            working = working & ~tiny
            if simd.none_of(working):
                break
        given_up = given_up | working
        left = simd.bits(given_up)
        while left != 0:
            j = simd.trailing_zeros(left)
            left &= left - 1
            _by_search(room, memory, tape, np.int64(simd.lane(ray, j)), simd.lane(at, j), simd.lane(end, j), start, t, spacing, u, v)
    return count


@apart_
def _by_search(room, memory, tape, ray, a, b, start, t, spacing, u, v):
    """Meet one ray between a and b in float64."""
    like = lanes.to_float(across.numbered(0)) * 0.0
    x = room.exact
    o, d = (x[ray], x[RAYS + ray], x[2 * RAYS + ray]), (x[3 * RAYS + ray], x[4 * RAYS + ray], x[5 * RAYS + ray])
    low, high = max(np.float64(a), x[6 * RAYS + ray]), min(np.float64(b), x[7 * RAYS + ray])
    root, inside, doubt = search.first(room, 0, tape, memory, o, d, low, high, start, room.places[0, 1] != 0, like)
    if doubt > 0:
        count_up(room.unproved, 0, 1)
    if root < np.inf:
        one = across.numbered(0) < 1
        rays, at = lanes.int_like(like, ray), like + root
        point = lanes.along(*_exact(room, rays), at)
        value, gx, gy, gz = turns_at(room, 0, _tapes(like, tape), memory, point, one)
        _met(room, rays, at, abs(value), (gx, gy, gz), lanes.bool_like(like, inside), one, start, t, spacing, u, v)


# --- from brackets to meetings ------------------------------------------------------------------------------------------


@apart_
def _finished(room, memory, tape, count, start, reach, t, spacing, u, v):
    """Bring the one root in each bracket to rounding, and write what is met."""
    rows, registers = room.brackets, room.registers
    many = (count + VECTOR - 1) // VECTOR
    for k in range(count, many * VECTOR):  # lanes beyond repeat the last bracket
        room.bracket_ray[k] = room.bracket_ray[count - 1]
        for row in range(9):
            rows[row * _OPEN + k] = rows[row * _OPEN + count - 1]
    for k in range(many):
        ray = simd.load(room.bracket_ray, k * VECTOR, VECTOR)
        for row in range(6):
            simd.store(room.packed, row * _OPEN + k * VECTOR, room.rays[row * RAYS + ray])
        for row in range(2):
            simd.store(rows, (6 + row) * _OPEN + k * VECTOR, simd.load(rows, (2 + row) * _OPEN + k * VECTOR, VECTOR))
            simd.store(rows, (9 + row) * _OPEN + k * VECTOR, simd.load(rows, row * _OPEN + k * VECTOR, VECTOR))
    enough = 8.0 * U * reach
    for turn in range(MOST_TURNS):
        working = False
        for k in range(many):
            s = _guess(rows, k * VECTOR, turn)
            for axis in range(3):
                o = simd.load(room.packed, axis * _OPEN + k * VECTOR, VECTOR)
                d = simd.load(room.packed, (3 + axis) * _OPEN + k * VECTOR, VECTOR)
                simd.store(registers, (axis * many + k) * VECTOR, simd.fma(d, s, o))
        _run(room, _POINTS, tape, many)
        out = room.tapes[tape, 2] * many
        for k in range(many):
            f = simd.load(registers, (out + k) * VECTOR, VECTOR)
            working = _narrowed(rows, k * VECTOR, turn, f, enough) or working
        if not working:
            break
    for first in range(0, count, LANES):
        _polished(room, memory, tape, first, count, start, reach, t, spacing, u, v)


@helper
def _guess(rows: Any, at: int, turn: int) -> Any:
    """Where the line through both ends of a bracket meets 0, or now and then its middle."""
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, _OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * _OPEN + at, VECTOR), simd.load(rows, 3 * _OPEN + at, VECTOR)
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
    a, b = simd.load(rows, at, VECTOR), simd.load(rows, _OPEN + at, VECTOR)
    fa, fb = simd.load(rows, 2 * _OPEN + at, VECTOR), simd.load(rows, 3 * _OPEN + at, VECTOR)
    side = simd.load(rows, 5 * _OPEN + at, VECTOR)
    done = (b - a <= enough) | (side == 2.0)
    there = ~done & ~(abs(f) > 2.0 * simd.load(rows, 8 * _OPEN + at, VECTOR))
    same = (f <= 0.0) == (fa <= 0.0)
    on_a, on_b = ~done & ~there & same, ~done & ~there & ~same
    fb = simd.select(on_a & (side > 0.0), 0.5 * fb, fb)
    fa = simd.select(on_b & (side < 0.0), 0.5 * fa, fa)
    simd.store(rows, at, simd.select(on_a | there, s, a))
    simd.store(rows, _OPEN + at, simd.select(on_b | there, s, b))
    simd.store(rows, 2 * _OPEN + at, simd.select(on_a, f, fa))
    simd.store(rows, 3 * _OPEN + at, simd.select(on_b, f, fb))
    side = simd.select(on_a, 1.0, simd.select(on_b, -1.0, side))
    simd.store(rows, 5 * _OPEN + at, simd.select(there, 2.0, side))
    was_a, was_b = simd.load(rows, 6 * _OPEN + at, VECTOR), simd.load(rows, 7 * _OPEN + at, VECTOR)
    slope = (was_b - was_a) / simd.select(b > a, b - a, 1.0)  # that of the last bracket
    simd.store(rows, 6 * _OPEN + at, simd.select(there, slope, simd.select(on_a, f, was_a)))
    simd.store(rows, 7 * _OPEN + at, simd.select(on_b, f, was_b))
    return simd.any_of(~done & ~there)


@apart_
def _polished(room, memory, tape, first, count, start, reach, t, spacing, u, v):
    """A step by the bracket's slope and one by the formula's, in float64; bracketing where these do not suffice."""
    rows = room.brackets
    ray = _rays(room.bracket_ray, first)
    mask = across.numbered(first) < count
    o, d = _exact(room, ray)
    a, b = across.load_row(rows, first), across.load_row(rows, _OPEN + first)
    fa, fb = across.load_row(rows, 6 * _OPEN + first), across.load_row(rows, 7 * _OPEN + first)
    steep, side = across.load_row(rows, 4 * _OPEN + first), across.load_row(rows, 5 * _OPEN + first)
    low, high = room.exact[6 * RAYS + ray], room.exact[7 * RAYS + ray]
    there = side == 2.0
    share = fa / (fa - fb)
    at = lanes.where(there, a, a + (b - a) * lanes.where((share >= 0.0) & (share <= 1.0), share, 0.5))
    slope = lanes.where(there, fa, (fb - fa) / lanes.where(b > a, b - a, 1.0))
    tapes = _tapes(at, tape)
    f = value_at(room, 0, tapes, memory, lanes.along(o, d, at), mask)
    slope = lanes.where(abs(slope) >= steep, slope, steep * lanes.sign_of(slope))
    step = -f / slope
    far = lanes.minimum(2.0 * abs(f) / steep, 1e-4 * reach)
    at = at + lanes.clip(step, -far, far)
    point = lanes.along(o, d, at)
    value, gx, gy, gz = turns_at(room, 0, tapes, memory, point, mask)
    slope = gx * d[0] + gy * d[1] + gz * d[2]
    step = -value / slope
    begin, end = across.load_row(rows, 9 * _OPEN + first), across.load_row(rows, 10 * _OPEN + first)
    good = (abs(slope) >= 0.99 * steep) & (abs(step) <= 1e-5 * reach) & (abs(at + step - 0.5 * (begin + end)) <= 0.5 * (end - begin) + far)
    if lanes.any_lane(mask & good & (abs(step) > 1e-7 * reach)):
        at = at + lanes.where(good, step, 0.0)
        value = value_at(room, 0, tapes, memory, lanes.along(o, d, at), mask)
        step = -value / slope
        good = good & (abs(step) <= 1e-9 * reach)
    at = at + lanes.where(good, step, 0.0)
    off = abs(value) * 1e-5 + 2.0**-28 * across.load_row(rows, 8 * _OPEN + first)
    bad = mask & lanes.not_(good)
    if lanes.any_lane(bad):
        f_begin = value_at(room, 0, tapes, memory, lanes.along(o, d, begin), bad)
        f_end = value_at(room, 0, tapes, memory, lanes.along(o, d, end), bad)
        root = bracketed(room, 0, tape + lanes.int_like(at, 0), memory, o, d, begin, end, f_begin, f_end, at * 0.0 + start, reach, bad)
        at = lanes.where(bad, root, at)
        value, gx, gy, gz = turns_at(room, 0, tapes, memory, lanes.along(o, d, at), mask)
        off = lanes.where(bad, abs(value), off)
    inside = slope > 0.0
    _met(room, ray, at, off, (gx, gy, gz), inside, mask & (at >= low) & (at <= high), start, t, spacing, u, v)


@helper
def _met(
    room: Any, ray: Lane, at: Lane, off: Lane, gradient: Vec, inside: Lane, mask: Lane, start: float, t: Any, spacing: Any, u: Any, v: Any
) -> None:
    """Write what rays have met, and let them rest."""
    way = _exact(room, ray)[1]
    units, first, second = dressed(room, 0, way, gradient, inside, off)
    size = room.exact[8 * RAYS + ray]
    distance = (start + at) / size
    left = across.bits(mask)
    while left != 0:
        j = simd.trailing_zeros(left)
        left &= left - 1
        one = np.int64(across.lane(ray, j))
        t[one], spacing[one] = across.lane(distance, j), across.lane(units, j)
        u[one], v[one] = across.lane(first, j), across.lane(second, j)
        room.alive[one // VECTOR] &= ~(1 << (one % VECTOR))
