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


def union(one: Values, other: Values) -> Values:
    """The values of either set."""
    return None if one is None or other is None or len(one | other) > MOST_VALUES else one | other


def constant_values(op: int, operands: Sequence[Values]) -> Values:
    """The constant values of an operation, from those of its operands. A constant has one; CHOOSE passes its two branches."""
    if op in STEPS:
        return None
    if op in (Op.MIN, Op.MAX, Op.CHOOSE):
        found: Values = NOWHERE
        for one in operands:
            found = union(found, one)
        return found
    if all(one is None or one for one in operands):
        return _combinations(op, operands)
    factors = operands if op == Op.MULTIPLY else operands[:1] if op == Op.DIVIDE else ()  # 0 times anything is 0
    if any(one is None for one in factors):
        return None
    return frozenset({0.0}) if any(one is not None and 0.0 in one for one in factors) else NOWHERE


def _combinations(op: int, operands: Sequence[Values]) -> Values:
    known = [one for one in operands if one is not None]
    if len(known) < len(operands) or math.prod(len(one) for one in known) > MOST_VALUES:
        return None
    found = (fold(Op(op), *numbers) for numbers in itertools.product(*known))
    return frozenset(number + 0.0 for number in found if math.isfinite(number))
