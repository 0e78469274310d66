"""Lane operations: the same source runs on numpy arrays and, in kernels, on scalars.

Write straight-line code: `where` chooses, `if any_lane(mask):` skips what no lane needs. Both sides of a `where` are computed, so guard
denominators. Vectors are tuples (x, y, z). Comparisons with NaN are false, and `minimum`, `maximum` and `clip` are made of
comparisons: with NaN as the first operand they give the second one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from . import simd
from .kernels import HELPER, helper
from .records import Lane, Vec

WIDTH = simd.WIDTH64  # lanes of a kernel's values
_FITS = 2.0**62  # beyond this a float64 has no int64
_OPTIONS = HELPER  # overloads bear no annotations: Numba compares the signatures


def _vector(*kinds: Any) -> bool:
    return any(isinstance(kind, simd.Vector) for kind in kinds)


def where(condition: Lane, yes: Lane, no: Lane) -> Lane:
    """`yes` in lanes where the condition holds, else `no`."""
    return np.where(condition, yes, no)


@overload(where, jit_options=_OPTIONS)
def _where(condition, yes, no):
    if _vector(condition, yes, no):
        return lambda condition, yes, no: simd.select(condition, yes, no)
    return lambda condition, yes, no: yes if condition else no


def any_lane(mask: Lane) -> Any:
    """Whether any lane of a mask is set; the only thing a data-dependent `if` may ask."""
    return bool(np.any(mask))


@overload(any_lane, jit_options=_OPTIONS)
def _any_lane(mask):
    if _vector(mask):
        return lambda mask: simd.any_of(mask)
    return lambda mask: mask


def not_(mask: Lane) -> Lane:
    """The other lanes (~ on a scalar bool would be −1 or −2)."""
    return np.logical_not(mask)


@overload(not_, jit_options=_OPTIONS)
def _not(mask):
    if _vector(mask):
        return lambda mask: ~mask
    return lambda mask: not mask


def to_float(x: Lane) -> Lane:
    """As float64."""
    return np.asarray(x, dtype=np.float64)


@overload(to_float, jit_options=_OPTIONS)
def _to_float(x):
    return lambda x: simd.to_f64(x)


def to_int(x: Lane) -> Lane:
    """As int64, towards zero."""
    return np.asarray(x).astype(np.int64)


@overload(to_int, jit_options=_OPTIONS)
def _to_int(x):
    return lambda x: simd.to_i64(x)


def floor_int(x: Lane) -> Lane:
    """The whole number below, as int64; 0 where x is not finite or beyond int64."""
    return np.where(np.abs(x) < _FITS, np.floor(x), 0.0).astype(np.int64)


@overload(floor_int, jit_options=_OPTIONS)
def _floor_int(x):
    return lambda x: simd.to_i64(where(abs(x) < _FITS, simd.floor(x), 0.0))


def full_like(like: Lane, value: Any) -> Lane:
    """`value` as float64 in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.float64)


@overload(full_like, jit_options=_OPTIONS)
def _full_like(like, value):
    if _vector(like):
        make = getattr(simd, f"f64x{like.lanes}")
        return lambda like, value: make(value)
    return lambda like, value: float(value)


def int_like(like: Lane, value: Any) -> Lane:
    """`value` as int64 in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.int64)


@overload(int_like, jit_options=_OPTIONS)
def _int_like(like, value):
    if _vector(like):
        make = getattr(simd, f"i64x{like.lanes}")
        return lambda like, value: make(value)
    return lambda like, value: np.int64(value)


def bool_like(like: Lane, value: bool) -> Lane:
    """`value` as a mask in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.bool_)


@overload(bool_like, jit_options=_OPTIONS)
def _bool_like(like, value):
    if _vector(like):
        make = getattr(simd, f"m64x{like.lanes}")
        return lambda like, value: make(value)
    return lambda like, value: bool(value)


def is_finite(x: Lane) -> Lane:
    """Neither infinite nor NaN."""
    return np.isfinite(x)


@overload(is_finite, jit_options=_OPTIONS)
def _is_finite(x):
    return lambda x: simd.is_finite(x)


