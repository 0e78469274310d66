"""Kernel tables of a scene's implicit surfaces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler.formula.tape import Tape
from ..lanes.kinds import FLOAT, INT
from .llvm_math import ROW

HIT = (FLOAT, INT, FLOAT, FLOAT, INT)
"""Types of a hit: t, spacing, u, v, unproved; see intersect.first_hit."""


class Surface(NamedTuple):
    """An implicit surface before its tables are built: its tape, the row of its geometry's parameters, and its box (2, 3)."""

    tape: Tape
    parameters: NDArray[np.float64]
    bounds: NDArray[np.float64]


HIGH, CELLS_PER_UNIT, BALL_CENTER, BALL_RADIUS, LARGEST_COORDINATE = 3, 6, 9, 12, 13  # columns of Forms.numbers
CELLS_ALONG, IS_SHEET, FIRST_CELL, FIRST_CONSTANT, WHOLE_TAPE, DISCONTINUITY = range(6)  # columns of Forms.places
FIRST_ROW, ROW_COUNT, RESULT = range(3)  # columns of Forms.tapes
FIRST_STEP, STEP_COUNT, FIRST_LEAF = range(3)  # columns of ClosedForms.places
END_BLOCKS, END_LEAVES, END_TAPES, END_ROWS = range(4)
QUADRIC, LINEAR, TORUS, HOLE = 0, 1, 2, 3  # kinds of leaves; a hole is the complement of a torus
NUMBERS = 16  # of a leaf: coefficients of x², y², z², xy, yz, xz, x, y, z and 1; of a torus its frame, major and minor radius


class ClosedForms(NamedTuple):
    """CSG trees of planes, quadrics and tori in kernels; see closed_form_hits.py."""

    places: NDArray[np.int64]  # (surfaces, 3) first step, number of steps, first leaf; no steps: the surface has no closed form
    steps: NDArray[np.int32]  # (n, 2) op, leaf
    kinds: NDArray[np.int32]  # (leaves,)
    numbers: NDArray[np.float64]  # (leaves, NUMBERS)
    kernels: NDArray[np.int64]  # (3,) addresses: closed_form_hits.first_hit, intersect.first_hit, closed_form_hits.crossings


NO_CLOSED_FORMS = ClosedForms(
    np.zeros((0, 3), np.int64), np.zeros((0, 2), np.int32), np.zeros(0, np.int32), np.zeros((0, NUMBERS)), np.zeros(3, np.int64)
)  # fmt: skip


class Forms(NamedTuple):
    """The implicit surfaces of a scene in kernels; rows of `numbers` and `places` are surfaces.

    numbers  lowest x, y, z of the box, highest; cells per unit along x, y, z; center and radius of the ball that clips it (0: none);
             largest coordinate
    places   cells along an axis, whether it is a sheet, first element of its grid and of its constants, its whole tape, kind of
             discontinuities
    blocks   x, y, z and size, in cells, of blocks to be subdivided when a ray reaches them (interval_grid.py), and their tape

    Tapes, rows, blocks and leaves grow; `ends` counts them.
    """

    surface_of: NDArray[np.int32]  # (geometries,) row of a surface, or −1
    numbers: NDArray[np.float64]  # (n, 14)
    places: NDArray[np.int64]  # (n, 6)
    compiled: NDArray[np.int64]  # (n, 3) addresses of the whole tapes' compiled points, gradients and points32; 0: not yet
    grid: NDArray[np.int32]  # marks of cells: see interval_grid.py
    blocks: NDArray[np.int64]  # (blocks, 5)
    states: NDArray[np.int64]  # (blocks,) 0: pending, 1: claimed by a thread, 2: done
    ends: NDArray[np.int64]  # (4,) numbers of blocks, leaves, tapes and rows
    leaf_tape: NDArray[np.int32]
    leaf_slopes: NDArray[np.float64]  # (leaves, 6) bounds of the derivatives by x, y, z
    tapes: NDArray[np.int64]  # (tapes, 3) first row, rows, register of the result
    names: NDArray[np.int32]  # (rows, 4) op and the names of operands
    code: NDArray[np.int32]  # (rows, ROW) the same with registers, for interpreters
    constants: NDArray[np.float64]  # flat
    constants32: NDArray[np.float32]  # flat
    programs: NDArray[np.int64]  # addresses of the interpreters, in the order of scene_surfaces.PROGRAMS
    unproved: NDArray[np.int64]  # (1,) number of rays with a segment not proved to be free of roots
    parts: ClosedForms


_ROWS, _NUMBERS, _FLOATS = np.zeros(0, np.int32), np.zeros(0, np.int64), np.zeros(0)
NO_FORMS = Forms(
    surface_of=_ROWS, numbers=np.zeros((0, 14)), places=np.zeros((0, 6), np.int64), compiled=np.zeros((0, 3), np.int64), grid=_ROWS,
    blocks=np.zeros((0, 5), np.int64), states=_NUMBERS, ends=_NUMBERS, leaf_tape=_ROWS, leaf_slopes=np.zeros((0, 6)),
    tapes=np.zeros((0, 4), np.int64), names=np.zeros((0, 4), np.int32), code=np.zeros((0, ROW), np.int32), constants=_FLOATS,
    constants32=np.zeros(0, np.float32), programs=_NUMBERS, unproved=np.zeros(1, np.int64), parts=NO_CLOSED_FORMS,
)  # fmt: skip


def have_cells(forms: Forms) -> NDArray[np.bool_]:
    """(geometries,) mask of surfaces that are intersected by interval bounds in cells, not by closed forms."""
    rows = np.maximum(forms.surface_of, 0)
    return (forms.surface_of >= 0) & (forms.parts.places[rows, STEP_COUNT] == 0) if len(forms.places) else forms.surface_of >= 0
