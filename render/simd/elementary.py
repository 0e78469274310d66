"""Elementary functions in kernels: simd.sin(x), and overloads of np.sin and math.sin for vectors."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.core import types
from numba.core.typing.templates import Signature, signature

from . import exponential, trigonometry
from .llvm_expr import Value
from .operators import define
from .polynomials import call_shared, with_library_fallback
from .vector_type import Vector, common_type, intrinsic, lower_uniform, shape_of, value


def _shared_function(name: str, body: Callable[..., Value]) -> Callable[..., Value]:
    return lambda *arguments: call_shared(name, body, *arguments)


def _with_library(name: str, body: Callable[[Value], Value]) -> Callable[[Value], Value]:
    return lambda x: with_library_fallback(name, x, call_shared(name, body, x), trigonometry.is_far(x))


_sin = _with_library("sin", lambda x: trigonometry.sincos(x)[0])
_cos = _with_library("cos", lambda x: trigonometry.sincos(x)[1])
_tan = _with_library("tan", trigonometry.tan)
_asin = _shared_function("asin", trigonometry.asin)
_acos = _shared_function("acos", trigonometry.acos)
_atan = _shared_function("atan", trigonometry.atan)
_atan2 = _shared_function("atan2", trigonometry.atan2)
_exp = _shared_function("exp", exponential.exp)
_log = _shared_function("log", exponential.log)
_pow = _shared_function("pow", exponential.power)
_hypot = _shared_function("hypot", exponential.hypot)

EMITTED: dict[str, Callable[..., Value]] = {
    "sin": _sin, "cos": _cos, "tan": _tan, "asin": _asin, "acos": _acos, "atan": _atan, "atan2": _atan2, "exp": _exp, "log": _log,
    "power": _pow,
}  # fmt: skip
"""The emitter of each function, for LLVM code written without Numba (render/formula)."""


@intrinsic
def sin(typingctx, x):
    return lower_uniform("f", _sin, typingctx, x)


@intrinsic
def cos(typingctx, x):
    return lower_uniform("f", _cos, typingctx, x)


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
    return lower_uniform("f", _tan, typingctx, x)


@intrinsic
def asin(typingctx, x):
    """Arc sine; NaN outside of −1 … 1."""
    return lower_uniform("f", _asin, typingctx, x)


@intrinsic
def acos(typingctx, x):
    """Arc cosine; NaN outside of −1 … 1."""
    return lower_uniform("f", _acos, typingctx, x)


@intrinsic
def atan(typingctx, x):
    return lower_uniform("f", _atan, typingctx, x)


@intrinsic
def atan2(typingctx, y, x):
    """Angle of the point (x, y), −π … π."""
    return lower_uniform("f", _atan2, typingctx, y, x)


@intrinsic
def exp(typingctx, x):
    return lower_uniform("f", _exp, typingctx, x)


@intrinsic
def log(typingctx, x):
    """Natural logarithm; −∞ of 0, NaN below."""
    return lower_uniform("f", _log, typingctx, x)


@intrinsic
def power(typingctx, x, y):
    """x to the y; NaN for negative x and non-integral y. 0⁰ is 1."""
    return lower_uniform("f", _pow, typingctx, x, y)


@intrinsic
def hypot(typingctx, x, y):
    """√(x² + y²) without intermediate overflow."""
    return lower_uniform("f", _hypot, typingctx, x, y)


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
    ((np.sin, math.sin), _sin),
    ((np.cos, math.cos), _cos),
    ((np.tan, math.tan), _tan),
    ((np.arcsin, math.asin), _asin),
    ((np.arccos, math.acos), _acos),
    ((np.arctan, math.atan), _atan),
    ((np.arctan2, math.atan2), _atan2),
    ((np.exp, math.exp), _exp),
    ((np.log, math.log), _log),
    ((np.power, math.pow, operator.pow, operator.ipow), _pow),
    ((np.hypot, math.hypot), _hypot),
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
