"""Flush-to-zero mode in kernels (FTZ and DAZ): arithmetic on denormals is a hundred times slower on many processors.

    saved = simd.flush_denormals()
    ...                               # arithmetic
    simd.restore_denormals(saved)     # before returning: the mode belongs to the thread and affects Python's floats

Use it only where results below 10⁻³⁸ (float32) or 10⁻³⁰⁸ (float64) are insignificant. It has no effect on processors other than x86.
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

FLUSH = 0x8040  # MXCSR: flush denormal results (bit 15) and operands (bit 6) to zero


def _control(builder: Any, instruction: str, word: Any) -> None:
    pointer = builder.bitcast(word, I8.as_pointer())
    call(builder, f"llvm.x86.sse.{instruction}", ir.VoidType(), [pointer])


@intrinsic
def flush_denormals(typingctx):
    """Flush denormals to zero in this thread; return the previous mode (int32) for `restore_denormals`."""

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
    """Restore the mode that `flush_denormals` returned."""
    if not isinstance(saved, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        if target.X86:
            word = entry_alloca(builder, I32, 1)
            builder.store(context.cast(builder, args[0], sig.args[0], types.int32), word)
            _control(builder, "ldmxcsr", word)
        return context.get_dummy_value()

    return signature(types.void, saved), generate
