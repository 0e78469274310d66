"""Disk cache of kernels, and the time of compiling and loading them.

Numba's cache checks the file of a kernel, but not the helpers that the kernel calls. Here the file name of a kernel contains a digest of
the syntax trees of all modules that it is compiled from (`cache_key.py`), so that stale code is never loaded.
"""

from __future__ import annotations

import glob
import hashlib
import pickle
import shutil
import sys
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba import config, types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

from ...compiler.io import cache_dirs
from ..simd import target
from . import cache_key, compile_events

_KEEP = 3  # caches of other machines or Numba versions that are not removed
_FORMAT = "3"  # of the files in the cache
_DIGEST = 16  # bytes
_TRIES = 5
_FRESH = 24 * 3600.0  # seconds during which another process may use a cache


def _prepare_cache() -> Path:
    """Create the kernel folder of this machine: one for each version of Numba and Python and each instruction set."""
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
        return folder  # without a writable folder Numba compiles in each process
    return folder


CACHE = _prepare_cache()
config.CACHE_DIR = str(CACHE)  # pyright: ignore[reportAttributeAccessIssue]
LOOKUP_HOOKS: list[Callable[[Any, Any], None]] = []
"""Functions called with a kernel's function and types before each look-up on disk."""


def is_cached(dispatcher: Any, kinds: tuple[types.Type, ...]) -> bool:
    """Return whether a kernel is compiled for these types, in this process or on disk."""
    return kinds in dispatcher.overloads or dispatcher._cache.contains(kinds, dispatcher.targetctx)


@contextmanager
def timed(seconds: dict[str, float], part: str) -> Iterator[None]:
    """Add the seconds of a block to `part`, and its seconds of compiling or loading kernels to "compile_kernels" instead."""
    started = time.perf_counter()
    # Numba holds this lock exactly while it compiles or loads, in any thread.
    with event.install_listener("numba:compiler_lock", event.TimingListener()) as lock:
        try:
            yield
        finally:
            spent = time.perf_counter() - started
            compiling = min(lock.duration, spent) if lock.done else 0.0
            seconds["compile_kernels"] = seconds.get("compile_kernels", 0.0) + compiling
            seconds[part] = seconds.get(part, 0.0) + spent - compiling


class KernelFiles(IndexDataCacheFile):
    """Files of one kernel, safe for processes that write at the same time.

    Numba numbers the files. Of two processes that compile for different types at the same time, one could load the other's code under its
    own number. Here files get unique names. Each file begins with a digest of the rest: a damaged file counts as missing.
    """

    def _load_index(self) -> dict[Any, str]:
        data = _read_checked(Path(self._index_path))
        if data is None:
            return {}
        version, stamp, names = pickle.loads(data)
        return names if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write_checked(self._index_path, self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        data = _read_checked(Path(self._data_path(name)))
        if data is None:
            raise FileNotFoundError(name)
        return pickle.loads(data)

    def _save_data(self, name: str, data: Any) -> None:
        self._write_checked(self._data_path(name), self._dump(data))

    def _write_checked(self, path: str, data: bytes) -> None:
        with self._open_for_write(path) as file:
            file.write(_digest(data) + data)

    def save(self, key: Any, data: Any) -> None:
        name = self._load_index().get(key) or self._data_name_pattern.replace("{number:d}", uuid.uuid4().hex[:12])
        self._save_data(name, data)
        for _ in range(_TRIES):  # another process may have read the index before this write, and overwrite it afterwards
            known = self._load_index()
            if known.get(key) == name:
                break
            self._save_index({**known, key: name})
        self._remove_older()

    def _remove_older(self) -> None:
        """Remove files of the kernel's other versions that no process is likely to use."""
        path = Path(self._index_path)
        kernel_name = path.stem.rpartition("-")[0]
        for other in path.parent.glob(f"{glob.escape(kernel_name)}-*"):
            with suppress(OSError):
                if not other.name.startswith(path.stem) and time.time() - other.stat().st_mtime > _FRESH:
                    other.unlink()


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=_DIGEST).digest()


def _read_checked(path: Path) -> bytes | None:
    """Return the content of a file behind its digest, or None where the file is missing, unreadable or damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    return data[_DIGEST:] if len(data) > _DIGEST and _digest(data[_DIGEST:]) == data[:_DIGEST] else None


class KernelCache(FunctionCache):
    """Numba's cache, but loads compiled code without initializing the compiler, which takes longer than rendering a small picture."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        module = function.__module__.partition(".")[2] or function.__module__
        self._module, self._name = module, f"{module}~{function.__qualname__}".replace("<locals>", "local")
        self._cache_path = str(CACHE)
        self._compiling = ExitStack()  # from a look-up in vain to the new code
        self._cache_file = KernelFiles(self._cache_path, f"{self._name}-{cache_key.key(function.__module__)}", _FORMAT)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Numba's key, extended by the digest of the modules that define the NamedTuples and functions among the arguments."""
        return (*super()._index_key(sig, codegen), _digest_of_types(sig))

    def contains(self, sig: Any, target_context: Any) -> bool:
        """Return whether code for these types is on disk."""
        return self._index_key(sig, target_context.codegen()) in self._cache_file._load_index()

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel. On a full or read-only disk the kernel serves this process alone."""
        self._compiling.close()
        compile_events.ready()
        with suppress(OSError):
            super().save_overload(sig, data)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for wait in LOOKUP_HOOKS:
            wait(self._py_func, sig)
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
            if found is None:
                self._compiling.enter_context(compile_events.compiling(self._name))
            else:
                compile_events.ready()
            return found


def _digest_of_types(sig: Any) -> str:
    """Digest of the modules of the classes and functions in a signature: kernels compile in their fields and code."""
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
