"""Metering: the exposure that brings what matters of a picture to middle grey."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from . import metrics

MIDDLE_GREY = 0.18
OUTLYING = 3.0  # stops from the median, that count at most
EDGE = 0.4  # weight at the edges of a picture
MOST = 128  # stops of luminance
BINS = 64  # a stop
F64 = NDArray[np.float64]


def center_weights(shape: tuple[int, ...]) -> F64:
    """(…) weights of the pixels of a picture: EDGE at its edges, 1 in its middle."""
    if len(shape) != 2:
        return np.ones(shape)
    y, x = (np.square((2.0 * np.arange(side) + 1.0) / side - 1.0) for side in shape)
    return EDGE + (1.0 - EDGE) * np.exp(-2.0 * (y[:, None] + x))


def count(rgba: NDArray[np.floating], weights: F64) -> F64:
    """(2, bins) weights of pixels, and those times their stops, in bins of stops of luminance.

    Black pixels are left out, and so is the background where nothing covers it. Edges count by what covers them.
    """
    covered = np.clip(np.nan_to_num(rgba[..., 3]), 0.0, 1.0) if rgba.shape[-1] > 3 else np.ones(rgba.shape[:-1])
    y = metrics.luminance(rgba[..., :3]) / np.where(covered > 0.0, covered, 1.0)  # of associated alpha
    lit = np.isfinite(y) & (y > 0.0) & (covered > 0.0)
    weight = (weights * covered)[lit]
    stops = np.clip(np.log2(y[lit]), -MOST, MOST)
    place = ((stops + MOST) * BINS).astype(np.int64)
    return np.stack([np.bincount(place, w, 2 * MOST * BINS + 1).astype(np.float64) for w in (weight, weight * stops)])


def exposure(counts: Sequence[F64]) -> float:
    """Return the exposure in stops that maps the mean logarithm of luminance to middle grey (Reinhard et al. 2002), to 1/100 stop.

    What is more than OUTLYING stops from the median, as a window or a lamp, counts as that far. A black picture gives 0.
    """
    if not len(counts):
        return 0.0
    weight, sums = np.sum(counts, axis=0)
    passed = np.cumsum(weight)
    if not passed[-1] > 0.0:
        return 0.0
    middle = int(np.searchsorted(passed, 0.5 * passed[-1]))
    median = sums[middle] / weight[middle]
    clipped = np.clip(np.divide(sums, weight, out=np.zeros_like(sums), where=weight > 0.0), median - OUTLYING, median + OUTLYING)
    return round(math.log2(MIDDLE_GREY) - float(clipped @ weight / passed[-1]), 2)
