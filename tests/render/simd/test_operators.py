"""Operators of vectors, lane by lane against numpy, on awkward numbers of every type."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render import simd
from maquette.render.jit.kernel import kernel
from numba.core.errors import TypingError

from .values import COUNT, FLOATS, INTS, TYPES, awkward, compiled, over, same, widths

FLOAT_KINDS = [(dtype, kind) for dtype in FLOATS for kind in widths(dtype)]
INT_KINDS = [(dtype, kind) for dtype in INTS for kind in widths(dtype)]
COMPARISONS = ("x < y", "x <= y", "x > y", "x >= y", "x == y", "x != y")


def run(kind, expressions, x, y, dtypes=None):
    """Outputs of expressions of two arrays."""
    outs = tuple(np.zeros(COUNT, dtype) for dtype in dtypes or [x.dtype] * len(expressions))
    over(kind, expressions)(x, y, outs)
    return outs


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS)
def test_floats(dtype, kind):
    x, y = awkward(dtype, 1), awkward(dtype, 2)
    expressions = ("x + y", "x - y", "x * y", "x / y", "-x", "+x", "abs(x)", "x * 0.1", "2 - x", "1.0 / x")
    results = run(kind, expressions, x, y)
    with np.errstate(all="ignore"):
        expected = (x + y, x - y, x * y, x / y, -x, x, abs(x), x * dtype(0.1), dtype(2) - x, dtype(1) / x)
    for result, right in zip(results, expected, strict=True):
        same(result, right)


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS)
def test_floor_division_and_remainder_of_floats(dtype, kind):
    x, y = (np.where(np.abs(v) < 1e30, v, dtype(7.5)) for v in (awkward(dtype, 3), awkward(dtype, 4)))
    x = np.where(np.abs(x) < 1e6, x, dtype(-3.25))
    y = np.where((np.abs(y) > 1e-6) | (y == 0), y, dtype(0.5))
    quotient, remainder = run(kind, ("x // y", "x % y"), x, y)
    with np.errstate(all="ignore"):
        same(quotient, np.floor_divide(x, y))
        same(remainder, np.remainder(x, y))


@pytest.mark.parametrize(("dtype", "kind"), INT_KINDS)
def test_ints_wrap_around(dtype, kind):
    x, y = awkward(dtype, 5), awkward(dtype, 6)
    expressions = ("x + y", "x - y", "x * y", "-x", "abs(x)", "x & y", "x | y", "x ^ y", "~x", "x + 3", "x & 255", "x * 7 - 1")
    results = run(kind, expressions, x, y)
    with np.errstate(all="ignore"):
        expected = (x + y, x - y, x * y, -x, abs(x), x & y, x | y, x ^ y, ~x, x + dtype(3), x & dtype(255), x * dtype(7) - dtype(1))
    for result, right in zip(results, expected, strict=True):
        same(result, right)


@pytest.mark.parametrize(("dtype", "kind"), INT_KINDS)
def test_integer_division_is_numpys(dtype, kind):
    """Division rounds down; x / 0 is 0, and the lowest integer divided by −1 is itself."""
    x, y = awkward(dtype, 7), awkward(dtype, 8)
    quotient, remainder, by_ten, of_ten = run(kind, ("x // y", "x % y", "x // 10", "x % 10"), x, y)
    with np.errstate(all="ignore"):
        same(quotient, x // y)
        same(remainder, x % y)
        same(by_ten, x // dtype(10))
        same(of_ten, x % dtype(10))


@pytest.mark.parametrize(("dtype", "kind"), INT_KINDS)
def test_division_of_ints_gives_floats(dtype, kind):
    x, y = awkward(dtype, 9), awkward(dtype, 10)
    float_type = np.float32 if np.dtype(dtype).itemsize == 4 else np.float64
    (quotient,) = run(kind, ("x / y",), x, y, [float_type])
    with np.errstate(all="ignore"):
        same(quotient, x.astype(float_type) / y.astype(float_type))


@pytest.mark.parametrize(("dtype", "kind"), INT_KINDS)
def test_shifts(dtype, kind):
    x, bits = awkward(dtype, 11), 8 * np.dtype(dtype).itemsize
    by = np.random.default_rng(0).integers(0, bits, COUNT).astype(dtype)
    results = run(kind, ("x << y", "x >> y", "x << 3", "x >> 5"), x, by)
    for result, right in zip(results, (x << by, x >> by, x << dtype(3), x >> dtype(5)), strict=True):
        same(result, right)


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS + INT_KINDS)
def test_comparisons(dtype, kind):
    x, y = awkward(dtype, 12), awkward(dtype, 13)
    results = run(kind, (*COMPARISONS, "x < 1", "~(x < y) & (y < 3) | (x == y) ^ (x > 2)"), x, y, [np.bool_] * 8)
    expected = (x < y, x <= y, x > y, x >= y, x == y, x != y, x < 1, ~(x < y) & (y < 3) | (x == y) ^ (x > 2))
    for result, right in zip(results, expected, strict=True):
        same(result, right)


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS + INT_KINDS)
def test_the_smaller_and_the_larger(dtype, kind):
    """The second operand where either is NaN, and of two zeros."""
    x, y = awkward(dtype, 14), awkward(dtype, 15)
    results = run(kind, ("min(x, y)", "max(x, y)", "simd.minimum(x, y)", "simd.maximum(x, 1)", "min(x, y, 3)"), x, y)
    low, high = np.where(x < y, x, y), np.where(x > y, x, y)
    expected = (low, high, low, np.where(x > 1, x, dtype(1)), np.where(low < 3, low, dtype(3)))
    for result, right in zip(results, expected, strict=True):
        same(result, right)


@kernel
def _mixed(ints, floats, out):
    """All mixes of scalars and vectors; results have the vectors' types."""
    i, x = simd.load(ints, 0), simd.load(floats, 0)
    total = 0.0  # a number here, a vector after the first turn
    for k in range(3):
        total += x * k
    total -= i
    total *= i > 2
    n = i
    n += 1
    n <<= 1
    simd.store(out, 0, total + n / 2 + (i * 0.5) + (x > 1) * 2.0)


