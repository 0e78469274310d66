"""Fragments are compiled once for a machine: a helper's LLVM module, the type of its result and its callees are kept on disk.

Their files stand beside those of kernels: a digest, a header in JSON, and the bitcode of some dozen fragments. A damaged file counts as
missing. The name of a file is the digest of its content, so that processes write beside each other.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from . import cache_folder

SUFFIX = ".fragments"
_MAGIC = b"maquette fragments 2\n"
_DIGEST = 16  # bytes
_SIZE = struct.Struct("<I")
BATCH = 64  # new fragments that are written together
_SCAN = 1.0  # seconds between two looks for the files of other processes


class Fragment(NamedTuple):
    """A compiled helper."""

    key: str
    symbol: str  # of its function
    result: Any  # type, as in numba_types.to_plain
    calls: tuple[str, ...]  # keys
    separate: bool  # emitted apart from the kernels that call it
    code: bytes  # LLVM bitcode


class Store:
    """Fragments of this process and of the disk, by their keys."""

    def __init__(self) -> None:
        self.open(Path())

    def open(self, folder: Path) -> None:
        """Keep fragments in a folder of compiled code, in place of those of another."""
        if folder != getattr(self, "_folder", None):
            self._folder = folder
            self._fragments: dict[str, Fragment] = {}
            self._new: list[Fragment] = []
            self._read = set[str]()
            self._scanned = -_SCAN

    def find(self, key: str) -> Fragment | None:
        """The fragment of a key, if those that it calls are there, too."""
        if key not in self._fragments:
            self._scan()
        return self._fragments[key] if self._is_complete(key) else None

    def callees(self, fragment: Fragment) -> list[Fragment]:
        """The fragments that one calls."""
        return [self._fragments[key] for key in fragment.calls]

    def add(self, fragment: Fragment) -> None:
        """Keep a fragment, and write it with others later."""
        self._fragments[fragment.key] = fragment
        self._new.append(fragment)
        if len(self._new) >= BATCH:
            self.save()

    def save(self) -> None:
        """Write the fragments that are not on disk yet."""
        if self._new:
            self._read.add(write(self._folder, self._new))
            self._new = []

    def _scan(self) -> None:
        """Read the files that other processes have written since the last look."""
        now = time.monotonic()
        if now - self._scanned >= _SCAN:
            self._scanned = now
            for name in names(self._folder) - self._read:
                self._read.add(name)
                self._fragments.update((each.key, each) for each in read(self._folder / name) if each.key not in self._fragments)

    def _is_complete(self, key: str) -> bool:
        """Whether a fragment and all that it calls, step by step, are there: files are removed one by one."""
        todo, seen = [key], {key}
        while todo:
            fragment = self._fragments.get(todo.pop())
            if fragment is None:
                return False
            todo += (each for each in fragment.calls if each not in seen)
            seen.update(fragment.calls)
        return True


STORE = Store()


# --- files ---------------------------------------------------------------------------------------------------------------


def names(folder: Path) -> set[str]:
    """The files of fragments in the folder of compiled code."""
    with suppress(OSError):
        return {name for name in os.listdir(folder) if name.endswith(SUFFIX)}
    return set()


def write(folder: Path, fragments: list[Fragment]) -> str:
    """Write fragments; return the name of the file. On a full or read-only disk they serve this process alone."""
    header = json.dumps([[*each[:-1], len(each.code)] for each in fragments], separators=(",", ":")).encode()
    body = _SIZE.pack(len(header)) + header + b"".join(each.code for each in fragments)
    digest = _digest(body)
    name = f"{digest.hex()}{SUFFIX}"
    cache_folder.write(folder / name, _MAGIC + digest + body)
    return name


def read(file: Path) -> list[Fragment]:
    """The fragments in a file; none where it is damaged or of another format."""
    data = cache_folder.read(file) or b""
    start = len(_MAGIC) + _DIGEST
    if not data.startswith(_MAGIC) or _digest(data[start:]) != data[len(_MAGIC) : start]:
        return []
    fragments = []
    try:
        (size,) = _SIZE.unpack_from(data, start)
        start += _SIZE.size
        rows = json.loads(data[start : start + size])
        start += size
        for key, symbol, result, calls, separate, length in rows:
            fragments.append(Fragment(key, symbol, result, tuple(calls), bool(separate), data[start : start + length]))
            start += length
    except (ValueError, LookupError, TypeError, struct.error):
        return []
    return fragments


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=_DIGEST).digest()
