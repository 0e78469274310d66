"""Confines this process before it reads a stranger's scene: files by Landlock, memory and sizes of files by rlimits."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

try:
    import resource
except ImportError:  # Windows
    resource = None

from . import landlock
from .cache_dirs import cache_root
from .sandbox import LIBRARY

LARGEST_FILE = 16 << 30  # bytes
MEMORY = 8 << 30  # bytes of data, without --memory
PROGRAM = 1 << 30  # bytes of data of the program itself
_SYSTEM = ("/usr", "/lib", "/lib64", "/etc", "/opt", "/proc", "/sys/devices/system", "/sys/fs/cgroup", "/dev/urandom")


_confined = False


def is_confined() -> bool:
    """Whether `confine` was called."""
    return _confined


def confine(read: Iterable[Path], write: Iterable[Path], memory: int | None = None) -> None:
    """Confine this process for good. Call it before libraries start threads. Raises OSError where the system cannot.

    It may read `read`, the program, its libraries, its cache and the system's; it may write below `write`, the first of which also holds
    temporary files. `memory`: bytes, by default MEMORY. The cache of kernels cannot be written: code that a hostile file has put into it
    would run in later processes.
    """
    global _confined
    if resource is None:
        raise OSError("this system has no limits of processes")
    folders = list(write)
    os.environ["TMPDIR"] = tempfile.tempdir = str(folders[0])
    program = {Path(path) for path in (sys.prefix, sys.base_prefix, *sys.path) if path and Path(path).is_dir()}
    program |= {path.resolve() for path in program}
    landlock.restrict([*read, *program, LIBRARY.parent, cache_root(), *map(Path, _SYSTEM)], [*folders, Path("/dev/null"), Path("/dev/shm")])
    for limit, most in (
        (resource.RLIMIT_DATA, PROGRAM + (MEMORY if memory is None else memory)), (resource.RLIMIT_FSIZE, LARGEST_FILE),
        (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        _, hard = resource.getrlimit(limit)
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(limit, (least, least))
    _confined = True
