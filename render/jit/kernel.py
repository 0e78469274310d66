"""Decorators of kernels and helpers, and the disk cache of kernels.

Numba's cache checks the file of a kernel and not the helpers it calls. Here each kernel's file is named after the syntax trees of all
modules the kernel is compiled from (`cache_key.py`), so that stale code is never loaded.
"""

from __future__ import annotations

import glob
import hashlib
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba import config, njit, types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys
from numba.extending import overload, register_jitable

from ...compiler.io import cache_dirs
from ..simd import target
from . import cache_key, numba_patches
from .lto import Fragment, Kernel

_KEEP = 3  # caches of other machines or Numba versions that are left in place
_FORM = "2"  # of the files in the cache
_TRIES = 5
_FRESH = 24 * 3600.0  # seconds in which a cache may be in use by another process


def _prepare_cache() -> Path:
    """The folder of this machine's kernels: one for each version of Numba and Python, and each instruction set."""
    root = cache_dirs.cache_root() / "kernels"
    machine = f"{numba.__version__} {sys.version_info[:2]} {target.fingerprint()}"
    folder = root / hashlib.sha256(machine.encode()).hexdigest()[:16]
    try:
        new = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        if new:
            others = sorted((p for p in root.iterdir() if p != folder), key=lambda p: p.stat().st_mtime, reverse=True)
            for old in others[_KEEP:]:
                if time.time() - old.stat().st_mtime > _FRESH:
                    shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return folder  # nowhere to write: Numba then compiles anew each time and says nothing
    return folder


numba_patches.install_patches()
CACHE = _prepare_cache()
config.CACHE_DIR = str(CACHE)  # pyright: ignore[reportAttributeAccessIssue]


HELPER: Any = {
    "error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True,
    "pipeline_class": Fragment, "_nrt": False,
}  # fmt: skip
"""How helpers compile: into the kernels that call them, and nowhere else. Vectors passed through memory cost more than the work on them.
They make no arrays, and so count no references to those they are given: in inner loops that took half of the time."""


def cache_is_empty() -> bool:
    """Whether the disk holds no kernel of this version, so that the first picture waits for the compiler."""
    found = (path.stem.partition("~") for path in CACHE.glob("*.nbi"))
    return not any(rest.endswith(cache_key.key(module)) for module, _, rest in found)


@contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the seconds a block takes to `part`, and what of them went into compiling kernels or loading them to "compile_kernels"."""
    started = time.perf_counter()
    # Numba holds this lock exactly while it compiles or loads, in whichever thread.
    with event.install_listener("numba:compiler_lock", event.TimingListener()) as lock:
        try:
            yield
        finally:
            spent = time.perf_counter() - started
            compiling = min(lock.duration, spent) if lock.done else 0.0
            seconds["compile_kernels"] = seconds.get("compile_kernels", 0.0) + compiling
            seconds[part] = seconds.get(part, 0.0) + spent - compiling


def _digest_of_types(sig: Any) -> str:
    """Digest of the modules of classes and functions that occur in a signature: their fields and code are compiled in."""
    modules, todo, seen = set[str](), list(sig), set[int]()
    while todo:
        kind = todo.pop()
        if id(kind) in seen:
            continue
        seen.add(id(kind))
        if isinstance(kind, types.BaseNamedTuple):
            modules.add(kind.instance_class.__module__)  # pyright: ignore[reportAttributeAccessIssue]
        if isinstance(kind, types.Dispatcher):
            modules.add(kind.dispatcher.py_func.__module__)
        if isinstance(kind, types.BaseTuple):
            todo += list(kind)  # pyright: ignore[reportArgumentType]
    ours = sorted(name for name in modules if name.partition(".")[0] == __name__.partition(".")[0])
    return " ".join(cache_key.key(name) for name in ours)


class Files(IndexDataCacheFile):
    """A kernel's files, which several processes may write at once: none takes the name that another gives to other code.

    Numba counts them, so that of two processes which compile for different types at the same time one could find the other's code
    under its own number.
    """

    def save(self, key: Any, data: Any) -> None:
        name = self._load_index().get(key) or self._data_name_pattern.replace("{number:d}", uuid.uuid4().hex[:12])
        self._save_data(name, data)
        for _ in range(_TRIES):  # another process may have read the index before this one wrote it, and write it afterwards
            known = self._load_index()
            if known.get(key) == name:
                break
            self._save_index({**known, key: name})
        self._remove_older()

    def _remove_older(self) -> None:
        """Remove files of the same kernel's other versions once no process is likely to use them."""
        path = Path(self._index_path)
        kernel_name = path.stem.rpartition("-")[0]
        for other in path.parent.glob(f"{glob.escape(kernel_name)}-*"):
            with suppress(OSError):
                if not other.name.startswith(path.stem) and time.time() - other.stat().st_mtime > _FRESH:
                    other.unlink()


