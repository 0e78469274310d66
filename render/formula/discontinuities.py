"""Where a formula jumps over 0, or ends: the same place by whatever way it was found, and the normal of the face that is there.

A floor has no slope, and what has one beside it says nothing of the face between two steps; a root's slope at the edge of where it is
defined points inwards, as steep as a root is near. So the face is looked for on two rays beside
the one that met it. How far off a root is when it is found depends on the stretch it was found in, and with it the side of the jump that
is looked at; here each ray has places of its own, between which the change of sign is closed in on anew.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiler.formula.numpy_interpreter import boxes
from ...compiler.formula.tape import Op, Tape
from ...compiler.ir import among
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..types import Lane, Vec
from .evaluate import Room, value_at

JUMPING = (Op.FLOOR, Op.CEIL, Op.MOD, Op.SIGN, Op.CHOOSE, Op.ATAN2)
ENDING = (Op.SQRT, Op.LOG, Op.POWER, Op.ASIN, Op.ACOS)
NEVER, JUMPS, ENDS = 0, 1, 2  # what a tape may do
SPACE = 2.0**-40  # of the largest coordinate, between a ray's places
HALVINGS = 13  # of the space between two of them
WIDER, TIMES = 256.0, 3  # where a root is farther from where it was looked for: by how much more space, and how often
FARTHEST = 256.0  # times the largest coordinate: rays that come from farther away are not told apart so finely
LEAST = 2.0**-30  # of slope times largest coordinate: a change of the value over the last of these halves that is a jump
BESIDE, REACH, TURNS = 2.0**-20, 32.0, 33  # rays beside: how far away, how far up and down they are followed, and in how many halvings
CLOSER = 2.0**-12  # of how far away, where faces are seen nearly edge-on
OFF = 2.0**-49  # of the largest coordinate, that faces may be off


class Face(NamedTuple):
    """Which lanes are settled, how far along, the formula's gradient or what stands for it, and how far from 0 it may be."""

    settled: Lane
    at: Lane
    gradient: Vec
    off: Lane


def kind_of(tape: Tape, bounds: np.ndarray) -> int:
    """Whether a tape has an operation whose values jump, or else one that may end to be defined somewhere in a box (2, 3)."""
    if among(tape.code[:, 0], JUMPING).any():
        return JUMPS
    ending = among(tape.code[:, 0], ENDING).any() and boxes(tape, bounds[0][:, None], bounds[1][:, None])[2].any()
    return ENDS if ending else NEVER


@noinline_helper
def discontinuity_normal(forms, k, memory, o, d, at, inside, gradient, off, mask):
    """The Face of roots near `at` along rays (o, d), d of unit length, that are `inside` before them, in the lanes of a mask."""
    reach = forms.numbers[k, 13]
    mask = mask & (at < FARTHEST * reach)
    low, high, found = _between_places(forms, k, memory, o, d, at, inside, SPACE * reach, HALVINGS, mask)
    space, turns = SPACE * reach, HALVINGS
    for _ in range(TIMES):  # single precision may have seen the sign change this far off; where roots are dense, there are nearer ones
        missing = mask & ops.not_(found)
        if not ops.any_lane(missing):
            break
        space, turns = WIDER * space, turns + 8
        _, near, held = _between_places(forms, k, memory, o, d, at, inside, space, turns, missing)
        again_low, again_high, again = _between_places(forms, k, memory, o, d, near, inside, SPACE * reach, HALVINGS, held)
        low, high, found = ops.where(again, again_low, low), ops.where(again, again_high, high), found | again
    at = ops.where(found, high, at)
    before, after = _value(forms, k, memory, o, d, low, found), _value(forms, k, memory, o, d, high, found)
    steep = ops.length(gradient)
    jumps = found & ops.not_(abs(after - before) <= LEAST * reach * steep) & ops.not_(abs(after) + abs(before) >= np.inf)
    if ops.any_lane(jumps):
        normal = _turned(forms, k, memory, o, d, at, inside, reach, jumps)
        gradient = ops.where3(jumps, ops.scale(normal, ops.where(inside, 1.0, -1.0)), gradient)
        off = ops.where(jumps, OFF * reach * ops.length(gradient), off)
    return Face(found, at, gradient, off)