# --- lanes one by one, in kernels ---------------------------------------------------------------------------------------


def is_mask(kind: Any) -> bool:
    """Whether a Numba type is one of a kernel's masks."""
    return isinstance(kind, types.Boolean) or (isinstance(kind, simd.Vector) and kind.kind == "m")


def width(like: Lane) -> int:
    """How many lanes a kernel's value has."""
    return np.size(like)


@overload(width, jit_options=_OPTIONS)
def _width(like):
    count = like.lanes if _vector(like) else 1
    return lambda like: count


def lane(x: Lane, k: int) -> Lane:
    """Lane k of a value, a scalar."""
    return np.ravel(x)[k]


@overload(lane, jit_options=_OPTIONS)
def _lane(x, k):
    if _vector(x):
        return lambda x, k: simd.lane(x, k)
    return lambda x, k: x


def with_lane(x: Lane, k: int, value: Lane) -> Lane:
    """A value with another lane k."""
    changed = np.array(x)
    changed[k] = value
    return changed


@overload(with_lane, jit_options=_OPTIONS)
def _with_lane(x, k, value):
    if _vector(x):
        return lambda x, k, value: simd.with_lane(x, k, value)
    return lambda x, k, value: value


@helper
def lane3(a: Vec, k: int) -> Vec:
    """Lane k of a vector."""
    return lane(a[0], k), lane(a[1], k), lane(a[2], k)


def load(table: Any, row: int) -> Lane:
    """A row of a (rows, WIDTH) table as a value."""
    return table[row]


@overload(load, jit_options=_OPTIONS)
def _load(table, row):
    if WIDTH > 1:
        return lambda table, row: simd.load(table, row * WIDTH, WIDTH)
    return lambda table, row: table[row, 0]


def store(table: Any, row: int, x: Lane) -> None:
    """Write a value to a row of a (rows, WIDTH) table."""
    table[row] = x


@overload(store, jit_options=_OPTIONS)
def _store(table, row, x):
    if _vector(x):
        return lambda table, row, x: simd.store(table, row * WIDTH, x)

    def write(table, row, x):
        table[row, 0] = x

    return write


def together(values: Lane, mask: Lane) -> tuple[Lane, Lane]:
    """Lanes of a mask that can be handled together, and what they have in common: all lanes here, each with its own value.

    In vectors: the value of the first lane of the mask, as a scalar, and the lanes of the mask that share it.
    """
    return values, mask


@overload(together, jit_options=_OPTIONS)
def _together(values, mask):
    if _vector(values):

        def first(values, mask):
            value = simd.lane(values, simd.trailing_zeros(simd.bits(mask)))
            return value, mask & (values == value)

        return first
    return lambda values, mask: (values, mask)


def put(stack: Any, place: Lane, field: int, value: Lane, mask: Lane) -> None:
    """Write stack[place, field, lane] in the lanes of a mask; `stack` is (rows, fields, lanes)."""
    lane = np.flatnonzero(np.broadcast_to(mask, stack.shape[2:]))
    stack[np.broadcast_to(place, stack.shape[2:])[lane], field, lane] = np.broadcast_to(value, stack.shape[2:])[lane]


@overload(put, jit_options=_OPTIONS)
def _put(stack, place, field, value, mask):
    if _vector(mask):

        def scatter(stack, place, field, value, mask):
            n = stack.shape[2]
            simd.scatter(stack, (place * stack.shape[1] + field) * n + simd.iota(place), full_like(mask, value), mask)

        return scatter

    def write(stack, place, field, value, mask):
        if mask:
            stack[place, field, 0] = value

    return write


def take(stack: Any, place: Lane, field: int) -> Lane:
    """Read stack[place, field, lane]."""
    return stack[place, field, np.arange(stack.shape[2])]


@overload(take, jit_options=_OPTIONS)
def _take(stack, place, field):
    if _vector(place):
        return lambda stack, place, field: simd.gather(stack, (place * stack.shape[1] + field) * stack.shape[2] + simd.iota(place))
    return lambda stack, place, field: stack[place, field, 0]


