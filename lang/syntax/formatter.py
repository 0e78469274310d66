"""Lays a scene out in the standard way: what was written, each line where it belongs. No token and no comment changes.

Line breaks are the writer's, but that a block of several lines begins behind its `{` and ends with a `}` on a line of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile

from lark import Token

from ..diagnostics import Diagnostics
from .lexer import CLOSERS, KEYWORDS, OPENERS, OPERATORS, grammar
from .line_joining import GOES_ON
from .parser import parse

INDENT = 2
# Behind one of these an operand is to come: a `-` is a sign, a `|` begins the parameters of a function.
_BEFORE_OPERANDS = OPERATORS | KEYWORDS | frozenset(("(", "[", "{", ",", "=", ":"))
_TIGHT = frozenset((".", ".."))


@dataclass(slots=True)
class _Line:
    tokens: list[Token] = field(default_factory=list)
    comment: str = ""
    blank: bool = False  # an empty line above it
    indent: int = 0
    code: str = ""


@dataclass(slots=True)
class _Level:
    """The file, or what a bracket holds."""

    items: bool  # rather than arguments or the elements of a list
    inside: int  # indentation of its lines
    closer: int  # and of the line that closes it
    last: int  # of the last line that began in it


def format_text(text: str, name: str, diagnostics: Diagnostics) -> str | None:
    """`text` laid out, of file `name`. None where it has syntax errors, which are then in `diagnostics`. Laid out twice it is the same."""
    found = Diagnostics()
    parse(text, name, found)
    diagnostics.items.extend(found.items)
    if found.failed:
        return None
    lines = _lines(list(grammar().lex(text.removeprefix("\ufeff"))))
    _indent(lines)
    _spell(lines)
    return "".join(_written(lines))


# --- which line a token is on -----------------------------------------------------------------------------------------


def _lines(tokens: list[Token]) -> list[_Line]:
    lines = [_Line()]
    wide = _blocks_of_lines(tokens)
    for i, token in enumerate(tokens):
        here = lines[-1]
        if token.type == "_NL":
            if "\n" in token:
                lines.append(_Line(blank=token.count("\n") > 1 and bool(here.tokens or here.comment)))
            elif here.tokens and i + 1 < len(tokens) and tokens[i + 1].type != "COMMENT" and tokens[i + 1] != "}":
                here.tokens.append(token)
        elif token.type == "COMMENT":
            here.comment = token.rstrip()
        else:
            opened = bool(here.tokens) and _place(here.tokens[-1]) in wide and here.tokens[-1] == "{"
            if opened or (here.tokens and token == "}" and _place(token) in wide):
                _without_separator(here)
                lines.append(_Line())
            lines[-1].tokens.append(token)
    lines = [line for line in lines if line.tokens or line.comment]
    for above, line in zip([None, *lines], lines, strict=False):
        _without_separator(line)
        if above is None or above.tokens[-1:] == ["{"] or line.tokens[:1] == ["}"]:
            line.blank = False
    return lines


def _without_separator(line: _Line) -> None:
    if line.tokens and line.tokens[-1].type == "_NL":
        line.tokens.pop()


def _blocks_of_lines(tokens: list[Token]) -> set[int | None]:
    """Where the braces of blocks are that go over several lines."""
    stack: list[Token] = []
    wide: set[int | None] = set()
    for token in tokens:
        if token in OPENERS:
            stack.append(token)
        elif token in CLOSERS:
            opened = stack.pop()
            if opened == "{" and opened.line != token.line:
                wide |= {_place(opened), _place(token)}
    return wide


def _place(token: Token) -> int | None:
    return token.start_pos


# --- how far in a line begins -----------------------------------------------------------------------------------------


def _indent(lines: list[_Line]) -> None:
    levels = [_Level(True, 0, 0, 0)]
    above: Token | None = None  # the last token above
    for line in lines:
        if line.tokens and line.tokens[0] in CLOSERS:
            line.indent = levels[-1].closer
        else:
            line.indent = levels[-1].last = _beginning(line, above, levels[-1])
        for token in line.tokens:
            if token in OPENERS:
                base = levels[-1].last
                levels.append(_Level(token == "{", base + INDENT, base, base))
            elif token in CLOSERS:
                levels.pop()
            above = token


def _beginning(line: _Line, above: Token | None, level: _Level) -> int:
    """Where a line begins that closes nothing: further in where it goes on with an item."""
    if not level.items:
        return level.inside
    if line.tokens[:1] == ["else"]:
        return level.last if above == "}" else level.inside + INDENT
    return level.inside + (INDENT if above in GOES_ON else 0)


# --- what stands between tokens ---------------------------------------------------------------------------------------


def _spell(lines: list[_Line]) -> None:
    before: Token | None = None
    operand = True  # one is to come: a `-` is a sign, a `|` begins the parameters of a function
    tight = True  # nothing is to stand between `before` and what follows
    for line in lines:
        for token in line.tokens:
            opens = token == "|" and operand
            if token is not line.tokens[0]:
                line.code += _between(before, token, operand, tight, closes=token == "|" and not operand)
            line.code += ";" if token.type == "_NL" else token
            tight = token in _TIGHT or token in ("(", "[") or opens or (token == "-" and operand)
            operand = token in _BEFORE_OPERANDS or token.type == "_NL" or (token == "|" and not opens)
            before = token


def _between(before: Token | None, token: Token, operand: bool, tight: bool, closes: bool) -> str:
    if tight or closes or token in _TIGHT or token in (")", "]", ",", ":") or token.type == "_NL":
        return ""
    if before == "{" and token == "}":
        return ""
    if token in ("(", "[") and not operand and before != "}":
        return ""
    return "  " if token.type == "STRING" and not operand else " "  # what a param is for


def _written(lines: list[_Line]) -> Iterator[str]:
    """The lines as text. Comments behind lines that follow each other begin in one column."""
    column = 0
    for i, line in enumerate(lines):
        if line.blank:
            yield "\n"
        line_text = " " * line.indent + line.code
        if line.tokens and line.comment:
            column = 0 if line.blank else column
            column = column or _comment_column(lines[i:])
            yield f"{line_text:{column}}{line.comment}\n"
        else:
            column = 0
            yield f"{line_text}{line.comment}\n"


def _comment_column(lines: list[_Line]) -> int:
    """Where comments behind the first of `lines` and those that follow it directly begin."""
    run = takewhile(lambda line: line.tokens and line.comment and not (line.blank and line is not lines[0]), lines)
    return max(line.indent + len(line.code) for line in run) + 2
