"""Lane operations on vectors of float64 and float32: the same values as on numpy arrays."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render import simd
from maquette.render.jit.kernel import helper, kernel
from maquette.render.lanes import affine, ops
from maquette.render.sampling import sobol

X = np.array([-2.5, -1.0, -0.0, 0.0, 0.3, 1.0, 7.25, 1e30, -1e30, np.inf, -np.inf, np.nan])


def one_number(x, y):
    """Every operation on numbers, as a tuple."""
    k = ops.floor_int(x)
    return (
        ops.where(x > y, x, y), ops.where(x > 0.0, 1.0, y), ops.minimum(x, y), ops.maximum(x, y), ops.clip(x, -1.0, 1.0),
        ops.sqrt(abs(x)), ops.sin(y), ops.cos(y), ops.asin(x), ops.acos(x), ops.atan2(y, x), ops.hypot(x, y),
        ops.exp(-abs(y)), ops.log(abs(y)), ops.floor(x), ops.power(abs(y), 1.5), ops.lerp(x, y, 0.25), ops.sign_of(x),
        ops.absolute(x), ops.to_float(k), ops.to_float(ops.to_int(ops.clip(x, -9.0, 9.0))),
        ops.where(ops.is_finite(x), 1.0, 0.0), ops.where(ops.not_(x > 0.0), 1.0, 0.0), ops.full_like(x, 3.0),
        ops.to_float(ops.int_like(x, 5) % 3), ops.where(ops.bool_like(x, True), x, y),
    )  # fmt: skip


def one_vector(a, b, matrix, row):
    """Every operation on vectors, as a tuple of numbers."""
    n = ops.normalize(a)
    s, t = ops.basis(n)
    results = (
        ops.add(a, b), ops.sub(a, b), ops.mul(a, b), ops.scale(a, 2.0), ops.negate(a), ops.cross(a, b), n, s, t,
        ops.reflect(b, n), ops.in_basis(s, t, n, 0.1, 0.2, 0.3), ops.along(a, b, 0.7), ops.where3(a[0] > b[0], a, b),
        ops.lerp3(a, b, 0.3), ops.like3(a[0], 1.0, 2.0, 3.0), affine.transform_point(matrix, row, a),
        affine.transform_vector(matrix, row, a), affine.transform_normal(matrix, row, a), affine.transform_point(matrix, 0, a),
        (ops.dot(a, b), ops.length(a), ops.largest(a)),
    )  # fmt: skip
    return results


def skipping(x):
    """Work that only some lanes need, under an `if`, with a variable that is a scalar before it."""
    root = 0.0
    if ops.any_lane(x > 1.0):
        root = ops.where(x > 1.0, ops.sqrt(ops.maximum(x, 0.0)), 0.5)
    return root


_one_number, _one_vector, _skipping = helper(one_number), helper(one_vector), helper(skipping)


@kernel
def _numbers(x, y, out, like):
    n = len(x)
    for i in range(0, n, like):
        for k, value in enumerate(_one_number(simd.load(x, i), simd.load(y, i))):
            simd.store(out, k * n + i, value)


@kernel
def _vectors(v, matrix, rows, out, like):
    n = len(rows)
    for i in range(0, n, like):
        a = (simd.load(v, i), simd.load(v, n + i), simd.load(v, 2 * n + i))
        b = (simd.load(v, 3 * n + i), simd.load(v, 4 * n + i), simd.load(v, 5 * n + i))
        k = 0
        for p, q, r in _one_vector(a, b, matrix, simd.load(rows, i)):
            simd.store(out, k * n + i, p)
            simd.store(out, (k + 1) * n + i, q)
            simd.store(out, (k + 2) * n + i, r)
            k += 3


@kernel
def _skipped(x, out, like):
    for i in range(0, len(x), like):
        simd.store(out, i, _skipping(simd.load(x, i)))


@kernel
def _pairs(pixels, out, like):
    n = len(pixels)
    for i in range(0, n, like):
        u, v = sobol.pair(simd.load(pixels, i), 3, 5, 7)
        simd.store(out, i, u)
        simd.store(out, n + i, v)


@pytest.mark.long
@pytest.mark.parametrize(("dtype", "lanes_", "tolerance"), [(np.float64, simd.WIDTH64, 1e-14), (np.float32, simd.WIDTH, 1e-6)])
def test_numbers_agree(dtype, lanes_, tolerance):
    x, y = (c.ravel().astype(dtype) for c in np.meshgrid(X, X[:8]))
    with np.errstate(all="ignore"):
        expected = np.stack(np.broadcast_arrays(*one_number(x, y)))
    out = np.zeros(expected.shape, dtype)
    _numbers(x, y, out, lanes_)
    assert np.allclose(out, expected.astype(dtype), rtol=tolerance, atol=0, equal_nan=True)


@pytest.mark.long
@pytest.mark.parametrize(
    ("dtype", "ints", "lanes_", "tolerance"), [(np.float64, np.int64, simd.WIDTH64, 1e-13), (np.float32, np.int32, simd.WIDTH, 2e-5)]
)
def test_vectors_agree(dtype, ints, lanes_, tolerance):
    random = np.random.default_rng(0)
    v, matrix, rows = random.normal(size=(6, 64)).astype(dtype), random.normal(size=(5, 3, 4)), random.integers(0, 5, 64).astype(ints)
    results = one_vector(tuple(v[:3]), tuple(v[3:]), matrix, rows)
    expected = np.concatenate([np.stack(np.broadcast_arrays(*row, v[0])[:3]) for row in results])
    out = np.zeros(expected.shape, dtype)
    _vectors(v, matrix, rows, out, lanes_)
    assert np.abs(out - expected).max() < tolerance


@pytest.mark.parametrize(("dtype", "lanes_"), [(np.float64, simd.WIDTH64), (np.float32, simd.WIDTH)])
def test_work_that_no_lane_needs_is_skipped(dtype, lanes_):
    x = np.linspace(-1, 3, 64).astype(dtype)
    out = np.zeros_like(x)
    _skipped(x, out, lanes_)
    groups = x.reshape(-1, lanes_)
    expected = np.where(groups > 1, np.sqrt(np.maximum(groups, 0)), 0.5) * (groups > 1).any(axis=1, keepdims=True)
    assert np.array_equal(out, expected.ravel().astype(dtype))


def test_random_numbers_have_the_same_bits():
    pixels = np.arange(64) * 977
    out = np.zeros((2, 64))
    _pairs(pixels, out, simd.WIDTH64)
    assert np.array_equal(out, np.stack(sobol.pair(pixels, 3, 5, 7)))
