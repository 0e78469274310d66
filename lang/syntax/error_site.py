"""The place of a syntax error in a token stream, as input of the rules for messages."""

from __future__ import annotations

from dataclasses import dataclass

from .grammar import Token
from .lexer import CLOSERS, OPENERS

VALUES = frozenset(("NUMBER", "STRING", "COLOR", "NAME"))

Answer = tuple[str, str, Token]  # message, hint, where


@dataclass(frozen=True, slots=True)
class ErrorSite:
    """Token `at` of a stream, unexpected in the item that begins at token `first`. `expected` are the allowed terminals.

    Rules read the item alone, except for names that the file binds: those that they look for in vain are added to `unbound`.
    """

    stream: list[Token]
    at: int
    first: int
    expected: set[str]
    unbound: set[str]

    @property
    def token(self) -> Token:
        """The unexpected token."""
        return self.stream[self.at]

    @property
    def start(self) -> Token:
        """The first token of the item."""
        return self.stream[self.first]

    def near(self, offset: int) -> Token:
        """The token `offset` tokens after this one; an empty token outside of the item."""
        i = self.at + offset
        return self.stream[i] if self.first <= i < len(self.stream) else Token("", "")

    def word(self) -> str:
        """The token with all tokens that follow it without a space."""
        end = self.at + 1
        while self.stream[end].start_pos == self.stream[end - 1].end_pos and self.stream[end].type not in ("_NL", "$END"):
            end += 1
        return "".join(self.stream[self.at : end])

    def opener(self) -> int | None:
        """Index of the innermost open bracket of the item."""
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
        """The kind of the innermost open bracket: `call`, `parameters`, `condition`, `loop`, `group`, `list`, `index` or empty."""
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
    """Whether a token can end a value."""
    return (token.type in VALUES) or token in (")", "]", "}")


def starts_value(token: Token) -> bool:
    """Whether a token can begin a value, other than by an operator or a keyword."""
    return token.type in VALUES or token in ("(", "[")


def quote(token: Token) -> str:
    """A token in a message."""
    if token.type == "$END":
        return "the end of the file"
    if token.type == "_NL":
        return "`;`" if ";" in token else "the end of the line"
    text = str(token)
    return f"`{text}`" if len(text) <= 40 else f"`{text[:37]}…`"


def is_end(token: Token) -> bool:
    """Whether a token ends a line, a bracket or the file."""
    return token.type in ("$END", "_NL") or token in (")", "]", "}")
