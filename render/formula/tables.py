"""The formula surfaces of a scene as kernels read them; what makes them ready is loaded by scenes that hold some."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler.formula.tape import Tape
from ..lanes.kinds import FLOAT, INT
from .llvm_math import ROW

MET = (FLOAT, INT, FLOAT, FLOAT, INT)
"""Types of what is said of a meeting: t, spacing, u, v, unproved; see meet.py."""


class Surface(NamedTuple):
    """An implicit surface before its tables are built: tape, the row of its geometry's parameters, and its box (2, 3)."""

    tape: Tape
    parameters: NDArray[np.float64]
    bounds: NDArray[np.float64]


END_BLOCKS, END_LEAVES, END_TAPES, END_ROWS = range(4)
QUADRIC, LINEAR, TORUS, HOLE = 0, 1, 2, 3  # kinds of leaves; a hole is where a torus is not
NUMBERS = 16  # of a leaf: coefficients of x², y², z², xy, yz, xz, x, y, z and 1; of a torus its frame, its ring and its tube


class Parts(NamedTuple):
    """Solids of planes, quadrics and tori as kernels read them; see exact.py."""

    places: NDArray[np.int64]  # (surfaces, 3) first step, how many; first leaf; no steps: a surface that has no closed form
    steps: NDArray[np.int32]  # (n, 2) op, leaf
    kinds: NDArray[np.int32]  # (leaves,)
    numbers: NDArray[np.float64]  # (leaves, NUMBERS)
    ways: NDArray[np.int64]  # (3,) addresses: what meets these, what meets other formulas, `crossings` of tori


NO_PARTS = Parts(
    np.zeros((0, 3), np.int64), np.zeros((0, 2), np.int32), np.zeros(0, np.int32), np.zeros((0, NUMBERS)), np.zeros(3, np.int64)
)  # fmt: skip


class Forms(NamedTuple):
    """The formula surfaces of a scene, as kernels read them; rows of `numbers` and `places` are surfaces.

    numbers  lowest x, y, z of the box, highest; cells in a unit along x, y, z; middle and radius of the ball that cuts it (0: none);
             largest coordinate
    places   cells along an axis, whether it is a sheet, where its grid and its constants (elements) begin, its whole tape
    blocks   x, y, z and size, in cells, of what is cut up when a ray comes to it (cells.py), and its tape

    Tapes, rows, blocks and leaves grow; `ends` says how many there are.
    """

    of: NDArray[np.int32]  # (geometries,) row of a surface, or -1
    numbers: NDArray[np.float64]  # (n, 14)
    places: NDArray[np.int64]  # (n, 5)
    compiled: NDArray[np.int64]  # (n, 3) addresses of the whole tapes' own code for points, turns and points in float32; 0: none yet
    grid: NDArray[np.int32]  # what is in a cell: see cells.py
    blocks: NDArray[np.int64]  # (blocks, 5)
    states: NDArray[np.int64]  # (blocks,) 0: to be cut up, 1: a thread is at it, 2: done
    ends: NDArray[np.int64]  # (4,) how many blocks, leaves, tapes and rows there are
    leaf_tape: NDArray[np.int32]
    leaf_slopes: NDArray[np.float64]  # (leaves, 6) bounds of the derivatives by x, y, z
    tapes: NDArray[np.int64]  # (tapes, 3) first row, rows, register of the result
    names: NDArray[np.int32]  # (rows, 4) op and the names of operands
    code: NDArray[np.int32]  # (rows, ROW) the same with registers, as interpreters take it
    constants: NDArray[np.float64]  # flat
    constants32: NDArray[np.float32]  # flat
    programs: NDArray[np.int64]  # addresses of the interpreters, in the order of PROGRAMS
    unproved: NDArray[np.int64]  # (1,) rays of which a stretch could not be proved to be without a root
    parts: Parts  # of surfaces that are made of planes, quadrics and tori


_ROWS, _NUMBERS, _FLOATS = np.zeros(0, np.int32), np.zeros(0, np.int64), np.zeros(0)
NO_FORMS = Forms(
    of=_ROWS, numbers=np.zeros((0, 14)), places=np.zeros((0, 5), np.int64), compiled=np.zeros((0, 3), np.int64), grid=_ROWS,
    blocks=np.zeros((0, 5), np.int64), states=_NUMBERS, ends=_NUMBERS, leaf_tape=_ROWS, leaf_slopes=np.zeros((0, 6)),
    tapes=np.zeros((0, 3), np.int64), names=np.zeros((0, 4), np.int32), code=np.zeros((0, ROW), np.int32), constants=_FLOATS,
    constants32=np.zeros(0, np.float32), programs=_NUMBERS, unproved=np.zeros(1, np.int64), parts=NO_PARTS,
)  # fmt: skip


def have_cells(forms: Forms) -> NDArray[np.bool_]:
    """(geometries,) which are surfaces that rays meet by bounds in cells, and not by closed forms."""
    rows = np.maximum(forms.of, 0)
    return (forms.of >= 0) & (forms.parts.places[rows, 1] == 0) if len(forms.places) else forms.of >= 0
