"""Disk cache of compiled code, and the time of compiling and loading it.

The file name of a kernel contains a digest of the definitions that it is compiled from (`cache_key.py`) and a digest of its types, so that
stale code is never loaded. kernel_file.py describes the files.
"""

from __future__ import annotations

import hashlib
import marshal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

from ..simd import target
from . import cache_folder, cache_key, compile_events, compile_lock, kernel_file, loader, prebuilt, requests, value_types
from .kernel_file import Code
from .loader import Loaded
from .value_types import ValueType

SUFFIX = ".kernel"
HELPER_SUFFIX = ".helper"


def _folder_name() -> str:
    """Name of the folder for these versions of Numba and llvmlite and this target."""
    versions = " ".join(map(_version_of, ("numba", "llvmlite")))
    return f"{target.LEVEL.cpu}-{_digest(f'{versions} {target.fingerprint()}'.encode())}"


def _version_of(package: str) -> str:
    """The installed version of a package, from the name of its .dist-info folder. importlib.metadata takes 12 ms to load."""
    versions = (path.name for folder in sys.path for path in Path(folder).glob(f"{package}-*.dist-info"))
    name = next(versions, None)
    if name is None:
        raise ModuleNotFoundError(f"there is no {package}-….dist-info in sys.path")
    return name.removeprefix(f"{package}-").removesuffix(".dist-info")


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


CACHE = cache_folder.prepare(_folder_name())
LOOKUP_HOOKS: list[Callable[[Any, Any], None]] = []
"""Functions called with a kernel's function and types before each look-up on disk."""


class NotCompiled(Exception):
    """A kernel that is not compiled yet, where `compiled_only` forbids compiling; `key` names it and its types."""

    def __init__(self, key: str) -> None:
        super().__init__(key)
        self.key = key


_rules = threading.local()
_records: list[list[str]] = []
_helpers: dict[str, Code] = {}  # separate helpers that this process has emitted or read, by the names of their files
_unkept: list[str] = []  # why compiled kernels could not be written


@contextmanager
def compiled_only() -> Iterator[None]:
    """In this thread, raise NotCompiled in the block instead of compiling a kernel."""
    before = must_be_compiled()
    _rules.compiled_only = True
    try:
        yield
    finally:
        _rules.compiled_only = before


@contextmanager
def recording() -> Iterator[list[str]]:
    """Record the names of the kernels that this process loads or compiles in the block."""
    names: list[str] = []
    _records.append(names)
    try:
        yield names
    finally:
        _records.remove(names)


def must_be_compiled() -> bool:
    """Whether this thread runs in a block of `compiled_only`."""
    return getattr(_rules, "compiled_only", False)


# --- kernels -------------------------------------------------------------------------------------------------------------


def load(kernel: Any, kinds: tuple[ValueType, ...]) -> Loaded:
    """Load a kernel for arguments of these types from disk, or compile it."""
    with _compiling():
        loaded = kernel.loaded.get(kinds)
        if loaded is None:
            function = kernel.py_func
            for wait in LOOKUP_HOOKS:
                wait(function, kinds)
            if target.REQUESTS:
                requests.record(function, kinds)
            name = _file_name(function, kinds)
            code, compiled = read(name) if name else None, False
            if code is None or not _load_helpers(code):
                if must_be_compiled():
                    raise NotCompiled(f"{_name_of(function)}-{_digest_of_types(kinds)}")
                code, compiled = _compile(function, kinds, name)
            loaded = kernel.loaded[kinds] = Loaded(function.__qualname__, kinds, code, not compiled)
            compile_events.ready()
            for names in _records:
                names.append(_name_of(function))
        return loaded


def _compile(function: Callable[..., Any], kinds: tuple[ValueType, ...], name: str | None) -> tuple[Code, bool]:
    """(code, whether this process compiled it): another process may compile the same kernel, which is then read from disk."""
    with compile_events.compiling(_name_of(function)), compile_lock.compiling(CACHE / name) if name else nullcontext():
        code = read(name) if name else None
        if code is not None and _load_helpers(code):
            return code, False
        code = _emit(function, kinds)
        if not _load_helpers(code):
            raise RuntimeError(f"the helpers of the kernel {_name_of(function)} cannot be loaded")
        if name:
            write(name, code)
        return code, True


def _emit(function: Callable[..., Any], kinds: tuple[ValueType, ...]) -> Code:
    """Compile a kernel, and the separate helpers that it calls and that are not on disk."""
    from . import compiler

    code, helpers = compiler.compile_kernel(function, kinds, CACHE)
    return code._replace(helpers=_emit_helpers(helpers))


def _emit_helpers(helpers: list[Any]) -> tuple[str, ...]:
    """Emit the separate helpers that are not on disk; return the names of their files. Those that other processes emit come last."""
    names = {helper.symbol: f"{helper.symbol}{HELPER_SUFFIX}".replace("<locals>", "local") for helper in helpers}
    for helper in sorted(helpers, key=lambda helper: compile_lock.is_taken(CACHE / names[helper.symbol])):
        name = names[helper.symbol]
        if _helper(name) is None:
            with compile_lock.compiling(CACHE / name):
                if _helper(name) is None:
                    code, callees = helper.emit()
                    _helpers[name] = code._replace(helpers=_emit_helpers(callees))
                    write(name, _helpers[name])
    return tuple(sorted(names.values()))


