"""What the bundles of tiles.py work with: a thread's memory, its rays in float32 and the boxes around them, and programs run on these."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..jit.kernel import noinline_helper as apart_
from ..lanes import crosslane, ops
from ..lanes.ray_soa import get
from ..simd.aligned_arrays import CACHE_LINE
from ..types import Lane, Vec
from .evaluate import value_at
from .evaluator_calls import compiled_rows, interpret
from .interpreter import KNOWN, PARTS, UNKNOWN
from .intersect import clipped
from .interval_grid import CHOICE, simplify
from .llvm_math import LANES, ROW, SINGLE
from .op_codegen import WIDTHS
from .scene_surfaces import PROGRAMS, Forms

RAYS = 4096
SPACED = RAYS + 64  # between columns of rays: a round number would have them all in the same few places of a cache
VECTOR, GROUP, SLABS, QUARTERS = 16, 256, 8, 4  # with sixteen slabs a gyroid takes three tenths more
PARTS_OF_SPAN = WIDTHS["spans32"]
POINTS, BOXES, SPANS = (PROGRAMS.index(name) for name in ("points32", "boxes32", "spans32"))
HULLS = RAYS // VECTOR  # of vectors; those of groups stand behind them
STRIDE = HULLS + GROUP // VECTOR
OPEN = GROUP + VECTOR
FINEST = 2.0**-17  # of the largest coordinate: pieces of a ray that float32 does not cut
WIDEST = 8.0  # times its diagonal, in which rays of a bundle may enter the box
LONG = 40  # rows of a tape for which it pays to ask for the result first
MOST_PIECES = 400
QUICKER = 4  # a formula's own code takes as long as the interpreter for this share of its rows
ANY = -2  # in place of an instance: where a ray meets anything its distance becomes −inf, and nothing else is asked or told
U = 2.0**-24
ROUNDED = 2.0**-50  # of the square of a length of 1


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
    hulls: NDArray[np.float32]  # (12, STRIDE) lowest x y z of starts, highest; of ways
    alive: NDArray[np.int32]  # bits of each vector's rays that have met nothing yet
    carried_at: NDArray[np.float32]  # where each vector's values are known
    carried: NDArray[np.float32]
    list: NDArray[np.int64]  # vectors that are looked at
    slopes: NDArray[np.float32]  # (4, …) their bounds: least, most; 1 where these have one sign; by how much values may be off
    values: NDArray[np.float32]  # (2, …) at both ends
    open: NDArray[np.float32]  # (9, …) stretches of single rays, as brackets
    open_ray: NDArray[np.int32]
    brackets: NDArray[np.float32]  # (9, …) ends, values there, least slope, side, first ends, how far off values are
    bracket_ray: NDArray[np.int32]
    packed: NDArray[np.float32]  # (6, …) rays
    kept: NDArray[np.int64]  # the state after bounds of slabs
    bounds: NDArray[np.float32]  # (10, 64) of groups in quarters, and of vectors in theirs: what `spans32` found
    results: NDArray[np.float32]  # (2, 16) what is known of the result in slabs
    inputs: NDArray[np.float32]  # what is put aside
    tape_of: NDArray[np.int64]  # groups' tapes in quarters, or -1
    spent: NDArray[np.int64]  # rounds of search.py that each ray has had, and tile_leaves.COUNTED once it is not proved


def room(forms: Forms, k: int) -> Room:
    """Room for surface k."""
    places = forms.places[k]
    first, rows = forms.tapes[places[4], :2].tolist()
    begin = int(places[3])
    wide = begin // (PARTS * LANES) * PARTS * SINGLE.lanes
    whole = forms.names[first : first + rows]
    choices = 1 + 2 * max(int(CHOICE[whole[:, 0]].sum()), 1)
    many = 24 * rows + 2048
    single, double, half, number = np.float32, np.float64, np.int32, np.int64
    here = np.zeros((1, 6), number)
    here[0, [1, 5]] = places[[1, 5]]
    memory: Any = _zeros((
        ((many, 4), half), ((many, ROW), half), ((512, 4), number), (3, number), (3 * rows + 8, number), (choices, number),
        ((KNOWN + 1) * PARTS_OF_SPAN * QUARTERS * VECTOR, single), (8 * SPACED, single), (9 * SPACED, double), (12 * STRIDE, single),
        (HULLS, half), (HULLS, single), (RAYS, single), (VECTOR, number), (4 * VECTOR, single), (2 * GROUP, single),
        (9 * OPEN, single), (OPEN, half), (9 * OPEN, single), (OPEN, half), (6 * OPEN, single), (choices, number),
        ((2 * PARTS_OF_SPAN, QUARTERS * VECTOR), single), (2 * VECTOR, single), (21 * QUARTERS * VECTOR, single),
        (QUARTERS * VECTOR, number), (RAYS, number),
    ))  # fmt: skip
    return Room(
        forms.programs, forms.constants[begin:], forms.constants32[wide:], forms.compiled[k : k + 1], forms.numbers[k : k + 1], here,
        forms.unproved, np.ascontiguousarray(whole), *memory,
    )  # fmt: skip


def _zeros(parts: Sequence[tuple[Any, Any]]) -> list[NDArray[Any]]:
    """Zeros of these shapes and types, one behind the other; each begins where a cache line does: vectors then never lie across two."""
    places, size = [], 0
    for shape, dtype in parts:
        places.append(size)
        size += -(-np.dtype(dtype).itemsize * (shape if isinstance(shape, int) else math.prod(shape)) // CACHE_LINE) * CACHE_LINE
    block = simd.aligned_empty(size, np.uint8)
    block[...] = 0
    return [np.ndarray(shape, dtype, block, place) for place, (shape, dtype) in zip(places, parts, strict=True)]


@helper
def evaluate(room: Any, program: int, tape: int, vectors: int) -> None:
    tapes = room.tapes
    first, rows = tapes[tape, 0], tapes[tape, 1]
    interpret(room.programs[program], room.code, first, rows, room.registers, room.constants32, 0, room.state, np.int64(vectors))


@helper
def evaluate_points(room: Any, tape: int, vectors: int) -> None:
    """`evaluate` for POINTS, by the formula's own code where that is ready and the tape not much simpler; the same bit for bit."""
    code = room.compiled[0, 2]
    if code != 0 and len(room.whole) <= QUICKER * room.tapes[tape, 1]:
        compiled_rows(code, room.registers, room.constants32, room.tapes[tape, 2] * vectors * VECTOR, vectors)
    else:
        evaluate(room, POINTS, tape, vectors)


