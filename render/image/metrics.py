"""Image metrics: √relMSE, the greatest difference, and a false-color difference image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LUMINANCE = np.array([0.2126729, 0.7151522, 0.0721750])  # Y of the Rec.709 primaries
BLOCK = 4  # pixels of a side of the blocks of block_relmse
EPSILON = 0.01  # of the reference's mean luminance: lower bound of the denominator of relative errors

Pixels = NDArray[np.floating]


class SizeError(ValueError):
    """Pictures of different sizes, which the message gives."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The result of `difference`. `error` is √relMSE; `maximum` the greatest |a - b| of any channel, at pixel `at` (x, y)."""

    error: float
    maximum: float
    at: tuple[int, int]
    differing: int  # pixels that are not exactly equal
    pixels: int


def luminance(rgb: Pixels) -> NDArray[np.float64]:
    """Return the relative luminance (…) of linear Rec.709 colors (…, 3)."""
    return np.asarray(rgb, dtype=np.float64) @ LUMINANCE


def root_relmse(image: Pixels, reference: Pixels) -> float:
    """Return √mean((I − R)² / (R² + ε²)) over all pixels and channels, ε = 1 % of the reference's mean luminance.

    Both are linear (height, width, 3). A pixel that is inf or nan in one alone makes the error infinite; where both hold
    the same value the error is 0, so a black picture can be compared with itself.
    """
    squared = squared_relative(image, reference)
    return float(np.sqrt(squared.mean())) if squared.size else 0.0


def block_relmse(image: Pixels, reference: Pixels) -> float:
    """Return √relMSE of the means over blocks of BLOCK × BLOCK pixels, smaller at the right and the bottom.

    Noise that is independent from pixel to pixel falls to 1/BLOCK of `root_relmse`; noise shared by the pixels of a block keeps its size.
    """
    a, b = _same_size(image, reference)
    return root_relmse(block_means(a), block_means(b))


def block_means(values: Pixels, side: int = BLOCK) -> NDArray[np.float64]:
    """Return the means (rows, columns, …) over blocks of side × side pixels of (height, width, …), from the upper left corner."""
    rows, columns = (np.arange(0, count, side) for count in values.shape[:2])
    if values.size == 0:
        return np.asarray(values, np.float64)
    total = np.add.reduceat(np.add.reduceat(np.asarray(values, np.float64), rows, axis=0), columns, axis=1)
    pixels = np.multiply.outer(*(np.diff(starts, append=count) for starts, count in zip((rows, columns), values.shape[:2], strict=True)))
    return total / pixels.reshape(*pixels.shape, *(1 for _ in values.shape[2:]))


def squared_relative(image: Pixels, reference: Pixels) -> NDArray[np.float64]:
    """Return (I − R)² / (R² + ε²), (height, width, 3); `root_relmse` is the root of its mean."""
    a, b = _same_size(image, reference)
    if a.size == 0:
        return np.zeros_like(a)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        finite = np.isfinite(b)
        epsilon = EPSILON * luminance(np.where(finite, b, 0.0)).mean()
        squared = (a - b) ** 2 / (b**2 + epsilon**2)
    squared[a == b] = 0.0
    squared[~np.isfinite(squared)] = np.inf
    squared[np.isnan(a) & np.isnan(b)] = 0.0
    return squared


def difference(image: Pixels, reference: Pixels) -> Difference:
    """Compare two linear pictures (height, width, 3). Raises SizeError if their sizes differ."""
    a, b = _same_size(image, reference)
    height, width = a.shape[:2]
    if a.size == 0:
        return Difference(0.0, 0.0, (0, 0), 0, 0)
    apart = distance(a, b).max(axis=2)
    row, column = np.unravel_index(np.argmax(apart), apart.shape)
    return Difference(
        error=root_relmse(a, b),
        maximum=float(apart[row, column]),
        at=(int(column), int(row)),
        differing=int(np.count_nonzero(apart)),
        pixels=height * width,
    )


def false_colour(image: Pixels, reference: Pixels, full: float | None = None) -> NDArray[np.float32]:
    """Return linear (height, width, 3): red where `image` is brighter than `reference`, blue where darker, white where equal.

    Colors are saturated at a luminance difference of ±`full`; None takes `full_scale`.
    """
    a, b = _same_size(image, reference)
    with np.errstate(invalid="ignore"):
        signed = np.nan_to_num(luminance(a - b), nan=0.0, posinf=1e38, neginf=-1e38)
    share = np.clip(signed / (full_scale(a, b) if full is None else full), -1.0, 1.0)
    colours = np.ones((*share.shape, 3))
    colours[..., 1] = 1.0 - np.abs(share)
    colours[..., 0] -= np.clip(-share, 0.0, 1.0)
    colours[..., 2] -= np.clip(share, 0.0, 1.0)
    return colours.astype(np.float32)


def full_scale(image: Pixels, reference: Pixels) -> float:
    """Return the 99.5th percentile of nonzero luminance differences, against outliers; 1 without any."""
    a, b = _same_size(image, reference)
    with np.errstate(invalid="ignore"):
        apart = np.abs(luminance(a - b))
    differing = apart[(apart > 0) & np.isfinite(apart)]
    return float(np.percentile(differing, 99.5)) if differing.size else 1.0


def distance(a: Pixels, b: Pixels) -> NDArray[np.float64]:
    """Return |a − b|: 0 where both are the same inf or both nan, inf where only one is not finite."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(a - b)
    apart[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    apart[np.isnan(apart)] = np.inf
    return apart


def _same_size(image: Pixels, reference: Pixels) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    a, b = np.asarray(image, dtype=np.float64), np.asarray(reference, dtype=np.float64)
    if a.shape[:2] != b.shape[:2]:
        raise SizeError(f"sizes differ: {a.shape[1]}x{a.shape[0]} and {b.shape[1]}x{b.shape[0]} pixels")
    return a[..., :3], b[..., :3]
