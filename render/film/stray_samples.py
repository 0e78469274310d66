"""Stray bright samples: the share of a picture's error that they have. How many a picture has, and which it lacks, is chance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..jit import thread_pool
from .accumulate import FAINTEST

FEW = 1000  # the pixels of a picture over those with the largest errors that are looked at
SPARSE = 16  # pixels, of which one is looked at first
BRIGHTER = 1.25  # times the brightest of its neighbors, from which on a pixel holds a stray bright sample
ENOUGH = 10.0  # samples: a pixel of n samples is taken to have at least the share ENOUGH / n of the light that it shows
DARK = 0.75  # of what a pixel shows, from which on half of the difference of its halves shows that one of them is dark
OUTSHINES = 4.0  # times the brightest of its neighbors, from which on a single sample is none of an edge
CANDIDATES = 8  # pixels that are looked at for each of the few
ROWS = 64  # of pixels, that a thread takes at a time
DECIDES = 0.5  # of what a pixel is brighter by, from which on the difference of its halves shows that few samples make it so

Places = NDArray[np.intp]
_NONE: tuple[Places, Places, NDArray[np.float64]] = (np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0))


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
    center, second = _light(rgba, y, x), _brightest_neighbor(rgba, y, x)
    stray = (center > BRIGHTER * second) & (_half(differences, y, x) > DECIDES * (center - second))
    return float(finite[y, x][stray].sum()) / total


def share_in_dark_pixels(
    relative: NDArray[np.float64], rgba: NDArray[np.float32], differences: NDArray[np.float32], samples: NDArray[np.int64],
    shares: NDArray[np.float64], squared_epsilon: float, threads: int = 1,
) -> float:  # fmt: skip
    """The share of the squared error in few pixels with a stray bright sample that bright neighbors hide: dark ones beside a flame.

    For the light of a pixel accumulate.relative_error takes at least half of what it shows, which may be a single sample of a dark pixel.
    Here it is the geometric mean of its halves, at least ENOUGH / `samples` and FAINTEST of what it shows. The few pixels are those with
    one dark half whose errors (h, w) grow most by that. Such a sample is brighter than all around the pixel. That of an edge is not.

    `shares` (h, w) are the variance of pixels over the square of their `differences`, `squared_epsilon` is the ε² of relMSE. Otherwise as
    share_of_error.
    """
    total, count = float(np.sum(relative, where=np.isfinite(relative))), relative.size // FEW
    if total <= 0.0 or not count:
        return 0.0
    parts: list[tuple[Places, Places, NDArray[np.float64]]] = [_NONE] * -(-len(relative) // ROWS)

    def find_in_rows(top: int) -> None:
        rows = slice(top, top + ROWS)
        dark = _sums(differences[rows]) > DARK * _sums(rgba[rows])
        y, x = np.nonzero(dark & (samples[rows] > ENOUGH) & np.isfinite(relative[rows]))
        y += top
        mean, half = (np.square(values, dtype=np.float64) for values in (rgba[y, x, :3], differences[y, x]))
        faintest = np.square(np.maximum(ENOUGH / samples[y, x], FAINTEST))[:, None]
        errors = (half / (np.maximum(mean - half, faintest * mean) + squared_epsilon)).mean(axis=1) * shares[y, x]
        parts[top // ROWS] = y, x, np.maximum(errors - relative[y, x], 0.0)

    thread_pool.parallel_for(find_in_rows, range(0, len(relative), ROWS), threads)
    y, x, growth = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    candidates = np.argsort(-growth, kind="stable")[: CANDIDATES * count]
    y, x, growth = y[candidates], x[candidates], growth[candidates]
    stray = samples[y, x] * _half(differences, y, x) > OUTSHINES * _brightest_neighbor(rgba, y, x)
    first = np.flatnonzero(stray & (growth > 0.0))[:count]
    grown = float(growth[first].sum())
    return (grown + float(relative[y, x][first].sum())) / (total + grown)


def _sums(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) sums of the magnitudes of red, green and blue; faster than a sum over the last axis."""
    return np.abs(values[..., 0]) + np.abs(values[..., 1]) + np.abs(values[..., 2])


def _brightest_neighbor(rgba: NDArray[np.float32], y: NDArray[np.intp], x: NDArray[np.intp]) -> NDArray[np.float64]:
    """(n,) light of the brightest of the eight neighbors of pixels."""
    second = np.zeros(len(y))
    for down, right in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        v, u = y + down, x + right
        inside = (v >= 0) & (v < len(rgba)) & (u >= 0) & (u < rgba.shape[1])
        light = np.nan_to_num(_light(rgba, np.where(inside, v, y), np.where(inside, u, x)))
        second = np.maximum(second, np.where(inside, light, 0.0))
    return second


def _half(differences: NDArray[np.float32], y: NDArray[np.intp], x: NDArray[np.intp]) -> NDArray[np.float64]:
    """(n,) sums of red, green and blue of half of the difference of pixels' halves."""
    return np.abs(differences[y, x]).sum(axis=1, dtype=np.float64)


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
