"""Constructors of vectors, conversions between number types, and lane numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import target as simd_target
from .llvm_expr import Value
from .vector_type import Lowering, Vector, intrinsic, lower, shape_of, type_for


def _constructor(kind: str, bits: int, lanes: int) -> Any:
    target = Vector(kind, bits, lanes)

    def make(typingctx, x):
        if not (isinstance(x, types.Number | types.Boolean) or (isinstance(x, Vector) and x.lanes == lanes)):
            return None

        def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
            return context.cast(builder, args[0], sig.args[0], target)

        return signature(target, types.unliteral(x)), generate

    make.__name__ = make.__qualname__ = f"{kind}{bits}x{lanes}"
    make.__doc__ = f"A number broadcast to {lanes} lanes, or the conversion of {lanes} lanes of another kind."
    constructor = intrinsic(make)
    CONSTRUCTED[constructor] = target
    return constructor


CONSTRUCTED: dict[Any, Vector] = {}
"""The type of each constructor; a constructor also names a type, as in `load`."""

f32x16, f32x8, f32x4, f32x2, f32x1 = (_constructor("f", 32, n) for n in (16, 8, 4, 2, 1))
i32x16, i32x8, i32x4, i32x2, i32x1 = (_constructor("i", 32, n) for n in (16, 8, 4, 2, 1))
u32x16, u32x8, u32x4, u32x2, u32x1 = (_constructor("u", 32, n) for n in (16, 8, 4, 2, 1))
m32x16, m32x8, m32x4, m32x2, m32x1 = (_constructor("m", 32, n) for n in (16, 8, 4, 2, 1))
f64x16, f64x8, f64x4, f64x2, f64x1 = (_constructor("f", 64, n) for n in (16, 8, 4, 2, 1))
i64x16, i64x8, i64x4, i64x2, i64x1 = (_constructor("i", 64, n) for n in (16, 8, 4, 2, 1))
u64x16, u64x8, u64x4, u64x2, u64x1 = (_constructor("u", 64, n) for n in (16, 8, 4, 2, 1))
m64x16, m64x8, m64x4, m64x2, m64x1 = (_constructor("m", 64, n) for n in (16, 8, 4, 2, 1))

f32, i32, u32, m32 = (_constructor(kind, 32, simd_target.WIDTH) for kind in "fium")
f64, i64, u64, m64 = (_constructor(kind, 64, simd_target.WIDTH64) for kind in "fium")


def _convert(kind: str, bits: int, context: Any, x: types.Type) -> Lowering:
    shape = shape_of(types.unliteral(x))
    if shape is None:
        return None
    return lower(signature(type_for(kind, bits, shape[2]), types.unliteral(x)), lambda a: a.to(kind, bits))


@intrinsic
def to_f32(typingctx, x):
    """Convert to float32."""
    return _convert("f", 32, typingctx, x)


@intrinsic
def to_f64(typingctx, x):
    """Convert to float64."""
    return _convert("f", 64, typingctx, x)


@intrinsic
def to_i32(typingctx, x):
    """Convert to int32: floats round towards zero (undefined on overflow), int64 lanes lose their high bits."""
    return _convert("i", 32, typingctx, x)


@intrinsic
def to_i64(typingctx, x):
    """Convert to int64, rounding towards zero."""
    return _convert("i", 64, typingctx, x)


@intrinsic
def to_u32(typingctx, x):
    """Convert to uint32."""
    return _convert("u", 32, typingctx, x)


@intrinsic
def to_u64(typingctx, x):
    """Convert to uint64."""
    return _convert("u", 64, typingctx, x)


def _lower_same_width(kind: str, x: types.Type, emit: Callable[[Value], Value]) -> Lowering:
    """Lower a function to another kind of the same lane width."""
    shape = shape_of(types.unliteral(x))
    if shape is None or shape[0] == "m":
        return None
    return lower(signature(type_for(kind, shape[1], shape[2]), types.unliteral(x)), emit)


@intrinsic
def float_bits(typingctx, x):
    """Reinterpret floats as ints of the same width."""
    return _lower_same_width("i", x, lambda a: a.bitcast("i"))


@intrinsic
def bits_float(typingctx, x):
    """Reinterpret ints as floats of the same width."""
    return _lower_same_width("f", x, lambda a: a.bitcast("f"))


@intrinsic
def iota(typingctx, like):
    """Return 0, 1, 2 … in the lanes of `like`, as ints of its lane width."""
    return _lower_same_width("i", like, lambda a: number_lanes(a.of("i", ir.Constant(a.type_of("i"), None))))


def number_lanes(zero: Value) -> Value:
    """Constant 0, 1, 2 … of the type of `zero`."""
    return zero.constant(list(range(zero.lanes)) if zero.lanes else 0)
