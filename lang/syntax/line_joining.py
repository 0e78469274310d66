"""Balances the brackets of a token stream and drops the line ends that end nothing."""

from __future__ import annotations

from dataclasses import dataclass

from lark import Token

from ..diagnostics import Diagnostics
from .lexer import CLOSERS, OPENERS, OPERATORS, Scan, span_of

# After one of these a line goes on; `|` closes the parameters of a function.
GOES_ON = OPERATORS | frozenset(("=", ",", ":", ".", "|", "in", "then", "else", "(", "["))
# What begins an item and can be nowhere else.
_ITEM_WORDS = frozenset(("let", "param", "use", "unit"))
# What may stand behind a complete value, so that a line beginning with it is no new item.
_CONTINUES = OPERATORS - {"not"} | frozenset(("=", ",", ":", ".", "|", "in", "then", "else", "for", "if", "(", ")", "[", "]", "{"))
_MAX_BRACKET_ERRORS = 20  # each may look at the rest of the file once more


@dataclass(slots=True)
class _Open:
    token: Token
    index: int  # of the token behind it
    kept: int  # tokens written out up to and with it
    line_end: tuple[int, int] | None = None  # (index, kept) of the first line end where it may have been meant to close


def lay_out(scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    """The tokens with balanced brackets and a `_NL` only between items. Where something is repaired, it is reported."""
    return _drop_line_ends(_balance(scan, file, diagnostics), scan, file, diagnostics)


class _Report:
    """Reports brackets, each line once."""

    def __init__(self, scan: Scan, file: str, diagnostics: Diagnostics) -> None:
        self.scan, self.file, self.diagnostics = scan, file, diagnostics
        self.lines = {line for line, _ in scan.wrong}
        self.count = 0

    def __call__(self, token: Token, message: str, hint: str) -> None:
        self.count += 1
        if token != "{":  # what stands in an unclosed block is as good as before
            self.scan.wrong.append((token.line or 1, token.column or 1))
        if token.line not in self.lines:
            self.lines.add(token.line or 1)
            self.diagnostics.error(message, span_of(token, self.file), hint)


def _balance(scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    tokens, kept = scan.tokens, []
    report = _Report(scan, file, diagnostics)
    stack: list[_Open] = []
    pairs: list[tuple[Token, Token]] = []
    i = 0
    while i < len(tokens):
        token = tokens[i]
        if token.type == "_NL":
            _note_line_end(stack, tokens, i, len(kept))
        elif _ends_brackets(tokens, i, stack):
            back = _close(stack, tokens, kept, i, token, report)
            if back is not None:
                i = back
                continue
            if token in CLOSERS:
                if not stack or CLOSERS[token] != stack[-1].token:
                    report(token, f"nothing is open that this `{token}` could close", "delete it")
                    i += 1
                    continue
                pairs.append((stack.pop().token, token))
        kept.append(token)
        if token in OPENERS:
            stack.append(_Open(token, i + 1, len(kept)))
        i += 1
    if stack:
        _close_blocks(stack, pairs, tokens, kept, report)
    return kept


def _ends_brackets(tokens: list[Token], i: int, stack: list[_Open]) -> bool:
    """Whether an open ( or [ cannot reach beyond this token unless the token is its own closer."""
    token = tokens[i]
    if token in CLOSERS or token.type == "$END":
        return True
    starts_line = i > 0 and tokens[i - 1].type == "_NL"
    return starts_line and token in _ITEM_WORDS and bool(stack) and stack[-1].token != "{"


def _note_line_end(stack: list[_Open], tokens: list[Token], i: int, kept: int) -> None:
    if not stack or stack[-1].token == "{" or stack[-1].line_end is not None:
        return
    before, behind = tokens[i - 1], tokens[i + 1]
    if (before not in GOES_ON and behind not in _CONTINUES) or ";" in tokens[i]:
        stack[-1].line_end = (i, kept)


def _close(stack: list[_Open], tokens: list[Token], kept: list[Token], i: int, token: Token, report: _Report) -> int | None:
    """Closes the ( and [ that `token` shows to be unclosed. Returns where to go on, or None where nothing was unclosed."""
    first = len(stack)
    while first and stack[first - 1].token != "{" and CLOSERS.get(token) != stack[first - 1].token:
        first -= 1
    if token in (")", "]") and (not first or stack[first - 1].token == "{"):
        return None  # a stray closer
    unclosed = stack[first:]
    if not unclosed:
        return None
    ends = [o.line_end for o in unclosed if o.line_end is not None]
    if ends and report.count < _MAX_BRACKET_ERRORS:
        i, length = min(ends)
        del kept[length:]
        unclosed = [o for o in unclosed if o.kept <= length]  # the others are met again
    for opened in unclosed:
        closer = OPENERS[opened.token]
        where = "" if token.line == opened.token.line else f" in line {token.line}"
        hint = f"write `{closer}` before the `{token}`{where}" if token in (")", "]") else f"write `{closer}` where it ends"
        report(opened.token, f"this `{opened.token}` is not closed", hint)
    last = kept[-1]
    kept.extend(_borrowed(OPENERS[o.token], last) for o in reversed(unclosed))
    del stack[first:]
    return i


def _close_blocks(stack: list[_Open], pairs: list[tuple[Token, Token]], tokens: list[Token], kept: list[Token], report: _Report) -> None:
    """Closes the blocks open at the end of the file, and what is open around them. The indentation tells which `}` is missing."""
    indents: dict[int, int] = {}
    for t in tokens:
        indents.setdefault(t.line or 1, t.column or 1)
    early = [a for a, b in pairs if a == "{" and indents[b.line or 1] == b.column and (b.column or 1) < indents[a.line or 1]]
    blamed = sorted(early, key=lambda t: t.start_pos or 0)[: len(stack)] or [o.token for o in stack]
    for token in blamed:
        where = "after its last item" if token == "{" else "where it ends"
        report(token, f"this `{token}` is not closed", f"write `{OPENERS[token]}` {where}")
    end = kept.pop()
    kept.extend(_borrowed(OPENERS[o.token], end) for o in reversed(stack))
    kept.append(end)


def _borrowed(text: str, place: Token) -> Token:
    kind = {")": "RPAR", "]": "RSQB", "}": "RBRACE"}[text]
    end = (place.end_line, place.end_column, place.end_pos)
    return Token(kind, text, end[2], end[0], end[1], end[0], end[1], end[2])


def _goes_on(line: list[Token]) -> bool:
    """Whether the line goes on after its last token. `unit in`, a mistake for `unit inch`, ends there."""
    return bool(line) and line[-1] in GOES_ON and not (line[-1] == "in" and len(line) > 1 and line[-2] == "unit")


def _drop_line_ends(tokens: list[Token], scan: Scan, file: str, diagnostics: Diagnostics) -> list[Token]:
    kept: list[Token] = []
    stack: list[Token] = []
    for token, behind in zip(tokens, [*tokens[1:], tokens[-1]], strict=True):
        if token.type == "_NL":
            if ";" not in token and (behind == "else" or _goes_on(kept) or (stack and stack[-1] != "{")):
                continue
            if kept and kept[-1].type == "_NL":  # a bracket that stood alone on its line is gone
                continue
            if behind == "{" and kept:
                scan.wrong.append((behind.line or 1, behind.column or 1))
                diagnostics.error("this `{` has no line to belong to", span_of(behind, file), "write it at the end of the line above")
                continue
        elif token in OPENERS:
            stack.append(token)
        elif token in CLOSERS:
            stack.pop()
        kept.append(token)
    return kept
