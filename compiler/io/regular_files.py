"""The one reader of files: ordinary files alone, up to a size. Devices, pipes and sockets are refused before they are read."""

from __future__ import annotations

import errno
import os
import stat
import sys
from io import BufferedReader
from pathlib import Path

from ...lang import text_encoding

MAX_SOURCE = 16 << 20  # bytes of a .scene file, or of another text
MAX_DATA = 2 << 30  # bytes of a mesh, image or stage
ANY_SIZE = sys.maxsize  # for files that are read in parts
NOT_REGULAR = "not an ordinary file"
_CHUNK = 1 << 20
_FLAGS = sum(getattr(os, name, 0) for name in ("O_RDONLY", "O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "O_BINARY"))


def open_regular(path: Path | str, limit: int = MAX_DATA) -> BufferedReader:
    """An ordinary file, open for reading. It never waits for a writer of a pipe.

    Raises OSError, also for files of other kinds and of more than `limit` bytes.
    """
    _check(os.stat(path), path, limit)  # a device may act when it is opened
    descriptor = os.open(path, _FLAGS)
    try:
        _check(os.fstat(descriptor), path, limit)  # another file may have its name by now
        return open(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path | str, limit: int = MAX_DATA) -> bytes:
    """The bytes of an ordinary file. Raises OSError as open_regular does, also for a file that grows beyond `limit` while it is read."""
    with open_regular(path, limit) as file:
        length = os.fstat(file.fileno()).st_size
        parts = [file.read(length + 1)]
        read = len(parts[0])
        while parts[-1] and read > length:  # it grows, or does not tell its size, as files of /proc
            parts.append(file.read(_CHUNK))
            read += len(parts[-1])
            if read > limit:
                raise _too_big(read, path, limit)
    return b"".join(parts) if len(parts) > 1 else parts[0]


def read_text(path: Path | str, limit: int = MAX_SOURCE) -> str:
    """The text of an ordinary file of UTF-8, UTF-16 or UTF-32, whose lines end with `\\n`.

    Raises OSError as read_bytes does, and UnicodeDecodeError.
    """
    return text_encoding.decode(read_bytes(path, limit)).replace("\r\n", "\n").replace("\r", "\n")


def is_regular(path: Path | str) -> bool:
    """Whether a path is that of an ordinary file, or a link to one. Libraries that open files by name may read it."""
    try:
        return stat.S_ISREG(os.stat(path).st_mode)
    except (OSError, ValueError):
        return False


def size(count: int) -> str:
    """A number of bytes with a unit, for messages."""
    for unit, step in (("GB", 1 << 30), ("MB", 1 << 20), ("kB", 1 << 10)):
        if count >= step:
            return f"{count / step:.3g} {unit}"
    return f"{count} byte{'s' * (count != 1)}"


def _check(status: os.stat_result, path: Path | str, limit: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, NOT_REGULAR, str(path))
    if status.st_size > limit:
        raise _too_big(status.st_size, path, limit)


def _too_big(count: int, path: Path | str, limit: int) -> OSError:
    return OSError(errno.EFBIG, f"too big: {size(count)}, and the limit is {size(limit)}", str(path))
