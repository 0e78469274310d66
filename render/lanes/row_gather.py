"""Gathers of neighbouring numbers of table rows: one vector load a lane, then a transpose, where the machine supports it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..simd.registration import overload
from ..types import Lane, Vec


def three_at(table: Any, row: Lane, first: int) -> Vec:
    """Gather numbers first … first + 2 of table rows of four numbers or more; `first` counts in the flattened row."""
    flat = table.reshape(len(table), -1)
    return flat[row, first], flat[row, first + 1], flat[row, first + 2]


@overload(three_at)
def _three_at(table, row, first):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:

        def gather(table, row, first):  # loads four numbers; begins one earlier unless first is 0, to stay inside the row
            before = 1 if first > 0 else 0
            x = simd.gather_rows(table, row * _row_length(table), 4, first - before)
            if before:
                return x[1], x[2], x[3]
            return x[0], x[1], x[2]

        return gather
    if table.ndim == 3:
        return lambda table, row, first: (
            table[row, first // 3, first % 3], table[row, (first + 1) // 3, (first + 1) % 3], table[row, (first + 2) // 3, (first + 2) % 3]
        )  # fmt: skip
    return lambda table, row, first: (table[row, first], table[row, first + 1], table[row, first + 2])


def four_at(table: Any, row: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """Gather rows of an (n, 4) table."""
    return table[row, 0], table[row, 1], table[row, 2], table[row, 3]


@overload(four_at)
def _four_at(table, row):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:
        return lambda table, row: simd.gather_rows(table, row * 4, 4)
    return lambda table, row: (table[row, 0], table[row, 1], table[row, 2], table[row, 3])


def eight_at(table: Any, row: Lane, first: int) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]:
    """Gather numbers first … first + 7 of table rows; `first` counts in the flattened row."""
    return tuple(table.reshape(len(table), -1)[row, first + k] for k in range(8))


@overload(eight_at)
def _eight_at(table, row, first):
    if isinstance(row, simd.Vector) and row.bits == table.dtype.bitwidth:
        return lambda table, row, first: simd.gather_rows(table, row * _row_length(table), 8, first)

    if isinstance(row, simd.Vector):  # a table of another width
        return lambda table, row, first: (
            table[row, first], table[row, first + 1], table[row, first + 2], table[row, first + 3],
            table[row, first + 4], table[row, first + 5], table[row, first + 6], table[row, first + 7],
        )  # fmt: skip

    def scalar(table, row, first):
        element = row * _row_length(table) + first
        return (
            simd.read(table, element), simd.read(table, element + 1), simd.read(table, element + 2), simd.read(table, element + 3),
            simd.read(table, element + 4), simd.read(table, element + 5), simd.read(table, element + 6), simd.read(table, element + 7),
        )  # fmt: skip

    return scalar


def _row_length(table: Any) -> Any:
    """Count the numbers of a flattened table row."""
    return int(np.prod(table.shape[1:]))


@overload(_row_length)
def _row_length_in_kernels(table):
    return (lambda table: table.shape[1]) if table.ndim == 2 else (lambda table: table.shape[1] * table.shape[2])
