"""Completion: arguments, names, elements, functions, members of used files, choices and names of files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from lsprotocol import types

from ...compiler.catalogue import CATALOGUE
from ...compiler.io.sandbox import LIBRARY
from ...lang import file_types, units
from ...lang.eval import builtins, parameters
from ...lang.reference_page import sentence, signature
from . import cursor, describe
from .describe import Callee
from .document import DefinitionSite, Document
from .places import Places
from .project import files_in, folder_of

Kind = types.CompletionItemKind
PICTURES = (".png", ".jpg", ".jpeg", ".exr", ".hdr", ".tif", ".tiff")
FILES = {  # of the string arguments that name a file
    ("image", "file"): PICTURES, ("dome", "file"): PICTURES, ("heightfield", "heights"): PICTURES,
    ("mesh", "file"): file_types.MESH, ("usd", "file"): file_types.USD, ("text", "font"): file_types.FONT,
}  # fmt: skip
ITEMS = ("let", "param", "use", "unit", "for", "if")
WORDS = ("if", "then", "else", "and", "or", "not", "for", "in")
KINDS = {"let": Kind.Variable, "param": Kind.Variable, "use": Kind.Module, "parameter": Kind.Variable, "loop": Kind.Variable}


@dataclass(frozen=True, slots=True)
class _Request:
    places: Places
    document: Document
    line: int
    column: int
    cursor: cursor.Cursor

    @property
    def names(self) -> dict[str, DefinitionSite]:
        return self.document.visible(self.line, self.column)


def complete(places: Places, document: Document, position: types.Position) -> list[types.CompletionItem]:
    """What can be written at a place."""
    line, column = places.place(document, position)
    request = _Request(places, document, line, column, cursor.read(document, line, column))
    cursor_position = request.cursor
    if cursor_position.comment:
        return []
    if cursor_position.string is not None:
        return [*_strings(request)]
    if cursor_position.after == ".":
        return [*_members(request)]
    if cursor_position.after == "unit":
        lengths = dict.fromkeys(u for u, (_, d) in units.UNITS.items() if d == units.LENGTH and u.isascii() and u != "in")
        return [types.CompletionItem(unit, kind=Kind.Unit) for unit in lengths]
    if cursor_position.after in ("let", "param", "use", "as"):
        return []
    if _declares(request):
        return [types.CompletionItem(name, kind=Kind.TypeParameter) for name in parameters.TYPES]
    return [*_arguments(request), *_names(request)]


def _declares(request: _Request) -> bool:
    """Whether a type of a param is written: `param name: …`."""
    row = request.document.lines[request.line - 1][: request.column - 1].split()
    return request.cursor.after == ":" and row[:1] == ["param"] and len(row) < 4


def _callee(request: _Request) -> tuple[cursor.Call, Callee] | None:
    for call in request.cursor.calls[:1]:
        callee = describe.of_name(call.name, call.owner, request.names, request.places.project)
        if callee is not None:
            return call, callee
    return None


def _arguments(request: _Request) -> Iterator[types.CompletionItem]:
    called = _callee(request)
    if called is None:
        return
    call, callee = called
    if request.cursor.after in ("(", ",") and not call.argument and callee.kind != "function":
        for p in callee.parameters:
            if p.name not in call.argument_names:
                yield types.CompletionItem(
                    p.name, kind=Kind.Property, detail=p.text, documentation=_markdown(p.markdown), insert_text=f"{p.name}: ",
                    sort_text=f"0{p.name}",
                )  # fmt: skip
    chosen = callee.parameter(call.argument) if call.argument else None
    if request.cursor.after == ":" and chosen is not None:
        for choice in chosen.choices:
            yield types.CompletionItem(f'"{choice}"', kind=Kind.EnumMember, sort_text=f"0{choice}")


def _names(request: _Request) -> Iterator[types.CompletionItem]:
    project, seen = request.places.project, set()
    prelude = project.document("std/prelude")
    for names in (request.names, prelude.top if prelude else {}):
        for name, definition in names.items():
            if name not in seen:
                seen.add(name)
                yield _definition(name, definition, request, "1" if names is not (prelude and prelude.top) else "2")
    for entry in CATALOGUE.values():
        if entry.name not in seen and not entry.planned:
            yield types.CompletionItem(
                entry.name, kind=Kind.Class, detail=entry.category, documentation=_markdown(sentence(entry.doc)), sort_text=f"2{entry.name}"
            )
    for function in builtins.FUNCTIONS.values():
        if function.name not in seen:
            doc = _markdown(sentence(function.doc))
            yield types.CompletionItem(
                function.name, kind=Kind.Function, detail=signature(function), documentation=doc, sort_text=f"2{function.name}"
            )
    for name, doc in describe.CONSTANTS.items():
        if name not in seen:
            yield types.CompletionItem(name, kind=Kind.Constant, documentation=_markdown(doc), sort_text=f"2{name}")
    row = request.document.lines[request.line - 1][: request.column - 1].strip()
    for word in ITEMS if row == request.cursor.word else WORDS:
        yield types.CompletionItem(word, kind=Kind.Keyword, sort_text=f"3{word}")


def _definition(name: str, definition: DefinitionSite, request: _Request, order: str) -> types.CompletionItem:
    callee = describe.of_definition(definition, request.places.project)
    kind = KINDS[definition.definition.kind]
    part = callee is not None and callee.kind == "part"
    detail = callee.signature if callee is not None and part else definition.definition.kind
    doc = describe.of_found(definition, request.places.project)
    return types.CompletionItem(
        name, kind=Kind.Function if part else kind, detail=detail, documentation=_markdown(doc), sort_text=f"{order}{name}"
    )


def _members(request: _Request) -> Iterator[types.CompletionItem]:
    used = describe.used_file(request.cursor.owner, request.names, request.places.project)
    for name, definition in used.top.items() if used else ():
        if definition.definition.kind in ("let", "param"):
            yield _definition(name, definition, request, "0")


def _strings(request: _Request) -> Iterable[types.CompletionItem]:
    position = request.cursor
    if position.use:
        library = sorted(f"std/{path.stem}" for path in LIBRARY.glob("*.scene") if path.stem != "prelude")
        endings = (*file_types.SCENE, *file_types.USD, *file_types.MESH)
        names = [*library, *(name for name in _files(request, endings) if not _is_self(request.document, name))]
        return [_string(request, name, Kind.Module if name in library else Kind.File) for name in names]
    called = _callee(request)
    if called is None:
        return []
    call, callee = called
    positional = [p for p in callee.parameters if not p.keyword]
    chosen = callee.parameter(call.argument) if call.argument else positional[call.index] if call.index < len(positional) else None
    if chosen is None:
        return []
    if chosen.choices:
        return [_string(request, choice, Kind.EnumMember) for choice in chosen.choices]
    suffixes = FILES.get((callee.name, chosen.name), ()) if callee.kind == "element" else ()
    return [_string(request, name, Kind.File) for name in _files(request, suffixes)]


def _is_self(document: Document, name: str) -> bool:
    return os.path.realpath(folder_of(document.path) / name) == document.path


def _files(request: _Request, suffixes: tuple[str, ...]) -> list[str]:
    """The files of these kinds in the document's folder and the folders in it, relative to it."""
    if request.document.path.startswith("std/") or not suffixes:
        return []
    return files_in(folder_of(request.document.path), suffixes)


def _string(request: _Request, name: str, kind: types.CompletionItemKind) -> types.CompletionItem:
    """An item that replaces the part of the string before the cursor."""
    places, document, line, column = request.places, request.document, request.line, request.column
    start = places.position(document, line, column - len(request.cursor.string or ""))
    edit = types.TextEdit(types.Range(start, places.position(document, line, column)), name)
    return types.CompletionItem(name, kind=kind, text_edit=edit)


def _markdown(text: str) -> types.MarkupContent:
    return types.MarkupContent(types.MarkupKind.Markdown, text)
