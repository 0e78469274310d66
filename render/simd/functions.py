"""Functions of vectors: constructors, conversions, choosing by a mask, roots and rounding, and what looks across lanes.

All of them also take plain numbers, so that a helper can be shared with scalar code.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import llvm_expr as v
from . import target as simd_target
from .llvm_expr import I1, I32, I64, Value
from .vector_type import Vector, intrinsic, meet, shape_of, type_for, value

Lowering = tuple[Signature, Callable[..., Any]] | None


def lowered(sig: Signature, emit: Callable[..., Any]) -> Lowering:
    """What an @intrinsic returns: a signature and code made of Values."""

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return emit(*(value(builder, a, t) for a, t in zip(args, sig.args, strict=True))).raw

    return sig, generate


def same(kinds: str, emit: Callable[..., Any], context: Any, *args: types.Type) -> Lowering:
    """A function whose operands and result have the type in which the operands meet, of one of `kinds`."""
    whole = meet(context, *args)
    shape = whole and shape_of(whole)
    if not shape or shape[0] not in kinds or (shape[0] != "m" and shape[1] < 32):
        return None
    return lowered(signature(whole, *[whole] * len(args)), emit)


# --- constructors and conversions ----------------------------------------------------------------------------------------


def _constructor(kind: str, bits: int, lanes: int) -> Any:
    target = Vector(kind, bits, lanes)

    def make(typingctx, x):
        if not (isinstance(x, types.Number | types.Boolean) or (isinstance(x, Vector) and x.lanes == lanes)):
            return None

        def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
            return context.cast(builder, args[0], sig.args[0], target)

        return signature(target, types.unliteral(x)), generate

    make.__name__ = make.__qualname__ = f"{kind}{bits}x{lanes}"
    make.__doc__ = f"A number in each of {lanes} lanes, or as many lanes of another kind converted."
    made = intrinsic(make)
    CONSTRUCTED[made] = target
    return made


CONSTRUCTED: dict[Any, Vector] = {}
"""The types that constructors make, by which they also name a type (`load`)."""

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


def _converted(kind: str, bits: int, context: Any, x: types.Type) -> Lowering:
    shape = shape_of(types.unliteral(x))
    if shape is None:
        return None
    return lowered(signature(type_for(kind, bits, shape[2]), types.unliteral(x)), lambda a: a.to(kind, bits))


@intrinsic
def to_f32(typingctx, x):
    """The same lanes as float32."""
    return _converted("f", 32, typingctx, x)


@intrinsic
def to_f64(typingctx, x):
    """The same lanes as float64."""
    return _converted("f", 64, typingctx, x)


@intrinsic
def to_i32(typingctx, x):
    """The same lanes as int32: towards zero from floats (any number where it does not fit), cut off from int64."""
    return _converted("i", 32, typingctx, x)


@intrinsic
def to_i64(typingctx, x):
    """The same lanes as int64, towards zero."""
    return _converted("i", 64, typingctx, x)


@intrinsic
def to_u32(typingctx, x):
    """The same lanes as uint32."""
    return _converted("u", 32, typingctx, x)


@intrinsic
def to_u64(typingctx, x):
    """The same lanes as uint64."""
    return _converted("u", 64, typingctx, x)


def _sibling(kind: str, x: types.Type, emit: Callable[[Value], Value]) -> Lowering:
    """A function to another kind of the same width."""
    shape = shape_of(types.unliteral(x))
    if shape is None or shape[0] == "m":
        return None
    return lowered(signature(type_for(kind, shape[1], shape[2]), types.unliteral(x)), emit)


@intrinsic
def float_bits(typingctx, x):
    """The bits of floats as ints of the same width."""
    return _sibling("i", x, lambda a: a.bitcast("i"))


@intrinsic
def bits_float(typingctx, x):
    """Ints as the floats that have these bits."""
    return _sibling("f", x, lambda a: a.bitcast("f"))


@intrinsic
def iota(typingctx, like):
    """0, 1, 2 … in the lanes of `like`, as ints of its width."""
    return _sibling("i", like, lambda a: _iota(a.of("i", ir.Constant(a.type_of("i"), None))))


def _iota(zero: Value) -> Value:
    return zero.constant(list(range(zero.lanes)) if zero.lanes else 0)


# --- choosing ------------------------------------------------------------------------------------------------------------


@intrinsic
def select(typingctx, mask, yes, no):
    """`yes` in the lanes where the mask is set, else `no`. Both are computed."""
    sig = select_signature(typingctx, mask, yes, no)
    return sig and lowered(sig, v.select)


def select_signature(typingctx: Any, mask: types.Type, yes: types.Type, no: types.Type) -> Signature | None:
    mask, yes, no = map(types.unliteral, (mask, yes, no))
    if isinstance(mask, Vector) and mask.kind == "m":
        whole = meet(typingctx, yes, no)
        shape = whole and shape_of(whole)
        if not shape:
            return None
        if not shape[2]:
            whole = Vector(shape[0], mask.bits, mask.lanes)
        return signature(whole, mask, whole, whole) if whole.lanes == mask.lanes else None
    whole = meet(typingctx, yes, no)
    return signature(whole, mask, whole, whole) if isinstance(mask, types.Boolean) and whole else None


@intrinsic
def minimum(typingctx, a, b):
    """The smaller of two; the second one where either is NaN."""
    return same("fiu", v.minimum, typingctx, a, b)


@intrinsic
def maximum(typingctx, a, b):
    """The larger of two; the second one where either is NaN."""
    return same("fiu", v.maximum, typingctx, a, b)


# --- arithmetic ----------------------------------------------------------------------------------------------------------


@intrinsic
def fma(typingctx, a, b, c):
    """a · b + c: rounded once on machines with the instruction (`machine.FMA`), else twice."""
    return same("f", v.fma, typingctx, a, b, c)


@intrinsic
def sqrt(typingctx, x):
    """The square root, correctly rounded; NaN below zero."""
    return same("f", lambda a: a.call("sqrt"), typingctx, x)


@intrinsic
def floor(typingctx, x):
    return same("f", lambda a: a.call("floor"), typingctx, x)


@intrinsic
def ceil(typingctx, x):
    return same("f", lambda a: a.call("ceil"), typingctx, x)


@intrinsic
def trunc(typingctx, x):
    """Towards zero."""
    return same("f", lambda a: a.call("trunc"), typingctx, x)


@intrinsic
def rint(typingctx, x):
    """The nearest whole number, halves to the even one."""
    return same("f", lambda a: a.call("nearbyint"), typingctx, x)


@intrinsic
def absolute(typingctx, x):
    return same("fiu", abs, typingctx, x)


@intrinsic
def copysign(typingctx, x, y):
    """The size of x with the sign of y."""
    return same("f", lambda a, b: a.call("copysign", b), typingctx, x, y)


@intrinsic
def is_finite(typingctx, x):
    """A mask: neither infinite nor NaN."""
    shape = shape_of(types.unliteral(x))
    if shape is None or shape[0] != "f":
        return None
    return lowered(signature(type_for("m", shape[1], shape[2]), types.unliteral(x)), lambda a: abs(a) < float("inf"))


def _estimate(x: Value, name: str) -> Value | None:
    """The processor's estimate of 1 / x or 1 / √x, of relative error 2⁻¹⁴ or less; None where it has none."""
    if not simd_target.AVX512 or x.kind != "f" or x.lanes * x.bits not in (128, 256, 512):
        return None
    b, every = x.builder, ir.IntType(8 if x.lanes <= 8 else 16)
    whole = f"llvm.x86.avx512.{name}14.p{'s' if x.bits == 32 else 'd'}.{x.lanes * x.bits}"
    return x.like(v.call(b, whole, x.raw.type, [x.raw, x.constant(0.0).raw, ir.Constant(every, -1)]))


