"""Roots and normals where a formula jumps over 0 or ends to be defined, independent of how the root was found.

A floor has no slope, and the slope beside a step says nothing about the face between two steps. At the edge of a formula's domain the slope
at a root points inwards and is as steep as the root is near. So two rays beside the ray locate the face. The error of a root depends on the
segment it was found in, and with it the side of the jump that is evaluated. Here each ray has a fixed grid of distances; the change of sign
is bracketed anew between two of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiler.formula.numpy_interpreter import boxes
from ...compiler.formula.opcodes import Op
from ...compiler.formula.tape import Tape
from ...compiler.ir import is_in
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane, Vec
from .evaluate import EvalBuffers, RayFunction, value_on
from .tables import LARGEST_COORDINATE, WHOLE_TAPE

JUMPING = (Op.FLOOR, Op.CEIL, Op.MOD, Op.SIGN, Op.CHOOSE, Op.ATAN2)
ENDING = (Op.SQRT, Op.LOG, Op.POWER, Op.ASIN, Op.ACOS)
CONTINUOUS, JUMPS, ENDS = 0, 1, 2  # kinds of tapes
SPACE = 2.0**-40  # of the largest coordinate: spacing of a ray's grid of distances
BISECTIONS = 13  # between two of these distances
WIDER, RETRIES = 256.0, 3  # factor by which the spacing grows where the root is farther off, and how often
FARTHEST = 256.0  # times the largest coordinate: roots of rays that come from farther away stay as found
LEAST = 2.0**-30  # of slope times largest coordinate: a larger change of the value over the last interval is a jump
BESIDE, REACH, FACE_BISECTIONS = 2.0**-20, 32.0, 33  # offset of the rays beside, of the largest coordinate; search range in offsets
CLOSER = 2.0**-12  # factor of the offset for faces seen nearly edge-on
OFF = 2.0**-49  # of the largest coordinate: error of a face


class Face(NamedTuple):
    """Corrected roots: the lanes that have one, distance, gradient (or face normal), and bound of the value."""

    settled: Lane
    distance: Lane
    gradient: Vec
    off: Lane


def kind_of(tape: Tape, bounds: np.ndarray) -> int:
    """JUMPS for a tape with a jumping operation, ENDS for one that may be undefined somewhere in a box (2, 3), else CONTINUOUS."""
    if is_in(tape.code[:, 0], JUMPING).any():
        return JUMPS
    ending = is_in(tape.code[:, 0], ENDING).any() and boxes(tape, bounds[0][:, None], bounds[1][:, None])[2].any()
    return ENDS if ending else CONTINUOUS


@helper
def whole_tape(forms: Any, k: int, memory: EvalBuffers, origin: Vec, direction: Vec, like: Lane) -> RayFunction:
    """Surface k along rays by its whole tape: a cell's tape does not hold beside the cell."""
    return RayFunction(forms, k, ops.int_like(like, forms.places[k, WHOLE_TAPE]), memory, origin, direction)


@noinline_helper
def discontinuity_normal(ray, root, inside, gradient, off, mask):
    """The Face of roots near `root` along rays from their origins, which are `inside` before them, in the lanes of a mask."""
    reach = ray.forms.numbers[ray.k, LARGEST_COORDINATE]
    mask = mask & (root < FARTHEST * reach)
    low, high, settled = _bracket_on_grid(ray, root, inside, SPACE * reach, BISECTIONS, mask)
    space, turns = SPACE * reach, BISECTIONS
    for _ in range(RETRIES):  # single precision may have found the change of sign this far off; dense roots have nearer ones
        missing = mask & ops.not_(settled)
        if not ops.any_lane(missing):
            break
        space, turns = WIDER * space, turns + 8
        _, near, held = _bracket_on_grid(ray, root, inside, space, turns, missing)
        again_low, again_high, again = _bracket_on_grid(ray, near, inside, SPACE * reach, BISECTIONS, held)
        low, high, settled = ops.where(again, again_low, low), ops.where(again, again_high, high), settled | again
    root = ops.where(settled, high, root)
    before, after = value_on(ray, low, settled), value_on(ray, high, settled)
    steep = ops.length(gradient)
    jumps = settled & ops.not_(abs(after - before) <= LEAST * reach * steep) & ops.not_(abs(after) + abs(before) >= np.inf)
    if ops.any_lane(jumps):
        normal = _face_normal(ray, root, inside, reach, jumps)
        gradient = ops.where3(jumps, ops.scale(normal, ops.where(inside, 1.0, -1.0)), gradient)
        off = ops.where(jumps, OFF * reach * ops.length(gradient), off)
    return Face(settled, root, gradient, off)


