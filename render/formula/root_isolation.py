"""The first root in a stretch of one ray that bounds over a whole cell could not decide: pieces of it side by side, smaller where need be.

As many pieces as there are lanes are bounded at once, by intervals of the value and of the slope along the ray. From the near end on,
each is known to hold no root, or one, or is cut up next (Mitchell, "Robust Ray Intersection with Interval Arithmetic", Graphics
Interface 1990; Knoll and others, "Fast Ray Tracing of Arbitrary Implicit Surfaces with Interval and Affine Arithmetic", Computer
Graphics Forum 2009). Where the formula jumps, all ways past its jumps are bounded side by side; see enclosures.one_side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..jit.kernel import noinline_helper as apart_
from ..lanes import crosslane, ops
from ..types import Lane, Vec
from .discontinuities import JUMPS
from .evaluate import Bounds, Room, bounds_at, value_at
from .evaluator_calls import interpret
from .llvm_math import LANES, WAYS
from .scene_surfaces import PROGRAMS

_FORKS = PROGRAMS.index("forks")

WAYS_PAST = 8  # up to three jumps
FINEST = 2.0**-44  # of the largest coordinate: shorter pieces are not told apart
MOST_ROUNDS, FEW = 3000, 40  # of pieces on one ray; on a stretch of a ray that has had as many
SAMPLES = 64  # vectors of points by which a stretch is looked at that bounds say too little of
JUMP = 1e90  # bounds of a slope beyond this: the formula may jump there
NEAR = 1e-6  # of both ends' values: a bound above this share of them is above rounding, too
LARGEST = 1e290  # of values: bounds tell larger ones not apart, and say nothing of their slopes
_ENOUGH = 2.0**-50
NEIGHBOURS = 64.0  # times FINEST: so far from a root bounds may be open because of it
GAP = 4.0  # times FINEST: what is open no longer than that, in a solid, is no place where a ray leaves it
_OVER = 2.0**-40  # of the largest coordinate, by which a stretch is looked at beyond its end; cells.py has tapes hold so far
_PARTS = max(LANES, 2)  # that an open piece is cut into
_COARSER = 0.25  # of a stretch that is open at every size: pieces in it are not cut smaller
_WAYS = tuple(np.arange(float(WAYS_PAST), 2.0 * WAYS_PAST).view(np.int64).tolist())
"""What VectorMath.fork reads: a one, then the binary digits of the way's number."""


@apart_
def isolate_first_root(forms, k, tape, memory, start, way, a, b, own, begin, sheet, like, most):
    """(distance or inf, whether the ray is inside before it, 1 where not all is proved, rounds that it took) of the first root in a … b
    of a ray that begins at `own`.

    What is bracketed within FINEST counts as met where the sign changes, of a sheet only where the formula does not jump; where no sign
    changes, it is left out and not proved, unless a root is next to it, or the ray begins there: at the surface that it leaves, or it is
    no more than a gap in a solid, as where parts of one share a face.
    """
    number = ops.to_float(crosslane.lane_indices(0))
    o = ops.like3(like, start[0], start[1], start[2])
    d = ops.like3(like, way[0], way[1], way[2])
    reach = forms.numbers[k, 13] + begin
    finest = FINEST * reach
    tapes = ops.int_like(like, tape)
    piece, over = (b - a) / LANES, min(16.0 * finest, _OVER * forms.numbers[k, 13])
    at, doubt, open_from, used = a, 0, -1.0, 0
    known = own + NEIGHBOURS * finest  # what is open up to here need not be proved, nor a gap
    value = _one_value(forms, k, tapes, memory, o, d, at)
    while used < most:
        used += 1
        if not at < b:
            if open_from < 0.0 or over == 0.0:
                return np.inf, False, _ended(doubt, open_from, at, known), used
            b, over = b + over, 0.0
        piece = max(piece, 0.5 * finest)
        x = _pieces(forms, k, tape, tapes, memory, o, d, at, piece, b, value)
        if x.open & 1 == 0:
            doubt, open_from = _ended(doubt, open_from, at, known), -1.0
        if x.open == 0:
            value = crosslane.lane(x.far, LANES - 1)
            at = at + LANES * piece
            piece = min(4.0 * piece, (b - at) / LANES)
            continue
        j = simd.trailing_zeros(x.open)
        low, high, within = crosslane.lane(x.begins, j), crosslane.lane(x.ends, j), crosslane.lane(x.near, j) <= 0.0
        changes = ((crosslane.bits(x.change) >> j) & 1) != 0
        if changes and ((crosslane.bits(x.one_way) >> j) & 1) != 0:
            root = _narrowed(forms, k, tapes, memory, o, d, low, high, within, reach, number)
            return root, within, _doubtful(doubt, open_from, root, finest), used
        jumps = not (crosslane.lane(x.bounds.least, j) > -JUMP and crosslane.lane(x.bounds.most, j) < JUMP)
        asked = (jumps or ((crosslane.bits(x.bounds.maybe) >> j) & 1) != 0) and (sheet or not changes)
        if asked and _passes(forms, k, tape, memory, crosslane.lane3(x.p, j), crosslane.lane3(x.q, j), sheet, within, like):
            doubt, open_from = _ended(doubt, open_from, low, known), -1.0
            at, value, piece = high, crosslane.lane(x.far, j), high - low
            continue
        smallest = finest if changes or open_from < 0.0 else max(finest, _COARSER * (low - open_from))
        if high - low > smallest:
            at, value = low, crosslane.lane(x.near, j)
            piece = (high - low) / _PARTS
            continue
        if changes and not (sheet and jumps):
            after = _one_value(forms, k, tapes, memory, o, d, high + finest)
            before = within  # as the ray knows: where it nearly grazes a surface, rounding has values change sign again and again
            if low <= a + finest:  # it may begin at a place alone
                before = _one_value(forms, k, tapes, memory, o, d, low - finest) <= 0.0
            if before != (after <= 0.0):
                root = 0.5 * (low + high)
                return root, within, _doubtful(doubt, open_from, root, finest), used
            at, value, piece = high + finest, after, max(piece, finest)  # a gap at a place alone, as where the formula is undefined
            continue
        if jumps and not sheet and forms.places[k, 5] == JUMPS:  # a solid's jump that thin has no inside, nor what is beside it
            known = max(known, high + NEIGHBOURS * finest)
            open_from = -1.0 if low - open_from <= NEIGHBOURS * finest else open_from
        elif open_from < 0.0:
            open_from, known = low, max(known, low + GAP * finest if within and not sheet else 0.0)
        at, value = high, crosslane.lane(x.far, j)
        piece = max(piece, _COARSER * (high - open_from)) if open_from >= 0.0 else finest
    root, within = _sampled(forms, k, tapes, memory, o, d, at, b, value, sheet, reach, number)
    return root, within, 1, used


