"""File access policy: a scene reads files below its own folder, in the library, and below each `--allow` path."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from ...lang import text_encoding
from ...lang.diagnostics import suggest
from ...lang.file_types import is_binary
from ...lang.input_error import InputError
from .regular_files import MAX_DATA, MAX_SOURCE, read_bytes, size

if TYPE_CHECKING:
    from .color_config import Config

LIBRARY = Path(__file__).resolve().parents[2] / "stdlib"
MAX_QUOTED = 4 << 20  # bytes of the largest file whose lines are quoted in messages


_unsaved: ContextVar[Mapping[str, str]] = ContextVar("unsaved", default=MappingProxyType({}))


@contextmanager
def unsaved(texts: Mapping[str, str]) -> Iterator[None]:
    """In the block, `texts` are the contents of source files, by resolved path: the unsaved text of an editor."""
    token = _unsaved.set(texts)
    try:
        yield
    finally:
        _unsaved.reset(token)


class FileError(InputError):
    """A missing or forbidden file. The caller adds the span."""


class Files:
    """Resolves, checks and records the files that one scene reads. Names are relative to the file that contains them."""

    def __init__(self, root: Path | str, allow: Iterable[Path | str] = ()) -> None:
        """`root` is the scene's folder. Files below `root` and below each path of `allow` are readable."""
        self.root = Path(root).resolve()
        self._unsaved = _unsaved.get()
        self._allowed = (self.root, LIBRARY, *(Path(a).expanduser().resolve() for a in allow))
        self._read: dict[str, None] = {}
        self.colors: Config | None = None  # the configuration whose colour spaces pictures may be of

    @property
    def read(self) -> tuple[str, ...]:
        """Paths of all files found so far, in order of first use."""
        return tuple(self._read)

    def find(self, name: str, folder: Path | str | None = None, what: str = "file", limit: int = MAX_DATA) -> Path:
        """The path of `name` relative to `folder` (default: the scene's folder).

        Raises FileError if the file is missing, forbidden or larger than `limit` bytes.
        Paths outside the allowed folders are refused before they are opened; so are symbolic links to such paths.
        """
        path = self._inside(name, self.root if folder is None else Path(folder))
        if str(path) in self._unsaved:  # on disk or not
            self._read.setdefault(str(path))
            return path
        try:
            status = path.stat()
        except FileNotFoundError:
            raise FileError(f"there is no {what} `{name}`", self._near(name, path)) from None
        except OSError as failure:
            raise FileError(f"cannot open `{name}`: {failure.strerror}") from None
        if stat.S_ISDIR(status.st_mode):
            raise FileError(f"`{name}` is a folder, not a {what}")
        if not stat.S_ISREG(status.st_mode):
            raise FileError(f"`{name}` is not an ordinary file")
        if status.st_size > limit:
            raise FileError(f"`{name}` is too big: {size(status.st_size)}", f"the limit is {size(limit)}")
        self._read.setdefault(str(path))
        return path

    def text(self, name: str, folder: Path | str | None = None, what: str = "file") -> tuple[Path, str]:
        """The path and text of a source file. Raises FileError if it is not UTF-8."""
        path = self.find(name, folder, what, MAX_SOURCE)
        if str(path) in self._unsaved:
            return path, self._unsaved[str(path)]
        try:
            data = read_bytes(path, MAX_SOURCE)
        except OSError as failure:
            raise FileError(f"cannot read `{name}`: {failure.strerror}") from None
        return path, decode(data, name)

    def outside(self, name: str, path: Path | str) -> tuple[str, str] | None:
        """Why a file, which messages call `name`, may not be read, and what to do; None for one that may, there or not.

        This is the one rule for all kinds of files. Symbolic links are resolved.
        """
        try:
            target = Path(path).resolve()
        except UnicodeEncodeError:  # the encoding of file names lacks a character: one message with its fix, for all commands
            raise
        except (OSError, ValueError, RuntimeError):
            return f"`{name}` leads round in a circle of links", ""
        if self._holds(target):
            return None
        is_link = self._holds(Path(os.path.normpath(os.path.abspath(path))))
        how = "is a link that leads outside" if is_link else "lies outside"
        return f"`{name}` {how} of the scene's folder", f"use --allow {target.parent} to let scenes read it"

    def _holds(self, resolved: Path) -> bool:
        return any(resolved.is_relative_to(folder) for folder in self._allowed)

    def _inside(self, name: str, folder: Path) -> Path:
        if not name or "\0" in name:
            raise FileError("a file's name cannot be empty" if not name else "a file's name cannot hold a zero byte")
        if "://" in name:
            raise FileError(f"`{name}` is an address: a scene reads files only", "save it beside the scene")
        if fault := self.outside(name, folder / name):
            raise FileError(*fault)
        return (folder / name).resolve()

    def _near(self, name: str, path: Path) -> str:
        if path.parent.is_dir():
            near = suggest(path.name, sorted(p.name for p in path.parent.iterdir())[:10_000])
            return near or f"looked in {path.parent}"
        return f"there is no folder {path.parent}"


def open_main(path: Path | str, allow: Iterable[Path | str] = (), what: str = "file") -> tuple[Files, Path]:
    """What the main file of a scene, stage or mesh may read, and its path.

    Inputs are the files of the main file's folder as it is named, and those below each path of `allow`. A main file that is a link may
    lead to another file of these folders. Raises FileError for a link that leads elsewhere, and as Files.find does.
    """
    path = Path(path)
    if path.name in ("", ".."):
        path = resolved(path)
    files = Files(path.parent, allow)
    return files, files.find(path.name, what=what)


def resolved(path: Path) -> Path:
    """The target of a path that the user names. Raises FileError for a circle of links."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        raise FileError(f"`{path}` leads round in a circle of links") from None


def decode(data: bytes, name: str) -> str:
    """The text of a source file of UTF-8, UTF-16 or UTF-32, whose lines end with `\\n`. Raises FileError for other data."""
    if is_binary(data):
        raise FileError(f"`{name}` is not a text file")
    try:
        return text_encoding.decode(data).replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as failure:
        if text_encoding.is_wide(data):
            raise FileError(f"`{name}` is damaged text of UTF-16 or UTF-32", "save it as UTF-8") from None
        line = data[: failure.start].count(b"\n") + 1
        raise FileError(f"`{name}` is not UTF-8 text (line {line})", "save it as UTF-8") from None


def source_text(name: str) -> str | None:
    """The text of a file by its displayed name (a path, or `std/room` of the library), or None."""
    try:
        path = LIBRARY / f"{name[4:].removesuffix('.scene')}.scene" if name.startswith("std/") else Path(name)
        return text_encoding.decode_any(read_bytes(path, MAX_QUOTED))
    except (OSError, ValueError):
        return None
