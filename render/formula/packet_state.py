"""Rays of packets in float32 and the boxes around them, and tape evaluation on these."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..lanes.ray_soa import get
from ..types import Lane, Vec
from .evaluate import EvalBuffers, RayFunction, value_on
from .evaluator_calls import interpret, run_compiled_rows
from .interpreter import KNOWN, UNKNOWN
from .intersect import clip_to_bounds
from .interval_grid import CHOICE, TapeStore, simplify
from .llvm_math import LANES
from .op_codegen import WIDTHS
from .scene_surfaces import PROGRAMS
from .tables import FIRST_ROW, RESULT, ROW_COUNT

RAYS = 4096
SPACED = RAYS + 64  # between columns of rays: a power of two would map all columns to the same cache sets
VECTOR, GROUP, SLABS, QUARTERS = 16, 256, 8, 4  # with sixteen slabs a gyroid takes 30 % more time
PARTS_OF_SPAN = WIDTHS["spans32"]
POINTS, BOXES, SPANS = (PROGRAMS.index(name) for name in ("points32", "boxes32", "spans32"))
HULLS = RAYS // VECTOR  # of vectors; the hulls of groups follow them
STRIDE = HULLS + GROUP // VECTOR
ENTER, LEAVE, LENGTH = 6 * SPACED, 7 * SPACED, 8 * SPACED  # first elements of columns of rays, after three each of starts and directions
OPEN = GROUP + VECTOR
END, VALUE_AT_BEGIN, VALUE_AT_END, SLOPE, SIDE, FIRST_BEGIN, FIRST_END, ERROR = (row * OPEN for row in range(1, 9))
"""First elements of rows of brackets and open segments, after that of their begins."""
STEP = SLOPE  # of an open segment: length of its next piece
FINEST = 2.0**-17  # of the largest coordinate: shortest piece of a ray in float32
WIDEST = 8.0  # times the box's diagonal: longest interval in which rays of a packet may enter the box
LONG_TAPE = 40  # rows from which bounding the result first pays
MAX_PIECES = 400
SPEEDUP = 4  # compiled code of the whole tape runs as fast as the interpreter of a tape this many times shorter
ANY = -2  # instance number of any-hit queries: the distance of a ray that hits anything becomes −inf, and nothing else is written
U = 2.0**-24
UNIT_TOLERANCE = 2.0**-50  # of the squared length of a unit vector


@helper
def evaluate(packet: Any, program: int, tape: int, vectors: int) -> None:
    """Run a program on `vectors` vectors of inputs in the registers."""
    tapes = packet.tapes
    first, rows = tapes[tape, FIRST_ROW], tapes[tape, ROW_COUNT]
    interpret(packet.programs[program], packet.code, first, rows, packet.registers, packet.constants32, 0, packet.state, np.int64(vectors))


@helper
def evaluate_points(packet: Any, tape: int, vectors: int) -> None:
    """`evaluate` for POINTS, by compiled code if that is ready and the tape not much shorter; both give the same bits."""
    code = packet.compiled[0, 2]
    if code != 0 and len(packet.whole_tape) <= SPEEDUP * packet.tapes[tape, ROW_COUNT]:
        run_compiled_rows(code, packet.registers, packet.constants32, packet.tapes[tape, RESULT] * vectors * VECTOR, vectors)
    else:
        evaluate(packet, POINTS, tape, vectors)


@helper
def set_known_bounds(packet: Any, parts: int, vectors: int, low: Any, high: Any) -> None:
    """Set the known bounds of the result for a program whose values have `parts` parts."""
    for vector in range(vectors):
        unknown_row, known_row = UNKNOWN * parts * vectors + vector, KNOWN * parts * vectors + vector
        simd.store(packet.registers, unknown_row * VECTOR, simd.f32x16(-np.inf))
        simd.store(packet.registers, (unknown_row + vectors) * VECTOR, simd.f32x16(np.inf))
        simd.store(packet.registers, known_row * VECTOR, low)
        simd.store(packet.registers, (known_row + vectors) * VECTOR, high)


@helper
def simplify_for_lane(packet: Any, tape: int, lane: int) -> int:
    """Simplify a tape for a lane of the last bounds; the tape itself where it may be undefined or memory is full."""
    if (packet.state[0] >> lane) & 1 != 0:
        return tape
    simpler = simplify(TapeStore(packet.names, packet.code, packet.tapes, packet.ends), tape, packet.state, lane, packet.scratch)
    return simpler if simpler >= 0 else tape


@helper
def same_choices(packet: Any, tape: int, lane: int, other_lane: int) -> bool:
    """Whether two lanes of the last bounds need the same rows of a tape."""
    last = packet.tapes[tape, FIRST_ROW] + packet.tapes[tape, ROW_COUNT] - 1
    state = packet.state
    for word in range(1, 1 + 2 * (packet.code[last, 5] + CHOICE[packet.code[last, 0]])):
        if ((state[word] >> lane) ^ (state[word] >> other_lane)) & 1 != 0:
            return False
    return True


# --- rays ---------------------------------------------------------------------------------------------------------------


def ray_columns(origin: Any, direction: Any, t_min: Any, t_max: Any) -> NDArray[np.float64]:
    """Rays as columns (8, n or more): x, y, z of origins (n, 3) and of directions (n, 3), first and last distance."""
    n = len(origin)
    columns = np.zeros((8, -(-n // VECTOR) * VECTOR))
    columns[:3, :n], columns[3:6, :n], columns[6, :n], columns[7, :n] = np.transpose(origin), np.transpose(direction), t_min, t_max
    return columns


@noinline_helper
def begin_packet(packet, columns, column, n, inverse, hit_distances):
    """Set a packet's rays from n columns; `hit_distances` holds the distances of hits so far.

    Returns (distance at which the packet begins, length of the interval in which it may hit the box; −1 if no ray does).
    """
    exact, rays = packet.exact, packet.rays
    begin, end = _clip_rays(packet, columns, column, n, inverse, hit_distances)
    if not begin < end:
        return 0.0, -1.0
    for first in range(0, (n + VECTOR - 1) // VECTOR * VECTOR, LANES):
        enter = crosslane.load_row(exact, ENTER + first)
        if not ops.any_lane(enter < np.inf):
            crosslane.store_row(rays, ENTER + first, ops.full_like(enter, np.inf))
            crosslane.store_row(rays, LEAVE + first, ops.full_like(enter, -np.inf))
            continue
        for axis in range(3):
            direction = crosslane.load_row(exact, (3 + axis) * SPACED + first)
            start = crosslane.load_row(exact, axis * SPACED + first) + begin * direction
            crosslane.store_row(exact, axis * SPACED + first, start)
            crosslane.store_row(rays, axis * SPACED + first, start)
            crosslane.store_row(rays, (3 + axis) * SPACED + first, direction)
        enter, leave = enter - begin, crosslane.load_row(exact, LEAVE + first) - begin
        crosslane.store_row(exact, ENTER + first, enter)
        crosslane.store_row(exact, LEAVE + first, leave)
        crosslane.store_row(rays, ENTER + first, enter * (1.0 - 4.0 * U))
        crosslane.store_row(rays, LEAVE + first, leave * (1.0 + 4.0 * U))
    return begin, end - begin


@helper
def _clip_rays(packet: Any, columns: Any, column: int, n: int, inverse: Any, hit_distances: Any) -> tuple[float, float]:
    """Transform rays to the surface's frame and clip them to its box: (first distance in it, last)."""
    exact = packet.exact
    soonest = ops.full_like(ops.to_float(crosslane.lane_indices(0)), np.inf)
    latest = -soonest
    for first in range(0, (n + VECTOR - 1) // VECTOR * VECTOR, LANES):
        o, d, low, high = to_local(columns, column + first, inverse)
        mine = crosslane.lane_indices(first) < n
        if first + LANES <= n:
            high = ops.minimum(high, crosslane.load_row(hit_distances, column + first))
        else:
            high = ops.minimum(high, hit_distances[column + ops.minimum(crosslane.lane_indices(first), n - 1)])
        if not ops.any_lane(mine & (low < high) & _hits_ball(packet, o, d)):  # the divisions below are most of the cost here
            crosslane.store_row(exact, ENTER + first, ops.full_like(soonest, np.inf))
            crosslane.store_row(exact, LEAVE + first, ops.full_like(soonest, -np.inf))
            continue
        unit, size = _normalize(d)
        enter, leave = clip_to_bounds(packet, 0, o, unit, low * size, high * size)
        active = (enter < leave) & mine
        enter, leave = ops.where(active, enter, np.inf), ops.where(active, leave, -np.inf)
        soonest, latest = ops.minimum(soonest, enter), ops.maximum(latest, leave)
        for axis in range(3):
            crosslane.store_row(exact, axis * SPACED + first, o[0] if axis == 0 else o[1] if axis == 1 else o[2])
            crosslane.store_row(exact, (3 + axis) * SPACED + first, unit[0] if axis == 0 else unit[1] if axis == 1 else unit[2])
        crosslane.store_row(exact, ENTER + first, enter)
        crosslane.store_row(exact, LEAVE + first, leave)
        crosslane.store_row(exact, LENGTH + first, size)
    return crosslane.reduce_min(soonest), crosslane.reduce_max(latest)


@helper
def _normalize(d: Vec) -> tuple[Vec, Lane]:
    """(unit vectors, original lengths); vectors of unit length up to rounding, the usual case, stay unchanged."""
    square = ops.dot(d, d)
    size = ops.full_like(square, 1.0)
    other = abs(square - 1.0) > UNIT_TOLERANCE
    if ops.any_lane(other):
        length = ops.sqrt(square)
        size = ops.where(other & (length > 0.0), length, 1.0)
        d = ops.where3(other, ops.scale(d, 1.0 / size), d)
    return d, size


@helper
def _hits_ball(packet: Any, o: Vec, d: Vec) -> Lane:
    """Whether the lines of rays may hit the ball around the box, with a margin for rounding."""
    box = packet.numbers
    low, high = (box[0, 0], box[0, 1], box[0, 2]), (box[0, 3], box[0, 4], box[0, 5])
    edges = ops.sub(high, low)
    f = ops.sub(ops.scale(ops.add(low, high), 0.5), o)
    off = ops.cross(f, d)
    return ops.dot(off, off) <= ((0.25 + 1e-9) * ops.dot(edges, edges) + 1e-20 * ops.dot(f, f)) * ops.dot(d, d)


@helper
def to_local(columns: Any, column: int, matrix: Any) -> tuple[Vec, Vec, Lane, Lane]:
    """Rays from column `column` on, transformed by a (3, 4) matrix: (origins, directions, first and last distance)."""
    o, d, first, last = get(columns, column)
    x, y, z = _rotate(matrix, o)
    return (x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]), _rotate(matrix, d), first, last


