"""Packets of rays as structure of arrays (8, n or more): x, y, z of origins and of directions, t_min, t_max."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper
from ..types import Lane, Vec
from . import crosslane


@helper
def get(columns: Any, column: int) -> tuple[Vec, Vec, Lane, Lane]:
    """Load WIDTH rays from column `column`: (origin, direction, t_min, t_max)."""
    return get_of(columns, columns.shape[1], column)


@helper
def get_of(columns: Any, n: int, column: int) -> tuple[Vec, Vec, Lane, Lane]:
    """`get` for a flat array whose rows hold n rays each."""
    o = crosslane.load_row(columns, column), crosslane.load_row(columns, n + column), crosslane.load_row(columns, 2 * n + column)
    d = (
        crosslane.load_row(columns, 3 * n + column),
        crosslane.load_row(columns, 4 * n + column),
        crosslane.load_row(columns, 5 * n + column),
    )
    return o, d, crosslane.load_row(columns, 6 * n + column), crosslane.load_row(columns, 7 * n + column)


@helper
def put(columns: Any, column: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> None:
    """Store WIDTH rays from column `column` on, all lanes, in the layout of `get`."""
    n = columns.shape[1]
    for axis in range(3):
        o, d = (origin[0], direction[0]) if axis == 0 else (origin[1], direction[1]) if axis == 1 else (origin[2], direction[2])
        crosslane.store_row(columns, axis * n + column, o)
        crosslane.store_row(columns, (3 + axis) * n + column, d)
    crosslane.store_row(columns, 6 * n + column, t_min)
    crosslane.store_row(columns, 7 * n + column, t_max)
