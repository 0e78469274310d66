"""The exception of a faulty input: a message, and a hint for the fix."""

from __future__ import annotations


class InputError(Exception):
    """A fault of the input. `message` names the fault, `hint` names the fix; the caller adds the place."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