@helper
def set_known_bounds(room: Any, parts: int, vectors: int, low: Any, high: Any) -> None:
    """Tell programs whose values have so many parts the bounds of the result."""
    for vector in range(vectors):
        unknown, known = UNKNOWN * parts * vectors + vector, KNOWN * parts * vectors + vector
        simd.store(room.registers, unknown * VECTOR, simd.f32x16(-np.inf))
        simd.store(room.registers, (unknown + vectors) * VECTOR, simd.f32x16(np.inf))
        simd.store(room.registers, known * VECTOR, low)
        simd.store(room.registers, (known + vectors) * VECTOR, high)


@helper
def simpler(room: Any, tape: int, lane: int) -> int:
    """The tape that a lane of the last bounds needs; the same where it may be undefined there, or there is no room."""
    if (room.state[0] >> lane) & 1 != 0:
        return tape
    found = simplify(room.names, room.code, room.tapes, room.ends, tape, room.state, lane, room.scratch)
    return found if found >= 0 else tape


@helper
def decides_alike(room: Any, tape: int, one: int, other: int) -> bool:
    """Whether two lanes of the last bounds need the same of a tape."""
    last = room.tapes[tape, 0] + room.tapes[tape, 1] - 1
    state = room.state
    for word in range(1, 1 + 2 * (room.code[last, 5] + CHOICE[room.code[last, 0]])):
        if ((state[word] >> one) ^ (state[word] >> other)) & 1 != 0:
            return False
    return True


# --- the rays -----------------------------------------------------------------------------------------------------------


