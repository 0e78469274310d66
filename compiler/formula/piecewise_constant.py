"""Piecewise-constant analysis: the values that an operation may have over a whole region.

Steps (floor, ceil, sign) and plateaus of minima and maxima are constant over regions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from .opcodes import STEPS, Op, fold

Values = frozenset[float] | None  # values that are constant over regions; None: unknown ones
NOWHERE: frozenset[float] = frozenset()
MOST_VALUES = 16  # beyond it the set is None


def union(first: Values, second: Values) -> Values:
    """The values of either set."""
    return None if first is None or second is None or len(first | second) > MOST_VALUES else first | second


def constant_values(op: int, operands: Sequence[Values]) -> Values:
    """The constant values of an operation, from those of its operands. A constant has one; CHOOSE passes its two branches."""
    if op in STEPS:
        return None
    if op in (Op.MIN, Op.MAX, Op.CHOOSE):
        values: Values = NOWHERE
        for operand in operands:
            values = union(values, operand)
        return values
    if all(operand is None or operand for operand in operands):
        return _combinations(op, operands)
    factors = operands if op == Op.MULTIPLY else operands[:1] if op == Op.DIVIDE else ()  # 0 times anything is 0
    if any(operand is None for operand in factors):
        return None
    return frozenset({0.0}) if any(operand is not None and 0.0 in operand for operand in factors) else NOWHERE


def _combinations(op: int, operands: Sequence[Values]) -> Values:
    sets = [operand for operand in operands if operand is not None]
    if len(sets) < len(operands) or math.prod(len(operand) for operand in sets) > MOST_VALUES:
        return None
    results = (fold(Op(op), *numbers) for numbers in itertools.product(*sets))
    return frozenset(number + 0.0 for number in results if math.isfinite(number))
