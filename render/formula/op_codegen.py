"""Code emitters of one operation for each evaluation program: values, derivatives, and bounds of both.

    points    the value
    gradients the value and its three derivatives
    boxes     lowest and highest value; records which operand of a choice is irrelevant
    rays      lowest and highest value, lowest and highest slope along a ray
    cells     lowest and highest value, and of each of the three derivatives
    forks     lowest and highest value on one branch of each jump; see interval_arithmetic.one_side
    points32  the value, in float32
    boxes32   as boxes, in float32
    spans32   as rays, in float32, with the error of values; records choices too

The interpreter and compiled tapes emit the same instructions for an operation: their results are the same bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from llvmlite import ir

from ...compiler.formula import derivative_bounds, interval_arithmetic, interval_semantics, point_semantics
from ...compiler.formula.opcodes import ARCS, CHOICES, Op
from ..simd.llvm_expr import I64, Value
from .llvm_math import DOUBLE, SINGLE, Form, VectorMath

WIDTHS = {"points": 1, "gradients": 4, "boxes": 2, "rays": 4, "cells": 8, "forks": 2, "points32": 1, "boxes32": 2, "spans32": 5}
"""Number of vectors of a value in each program."""


def form_of(program: str) -> Form:
    """Number format of a program."""
    return SINGLE if program.endswith("32") else DOUBLE

LARGEST = 1e12
"""Largest magnitude that float32 programs handle."""

EXACT = frozenset({
    Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.DIVIDE, Op.NEGATE, Op.ABS, Op.SQUARE, Op.SQRT, Op.MIN, Op.MAX, Op.CHOOSE, Op.FLOOR,
    Op.CEIL, Op.SIGN,
})  # fmt: skip
"""Operations that round once."""

SCALE = len(Op)
"""MULTIPLY of a register by a constant in interpreter rows (interval_grid.allocate_registers): in spans32 it takes a third of the work."""

NEAREST, LARGEST_PART = 5, 6
"""Vectors of a constant's float32 row: the nearest float32 number, and its largest magnitude (∞ if its error exceeds rounding)."""

Parts = list[Value]
Emitter = Callable[..., Parts]


def _points(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    return [point_semantics.point(m, op, *(p[0] for p in operand_parts))]


def _gradients(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    operands = [p[0] for p in operand_parts]
    value = point_semantics.point(m, op, *operands)
    return [value, *point_semantics.slopes(m, op, operands, value, [p[1:] for p in operand_parts])]


def _boxes(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    operands = [(p[0], p[1]) for p in operand_parts]
    bounds = interval_semantics.interval(m, op, *operands)
    _record_choice(m, op, operands, choice)
    return list(bounds)


def _record_choice(m: VectorMath, op: Op, operands: list[Any], choice: Any) -> None:
    """Record which operand of a choice is irrelevant."""
    if op not in CHOICES:
        return
    irrelevant = interval_semantics.branch_choices(m, operands[0]) if op == Op.CHOOSE else interval_semantics.choices(m, op, *operands)
    if m.result:  # of a minimum that goes into the result by minima, an operand above the result is irrelevant; likewise of maxima
        low, high = m.result
        first_beyond, second_beyond = (p[0] > high if op == Op.MIN else p[1] < low for p in operands)
        irrelevant = irrelevant[0] | (second_beyond & ~first_beyond), irrelevant[1] | first_beyond
    for k, mask in enumerate(irrelevant):
        m.note(m.builder.add(m.builder.mul(choice, ir.Constant(I64, 2)), ir.Constant(I64, 1 + k)), mask)


def _forks(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    return list(interval_semantics.interval(m, op, *((p[0], p[1]) for p in operand_parts)))


def _rays(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    return _slope_bounds(m, op, operand_parts, 1)


def _spans(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    """Bounds with the error of values: the operands' errors and rounding, scaled by derivative bounds (mean value theorem)."""
    operands = [(p[0], p[1]) for p in operand_parts]
    _record_choice(m, op, operands, choice)
    u = 0.5 * m.unit
    off = [p[4] + interval_arithmetic.high_of(m, abs(p[0]), abs(p[1])) * u for p in operand_parts]
    value = interval_semantics.interval(m, op, *operands)
    (slope,) = derivative_bounds.slope_intervals(m, op, operands, value, [[(p[2], p[3])] for p in operand_parts])
    error = derivative_bounds.spread(m, op, operands, value, off)
    if op == Op.SQRT:
        error = interval_arithmetic.low_of(m, error, m.sqrt(off[0]))
    size = interval_arithmetic.high_of(m, abs(value[0]), abs(value[1]))
    if op in ARCS:
        error = error + interval_semantics.arc_slack(m, *operands[:2])
    elif op == Op.CUBE:
        error = error + size * u  # rounded twice
    elif op not in EXACT:
        error = error + (size * (4.0 * interval_semantics.ULPS * u) if op != Op.NOISE else 64.0 * m.unit)
    return [*value, *slope, m.where((error < LARGEST) & (size < LARGEST), error, math.inf)]


def emit_scaled(m: VectorMath, operand: Parts, nearest: Value, largest: Value) -> Parts:
    """`_spans` of a product with a constant, given by its nearest number and its largest magnitude."""
    ends = [part * nearest for part in operand[:4]]
    size, steepness = (interval_arithmetic.high_of(m, abs(ends[k]), abs(ends[k + 1])) for k in (0, 2))
    off = largest * (operand[4] + interval_arithmetic.high_of(m, abs(operand[0]), abs(operand[1])) * m.unit)
    m.unbounded((size > m.big) | (steepness > m.big) | (off > m.big))
    ends = [m.clipped(end, -m.big, m.big) for end in ends]
    bounds = [*_outer_bounds(m, *ends[:2]), *_outer_bounds(m, *ends[2:])]
    off = off + (off * (4.0 * m.unit) + m.tiny)
    return [*bounds, m.where((off < LARGEST) & (size < LARGEST), off, math.inf)]


def _outer_bounds(m: VectorMath, first: Value, second: Value) -> Parts:
    """Bounds of the interval between two products with rounded factors."""
    return [interval_arithmetic.down(m, m.least(first, second), 1), interval_arithmetic.up(m, m.largest(first, second), 1)]


def _cells(m: VectorMath, op: Op, operand_parts: list[Parts], choice: Any) -> Parts:
    return _slope_bounds(m, op, operand_parts, 3)


def _slope_bounds(m: VectorMath, op: Op, operand_parts: list[Parts], directions: int) -> Parts:
    """Bounds of the value and of the derivatives along 1 or 3 directions."""
    operands = [(p[0], p[1]) for p in operand_parts]
    value = interval_semantics.interval(m, op, *operands)
    derivatives = [[(p[2 + 2 * k], p[3 + 2 * k]) for k in range(directions)] for p in operand_parts]
    slopes = derivative_bounds.slope_intervals(m, op, operands, value, derivatives)
    return [*value, *(bound for slope in slopes for bound in slope)]


EMITTERS: dict[str, Emitter] = {
    "points": _points, "gradients": _gradients, "boxes": _boxes, "rays": _rays, "cells": _cells, "forks": _forks, "points32": _points,
    "boxes32": _boxes, "spans32": _spans,
}  # fmt: skip
