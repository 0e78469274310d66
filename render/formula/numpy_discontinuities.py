"""The faces where formulas jump or end, for the definition: what a jump or a root is taken of, whose level the face is."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler.formula.numpy_interpreter import gradients
from ...compiler.formula.point_semantics import NumpyMath, slopes
from ...compiler.formula.tape import Op, Tape


def faces(tape: Tape, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(3, n) gradients of what makes a tape jump or end between points (3, n) next to each other; nan where nothing does.

    That is what a floor or a sign is taken of, a choice made by, or an angle's cut counted from, or what a root or a logarithm is taken
    of where it ends: the face there is a level of it.
    """
    shape = np.shape(before[0])
    found = np.full((3, *shape), np.nan)

    def look(op: int, given: list[Any], ways: list[list[Any]]) -> None:
        step = _side(op, given)
        if step is not None:
            of = slopes(NumpyMath(), Op.DIVIDE, given, given[0] / given[1], ways) if op == Op.MOD else ways[0]
            fresh = (step[0] != step[1]) & np.isnan(found[0])
            np.copyto(found, np.stack([np.broadcast_to(turn, (2, *shape))[1] for turn in of]), where=fresh)

    gradients(tape, *np.stack([before, after], axis=1), look=look)
    return found


def _side(op: int, given: list[Any]) -> Any:
    """Which step of an operation that jumps it is on, or whether one that ends is defined; None of others."""
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
        case Op.SQRT | Op.POWER:
            return given[0] < 0.0
        case Op.LOG:
            return given[0] <= 0.0
        case Op.ASIN | Op.ACOS:
            return np.abs(given[0]) > 1.0
    return None
