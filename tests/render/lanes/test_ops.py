"""Lane operations: the same values from numpy arrays and from scalars in kernels; NaN and edge cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.jit.kernel import kernel
from maquette.render.lanes import affine, ops

X = np.array([-2.5, -1.0, -0.0, 0.0, 0.3, 1.0, 7.25, 1e300, -1e300, np.inf, -np.inf, np.nan])
unit = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: sum(c * c for c in v) > 1e-6)


def one_number(x, y):
    """Every operation on numbers, as a tuple."""
    return (
        ops.where(x > y, x, y), ops.minimum(x, y), ops.maximum(x, y), ops.clip(x, -1.0, 1.0), ops.sqrt(abs(x)), ops.sin(y),
        ops.cos(y), ops.asin(x), ops.acos(x), ops.atan2(y, x), ops.hypot(x, y), ops.exp(-abs(y)), ops.floor(x),
        ops.power(abs(y), 1.5), ops.lerp(x, y, 0.25), ops.sign_of(x), ops.to_float(ops.floor_int(x)),
        ops.where(ops.is_finite(x), 1.0, 0.0), ops.where(ops.not_(x > 0.0), 1.0, 0.0), ops.full_like(x, 3.0),
    )  # fmt: skip


NUMBERS = 20
_one_number = ops.helper(one_number)


@kernel
def _numbers(x, y, out):
    for k in range(len(x)):
        values = _one_number(x[k], y[k])
        for j, value in enumerate(values):
            out[k, j] = value


@kernel
def _vectors(v, w, matrix, out):
    for k in range(len(v)):
        a, b = (v[k, 0], v[k, 1], v[k, 2]), (w[k, 0], w[k, 1], w[k, 2])
        n = ops.normalize(a)
        s, t = ops.basis(n)
        for j, row in enumerate((
            ops.cross(a, b), n, s, t, ops.reflect(b, n), ops.in_basis(s, t, n, 0.1, 0.2, 0.3), ops.along(a, b, 0.7),
            ops.where3(a[0] > b[0], a, b), affine.transform_point(matrix, 0, a), affine.transform_vector(matrix, 0, a),
            affine.transform_normal(matrix, 0, a), ops.lerp3(a, b, 0.3),
        )):  # fmt: skip
            out[k, j, 0], out[k, j, 1], out[k, j, 2] = row


def test_numbers_agree():
    x, y = (c.ravel() for c in np.meshgrid(X, X[:7]))
    out = np.empty((len(x), NUMBERS))
    _numbers(x, y, out)
    with np.errstate(all="ignore"):
        expected = np.stack(np.broadcast_arrays(*one_number(x, y)), axis=1)
    assert np.allclose(out, expected, rtol=1e-14, atol=0, equal_nan=True)


@pytest.mark.long
def test_vectors_agree():
    random = np.random.default_rng(0)
    v, w, matrix = random.normal(size=(20, 3)), random.normal(size=(20, 3)), random.normal(size=(1, 3, 4))
    out = np.empty((20, 12, 3))
    _vectors(v, w, matrix, out)
    a, b = tuple(v.T), tuple(w.T)
    n = ops.normalize(a)
    s, t = ops.basis(n)
    expected = (
        ops.cross(a, b), n, s, t, ops.reflect(b, n), ops.in_basis(s, t, n, 0.1, 0.2, 0.3), ops.along(a, b, 0.7),
        ops.where3(a[0] > b[0], a, b), affine.transform_point(matrix, 0, a), affine.transform_vector(matrix, 0, a),
        affine.transform_normal(matrix, 0, a), ops.lerp3(a, b, 0.3),
    )  # fmt: skip
    assert np.abs(out - np.moveaxis(np.array(expected), -1, 0)).max() < 1e-13


@pytest.mark.long
@given(unit)
@settings(max_examples=200, deadline=None)
def test_a_basis_is_orthonormal_and_right_handed(v):
    n = ops.normalize(tuple(map(np.float64, v)))
    s, t = ops.basis(n)
    frame = np.array([s, t, n], float)
    assert np.abs(frame @ frame.T - np.eye(3)).max() < 1e-12
    assert np.linalg.det(frame) == pytest.approx(1.0)


@pytest.mark.parametrize("z", [1.0, -1.0])
def test_a_basis_has_no_singular_direction(z):
    assert np.isfinite(np.array(ops.basis((np.float64(0.0), np.float64(0.0), np.float64(z))), float)).all()


def test_a_basis_is_steady_around_upright_normals():
    """Rounding errors of z do not turn the samples around the normal of a surface that is extruded along z."""
    below, above = (ops.basis((np.float64(0.6), np.float64(0.8), np.float64(z))) for z in (-1e-9, 1e-9))
    assert np.allclose(below, above, rtol=0, atol=1e-8)


def test_a_nan_as_first_operand_gives_the_second():
    assert ops.minimum(np.nan, 1.0) == 1.0
    assert ops.maximum(np.nan, 1.0) == 1.0
    assert ops.clip(np.nan, -1.0, 1.0) == -1.0


def test_floors_of_infinity_and_nan_are_zero():
    with np.errstate(all="ignore"):
        assert list(ops.floor_int(np.array([np.nan, np.inf, -np.inf, 1e300, -1.5]))) == [0, 0, 0, 0, -2]


@given(unit, unit)
@settings(max_examples=100, deadline=None)
def test_normals_stay_perpendicular_under_any_matrix(n, v):
    """(M⁻ᵀ n) · (M v) = n · v."""
    matrix = np.zeros((1, 3, 4))
    matrix[0, :, :3] = [[2, 0.3, 0], [0, -0.5, 0.2], [1, 0, 3]]
    inverse = np.zeros((1, 3, 4))
    inverse[0, :, :3] = np.linalg.inv(matrix[0, :, :3])
    product = ops.dot(affine.transform_normal(inverse, 0, n), affine.transform_vector(matrix, 0, v))
    assert product == pytest.approx(ops.dot(n, v), abs=1e-12)
    assert math.isfinite(product)
