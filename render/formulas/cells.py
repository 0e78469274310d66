"""Where a surface may be: a grid over its box, found by bounds of its formula, in whose cells the formula is simpler than on the whole.

A block of cells is empty where the formula's bounds have one sign, else it is cut into 4 × 4 × 4; of a minimum one of whose operands is
known to be larger everywhere in a block, only the other is evaluated there (Keeter, "Massively Parallel Rendering of Complex
Closed-Form Implicit Surfaces", SIGGRAPH 2020). A leaf knows bounds of its derivatives: a
ray along which the slope has one sign has one root in it at the most, and the values at both ends say whether.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler.tapes import CHOICES, INPUTS, Op, arity
from ..kernels import apart, helper, kernel, maker
from . import interpreter
from .calls import interpret
from .vectors import LANES, ROW

MOST_REGISTERS = 256
SPLIT = 4
CHILDREN = SPLIT**3
MOST_LEVELS = 5
SLACK = 1e-9  # of a cell, by which boxes grow: where rays enter them is rounded
BIG = 1e100
_STACK = CHILDREN * MOST_LEVELS
_WIDE = 8  # vectors of a register in the largest program
_ROOM = MOST_REGISTERS * _WIDE * LANES
_ARITY = np.array([arity(op) for op in Op], np.int64)
CHOICE = np.array([op in CHOICES for op in Op], np.int64)
COPY, CHOOSE, MIN, MAX = int(Op.COPY), int(Op.CHOOSE), int(Op.MIN), int(Op.MAX)
_BOXES, _CELLS = 2, 8  # vectors of a value


def build(
    rows: tuple[NDArray[np.int32], int],
    constants: NDArray[np.float64],
    low: NDArray[np.float64],
    cell: NDArray[np.float64],
    count: int,
    reach: float,
) -> tuple[NDArray[Any], ...]:
    """(grid, leaf_tape, leaf_size, leaf_slopes, tapes, code) of a surface; see fields.Forms. ValueError: it needs too many registers.

    `rows` are of fields.names_of; `cell` is the size of one, `low` the lowest corner, and `count` how many there are along an axis.
    """
    code, _ = rows
    choices = int(CHOICE[code[:, 0]].sum()) if len(code) else 0
    programs = np.array([interpreter.address("boxes"), interpreter.address("cells")], np.int64)
    grid = np.empty(count**3, np.int32)
    room, leaves = 64 * len(code) + 4096, 4096
    while True:
        work = (
            np.zeros((room, 4), np.int32), np.zeros((room, ROW), np.int32), np.zeros((room // 4 + 64, 4), np.int64),
            np.zeros(leaves, np.int32), np.zeros(leaves, np.int32), np.zeros((leaves, 6)),
        )  # fmt: skip
        ends = np.zeros(3, np.int64)
        state = np.zeros(1 + 2 * max(choices, 1), np.int64)
        outcome = fill(code, constants, low, cell, count, reach, programs, state, grid, *work, ends)
        if outcome == 2:
            raise ValueError(f"the formula keeps more than {MOST_REGISTERS} values at a time")
        if outcome == 0:
            break
        room, leaves = 2 * room, 2 * leaves
    tapes, used, made = ends.tolist()
    made = max(made, 1)  # kernels look up lanes that have no leaf
    _, run, table, leaf_tape, leaf_size, slopes = work
    table = np.ascontiguousarray(table[:tapes, :3])
    return grid, leaf_tape[:made].copy(), leaf_size[:made].copy(), slopes[:made].copy(), table, run[:used].copy()


@kernel
def fill(code, constants, low, cell, count, reach, programs, state, grid, names, run, tapes, leaf_tape, leaf_size, leaf_slopes, ends):
    """Write the grid, its leaves and their tapes. 0: done, 1: more room is needed, 2: more registers."""
    n = len(code)
    if n > len(names):
        return 1
    for i in range(n):
        for k in range(4):
            names[i, k] = code[i, k]
    tapes[0, 0], tapes[0, 1] = 0, n
    outcome = place(names, run, tapes, 0)
    if outcome != 0:
        return outcome
    ends[0], ends[1] = 1, n
    registers = np.empty(_ROOM)
    scratch = np.empty(3 * n + 8, np.int64)
    stack = np.empty((_STACK, 5), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3], stack[0, 4] = 0, 0, 0, count, 0
    top, known = 1, np.empty(CHILDREN, np.int64)
    while top > 0:
        top -= 1
        x, y, z, size, tape = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3], stack[top, 4]
        small = size // SPLIT
        alive = 0
        for first in range(0, CHILDREN, LANES):
            _boxes(registers, low, cell, reach, x, y, z, small, known, first, min(LANES, CHILDREN - first), False, _BOXES)
            state[0] = 0
            interpret(programs[0], run, tapes[tape, 0], tapes[tape, 1], registers, constants, 0, state, 1)
            out = tapes[tape, 2] * _BOXES * LANES
            for k in range(min(LANES, CHILDREN - first)):
                child = first + k
                least, most, maybe = registers[out + k], registers[out + LANES + k], (state[0] >> k) & 1
                if not least <= 0.0 or (most < 0.0 and maybe == 0):
                    _mark(grid, count, x, y, z, child, small, _empty(small))
                    continue
                kept = tape
                if maybe == 0:
                    kept = simplify(names, run, tapes, ends, tape, state, k, scratch)
                    if kept < 0:
                        return -kept
                known[alive] = child | (kept << 8)
                alive += 1
        for first in range(0, alive, LANES):
            few = min(LANES, alive - first)
            if small == 1:
                _boxes(registers, low, cell, reach, x, y, z, small, known, first, few, True, _CELLS)
                state[0] = 0
                interpret(programs[1], run, tapes[tape, 0], tapes[tape, 1], registers, constants, 0, state, 1)
            out = tapes[tape, 2] * _CELLS * LANES
            for k in range(few):
                child, kept = known[first + k] & 255, known[first + k] >> 8
                if small == 1:
                    leaf, maybe = ends[2], (state[0] >> k) & 1
                    if leaf >= len(leaf_tape):
                        return 1
                    leaf_tape[leaf], leaf_size[leaf] = kept, small
                    for j in range(6):
                        bound = registers[out + (2 + j) * LANES + k]
                        unknown = -BIG if j % 2 == 0 else BIG
                        leaf_slopes[leaf, j] = unknown if maybe == 1 or not abs(bound) <= BIG else bound
                    _mark(grid, count, x, y, z, child, small, leaf)
                    ends[2] += 1
                    continue
                stack[top, 0] = x + small * (child // (SPLIT * SPLIT))
                stack[top, 1] = y + small * (child // SPLIT % SPLIT)
                stack[top, 2] = z + small * (child % SPLIT)
                stack[top, 3], stack[top, 4] = small, kept
                top += 1
    return 0


@helper
def _empty(size: int) -> int:
    """What a grid holds where a block of `size` cells along an axis is empty."""
    mark = -1
    while size > 1:
        size //= SPLIT
        mark -= 1
    return mark


@helper
def _mark(grid: Any, count: int, x: int, y: int, z: int, child: int, size: int, mark: int) -> None:
    x += size * (child // (SPLIT * SPLIT))
    y += size * (child // SPLIT % SPLIT)
    z += size * (child % SPLIT)
    for i in range(x, x + size):
        for j in range(y, y + size):
            for k in range(z, z + size):
                grid[(i * count + j) * count + k] = mark


@helper
def _boxes(
    registers: Any,
    low: Any,
    cell: Any,
    reach: float,
    x: int,
    y: int,
    z: int,
    size: int,
    known: Any,
    first: int,
    few: int,
    listed: bool,
    width: int,
) -> None:
    """Set the registers of x, y and z to the boxes of children; lanes beyond repeat the last one."""
    for k in range(LANES):
        child = first + min(k, few - 1)
        if listed:
            child = known[child] & 255
        corner = (x + size * (child // (SPLIT * SPLIT)), y + size * (child // SPLIT % SPLIT), z + size * (child % SPLIT))
        for axis in range(3):
            at = axis * width * LANES + k
            slack = SLACK * cell[axis] + 4e-15 * reach
            registers[at] = low[axis] + corner[axis] * cell[axis] - slack
            registers[at + LANES] = low[axis] + (corner[axis] + size) * cell[axis] + slack
            for j in range(2, width):
                registers[at + j * LANES] = 1.0 if (j - 2) // 2 == axis else 0.0


# --- simpler tapes ------------------------------------------------------------------------------------------------------


@apart
def simplify(names, run, tapes, ends, tape, state, lane, scratch):
    """The number of the tape that lane `lane` of the last evaluation needs; −1 or −2 where there is no room for it (see `fill`)."""
    first, n = tapes[tape, 0], tapes[tape, 1]
    for i in range(n):  # scratch[i]: whether row i is needed; 2 where it is but one of its operands
        scratch[i] = 0
    scratch[n - 1] = 1
    visited, dropped = 0, 0
    for i in range(n - 1, -1, -1):
        if scratch[i] == 0:
            continue
        op = names[first + i, 0]
        scratch[2 * n + visited] = i
        visited += 1
        column = 0
        if CHOICE[op] == 1:
            choice = run[first + i, 5]
            one, two = (state[1 + 2 * choice] >> lane) & 1, (state[2 + 2 * choice] >> lane) & 1
            if one == 1 or two == 1:
                column = (1 if one == 1 else 2) + (1 if op == CHOOSE else 0)
        if column > 0:
            name = np.int64(names[first + i, column])
            scratch[i], scratch[n + i] = 2, name
            dropped += 1
            if name >= INPUTS:
                scratch[name - INPUTS] = 1
            continue
        for k in range(_ARITY[op]):
            name = np.int64(names[first + i, 1 + k])
            if name >= INPUTS:
                scratch[name - INPUTS] = 1
    if dropped == 0:
        return tape
    number, begin = ends[0], ends[1]
    if begin + visited + 1 > len(names) or number >= len(tapes):
        return -1
    count = 0
    for place_ in range(visited - 1, -1, -1):  # scratch[n + i]: the row's new name
        i = scratch[2 * n + place_]
        if scratch[i] == 2:
            scratch[n + i] = _renamed(scratch, n, scratch[n + i])
            continue
        op = names[first + i, 0]
        names[begin + count, 0] = op
        for k in range(3):
            names[begin + count, 1 + k] = _renamed(scratch, n, np.int64(names[first + i, 1 + k])) if k < _ARITY[op] else 0
        scratch[n + i] = INPUTS + count
        count += 1
    result = scratch[n + n - 1]
    if result < INPUTS:
        names[begin, 0], names[begin, 1], names[begin, 2], names[begin, 3] = COPY, result, 0, 0
        count = 1
    same = _known(names, tapes, number, begin, count)
    if same >= 0:
        return same
    tapes[number, 0], tapes[number, 1] = begin, count
    outcome = place(names, run, tapes, number)
    if outcome != 0:
        return -outcome
    ends[0], ends[1] = number + 1, begin + count
    return number


@helper
def _renamed(scratch: Any, n: int, name: int) -> int:
    return scratch[n + name - INPUTS] if name >= INPUTS else name


@helper
def _known(names: Any, tapes: Any, number: int, begin: int, count: int) -> int:
    """An equal tape among the last ones made, or −1; sets tapes[number, 3], a hash."""
    mixed = np.int64(count)
    for i in range(begin, begin + count):
        for k in range(4):
            mixed = (mixed * 1000003) ^ np.int64(names[i, k])
    tapes[number, 3] = mixed
    for other in range(number - 1, max(-1, number - 1025), -1):
        if tapes[other, 3] == mixed and tapes[other, 1] == count:
            equal = True
            for i in range(count):
                for k in range(4):
                    equal = equal and names[tapes[other, 0] + i, k] == names[begin + i, k]
            if equal:
                return other
    return -1


@maker
def place(names, run, tapes, tape):
    """Give each value of a tape a register, and write its rows as interpreters read them. 0, or 2 where there are too few registers."""
    first, n = tapes[tape, 0], tapes[tape, 1]
    last, register = np.full(n, n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        for k in range(_ARITY[names[first + i, 0]]):
            name = names[first + i, 1 + k]
            if name >= INPUTS:
                last[name - INPUTS] = i
    free, frees, used, choice = np.empty(MOST_REGISTERS, np.int64), 0, INPUTS, 0
    for i in range(n):
        op = names[first + i, 0]
        run[first + i, 0] = op
        for k in range(3):
            run[first + i, 2 + k] = 0
        for k in range(_ARITY[op]):
            name = names[first + i, 1 + k]
            run[first + i, 2 + k] = register[name - INPUTS] if name >= INPUTS else name
        for k in range(_ARITY[op]):
            name = names[first + i, 1 + k]
            if name >= INPUTS and last[name - INPUTS] == i:
                free[frees] = register[name - INPUTS]
                frees += 1
                last[name - INPUTS] = -1  # once, where both operands are the same
        if frees > 0:
            frees -= 1
            register[i] = free[frees]
        else:
            if used >= MOST_REGISTERS:
                return 2
            register[i] = used
            used += 1
        run[first + i, 1] = register[i]
        run[first + i, 5] = choice
        choice += CHOICE[op]
    tapes[tape, 2] = register[n - 1]
    _mark_extremes(names, run, first, n, last)
    return 0


@helper
def _mark_extremes(names: Any, run: Any, first: int, n: int, inner: Any) -> None:
    """Set run[:, 6] of those minima and maxima that go into nothing but minima and maxima, up to the result."""
    for i in range(n):
        inner[i] = 1
    for i in range(n - 1, -1, -1):
        op = names[first + i, 0]
        chooses = inner[i] == 1 and op in (MIN, MAX)
        run[first + i, 6] = 1 if chooses else 0
        if not chooses:
            for k in range(_ARITY[op]):
                name = names[first + i, 1 + k]
                if name >= INPUTS:
                    inner[name - INPUTS] = 0
