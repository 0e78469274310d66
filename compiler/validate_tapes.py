"""The validator's checks of tapes: their ranges, operations and operands, so that whoever runs one can trust it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .tapes import INPUTS, Op, arity

if TYPE_CHECKING:
    from .validate import Check

_ARITY = np.array([arity(op) for op in Op])


def validate(check: Check) -> None:
    """Every tape lies in the pools, its rows use earlier values and its own finite constants, and it has 1 to 4 results."""
    table, pools = check.tables["tapes"], check.tables["pools"]
    code, constants = pools["code"], pools["constants"]
    wrong = np.zeros(len(table["first"]), bool)
    for row in range(len(wrong)):
        first, count, begin, numbers, named = (int(table[name][row]) for name in _COLUMNS)
        inside = 0 <= first <= first + count <= len(code) and 0 <= begin <= begin + numbers <= len(constants) and 1 <= named <= 4
        wrong[row] = not inside or not _sound(code[first : first + count], numbers, table["results"][row, :named])
    check.bad("tapes", wrong, "its code does not hold together")
    check.bad(
        "tapes", ~wrong & np.array([not _finite(table, constants, row) for row in range(len(wrong))], bool), "a number of it is not finite"
    )


_COLUMNS = ("first", "count", "first_constant", "constant_count", "result_count")


def _sound(code: np.ndarray, numbers: int, results: np.ndarray) -> bool:
    if ((code[:, 0] < 0) | (code[:, 0] >= len(_ARITY))).any():
        return False
    used = np.arange(3) < _ARITY[code[:, 0]][:, None]
    operands = code[:, 1:]
    there = (operands >= -numbers) & (operands < INPUTS + np.arange(len(code))[:, None])
    return bool(there[used].all() and ((results >= -numbers) & (results < INPUTS + len(code))).all())


def _finite(table: dict[str, np.ndarray], constants: np.ndarray, row: int) -> bool:
    begin = int(table["first_constant"][row])
    return bool(np.isfinite(constants[begin : begin + int(table["constant_count"][row])]).all())
