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


def _calling(kind: Any, places: Any) -> Any:
    """What emits a call of a function of this type by its address; places(place, sig, args) are its arguments."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        def place(number: int, index: Any = None) -> Any:
            return _place(context, builder, sig.args[number], args[number], ir.Constant(I64, 0) if index is None else index)

        builder.call(builder.inttoptr(args[0], kind.as_pointer()), places(builder, place, args))
        return context.get_dummy_value()

    return generate


@intrinsic
def interpret(typingctx, address, code, first, rows, registers, constants, begin, state, vectors):
    """Run an interpreter (interpreter.py) over `rows` instructions from row `first`; the tape's constants begin at element `begin`."""

    def places(b: Any, place: Any, args: Any) -> list[Any]:
        at = b.mul(args[2], ir.Constant(I64, ROW))
        return [place(1, at), args[3], place(4), place(5, args[6]), place(7), args[8]]

    i = types.int64
    return signature(types.void, i, code, i, i, registers, constants, i, state, i), _calling(INTERPRETER, places)


@intrinsic
def compiled(typingctx, address, registers, constants, begin, out):
    """Run a tape's own code (compiled.py) on the vectors x, y and z at the beginning of `registers`."""

    def places(b: Any, place: Any, args: Any) -> list[Any]:
        return [place(1), place(2, args[3]), place(4)]

    i = types.int64
    return signature(types.void, i, registers, constants, i, out), _calling(CODE, places)


@intrinsic
def count_up(typingctx, counters, index, by):
    """counters[index] += by, whatever other threads do."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = make_array(counters)(context, builder, args[0]).data
        builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "monotonic")
        return context.get_dummy_value()

    return signature(types.void, counters, types.int64, types.int64), generate


@intrinsic
def taken(typingctx, counters, index, by):
    """counters[index] as it was before `by` was added to it, whatever other threads do."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = make_array(counters)(context, builder, args[0]).data
        return builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "acq_rel")

    return signature(types.int64, counters, types.int64, types.int64), generate


@intrinsic
def claimed(typingctx, states, index):
    """states[index] (0 free, 1 taken, 2 done) as it was, taken now if it was free."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = make_array(states)(context, builder, args[0]).data
        zero, one = ir.Constant(I64, 0), ir.Constant(I64, 1)
        found = builder.cmpxchg(builder.gep(data, [args[1]]), zero, one, "acq_rel", "acquire")
        return builder.extract_value(found, 0)

    return signature(types.int64, states, types.int64), generate


@intrinsic
def released(typingctx, states, index):
    """states[index] = 2, after all that was written before."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = make_array(states)(context, builder, args[0]).data
        builder.atomic_rmw("max", builder.gep(data, [args[1]]), ir.Constant(I64, 2), "acq_rel")
        return context.get_dummy_value()

    return signature(types.void, states, types.int64), generate
