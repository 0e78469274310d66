"""Taking samples in: kernels that add a batch to a tile's sums, tell its variance, and weigh errors over a picture."""

from __future__ import annotations

import math

import numpy as np

from ..jit.kernel import helper, kernel

LARGEST = float(np.finfo(np.float32).max)  # that a picture can hold; what is brighter counts as not finite


@kernel
def take_in(film, count, color, alpha, issues, samples, variance, value, rgba, least, shown):
    """Add a film's batch of `count` (h, w) samples to a tile's sums, (h, w, …) each; pixels with none stay as they are.

    Sets the picture, the variance of its means and the value it is a share of. The old samples and the new ones have means m₁, m₂ of n₁,
    n₂ samples; for independent batches whose variance falls as 1/n, the mean of all has the variance (m₁ - m₂)² n₁ n₂ / (n₁ + n₂)²
    (adaptive.Decline says what Sobol points make of it). The value is the geometric mean of both, lest a bright sample excuse itself, but
    at least half of the mean: of few samples one batch may have nothing. Adds to `shown` (levels, 2), where pixels are doubled,
    variance / (value² + `least`) as it was and as it is now, at the level of their samples.
    """
    known_whole, at = 0.0, 0  # neighbours mostly have as many
    for y in range(count.shape[0]):
        for x in range(count.shape[1]):
            new, old = count[y, x], samples[y, x]
            if new == 0:
                continue
            whole = float(old + new)
            if whole != known_whole:
                known_whole, at = whole, level(whole)
            beyond = False
            weight = float(old) * float(new) / (whole * whole)
            for k in range(3):
                total = color[y, x, k] + film.color[y, x, k]
                mean = total / whole
                if old > 0:
                    one, other = color[y, x, k] / old, film.color[y, x, k] / new
                    apart = (one - other) * (one - other) * weight
                    known = math.sqrt(max(one * other, 0.25 * mean * mean))
                    if old == new and variance[y, x, k] < np.inf:
                        below = known * known + least
                        if below > 0.0:
                            shown[at, 0] += variance[y, x, k] / below
                            shown[at, 1] += apart / below
                    variance[y, x, k], value[y, x, k] = apart, known
                color[y, x, k] = total
                rgba[y, x, k] = min(max(mean, -LARGEST), LARGEST)
                beyond = beyond or not abs(mean) <= LARGEST
            alpha[y, x] += film.alpha[y, x]
            issues[y, x] += film.issues[y, x] + (1 if beyond else 0)
            samples[y, x] = old + new
            rgba[y, x, 3] = alpha[y, x] / whole


@helper
def held(value):
    """A number, or the nearest one that a picture can hold."""
    return min(max(value, -LARGEST), LARGEST)


@kernel
def take_first(film, rgba):
    """Set the picture of a tile from a film's one sample of each pixel, and empty the film; how many samples of all are no numbers that a
    picture can hold."""
    issues = 0
    for y in range(rgba.shape[0]):
        for x in range(rgba.shape[1]):
            red, green, blue = film.color[y, x, 0], film.color[y, x, 1], film.color[y, x, 2]
            if not (abs(red) <= LARGEST and abs(green) <= LARGEST and abs(blue) <= LARGEST):
                red, green, blue = held(red), held(green), held(blue)
                issues += 1
            rgba[y, x, 0], rgba[y, x, 1], rgba[y, x, 2], rgba[y, x, 3] = red, green, blue, film.alpha[y, x]
            issues += film.issues[y, x]
    film.color[...], film.alpha[...], film.issues[...] = 0.0, 0.0, 0
    return issues


@helper
def level(samples):
    """log₂ of a number of samples, rounded down."""
    return int(math.log2(max(samples, 1)) + 1e-9)


@kernel
def relative_error(variance, value, rgba, samples, share, least, out):
    """Write (h, w) variance / (value² + `least`), the mean of three channels, times the `share` (levels,) for the pixel's samples.

    What counts is the pixel's value or, where that is less, the mean of the eight around it, of which a stray bright sample makes little.
    """
    height, width = out.shape
    columns = np.zeros((width + 2, 3))  # sums of up to three pixels, with none beside the picture
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
                    around = columns[x, k] + columns[x + 1, k] + columns[x + 2, k] - float(rgba[y, x, k])
                    known = min(known, abs(around) / count)
                total += variance[y, x, k] / (known * known + least)
            if samples[y, x] != known_samples:
                known_samples = samples[y, x]
                scale = share[level(known_samples)] / 3.0
            out[y, x] = total * scale
