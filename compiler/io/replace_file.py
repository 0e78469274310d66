"""Atomic file replacement: writes a temporary file beside the target and renames it."""

from __future__ import annotations

import errno
import os
import platform
import shutil
import stat
import tempfile
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PREFIX = ".maquette-"  # of temporary files: the prefix, the host, the process, random digits
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
ABANDONED = 60.0  # seconds since the last change of a temporary file whose process has ended


class Replacement:
    """One new file. The caller writes it at `partial`; `place` renames it to its path.

    At any time the path holds the complete old file or the complete new one. The new file gets the permissions of the old one; in a
    confined process, which cannot widen permissions, those that a new file has beside.
    A symbolic link at the path is refused, and one that comes there later is replaced itself: nothing is written through links.
    `partial` is a new, empty file. Its name is valid UTF-8 even if the path is not, and has the same extension. A process that was killed
    leaves its `partial` behind; the next one that writes into the folder removes it.
    """

    def __init__(self, path: Path) -> None:
        check_replaceable(path)
        folder = path.parent if _is_utf8(str(path.parent)) else Path(tempfile.gettempdir())
        remove_abandoned(folder)
        self.partial = _new_file(folder, path)

    def place(self, path: Path, good: bool = True) -> None:
        """Rename the new file to `path`, or remove it if not `good`. Raises OSError and keeps the old file."""
        try:
            if good:
                try:
                    self.partial.replace(path)
                except OSError as fault:
                    if fault.errno != errno.EXDEV or self.partial.parent == path.parent:
                        raise
                    self._copy(path)
        finally:
            with suppress(OSError):  # its folder may be gone, or not writable any more
                self.partial.unlink(missing_ok=True)


    def _copy(self, path: Path) -> None:
        """Move the new file from another file system."""
        copy = _new_file(path.parent, path)
        try:
            shutil.copyfile(self.partial, copy)
            copy.replace(path)
        finally:
            copy.unlink(missing_ok=True)


def _new_file(folder: Path, path: Path) -> Path:
    """A new, empty file in `folder` with the permissions of the file at `path`, if there is one. Raises OSError that names `path`."""
    suffix = path.suffix if _is_utf8(path.suffix) else ""
    temporary = folder / f"{PREFIX}{_host()}-{os.getpid()}-{os.urandom(6).hex()}{suffix}"
    try:
        mode = stat.S_IMODE(os.lstat(path).st_mode)
    except OSError:
        mode = None  # nothing is there
    try:
        descriptor = os.open(temporary, _NEW, 0o666 if mode is None else mode & 0o777)
    except OSError as fault:
        raise OSError(fault.errno, fault.strerror, str(path)) from None
    try:
        if mode is not None and hasattr(os, "fchmod"):
            with suppress(PermissionError):  # a confined process
                os.fchmod(descriptor, mode)
    finally:
        os.close(descriptor)
    return temporary


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Replace `path` atomically by the file that the block writes at the yielded path. An error keeps the old file.

    An OSError of the new file names `path`.
    """
    new, good = Replacement(path), False
    try:
        try:
            yield new.partial
            good = True
        finally:
            new.place(path, good)
    except OSError as failure:
        if failure.errno is None or failure.filename not in (None, str(new.partial), new.partial):
            raise
        raise OSError(failure.errno, failure.strerror, str(path)) from failure


def replace_file(path: Path, data: bytes) -> None:
    """Write `data` to `path` atomically. Raises OSError and keeps the old file."""
    with replacing(path) as partial:
        partial.write_bytes(data)


def check_replaceable(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise OSError with a full sentence if no file may be written at `path`.

    A link, a folder, a device, a pipe, a socket or one of `inputs`, the files that are read, stands there.
    """
    name = as_utf8(str(path))
    try:
        target = os.path.realpath(path)
    except FileNotFoundError:
        raise FileNotFoundError(f"cannot write {name}: the current folder was removed") from None
    if os.path.islink(path):
        raise OSError(f"{name} is a link, and nothing is written through links: remove it, or choose another name")
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return  # nothing is there
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(f"{name} is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(f"{name} is a device, a pipe or a socket: choose the name of a file")
    if read := next((file for file in inputs if os.path.realpath(file) == target), None):
        raise OSError(f"{name} would replace {as_utf8(str(read))}, which is read: choose another name")


def check_new_folder(folder: Path) -> None:
    """Raise OSError with a full sentence if no folder can be at a path: a link or a file stands there."""
    name = as_utf8(str(folder))
    if folder.is_symlink():
        raise OSError(f"{name} is a link, and nothing is written through links: remove it, or choose another name")
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(f"{name} is a file, and a folder of this name is needed: remove it, or choose another name")


def make_folder(folder: Path, base: Path | None = None) -> None:
    """Make a folder for new files, and those above it. Raises OSError for links among the folders below `base`, by default its parent.

    Nothing is written through such links. `base` may be one: the user has named it.
    """
    for each in (folder, *folder.parents):
        if each == (base or folder.parent):
            break
        if each.is_symlink():
            raise OSError(f"{as_utf8(str(each))} is a link, and nothing is written through links: remove it, or choose another name")
    folder.mkdir(parents=True, exist_ok=True)


def remove_abandoned(folder: Path) -> None:
    """Remove temporary files of processes of this host that have ended."""
    try:
        with os.scandir(folder) as entries:
            abandoned = [entry for entry in entries if entry.name.startswith(f"{PREFIX}{_host()}-")]
        for entry in abandoned:
            process = entry.name.removeprefix(f"{PREFIX}{_host()}-").partition("-")[0]
            if process.isdecimal() and not _is_alive(int(process)) and time.time() - entry.stat().st_mtime > ABANDONED:
                os.unlink(entry.path)
    except OSError:
        return  # the folder, or another process's file, is not ours to change


def _host() -> str:
    """Eight digits of this host: processes of other hosts may write into a shared folder."""
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _is_utf8(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def as_utf8(text: str) -> str:
    """`text` with bytes that are not UTF-8 (surrogates in file names) escaped as `\\xff`."""
    return os.fsencode(text).decode("utf-8", "backslashreplace")
