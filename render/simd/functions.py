"""Functions of vectors: selection by a mask, arithmetic, rounding, and masks. All of them also take scalars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import llvm_expr as v
from . import target as simd_target
from .constructors import number_lanes
from .llvm_expr import I1, I64, Value, mask_bits
from .vector_type import Lowering, Vector, common_type, intrinsic, lower, lower_uniform, shape_of, type_for

# --- selection -----------------------------------------------------------------------------------------------------------


@intrinsic
def select(typingctx, mask, yes, no):
    """Select `yes` in the lanes where the mask is set, else `no`. Both are computed."""
    sig = select_signature(typingctx, mask, yes, no)
    return sig and lower(sig, v.select)


def select_signature(typingctx: Any, mask: types.Type, yes: types.Type, no: types.Type) -> Signature | None:
    """Typing rule of `select`: the common type of `yes` and `no` in the lanes of the mask."""
    mask, yes, no = map(types.unliteral, (mask, yes, no))
    if isinstance(mask, Vector) and mask.kind == "m":
        common = common_type(typingctx, yes, no)
        shape = common and shape_of(common)
        if not shape:
            return None
        if not shape[2]:
            common = Vector(shape[0], mask.bits, mask.lanes)
        return signature(common, mask, common, common) if common.lanes == mask.lanes else None
    common = common_type(typingctx, yes, no)
    return signature(common, mask, common, common) if isinstance(mask, types.Boolean) and common else None


@intrinsic
def minimum(typingctx, a, b):
    """The smaller of two; the second one where either is NaN."""
    return lower_uniform("fiu", v.minimum, typingctx, a, b)


@intrinsic
def maximum(typingctx, a, b):
    """The larger of two; the second one where either is NaN."""
    return lower_uniform("fiu", v.maximum, typingctx, a, b)


# --- arithmetic ----------------------------------------------------------------------------------------------------------


@intrinsic
def fma(typingctx, a, b, c):
    """a · b + c: rounded once on machines with the instruction (`target.FMA`), else twice."""
    return lower_uniform("f", v.fma, typingctx, a, b, c)


@intrinsic
def sqrt(typingctx, x):
    """Square root, correctly rounded; NaN below zero."""
    return lower_uniform("f", lambda a: a.call("sqrt"), typingctx, x)


@intrinsic
def floor(typingctx, x):
    return lower_uniform("f", lambda a: a.call("floor"), typingctx, x)


@intrinsic
def ceil(typingctx, x):
    return lower_uniform("f", lambda a: a.call("ceil"), typingctx, x)


@intrinsic
def trunc(typingctx, x):
    """Round towards zero."""
    return lower_uniform("f", lambda a: a.call("trunc"), typingctx, x)


@intrinsic
def rint(typingctx, x):
    """Round to the nearest integer, halves to even."""
    return lower_uniform("f", lambda a: a.call("nearbyint"), typingctx, x)


@intrinsic
def absolute(typingctx, x):
    return lower_uniform("fiu", abs, typingctx, x)


@intrinsic
def copysign(typingctx, x, y):
    """Magnitude of x with the sign of y."""
    return lower_uniform("f", lambda a, b: a.call("copysign", b), typingctx, x, y)


@intrinsic
def is_finite(typingctx, x):
    """Mask of lanes that are neither infinite nor NaN."""
    shape = shape_of(types.unliteral(x))
    if shape is None or shape[0] != "f":
        return None
    return lower(signature(type_for("m", shape[1], shape[2]), types.unliteral(x)), lambda a: abs(a) < float("inf"))


def _estimate(x: Value, name: str) -> Value | None:
    """Emit the AVX-512 estimate of 1 / x or 1 / √x, of relative error ≤ 2⁻¹⁴; None if there is no instruction."""
    if not simd_target.AVX512 or x.kind != "f" or x.lanes * x.bits not in (128, 256, 512):
        return None
    b, every = x.builder, ir.IntType(8 if x.lanes <= 8 else 16)
    full_name = f"llvm.x86.avx512.{name}14.p{'s' if x.bits == 32 else 'd'}.{x.lanes * x.bits}"
    return x.like(v.call(b, full_name, x.raw.type, [x.raw, x.constant(0.0).raw, ir.Constant(every, -1)]))


def _reciprocal(x: Value) -> Value:
    y = _estimate(x, "rcp") if x.bits == 32 else None
    if y is None:
        return 1.0 / x
    error = v.fma(-x, y, y.constant(1.0))
    return v.select(abs(error) < 1.0, v.fma(y, error, y), y)  # one Newton step, skipped for 0 and ∞: it would give NaN


@intrinsic
def reciprocal(typingctx, x):
    """1 / x to 2 ulp: an estimate and a Newton step if the machine has the estimate, else a division."""
    return lower_uniform("f", _reciprocal, typingctx, x)


def _reciprocal_sqrt(x: Value) -> Value:
    y = _estimate(x, "rsqrt") if x.bits == 32 else None
    if y is None:
        return 1.0 / x.call("sqrt")
    error = v.fma(-(x * y), y, y.constant(1.0))
    return v.select(abs(error) < 1.0, v.fma(y * 0.5, error, y), y)


@intrinsic
def reciprocal_sqrt(typingctx, x):
    """1 / √x to 3 ulp: an estimate and a Newton step if the machine has the estimate, else a root and a division."""
    return lower_uniform("f", _reciprocal_sqrt, typingctx, x)


# --- masks ---------------------------------------------------------------------------------------------------------------


def _lower_mask(result: types.Type, emit: Callable[[Value], Value], mask: types.Type) -> Lowering:
    mask = types.unliteral(mask)
    shape = shape_of(mask)
    return lower(signature(result, mask), emit) if shape and shape[0] == "m" else None


@intrinsic
def any_of(typingctx, mask):
    """Return whether any lane of the mask is set, as a scalar for an `if`."""
    return _lower_mask(types.boolean, lambda m: mask_bits(m) != 0, mask)


@intrinsic
def all_of(typingctx, mask):
    """Return whether every lane of the mask is set."""
    return _lower_mask(types.boolean, lambda m: mask_bits(m) == (1 << max(m.lanes, 1)) - 1, mask)


@intrinsic
def none_of(typingctx, mask):
    """Return whether no lane of the mask is set."""
    return _lower_mask(types.boolean, lambda m: mask_bits(m) == 0, mask)


@intrinsic
def bits(typingctx, mask):
    """Convert the mask to an int64: bit k is lane k."""
    return _lower_mask(types.int64, lambda m: m.of("i", m.builder.zext(mask_bits(m).raw, I64), 64), mask)


@intrinsic
def count(typingctx, mask):
    """Count the set lanes of the mask."""
    return _lower_mask(types.int64, lambda m: m.of("i", m.builder.zext(mask_bits(m).raw, I64), 64).call("ctpop"), mask)


@intrinsic
def mask_from_bits(typingctx, number, like):
    """Build a mask with the lanes of `like` from an integer: lane k is bit k."""
    if not isinstance(number, types.Integer) or not isinstance(like, Vector):
        return None
    result = Vector("m", like.bits, like.lanes)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        bits = context.cast(builder, args[0], sig.args[0], types.int64)
        return builder.bitcast(builder.trunc(bits, ir.IntType(result.lanes)), ir.VectorType(I1, result.lanes))

    return signature(result, number, like), generate


@intrinsic
def first_lanes(typingctx, n, like):
    """Build the mask of lanes 0 … n − 1 with the lanes of `like`, for the tail of an array."""
    if not isinstance(n, types.Integer) or not isinstance(like, Vector):
        return None
    result = Vector("m", like.bits, like.lanes)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        number = Value(builder, context.cast(builder, args[0], sig.args[0], types.int64), "i", 64)
        number = v.minimum(v.maximum(number, number.constant(0)), number.constant(like.lanes)).to("i", 32).splat(like.lanes)
        return (number_lanes(number) < number).raw

    return signature(result, n, like), generate


@intrinsic
def trailing_zeros(typingctx, number):
    """Index of the lowest set bit of an integer, 64 for 0; of `bits(mask)` it is the first set lane."""
    if not isinstance(number, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        bits = context.cast(builder, args[0], sig.args[0], types.int64)
        return v.call(builder, "llvm.cttz.i64", I64, [bits, ir.Constant(I1, 0)])

    return signature(types.int64, types.unliteral(number)), generate


@intrinsic
def population(typingctx, x):
    """Count the set bits of an integer, in each lane of a vector."""
    return lower_uniform("iu", lambda a: a.call("ctpop"), typingctx, x)
