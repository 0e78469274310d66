"""The scene of the live window: how it is loaded, which files it uses, and their texts."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..compiler import ir
from ..compiler.io import sandbox
from ..compiler.io.regular_files import MAX_SOURCE, read_bytes
from ..compiler.io.sandbox import LIBRARY, source_text
from ..lang import file_types, text_encoding
from ..lang.diagnostics import Diagnostic, Diagnostics, Span, render_text, sort_diagnostics
from .state import State

MAX_SHOWN = 50  # diagnostics sent to a page


@dataclass(frozen=True, slots=True)
class Opened:
    """A scene file with the options of the command line."""

    path: Path
    load: Callable[..., ir.Scene]  # compiler.load.load with its options but sets, time, code and diagnostics
    settings: ir.Settings = field(default_factory=ir.Settings)
    overrides: Mapping[str, str] = field(default_factory=dict)
    sets: Mapping[str, str] = field(default_factory=dict)
    time: float | None = None

    @property
    def scene(self) -> bool:
        """Whether it is a .scene file, whose source and params pages may edit."""
        return self.path.suffix.lower() in file_types.SCENE

    @property
    def usd(self) -> bool:
        return self.path.suffix.lower() in file_types.USD

    def compile(self, state: State, diagnostics: Diagnostics) -> ir.Scene:
        """The scene with the values and unsaved texts of `state`. Raises SceneError."""
        sets = {**self.sets, **state.sets}
        moment: dict[str, Any] = {"time": self.time}
        if state.moment is not None:
            moment = {"code": state.moment} if self.usd else {"time": state.moment}
        with sandbox.unsaved(state.texts):
            return self.load(sets=sets, diagnostics=diagnostics, **moment)

    def timeline(self, scene: ir.Scene) -> dict[str, Any] | None:
        """First and last moment, their unit and the moments a second; None for a scene without animation."""
        if self.usd:
            from ..compiler.importers.usd import stage

            codes = stage.time_codes(self.path)
            return None if codes is None else {"first": codes[0], "last": codes[1], "unit": "frame", "rate": scene.fps}
        if scene.duration:
            return {"first": 0.0, "last": scene.duration, "unit": "s", "rate": 1.0}
        return None


def import_readers(path: Path) -> None:
    """Import the reader of USD stages, if a scene file or folder may need it; call it before threads start.

    The first import of pxr beside other threads can deadlock: it runs tasks on threads of its own while it holds Python's lock.
    """
    suffix = path.suffix.lower()
    if path.is_dir() or suffix in file_types.USD or (suffix in file_types.SCENE and "usd" in (read_text(path) or "")):
        import_usd()


def import_usd() -> None:
    """Import the reader of USD stages; call it in the main thread."""
    from ..compiler.importers.usd import load  # noqa: F401


def real_path(path: str | Path) -> Path:
    """A full path without links. One whose links go round in a circle stays as it is: Path.resolve raises RuntimeError there."""
    return Path(os.path.realpath(path))


def of_scene(files: Iterable[str | Path], main: Path) -> list[Path]:
    """The files of a scene that the page edits: the main .scene file and those that it uses, without the library."""
    paths = dict.fromkeys([real_path(main), *map(real_path, files)])
    return [path for path in paths if path.suffix.lower() in file_types.SCENE and not path.is_relative_to(LIBRARY)]


def read_text(path: Path) -> str | None:
    """The text of a source file on disk; None if it is missing or not text. Line ends stay as they are."""
    try:
        return text_encoding.decode(read_bytes(path, MAX_SOURCE))
    except (OSError, UnicodeDecodeError):
        return None


def digest(text: str | None) -> str:
    """A short identifier of a text."""
    return "" if text is None else hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=12).hexdigest()


def fingerprint(files: Iterable[Path], texts: Mapping[str, str]) -> tuple[Any, ...]:
    """A value that changes with the contents that a scene is compiled from: texts of sources, time and size of other files."""
    digests: list[Any] = []
    for path in files:
        if path.suffix.lower() in file_types.SCENE:
            digests.append((str(path), digest(texts.get(str(path), read_text(path)))))
            continue
        try:
            status = path.stat()
        except OSError:
            digests.append((str(path), None))
        else:
            digests.append((str(path), status.st_mtime_ns, status.st_size, status.st_ino))
    return tuple(digests)


def changed_since(moment: int, path: Path) -> bool:
    """Whether a file was changed after `moment`, nanoseconds since 1970."""
    try:
        return path.stat().st_mtime_ns > moment
    except OSError:
        return False


def diagnostics_json(diagnostics: Iterable[Diagnostic], texts: Mapping[str, str]) -> list[dict[str, Any]]:
    """Diagnostics for a page, sorted: the parts, and the text with source line, carets and fix. `texts` are unsaved, by path."""
    cache: dict[str, str | None] = {}

    def source(name: str) -> str | None:
        if name not in cache:
            cache[name] = texts.get(resolved(name) or "", None) or source_text(name)
        return cache[name]

    return [
        {"severity": d.severity, "message": d.message, "hint": d.hint, "text": render_text(d, source), "place": place(d.span)}
        for d in sort_diagnostics(diagnostics)[:MAX_SHOWN]
    ]


def place(span: Span | None) -> dict[str, Any] | None:
    """A source position for a page; `path` is that of the file, if it is one."""
    if span is None:
        return None
    return {
        "name": str(span), "path": resolved(span.file), "line": span.line, "column": span.column, "end_line": span.end_line,
        "end_column": span.end_column,
    }  # fmt: skip


def resolved(name: str) -> str | None:
    """The path of a displayed file name; None if it is not a file's."""
    try:
        path = Path(name)
        return str(real_path(path)) if path.suffix else None
    except (OSError, ValueError, RuntimeError):
        return None