@helper
def _one_value(forms: Any, k: int, tapes: Lane, memory: Room, o: Vec, d: Vec, at: float) -> float:
    place = ops.along(o, d, 0.0 * o[0] + at)
    return crosslane.lane(value_at(forms, k, tapes, memory, place, ops.bool_like(o[0], True)), 0)


@helper
def _ended(doubt: int, open_from: float, at: float, known: float) -> int:
    """Whether anything is not proved, where what was open ended without a root."""
    return 1 if open_from >= 0.0 and at > known else doubt


@helper
def _doubtful(doubt: int, open_from: float, root: float, finest: float) -> int:
    """Whether what is open before a root is more than its neighbourhood."""
    return 1 if open_from >= 0.0 and root - open_from > NEIGHBOURS * finest else doubt


class _Pieces(NamedTuple):
    """Of a stretch, one a lane."""

    begins: Lane
    ends: Lane
    p: Vec
    q: Vec
    near: Lane
    far: Lane
    bounds: Bounds
    change: Lane  # mask: the sign
    one_way: Lane  # mask: the slope has one sign all along
    open: int  # bits: whatever may have a root


@helper
def _pieces(
    forms: Any, k: int, tape: int, tapes: Lane, memory: Room, o: Vec, d: Vec, at: float, piece: float, b: float, value: float
) -> _Pieces:
    """The pieces from `at`, where the formula has a `value`, up to b at the most."""
    number = ops.to_float(crosslane.lane_indices(0))
    begins, ends = at + number * piece, ops.minimum(at + (number + 1.0) * piece, 0.0 * number + b)
    p, q = ops.along(o, d, begins), ops.along(o, d, ends)
    bounds = bounds_at(forms, k, tape, memory, p, q, d)
    far = value_at(forms, k, tapes, memory, q, ops.bool_like(number, True))
    near = _shifted(far, value)
    in_near, in_far = near <= 0.0, far <= 0.0
    change = (in_near & ops.not_(in_far)) | (in_far & ops.not_(in_near))
    finite = (abs(bounds.low) < LARGEST) & (abs(bounds.high) < LARGEST) & (abs(bounds.least) < LARGEST) & (abs(bounds.most) < LARGEST)
    one_way = ((bounds.least > 0.0) | (bounds.most < 0.0)) & finite & ops.not_(bounds.maybe)
    away = ops.not_(bounds.low <= 0.0) | ((bounds.high < 0.0) & ops.not_(bounds.maybe))
    above = apart(near, far, bounds.least, bounds.most, ends - begins) & ops.not_(bounds.maybe)
    none = ops.not_(change) & (away | one_way | above)
    open_ = crosslane.bits((begins < b) & ops.not_(none))
    return _Pieces(begins, ends, p, q, near, far, bounds, change, one_way, open_)


