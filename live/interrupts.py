"""Interrupts a long computation of another thread in Python, such as the evaluation of a scene."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager


class Interrupted(BaseException):
    """Raised in a thread whose block of `running` was interrupted. It passes handlers of Exception."""


class Interruptible:
    """Blocks of one thread that other threads may interrupt: between two operations of Python, not within one of a library."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._thread: int | None = None
        self._began = 0.0
        self._interrupted = False

    @contextmanager
    def running(self) -> Iterator[None]:
        """The block may be interrupted: Interrupted is raised in it or at its end, never after it."""
        with self._lock:
            self._thread, self._began, self._interrupted = threading.get_ident(), time.monotonic(), False
        try:
            yield
        finally:
            try:
                self._end()
            except Interrupted:
                self._end()
                raise
            if self._interrupted:
                raise Interrupted from None

    def _end(self) -> None:
        with self._lock:
            if self._thread is not None and self._interrupted:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), None)  # it comes no more
            self._thread = None

    def interrupt(self, after: float) -> None:
        """Interrupt the block if one has been running for more than `after` seconds."""
        with self._lock:
            if self._thread is None or self._interrupted or time.monotonic() - self._began <= after:
                return
            self._interrupted = True
            ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), ctypes.py_object(Interrupted))
