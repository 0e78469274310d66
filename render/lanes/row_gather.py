"""Several numbers of a table's row at a time, the row in lanes: loaded side by side and turned into columns, where the machine can."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.extending import overload

from .. import simd
from ..jit.kernel import HELPER
from ..types import Lane, Vec


def three_at(table: Any, row: Lane, first: int) -> Vec:
    """Numbers `first` to first + 2 of a row of a table whose rows hold four or more, counted through all its dimensions but the first."""
    flat = table.reshape(len(table), -1)
    return flat[row, first], flat[row, first + 1], flat[row, first + 2]


@overload(three_at, jit_options=HELPER)
def _three_at(table, row, first):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:

        def together(table, row, first):  # four at a time, which begin one earlier where there is something before
            before = 1 if first > 0 else 0
            found = simd.gather_rows(table, row * _row_length(table), 4, first - before)
            if before:
                return found[1], found[2], found[3]
            return found[0], found[1], found[2]

        return together
    if table.ndim == 3:
        return lambda table, row, first: (
            table[row, first // 3, first % 3], table[row, (first + 1) // 3, (first + 1) % 3], table[row, (first + 2) // 3, (first + 2) % 3]
        )  # fmt: skip
    return lambda table, row, first: (table[row, first], table[row, first + 1], table[row, first + 2])


def four_at(table: Any, row: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """A row of an (n, 4) table."""
    return table[row, 0], table[row, 1], table[row, 2], table[row, 3]


@overload(four_at, jit_options=HELPER)
def _four_at(table, row):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:
        return lambda table, row: simd.gather_rows(table, row * 4, 4)
    return lambda table, row: (table[row, 0], table[row, 1], table[row, 2], table[row, 3])


def eight_at(table: Any, row: Lane, first: int) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]:
    """Numbers `first` to first + 7 of a row of a table, counted through all its dimensions but the first."""
    return tuple(table.reshape(len(table), -1)[row, first + k] for k in range(8))


@overload(eight_at, jit_options=HELPER)
def _eight_at(table, row, first):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:
        return lambda table, row, first: simd.gather_rows(table, row * _row_length(table), 8, first)

    def each(table, row, first):
        at = row * _row_length(table) + first
        return (
            simd.read(table, at), simd.read(table, at + 1), simd.read(table, at + 2), simd.read(table, at + 3), simd.read(table, at + 4),
            simd.read(table, at + 5), simd.read(table, at + 6), simd.read(table, at + 7),
        )  # fmt: skip

    return each


def _row_length(table: Any) -> Any:
    """How many numbers there are in a row of a table, counted through all its dimensions but the first."""
    return int(np.prod(table.shape[1:]))


@overload(_row_length, jit_options=HELPER)
def _row_length_in_kernels(table):
    return (lambda table: table.shape[1]) if table.ndim == 2 else (lambda table: table.shape[1] * table.shape[2])
