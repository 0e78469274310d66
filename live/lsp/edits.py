"""Edits: the standard layout, fixes that messages name, and colours."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from lsprotocol import types

from ...compiler.catalogue import CATALOGUE
from ...lang import colors
from ...lang.diagnostics import Diagnostic, Span
from ...lang.eval.builtins import CONSTANTS, FUNCTIONS
from ...lang.syntax.formatter import lay_out
from ...lang.syntax.lexer import lex
from . import messages
from .document import Document
from .pieces import piece
from .places import Places

_NEAR = re.compile(r"did you mean `([^`]+)`\?")
_WRITE = re.compile(r"^write (?:`([^`]+)`|([^;…]+?))(?:; .*)?$")
_PROSE = re.compile(r" (?!or )[a-z]+ |^(?:it|the|each|a|an|its|one|in) |[,;]$| for | its | where | before | instead$")
_AT_END = re.compile(r"^write `([^`]+)` at its end$")

Replacement = tuple[int, int, str]  # first column, column behind the last, new text


def formatted(places: Places, document: Document) -> list[types.TextEdit]:
    """The edit to the standard layout; none for a file with syntax errors, or more than MAX_PARSED characters."""
    text = document.text if document.failed or document.unparsed else lay_out(document.text)
    return [] if text == document.text else [types.TextEdit(places.full_range(document), text)]


def fixes(places: Places, document: Document, diagnostics: Iterable[Diagnostic], within: types.Range) -> Iterator[types.CodeAction]:
    """The fixes that the messages in a range of lines name, as edits."""
    for d in diagnostics:
        span = d.span
        if span is None or not span.line or span.end_line - 1 < within.start.line or span.line - 1 > within.end.line:
            continue
        options = [*replacements(document, d)]
        for column, end, text in options:
            row = document.lines[span.line - 1]
            old = row[column - 1 : end - 1]
            start, stop = places.position(document, span.line, column), places.position(document, span.line, end)
            yield types.CodeAction(
                f"Replace `{old}` by `{text}`" if old else f"Write `{text}`",
                kind=types.CodeActionKind.QuickFix,
                diagnostics=[messages.to_client(d, document.path, places)],
                edit=types.WorkspaceEdit(changes={places.project.uri(document.path): [types.TextEdit(types.Range(start, stop), text)]}),
                is_preferred=len(options) == 1,
            )


def replacements(document: Document, d: Diagnostic) -> Iterator[Replacement]:
    """The fixes that a message names, in the line of its span.

    A name is replaced where the message quotes it. Other spans are replaced as a whole, or with the token beside them, by source text
    alone: hints in prose are left to the reader. A fix of a syntax error makes the piece of the file have fewer of them.
    """
    span = d.span
    if span is None or span.line != span.end_line or span.line > len(document.lines):
        return
    old = document.lines[span.line - 1][span.column - 1 : span.end_column - 1]
    near, end, write = _NEAR.search(f"{d.message} {d.hint}"), _AT_END.match(d.hint), _WRITE.match(d.hint)
    if near:
        options = [[*_quoted(d, old, near[1])]]
    elif end:
        options = [[(span.end_column, span.end_column, end[1])]]
    elif write and old:
        texts = [write[1]] if write[1] else [text for text in write[2].split(" or ") if not _PROSE.search(f"{text} ")]
        options = [[*_widened(document, span, text)] for text in texts if text != old and _is_source(text, document.lines[span.line - 1])]
    else:
        return
    for option in options:
        fixed = next((each for each in option if _mends(document, span.line, each)), None)
        if fixed is not None:
            yield fixed


def _widened(document: Document, span: Span, text: str) -> Iterator[Replacement]:
    """The replacement of a span, of the span twice as for `&&`, and of the span with the token before it as for `1 m`."""
    row = document.lines[span.line - 1]
    old = row[span.column - 1 : span.end_column - 1]
    yield span.column, span.end_column, text
    if row[span.end_column - 1 :].startswith(old):
        yield span.column, span.end_column + len(old), text
    before = re.search(r"[\w.]+\s+$", row[: span.column - 1])
    if before:
        yield before.start() + 1, span.end_column, text


def _mends(document: Document, line: int, fix: Replacement) -> bool:
    """Whether a fix leaves fewer syntax errors in its piece, if there are any, and else makes none."""
    for placed in document.placed_at(line):
        lines = placed.piece.text.split("\n")
        row = lines[line - placed.above - 1]
        lines[line - placed.above - 1] = row[: fix[0] - 1] + fix[2] + row[fix[1] - 1 :]
        return piece("\n".join(lines)).errors < max(placed.piece.errors, 1)
    return False


def _quoted(d: Diagnostic, old: str, new: str) -> Iterator[Replacement]:
    """The replacement of the one word in a span that the message quotes."""
    assert d.span is not None
    for word in re.findall(r"`([^`]+)`", d.message):
        places = [m.start() for m in re.finditer(rf"(?<!\w){re.escape(word)}(?!\w)", old)]
        if len(places) == 1:
            yield d.span.column + places[0], d.span.column + places[0] + len(word), new
            return


def _is_source(text: str, row: str) -> bool:
    """Whether a text is of the language's tokens and names, and of names that its line has: `[x, y, z]` is a pattern."""
    wrong = ("OPEN_STRING", "BLOCK_COMMENT", "HASH_COMMENT", "BAD_COLOR", "UNKNOWN", "_NL", "COMMENT")
    names = {*CATALOGUE, *FUNCTIONS, *CONSTANTS, *re.findall(r"\w+", row)}
    return all(token.type not in wrong and (token.type != "NAME" or token in names) for token in lex(text))


def swatches(places: Places, document: Document) -> list[types.ColorInformation]:
    """The `#rrggbb` colours of a file."""
    colors = []
    for placed in document.placed:
        for node in () if placed.stale else placed.piece.names.colors:
            digits = node.text[1:] if len(node.text) == 7 else "".join(2 * digit for digit in node.text[1:])
            r, g, b = (int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4))
            colors.append(types.ColorInformation(places.within(document, placed.span(node.span)), types.Color(r, g, b, 1.0)))
    return colors


def written(color: types.Color) -> list[types.ColorPresentation]:
    """A chosen colour in the source: encoded in sRGB, and in linear light."""
    codes = [round(255 * min(max(c, 0.0), 1.0)) for c in (color.red, color.green, color.blue)]
    text = "#" + "".join(f"{code:02x}" for code in codes)
    linear = ", ".join(f"{c:.3g}" for c in colors.from_hex(text))
    return [types.ColorPresentation(text), types.ColorPresentation(f"rgb({linear})")]
