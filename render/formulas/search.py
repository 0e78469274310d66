"""The first root in a stretch of one ray that bounds over a whole cell could not decide: pieces of it side by side, smaller where need be.

As many pieces as there are lanes are bounded at once, by intervals of the value and of the slope along the ray. From the near end on,
each is known to hold no root, or one, or is cut up next (Mitchell, "Robust Ray Intersection with Interval Arithmetic", Graphics
Interface 1990; Knoll and others, "Fast Ray Tracing of Arbitrary Implicit Surfaces with Interval and Affine Arithmetic", Computer
Graphics Forum 2009).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import across, lanes, simd
from ..kernels import apart, helper
from .evaluate import Room, bounds_at, value_at
from .vectors import LANES

FINEST = 2.0**-44  # of the largest coordinate: shorter pieces are not told apart
MOST_ROUNDS = 4000  # of pieces on one stretch
JUMP = 1e90  # bounds of a slope beyond this: the formula may jump there
_ENOUGH = 2.0**-50


@apart
def first(forms, k, tape, memory, start, way, a, b, begin, sheet, like):
    """(distance or inf, whether the ray is inside before it, 1 where not all is proved) of the first root in a … b.

    What is bracketed within FINEST counts as met where the sign changes, of a sheet only where the formula does not jump; where no sign
    changes, it is left out and not proved.
    """
    number = lanes.to_float(across.numbered(0))
    o = lanes.like3(like, start[0], start[1], start[2])
    d = lanes.like3(like, way[0], way[1], way[2])
    reach = forms.numbers[k, 13] + begin
    finest = FINEST * reach
    tapes = lanes.int_like(like, tape)
    everywhere = lanes.bool_like(like, True)
    piece = (b - a) / LANES
    at, doubt = a, 0
    value = across.lane(value_at(forms, k, tapes, memory, lanes.along(o, d, like + at), everywhere), 0)
    for _ in range(MOST_ROUNDS):
        if not at < b:
            return np.inf, False, doubt
        piece = max(piece, 0.5 * finest)
        begins, ends = at + number * piece, lanes.minimum(at + (number + 1.0) * piece, like + b)
        inside_range = begins < b
        p, q = lanes.along(o, d, begins), lanes.along(o, d, ends)
        bounds = bounds_at(forms, k, tape, memory, p, q, d)
        far = value_at(forms, k, tapes, memory, q, everywhere)
        near = _shifted(far, value)
        in_near, in_far = near <= 0.0, far <= 0.0
        change = (in_near & lanes.not_(in_far)) | (in_far & lanes.not_(in_near))
        one_way = ((bounds.least > 0.0) | (bounds.most < 0.0)) & lanes.not_(bounds.maybe)
        away = lanes.not_(bounds.low <= 0.0) | ((bounds.high < 0.0) & lanes.not_(bounds.maybe))
        none = lanes.not_(change) & (away | one_way)
        open_ = across.bits(inside_range & lanes.not_(none))
        if open_ == 0:
            value = across.lane(far, LANES - 1)
            at = at + LANES * piece
            piece = min(4.0 * piece, (b - at) / LANES)
            continue
        j = simd.trailing_zeros(open_)
        low, high = across.lane(begins, j), across.lane(ends, j)
        changes = ((across.bits(change) >> j) & 1) != 0
        if changes and ((across.bits(one_way) >> j) & 1) != 0:
            within = across.lane(near, j) <= 0.0
            return _narrowed(forms, k, tapes, memory, o, d, low, high, within, reach, number), within, doubt
        if high - low > finest:
            at, value = low, across.lane(near, j)
            piece = (high - low) / LANES
            continue
        jumps = not (across.lane(bounds.least, j) > -JUMP and across.lane(bounds.most, j) < JUMP)
        if changes and not (sheet and jumps):
            return 0.5 * (low + high), across.lane(near, j) <= 0.0, doubt
        if not changes:
            doubt = 1
        at, value = high, across.lane(far, j)
    return np.inf, False, 1


@helper
def _shifted(x: Any, before: Any) -> Any:
    """Each lane gets the one before it, the first one `before`."""
    memory = simd.stack_array(np.float64, _SHIFT)
    simd.write(memory, 0, before)
    across.store_row(memory, 1, x)
    return across.load(memory, 0)


_SHIFT = LANES + 1


@helper
def _narrowed(
    forms: Any, k: int, tapes: Any, memory: Room, o: Any, d: Any, low: Any, high: Any, within: bool, reach: float, number: Any
) -> Any:
    """The one root between low and high: as many points between them as there are lanes, again and again."""
    everywhere = lanes.bool_like(o[0], True)
    while high - low > _ENOUGH * (reach + high):
        step = (high - low) / (LANES + 1)
        places = low + (number + 1.0) * step
        f = value_at(forms, k, tapes, memory, lanes.along(o, d, places), everywhere)
        same = (f <= 0.0) if within else lanes.not_(f <= 0.0)
        over = across.bits(lanes.not_(same))
        if over == 0:
            low = across.lane(places, LANES - 1)
        else:
            j = simd.trailing_zeros(over)
            high = across.lane(places, j)
            if j > 0:
                low = across.lane(places, j - 1)
        if not step > 0.25 * _ENOUGH * reach:
            break
    return 0.5 * (low + high)
