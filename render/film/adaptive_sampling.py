"""Where more samples are worth most: how often each pixel's number of samples is doubled, for an error or for so many samples.

A doubling of a pixel's n samples takes about half of the variance r of its mean, for n more samples: it is worth r / n. Taking
doublings in the order of their worth, down to one threshold for all pixels, reaches an error with the fewest samples (with
r = v / n, n ∝ √v: Neyman's allocation, Cochran, "Sampling Techniques", §5.5). Numbers of samples stay powers of two times the
first, where Sobol points are spread best.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Map = NDArray[np.float64]
Counts = NDArray[np.int64]

MOST_DOUBLINGS = 2  # of a pixel in a round: what is known of it from n samples is not trusted further than for 4 n
ALONE = 16.0  # times its neighbours' mean at which a pixel's own variance is believed
LEFT = 0.4  # of a pixel's variance after a doubling: half for independent samples, less for Sobol points
_STEP = 20  # bins of worth between a doubling and the next, which leaves LEFT at twice the price
_BINS = _STEP / math.log2(2.0 / LEFT)  # an octave
_PLACES = 512


BEYOND = 0.05  # share of the squared error asked for by which a round does more than it has to: else the last ones are many and small
AIM = 0.97  # of the error asked for: pixels that are left alone are a little more often those that look better than they are
CONFIDENCE = 2.0  # standard deviations by which the estimate stays below the error asked for


def doublings_for_error(relative: Map, samples: Counts, most: int, share: float) -> Counts:
    """(h, w) doublings of each pixel's samples, so that the mean of `relative` falls by a share of it, in this round or later.

    `relative` (h, w): variance of each pixel's mean over its squared value. No pixel goes beyond `most` samples.
    """
    places, highest = _places(relative, samples, most)
    if highest is None or share <= 0.0:
        return np.zeros(samples.shape, np.int64)
    taken = _totals(places, relative) @ _falls()
    enough = np.flatnonzero(taken >= share * float(np.sum(relative)))
    return _doublings(places, int(enough[0]) if len(enough) else _PLACES)


def doublings_for_samples(relative: Map, samples: Counts, most: int, more: float) -> Counts:
    """(h, w) doublings of each pixel's samples that take about `more` samples in all, at most, where they are worth most."""
    places, highest = _places(relative, samples, most)
    if highest is None:
        return np.zeros(samples.shape, np.int64)
    added = _totals(places, samples) @ (2.0 ** np.minimum(_steps(), MOST_DOUBLINGS) - 1.0)
    within = np.flatnonzero(added <= more)
    return _doublings(places, int(within[-1]) if len(within) else -1)


def smoothed(relative: Map, samples: Counts) -> Map:
    """`relative` from the variance of a sample as each pixel's eight neighbours know it.

    A few samples tell little of one pixel alone. And a pixel that by chance seems quieter than it is would be left as it is, while
    one that seems noisier is measured again: what pixels say of themselves would then add up to too small an error. A pixel's own word
    counts where chance alone says so seldom: at ALONE times its neighbours' mean, one in 16,000 squares of a normal variable.
    """
    own = relative * samples
    total, count = own, np.ones_like(own)
    for axis in (0, 1):
        total, count = _three(total, axis), _three(count, axis)
    total, count = total - own, count - 1.0
    around = np.maximum(total, 0.0) / np.maximum(count, 1.0)
    return np.where(count > 0.0, np.maximum(around, own / ALONE), own) / samples


def _three(values: Map, axis: int) -> Map:
    total = values.copy()
    there, here = np.moveaxis(total, axis, 0), np.moveaxis(values, axis, 0)
    there[1:] += here[:-1]
    there[:-1] += here[1:]
    return total


def _places(relative: Map, samples: Counts, most: int) -> tuple[Counts, float | None]:
    """(h, w) how many bins the worth of each pixel's first doubling lies below the highest, which is given too.

    It is `_PLACES` where there is nothing to gain, and more samples are not allowed.
    """
    with np.errstate(divide="ignore"):
        worth = np.log2(np.where(samples < most, relative / samples, 0.0))
    highest = float(worth.max(initial=-np.inf))
    if not math.isfinite(highest):
        return np.zeros(samples.shape, np.int64), None
    depth = np.minimum((highest - worth) * _BINS, _PLACES)
    return depth.astype(np.int64), highest