def columns(origin: Any, direction: Any, t_min: Any, t_max: Any) -> NDArray[np.float64]:
    """(8, n or a few more) rays as `begun` reads them: x, y, z of origins (n, 3) and directions, first and last distance."""
    n = len(origin)
    made = np.zeros((8, -(-n // VECTOR) * VECTOR))
    made[:3, :n], made[3:6, :n], made[6, :n], made[7, :n] = np.transpose(origin), np.transpose(direction), t_min, t_max
    return made


@apart_
def begin_packet(room, columns, at, n, inverse, known):
    """(where the bundle begins, how long the stretch is in which it may meet the box; −1 if none does); sets the rays, up to what is
    `known` of them."""
    exact, rays = room.exact, room.rays
    padded = (n + VECTOR - 1) // VECTOR * VECTOR
    soonest = ops.full_like(ops.to_float(crosslane.lane_indices(0)), np.inf)
    latest = -soonest
    for first in range(0, padded, LANES):
        o, d, low, high = local(columns, at + first, inverse)
        mine = crosslane.lane_indices(first) < n
        if first + LANES <= n:
            high = ops.minimum(high, crosslane.load_row(known, at + first))
        else:
            high = ops.minimum(high, known[at + ops.minimum(crosslane.lane_indices(first), n - 1)])
        if not ops.any_lane(mine & (low < high) & _near(room, o, d)):  # dividing is most of what is done here
            crosslane.store_row(exact, 6 * SPACED + first, ops.full_like(soonest, np.inf))
            crosslane.store_row(exact, 7 * SPACED + first, ops.full_like(soonest, -np.inf))
            continue
        way, size = _of_unit_length(d)
        enter, leave = clipped(room, 0, o, way, low * size, high * size)
        active = (enter < leave) & mine
        enter, leave = ops.where(active, enter, np.inf), ops.where(active, leave, -np.inf)
        soonest, latest = ops.minimum(soonest, enter), ops.maximum(latest, leave)
        for axis in range(3):
            crosslane.store_row(exact, axis * SPACED + first, o[0] if axis == 0 else o[1] if axis == 1 else o[2])
            crosslane.store_row(exact, (3 + axis) * SPACED + first, way[0] if axis == 0 else way[1] if axis == 1 else way[2])
        crosslane.store_row(exact, 6 * SPACED + first, enter)
        crosslane.store_row(exact, 7 * SPACED + first, leave)
        crosslane.store_row(exact, 8 * SPACED + first, size)
    begin, end = crosslane.reduce_min(soonest), crosslane.reduce_max(latest)
    if not begin < end:
        return 0.0, -1.0
    for first in range(0, padded, LANES):
        if not ops.any_lane(crosslane.load_row(exact, 6 * SPACED + first) < np.inf):
            crosslane.store_row(rays, 6 * SPACED + first, ops.full_like(soonest, np.inf))
            crosslane.store_row(rays, 7 * SPACED + first, ops.full_like(soonest, -np.inf))
            continue
        for axis in range(3):
            way = crosslane.load_row(exact, (3 + axis) * SPACED + first)
            start = crosslane.load_row(exact, axis * SPACED + first) + begin * way
            crosslane.store_row(exact, axis * SPACED + first, start)
            crosslane.store_row(rays, axis * SPACED + first, start)
            crosslane.store_row(rays, (3 + axis) * SPACED + first, way)
        enter, leave = crosslane.load_row(exact, 6 * SPACED + first) - begin, crosslane.load_row(exact, 7 * SPACED + first) - begin
        crosslane.store_row(exact, 6 * SPACED + first, enter)
        crosslane.store_row(exact, 7 * SPACED + first, leave)
        crosslane.store_row(rays, 6 * SPACED + first, enter * (1.0 - 4.0 * U))
        crosslane.store_row(rays, 7 * SPACED + first, leave * (1.0 + 4.0 * U))
    return begin, end - begin


@helper
def _of_unit_length(d: Vec) -> tuple[Vec, Lane]:
    """(unit vectors, how long they were): those that are so but for rounding, as mostly, stay as they are."""
    square = ops.dot(d, d)
    size = ops.full_like(square, 1.0)
    other = abs(square - 1.0) > ROUNDED
    if ops.any_lane(other):
        length = ops.sqrt(square)
        size = ops.where(other & (length > 0.0), length, 1.0)
        d = ops.where3(other, ops.scale(d, 1.0 / size), d)
    return d, size


@helper
def _near(room: Any, o: Vec, d: Vec) -> Lane:
    """Whether the lines of rays may meet the ball around the box, with room for rounding."""
    low, high = (room.numbers[0, 0], room.numbers[0, 1], room.numbers[0, 2]), (room.numbers[0, 3], room.numbers[0, 4], room.numbers[0, 5])
    edges = ops.sub(high, low)
    f = ops.sub(ops.scale(ops.add(low, high), 0.5), o)
    off = ops.cross(f, d)
    return ops.dot(off, off) <= ((0.25 + 1e-9) * ops.dot(edges, edges) + 1e-20 * ops.dot(f, f)) * ops.dot(d, d)


@helper
def local(columns: Any, at: int, matrix: Any) -> tuple[Vec, Vec, Lane, Lane]:
    """Origins and directions of rays `at` on in a frame to which a (3, 4) matrix leads, and their first and last distance."""
    o, d, first, last = get(columns, at)
    x, y, z = _turned(matrix, o)
    return (x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]), _turned(matrix, d), first, last


@helper
def own_origin(columns: Any, rays: Lane, matrix: Any) -> Vec:
    """Where rays begin, as `local` has it."""
    x, y, z = _turned(matrix, (columns[0, rays], columns[1, rays], columns[2, rays]))
    return x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]


@helper
def _turned(matrix: Any, p: Vec) -> Vec:
    return (
        matrix[0, 0] * p[0] + matrix[0, 1] * p[1] + matrix[0, 2] * p[2], matrix[1, 0] * p[0] + matrix[1, 1] * p[1] + matrix[1, 2] * p[2],
        matrix[2, 0] * p[0] + matrix[2, 1] * p[1] + matrix[2, 2] * p[2],
    )  # fmt: skip


@apart_
def hulled(room, vectors):
    """Boxes around the starts and ways of each vector's rays; which rays are alive."""
    for vector in range(vectors):
        at = vector * VECTOR
        there = simd.load(room.rays, 6 * SPACED + at, VECTOR) < simd.load(room.rays, 7 * SPACED + at, VECTOR)
        room.alive[vector] = simd.bits(there)
        for ray in range(at, at + VECTOR):
            room.spent[ray] = 0
        room.carried_at[vector] = -1.0
        if room.alive[vector] == 0:
            continue
        for part in range(2):
            for axis in range(3):
                x = simd.load(room.rays, (3 * part + axis) * SPACED + at, VECTOR)
                room.hulls[(6 * part + axis) * STRIDE + vector] = simd.min_of(simd.select(there, x, np.inf))
                room.hulls[(6 * part + 3 + axis) * STRIDE + vector] = simd.max_of(simd.select(there, x, -np.inf))


@helper
def around(room: Any, groups: int) -> None:
    """Boxes around groups, which stand behind those of vectors; then, in all lanes of the inputs' first place, around all."""
    for row in range(12):
        high = row % 6 >= 3
        for group in range(groups):
            found = -np.inf if high else np.inf
            for k in range(VECTOR):
                vector = group * VECTOR + k
                if room.alive[vector] != 0:
                    x = np.float64(room.hulls[row * STRIDE + vector])
                    found = max(found, x) if high else min(found, x)
            room.hulls[row * STRIDE + HULLS + group] = found


@helper
def box_inputs(room: Any, groups_at: int, slab: float, slack: float) -> None:
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
    x = simd.load(room.hulls, row * STRIDE + at, VECTOR)
    return simd.select(simd.iota(simd.i32x16(0)) < room.ends[2], x, empty)


@helper
def span_inputs(room: Any, at: int, begin: float, length: float, slack: float) -> None:
    """The boxes around sixteen hulls from `at` on, in each quarter of a slab, as inputs of `spans32`."""
    for quarter in range(QUARTERS):
        _span(room, at, begin + quarter * length, begin + (quarter + 1) * length, slack, quarter, QUARTERS)


@helper
def span_input(room: Any, at: int, begin: float, length: float, slack: float) -> None:
    """The same in one stretch."""
    _span(room, at, begin, begin + length, slack, 0, 1)


@helper
def _span(room: Any, at: int, a: float, b: float, slack: float, vector: int, vectors: int) -> None:
    for axis in range(3):
        low, high, d_low, d_high = _swept(room, at, axis, a, b, slack)
        row = (PARTS_OF_SPAN * axis * vectors + vector) * VECTOR
        simd.store(room.registers, row, low)
        simd.store(room.registers, row + vectors * VECTOR, high)
        simd.store(room.registers, row + 2 * vectors * VECTOR, d_low)
        simd.store(room.registers, row + 3 * vectors * VECTOR, d_high)
        simd.store(room.registers, row + 4 * vectors * VECTOR, d_high * 0.0 + slack)


@helper
def quarter_inputs(room: Any, at: int, begin: float, length: float, slack: float) -> None:
    """The boxes of `span_inputs` as inputs of `boxes32`."""
    for quarter in range(QUARTERS):
        for axis in range(3):
            low, high, _, _ = _swept(room, at, axis, begin + quarter * length, begin + (quarter + 1) * length, slack)
            row = (2 * axis * QUARTERS + quarter) * VECTOR
            simd.store(room.registers, row, low)
            simd.store(room.registers, row + QUARTERS * VECTOR, high)


@helper
def _swept(room: Any, at: int, axis: int, a: float, b: float, slack: float) -> tuple[Any, Any, Any, Any]:
    """Along an axis, the box of each of sixteen hulls between a and b, and of their ways."""
    o_low = simd.load(room.hulls, axis * STRIDE + at, VECTOR) - slack
    o_high = simd.load(room.hulls, (3 + axis) * STRIDE + at, VECTOR) + slack
    d_low = simd.load(room.hulls, (6 + axis) * STRIDE + at, VECTOR) - 2.0 * U
    d_high = simd.load(room.hulls, (9 + axis) * STRIDE + at, VECTOR) + 2.0 * U
    return o_low + simd.minimum(d_low * a, d_low * b), o_high + simd.maximum(d_high * a, d_high * b), d_low, d_high


# --- in float64, and how far float32 is from it ----------------------------------------------------------------------------


@apart_
def signed(room, memory, tape, ray, s, f, mask):
    """f, in the lanes of a mask with the sign that float64 gives at distances s of rays."""
    places, numbers, found = simd.stack_array(np.int32, 16), simd.stack_array(np.float32, 16), simd.stack_array(np.float32, 16)
    simd.store(places, 0, ray)
    simd.store(numbers, 0, s)
    simd.store(found, 0, f)
    bits = simd.bits(mask)
    for first in range(0, VECTOR, LANES):
        if (bits >> first) & ((1 << LANES) - 1) == 0:
            continue
        o, d = exact(room, numbers_of(places, first))
        at = crosslane.load_row(numbers, first)
        value = value_at(room, 0, tapes_of(at, tape), memory, ops.along(o, d, ops.where(abs(at) < np.inf, at, 0.0)), at == at)
        size = ops.maximum(abs(value), 1e-30)
        crosslane.store_row(found, first, ops.where(value <= 0.0, -size, size))
    return simd.select(mask, simd.load(found, 0, VECTOR), f)


@helper
def tapes_of(like: Lane, tape: int) -> Lane:
    return ops.int_like(like, tape)


@helper
def numbers_of(places: Any, first: int) -> Lane:
    return ops.to_int(crosslane.load_row(places, first))


@helper
def exact(room: Any, ray: Lane) -> tuple[Vec, Vec]:
    """Starts and ways of rays in float64."""
    x, first = room.exact, crosslane.lane(ray, 0)
    if in_a_row(ray):
        o = crosslane.load_row(x, first), crosslane.load_row(x, SPACED + first), crosslane.load_row(x, 2 * SPACED + first)
        d = crosslane.load_row(x, 3 * SPACED + first), crosslane.load_row(x, 4 * SPACED + first), crosslane.load_row(x, 5 * SPACED + first)
    else:
        o, d = (x[ray], x[SPACED + ray], x[2 * SPACED + ray]), (x[3 * SPACED + ray], x[4 * SPACED + ray], x[5 * SPACED + ray])
    return o, d


@helper
def in_a_row(ray: Lane) -> bool:
    """Whether rays stand one behind the other, as those of a vector that meet something together: these are read several times as fast."""
    return ops.not_(ops.any_lane(ray != crosslane.lane_indices(crosslane.lane(ray, 0))))


@helper
def single(rays: Any, row: int, ray: Any) -> Any:
    """A row of Room.rays for the rays of a vector of sixteen."""
    first = np.int64(simd.lane(ray, 0))
    if simd.none_of(ray != simd.lane(ray, 0) + simd.iota(simd.i32x16(0))):
        found = simd.load(rays, row * SPACED + first, VECTOR)
    else:
        found = rays[row * SPACED + ray]
    return found


@helper
def error_of(low: Any, high: Any, off: Any) -> Any:
    """By how much values between bounds may be off, with their own rounding."""
    return off * 1.01 + 2.0 * U * (abs(low) + abs(high))
