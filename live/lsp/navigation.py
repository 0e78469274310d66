"""Hover, signature help, definition, references, rename and symbols."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from lsprotocol import types

from ...compiler.catalogue import CATALOGUE
from ...lang.diagnostics import Span
from ...lang.eval import builtins
from ...lang.eval.lint import RESERVED
from ...lang.eval.modules import is_asset
from ...lang.reference_page import sentence
from ...lang.schema.argument_types import TYPES
from ...lang.syntax import ast
from ...lang.syntax.lexer import KEYWORDS
from . import cursor, describe
from .document import DefinitionSite, Document, Placed, touching
from .names import contains
from .places import Places
from .project import Project, folder_of

SYMBOLS = {"use": types.SymbolKind.Module, "param": types.SymbolKind.Property}


class RenameError(ValueError):
    """A rename that would change the meaning of the scene. The text says why."""


@dataclass(frozen=True, slots=True)
class Target:
    """What a place means: a definition, an argument of an element, or a name of the language; and its range there."""

    span: Span
    site: DefinitionSite | None = None
    callee: describe.Callee | None = None
    argument: describe.Parameter | None = None
    name: str = ""
    is_type: bool = False  # of a param or a parameter


def target(project: Project, document: Document, line: int, column: int) -> Target | None:
    """What stands at a place; None for numbers, keywords and blanks."""
    for placed in document.placed_at(line):
        result = _in_piece(project, document, placed, line - placed.above, column)
        if result is not None:
            return result
    return None


def _in_piece(project: Project, document: Document, placed: Placed, line: int, column: int) -> Target | None:
    names = placed.piece.names
    for definition in names.definitions:
        if contains(definition.span, line, column):
            return Target(placed.span(definition.span), DefinitionSite(document, placed, definition), name=definition.name)
    for call in names.calls:
        for argument in call.arguments:
            if argument.name is not None and contains(argument.name.span, line, column):
                return _argument(project, document, placed, call, argument.name)
    for node, _ in names.members:
        if contains(node.name.span, line, column):
            located = project.member(document, placed, node)
            return Target(placed.span(node.name.span), located, name=node.name.id) if located else None
    used = touching([*(name for name, _ in names.bound), *names.free], line, column)
    if used is not None:
        span = placed.span(used.span)
        located = document.resolve(placed, used)
        if located is None and used.id not in CATALOGUE and used.id not in builtins.FUNCTIONS:
            located = project.prelude(used.id)
        return Target(span, located, None if located else describe.of_name(used.id, "", {}, project), name=used.id)
    kind = touching(names.types, line, column)
    return Target(placed.span(kind.span), name=kind.id, is_type=True) if kind else None


def _argument(project: Project, document: Document, placed: Placed, call: ast.Call, name: ast.Name) -> Target | None:
    """The parameter that a named argument means."""
    span, located = placed.span(name.span), project.called(document, placed, call.function)
    if located is None:
        callee = describe.of_name(call.function.id, "", {}, project) if isinstance(call.function, ast.Name) else None
        entry = CATALOGUE.get(callee.name) if callee else None
        arg = entry.arg(name.id) if entry else None
        chosen = callee.parameter(arg.name) if callee and arg else None
        return Target(span, None, callee, chosen, name.id) if chosen else None
    parameter = parameter_of(located, name.id, project)
    return Target(span, parameter, name=name.id) if parameter else None


def parameter_of(located: DefinitionSite, name: str, project: Project) -> DefinitionSite | None:
    """The definition of a parameter of a part, or of a `param` of a used file."""
    node = located.definition.node
    if isinstance(node, ast.Let):
        parameters = [p for p in node.parameters or () if p.name.id == name]
        matching = [d for d in located.placed.piece.names.definitions if parameters and d.node is parameters[0]]
        return DefinitionSite(located.document, located.placed, matching[0]) if matching else None
    if isinstance(node, ast.Use):
        used = project.used(located.document, node)
        param = used.top.get(name) if used else None
        return param if param and isinstance(param.definition.node, ast.Param) else None
    return None


def hover(places: Places, document: Document, position: types.Position, values: Mapping[str, str]) -> types.Hover | None:
    """Docs of what stands at a place. `values` are those of the file's names at the top level."""
    line, column = places.place(document, position)
    symbol = target(places.project, document, line, column)
    if symbol is None:
        return None
    if symbol.argument is not None:
        text = symbol.argument.markdown
    elif symbol.site is not None:
        top = symbol.site.document is document and document.top.get(symbol.name)
        is_own = top and top.key == symbol.site.key
        text = describe.of_found(symbol.site, places.project, values.get(symbol.name, "") if is_own else "")
        if symbol.site.document is not document:
            text += f"\n\nIn `{_shown(symbol.site.document.path, document)}`"
    elif symbol.callee is not None:
        text = describe.of_callee(symbol.callee)
    elif symbol.name in (TYPES if symbol.is_type else describe.CONSTANTS):
        text = f"`{symbol.name}`: {TYPES[symbol.name]}." if symbol.is_type else describe.CONSTANTS[symbol.name]
    else:
        return None
    return types.Hover(types.MarkupContent(types.MarkupKind.Markdown, text), places.within(document, symbol.span))