def _totals(places: Counts, amounts: NDArray[Any]) -> Map:
    """Sums of amounts by place."""
    sums = np.bincount(places.ravel(), weights=amounts.ravel(), minlength=_PLACES + 1)
    return sums[: _PLACES].astype(np.float64)


@functools.cache
def _falls() -> Map:
    """(places, thresholds) the share of its variance that a pixel loses by `_steps`."""
    return np.asarray(1.0 - LEFT ** _steps(), np.float64)


@functools.cache
def _steps() -> Counts:
    """(places, thresholds) doublings of a pixel at a place when the threshold is at a place: one each _STEP above it."""
    place = np.arange(_PLACES)
    return np.where(place[None, :] >= place[:, None], (place[None, :] - place[:, None]) // _STEP + 1, 0)


def _doublings(places: Counts, threshold: int) -> Counts:
    """How often each pixel's samples are doubled with the threshold at a place; -1: never."""
    steps = (threshold - places) // _STEP + 1
    return np.where((places <= threshold) & (places < _PLACES), np.clip(steps, 0, MOST_DOUBLINGS), 0)


class Blocks:
    """A crop in blocks of so many pixels a side, which are the picture's: those at its edges are cut off. Of 1 they are the pixels."""

    def __init__(self, crop: tuple[int, int, int, int], side: int) -> None:
        x0, y0, x1, y1 = crop
        self.side = side
        self.rows, self.columns = (np.arange(y0, y1) // side - y0 // side, np.arange(x0, x1) // side - x0 // side)

    def means(self, values: NDArray[Any]) -> NDArray[Any]:
        """(rows, columns) the mean over each block of (h, w)."""
        if self.side == 1:
            return values
        starts = [np.flatnonzero(np.diff(places, prepend=-1)) for places in (self.rows, self.columns)]
        total = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
        return total / np.multiply.outer(np.bincount(self.rows), np.bincount(self.columns))

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """(h, w) each block's value for all of its pixels."""
        return values if self.side == 1 else values[np.ix_(self.rows, self.columns)]


class Decline:
    """How variance falls with samples, as the doublings of a picture show it, and what follows for its error.

    Two halves of n samples each differ by what variance V they have, less what they have in common: for scrambled nets, whose halves are
    made to complete each other, (m₁ - m₂)² / 4 has the mean V(n) - V(2n), not V(2n). With V falling as n⁻ᵖ the first is 2ᵖ - 1 times the
    second. p is 1 for independent samples, 3/2 across an edge; successive doublings of the same pixels show which, and each level of
    samples shows its own: the pixels that get most are those where nets help least. It is told from pixels that were chosen by what their
    neighbours said (see `smoothed`), else chance alone would make it large; and as pixels with a stray bright sample are chosen for what
    they say themselves, and fall to a quarter whatever the samples are, half of what is seen beyond 1 is believed.
    """

    STEEPEST = 1.5
    BELIEVED = 0.5
    LEVELS = 32  # of numbers of samples, an octave each

    def __init__(self) -> None:
        self._shown: dict[Any, Map] = {}

    def of(self, tile: Any) -> Map:
        """(levels, 2) of a tile, for sums.take_in to add to: what doublings to each level made of the error. Of one thread at a time."""
        return self._shown.setdefault(tile, np.zeros((self.LEVELS, 2)))

    def shares(self) -> Map:
        """(levels,) the variance of the means as a share of the estimate from their halves: 1 for independent samples, less for nets."""
        before, after = np.sum([self._shown[tile] for tile in sorted(self._shown)], axis=0).T
        known = (after > 0.0) & (before > after)
        slope = np.log2(np.divide(before, after, out=np.ones_like(before), where=known), where=known, out=np.ones_like(before))
        return 1.0 / (2.0 ** (1.0 + self.BELIEVED * (np.clip(slope, 1.0, self.STEEPEST) - 1.0)) - 1.0)


def excess(relative: Map, error: float) -> float:
    """The share by which the mean of `relative` shall fall for a picture to have the error asked for, with CONFIDENCE; 0 where it has.

    Each pixel's entry is the square of one normal variable, as its error is of another: 2 σ⁴ is the variance of either, 3 σ⁴ the mean of
    the entry's square.
    """
    aim = (AIM * error) ** 2
    uncertain = math.sqrt(4.0 / 3.0 * float(np.sum(np.square(relative)))) / relative.size
    likely = float(np.mean(relative)) + CONFIDENCE * uncertain
    return 1.0 - (1.0 - BEYOND) * aim / likely if likely > aim else 0.0
