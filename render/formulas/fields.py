"""Formula surfaces ready to be traced: their tapes as interpreters run them, simplified for the cells of a grid around the surface."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.tapes import INPUTS, Op, Tape
from . import cells, compiled, interpreter
from .forms import Forms
from .interpreter import PARTS
from .programs import WIDTHS
from .vectors import LANES, ROW, SINGLE

CELLS = 64  # of a grid along each axis: a power of 4
_ROWS = ("constants", "names", "constants32")
IN_MEMORY = 16  # fields that are kept
PROGRAMS = tuple(WIDTHS)
_known: OrderedDict[bytes, Field] = OrderedDict()
_lock = threading.Lock()


class Field(NamedTuple):
    """One surface; its numbers count from its own beginning."""

    numbers: NDArray[np.float64]
    sheet: bool
    cells: int
    grid: NDArray[np.int32]
    leaf_tape: NDArray[np.int32]
    leaf_size: NDArray[np.int32]
    leaf_slopes: NDArray[np.float64]
    tapes: NDArray[np.int64]
    code: NDArray[np.int32]
    constants: NDArray[np.float64]
    names: NDArray[np.int32]
    constants32: NDArray[np.float32]
    tape: Tape


def tape_of(tables: ir.Tables, g: int) -> Tape:
    """The tape of a geometry."""
    row, tapes, pools = int(tables.geometries.tape[g]), tables.tapes, tables.pools
    first, begin = int(tapes.first[row]), int(tapes.first_constant[row])
    results = tuple(tapes.results[row, : tapes.result_count[row]].tolist())
    return Tape(pools.code[first : first + int(tapes.count[row])], pools.constants[begin : begin + int(tapes.constant_count[row])], results)


def forms(tables: ir.Tables) -> Forms:
    """All formula surfaces that some instance shows."""
    kinds = tables.geometries.kind
    shown = [g for g in np.unique(tables.instances.geometry).tolist() if kinds[g] == ir.GeometryKind.FORMULA]
    of = np.full(len(kinds), -1, np.int32)
    of[shown] = np.arange(len(shown))
    made = [field(tape_of(tables, g), tables.geometries.parameters[g], tables.geometries.bounds[g]) for g in shown]
    return _pooled(of, made)


def _pooled(of: NDArray[np.int32], made: list[Field]) -> Forms:
    places = np.zeros((len(made), 8), np.int64)
    begin: dict[str, int] = dict.fromkeys(("grid", "leaves", "tapes", "code", "constants", "names"), 0)
    parts: dict[str, list[Any]] = {name: [] for name in ("grid", "leaf_tape", "leaf_size", "leaf_slopes", "tapes", "code", *_ROWS)}
    for row, each in enumerate(made):
        places[row, :7] = each.cells, each.sheet, begin["grid"], begin["leaves"], begin["tapes"], begin["constants"], begin["tapes"]
        places[row, 7] = begin["names"]
        parts["grid"].append(np.where(each.grid >= 0, each.grid + begin["leaves"], each.grid))
        parts["leaf_tape"].append(each.leaf_tape + begin["tapes"])
        parts["tapes"].append(each.tapes + [begin["code"], 0, 0])
        for name in ("leaf_size", "leaf_slopes", "code", *_ROWS):
            parts[name].append(getattr(each, name))
        for name, column in (("grid", each.grid), ("leaves", each.leaf_size), ("tapes", each.tapes), ("code", each.code)):
            begin[name] += len(column)
        begin["constants"] += len(each.constants)
        begin["names"] += len(each.names)

    def joined(name: str, dtype: Any, width: int = 0) -> Any:
        empty = np.zeros((0, width) if width else 0, dtype)
        return np.ascontiguousarray(np.concatenate([empty, *parts[name]]), dtype)

    return Forms(
        of=of,
        numbers=np.array([each.numbers for each in made], np.float64).reshape(-1, 14),
        places=places,
        compiled=compiled.addresses([each.tape for each in made]),
        grid=joined("grid", np.int32),
        leaf_tape=joined("leaf_tape", np.int32),
        leaf_size=joined("leaf_size", np.int32),
        leaf_slopes=joined("leaf_slopes", np.float64, 6),
        tapes=joined("tapes", np.int64, 3),
        code=joined("code", np.int32, ROW),
        constants=joined("constants", np.float64),
        names=joined("names", np.int32, 4),
        constants32=joined("constants32", np.float32),
        programs=np.array([interpreter.address(name) for name in PROGRAMS] if made else [], np.int64),
        unproved=np.zeros(1, np.int64),
    )


def field(tape: Tape, parameters: NDArray[np.float64], bounds: NDArray[np.float64], count: int = CELLS) -> Field:
    """The grid of a surface in its box; taken from those that are kept if it was made before."""
    key = hashlib.blake2b(digest_size=16)
    for part in (tape.structure(), tape.constants.tobytes(), parameters.tobytes(), bounds.tobytes(), bytes([count])):
        key.update(part)
    name = key.digest()
    with _lock:
        if name in _known:
            _known.move_to_end(name)
            return _known[name]
    made = _field(tape, parameters, bounds, count)
    with _lock:
        _known[name] = made
        while len(_known) > IN_MEMORY:
            _known.popitem(last=False)
    return made


def _field(tape: Tape, parameters: NDArray[np.float64], bounds: NDArray[np.float64], count: int) -> Field:
    low, high = bounds
    cell = (high - low) / count
    reach = float(np.abs(bounds).max())
    numbers = np.concatenate([low, high, 1.0 / cell, parameters[1:5], [reach]])
    constants = constant_rows(tape)
    names, register = names_of(tape)
    grid, leaf_tape, leaf_size, slopes, tapes, code = cells.build((names, register), constants, low, cell, count, reach)
    single = single_rows(tape)
    kind = bool(parameters[0])
    return Field(numbers, kind, count, grid, leaf_tape, leaf_size, slopes, tapes, code, constants, names, single, tape)


def names_of(tape: Tape) -> tuple[NDArray[np.int32], int]:
    """(rows (n, 4) of op, a, b, c; the name of the result). The result is always the last row: a copy where it was none."""
    code, result = tape.code, tape.results[0]
    if result != INPUTS + len(code) - 1 or not len(code):
        code = np.concatenate([code, np.array([[Op.COPY, result, 0, 0]], np.int32)])
    return np.ascontiguousarray(code, np.int32), INPUTS + len(code) - 1


def constant_rows(tape: Tape) -> NDArray[np.float64]:
    """A tape's constants as interpreters read them: for each PARTS vectors, the number in two of them."""
    rows = np.zeros((max(len(tape.constants), 1), PARTS, LANES))
    rows[: len(tape.constants), :2] = tape.constants[:, None, None]
    return rows.ravel()


def single_rows(tape: Tape) -> NDArray[np.float32]:
    """The same in float32: bounds of the number, zeros, and from the sixth vector on the number and zeros."""
    near = tape.constants.astype(np.float32)
    rows = np.zeros((max(len(near), 1), PARTS, SINGLE.lanes), np.float32)
    exact = near == tape.constants
    rows[: len(near), 0] = np.where(exact, near, np.nextafter(near, np.float32(-np.inf)))[:, None]
    rows[: len(near), 1] = np.where(exact, near, np.nextafter(near, np.float32(np.inf)))[:, None]
    rows[: len(near), 5] = near[:, None]
    return rows.ravel()