def _shown(path: str, document: Document) -> str:
    return path if path.startswith("std/") else os.path.relpath(path, folder_of(document.path))


def signature_help(places: Places, document: Document, position: types.Position) -> types.SignatureHelp | None:
    """The parameters of the call that a place is in."""
    line, column = places.place(document, position)
    for call in cursor.read(document, line, column).calls[:1]:
        callee = describe.of_name(call.name, call.owner, document.visible(line, column), places.project)
        if callee is None:
            return None
        chosen = callee.parameter(call.argument) if call.argument else None
        index = callee.parameters.index(chosen) if chosen else call.index
        count = len(callee.parameters)
        active = min(index, count - 1) if callee.variadic else index if index < count else None
        shown = [
            types.ParameterInformation(p.text, types.MarkupContent(types.MarkupKind.Markdown, sentence(p.doc)) if p.doc else None)
            for p in callee.parameters
        ]
        doc = types.MarkupContent(types.MarkupKind.Markdown, callee.doc) if callee.doc else None
        return types.SignatureHelp([types.SignatureInformation(callee.signature, doc, shown)], 0, active)
    return None


def definition(places: Places, document: Document, position: types.Position) -> types.Location | None:
    """Where a name is defined. Of a `use`, the file."""
    line, column = places.place(document, position)
    for placed in document.placed_at(line):
        for each in placed.piece.names.top.values():
            node = each.node
            if isinstance(node, ast.Use) and contains(node.path.span, line - placed.above, column):
                return _file(places, document, node)
    symbol = target(places.project, document, line, column)
    if symbol is None or symbol.site is None:
        return None
    return types.Location(places.project.uri(symbol.site.document.path), places.within(symbol.site.document, symbol.site.span))


def _file(places: Places, document: Document, use: ast.Use) -> types.Location | None:
    start = types.Range(types.Position(0, 0), types.Position(0, 0))
    used = places.project.used(document, use)
    if used is not None:
        return types.Location(places.project.uri(used.path), start)
    path = os.path.realpath(folder_of(document.path) / use.path.value)
    return types.Location(places.project.uri(path), start) if is_asset(use.path.value) and os.path.isfile(path) else None


def uses(project: Project, document: Document, located: DefinitionSite) -> Iterator[Span]:
    """The spans in `document` that mean a definition, without the definition itself."""
    wanted = located.definition
    for placed in document.placed:
        if placed.stale:
            continue
        names = placed.piece.names
        for name in (*(name for name, _ in names.bound), *names.free):
            if name.id == wanted.name:
                means = document.resolve(placed, name)
                if means is not None and means.key == located.key:
                    yield placed.span(name.span)
        for node, _ in names.members:
            if node.name.id == wanted.name:
                means = project.member(document, placed, node)
                if means is not None and means.key == located.key:
                    yield placed.span(node.name.span)
        for call in names.calls:
            for argument in call.arguments:
                if argument.name is not None and argument.name.id == wanted.name:
                    called = project.called(document, placed, call.function)
                    means = parameter_of(called, wanted.name, project) if called else None
                    if means is not None and means.key == located.key:
                        yield placed.span(argument.name.span)


def references(places: Places, document: Document, position: types.Position, declaration: bool) -> list[types.Location]:
    """The uses of a definition in its file and in the files beside the document."""
    symbol = target(places.project, document, *places.place(document, position))
    if symbol is None or symbol.site is None:
        return []
    declared = symbol.site
    located = [(declared.document, declared.span)] if declaration else []
    documents = {d.path: d for d in (declared.document, document, *places.project.beside(document.path))}
    for each in documents.values():
        located += [(each, span) for span in uses(places.project, each, declared)]
    return [types.Location(places.project.uri(d.path), places.within(d, span)) for d, span in located]