@helper
def to_surface(columns: Any, rays: Lane, matrix: Any) -> Vec:
    """Origins of the rays in given columns, transformed by a (3, 4) matrix."""
    x, y, z = _rotate(matrix, (columns[0, rays], columns[1, rays], columns[2, rays]))
    return x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]


@helper
def _rotate(matrix: Any, p: Vec) -> Vec:
    return (
        matrix[0, 0] * p[0] + matrix[0, 1] * p[1] + matrix[0, 2] * p[2], matrix[1, 0] * p[0] + matrix[1, 1] * p[1] + matrix[1, 2] * p[2],
        matrix[2, 0] * p[0] + matrix[2, 1] * p[1] + matrix[2, 2] * p[2],
    )  # fmt: skip


@noinline_helper
def hull_vectors(packet, vectors):
    """Set the boxes around starts and directions of each vector's rays, and the alive rays."""
    for vector in range(vectors):
        first_ray = vector * VECTOR
        active = simd.load(packet.rays, ENTER + first_ray, VECTOR) < simd.load(packet.rays, LEAVE + first_ray, VECTOR)
        packet.alive[vector] = simd.bits(active)
        for ray in range(first_ray, first_ray + VECTOR):
            packet.spent[ray] = 0
        packet.carried_at[vector] = -1.0
        if packet.alive[vector] == 0:
            continue
        for part in range(2):
            for axis in range(3):
                x = simd.load(packet.rays, (3 * part + axis) * SPACED + first_ray, VECTOR)
                packet.hulls[(6 * part + axis) * STRIDE + vector] = simd.min_of(simd.select(active, x, np.inf))
                packet.hulls[(6 * part + 3 + axis) * STRIDE + vector] = simd.max_of(simd.select(active, x, -np.inf))


