"""The deadline of a budget, by a clock that the test sets."""

from __future__ import annotations

import math

import pytest
from maquette.render.film.deadline import Deadline, Pace
from maquette.render.jit import compile_events


class Clock:
    """A clock that stands still."""

    def __init__(self) -> None:
        self.now = 50.0

    def __call__(self) -> float:
        return self.now


def test_a_budget_ends_after_its_seconds_from_the_start() -> None:
    clock = Clock()
    deadline = Deadline(10.0, 47.0, clock)
    assert (deadline.spent(), deadline.left(), deadline.is_over()) == (3.0, 7.0, False)
    clock.now = 57.0
    assert (deadline.left(), deadline.is_over()) == (0.0, True)


def test_no_budget_never_ends() -> None:
    deadline = Deadline()
    assert (deadline.is_finite, deadline.left(), deadline.is_over()) == (False, math.inf, False)
    assert deadline.part(0.5) is deadline


def test_reserved_seconds_and_parts() -> None:
    clock = Clock()
    deadline = Deadline(10.0, None, clock)
    early = deadline.earlier(2.0).earlier(1.0)
    clock.now = 54.0
    assert (early.left(), deadline.left()) == (3.0, 6.0)
    assert deadline.part(0.5).end == 57.0
    clock.now = 70.0
    assert deadline.part(0.5).end == 70.0


def test_half_of_the_budget_remains_after_a_compilation_and_nothing_else_moves_the_end() -> None:
    clock = Clock()
    deadline = Deadline(10.0, None, clock)
    early = deadline.earlier(1.0)
    with deadline.watch_compiler():
        with compile_events.compiling("quick"):
            clock.now += 3.0
        assert deadline.end == 60.0  # more than half is left
        with compile_events.compiling("slow"):
            clock.now += 30.0
        assert deadline.end == clock.now + 5.0
        assert early.left() == 4.0
    with compile_events.compiling("of another picture"):
        clock.now += 1.0
    assert deadline.left() == 4.0


def test_the_pace_of_calls() -> None:
    pace = Pace()
    assert (pace.seconds, pace.samples()) == (0.0, 1)
    pace.add(0, 1.0)
    for seconds in (9.0, 2.0, 1.0, 1.0, 1.0):
        pace.add(1000, seconds)
    assert (pace.seconds, pace.warm) == (1e-3, 1e-3)
    assert pace.samples() == pytest.approx(200, abs=1)
