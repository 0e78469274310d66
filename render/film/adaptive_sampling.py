"""Adaptive sampling: how often each pixel's number of samples is doubled, for a target error or a number of samples.

Doubling a pixel's n samples halves the variance r of its mean, at a cost of n samples: its benefit is r / n. Doublings by falling benefit,
down to one threshold for all pixels, reach an error with the fewest samples (with r = v / n, n ∝ √v: Neyman's allocation, Cochran,
"Sampling Techniques", §5.5). Numbers of samples stay the first times powers of two, which Sobol points suit best.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit import thread_pool
from ..sampling.pixel_groups import GROUP
from ..types import Tile

Map = NDArray[np.float64]
Counts = NDArray[np.int64]

FIRST = ((0.2, 2), (0.04, 4), (0.0, 16))  # (least error asked for, samples a pixel before the first estimate)
ROWS = 64  # of pixels, that a thread takes at a time
MOST_DOUBLINGS = 2  # of a pixel in a round: an estimate from n samples serves up to 4 n
ALONE = 16.0  # factor of its neighbors' mean from which a pixel's own variance counts
LEFT = 0.4  # share of a pixel's variance after a doubling: half for independent samples, less for Sobol points
_STEP = 20  # bins of benefit between a doubling and the next
_BINS = _STEP / math.log2(2.0 / LEFT)  # bins an octave
_PLACES = 512


BEYOND = 0.05  # share of the target's square by which a round overshoots, to avoid many small last rounds
SELECTION = 1.1  # factor of an error whose pixels were selected: those that seem better than they are get too few samples
CONFIDENCE = 1.5  # standard deviations between the estimate and the target


def first_samples(error: float) -> int:
    """Samples a pixel before the first estimate of the error, by the one asked for; 0 for none."""
    return next(samples for least, samples in FIRST if error >= least)


def doublings_for_error(relative: Map, samples: Counts, most: int, share: float) -> Counts:
    """Return (h, w) doublings of each pixel that reduce the mean of `relative` by a share, now or in later rounds.

    `relative` (h, w): variance of each pixel's mean over its squared value. No pixel exceeds `most` samples.
    """
    places, highest = _places(relative, samples, most)
    if highest is None or share <= 0.0:
        return np.zeros(samples.shape, np.int64)
    reductions = _totals(places, relative) @ _falls()
    enough = np.flatnonzero(reductions >= share * float(np.sum(relative)))
    return _doublings(places, int(enough[0]) if len(enough) else _PLACES)


def doublings_for_samples(relative: Map, samples: Counts, most: int, more: float) -> Counts:
    """Return (h, w) doublings of greatest benefit that cost at most about `more` samples."""
    places, highest = _places(relative, samples, most)
    if highest is None:
        return np.zeros(samples.shape, np.int64)
    added = _totals(places, samples) @ (2.0 ** np.minimum(_steps(), MOST_DOUBLINGS) - 1.0)
    within = np.flatnonzero(added <= more)
    return _doublings(places, int(within[-1]) if len(within) else -1)


def smooth(relative: Map, samples: Counts, threads: int = 1) -> Map:
    """Estimate `relative` from the sample variance of each pixel's eight neighbors.

    The estimate of one pixel from a few samples is noisy. Selection by it would also bias the error downward: pixels with too small an
    estimate are left, and those with too large a one are measured again. A pixel's own estimate counts if it exceeds ALONE times its
    neighbors' mean, as one in 16,000 squares of a normal variable does.
    """
    out = np.empty(relative.shape)

    def some(top: int) -> None:
        first = max(top - 1, 0)  # a row more on either side
        rows = slice(first, top + ROWS + 1)
        out[top : top + ROWS] = _smooth(relative[rows], samples[rows])[top - first : top - first + ROWS]

    thread_pool.parallel_for(some, range(0, len(out), ROWS), threads)
    return out


def _smooth(relative: Map, samples: Counts) -> Map:
    variance = relative * samples
    total, count = variance, np.ones_like(variance)
    for axis in (0, 1):
        total, count = _three(total, axis), _three(count, axis)
    total, count = total - variance, count - 1.0
    neighbors = np.maximum(total, 0.0) / np.maximum(count, 1.0)
    return np.where(count > 0.0, np.maximum(neighbors, variance / ALONE), variance) / samples


def _three(values: Map, axis: int) -> Map:
    total = values.copy()
    sums, source = np.moveaxis(total, axis, 0), np.moveaxis(values, axis, 0)
    sums[1:] += source[:-1]
    sums[:-1] += source[1:]
    return total


def _places(relative: Map, samples: Counts, most: int) -> tuple[Counts, float | None]:
    """(bins (h, w) of each pixel's first doubling below the greatest benefit, that benefit).

    The bin is `_PLACES` for pixels without benefit or at the limit of samples.
    """
    with np.errstate(divide="ignore"):
        worth = np.log2(np.where(samples < most, relative / samples, 0.0))
    highest = float(worth.max(initial=-np.inf))
    if not math.isfinite(highest):
        return np.zeros(samples.shape, np.int64), None
    depth = np.minimum((highest - worth) * _BINS, _PLACES)
    return depth.astype(np.int64), highest


def _totals(places: Counts, amounts: NDArray[Any]) -> Map:
    """Sum amounts by bin."""
    sums = np.bincount(places.ravel(), weights=amounts.ravel(), minlength=_PLACES + 1)
    return sums[: _PLACES].astype(np.float64)


@functools.cache
def _falls() -> Map:
    """(bins, thresholds) share of its variance that a pixel loses by `_steps`."""
    return np.asarray(1.0 - LEFT ** _steps(), np.float64)


@functools.cache
def _steps() -> Counts:
    """(bins, thresholds) doublings of a pixel in a bin for a threshold: one for each _STEP above it."""
    place = np.arange(_PLACES)
    return np.where(place[None, :] >= place[:, None], (place[None, :] - place[:, None]) // _STEP + 1, 0)


def _doublings(places: Counts, threshold: int) -> Counts:
    """The doublings of each pixel for the bin of the threshold; -1: none."""
    steps = (threshold - places) // _STEP + 1
    return np.where((places <= threshold) & (places < _PLACES), np.clip(steps, 0, MOST_DOUBLINGS), 0)


class Cells:
    """Partition of a crop by the picture's grid of square cells, `side` pixels each; cells at the edges are cropped."""

    def __init__(self, crop: tuple[int, int, int, int], side: int) -> None:
        x0, y0, x1, y1 = crop
        self.side = side
        self.rows, self.columns = (np.arange(y0, y1) // side - y0 // side, np.arange(x0, x1) // side - x0 // side)

    def means(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return (rows, columns) means over the cells of (h, w)."""
        if self.side == 1:
            return values
        starts = [np.flatnonzero(np.diff(places, prepend=-1)) for places in (self.rows, self.columns)]
        total = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
        return total / np.multiply.outer(np.bincount(self.rows), np.bincount(self.columns))

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return (h, w): each cell's value at all of its pixels."""
        return values if self.side == 1 else values[np.ix_(self.rows, self.columns)]


class Decline:
    """Estimates how variance falls with samples, from the doublings of a picture.

    For scrambled nets, whose halves complement each other, (m₁ - m₂)² / 4 of two halves of n samples has the mean V(n) - V(2n), not V(2n).
    With V ∝ n⁻ᵖ the first is 2ᵖ - 1 times the second. p is 1 for independent samples and 3/2 across an edge. Successive doublings of the
    same pixels measure it, separately for each level of samples: pixels with the most samples are those where nets help least. The pixels
    are chosen by their neighbors (see `smoothed`), without which chance would raise p. Pixels with a stray bright sample are chosen by
    themselves, and fall to a quarter for any p: so only half of the excess over 1 counts, from the level on where pixels are chosen.
    """

    STEEPEST = 1.5
    BELIEVED = 0.5
    LEVELS = 32  # octaves of the number of samples

    def __init__(self, tiles: Sequence[Tile], chosen_from: int = 0) -> None:
        """`chosen_from`: first level of samples whose excess over 1 counts half; 0 for pictures of fixed samples."""
        self._believed = np.where(np.arange(self.LEVELS) < chosen_from, 1.0, self.BELIEVED)
        self._order = sorted(range(len(tiles)), key=lambda k: tiles[k])
        self.shown = np.zeros((len(tiles), self.LEVELS, 2))
        """(tiles, levels, 2) for accumulate.add_batch: errors before and after doublings, by level."""

    def shares(self) -> Map:
        """Return (levels,) variance of the means over the estimate from halves: 1 for independent samples, less for nets."""
        before, after = self.shown[self._order].sum(axis=0).T
        measured = (after > 0.0) & (before > after)
        slope = np.log2(np.divide(before, after, out=np.ones_like(before), where=measured), where=measured, out=np.ones_like(before))
        return 1.0 / (2.0 ** (1.0 + self._believed * (np.clip(slope, 1.0, self.STEEPEST) - 1.0)) - 1.0)


def expected_samples(rounds: Sequence[tuple[int, float]], excess: float) -> float:
    """Return how many samples a picture is expected to have when its relative error squared has fallen by the share `excess`.

    `rounds` are the samples and the relative errors squared so far, which fall as a power of the samples: that of the last two rounds.
    """
    samples, now = rounds[-1]
    power = 1.0
    before, then = rounds[-2] if len(rounds) > 1 else (samples, now)
    if samples > before and now > 0.0:
        power = min(max(math.log(max(then / now, 1.0)) / math.log(samples / before), 0.2), 1.5)
    return samples * max(1.0 - excess, 1e-9) ** (-1.0 / power)


def excess(relative: Map, error: float, side: int = 1) -> float:
    """Return the share by which the mean of `relative` must fall to reach an error with CONFIDENCE; 0 if it is reached.

    Each pixel's entry is the square of one normal variable, its error that of another: 2 σ⁴ is the variance of either, and 3 σ⁴ the mean
    of the entry's square. The mean over a cell of `side` pixels has one such variable for each group that shares paths.
    """
    aim, count = error**2, max(side**2 // GROUP, 1)
    uncertain = math.sqrt(4.0 / (count + 2.0) * float(np.sum(np.square(relative)))) / relative.size
    likely = float(np.mean(relative)) + CONFIDENCE * uncertain
    return 1.0 - (1.0 - BEYOND) * aim / likely if likely > aim else 0.0
