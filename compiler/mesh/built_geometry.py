"""Geometry that takes long to make: whether it is made at all, and how long it took.

`check` makes none: text, heightfields and solids have the boxes around them in its scenes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from ...lang.diagnostics import Span
from ..ir import F64
from ..scene.row_records import MeshData

THIN = 1e-6  # of the longest side of a box
LEAST = 0.05  # seconds, from which a record is kept

_left_out: ContextVar[bool] = ContextVar("left_out", default=False)
_records: ContextVar[list[Cost] | None] = ContextVar("records", default=None)
_parts: ContextVar[dict[str, list[float]] | None] = ContextVar("parts", default=None)


class Cost(NamedTuple):
    """A shape whose geometry took long."""

    kind: str
    span: Span | None
    seconds: float
    parts: tuple[tuple[str, int, float], ...]  # (what was done, how often, seconds), longest first


@contextmanager
def left_out() -> Iterator[None]:
    """In the block, scenes have boxes in place of geometry that takes long to make."""
    token = _left_out.set(True)
    try:
        yield
    finally:
        _left_out.reset(token)


def is_left_out() -> bool:
    """Whether boxes stand in for geometry."""
    return _left_out.get()


@contextmanager
def recorded() -> Iterator[list[Cost]]:
    """In the block, note the shapes whose geometry takes LEAST seconds or more."""
    costs: list[Cost] = []
    token = _records.set(costs)
    try:
        yield costs
    finally:
        _records.reset(token)


@contextmanager
def timed(kind: str, span: Span | None) -> Iterator[None]:
    """Note the seconds of a shape; those of the shapes in it count as its own."""
    records = _records.get()
    if records is None or _parts.get() is not None:
        yield
        return
    parts: dict[str, list[float]] = {}
    token, began = _parts.set(parts), time.perf_counter()
    try:
        yield
    finally:
        _parts.reset(token)
        if (seconds := time.perf_counter() - began) >= LEAST:
            listed = sorted(((what, len(each), sum(each)) for what, each in parts.items()), key=lambda part: -part[2])
            records.append(Cost(kind, span, seconds, tuple(listed)))


@contextmanager
def part(what: str) -> Iterator[None]:
    """Note the seconds of a part of the work for a shape."""
    parts, began = _parts.get(), time.perf_counter()
    try:
        yield
    finally:
        if parts is not None:
            parts.setdefault(what, []).append(time.perf_counter() - began)


def box(low: F64, high: F64, closed: bool = False) -> MeshData:
    """The box between two corners, in place of a mesh. Flat ones get a small thickness.

    One that is not `closed` lacks a side, so that nothing counts as inside of it.
    """
    size = np.maximum(high - low, THIN * max(float((high - low).max()), 1e-9))
    middle = 0.5 * (low + high)
    corners = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)]) - 0.5
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)][: 6 if closed else 5]
    return MeshData(middle + corners * size, np.array([(q[0], q[k], q[k + 1]) for q in quads for k in (1, 2)]))
