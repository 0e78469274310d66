"""The place of a syntax error in a token stream, as the rules for messages read it."""

from __future__ import annotations

from dataclasses import dataclass

from lark import Token

from .lexer import CLOSERS, OPENERS

VALUES = frozenset(("NUMBER", "STRING", "COLOR", "NAME"))

Answer = tuple[str, str, Token]  # message, hint, where


@dataclass(frozen=True, slots=True)
class ErrorSite:
    """Token `at` of a stream, where the item that begins at `first` cannot go on; `expected` are lark's terminals that could."""

    stream: list[Token]
    at: int
    first: int
    expected: set[str]

    @property
    def token(self) -> Token:
        return self.stream[self.at]

    @property
    def start(self) -> Token:
        return self.stream[self.first]

    def near(self, offset: int) -> Token:
        """A token before or behind; an empty one outside of the item's reach."""
        i = self.at + offset
        return self.stream[i] if self.first <= i < len(self.stream) else Token("", "")

    def word(self) -> str:
        """The token with all that follows it without a space."""
        end = self.at + 1
        while self.stream[end].start_pos == self.stream[end - 1].end_pos and self.stream[end].type not in ("_NL", "$END"):
            end += 1
        return "".join(self.stream[self.at : end])

    def opener(self) -> int | None:
        """Index of the innermost bracket of the item that is open here."""
        depth = 0
        for i in range(self.at - 1, self.first - 1, -1):
            token = self.stream[i]
            if token in CLOSERS:
                depth += 1
            elif token in OPENERS:
                if depth == 0:
                    return i
                depth -= 1
        return None

    def inside(self) -> str:
        """What is open here: `call`, `parameters`, `condition`, `loop`, `group`, `list`, `index`, or nothing."""
        i = self.opener()
        if i is None:
            return ""
        before = self.stream[i - 1] if i > self.first else Token("", "")
        if self.stream[i] == "[":
            return "index" if ends_value(before) else "list"
        if before in ("if", "for"):
            return "condition" if before == "if" else "loop"
        if i == self.first + 2 and self.start == "let":
            return "parameters"
        return "call" if ends_value(before) else "group"


def ends_value(token: Token) -> bool:
    return (token.type in VALUES) or token in (")", "]", "}")


def starts_value(token: Token) -> bool:
    return token.type in VALUES or token in ("(", "[")


def quote(token: Token) -> str:
    if token.type == "$END":
        return "the end of the file"
    if token.type == "_NL":
        return "`;`" if ";" in token else "the end of the line"
    text = str(token)
    return f"`{text}`" if len(text) <= 40 else f"`{text[:37]}…`"


def is_end(token: Token) -> bool:
    return token.type in ("$END", "_NL") or token in (")", "]", "}")
