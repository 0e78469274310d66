"""A lock for each kernel that is being compiled: other processes wait for it and read the result from disk."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: processes may compile the same kernel twice
    fcntl = None

SUFFIX = ".compiling"
LONGEST = 300.0  # seconds of waiting for another process, after which this one compiles too
_STEP = 0.05  # seconds between two attempts, so that signals are handled


def is_taken(file: Path) -> bool:
    """Whether a process may hold the lock of a file of compiled code."""
    return file.with_name(f"{file.name}{SUFFIX}").exists()


@contextmanager
def compiling(file: Path) -> Iterator[None]:
    """Hold the lock of a file of compiled code in the block. The lock of a process that ended is free.

    Without a writable folder, or after LONGEST, the block runs without the lock.
    """
    path = file.with_name(f"{file.name}{SUFFIX}")
    held = None
    if fcntl is not None:
        with suppress(OSError):
            held = path.open("wb")
    try:
        if fcntl is not None and held is not None:
            end = time.monotonic() + LONGEST
            while time.monotonic() < end and not _try_lock(held):
                time.sleep(_STEP)
        yield
    finally:
        if held is not None:
            with suppress(OSError):
                path.unlink()  # a process that waits for it finds the code
            held.close()


def _try_lock(file: object) -> bool:
    assert fcntl is not None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # pyright: ignore[reportArgumentType]
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True
