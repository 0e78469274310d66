"""Kernels that add samples to a picture, and estimate its variance and relative error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper, kernel

REACH = 2  # pixels from the middle of the window that estimates a pixel's light
STRAY = 8.0  # times the variance of its neighbors, from which on a pixel holds a stray bright sample
FAINTEST = 1.0 / 16.0  # of a stray pixel's light, that its true light is taken for
CAUTION = 1.5  # times the noise of a window, for the trust in a pixel's own light
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


class Window(NamedTuple):
    """Where a tile lies in larger arrays: its size, and its first row and column in PixelSums and in the picture."""

    rows: int
    columns: int
    sums_row: int
    sums_column: int
    row: int
    column: int


@kernel
def add_samples(film, count, sums, differences, rgba, least, shown, tile):
    """Add a film's batch of `count` (h, w) samples to the sums of a tile, and update picture and differences; see `add_batch`.

    Adds to shown[tile].
    """
    add_batch(film, count, Window(count.shape[0], count.shape[1], 0, 0, 0, 0), sums, differences, rgba, least, shown, tile)


@helper
def add_batch(film, count, window, sums, differences, rgba, least, shown, tile):
    """Add a film's batch of `count` samples to the sums of a tile, and update picture and differences; `count` may be 0.

    The old samples and the new ones have means m₁, m₂ of n₁, n₂ samples. For independent batches whose variance falls as 1/n, the mean of
    all has the variance d² of d = (m₁ - m₂) √(n₁ n₂) / (n₁ + n₂); adaptive_sampling.Decline corrects it for Sobol points. `differences`
    (h, w, 3) hold d, inf after one batch. Adds to shown[tile] (levels, 2), at pixels that are doubled, d² / (value² + `least`) before and
    after, at the level of their samples. The value is the geometric mean of both batches, at least half of the mean, as one may be black.
    """
    last_count, level_row = 0.0, 0  # neighbors mostly have equal counts
    for row in range(window.rows):
        for column in range(window.columns):
            y, x, v, u = window.sums_row + row, window.sums_column + column, window.row + row, window.column + column
            new, old = count[row, column], sums.samples[y, x]
            if new == 0:
                continue
            sample_count = float(old + new)
            if sample_count != last_count:
                last_count, level_row = sample_count, level(sample_count)
            beyond = False
            weight = math.sqrt(float(old) * float(new)) / sample_count
            for k in range(3):
                total = sums.color[y, x, k] + film.color[row, column, k]
                mean = total / sample_count
                if old > 0:
                    old_mean, new_mean = sums.color[y, x, k] / old, film.color[row, column, k] / new
                    before, now = np.float64(differences[v, u, k]), (old_mean - new_mean) * weight
                    value = math.sqrt(max(old_mean * new_mean, 0.25 * mean * mean))
                    if old == new and before < np.inf:
                        below = value * value + least
                        if below > 0.0:
                            shown[tile, level_row, 0] += before * before / below
                            shown[tile, level_row, 1] += now * now / below
                    differences[v, u, k] = now
                sums.color[y, x, k] = total
                rgba[v, u, k] = min(max(mean, -LARGEST), LARGEST)
                beyond = beyond or not abs(mean) <= LARGEST
            sums.alpha[y, x] += film.alpha[row, column]
            sums.issues[y, x] += film.issues[row, column] + (1 if beyond else 0)
            sums.samples[y, x] = old + new
            rgba[v, u, 3] = sums.alpha[y, x] / sample_count


@helper
def clamp(value):
    """Clamp a number to the range that a picture can store."""
    return min(max(value, -LARGEST), LARGEST)


@kernel
def set_first(film, rgba):
    """Set the picture of a tile from a film's one sample of each pixel, and clear the film; return how many samples are not finite."""
    return put_first(film, Window(rgba.shape[0], rgba.shape[1], 0, 0, 0, 0), rgba)


@helper
def put_first(film, window, rgba):
    """`set_first` for a tile of a picture."""
    issues = 0
    for row in range(window.rows):
        for column in range(window.columns):
            y, x = window.row + row, window.column + column
            red, green, blue = film.color[row, column, 0], film.color[row, column, 1], film.color[row, column, 2]
            if not (abs(red) <= LARGEST and abs(green) <= LARGEST and abs(blue) <= LARGEST):
                red, green, blue = clamp(red), clamp(green), clamp(blue)
                issues += 1
            rgba[y, x, 0], rgba[y, x, 1], rgba[y, x, 2], rgba[y, x, 3] = red, green, blue, film.alpha[row, column]
            issues += film.issues[row, column]
    clear(film, window.rows, window.columns)
    return issues


@helper
def clear(film, rows, columns):
    """Set the sums of a film of this size to 0."""
    for row in range(rows):
        for column in range(columns):
            film.color[row, column, 0], film.color[row, column, 1], film.color[row, column, 2] = 0.0, 0.0, 0.0
            film.alpha[row, column], film.issues[row, column] = 0.0, 0


