"""Where values of a tape are the same number all over a region: steps, and plateaus of minima and maxima.

A relation of such values may hold with equality all over a region, where rounding would otherwise say whether that belongs to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .opcodes import STEPS, Op, fold

if TYPE_CHECKING:
    from .tape import Builder

Levels = frozenset[float] | None  # the numbers that a value may be all over regions; None: whatever steps there are
NOWHERE: frozenset[float] = frozenset()
MOST = 16  # levels that are kept apart
APART = 2.0**-40  # of what is compared: what differs by less is equal but for rounding
TINY = 1e-30  # beside what steps add up to, so that float32 has it
VANISHING = 1e-300  # beside what may be equal because floating point ends there
FARTHEST = 2**52
INPUTS = 3


def both(one: Levels, other: Levels) -> Levels:
    """The levels of either."""
    return None if one is None or other is None or len(one | other) > MOST else one | other


def levels(op: int, used: Sequence[Levels]) -> Levels:
    """The levels of an operation's value, by those of its operands (of CHOOSE those that it chooses from); a constant is one."""
    if op in STEPS:
        return None
    if op in (Op.MIN, Op.MAX, Op.CHOOSE):
        found: Levels = NOWHERE
        for one in used:
            found = both(found, one)
        return found
    if all(one is None or one for one in used):
        return _all_together(op, used)
    factors = used if op == Op.MULTIPLY else used[:1] if op == Op.DIVIDE else ()  # 0 times anything
    if any(one is None for one in factors):
        return None
    return frozenset({0.0}) if any(one is not None and 0.0 in one for one in factors) else NOWHERE


def _all_together(op: int, used: Sequence[Levels]) -> Levels:
    known = [one for one in used if one is not None]
    if len(known) < len(used) or math.prod(len(one) for one in known) > MOST:
        return None
    found = (fold(Op(op), *numbers) for numbers in itertools.product(*known))
    return frozenset(number + 0.0 for number in found if math.isfinite(number))


def against_own(b: Builder, left: int, right: int, strictly: bool) -> int | None:
    """A field that is at most 0 where left ≤ right, or left < right, if one of them is a maximum, minimum or magnitude of the other.

    Both are equal then wherever that operand is chosen, and bounds could never tell: max(x, y) > x says as much as y > x.
    """
    for choice, own, above in ((right, left, True), (left, right, False)):
        op, *of = b.row(choice) if choice >= 0 else (Op.COPY, 0, 0)
        if op == Op.ABS and of[0] == own:
            op, other = Op.MAX, b.op(Op.NEGATE, own)
        elif op in (Op.MIN, Op.MAX) and own in of:
            other = of[1] if of[0] == own else of[0]
        else:
            continue
        if above == (op == Op.MAX) and not strictly:
            continue  # holds wherever it is defined
        if above != (op == Op.MAX) and strictly:
            return b.constant(1.0)
        return b.below(own, other, strictly) if above else b.below(other, own, strictly)
    return None


def sign_of_0(b: Builder, name: int) -> int:
    """1 where a value may be +0 all over a region, and −0 at places alone; −1 the other way round; 0 where neither is known.

    What is divided by it has there the sign that it had, or the other one.
    """
    if name < INPUTS or not b.stays_0(name):
        return 0
    op, one, other = b.row(name)
    if op in (Op.ABS, Op.SQUARE):
        return 1
    if op == Op.CUBE:
        return sign_of_0(b, one)
    if op in (Op.MIN, Op.MAX):
        return 1 if 0.0 in (b.number(one), b.number(other)) else 0
    if op == Op.NEGATE:
        return -sign_of_0(b, one)
    if op in (Op.FLOOR, Op.CEIL, Op.SIGN):
        mine = -1 if op == Op.CEIL else 1
        return mine if not b.stays_0(one) or sign_of_0(b, one) == mine else 0
    if op in (Op.ADD, Op.SUBTRACT):  # −0 only of two such; numbers that cancel leave +0
        turned = 1 if op == Op.ADD else -1
        return 1 if any(not b.stays_0(x) or sign_of_0(b, x) == sign for x, sign in ((one, 1), (other, turned))) else 0
    return 0


def parted(b: Builder, field: int, strictly: bool) -> int:
    """A field that is at most 0 where `field` is, or where it is below 0, and is 0 over no region."""
    found = _before(b, field, strictly)
    if found is not None:
        return found
    terms, shift = _terms(b, field)
    scale = b.constant(abs(shift) if len(terms) == 1 else 0.0)
    if len(terms) > 1:
        for term in terms:
            scale = b.add(scale, b.op(Op.ABS, term))
    apart = b.shifted(b.scaled(scale, APART), VANISHING if b.parted else TINY)
    return b.add(field, apart) if strictly else b.subtract(field, apart)


def _before(b: Builder, field: int, strictly: bool) -> int | None:
    """The same for what rises or falls with one whole number alone: whether that is at most, or at least, so much."""
    steps: list[tuple[Op, float, bool]] = []  # operation, the constant in it, whether that comes first
    name = field
    while not b.is_whole(name):
        op, one, other = b.row(name)
        if op == Op.NEGATE:
            steps.append((Op.MULTIPLY, -1.0, False))
        elif op in (Op.ADD, Op.SUBTRACT, Op.MULTIPLY) and (one < 0) != (other < 0):
            steps.append((op, b.constants[~min(one, other)], one < 0))
            one = max(one, other)
        elif op == Op.DIVIDE and other < 0:
            steps.append((op, b.constants[~other], False))
        else:
            return None
        name = one

    def holds(number: int) -> bool:
        value = float(number)
        for op, constant, first in reversed(steps):
            value = fold(op, *((constant, value) if first else (value, constant)))
        return value < 0.0 if strictly else value <= 0.0

    low, high = -FARTHEST, FARTHEST
    begins = holds(low)
    if holds(high) == begins:
        return b.constant(-1.0 if begins else 1.0)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) == begins else (low, middle)
    past = b.shifted(name, -(low + 0.5))
    return past if begins else b.op(Op.NEGATE, past)


def _terms(b: Builder, field: int) -> tuple[list[int], float]:
    """What is added up in a field, constants apart: (values, sum of the magnitudes of constants)."""
    terms, shift, waiting = [], 0.0, [field]
    while waiting:
        name = waiting.pop()
        if name < 0:
            shift += abs(b.constants[~name])
            continue
        op, one, other = b.row(name)
        if op in (Op.ADD, Op.SUBTRACT):
            waiting += [one, other]
        elif op == Op.NEGATE:
            waiting.append(one)
        else:
            terms.append(name)
    return terms, shift
