"""Where a surface may be: a grid over its box, found by bounds of its formula, in whose cells the formula is simpler than on the whole.

A block of cells is empty where the formula's bounds have one sign, else it is cut into 4 × 4 × 4, when the first ray comes to it; of a
minimum one of whose operands is known to be larger everywhere in a block, only the other is evaluated there (Keeter, "Massively Parallel
Rendering of Complex Closed-Form Implicit Surfaces", SIGGRAPH 2020). A cell that is not empty is a leaf, which knows bounds of its
derivatives: a ray along which the slope has one sign has one root in it at the most, and the values at both ends say whether.

What a grid holds of a cell: the number of its leaf; −1, −2, −3 where the block of 1, 4, 16 cells along an axis around it is empty;
PENDING − n where block n around it is yet to be cut. What comes out does not depend on which ray, or thread, came first.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiler.formula.opcodes import CHOICES, Op, arity
from ...compiler.formula.point_semantics import NumpyMath
from ...compiler.formula.tape import INPUTS, MOST_LIVE
from ..jit.kernel import allocating_helper, helper, kernel, noinline_helper
from ..simd.atomics import fetch_add, store_release, try_claim
from .evaluator_calls import interpret
from .llvm_math import LANES, ROW
from .op_codegen import SCALE
from .tables import END_BLOCKS, END_LEAVES, END_ROWS, END_TAPES

MOST_REGISTERS = MOST_LIVE
SPLIT = 4
CHILDREN = SPLIT**3
PENDING = -16
SLACK = 1e-9  # of a cell, by which boxes grow: where rays enter them is rounded
OVER = 2.0**-40 + 4e-15  # of the largest coordinate, by which they do besides: see search.py
BIG, LARGEST = NumpyMath.most, NumpyMath.big
_WIDE = 8  # vectors of a register in the largest program
_ROOM = MOST_REGISTERS * _WIDE * LANES
_ARITY = np.array([arity(op) for op in Op], np.int64)
CHOICE = np.array([op in CHOICES for op in (*Op, SCALE)], np.int64)
COPY, CHOOSE, MIN, MAX, MULTIPLY = int(Op.COPY), int(Op.CHOOSE), int(Op.MIN), int(Op.MAX), int(Op.MULTIPLY)
_BOXES, _CELLS = 2, 8  # vectors of a value
_BOXES_AT, _CELLS_AT = 2, 4  # places in fields.PROGRAMS


@noinline_helper
def ensure_block(forms, k, number):
    """Cut block `number` of surface k up, unless it is; where another thread is about to, wait for it."""
    while True:
        was = try_claim(forms.states, number)
        if was == 2:
            return
        if was == 0:
            _cut(forms, k, number)
            store_release(forms.states, number)
            return


class _Block(NamedTuple):
    """A block while it is cut up: the place and size of its parts, its tape, and memory; see `simplify`."""

    corner: tuple[int, int, int]
    small: int
    whole: int
    names: Any
    run: Any
    tapes: Any
    ends: Any
    scratch: Any
    state: Any
    registers: Any
    known: Any  # (CHILDREN, 2) parts that may hold a part of the surface, and their tapes


@allocating_helper
def _cut(forms, k, number):
    """Write what is in a block's 64 parts to the grid: leaves where these are cells, else blocks, with the tapes that they need."""
    x, y, z, size, whole = (
        forms.blocks[number, 0], forms.blocks[number, 1], forms.blocks[number, 2], forms.blocks[number, 3], forms.blocks[number, 4]
    )  # fmt: skip
    rows = forms.tapes[whole, 1]
    names, run = np.empty(((CHILDREN + 1) * (rows + 1), 4), np.int32), np.empty(((CHILDREN + 1) * (rows + 1), ROW), np.int32)
    tapes, ends, scratch = np.zeros((CHILDREN + 1, 4), np.int64), np.zeros(2, np.int64), np.empty(3 * rows + 8, np.int64)
    choices = _copied(forms, whole, names, run)
    tapes[0, 1], tapes[0, 2] = rows, forms.tapes[whole, 2]
    ends[0], ends[1] = 1, rows
    block = _Block(
        (x, y, z), size // SPLIT, whole, names, run, tapes, ends, scratch, np.zeros(1 + 2 * (choices + 1), np.int64), np.empty(_ROOM),
        np.empty((CHILDREN, 2), np.int64),
    )  # fmt: skip
    alive = _occupied(forms, k, block)
    made, placed = _kept(forms, whole, rows, names, run, tapes, ends)
    for i in range(alive):  # from here on the numbers of tapes are those of the grid
        kept = block.known[i, 1]
        block.known[i, 1] = made + kept - 1 if kept > 0 and placed else whole
    if block.small > 1:
        _as_blocks(forms, k, block, alive)
    else:
        _as_leaves(forms, k, block, alive)