@helper
def level(samples):
    """Return log₂ of a number of samples, rounded down."""
    return int(math.log2(max(samples, 1)) + 1e-9)


@kernel
def relative_error(differences, rgba, samples, share, least, out, top=0, bottom=1 << 62):
    """Write rows `top` to `bottom` of (h, w) d² / (light² + `least`), means of three channels.

    They are times the `share` (levels,) for the pixel's samples.

    d are the `differences` of add_samples.

    The light is estimated from the noisy picture, as that of single pixels under-states the error of bright strays and over-states that of
    dark pixels: the mean of the window around a pixel, moved to the pixel's own light by the share of the window's differences that noise
    does not explain (Lee 1980, Digital image enhancement and noise filtering by use of local statistics). The own light is the geometric
    mean of both halves of the samples, at least half of their mean. Strays are replaced by their neighbors. Pixels after one batch
    are inf, and others do not use them.
    """
    height, width = out.shape
    rows = 2 * REACH + 1
    light, noise, is_measured = np.zeros((rows, width, 3)), np.zeros((rows, width, 3)), np.zeros((rows, width))
    columns = np.zeros((width, 3, 3))  # sums over the window's rows: light, its square, noise
    counts = np.zeros(width)
    ready, last_samples, scale = max(top - REACH, 0), 0, share[0] / 3.0
    for y in range(top, min(bottom, height)):
        while ready < min(y + REACH + 1, height):
            row = ready % rows
            without_strays(differences, rgba, ready, light[row], noise[row], is_measured[row])
            ready += 1
        columns[...], counts[...] = 0.0, 0.0
        for j in range(max(y - REACH, 0), min(y + REACH + 1, height)):
            row = j % rows
            for x in range(width):
                if is_measured[row, x] > 0.0:
                    counts[x] += 1.0
                    for k in range(3):
                        value = light[row, x, k]
                        columns[x, k, 0] += value
                        columns[x, k, 1] += value * value
                        columns[x, k, 2] += noise[row, x, k]
        row = y % rows
        for x in range(width):
            if is_measured[row, x] == 0.0:
                out[y, x] = np.inf
                continue
            total, first, last = 0.0, max(x - REACH, 0), min(x + REACH + 1, width)
            count = 0.0
            for i in range(first, last):
                count += counts[i]
            for k in range(3):
                light_sum, square, spread = 0.0, 0.0, 0.0
                for i in range(first, last):
                    light_sum += columns[i, k, 0]
                    square += columns[i, k, 1]
                    spread += columns[i, k, 2]
                seen = likely_light(light_sum, square, spread, count, light[row, x, k], noise[row, x, k])
                total += square_of(differences[y, x, k]) / (seen * seen + least)
            if samples[y, x] != last_samples:
                last_samples = samples[y, x]
                scale = share[level(last_samples)] / 3.0
            out[y, x] = total * scale


@helper
def square_of(value):
    """Return the square of a number in float64; `float` would leave float32 in kernels, whose squares vanish below 1e-45."""
    return np.float64(value) * np.float64(value)


@helper
def likely_light(light_sum, square, spread, count, light, noise):
    """Return the likely light of a pixel, from the sums of light, its square and noise over the `count` pixels of its window."""
    mean = light_sum / count
    of_noise = CAUTION * spread / count
    differences = max(square / count - mean * mean, 0.0) * count / max(count - 1.0, 1.0)
    true = max(differences - spread / count, 0.0)
    if true + of_noise <= 0.0:
        return mean
    own_light = math.sqrt(max(light * light - noise, 0.25 * light * light))
    return mean + true / (true + of_noise) * (own_light - mean)


@helper
def without_strays(differences, rgba, y, light, noise, is_measured):
    """Write the light and noise (w, 3) of row `y`, and whether they are known (w,).

    A pixel whose variance is more than STRAY times the mean of its eight neighbors' takes their mean noise, and their mean light if that is
    less than its own, but at least FAINTEST of it.
    """
    height, width = rgba.shape[0], rgba.shape[1]
    for x in range(width):
        is_measured[x] = 1.0 if differences[y, x, 0] < np.inf else 0.0
        for k in range(3):
            own_light, spread = abs(np.float64(rgba[y, x, k])), square_of(differences[y, x, k])
            total, around, count = 0.0, 0.0, 0.0
            for j in range(max(y - 1, 0), min(y + 2, height)):
                for i in range(max(x - 1, 0), min(x + 2, width)):
                    if (j != y or i != x) and differences[j, i, k] < np.inf:
                        total += square_of(differences[j, i, k])
                        around += abs(np.float64(rgba[j, i, k]))
                        count += 1.0
            if count > 0.0 and spread * count > STRAY * total:
                own_light, spread = max(min(around / count, own_light), FAINTEST * own_light), total / count
            light[x, k], noise[x, k] = own_light, spread
