"""The open files and those that they use, by path."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pygls import uris

from ...compiler.io.regular_files import read_text
from ...compiler.io.sandbox import LIBRARY
from ...lang import file_types
from ...lang.eval.modules import is_asset
from ...lang.syntax import ast
from .document import DefinitionSite, Document, Placed

MAX_FILES = 500  # found in a folder
MAX_FOLDERS = 2000  # searched in a folder


class Project:
    """Documents by path. Those of open files have the text of the editor; others are read from disk again when they change."""

    def __init__(self) -> None:
        self.open: dict[str, Document] = {}
        self.versions: dict[str, int] = {}  # of open files, as the editor counts
        self._uris: dict[str, str] = {}
        self._read: dict[str, tuple[tuple[int, int], Document]] = {}

    def change(self, uri: str, text: str, version: int) -> Document:
        """Set the text of an open file."""
        path = path_of(uri)
        self.versions[path] = version
        self._uris[path] = uri
        self.open[path] = Document(path, text, self.open.get(path) or self.document(path))
        return self.open[path]

    def close(self, uri: str) -> None:
        """Forget the text of a file that is no longer open."""
        self.open.pop(path_of(uri), None)

    def document(self, path: str) -> Document | None:
        """The document at a path, or of `std/…`; None if there is none."""
        if path in self.open:
            return self.open[path]
        file = file_of(path)
        try:
            status = file.stat()
            key = status.st_mtime_ns, status.st_size
            if path not in self._read or self._read[path][0] != key:
                self._read[path] = key, Document(path, read_text(file))
        except (OSError, UnicodeDecodeError, ValueError):
            return None
        return self._read[path][1]

    def uri(self, path: str) -> str:
        """The address of a document."""
        return self._uris.get(path) or uris.from_fs_path(str(file_of(path))) or ""

    def used(self, document: Document, use: ast.Use) -> Document | None:
        """The file that `use` names; None for a mesh, a stage, or a missing file."""
        path = use.path.value
        if is_asset(path):
            return None
        if path.startswith("std/"):
            return self.document(path.removesuffix(".scene"))
        return self.document(os.path.realpath(folder_of(document.path) / path))

    def files(self, path: str) -> set[str]:
        """The paths of a file and of all that it uses."""
        paths: set[str] = set()
        waiting = [path]
        while waiting:
            document = self.document(waiting.pop())
            if document is None or document.path in paths:
                continue
            paths.add(document.path)
            for each in document.top.values():
                if isinstance(each.definition.node, ast.Use):
                    used = self.used(document, each.definition.node)
                    waiting += [used.path] if used else []
        return paths

    def beside(self, path: str) -> Iterator[Document]:
        """The .scene files of a document's folder and the folders in it, and all open ones."""
        paths = dict.fromkeys(self.open)
        if not path.startswith("std/"):
            root = folder_of(path)
            real = os.path.realpath(root)
            files = (os.path.realpath(root / name) for name in files_in(root, file_types.SCENE))
            paths |= dict.fromkeys(name for name in files if name.startswith(os.path.join(real, "")))  # without links out of the folder
        for each in paths:
            document = self.document(each)
            if document is not None:
                yield document

    def member(self, document: Document, placed: Placed, node: ast.Member) -> DefinitionSite | None:
        """The definition that `file.name` means."""
        if not isinstance(node.object, ast.Name):
            return None
        owner = document.resolve(placed, node.object)
        if owner is None or not isinstance(owner.definition.node, ast.Use):
            return None
        used = self.used(owner.document, owner.definition.node)
        return used.top.get(node.name.id) if used else None

    def called(self, document: Document, placed: Placed, function: ast.Node) -> DefinitionSite | None:
        """The definition that a call's function means; None for elements and functions of the language."""
        if isinstance(function, ast.Name):
            return document.resolve(placed, function) or self.prelude(function.id)
        return self.member(document, placed, function) if isinstance(function, ast.Member) else None

    def prelude(self, name: str) -> DefinitionSite | None:
        """The definition of a name that every scene has from the library."""
        document = self.document("std/prelude")
        return document.top.get(name) if document else None


def path_of(uri: str) -> str:
    """The path of an address. A text that was never saved has one in the working folder."""
    if uri.startswith("file:"):
        return os.path.realpath(uris.to_fs_path(uri) or "")
    name = uri.rpartition(":")[2].rpartition("/")[2] or "untitled"
    return os.path.join(os.getcwd(), name if name.endswith(".scene") else f"{name}.scene")


def file_of(path: str) -> Path:
    """The file of a document's path."""
    return LIBRARY / f"{path[4:]}.scene" if path.startswith("std/") else Path(path)


def files_in(root: Path, suffixes: tuple[str, ...]) -> list[str]:
    """The names of files of these kinds in a folder and the folders in it, relative to it, up to a limit. Nearer files come first."""
    paths: list[str] = []
    waiting, seen = [root], 0
    while waiting and len(paths) < MAX_FILES and seen < MAX_FOLDERS:
        folder, seen = waiting.pop(0), seen + 1
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError:
            continue
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                waiting += [Path(entry.path)] * (not entry.name.startswith("."))
            elif entry.name.lower().endswith(suffixes):
                paths.append(Path(entry.path).relative_to(root).as_posix())
    return paths[:MAX_FILES]


def folder_of(path: str) -> Path:
    """The folder in which a document's names of files are looked up."""
    return file_of(path).parent
