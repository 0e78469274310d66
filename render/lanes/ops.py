"""Lane-generic arithmetic: one source for numpy arrays and, in kernels, scalars and SIMD vectors.

Write straight-line code. `where` selects; `if any_lane(mask):` skips work that no lane needs. Both sides of a `where` are computed, so
guard denominators. 3D vectors are tuples (x, y, z). Comparisons with NaN are false. `minimum`, `maximum` and `clip` are comparisons: with
NaN as the first operand they return the second one.

SIMD code uses one lane width: float64 lanes go with int64 lanes, float32 lanes with int32 lanes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..simd import llvm_expr
from ..simd.registration import define, overload, signature, types
from ..types import Lane, Vec

_MAX_INT = 2.0**62  # bound of the float64 values that convert to int64


def on_scalars(function: Callable[..., Any]) -> Callable[..., Any]:
    """Overload a function for scalar arguments; `simd.define` covers calls with a vector among the arguments."""

    def decorate(choose: Callable[..., Any]) -> Callable[..., Any]:  # `choose` has no annotations: Numba compares signatures
        @overload(function)
        @functools.wraps(choose)
        def scalar(*kinds):
            return None if any(isinstance(kind, simd.Vector) for kind in kinds) else choose(*kinds)

        return scalar

    return decorate


def where(condition: Lane, yes: Lane, no: Lane) -> Lane:
    """Select `yes` in lanes where the condition holds, else `no`."""
    return np.where(condition, yes, no)


@on_scalars(where)
def _where(condition, yes, no):
    return lambda condition, yes, no: yes if condition else no


def any_lane(mask: Lane) -> Any:
    """Return whether any lane of a mask is set; the only condition a data-dependent `if` may have."""
    return bool(np.any(mask))


@on_scalars(any_lane)
def _any_lane(mask):
    return lambda mask: mask


def not_(mask: Lane) -> Lane:
    """Invert a mask (`~` on a scalar bool gives −1 or −2)."""
    return np.logical_not(mask)


@on_scalars(not_)
def _not(mask):
    return lambda mask: not mask


def to_float(x: Lane) -> Lane:
    """Convert to float64."""
    return np.asarray(x, dtype=np.float64)


@on_scalars(to_float)
def _to_float(x):
    return lambda x: float(x)


def to_int(x: Lane) -> Lane:
    """Convert to int64, rounding towards zero."""
    return np.asarray(x).astype(np.int64)


@on_scalars(to_int)
def _to_int(x):
    return lambda x: np.int64(x)


def floor_int(x: Lane) -> Lane:
    """Round down to int64; 0 where x is not finite or beyond int64."""
    return np.where(np.abs(x) < _MAX_INT, np.floor(x), 0.0).astype(np.int64)


@on_scalars(floor_int)
def _floor_int(x):
    return lambda x: np.int64(math.floor(x)) if abs(x) < _MAX_INT else np.int64(0)


def full_like(like: Lane, value: Any) -> Lane:
    """Broadcast `value` as float64 to the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.float64)


@on_scalars(full_like)
def _full_like(like, value):
    return lambda like, value: float(value)


def int_like(like: Lane, value: Any) -> Lane:
    """Broadcast `value` as int64 to the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.int64)


@on_scalars(int_like)
def _int_like(like, value):
    return lambda like, value: np.int64(value)


def bool_like(like: Lane, value: bool) -> Lane:
    """Broadcast `value` as a mask to the lanes of `like`."""
    return np.full(np.shape(like), value, dtype=np.bool_)


@on_scalars(bool_like)
def _bool_like(like, value):
    return lambda like, value: bool(value)


def roundoff(like: Lane) -> float:
    """Return the unit roundoff of the lane type: 2⁻⁵³, or 2⁻²⁴ for float32 lanes."""
    return 2.0**-53


@overload(roundoff)
def _roundoff(like):
    single = like.bits == 32 if isinstance(like, simd.Vector) else like == types.float32
    unit = 2.0**-24 if single else 2.0**-53
    return lambda like: unit


def is_finite(x: Lane) -> Lane:
    """Mask of lanes that are neither infinite nor NaN."""
    return np.isfinite(x)


@on_scalars(is_finite)
def _is_finite(x):
    return lambda x: math.isfinite(x)


# --- scalars ------------------------------------------------------------------------------------------------------------


def fma(a: Lane, b: Lane, c: Lane) -> Lane:
    """a · b + c, rounded once in float32 lanes if the machine has the instruction, else twice."""
    return a * b + c


def _has_float32(*kinds: Any) -> bool:
    """Return whether any type is a vector of float32 lanes."""
    return any(isinstance(kind, simd.Vector) and kind.kind == "f" and kind.bits == 32 for kind in kinds)


@overload(fma)
def _fma(a, b, c):
    if _has_float32(a, b, c):
        return lambda a, b, c: simd.fma(a, b, c)
    return lambda a, b, c: a * b + c


def inverse(x: Lane) -> Lane:
    """1 / x, to 2 ulp in float32 lanes."""
    return 1.0 / x


@overload(inverse)
def _inverse(x):
    if _has_float32(x):
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


@helper
def lerp(a: Lane, b: Lane, t: Lane) -> Lane:
    return a + (b - a) * t


@helper
def sign_of(x: Lane) -> Lane:
    """1 for x ≥ 0, else −1."""
    return where(x >= 0.0, 1.0, -1.0)


# --- SIMD overloads -----------------------------------------------------------------------------------------------------


def _converts_to(kind: str) -> Callable[..., Any]:
    """Typing rule of a conversion to lanes of a kind, of the argument's width and count."""
    return lambda context, x: signature(simd.Vector(kind, x.bits, x.lanes), x)


