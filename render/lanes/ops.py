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

from .. import simd
from ..jit.kernel import HELPER, helper
from ..types import Lane, Vec

MOST_FACTORS = 256  # whole powers up to this are taken by squaring
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


def roundoff(like: Lane) -> float:
    """Half the distance from 1 to the next number of a lane's kind: 2⁻⁵³, or 2⁻²⁴ in lanes of float32."""
    return 2.0**-53


@on_scalars(roundoff)
def _roundoff(like):
    unit = 2.0**-24 if like == types.float32 else 2.0**-53
    return lambda like: unit


@overload(roundoff, jit_options=HELPER)
def _roundoff_of_vectors(like):
    if not isinstance(like, simd.Vector):
        return None
    unit = 2.0**-24 if like.bits == 32 else 2.0**-53
    return lambda like: unit


def is_finite(x: Lane) -> Lane:
    """Neither infinite nor NaN."""
    return np.isfinite(x)


@on_scalars(is_finite)
def _is_finite(x):
    return lambda x: math.isfinite(x)


# --- numbers ------------------------------------------------------------------------------------------------------------


def fma(a: Lane, b: Lane, c: Lane) -> Lane:
    """a · b + c, rounded once in lanes of float32 (where the machine can), else twice."""
    return a * b + c


def _narrow(*kinds: Any) -> bool:
    """Whether lanes of float32 are among the types."""
    return any(isinstance(kind, simd.Vector) and kind.kind == "f" and kind.bits == 32 for kind in kinds)


@overload(fma, jit_options=HELPER)
def _fma(a, b, c):
    if _narrow(a, b, c):
        return lambda a, b, c: simd.fma(a, b, c)
    return lambda a, b, c: a * b + c


def inverse(x: Lane) -> Lane:
    """1 / x; to 2 ulp in lanes of float32."""
    return 1.0 / x


@overload(inverse, jit_options=HELPER)
def _inverse(x):
    if _narrow(x):
        return lambda x: simd.reciprocal(x)
    return lambda x: 1.0 / x


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


def fast_pow(x: Lane, y: Lane) -> Lane:
    """x to the y for 0 < x <= 1 and y >= 0: much quicker than `power`, its error a few roundings of y log x or, for whole y, of y."""
    return np.power(x, y)


@overload(fast_pow, jit_options=HELPER)
def _fading(x, y):
    if isinstance(y, simd.Vector):

        def by_lanes(x, y):
            one = simd.lane(y, 0)
            whole = np.int64(min(one, 1e3))
            if whole <= MOST_FACTORS and simd.all_of(y == whole):
                return _whole_power(x, whole)
            return np.exp(y * np.log(x))

        return by_lanes

    def by_one(x, y):
        whole = np.int64(min(y, 1e3))
        return _whole_power(x, whole) if whole <= MOST_FACTORS and whole == y else np.exp(y * np.log(x))

    return by_one


@helper
def _whole_power(x: Lane, n: int) -> Lane:
    """By squaring: x, x², x⁴ … are multiplied where n has a bit."""
    if n <= 0:
        return 0.0 * x + 1.0
    while n & 1 == 0:
        x = x * x
        n >>= 1
    found = x
    while n > 1:
        x = x * x
        n >>= 1
        if n & 1:
            found = found * x
    return found


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
    return (fma(t, direction[0], origin[0]), fma(t, direction[1], origin[1]), fma(t, direction[2], origin[2]))


@helper
def negate(a: Vec) -> Vec:
    return (-a[0], -a[1], -a[2])


@helper
def dot(a: Vec, b: Vec) -> Lane:
    return fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]))


@helper
def cross(a: Vec, b: Vec) -> Vec:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@helper
def length(a: Vec) -> Lane:
    return np.sqrt(dot(a, a))


def rsqrt(x: Lane) -> Lane:
    """1 / √x, and 1 where x is not above 0; on vectors of float32 to 3 ulp."""
    n = np.sqrt(x)
    return 1.0 / where(n > 0.0, n, 1.0)


@overload(rsqrt, jit_options=HELPER)
def _over_root(x):
    def exact(x):
        n = np.sqrt(x)
        return 1.0 / where(n > 0.0, n, 1.0)

    def quick(x):
        return where(x > 0.0, simd.reciprocal_sqrt(x), 1.0)

    return quick if isinstance(x, simd.Vector) and x.bits == 32 else exact


@helper
def normalize(a: Vec) -> Vec:
    """Unit length; a zero vector stays zero."""
    return scale(a, rsqrt(dot(a, a)))


@helper
def where3(condition: Lane, yes: Vec, no: Vec) -> Vec:
    return (where(condition, yes[0], no[0]), where(condition, yes[1], no[1]), where(condition, yes[2], no[2]))


@helper
def lerp3(a: Vec, b: Vec, t: Lane) -> Vec:
    return (lerp(a[0], b[0], t), lerp(a[1], b[1], t), lerp(a[2], b[2], t))


@helper
def mean3(a: Vec) -> Lane:
    """The mean of the components."""
    return (a[0] + a[1] + a[2]) * (1.0 / 3.0)


@helper
def smallest(a: Vec) -> Lane:
    """The smallest component."""
    return minimum(a[0], minimum(a[1], a[2]))


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
    return (
        fma(n[0], z, fma(t[0], y, s[0] * x)), fma(n[1], z, fma(t[1], y, s[1] * x)), fma(n[2], z, fma(t[2], y, s[2] * x)),
    )  # fmt: skip


@helper
def like3(like: Lane, x: float, y: float, z: float) -> Vec:
    """The same vector in the lanes of `like`."""
    return (full_like(like, x), full_like(like, y), full_like(like, z))


@helper
def affine(matrix: Any, i: Lane) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]:
    """Row i of (n, 3, 4) matrices as twelve numbers, row by row."""
    return (
        matrix[i, 0, 0], matrix[i, 0, 1], matrix[i, 0, 2], matrix[i, 0, 3], matrix[i, 1, 0], matrix[i, 1, 1], matrix[i, 1, 2],
        matrix[i, 1, 3], matrix[i, 2, 0], matrix[i, 2, 1], matrix[i, 2, 2], matrix[i, 2, 3],
    )  # fmt: skip


@helper
def transform_point12(m: Any, p: Vec) -> Vec:
    """An affine's twelve numbers applied to a point."""
    return (
        m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3], m[4] * p[0] + m[5] * p[1] + m[6] * p[2] + m[7],
        m[8] * p[0] + m[9] * p[1] + m[10] * p[2] + m[11],
    )  # fmt: skip


@helper
def transform_vector12(m: Any, v: Vec) -> Vec:
    """An affine's twelve numbers applied to a direction."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2], m[4] * v[0] + m[5] * v[1] + m[6] * v[2], m[8] * v[0] + m[9] * v[1] + m[10] * v[2],
    )  # fmt: skip


@helper
def normal_by(inverse: Any, n: Vec) -> Vec:
    """A normal by the transpose of an inverse's twelve numbers; not normalised."""
    m = inverse
    return (
        m[0] * n[0] + m[4] * n[1] + m[8] * n[2], m[1] * n[0] + m[5] * n[1] + m[9] * n[2], m[2] * n[0] + m[6] * n[1] + m[10] * n[2],
    )  # fmt: skip


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
