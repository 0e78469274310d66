"""The exception of a faulty input: a message, and a hint that says what to write."""

from __future__ import annotations


class InputError(Exception):
    """A fault of the input. `message` says what is wrong, `hint` says what to write; who catches it adds the place."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
