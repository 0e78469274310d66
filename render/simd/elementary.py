"""Elementary functions in kernels: simd.sin(x), and overloads of np.sin and math.sin for vectors."""

from __future__ import annotations

import math
import operator
from typing import Any

import numpy as np
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import trigonometry
from .emitters import EMITTED
from .operators import define
from .polynomials import with_library_fallback
from .vector_type import Vector, common_type, intrinsic, lower_uniform, shape_of, value


@intrinsic
def sin(typingctx, x):
    return lower_uniform("f", EMITTED["sin"], typingctx, x)


@intrinsic
def cos(typingctx, x):
    return lower_uniform("f", EMITTED["cos"], typingctx, x)


@intrinsic
def sincos(typingctx, x):
    """(sin x, cos x) from one argument reduction."""
    x = types.unliteral(x)
    shape = shape_of(x)
    if shape is None or shape[0] != "f":
        return None
    pair = types.UniTuple(x, 2)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        angle = value(builder, args[0], x)
        sine, cosine = trigonometry.sincos(angle)
        far = trigonometry.is_far(angle)
        both = [with_library_fallback("sin", angle, sine, far).raw, with_library_fallback("cos", angle, cosine, far).raw]
        return context.make_tuple(builder, pair, both)

    return signature(pair, x), generate


@intrinsic
def tan(typingctx, x):
    return lower_uniform("f", EMITTED["tan"], typingctx, x)


@intrinsic
def asin(typingctx, x):
    """Arc sine; NaN outside of −1 … 1."""
    return lower_uniform("f", EMITTED["asin"], typingctx, x)


@intrinsic
def acos(typingctx, x):
    """Arc cosine; NaN outside of −1 … 1."""
    return lower_uniform("f", EMITTED["acos"], typingctx, x)


@intrinsic
def atan(typingctx, x):
    return lower_uniform("f", EMITTED["atan"], typingctx, x)


@intrinsic
def atan2(typingctx, y, x):
    """Angle of the point (x, y), −π … π."""
    return lower_uniform("f", EMITTED["atan2"], typingctx, y, x)


@intrinsic
def exp(typingctx, x):
    return lower_uniform("f", EMITTED["exp"], typingctx, x)


@intrinsic
def log(typingctx, x):
    """Natural logarithm; −∞ of 0, NaN below."""
    return lower_uniform("f", EMITTED["log"], typingctx, x)


@intrinsic
def power(typingctx, x, y):
    """x to the y; NaN for negative x and non-integral y. 0⁰ is 1."""
    return lower_uniform("f", EMITTED["power"], typingctx, x, y)


@intrinsic
def hypot(typingctx, x, y):
    """√(x² + y²) without intermediate overflow."""
    return lower_uniform("f", EMITTED["hypot"], typingctx, x, y)


def _floats(context: Any, *kinds: types.Type) -> Signature | None:
    """Typing rule: all operands convert to floats of the vector's width."""
    kind = common_type(context, *kinds)
    if not isinstance(kind, Vector):
        return None
    kind = Vector("f", kind.bits, kind.lanes)
    return signature(kind, *[kind] * len(kinds))


def _number(context: Any, x: types.Type) -> Signature | None:
    return signature(x, x) if isinstance(x, Vector) and x.kind != "m" else None


for _functions, _emit in (
    ((np.sin, math.sin), EMITTED["sin"]),
    ((np.cos, math.cos), EMITTED["cos"]),
    ((np.tan, math.tan), EMITTED["tan"]),
    ((np.arcsin, math.asin), EMITTED["asin"]),
    ((np.arccos, math.acos), EMITTED["acos"]),
    ((np.arctan, math.atan), EMITTED["atan"]),
    ((np.arctan2, math.atan2), EMITTED["atan2"]),
    ((np.exp, math.exp), EMITTED["exp"]),
    ((np.log, math.log), EMITTED["log"]),
    ((np.power, math.pow, operator.pow, operator.ipow), EMITTED["power"]),
    ((np.hypot, math.hypot), EMITTED["hypot"]),
    ((np.sqrt, math.sqrt), lambda x: x.call("sqrt")),
    ((np.floor,), lambda x: x.call("floor")),
    ((np.ceil,), lambda x: x.call("ceil")),
    ((np.trunc,), lambda x: x.call("trunc")),
    ((np.rint,), lambda x: x.call("nearbyint")),
    ((np.copysign, math.copysign), lambda x, y: x.call("copysign", y)),
):
    for _function in _functions:
        define(_function, _floats, _emit)

define(np.abs, _number, abs)
