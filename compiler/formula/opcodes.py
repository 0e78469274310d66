"""The operations that tapes have, and what they give for plain numbers."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

from ...lang.noise import noise


class Op(IntEnum):
    """The operations. Rows hold (op, a, b, c); operands that an operation does not have are 0."""

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
    ANGLE = 22  # atan2 whose multiples only go into sines and cosines, so that its cut cannot be seen
    FLOOR = 23
    CEIL = 24
    MOD = 25  # a − b ⌊a / b⌋
    SIGN = 26
    NOISE = 27
    CHOOSE = 28  # b where a ≤ 0, else c
    FILLET = 29  # MIN of a and b, its inner edge filled by an arc of radius c: c − √((c − a)² + (c − b)²) where both are below c
    CUBE = 30  # a a a: what rises everywhere, which a product with a square would not tell


UNARY = frozenset({
    Op.COPY, Op.NEGATE, Op.ABS, Op.SQUARE, Op.SQRT, Op.EXP, Op.LOG, Op.SIN, Op.COS, Op.TAN, Op.ASIN, Op.ACOS, Op.ATAN, Op.FLOOR, Op.CEIL,
    Op.SIGN, Op.CUBE,
})  # fmt: skip
TERNARY = frozenset({Op.NOISE, Op.CHOOSE, Op.FILLET})
CHOICES = frozenset({Op.MIN, Op.MAX, Op.CHOOSE, Op.FILLET})  # of whose operands one may be known not to matter
COMMUTES = frozenset({Op.ADD, Op.MULTIPLY, Op.HYPOT})
STEPS = frozenset({Op.FLOOR, Op.CEIL, Op.SIGN})  # whole numbers, of anything
KEEP_WHOLE = frozenset({
    Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.NEGATE, Op.ABS, Op.SQUARE, Op.CUBE, Op.MIN, Op.MAX, Op.MOD, Op.CHOOSE,
})  # fmt: skip


def arity(op: int) -> int:
    """How many operands an operation has."""
    return _ARITIES[op]


_ARITIES = tuple(1 if op in UNARY else 3 if op in TERNARY else 2 for op in Op)


def fold(op: Op, *numbers: float) -> float:
    """An operation on plain numbers; nan where it is not defined, or infinite."""
    try:
        return float(_FOLD[op](*numbers))
    except (ArithmeticError, ValueError):
        return math.nan


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
    Op.FILLET: lambda a, b, c: c - math.hypot(c - a, c - b) if a < c and b < c else min(a, b),
}  # fmt: skip
