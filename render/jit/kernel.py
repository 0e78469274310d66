"""Decorators of kernels and of the helpers that kernels call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit, types
from numba.extending import overload, register_jitable

from . import numba_patches
from .kernel_cache import KernelCache
from .lto import Fragment, Kernel

numba_patches.install_patches()
HELPER: Any = {
    "error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True,
    "pipeline_class": Fragment, "_nrt": False,
}  # fmt: skip
"""Compile options of helpers: inlined into the kernels that call them, since passing vectors through memory costs more than the arithmetic.
Helpers allocate no arrays and do not count references to their arguments: in inner loops that took half of the time."""


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that runs without the GIL, is cached on disk and divides by IEEE rules. The first call sets the types."""
    dispatcher = njit(nogil=True, cache=True, error_model="numpy", pipeline_class=Kernel)(function)
    dispatcher._cache = KernelCache(function)  # pyright: ignore[reportAttributeAccessIssue]
    return dispatcher


def helper(function: Callable[..., Any]) -> Any:
    """Compile a lane function into the kernels that call it; outside of kernels it runs as Python on numpy arrays."""
    return register_jitable(**HELPER)(function)


def noinline_helper(function: Callable[..., Any]) -> Any:
    """`helper` that stays a separate function in its kernels, for long code and for several call sites."""
    return register_jitable(**{**HELPER, "forceinline": False})(function)


def allocating_helper(function: Callable[..., Any]) -> Any:
    """`noinline_helper` that may allocate arrays."""
    return register_jitable(**{**HELPER, "forceinline": False, "_nrt": True})(function)


def make_replace(kind: Any, *names: str) -> Any:
    """Make a helper `replace(record, value, …)` that replaces the fields of these names in a NamedTuple of this kind."""
    values = [f"value_{name}" for name in names]
    parts = ", ".join(f"value_{name}" if name in names else f"record.{name}" for name in kind._fields)
    scope: dict[str, Any] = {"kind": kind}
    exec(f"def replace(record, {', '.join(values)}):\n    return kind({parts})\n", scope)  # Numba does not support _replace
    return helper(scope["replace"])


def specialize_if_present(function: Callable[..., Any]) -> Callable[..., Any]:
    """`select(part, plain, …)`: `plain` where `part` is absent, else function(part, plain, …).

    A part is absent if it is None or a NamedTuple without fields; its type decides. So kernels compile only the features that a scene uses.
    """

    def select(part: Any, plain: Any, *of: Any) -> Any:
        return plain if _is_absent(part) else function(part, plain, *of)

    @overload(select, jit_options=HELPER)
    def _in_kernels(part, plain, *of):
        if _is_absent_type(part):
            return lambda part, plain, *of: plain
        return lambda part, plain, *of: function(part, plain, *of)

    return select


def specialize_either(function: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """`select(part, …)`: otherwise(…) where `part` is absent (see `specialize_if_present`), else function(part, …)."""

    def select(part: Any, *of: Any) -> Any:
        return otherwise(*of) if _is_absent(part) else function(part, *of)

    @overload(select, jit_options=HELPER)
    def _in_kernels(part, *of):
        return (lambda part, *of: otherwise(*of)) if _is_absent_type(part) else (lambda part, *of: function(part, *of))

    return select


def _is_absent(part: Any) -> bool:
    return part is None or (isinstance(part, tuple) and not part)


def _is_absent_type(kind: Any) -> bool:
    return isinstance(kind, types.NoneType) or getattr(kind, "layout", None) == ()  # a HandleType without fields
