"""Intrinsics that call tape evaluators by their address."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from ..simd.llvm_expr import I64
from ..simd.registration import intrinsic, make_array, signature, types
from .llvm_math import CODE, INTERPRETER, POINTER, ROW, ROWS


def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Byte pointer to an element of an array."""
    data = make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), POINTER)


def _emit_call(kind: Any, places: Any) -> Any:
    """Code generator of a call by address of a function of this type; places(builder, place, args) returns its arguments."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def place(number: int, index: Any = None) -> Any:
            return _place(context, builder, sig.args[number], args[number], ir.Constant(I64, 0) if index is None else index)

        builder.call(builder.inttoptr(args[0], kind.as_pointer()), places(builder, place, args))
        return context.get_dummy_value()

    return generate


@intrinsic
def interpret(typingctx, address, code, first, rows, registers, constants, begin, state, vectors):
    """Run an interpreter (interpreter.py) over `rows` instructions from row `first`; constants begin at element `begin`."""

    def places(b: Any, place: Any, args: Any) -> list[Any]:
        row_offset = b.mul(args[2], ir.Constant(I64, ROW))
        return [place(1, row_offset), args[3], place(4), place(5, args[6]), place(7), args[8]]

    i = types.int64
    return signature(types.void, i, code, i, i, registers, constants, i, state, i), _emit_call(INTERPRETER, places)


@intrinsic
def run_compiled(typingctx, address, registers, constants, begin, out):
    """Run a tape's compiled code (tape_jit.py) on the vectors x, y and z at the beginning of `registers`."""

    def places(b: Any, place: Any, args: Any) -> list[Any]:
        return [place(1), place(2, args[3]), place(4)]

    i = types.int64
    return signature(types.void, i, registers, constants, i, out), _emit_call(CODE, places)


@intrinsic
def run_compiled_rows(typingctx, address, registers, constants, out, vectors):
    """Run a tape's compiled float32 code on `vectors` vectors each of x, y and z at the beginning of `registers`.

    The values go to `registers` from element `out` on.
    """

    def places(b: Any, place: Any, args: Any) -> list[Any]:
        return [place(1), place(2), place(1, args[3]), args[4]]

    i = types.int64
    return signature(types.void, i, registers, constants, i, i), _emit_call(ROWS, places)
