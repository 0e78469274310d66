"""Compiling kernels: the house's Numba flags, and a cache folder that knows when any helper's source has changed."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from numba import njit
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., Any])

_KEPT_SECONDS = 30 * 24 * 3600  # folders of other versions unused for so long are removed
_SOURCES = (*sorted(Path(__file__).parent.glob("*.py")), Path(__file__).parent.parent / "compiler" / "ir.py")


def cache_folder() -> Path:
    """The folder of this version's compiled kernels.

    Numba's own cache looks at the kernel's file only and would run old code after a change in a function it calls, so the
    folder's name holds a digest of every source that kernels are made of, and of the versions of Numba and Python.
    """
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for source in _SOURCES:
        digest.update(source.read_bytes())
    root = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "maquette" / f"kernels-{digest.hexdigest()[:16]}"


def _open(folder: Path) -> bool:
    """Makes the folder and removes long unused ones beside it; False where that cannot be, and kernels are then not kept."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return False
    for other in folder.parent.glob("kernels-*"):
        try:
            if time.time() - other.stat().st_mtime > _KEPT_SECONDS:
                shutil.rmtree(other, ignore_errors=True)
        except OSError:
            continue
    return os.access(folder, os.W_OK)


_FOLDER = cache_folder()
_CACHED = _open(_FOLDER)


def kernel(function: F) -> F:
    """Compiles a function at its first call, and keeps the machine code.

    Kernels release the GIL, take NamedTuples of arrays, and divide as numpy does (x/0 is inf or nan, never an exception).
    """
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_FOLDER)  # type: ignore[attr-defined]
    try:
        return njit(nogil=True, cache=_CACHED, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


def helper(function: F) -> F:
    """A function that kernels may call and that stays plain Python outside of them: one source for both."""
    return register_jitable(error_model="numpy")(function)
