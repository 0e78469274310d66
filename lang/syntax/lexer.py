"""Lexer, with messages for characters and strings that are not in the language."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, field

from ..diagnostics import Diagnostics, Span
from ..plain_values import counted
from . import ast
from .grammar import Token, grammar

KEYWORDS = frozenset(("use", "as", "unit", "param", "in", "let", "for", "if", "else", "then", "or", "and", "not"))
COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
OPERATORS = COMPARISONS | frozenset(("+", "-", "*", "/", "^", "..", "and", "or", "not"))
OPENERS = {"(": ")", "[": "]", "{": "}"}
CLOSERS = {")": "(", "]": "[", "}": "{"}
MAX_NESTING = 200  # open brackets
MAX_MISTAKES = 1000  # after which the lexer stops

_ESCAPE = re.compile(r"\\(.)")
_CONTROL = re.compile(r"[\0-\x08\x0b-\x1f\x7f-\x9f]")  # not the tab
_TURNING = re.compile(r"[\u202a-\u202e\u2066-\u2069]")  # characters that change the direction of text
_REPLACEMENTS = {  # hints for characters of other languages
    "!": "write `not`",
    "&": "write `and`",
    "%": "write mod(a, b) for a remainder; a percentage directly follows its number: 50%",
    "?": "write `if … then … else …`",
    "$": "names have no `$`; OpenSCAD's $fn is not needed, as round shapes are drawn round",
    **dict.fromkeys("`'", 'strings are written in double quotes: "…"'),
    **dict.fromkeys("“”„‘’‚«»", 'strings are written in straight quotes: "…"'),
    "×": "write `*`",
    "·": "write `*`",
    "÷": "write `/`",
    **dict.fromkeys("−–—‐‑", "write `-`"),
    "≤": "write `<=`",
    "≥": "write `>=`",
    "≠": "write `!=`",
    "…": "write `..` for a range",
    "\\": "a line continues inside ( ) and [ ], and after an operator",
}


@dataclass(slots=True)
class Scan:
    """The tokens of a file (ending with `$END`), its comments, and the places of lexical errors."""

    tokens: list[Token] = field(default_factory=list)
    comments: list[ast.Comment] = field(default_factory=list)
    wrong: list[tuple[int, int]] = field(default_factory=list)  # line, column
    mistakes: int = 0  # lexical errors
    depth: int = 0  # brackets open at the end
    deepest: int = 0  # most open brackets
    ends_line: bool = False  # the last character is part of a line end
    bracket_errors: int = 0
    open_at_end: str = ""  # brackets for which the end of the text came too early


def lex(text: str, line: int = 1) -> Iterator[Token]:
    """The tokens of a text that begins in `line`, without blanks.

    Every character is part of a token: characters outside the language have kinds of their own.
    """
    return grammar().tokens(text, line).lex(None)


def span_of(token: Token, file: str) -> Span:
    """The place of a token."""
    return Span(file, token.line or 1, token.column or 1, token.end_line or 1, token.end_column or 1)


def scan(text: str, file: str, diagnostics: Diagnostics, line: int = 1) -> Scan:
    """The tokens of `text`, which begins in `line`. Lexical errors are reported, then replaced by a valid token or dropped."""
    result = Scan()
    depth = 0
    safe = 0  # number of tokens before the last line end outside all brackets
    for token in _commented_lines(lex(text, line)):
        if token.type in _MISTAKES:
            result.wrong.append((token.line or 1, token.column or 1))
            replacement = _MISTAKES[token.type](token, file, diagnostics)
            if isinstance(replacement, ast.Comment):
                result.comments.append(replacement)
            elif replacement is not None:
                result.tokens.append(replacement)
            if len(result.wrong) >= MAX_MISTAKES:
                break
            continue
        if token.type == "COMMENT":
            _check_direction(token, "comment", file, diagnostics)
            result.comments.append(ast.Comment(span_of(token, file), str(token).rstrip()))
            continue
        if token in OPENERS:
            depth += 1
            result.deepest = max(result.deepest, depth)
            if depth > MAX_NESTING:
                diagnostics.error(f"brackets more than {MAX_NESTING} deep", span_of(token, file), "give parts of it a name with `let`")
                result.wrong.append((token.line or 1, token.column or 1))
                del result.tokens[safe:]
                break
        elif token in CLOSERS:
            depth = max(0, depth - 1)
        elif token.type == "STRING" and ("\\" in token or not token.isprintable()):
            _check_escapes(token, file, diagnostics)
            _check_controls(token, file, diagnostics)
            _check_direction(token, "string", file, diagnostics)
        elif token.type == "_NL":
            result.ends_line = token.end_pos == len(text)
            if result.tokens and result.tokens[-1].type == "_NL":  # a line with only a comment
                first = result.tokens.pop()
                token = first if ";" in first else token
            if depth == 0:
                safe = len(result.tokens)
        result.tokens.append(token)
    result.tokens.append(_end(result.tokens))
    result.mistakes, result.depth = len(result.wrong), depth
    return result


def _commented_lines(stream):
    """The token stream with each line that begins with `#word` replaced by one comment, unless `#word` is a colour."""
    skipped = 0
    fresh = True
    for token in stream:
        if token.type == "_NL":
            fresh, skipped = True, 0
        elif skipped and token.line == skipped:
            continue
        elif fresh and token.type == "BAD_COLOR" and re.search("[g-zG-Z]", token):
            skipped = token.line
            token = token.update("HASH_COMMENT")
        if token.type not in ("_NL", "COMMENT"):
            fresh = False
        yield token


def _end(tokens: list[Token]) -> Token:
    if not tokens:
        return Token("$END", "", 0, 1, 1, 1, 1, 0)
    last = tokens[-1]
    return Token("$END", "", last.end_pos, last.end_line, last.end_column, last.end_line, last.end_column, last.end_pos)


def _check_escapes(token: Token, file: str, diagnostics: Diagnostics) -> None:
    for match in _ESCAPE.finditer(token):
        if match[1] not in 'n"\\':
            column = (token.column or 1) + match.start()
            span = Span(file, token.line or 1, column, token.line or 1, column + 2)
            hint = "write `/` in paths; a backslash is `\\\\`, a line end `\\n`"
            diagnostics.error(f"a string has no `{match[0]}`", span, hint)
            return


def _check_controls(token: Token, file: str, diagnostics: Diagnostics) -> None:
    """Report the first control character of a string other than a tab: no file name and no text has one."""
    if control := _CONTROL.search(token):
        diagnostics.error(f"a string has no invisible character {_code(control[0])}", _span_at(token, control.start(), file), "delete it")


def _check_direction(token: Token, what: str, file: str, diagnostics: Diagnostics) -> None:
    """Warn of the first character of a string or comment that changes the direction of text: code behind it is shown elsewhere."""
    if not token.isascii() and (mark := _TURNING.search(token)):
        message = f"this {what} has the invisible character {_code(mark[0])}, which changes the direction of the text after it"
        hint = "delete it: editors may show code as part of the text, and text as code"
        diagnostics.warning(message, _span_at(token, mark.start(), file), hint)


def _span_at(token: Token, index: int, file: str) -> Span:
    """The place of a character of a token in one line."""
    line, column = token.line or 1, (token.column or 1) + index
    return Span(file, line, column, line, column + 1)


def _code(char: str) -> str:
    return f"U+{ord(char):04X}"


def _open_string(token: Token, file: str, diagnostics: Diagnostics) -> Token:
    diagnostics.error("this string is not closed", span_of(token, file), 'write `"` at its end')
    text = str(token).rstrip("\\")
    return token.update("STRING", text + '"')


def _block_comment(token: Token, file: str, diagnostics: Diagnostics) -> ast.Comment:
    span = span_of(token, file)
    opening = Span(file, span.line, span.column, span.line, span.column + 2)
    diagnostics.error("`/* … */` is not a comment here", opening, "begin each line of a comment with `//`")
    return ast.Comment(span, str(token).rstrip())


_DIRECTIVES = {  # of POV-Ray
    **dict.fromkeys(("declare", "local"), "write let name = …"),
    "macro": "write let name(…) = …",
    "include": 'write use "parts.scene" for a file of scenes',
    **dict.fromkeys(("while", "for"), "write for (k in 0..5) { … }"),
    **dict.fromkeys(("if", "ifdef", "ifndef"), "write if (…) { … }"),
    "else": "write else { … }",
    "end": "a block ends with `}`",
}


def _hash_comment(token: Token, file: str, diagnostics: Diagnostics) -> ast.Comment:
    span = span_of(token, file)
    word = re.match(r"#?(\w*)", token)
    if word and word[1] in _DIRECTIVES:
        diagnostics.error(f"the language has no `#{word[1]}`", span, _DIRECTIVES[word[1]])
        return ast.Comment(span, str(token).rstrip())
    diagnostics.error("`#` begins no comment", Span(file, span.line, span.column, span.line, span.column + 1), "write `//`")
    return ast.Comment(span, str(token).rstrip())


def _bad_color(token: Token, file: str, diagnostics: Diagnostics) -> Token:
    hint = "a colour is #rgb or #rrggbb"
    if re.fullmatch("#[0-9a-fA-F]{8}", token):
        hint = f"write {token[:7]}; `opacity` of the material takes the place of the last two digits"
    what = "has a letter that is not a hexadecimal digit" if re.search("[g-zG-Z]", token) else f"has {counted(len(token) - 1, 'digit')}"
    diagnostics.error(f"the colour `{token}` {what}", span_of(token, file), hint)
    return token.update("COLOR", "#000")


def _unknown(token: Token, file: str, diagnostics: Diagnostics) -> Token | None:
    char = str(token)
    visible = char.isprintable() and not char.isspace()
    shown = "backquote" if char == "`" else f"`{char}`" if visible else f"invisible character {_code(char)}"
    usual = unicodedata.normalize("NFKC", char)  # of a full-width character
    hint = _REPLACEMENTS.get(char, f"write `{usual}`" if visible and usual != char and usual.isascii() else "" if visible else "delete it")
    replacement = token.update("NAME") if char == "$" else None  # the name after it is part of the error
    last = diagnostics.items[-1] if diagnostics.items else None
    if last and last.span and last.span.line == token.line and last.hint == hint:
        return replacement  # the second of a pair, or one of a sequence
    diagnostics.error(f"the language has no {shown}", span_of(token, file), hint)
    return replacement


_MISTAKES = {
    "OPEN_STRING": _open_string,
    "BLOCK_COMMENT": _block_comment,
    "HASH_COMMENT": _hash_comment,
    "BAD_COLOR": _bad_color,
    "UNKNOWN": _unknown,
}
