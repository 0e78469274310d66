"""Functions across the lanes of vectors: reductions, single lanes, halves and transposes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import llvm_expr as v
from .llvm_expr import I32, Value
from .vector_type import Lowering, Vector, intrinsic, lower, shape_of, type_for


def _reduce(x: Value, join: Callable[[Value, Value], Value]) -> Value:
    """Combine the two halves until one lane is left; the order is fixed."""
    b, lanes = x.builder, x.lanes
    while lanes > 1:
        lanes //= 2
        low, high = (ir.Constant(ir.VectorType(I32, lanes), list(range(first, first + lanes))) for first in (0, lanes))
        x = join(x.like(b.shuffle_vector(x.raw, x.raw, low)), x.like(b.shuffle_vector(x.raw, x.raw, high)))
    return Value(b, b.extract_element(x.raw, ir.Constant(I32, 0)), x.kind, x.bits) if lanes else x


def _lower_reduction(x: types.Type, join: Callable[[Value, Value], Value]) -> Lowering:
    x = types.unliteral(x)
    shape = shape_of(x)
    if shape is None or shape[0] == "m":
        return None
    return lower(signature(type_for(shape[0], shape[1], 0), x), lambda a: _reduce(a, join))


@intrinsic
def sum_of(typingctx, x):
    """Sum all lanes by halves: ((x0 + x2) + (x1 + x3)) for four lanes."""
    return _lower_reduction(x, lambda a, b: a + b)


@intrinsic
def min_of(typingctx, x):
    """Smallest lane; any lane if one is NaN."""
    return _lower_reduction(x, v.minimum)


@intrinsic
def max_of(typingctx, x):
    """Largest lane; any lane if one is NaN."""
    return _lower_reduction(x, v.maximum)


@intrinsic
def lane(typingctx, x, k):
    """Extract lane k (unchecked; fast for constant k)."""
    if not isinstance(x, Vector) or not isinstance(k, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return builder.extract_element(args[0], context.cast(builder, args[1], sig.args[1], types.int64))

    return signature(x.scalar, x, k), generate


@intrinsic
def with_lane(typingctx, x, k, number):
    """Replace lane k (unchecked)."""
    if not isinstance(x, Vector) or not isinstance(k, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        scalar = context.cast(builder, args[2], sig.args[2], x.scalar)
        return builder.insert_element(args[0], scalar, context.cast(builder, args[1], sig.args[1], types.int64))

    return signature(x, x, k, number), generate


def shuffle(b: Any, x: Any, y: Any, places: list[int]) -> Any:
    """Emit LLVM's shufflevector of two vectors by constant indices."""
    return b.shuffle_vector(x, y, ir.Constant(ir.VectorType(I32, len(places)), places))


@intrinsic
def low_half(typingctx, x):
    """First half of the lanes."""
    return _lower_half(x, 0)


@intrinsic
def high_half(typingctx, x):
    """Second half of the lanes."""
    return _lower_half(x, 1)


def _lower_half(x: types.Type, half: int) -> Lowering:
    if not isinstance(x, Vector) or x.lanes < 2:
        return None
    n = x.lanes // 2
    return lower(
        signature(Vector(x.kind, x.bits, n), x),
        lambda a: a.like(shuffle(a.builder, a.raw, a.raw, list(range(half * n, half * n + n)))),
    )


@intrinsic
def concatenate(typingctx, low, high):
    """Concatenate two vectors."""
    if not isinstance(low, Vector) or low != high:
        return None
    return lower(
        signature(Vector(low.kind, low.bits, 2 * low.lanes), low, high),
        lambda a, b: a.like(shuffle(a.builder, a.raw, b.raw, list(range(2 * a.lanes)))),
    )


@intrinsic
def transpose(typingctx, rows):
    """Transpose the k×k blocks of k vectors (a tuple; k = 2, 4 or 8), lanes taken k at a time.

    Four vectors of 16 lanes are four 4×4 blocks side by side. With k lanes, lane j of vector i becomes lane i of vector j.
    """
    if not isinstance(rows, types.UniTuple) or not isinstance(rows.dtype, Vector):
        return None
    k, lanes = rows.count, rows.dtype.lanes
    if k not in (2, 4, 8) or lanes % k:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        from_tuple = [builder.extract_value(args[0], i) for i in range(k)]
        return context.make_tuple(builder, rows, transpose_blocks(builder, from_tuple, lanes))

    return signature(rows, rows), generate


def transpose_blocks(builder: Any, rows: list[Any], lanes: int) -> list[Any]:
    """Transpose square blocks of as many lanes as there are rows, by shuffles that are one instruction on every machine."""

    def pairs(x: Any, y: Any, size: int, group: int) -> tuple[Any, Any]:
        """Interleave runs of `size` lanes of x and y: (those of the first half of each group of lanes, those of the second half)."""
        half, places = group // 2, ([], [])
        for start in range(0, lanes, group):
            for second in (0, 1):
                for run in range(start + second * half, start + second * half + half, size):
                    places[second].extend([*range(run, run + size), *range(lanes + run, lanes + run + size)])
        return shuffle(builder, x, y, places[0]), shuffle(builder, x, y, places[1])

    if len(rows) == 2:
        even = [lanes + n - 1 if n & 1 else n for n in range(lanes)]
        odd = [lanes + n if n & 1 else n + 1 for n in range(lanes)]
        return [shuffle(builder, rows[0], rows[1], even), shuffle(builder, rows[0], rows[1], odd)]
    columns = []
    for k in range(0, len(rows), 4):  # within four lanes: a0 b0 a1 b1, a2 b2 a3 b3, then a0 b0 c0 d0 …
        (p, q), (r, s) = pairs(rows[k], rows[k + 1], 1, 4), pairs(rows[k + 2], rows[k + 3], 1, 4)
        columns.extend([*pairs(p, r, 2, 4), *pairs(q, s, 2, 4)])
    if len(rows) == 8:
        halves = [pairs(columns[k], columns[k + 4], 4, 8) for k in range(4)]
        columns = [first for first, _ in halves] + [second for _, second in halves]
    return columns
