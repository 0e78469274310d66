"""Code emitters of elementary functions on Values, for simd.sin and its like and for formulas."""

from __future__ import annotations

from collections.abc import Callable

from . import exponential, trigonometry
from .llvm_expr import Value
from .polynomials import call_shared, with_library_fallback


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
    "power": _pow, "hypot": _hypot,
}  # fmt: skip
"""The emitter of each function."""
