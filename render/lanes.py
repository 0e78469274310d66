"""Lane operations: the same source runs on numpy arrays and, in kernels, on scalars and on SIMD vectors.

Write straight-line code: `where` chooses, `if any_lane(mask):` skips what no lane needs. Both sides of a `where` are computed, so guard
denominators. Vectors are tuples (x, y, z). Comparisons with NaN are false, and `minimum`, `maximum` and `clip` are made of
comparisons: with NaN as the first operand they give the second one.

On vectors (simd/) one width goes through the code: lanes of float64 have ints of 64 bits, lanes of float32 ints of 32.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import types
from numba.core.typing.templates import signature
from numba.extending import overload

from . import simd
from .kernels import HELPER, helper
from .records import Lane, Vec

WIDTH = simd.WIDTH64  # lanes of a kernel's values
_FITS = 2.0**62  # beyond this a float64 has no int64


def on_scalars(function: Callable[..., Any]) -> Callable[..., Any]:
    """`overload` for kernels that work on numbers; where a vector is among the types, `on_vectors` has the say."""

    def decorate(choose: Callable[..., Any]) -> Callable[..., Any]:  # `choose` bears no annotations: Numba compares signatures
        @overload(function, jit_options=HELPER)
        @functools.wraps(choose)
        def scalar(*kinds):
            return None if any(isinstance(kind, simd.Vector) for kind in kinds) else choose(*kinds)

        return scalar

    return decorate


def where(condition: Lane, yes: Lane, no: Lane) -> Lane:
    """`yes` in lanes where the condition holds, else `no`."""
    return np.where(condition, yes, no)


@on_scalars(where)
def _where(condition, yes, no):
    return lambda condition, yes, no: yes if condition else no


def any_lane(mask: Lane) -> Any:
    """Whether any lane of a mask is set; the only thing a data-dependent `if` may ask."""
    return bool(np.any(mask))


@on_scalars(any_lane)
def _any_lane(mask):
    return lambda mask: mask


def not_(mask: Lane) -> Lane:
    """The other lanes (~ on a scalar bool would be −1 or −2)."""
    return np.logical_not(mask)


@on_scalars(not_)
def _not(mask):
    return lambda mask: not mask


def to_float(x: Lane) -> Lane:
    """As float64."""
    return np.asarray(x, dtype=np.float64)


@on_scalars(to_float)
def _to_float(x):
    return lambda x: float(x)


def to_int(x: Lane) -> Lane:
    """As int64, towards zero."""
    return np.asarray(x).astype(np.int64)


@on_scalars(to_int)
def _to_int(x):
    return lambda x: np.int64(x)


def floor_int(x: Lane) -> Lane:
    """The whole number below, as int64; 0 where x is not finite or beyond int64."""
    return np.where(np.abs(x) < _FITS, np.floor(x), 0.0).astype(np.int64)


@on_scalars(floor_int)
def _floor_int(x):
    return lambda x: np.int64(math.floor(x)) if abs(x) < _FITS else np.int64(0)


def full_like(like: Lane, value: Any) -> Lane:
    """`value` as float64 in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.float64)


@on_scalars(full_like)
def _full_like(like, value):
    return lambda like, value: float(value)


def int_like(like: Lane, value: Any) -> Lane:
    """`value` as int64 in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.int64)


@on_scalars(int_like)
def _int_like(like, value):
    return lambda like, value: np.int64(value)


def bool_like(like: Lane, value: bool) -> Lane:
    """`value` as a mask in the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.bool_)


@on_scalars(bool_like)
def _bool_like(like, value):
    return lambda like, value: bool(value)


def is_finite(x: Lane) -> Lane:
    """Neither infinite nor NaN."""
    return np.isfinite(x)


@on_scalars(is_finite)
def _is_finite(x):
    return lambda x: math.isfinite(x)


# --- lanes one by one, in kernels ---------------------------------------------------------------------------------------


def _vector(kind: Any) -> bool:
    return isinstance(kind, simd.Vector)


def kind(of: str) -> Any:
    """Numba's type of a kernel's lanes of 64 bits: "f" float, "i" int, "m" mask."""
    if WIDTH > 1:
        return simd.Vector(of, 64, WIDTH)
    return {"f": types.float64, "i": types.int64, "m": types.boolean}[of]


def is_mask(kind: Any) -> bool:
    """Whether a Numba type is one of a kernel's masks."""
    return isinstance(kind, types.Boolean) or (isinstance(kind, simd.Vector) and kind.kind == "m")


def width(like: Lane) -> int:
    """How many lanes a kernel's value has."""
    return np.size(like)


@overload(width, jit_options=HELPER)
def _width(like):
    count = like.lanes if _vector(like) else 1
    return lambda like: count


def lane(x: Lane, k: int) -> Lane:
    """Lane k of a value, a scalar."""
    return np.ravel(x)[k]


@overload(lane, jit_options=HELPER)
def _lane(x, k):
    if _vector(x):
        return lambda x, k: simd.lane(x, k)
    return lambda x, k: x


def with_lane(x: Lane, k: int, value: Lane) -> Lane:
    """A value with another lane k."""
    changed = np.array(x)
    changed[k] = value
    return changed


@overload(with_lane, jit_options=HELPER)
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


@overload(load, jit_options=HELPER)
def _load(table, row):
    if WIDTH > 1:
        return lambda table, row: simd.load(table, row * WIDTH, WIDTH)
    return lambda table, row: table[row, 0]


def store(table: Any, row: int, x: Lane) -> None:
    """Write a value to a row of a (rows, WIDTH) table."""
    table[row] = x


