"""Upper bounds of tapes over boxes, by interval arithmetic on cells that are split where a bound is too high."""

from __future__ import annotations

import numpy as np

from ..ir import F64
from . import numpy_interpreter
from .tape import Tape

FIRST = 4  # cells along each side
SPLITS = 4  # times that a cell is halved along each side
MOST_CELLS = 1 << 15  # of one split: more are not looked at


def exceeds(tape: Tape, box: F64, limit: float) -> bool:
    """Whether the first result of a tape is not known to stay below `limit` in a box (2, 3), down to cells of 1/64 of its sides."""
    sides = (box[1] - box[0]) / FIRST
    corners = np.stack(np.meshgrid(*(np.arange(FIRST),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    low = box[0] + corners * sides
    for split in range(SPLITS + 1):
        high = numpy_interpreter.boxes(tape, low.T, (low + sides).T)[0][1]
        low = low[np.broadcast_to(np.asarray(high, np.float64), len(low)) > limit]
        if not len(low) or len(low) > MOST_CELLS or split == SPLITS:
            return len(low) > 0
        sides = 0.5 * sides
        halves = np.stack(np.meshgrid(*((0.0, 1.0),) * 3, indexing="ij"), axis=-1).reshape(-1, 3) * sides
        low = (low[:, None] + halves).reshape(-1, 3)
    return False
