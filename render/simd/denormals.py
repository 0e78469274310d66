"""Denormal numbers taken as zero inside a kernel: arithmetic on them is a hundred times slower on many processors.

    saved = simd.flush_denormals()
    ...                               # all work on numbers
    simd.restore_denormals(saved)     # before returning: the setting is the thread's, and Python's floats live there too

Only where results below 10⁻³⁸ (float32) or 10⁻³⁰⁸ (float64) are worth nothing. Where the processor has no such switch, or none
that is known here, nothing happens.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import target
from .llvm_expr import I8, I32, call
from .memory import entry_alloca
from .vector_type import intrinsic

FLUSH = 0x8040  # MXCSR: results (bit 15) and operands (bit 6) that are denormal become zero


def _control(builder: Any, instruction: str, word: Any) -> None:
    pointer = builder.bitcast(word, I8.as_pointer())
    call(builder, f"llvm.x86.sse.{instruction}", ir.VoidType(), [pointer])


@intrinsic
def flush_denormals(typingctx):
    """Take denormals as zero from here on, in this thread; the setting before, for `restore_denormals` (int32)."""

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        if not target.X86:
            return ir.Constant(I32, 0)
        word = entry_alloca(builder, I32, 1)
        _control(builder, "stmxcsr", word)
        saved = builder.load(word)
        builder.store(builder.or_(saved, ir.Constant(I32, FLUSH)), word)
        _control(builder, "ldmxcsr", word)
        return saved

    return signature(types.int32), generate


@intrinsic
def restore_denormals(typingctx, saved):
    """Set again what `flush_denormals` gave."""
    if not isinstance(saved, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        if target.X86:
            word = entry_alloca(builder, I32, 1)
            builder.store(context.cast(builder, args[0], sig.args[0], types.int32), word)
            _control(builder, "ldmxcsr", word)
        return context.get_dummy_value()

    return signature(types.void, saved), generate
