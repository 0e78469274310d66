"""Elementary functions of vectors: errors in units of the last place, and numpy's special cases."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from .values import COUNT, FLOATS, TYPES, awkward, over

EVERYTHING, WHOLE = "everything", "whole"
ONE = {
    "sin": (EVERYTHING, (-10, 10), (-1e5, 1e5), (-1e9, 1e9)),
    "cos": (EVERYTHING, (-10, 10), (-1e5, 1e5), (-1e9, 1e9)),
    "tan": (EVERYTHING, (-10, 10), (-1e5, 1e5)),
    "asin": (EVERYTHING, (-1, 1)),
    "acos": (EVERYTHING, (-1, 1), (0.99, 1)),
    "atan": (EVERYTHING, (-3, 3)),
    "exp": (EVERYTHING, (-100, 90), (-1, 1), (-760, 720)),
    "log": (EVERYTHING, (0, 2), (0.5, 1.5), (0.99, 1.01)),
}
TWO = {
    "atan2": ((EVERYTHING, EVERYTHING), ((-3, 3), (-3, 3))),
    "hypot": ((EVERYTHING, EVERYTHING), ((-3, 3), (-3, 3))),
    "power": ((EVERYTHING, EVERYTHING), ((0, 20), (-20, 20)), ((0.9, 1.1), (-3000, 3000)), ((0, 1), (0, 300)), ((-9, 9), WHOLE)),
}
NUMPY = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2"}
# The largest error in units of the last place that docs/simd.md states, by function: float32, float64.
LIMITS = {
    "sin": (1.0, 1.0), "cos": (1.0, 1.0), "tan": (2.0, 2.2), "asin": (2.0, 2.2), "acos": (1.5, 1.5), "atan": (2.0, 1.6),
    "exp": (1.5, 2.0), "log": (1.0, 1.0), "atan2": (2.0, 2.2), "hypot": (2.2, 2.2), "power": (0.6, 2.2),
}  # fmt: skip


def exact_function(name):
    return getattr(np, NUMPY.get(name) or name)


def numbers(dtype, interval, seed):
    """Numbers of an interval, integers of −9 … 9, or all kinds of numbers."""
    if interval == EVERYTHING:
        return awkward(dtype, seed)
    random = np.random.default_rng(seed)
    if interval == WHOLE:
        return random.integers(-9, 10, COUNT).astype(dtype)
    low, high = interval
    return random.uniform(low, high, COUNT).astype(dtype)


def assert_close(values, exact, limit, arguments):
    """Check values within `limit` ulp of longdouble's result; NaN, infinities and signs of zero must be equal."""
    dtype = values.dtype
    with np.errstate(all="ignore"):
        expected = exact.astype(dtype)
        step = np.spacing(np.minimum(np.abs(expected), np.finfo(dtype).max)).astype(np.longdouble)
        ulp = np.where((values == expected) | (np.isnan(values) & np.isnan(expected)), 0, np.abs(values - exact) / step)
        ulp = np.where((np.signbit(values) != np.signbit(expected)) & ~np.isnan(expected), np.inf, ulp)
    worst = int(np.argmax(np.where(np.isnan(ulp), np.inf, ulp)))
    place = [a[worst] for a in arguments]
    assert ulp[worst] <= limit, f"{float(ulp[worst]):.2f} ulp at {place}: {values[worst]!r} and not {expected[worst]!r}"


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("name", ONE)
def test_functions_of_one_number(name, dtype):
    run = over(TYPES[dtype], [f"simd.{name}(x)"], "x")
    for seed, interval in enumerate(ONE[name]):
        x, out = numbers(dtype, interval, seed), np.zeros(COUNT, dtype)
        run(x, (out,))
        with np.errstate(all="ignore"):
            exact = exact_function(name)(x.astype(np.longdouble))
        assert_close(out, exact, LIMITS[name][dtype == np.float64], [x])


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("name", TWO)
def test_functions_of_two_numbers(name, dtype):
    run = over(TYPES[dtype], [f"simd.{name}(x, y)"])
    for seed, (first, second) in enumerate(TWO[name]):
        x, y, out = numbers(dtype, first, 2 * seed), numbers(dtype, second, 2 * seed + 1), np.zeros(COUNT, dtype)
        run(x, y, (out,))
        with np.errstate(all="ignore"):
            exact = exact_function(name)(x.astype(np.longdouble), y.astype(np.longdouble))
        assert_close(out, exact, LIMITS[name][dtype == np.float64], [x, y])


@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("name", TWO)
def test_special_pairs(name, dtype):
    """All pairs of zeros, ones, infinities and NaN, against numpy."""
    limits = np.finfo(dtype)
    special = [0.0, -0.0, 1, -1, 2, -2, 0.5, -0.5, 3, -3, 2.5, np.inf, -np.inf, np.nan]
    special += [limits.tiny, limits.tiny / 8, limits.max, -limits.max]
    x, y = (np.resize(np.array(v, dtype), 512) for v in zip(*itertools.product(special, special), strict=True))
    out = np.zeros(512, dtype)
    over(TYPES[dtype], [f"simd.{name}(x, y)"])(x, y, (out,))
    with np.errstate(all="ignore"):
        exact = exact_function(name)(x.astype(np.longdouble), y.astype(np.longdouble))
    assert_close(out, exact, LIMITS[name][dtype == np.float64], [x, y])


@pytest.mark.long
@pytest.mark.parametrize("dtype", FLOATS)
def test_functions_of_numpy_and_math_are_overloaded(dtype):
    names = ["np.sin", "np.cos", "np.tan", "np.arcsin", "np.arccos", "np.arctan", "np.exp", "np.log", "np.abs"]
    ours = ["sin", "cos", "tan", "asin", "acos", "atan", "exp", "log", "absolute"]
    x = np.random.default_rng(0).uniform(0, 1, COUNT).astype(dtype)
    pairs = ["np.arctan2(x, y)", "simd.atan2(x, y)", "x ** y", "simd.power(x, y)"]
    pairs += ["simd.sincos(x)[0]", "simd.sin(x)", "simd.sincos(x * 1e7)[1]", "simd.cos(x * 1e7)"]
    pairs += [f"{form}(x)" for names in zip(names, [f"simd.{name}" for name in ours], strict=True) for form in names]
    outs = tuple(np.zeros(COUNT, dtype) for _ in pairs)
    over(TYPES[dtype], pairs)(x, x[::-1].copy(), outs)
    for a, b in zip(outs[::2], outs[1::2], strict=True):
        assert np.array_equal(a, b)