@noinline_helper
def _occupied(forms, k, block):
    """How many parts may hold a part of the surface, which `known` lists with their tapes; the others are marked empty."""
    alive = 0
    for first in range(0, CHILDREN, LANES):
        few = min(LANES, CHILDREN - first)
        out = _bounded(forms, k, block, first, few, False, _BOXES, _BOXES_AT)
        for lane in range(few):
            least, most, maybe = block.registers[out + lane], block.registers[out + LANES + lane], (block.state[0] >> lane) & 1
            if not least <= 0.0 or (most < 0.0 and maybe == 0):
                _mark(forms, k, block, first + lane, _empty(block.small))
                continue
            block.known[alive, 0], block.known[alive, 1] = first + lane, 0
            if maybe == 0:
                found = simplify(block.names, block.run, block.tapes, block.ends, 0, block.state, lane, block.scratch)
                block.known[alive, 1] = max(found, 0)
            alive += 1
    return alive


@helper
def _as_blocks(forms: Any, k: int, block: _Block, alive: int) -> None:
    """Put the parts to what is cut up when a ray comes to it."""
    first, (x, y, z), small = fetch_add(forms.ends, END_BLOCKS, alive), block.corner, block.small
    for i in range(alive):
        child, number = block.known[i, 0], first + i
        forms.blocks[number, 0] = x + small * (child // (SPLIT * SPLIT))
        forms.blocks[number, 1] = y + small * (child // SPLIT % SPLIT)
        forms.blocks[number, 2] = z + small * (child % SPLIT)
        forms.blocks[number, 3], forms.blocks[number, 4] = small, block.known[i, 1]
        _mark(forms, k, block, child, PENDING - number)


@noinline_helper
def _as_leaves(forms, k, block, alive):
    """Put the parts, which are cells, to the leaves, with bounds of their derivatives."""
    first_leaf = fetch_add(forms.ends, END_LEAVES, alive)
    for first in range(0, alive, LANES):
        few = min(LANES, alive - first)
        out = _bounded(forms, k, block, first, few, True, _CELLS, _CELLS_AT)
        for lane in range(few):
            leaf = first_leaf + first + lane
            forms.leaf_tape[leaf] = block.known[first + lane, 1]
            finite = abs(block.registers[out + lane]) < LARGEST and abs(block.registers[out + LANES + lane]) < LARGEST
            sure = (block.state[0] >> lane) & 1 == 0 and finite  # ∞ − ∞ has no slope
            for j in range(3):
                least, most = block.registers[out + (2 + 2 * j) * LANES + lane], block.registers[out + (3 + 2 * j) * LANES + lane]
                known = sure and abs(least) < LARGEST and abs(most) < LARGEST
                forms.leaf_slopes[leaf, 2 * j], forms.leaf_slopes[leaf, 2 * j + 1] = (least, most) if known else (-BIG, BIG)
    fetch_add(forms.ends, END_LEAVES, 0)  # what leaves are is written before the grid says so
    for i in range(alive):
        _mark(forms, k, block, block.known[i, 0], first_leaf + i)


@helper
def _bounded(forms: Any, k: int, block: _Block, first: int, few: int, listed: bool, width: int, program: int) -> int:
    """Ask a program for bounds over parts `first` on, of all or of those that `known` lists; where in the registers they are."""
    _boxes(block.registers, forms.numbers, k, forms.places[k, 0], block, first, few, listed, width)
    block.state[0] = 0
    rows = block.tapes[0, 1]
    interpret(forms.programs[program], block.run, 0, rows, block.registers, forms.constants, forms.places[k, 3], block.state, 1)
    return block.tapes[0, 2] * width * LANES


@helper
def _copied(forms: Any, tape: int, names: Any, run: Any) -> Any:
    """Copy a tape's rows to the beginning; how many choices they have."""
    first, choices = forms.tapes[tape, 0], 0
    for i in range(forms.tapes[tape, 1]):
        for c in range(4):
            names[i, c] = forms.names[first + i, c]
        for c in range(ROW):
            run[i, c] = forms.code[first + i, c]
        choices += CHOICE[names[i, 0]]
    return choices


@helper
def _kept(forms: Any, whole: int, rows: int, names: Any, run: Any, tapes: Any, ends: Any) -> tuple[int, bool]:
    """Put new tapes to the others: (number of the first one, whether there was room for them)."""
    many, length = ends[0] - 1, ends[1] - rows
    made, begin = fetch_add(forms.ends, END_TAPES, many), fetch_add(forms.ends, END_ROWS, length)
    if made + many > len(forms.tapes) or begin + length > len(forms.names):
        return whole, False
    for i in range(length):
        for c in range(4):
            forms.names[begin + i, c] = names[rows + i, c]
        for c in range(ROW):
            forms.code[begin + i, c] = run[rows + i, c]
    for i in range(many):
        forms.tapes[made + i, 0] = tapes[1 + i, 0] - rows + begin
        forms.tapes[made + i, 1], forms.tapes[made + i, 2] = tapes[1 + i, 1], tapes[1 + i, 2]
    return made, True


@helper
def _empty(size: int) -> int:
    """What a grid holds where a block of `size` cells along an axis is empty."""
    mark = -1
    while size > 1:
        size //= SPLIT
        mark -= 1
    return mark


@helper
def _mark(forms: Any, k: int, block: _Block, child: int, mark: int) -> None:
    """Write what is in a part to the grid."""
    count, begin, (x, y, z), size = forms.places[k, 0], forms.places[k, 2], block.corner, block.small
    x += size * (child // (SPLIT * SPLIT))
    y += size * (child // SPLIT % SPLIT)
    z += size * (child % SPLIT)
    for i in range(x, x + size):
        for j in range(y, y + size):
            for c in range(z, z + size):
                forms.grid[begin + (i * count + j) * count + c] = mark


@helper
def _boxes(registers: Any, numbers: Any, k: int, count: int, block: _Block, first: int, few: int, listed: bool, width: int) -> None:
    """Set the registers of x, y and z to the boxes of parts; lanes beyond repeat the last one."""
    (x, y, z), size = block.corner, block.small
    for lane in range(LANES):
        child = first + min(lane, few - 1)
        if listed:
            child = block.known[child, 0]
        corner = (x + size * (child // (SPLIT * SPLIT)), y + size * (child // SPLIT % SPLIT), z + size * (child % SPLIT))
        for axis in range(3):
            at = axis * width * LANES + lane
            low, cell = numbers[k, axis], (numbers[k, 3 + axis] - numbers[k, axis]) / count
            slack = SLACK * cell + OVER * numbers[k, 13]
            registers[at] = low + corner[axis] * cell - slack
            registers[at + LANES] = low + (corner[axis] + size) * cell + slack
            for j in range(2, width):
                registers[at + j * LANES] = 1.0 if (j - 2) // 2 == axis else 0.0


# --- simpler tapes ------------------------------------------------------------------------------------------------------


@noinline_helper
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


@allocating_helper
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
        one, other = run[first + i, 2], run[first + i, 3]
        if op == MULTIPLY and (one < 0) != (other < 0):
            run[first + i, 0], run[first + i, 2], run[first + i, 3] = SCALE, max(one, other), min(one, other)
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


@kernel
def placed(names, run, tapes, tape):
    """`place`, for what is no kernel."""
    return place(names, run, tapes, tape)


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
