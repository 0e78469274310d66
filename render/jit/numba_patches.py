"""Numba's compiler made quicker where it does much over and over; what it does stays the same.

Most of what compiling a kernel takes is Python: each of its helpers is a function with flags that are compared, statements that are
searched for variables, and a lock taken hundreds of times. Each of these places is replaced by one that gives the same answers; where
a version of Numba has them no more as they are known here, they stay as they are.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import FunctionType
from typing import Any

from llvmlite.ir import Type
from numba.core import analysis, base, compiler_lock, errors, event, ir, lowering, postproc, transforms, typeinfer, types
from numba.core.targetconfig import TargetConfig
from numba.core.types.abstract import Type as NumbaType
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext as Typing

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


def install_timer(kind: str, callback: Callable[[float], None]) -> AbstractContextManager[Any]:
    """event.install_timer, but for what LLVM takes, of which nobody asks: each of its calls would be told to every function on its way."""
    return nullcontext() if kind == "numba:llvm_lock" else _install_timer(kind, callback)


_install_timer = event.install_timer


class ErrorContext:
    """errors.new_error_context without a generator for each statement."""

    __slots__ = ("args", "kwargs", "message")

    def __init__(self, fmt_: str, *args: Any, **kwargs: Any) -> None:
        self.message, self.args, self.kwargs = fmt_, args, kwargs

    def __enter__(self) -> None:
        loc = self.kwargs.get("loc")
        if loc is not None and not loc.filename.startswith(errors._numba_path):  # pyright: ignore[reportAttributeAccessIssue]
            errors.loc_info.update(self.kwargs)  # pyright: ignore[reportAttributeAccessIssue]

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        if isinstance(error, errors.NumbaError):
            error.add_context(errors._format_msg(self.message, self.args, self.kwargs))  # pyright: ignore[reportAttributeAccessIssue]


def refresh(self: Any) -> None:
    """BaseContext.refresh of targets: where no registry has got longer nothing is looked for."""
    known = _registered(self)
    if self.__dict__.get("_refreshed") != known:
        _refresh(self)
        self._refreshed = _registered(self)


_refresh = base.BaseContext.refresh


def refresh_typing(self: Any) -> None:
    """BaseContext.refresh of typing, likewise."""
    known = _lengths(self)
    if self.__dict__.get("_refreshed") != known:
        self.__dict__.pop("_found_attributes", None)
        _refresh_typing(self)
        self._refreshed = _lengths(self)


_refresh_typing = Typing.refresh


def _registered(target: Any) -> tuple[int, ...]:
    return _lengths(target) + _lengths(target.typing_context)


def _lengths(context: Any) -> tuple[int, ...]:
    """How much each registry that a context has loaded holds."""
    return tuple(len(getattr(known, name)) for known, loader in context._registries.items() for name in loader.registry_items)


def resolve_getattr(self: Any, typ: Any, attr: str) -> Any:
    """BaseContext.resolve_getattr: types of attributes are looked for once; those of modules' own are asked of the module."""
    known = self.__dict__.setdefault("_found_attributes", {})
    of_module = isinstance(typ, types.Module)
    found = known.get((typ, attr))
    if found is None:
        if of_module and self.find_matching_getattr_template(typ, attr) is None:
            found = known[typ, attr] = _OF_MODULE
        else:
            found = _resolve_getattr(self, typ, attr)
            if found is not None:
                known[typ, attr] = found
    return self.resolve_module_constants(typ, attr) if found is _OF_MODULE else found


_resolve_getattr = Typing.resolve_getattr
_OF_MODULE = object()


def resolve_value_type(self: Any, val: Any) -> Any:
    """BaseContext.resolve_value_type: plain functions are no constants, and need not be asked whether they are buffers."""
    if type(val) is FunctionType and "_numba_type_" not in val.__dict__:
        found = self._get_global_type(val)
        if found is not None:
            return found
    return _resolve_value_type(self, val)


_resolve_value_type = Typing.resolve_value_type


REPLACED: tuple[tuple[Any, str, Callable[..., Any], tuple[str, ...]], ...] = (
    (TargetConfig, "values", values, ("options", "values")),
    (ir.Inst, "_rec_list_vars", variables, ("_rec_list_vars", "list_vars")),
    (postproc.PostProcessor, "run", post_process, ("run", "_insert_var_dels")),
    (base, "_has_loc", has_loc, ("_has_loc",)),
    (event, "start_event", start_event, ("start_event", "_registered")),
    (event, "end_event", end_event, ("end_event", "_registered")),
    (event, "install_timer", install_timer, ("install_timer",)),
    (typeinfer, "new_error_context", ErrorContext, ("new_error_context",)),
    (lowering, "new_error_context", ErrorContext, ("new_error_context",)),
    (base.BaseContext, "refresh", refresh, ("refresh", "load_additional_registries", "install_registry")),
    (Typing, "refresh", refresh_typing, ("refresh", "load_additional_registries", "install_registry")),
    (Typing, "resolve_getattr", resolve_getattr, ("resolve_getattr", "find_matching_getattr_template", "resolve_module_constants")),
    (Typing, "resolve_value_type", resolve_value_type, ("resolve_value_type", "_get_global_type")),
    (type(NumbaType), "__instancecheck__", type.__instancecheck__, ("__instancecheck__",)),
    (type(NumbaType), "__subclasscheck__", type.__subclasscheck__, ("__subclasscheck__",)),
    (Type, "get_abi_size", size_of, ("get_abi_size",)),
    (BaseFunction, "get_call_type", call_type, ("get_call_type",)),
    (compiler_lock._CompilerLock, "acquire", acquire, ("acquire", "release", "is_locked")),
    (compiler_lock._CompilerLock, "release", release, ("acquire", "release", "is_locked")),
)
"""Of which class or module which function by which, if all these are there."""


def install_patches() -> None:
    """Replace them."""
    for of, name, function, needed in REPLACED:
        if all(hasattr(of, part) for part in needed):
            setattr(of, name, function)
