"""The groups of sixteen pixels that share paths, spread over a square cell of the picture's grid.

A bright path shows at all sixteen pixels of its group. Neighbors in one group show it as a square, and a denoiser takes it for a detail. So
a cell is divided into 4 × 4 parts, and a group has one pixel of each part. A hash of the part decides which one. Errors of neighbors are
then independent. The pixels of a group have sixteen adjacent ranges of one sequence (sobol.zorder_index), so that the paths that they share
are as well stratified as one pixel's samples. Light samples of first surfaces are not shared and keep the order of neighbors. All
pixels of a cell have equal samples.
"""

from __future__ import annotations

from ..jit.kernel import helper
from . import sobol

SIDE = 4  # parts of a cell along a side
GROUP = SIDE * SIDE  # pixels of a group
CELL = 32  # pixels of a cell along a side


@helper
def cell_extent(start: int, size: int) -> int:
    """The pixels of the cell that starts at a column or row of a picture of this size, a multiple of SIDE."""
    return min(CELL, -((start - size) // SIDE) * SIDE)


@helper
def place_of(cell_x: int, cell_y: int, columns: int, rows: int, x: int, y: int, part: int) -> tuple[int, int]:
    """The pixel of group x, y in one of the sixteen parts of the cell at left, top, of so many columns and rows.

    Groups number the pixels of a part in order, shifted cyclically by hashed numbers.
    """
    u, v = sobol.hashed_pair(cell_x, cell_y, part, 0)
    width, height = columns // SIDE, rows // SIDE
    column = cell_x + part % SIDE * width + (x + int(u * width)) % width
    return column, cell_y + part // SIDE * height + (y + int(v * height)) % height
