"""Rays of a bundle as columns (8, n or a few more): x, y, z of origins and directions, first and last distance."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..types import Lane, Vec
from . import crosslane


@helper
def get(columns: Any, at: int) -> tuple[Vec, Vec, Lane, Lane]:
    """Origins and directions of rays `at` on, and their first and last distance."""
    return get_of(columns, columns.shape[1], at)


@helper
def get_of(columns: Any, n: int, at: int) -> tuple[Vec, Vec, Lane, Lane]:
    """The same of columns of n rays, one behind the other."""
    o = crosslane.load_row(columns, at), crosslane.load_row(columns, n + at), crosslane.load_row(columns, 2 * n + at)
    d = crosslane.load_row(columns, 3 * n + at), crosslane.load_row(columns, 4 * n + at), crosslane.load_row(columns, 5 * n + at)
    return o, d, crosslane.load_row(columns, 6 * n + at), crosslane.load_row(columns, 7 * n + at)


@helper
def put(columns: Any, at: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> None:
    """Write rays `at` on, all lanes of each, as `get` reads them."""
    n = columns.shape[1]
    for axis in range(3):
        o, d = (origin[0], direction[0]) if axis == 0 else (origin[1], direction[1]) if axis == 1 else (origin[2], direction[2])
        crosslane.store_row(columns, axis * n + at, o)
        crosslane.store_row(columns, (3 + axis) * n + at, d)
    crosslane.store_row(columns, 6 * n + at, t_min)
    crosslane.store_row(columns, 7 * n + at, t_max)
