"""Atomic operations on int64 counters and states in kernels."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from .llvm_expr import I64
from .registration import intrinsic, make_array, signature, types


def _element(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    """Address of array[index]."""
    return builder.gep(make_array(kind)(context, builder, array).data, [index])


@intrinsic
def count_up(typingctx, counters, index, by):
    """Add `by` to counters[index] atomically (relaxed order)."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.atomic_rmw("add", _element(context, builder, counters, *args[:2]), args[2], "monotonic")
        return context.get_dummy_value()

    return signature(types.void, counters, types.int64, types.int64), generate


@intrinsic
def fetch_add(typingctx, counters, index, by):
    """Add `by` to counters[index] atomically; return the value before."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.atomic_rmw("add", _element(context, builder, counters, *args[:2]), args[2], "acq_rel")

    return signature(types.int64, counters, types.int64, types.int64), generate


@intrinsic
def load_acquire(typingctx, counters, index):
    """Load counters[index] with acquire order."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.load_atomic(_element(context, builder, counters, *args), "acquire", 8)

    return signature(types.int64, counters, types.int64), generate


@intrinsic
def try_claim(typingctx, states, index):
    """Claim states[index] (0 free, 1 claimed, 2 done) if it is free; return the value before."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        zero, claimed = ir.Constant(I64, 0), ir.Constant(I64, 1)
        previous = builder.cmpxchg(_element(context, builder, states, *args), zero, claimed, "acq_rel", "acquire")
        return builder.extract_value(previous, 0)

    return signature(types.int64, states, types.int64), generate


@intrinsic
def store_release(typingctx, states, index):
    """Set states[index] to 2 (done) with release order."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.atomic_rmw("max", _element(context, builder, states, *args), ir.Constant(I64, 2), "acq_rel")
        return context.get_dummy_value()

    return signature(types.void, states, types.int64), generate