def _helper(name: str) -> Code | None:
    """The code of a separate helper and of all that it calls: of this process, or in files."""
    code = _helpers.get(name) or read(name)
    if code is None or any(_helper(callee) is None for callee in code.helpers):
        return None
    _helpers[name] = code
    return code


def _load_helpers(code: Code) -> bool:
    """Load the separate helpers that a kernel calls, step by step; False where a file is missing."""
    if any(_helper(name) is None for name in code.helpers):
        return False
    for name in code.helpers:
        if not loader.is_defined(_helpers[name].function):
            _load_helpers(_helpers[name])
            loader.define(_helpers[name])
    return True


def compile_only(kernel: Any, kinds: tuple[ValueType, ...]) -> None:
    """Compile a kernel into the cache, for a machine that may not be this one. Kernels that it calls must have been compiled before."""
    name = _file_name(kernel.py_func, kinds)
    code = read(name) if name else None
    if code is None or any(_helper(helper) is None for helper in code.helpers):
        code = _emit(kernel.py_func, kinds)
        if name:
            write(name, code)
    kernel.loaded[kinds] = loader.NotLoaded(code.result)


def is_cached(kernel: Any, kinds: tuple[ValueType, ...]) -> bool:
    """Return whether a kernel is compiled for these types, in this process or on disk."""
    if kinds in kernel.loaded:
        return True
    name = _file_name(kernel.py_func, kinds)
    return name is not None and has(name)


def _file_name(function: Callable[..., Any], kinds: tuple[ValueType, ...]) -> str | None:
    """File name of a kernel's code; None for code that depends on more than files and types."""
    module = function.__module__ or ""
    file = getattr(sys.modules.get(module), "__file__", None)
    if function.__closure__:
        return None
    if cache_key.is_ours(module):
        sources = cache_key.key(module, function.__qualname__)
    elif file is not None and Path(file).is_file():
        sources = _digest(cache_key.key_of_file(Path(file)).encode() + marshal.dumps(function.__code__))
    else:
        return None
    return f"{_name_of(function)}-{sources}-{_digest_of_types(kinds)}{SUFFIX}"


def _name_of(function: Callable[..., Any]) -> str:
    """Name of a kernel in messages and files."""
    module = function.__module__ or ""
    return f"{module.partition('.')[2] or module}~{function.__qualname__}".replace("<locals>", "local")


def _digest_of_types(kinds: tuple[ValueType, ...]) -> str:
    """Digest of types, and of the NamedTuples among them: kernels compile in their fields."""
    classes, todo = set[tuple[str, str]](), list(kinds)
    while todo:
        kind = todo.pop()
        if isinstance(kind, value_types.Tuple):
            todo += kind.items
            if kind.cls is not None and cache_key.is_ours(kind.cls.__module__):
                classes.add((kind.cls.__module__, kind.cls.__qualname__))
    return _digest("\n".join([*(kind.text for kind in kinds), *(cache_key.key(*each) for each in sorted(classes))]).encode())


# --- files ---------------------------------------------------------------------------------------------------------------


def read(name: str) -> Code | None:
    """The code in a file of the user's cache or of the package.

    None where it is missing, unreadable or damaged, or needs symbols that this process lacks.
    """
    for data in (cache_folder.read(CACHE / name), prebuilt.read(name)):
        code = kernel_file.unpacked(name, data) if data is not None else None
        if code is not None and loader.has_symbols(code):
            return code
    return None


def has(name: str) -> bool:
    """Return whether the user's cache or the package has a file of this name."""
    return (cache_folder.is_trusted(CACHE) and (CACHE / name).exists()) or prebuilt.find(name) is not None


def is_current(name: str) -> bool:
    """Return whether a file of this name was compiled from the package's modules as they are."""
    kernel, sources, _ = name.rsplit("-", 2)
    module, _, function = ("render.formula.interpreter", "", "") if kernel.startswith("tape_") else kernel.partition("~")
    return cache_key.is_ours(module) and sources == cache_key.key(module, function)


def write(name: str, code: Code) -> None:
    """Write compiled code. On a full or read-only disk it serves this process alone: see `unkept`."""
    if reason := cache_folder.write(CACHE / name, kernel_file.packed(name, code)):
        _unkept.append(reason)


def unkept() -> tuple[int, str]:
    """How many kernels this process has compiled and could not write to disk, and why the first of them."""
    return len(_unkept), _unkept[0] if _unkept else ""


# --- time ----------------------------------------------------------------------------------------------------------------

_lock = threading.RLock()
_depth = 0
_timers: list[list[float]] = []


@contextmanager
def _compiling() -> Iterator[None]:
    """Hold the lock of compiling and loading, and add its time to all timers."""
    global _depth
    with _lock:
        started, _depth = time.perf_counter(), _depth + 1
        try:
            yield
        finally:
            _depth -= 1
            if not _depth:
                for timer in _timers:
                    timer.append(time.perf_counter() - started)


@contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the seconds of a block to `part`, and its seconds of compiling or loading kernels to "compile_kernels" instead."""
    started, timer = time.perf_counter(), list[float]()
    _timers.append(timer)
    try:
        yield
    finally:
        _timers[:] = [other for other in _timers if other is not timer]
        spent = time.perf_counter() - started
        compiling = min(sum(timer), spent)
        seconds["compile_kernels"] = seconds.get("compile_kernels", 0.0) + compiling
        seconds[part] = seconds.get(part, 0.0) + spent - compiling
