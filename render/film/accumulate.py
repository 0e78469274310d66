"""Kernels that add samples to a picture, and estimate its variance and relative error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper, kernel

LARGEST = float(np.finfo(np.float32).max)  # greatest radiance of a picture; greater values count as not finite


class PixelSums(NamedTuple):
    """Sums over the samples of pixels, (h, w, …) each."""

    color: NDArray[np.float64]  # (h, w, 3) radiance
    alpha: NDArray[np.float64]  # coverage
    issues: NDArray[np.int64]  # samples that were not finite
    samples: NDArray[np.int64]

    @classmethod
    def zeros(cls, height: int, width: int) -> PixelSums:
        """Return sums of no samples."""
        shape = (height, width)
        return cls(np.zeros((*shape, 3)), np.zeros(shape), np.zeros(shape, np.int64), np.zeros(shape, np.int64))

    def window(self, window: tuple[slice, slice]) -> PixelSums:
        """Return views of a part."""
        return PixelSums(self.color[window], self.alpha[window], self.issues[window], self.samples[window])


class PixelErrors(NamedTuple):
    """Error estimates of pixels, (h, w, 3) each."""

    variance: NDArray[np.float64]  # of the mean; inf after one batch
    value: NDArray[np.float32]  # the denominator of the relative error


@kernel
def add_samples(film, count, sums, errors, rgba, least, shown):
    """Add a film's batch of `count` (h, w) samples to the sums of a tile, and update picture and errors; `count` may be 0.

    The old samples and the new ones have means m₁, m₂ of n₁, n₂ samples. For independent batches whose variance falls as 1/n, the mean of
    all has the variance (m₁ - m₂)² n₁ n₂ / (n₁ + n₂)²; adaptive_sampling.Decline corrects it for Sobol points. The value is the geometric
    mean of both, so that a bright sample does not hide its own error, but at least half of the mean, as one batch may be black. Adds to
    `shown` (levels, 2), at pixels that are doubled, variance / (value² + `least`) before and after, at the level of their samples.
    """
    known_whole, at = 0.0, 0  # neighbors mostly have equal counts
    for y in range(count.shape[0]):
        for x in range(count.shape[1]):
            new, old = count[y, x], sums.samples[y, x]
            if new == 0:
                continue
            whole = float(old + new)
            if whole != known_whole:
                known_whole, at = whole, level(whole)
            beyond = False
            weight = float(old) * float(new) / (whole * whole)
            for k in range(3):
                total = sums.color[y, x, k] + film.color[y, x, k]
                mean = total / whole
                if old > 0:
                    one, other = sums.color[y, x, k] / old, film.color[y, x, k] / new
                    variance = (one - other) * (one - other) * weight
                    value = math.sqrt(max(one * other, 0.25 * mean * mean))
                    if old == new and errors.variance[y, x, k] < np.inf:
                        below = value * value + least
                        if below > 0.0:
                            shown[at, 0] += errors.variance[y, x, k] / below
                            shown[at, 1] += variance / below
                    errors.variance[y, x, k], errors.value[y, x, k] = variance, value
                sums.color[y, x, k] = total
                rgba[y, x, k] = min(max(mean, -LARGEST), LARGEST)
                beyond = beyond or not abs(mean) <= LARGEST
            sums.alpha[y, x] += film.alpha[y, x]
            sums.issues[y, x] += film.issues[y, x] + (1 if beyond else 0)
            sums.samples[y, x] = old + new
            rgba[y, x, 3] = sums.alpha[y, x] / whole


@helper
def clamp(value):
    """Clamp a number to the range that a picture can store."""
    return min(max(value, -LARGEST), LARGEST)


@kernel
def set_first(film, rgba):
    """Set the picture of a tile from a film's one sample of each pixel, and clear the film; return how many samples are not finite."""
    issues = 0
    for y in range(rgba.shape[0]):
        for x in range(rgba.shape[1]):
            red, green, blue = film.color[y, x, 0], film.color[y, x, 1], film.color[y, x, 2]
            if not (abs(red) <= LARGEST and abs(green) <= LARGEST and abs(blue) <= LARGEST):
                red, green, blue = clamp(red), clamp(green), clamp(blue)
                issues += 1
            rgba[y, x, 0], rgba[y, x, 1], rgba[y, x, 2], rgba[y, x, 3] = red, green, blue, film.alpha[y, x]
            issues += film.issues[y, x]
    film.color[...], film.alpha[...], film.issues[...] = 0.0, 0.0, 0
    return issues


@helper
def level(samples):
    """Return log₂ of a number of samples, rounded down."""
    return int(math.log2(max(samples, 1)) + 1e-9)


@kernel
def relative_error(variance, value, rgba, samples, share, least, out):
    """Write (h, w) variance / (value² + `least`), the mean of three channels, times the `share` (levels,) for the pixel's samples.

    The value is the pixel's or, if that is less, the mean of its eight neighbors, on which a stray bright sample has little effect.
    """
    height, width = out.shape
    columns = np.zeros((width + 2, 3))  # sums of up to three pixels, 0 beside the picture
    known_samples, scale = 0, share[0] / 3.0
    for y in range(height):
        first, last = max(y - 1, 0), min(y + 2, height)
        for x in range(width):
            for k in range(3):
                columns[x + 1, k] = 0.0
                for j in range(first, last):
                    columns[x + 1, k] += float(rgba[j, x, k])
        for x in range(width):
            count = (last - first) * (min(x + 2, width) - max(x - 1, 0)) - 1
            total = 0.0
            for k in range(3):
                known = float(value[y, x, k])
                if count > 0:
                    neighbors = columns[x, k] + columns[x + 1, k] + columns[x + 2, k] - float(rgba[y, x, k])
                    known = min(known, abs(neighbors) / count)
                total += variance[y, x, k] / (known * known + least)
            if samples[y, x] != known_samples:
                known_samples = samples[y, x]
                scale = share[level(known_samples)] / 3.0
            out[y, x] = total * scale
