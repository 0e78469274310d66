"""The folder beside the scene with its meshes and pictures, and the names of all that is written."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from ...io.sandbox import LIBRARY
from ..export import Export
from .identifiers import FileNames, Identifiers

_LET = re.compile(r"^let (\w+)", re.MULTILINE)


def _library_names() -> list[str]:
    """The names that scenes have without `use`."""
    return _LET.findall((LIBRARY / "prelude.scene").read_text(encoding="utf-8"))


class Files:
    """The files of a folder, equal ones once."""

    def __init__(self, out: Export, output: Path) -> None:
        self.out, self.folder, self._parts = out, output.parent, f"{output.stem}.parts"
        self.identifiers = Identifiers(_library_names())
        self._names, self._known = FileNames(), dict[bytes, str]()

    def add(self, source: str, fallback: str, ending: str, data: bytes) -> str:
        """The name of a file, as the scene names it."""
        digest = hashlib.blake2b(data, digest_size=16).digest() + ending.encode()
        if digest not in self._known:
            self._known[digest] = f"{self._parts}/{self._names.new(source, fallback, ending)}"
            self.out.files[self._known[digest]] = data
        return self._known[digest]
