"""Calls listeners with the kernel that a picture waits for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple


class Compiling(NamedTuple):
    """A kernel that is being compiled."""

    name: str
    number: int  # of the kernels that the picture has needed so far, from 1
    total: int  # kernels that the picture is expected to need; at least `number`


Listener = Callable[[Compiling | None], None]
LISTENERS: list[Listener] = []
"""Called in any thread when a compilation starts or ends, with the kernel that is being compiled then; None: no kernel."""

_lock = threading.Lock()
_active: list[Compiling] = []
_compiled = 0
_ready = _total = 0


def expect(total: int) -> None:
    """Count kernels from 0 again, up to an expected number."""
    global _ready, _total
    with _lock:
        _ready, _total = 0, total


def ready() -> None:
    """Count a kernel that was compiled or read from disk."""
    global _ready
    with _lock:
        _ready += 1


def compiled() -> int:
    """How many kernels this process has compiled, or waited for."""
    return _compiled


@contextmanager
def compiling(name: str) -> Iterator[None]:
    """The block compiles a kernel, or waits for a process that compiles it."""
    global _compiled
    event = Compiling(name, _ready + 1, max(_ready + 1, _total))
    with _lock:
        _compiled += 1
        _active.append(event)
    _tell(event)
    try:
        yield
    finally:
        with _lock:
            _active.remove(event)
            outer = _active[-1] if _active else None
        _tell(outer)


def _tell(event: Compiling | None) -> None:
    for listener in LISTENERS:
        listener(event)
