"""Sparse grid of cells over a surface's box, classified by interval bounds, with a simplified tape for each cell.

A block of cells is empty where the formula's bounds have one sign. Other blocks are cut into 4 × 4 × 4 parts when the first ray reaches
them. If one operand of a minimum is larger everywhere in a block, the block's tape evaluates only the other operand. (Keeter, "Massively
Parallel Rendering of Complex Closed-Form Implicit Surfaces", SIGGRAPH 2020.) A cell that is not empty is a leaf with bounds of its
derivatives: a ray whose slope has one sign has at most one root in it, and the values at both ends tell whether.

A grid element holds the number of its leaf; −1, −2, −3 where the block of 1, 4, 16 cells along an axis around it is empty; or PENDING − n
where block n around it is not cut yet. The contents do not depend on the order of rays and threads.
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
from .tables import (
    CELLS_ALONG,
    END_BLOCKS,
    END_LEAVES,
    END_ROWS,
    END_TAPES,
    FIRST_CELL,
    FIRST_CONSTANT,
    FIRST_ROW,
    HIGH,
    LARGEST_COORDINATE,
    RESULT,
    ROW_COUNT,
)

MAX_REGISTERS = MOST_LIVE
SPLIT = 4
CHILDREN = SPLIT**3
PENDING = -16
SLACK = 1e-9  # of a cell, by which boxes grow: rays' entry points are rounded
OVERRUN = 2.0**-40 + 4e-15  # of the largest coordinate, by which boxes grow besides: see root_isolation.py
BIG, LARGEST = NumpyMath.most, NumpyMath.big
_WIDE = 8  # vectors of a register in the largest program
_REGISTERS = MAX_REGISTERS * _WIDE * LANES
_ARITY = np.array([arity(op) for op in Op], np.int64)
CHOICE = np.array([op in CHOICES for op in (*Op, SCALE)], np.int64)
COPY, CHOOSE, MIN, MAX, MULTIPLY = int(Op.COPY), int(Op.CHOOSE), int(Op.MIN), int(Op.MAX), int(Op.MULTIPLY)
_BOXES, _CELLS = 2, 8  # vectors of a value
_BOXES_AT, _CELLS_AT = 2, 4  # places in scene_surfaces.PROGRAMS


@noinline_helper
def ensure_block(forms, k, number):
    """Subdivide block `number` of surface k unless that is done; wait for another thread that is at it."""
    while True:
        was = try_claim(forms.states, number)
        if was == 2:
            return
        if was == 0:
            _subdivide(forms, k, number)
            store_release(forms.states, number)
            return


class TapeStore(NamedTuple):
    """Growing storage of tapes."""

    names: Any  # (rows, 4) op and the names of operands
    code: Any  # (rows, ROW) the same with registers
    tapes: Any  # (tapes, 4) first row, rows, register of the result, hash
    ends: Any  # (2,) or more: how many tapes and rows there are


class _Block(NamedTuple):
    """A block that is being subdivided."""

    corner: tuple[int, int, int]
    size: int  # of its parts, in cells
    tape: int
    store: TapeStore  # of its parts' tapes
    scratch: Any
    state: Any
    registers: Any
    parts: Any  # (CHILDREN, 2) parts that may hold a part of the surface, and their tapes


@allocating_helper
def _subdivide(forms, k, number):
    """Write a block's 64 parts to the grid: as leaves if they are cells, else as blocks, with simplified tapes."""
    x, y, z, size, tape = (
        forms.blocks[number, 0], forms.blocks[number, 1], forms.blocks[number, 2], forms.blocks[number, 3], forms.blocks[number, 4]
    )  # fmt: skip
    rows = forms.tapes[tape, ROW_COUNT]
    names, code = np.empty(((CHILDREN + 1) * (rows + 1), 4), np.int32), np.empty(((CHILDREN + 1) * (rows + 1), ROW), np.int32)
    tapes, ends, scratch = np.zeros((CHILDREN + 1, 4), np.int64), np.zeros(2, np.int64), np.empty(3 * rows + 8, np.int64)
    choices = _copy_tape(forms, tape, names, code)
    tapes[0, ROW_COUNT], tapes[0, RESULT] = rows, forms.tapes[tape, RESULT]
    ends[0], ends[1] = 1, rows
    block = _Block(
        (x, y, z), size // SPLIT, tape, TapeStore(names, code, tapes, ends), scratch, np.zeros(1 + 2 * (choices + 1), np.int64),
        np.empty(_REGISTERS), np.empty((CHILDREN, 2), np.int64),
    )  # fmt: skip
    count = _find_parts(forms, k, block)
    first_tape, stored = _append_tapes(forms, tape, rows, block.store)
    for i in range(count):  # from here on, tape numbers are those of the grid
        local = block.parts[i, 1]
        block.parts[i, 1] = first_tape + local - 1 if local > 0 and stored else tape
    if block.size > 1:
        _append_blocks(forms, k, block, count)
    else:
        _append_leaves(forms, k, block, count)