@helper
def hull_groups(packet: Any, groups: int) -> None:
    """Set the boxes around groups, behind those of vectors."""
    for row in range(12):
        high = row % 6 >= 3
        for group in range(groups):
            bound = -np.inf if high else np.inf
            for k in range(VECTOR):
                vector = group * VECTOR + k
                if packet.alive[vector] != 0:
                    x = np.float64(packet.hulls[row * STRIDE + vector])
                    bound = max(bound, x) if high else min(bound, x)
            packet.hulls[row * STRIDE + HULLS + group] = bound


@helper
def slab_inputs(packet: Any, groups_at: int, slab: float, slack: float) -> None:
    """Set the inputs of `boxes32` to the boxes around all rays in each slab."""
    number = simd.f32x16(simd.iota(simd.i32x16(0)))
    a, b = number * slab, (number + 1.0) * slab
    for axis in range(3):
        o_low = simd.min_of(_groups(packet, axis, groups_at, np.inf))
        o_high = simd.max_of(_groups(packet, 3 + axis, groups_at, -np.inf))
        d_low = simd.min_of(_groups(packet, 6 + axis, groups_at, np.inf))
        d_high = simd.max_of(_groups(packet, 9 + axis, groups_at, -np.inf))
        simd.store(packet.registers, (2 * axis) * VECTOR, o_low + simd.minimum(a * d_low, b * d_low) - slack)
        simd.store(packet.registers, (2 * axis + 1) * VECTOR, o_high + simd.maximum(a * d_high, b * d_high) + slack)


