"""Numba's compiler made quicker where it does much over and over; what it does stays the same.

Most of what compiling a kernel takes is Python: each of its helpers is a function with flags that are compared, statements that are
searched for variables, and a lock taken hundreds of times. Each of these places is replaced by one that gives the same answers; where
a version of Numba has them no more as they are known here, they stay as they are.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Any

from numba.core import compiler_lock, event, ir
from numba.core.targetconfig import TargetConfig

_NONE, _VARIABLE, _INSTRUCTION, _SEVERAL, _NAMED = range(5)
_defaults: dict[type, dict[str, Any]] = {}
_kinds: dict[type, int] = {}


def values(self: Any) -> dict[str, Any]:
    """TargetConfig.values: a dict of all options."""
    kind = type(self)
    if kind not in _defaults:
        _defaults[kind] = {name: option.default for name, option in kind.options.items()}
    return {**_defaults[kind], **self._values}


def variables(self: Any, value: Any) -> list[Any]:
    """Inst._rec_list_vars: all variables in a value."""
    kind = _kinds.get(type(value))
    if kind is None:
        kind = _kinds[type(value)] = _kind_of(value)
    if kind == _NONE:
        return []
    if kind == _VARIABLE:
        return [value]
    if kind == _INSTRUCTION:
        return value.list_vars()
    found = []
    for each in value if kind == _SEVERAL else value.values():
        if _kinds.get(type(each)) != _NONE:
            found += variables(self, each)
    return found


def _kind_of(value: Any) -> int:
    for kind, classes in ((_VARIABLE, ir.Var), (_INSTRUCTION, ir.Inst), (_SEVERAL, (list, tuple)), (_NAMED, dict)):
        if isinstance(value, classes):
            return kind
    return _NONE


def acquire(self: Any) -> None:
    """_CompilerLock.acquire; events tell of the outermost one alone. While it is held nobody looks for garbage: there is little."""
    if self.is_locked():
        self._lock.acquire()
        return
    event.start_event("numba:compiler_lock")
    self._lock.acquire()
    self.collects = gc.isenabled()
    gc.disable()


def release(self: Any) -> None:
    """_CompilerLock.release."""
    collects = self.collects
    self._lock.release()
    if not self.is_locked():
        if collects:
            gc.freeze()  # what compiling leaves behind is kept, not searched again and again
            gc.enable()
        event.end_event("numba:compiler_lock")


REPLACED: tuple[tuple[type, str, Callable[..., Any], tuple[str, ...]], ...] = (
    (TargetConfig, "values", values, ("options", "values")),
    (ir.Inst, "_rec_list_vars", variables, ("_rec_list_vars", "list_vars")),
    (compiler_lock._CompilerLock, "acquire", acquire, ("acquire", "release", "is_locked")),
    (compiler_lock._CompilerLock, "release", release, ("acquire", "release", "is_locked")),
)
"""Of which class which function by which, if all these are there."""


def make() -> None:
    """Replace them."""
    for of, name, function, needed in REPLACED:
        if all(hasattr(of, part) for part in needed):
            setattr(of, name, function)