class _Kept(FunctionCache):
    """Numba's cache, which loads compiled code without first getting ready to compile: that takes longer than all of a small picture."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        module = function.__module__.partition(".")[2] or function.__module__
        self._module, self._name = module, f"{module}~{function.__qualname__}".replace("<locals>", "local")
        self._cache_path = str(CACHE)
        self._cache_file = Files(self._cache_path, f"{self._name}-{cache_key.key(function.__module__)}", _FORM)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's key, and the digest of the modules that define the NamedTuples and functions among the arguments."""
        return (*super()._index_key(sig, codegen), _digest_of_types(sig))

    def knows(self, sig: Any, target_context: Any) -> bool:
        """Whether code for these types is on disk."""
        return self._index_key(sig, target_context.codegen()) in self._cache_file._load_index()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for wait in CACHE_LOOKUP_HOOKS:
            wait(self._py_func, sig)
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


CACHE_LOOKUP_HOOKS: list[Callable[[Any, Any], None]] = []
"""Called with a kernel's function and types before it is looked for on disk."""


def is_cached(dispatcher: Any, kinds: tuple[types.Type, ...]) -> bool:
    """Whether a kernel is compiled for these types, here or on disk."""
    return kinds in dispatcher.overloads or dispatcher._cache.knows(kinds, dispatcher.targetctx)


def kernel(function: Callable[..., Any]) -> Any:
    """Compile for threads (no GIL), kept on disk, with IEEE division. Types come with the first call."""
    dispatcher = njit(nogil=True, cache=True, error_model="numpy", pipeline_class=Kernel)(function)
    dispatcher._cache = _Kept(function)  # pyright: ignore[reportAttributeAccessIssue]
    return dispatcher


def helper(function: Callable[..., Any]) -> Any:
    """A lane function: plain Python on numpy arrays, compiled where a kernel calls it."""
    return register_jitable(**HELPER)(function)


def noinline_helper(function: Callable[..., Any]) -> Any:
    """A helper that stays a function of its own in the kernels that call it: for what is long, or called from several places."""
    return register_jitable(**{**HELPER, "forceinline": False})(function)


def allocating_helper(function: Callable[..., Any]) -> Any:
    """`apart`, for what makes arrays of its own."""
    return register_jitable(**{**HELPER, "forceinline": False, "_nrt": True})(function)


def make_replace(kind: Any, *names: str) -> Any:
    """A helper `changed(record, value, …)`: a NamedTuple of this kind with other values in the fields of these names."""
    values = [f"value_{name}" for name in names]
    parts = ", ".join(f"value_{name}" if name in names else f"record.{name}" for name in kind._fields)
    made: dict[str, Any] = {"kind": kind}
    exec(f"def changed(record, {', '.join(values)}):\n    return kind({parts})\n", made)  # kernels know no _replace
    return helper(made["changed"])


def specialize_if_present(function: Callable[..., Any]) -> Callable[..., Any]:
    """`chosen(part, plain, …)`: `plain` where `part` is None or a NamedTuple without fields, which are types, and else
    function(part, plain, …).

    Kernels compile only what a scene needs of materials and media.
    """

    def chosen(part: Any, plain: Any, *of: Any) -> Any:
        return plain if _is_nothing(part) else function(part, plain, *of)

    @overload(chosen, jit_options=HELPER)
    def _in_kernels(part, plain, *of):
        if _is_no_type(part):
            return lambda part, plain, *of: plain
        return lambda part, plain, *of: function(part, plain, *of)

    return chosen


def specialize_either(function: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """`chosen(part, …)`: otherwise(…) where `if_there` would give what is plain, and else function(part, …)."""

    def chosen(part: Any, *of: Any) -> Any:
        return otherwise(*of) if _is_nothing(part) else function(part, *of)

    @overload(chosen, jit_options=HELPER)
    def _in_kernels(part, *of):
        return (lambda part, *of: otherwise(*of)) if _is_no_type(part) else (lambda part, *of: function(part, *of))

    return chosen


def _is_nothing(part: Any) -> bool:
    return part is None or (isinstance(part, tuple) and not part)


def _is_no_type(kind: Any) -> bool:
    return isinstance(kind, types.NoneType) or getattr(kind, "layout", None) == ()  # of a handle, see handles.py