def _reciprocal(x: Value) -> Value:
    y = _estimate(x, "rcp") if x.bits == 32 else None
    if y is None:
        return 1.0 / x
    error = v.fma(-x, y, y.constant(1.0))
    return v.select(abs(error) < 1.0, v.fma(y, error, y), y)  # one step of Newton's, which would make NaN of 0 and ∞


@intrinsic
def reciprocal(typingctx, x):
    """1 / x to 2 ulp: an estimate and a step of Newton's where the machine has one, else a division."""
    return same("f", _reciprocal, typingctx, x)


def _reciprocal_sqrt(x: Value) -> Value:
    y = _estimate(x, "rsqrt") if x.bits == 32 else None
    if y is None:
        return 1.0 / x.call("sqrt")
    error = v.fma(-(x * y), y, y.constant(1.0))
    return v.select(abs(error) < 1.0, v.fma(y * 0.5, error, y), y)


@intrinsic
def reciprocal_sqrt(typingctx, x):
    """1 / √x to 3 ulp: an estimate and a step of Newton's where the machine has one, else a root and a division."""
    return same("f", _reciprocal_sqrt, typingctx, x)


# --- masks ---------------------------------------------------------------------------------------------------------------


def mask_bits(mask: Value) -> Value:
    """A mask as an unsigned number of as many bits as it has lanes."""
    return Value(mask.builder, mask.builder.bitcast(mask.raw, ir.IntType(mask.lanes)) if mask.lanes else mask.raw, "u", mask.lanes or 1)


