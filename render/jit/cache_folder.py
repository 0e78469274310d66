"""The folder of compiled code: made for its user alone, bounded in size, and read only where no other user can write.

Files that were unused for longest go first. MAQUETTE_CACHE_SIZE is the most that all files take together, such as 500MB or 2GB.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import time
from contextlib import suppress
from pathlib import Path

from ...compiler.io.cache_dirs import cache_root
from ...compiler.io.environment import SettingError
from ...compiler.io.replace_file import replace_file

VARIABLE = "MAQUETTE_CACHE_SIZE"
DEFAULT_SIZE = "1GB"
_UNITS = {"": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_SAME_USE = 3600.0  # seconds: reading a file again within them does not change its time


def root() -> Path:
    """The folder of all versions' and targets' code."""
    return cache_root() / "kernels"


def prepare(name: str) -> Path:
    """Create the folder of one version and target. Without a writable folder each process compiles.

    Own folders that others could write to lose their files, which may not be ours. Raises SettingError as `largest_size`.
    """
    largest_size()  # before minutes of compiling
    folder = root() / name
    with suppress(OSError):
        for each in (root(), folder):
            if each.is_dir() and _is_own(each) and not is_trusted(each):
                shutil.rmtree(each, ignore_errors=True)
            each.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder


def _is_own(path: Path) -> bool:
    return not hasattr(os, "geteuid") or path.stat().st_uid == os.geteuid()


def is_trusted(folder: Path) -> bool:
    """Return whether a folder belongs to this user, and nobody else can write to it."""
    try:
        return _is_own(folder) and (os.name == "nt" or not folder.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH))
    except OSError:
        return False


def read(file: Path) -> bytes | None:
    """The content of a file, which counts as used; None where it cannot be read or trusted."""
    if not is_trusted(file.parent):
        return None
    try:
        data = file.read_bytes()
        if time.time() - file.stat().st_mtime > _SAME_USE:
            with suppress(OSError):
                os.utime(file)
    except OSError:
        return None
    return data


def write(file: Path, data: bytes) -> str:
    """Write a file, in place of others where the folder is full. Return why it could not be written, "" if it was."""
    if not make_room(len(data)):
        return f"{VARIABLE} is {os.environ.get(VARIABLE) or DEFAULT_SIZE}"
    try:
        if not file.parent.is_dir():
            file.parent.mkdir(mode=0o700, parents=True)
        if not is_trusted(file.parent):
            return "other users can write to it" if _is_own(file.parent) else "it belongs to another user"
        replace_file(file, data)
    except FileExistsError:
        return "a file has its name"
    except OSError as fault:
        return fault.strerror or str(fault)
    return ""


def make_room(size: int) -> bool:
    """Remove the files unused for longest until `size` bytes fit; return whether they do.

    Raises SettingError for a value of MAQUETTE_CACHE_SIZE that is no size.
    """
    limit = largest_size()
    files = []
    for folder, _, names in os.walk(root()):
        for name in names:
            path = os.path.join(folder, name)
            with suppress(OSError):
                status = os.stat(path)
                files.append((status.st_mtime, status.st_size, path))
    total = sum(each for _, each, _ in files)
    for _, each, path in sorted(files):
        if total + size <= limit:
            break
        with suppress(OSError):
            os.unlink(path)
            total -= each
    return total + size <= limit


def largest_size() -> int:
    """The bytes of MAQUETTE_CACHE_SIZE. Raises SettingError for a value that is no size."""
    text = os.environ.get(VARIABLE) or DEFAULT_SIZE
    size = re.fullmatch(r"(\d+(?:\.\d+)?) ?([KMGT]?B)?", text.strip(), re.IGNORECASE)
    if size is None or (size[2] or "").upper() == "B":
        raise SettingError(f"{VARIABLE} is {text}, which is no size: write a number of bytes, or 500MB, or 2GB")
    return int(float(size[1]) * _UNITS[(size[2] or "").upper()])