def highlights(places: Places, document: Document, position: types.Position) -> list[types.DocumentHighlight]:
    """The places of this file that mean what stands at a place."""
    symbol = target(places.project, document, *places.place(document, position))
    if symbol is None or symbol.site is None:
        return []
    spans = [symbol.site.span] if symbol.site.document is document else []
    return [types.DocumentHighlight(places.within(document, s)) for s in (*spans, *uses(places.project, document, symbol.site))]


def renamed(project: Project, document: Document, line: int, column: int) -> Target:
    """The definition that a rename at a place changes. Raises RenameError if it cannot be renamed."""
    if document.failed:
        raise RenameError("the file has syntax errors: mend them first")
    if document.unparsed:
        raise RenameError(f"the file is too large to rename in: its uses from line {document.unparsed} on are not known")
    symbol = target(project, document, line, column)
    if symbol is None or symbol.site is None:
        raise RenameError("there is no name of this file here")
    if symbol.site.document is not document:
        raise RenameError(f"`{symbol.name}` is defined in another file, {_shown(symbol.site.document.path, document)}")
    return symbol


def rename(places: Places, document: Document, position: types.Position, new: str) -> types.WorkspaceEdit:
    """The edits that rename a definition and its uses in this file. Raises RenameError if the scene would change its meaning."""
    project = places.project
    symbol = renamed(project, document, *places.place(document, position))
    declared = symbol.site
    assert declared is not None
    if not new.isidentifier() or new in KEYWORDS or new in RESERVED:
        raise RenameError(f"`{new}` cannot be a name")
    for other in project.beside(document.path):
        if other.path != document.path and any(uses(project, other, declared)):
            raise RenameError(f"`{declared.definition.name}` is used by {_shown(other.path, document)} as well")
    node = declared.definition.node
    spans = [*uses(project, document, declared)]
    texts = [(span, new) for span in spans]
    if isinstance(node, ast.Use) and node.alias is None:
        end = declared.placed.span(node.path.span)
        texts.append((Span(end.file, end.end_line, end.end_column, end.end_line, end.end_column), f" as {new}"))
    else:
        texts.append((declared.span, new))
    _check_rename(document, texts, new)
    edits = [types.TextEdit(places.within(document, span), text) for span, text in texts]
    return types.WorkspaceEdit(changes={project.uri(document.path): edits})


def _check_rename(document: Document, texts: list[tuple[Span, str]], new: str) -> None:
    """Raise RenameError unless each name means the same definition after the edits."""
    lines = [*document.lines]
    for span, text in sorted(texts, key=lambda each: (each[0].line, each[0].column), reverse=True):
        row = lines[span.line - 1]
        lines[span.line - 1] = row[: span.column - 1] + text + row[span.end_column - 1 :]
    if _meanings(Document(document.path, "\n".join(lines))) != _meanings(document):
        raise RenameError(f"`{new}` is the name of something else here")


def _meanings(document: Document) -> list[tuple[int, ...]]:
    """For each used name, in order, the number of its definition, or -1; and how often each definition is made."""
    numbers: dict[tuple[str, int, int], int] = {}
    for placed in document.placed:
        for each in placed.piece.names.definitions:
            numbers[DefinitionSite(document, placed, each).key] = len(numbers)
    rows = []
    for placed in document.placed:
        names = placed.piece.names
        used = sorted([*(name for name, _ in names.bound), *names.free], key=lambda name: (name.span.line, name.span.column))
        means = [document.resolve(placed, name) for name in used]
        rows.append(tuple(numbers.get(m.key, -1) if m else -1 for m in means))
    tops = {name: numbers[each.key] for name, each in document.top.items()}
    return [*rows, tuple(tops.values())]


def symbols(places: Places, document: Document) -> list[types.DocumentSymbol]:
    """The items at the top level of a file; those of an earlier text where the text does not parse."""
    outline = []
    for name, each in document.top.items():
        node = each.definition.node
        part = isinstance(node, ast.Let) and node.parameters is not None
        kind = types.SymbolKind.Function if part else SYMBOLS.get(each.definition.kind, types.SymbolKind.Variable)
        full_range, name_range = places.within(document, each.placed.span(node.span)), places.within(document, each.span)
        start, name_start = full_range.start, name_range.start
        if (name_start.line, name_start.character) < (start.line, start.character) or name_range.end.line > full_range.end.line:
            name_range = full_range
        outline.append(types.DocumentSymbol(name, kind, full_range, name_range))
    return sorted(outline, key=lambda symbol: (symbol.range.start.line, symbol.range.start.character))