def _of_mask(result: types.Type, emit: Callable[[Value], Value], mask: types.Type) -> Lowering:
    mask = types.unliteral(mask)
    shape = shape_of(mask)
    return lowered(signature(result, mask), emit) if shape and shape[0] == "m" else None


@intrinsic
def any_of(typingctx, mask):
    """Whether a lane of the mask is set: what an `if` may ask."""
    return _of_mask(types.boolean, lambda m: mask_bits(m) != 0, mask)


@intrinsic
def all_of(typingctx, mask):
    """Whether every lane of the mask is set."""
    return _of_mask(types.boolean, lambda m: mask_bits(m) == (1 << max(m.lanes, 1)) - 1, mask)


@intrinsic
def none_of(typingctx, mask):
    """Whether no lane of the mask is set."""
    return _of_mask(types.boolean, lambda m: mask_bits(m) == 0, mask)


@intrinsic
def bits(typingctx, mask):
    """The mask as an int64: bit k is lane k."""
    return _of_mask(types.int64, lambda m: m.of("i", m.builder.zext(mask_bits(m).raw, I64), 64), mask)


@intrinsic
def count(typingctx, mask):
    """How many lanes of the mask are set."""
    return _of_mask(types.int64, lambda m: m.of("i", m.builder.zext(mask_bits(m).raw, I64), 64).call("ctpop"), mask)


@intrinsic
def mask_from_bits(typingctx, number, like):
    """The mask whose lane k is bit k of an integer, in the lanes of `like`."""
    if not isinstance(number, types.Integer) or not isinstance(like, Vector):
        return None
    result = Vector("m", like.bits, like.lanes)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        whole = context.cast(builder, args[0], sig.args[0], types.int64)
        return builder.bitcast(builder.trunc(whole, ir.IntType(result.lanes)), ir.VectorType(I1, result.lanes))

    return signature(result, number, like), generate


@intrinsic
def first_lanes(typingctx, n, like):
    """The mask of lanes 0 … n-1, in the lanes of `like`: for the rest of an array."""
    if not isinstance(n, types.Integer) or not isinstance(like, Vector):
        return None
    result = Vector("m", like.bits, like.lanes)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        number = Value(builder, context.cast(builder, args[0], sig.args[0], types.int64), "i", 64)
        number = v.minimum(v.maximum(number, number.constant(0)), number.constant(like.lanes)).to("i", 32).splat(like.lanes)
        return (_iota(number) < number).raw

    return signature(result, n, like), generate


