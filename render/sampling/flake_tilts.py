"""Quantiles of the tilts of flakes, and the width that facets have with a part of these tilts.

Facets of α = c and tilts of this law are together GGX facets of α = 1, exactly: slopes of GGX are self-decomposable. So a filter may take
tilts away and widen the facets, and no mean changes. tools/flake_tilts.py writes the quantiles to flake_tilts.json.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..types import Lane

ROWS, COLUMNS = 13, 33
WIDEST = 0.999  # greatest c
FARTHEST = 1e-4  # least share of flakes that tilt more

F64 = NDArray[np.float64]


def shares() -> F64:
    """Return (ROWS,) c of each row, at even steps of acos √c, from 1 down to 0."""
    return np.clip(np.cos(np.linspace(0.0, 0.5 * math.pi, ROWS)) ** 2, 0.0, WIDEST)


def places() -> F64:
    """Return (COLUMNS,) probability of each column."""
    return 1.0 - np.linspace(1.0, 0.0, COLUMNS) ** 2


@lru_cache(maxsize=1)
def table() -> F64:
    """Return (ROWS · COLUMNS, 4) quantiles of a column and the next, in this row and in the next, over those of a t distribution."""
    each = np.array(json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8")), np.float64)
    each = np.pad(each, ((0, 1), (0, 1)), mode="edge")
    quads = np.stack([each[:-1, :-1], each[:-1, 1:], each[1:, :-1], each[1:, 1:]], axis=-1)
    return np.ascontiguousarray(quads.reshape(-1, 4))


@helper
def size_of_tilt(quads: F64, c: Lane, u: Lane) -> Lane:
    """The slope of a flake over the α of all, for facets of c times this α; `u` from 0 to 1 is the flake's number."""
    rest = 1.0 - ops.clip(u, 0.0, 1.0 - FARTHEST)
    share = ops.clip(c, 0.0, 1.0)
    across, down = (1.0 - ops.sqrt(rest)) * (COLUMNS - 1.0), ops.acos(ops.sqrt(share)) * ((ROWS - 1.0) / (0.5 * math.pi))
    column, row = ops.minimum(ops.floor_int(across), COLUMNS - 2), ops.minimum(ops.floor_int(down), ROWS - 2)
    x, y = across - ops.to_float(column), down - ops.to_float(row)
    first, second, third, fourth = row_gather.four_at(quads, row * COLUMNS + column)
    scale = ops.lerp(ops.lerp(first, second, x), ops.lerp(third, fourth, x), y)
    return scale * ops.sqrt((1.0 - share * share) * (1.0 - rest) / rest)
