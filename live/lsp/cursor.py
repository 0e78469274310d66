"""The context of a text position: enclosing call and argument, string or member, read from tokens of possibly broken source."""

from __future__ import annotations

from dataclasses import dataclass

from ...lang.syntax.grammar import Token
from ...lang.syntax.lexer import CLOSERS, OPENERS, lex
from .document import Document


@dataclass(frozen=True, slots=True)
class Call:
    """An open call around the cursor. `argument_names` are the names of its arguments, `index` counts the arguments before the cursor."""

    name: str
    owner: str  # the file of `file.name(…)`; "" without
    index: int
    argument_names: tuple[str, ...]
    argument: str  # the name of the argument that the cursor stands in; "" for a positional one


@dataclass(frozen=True, slots=True)
class Cursor:
    """What stands before the cursor."""

    word: str  # the part of a name before the cursor
    owner: str  # the name before the dot of a member
    string: str | None  # the part of a string before the cursor; None outside of strings
    comment: bool
    use: bool  # in the string of `use`
    after: str  # the token before the word
    calls: tuple[Call, ...]  # innermost first


def read(document: Document, line: int, column: int) -> Cursor:
    """The surroundings of a place, from the tokens of its piece."""
    above = next((placed.above for placed in document.placed_at(line)), 0)
    rows = [*document.lines[above : line - 1], document.lines[line - 1][: column - 1]]
    tokens = [*lex("\n".join(rows))]
    word, string, comment = "", None, False
    if tokens:
        last = tokens[-1]
        end = (last.end_line, last.end_column) == (len(rows), len(rows[-1]) + 1)
        comment = last.type == "COMMENT" and end
        if last.type == "OPEN_STRING":
            string = str(tokens.pop())[1:]
        elif end and (last.isidentifier() or (last.type == "NUMBER" and last.isalpha())):
            word = str(tokens.pop())
    tokens = [t for t in tokens if t.type not in ("_NL", "COMMENT")]
    after = str(tokens[-1]) if tokens else ""
    owner = str(tokens[-2]) if after == "." and len(tokens) > 1 and tokens[-2].isidentifier() else ""
    return Cursor(word, owner, string, comment, after == "use" and string is not None, after, _calls(tokens))


def _calls(tokens: list[Token]) -> tuple[Call, ...]:
    """The calls that are open at the end of the tokens."""
    stack: list[int] = []
    for i, token in enumerate(tokens):
        if token in OPENERS:
            stack.append(i)
        elif token in CLOSERS and stack:
            stack.pop()
    calls = []
    for i in reversed(stack):
        if tokens[i] == "{":
            break
        if tokens[i] == "(" and i and tokens[i - 1].isidentifier() and (i < 2 or tokens[i - 2] not in ("let", "param")):
            member = i > 2 and tokens[i - 2] == "."
            calls.append(_call(str(tokens[i - 1]), str(tokens[i - 3]) if member else "", tokens[i + 1 :]))
    return tuple(calls)


def _call(name: str, owner: str, tokens: list[Token]) -> Call:
    depth, index, names, argument = 0, 0, [], ""
    for i, token in enumerate(tokens):
        if token in OPENERS:
            depth += 1
        elif token in CLOSERS:
            depth -= 1
        elif depth == 0 and token == ",":
            index, argument = index + 1, ""
        elif depth == 0 and token == ":" and i and tokens[i - 1].isidentifier():
            argument = str(tokens[i - 1])
            names.append(argument)
    return Call(name, owner, index, tuple(names), argument)