@intrinsic
def trailing_zeros(typingctx, number):
    """The place of the lowest set bit of an integer, 64 for 0: with `bits`, the first set lane."""
    if not isinstance(number, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        whole = context.cast(builder, args[0], sig.args[0], types.int64)
        return v.call(builder, "llvm.cttz.i64", I64, [whole, ir.Constant(I1, 0)])

    return signature(types.int64, types.unliteral(number)), generate


@intrinsic
def population(typingctx, x):
    """How many bits of an integer are set, lane by lane of a vector."""
    return same("iu", lambda a: a.call("ctpop"), typingctx, x)


# --- across lanes --------------------------------------------------------------------------------------------------------


def _reduced(x: Value, join: Callable[[Value, Value], Value]) -> Value:
    """Halves joined until one lane is left: the same order on each run."""
    b, lanes = x.builder, x.lanes
    while lanes > 1:
        lanes //= 2
        low, high = (ir.Constant(ir.VectorType(I32, lanes), list(range(first, first + lanes))) for first in (0, lanes))
        x = join(x.like(b.shuffle_vector(x.raw, x.raw, low)), x.like(b.shuffle_vector(x.raw, x.raw, high)))
    return Value(b, b.extract_element(x.raw, ir.Constant(I32, 0)), x.kind, x.bits) if lanes else x


def _across(x: types.Type, join: Callable[[Value, Value], Value]) -> Lowering:
    x = types.unliteral(x)
    shape = shape_of(x)
    if shape is None or shape[0] == "m":
        return None
    return lowered(signature(type_for(shape[0], shape[1], 0), x), lambda a: _reduced(a, join))


@intrinsic
def sum_of(typingctx, x):
    """The sum of all lanes, added by halves: ((x0 + x2) + (x1 + x3)) for four."""
    return _across(x, lambda a, b: a + b)


@intrinsic
def min_of(typingctx, x):
    """The smallest lane; with NaN in a lane, any of them."""
    return _across(x, v.minimum)


@intrinsic
def max_of(typingctx, x):
    """The largest lane; with NaN in a lane, any of them."""
    return _across(x, v.maximum)


@intrinsic
def lane(typingctx, x, k):
    """The number in lane k (unchecked; quick where k is a constant)."""
    if not isinstance(x, Vector) or not isinstance(k, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return builder.extract_element(args[0], context.cast(builder, args[1], sig.args[1], types.int64))

    return signature(x.scalar, x, k), generate


@intrinsic
def with_lane(typingctx, x, k, number):
    """x with another number in lane k (unchecked)."""
    if not isinstance(x, Vector) or not isinstance(k, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        one = context.cast(builder, args[2], sig.args[2], x.scalar)
        return builder.insert_element(args[0], one, context.cast(builder, args[1], sig.args[1], types.int64))

    return signature(x, x, k, number), generate


def shuffled(b: Any, x: Any, y: Any, places: list[int]) -> Any:
    """LLVM's shuffle of two vectors by constant places."""
    return b.shuffle_vector(x, y, ir.Constant(ir.VectorType(I32, len(places)), places))


@intrinsic
def low_half(typingctx, x):
    """The first half of the lanes."""
    return _part(x, 0)


@intrinsic
def high_half(typingctx, x):
    """The second half of the lanes."""
    return _part(x, 1)


def _part(x: types.Type, half: int) -> Lowering:
    if not isinstance(x, Vector) or x.lanes < 2:
        return None
    n = x.lanes // 2
    return lowered(
        signature(Vector(x.kind, x.bits, n), x),
        lambda a: a.like(shuffled(a.builder, a.raw, a.raw, list(range(half * n, half * n + n)))),
    )


@intrinsic
def joined(typingctx, low, high):
    """The lanes of two vectors, one after the other."""
    if not isinstance(low, Vector) or low != high:
        return None
    return lowered(
        signature(Vector(low.kind, low.bits, 2 * low.lanes), low, high),
        lambda a, b: a.like(shuffled(a.builder, a.raw, b.raw, list(range(2 * a.lanes)))),
    )


@intrinsic
def transpose(typingctx, rows):
    """Of k vectors (k = 2, 4 or 8), lanes taken k at a time: k×k numbers with rows and columns exchanged.

    Four vectors of 16 lanes are four 4×4 blocks beside each other. With k lanes, lane j of vector i becomes lane i of vector j.
    """
    if not isinstance(rows, types.UniTuple) or not isinstance(rows.dtype, Vector):
        return None
    k, lanes = rows.count, rows.dtype.lanes
    if k not in (2, 4, 8) or lanes % k:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        from_tuple = [builder.extract_value(args[0], i) for i in range(k)]
        return context.make_tuple(builder, rows, transposed(builder, from_tuple, lanes))

    return signature(rows, rows), generate


def transposed(builder: Any, rows: list[Any], lanes: int) -> list[Any]:
    """Exchange rows and columns of blocks of as many lanes as there are rows, in shuffles that every machine has as one instruction."""

    def pairs(x: Any, y: Any, size: int, group: int) -> tuple[Any, Any]:
        """In each group of lanes: the runs of `size` lanes of its first half, those of x before those of y; and of its second half."""
        half, places = group // 2, ([], [])
        for start in range(0, lanes, group):
            for second in (0, 1):
                for at in range(start + second * half, start + second * half + half, size):
                    places[second].extend([*range(at, at + size), *range(lanes + at, lanes + at + size)])
        return shuffled(builder, x, y, places[0]), shuffled(builder, x, y, places[1])

    if len(rows) == 2:
        even = [lanes + n - 1 if n & 1 else n for n in range(lanes)]
        odd = [lanes + n if n & 1 else n + 1 for n in range(lanes)]
        return [shuffled(builder, rows[0], rows[1], even), shuffled(builder, rows[0], rows[1], odd)]
    made = []
    for k in range(0, len(rows), 4):  # within four lanes: a0 b0 a1 b1, a2 b2 a3 b3, then a0 b0 c0 d0 …
        (p, q), (r, s) = pairs(rows[k], rows[k + 1], 1, 4), pairs(rows[k + 2], rows[k + 3], 1, 4)
        made.extend([*pairs(p, r, 2, 4), *pairs(q, s, 2, 4)])
    if len(rows) == 8:
        halves = [pairs(made[k], made[k + 4], 4, 8) for k in range(4)]
        made = [first for first, _ in halves] + [second for _, second in halves]
    return made
