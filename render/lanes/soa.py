"""Structure-of-arrays storage of a wave of paths: vector loads, stores and compaction."""

from __future__ import annotations

from typing import Any

from .. import simd
from ..jit.kernel import helper
from ..types import Lane, Vec

SIZE = 2048  # paths in a wave
PAD = 64  # extra elements for stores of whole vectors
ROW = SIZE + PAD


@helper
def load3(rows: Any, base: int, row: int, i: int) -> Vec:
    """Load a vector of 3D vectors from rows `row` … row + 2, element i on."""
    element = base + row * ROW + i
    return simd.load(rows, element), simd.load(rows, element + ROW), simd.load(rows, element + 2 * ROW)


@helper
def store3(rows: Any, base: int, row: int, i: int, v: Vec) -> None:
    """Store a vector of 3D vectors to rows `row` … row + 2, element i on."""
    element = base + row * ROW + i
    simd.store(rows, element, v[0])
    simd.store(rows, element + ROW, v[1])
    simd.store(rows, element + 2 * ROW, v[2])


@helper
def compress_store(rows: Any, element: int, x: Lane, mask: Lane) -> None:
    """Compress the lanes of a mask and store them from `element` on; overwrites the elements behind them in the row."""
    simd.store(rows, element, simd.compress(x, mask))


@helper
def compress_store3(rows: Any, element: int, v: Vec, mask: Lane) -> None:
    """`compress_store` for a vector of 3D vectors in three rows."""
    compress_store(rows, element, v[0], mask)
    compress_store(rows, element + ROW, v[1], mask)
    compress_store(rows, element + 2 * ROW, v[2], mask)


@helper
def scatter_add(rows: Any, slot: Lane, light: Vec, mask: Lane) -> None:
    """Add light to the radiance of the paths in a mask; each path occurs in one lane only."""
    for k in range(3):
        element = slot + k * ROW
        simd.scatter(rows, element, simd.gather(rows, element, mask) + light[k], mask)


@helper
def gather3(rows: Any, base: int, row: int, k: Lane) -> Vec:
    """Gather 3D vectors from rows `row` … row + 2 at elements k."""
    element = k + (base + row * ROW)
    return rows[element], rows[element + ROW], rows[element + 2 * ROW]
