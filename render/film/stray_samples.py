"""Stray bright samples: the share of a picture's error that they have. How many a picture has, and which it lacks, is chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FEW = 1000  # the pixels of a picture over those with the largest errors that are looked at
SPARSE = 16  # pixels, of which one is looked at first
BRIGHTER = 1.25  # times the brightest of its neighbors, from which on a pixel holds a stray bright sample
DECIDES = 0.5  # of what a pixel is brighter by, from which on the difference of its halves shows that few samples make it so


def share_of_error(relative: NDArray[np.float64], rgba: NDArray[np.float32], differences: NDArray[np.float32]) -> float:
    """The share of the squared error (h, w) in those of its worst 0.1 % of pixels that hold a stray bright sample.

    Such a sample makes a pixel brighter than all around it, and one half of its samples brighter than the other: see the `differences`
    (h, w, 3) of accumulate.add_samples. A pixel at an edge has a large error as well, and lies between its neighbors. A small lamp lights
    many samples of its pixel. Errors that are not finite do not count. A picture of less than FEW pixels has none: its worst pixel is more
    than 0.1 % of it.
    """
    is_finite = np.isfinite(relative)
    finite = relative if is_finite.all() else np.where(is_finite, relative, 0.0)
    total, width = float(finite.sum()), finite.shape[1]
    if total <= 0.0 or finite.size < FEW:
        return 0.0
    few = finite.size // FEW
    y, x = np.divmod(_largest(finite.reshape(-1), few), width)
    center, second = _light(rgba, y, x), np.zeros(few)
    for down, right in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        v, u = y + down, x + right
        inside = (v >= 0) & (v < len(rgba)) & (u >= 0) & (u < width)
        light = np.nan_to_num(_light(rgba, np.where(inside, v, y), np.where(inside, u, x)))
        second = np.maximum(second, np.where(inside, light, 0.0))
    halves = np.abs(differences[y, x]).sum(axis=1, dtype=np.float64)
    stray = (center > BRIGHTER * second) & (halves > DECIDES * (center - second))
    return float(finite[y, x][stray].sum()) / total


def _largest(values: NDArray[np.float64], few: int) -> NDArray[np.intp]:
    """Numbers of the `few` largest values: those of a part bound them from below, and most are less."""
    part = values[::SPARSE]
    if len(part) > few:
        bound = np.partition(part, -few)[-few]
        over = np.flatnonzero(values >= bound)
    else:
        over = np.arange(len(values))
    return over[np.argpartition(values[over], -few)[-few:]]


def _light(rgba: NDArray[np.float32], y: NDArray[np.intp], x: NDArray[np.intp]) -> NDArray[np.float64]:
    """(n,) sums of red, green and blue of pixels."""
    return np.abs(rgba[y, x, :3]).sum(axis=1, dtype=np.float64)
