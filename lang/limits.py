"""Evaluation limits that bound the time and memory of untrusted scenes."""

from __future__ import annotations

import sys

from .diagnostics import Span

MAX_CALLS = 200  # nested calls
MAX_LIST = 1_000_000  # items of a list, and iterations of a range or a `for`
MAX_TEXT = 1_000_000  # characters of a string
MAX_STEPS = 2_000_000  # calls, loop iterations and comparisons together
MAX_ELEMENTS = 200_000  # elements made, and elements placed, counting the repetitions of blocks
MAX_TERMS = 50_000  # operations in one formula
MAX_FILES = 200  # files used

_STACK = 40_000  # Python frames: MAX_CALLS calls with some 50 nested expressions each, or one expression of the greatest depth


class Exhausted(Exception):
    """A limit was reached. The evaluator adds the place and stops the item."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.span: Span | None = None
        self.trace: tuple[tuple[str, Span], ...] = ()


class Meter:
    """Counters of one evaluation: steps, nested calls, elements."""

    __slots__ = ("calls", "elements", "steps")

    def __init__(self) -> None:
        self.calls = 0
        self.steps = 0
        self.elements = 0

    def step(self, count: int = 1) -> None:
        """Count steps. Raises Exhausted."""
        self.steps += count
        if self.steps > MAX_STEPS:
            raise Exhausted(f"the scene takes more than {MAX_STEPS:,} steps to evaluate", "reduce loop iterations or calls")

    def element(self) -> None:
        """Count one element. Raises Exhausted."""
        self.elements += 1
        if self.elements > MAX_ELEMENTS:
            raise too_many_elements()


def too_many_elements() -> Exhausted:
    """The error for too many elements."""
    return Exhausted(f"the scene makes more than {MAX_ELEMENTS:,} elements", "use a mesh for many small parts")


def check_list(length: float) -> None:
    """Raise Exhausted for a list of more than MAX_LIST items."""
    if length > MAX_LIST:
        raise Exhausted(f"a list of {length:.10g} items is too long", f"at most {MAX_LIST:,} items")


def check_text(length: int) -> None:
    """Raise Exhausted for a string of more than MAX_TEXT characters."""
    if length > MAX_TEXT:
        raise Exhausted(f"a string of {length} characters is too long", f"at most {MAX_TEXT:,} characters")


def raise_recursion_limit() -> None:
    """Raise Python's recursion limit for MAX_CALLS nested calls; never lower it.

    The evaluator recurses through Python functions only. Their frames are on the heap, so the C stack does not overflow.
    """
    if sys.getrecursionlimit() < _STACK:
        sys.setrecursionlimit(_STACK)
