"""Numba's compiler made quicker where it does much over and over; what it does stays the same.

Most of what compiling a kernel takes is Python: each of its helpers is a function with flags that are compared, statements that are
searched for variables, and a lock taken hundreds of times. Each of these places is replaced by one that gives the same answers; where
a version of Numba has them no more as they are known here, they stay as they are.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite.ir import Type
from numba.core import analysis, base, compiler_lock, event, ir, postproc, transforms
from numba.core.targetconfig import TargetConfig
from numba.core.types.functions import BaseFunction

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


def call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """BaseFunction.get_call_type: what is known of a function for such arguments is not looked for again."""
    known = self.__dict__.setdefault("_known", {})
    key = (context, args, tuple(kws.items()))
    found = known.get(key)
    if found is None:
        found = known[key] = _call_type(self, context, args, kws)
    return found


_call_type = BaseFunction.get_call_type


class _Entries(dict[Any, Any]):
    """FunctionIR.block_entry_vars, found when somebody asks: only generators and object mode do."""

    def __init__(self, blocks: Any, lifetime: Any) -> None:
        super().__init__()
        self.blocks, self.lifetime = blocks, lifetime

    def __missing__(self, block: Any) -> Any:
        lives = self.lifetime
        found = analysis.compute_live_variables(lives.cfg, self.blocks, lives.usedefs.defmap, lives.deadmaps.combined)
        self.update((each, found[offset]) for offset, each in self.blocks.items())
        return self[block]


def post_process(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """PostProcessor.run: which variables live where is found when somebody asks."""
    code = self.func_ir
    if code.is_generator:
        _post_process(self, emit_dels, extend_lifetimes)
        return
    code.blocks = transforms.canonicalize_cfg(code.blocks)
    code.variable_lifetime = postproc.VariableLifetime(code.blocks)
    code.block_entry_vars = _Entries(code.blocks, code.variable_lifetime)
    code.generator_info = None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


_post_process = postproc.PostProcessor.run


def has_loc(function: Any) -> bool:
    """base._has_loc: whether a function takes `loc`, which plain functions tell without a look at their signature."""
    if type(function) is not FunctionType or hasattr(function, "__wrapped__") or hasattr(function, "__signature__"):
        return _has_loc(function)
    code = function.__code__
    return "loc" in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]


_has_loc = base._has_loc


def start_event(kind: str, data: Any = None) -> None:
    """event.start_event: nothing is made where nobody listens."""
    if event._registered.get(kind):
        _start_event(kind, data)


def end_event(kind: str, data: Any = None, exc_details: Any = None) -> None:
    """event.end_event, likewise."""
    if event._registered.get(kind):
        _end_event(kind, data, exc_details)


_start_event, _end_event = event.start_event, event.end_event


def size_of(self: Any, target_data: Any, context: Any = None) -> int:
    """Type.get_abi_size: sizes of types that are known by how they are written are kept."""
    written = str(self)
    if "%" in written:
        return _size_of(self, target_data, context)
    if written not in _sizes:
        _sizes[written] = _size_of(self, target_data, context)
    return _sizes[written]


_size_of = Type.get_abi_size
_sizes: dict[str, int] = {}


REPLACED: tuple[tuple[Any, str, Callable[..., Any], tuple[str, ...]], ...] = (
    (TargetConfig, "values", values, ("options", "values")),
    (ir.Inst, "_rec_list_vars", variables, ("_rec_list_vars", "list_vars")),
    (postproc.PostProcessor, "run", post_process, ("run", "_insert_var_dels")),
    (base, "_has_loc", has_loc, ("_has_loc",)),
    (event, "start_event", start_event, ("start_event", "_registered")),
    (event, "end_event", end_event, ("end_event", "_registered")),
    (Type, "get_abi_size", size_of, ("get_abi_size",)),
    (BaseFunction, "get_call_type", call_type, ("get_call_type",)),
    (compiler_lock._CompilerLock, "acquire", acquire, ("acquire", "release", "is_locked")),
    (compiler_lock._CompilerLock, "release", release, ("acquire", "release", "is_locked")),
)
"""Of which class or module which function by which, if all these are there."""


def make() -> None:
    """Replace them."""
    for of, name, function, needed in REPLACED:
        if all(hasattr(of, part) for part in needed):
            setattr(of, name, function)
