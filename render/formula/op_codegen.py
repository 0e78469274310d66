"""What can be asked of a tape, as LLVM code for one operation: values, their derivatives, and bounds of both.

    points    the value
    turns     the value and its three derivatives
    boxes     lowest and highest value; notes which operand of a choice is known not to matter
    rays      lowest and highest value, lowest and highest slope along a ray
    cells     lowest and highest value, and of each of the three derivatives
    forks     lowest and highest value where jumps are gone one way; see enclosures.one_side
    points32  the value, in float32
    boxes32   as boxes, in float32
    spans32   as rays, in float32, and by how much values there may be off; notes choices, too

The interpreter and compiled tapes emit the same instructions for an operation: what they compute is the same bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from llvmlite import ir

from ...compiler.formula import derivative_bounds, interval_semantics, point_semantics
from ...compiler.formula.opcodes import CHOICES, Op
from ..simd.llvm_expr import I64, Value
from .llvm_math import DOUBLE, SINGLE, Form, VectorMath

WIDTHS = {"points": 1, "turns": 4, "boxes": 2, "rays": 4, "cells": 8, "forks": 2, "points32": 1, "boxes32": 2, "spans32": 5}
"""How many vectors a value is in each program."""


def form_of(program: str) -> Form:
    """The numbers a program works on."""
    return SINGLE if program.endswith("32") else DOUBLE

LARGEST = 1e12
"""Numbers beyond this are not for float32."""

EXACT = frozenset({
    Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.DIVIDE, Op.NEGATE, Op.ABS, Op.SQUARE, Op.SQRT, Op.MIN, Op.MAX, Op.CHOOSE, Op.FLOOR,
    Op.CEIL, Op.SIGN,
})  # fmt: skip
"""Operations that are rounded once."""

SCALE = len(Op)
"""MULTIPLY of a register by a constant, as rows for interpreters have it (`cells.place`): in spans32 it takes a third of the work."""

NEAREST, LARGEST_PART = 5, 6
"""Where in a constant's row for float32 the nearest number to it stands, and what its magnitude is at most: ∞ where the nearest one is
not known to be within rounding."""

Parts = list[Value]
Emitter = Callable[..., Parts]


def _points(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return [point_semantics.point(m, op, *(p[0] for p in given))]


def _turns(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    operands = [p[0] for p in given]
    value = point_semantics.point(m, op, *operands)
    return [value, *point_semantics.slopes(m, op, operands, value, [p[1:] for p in given])]


def _boxes(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    operands = [(p[0], p[1]) for p in given]
    found = interval_semantics.interval(m, op, *operands)
    _noted(m, op, operands, choice)
    return list(found)


def _noted(m: VectorMath, op: Op, operands: list[Any], choice: Any) -> None:
    """Note which operand of a choice is known not to matter."""
    if op not in CHOICES:
        return
    known = interval_semantics.chosen(m, operands[0]) if op == Op.CHOOSE else interval_semantics.choices(m, op, *operands)
    if m.result:  # of a minimum that the result is a minimum of, an operand above the result is of no account; so with maxima
        low, high = m.result
        one, two = (p[0] > high if op == Op.MIN else p[1] < low for p in operands)
        known = known[0] | (two & ~one), known[1] | one
    for k, mask in enumerate(known):
        m.note(m.builder.add(m.builder.mul(choice, ir.Constant(I64, 2)), ir.Constant(I64, 1 + k)), mask)


def _forks(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return list(interval_semantics.interval(m, op, *((p[0], p[1]) for p in given)))


def _rays(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return _sloped(m, op, given, 1)


def _spans(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    """Operands are off by what they are off, and by rounding; how that grows, bounds of the derivatives say (mean value theorem)."""
    operands = [(p[0], p[1]) for p in given]
    _noted(m, op, operands, choice)
    u = 0.5 * m.unit
    off = [p[4] + interval_semantics.high_of(m, abs(p[0]), abs(p[1])) * u for p in given]
    value = interval_semantics.interval(m, op, *operands)
    (slope,) = derivative_bounds.slope_intervals(m, op, operands, value, [[(p[2], p[3])] for p in given])
    found = derivative_bounds.spread(m, op, operands, value, off)
    if op == Op.SQRT:
        found = interval_semantics.low_of(m, found, m.sqrt(off[0]))
    size = interval_semantics.high_of(m, abs(value[0]), abs(value[1]))
    if op == Op.FILLET:
        found = found + interval_semantics.fillet_slack(m, *operands)
    elif op == Op.CUBE:
        found = found + size * u  # rounded twice
    elif op not in EXACT:
        found = found + (size * (4.0 * interval_semantics.ULPS * u) if op != Op.NOISE else 64.0 * m.unit)
    return [*value, *slope, m.where((found < LARGEST) & (size < LARGEST), found, math.inf)]


def scaled(m: VectorMath, given: Parts, nearest: Value, largest: Value) -> Parts:
    """As _spans of a product with a constant, by the number nearest to it and its largest magnitude."""
    ends = [part * nearest for part in given[:4]]
    size, steepness = (interval_semantics.high_of(m, abs(ends[k]), abs(ends[k + 1])) for k in (0, 2))
    off = largest * (given[4] + interval_semantics.high_of(m, abs(given[0]), abs(given[1])) * m.unit)
    m.unbounded((size > m.big) | (steepness > m.big) | (off > m.big))
    ends = [m.clipped(end, -m.big, m.big) for end in ends]
    found = [*_widened(m, *ends[:2]), *_widened(m, *ends[2:])]
    off = off + (off * (4.0 * m.unit) + m.tiny)
    return [*found, m.where((off < LARGEST) & (size < LARGEST), off, math.inf)]


def _widened(m: VectorMath, one: Value, other: Value) -> Parts:
    """Bounds of what lies between two products of which either factor was rounded."""
    return [interval_semantics.down(m, m.least(one, other), 1), interval_semantics.up(m, m.largest(one, other), 1)]


def _cells(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return _sloped(m, op, given, 3)


def _sloped(m: VectorMath, op: Op, given: list[Parts], ways: int) -> Parts:
    operands = [(p[0], p[1]) for p in given]
    value = interval_semantics.interval(m, op, *operands)
    turns = [[(p[2 + 2 * k], p[3 + 2 * k]) for k in range(ways)] for p in given]
    slopes = derivative_bounds.slope_intervals(m, op, operands, value, turns)
    return [*value, *(bound for slope in slopes for bound in slope)]


EMITTERS: dict[str, Emitter] = {
    "points": _points, "turns": _turns, "boxes": _boxes, "rays": _rays, "cells": _cells, "forks": _forks, "points32": _points,
    "boxes32": _boxes, "spans32": _spans,
}  # fmt: skip
