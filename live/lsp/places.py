"""Places of the language (lines and columns from 1, in characters) and of the editor (from 0, in its own code units)."""

from __future__ import annotations

from dataclasses import dataclass

from lsprotocol import types
from pygls.workspace import PositionCodec

from ...lang.diagnostics import Span
from .document import Document
from .project import Project


@dataclass(slots=True)
class Places:
    """Converts places of the project's documents. `codec` counts the columns of the editor."""

    project: Project
    codec: PositionCodec

    def position(self, document: Document | None, line: int, column: int) -> types.Position:
        """The editor's position of a place; the start of the file for line 0."""
        if line <= 0:
            return types.Position(0, 0)
        if document is None or line > len(document.lines):
            return types.Position(line - 1, column - 1)
        return types.Position(line - 1, self.codec.client_num_units(document.lines[line - 1][: column - 1]))

    def range(self, path: str, span: Span) -> types.Range:
        """The editor's range of a span in the document at `path`."""
        return self.within(self.project.document(path), span)

    def within(self, document: Document | None, span: Span) -> types.Range:
        """The editor's range of a span in a document. The first line for a span of the whole file."""
        if span.line == 0:
            first = document.lines[0] if document else ""
            return types.Range(types.Position(0, 0), types.Position(0, self.codec.client_num_units(first)))
        start = self.position(document, span.line, span.column)
        return types.Range(start, self.position(document, span.end_line, span.end_column))

    def place(self, document: Document, position: types.Position) -> tuple[int, int]:
        """(line, column) of an editor's position, clipped to the text."""
        if position.line >= len(document.lines):
            return len(document.lines), len(document.lines[-1]) + 1
        row = document.lines[position.line]
        units = 0
        for k, char in enumerate(row):
            if units >= position.character:
                return position.line + 1, k + 1
            units += self.codec.client_num_units(char)
        return position.line + 1, len(row) + 1

    def full_range(self, document: Document) -> types.Range:
        """The range of all the text."""
        return types.Range(types.Position(0, 0), self.position(document, len(document.lines), len(document.lines[-1]) + 1))
