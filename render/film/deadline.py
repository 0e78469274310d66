"""Deadline: the end of a budget of seconds, which counts from the start of a command or call until its picture is written.

Half of the budget remains after a compilation of kernels, which happens once. Other work moves the end by a little at most, see `leave`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from ..jit import compile_events

AFTER_COMPILING = 0.5  # of the budget, that remains at least after kernels were compiled
UNLIMITED = 1 << 40  # samples
CALL = 0.2  # seconds that a call of a renderer may take, between two looks at the clock


class Deadline:
    """The end of a budget. `clock` gives seconds; `began` is a time of it, by default now."""

    def __init__(
        self, seconds: float = math.inf, began: float | None = None, clock: Callable[[], float] = time.perf_counter,
        processed: float | None = None,
    ) -> None:  # fmt: skip
        """`processed` is the CPU time of this process at the beginning, by default now."""
        self.seconds, self.clock = float(seconds), clock
        self.began = clock() if began is None else began
        self.cpu_clock = time.process_time
        self.processed = time.process_time() if processed is None else processed
        self._end = [self.began + self.seconds]  # shared with those of `earlier`
        self._reserved = 0.0

    @classmethod
    def ended(cls, seconds: float, spent: float, cpu: float) -> Deadline:
        """A deadline of which so many seconds, and of CPU, are spent, as another process or an earlier picture has measured."""
        deadline = cls(seconds, 0.0, lambda: spent, 0.0)
        deadline.cpu_clock = lambda: cpu
        return deadline

    @property
    def is_finite(self) -> bool:
        """Whether there is a budget."""
        return math.isfinite(self.seconds)

    @property
    def end(self) -> float:
        """The time of the clock at which the budget is spent."""
        return self._end[0] - self._reserved

    def left(self) -> float:
        """Seconds until the end; negative after it."""
        return self.end - self.clock()

    def is_over(self) -> bool:
        """Whether the budget is spent."""
        return self.clock() >= self.end

    def leave(self, seconds: float) -> None:
        """Let at least so many seconds be left, as of now."""
        if self.is_finite:
            self._end[0] = max(self._end[0], self.clock() + self._reserved + seconds)

    def spent(self) -> float:
        """Seconds since the beginning."""
        return self.clock() - self.began

    def cpu_spent(self) -> float:
        """CPU seconds of all threads of this process since the beginning."""
        return self.cpu_clock() - self.processed

    def earlier(self, seconds: float) -> Deadline:
        """This deadline with `seconds` reserved for what comes after it."""
        deadline = Deadline(self.seconds, self.began, self.clock, self.processed)
        deadline._end, deadline._reserved = self._end, self._reserved + seconds
        return deadline

    def part(self, share: float) -> Deadline:
        """A deadline after this share of the seconds that are left."""
        return Deadline(share * max(self.left(), 0.0), None, self.clock) if self.is_finite else self

    @contextmanager
    def watch_compiler(self) -> Iterator[None]:
        """After a compilation of kernels in the block, let AFTER_COMPILING of the budget remain."""

        def compiled(event: compile_events.Compiling | None) -> None:
            if event is None:
                self._end[0] = max(self._end[0], self.clock() + AFTER_COMPILING * self.seconds)

        if not self.is_finite:
            yield
            return
        compile_events.LISTENERS.append(compiled)
        try:
            yield
        finally:
            compile_events.LISTENERS.remove(compiled)


class Pace:
    """Seconds that a thread takes for a sample, from the calls of a renderer so far; for any threads."""

    KEPT = 64  # of the last calls

    def __init__(self) -> None:
        self._last: list[float] = []
        self.limits = True  # whether calls are limited to CALL seconds

    def add(self, samples: int, seconds: float) -> None:
        """Take in a call."""
        if samples > 0:
            self._last = [*self._last[1 - self.KEPT :], seconds / samples]

    @property
    def seconds(self) -> float:
        """The median; 0 before the first call."""
        return self._at(0.5)

    @property
    def warm(self) -> float:
        """The first quartile: the first calls of a renderer load code and take longer. 0 before the first call."""
        return self._at(0.25)

    def _at(self, share: float) -> float:
        last = sorted(self._last)
        return last[int(share * len(last))] if last else 0.0

    def samples(self) -> int:
        """The samples of a call that takes CALL seconds, at least one; one before the first call. UNLIMITED without a limit."""
        if not self.limits:
            return UNLIMITED
        return max(int(CALL / self.seconds), 1) if self.seconds > 0.0 else 1
