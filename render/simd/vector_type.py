"""The Numba type of SIMD vectors, its promotion rules and implicit conversions, and how intrinsics lower to Values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba.extending
from numba.core import types
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import Signature, signature
from numba.extending import lower_cast, models, register_model

from .llvm_expr import Value, ir_type

_SCALARS = {
    ("f", 32): types.float32, ("f", 64): types.float64, ("i", 32): types.int32, ("i", 64): types.int64,
    ("u", 32): types.uint32, ("u", 64): types.uint64, ("m", 32): types.boolean, ("m", 64): types.boolean,
}  # fmt: skip


class Vector(types.Type):
    """`lanes` values of 32 or 64 bits of a kind: "f" float, "i" int, "u" unsigned, "m" mask; its name is like f32x16.

    A mask records the lane width of the compared vectors, so that `select` of two scalars by it has that width.
    """

    def __init__(self, kind: str, bits: int, lanes: int) -> None:
        self.kind, self.bits, self.lanes = kind, bits, lanes
        super().__init__(name=f"{kind}{bits}x{lanes}")

    @property
    def scalar(self) -> types.Type:
        """The type of one lane."""
        return _SCALARS[self.kind, self.bits]

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Unify a variable that is a scalar on one path and a vector on another to the vector type."""
        if isinstance(other, types.Number | types.Boolean | Vector) and other != self and promote(self, other) == self:
            return Conversion.safe
        return None


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Vector) -> None:
        super().__init__(manager, kind, ir_type(kind.kind, kind.bits, kind.lanes))


def shape_of(kind: Any) -> tuple[str, int, int] | None:
    """(kind, bits, lanes) of a vector, or with 0 lanes of a number or boolean; None for other types."""
    if isinstance(kind, Vector):
        return kind.kind, kind.bits, kind.lanes
    if isinstance(kind, types.Boolean):
        return "m", 32, 0
    if isinstance(kind, types.Float):
        return "f", kind.bitwidth, 0
    if isinstance(kind, types.Integer):
        return ("i" if kind.signed else "u"), kind.bitwidth, 0  # pyright: ignore[reportAttributeAccessIssue]
    return None


def type_for(kind: str, bits: int, lanes: int) -> Any:
    """Numba type of a shape: a Vector, or a scalar for 0 lanes."""
    return Vector(kind, bits, lanes) if lanes else _SCALARS[kind, bits]


def promote(a: types.Type, b: types.Type) -> Vector | None:
    """Promote two operands, at least one a vector, to a common type; None if there is none.

    A scalar takes the vector's width: f32x16 · 0.5 is f32x16, and i32x16 + 1 is i32x16. Ints and floats promote to floats of the same
    width. Vectors of two widths have no common type: convert one explicitly (to_f32, to_f64 …).
    """
    if not isinstance(a, Vector):
        a, b = b, a
    if not isinstance(a, Vector):
        return None
    other = shape_of(b)
    if other is None:
        return None
    kind, bits, lanes = other
    if not lanes:
        if kind == "f" and a.kind != "f":
            return Vector("f", a.bits, a.lanes)
        if a.kind == "m" and kind != "m":
            return Vector(kind, a.bits, a.lanes)
        return a
    if lanes != a.lanes:
        return None
    if "m" in (kind, a.kind):
        if kind == a.kind:
            return Vector("m", max(bits, a.bits), lanes)
        return a if kind == "m" else Vector(kind, bits, lanes)
    if bits != a.bits or {kind, a.kind} == {"i", "u"}:
        return None
    return Vector("f" if "f" in (kind, a.kind) else kind, bits, lanes)


def common_type(typingctx: Any, *kinds: types.Type) -> Any:
    """Common type of operands, vectors or scalars; None if there is none."""
    common = types.unliteral(kinds[0])
    for kind in kinds[1:]:
        kind = types.unliteral(kind)
        if common is None:
            return None
        if isinstance(common, Vector) or isinstance(kind, Vector):
            common = promote(common, kind)
        else:
            common = typingctx.unify_types(common, kind)
    return common


def value(builder: Any, raw: Any, kind: types.Type) -> Value:
    """Wrap a raw LLVM value of a Numba type as a Value."""
    shape = shape_of(kind)
    assert shape is not None, kind
    return Value(builder, raw, shape[0], shape[1])


def intrinsic(definition: Callable[..., Any] | None = None, *, prefer_literal: bool = False) -> Any:
    """Numba's @intrinsic, typed for type checkers as a decorator to Any.

    `definition(typingctx, *kinds)` returns a signature and a code generator, or None for unsupported types.
    """
    decorate = numba.extending.intrinsic(prefer_literal=prefer_literal)
    return decorate(definition) if definition else decorate


Lowering = tuple[Signature, Callable[..., Any]] | None


def lower(sig: Signature, emit: Callable[..., Any]) -> Lowering:
    """Build the result of an @intrinsic: a signature, and a code generator whose arguments and result are Values."""

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return emit(*(value(builder, a, t) for a, t in zip(args, sig.args, strict=True))).raw

    return sig, generate


def lower_uniform(kinds: str, emit: Callable[..., Any], context: Any, *args: types.Type) -> Lowering:
    """Lower a function whose operands and result have the operands' common type; None unless that is of one of `kinds`."""
    common = common_type(context, *args)
    shape = common and shape_of(common)
    if not shape or shape[0] not in kinds or (shape[0] != "m" and shape[1] < 32):
        return None
    return lower(signature(common, *[common] * len(args)), emit)


@lower_cast(Vector, Vector)
def _from_vector(context: Any, builder: Any, source: Vector, target: Vector, raw: Any) -> Any:
    return value(builder, raw, source).to(target.kind, target.bits).raw


@lower_cast(types.Boolean, Vector)
@lower_cast(types.Number, Vector)
def _from_scalar(context: Any, builder: Any, source: types.Type, target: Vector, raw: Any) -> Any:
    if isinstance(source, types.Literal):
        source = source.literal_type
    if target.kind == "m":
        scalar = context.cast(builder, raw, source, types.boolean)
    else:
        scalar = context.cast(builder, raw, source, target.scalar)
    return Value(builder, scalar, target.kind, target.bits).splat(target.lanes).raw
