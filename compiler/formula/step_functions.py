"""Comparisons of step functions and plateaus: fields that are 0 over no region.

Both sides of such a comparison may be equal over a region, where rounding would decide. These rewrites decide exactly.
"""

from __future__ import annotations

from .graph import Graph
from .opcodes import Op, fold
from .tape import INPUTS

SEPARATION = 2.0**-40  # relative to the sum of the magnitudes: smaller differences are rounding errors
TINY = 1e-30  # absolute separation of steps, which float32 can hold
VANISHING = 1e-300  # absolute separation of values that are equal because they underflow
LARGEST_INTEGER = 2**52


def compare_choice(b: Graph, left: int, right: int, strictly: bool) -> int | None:
    """Compare a value with a maximum, minimum or magnitude of it: a field that is at most 0 where left ≤ right, or left < right.

    Both sides are equal where that operand is chosen, so bounds cannot decide: max(x, y) > x becomes y > x. None for other values.
    """
    for choice, operand, choice_is_right in ((right, left, True), (left, right, False)):
        op, *operands = b.row(choice) if choice >= 0 else (Op.COPY, 0, 0)
        if op == Op.ABS and operands[0] == operand:
            op, other = Op.MAX, b.op(Op.NEGATE, operand)
        elif op in (Op.MIN, Op.MAX) and operand in operands:
            other = operands[1] if operands[0] == operand else operands[0]
        else:
            continue
        if choice_is_right == (op == Op.MAX) and not strictly:
            continue  # holds wherever it is defined
        if choice_is_right != (op == Op.MAX) and strictly:
            return b.constant(1.0)
        return b.less(operand, other, strictly) if choice_is_right else b.less(other, operand, strictly)
    return None


def sign_of_zero(b: Graph, name: int) -> int:
    """The sign of the zero that a value may be over a region: 1 for +0, −1 for −0, 0 if unknown.

    The other zero occurs at isolated points at most. A quotient by the value has that sign times the dividend's.
    """
    if name < INPUTS or not b.may_be_zero(name):
        return 0
    op, operand, other = b.row(name)
    if op in (Op.ABS, Op.SQUARE):
        return 1
    if op == Op.CUBE:
        return sign_of_zero(b, operand)
    if op in (Op.MIN, Op.MAX):
        return 1 if 0.0 in (b.number(operand), b.number(other)) else 0
    if op == Op.NEGATE:
        return -sign_of_zero(b, operand)
    if op in (Op.FLOOR, Op.CEIL, Op.SIGN):
        sign = -1 if op == Op.CEIL else 1
        return sign if not b.may_be_zero(operand) or sign_of_zero(b, operand) == sign else 0
    if op in (Op.ADD, Op.SUBTRACT):  # −0 only from two of them; numbers that cancel leave +0
        second = 1 if op == Op.ADD else -1
        return 1 if any(not b.may_be_zero(x) or sign_of_zero(b, x) == sign for x, sign in ((operand, 1), (other, second))) else 0
    return 0


def separate_equal(b: Graph, field: int, strictly: bool) -> int:
    """A field that is at most 0 where `field` ≤ 0, or `field` < 0, and is 0 over no region."""
    threshold = _integer_threshold(b, field, strictly)
    if threshold is not None:
        return threshold
    terms, offset = _terms(b, field)
    scale = b.constant(abs(offset) if len(terms) == 1 else 0.0)
    if len(terms) > 1:
        for term in terms:
            scale = b.add(scale, b.op(Op.ABS, term))
    distance = b.offset(b.scale(scale, SEPARATION), VANISHING if b.may_tie else TINY)
    return b.add(field, distance) if strictly else b.subtract(field, distance)


def _integer_threshold(b: Graph, field: int, strictly: bool) -> int | None:
    """The same field for a monotonic function of one whole number: a comparison of that number with a threshold. None for others."""
    steps: list[tuple[Op, float, bool]] = []  # operation, its constant, whether that is the first operand
    name = field
    while not b.is_integer(name):
        op, first, second = b.row(name)
        if op == Op.NEGATE:
            steps.append((Op.MULTIPLY, -1.0, False))
        elif op in (Op.ADD, Op.SUBTRACT, Op.MULTIPLY) and (first < 0) != (second < 0):
            steps.append((op, b.constants[~min(first, second)], first < 0))
            first = max(first, second)
        elif op == Op.DIVIDE and second < 0:
            steps.append((op, b.constants[~second], False))
        else:
            return None
        name = first

    def holds(number: int) -> bool:
        value = float(number)
        for op, constant, constant_first in reversed(steps):
            value = fold(op, *((constant, value) if constant_first else (value, constant)))
        return value < 0.0 if strictly else value <= 0.0

    low, high = -LARGEST_INTEGER, LARGEST_INTEGER
    holds_below = holds(low)
    if holds(high) == holds_below:
        return b.constant(-1.0 if holds_below else 1.0)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) == holds_below else (low, middle)
    above = b.offset(name, -(low + 0.5))
    return above if holds_below else b.op(Op.NEGATE, above)


def _terms(b: Graph, field: int) -> tuple[list[int], float]:
    """(the terms of a sum except constants, the sum of the constants' magnitudes)."""
    terms, offset, waiting = [], 0.0, [field]
    while waiting:
        name = waiting.pop()
        if name < 0:
            offset += abs(b.constants[~name])
            continue
        op, first, second = b.row(name)
        if op in (Op.ADD, Op.SUBTRACT):
            waiting += [first, second]
        elif op == Op.NEGATE:
            waiting.append(first)
        else:
            terms.append(name)
    return terms, offset
