"""Balances the brackets of a token stream and drops line ends inside items."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass

from ..diagnostics import Diagnostics
from .grammar import Token
from .lexer import CLOSERS, OPENERS, OPERATORS, Scan, span_of

# A line that ends with one of these continues; `|` closes the parameters of a function.
CONTINUED_AFTER = OPERATORS | frozenset(("=", ",", ":", ".", "|", "in", "then", "else", "(", "["))
# Keywords that begin an item and occur nowhere else.
_ITEM_WORDS = frozenset(("let", "param", "use", "unit"))
# A line that begins with one of these continues the line above, because it can follow a complete value.
_CONTINUES_LINE = OPERATORS - {"not"} | frozenset(("=", ",", ":", ".", "|", "in", "then", "else", "for", "if", "(", ")", "[", "]", "{"))
# A `{` after one of these begins a block expression. After `else` it may be the block of a statement.
_BEFORE_BLOCKS = frozenset(("=", ",", ":", "|", "then", "(", "["))
MAX_BRACKET_ERRORS = 20  # each may scan the rest of the file again


@dataclass(slots=True)
class _Open:
    """An open bracket."""

    token: Token
    index: int  # of the next token
    output: int  # number of output tokens up to and including it
    line_end: tuple[int, int] | None = None  # (index, output) of the first line end that may be its intended end


def join_lines(scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    """The tokens with balanced brackets and a `_NL` only between items. Repairs are reported as errors."""
    return _drop_line_ends(_balance(scan, file, diagnostics), scan, file, diagnostics)


class _Report:
    """Reports wrong brackets, one error a line."""

    def __init__(self, scan: Scan, file: str, diagnostics: Diagnostics) -> None:
        self.scan, self.file, self.diagnostics = scan, file, diagnostics
        self.lines = {line for line, _ in scan.wrong}
        self.count = 0

    def __call__(self, token: Token, message: str, hint: str) -> None:
        self.count += 1
        if token != "{":  # the items of an unclosed block remain valid
            self.scan.wrong.append((token.line or 1, token.column or 1))
        if token.line not in self.lines:
            self.lines.add(token.line or 1)
            self.diagnostics.error(message, span_of(token, self.file), hint)


def _balance(scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    tokens, output = scan.tokens, []
    report = _Report(scan, file, diagnostics)
    stack: list[_Open] = []
    pairs: list[tuple[Token, Token]] = []
    i = 0
    while i < len(tokens):
        token = tokens[i]
        if token.type == "_NL":
            _note_line_end(stack, tokens, i, len(output))
        elif _ends_brackets(tokens, i, stack):
            if token.type == "$END":
                scan.open_at_end = scan.open_at_end or "".join(opened.token for opened in stack)
            back = _close(stack, tokens, output, i, token, report)
            if back is not None:
                i = back
                continue
            if token in CLOSERS:
                if not stack or CLOSERS[token] != stack[-1].token:
                    report(token, f"nothing is open that this `{token}` could close", "delete it")
                    i += 1
                    continue
                pairs.append((stack.pop().token, token))
        output.append(token)
        if token in OPENERS:
            stack.append(_Open(token, i + 1, len(output)))
        i += 1
    if stack:
        _close_blocks(stack, pairs, tokens, output, report)
    scan.bracket_errors = report.count
    return output


def _ends_brackets(tokens: list[Token], i: int, stack: list[_Open]) -> bool:
    """Whether this token ends every open ( and [, matched or not."""
    token = tokens[i]
    if token in CLOSERS or token.type == "$END":
        return True
    starts_line = i > 0 and tokens[i - 1].type == "_NL"
    return starts_line and token in _ITEM_WORDS and token.type != "NAME" and bool(stack) and stack[-1].token != "{"


def _note_line_end(stack: list[_Open], tokens: list[Token], i: int, output: int) -> None:
    if not stack or stack[-1].token == "{" or stack[-1].line_end is not None:
        return
    before, following = tokens[i - 1], tokens[i + 1]
    if (before not in CONTINUED_AFTER and following not in _CONTINUES_LINE) or ";" in tokens[i]:
        stack[-1].line_end = (i, output)


def _close(stack: list[_Open], tokens: list[Token], output: list[Token], i: int, token: Token, report: _Report) -> int | None:
    """Close the ( and [ that are unclosed at `token`. Returns the index to resume at, or None if none is unclosed."""
    first = len(stack)
    while first and stack[first - 1].token != "{" and CLOSERS.get(token) != stack[first - 1].token:
        first -= 1
    if token in (")", "]") and (not first or stack[first - 1].token == "{"):
        return None  # a stray closer
    unclosed = stack[first:]
    if not unclosed:
        return None
    ends = [o.line_end for o in unclosed if o.line_end is not None]
    if ends and report.count < MAX_BRACKET_ERRORS:
        i, length = min(ends)
        del output[length:]
        unclosed = [o for o in unclosed if o.output <= length]  # the scan reaches the others again
    for opened in unclosed:
        closer = OPENERS[opened.token]
        where = "" if token.line == opened.token.line else f" in line {token.line}"
        hint = f"write `{closer}` before the `{token}`{where}" if token in (")", "]") else f"write `{closer}` where it ends"
        report(opened.token, f"this `{opened.token}` is not closed", hint)
    last = output[-1]
    output.extend(_insert_closer(OPENERS[o.token], last) for o in reversed(unclosed))
    del stack[first:]
    return i


def _close_blocks(stack: list[_Open], pairs: list[tuple[Token, Token]], tokens: list[Token], output: list[Token], report: _Report) -> None:
    """Close all brackets open at the end of the file. The indentation shows which `}` is missing, and where."""
    indents: dict[int, int] = {}
    for t in tokens:
        indents.setdefault(t.line or 1, t.column or 1)
    early = [a for a, b in pairs if a == "{" and indents[b.line or 1] == b.column and (b.column or 1) < indents[a.line or 1]]
    blamed = sorted(early, key=lambda t: t.start_pos or 0)[: len(stack)] or [o.token for o in stack]
    for token in reversed(blamed):  # of two brackets in one line the inner one is reported
        where = "after its last item" if token == "{" else "where it ends"
        report(token, f"this `{token}` is not closed", f"write `{OPENERS[token]}` {where}")
    ends = [len(output) - 1] * len(stack)
    if len(stack) <= MAX_BRACKET_ERRORS:
        dedents = (_dedent(output, token, indents) for token in blamed)
        ends = sorted([*dedents, *ends[len(blamed) :]])
        # The `}` of a block that is closed in the text lies before the `{` that has none where the blocks are not nested.
        ends = sorted((end if end >= opened.output else len(output) - 1 for opened, end in zip(stack, ends, strict=True)), reverse=True)
    for opened, end in zip(stack, ends, strict=True):
        output.insert(end, _insert_closer(OPENERS[opened.token], output[end]))


def _dedent(output: list[Token], opener: Token, indents: dict[int, int]) -> int:
    """The line end in `output` at which the indentation of a block ends, or the end of the file, as of blocks that are not indented."""
    indent, last = indents[opener.line or 1], len(output) - 1
    inside = bisect_right([token.start_pos or 0 for token in output], opener.start_pos or 0)
    starts = [k for k in range(inside + 1, last) if output[k - 1].type == "_NL" and output[k].type != "_NL"]
    outer = [k - 1 for k in starts if (output[k].column or 1) <= indent]
    return outer[0] if outer and outer[0] + 1 != starts[0] else last


def _insert_closer(text: str, place: Token) -> Token:
    """A bracket of no width, at the end of the token `place`."""
    kind = {")": "RPAR", "]": "RSQB", "}": "RBRACE"}[text]
    end = (place.end_line, place.end_column, place.end_pos)
    return Token(kind, text, end[2], end[0], end[1], end[0], end[1], end[2])


def _continues(line: list[Token]) -> bool:
    """Whether a line continues after its last token. `unit in`, a mistake for `unit inch`, ends there."""
    return bool(line) and line[-1] in CONTINUED_AFTER and not (line[-1] == "in" and len(line) > 1 and line[-2] == "unit")


def _drop_line_ends(tokens: list[Token], scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    output: list[Token] = []
    stack: list[Token] = []
    values: list[bool] = []  # for each open bracket, whether it begins a block expression
    for token, following in zip(tokens, [*tokens[1:], tokens[-1]], strict=True):
        if token.type == "_NL":
            if ";" not in token and (following == "else" or _continues(output) or (stack and stack[-1] != "{")):
                continue
            if output and output[-1].type == "_NL":  # the line held only a bracket that was dropped
                continue
            if following == "{" and output and not (values and values[-1]):
                scan.wrong.append((following.line or 1, following.column or 1))
                diagnostics.error("this `{` follows no item", span_of(following, file), "write it at the end of the line above")
                continue
        elif token in OPENERS:
            stack.append(token)
            values.append(token == "{" and bool(output) and output[-1] in _BEFORE_BLOCKS)
        elif token in CLOSERS:
            stack.pop()
            values.pop()
        output.append(token)
    return output
