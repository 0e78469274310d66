"""Tapes as straight code of their own, compiled in the background while the first pictures are drawn by interpreters.

The code computes bit for bit what the interpreter does, so that a picture does not depend on when it is ready. Constants stay in their
table: another number needs no other code.
"""

from __future__ import annotations

import atexit
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from ...compiler.formula.opcodes import Op, arity
from ...compiler.formula.tape import Tape
from ..simd.llvm_expr import I64
from . import interpreter
from .interpreter import PARTS, SHIFTS
from .llvm_math import BYTES, CODE, ROWS, SINGLE, VectorMath, load, store
from .loop_codegen import over_vectors
from .op_codegen import EMITTERS, WIDTHS

PROGRAMS = ("points", "turns", "points32")
PATIENCE = 0.1  # seconds until a thread begins to compile: what is to be drawn at once goes first
LONGEST = 3000  # rows of a tape that is compiled: longer ones are evaluated simplified
LONGEST_ROWS = 300  # the same of float32, whose interpreter takes many vectors at once
RECENT = 16  # formulas whose code is kept though no table has its address: each takes two megabytes
_engines: weakref.WeakValueDictionary[bytes, Any] = weakref.WeakValueDictionary()  # all that are in use, or recent
_recent: OrderedDict[bytes, Any] = OrderedDict()
_waiting: dict[bytes, list[tuple[weakref.ref[NDArray[np.int64]], int]]] = {}
_lock, _hurry, _closing = threading.Lock(), threading.Event(), threading.Event()


class _Ended(Exception):
    """The process ends."""


def addresses(tapes: list[Tape | None]) -> NDArray[np.int64]:
    """(n, 3) where each tape's code for each of PROGRAMS is: 0 until a background thread writes it there, or without a tape.

    The code is there as long as the table: kernels have its rows from the table itself, or from a view of it.
    """
    table = np.zeros((len(tapes), len(PROGRAMS)), np.int64)
    for row, tape in enumerate(tapes):
        if tape is None or len(tape.code) > LONGEST:
            continue
        key = tape.structure()
        with _lock:
            engine = _engines.get(key)
            if engine is not None:
                _lend(key, engine, table, row)
                continue
            begin = key not in _waiting
            _waiting.setdefault(key, []).append((weakref.ref(table), row))
        if begin:
            threading.Thread(target=_compile, args=(tape, key), name="formula", daemon=True).start()
    return table


def _addresses(engine: Any) -> list[int]:
    return [engine.get_function_address(f"tape_{name}") for name in PROGRAMS]  # 0 for those that it does not have


def _lend(key: bytes, engine: Any, table: NDArray[np.int64], row: int) -> None:
    """Write a tape's addresses into a table, and see that its code lives at least as long."""
    weakref.finalize(table, _returned, engine).atexit = False
    table[row] = _addresses(engine)
    _recent[key] = engine
    _recent.move_to_end(key)
    while len(_recent) > RECENT:
        _recent.popitem(last=False)


def _returned(engine: Any) -> None:
    """A table is no more. It may be another thread's collector that says so, at any place: nothing is to be locked here."""


def _compile(tape: Tape, key: bytes) -> None:
    _hurry.wait(PATIENCE)
    with _lock:
        if not any(table() is not None for table, _ in _waiting[key]):  # it was changed again meanwhile
            del _waiting[key]
            return
    try:
        engine = engine_of(tape)
    except _Ended:
        return
    with _lock:
        _engines[key] = engine
        for there, row in _waiting.pop(key):
            table = there()
            if table is not None:
                _lend(key, engine, table, row)


def finish() -> None:
    """Wait until everything that was asked for is compiled."""
    _hurry.set()
    for thread in threading.enumerate():
        if thread.name == "formula":
            thread.join()
    _hurry.clear()


@atexit.register
def _end() -> None:
    """Let no thread be in LLVM when that is taken down: the process would be aborted."""
    _closing.set()
    finish()


def engine_of(tape: Tape) -> Any:
    """A tape's code, with its functions tape_points and tape_turns (x y z, constants, out), and tape_points32 if it is short."""
    module = llvm.parse_assembly(str(module_of(tape)))
    engine = llvm.create_mcjit_compiler(module, interpreter.target())
    engine.finalize_object()
    return engine


def module_of(tape: Tape) -> ir.Module:
    """LLVM code of a tape: for one vector of points, and for many in float32."""
    module = ir.Module("maquette.formula")
    for program in PROGRAMS[:2]:
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
    program, size = PROGRAMS[2], SINGLE.bytes
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


def _result(tape: Tape, program: str, m: VectorMath, given: list[Any], constant: Callable[[int], Any]) -> Any:
    """Emit a tape for its inputs; its result."""
    values = list(given)

    def named(name: int) -> Any:
        return values[name] if name >= 0 else constant(~name)

    for op, *operands in tape.code.tolist():
        if _closing.is_set():
            raise _Ended
        time.sleep(0)  # lets others go on: a picture is being drawn meanwhile
        values.append(EMITTERS[program](m, Op(op), [named(name) for name in operands[: arity(op)]], ir.Constant(I64, 0)))
    return named(tape.results[0])
