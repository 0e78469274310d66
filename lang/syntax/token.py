"""Tokens of the language: texts with a kind and a place."""

from __future__ import annotations


class Token(str):
    """The text of a token. Lines and columns count from 1; `end_column` and `end_pos` lie behind the last character."""

    __slots__ = ("column", "end_column", "end_line", "end_pos", "line", "start_pos", "type")

    type: str
    start_pos: int | None
    line: int | None
    column: int | None
    end_line: int | None
    end_column: int | None
    end_pos: int | None

    def __new__(
        cls, kind: str, text: str, start_pos: int | None = None, line: int | None = None, column: int | None = None,
        end_line: int | None = None, end_column: int | None = None, end_pos: int | None = None,
    ) -> Token:  # fmt: skip
        token = super().__new__(cls, text)
        token.type, token.start_pos, token.end_pos = kind, start_pos, end_pos
        token.line, token.column, token.end_line, token.end_column = line, column, end_line, end_column
        return token

    def replaced(self, kind: str, text: str) -> Token:
        """Another token at the same place."""
        return Token(kind, text, self.start_pos, self.line, self.column, self.end_line, self.end_column, self.end_pos)
