"""Python's operators, abs, min and max on vectors in kernels."""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import reduce
from typing import Any

from numba.core import types
from numba.core.typing.templates import AbstractTemplate, Signature, infer_global, signature
from numba.extending import lower_builtin

from .llvm_expr import maximum, minimum
from .vector_type import Vector, common_type, promote, value

Emit = Callable[..., Any]  # of Values, a Value
Typing = Callable[..., Signature | None]


def define(function: Any, typing: Typing, emit: Emit) -> None:
    """Implement a Python function for vectors: `typing(context, *kinds)` returns the signature or None, `emit` the code.

    Numba converts the arguments to the signature's types. Implementations of `function` for other types stay.
    """

    class Key:
        """Key of this implementation: the function itself as key would shadow Numba's implementations for other types."""

    class Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Signature | None:
            return None if kws or not any(isinstance(a, Vector) for a in args) else typing(self.context, *args)

        def get_impl_key(self, sig: Any) -> Any:
            return Key

    infer_global(function)(Template)  # pyright: ignore[reportOptionalCall]

    def lower(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return emit(*(value(builder, a, t) for a, t in zip(args, sig.args, strict=True))).raw

    lower_builtin(Key, types.VarArg(types.Any))(lower)


def _arithmetic(context: Any, a: types.Type, b: types.Type) -> Signature | None:
    kind = promote(a, b)
    return signature(kind, kind, kind) if kind and kind.kind != "m" else None


def _division(context: Any, a: types.Type, b: types.Type) -> Signature | None:
    kind = promote(a, b)
    if kind is None or kind.kind == "m":
        return None
    kind = Vector("f", kind.bits, kind.lanes)
    return signature(kind, kind, kind)


def _logic(context: Any, a: types.Type, b: types.Type) -> Signature | None:
    kind = promote(a, b)
    return signature(kind, kind, kind) if kind and kind.kind != "f" else None


def _shift(context: Any, a: types.Type, b: types.Type) -> Signature | None:
    kind = promote(a, b)
    return signature(kind, kind, kind) if kind and kind.kind in "iu" else None


def _comparison(context: Any, a: types.Type, b: types.Type) -> Signature | None:
    kind = promote(a, b)
    return signature(Vector("m", kind.bits, kind.lanes), kind, kind) if kind else None


def _same(*kinds: str) -> Typing:
    def typing(context: Any, a: types.Type, *more: types.Type) -> Signature | None:
        return signature(a, a) if isinstance(a, Vector) and a.kind in kinds and not more else None

    return typing


def _several(context: Any, *kinds: types.Type) -> Signature | None:
    kind = common_type(context, *kinds) if len(kinds) > 1 else None
    return signature(kind, *[kind] * len(kinds)) if kind and kind.kind != "m" else None


for _operators, _typing in (
    ((operator.add, operator.sub, operator.mul, operator.floordiv, operator.mod), _arithmetic),
    ((operator.iadd, operator.isub, operator.imul, operator.ifloordiv, operator.imod), _arithmetic),
    ((operator.truediv, operator.itruediv), _division),
    ((operator.and_, operator.or_, operator.xor, operator.iand, operator.ior, operator.ixor), _logic),
    ((operator.lshift, operator.rshift, operator.ilshift, operator.irshift), _shift),
    ((operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne), _comparison),
):
    for _operator in _operators:
        define(_operator, _typing, _operator)

define(operator.neg, _same("f", "i", "u"), operator.neg)
define(operator.pos, _same("f", "i", "u"), operator.pos)
define(operator.invert, _same("i", "u", "m"), operator.invert)
define(abs, _same("f", "i", "u"), abs)
define(min, _several, lambda *v: reduce(minimum, v))
define(max, _several, lambda *v: reduce(maximum, v))
