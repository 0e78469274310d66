"""Evaluation limits that bound the time and memory of untrusted scenes."""

from __future__ import annotations

import sys

from .diagnostics import Span
from .input_error import InputError

MAX_CALLS = 200  # nested calls
MAX_LIST = 10_000_000  # items of a list, and iterations of a range or a `for`
MAX_TEXT = 1_000_000  # characters of a string
MAX_STEPS = 2_000_000  # calls, loop iterations and comparisons together, besides those of the elements made
STEPS_OF_ELEMENT = 100  # further steps for each element made
MAX_ELEMENTS = 2_000_000  # elements made, and elements placed, counting the repetitions of blocks: some 3 GB of memory
MAX_TERMS = 50_000  # operations in one formula
MAX_APPLIED = 250_000  # operations of one formula, equal ones counted each time
MAX_FILES = 200  # files used
MAX_ERRORS = 1000  # errors of one evaluation

_STACK = 40_000  # Python frames: MAX_CALLS calls with some 50 nested expressions each, or one expression of the greatest depth


class Exhausted(InputError):
    """A limit was reached. The evaluator adds the place and stops the item.

    `of_elements`: it is the limit on elements, whose place is the loop that makes most of them.
    """

    def __init__(self, message: str, hint: str = "", of_elements: bool = False) -> None:
        super().__init__(message, hint)
        self.of_elements = of_elements
        self.span: Span | None = None
        self.trace: tuple[tuple[str, Span], ...] = ()


class TooManyErrors(Exception):
    """An evaluation has reported MAX_ERRORS errors. It ends there."""


class Meter:
    """Counters of one evaluation: steps, nested calls, elements made, and elements placed with the repetitions of blocks."""

    __slots__ = ("allowed", "calls", "elements", "most", "placed", "steps")

    def __init__(self, most: int | None = None) -> None:
        """`most` elements; MAX_ELEMENTS if None."""
        self.calls = 0
        self.steps = 0
        self.allowed = 0  # steps, as far as they are known to be allowed
        self.elements = 0
        self.placed = 0
        self.most = MAX_ELEMENTS if most is None else most

    def step(self, count: int = 1) -> None:
        """Count steps. Raises Exhausted."""
        self.steps += count
        if self.steps > self.allowed:
            self._allow()

    def _allow(self) -> None:
        self.allowed = MAX_STEPS + STEPS_OF_ELEMENT * self.elements
        if self.steps > self.allowed:
            besides = f" besides {STEPS_OF_ELEMENT} for each element" if self.elements else ""
            raise Exhausted(f"the scene takes more than {MAX_STEPS:,} steps to evaluate{besides}", "reduce loop iterations or calls")

    def element(self) -> None:
        """Count one element. Raises Exhausted."""
        self.elements += 1
        if self.elements > self.most:
            raise self.too_many_elements()

    def too_many_elements(self) -> Exhausted:
        """The error for too many elements."""
        hint = "use a mesh for many small parts, or allow more with --max-elements"
        return Exhausted(f"the scene makes more than {self.most:,} elements", hint, of_elements=True)


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
