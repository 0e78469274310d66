"""LLVM expressions in Python notation, for scalars and vectors.

A Value is an LLVM value with its builder; `a * b + 1.0` on Values emits the instructions. The operators, the functions and the polynomials
of this package use it. Python numbers become constants of the other operand's type. Both operands must have one type: convert first (`to`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

from llvmlite import ir

from . import target as simd_target

I1, I8, I32, I64 = ir.IntType(1), ir.IntType(8), ir.IntType(32), ir.IntType(64)
F32, F64 = ir.FloatType(), ir.DoubleType()


def ir_type(kind: str, bits: int, lanes: int) -> Any:
    """LLVM type of a vector, or of a scalar for 0 lanes. A mask has one bit a lane for any lane width."""
    element = (F32 if bits == 32 else F64) if kind == "f" else I1 if kind == "m" else ir.IntType(bits)
    return ir.VectorType(element, lanes) if lanes else element


class Value:
    """An LLVM value with its kind ("f", "i", "u" or "m"), the bits of a lane, and its lanes (0: a scalar)."""

    __hash__ = None  # pyright: ignore[reportAssignmentType] - == emits a comparison

    def __init__(self, builder: Any, raw: Any, kind: str, bits: int) -> None:
        self.builder, self.raw, self.kind, self.bits = builder, raw, kind, bits
        self.lanes: int = raw.type.count if isinstance(raw.type, ir.VectorType) else 0

    # --- construction -------------------------------------------------------------------------------------------------------

    def like(self, raw: Any) -> Value:
        """Wrap a raw value of this type."""
        return Value(self.builder, raw, self.kind, self.bits)

    def of(self, kind: str, raw: Any, bits: int = 0) -> Value:
        """Wrap a raw value of another kind, of this lane width unless `bits` is given."""
        return Value(self.builder, raw, kind, bits or self.bits)

    def constant(self, number: float | Sequence[float]) -> Value:
        """Constant of this type: one number for all lanes, or one for each."""
        kind = ir_type(self.kind, self.bits, self.lanes)
        many = isinstance(number, Sequence)
        numbers = [_number(self.kind, self.bits, n) for n in (number if many else [number])]
        if self.lanes:
            return self.like(ir.Constant(kind, numbers if many else numbers * self.lanes))
        return self.like(ir.Constant(kind, numbers[0]))

    def type_of(self, kind: str, bits: int = 0) -> Any:
        """LLVM type of as many lanes of another kind."""
        return ir_type(kind, bits or self.bits, self.lanes)

    def call(self, name: str, *others: Value, result: Value | None = None) -> Value:
        """Call an LLVM intrinsic overloaded on this type, such as sqrt."""
        suffix = ("f" if self.kind == "f" else "i") + str(1 if self.kind == "m" else self.bits)
        full_name = f"llvm.{name}.{f'v{self.lanes}' if self.lanes else ''}{suffix}"
        return (result or self).like(call(self.builder, full_name, (result or self).raw.type, [self.raw, *(o.raw for o in others)]))

    def _other(self, other: Any) -> Value:
        if isinstance(other, Value):
            assert other.raw.type == self.raw.type, f"{self.raw.type} with {other.raw.type}"
            return other
        return self.constant(other)

    # --- conversions --------------------------------------------------------------------------------------------------------

    def to(self, kind: str, bits: int) -> Value:
        """Convert: floats to ints towards zero, masks to 0 and 1, wider ints truncated."""
        b, target = self.builder, self.type_of(kind, bits)
        if kind == "m":
            return self.of("m", (self if self.kind == "m" else self != 0).raw, bits)
        if self.kind == "m":
            return self.of(kind, b.uitofp(self.raw, target) if kind == "f" else b.zext(self.raw, target), bits)
        if self.kind == "f":
            if kind == "f":
                raw = self.raw if bits == self.bits else b.fpext(self.raw, target) if bits > self.bits else b.fptrunc(self.raw, target)
            else:
                raw = (b.fptosi if kind == "i" else b.fptoui)(self.raw, target)
        elif kind == "f":
            raw = (b.sitofp if self.kind == "i" else b.uitofp)(self.raw, target)
        elif bits == self.bits:
            raw = self.raw
        else:
            raw = b.trunc(self.raw, target) if bits < self.bits else (b.sext if self.kind == "i" else b.zext)(self.raw, target)
        return self.of(kind, raw, bits)

    def bitcast(self, kind: str) -> Value:
        """Reinterpret the bits as another kind."""
        return self.of(kind, self.builder.bitcast(self.raw, self.type_of(kind)))

    def splat(self, lanes: int) -> Value:
        """Broadcast this scalar to all lanes."""
        vector_type = ir.VectorType(self.raw.type, lanes)
        vector = self.builder.insert_element(ir.Constant(vector_type, ir.Undefined), self.raw, ir.Constant(I32, 0))
        return self.like(self.builder.shuffle_vector(vector, vector, ir.Constant(ir.VectorType(I32, lanes), [0] * lanes)))

    # --- arithmetic ---------------------------------------------------------------------------------------------------------

    def _arithmetic(self, other: Any, on_floats: str, on_ints: str) -> Value:
        other = self._other(other)
        return self.like(getattr(self.builder, on_floats if self.kind == "f" else on_ints)(self.raw, other.raw))

    def __add__(self, other: Any) -> Value:
        return self._arithmetic(other, "fadd", "add")

    def __radd__(self, other: Any) -> Value:
        return self._other(other) + self

    def __sub__(self, other: Any) -> Value:
        return self._arithmetic(other, "fsub", "sub")

    def __rsub__(self, other: Any) -> Value:
        return self._other(other) - self

    def __mul__(self, other: Any) -> Value:
        return self._arithmetic(other, "fmul", "mul")

    def __rmul__(self, other: Any) -> Value:
        return self._other(other) * self

    def __truediv__(self, other: Any) -> Value:
        assert self.kind == "f"
        return self.like(self.builder.fdiv(self.raw, self._other(other).raw))

    def __rtruediv__(self, other: Any) -> Value:
        return self._other(other) / self

    def __floordiv__(self, other: Any) -> Value:
        return floor_divide(self, self._other(other))[0]

    def __mod__(self, other: Any) -> Value:
        return floor_divide(self, self._other(other))[1]

    def __neg__(self) -> Value:
        return self.like(self.builder.fneg(self.raw) if self.kind == "f" else self.builder.neg(self.raw))

    def __pos__(self) -> Self:
        return self

    def __abs__(self) -> Value:
        if self.kind == "f":
            return self.call("fabs")
        return self if self.kind == "u" else select(self < 0, -self, self)

    # --- bits ---------------------------------------------------------------------------------------------------------------

    def __and__(self, other: Any) -> Value:
        return self.like(self.builder.and_(self.raw, self._other(other).raw))

    def __or__(self, other: Any) -> Value:
        return self.like(self.builder.or_(self.raw, self._other(other).raw))

    def __xor__(self, other: Any) -> Value:
        return self.like(self.builder.xor(self.raw, self._other(other).raw))

    def __invert__(self) -> Value:
        return self.like(self.builder.not_(self.raw))

    def __lshift__(self, other: Any) -> Value:
        return self.like(self.builder.shl(self.raw, self._other(other).raw))

    def __rshift__(self, other: Any) -> Value:
        shift = self.builder.ashr if self.kind == "i" else self.builder.lshr
        return self.like(shift(self.raw, self._other(other).raw))

    # --- comparisons: false with NaN, except != ------------------------------------------------------------------------------

    def _compare(self, sign: str, other: Any) -> Value:
        b, other = self.builder, self._other(other)
        if self.kind == "f":
            compare = b.fcmp_unordered if sign == "!=" else b.fcmp_ordered
        else:
            compare = b.icmp_signed if self.kind == "i" else b.icmp_unsigned
        return self.of("m", compare(sign, self.raw, other.raw))

    def __lt__(self, other: Any) -> Value:
        return self._compare("<", other)

    def __le__(self, other: Any) -> Value:
        return self._compare("<=", other)

    def __gt__(self, other: Any) -> Value:
        return self._compare(">", other)

    def __ge__(self, other: Any) -> Value:
        return self._compare(">=", other)

    def __eq__(self, other: object) -> Value:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._compare("==", other)

    def __ne__(self, other: object) -> Value:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._compare("!=", other)


def _number(kind: str, bits: int, number: float) -> Any:
    if kind == "f":
        return float(number)
    if kind == "m":
        return int(bool(number))
    return int(number) & (1 << bits) - 1


def call(builder: Any, name: str, result: Any, arguments: Sequence[Any]) -> Any:
    """Call an LLVM intrinsic or library function by its full name."""
    function = builder.module.globals.get(name)
    return builder.call(function or ir.Function(builder.module, ir.FunctionType(result, [a.type for a in arguments]), name), arguments)


def select(mask: Value, yes: Value, no: Value) -> Value:
    """Select `yes` where the mask is set, else `no`."""
    return yes.like(yes.builder.select(mask.raw, yes.raw, no.raw))


def mask_bits(mask: Value) -> Value:
    """Convert a mask to an unsigned integer with one bit a lane."""
    return Value(mask.builder, mask.builder.bitcast(mask.raw, ir.IntType(mask.lanes)) if mask.lanes else mask.raw, "u", mask.lanes or 1)


def minimum(a: Value, b: Value) -> Value:
    """The smaller; `b` where either is NaN (one instruction on x86)."""
    return select(a < b, a, b)


def maximum(a: Value, b: Value) -> Value:
    """The larger; `b` where either is NaN."""
    return select(a > b, a, b)


def fma(a: Value, b: Value, c: Value) -> Value:
    """a · b + c, rounded once if the machine has the instruction, else twice."""
    return a.call("fma", b, c) if simd_target.FMA else a * b + c


def floor_divide(a: Value, b: Value) -> tuple[Value, Value]:
    """Quotient and remainder as Python's // and % have them; integers by zero give 0 and 0, as in numpy."""
    if a.kind == "f":
        return _floor_divide_floats(a, b)
    by_zero, builder = b == 0, a.builder
    safe = select(by_zero, b.constant(1), b)
    if a.kind == "u":
        quotient, remainder = a.like(builder.udiv(a.raw, safe.raw)), a.like(builder.urem(a.raw, safe.raw))
    else:
        minus = safe == -1  # the lowest integer divided by −1 traps
        safe = select(minus, safe.constant(1), safe)
        signed = select(minus, -a, a)
        quotient = signed.like(builder.sdiv(signed.raw, safe.raw))
        remainder = signed - quotient * safe
        off = (remainder != 0) & ((remainder ^ safe) < 0)
        quotient, remainder = quotient + select(off, a.constant(-1), a.constant(0)), remainder + select(off, safe, a.constant(0))
    zero = a.constant(0)
    return select(by_zero, zero, quotient), select(by_zero, zero, remainder)


def _floor_divide_floats(a: Value, b: Value) -> tuple[Value, Value]:
    """As numpy's floor_divide and remainder: frem is exact, and the remainder has the divisor's sign."""
    remainder = a.like(a.builder.frem(a.raw, b.raw))
    off = (remainder != 0.0) & ((remainder < 0.0) ^ (b < 0.0))
    quotient = (a - remainder) / b - select(off, a.constant(1.0), a.constant(0.0))
    rounded = quotient.call("floor")
    rounded = select(quotient - rounded > 0.5, rounded + 1.0, rounded)
    floor_quotient = select(quotient != 0.0, rounded, (a / b).call("copysign", a / b) * 0.0)
    remainder = select(off, remainder + b, remainder)
    remainder = select(remainder == 0.0, a.constant(0.0).call("copysign", b), remainder)
    return select(b == 0.0, a / b, floor_quotient), select(b == 0.0, a.like(a.builder.frem(a.raw, b.raw)), remainder)