@overload(store, jit_options=HELPER)
def _store(table, row, x):
    if _vector(x):
        return lambda table, row, x: simd.store(table, row * WIDTH, x)

    def write(table, row, x):
        table[row, 0] = x

    return write


def numbered(first: int) -> Lane:
    """first, first + 1, … in a kernel's WIDTH lanes of int64."""
    return first + np.arange(WIDTH)


@overload(numbered, jit_options=HELPER)
def _numbered(first):
    if WIDTH > 1:
        make = getattr(simd, f"i64x{WIDTH}")
        return lambda first: first + simd.iota(make(0))
    return lambda first: np.int64(first)


def total(x: Lane) -> Lane:
    """The sum of all lanes."""
    return np.sum(x)


@overload(total, jit_options=HELPER)
def _total(x):
    if _vector(x):
        return lambda x: simd.sum_of(x)
    return lambda x: x


def least(x: Lane) -> Lane:
    """The smallest of all lanes."""
    return np.min(x)


@overload(least, jit_options=HELPER)
def _least(x):
    if _vector(x):
        return lambda x: simd.min_of(x)
    return lambda x: x


def most(x: Lane) -> Lane:
    """The largest of all lanes."""
    return np.max(x)


@overload(most, jit_options=HELPER)
def _most(x):
    if _vector(x):
        return lambda x: simd.max_of(x)
    return lambda x: x


def count(mask: Lane) -> Lane:
    """How many lanes of a mask are set."""
    return np.count_nonzero(mask)


@overload(count, jit_options=HELPER)
def _count(mask):
    if _vector(mask):
        return lambda mask: simd.count(mask)
    return lambda mask: 1 if mask else 0


def together(values: Lane, mask: Lane) -> tuple[Lane, Lane]:
    """Lanes of a mask that can be handled together, and what they have in common: all lanes here, each with its own value.

    In vectors: the value of the first lane of the mask, as a scalar, and the lanes of the mask that share it.
    """
    return values, mask


@overload(together, jit_options=HELPER)
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


@overload(put, jit_options=HELPER)
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


@overload(take, jit_options=HELPER)
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


@helper
def absolute(x: Lane) -> Lane:
    return np.abs(x)


@helper
def sqrt(x: Lane) -> Lane:
    return np.sqrt(x)


@helper
def sin(x: Lane) -> Lane:
    return np.sin(x)


@helper
def cos(x: Lane) -> Lane:
    return np.cos(x)


@helper
def acos(x: Lane) -> Lane:
    """Arc cosine of x clipped to −1 … 1."""
    return np.arccos(clip(x, -1.0, 1.0))


@helper
def asin(x: Lane) -> Lane:
    """Arc sine of x clipped to −1 … 1."""
    return np.arcsin(clip(x, -1.0, 1.0))


@helper
def atan2(y: Lane, x: Lane) -> Lane:
    return np.arctan2(y, x)


@helper
def hypot(x: Lane, y: Lane) -> Lane:
    return np.hypot(x, y)


@helper
def exp(x: Lane) -> Lane:
    return np.exp(x)


@helper
def log(x: Lane) -> Lane:
    return np.log(x)


@helper
def floor(x: Lane) -> Lane:
    return np.floor(x)


@helper
def power(x: Lane, y: Lane) -> Lane:
    """x to the y, for x ≥ 0; 0⁰ = 1."""
    return np.power(x, y)


@helper
def lerp(a: Lane, b: Lane, t: Lane) -> Lane:
    return a + (b - a) * t


@helper
def sign_of(x: Lane) -> Lane:
    """1 for x ≥ 0, else −1."""
    return where(x >= 0.0, 1.0, -1.0)


# --- on SIMD vectors ----------------------------------------------------------------------------------------------------


def _lanes_of(kind: str) -> Callable[..., Any]:
    """Numba's signature of a function to lanes of a kind, as wide as its argument's."""
    return lambda context, x: signature(simd.Vector(kind, x.bits, x.lanes), x)


def _filled(kind: str) -> Callable[..., Any]:
    """Numba's signature of a function of (like, value) to lanes of a kind, as wide and as many as `like` has."""

    def typing(context: Any, like: Any, value: Any) -> Any:
        if not isinstance(like, simd.Vector):
            return None
        whole = simd.Vector(kind, like.bits, like.lanes)
        return signature(whole, like, whole)

    return typing


def _same(context: Any, x: Any) -> Any:
    return signature(x, x)


def _floor_to_int(x: simd.Value) -> simd.Value:
    whole = x.call("floor")
    return simd.choose(abs(x) < 2.0 ** (x.bits - 2), whole, x.constant(0.0)).to("i", x.bits)


simd.define(where, simd.select_signature, simd.choose)
simd.define(any_lane, lambda context, mask: signature(types.boolean, mask), lambda mask: simd.mask_bits(mask) != 0)
simd.define(not_, _same, lambda mask: ~mask)
simd.define(to_float, _lanes_of("f"), lambda x: x.to("f", x.bits))
simd.define(to_int, _lanes_of("i"), lambda x: x.to("i", x.bits))
simd.define(floor_int, _lanes_of("i"), _floor_to_int)
simd.define(is_finite, _lanes_of("m"), lambda x: abs(x) < math.inf)
simd.define(full_like, _filled("f"), lambda like, value: value)
simd.define(int_like, _filled("i"), lambda like, value: value)
simd.define(bool_like, _filled("m"), lambda like, value: value)


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
    return np.sqrt(dot(a, a))


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
