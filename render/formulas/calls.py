"""What kernels need to reach evaluators by their address, and to count across threads."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import signature
from numba.np.arrayobj import make_array

from ..simd.value import I64
from ..simd.vector import intrinsic
from .vectors import CODE, INTERPRETER, POINTER, ROW


def _place(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """A byte pointer to an element of an array."""
    data = make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), POINTER)


@intrinsic
def interpret(typingctx, address, code, first, rows, registers, constants, begin, state):
    """Run an interpreter (interpreter.py) over `rows` instructions from row `first`; the tape's constants begin at element `begin`."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = ir.Constant(I64, 0)
        function = builder.inttoptr(args[0], INTERPRETER.as_pointer())
        at = builder.mul(args[2], ir.Constant(I64, ROW))
        given = [
            _place(context, builder, code, args[1], at),
            args[3],
            _place(context, builder, registers, args[4], zero),
            _place(context, builder, constants, args[5], args[6]),
            _place(context, builder, state, args[7], zero),
        ]
        builder.call(function, given)
        return context.get_dummy_value()

    i = types.int64
    return signature(types.void, i, code, i, i, registers, constants, i, state), generate


@intrinsic
def compiled(typingctx, address, registers, constants, begin, out):
    """Run a tape's own code (compiled.py) on the vectors x, y and z at the beginning of `registers`."""
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero = ir.Constant(I64, 0)
        function = builder.inttoptr(args[0], CODE.as_pointer())
        given = [
            _place(context, builder, registers, args[1], zero),
            _place(context, builder, constants, args[2], args[3]),
            _place(context, builder, out, args[4], zero),
        ]
        builder.call(function, given)
        return context.get_dummy_value()

    i = types.int64
    return signature(types.void, i, registers, constants, i, out), generate


@intrinsic
def count_up(typingctx, counters, index, by):
    """counters[index] += by, whatever other threads do."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = make_array(counters)(context, builder, args[0]).data
        builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "monotonic")
        return context.get_dummy_value()

    return signature(types.void, counters, types.int64, types.int64), generate