@helper
def _groups(packet: Any, row: int, first_hull: int, empty: float) -> Any:
    x = simd.load(packet.hulls, row * STRIDE + first_hull, VECTOR)
    return simd.select(simd.iota(simd.i32x16(0)) < packet.ends[2], x, empty)


@helper
def span_inputs(packet: Any, first_hull: int, begin: float, length: float, slack: float) -> None:
    """Set the inputs of `spans32` to the boxes around sixteen hulls from `first_hull` on in each quarter of a slab."""
    for quarter in range(QUARTERS):
        _span(packet, first_hull, begin + quarter * length, begin + (quarter + 1) * length, slack, quarter, QUARTERS)


@helper
def span_input(packet: Any, first_hull: int, begin: float, length: float, slack: float) -> None:
    """`span_inputs` for one interval."""
    _span(packet, first_hull, begin, begin + length, slack, 0, 1)


@helper
def _span(packet: Any, first_hull: int, a: float, b: float, slack: float, vector: int, vectors: int) -> None:
    for axis in range(3):
        low, high, d_low, d_high = _sweep(packet, first_hull, axis, a, b, slack)
        row = (PARTS_OF_SPAN * axis * vectors + vector) * VECTOR
        simd.store(packet.registers, row, low)
        simd.store(packet.registers, row + vectors * VECTOR, high)
        simd.store(packet.registers, row + 2 * vectors * VECTOR, d_low)
        simd.store(packet.registers, row + 3 * vectors * VECTOR, d_high)
        simd.store(packet.registers, row + 4 * vectors * VECTOR, d_high * 0.0 + slack)


@helper
def quarter_inputs(packet: Any, first_hull: int, begin: float, length: float, slack: float) -> None:
    """Set the inputs of `boxes32` to the boxes of `span_inputs`."""
    for quarter in range(QUARTERS):
        for axis in range(3):
            low, high, _, _ = _sweep(packet, first_hull, axis, begin + quarter * length, begin + (quarter + 1) * length, slack)
            row = (2 * axis * QUARTERS + quarter) * VECTOR
            simd.store(packet.registers, row, low)
            simd.store(packet.registers, row + QUARTERS * VECTOR, high)


