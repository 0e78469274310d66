"""Requests to a cluster and their answers; the error of a cluster that cannot answer."""

from __future__ import annotations

import math
import threading
import time
from typing import Any, NamedTuple

from ..packing import Arrays
from . import messages


class ClusterError(ConnectionError):
    """A cluster that cannot be used, or that has no worker left. The message is a sentence with the reason."""


class Work(NamedTuple):
    """A picture that requests are about."""

    parcel: messages.Parcel
    plan: list[list[Any]]  # of packing.plan_to


class Request:
    """A request about a picture, and its answer."""

    def __init__(
        self, work: Work, about: dict[str, Any], arrays: Arrays, cost: float, cancel: threading.Event | None = None,
        deadline: float = math.inf,
    ) -> None:  # fmt: skip
        """`cost` is in samples; `deadline` a time of time.perf_counter, after which no answer is wanted."""
        self.work, self.about, self.arrays, self.cost, self.deadline = work, about, arrays, cost, deadline
        self.asked = time.perf_counter()
        self.urgent = False  # before others that wait
        self.cancel = cancel
        self.failures = 0  # answers that were errors
        self.losses = 0  # workers that ended while they had it
        self.running = 0  # messages on their way that hold it
        self.answer: tuple[dict[str, Any], dict[str, Any]] | None = None
        self.fault: ClusterError | None = None
        self._done = threading.Event()

    @property
    def kind(self) -> str:
        """What is asked for."""
        return self.about["do"]

    @property
    def whole(self) -> bool:
        """Whether the request takes all threads of a worker."""
        return self.kind == "picture"

    @property
    def done(self) -> bool:
        """Whether there is an answer, a fault or no wish for one any more."""
        return self._done.is_set()

    def finish(self, answer: tuple[dict[str, Any], dict[str, Any]] | None, fault: ClusterError | None = None) -> None:
        """Set the answer, unless there is one. None: cancelled, or after the deadline."""
        if not self.done:
            self.answer, self.fault = answer, fault
            self._done.set()

    def is_unwanted(self, now: float) -> bool:
        """Whether it was cancelled, or its deadline is over."""
        return now > self.deadline or (self.cancel is not None and self.cancel.is_set())

    def wait(self) -> tuple[dict[str, Any], dict[str, Any]] | None:
        """The answer, when it is there; None if it is not wanted any more. Raises ClusterError."""
        self._done.wait()
        if self.fault is not None:
            raise self.fault
        return self.answer
