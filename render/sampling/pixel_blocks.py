"""The blocks of 4 × 4 pixels that share paths, and their shifts from sample to sample.

Errors are alike inside of a block and independent of those beside it: blocks at fixed places show as squares. So a pixel's samples form
four groups of consecutive samples, each with a shift of its own: two neighbors are in one block in three groups, wherever they lie. In a
cell of 32 × 32 pixels of the picture's grid the shift is cyclic: a block at the cell's border has pixels at both ends, so that no path is
traced for more than one block.
"""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper

SIDE = 4  # pixels of a block
BLOCK = SIDE * SIDE
CELL = 32  # pixels of a cell
LONGEST = 4  # binary logarithm of the most consecutive samples of a group


@helper
def cell_extent(start: int, size: int) -> int:
    """The pixels of the cell that starts at a column or row of a picture of this size, in whole blocks."""
    return min(CELL, -((start - size) // SIDE) * SIDE)


@helper
def shift_of(sample: int, total: int) -> tuple[int, int]:
    """(columns, rows) by which the blocks of a sample are shifted; consecutive samples are well stratified and stay together."""
    length = 0
    while length < LONGEST and (8 << length) <= total:
        length += 1
    group = (sample >> length) & 3
    return group, (group >> 1) + 2 * (group & 1)


@helper
def position_in(start: int, extent: int, offset: int) -> int:
    """The column or row at an offset, cyclic, of a cell."""
    return start + offset % extent


@helper
def reaches(start: int, extent: int, offset: int, low: int, high: int) -> bool:
    """Whether a column or row of the block at an offset lies in low … high - 1."""
    for k in range(SIDE):
        at = position_in(start, extent, offset + k)
        if (low <= at) & (at < high):
            return True
    return False


@helper
def are_equal(counts: Any) -> bool:
    """Whether all entries of (h, w) are equal."""
    for row in counts:
        for count in row:
            if count != counts[0, 0]:
                return False
    return True
