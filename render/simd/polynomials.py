"""Building blocks of elementary functions: polynomials, exact sums and products, C library fallback, shared functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

from . import target
from .llvm_expr import I32, Value, call, fma, ir_type, mask_bits


def polynomial(x: Value, coefficients: Sequence[float]) -> Value:
    """Evaluate a polynomial by Horner's scheme; the coefficient of the highest power comes first."""
    result = x.constant(coefficients[0])
    for c in coefficients[1:]:
        result = fma(result, x, x.constant(c))
    return result


def monic(x: Value, coefficients: Sequence[float]) -> Value:
    """Evaluate a monic polynomial; the leading coefficient 1 is not listed."""
    result = x + coefficients[0]
    for c in coefficients[1:]:
        result = fma(result, x, x.constant(c))
    return result


def two_sum(a: Value, b: Value) -> tuple[Value, Value]:
    """a + b and its exact rounding error (Knuth, The Art of Computer Programming 2, 4.2.2)."""
    s = a + b
    c = s - a
    return s, (a - (s - c)) + (b - c)


def fast_two_sum(a: Value, b: Value) -> tuple[Value, Value]:
    """two_sum for |a| ≥ |b| (Dekker 1971)."""
    s = a + b
    return s, b - (s - a)


def two_product(a: Value, b: Value) -> tuple[Value, Value]:
    """a · b and its exact rounding error; without a fused multiply-add by halves of the mantissas (Dekker 1971)."""
    p = a * b
    if target.FMA:
        return p, fma(a, b, -p)
    a1, a2 = _halves(a)
    b1, b2 = _halves(b)
    return p, ((a1 * b1 - p) + a1 * b2 + a2 * b1) + a2 * b2


def _halves(x: Value) -> tuple[Value, Value]:
    c = x * (134217729.0 if x.bits == 64 else 4097.0)
    high = c - (c - x)
    return high, x - high


def power_of_two(exponent: Value) -> Value:
    """2 to an integer power, from the exponent bits; for exponents of normal numbers."""
    mantissa, bias = (23, 127) if exponent.bits == 32 else (52, 1023)
    return ((exponent + bias) << mantissa).bitcast("f")


_SHIFT = 6755399441055744.0  # 1.5 · 2⁵²: adding it moves a float64 integer into the last bits
_SHIFT_BITS = 0x4338000000000000


def to_integer(x: Value) -> Value:
    """Convert integral floats below 2³¹ (float32) or 2⁵¹ to ints; only AVX-512 has an instruction for int64."""
    if x.bits == 32 or target.AVX512:
        return x.to("i", x.bits)
    return (x + _SHIFT).bitcast("i") - _SHIFT_BITS


def from_integer(x: Value) -> Value:
    """Convert ints below 2³¹ or 2⁵¹ to floats: the inverse of `whole`."""
    if x.bits == 32 or target.AVX512:
        return x.to("f", x.bits)
    return (x + _SHIFT_BITS).bitcast("f") - _SHIFT


def call_shared(name: str, body: Callable[..., Value], *arguments: Value) -> Value:
    """Call `body` as a function emitted once in a module; LLVM inlines small ones."""
    first = arguments[0]
    full_name = f"maquette.{name}.{first.kind}{first.bits}x{first.lanes}"
    module = first.builder.module
    if full_name not in module.globals:
        function = ir.Function(module, ir.FunctionType(first.raw.type, [a.raw.type for a in arguments]), full_name)
        function.linkage = "linkonce_odr"
        function.attributes.add("nounwind")
        builder = ir.IRBuilder(function.append_basic_block("entry"))
        builder.ret(body(*(Value(builder, raw, a.kind, a.bits) for raw, a in zip(function.args, arguments, strict=True))).raw)
    return first.like(first.builder.call(module.globals[full_name], [a.raw for a in arguments]))


def with_library_fallback(name: str, x: Value, result: Value, rare: Value) -> Value:
    """Replace `result` in the lanes of `rare` by the C library's function, evaluated in float64."""
    b = x.builder
    is_rare = mask_bits(rare) != 0
    before = b.block
    with b.if_then(is_rare.raw, likely=False):
        slow = call_shared(f"slow_{name}", lambda a: _lane_by_lane(name, a), x)
        mixed = b.select(rare.raw, slow.raw, result.raw)
        inside = b.block
    merged = b.phi(result.raw.type)
    merged.add_incoming(result.raw, before)
    merged.add_incoming(mixed, inside)
    return result.like(merged)


def _lane_by_lane(name: str, x: Value) -> Value:
    b, double = x.builder, ir_type("f", 64, 0)
    raw: Any = ir.Constant(x.raw.type, ir.Undefined)
    b.function.attributes.add("noinline")
    b.function.attributes.add("cold")
    for k in range(x.lanes or 1):
        lane = Value(b, b.extract_element(x.raw, ir.Constant(I32, k)) if x.lanes else x.raw, "f", x.bits)
        number = Value(b, call(b, f"llvm.{name}.f64", double, [lane.to("f", 64).raw]), "f", 64).to("f", x.bits)
        raw = b.insert_element(raw, number.raw, ir.Constant(I32, k)) if x.lanes else number.raw
    return x.like(raw)