def _broadcasts_to(kind: str) -> Callable[..., Any]:
    """Typing rule of a function of (like, value) to lanes of a kind, of the width and count of `like`."""

    def typing(context: Any, like: Any, value: Any) -> Any:
        if not isinstance(like, simd.Vector):
            return None
        result = simd.Vector(kind, like.bits, like.lanes)
        return signature(result, like, result)

    return typing


def _same_type(context: Any, x: Any) -> Any:
    return signature(x, x)


def _floor_to_int(x: llvm_expr.Value) -> llvm_expr.Value:
    floored = x.call("floor")
    return llvm_expr.select(abs(x) < 2.0 ** (x.bits - 2), floored, x.constant(0.0)).to("i", x.bits)


define(where, lambda *kinds: simd.select_signature(*kinds), lambda *values: llvm_expr.select(*values))
define(any_lane, lambda context, mask: signature(types.boolean, mask), lambda mask: llvm_expr.mask_bits(mask) != 0)
define(not_, _same_type, lambda mask: ~mask)
define(to_float, _converts_to("f"), lambda x: x.to("f", x.bits))
define(to_int, _converts_to("i"), lambda x: x.to("i", x.bits))
define(floor_int, _converts_to("i"), _floor_to_int)
define(is_finite, _converts_to("m"), lambda x: abs(x) < math.inf)
define(full_like, _broadcasts_to("f"), lambda like, value: value)
define(int_like, _broadcasts_to("i"), lambda like, value: value)
define(bool_like, _broadcasts_to("m"), lambda like, value: value)


# --- 3D vectors ---------------------------------------------------------------------------------------------------------


@helper
def add(a: Vec, b: Vec) -> Vec:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@helper
def sub(a: Vec, b: Vec) -> Vec:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@helper
def mul(a: Vec, b: Vec) -> Vec:
    """Componentwise product."""
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
    """1 / √x, and 1 where x is not above 0; to 3 ulp in float32 lanes."""
    n = np.sqrt(x)
    return 1.0 / where(n > 0.0, n, 1.0)


@overload(rsqrt)
def _rsqrt(x):
    def exact(x):
        n = np.sqrt(x)
        return 1.0 / where(n > 0.0, n, 1.0)

    def estimate(x):
        return where(x > 0.0, simd.reciprocal_sqrt(x), 1.0)

    return estimate if isinstance(x, simd.Vector) and x.bits == 32 else exact


@helper
def normalize(a: Vec) -> Vec:
    """Scale to unit length; a zero vector stays zero."""
    return scale(a, rsqrt(dot(a, a)))


@helper
def where3(condition: Lane, yes: Vec, no: Vec) -> Vec:
    return (where(condition, yes[0], no[0]), where(condition, yes[1], no[1]), where(condition, yes[2], no[2]))


@helper
def lerp3(a: Vec, b: Vec, t: Lane) -> Vec:
    return (lerp(a[0], b[0], t), lerp(a[1], b[1], t), lerp(a[2], b[2], t))


@helper
def mean3(a: Vec) -> Lane:
    """Mean of the components."""
    return (a[0] + a[1] + a[2]) * (1.0 / 3.0)


@helper
def smallest(a: Vec) -> Lane:
    """Smallest component."""
    return minimum(a[0], minimum(a[1], a[2]))


@helper
def largest(a: Vec) -> Lane:
    """Largest component."""
    return maximum(a[0], maximum(a[1], a[2]))


@helper
def reflect(direction: Vec, normal: Vec) -> Vec:
    """Mirror reflection of a direction at a surface of unit normal."""
    k = 2.0 * dot(direction, normal)
    return (direction[0] - k * normal[0], direction[1] - k * normal[1], direction[2] - k * normal[2])


@helper
def basis(n: Vec) -> tuple[Vec, Vec]:
    """Two unit vectors that complete unit n to a right-handed frame (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").

    The frame jumps at z = −0.65, not at 0. Normals of z = 0 are frequent, and errors of rounding would give neighbors different frames.
    """
    s = sign_of(n[2] + 0.65)
    a = -1.0 / (s + n[2])
    b = n[0] * n[1] * a
    return (1.0 + s * n[0] * n[0] * a, s * b, -s * n[0]), (b, s + n[1] * n[1] * a, -n[1])


@helper
def in_basis(s: Vec, t: Vec, n: Vec, x: Lane, y: Lane, z: Lane) -> Vec:
    """The vector x s + y t + z n."""
    return (
        fma(n[0], z, fma(t[0], y, s[0] * x)), fma(n[1], z, fma(t[1], y, s[1] * x)), fma(n[2], z, fma(t[2], y, s[2] * x)),
    )  # fmt: skip


@helper
def like3(like: Lane, x: float, y: float, z: float) -> Vec:
    """Broadcast a vector to the lanes of `like`."""
    return (full_like(like, x), full_like(like, y), full_like(like, z))