@helper
def apart(a: Lane, b: Lane, low: Lane, high: Lane, length: Lane) -> Lane:
    """Whether values a and b of one sign, at the ends of a stretch over which slopes lie between low and high, leave no room for a root.

    |f| falls from both ends with the steepest slopes at the most: the two lines meet above 0 (Piyavskii 1972; Shubert 1972).
    """
    up = a > 0.0
    least, most = ops.where(up, low, -high), ops.where(up, high, -low)
    size_a, size_b = abs(a), abs(b)
    steep = most - least
    x = ops.where(steep > 0.0, (size_a - size_b + most * length) / ops.where(steep > 0.0, steep, 1.0), 0.0)
    meeting = size_a + least * ops.clip(x, 0.0, length)
    ends = size_a + size_b
    return (meeting > NEAR * ends) & (ends < LARGEST) & (((a > 0.0) & (b > 0.0)) | ((a < 0.0) & (b < 0.0)))


@apart_
def _passes(forms, k, tape, memory, p, q, sheet, within, like):
    """Whether a piece in which the formula jumps has no root: all ways past jumps are away from 0, of a solid on the side of its ends."""
    registers = memory.registers
    begin, rows, out = forms.tapes[tape, 0], forms.tapes[tape, 1], 2 * forms.tapes[tape, 2]
    for first_way in range(0, WAYS_PAST, LANES):
        for axis in range(3):
            a, b = (p[0], q[0]) if axis == 0 else (p[1], q[1]) if axis == 1 else (p[2], q[2])
            crosslane.store(registers, 2 * axis, like + min(a, b))
            crosslane.store(registers, 2 * axis + 1, like + max(a, b))
        simd.write(memory.state, 0, 0)
        for j in range(LANES):
            simd.write(memory.state, WAYS + j, _WAYS[first_way + j])
        interpret(forms.programs[_FORKS], forms.code, begin, rows, registers, forms.constants, forms.places[k, 3], memory.state, 1)
        if simd.read(memory.state, 0) != 0:
            return False
        outside, inside = ops.not_(crosslane.load(registers, out) <= 0.0), crosslane.load(registers, out + 1) < 0.0
        wanted = outside | inside if sheet else inside if within else outside
        if ops.any_lane(ops.not_(wanted)):
            return False
    return True


@apart_
def _sampled(forms, k, tapes, memory, o, d, a, b, value, sheet, reach, number):
    """(distance or inf, whether the ray is inside before it) of the first root between points side by side."""
    everywhere = ops.bool_like(o[0], True)
    step = (b - a) / (SAMPLES * LANES)
    for turn in range(SAMPLES):
        places = a + (turn * LANES + number + 1.0) * step
        far = value_at(forms, k, tapes, memory, ops.along(o, d, places), everywhere)
        near = _shifted(far, value)
        changes = crosslane.bits(((near <= 0.0) & ops.not_(far <= 0.0)) | ((far <= 0.0) & ops.not_(near <= 0.0)))
        while changes != 0:
            j = simd.trailing_zeros(changes)
            changes &= changes - 1
            high, within = crosslane.lane(places, j), crosslane.lane(near, j) <= 0.0
            root = _narrowed(forms, k, tapes, memory, o, d, high - step, high, within, reach, number)
            if not sheet:
                return root, within
            if abs(_one_value(forms, k, tapes, memory, o, d, root)) <= 1e-3 * (abs(crosslane.lane(near, j)) + abs(crosslane.lane(far, j))):
                return root, within
        value = crosslane.lane(far, LANES - 1)
    return np.inf, False


@helper
def _shifted(x: Any, before: Any) -> Any:
    """Each lane gets the one before it, the first one `before`."""
    memory = simd.stack_array(np.float64, _SHIFT)
    simd.write(memory, 0, before)
    crosslane.store_row(memory, 1, x)
    return crosslane.load(memory, 0)


_SHIFT = LANES + 1


@helper
def _narrowed(
    forms: Any, k: int, tapes: Any, memory: Room, o: Any, d: Any, low: Any, high: Any, within: bool, reach: float, number: Any
) -> Any:
    """The one root between low and high: as many points between them as there are lanes, again and again."""
    everywhere = ops.bool_like(o[0], True)
    while high - low > _ENOUGH * (reach + high):
        step = (high - low) / (LANES + 1)
        places = low + (number + 1.0) * step
        f = value_at(forms, k, tapes, memory, ops.along(o, d, places), everywhere)
        same = (f <= 0.0) if within else ops.not_(f <= 0.0)
        over = crosslane.bits(ops.not_(same))
        if over == 0:
            low = crosslane.lane(places, LANES - 1)
        else:
            j = simd.trailing_zeros(over)
            high = crosslane.lane(places, j)
            if j > 0:
                low = crosslane.lane(places, j - 1)
        if not step > 0.25 * _ENOUGH * reach:
            break
    return 0.5 * (low + high)
