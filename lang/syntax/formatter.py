"""Formatter: sets spaces, indentation and blank lines. Changes no token and no comment.

Line breaks stay, except that a block of several lines begins after its `{` and ends with a `}` on its own line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile

from ..diagnostics import Diagnostics
from .grammar import Token
from .lexer import CLOSERS, KEYWORDS, OPENERS, OPERATORS, lex
from .line_joining import CONTINUED_AFTER
from .parser import parse

INDENT = 2
# An operand follows one of these: a `-` is a sign, a `|` begins the parameters of a function.
_BEFORE_OPERANDS = OPERATORS | KEYWORDS | frozenset(("(", "[", "{", ",", "=", ":"))
_TIGHT = frozenset((".", ".."))


@dataclass(slots=True)
class _Line:
    """A line of output."""

    tokens: list[Token] = field(default_factory=list)
    comment: str = ""
    blank: bool = False  # an empty line precedes it
    indent: int = 0
    code: str = ""


@dataclass(slots=True)
class _Level:
    """The file, or the content of a bracket."""

    items: bool  # holds items, not arguments or list elements
    inside: int  # indentation of its lines
    closer: int  # indentation of the line that closes it
    last: int  # indentation of the last line that begins in it


def format_text(text: str, name: str, diagnostics: Diagnostics) -> str | None:
    """`text` of file `name`, formatted; None for syntax errors, which go into `diagnostics`. Formatting is idempotent."""
    messages = Diagnostics()
    parse(text, name, messages)
    diagnostics.items.extend(messages.items)
    return None if messages.failed else lay_out(text)


def lay_out(text: str) -> str:
    """`text`, which has no syntax errors, formatted."""
    lines = _lines(list(lex(text.removeprefix("\ufeff"))))
    _indent(lines)
    _set_spaces(lines)
    return "".join(_output(lines))


# --- lines ------------------------------------------------------------------------------------------------------------


def _lines(tokens: list[Token]) -> list[_Line]:
    lines = [_Line()]
    wide = _multiline_braces(tokens)
    for i, token in enumerate(tokens):
        current = lines[-1]
        if token.type == "_NL":
            if "\n" in token:
                lines.append(_Line(blank=token.count("\n") > 1 and bool(current.tokens or current.comment)))
            elif current.tokens and i + 1 < len(tokens) and tokens[i + 1].type != "COMMENT" and tokens[i + 1] != "}":
                current.tokens.append(token)
        elif token.type == "COMMENT":
            current.comment = token.rstrip()
        else:
            opened = bool(current.tokens) and _place(current.tokens[-1]) in wide and current.tokens[-1] == "{"
            if opened or (current.tokens and token == "}" and _place(token) in wide):
                _drop_separator(current)
                lines.append(_Line())
            lines[-1].tokens.append(token)
    lines = [line for line in lines if line.tokens or line.comment]
    for above, line in zip([None, *lines], lines, strict=False):
        _drop_separator(line)
        if above is None or above.tokens[-1:] == ["{"] or line.tokens[:1] == ["}"]:
            line.blank = False
    return lines


def _drop_separator(line: _Line) -> None:
    if line.tokens and line.tokens[-1].type == "_NL":
        line.tokens.pop()


def _multiline_braces(tokens: list[Token]) -> set[int | None]:
    """The positions of the braces of blocks that span several lines."""
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


# --- indentation ------------------------------------------------------------------------------------------------------


def _indent(lines: list[_Line]) -> None:
    levels = [_Level(True, 0, 0, 0)]
    above: Token | None = None  # the last token above
    for line in lines:
        if line.tokens and line.tokens[0] in CLOSERS:
            line.indent = levels[-1].closer
        else:
            line.indent = levels[-1].last = _indentation(line, above, levels[-1])
        for token in line.tokens:
            if token in OPENERS:
                base = levels[-1].last
                levels.append(_Level(token == "{", base + INDENT, base, base))
            elif token in CLOSERS:
                levels.pop()
            above = token


def _indentation(line: _Line, above: Token | None, level: _Level) -> int:
    """The indentation of a line that does not begin with a closing bracket; deeper if it continues an item."""
    if not level.items:
        return level.inside
    if line.tokens[:1] == ["else"]:
        return level.last if above == "}" else level.inside + INDENT
    return level.inside + (INDENT if above in CONTINUED_AFTER else 0)


# --- spaces -----------------------------------------------------------------------------------------------------------


def _set_spaces(lines: list[_Line]) -> None:
    before: Token | None = None
    operand = True  # an operand comes next: a `-` is a sign, a `|` begins the parameters of a function
    tight = True  # no space between `before` and the next token
    openers: list[Token] = []
    for line in lines:
        operand = operand or (before not in CONTINUED_AFTER and (not openers or openers[-1] == "{"))  # an item begins
        for token in line.tokens:
            opens = token == "|" and operand
            if token is not line.tokens[0]:
                line.code += _space(before, token, operand, tight, closes=token == "|" and not operand)
            line.code += ";" if token.type == "_NL" else token
            tight = token in _TIGHT or token in ("(", "[") or opens or (token == "-" and operand)
            operand = token in _BEFORE_OPERANDS or token.type == "_NL" or (token == "|" and not opens)
            before = token
            if token in OPENERS:
                openers.append(token)
            elif token in CLOSERS:
                openers.pop()


def _space(before: Token | None, token: Token, operand: bool, tight: bool, closes: bool) -> str:
    if tight or closes or token in _TIGHT or token in (")", "]", ",", ":") or token.type == "_NL":
        return ""
    if before == "{" and token == "}":
        return ""
    if token in ("(", "[") and not operand and before != "}":
        return ""
    return "  " if token.type == "STRING" and not operand else " "  # the description of a param


def _output(lines: list[_Line]) -> Iterator[str]:
    """The lines as text. Comments after consecutive lines begin in one column."""
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
    """The column of the comments after the first of `lines` and the lines that follow it directly."""
    run = takewhile(lambda line: line.tokens and line.comment and not (line.blank and line is not lines[0]), lines)
    return max(line.indent + len(line.code) for line in run) + 2