def test_scalars_take_the_vectors_width():
    ints, floats = np.arange(16, dtype=np.int32), np.linspace(0, 2, 16, dtype=np.float32)
    out = np.zeros(16, np.float32)
    _mixed(ints, floats, out)
    expected = (floats * 3 - ints) * (ints > 2) + (ints + 1) + ints * np.float32(0.5) + (floats > 1) * np.float32(2)
    same(out[: simd.WIDTH], expected[: simd.WIDTH])


def test_int32_stays_int32():
    @kernel
    def add(x, out):
        simd.store(out, 0, simd.load(x, 0) + 1)

    out = np.zeros(2 * 16, np.int32)
    add(np.full(16, 2**31 - 1, np.int32), out)
    assert np.all(out[: simd.WIDTH] == -(2**31))
    assert np.all(out[simd.WIDTH :] == 0)  # the neighbours are not written to


@pytest.mark.parametrize(
    "expression",
    [
        "simd.f32x8(x) + simd.f64x8(1.0)", "simd.f32x8(x) + simd.f32x4(1.0)", "simd.to_i64(simd.f32(1)) + simd.i32(1)",
        "simd.i32(1) + simd.u32(1)", "simd.f32(1.0) & 1", "-simd.m32(True)",
    ],
)
def test_incompatible_types_are_a_compile_error(expression):
    wrong = compiled(f"def run(x):\n    y = {expression}\n    return simd.lane(y, 0)")
    with pytest.raises(TypingError, match="No implementation of function"):
        wrong(1.0)


def test_a_mask_is_not_a_condition():
    @kernel
    def wrong(x):
        return 1 if simd.f32(x) > 0 else 2

    with pytest.raises(TypingError):
        wrong(1.0)


def test_every_type_has_its_name():
    assert [str(simd.CONSTRUCTED[getattr(simd, name)]) for name in TYPES.values()] == [
        f"{name}x{simd.WIDTH if name.endswith('32') else simd.WIDTH64}" for name in TYPES.values()
    ]
