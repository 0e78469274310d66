"""Tape: a formula as a flat list of operations, with its numbers in a table of constants, so that a new number compiles no code.

Names of values are whole numbers: 0, 1 and 2 are the coordinates x, y and z; 3 + i is the result of row i; ~k (negative) is constant k.
point_semantics.py and interval_semantics.py define the operations.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from .opcodes import Op, arity

INPUTS = 3
X, Y, Z = 0, 1, 2
MOST_LIVE = 256  # values that an evaluator holds at a time


@dataclass(frozen=True, eq=False)
class Tape:
    """A finished formula: code (n, 4) int32, constants (k,) float64, and the names of its results."""

    code: np.ndarray
    constants: np.ndarray
    results: tuple[int, ...]

    def structure(self) -> bytes:
        """A hash of the code and results, without the constants."""
        return hashlib.blake2b(self.code.tobytes() + repr(self.results).encode(), digest_size=16).digest()


def load_tape(tables: Any, row: int) -> Tape:
    """Row `row` of the table Tapes of `tables` (ir.Tables)."""
    tapes, pools = tables.tapes, tables.pools
    first, begin = int(tapes.first[row]), int(tapes.first_constant[row])
    code, constants = pools.code[first : first + int(tapes.count[row])], pools.constants[begin : begin + int(tapes.constant_count[row])]
    return Tape(code, constants, tuple(tapes.results[row, : tapes.result_count[row]].tolist()))


def most_live(tape: Tape) -> int:
    """The largest number of values that are live at a time, x, y and z among them."""
    last: dict[int, int] = {name: len(tape.code) for name in tape.results}
    for i, (op, *operands) in enumerate(tape.code.tolist()):
        for name in operands[: arity(op)]:
            last[name] = max(last.get(name, 0), i)
    ends = np.bincount([last.get(INPUTS + i, i) for i in range(len(tape.code))], minlength=len(tape.code) + 1)[: len(tape.code)]
    return INPUTS + int((np.arange(1, len(tape.code) + 1) - np.concatenate([[0], np.cumsum(ends)[:-1]])).max(initial=0))


def mark_periodic_angles(tape: Tape) -> None:
    """Replace ATAN2 by ANGLE, in place, where adding 2π to its value changes no result of the tape."""
    for i in np.flatnonzero(tape.code[:, 0] == Op.ATAN2).tolist():
        if _is_periodic(tape, INPUTS + i):
            tape.code[i, 0] = Op.ANGLE


def _is_periodic(tape: Tape, angle: int) -> bool:
    """Whether a value reaches the results through sines and cosines alone, times whole numbers."""
    share: dict[int, float] = {angle: 1.0}  # the derivative of each value by the angle
    for i, (op, *operands) in enumerate(tape.code.tolist()):
        used = operands[: arity(op)]
        if not any(name in share for name in used):
            continue
        numbers = [float(tape.constants[~name]) if name < 0 else None for name in used]
        if op in (Op.SIN, Op.COS):
            if share[used[0]] != round(share[used[0]]):
                return False
            continue
        if op in (Op.NEGATE, Op.COPY):
            slope = -share[used[0]] if op == Op.NEGATE else share[used[0]]
        elif op in (Op.ADD, Op.SUBTRACT):
            slope = share.get(used[0], 0.0) + share.get(used[1], 0.0) * (1.0 if op == Op.ADD else -1.0)
        elif op == Op.MULTIPLY and (numbers[0] is not None or numbers[1] is not None):
            constant_first = numbers[0] is not None
            slope = share[used[1] if constant_first else used[0]] * float((numbers[0] if constant_first else numbers[1]) or 0.0)
        elif op == Op.DIVIDE and numbers[1]:
            slope = share[used[0]] / numbers[1]
        else:
            return False
        share[INPUTS + i] = slope
    return not any(name in share for name in tape.results)
