"""Validates tapes: ranges, operations and operands, so that tapes run without checks."""

from __future__ import annotations

import numpy as np

from .. import ir
from ..formula.opcodes import Op, arity
from ..formula.tape import INPUTS, MOST_LIVE, Tape, most_live
from ..texture_graph import opcodes as graph_opcodes
from .check import Check

_ARITY = np.array([arity(op) for op in Op])


def validate(check: Check) -> None:
    """Every tape lies in the pools, uses only earlier values and its own finite constants, and has 1 to 4 results."""
    table, pools = check.tables["tapes"], check.tables["pools"]
    code, constants = pools["code"], pools["constants"]
    wrong = np.zeros(len(table["first"]), bool)
    densities = check.tables["media"]["density"]
    formulas = {*check.tables["geometries"]["tape"].tolist(), *check.tables["textures"]["tape"][densities[densities >= 0]].tolist()}
    for row in range(len(wrong)):
        first, count, begin, numbers, named = (int(table[name][row]) for name in _COLUMNS)
        inside = 0 <= first <= first + count <= len(code) and 0 <= begin <= begin + numbers <= len(constants) and 1 <= named <= 4
        if not inside:
            wrong[row] = True
            continue
        rows, results = code[first : first + count], table["results"][row, :named]
        if graph_opcodes.is_graph(rows, results.tolist()):
            wrong[row] = row in formulas or not (graph_opcodes.is_valid(rows, numbers, results) and _has_pictures(check, row, rows))
        else:
            wrong[row] = not _valid_code(rows, numbers, results)
    check.bad("tapes", wrong, "its code does not hold together")
    if not wrong.any():
        surfaces = set(check.tables["geometries"]["tape"].tolist())
        check.bad("tapes", np.array([row in surfaces and _too_wide(table, pools, row) for row in range(len(wrong))], bool), _TOO_WIDE)
    check.bad(
        "tapes", ~wrong & np.array([not _finite(table, constants, row) for row in range(len(wrong))], bool), "a number of it is not finite"
    )


_TOO_WIDE = f"it needs more than {MOST_LIVE} values at a time"


def _too_wide(table: dict[str, np.ndarray], pools: dict[str, np.ndarray], row: int) -> bool:
    first, count = int(table["first"][row]), int(table["count"][row])
    results = tuple(table["results"][row, : int(table["result_count"][row])].tolist())
    return count > MOST_LIVE and most_live(Tape(pools["code"][first : first + count], np.zeros(0), results)) > MOST_LIVE


def _has_pictures(check: Check, tape: int, rows: np.ndarray) -> bool:
    """Whether the look-ups of a tape of a texture name images of the table Textures."""
    table, textures = check.tables["tapes"], check.tables["textures"]
    names = rows[rows[:, 0] == graph_opcodes.Op.LOOK_UP, 3]
    pictures = check.tables["pools"]["constants"][int(table["first_constant"][tape]) + ~names]
    if not ((pictures >= 0) & (pictures < len(textures["kind"]))).all():
        return False
    return bool((textures["kind"][pictures.astype(np.int64)] == ir.TextureKind.IMAGE).all())


_COLUMNS = ("first", "count", "first_constant", "constant_count", "result_count")


def _valid_code(code: np.ndarray, numbers: int, results: np.ndarray) -> bool:
    if ((code[:, 0] < 0) | (code[:, 0] >= len(_ARITY))).any():
        return False
    used = np.arange(3) < _ARITY[code[:, 0]][:, None]
    operands = code[:, 1:]
    defined = (operands >= -numbers) & (operands < INPUTS + np.arange(len(code))[:, None])
    return bool(defined[used].all() and ((results >= -numbers) & (results < INPUTS + len(code))).all())


def _finite(table: dict[str, np.ndarray], constants: np.ndarray, row: int) -> bool:
    begin = int(table["first_constant"][row])
    return bool(np.isfinite(constants[begin : begin + int(table["constant_count"][row])]).all())
