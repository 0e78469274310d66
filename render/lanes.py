"""Operations on lanes: the same names work on numpy arrays (reference backend) and on scalars inside Numba kernels.

A lane is a float64 or int64: an array of any shape, or one number. Vectors are tuples (x, y, z) of lanes. There is no
data-dependent `if` over lanes but `if any_lane(mask)`; values are chosen with `where`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from .kernels import helper
from .records import Lane, Vec

_SAFE = 2.0**62  # beyond this a float64 has no int64


def where(condition: Lane, a: Lane, b: Lane) -> Lane:
    """a where the condition holds, else b."""
    return np.where(condition, a, b)


def any_lane(mask: Lane) -> Any:
    """Whether the mask holds in any lane: a bool, fit for `if`."""
    return np.any(mask)


def not_(mask: Lane) -> Lane:
    return np.logical_not(mask)


def minimum(a: Lane, b: Lane) -> Lane:
    """The smaller; b where either is NaN (as x86's minsd), so that the order of arguments says which side is trusted."""
    return np.where(a < b, a, b)


def maximum(a: Lane, b: Lane) -> Lane:
    """The larger; b where either is NaN."""
    return np.where(a > b, a, b)


def floor_int(x: Lane) -> Lane:
    """The floor as int64; 0 where x is not finite or beyond int64."""
    return np.where(np.abs(x) < _SAFE, np.floor(x), 0.0).astype(np.int64)


def to_int(x: Lane) -> Lane:
    """int64, cut towards 0."""
    return np.asarray(x).astype(np.int64)


def to_float(x: Lane) -> Lane:
    return np.asarray(x).astype(np.float64)


def to_uint(x: Lane) -> Lane:
    """uint64 of integers."""
    return np.asarray(x).astype(np.uint64)


def full_like(x: Lane, value: float) -> Lane:
    """float64 lanes as many as x's, all of one value."""
    return np.full(np.shape(x), value, dtype=np.float64)


def int_like(x: Lane, value: int) -> Lane:
    """int64 lanes as many as x's, all of one value."""
    return np.full(np.shape(x), value, dtype=np.int64)


def bool_like(x: Lane, value: bool) -> Lane:
    """bool lanes as many as x's, all of one value."""
    return np.full(np.shape(x), value, dtype=np.bool_)


@overload(where)
def _where(condition: Any, a: Any, b: Any) -> Any:
    if isinstance(condition, types.Boolean):
        return lambda condition, a, b: a if condition else b
    return None


@overload(any_lane)
def _any_lane(mask: Any) -> Any:
    return (lambda mask: mask) if isinstance(mask, types.Boolean) else None


@overload(not_)
def _not(mask: Any) -> Any:
    return (lambda mask: not mask) if isinstance(mask, types.Boolean) else None


@overload(minimum)
def _minimum(a: Any, b: Any) -> Any:
    return (lambda a, b: a if a < b else b) if isinstance(a, types.Number) else None


@overload(maximum)
def _maximum(a: Any, b: Any) -> Any:
    return (lambda a, b: a if a > b else b) if isinstance(a, types.Number) else None


@overload(floor_int)
def _floor_int(x: Any) -> Any:
    if not isinstance(x, types.Float):
        return None
    return lambda x: np.int64(math.floor(x) if abs(x) < _SAFE else 0)


@overload(to_int)
def _to_int(x: Any) -> Any:
    return (lambda x: np.int64(x)) if isinstance(x, (types.Number, types.Boolean)) else None


@overload(to_float)
def _to_float(x: Any) -> Any:
    return (lambda x: np.float64(x)) if isinstance(x, (types.Number, types.Boolean)) else None


@overload(to_uint)
def _to_uint(x: Any) -> Any:
    return (lambda x: np.uint64(x)) if isinstance(x, types.Integer) else None


@overload(full_like)
def _full_like(x: Any, value: Any) -> Any:
    return (lambda x, value: np.float64(value)) if isinstance(x, (types.Number, types.Boolean)) else None


@overload(int_like)
def _int_like(x: Any, value: Any) -> Any:
    return (lambda x, value: np.int64(value)) if isinstance(x, (types.Number, types.Boolean)) else None


@overload(bool_like)
def _bool_like(x: Any, value: Any) -> Any:
    return (lambda x, value: value) if isinstance(x, (types.Number, types.Boolean)) else None


def sqrt(x: Lane) -> Lane:
    return np.sqrt(x)


def sin(x: Lane) -> Lane:
    return np.sin(x)


def cos(x: Lane) -> Lane:
    return np.cos(x)


def asin(x: Lane) -> Lane:
    return np.arcsin(x)


def acos(x: Lane) -> Lane:
    return np.arccos(x)


def exp(x: Lane) -> Lane:
    return np.exp(x)


def floor(x: Lane) -> Lane:
    return np.floor(x)


def atan2(y: Lane, x: Lane) -> Lane:
    return np.arctan2(y, x)


def hypot(x: Lane, y: Lane) -> Lane:
    return np.hypot(x, y)


def copysign(x: Lane, y: Lane) -> Lane:
    return np.copysign(x, y)


def power(x: Lane, y: Lane) -> Lane:
    return np.power(x, y)


def isfinite(x: Lane) -> Lane:
    return np.isfinite(x)


@overload(sqrt)
def _sqrt(x: Any) -> Any:
    return (lambda x: math.sqrt(x)) if isinstance(x, types.Number) else None


@overload(sin)
def _sin(x: Any) -> Any:
    return (lambda x: math.sin(x)) if isinstance(x, types.Number) else None


@overload(cos)
def _cos(x: Any) -> Any:
    return (lambda x: math.cos(x)) if isinstance(x, types.Number) else None


@overload(asin)
def _asin(x: Any) -> Any:
    return (lambda x: math.asin(x)) if isinstance(x, types.Number) else None


@overload(acos)
def _acos(x: Any) -> Any:
    return (lambda x: math.acos(x)) if isinstance(x, types.Number) else None


@overload(exp)
def _exp(x: Any) -> Any:
    return (lambda x: math.exp(x)) if isinstance(x, types.Number) else None


@overload(floor)
def _floor(x: Any) -> Any:
    return (lambda x: np.floor(x)) if isinstance(x, types.Float) else None


@overload(atan2)
def _atan2(y: Any, x: Any) -> Any:
    return (lambda y, x: math.atan2(y, x)) if isinstance(x, types.Number) else None


@overload(hypot)
def _hypot(x: Any, y: Any) -> Any:
    return (lambda x, y: math.hypot(x, y)) if isinstance(x, types.Number) else None


@overload(copysign)
def _copysign(x: Any, y: Any) -> Any:
    return (lambda x, y: math.copysign(x, y)) if isinstance(y, types.Number) else None


@overload(power)
def _power(x: Any, y: Any) -> Any:
    return (lambda x, y: math.pow(x, y)) if isinstance(x, types.Number) else None


@overload(isfinite)
def _isfinite(x: Any) -> Any:
    return (lambda x: math.isfinite(x)) if isinstance(x, types.Number) else None


@helper
def clip(x: Lane, low: Lane, high: Lane) -> Lane:
    """x between low and high; low where x is NaN."""
    return minimum(maximum(x, low), high)


# --- vectors ---


@helper
def add(a: Vec, b: Vec) -> Vec:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@helper
def sub(a: Vec, b: Vec) -> Vec:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@helper
def scale(a: Vec, s: Lane) -> Vec:
    return (a[0] * s, a[1] * s, a[2] * s)


@helper
def mul(a: Vec, b: Vec) -> Vec:
    """Component by component."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@helper
def dot(a: Vec, b: Vec) -> Lane:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@helper
def cross(a: Vec, b: Vec) -> Vec:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@helper
def length(a: Vec) -> Lane:
    return sqrt(dot(a, a))


@helper
def normalize(a: Vec) -> Vec:
    """The vector at length 1; NaN for the zero vector. Scaled first, so that no square overflows or vanishes."""
    largest = maximum(abs(a[0]), maximum(abs(a[1]), abs(a[2])))
    b = (a[0] / largest, a[1] / largest, a[2] / largest)
    n = sqrt(dot(b, b))
    return (b[0] / n, b[1] / n, b[2] / n)


@helper
def negate(a: Vec) -> Vec:
    return (-a[0], -a[1], -a[2])


@helper
def along(origin: Vec, direction: Vec, t: Lane) -> Vec:
    """origin + t · direction"""
    return (origin[0] + direction[0] * t, origin[1] + direction[1] * t, origin[2] + direction[2] * t)


@helper
def where3(condition: Lane, a: Vec, b: Vec) -> Vec:
    return (where(condition, a[0], b[0]), where(condition, a[1], b[1]), where(condition, a[2], b[2]))


@helper
def like3(x: Lane, r: float, g: float, b: float) -> Vec:
    """The same vector in as many lanes as x has."""
    return (full_like(x, r), full_like(x, g), full_like(x, b))


@helper
def reflect(incident: Vec, normal: Vec) -> Vec:
    """The mirror image of a direction that comes in, at a unit normal: i − 2 (i·n) n."""
    k = -2.0 * dot(incident, normal)
    return along(incident, normal, k)


@helper
def basis(n: Vec) -> tuple[Vec, Vec]:
    """Two unit vectors that make a right-handed frame (s, t, n) with the unit vector n.

    Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017: no branch and no singular direction.
    """
    sign = copysign(1.0, n[2])
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    s = (1.0 + sign * n[0] * n[0] * a, sign * b, -sign * n[0])
    t = (b, sign + n[1] * n[1] * a, -n[1])
    return s, t


@helper
def in_basis(s: Vec, t: Vec, n: Vec, x: Lane, y: Lane, z: Lane) -> Vec:
    """x s + y t + z n"""
    return (
        s[0] * x + t[0] * y + n[0] * z,
        s[1] * x + t[1] * y + n[1] * z,
        s[2] * x + t[2] * y + n[2] * z,
    )


# --- rows of (n, 3, 4) matrices ---


@helper
def transform_point(matrix: Lane, i: Lane, p: Vec) -> Vec:
    """Row i of the matrices applied to a point."""
    return (
        matrix[i, 0, 0] * p[0] + matrix[i, 0, 1] * p[1] + matrix[i, 0, 2] * p[2] + matrix[i, 0, 3],
        matrix[i, 1, 0] * p[0] + matrix[i, 1, 1] * p[1] + matrix[i, 1, 2] * p[2] + matrix[i, 1, 3],
        matrix[i, 2, 0] * p[0] + matrix[i, 2, 1] * p[1] + matrix[i, 2, 2] * p[2] + matrix[i, 2, 3],
    )


@helper
def transform_vector(matrix: Lane, i: Lane, v: Vec) -> Vec:
    """Row i of the matrices applied to a difference of points."""
    return (
        matrix[i, 0, 0] * v[0] + matrix[i, 0, 1] * v[1] + matrix[i, 0, 2] * v[2],
        matrix[i, 1, 0] * v[0] + matrix[i, 1, 1] * v[1] + matrix[i, 1, 2] * v[2],
        matrix[i, 2, 0] * v[0] + matrix[i, 2, 1] * v[1] + matrix[i, 2, 2] * v[2],
    )


@helper
def transform_normal(inverse: Lane, i: Lane, n: Vec) -> Vec:
    """A normal taken to where the points went, given the *inverse* of the points' matrix: the transposed inverse.

    An outward normal stays outward whether the transform mirrors or not. Not of unit length.
    """
    return (
        inverse[i, 0, 0] * n[0] + inverse[i, 1, 0] * n[1] + inverse[i, 2, 0] * n[2],
        inverse[i, 0, 1] * n[0] + inverse[i, 1, 1] * n[1] + inverse[i, 2, 1] * n[2],
        inverse[i, 0, 2] * n[0] + inverse[i, 1, 2] * n[1] + inverse[i, 2, 2] * n[2],
    )
