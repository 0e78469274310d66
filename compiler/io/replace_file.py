"""Atomic file replacement: writes a temporary file beside the target and renames it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class Replacement:
    """One new file. The caller writes it at `partial`; `place` renames it to its path.

    At any time the path holds the complete old file or the complete new one. The new file gets the permissions of the old one.
    A symbolic link stays; its target is replaced.
    The name of `partial` is valid UTF-8 even if the path is not, and has the same extension.
    """

    def __init__(self, path: Path) -> None:
        target = Path(os.path.realpath(path))
        folder = target.parent if _is_utf8(str(target.parent)) else Path(tempfile.gettempdir())
        suffix = target.suffix if _is_utf8(target.suffix) else ""
        self.partial = folder / f".maquette-{os.urandom(6).hex()}{suffix}"

    def place(self, path: Path, good: bool = True) -> None:
        """Rename the new file to `path`, or remove it if not `good`. Raises OSError and keeps the old file."""
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


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Replace `path` atomically by the file that the block writes at the yielded path. An error keeps the old file."""
    new, good = Replacement(path), False
    try:
        yield new.partial
        good = True
    finally:
        new.place(path, good)


def replace_file(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically. Raises OSError and keeps the old file."""
    with replacing(path) as partial:
        partial.write_bytes(data)


def _is_utf8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def as_utf8(text: str) -> str:
    """`text` with bytes that are not UTF-8 (surrogates in file names) escaped as `\\xff`."""
    return os.fsencode(text).decode("utf-8", "backslashreplace")
