"""Builds the kernel tables of a scene's implicit surfaces: tapes for the interpreters, and grids that fill as rays arrive."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.formula import closed_form_solids
from ...compiler.formula.opcodes import Op
from ...compiler.formula.tape import INPUTS, Tape, load_tape
from .. import simd
from . import closed_form_tables, discontinuities, interpreter, interval_grid, tape_jit
from .interpreter import PARTS
from .llvm_math import LANES, ROW, SINGLE
from .op_codegen import LARGEST_PART, NEAREST, WIDTHS
from .tables import END_BLOCKS, END_ROWS, END_TAPES, NO_CLOSED_FORMS, Forms, Surface

CELLS, FEWER_CELLS = 64, 16  # of a grid along each axis: powers of 4
MANY = 32  # surfaces, beyond which each has fewer cells
ROWS, ROWS_PER_ROW, TAPES = 1 << 20, 256, 1 << 17  # capacity: rows per surface, rows per row of a whole tape, tapes per surface
MAX_CACHED = 4  # scenes whose tables stay in memory
PROGRAMS = tuple(WIDTHS)
_cached: OrderedDict[bytes, Forms] = OrderedDict()
_lock = threading.Lock()


def tape_of(tables: ir.Tables, g: int) -> Tape:
    """The tape of a geometry."""
    return load_tape(tables, int(tables.geometries.tape[g]))


def forms(tables: ir.Tables, closed: bool = True, threads: int = 1) -> Forms:
    """Tables of the implicit surfaces that instances reference; `closed` uses closed forms for surfaces that have them."""
    kinds = tables.geometries.kind
    shown = [g for g in np.unique(tables.instances.geometry).tolist() if kinds[g] == ir.GeometryKind.FORMULA]
    surfaces = [Surface(tape_of(tables, g), tables.geometries.parameters[g], tables.geometries.bounds[g]) for g in shown]
    solids = [closed_form_solids.of_geometry(tables, g) if closed else None for g in shown]
    order = np.argsort([solid is not None for solid in solids], kind="stable").tolist()  # surfaces with closed forms last
    surface_of = np.full(len(kinds), -1, np.int32)
    surface_of[[shown[row] for row in order]] = np.arange(len(shown))
    gridded = of_surfaces([surfaces[row] for row in order if solids[row] is None], threads)
    closed_surfaces = [(surfaces[row], solid) for row in order if (solid := solids[row]) is not None]
    return closed_form_tables.append_closed_forms(gridded._replace(surface_of=surface_of), closed_surfaces)


def of_surfaces(surfaces: Sequence[Surface], threads: int = 1) -> Forms:
    """Tables of surfaces by number; cached with their grids for later pictures."""
    key = hashlib.blake2b(digest_size=16)
    for tape, parameters, bounds in surfaces:
        for part in (tape.structure(), tape.constants.tobytes(), parameters.tobytes(), bounds.tobytes()):
            key.update(part)
    name = key.digest()
    with _lock:
        built = _cached.get(name)
        if built is None:
            interpreter.compile_missing(threads if surfaces else 1)
            built = _cached[name] = _build(surfaces)
            while len(_cached) > MAX_CACHED:
                _cached.popitem(last=False)
        _cached.move_to_end(name)
    return built._replace(unproved=np.zeros(1, np.int64))


def _build(surfaces: Sequence[Surface]) -> Forms:
    n = len(surfaces)
    count = CELLS if n <= MANY else FEWER_CELLS
    wholes = [names_of(tape) for tape, _, _ in surfaces]
    rows = sum(map(len, wholes))
    capacity = (ROWS + ROWS_PER_ROW * rows) * min(n, 1)
    names, code = simd.paged_empty((capacity, 4), np.int32), simd.paged_empty((capacity, ROW), np.int32)  # pages are used as tapes grow
    tapes, ends = simd.paged_empty((TAPES * n, 4), np.int64), np.zeros(4, np.int64)
    places, numbers = np.zeros((n, 6), np.int64), np.zeros((n, 14))
    most_blocks = sum((count // interval_grid.SPLIT**k) ** 3 for k in range(1, 4))
    blocks = np.empty((n * most_blocks, 5), np.int64)
    constants = [constant_rows(tape) for tape, _, _ in surfaces]
    begin = 0
    for k, (tape, parameters, bounds) in enumerate(surfaces):
        (low, high), first = bounds, int(ends[END_ROWS])
        numbers[k] = [*low, *high, *(count / (high - low)), *parameters[1:5], np.abs(bounds).max()]
        places[k] = count, bool(parameters[0]), k * count**3, begin, k, 0 if parameters[0] else discontinuities.kind_of(tape, bounds)
        begin += len(constants[k])
        names[first : first + len(wholes[k])] = wholes[k]
        tapes[k, :2] = first, len(wholes[k])
        interval_grid.allocate_registers_kernel(names, code, tapes, k)  # cannot fail: the compiler rejects tapes that need more registers
        blocks[k] = 0, 0, 0, count, k
        ends[[END_BLOCKS, END_TAPES]] = k + 1
        ends[END_ROWS] += len(wholes[k])
    return Forms(
        surface_of=np.arange(n, dtype=np.int32),
        numbers=numbers,
        places=places,
        compiled=tape_jit.addresses([tape for tape, _, _ in surfaces]),
        grid=np.repeat(interval_grid.PENDING - np.arange(n, dtype=np.int32), count**3),
        blocks=blocks,
        states=np.zeros(len(blocks), np.int64),
        ends=ends,
        leaf_tape=simd.paged_empty((n * count**3,), np.int32),
        leaf_slopes=simd.paged_empty((n * count**3, 6), np.float64),
        tapes=tapes,
        names=names,
        code=code,
        constants=_concatenate_aligned(constants, np.float64),
        constants32=_concatenate_aligned([single_rows(tape) for tape, _, _ in surfaces], np.float32),
        programs=np.array([interpreter.address(name) for name in PROGRAMS] if n else [], np.int64),
        unproved=np.zeros(1, np.int64),
        parts=NO_CLOSED_FORMS,
    )


def _concatenate_aligned(rows: list[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    """Concatenate rows in memory aligned to a cache line."""
    array = simd.aligned_empty(sum(map(len, rows)), dtype)
    array[...] = np.concatenate([np.zeros(0, dtype), *rows])
    return array


def names_of(tape: Tape) -> NDArray[np.int32]:
    """Rows (n, 4) of op, a, b, c. The last row is the result; a copy is appended where it was another value."""
    code, result = tape.code, tape.results[0]
    if result != INPUTS + len(code) - 1 or not len(code):
        code = np.concatenate([code, np.array([[Op.COPY, result, 0, 0]], np.int32)])
    return np.ascontiguousarray(code, np.int32)


def constant_rows(tape: Tape) -> NDArray[np.float64]:
    """A tape's constants for the interpreters: PARTS vectors for each, the first two with the number, the others zeros."""
    rows = np.zeros((max(len(tape.constants), 1), PARTS, LANES))
    rows[: len(tape.constants), :2] = tape.constants[:, None, None]
    return rows.ravel()


def single_rows(tape: Tape) -> NDArray[np.float32]:
    """A tape's constants in float32: bounds of each number, zeros, the nearest number, its largest magnitude (op_codegen.NEAREST)."""
    with np.errstate(over="ignore"):
        near = tape.constants.astype(np.float32)
    rows, most = np.zeros((max(len(near), 1), PARTS, SINGLE.lanes), np.float32), np.finfo(np.float32).max
    exact = near == tape.constants
    rows[: len(near), 0] = np.where(exact, near, np.nextafter(near, np.float32(-np.inf)))[:, None]
    rows[: len(near), 1] = np.where(exact, near, np.nextafter(near, np.float32(np.inf)))[:, None]
    rows[: len(near), NEAREST] = np.clip(near, -most, most)[:, None]  # finite, so that 0 times it is 0
    normal = exact | ((np.abs(near) > 1e-30) & np.isfinite(near))  # otherwise its error exceeds rounding
    rows[: len(near), LARGEST_PART] = np.where(normal, np.abs(rows[: len(near), :2, 0]).max(1), np.inf)[:, None]
    return rows.ravel()
