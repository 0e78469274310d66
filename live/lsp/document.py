"""A source file as the server knows it: its text, its pieces, and what stands at a place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, takewhile

from ...lang.diagnostics import Span
from ...lang.syntax import ast
from .names import Definition, contains
from .pieces import Piece, cut, piece


@dataclass(frozen=True, slots=True)
class Placed:
    """A piece `above` lines below the start of the file. `stale`: of an earlier text, in place of one that does not parse."""

    above: int
    last: int  # number of its last line
    piece: Piece
    stale: bool = False

    def span(self, span: Span) -> Span:
        """A span of the piece as one of the file, clipped to the piece's lines."""
        line = min(span.line + self.above, self.last)
        return replace(span, line=line, end_line=min(span.end_line + self.above, self.last))


@dataclass(frozen=True, slots=True)
class DefinitionSite:
    """A definition with the document and the piece that hold it."""

    document: Document
    placed: Placed
    definition: Definition

    @property
    def key(self) -> tuple[str, int, int]:
        """Equal for the same definition of the same file. Equal pieces share their definitions."""
        return self.document.path, self.placed.above, id(self.definition)

    @property
    def span(self) -> Span:
        return self.placed.span(self.definition.span)


MAX_PARSED = 100_000  # characters of a file that are parsed for requests: an answer waits for their parser


class Document:
    """The text of a file at `path`, which identifies it: an absolute path, or `std/room`. Immutable."""

    def __init__(self, path: str, text: str, before: Document | None = None) -> None:
        """`before` is the last document of the file: it stands in for pieces that do not parse.

        Pieces after the first MAX_PARSED characters are left out.
        """
        self.path = path
        self.text = text.replace("\r\n", "\n").replace("\r", "\n")
        self.lines = self.text.split("\n")
        parts = [*cut(self.text)]
        ends = [above for above, _ in parts[1:]] + [len(self.lines)]
        sizes = accumulate(len(part) for _, part in parts)
        count = sum(1 for _ in takewhile(lambda size: size <= MAX_PARSED, sizes))
        self.unparsed = parts[count][0] + 1 if count < len(parts) else 0  # first line that no request knows; 0: it knows all
        self.placed = [Placed(above, end, piece(part)) for (above, part), end in zip(parts[:count], ends[:count], strict=True)]
        self.failed = any(each.piece.failed for each in self.placed)
        self.good: list[Placed] = self.placed
        if self.failed:
            self.good = before.good if before is not None else [each for each in self.placed if not each.piece.failed]
            self.placed = [*self.placed, *self._stale()]

    def _stale(self) -> Iterator[Placed]:
        """The pieces of the last good text that this text has replaced, at the lines of those that replace them."""
        good, now = self.good, self.placed
        first = sum(1 for _ in takewhile(lambda pair: pair[0].piece is pair[1].piece, zip(good, now, strict=False)))
        most = min(len(good), len(now)) - first
        ends = zip(reversed(good), reversed(now), strict=False)
        last = min(most, sum(1 for _ in takewhile(lambda pair: pair[0].piece is pair[1].piece, ends)))
        middle = now[first : len(now) - last]
        if not middle:
            return
        for k, old in enumerate(good[first : len(good) - last]):
            place = middle[min(k, len(middle) - 1)]
            yield Placed(place.above, max(place.last, middle[-1].last), old.piece, stale=True)

    @cached_property
    def top(self) -> dict[str, DefinitionSite]:
        """The names of the file's top level."""
        names: dict[str, DefinitionSite] = {}
        for placed in self.placed:
            for name, definition in placed.piece.names.top.items():
                names.setdefault(name, DefinitionSite(self, placed, definition))
        return names

    def placed_at(self, line: int) -> Iterator[Placed]:
        """The pieces at a line, which counts from 1: the current one, then those of earlier texts."""
        return (each for each in self.placed if each.above < line <= each.last)

    def visible(self, line: int, column: int) -> dict[str, DefinitionSite]:
        """All names of the file that are visible at a place."""
        names = dict(self.top)
        for placed in reversed([*self.placed_at(line)]):
            inner = placed.piece.names.visible(line - placed.above, column)
            names |= {name: DefinitionSite(self, placed, definition) for name, definition in inner.items()}
        return names

    def resolve(self, placed: Placed, name: ast.Name) -> DefinitionSite | None:
        """The definition of a used name; None for a name of the language, or an unknown one."""
        local = placed.piece.names.local(name)
        return DefinitionSite(self, placed, local) if local else self.top.get(name.id)

    def word(self, line: int, column: int) -> str:
        """The name that touches a place."""
        row = self.lines[line - 1] if line <= len(self.lines) else ""
        start = end = min(column - 1, len(row))
        while start and (row[start - 1].isalnum() or row[start - 1] == "_"):
            start -= 1
        while end < len(row) and (row[end].isalnum() or row[end] == "_"):
            end += 1
        return row[start:end]

    def source(self, span: Span) -> str:
        """The text of a span of this file."""
        rows = self.lines[span.line - 1 : span.end_line]
        if not rows:
            return ""
        rows[-1] = rows[-1][: span.end_column - 1]
        rows[0] = rows[0][span.column - 1 :]
        return "\n".join(rows)


def touching(nodes: list[ast.Name], line: int, column: int) -> ast.Name | None:
    """The name among `nodes` that touches a place."""
    return next((node for node in nodes if contains(node.span, line, column)), None)
