"""Where more samples are worth most: how often each pixel's number of samples is doubled, for an error or for so many samples.

A doubling of a pixel's n samples takes about half of the variance r of its mean, for n more samples: it is worth r / n. Taking
doublings in the order of their worth, down to one threshold for all pixels, reaches an error with the fewest samples (with
r = v / n, n ∝ √v: Neyman's allocation, Cochran, "Sampling Techniques", §5.5). Numbers of samples stay powers of two times the
first, where Sobol points are spread best.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_DOUBLINGS = 2  # of a pixel in a round: what is known of it from n samples is not trusted further than for 4 n
_LADDER = 12  # doublings looked ahead, to see how far it is worth going in the end
LEFT = 0.5  # of a pixel's variance after a doubling
_BINS = 16  # thresholds an octave of worth


def doublings_for_error(relative: Map, samples: Counts, most: int, mean: float) -> NDArray[np.int64]:
    """(h, w) doublings of each pixel's samples, so that the mean of `relative` over all pixels is expected to fall to `mean`.

    `relative` (h, w): variance of each pixel's mean over its squared value. No pixel goes beyond `most` samples.
    """
    variances, _, worth = _ladder(relative, samples, most)
    too_much = (float(np.mean(relative)) - mean) * relative.size
    return _doublings(worth, _threshold(worth, variances, too_much))


def doublings_for_samples(relative: Map, samples: Counts, most: int, more: float) -> NDArray[np.int64]:
    """(h, w) doublings of each pixel's samples that take about `more` samples in all, at most, where they are worth most."""
    _, costs, worth = _ladder(relative, samples, most)
    return _doublings(worth, _threshold(worth, costs, more, within=True))


def smoothed(relative: Map, samples: Counts) -> NDArray[np.float64]:
    """`relative` from the variance of a sample as each pixel and its neighbours know it (3 by 3, fewer at the borders).

    A few samples tell little of one pixel alone.
    """
    total = relative * samples
    count = np.ones_like(total)
    for axis in (0, 1):
        total, count = _three(total, axis), _three(count, axis)
    return total / (count * samples)


def _three(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    total = values.copy()
    there, here = np.moveaxis(total, axis, 0), np.moveaxis(values, axis, 0)
    there[1:] += here[:-1]
    there[:-1] += here[1:]
    return total


def _ladder(relative: Map, samples: Counts, most: int) -> tuple[Map, Map, Map]:
    """(_LADDER, h, w) variance taken away, samples added and worth of each pixel's 1st, 2nd, … doubling; worth 0: not possible."""
    step = np.arange(_LADDER).reshape(-1, 1, 1)
    taken = relative * (1.0 - LEFT) * LEFT**step
    added = samples * 2.0**step
    return taken, added, np.where(samples * 2.0**step < most, taken / added, 0.0)


def _threshold(worth: Map, amounts: Map, wanted: float, within: bool = False) -> float:
    """The worth down to which doublings are taken so that their `amounts` add up to `wanted`: at least, or at most where `within`."""
    if wanted <= 0.0:
        return math.inf
    there = worth > 0.0
    if not there.any():
        return math.inf
    places = np.floor(np.log2(worth[there]) * _BINS).astype(np.int64)
    lowest = int(places.min())
    totals = np.bincount(places - lowest, weights=amounts[there])[::-1].cumsum()  # from the dearest down
    reached = int(np.searchsorted(totals, wanted, side="right" if within else "left"))
    taken = reached if within else min(reached + 1, len(totals))  # bins
    if taken == 0:
        return math.inf
    return 2.0 ** ((lowest + len(totals) - taken) / _BINS)


def _doublings(worth: Map, threshold: float) -> NDArray[np.int64]:
    if math.isinf(threshold):
        return np.zeros(worth.shape[1:], np.int64)
    return np.minimum(np.sum((worth > 0.0) & (worth >= threshold * (1.0 - 1e-12)), axis=0), MOST_DOUBLINGS)