@helper
def _bracket_on_grid(ray: RayFunction, root: Lane, inside: Lane, space: float, turns: int, mask: Lane) -> tuple[Lane, Lane, Lane]:
    """`_bisect` between the grid distances near `root`, which are `space` apart."""
    place = space * ops.floor(ops.where(mask, root, 0.0) / space)
    held = value_on(ray, place, mask) <= 0.0
    back = (held & ops.not_(inside)) | (inside & ops.not_(held))  # the sign has changed before this distance
    place = ops.where(back, place - space, place)
    low, high, bracketed = _bisect(ray, place, place + space, inside, turns, mask)
    missed = mask & ops.not_(bracketed)
    if ops.any_lane(missed):
        next_low, next_high, later = _bisect(ray, place + space, place + 2.0 * space, inside, turns, missed)
        low, high, bracketed = ops.where(later, next_low, low), ops.where(later, next_high, high), bracketed | later
    return low, high, bracketed


@helper
def _face_normal(ray: RayFunction, root: Lane, inside: Lane, reach: float, mask: Lane) -> Vec:
    """Normal of the face, on the side of the ray's direction, from two rays beside; the direction itself at an edge."""
    d = ray.direction
    first, second = ops.basis(d)
    a, on_a = _face_slope(ray, root, first, inside, reach, mask)
    b, on_b = _face_slope(ray, root, second, inside, reach, mask)
    return ops.where3(on_a & on_b, ops.sub(d, ops.add(ops.scale(first, a), ops.scale(second, b))), d)


@helper
def _face_slope(ray: RayFunction, root: Lane, sideways: Vec, inside: Lane, reach: float, mask: Lane) -> tuple[Lane, Lane]:
    """(change of the face's distance for a unit step `sideways`, lanes where it was found).

    It is searched on the opposite side where the face ends on this side, and closer by where it leaves the search range.
    """
    step = BESIDE * reach
    slope, measured = 0.0 * root, mask & ops.not_(mask)
    for turn in range(4):
        remaining = mask & ops.not_(measured)
        if ops.any_lane(remaining):
            aside = (step if turn < 2 else CLOSER * step) * (1.0 if turn % 2 == 0 else -1.0)
            beside = RayFunction(ray.forms, ray.k, ray.tape, ray.memory, ops.along(ray.start, sideways, 0.0 * root + aside), ray.direction)
            low, high, bracketed = _bisect(beside, root - REACH * step, root + REACH * step, inside, FACE_BISECTIONS, remaining)
            slope = ops.where(bracketed, (0.5 * (low + high) - root) / aside, slope)
            measured = measured | bracketed
    return slope, measured


@helper
def _bisect(ray: RayFunction, low: Lane, high: Lane, inside: Lane, turns: int, mask: Lane) -> tuple[Lane, Lane, Lane]:
    """Bisect low … high to the change of sign that ends the side `inside`: (low, high, lanes in which the sign changes)."""
    at_low, at_high = value_on(ray, low, mask) <= 0.0, value_on(ray, high, mask) <= 0.0
    changes = mask & ((at_low & inside & ops.not_(at_high)) | (at_high & ops.not_(at_low) & ops.not_(inside)))
    if ops.any_lane(changes):
        for _ in range(turns):
            middle = 0.5 * (low + high)
            within = value_on(ray, middle, changes) <= 0.0
            same = (within & inside) | (ops.not_(within) & ops.not_(inside))
            low, high = ops.where(same, middle, low), ops.where(same, high, middle)
    return low, high, changes
