"""Root isolation: the first root in an undecided segment of one ray, by interval bisection.

The lanes of a vector bound as many pieces of the segment at once, by intervals of the value and of the slope along the ray. From the near
end on, each piece is proved to hold no root or one, or is subdivided next (Mitchell, "Robust Ray Intersection with Interval Arithmetic",
Graphics Interface 1990; Knoll et al., "Fast Ray Tracing of Arbitrary Implicit Surfaces with Interval and Affine Arithmetic", Computer
Graphics Forum 2009). Where the formula jumps, the lanes bound all branches of its jumps; see interval_arithmetic.one_side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .bracketing import LARGEST, SegmentBounds, excludes_root
from .discontinuities import JUMPS
from .evaluate import Bounds, RayFunction, bounds_at, value_on
from .evaluator_calls import interpret
from .llvm_math import BRANCH_WORD, LANES
from .scene_surfaces import PROGRAMS
from .tables import DISCONTINUITY, FIRST_CONSTANT, FIRST_ROW, LARGEST_COORDINATE, RESULT, ROW_COUNT

_FORKS = PROGRAMS.index("forks")

BRANCHES = 8  # of up to three jumps
FINEST = 2.0**-44  # of the largest coordinate: length of the shortest pieces
MAX_ROUNDS, MIN_ROUNDS = 3000, 40  # of bounding pieces on one ray; on a segment of a ray that has spent these
SAMPLES = 64  # vectors of points that sample a segment whose bounds stay undecided
JUMP = 1e90  # slope bounds beyond this mean that the formula may jump
NEIGHBOURS = 64.0  # times FINEST: distance from a root within which it may leave bounds undecided
GAP = 4.0  # times FINEST: in a solid, a ray does not leave through an undecided gap no longer than this
_TOLERANCE = 2.0**-50
_OVERRUN = 2.0**-40  # of the largest coordinate: search beyond the segment's end; tapes of cells hold that far
_PARTS = max(LANES, 2)  # pieces of an undecided piece
_COARSER = 0.25  # of a segment that is undecided at every size: pieces in it do not get smaller
_BRANCHES = tuple(np.arange(float(BRANCHES), 2.0 * BRANCHES).view(np.int64).tolist())
"""Inputs of VectorMath.fork: a leading one, then the binary digits of the branch number."""


class _Search(NamedTuple):
    """What stays constant while one ray is searched."""

    ray: RayFunction  # of scalars
    lanes: RayFunction  # the same ray in all lanes
    sheet: bool
    reach: float  # largest coordinate
    finest: float  # length of the shortest pieces
    begin: float  # of the segment
    zero: Lane


class _Front(NamedTuple):
    """The end of the part of a ray that is searched."""

    distance: float
    value: float  # there
    piece: float  # length of the next pieces
    open_from: float  # begin of the undecided part before it, or -1
    exempt_until: float  # undecided parts, and gaps, that end before this distance need no proof
    doubt: Any  # int64: 1 once an undecided part had no root


class _Piece(NamedTuple):
    """The first undecided piece."""

    low: float
    high: float
    within: bool  # the ray is inside at its begin
    changes: bool  # of the sign
    jumps: bool  # the formula may jump
    far: float  # value at its end


@noinline_helper
def isolate_first_root(ray, a, b, ray_begin, begin, sheet, like, most):
    """(distance or inf, whether the ray is inside before it, 1 where unproved, rounds used) of the first root of one ray in a … b.

    The ray begins at the distance `ray_begin`, its start lies `begin` from its origin, and `most` limits the rounds. A shortest piece is
    a hit if the sign changes in it, on a sheet only if the formula does not jump. Without a change of sign it is skipped and counts as
    unproved. Exceptions are pieces next to a root, at the begin of the ray (the surface that it leaves), and at a gap in a solid, such as
    a face that two parts share.
    """
    s = _search(ray, a, begin, sheet, like)
    over = min(16.0 * s.finest, _OVERRUN * ray.forms.numbers[ray.k, LARGEST_COORDINATE])
    front = _Front(a, _value(s, a), (b - a) / LANES, -1.0, ray_begin + NEIGHBOURS * s.finest, np.int64(0))
    used = 0
    while used < most:
        used += 1
        if not front.distance < b:
            if front.open_from < 0.0 or over == 0.0:
                return np.inf, False, _close(front, front.distance).doubt, used
            b, over = b + over, 0.0
        x = _bound_pieces(s, front.distance, max(front.piece, 0.5 * s.finest), b, front.value)
        if x.open & 1 == 0:
            front = _close(front, front.distance)
        if x.open == 0:
            searched_to = front.distance + LANES * x.length
            front = _move(front, searched_to, crosslane.lane(x.far, LANES - 1), min(4.0 * x.length, (b - searched_to) / LANES))
            continue
        j = simd.trailing_zeros(x.open)
        piece = _piece(x, j)
        if piece.changes and ((crosslane.bits(x.monotonic) >> j) & 1) != 0:
            root = _narrow(s, piece.low, piece.high, piece.within)
            return root, piece.within, _doubt_before(front, root, s.finest), used
        check_branches = (piece.jumps or ((crosslane.bits(x.bounds.maybe) >> j) & 1) != 0) and (sheet or not piece.changes)
        if check_branches and _branches_exclude_root(s, crosslane.lane3(x.p, j), crosslane.lane3(x.q, j), piece.within):
            front = _move(_close(front, piece.low), piece.high, piece.far, piece.high - piece.low)
            continue
        smallest = s.finest if piece.changes or front.open_from < 0.0 else max(s.finest, _COARSER * (piece.low - front.open_from))
        if piece.high - piece.low > smallest:
            front = _move(front, piece.low, crosslane.lane(x.near, j), (piece.high - piece.low) / _PARTS)
        elif piece.changes and not (sheet and piece.jumps):
            crosses, after = _crosses(s, piece)
            if crosses:
                root = 0.5 * (piece.low + piece.high)
                return root, piece.within, _doubt_before(front, root, s.finest), used
            # a gap at a single point, as where the formula is undefined
            front = _move(front, piece.high + s.finest, after, max(x.length, s.finest))
        else:
            front = _skip(s, front, piece, x.length)
    root, within = _sample(s, front.distance, b, front.value)
    return root, within, 1, used


@helper
def _search(ray: RayFunction, a: float, begin: float, sheet: bool, like: Lane) -> _Search:
    start, direction = ray.start, ray.direction
    o = ops.like3(like, start[0], start[1], start[2])
    d = ops.like3(like, direction[0], direction[1], direction[2])
    reach = ray.forms.numbers[ray.k, LARGEST_COORDINATE] + begin
    lanes = RayFunction(ray.forms, ray.k, ops.int_like(like, ray.tape), ray.memory, o, d)
    return _Search(ray, lanes, sheet, reach, FINEST * reach, a, like)


@helper
def _value(s: _Search, distance: float) -> float:
    """Value at one distance."""
    zero = 0.0 * s.lanes.start[0]
    return crosslane.lane(value_on(s.lanes, zero + distance, ops.bool_like(zero, True)), 0)


@helper
def _move(front: _Front, distance: float, value: float, piece: float) -> _Front:
    return _Front(distance, value, piece, front.open_from, front.exempt_until, front.doubt)


@helper
def _close(front: _Front, distance: float) -> _Front:
    """End the undecided part at a distance, where it had no root."""
    doubt = np.int64(1) if front.open_from >= 0.0 and distance > front.exempt_until else front.doubt
    return _Front(front.distance, front.value, front.piece, -1.0, front.exempt_until, doubt)


@helper
def _doubt_before(front: _Front, root: float, finest: float) -> Any:
    """1 if the undecided part before a root is more than its neighbourhood, or an earlier one was unproved."""
    return np.int64(1) if front.open_from >= 0.0 and root - front.open_from > NEIGHBOURS * finest else front.doubt


@helper
def _crosses(s: _Search, piece: _Piece) -> tuple[bool, float]:
    """(whether a ray crosses the surface in the shortest piece, the value behind it)."""
    after = _value(s, piece.high + s.finest)
    before = piece.within  # as tracked along the ray: near grazing, rounding changes the sign again and again
    if piece.low <= s.begin + s.finest:  # the segment may begin at a single point
        before = _value(s, piece.low - s.finest) <= 0.0
    return before != (after <= 0.0), after


@helper
def _skip(s: _Search, front: _Front, piece: _Piece, length: float) -> _Front:
    """Move behind a shortest piece that stays undecided."""
    exempt_until, open_from = front.exempt_until, front.open_from
    if piece.jumps and not s.sheet and s.ray.forms.places[s.ray.k, DISCONTINUITY] == JUMPS:  # too thin for an inside
        exempt_until = max(exempt_until, piece.high + NEIGHBOURS * s.finest)
        open_from = -1.0 if piece.low - open_from <= NEIGHBOURS * s.finest else open_from
    elif open_from < 0.0:
        open_from, exempt_until = piece.low, max(exempt_until, piece.low + GAP * s.finest if piece.within and not s.sheet else 0.0)
    length = max(length, _COARSER * (piece.high - open_from)) if open_from >= 0.0 else s.finest
    return _Front(piece.high, piece.far, length, open_from, exempt_until, front.doubt)


class _Pieces(NamedTuple):
    """Pieces of a segment, one a lane."""

    length: float
    begins: Lane
    ends: Lane
    p: Vec
    q: Vec
    near: Lane
    far: Lane
    bounds: Bounds
    change: Lane  # mask: of the sign
    monotonic: Lane  # mask: the slope has one sign
    open: int  # bits: undecided pieces


@helper
def _bound_pieces(s: _Search, distance: float, length: float, b: float, value: float) -> _Pieces:
    """Bound the pieces of a length from `distance` on, where the formula has a `value`, up to b."""
    number = ops.to_float(crosslane.lane_indices(0))
    begins, ends = distance + number * length, ops.minimum(distance + (number + 1.0) * length, 0.0 * number + b)
    p, q = ops.along(s.lanes.start, s.lanes.direction, begins), ops.along(s.lanes.start, s.lanes.direction, ends)
    bounds = bounds_at(s.ray.forms, s.ray.k, s.ray.tape, s.ray.memory, p, q, s.lanes.direction)
    far = value_on(s.lanes, ends, ops.bool_like(number, True))
    near = _shift_lanes(far, value)
    in_near, in_far = near <= 0.0, far <= 0.0
    change = (in_near & ops.not_(in_far)) | (in_far & ops.not_(in_near))
    finite = (abs(bounds.low) < LARGEST) & (abs(bounds.high) < LARGEST) & (abs(bounds.least) < LARGEST) & (abs(bounds.most) < LARGEST)
    monotonic = ((bounds.least > 0.0) | (bounds.most < 0.0)) & finite & ops.not_(bounds.maybe)
    away = ops.not_(bounds.low <= 0.0) | ((bounds.high < 0.0) & ops.not_(bounds.maybe))
    above = excludes_root(SegmentBounds(near, far, bounds.least, bounds.most), ends - begins) & ops.not_(bounds.maybe)
    none = ops.not_(change) & (away | monotonic | above)
    open_ = crosslane.bits((begins < b) & ops.not_(none))
    return _Pieces(length, begins, ends, p, q, near, far, bounds, change, monotonic, open_)


@helper
def _piece(x: _Pieces, j: int) -> _Piece:
    jumps = not (crosslane.lane(x.bounds.least, j) > -JUMP and crosslane.lane(x.bounds.most, j) < JUMP)
    changes = ((crosslane.bits(x.change) >> j) & 1) != 0
    within = crosslane.lane(x.near, j) <= 0.0
    return _Piece(crosslane.lane(x.begins, j), crosslane.lane(x.ends, j), within, changes, jumps, crosslane.lane(x.far, j))


@noinline_helper
def _branches_exclude_root(s, p, q, within):
    """Whether the box p … q in which the formula jumps has no root: all branches have one sign, in a solid that of the begin."""
    forms, k, tape, registers = s.ray.forms, s.ray.k, s.ray.tape, s.ray.memory.registers
    state = s.ray.memory.state
    begin, rows, out = forms.tapes[tape, FIRST_ROW], forms.tapes[tape, ROW_COUNT], 2 * forms.tapes[tape, RESULT]
    for first_branch in range(0, BRANCHES, LANES):
        for axis in range(3):
            a, b = (p[0], q[0]) if axis == 0 else (p[1], q[1]) if axis == 1 else (p[2], q[2])
            crosslane.store(registers, 2 * axis, s.zero + min(a, b))
            crosslane.store(registers, 2 * axis + 1, s.zero + max(a, b))
        simd.write(state, 0, 0)
        for j in range(LANES):
            simd.write(state, BRANCH_WORD + j, _BRANCHES[first_branch + j])
        interpret(forms.programs[_FORKS], forms.code, begin, rows, registers, forms.constants, forms.places[k, FIRST_CONSTANT], state, 1)
        if simd.read(state, 0) != 0:
            return False
        outside, inside = ops.not_(crosslane.load(registers, out) <= 0.0), crosslane.load(registers, out + 1) < 0.0
        excluded = outside | inside if s.sheet else inside if within else outside
        if ops.any_lane(ops.not_(excluded)):
            return False
    return True


@noinline_helper
def _sample(s, a, b, value):
    """(distance or inf, whether the ray is inside before it) of the first root between neighbouring samples of a … b."""
    number = ops.to_float(crosslane.lane_indices(0))
    everywhere = ops.bool_like(number, True)
    step = (b - a) / (SAMPLES * LANES)
    for turn in range(SAMPLES):
        places = a + (turn * LANES + number + 1.0) * step
        far = value_on(s.lanes, places, everywhere)
        near = _shift_lanes(far, value)
        changes = crosslane.bits(((near <= 0.0) & ops.not_(far <= 0.0)) | ((far <= 0.0) & ops.not_(near <= 0.0)))
        while changes != 0:
            j = simd.trailing_zeros(changes)
            changes &= changes - 1
            high, within = crosslane.lane(places, j), crosslane.lane(near, j) <= 0.0
            root = _narrow(s, high - step, high, within)
            if not s.sheet:
                return root, within
            if abs(_value(s, root)) <= 1e-3 * (abs(crosslane.lane(near, j)) + abs(crosslane.lane(far, j))):
                return root, within
        value = crosslane.lane(far, LANES - 1)
    return np.inf, False


@helper
def _shift_lanes(x: Lane, before: float) -> Lane:
    """Move each lane up by one; lane 0 gets `before`."""
    memory = simd.stack_array(np.float64, _SHIFT)
    simd.write(memory, 0, before)
    crosslane.store_row(memory, 1, x)
    return crosslane.load(memory, 0)


_SHIFT = LANES + 1


@helper
def _narrow(s: _Search, low: float, high: float, within: bool) -> float:
    """Narrow a bracket to its one root, by as many points in it as there are lanes, again and again."""
    number = ops.to_float(crosslane.lane_indices(0))
    everywhere = ops.bool_like(number, True)
    while high - low > _TOLERANCE * (s.reach + high):
        step = (high - low) / (LANES + 1)
        places = low + (number + 1.0) * step
        f = value_on(s.lanes, places, everywhere)
        same = (f <= 0.0) if within else ops.not_(f <= 0.0)
        over = crosslane.bits(ops.not_(same))
        if over == 0:
            low = crosslane.lane(places, LANES - 1)
        else:
            j = simd.trailing_zeros(over)
            high = crosslane.lane(places, j)
            if j > 0:
                low = crosslane.lane(places, j - 1)
        if not step > 0.25 * _TOLERANCE * s.reach:
            break
    return 0.5 * (low + high)
