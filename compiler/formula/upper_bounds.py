"""Upper bounds of tapes over the cells of a grid, by interval arithmetic; cells are split where a bound is too high."""

from __future__ import annotations

import numpy as np

from ..ir import F64
from . import numpy_interpreter
from .tape import Tape

FIRST = 4  # cells along each side, to begin with
SPLITS = 4  # times that a cell is halved along each side
MOST_CELLS = 1 << 15  # of one split: more are not split
DENSEST = 1e9  # of the densities of media
SLACK = 16.0 * float(np.finfo(np.float64).eps)  # of a coordinate: cells overlap by it, so that rounded points lie in one
_CORNERS = np.stack(np.meshgrid(*((0.0, 1.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def exceeds(tape: Tape, box: F64, limit: float) -> bool:
    """Whether the first result of a tape is not known to stay below `limit` in a box (2, 3), down to cells of 1/64 of its sides."""
    return bool(over_grid(tape, box, (FIRST, FIRST, FIRST), limit).max() > limit)


def over_grid(tape: Tape, box: F64, cells: tuple[int, int, int], limit: float) -> F64:
    """Bounds (z, y, x) of the first result of a tape on the cells (x, y, z) of a box (2, 3), at least 0; undefined values count as 0.

    Cells with a bound above `limit` are split, and have the highest bound of their parts.
    """
    sides = (box[1] - box[0]) / cells
    places = np.stack(np.meshgrid(*(np.arange(n) for n in cells[::-1]), indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return _over_cells(tape, box[0] + places * sides, sides, limit, SPLITS).reshape(cells[::-1])


def _over_cells(tape: Tape, low: F64, sides: F64, limit: float, splits: int) -> F64:
    """The bounds (n,) on cells with low corners (n, 3)."""
    slack = SLACK * (np.abs(low) + sides)
    high = numpy_interpreter.boxes(tape, (low - slack).T, (low + sides + slack).T)[0][1]
    bounds = np.maximum(np.nan_to_num(np.broadcast_to(np.asarray(high, np.float64), len(low)), nan=0.0, posinf=np.inf), 0.0)
    loose = np.flatnonzero(bounds > limit)
    if splits and 0 < len(loose) <= MOST_CELLS:
        parts = (low[loose, None] + 0.5 * sides * _CORNERS).reshape(-1, 3)
        bounds[loose] = _over_cells(tape, parts, 0.5 * sides, limit, splits - 1).reshape(-1, len(_CORNERS)).max(axis=1)
    return bounds
