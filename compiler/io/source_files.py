"""Reader of .scene files: the text of modules, and the folder in which each source looks up its files."""

from __future__ import annotations

import os
from pathlib import Path

from ...lang.diagnostics import Span, suggest
from ...lang.eval.modules import ReadError, Source
from .regular_files import read_text
from .sandbox import LIBRARY, FileError, Files


class SceneReader:
    """Implements lang.modules.Reader with Files. `std/…` is the library; other paths are relative to the importing file."""

    def __init__(self, files: Files) -> None:
        self.files = files
        self._shown: dict[str, str] = {}  # path -> displayed name
        self._folders: dict[str, Path] = {}  # displayed name -> folder

    def main(self, shown: str, path: Path) -> Source:
        """The main source at `path`, displayed as `shown`. Raises FileError if it cannot be read."""
        file, text = self.files.text(path.name, path.parent, "scene")
        return self._source(shown, file, text)

    def scene(self, path: str, importer: str, span: Span) -> Source:
        """The source that `use "path"` in the file `importer` names. Raises ReadError if it cannot be read."""
        if path.startswith("std/"):
            return self._library(path)
        folder = Path(importer).parent
        try:
            file, text = self.files.text(path, folder, "scene")
        except FileError as failure:
            raise ReadError(failure.message, failure.hint) from None
        beside = os.path.dirname(self._shown.get(importer, importer))
        return self._source(os.path.normpath(os.path.join(beside, path)), file, text)

    def folder(self, shown: str) -> Path | None:
        """The folder for relative names in a source; None for an unknown source."""
        return self._folders.get(shown)

    def _library(self, path: str) -> Source:
        name = path.removesuffix(".scene")
        file = LIBRARY / f"{name.removeprefix('std/')}.scene"
        if file.parent != LIBRARY or not file.is_file():
            names = sorted(f"std/{p.stem}" for p in LIBRARY.glob("*.scene"))
            raise ReadError(f"the library has no `{name}`", suggest(name, names) or f"it has {', '.join(names)}")
        self._folders[name] = LIBRARY
        return Source(name, read_text(file), name)

    def _source(self, shown: str, path: Path, text: str) -> Source:
        self._shown[str(path)] = shown
        self._folders[shown] = path.parent
        return Source(shown, text, str(path))
