"""Runs jobs on the caller's thread and on idle worker threads.

Waking a thread takes a third of the time of starting one. Power-saving systems wake a thread on the core of the waking thread, which is
busy, and move it a millisecond later, after a third of a frame. So workers are pinned to the other cores where the system supports it.
"""

from __future__ import annotations

import _thread
import ctypes
import os
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

_core_of_caller = getattr(ctypes.CDLL(None), "sched_getcpu", None) if hasattr(os, "sched_setaffinity") else None


class _Worker:
    """A thread that runs jobs from its queue."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[tuple[Callable[[], Any], Callable[[Any], None]]] = queue.SimpleQueue()
        self._cores: set[int] | None = None
        self._number = 0
        started = _thread.allocate_lock()
        started.acquire()
        _thread.start_new_thread(self._run, (started,))
        started.acquire()

    def _run(self, started: Any) -> None:
        self._number = _thread.get_native_id()
        started.release()
        while True:
            work, report = self._jobs.get()
            result = work()
            _idle.append(self)  # before the report, whose receiver may have more work
            report(result)

    def submit(self, work: Callable[[], Any], report: Callable[[Any], None], cores: set[int] | None) -> None:
        """Queue work for this thread, pinned to these cores."""
        if cores is not None and cores != self._cores:
            with suppress(OSError):  # a confined process may not pin threads
                os.sched_setaffinity(self._number, cores)
            self._cores = cores
        self._jobs.put((work, report))


_idle: list[_Worker] = []
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_idle.clear)  # a child process has none of its parent's threads


def _start(work: Callable[[], Any], report: Callable[[Any], None], threads: int) -> None:
    """Run `work`, which raises nothing, in `threads` threads besides this one; each reports its result."""
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
        worker.submit(work, report, cores)


def parallel_for(
    draw: Callable[[Any], Any], jobs: Sequence[Any], threads: int, cancel: threading.Event | None = None,
    on_done: Callable[[Any, Any], None] | None = None, waits: bool = False,
) -> None:  # fmt: skip
    """Call draw(job) for all jobs on up to `threads` threads, the caller's included; report on_done(job, result) on the caller's.

    With `waits`, jobs wait for others: the caller's thread runs none, and reports at once.

    The first exception of a job stops the others and is raised here. Setting `cancel` stops after the running jobs.
    """
    take, lock = iter(jobs), threading.Lock()
    stop = threading.Event()
    results: queue.SimpleQueue[tuple[Any, Any, BaseException | None]] = queue.SimpleQueue()
    nothing = object()

    def next_job() -> Any:
        if stop.is_set() or (cancel is not None and cancel.is_set()):
            return nothing
        with lock:
            return next(take, nothing)

    def loop() -> tuple[Any, Any, BaseException | None]:
        try:
            while (job := next_job()) is not nothing:
                results.put((job, draw(job), None))
        except BaseException as problem:  # raised in the caller's thread
            stop.set()
            return nothing, None, problem
        return nothing, None, None

    running, failure = max(1, min(threads, len(jobs))) - (not waits), None
    _start(loop, results.put, running)
    try:
        while True:
            mine = nothing if waits else next_job()
            if mine is not nothing:
                result = draw(mine)
                if on_done is not None:
                    on_done(mine, result)
            elif not running:
                break
            while running and (mine is nothing or not results.empty()):
                job, result, problem = results.get()
                if job is nothing:
                    running -= 1
                    failure = failure or problem
                elif on_done is not None:
                    on_done(job, result)
    finally:
        stop.set()
        while running:
            running -= results.get()[0] is nothing
    if failure is not None:
        raise failure
