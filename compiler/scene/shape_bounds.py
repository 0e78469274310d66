"""Bounds under transforms."""

from __future__ import annotations

import numpy as np


def boxes_under(boxes: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """(n, 2, 3) bounds of boxes (n, 2, 3) under matrices (n, 3, 4); ±inf along each axis that an unbounded box extends to."""
    linear, moved = matrices[:, :, :3], matrices[:, :, 3]
    with np.errstate(invalid="ignore"):
        ends = linear[:, :, :, None] * np.swapaxes(boxes, 1, 2)[:, None]  # (n, out, in, low or high)
        ends = np.where(linear[:, :, :, None] == 0, 0.0, ends)
        return np.stack([ends.min(axis=3).sum(axis=2) + moved, ends.max(axis=3).sum(axis=2) + moved], axis=1)
