"""What kernels are compiled from: recorded while modules are imported, registered with Numba when the first kernel is compiled.

Drawing with compiled kernels therefore imports no Numba. Functions that Numba calls with types find its modules under the lazy names here.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any

RECORDS: list[tuple[str, tuple[Any, ...]]] = []
"""(kind, arguments) in the order of their definition: an "overload", an "intrinsic", or an "operator"; see render/jit/compiler.py."""


class LazyModule:
    """A module that is imported when an attribute is first read."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


types = LazyModule("numba.core.types")
cgutils = LazyModule("numba.core.cgutils")
_templates, _arrays, _errors = (LazyModule(f"numba.{name}") for name in ("core.typing.templates", "np.arrayobj", "core.errors"))


def signature(result: Any, *kinds: Any) -> Any:
    """Numba's signature of a function, for typing rules."""
    return _templates.signature(result, *kinds)


def make_array(kind: Any) -> Any:
    """Numba's access to the fields of an array, for code generators."""
    return _arrays.make_array(kind)


def typing_error(message: str) -> Exception:
    """Numba's error of a function that does not take such types."""
    return _errors.TypingError(message)


def overload(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a function of Numba types that returns the code of `function` for them, or None."""
    return functools.partial(_record_overload, function)


def _record_overload(function: Callable[..., Any], choose: Callable[..., Any]) -> Callable[..., Any]:
    record_overload(function, choose)
    return choose


def record_overload(
    function: Callable[..., Any], choose: Callable[..., Any], strict: bool = True, inline: bool = True, allocates: bool = False,
    separate: bool = False,
) -> None:  # fmt: skip
    """Record an overload of `function`, whose signature `strict` compares. The others are the kinds of helpers in render/jit/kernel.py."""
    RECORDS.append(("overload", (function, choose, strict, inline, allocates, separate)))


def define(function: Any, typing: Callable[..., Any], emit: Callable[..., Any]) -> None:
    """Implement a Python function for vectors in kernels; see operators.py."""
    RECORDS.append(("operator", (function, typing, emit)))


class Intrinsic:
    """A function of kernels that is written as LLVM code: definition(typingctx, *kinds) returns a signature and a code generator."""

    def __init__(self, definition: Callable[..., Any]) -> None:
        self.definition = definition
        functools.update_wrapper(self, definition)

    def __call__(self, *arguments: Any) -> Any:
        """Raises NotImplementedError: LLVM code runs in kernels only."""
        raise NotImplementedError(f"{self.definition.__name__} runs in kernels only")

    def __deepcopy__(self, memo: Any) -> Intrinsic:
        return self


def intrinsic(definition: Callable[..., Any]) -> Any:
    """Decorate the definition of an Intrinsic."""
    record = Intrinsic(definition)
    RECORDS.append(("intrinsic", (record,)))
    return record
