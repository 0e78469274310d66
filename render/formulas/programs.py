"""What can be asked of a tape, as LLVM code for one operation: values, their derivatives, and bounds of both.

    points    the value
    turns     the value and its three derivatives
    boxes     lowest and highest value; notes which operand of a choice is known not to matter
    rays      lowest and highest value, lowest and highest slope along a ray
    cells     lowest and highest value, and of each of the three derivatives

The interpreter and compiled tapes emit the same instructions for an operation: what they compute is the same bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from ...compiler import enclosures, tape_points
from ...compiler.tapes import CHOICES, Op
from ..simd.value import I64, Value
from .vectors import VectorMath, bits_of, word

WIDTHS = {"points": 1, "turns": 4, "boxes": 2, "rays": 4, "cells": 8}
"""How many vectors a value is in each program."""

Parts = list[Value]
Emitter = Callable[..., Parts]


def _points(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return [tape_points.point(m, op, *(p[0] for p in given))]


def _turns(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    operands = [p[0] for p in given]
    value = tape_points.point(m, op, *operands)
    return [value, *tape_points.slopes(m, op, operands, value, [p[1:] for p in given])]


def _boxes(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    operands = [(p[0], p[1]) for p in given]
    found = enclosures.interval(m, op, *operands)
    if op in CHOICES:
        known = enclosures.chosen(m, operands[0]) if op == Op.CHOOSE else enclosures.choices(m, op, *operands)
        b = m.builder
        for k, mask in enumerate(known):
            place = b.add(b.mul(choice, ir.Constant(I64, 2)), ir.Constant(I64, 1 + k))
            b.store(bits_of(mask), word(b, m.state, place))
    return list(found)


def _rays(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return _sloped(m, op, given, 1)


def _cells(m: VectorMath, op: Op, given: list[Parts], choice: Any) -> Parts:
    return _sloped(m, op, given, 3)


def _sloped(m: VectorMath, op: Op, given: list[Parts], ways: int) -> Parts:
    operands = [(p[0], p[1]) for p in given]
    value = enclosures.interval(m, op, *operands)
    turns = [[(p[2 + 2 * k], p[3 + 2 * k]) for k in range(ways)] for p in given]
    slopes = enclosures.slope_intervals(m, op, operands, value, turns)
    return [*value, *(bound for slope in slopes for bound in slope)]


EMITTERS: dict[str, Emitter] = {"points": _points, "turns": _turns, "boxes": _boxes, "rays": _rays, "cells": _cells}