@helper
def put3(stack: Any, place: Lane, field: int, value: Vec, mask: Lane) -> None:
    """Write a vector to three fields."""
    put(stack, place, field, value[0], mask)
    put(stack, place, field + 1, value[1], mask)
    put(stack, place, field + 2, value[2], mask)


@helper
def take3(stack: Any, place: Lane, field: int) -> Vec:
    """Read a vector from three fields."""
    return take(stack, place, field), take(stack, place, field + 1), take(stack, place, field + 2)


# --- numbers ------------------------------------------------------------------------------------------------------------


@helper
def minimum(a: Lane, b: Lane) -> Lane:
    return where(a < b, a, b)


@helper
def maximum(a: Lane, b: Lane) -> Lane:
    return where(a > b, a, b)


@helper
def clip(x: Lane, low: Lane, high: Lane) -> Lane:
    return minimum(maximum(x, low), high)


def _function(of_arrays: Any, name: str) -> Any:
    """A function of lanes: numpy's on arrays; in kernels simd's on vectors, numpy's on scalars."""
    of_vectors = getattr(simd, name, None)

    def apply(x):
        return of_arrays(x)

    apply.__name__ = apply.__qualname__ = name

    @overload(apply, jit_options=_OPTIONS)
    def _in_kernels(x):
        if not _vector(x):
            return lambda x: of_arrays(x)
        if of_vectors is not None:
            return lambda x: of_vectors(x)

        def each(x):
            y = x
            for k in range(width(x)):
                y = simd.with_lane(y, k, of_arrays(simd.lane(x, k)))
            return y

        return each

    return apply


absolute = _function(np.abs, "absolute")
sqrt = _function(np.sqrt, "sqrt")
sin = _function(np.sin, "sin")
cos = _function(np.cos, "cos")
exp = _function(np.exp, "exp")
log = _function(np.log, "log")
floor = _function(np.floor, "floor")
_asin = _function(np.arcsin, "asin")
_acos = _function(np.arccos, "acos")


def _function2(of_arrays: Any, name: str) -> Any:
    """A function of two lanes, as `_function` of one."""
    of_vectors = getattr(simd, name, None)

    def apply(x, y):
        return of_arrays(x, y)

    apply.__name__ = apply.__qualname__ = name

    @overload(apply, jit_options=_OPTIONS)
    def _in_kernels(x, y):
        if not _vector(x, y):
            return lambda x, y: of_arrays(x, y)
        if of_vectors is not None:
            return lambda x, y: of_vectors(x, y)

        def each(x, y):
            a, b = x + 0.0 * y, y + 0.0 * x
            z = a
            for k in range(width(a)):
                z = simd.with_lane(z, k, of_arrays(simd.lane(a, k), simd.lane(b, k)))
            return z

        return each

    return apply


atan2 = _function2(np.arctan2, "atan2")
power = _function2(np.power, "pow")  # of x ≥ 0; 0⁰ = 1
hypot = _function2(np.hypot, "hypot")


@helper
def acos(x: Lane) -> Lane:
    """Arc cosine of x clipped to −1 … 1."""
    return _acos(clip(x, -1.0, 1.0))


@helper
def asin(x: Lane) -> Lane:
    """Arc sine of x clipped to −1 … 1."""
    return _asin(clip(x, -1.0, 1.0))


@helper
def lerp(a: Lane, b: Lane, t: Lane) -> Lane:
    return a + (b - a) * t


@helper
def sign_of(x: Lane) -> Lane:
    """1 for x ≥ 0, else −1."""
    return where(x >= 0.0, 1.0, -1.0)


# --- vectors ------------------------------------------------------------------------------------------------------------


