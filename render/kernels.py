"""How the house compiles: the kernel and helper decorators, and a cache on disk that cannot go stale.

Numba's cache looks at the one file a kernel stands in and not at the helpers it calls. So the cache lies in a folder named
after the content of everything that is compiled and the machine's instruction set, and any change makes a new one; the folders of
older versions are removed.
"""

from __future__ import annotations

import hashlib
import shutil
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
from numba import config, njit, types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys
from numba.extending import overload, register_jitable

from ..compiler import folders
from . import haste, machine
from .fragments import Fragment, Kernel

_COMPILED_FROM = ("ir.py", "records.py")  # without kernels of their own, but their constants and types are compiled in
_KEEP = 3  # caches of other versions that are left in place
_TRIES = 5
_FRESH = 24 * 3600.0  # seconds in which a cache may be in use by another process


def _sources_hash() -> str:
    here = Path(__file__).resolve().parent
    digest = hashlib.sha256(f"{numba.__version__} {machine.fingerprint()}".encode())
    for source in (*sorted(here.rglob("*.py")), here.parent / "compiler" / "ir.py"):
        text = source.read_bytes()
        if source.name in _COMPILED_FROM or b"numba" in text or b"from .kernels import" in text or source.parent != here:
            digest.update(source.relative_to(here.parent).as_posix().encode())
            digest.update(text)
    return digest.hexdigest()[:16]


def _prepare_cache() -> Path:
    root = folders.cache_root() / "kernels"
    folder = root / _sources_hash()
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


haste.make()
CACHE = _prepare_cache()
config.CACHE_DIR = str(CACHE)  # pyright: ignore[reportAttributeAccessIssue]


HELPER: Any = {
    "error_model": "numpy", "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True,
    "pipeline_class": Fragment, "_nrt": False,
}  # fmt: skip
"""How helpers compile: into the kernels that call them, and nowhere else. Vectors passed through memory cost more than the work on them.
They make no arrays, and so count no references to those they are given: in inner loops that took half of the time."""


def is_cold() -> bool:
    """Whether nothing has been compiled yet for this version, so that the first picture will take a while."""
    return not any(CACHE.rglob("*.nbc"))


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
                return
            self._save_index({**known, key: name})


class _Kept(FunctionCache):
    """Numba's cache, which loads compiled code without first getting ready to compile: that takes longer than all of a small picture."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = Files(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def knows(self, sig: Any, target_context: Any) -> bool:
        """Whether code for these types is on disk."""
        return self._index_key(sig, target_context.codegen()) in self._cache_file._load_index()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for wait in WAITED_FOR:
            wait(self._py_func, sig)
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


WAITED_FOR: list[Callable[[Any, Any], None]] = []
"""Called with a kernel's function and types before it is looked for on disk."""


def is_kept(dispatcher: Any, kinds: tuple[types.Type, ...]) -> bool:
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


def apart(function: Callable[..., Any]) -> Any:
    """A helper that stays a function of its own in the kernels that call it: for what is long, or called from several places."""
    return register_jitable(**{**HELPER, "forceinline": False})(function)


def maker(function: Callable[..., Any]) -> Any:
    """`apart`, for what makes arrays of its own."""
    return register_jitable(**{**HELPER, "forceinline": False, "_nrt": True})(function)


def replacing(kind: Any, *names: str) -> Any:
    """A helper `changed(record, value, …)`: a NamedTuple of this kind with other values in the fields of these names."""
    values = [f"value_{name}" for name in names]
    parts = ", ".join(f"value_{name}" if name in names else f"record.{name}" for name in kind._fields)
    made: dict[str, Any] = {"kind": kind}
    exec(f"def changed(record, {', '.join(values)}):\n    return kind({parts})\n", made)  # kernels know no _replace
    return helper(made["changed"])


def if_there(function: Callable[..., Any]) -> Callable[..., Any]:
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


def either(function: Callable[..., Any], otherwise: Callable[..., Any]) -> Callable[..., Any]:
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
