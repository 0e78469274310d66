"""The harness: contenders take turns at the same work, their answers must agree, and medians of their times are kept.

Ratios are taken round by round, between runs that stand next to each other, so that a machine that slows down slows both sides.
CPU time counts all threads of this process and of the programs it started and waited for.
"""

from __future__ import annotations

import importlib
import resource
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

OURS = "maquette"


class Missing(Exception):
    """A peer is not installed; the message says what to install."""


class Disagreement(Exception):
    """Contenders gave different answers: their times mean nothing and are not reported."""


@dataclass(frozen=True, slots=True)
class Seconds:
    """What something took."""

    cpu: float
    wall: float


Clock = Callable[[], Seconds]


def clock() -> Seconds:
    """Now: CPU seconds of this process and of children it has waited for, and wall seconds."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Seconds(time.process_time() + children.ru_utime + children.ru_stime, time.perf_counter())


def timed(work: Callable[[], Any], now: Clock = clock) -> tuple[Any, Seconds]:
    """What `work` returns, and what it took."""
    start = now()
    value = work()
    end = now()
    return value, Seconds(end.cpu - start.cpu, end.wall - start.wall)


@dataclass(frozen=True, slots=True)
class Contender:
    """One side. `run` does the work once; `read` makes the answer of what it returned, untimed; `build` is what came before,
    timed with `timed`."""

    name: str
    run: Callable[[], Any]
    read: Callable[[Any], Any] = lambda value: value
    build: Seconds | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One piece of work. `agree` gets the answers by contender's name (a peer that is missing has none), says in a few words how
    they compare and raises Disagreement. `amount` is how many of the section's units one run does."""

    name: str
    contenders: Sequence[Contender]
    agree: Callable[[Mapping[str, Any]], str]
    amount: float = 1.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Median and quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Of at least one value; quartiles by linear interpolation, as numpy's."""
        if len(values) == 1:
            return cls(values[0], values[0], values[0])
        low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(middle, low, high)


@dataclass(frozen=True, slots=True)
class Times:
    """One contender's runs in the order they were made; `first` is the run before them, in which it may compile and load."""

    contender: Contender
    first: Seconds
    runs: tuple[Seconds, ...]

    def spread(self, of: str = "cpu") -> Spread:
        return Spread.of([getattr(run, of) for run in self.runs])

    def compile(self) -> float:
        """CPU seconds that the first run took more than the median one; 0 where that is noise."""
        return max(0.0, self.first.cpu - self.spread().median)


@dataclass(frozen=True, slots=True)
class Result:
    """A case, measured; or refused, with why in `refused`, and no times."""

    case: Case
    times: tuple[Times, ...] = ()
    agreement: str = ""
    refused: str = ""

    def of(self, name: str) -> Times:
        return next(t for t in self.times if t.contender.name == name)

    def ratio(self, name: str, of: str = "cpu") -> float:
        """How many times as long `name` takes as maquette: the median over rounds."""
        pairs = zip(self.of(name).runs, self.of(OURS).runs, strict=True)
        return statistics.median(getattr(theirs, of) / max(getattr(ours, of), 1e-9) for theirs, ours in pairs)


@dataclass(frozen=True, slots=True)
class Effort:
    """How long to measure: `rounds`, of which at least `fewest` even where `seconds` a case are over."""

    rounds: int = 7
    fewest: int = 3
    seconds: float = 20.0


def measure(case: Case, effort: Effort, now: Clock = clock) -> Result:
    """Run each contender once, compare the answers, then let them take turns, and compare the answers of the last turn.

    Who begins a round changes from round to round. Answers that differ make a Result without times.
    """
    first: dict[str, Seconds] = {}
    values: dict[str, Any] = {}
    runs: dict[str, list[Seconds]] = {c.name: [] for c in case.contenders}
    for c in case.contenders:
        values[c.name], first[c.name] = timed(c.run, now)
    try:
        agreement = case.agree(_answers(case, values))
        started = now().wall
        for turn in range(effort.rounds):
            if turn >= effort.fewest and now().wall - started > effort.seconds:
                break
            begin = turn % len(case.contenders)
            for c in (*case.contenders[begin:], *case.contenders[:begin]):
                values[c.name], spent = timed(c.run, now)
                runs[c.name].append(spent)
        case.agree(_answers(case, values))
    except Disagreement as why:
        return Result(case, refused=str(why))
    return Result(case, tuple(Times(c, first[c.name], tuple(runs[c.name])) for c in case.contenders), agreement)


def _answers(case: Case, values: Mapping[str, Any]) -> dict[str, Any]:
    return {c.name: c.read(values[c.name]) for c in case.contenders}


def need(module: str, install: str) -> ModuleType:
    """A peer's module. Raises Missing, saying what to install."""
    try:
        return importlib.import_module(module)
    except ImportError as why:
        raise Missing(f"{module.split('.')[0]} is not installed ({install})") from why


@dataclass(slots=True)
class Peers:
    """Makes contenders and remembers which could not be made."""

    missing: list[str] = field(default_factory=list)

    def gather(self, *factories: Callable[[], Contender]) -> list[Contender]:
        """The contenders of those factories whose peers are installed, in order."""
        made: list[Contender] = []
        for factory in factories:
            try:
                made.append(factory())
            except Missing as why:
                if str(why) not in self.missing:
                    self.missing.append(str(why))
        return made