@helper
def add(a: Vec, b: Vec) -> Vec:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@helper
def sub(a: Vec, b: Vec) -> Vec:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@helper
def mul(a: Vec, b: Vec) -> Vec:
    """Component by component."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@helper
def scale(a: Vec, s: Lane) -> Vec:
    return (a[0] * s, a[1] * s, a[2] * s)


@helper
def along(origin: Vec, direction: Vec, t: Lane) -> Vec:
    """origin + t · direction."""
    return (origin[0] + t * direction[0], origin[1] + t * direction[1], origin[2] + t * direction[2])


@helper
def negate(a: Vec) -> Vec:
    return (-a[0], -a[1], -a[2])


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
    """Unit length; a zero vector stays zero."""
    n = length(a)
    return scale(a, 1.0 / where(n > 0.0, n, 1.0))


@helper
def where3(condition: Lane, yes: Vec, no: Vec) -> Vec:
    return (where(condition, yes[0], no[0]), where(condition, yes[1], no[1]), where(condition, yes[2], no[2]))


@helper
def lerp3(a: Vec, b: Vec, t: Lane) -> Vec:
    return (lerp(a[0], b[0], t), lerp(a[1], b[1], t), lerp(a[2], b[2], t))


@helper
def largest(a: Vec) -> Lane:
    """The largest component."""
    return maximum(a[0], maximum(a[1], a[2]))


@helper
def reflect(direction: Vec, normal: Vec) -> Vec:
    """The direction a ray takes off a mirror with this unit normal."""
    k = 2.0 * dot(direction, normal)
    return (direction[0] - k * normal[0], direction[1] - k * normal[1], direction[2] - k * normal[2])


@helper
def basis(n: Vec) -> tuple[Vec, Vec]:
    """Two unit vectors that with unit n make a right-handed frame (Duff et al. 2017, Building an Orthonormal Basis, Revisited)."""
    s = sign_of(n[2])
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return (1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]), (b, s + n[1] * n[1] * a, -n[1])


@helper
def in_basis(s: Vec, t: Vec, n: Vec, x: Lane, y: Lane, z: Lane) -> Vec:
    """x s + y t + z n."""
    return (s[0] * x + t[0] * y + n[0] * z, s[1] * x + t[1] * y + n[1] * z, s[2] * x + t[2] * y + n[2] * z)


@helper
def like3(like: Lane, x: float, y: float, z: float) -> Vec:
    """The same vector in the lanes of `like`."""
    return (full_like(like, x), full_like(like, y), full_like(like, z))


@helper
def transform_point(matrix: Any, i: Lane, p: Vec) -> Vec:
    """Row i of (n, 3, 4) matrices applied to a point."""
    return (
        matrix[i, 0, 0] * p[0] + matrix[i, 0, 1] * p[1] + matrix[i, 0, 2] * p[2] + matrix[i, 0, 3],
        matrix[i, 1, 0] * p[0] + matrix[i, 1, 1] * p[1] + matrix[i, 1, 2] * p[2] + matrix[i, 1, 3],
        matrix[i, 2, 0] * p[0] + matrix[i, 2, 1] * p[1] + matrix[i, 2, 2] * p[2] + matrix[i, 2, 3],
    )


@helper
def transform_vector(matrix: Any, i: Lane, v: Vec) -> Vec:
    """Row i of (n, 3, 4) matrices applied to a direction."""
    return (
        matrix[i, 0, 0] * v[0] + matrix[i, 0, 1] * v[1] + matrix[i, 0, 2] * v[2],
        matrix[i, 1, 0] * v[0] + matrix[i, 1, 1] * v[1] + matrix[i, 1, 2] * v[2],
        matrix[i, 2, 0] * v[0] + matrix[i, 2, 1] * v[1] + matrix[i, 2, 2] * v[2],
    )


@helper
def transform_normal(inverse: Any, i: Lane, n: Vec) -> Vec:
    """A normal by the transpose of row i of the inverse matrices; not normalised."""
    return (
        inverse[i, 0, 0] * n[0] + inverse[i, 1, 0] * n[1] + inverse[i, 2, 0] * n[2],
        inverse[i, 0, 1] * n[0] + inverse[i, 1, 1] * n[1] + inverse[i, 2, 1] * n[2],
        inverse[i, 0, 2] * n[0] + inverse[i, 1, 2] * n[1] + inverse[i, 2, 2] * n[2],
    )