@helper
def _sweep(packet: Any, first_hull: int, axis: int, a: float, b: float, slack: float) -> tuple[Any, Any, Any, Any]:
    """Bounds along an axis of sixteen hulls between the distances a and b, and of their directions."""
    o_low = simd.load(packet.hulls, axis * STRIDE + first_hull, VECTOR) - slack
    o_high = simd.load(packet.hulls, (3 + axis) * STRIDE + first_hull, VECTOR) + slack
    d_low = simd.load(packet.hulls, (6 + axis) * STRIDE + first_hull, VECTOR) - 2.0 * U
    d_high = simd.load(packet.hulls, (9 + axis) * STRIDE + first_hull, VECTOR) + 2.0 * U
    return o_low + simd.minimum(d_low * a, d_low * b), o_high + simd.maximum(d_high * a, d_high * b), d_low, d_high


# --- float64 ------------------------------------------------------------------------------------------------------------


@noinline_helper
def sign_in_float64(packet, memory, tape, ray, s, f, mask):
    """Replace values f, in the lanes of a mask, by values of the sign that float64 gives at distances s of rays."""
    places, numbers, signed = simd.stack_array(np.int32, 16), simd.stack_array(np.float32, 16), simd.stack_array(np.float32, 16)
    simd.store(places, 0, ray)
    simd.store(numbers, 0, s)
    simd.store(signed, 0, f)
    bits = simd.bits(mask)
    for first in range(0, VECTOR, LANES):
        if (bits >> first) & ((1 << LANES) - 1) == 0:
            continue
        function = ray_function(packet, memory, tape, load_numbers(places, first))
        distance = crosslane.load_row(numbers, first)
        value = value_on(function, ops.where(abs(distance) < np.inf, distance, 0.0), distance == distance)
        size = ops.maximum(abs(value), 1e-30)
        crosslane.store_row(signed, first, ops.where(value <= 0.0, -size, size))
    return simd.select(mask, simd.load(signed, 0, VECTOR), f)


@helper
def load_numbers(places: Any, first: int) -> Lane:
    """Load LANES ray numbers from element `first` on."""
    return ops.to_int(crosslane.load_row(places, first))


@helper
def ray_function(packet: Any, memory: EvalBuffers, tape: int, ray: Lane) -> RayFunction:
    """The surface along rays of a packet, by one tape, in float64."""
    x, first = packet.exact, crosslane.lane(ray, 0)
    if are_consecutive(ray):
        o = crosslane.load_row(x, first), crosslane.load_row(x, SPACED + first), crosslane.load_row(x, 2 * SPACED + first)
        d = crosslane.load_row(x, 3 * SPACED + first), crosslane.load_row(x, 4 * SPACED + first), crosslane.load_row(x, 5 * SPACED + first)
    else:
        o, d = (x[ray], x[SPACED + ray], x[2 * SPACED + ray]), (x[3 * SPACED + ray], x[4 * SPACED + ray], x[5 * SPACED + ray])
    return RayFunction(packet, 0, ops.int_like(ray, tape), memory, o, d)


@helper
def are_consecutive(ray: Lane) -> bool:
    """Whether ray numbers are consecutive, as for vectors of which all rays hit: loads are then several times as fast."""
    return ops.not_(ops.any_lane(ray != crosslane.lane_indices(crosslane.lane(ray, 0))))


@helper
def load_single(rays: Any, row: int, ray: Any) -> Any:
    """Load a row of PacketState.rays for a vector of sixteen ray numbers."""
    first = np.int64(simd.lane(ray, 0))
    if simd.none_of(ray != simd.lane(ray, 0) + simd.iota(simd.i32x16(0))):
        x = simd.load(rays, row * SPACED + first, VECTOR)
    else:
        x = rays[row * SPACED + ray]
    return x


@helper
def value_error(low: Any, high: Any, off: Any) -> Any:
    """Error of values between bounds, the rounding of the bounds included."""
    return off * 1.01 + 2.0 * U * (abs(low) + abs(high))