@noinline_helper
def _find_parts(forms, k, block):
    """List the parts that may hold a part of the surface, with their tapes; mark the others empty; return how many are listed."""
    count = 0
    for first in range(0, CHILDREN, LANES):
        few = min(LANES, CHILDREN - first)
        out = _bound_parts(forms, k, block, first, few, False, _BOXES, _BOXES_AT)
        for lane in range(few):
            least, most, maybe = block.registers[out + lane], block.registers[out + LANES + lane], (block.state[0] >> lane) & 1
            if not least <= 0.0 or (most < 0.0 and maybe == 0):
                _mark(forms, k, block, first + lane, _empty_mark(block.size))
                continue
            block.parts[count, 0], block.parts[count, 1] = first + lane, 0
            if maybe == 0:
                block.parts[count, 1] = max(simplify(block.store, 0, block.state, lane, block.scratch), 0)
            count += 1
    return count


@helper
def _append_blocks(forms: Any, k: int, block: _Block, count: int) -> None:
    """Append the listed parts to the pending blocks."""
    first, (x, y, z), small = fetch_add(forms.ends, END_BLOCKS, count), block.corner, block.size
    for i in range(count):
        child, number = block.parts[i, 0], first + i
        forms.blocks[number, 0] = x + small * (child // (SPLIT * SPLIT))
        forms.blocks[number, 1] = y + small * (child // SPLIT % SPLIT)
        forms.blocks[number, 2] = z + small * (child % SPLIT)
        forms.blocks[number, 3], forms.blocks[number, 4] = small, block.parts[i, 1]
        _mark(forms, k, block, child, PENDING - number)


@noinline_helper
def _append_leaves(forms, k, block, count):
    """Append the listed parts, which are cells, to the leaves, with bounds of their derivatives."""
    first_leaf = fetch_add(forms.ends, END_LEAVES, count)
    for first in range(0, count, LANES):
        few = min(LANES, count - first)
        out = _bound_parts(forms, k, block, first, few, True, _CELLS, _CELLS_AT)
        for lane in range(few):
            leaf = first_leaf + first + lane
            forms.leaf_tape[leaf] = block.parts[first + lane, 1]
            finite = abs(block.registers[out + lane]) < LARGEST and abs(block.registers[out + LANES + lane]) < LARGEST
            sure = (block.state[0] >> lane) & 1 == 0 and finite  # ∞ − ∞ has no slope
            for j in range(3):
                least, most = block.registers[out + (2 + 2 * j) * LANES + lane], block.registers[out + (3 + 2 * j) * LANES + lane]
                is_bounded = sure and abs(least) < LARGEST and abs(most) < LARGEST
                forms.leaf_slopes[leaf, 2 * j], forms.leaf_slopes[leaf, 2 * j + 1] = (least, most) if is_bounded else (-BIG, BIG)
    fetch_add(forms.ends, END_LEAVES, 0)  # publishes the leaves before the grid refers to them
    for i in range(count):
        _mark(forms, k, block, block.parts[i, 0], first_leaf + i)


@helper
def _bound_parts(forms: Any, k: int, block: _Block, first: int, few: int, listed: bool, width: int, program: int) -> int:
    """Run a program over parts from `first` on, of all parts or of the listed ones; return the register of its results."""
    _set_boxes(block.registers, forms.numbers, k, forms.places[k, CELLS_ALONG], block, first, few, listed, width)
    block.state[0] = 0
    rows, code = block.store.tapes[0, ROW_COUNT], block.store.code
    interpret(forms.programs[program], code, 0, rows, block.registers, forms.constants, forms.places[k, FIRST_CONSTANT], block.state, 1)
    return block.store.tapes[0, RESULT] * width * LANES


@helper
def _copy_tape(forms: Any, tape: int, names: Any, code: Any) -> Any:
    """Copy a tape's rows to the beginning of other storage; return the number of its choices."""
    first, choices = forms.tapes[tape, FIRST_ROW], 0
    for i in range(forms.tapes[tape, ROW_COUNT]):
        for c in range(4):
            names[i, c] = forms.names[first + i, c]
        for c in range(ROW):
            code[i, c] = forms.code[first + i, c]
        choices += CHOICE[names[i, 0]]
    return choices


@helper
def _append_tapes(forms: Any, parent: int, rows: int, store: TapeStore) -> tuple[int, bool]:
    """Append the new tapes of a block to the surfaces' tapes: (number of the first one, False if memory is full)."""
    count, length = store.ends[0] - 1, store.ends[1] - rows
    first_tape, begin = fetch_add(forms.ends, END_TAPES, count), fetch_add(forms.ends, END_ROWS, length)
    if first_tape + count > len(forms.tapes) or begin + length > len(forms.names):
        return parent, False
    for i in range(length):
        for c in range(4):
            forms.names[begin + i, c] = store.names[rows + i, c]
        for c in range(ROW):
            forms.code[begin + i, c] = store.code[rows + i, c]
    for i in range(count):
        forms.tapes[first_tape + i, FIRST_ROW] = store.tapes[1 + i, FIRST_ROW] - rows + begin
        forms.tapes[first_tape + i, ROW_COUNT], forms.tapes[first_tape + i, RESULT] = (
            store.tapes[1 + i, ROW_COUNT],
            store.tapes[1 + i, RESULT],
        )
    return first_tape, True


@helper
def _empty_mark(size: int) -> int:
    """Grid mark of an empty block of `size` cells along an axis."""
    mark = -1
    while size > 1:
        size //= SPLIT
        mark -= 1
    return mark


@helper
def _mark(forms: Any, k: int, block: _Block, child: int, mark: int) -> None:
    """Write a mark to the grid cells of a part."""
    count, begin, (x, y, z), size = forms.places[k, CELLS_ALONG], forms.places[k, FIRST_CELL], block.corner, block.size
    x += size * (child // (SPLIT * SPLIT))
    y += size * (child // SPLIT % SPLIT)
    z += size * (child % SPLIT)
    for i in range(x, x + size):
        for j in range(y, y + size):
            for c in range(z, z + size):
                forms.grid[begin + (i * count + j) * count + c] = mark


@helper
def _set_boxes(registers: Any, numbers: Any, k: int, count: int, block: _Block, first: int, few: int, listed: bool, width: int) -> None:
    """Set the registers of x, y and z to the boxes of parts; lanes beyond the last part repeat it."""
    (x, y, z), size = block.corner, block.size
    for lane in range(LANES):
        child = first + min(lane, few - 1)
        if listed:
            child = block.parts[child, 0]
        corner = (x + size * (child // (SPLIT * SPLIT)), y + size * (child // SPLIT % SPLIT), z + size * (child % SPLIT))
        for axis in range(3):
            element = axis * width * LANES + lane
            low, cell = numbers[k, axis], (numbers[k, HIGH + axis] - numbers[k, axis]) / count
            slack = SLACK * cell + OVERRUN * numbers[k, LARGEST_COORDINATE]
            registers[element] = low + corner[axis] * cell - slack
            registers[element + LANES] = low + (corner[axis] + size) * cell + slack
            for j in range(2, width):
                registers[element + j * LANES] = 1.0 if (j - 2) // 2 == axis else 0.0


# --- tape simplification ------------------------------------------------------------------------------------------------


@noinline_helper
def simplify(store, tape, state, lane, scratch):
    """Append the tape that lane `lane` of the last evaluation needs; return its number, or −1 or −2 if rows or registers run out."""
    names, code, tapes, ends = store
    n = tapes[tape, ROW_COUNT]
    visited, dropped = _mark_needed(store, tape, state, lane, scratch)
    if dropped == 0:
        return tape
    number, begin = ends[0], ends[1]
    if begin + visited + 1 > len(names) or number >= len(tapes):
        return -1
    count = _copy_needed(names, tapes[tape, FIRST_ROW], n, begin, visited, scratch)
    result = scratch[n + n - 1]
    if result < INPUTS:
        names[begin, 0], names[begin, 1], names[begin, 2], names[begin, 3] = COPY, result, 0, 0
        count = 1
    same = _find_equal(names, tapes, number, begin, count)
    if same >= 0:
        return same
    tapes[number, 0], tapes[number, 1] = begin, count
    outcome = allocate_registers(names, code, tapes, number)
    if outcome != 0:
        return -outcome
    ends[0], ends[1] = number + 1, begin + count
    return number


@helper
def _mark_needed(store: TapeStore, tape: int, state: Any, lane: int, scratch: Any) -> tuple[int, int]:
    """Mark the rows that a lane needs, from the result backwards: (marked rows, rows replaced by an operand).

    Of n rows, scratch[i] is 1 for a needed row and 2 for one that is replaced by the value named in scratch[n + i]. The list of marked rows
    begins at scratch[2 n].
    """
    names = store.names
    first, n = store.tapes[tape, FIRST_ROW], store.tapes[tape, ROW_COUNT]
    for i in range(n):
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
            choice = store.code[first + i, 5]
            takes_first, takes_second = (state[1 + 2 * choice] >> lane) & 1, (state[2 + 2 * choice] >> lane) & 1
            if takes_first == 1 or takes_second == 1:
                column = (1 if takes_first == 1 else 2) + (1 if op == CHOOSE else 0)
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
    return visited, dropped


@helper
def _copy_needed(names: Any, first: int, n: int, begin: int, visited: int, scratch: Any) -> int:
    """Copy the marked rows to row `begin` on and return their number; scratch[n + i] becomes the new name of row i."""
    count = 0
    for position in range(visited - 1, -1, -1):
        i = scratch[2 * n + position]
        if scratch[i] == 2:
            scratch[n + i] = _new_name(scratch, n, scratch[n + i])
            continue
        op = names[first + i, 0]
        names[begin + count, 0] = op
        for k in range(3):
            names[begin + count, 1 + k] = _new_name(scratch, n, np.int64(names[first + i, 1 + k])) if k < _ARITY[op] else 0
        scratch[n + i] = INPUTS + count
        count += 1
    return count


@helper
def _new_name(scratch: Any, n: int, name: int) -> int:
    return scratch[n + name - INPUTS] if name >= INPUTS else name


@helper
def _find_equal(names: Any, tapes: Any, number: int, begin: int, count: int) -> int:
    """Find an equal tape among the last 1024, or −1; sets tapes[number, 3], a hash."""
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
def allocate_registers(names, code, tapes, tape):
    """Assign a register to each value of a tape and write its rows for interpreters. Returns 0, or 2 if registers code out."""
    first, n = tapes[tape, FIRST_ROW], tapes[tape, ROW_COUNT]
    last, register = np.full(n, n, np.int64), np.empty(n, np.int64)
    for i in range(n):
        for k in range(_ARITY[names[first + i, 0]]):
            name = names[first + i, 1 + k]
            if name >= INPUTS:
                last[name - INPUTS] = i
    free, frees, used, choice = np.empty(MAX_REGISTERS, np.int64), 0, INPUTS, 0
    for i in range(n):
        op = names[first + i, 0]
        code[first + i, 0] = op
        for k in range(3):
            code[first + i, 2 + k] = 0
        for k in range(_ARITY[op]):
            name = names[first + i, 1 + k]
            code[first + i, 2 + k] = register[name - INPUTS] if name >= INPUTS else name
        operand_a, operand_b = code[first + i, 2], code[first + i, 3]
        if op == MULTIPLY and (operand_a < 0) != (operand_b < 0):
            code[first + i, 0], code[first + i, 2], code[first + i, 3] = SCALE, max(operand_a, operand_b), min(operand_a, operand_b)
        for k in range(_ARITY[op]):
            name = names[first + i, 1 + k]
            if name >= INPUTS and last[name - INPUTS] == i:
                free[frees] = register[name - INPUTS]
                frees += 1
                last[name - INPUTS] = -1  # once, also if both operands are the same
        if frees > 0:
            frees -= 1
            register[i] = free[frees]
        else:
            if used >= MAX_REGISTERS:
                return 2
            register[i] = used
            used += 1
        code[first + i, 1] = register[i]
        code[first + i, 5] = choice
        choice += CHOICE[op]
    tapes[tape, RESULT] = register[n - 1]
    _mark_extremes(names, code, first, n, last)
    return 0


@kernel
def allocate_registers_kernel(names, code, tapes, tape):
    """`allocate_registers` for callers outside of kernels."""
    return allocate_registers(names, code, tapes, tape)


@helper
def _mark_extremes(names: Any, code: Any, first: int, n: int, inner: Any) -> None:
    """Set code[:, 6] of the minima and maxima whose values go only into minima and maxima, up to the result."""
    for i in range(n):
        inner[i] = 1
    for i in range(n - 1, -1, -1):
        op = names[first + i, 0]
        chooses = inner[i] == 1 and op in (MIN, MAX)
        code[first + i, 6] = 1 if chooses else 0
        if not chooses:
            for k in range(_ARITY[op]):
                name = names[first + i, 1 + k]
                if name >= INPUTS:
                    inner[name - INPUTS] = 0
