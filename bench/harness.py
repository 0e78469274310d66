"""Measures contenders: they run the same work in turns, their answers must agree, and medians of their times are reported.

Ratios are computed within a round, between neighbouring runs, so that a slower machine affects both sides.
CPU time covers all threads of this process and of finished child processes.
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
    """A peer is not installed; the message has the remedy."""


class Disagreement(Exception):
    """The answers of contenders differ; their times are not reported."""


@dataclass(frozen=True, slots=True)
class Seconds:
    """CPU and wall seconds."""

    cpu: float
    wall: float


Clock = Callable[[], Seconds]


RUNNING: list[Callable[[], float]] = []
"""Each gives the CPU seconds so far of a child process that answers requests."""


def clock() -> Seconds:
    """The current CPU seconds of this process, of finished children and of those in RUNNING, and wall seconds."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    running = sum(spent() for spent in RUNNING)
    return Seconds(time.process_time() + children.ru_utime + children.ru_stime + running, time.perf_counter())


def timed(work: Callable[[], Any], now: Clock = clock) -> tuple[Any, Seconds]:
    """The result of `work` and its seconds."""
    start = now()
    value = work()
    end = now()
    return value, Seconds(end.cpu - start.cpu, end.wall - start.wall)


@dataclass(frozen=True, slots=True)
class Contender:
    """One side. `run` does the work once; `read` converts its result to an answer, untimed; `build` is the time of the preparation."""

    name: str
    run: Callable[[], Any]
    read: Callable[[Any], Any] = lambda value: value
    build: Seconds | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class Case:
    """One piece of work. `agree` gets the answers by contender, returns a short comparison, and raises Disagreement.
    `amount` is the number of units of a run."""

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
    def from_values(cls, values: Sequence[float]) -> Spread:
        """The spread of at least one value; quartiles by linear interpolation, as in numpy."""
        if len(values) == 1:
            return cls(values[0], values[0], values[0])
        low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(middle, low, high)


@dataclass(frozen=True, slots=True)
class Times:
    """The runs of a contender in order; `first` is an earlier run that may compile and load."""

    contender: Contender
    first: Seconds
    runs: tuple[Seconds, ...]

    def spread(self, measure: str = "cpu") -> Spread:
        return Spread.from_values([getattr(run, measure) for run in self.runs])

    def compile(self) -> float:
        """CPU seconds of the first run beyond the median; 0 if that is noise."""
        return max(0.0, self.first.cpu - self.spread().median)


@dataclass(frozen=True, slots=True)
class Result:
    """A measured case, or a refused one with the reason in `refused` and no times."""

    case: Case
    times: tuple[Times, ...] = ()
    agreement: str = ""
    refused: str = ""

    def times_of(self, name: str) -> Times:
        return next(t for t in self.times if t.contender.name == name)

    def ratio(self, name: str, measure: str = "cpu") -> float:
        """The time of `name` over that of maquette: the median over rounds."""
        pairs = zip(self.times_of(name).runs, self.times_of(OURS).runs, strict=True)
        return statistics.median(getattr(theirs, measure) / max(getattr(ours, measure), 1e-9) for theirs, ours in pairs)


@dataclass(frozen=True, slots=True)
class Effort:
    """The effort of a case: `rounds`, at least `fewest` of them even after `seconds`."""

    rounds: int = 7
    fewest: int = 3
    seconds: float = 20.0


def measure(case: Case, effort: Effort, now: Clock = clock) -> Result:
    """Run each contender once, compare the answers, then run rounds, and compare the answers of the last round.

    The order changes from round to round. Different answers give a Result without times.
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
    """The module of a peer. Raises Missing with the remedy."""
    try:
        return importlib.import_module(module)
    except ImportError as why:
        raise Missing(f"{module.split('.')[0]} is not installed ({install})") from why


@dataclass(slots=True)
class Peers:
    """Makes contenders and records missing peers."""

    missing: list[str] = field(default_factory=list)

    def gather(self, *factories: Callable[[], Contender]) -> list[Contender]:
        """The contenders of installed peers, in order."""
        contenders: list[Contender] = []
        for factory in factories:
            try:
                contenders.append(factory())
            except Missing as why:
                if str(why) not in self.missing:
                    self.missing.append(str(why))
        return contenders
