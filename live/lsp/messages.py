"""Diagnostics of a file for an editor: the same compiler as `maquette check`, on the texts of the editor."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from lsprotocol import types

from ...compiler import load
from ...compiler.catalogue import CATALOGUE
from ...compiler.io import sandbox
from ...compiler.io.source_files import SceneReader
from ...compiler.mesh import built_geometry
from ...compiler.plan import plan as planner
from ...lang.diagnostics import Diagnostic, Diagnostics, SceneError, Span, sort_diagnostics
from ...lang.eval import evaluator
from ...lang.eval.values import Color, show
from ...lang.syntax import ast
from ...lang.units import Quantity
from .document import MAX_PARSED, Document
from .pieces import begins_definition, cut, piece
from .places import Places

SEVERITIES = {
    "error": types.DiagnosticSeverity.Error,
    "warning": types.DiagnosticSeverity.Warning,
    "note": types.DiagnosticSeverity.Information,
}
SOURCE = "maquette"
MAX_MESSAGES = 200  # for a file
MAX_TEXT = 2000  # characters of a message


@dataclass(frozen=True, slots=True)
class Checked:
    """The result of a check: diagnostics by path of the file, and plain values of names at the top level, as text."""

    path: str
    diagnostics: Mapping[str, tuple[Diagnostic, ...]] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)


def check(path: str, texts: Mapping[str, str], allow: Sequence[Path] = ()) -> Checked:
    """Compile the scene at `path` with these unsaved texts by path. It reads files below its folder and below each of `allow`."""
    diagnostics = Diagnostics()
    with sandbox.unsaved(texts):
        try:
            if places_nothing(path, texts):
                reader = SceneReader(sandbox.Files(Path(path).parent, allow))
                evaluator.evaluate(reader.main(path, Path(path)), CATALOGUE, reader, diagnostics)
            else:
                with built_geometry.left_out():
                    diagnostics.items += planner.default_notes(load.load(Path(path), allow=allow, diagnostics=diagnostics))
            items = diagnostics.items
        except SceneError as error:
            items = list(error.diagnostics)
        except Exception as fault:
            message = f"internal error: {type(fault).__name__}: {fault}"
            items = [Diagnostic("error", message, Span(path), "this is a bug in maquette, not an error in the scene")]
        values = _values(path, allow) if len(items) <= MAX_MESSAGES else {}
    by_file: dict[str, list[Diagnostic]] = {path: []}
    for d in sort_diagnostics(items):
        file = _path(d.span)
        if file is None:
            d = Diagnostic(d.severity, f"{d.span.file}: {d.message}" if d.span else d.message, Span(path), d.hint, d.trace)
        by_file.setdefault(file or path, []).append(d)
    return Checked(path, {file: tuple(each) for file, each in by_file.items()}, values)


def places_nothing(path: str, texts: Mapping[str, str]) -> bool:
    """Whether a file only defines names, for other files: as a scene of its own it would be empty, which is not a mistake.

    Of a file of more than MAX_PARSED characters the first word of each piece tells it.
    """
    text = texts.get(path, "")
    if len(text) > MAX_PARSED:
        return all(begins_definition(part) for _, part in cut(text))
    items = [item for _, part in cut(text) for item in piece(part).file.items]
    return bool(items) and all(isinstance(item, ast.Let | ast.Param | ast.Use | ast.Unit) for item in items)


def _values(path: str, allow: Sequence[Path]) -> dict[str, str]:
    try:
        reader = SceneReader(sandbox.Files(Path(path).parent, allow))
        values = evaluator.values(reader.main(path, Path(path)), CATALOGUE, reader)
    except Exception:
        return {}  # `check` has reported what is wrong
    plain = (bool, int, float, str, Quantity, Color, tuple)
    return {name: f'"{value}"' if isinstance(value, str) else show(value) for name, value in values.items() if isinstance(value, plain)}


def _path(span: Span | None) -> str | None:
    """The path of the .scene file of a span; None for other files."""
    if span is None:
        return None
    if span.in_library:
        return span.file
    return os.path.realpath(span.file) if span.file.endswith(".scene") else None


def merged(checked: Iterable[Checked]) -> dict[str, tuple[Diagnostic, ...]]:
    """The diagnostics of several scenes by file, each once; one without a chain of calls comes before the same with one."""
    by_file: dict[str, dict[tuple[str, str, Span | None], Diagnostic]] = {}
    for each in checked:
        for path, items in each.diagnostics.items():
            unique = by_file.setdefault(path, {})
            for d in items:
                key = d.severity, d.message, d.span
                if key not in unique or not d.trace:
                    unique[key] = d
    return {path: tuple(sort_diagnostics(items.values())) for path, items in by_file.items()}


def of_size(document: Document) -> Iterator[Diagnostic]:
    """The note that requests do not know the end of a large file."""
    if document.unparsed:
        line = document.unparsed
        message = f"completion, hovers, references and layout know the first {MAX_PARSED:,} characters of a file: not those from here on"
        yield Diagnostic("note", message, Span(document.path, line, 1, line, 1), "cut the file into several, which `use` joins")


def to_client(d: Diagnostic, path: str, places: Places) -> types.Diagnostic:
    """A diagnostic for the editor. The hint is the second line of the message, the chain of calls is related information."""
    related = []
    for name, span in d.trace:
        file = _path(span)
        if file is not None:
            location = types.Location(places.project.uri(file), places.range(file, span))
            is_file = name.endswith(".scene") or name.startswith("std/")
            text = f"{os.path.basename(name)} is used here" if is_file else f"in {name}, called here"
            related.append(types.DiagnosticRelatedInformation(location, text))
    text = f"{d.message}\n{d.hint}" if d.hint else d.message
    return types.Diagnostic(
        range=places.range(path, d.span or Span(path)),
        message=text if len(text) <= MAX_TEXT else f"{text[:MAX_TEXT]}…",
        severity=SEVERITIES[d.severity],
        source=SOURCE,
        tags=[types.DiagnosticTag.Unnecessary] if re.search("is never used$", d.message) else None,
        related_information=related or None,
    )
