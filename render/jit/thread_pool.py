"""Jobs on several threads, one of which is the caller's; the others wait for the next time.

To wake a thread takes a third of the time of making one. Systems that save power wake it on the core of whoever wakes it, which is
busy, and look a millisecond later whether another is free, after a third of a frame: where a thread can be kept off a core, it is kept
off its caller's.
"""

from __future__ import annotations

import _thread
import ctypes
import os
import queue
import threading
from collections.abc import Callable, Sequence
from typing import Any

_core_of_caller = getattr(ctypes.CDLL(None), "sched_getcpu", None) if hasattr(os, "sched_setaffinity") else None


class _Worker:
    """A thread that does what it is given, and is idle then."""

    def __init__(self) -> None:
        self._given: queue.SimpleQueue[tuple[Callable[[], Any], Callable[[Any], None]]] = queue.SimpleQueue()
        self._cores: set[int] | None = None
        self._number = 0
        begun = _thread.allocate_lock()
        begun.acquire()
        _thread.start_new_thread(self._run, (begun,))
        begun.acquire()

    def _run(self, begun: Any) -> None:
        self._number = _thread.get_native_id()
        begun.release()
        while True:
            work, report = self._given.get()
            result = work()
            _idle.append(self)  # before anyone hears of it, who might have more to do
            report(result)

    def give(self, work: Callable[[], Any], report: Callable[[Any], None], cores: set[int] | None) -> None:
        """Do this, on one of these cores."""
        if cores is not None and cores != self._cores:
            os.sched_setaffinity(self._number, cores)
            self._cores = cores
        self._given.put((work, report))


_idle: list[_Worker] = []
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a child has none of its parent's threads


def _begin(work: Callable[[], Any], report: Callable[[Any], None], threads: int) -> None:
    """Run `work`, which raises nothing, in so many threads besides this one; each reports what it returns."""
    cores = None
    if _core_of_caller is not None:
        allowed = os.sched_getaffinity(0)
        others = allowed - {_core_of_caller()}
        cores = others if threads <= len(others) else allowed
    for _ in range(threads):
        try:
            worker = _idle.pop()
        except IndexError:
            worker = _Worker()
        worker.give(work, report, cores)


def parallel_for(
    draw: Callable[[Any], Any], jobs: Sequence[Any], threads: int, cancel: threading.Event | None = None,
    told: Callable[[Any, Any], None] | None = None,
) -> None:  # fmt: skip
    """Do jobs on several threads, of which this is one, but no more than there are jobs; told(job, result) follows each, here. The first
    exception ends it, here.

    Setting `cancel` ends it after the jobs that have begun.
    """
    take, lock = iter(jobs), threading.Lock()
    stop = threading.Event()
    results: queue.SimpleQueue[tuple[Any, Any, BaseException | None]] = queue.SimpleQueue()
    nothing = object()

    def following() -> Any:
        if stop.is_set() or (cancel is not None and cancel.is_set()):
            return nothing
        with lock:
            return next(take, nothing)

    def loop() -> tuple[Any, Any, BaseException | None]:
        try:
            while (job := following()) is not nothing:
                results.put((job, draw(job), None))
        except BaseException as problem:  # whatever it is, it is raised in the caller's thread
            stop.set()
            return nothing, None, problem
        return nothing, None, None

    running, failure = max(1, min(threads, len(jobs))) - 1, None
    _begin(loop, results.put, running)
    try:
        while True:
            mine = following()
            if mine is not nothing:
                result = draw(mine)
                if told is not None:
                    told(mine, result)
            elif not running:
                break
            while running and (mine is nothing or not results.empty()):
                job, result, problem = results.get()
                if job is nothing:
                    running -= 1
                    failure = failure or problem
                elif told is not None:
                    told(job, result)
    finally:
        stop.set()
        while running:
            running -= results.get()[0] is nothing
    if failure is not None:
        raise failure
