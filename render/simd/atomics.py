"""Counters and states that several threads change at the same time, in kernels."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import signature
from numba.np.arrayobj import make_array

from .llvm_expr import I64
from .vector_type import intrinsic


def _element(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Where array[index] is."""
    return builder.gep(make_array(kind)(context, builder, array).data, [index])


@intrinsic
def count_up(typingctx, counters, index, by):
    """counters[index] += by, whatever other threads do."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.atomic_rmw("add", _element(context, builder, counters, *args[:2]), args[2], "monotonic")
        return context.get_dummy_value()

    return signature(types.void, counters, types.int64, types.int64), generate


@intrinsic
def fetch_add(typingctx, counters, index, by):
    """counters[index] as it was before `by` was added to it, whatever other threads do."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", _element(context, builder, counters, *args[:2]), args[2], "acq_rel")

    return signature(types.int64, counters, types.int64, types.int64), generate


@intrinsic
def load_acquire(typingctx, counters, index):
    """counters[index] now, and all that was written before it became that."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_element(context, builder, counters, *args), "acquire", 8)

    return signature(types.int64, counters, types.int64), generate


@intrinsic
def try_claim(typingctx, states, index):
    """states[index] (0 free, 1 taken, 2 done) as it was, taken now if it was free."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero, one = ir.Constant(I64, 0), ir.Constant(I64, 1)
        found = builder.cmpxchg(_element(context, builder, states, *args), zero, one, "acq_rel", "acquire")
        return builder.extract_value(found, 0)

    return signature(types.int64, states, types.int64), generate


@intrinsic
def store_release(typingctx, states, index):
    """states[index] = 2, after all that was written before."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.atomic_rmw("max", _element(context, builder, states, *args), ir.Constant(I64, 2), "acq_rel")
        return context.get_dummy_value()

    return signature(types.void, states, types.int64), generate
