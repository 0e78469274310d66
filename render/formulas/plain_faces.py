"""The faces where formulas jump, for the definition: what a jump is taken of, whose level the face is."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.enclosures import operand
from ...compiler.tape_points import NumpyMath, point, slopes
from ...compiler.tapes import Op, Tape, arity


def faces(tape: Tape, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(3, n) gradients of what makes a tape jump between points (3, n) next to each other; nan where nothing jumps.

    That is what a floor or a sign is taken of, a choice made by, or an angle's cut counted from: the face there is a level of it.
    """
    m = NumpyMath()
    both: list[Any] = [np.stack([np.asarray(before[k], np.float64), np.asarray(after[k], np.float64)]) for k in range(3)]
    shape = both[0].shape
    turns: list[list[Any]] = [[np.full(shape, float(k == n)) for n in range(3)] for k in range(3)]
    found = np.full((3, shape[1]), np.nan)
    still = [np.zeros(shape)] * 3
    with np.errstate(all="ignore"):
        for op, *operands in tape.code.tolist():
            names = operands[: arity(op)]
            given, ways = [operand(tape, both, name) + still[0] for name in names], [turns[name] if name >= 0 else still for name in names]
            jumped = _side(op, given)
            if jumped is not None:
                of = slopes(m, Op.DIVIDE, given, given[0] / given[1], ways) if op == Op.MOD else ways[0]
                fresh = (jumped[0] != jumped[1]) & np.isnan(found[0])
                found = np.where(fresh, np.stack([np.broadcast_to(turn, shape)[1] for turn in of]), found)
            value = point(m, op, *given)
            turns.append(slopes(m, op, given, value, ways))
            both.append(value)
    return found


def _side(op: int, given: list[Any]) -> Any:
    """Which step of an operation that jumps it is on; None of others."""
    match op:
        case Op.FLOOR | Op.CEIL:
            return np.floor(given[0]) if op == Op.FLOOR else np.ceil(given[0])
        case Op.MOD:
            return np.floor(given[0] / given[1])
        case Op.SIGN:
            return np.sign(given[0])
        case Op.CHOOSE:
            return given[0] <= 0.0
        case Op.ATAN2:
            return np.signbit(given[0]) & (given[1] < 0.0)
    return None
