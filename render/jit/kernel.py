"""Kernels, and decorators of the helpers that kernels call. Compiling is in compiler.py, files are in kernel_cache.py."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any

from ..simd.registration import record_overload, types
from . import kernel_cache
from .value_types import ValueType, typeof


class Kernel:
    """A function that runs as machine code without Python's lock, and divides by IEEE rules. The types of the arguments select the code.

    `loaded` holds the code of each tuple of types in this process.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self.py_func = function
        self.loaded: dict[tuple[ValueType, ...], kernel_cache.Loaded] = {}
        self._parameters = inspect.signature(function)
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        if named or len(arguments) != len(self._parameters.parameters):
            bound = self._parameters.bind(*arguments, **named)
            bound.apply_defaults()
            arguments = bound.args
        kinds = tuple(map(typeof, arguments))
        return (self.loaded.get(kinds) or self.load(kinds))(arguments)

    def bind(self, *arguments: Any) -> Callable[[], Any]:
        """A call with these arguments for many runs: it packs them once. Arrays and handles must outlive it."""
        return self.load(tuple(map(typeof, arguments))).bind(arguments)

    def load(self, kinds: tuple[ValueType, ...]) -> kernel_cache.Loaded:
        """The code for arguments of these types: loaded from disk, or compiled."""
        return self.loaded.get(kinds) or kernel_cache.load(self, kinds)

    @functools.cached_property
    def _numba_type_(self) -> Any:
        """What Numba calls where a kernel calls this one by name."""
        from . import compiler

        return compiler.callee(self.py_func)


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a function that runs without Python's lock, is cached on disk and divides by IEEE rules. The first call sets the types."""
    return Kernel(function)


def helper(function: Callable[..., Any]) -> Any:
    """Compile a lane function into the kernels that call it; outside of kernels it runs as Python on numpy arrays.

    Helpers are inlined: passing vectors through memory costs more than the arithmetic. They allocate no arrays, and do not count
    references to their arguments, which took half of the time in inner loops.
    """
    return _register(function)


def noinline_helper(function: Callable[..., Any]) -> Any:
    """`helper` that stays a separate function in its kernels, for long code and for several call sites."""
    return _register(function, inline=False)


def separate_helper(function: Callable[..., Any]) -> Any:
    """`noinline_helper` that is optimized and emitted once for all kernels that call it, for long code of many kernels.

    LLVM sees its signature alone where it compiles a caller. It returns no memory of its stack.
    """
    return _register(function, inline=False, separate=True)


def allocating_helper(function: Callable[..., Any]) -> Any:
    """`noinline_helper` that may allocate arrays."""
    return _register(function, inline=False, allocates=True)


def _register(function: Callable[..., Any], **options: bool) -> Any:
    record_overload(function, lambda *kinds, **named: function, strict=False, **options)
    return function


def make_replace(kind: Any, *names: str) -> Any:
    """Make a helper `replace(record, value, …)` that replaces the fields of these names in a NamedTuple of this kind."""
    values = [f"value_{name}" for name in names]
    parts = ", ".join(f"value_{name}" if name in names else f"record.{name}" for name in kind._fields)
    scope: dict[str, Any] = {"kind": kind}
    exec(f"def replace(record, {', '.join(values)}):\n    return kind({parts})\n", scope)  # Numba does not support _replace
    return helper(scope["replace"])


def specialize_if_present(function: Callable[..., Any], is_active: Callable[[Any], Any] | None = None) -> Callable[..., Any]:
    """`select(part, default, …)`: `default` where `part` is absent, else function(part, default, …).

    A part is absent if it is None or a NamedTuple without fields; its type decides. So kernels compile only the features that a scene uses.
    General kernels have all features: with `is_active`, they branch to `default` at run time unless is_active(part) for some lane.
    """

    def select(part: Any, default: Any, *arguments: Any) -> Any:
        return default if _is_absent(part) or not (is_active is None or is_active(part)) else function(part, default, *arguments)

    def _in_kernels(part, default, *arguments):
        if _is_absent_type(part):
            return lambda part, default, *arguments: default
        if is_active is None:
            return function

        def branch(part, default, *arguments):
            if is_active(part):  # pyright: ignore[reportOptionalCall]
                return function(part, default, *arguments)
            return default

        return branch

    record_overload(select, _in_kernels, strict=False)  # the function's parameters have other names
    return select


def specialize_either(function: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """`select(part, …)`: otherwise(…) where `part` is absent (see `specialize_if_present`), else function(part, …)."""

    def select(part: Any, *arguments: Any) -> Any:
        return otherwise(*arguments) if _is_absent(part) else function(part, *arguments)

    def _in_kernels(part, *arguments):
        return (lambda part, *arguments: otherwise(*arguments)) if _is_absent_type(part) else function

    record_overload(select, _in_kernels, strict=False)
    return select


def _is_absent(part: Any) -> bool:
    return part is None or (isinstance(part, tuple) and not part)


def _is_absent_type(kind: Any) -> bool:
    return isinstance(kind, types.NoneType) or getattr(kind, "layout", None) == ()  # a HandleType without fields
