"""Confines this process before it reads a stranger's scene: files by Landlock, system calls by seccomp, memory by rlimits."""

from __future__ import annotations

import os
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

from . import landlock, seccomp, unlinked_paths
from .cache_dirs import cache_root
from .sandbox import LIBRARY

try:
    import fcntl
    import resource
except ImportError:  # Windows
    fcntl = resource = None

LARGEST_FILE = 16 << 30  # bytes
MEMORY = 8 << 30  # bytes of data, without --memory
PROGRAM = 1 << 30  # bytes of data of the program itself
_SYSTEM = (  # libraries, and what they read when they start
    "/lib", "/lib32", "/lib64", "/usr/lib", "/usr/lib32", "/usr/lib64", "/usr/libx32", "/usr/local/lib", "/usr/local/lib64",
    "/usr/share/locale", "/usr/share/zoneinfo", "/nix/store", "/gnu/store",
    "/etc/ld.so.cache", "/etc/localtime", "/etc/locale.alias", "/etc/mime.types", "/dev/urandom", "/dev/zero",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/filesystems", "/proc/sys/vm/overcommit_memory",
    "/sys/devices/system/cpu", "/sys/devices/system/node", "/sys/kernel/mm/transparent_hugepage",
    *(f"/sys/fs/cgroup/{name}" for name in ("memory.max", "memory.current", "memory.stat", "cpu.max")),
    *(f"/sys/fs/cgroup/memory/memory.{name}" for name in ("limit_in_bytes", "usage_in_bytes", "stat")),
)  # fmt: skip
_OWN = ("auxv", "cgroup", "maps", "mountinfo", "mounts", "smaps", "stat", "statm", "status")  # of /proc/self
_ENDING = 2.0  # seconds that threads may take to end
_KERNELS = ("*.kernel",)  # of the cache; its other files are of other scenes, or hold the secrets of live windows
_kept: list[int] = []  # descriptors of /proc/self: its rules end with them


def confine(read: Iterable[Path], write: Iterable[Path], memory: int | None = None) -> None:
    """Confine this process for good. Call it before libraries start threads. Raises OSError where the system cannot.

    It may read `read`, the program, its libraries, compiled kernels and what these need of the system. It may write below `write`, the
    first of which also holds temporary files. No part of these paths may be a link; those that are missing are left out. `memory`: bytes,
    by default MEMORY. The cache of kernels cannot be written: code that a hostile file has put into it would run in later processes.
    """
    if fcntl is None or resource is None:
        raise OSError("this system has no limits of processes")
    if why := seccomp.missing():
        raise OSError(why)
    if _has_threads():
        raise OSError("a process is confined before it starts threads")
    _leave_behind()
    with ExitStack() as stack:
        inputs, folders = ([*_opened(paths, stack)] for paths in (read, write))
        written = [Path(os.readlink(f"/proc/self/fd/{folder}")) for folder in folders]
        os.environ.setdefault("MAQUETTE_CACHE", str(cache_root()))  # the home folder may not be known any more
        os.environ["TMPDIR"] = tempfile.tempdir = str(written[0]) if written else "/"
        _kept[:] = [os.open(f"/proc/self/{name}", os.O_PATH | os.O_CLOEXEC) for name in _OWN if os.path.exists(f"/proc/self/{name}")]
        system = [*_program(), *_kernels(), *map(Path, _SYSTEM)]
        landlock.restrict([*inputs, *_kept, *system], [*folders, Path("/dev/null")])
    for limit, most in (
        (resource.RLIMIT_DATA, PROGRAM + (MEMORY if memory is None else memory)), (resource.RLIMIT_FSIZE, LARGEST_FILE),
        (resource.RLIMIT_CORE, 0),
    ):  # fmt: skip
        _, hard = resource.getrlimit(limit)
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(limit, (least, least))
    seccomp.restrict()


def _has_threads() -> bool:
    """Whether this process has other threads. Those that have been joined may take a moment to end."""
    deadline = time.monotonic() + _ENDING
    while len(os.listdir("/proc/self/task")) > 1:
        if time.monotonic() > deadline:
            return True
        time.sleep(0.01)
    return False


def _opened(paths: Iterable[Path], stack: ExitStack) -> Iterator[int]:
    for path in paths:
        with suppress(FileNotFoundError):
            descriptor = unlinked_paths.open_path(path)
            stack.callback(os.close, descriptor)
            yield descriptor


def _program() -> Iterator[Path]:
    """The folders of this program and its libraries, without that of the command and the current one, where a stranger's files may be."""
    yield LIBRARY.parent
    yield from (Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib"))
    yield from (Path(prefix, "lib") for prefix in (sys.prefix, sys.base_prefix))
    current, command = Path.cwd(), Path(sys.argv[0] or ".").resolve().parent
    for name in (*sys.path, *os.environ.get("LD_LIBRARY_PATH", "").split(":")):
        folder = Path(name).resolve()
        if os.path.isabs(name) and folder.is_dir() and not current.is_relative_to(folder) and folder != command:
            yield folder


def _kernels() -> Iterator[Path]:
    root = cache_root()
    yield root / "sources.json"
    for folder in (root / "kernels").glob("*"):
        yield from (path for pattern in _KERNELS for path in folder.glob(pattern) if not path.is_symlink())


def _leave_behind() -> None:
    """Close what the caller left open, but for the output: a file that is open can be used by a confined process as well.

    A terminal stays open for writing alone.
    """
    assert fcntl is not None
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):
            if int(name) > 2 and not fcntl.fcntl(int(name), fcntl.F_GETFD) & fcntl.FD_CLOEXEC:  # those of Python close by themselves
                os.close(int(name))
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    for number in (1, 2):
        with suppress(OSError):  # closed, or no terminal
            terminal = os.open(os.ttyname(number), os.O_WRONLY | os.O_NOCTTY)
            os.dup2(terminal, number)
            os.close(terminal)
