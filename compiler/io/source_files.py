"""The text of .scene files for the evaluator, and the folder that each source's own files are looked for in."""

from __future__ import annotations

import os
from pathlib import Path

from ...lang.diagnostics import Span, suggest
from ...lang.eval.modules import ReadError, Source
from .sandbox import LIBRARY, FileError, Files


class SceneReader:
    """lang.modules.Reader over Files. `std/…` is the library; everything else is beside the file that uses it."""

    def __init__(self, files: Files) -> None:
        self.files = files
        self._shown: dict[str, str] = {}  # path -> the name to show
        self._folders: dict[str, Path] = {}  # name shown -> folder

    def main(self, shown: str, path: Path) -> Source:
        """The scene itself, at `path` in its own folder, and shown as it was asked for. FileError if it cannot be read."""
        found, text = self.files.text(path.name, what="scene")
        return self._source(shown, found, text)

    def scene(self, path: str, importer: str, span: Span) -> Source:
        """The file that `use "path"` names in the file whose path is `importer`. ReadError if it cannot be used."""
        if path.startswith("std/"):
            return self._library(path)
        folder = Path(importer).parent
        try:
            found, text = self.files.text(path, folder, "scene")
        except FileError as failure:
            raise ReadError(failure.message, failure.hint) from None
        beside = os.path.dirname(self._shown.get(importer, importer))
        return self._source(os.path.normpath(os.path.join(beside, path)), found, text)

    def folder(self, shown: str) -> Path | None:
        """Where the files that a source names are looked for; None where the source is not known."""
        return self._folders.get(shown)

    def _library(self, path: str) -> Source:
        name = path.removesuffix(".scene")
        file = LIBRARY / f"{name.removeprefix('std/')}.scene"
        if file.parent != LIBRARY or not file.is_file():
            there = sorted(f"std/{p.stem}" for p in LIBRARY.glob("*.scene"))
            raise ReadError(f"the library has no `{name}`", suggest(name, there) or f"it has {', '.join(there)}")
        self._folders[name] = LIBRARY
        return Source(name, file.read_text(encoding="utf-8"), name)

    def _source(self, shown: str, path: Path, text: str) -> Source:
        self._shown[str(path)] = shown
        self._folders[shown] = path.parent
        return Source(shown, text, str(path))
