"""Kernel tables of CSG trees in closed form, for closed_form_hits.py."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...compiler.formula.closed_form_solids import Leaf, Solid
from .tables import HOLE, LINEAR, NUMBERS, QUADRIC, TORUS, ClosedForms, Forms, Surface

_PAIRS = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def append_closed_forms(forms: Forms, closed: Sequence[tuple[Surface, Solid]]) -> Forms:
    """Append surfaces with closed forms to the tables of the other surfaces."""
    first = len(forms.places)
    numbers, places = np.zeros((len(closed), forms.numbers.shape[1])), np.zeros((len(closed), forms.places.shape[1]), np.int64)
    steps_of = np.zeros((first + len(closed), 3), np.int64)
    steps: list[tuple[int, int]] = []
    leaves: list[Leaf] = []
    for row, ((_, parameters, bounds), solid) in enumerate(closed):
        numbers[row, :6], numbers[row, 9:13], numbers[row, 13] = bounds.ravel(), parameters[1:5], np.abs(bounds).max()
        places[row, 1] = bool(parameters[0])
        steps_of[first + row] = len(steps), len(solid.steps), len(leaves)
        steps += solid.steps
        leaves += solid.leaves
    kinds = np.array([_kind(leaf) for leaf in leaves], np.int32)
    rows = np.array([_row(leaf) for leaf in leaves]).reshape(-1, NUMBERS)
    parts = ClosedForms(steps_of, np.array(steps, np.int32).reshape(-1, 2), kinds, rows, np.zeros(3, np.int64))
    return forms._replace(
        numbers=np.concatenate([forms.numbers, numbers]), places=np.concatenate([forms.places, places]), parts=parts
    )  # fmt: skip


def _kind(leaf: Leaf) -> int:
    if leaf.form is None:
        return HOLE if leaf.outside else TORUS
    return QUADRIC if leaf.form[:3, :3].any() else LINEAR


def _row(leaf: Leaf) -> np.ndarray:
    row = np.zeros(NUMBERS)
    if leaf.torus is not None:
        row[:12], row[12], row[13] = leaf.torus.frame.ravel(), leaf.torus.ring, leaf.torus.tube
    elif leaf.form is not None:
        q = leaf.form
        row[:10] = [*q.diagonal()[:3], *(2 * q[i, j] for i, j in _PAIRS), q[3, 3]]
    return row
