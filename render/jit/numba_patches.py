"""Patches that speed up Numba's compiler without changing its results.

Compiling a kernel spends most of its time in Python: Numba compares the flags of each helper, searches its statements for variables and
takes a lock hundreds of times. Each patch replaces one function by a faster one with the same results. A patch is skipped where the
installed version of Numba lacks the functions it relies on.
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
    """TargetConfig.values: dict of all options."""
    kind = type(self)
    if kind not in _defaults:
        _defaults[kind] = {name: option.default for name, option in kind.options.items()}
    return {**_defaults[kind], **self._values}


def variables(self: Any, value: Any) -> list[Any]:
    """Inst._rec_list_vars: list of all variables in a value."""
    kind = _kinds.get(type(value))
    if kind is None:
        kind = _kinds[type(value)] = _kind_of(value)
    if kind == _NONE:
        return []
    if kind == _VARIABLE:
        return [value]
    if kind == _INSTRUCTION:
        return value.list_vars()
    parts = []
    for each in value if kind == _SEVERAL else value.values():
        if _kinds.get(type(each)) != _NONE:
            parts += variables(self, each)
    return parts


def _kind_of(value: Any) -> int:
    for kind, classes in ((_VARIABLE, ir.Var), (_INSTRUCTION, ir.Inst), (_SEVERAL, (list, tuple)), (_NAMED, dict)):
        if isinstance(value, classes):
            return kind
    return _NONE


def acquire(self: Any) -> None:
    """_CompilerLock.acquire: only the outermost call sends an event. Garbage collection, which finds little, pauses meanwhile."""
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
            gc.freeze()  # excludes the results of compilation from later collections
            gc.enable()
        event.end_event("numba:compiler_lock")


def call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """BaseFunction.get_call_type, cached by argument types."""
    signatures = self.__dict__.setdefault("_known", {})
    key = (context, args, tuple(kws.items()))
    signature = signatures.get(key)
    if signature is None:
        signature = signatures[key] = _call_type(self, context, args, kws)
    return signature


_call_type = BaseFunction.get_call_type


class _Entries(dict[Any, Any]):
    """FunctionIR.block_entry_vars, computed on demand: only generators and object mode read them."""

    def __init__(self, blocks: Any, lifetime: Any) -> None:
        super().__init__()
        self.blocks, self.lifetime = blocks, lifetime

    def __missing__(self, block: Any) -> Any:
        lives = self.lifetime
        live = analysis.compute_live_variables(lives.cfg, self.blocks, lives.usedefs.defmap, lives.deadmaps.combined)
        self.update((each, live[offset]) for offset, each in self.blocks.items())
        return self[block]


def post_process(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """PostProcessor.run: variable liveness is computed on demand."""
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
    """base._has_loc: whether a function takes `loc`, read from the code object of plain functions instead of their signature."""
    if type(function) is not FunctionType or hasattr(function, "__wrapped__") or hasattr(function, "__signature__"):
        return _has_loc(function)
    code = function.__code__
    return "loc" in code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]


_has_loc = base._has_loc


def start_event(kind: str, data: Any = None) -> None:
    """event.start_event: creates no event without listeners."""
    if event._registered.get(kind):
        _start_event(kind, data)


def end_event(kind: str, data: Any = None, exc_details: Any = None) -> None:
    """event.end_event: creates no event without listeners."""
    if event._registered.get(kind):
        _end_event(kind, data, exc_details)


_start_event, _end_event = event.start_event, event.end_event


def size_of(self: Any, target_data: Any, context: Any = None) -> int:
    """Type.get_abi_size, cached for types without named parts."""
    written = str(self)
    if "%" in written:
        return _size_of(self, target_data, context)
    if written not in _sizes:
        _sizes[written] = _size_of(self, target_data, context)
    return _sizes[written]


_size_of = Type.get_abi_size
_sizes: dict[str, int] = {}


def install_timer(kind: str, callback: Callable[[float], None]) -> AbstractContextManager[Any]:
    """event.install_timer without the timer of LLVM, which has no readers: each call would notify every function in progress."""
    return nullcontext() if kind == "numba:llvm_lock" else _install_timer(kind, callback)


_install_timer = event.install_timer


class ErrorContext:
    """errors.new_error_context as a class, without a generator for each statement."""

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


def markup(self: Any, msg: str, color: Any = None, style: Any = None) -> str:
    """HighlightColorScheme._markup without colours: types are tried by errors, whose messages nobody reads."""
    return msg


def refresh(self: Any) -> None:
    """BaseContext.refresh of target contexts: does nothing unless a registry has grown."""
    lengths = _registered(self)
    if self.__dict__.get("_refreshed") != lengths:
        _refresh(self)
        self._refreshed = _registered(self)


_refresh = base.BaseContext.refresh


def refresh_typing(self: Any) -> None:
    """BaseContext.refresh of typing contexts: does nothing unless a registry has grown."""
    lengths = _lengths(self)
    if self.__dict__.get("_refreshed") != lengths:
        self.__dict__.pop("_found_attributes", None)
        _refresh_typing(self)
        self._refreshed = _lengths(self)


_refresh_typing = Typing.refresh


def _registered(target: Any) -> tuple[int, ...]:
    return _lengths(target) + _lengths(target.typing_context)


def _lengths(context: Any) -> tuple[int, ...]:
    """Lengths of the registries that a context has loaded."""
    return tuple(len(getattr(registry, name)) for registry, loader in context._registries.items() for name in loader.registry_items)


def resolve_getattr(self: Any, typ: Any, attr: str) -> Any:
    """BaseContext.resolve_getattr: caches types of attributes; a module's own attributes are resolved by the module."""
    attributes = self.__dict__.setdefault("_found_attributes", {})
    of_module = isinstance(typ, types.Module)
    kind = attributes.get((typ, attr))
    if kind is None:
        if of_module and self.find_matching_getattr_template(typ, attr) is None:
            kind = attributes[typ, attr] = _OF_MODULE
        else:
            kind = _resolve_getattr(self, typ, attr)
            if kind is not None:
                attributes[typ, attr] = kind
    return self.resolve_module_constants(typ, attr) if kind is _OF_MODULE else kind


_resolve_getattr = Typing.resolve_getattr
_OF_MODULE = object()


def resolve_value_type(self: Any, val: Any) -> Any:
    """BaseContext.resolve_value_type: skips the constant and buffer checks for plain functions."""
    if type(val) is FunctionType and "_numba_type_" not in val.__dict__:
        kind = self._get_global_type(val)
        if kind is not None:
            return kind
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
    (getattr(errors, "HighlightColorScheme", errors), "_markup", markup, ("_markup",)),  # where colorama is installed
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
"""(class or module, name of the function, replacement, attributes that it relies on)."""


def install_patches() -> None:
    """Install all patches whose required attributes exist."""
    for owner, name, function, needed in REPLACED:
        if all(hasattr(owner, part) for part in needed):
            setattr(owner, name, function)
