"""Background compilation of tapes to straight-line LLVM code, while interpreters draw the first pictures.

Compiled code gives the same bits as the interpreter, so that a picture does not depend on the moment it becomes ready. Constants stay in
their table: a changed number needs no new code.
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
from ..jit import loader
from ..simd.llvm_expr import I64
from .interpreter import PARTS, SHIFTS
from .llvm_math import BYTES, CODE, ROWS, SINGLE, VectorMath, load, store
from .loop_codegen import over_vectors
from .op_codegen import EMITTERS, WIDTHS

PROGRAMS = ("points", "gradients", "points32")
DELAY = 0.1  # seconds before a thread compiles, so that the current picture is not slowed down
MAX_ROWS = 3000  # of a tape that is compiled; longer ones run simplified in the interpreter
MAX_ROWS_32 = 300  # of a tape that is compiled for float32, whose interpreter executes many vectors a row
RECENT = 16  # formulas whose code stays loaded without a table: two megabytes each
_loaded: weakref.WeakValueDictionary[bytes, _Code] = weakref.WeakValueDictionary()  # in use or recent
_recent: OrderedDict[bytes, _Code] = OrderedDict()
_waiting: dict[bytes, list[tuple[weakref.ref[NDArray[np.int64]], int]]] = {}
_lock, _hurry, _closing = threading.Lock(), threading.Event(), threading.Event()


class _Code:
    """The code of a tape, for weak references: those to an engine still reach it while LLVM frees it, with the GIL released."""

    __slots__ = ("__weakref__", "engine")

    def __init__(self, engine: Any) -> None:
        self.engine = engine


class _Closing(Exception):
    """The process ends."""


def addresses(tapes: list[Tape | None]) -> NDArray[np.int64]:
    """Table (n, 3) of the addresses of each tape's code for PROGRAMS: 0 until a background thread writes them, and without a tape.

    The code is kept as long as the table: kernels read addresses from the table or a view of it.
    """
    table = np.zeros((len(tapes), len(PROGRAMS)), np.int64)
    for row, tape in enumerate(tapes):
        if tape is None or len(tape.code) > MAX_ROWS:
            continue
        key = tape.structure()
        with _lock:
            code = _loaded.get(key)
            if code is not None:
                _register(key, code, table, row)
                continue
            begin = key not in _waiting
            _waiting.setdefault(key, []).append((weakref.ref(table), row))
        if begin:
            threading.Thread(target=_compile, args=(tape, key), name="formula", daemon=True).start()
    return table


def _addresses(engine: Any) -> list[int]:
    return [engine.get_function_address(f"tape_{name}") for name in PROGRAMS]  # 0 for missing functions


def _register(key: bytes, code: _Code, table: NDArray[np.int64], row: int) -> None:
    """Write a tape's addresses to a table and keep its code alive as long as the table."""
    weakref.finalize(table, _release, code).atexit = False
    table[row] = _addresses(code.engine)
    _recent[key] = code
    _recent.move_to_end(key)
    while len(_recent) > RECENT:
        _recent.popitem(last=False)


def _release(code: _Code) -> None:
    """Drop the reference of a table that no longer exists. Garbage collection may call this anywhere: it must not lock."""


def _compile(tape: Tape, key: bytes) -> None:
    _hurry.wait(DELAY)
    with _lock:
        if not any(table() is not None for table, _ in _waiting[key]):  # the formula has changed meanwhile
            del _waiting[key]
            return
    try:
        code = _Code(engine_of(tape))
    except _Closing:
        return
    with _lock:
        _loaded[key] = code
        for reference, row in _waiting.pop(key):
            table = reference()
            if table is not None:
                _register(key, code, table, row)


def finish() -> None:
    """Wait until all requested tapes are compiled."""
    _hurry.set()
    for thread in threading.enumerate():
        if thread.name == "formula":
            thread.join()
    _hurry.clear()


@atexit.register
def _end() -> None:
    """Stop all compiler threads before LLVM shuts down, which would abort the process."""
    _closing.set()
    finish()


def engine_of(tape: Tape) -> Any:
    """Compile a tape: functions tape_points and tape_gradients (x y z, constants, out), and tape_points32 for a short tape."""
    module = llvm.parse_assembly(str(module_of(tape)))
    engine = llvm.create_mcjit_compiler(module, loader.target_machine())
    engine.finalize_object()
    return engine


def module_of(tape: Tape) -> ir.Module:
    """LLVM code of a tape: for one vector of points, and for many vectors in float32."""
    module = ir.Module("maquette.formula")
    for program in PROGRAMS[:2]:
        function = ir.Function(module, CODE, f"tape_{program}")
        inputs, constants, out = function.args
        b = ir.IRBuilder(function.append_basic_block("entry"))
        m, width = VectorMath(b), WIDTHS[program]
        zeros, ones = (m.everywhere(number) for number in (0.0, 1.0))
        variables = []
        for axis in range(3):
            derivatives = [ones if k == axis else zeros for k in range(width - 1)]
            variables.append([load(b, inputs, axis * width * BYTES), *derivatives])

        def constant(k: int, b: Any = b, constants: Any = constants, zero_slopes: Any = (zeros,) * (width - 1)) -> Any:
            return [load(b, constants, k * PARTS * BYTES), *zero_slopes]

        for k, part in enumerate(_emit_tape(tape, program, m, variables, constant)):
            store(b, out, k * BYTES, part)
        b.ret_void()
    if len(tape.code) <= MAX_ROWS_32:
        _add_rows(module, tape)
    return module


def _add_rows(module: ir.Module, tape: Tape) -> None:
    """Add the function for many vectors."""
    program, size = PROGRAMS[2], SINGLE.bytes
    function = ir.Function(module, ROWS, f"tape_{program}")
    inputs, constants, out, vectors = function.args
    b = ir.IRBuilder(function.append_basic_block("entry"))
    stride = b.mul(vectors, ir.Constant(I64, size))

    def vector(k: Any) -> None:
        offset = b.mul(k, ir.Constant(I64, size))
        variables = [[load(b, inputs, b.add(offset, b.mul(stride, ir.Constant(I64, axis))), SINGLE)] for axis in range(3)]
        m = VectorMath(b, form=SINGLE)
        (value,) = _emit_tape(tape, program, m, variables, lambda k: [load(b, constants, (k * PARTS + SHIFTS[program]) * size, SINGLE)])
        store(b, out, offset, value)

    over_vectors(b, vectors, vector)
    b.ret_void()


def _emit_tape(tape: Tape, program: str, m: VectorMath, variables: list[Any], constant: Callable[[int], Any]) -> Any:
    """Emit a tape for its inputs; return its result."""
    values = list(variables)

    def operand(name: int) -> Any:
        return values[name] if name >= 0 else constant(~name)

    for op, *operands in tape.code.tolist():
        if _closing.is_set():
            raise _Closing
        time.sleep(0)  # yields to the threads that render
        values.append(EMITTERS[program](m, Op(op), [operand(name) for name in operands[: arity(op)]], ir.Constant(I64, 0)))
    return operand(tape.results[0])
