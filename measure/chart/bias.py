"""Bias and noise of a setting, told apart from runs with many seeds: the means of N runs, less what noise alone leaves of them.

With runs I₁ … I_N of a pixel, their mean Ī and variance s², and a reference R whose own variance is σ_R²,

    bias² = ⟨(Ī − R)² − v⟩ with v = s²/N + σ_R²,   noise² = ⟨s²⟩,

where ⟨⟩ is the mean over pixels and channels weighed as in √relMSE (render/image/metrics.py): by 1 / (R² + ε²). Both are unbiased, and
noise² + bias² is the relMSE one run is expected to have. Celarek et al. 2019, "Quantifying the error of light transport algorithms".

A bias that is small beside the noise of single pixels is looked for in means over blocks of them, where noise cancels and most biases
do not: relative differences δ = (Ī − R) / √(R² + ε²) are averaged, and ⟨δ̄² − v̄⟩ over blocks is at most bias² (Jensen). There R and
its weight would be dependent, which biases δ by σ_R²; each half of the reference is therefore weighed by the other.

Noise alone exceeds the threshold with a probability below e^−x: for Gaussian noise, Σ a (χ² − 1) ≥ 2 |a|₂ √x + 2 |a|∞ x (Laurent and
Massart 2000, lemma 1). Pixels are independent, as their random numbers are; the channels of a pixel are taken as fully dependent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...render.image import metrics
from ..records import Reference

RARE = 7.0  # x above: noise is called a bias once in e⁷ = 1100 times at each size of blocks
BLOCKS = (1, 4, 16, 1 << 20)  # pixels square, the last the whole picture
ROUNDING = 1e-6  # pictures hold float32: a bias below this is none

Pixels = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class Sums:
    """Mean and squared deviations of pictures (h, w, 3), taken in one by one (Welford 1962): none of them is kept."""

    count: int = 0
    mean: Pixels = field(default_factory=lambda: np.zeros(()))
    squares: Pixels = field(default_factory=lambda: np.zeros(()))

    def add(self, rgb: NDArray[np.floating]) -> None:
        """Take in one more."""
        self.count += 1
        away = np.asarray(rgb, np.float64) - self.mean
        self.mean = self.mean + away / self.count
        self.squares = self.squares + away * (rgb - self.mean)

    @property
    def variance(self) -> Pixels:
        """(h, w, 3) of one picture, unbiased; inf where there is only one."""
        return self.squares / (self.count - 1) if self.count > 1 else np.full(self.mean.shape, np.inf)


@dataclass(frozen=True, slots=True)
class Split:
    """Squares of bias and noise, the first of blocks of `block` pixels square, with standard errors; roots as charted.

    `bias_squared` is what was estimated (below 0 by accident as often as above, without a bias); `threshold` what noise may make of it.
    """

    bias_squared: float
    bias_squared_error: float
    threshold: float
    noise_squared: float
    noise_squared_error: float
    block: int = 1

    @property
    def is_biased(self) -> bool:
        """Whether noise does not explain how far the mean is from the reference."""
        return self.bias_squared > self.threshold

    @property
    def bias(self) -> float:
        """As √relMSE; of blocks, at least so much. 0 where it is not told from 0."""
        return math.sqrt(self.bias_squared) if self.is_biased else 0.0

    @property
    def bias_error(self) -> float:
        """The standard error of `bias`; where that is 0, what a bias would have to be to be seen for certain."""
        if self.is_biased:
            return self.bias_squared_error / (2.0 * self.bias)
        return math.sqrt(max(self.bias_squared, 0.0) + self.threshold)

    @property
    def noise(self) -> float:
        """As √relMSE, of one run."""
        return math.sqrt(self.noise_squared)

    @property
    def noise_error(self) -> float:
        """The standard error of `noise`."""
        return self.noise_squared_error / (2.0 * self.noise) if self.noise > 0.0 else 0.0


def split(runs: Sums, reference: Reference) -> Split | None:
    """Bias and noise of at least two runs; None of fewer, or where a picture or the reference is not finite everywhere.

    The bias is that of single pixels where it is seen, else of the smallest blocks in which it is, else of single pixels again.
    """
    if runs.count < 2 or not (np.isfinite(runs.mean).all() and np.isfinite(reference.rgb).all() and np.isfinite(reference.variance).all()):
        return None
    weight = weights(reference.rgb)
    noise = float(np.mean(weight * runs.variance))
    error = _of_sum(weight * runs.variance / (weight.size * math.sqrt(runs.count - 1)))
    found = Split(*_of_pixels(runs, reference, weight), noise, error)
    if found.is_biased:
        return found
    apart = _relative(runs.mean, reference)
    variance = weight * (runs.variance / runs.count + reference.variance)
    for size in BLOCKS[1:]:
        coarse = Split(*_of_blocks(apart, variance, size), noise, error, size)
        if coarse.is_biased:
            return coarse
    return found


def _of_pixels(runs: Sums, reference: Reference, weight: Pixels) -> tuple[float, float, float]:
    """bias², its standard error, its threshold. The variances are uncertain, too; and with R = μ (1 + x) the weights add 6 σ⁴ + …."""
    n, seeds = runs.count, max(len(reference.seeds), 2)
    of_mean, of_reference = runs.variance / n, reference.variance
    both = of_mean + of_reference
    doubt = np.sqrt(both**2 + of_mean**2 / (n - 1) + of_reference**2 / (seeds - 1))
    of_weights = 6.0 * float(np.mean((weight * of_reference) ** 2))
    estimate, error, threshold = _judged(weight * (runs.mean - reference.rgb) ** 2, weight * both, weight * doubt, 1.0 / weight.size)
    return estimate, math.hypot(error, of_weights), threshold + 3.0 * of_weights


def _of_blocks(apart: Pixels, variance: Pixels, size: int) -> tuple[float, float, float]:
    """The same of means over blocks of `size` pixels square, fewer at the right and the bottom."""
    height, width = apart.shape[:2]
    rows, columns = np.arange(0, height, size), np.arange(0, width, size)

    def summed(values: Pixels) -> Pixels:
        return np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)

    pixels = summed(np.ones((height, width, 1)))
    mean, of_mean = summed(apart) / pixels, summed(variance) / pixels**2
    return _judged(mean**2, of_mean, of_mean, pixels / apart.size)


def _judged(squares: Pixels, variance: Pixels, doubt: Pixels, share: Pixels | float) -> tuple[float, float, float]:
    """Σ share (squares − variance), its standard error, and what it may be by accident; `doubt` stands for the variance in the noise."""
    away = squares - variance
    estimate = float(np.sum(share * away))
    by_place = np.sum(share * doubt, axis=2)
    size = math.sqrt(float(np.sum(by_place**2)))
    crossed = max(float(np.sum(12.0 * np.square(share) * doubt * away)), 0.0)  # 4 b² v of each of three dependent channels
    threshold = 2.0 * math.sqrt(RARE) * size + 2.0 * RARE * float(by_place.max(initial=0.0))
    return estimate, math.sqrt(2.0 * size**2 + crossed), threshold + ROUNDING**2


def _relative(mean: Pixels, reference: Reference) -> Pixels:
    """δ: differences over √(R² + ε²), R and its weight from halves of the reference that know nothing of each other."""
    if reference.halves is None:
        return (mean - reference.rgb) * np.sqrt(weights(reference.rgb))
    a, b = (half[..., :3] for half in reference.halves)
    return 0.5 * ((mean - a) * np.sqrt(weights(b)) + (mean - b) * np.sqrt(weights(a)))


def _of_sum(spread: Pixels) -> float:
    """The standard error of Σ spread χ², the channels of a pixel fully dependent."""
    return math.sqrt(2.0 * float(np.sum(np.sum(spread, axis=2) ** 2)))


def weights(reference: Pixels) -> Pixels:
    """1 / (R² + ε²) of √relMSE; 0 for a reference that is black everywhere, where only what is exact has no error."""
    epsilon = metrics.EPSILON * float(metrics.luminance(reference).mean())
    below = reference**2 + epsilon**2
    return np.divide(1.0, below, out=np.zeros_like(below), where=below > 0.0)


def slope(samples: Sequence[float], noises: Sequence[float]) -> float | None:
    """How the variance falls with samples, d log noise² / d log n by least squares: −1 of random numbers, steeper of Sobol points.

    None of fewer than two rungs with noise.
    """
    known = [(math.log(n), 2.0 * math.log(s)) for n, s in zip(samples, noises, strict=True) if n > 0 and s > 0.0]
    if len({x for x, _ in known}) < 2:
        return None
    x, y = np.array(known).T
    return float(np.polyfit(x, y, 1)[0])


def joined(a: Sums, b: Sums) -> Sums:
    """The sums over the pictures of both (Chan, Golub and LeVeque 1979)."""
    if not (a.count and b.count):
        return a if a.count else b
    count, apart = a.count + b.count, b.mean - a.mean
    return Sums(count, a.mean + apart * (b.count / count), a.squares + b.squares + apart**2 * (a.count * b.count / count))
