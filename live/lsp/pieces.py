"""A source cut into pieces, each some items of the file: an edit parses only the piece that it changes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from ...lang.diagnostics import Diagnostics
from ...lang.syntax import ast
from ...lang.syntax.line_joining import CONTINUED_AFTER
from ...lang.syntax.parser import parse
from .names import Names, names_of

_SCAN = re.compile(r'"(?:\\.|[^"\\\n])*"?|//[^\n]*|[()\[\]{}]|\n')
_STARTS = re.compile(r"(?!(?:else|then|and|or|in|as)\b)[A-Za-z_]|//")
_ITEM = re.compile(r"(?:let|param|use|unit)\s")
_LAST = re.compile(r"(\.\.|[<>=!]=|[A-Za-z_]\w*|[^\s\w])\s*$")


@dataclass(eq=False, slots=True)
class Piece:
    """A parsed piece. With syntax errors, `file` lacks items."""

    text: str
    file: ast.File
    names: Names
    errors: int  # of syntax

    @property
    def failed(self) -> bool:
        """Whether the piece has syntax errors."""
        return self.errors > 0


@lru_cache(maxsize=16384)
def piece(text: str) -> Piece:
    """The piece with this text, parsed once."""
    mistakes = Diagnostics()
    file = parse(text, "", mistakes)
    return Piece(text, file, names_of(file), sum(d.severity == "error" for d in mistakes.items))


def cut(text: str) -> Iterator[tuple[int, str]]:
    """(number of lines above, text) of each piece.

    A piece begins at an unindented line outside all brackets. In a text with unbalanced brackets it also begins at an unindented
    `let`, `param`, `use` or `unit`, so that an open bracket does not hide the rest of the file.
    """
    lines = text.split("\n")
    depths = _depths(text, len(lines))
    balanced = depths[-1] == 0 and min(depths) >= 0
    first, base = 0, 0
    for i in range(1, len(lines)):
        line = lines[i]
        if not _STARTS.match(line) or _follows(lines, i, first):
            continue
        if depths[i] == base or (not balanced and _ITEM.match(line)):
            yield first, "\n".join([*lines[first:i], ""])
            first, base = i, depths[i]
    yield first, "\n".join(lines[first:])


def begins_definition(text: str) -> bool:
    """Whether a piece begins with `let`, `param`, `use` or `unit`, after comments."""
    return next((_ITEM.match(line) is not None for line in text.split("\n") if _code(line)), False)


def _depths(text: str, count: int) -> list[int]:
    """The number of open brackets at the start of each line."""
    depths, depth = [0], 0
    for match in _SCAN.finditer(text):
        mark = match[0]
        if mark == "\n":
            depths.append(depth)
        elif mark in "([{":
            depth += 1
        elif mark in ")]}":
            depth -= 1
    return depths[:count] + [depth]


def _follows(lines: list[str], i: int, first: int) -> bool:
    """Whether line `i` belongs to the lines above: comments and annotations, or an expression that continues."""
    above = lines[i - 1]
    if above.startswith("//"):
        return True
    k = i - 1
    while k >= first and not (code := _code(lines[k])):
        k -= 1
    if k < first:
        return False
    last = _LAST.search(code)
    return last is not None and last[1] in CONTINUED_AFTER


def _code(line: str) -> str:
    """A line without its comment and the spaces around."""
    for match in _SCAN.finditer(line):
        if match[0].startswith("//"):
            return line[: match.start()].strip()
    return line.strip()
