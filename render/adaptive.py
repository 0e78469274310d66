"""Where more samples are worth most: how often each pixel's number of samples is doubled, for an error or for so many samples.

A doubling of a pixel's n samples takes about half of the variance r of its mean, for n more samples: it is worth r / n. Taking
doublings in the order of their worth, down to one threshold for all pixels, reaches an error with the fewest samples (with
r = v / n, n ∝ √v: Neyman's allocation, Cochran, "Sampling Techniques", §5.5). Numbers of samples stay powers of two times the
first, where Sobol points are spread best.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_DOUBLINGS = 2  # of a pixel in a round: what is known of it from n samples is not trusted further than for 4 n
_BINS = 8  # thresholds an octave of worth
_DEEPEST = 60  # octaves of worth looked at, from the highest down


def doublings_for_error(relative: Map, samples: Counts, most: int, mean: float) -> Counts:
    """(h, w) doublings of each pixel's samples, so that the mean of `relative` over all pixels falls to `mean` in this round or later.

    `relative` (h, w): variance of each pixel's mean over its squared value. No pixel goes beyond `most` samples.
    """
    places, highest = _places(relative, samples, most)
    too_much = (float(np.mean(relative)) - mean) * relative.size
    if highest is None or too_much <= 0.0:
        return np.zeros(samples.shape, np.int64)
    taken = _totals(places, relative) @ (1.0 - 0.5 ** _steps())
    enough = np.flatnonzero(taken >= too_much)
    return _doublings(places, int(enough[0]) if len(enough) else _DEEPEST * _BINS)


def doublings_for_samples(relative: Map, samples: Counts, most: int, more: float) -> Counts:
    """(h, w) doublings of each pixel's samples that take about `more` samples in all, at most, where they are worth most."""
    places, highest = _places(relative, samples, most)
    if highest is None:
        return np.zeros(samples.shape, np.int64)
    added = _totals(places, samples) @ (2.0 ** np.minimum(_steps(), MOST_DOUBLINGS) - 1.0)
    within = np.flatnonzero(added <= more)
    return _doublings(places, int(within[-1]) if len(within) else -1)


def smoothed(relative: Map, samples: Counts) -> Map:
    """`relative` from the variance of a sample as each pixel and its neighbours know it (3 by 3, fewer at the borders).

    A few samples tell little of one pixel alone.
    """
    total = relative * samples
    count = np.ones_like(total)
    for axis in (0, 1):
        total, count = _three(total, axis), _three(count, axis)
    return total / (count * samples)


def _three(values: Map, axis: int) -> Map:
    total = values.copy()
    there, here = np.moveaxis(total, axis, 0), np.moveaxis(values, axis, 0)
    there[1:] += here[:-1]
    there[:-1] += here[1:]
    return total


def _places(relative: Map, samples: Counts, most: int) -> tuple[Counts, float | None]:
    """(h, w) how many bins the worth of each pixel's first doubling lies below the highest, which is given too.

    It is `_DEEPEST * _BINS` where there is nothing to gain, and more samples are not allowed.
    """
    with np.errstate(divide="ignore"):
        worth = np.log2(np.where(samples < most, relative / samples, 0.0))
    highest = float(worth.max(initial=-np.inf))
    if not math.isfinite(highest):
        return np.zeros(samples.shape, np.int64), None
    depth = np.minimum((highest - worth) * _BINS, _DEEPEST * _BINS)
    return depth.astype(np.int64), highest


def _totals(places: Counts, amounts: NDArray[Any]) -> Map:
    """Sums of amounts by place."""
    sums = np.bincount(places.ravel(), weights=amounts.ravel(), minlength=_DEEPEST * _BINS + 1)
    return sums[: _DEEPEST * _BINS].astype(np.float64)


def _steps() -> Counts:
    """(places, thresholds) doublings of a pixel at a place when the threshold is at a place: one each two octaves above it.

    Each doubling halves the variance at twice the price, so the next is worth a quarter.
    """
    place = np.arange(_DEEPEST * _BINS)
    return np.where(place[None, :] >= place[:, None], (place[None, :] - place[:, None]) // (2 * _BINS) + 1, 0)


def _doublings(places: Counts, threshold: int) -> Counts:
    """How often each pixel's samples are doubled with the threshold at a place; -1: never."""
    steps = (threshold - places) // (2 * _BINS) + 1
    return np.where((places <= threshold) & (places < _DEEPEST * _BINS), np.clip(steps, 0, MOST_DOUBLINGS), 0)
