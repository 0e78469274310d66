"""Lines that C libraries write to the standard error output themselves, as libpng does for a damaged file.

The library's caller reports the same error as a diagnostic with the file's name. So the lines are left out.
"""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import BinaryIO

STDERR = 2
STARTS = (b"libpng error:", b"libpng warning:", b"posix_madvise")

_lock = threading.Lock()
_blocks = 0  # that threads are in
_kept: tuple[int, BinaryIO] | None = None  # the standard error output, and the file in its place


@contextmanager
def left_out() -> Iterator[None]:
    """In the block, leave out lines with these STARTS; all others follow at its end. It may be entered by several threads at once."""
    global _blocks
    with _lock:
        _blocks += 1
        if _blocks == 1:
            _begin()
    try:
        yield
    finally:
        with _lock:
            _blocks -= 1
            if _blocks == 0:
                _end()


def _begin() -> None:
    global _kept
    with suppress(OSError):  # closed, or no file can be made: the lines stay
        file = tempfile.TemporaryFile()  # noqa: SIM115
        try:
            _kept = os.dup(STDERR), file
        except OSError:
            file.close()
            return
        os.dup2(file.fileno(), STDERR)


def _end() -> None:
    global _kept
    if _kept is None:
        return
    (stderr, file), _kept = _kept, None
    os.dup2(stderr, STDERR)
    os.close(stderr)
    with file:
        file.seek(0)
        for line in file:
            if not line.startswith(STARTS):
                with suppress(OSError):
                    os.write(STDERR, line)
