"""Opcodes of tapes, and constant folding."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

from ...lang.noise import noise


class Op(IntEnum):
    """Opcodes. Rows are (op, a, b, c); missing operands are 0."""

    COPY = 0
    ADD = 1
    SUBTRACT = 2
    MULTIPLY = 3
    DIVIDE = 4
    NEGATE = 5
    ABS = 6
    SQUARE = 7
    SQRT = 8
    HYPOT = 9
    MIN = 10  # the other operand where one is undefined
    MAX = 11  # undefined where either operand is
    EXP = 12
    LOG = 13
    POWER = 14
    SIN = 15
    COS = 16
    TAN = 17
    ASIN = 18
    ACOS = 19
    ATAN = 20
    ATAN2 = 21
    ANGLE = 22  # atan2 that reaches results through sines and cosines alone: its branch cut does not matter
    FLOOR = 23
    CEIL = 24
    MOD = 25  # a − b ⌊a / b⌋
    SIGN = 26
    NOISE = 27
    CHOOSE = 28  # b where a ≤ 0, else c
    ARC = 29  # length of the shortest vector with components of at least a and b along unit vectors of cosine c (point_semantics.arc)
    CUBE = 30  # a a a: increasing, with tighter bounds than a product with a square
    QUARTER_ARC = 31  # ARC of the cosine 0: the larger operand where one is not positive, else √(a² + b²)


UNARY = frozenset({
    Op.COPY, Op.NEGATE, Op.ABS, Op.SQUARE, Op.SQRT, Op.EXP, Op.LOG, Op.SIN, Op.COS, Op.TAN, Op.ASIN, Op.ACOS, Op.ATAN, Op.FLOOR, Op.CEIL,
    Op.SIGN, Op.CUBE,
})  # fmt: skip
TERNARY = frozenset({Op.NOISE, Op.CHOOSE, Op.ARC})
CHOICES = frozenset({Op.MIN, Op.MAX, Op.CHOOSE, Op.ARC, Op.QUARTER_ARC})  # one operand may be irrelevant over a box
ARCS = frozenset({Op.ARC, Op.QUARTER_ARC})
COMMUTES = frozenset({Op.ADD, Op.MULTIPLY, Op.HYPOT})
STEPS = frozenset({Op.FLOOR, Op.CEIL, Op.SIGN})  # integers for any operand
KEEP_WHOLE = frozenset({
    Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.NEGATE, Op.ABS, Op.SQUARE, Op.CUBE, Op.MIN, Op.MAX, Op.MOD, Op.CHOOSE,
})  # fmt: skip


def arity(op: int) -> int:
    """The number of operands of an operation."""
    return _ARITIES[op]


_ARITIES = tuple(1 if op in UNARY else 3 if op in TERNARY else 2 for op in Op)


def fold(op: Op, *numbers: float) -> float:
    """An operation on numbers; NaN where it is undefined or raises."""
    try:
        return float(_FOLD[op](*numbers))
    except (ArithmeticError, ValueError):
        return math.nan


LEAST_COSINE = -math.sqrt(0.75)
"""ARC takes smaller cosines as this one: below it the shortest vector is more than 3.9 times as long as its components."""


def arc(a: float, b: float, cosine: float = 0.0) -> float:
    """ARC of numbers."""
    cosine, (small, large) = min(max(cosine, LEAST_COSINE), 1.0), sorted((a, b))
    rise = small - cosine * large
    return math.hypot(large, rise / math.sqrt(1.0 - cosine * cosine)) if rise > 0.0 else large


def _angle(y: float, x: float) -> float:
    return math.atan2(y + 0.0, x + 0.0)  # −0 is 0


_FOLD: dict[Op, Any] = {
    Op.COPY: lambda a: a, Op.ADD: lambda a, b: a + b, Op.SUBTRACT: lambda a, b: a - b, Op.MULTIPLY: lambda a, b: a * b,
    Op.DIVIDE: lambda a, b: a / b, Op.NEGATE: lambda a: -a, Op.ABS: abs, Op.SQUARE: lambda a: a * a, Op.SQRT: math.sqrt,
    Op.CUBE: lambda a: a * a * a,
    Op.HYPOT: math.hypot, Op.MIN: min, Op.MAX: max, Op.EXP: math.exp, Op.LOG: math.log, Op.POWER: math.pow,
    Op.SIN: math.sin, Op.COS: math.cos, Op.TAN: math.tan, Op.ASIN: math.asin, Op.ACOS: math.acos, Op.ATAN: math.atan,
    Op.ATAN2: _angle, Op.ANGLE: _angle, Op.FLOOR: math.floor, Op.CEIL: math.ceil, Op.MOD: lambda a, b: a - b * math.floor(a / b),
    Op.SIGN: lambda a: 0.0 if a == 0 else math.copysign(1.0, a), Op.NOISE: noise, Op.CHOOSE: lambda a, b, c: b if a <= 0 else c,
    Op.ARC: arc, Op.QUARTER_ARC: arc,
}  # fmt: skip
