"""Cancels the preparation of a picture between two of its parts, such as the BVHs of two meshes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_event: ContextVar[threading.Event | None] = ContextVar("cancellation", default=None)


class Cancelled(Exception):
    """The picture that was being prepared is not wanted any more."""


@contextmanager
def cancelled_by(event: threading.Event | None) -> Iterator[None]:
    """In this thread, `check` raises Cancelled in the block once the event is set."""
    token = _event.set(event)
    try:
        yield
    finally:
        _event.reset(token)


def check() -> None:
    """Raise Cancelled if the picture was cancelled."""
    event = _event.get()
    if event is not None and event.is_set():
        raise Cancelled
