"""Fewer runs of Python's cyclic garbage collector while a scene is compiled: nearly all objects are kept."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_YOUNG = 5_000_000  # objects of the youngest generation, at least, before it is examined: some 1 GB
_lock = threading.Lock()
_usual: list[tuple[int, int, int]] = []  # the thresholds before, once for each compilation that runs


@contextmanager
def fewer_collections() -> Iterator[None]:
    """Raise the collector's thresholds inside; the last of several threads that leaves restores them."""
    with _lock:
        _usual.append(gc.get_threshold() if not _usual else _usual[0])
        young, *others = _usual[0]
        gc.set_threshold(max(young, _YOUNG) if young else 0, *others)  # 0: switched off
    try:
        yield
    finally:
        with _lock:
            before = _usual.pop()
            if not _usual:
                gc.set_threshold(*before)