@helper
def _between_places(
    forms: Any, k: int, memory: Room, o: Vec, d: Vec, at: Lane, inside: Lane, space: float, turns: int, mask: Lane
) -> tuple[Lane, Lane, Lane]:
    """`_closed_in` between the places near `at`, which are `space` apart."""
    place = space * ops.floor(ops.where(mask, at, 0.0) / space)
    held = _is_inside(forms, k, memory, o, d, place, mask)
    back = (held & ops.not_(inside)) | (inside & ops.not_(held))  # the sign has changed here already
    place = ops.where(back, place - space, place)
    low, high, found = _closed_in(forms, k, memory, o, d, place, place + space, inside, turns, mask)
    missed = mask & ops.not_(found)
    if ops.any_lane(missed):
        next_low, next_high, later = _closed_in(forms, k, memory, o, d, place + space, place + 2.0 * space, inside, turns, missed)
        low, high, found = ops.where(later, next_low, low), ops.where(later, next_high, high), found | later
    return low, high, found


@helper
def _turned(forms: Any, k: int, memory: Room, o: Vec, d: Vec, at: Lane, inside: Lane, reach: float, mask: Lane) -> Vec:
    """The normal of the face on the side of d, from where two rays beside each meet it; d at an edge."""
    first, second = ops.basis(d)
    a, on_a = _leaning(forms, k, memory, o, d, at, first, inside, reach, mask)
    b, on_b = _leaning(forms, k, memory, o, d, at, second, inside, reach, mask)
    return ops.where3(on_a & on_b, ops.sub(d, ops.add(ops.scale(first, a), ops.scale(second, b))), d)


@helper
def _leaning(
    forms: Any, k: int, memory: Room, o: Vec, d: Vec, at: Lane, way: Vec, inside: Lane, reach: float, mask: Lane
) -> tuple[Lane, Lane]:
    """(how much farther the face is a unit of `way` aside, where it was found).

    It is looked for on the other side where it ends on this one, and closer by where it leaves the stretch that is followed.
    """
    step = BESIDE * reach
    leaning, known = 0.0 * at, mask & ops.not_(mask)
    for turn in range(4):
        left = mask & ops.not_(known)
        if ops.any_lane(left):
            aside = (step if turn < 2 else CLOSER * step) * (1.0 if turn % 2 == 0 else -1.0)
            ray = ops.along(o, way, 0.0 * at + aside)
            low, high, found = _closed_in(forms, k, memory, ray, d, at - REACH * step, at + REACH * step, inside, TURNS, left)
            leaning = ops.where(found, (0.5 * (low + high) - at) / aside, leaning)
            known = known | found
    return leaning, known


@helper
def _closed_in(
    forms: Any, k: int, memory: Room, o: Vec, d: Vec, low: Lane, high: Lane, inside: Lane, turns: int, mask: Lane
) -> tuple[Lane, Lane, Lane]:
    """(low, high, mask) of the stretch between, halved again and again, in which the sign changes; in lanes where it does."""
    at_low, at_high = _is_inside(forms, k, memory, o, d, low, mask), _is_inside(forms, k, memory, o, d, high, mask)
    found = mask & ((at_low & inside & ops.not_(at_high)) | (at_high & ops.not_(at_low) & ops.not_(inside)))
    if ops.any_lane(found):
        for _ in range(turns):
            middle = 0.5 * (low + high)
            within = _is_inside(forms, k, memory, o, d, middle, found)
            same = (within & inside) | (ops.not_(within) & ops.not_(inside))
            low, high = ops.where(same, middle, low), ops.where(same, high, middle)
    return low, high, found


@helper
def _is_inside(forms: Any, k: int, memory: Room, o: Vec, d: Vec, at: Lane, mask: Lane) -> Lane:
    return _value(forms, k, memory, o, d, at, mask) <= 0.0


@helper
def _value(forms: Any, k: int, memory: Room, o: Vec, d: Vec, at: Lane, mask: Lane) -> Lane:
    whole = ops.int_like(at, forms.places[k, 4])  # a cell's tape says nothing of what is beside the cell
    return value_at(forms, k, whole, memory, ops.along(o, d, at), mask)
