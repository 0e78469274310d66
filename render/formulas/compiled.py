"""Tapes as straight code of their own, compiled in the background while the first pictures are drawn by interpreters.

The code computes bit for bit what the interpreter does, so that a picture does not depend on when it is ready. Constants stay in their
table: another number needs no other code.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from ...compiler.operations import CHOICES
from ...compiler.tapes import Op, Tape, arity
from ..simd.value import I64
from . import interpreter
from .interpreter import PARTS, SHIFTS
from .loops import over_vectors
from .programs import EMITTERS, WIDTHS
from .vectors import BOUNDS, BYTES, CODE, ROWS, SINGLE, VectorMath, load, store

PROGRAMS = ("points", "turns", "points32", "boxes32", "spans32")
SINGLES = 2  # from which place on they are of float32
PATIENCE = 0.1  # seconds until a thread begins to compile: what is to be drawn at once goes first
LONGEST = 3000  # rows of a tape that is compiled: longer ones are evaluated simplified
LONGEST_ROWS = 300  # the same of float32, whose interpreter takes many vectors at once
LONGEST_BOUNDS = 48  # the same of bounds, which are ten times as much code; without choices: bounds tell what of these is left
_engines: dict[bytes, list[Any]] = {}
_waiting: dict[bytes, list[tuple[NDArray[np.int64], int]]] = {}
_lock, _hurry = threading.Lock(), threading.Event()


def addresses(tapes: list[Tape | None]) -> NDArray[np.int64]:
    """(n, 3) where each tape's code for each of PROGRAMS is: 0 until a background thread writes it there, or without a tape."""
    table = np.zeros((len(tapes), len(PROGRAMS)), np.int64)
    for row, tape in enumerate(tapes):
        if tape is None or len(tape.code) > LONGEST:
            continue
        key = tape.structure()
        with _lock:
            table[row] = _addresses(_engines.get(key, []))
            begin = key not in _engines and key not in _waiting
            if begin or key in _waiting:
                _waiting.setdefault(key, []).append((table, row))
        if begin:
            threading.Thread(target=_compile, args=(tape, key), name="formula", daemon=True).start()
    return table


def _addresses(engines: list[Any]) -> list[int]:
    return [max((engine.get_function_address(f"tape_{name}") for engine in engines), default=0) for name in PROGRAMS]  # 0: there is none


def _compile(tape: Tape, key: bytes) -> None:
    _hurry.wait(PATIENCE)
    engines = [engine_of(module_of(tape))]
    _tell(key, engines)
    if len(tape.code) <= LONGEST_BOUNDS and CHOICES.isdisjoint(tape.code[:, 0].tolist()):
        engines.append(engine_of(bounds_of(tape)))
        _tell(key, engines)
    with _lock:
        _waiting.pop(key)


def _tell(key: bytes, engines: list[Any]) -> None:
    """Write where code is to all that wait for it."""
    with _lock:
        _engines[key] = engines  # kept for good: an address in use must stay
        for table, row in _waiting[key]:
            table[row] = _addresses(engines)


def finish() -> None:
    """Wait until everything that was asked for is compiled."""
    _hurry.set()
    for thread in threading.enumerate():
        if thread.name == "formula":
            thread.join()
    _hurry.clear()


def engine_of(module: ir.Module) -> Any:
    """The code of a module."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), interpreter.target())
    engine.finalize_object()
    return engine


def module_of(tape: Tape) -> ir.Module:
    """LLVM code of a tape: for one vector of points, tape_points and tape_turns (x y z, constants, out), and if it is short for many in
    float32, tape_points32."""
    module = ir.Module("maquette.formula")
    for program in PROGRAMS[:SINGLES]:
        function = ir.Function(module, CODE, f"tape_{program}")
        inputs, constants, out = function.args
        b = ir.IRBuilder(function.append_basic_block("entry"))
        m, width = VectorMath(b), WIDTHS[program]
        zero, one = (m.everywhere(number) for number in (0.0, 1.0))
        given = []
        for axis in range(3):
            turns = [one if k == axis else zero for k in range(width - 1)]
            given.append([load(b, inputs, axis * width * BYTES), *turns])

        def constant(k: int, b: Any = b, constants: Any = constants, rest: Any = (zero,) * (width - 1)) -> Any:
            return [load(b, constants, k * PARTS * BYTES), *rest]

        for k, part in enumerate(_result(tape, program, m, given, constant)):
            store(b, out, k * BYTES, part)
        b.ret_void()
    if len(tape.code) <= LONGEST_ROWS:
        _add_rows(module, tape)
    return module


def _add_rows(module: ir.Module, tape: Tape) -> None:
    """The function for many vectors."""
    program, size = PROGRAMS[SINGLES], SINGLE.bytes
    function = ir.Function(module, ROWS, f"tape_{program}")
    inputs, constants, out, vectors = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    stride = b.mul(vectors, ir.Constant(I64, size))

    def vector(k: Any) -> None:
        offset = b.mul(k, ir.Constant(I64, size))
        given = [[load(b, inputs, b.add(offset, b.mul(stride, ir.Constant(I64, axis))), SINGLE)] for axis in range(3)]
        m = VectorMath(b, form=SINGLE)
        (value,) = _result(tape, program, m, given, lambda k: [load(b, constants, (k * PARTS + SHIFTS[program]) * size, SINGLE)])
        store(b, out, offset, value)

    over_vectors(b, vectors, vector)
    b.ret_void()


def bounds_of(tape: Tape) -> ir.Module:
    """LLVM code of a tape's bounds for many vectors of float32, tape_boxes32 and tape_spans32 (see calls.compiled_bounds)."""
    module = ir.Module("maquette.bounds")
    for program in PROGRAMS[SINGLES + 1 :]:
        _add_bounds(module, tape, program)
    return module


def _add_bounds(module: ir.Module, tape: Tape, program: str) -> None:
    function = ir.Function(module, BOUNDS, f"tape_{program}")
    inputs, constants, out, state, vectors = function.args
    width, size = WIDTHS[program], SINGLE.bytes
    b = ir.IRBuilder(function.append_basic_block("entry"))
    stride = b.mul(vectors, ir.Constant(I64, size))

    def vector(k: Any) -> None:
        offset = b.mul(k, ir.Constant(I64, size))
        places = [b.add(offset, b.mul(stride, ir.Constant(I64, part))) for part in range(3 * width)]
        read = [load(b, inputs, place, SINGLE) for place in places]
        given = [read[axis * width : (axis + 1) * width] for axis in range(3)]
        found = _result(
            tape, program, VectorMath(b, state, SINGLE, k), given,
            lambda k: [load(b, constants, (k * PARTS + part) * size, SINGLE) for part in range(width)],
        )  # fmt: skip
        for place, part in zip(places, found, strict=False):
            store(b, out, place, part)

    over_vectors(b, vectors, vector)
    b.ret_void()


def _result(tape: Tape, program: str, m: VectorMath, given: list[Any], constant: Callable[[int], Any]) -> Any:
    """Emit a tape for its inputs; its result."""
    values = list(given)

    def named(name: int) -> Any:
        return values[name] if name >= 0 else constant(~name)

    for op, *operands in tape.code.tolist():
        time.sleep(0)  # lets others go on: a picture is being drawn meanwhile
        values.append(EMITTERS[program](m, Op(op), [named(name) for name in operands[: arity(op)]], ir.Constant(I64, 0)))
    return named(tape.results[0])
