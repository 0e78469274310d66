"""Replaces a file as a whole: the new one is written beside the old one and renamed over it."""

from __future__ import annotations

import itertools
import os
import shutil
import tempfile
from pathlib import Path

_numbers = itertools.count()


class Replacement:
    """One new file. It is written at `partial`; `place` puts it at its path.

    The path holds the old file or the new one, never a part. The new file has the permissions of the old one.
    Where the path is a symbolic link, the link stays and the file that it names is replaced.
    The name of `partial` is valid UTF-8 even where that of the path is not, and it has the same extension.
    """

    def __init__(self, path: Path) -> None:
        target = Path(os.path.realpath(path))
        folder = target.parent if _is_utf8(str(target.parent)) else Path(tempfile.gettempdir())
        suffix = target.suffix if _is_utf8(target.suffix) else ""
        self.partial = folder / f".maquette-{os.getpid()}-{next(_numbers)}{suffix}"

    def place(self, path: Path, good: bool = True) -> None:
        """Put the new file at `path`, or remove it where it is not `good`. Raises OSError, and then the old file stays."""
        target = Path(os.path.realpath(path))
        try:
            if good:
                if target.exists():
                    shutil.copymode(target, self.partial)
                if self.partial.parent == target.parent:
                    self.partial.replace(target)
                else:
                    shutil.move(self.partial, target)
        finally:
            self.partial.unlink(missing_ok=True)


def replace_file(path: Path, data: bytes) -> None:
    """Write a file as a whole. Raises OSError, and then the old file stays."""
    new = Replacement(path)
    good = False
    try:
        new.partial.write_bytes(data)
        good = True
    finally:
        new.place(path, good)


def _is_utf8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def as_utf8(text: str) -> str:
    """`text` with the bytes of file names that are not UTF-8 written as `\\xff`."""
    return os.fsencode(text).decode("utf-8", "backslashreplace")
