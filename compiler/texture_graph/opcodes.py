"""Names and operations that tapes of texture graphs have beside those of formulas (compiler/formula/tape.py).

A name from U on is a number of the surface point. Operations from PERLIN2 on are MaterialX's noise (noise.py). LOOK_UP is a row
(LOOK_UP, s, t, ~k): constant k is the row of an image of the table Textures; its result is red, and three CHANNEL rows after it hold
green, blue and alpha.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from ..formula import opcodes as formula_opcodes
from ..formula.tape import INPUTS, Tape

MOST_ROWS = 2040  # of a tape
U, V, NORMAL_X, NORMAL_Y, NORMAL_Z = range(2048, 2053)  # the normal in the frame of the instance
STREAMS = (U, V, NORMAL_X, NORMAL_Y, NORMAL_Z)
REGISTERS = STREAMS[-1] + 1
FIRST = 64  # number of the first operation


class Op(IntEnum):
    """Operations of texture graphs alone. R, G and B are the channels of a noise of three numbers."""

    PERLIN2 = FIRST  # of a and b
    PERLIN2_R = 65
    PERLIN2_G = 66
    PERLIN2_B = 67
    PERLIN3 = 68
    PERLIN3_R = 69
    PERLIN3_G = 70
    PERLIN3_B = 71
    CELL1 = 72
    CELL2 = 73
    CELL3 = 74
    CELL4_0 = 75  # of the cell (a, b, c, 0)
    CELL4_1 = 76
    CELL4_2 = 77
    LOOK_UP = 78
    CHANNEL = 79


_ARITIES = {Op.PERLIN3: 3, Op.PERLIN3_R: 3, Op.PERLIN3_G: 3, Op.PERLIN3_B: 3, Op.CELL1: 1, Op.CELL3: 3, Op.CELL4_0: 3, Op.CELL4_1: 3,
            Op.CELL4_2: 3, Op.LOOK_UP: 3, Op.CHANNEL: 0}  # fmt: skip
CHANNELS = 4  # rows of a look-up


def arity(op: int) -> int:
    """The number of operands of an operation."""
    return formula_opcodes.arity(op) if op < FIRST else _ARITIES.get(Op(op), 2)


def is_graph(code: np.ndarray, results: Sequence[int]) -> bool:
    """Whether a tape has an operation or a name of texture graphs alone."""
    return bool((code[:, 0] >= FIRST).any() or (code[:, 1:] >= U).any()) or max(results, default=0) >= U


def reads_coordinates(tape: Tape) -> bool:
    """Whether a tape reads u or v."""
    names = [name for op, *operands in tape.code.tolist() for name in operands[: arity(op)]]
    return not {U, V}.isdisjoint([*names, *tape.results])


def is_valid(code: np.ndarray, numbers: int, results: np.ndarray) -> bool:
    """Whether the operations of a tape are known, and its operands are defined before they are used."""
    if len(code) > MOST_ROWS or not np.isin(code[:, 0], _KNOWN).all():
        return False
    used = np.arange(3) < np.array([arity(op) for op in code[:, 0].tolist()], np.int64).reshape(-1, 1)
    operands = code[:, 1:]
    streams = (operands >= U) & (operands < REGISTERS)
    defined = streams | ((operands >= -numbers) & (operands < INPUTS + np.arange(len(code))[:, None]))
    named = ((results >= U) & (results < REGISTERS)) | ((results >= -numbers) & (results < INPUTS + len(code)))
    return bool(defined[used].all() and named.all() and _looks_up(code))


_KNOWN = np.array([*formula_opcodes.Op, *Op])


def _looks_up(code: np.ndarray) -> bool:
    """Whether a constant names the image of each look-up, and its channels follow."""
    rows = np.flatnonzero(code[:, 0] == Op.LOOK_UP)
    channels = np.flatnonzero(code[:, 0] == Op.CHANNEL)
    follow = (rows[:, None] + np.arange(1, CHANNELS)).ravel()
    return bool((code[rows, 3] < 0).all() and np.array_equal(channels, follow))
