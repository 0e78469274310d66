"""The limits of an evaluation: a scene may come from a stranger, and must be answered in time and memory."""

from __future__ import annotations

import sys

from .diagnostics import Span

MAX_CALLS = 200  # calls inside calls
MAX_LIST = 1_000_000  # items of a list, and steps of a range or a `for`
MAX_TEXT = 1_000_000  # characters of a string
MAX_STEPS = 2_000_000  # calls, rounds of loops and comparisons together
MAX_ELEMENTS = 200_000  # elements made, and elements placed with what their blocks repeat
MAX_TERMS = 50_000  # operations in one formula
MAX_FILES = 200  # files used

_STACK = 40_000  # Python frames: enough for MAX_CALLS calls with some 50 nested expressions in each, or for one that is as deep as may be


class Exhausted(Exception):
    """A limit was reached. Carries what was counted; the evaluator adds the place, and stops the whole item."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.span: Span | None = None
        self.trace: tuple[tuple[str, Span], ...] = ()


class Meter:
    """Counts what one evaluation has used."""

    __slots__ = ("calls", "elements", "steps")

    def __init__(self) -> None:
        self.calls = 0
        self.steps = 0
        self.elements = 0

    def step(self, count: int = 1) -> None:
        self.steps += count
        if self.steps > MAX_STEPS:
            raise Exhausted(f"the scene takes more than {MAX_STEPS:,} steps to evaluate", "fewer rounds of its loops, or fewer calls")

    def element(self) -> None:
        self.elements += 1
        if self.elements > MAX_ELEMENTS:
            raise too_many_elements()


def too_many_elements() -> Exhausted:
    return Exhausted(f"the scene makes more than {MAX_ELEMENTS:,} elements", "a mesh holds many small things better")


def check_list(length: float) -> None:
    """Raise Exhausted where a list of this length would be too long."""
    if length > MAX_LIST:
        raise Exhausted(f"a list of {length:.10g} items is too long", f"at most {MAX_LIST:,} items")


def check_text(length: int) -> None:
    """Raise Exhausted where a string of this length would be too long."""
    if length > MAX_TEXT:
        raise Exhausted(f"a string of {length} characters is too long", f"at most {MAX_TEXT:,} characters")


def deepen_stack() -> None:
    """Let Python recurse deep enough for MAX_CALLS calls; never lowers a limit somebody else has set.

    The evaluator recurses through Python functions only, whose frames lie on the heap, so the C stack is not at risk.
    """
    if sys.getrecursionlimit() < _STACK:
        sys.setrecursionlimit(_STACK)
