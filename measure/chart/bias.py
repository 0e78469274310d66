"""Separates the bias of a setting from its noise, from runs with different seeds.

With runs I₁ … I_N of a pixel, their mean Ī and variance s², and a reference R whose own variance is σ_R²,

    bias² = ⟨(Ī − R)² − v⟩ with v = s²/N + σ_R²,   noise² = ⟨s²⟩,

where ⟨⟩ is the mean over pixels and channels, weighted as in √relMSE (render/image/metrics.py) by 1 / (R² + ε²). Both are unbiased, and
noise² + bias² is the expected relMSE of one run. Celarek et al. 2019, "Quantifying the error of light transport algorithms".

A bias that is small beside the noise of single pixels is estimated from means over blocks, where noise cancels and most biases do not.
Relative differences δ = (Ī − R) / √(R² + ε²) are averaged, and ⟨δ̄² − v̄⟩ over blocks is at most bias² (Jensen). R and its weight would
be dependent there, which biases δ by σ_R². Each half of the reference is therefore weighted by the other.

Noise alone exceeds the threshold with a probability below e^−x: for Gaussian noise, Σ a (χ² − 1) ≥ 2 |a|₂ √x + 2 |a|∞ x (Laurent and
Massart 2000, lemma 1). Pixels are independent, as their random numbers are. The channels of a pixel count as fully dependent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...render.image import metrics
from ..records import Reference

THRESHOLD_EXPONENT = 7.0  # x above: noise counts as bias once in e⁷ = 1100 times at each block size
BLOCKS = (1, 4, 16, 1 << 20)  # sides in pixels; the last is the whole picture
ROUNDING = 1e-6  # pictures are float32: a smaller bias is none

Pixels = NDArray[np.float64]


@dataclass(slots=True, eq=False)
class RunningStats:
    """Running mean and squared deviations of pictures (h, w, 3) (Welford 1962)."""

    count: int = 0
    mean: Pixels = field(default_factory=lambda: np.zeros(()))
    squares: Pixels = field(default_factory=lambda: np.zeros(()))

    def add(self, rgb: NDArray[np.floating]) -> None:
        """Add a picture."""
        self.count += 1
        away = np.asarray(rgb, np.float64) - self.mean
        self.mean = self.mean + away / self.count
        self.squares = self.squares + away * (rgb - self.mean)

    @property
    def variance(self) -> Pixels:
        """(h, w, 3) unbiased variance of one picture; inf for a single picture."""
        return self.squares / (self.count - 1) if self.count > 1 else np.full(self.mean.shape, np.inf)


@dataclass(frozen=True, slots=True)
class Decomposition:
    """Squares of bias and noise with standard errors. The bias is that of means over blocks of `block` × `block` pixels.

    `bias_squared` is the estimate, negative as often as positive without a bias. `threshold` is the largest estimate that noise explains.
    """

    bias_squared: float
    bias_squared_error: float
    threshold: float
    noise_squared: float
    noise_squared_error: float
    block: int = 1

    @property
    def is_biased(self) -> bool:
        """Whether the mean differs from the reference by more than noise explains."""
        return self.bias_squared > self.threshold

    @property
    def bias(self) -> float:
        """The bias as √relMSE, a lower bound for blocks; 0 where it is not significant."""
        return math.sqrt(self.bias_squared) if self.is_biased else 0.0

    @property
    def bias_error(self) -> float:
        """The standard error of `bias`; where that is 0, the smallest bias that would be detected."""
        if self.is_biased:
            return self.bias_squared_error / (2.0 * self.bias)
        return math.sqrt(max(self.bias_squared, 0.0) + self.threshold)

    @property
    def noise(self) -> float:
        """The noise of one run as √relMSE."""
        return math.sqrt(self.noise_squared)

    @property
    def noise_error(self) -> float:
        """The standard error of `noise`."""
        return self.noise_squared_error / (2.0 * self.noise) if self.noise > 0.0 else 0.0


def decompose(runs: RunningStats, reference: Reference) -> Decomposition | None:
    """Bias and noise of at least two runs; None for fewer runs or non-finite pixels.

    The bias is that of single pixels where it is significant, else that of the smallest blocks where it is, else that of single pixels.
    """
    if runs.count < 2 or not (np.isfinite(runs.mean).all() and np.isfinite(reference.rgb).all() and np.isfinite(reference.variance).all()):
        return None
    weight = weights(reference.rgb)
    noise = float(np.mean(weight * runs.variance))
    error = _standard_error(weight * runs.variance / (weight.size * math.sqrt(runs.count - 1)))
    parts = Decomposition(*_pixel_bias(runs, reference, weight), noise, error)
    if parts.is_biased:
        return parts
    apart = _relative_difference(runs.mean, reference)
    variance = weight * (runs.variance / runs.count + reference.variance)
    for size in BLOCKS[1:]:
        coarse = Decomposition(*_block_bias(apart, variance, size), noise, error, size)
        if coarse.is_biased:
            return coarse
    return parts


def _pixel_bias(runs: RunningStats, reference: Reference, weight: Pixels) -> tuple[float, float, float]:
    """(bias², its standard error, its threshold). The variances are uncertain, too. With R = μ (1 + x) the weights add 6 σ⁴ + …."""
    n, seeds = runs.count, max(len(reference.seeds), 2)
    of_mean, of_reference = runs.variance / n, reference.variance
    both = of_mean + of_reference
    doubt = np.sqrt(both**2 + of_mean**2 / (n - 1) + of_reference**2 / (seeds - 1))
    of_weights = 6.0 * float(np.mean((weight * of_reference) ** 2))
    estimate, error, threshold = _estimate(weight * (runs.mean - reference.rgb) ** 2, weight * both, weight * doubt, 1.0 / weight.size)
    return estimate, math.hypot(error, of_weights), threshold + 3.0 * of_weights


def _block_bias(apart: Pixels, variance: Pixels, size: int) -> tuple[float, float, float]:
    """The same for means over blocks of `size` × `size` pixels, smaller at the right and the bottom."""
    height, width = apart.shape[:2]
    rows, columns = np.arange(0, height, size), np.arange(0, width, size)

    def summed(values: Pixels) -> Pixels:
        return np.add.reduceat(np.add.reduceat(values, rows, axis=0), columns, axis=1)

    pixels = summed(np.ones((height, width, 1)))
    mean, of_mean = summed(apart) / pixels, summed(variance) / pixels**2
    return _estimate(mean**2, of_mean, of_mean, pixels / apart.size)


def _estimate(squares: Pixels, variance: Pixels, doubt: Pixels, share: Pixels | float) -> tuple[float, float, float]:
    """(Σ share (squares − variance), its standard error, the threshold of noise); `doubt` is the variance with its own uncertainty."""
    away = squares - variance
    estimate = float(np.sum(share * away))
    by_place = np.sum(share * doubt, axis=2)
    size = math.sqrt(float(np.sum(by_place**2)))
    crossed = max(float(np.sum(12.0 * np.square(share) * doubt * away)), 0.0)  # 4 b² v of each of three dependent channels
    threshold = 2.0 * math.sqrt(THRESHOLD_EXPONENT) * size + 2.0 * THRESHOLD_EXPONENT * float(by_place.max(initial=0.0))
    return estimate, math.sqrt(2.0 * size**2 + crossed), threshold + ROUNDING**2


def _relative_difference(mean: Pixels, reference: Reference) -> Pixels:
    """δ: differences over √(R² + ε²), with R and its weight from independent halves of the reference."""
    if reference.halves is None:
        return (mean - reference.rgb) * np.sqrt(weights(reference.rgb))
    a, b = (half[..., :3] for half in reference.halves)
    return 0.5 * ((mean - a) * np.sqrt(weights(b)) + (mean - b) * np.sqrt(weights(a)))


def _standard_error(spread: Pixels) -> float:
    """The standard error of Σ spread χ², with fully dependent channels."""
    return math.sqrt(2.0 * float(np.sum(np.sum(spread, axis=2) ** 2)))


def weights(reference: Pixels) -> Pixels:
    """1 / (R² + ε²) of √relMSE; 0 for an entirely black reference, where only an exact picture has no error."""
    epsilon = metrics.EPSILON * float(metrics.luminance(reference).mean())
    below = reference**2 + epsilon**2
    return np.divide(1.0, below, out=np.zeros_like(below), where=below > 0.0)


def slope(samples: Sequence[float], noises: Sequence[float]) -> float | None:
    """The convergence rate d log noise² / d log n by least squares: −1 for random numbers, steeper for Sobol points.

    None for fewer than two steps with noise.
    """
    logarithms = [(math.log(n), 2.0 * math.log(s)) for n, s in zip(samples, noises, strict=True) if n > 0 and s > 0.0]
    if len({x for x, _ in logarithms}) < 2:
        return None
    x, y = np.array(logarithms).T
    return float(np.polyfit(x, y, 1)[0])


def merge(a: RunningStats, b: RunningStats) -> RunningStats:
    """The statistics of the pictures of both (Chan, Golub and LeVeque 1979)."""
    if not (a.count and b.count):
        return a if a.count else b
    count, apart = a.count + b.count, b.mean - a.mean
    return RunningStats(count, a.mean + apart * (b.count / count), a.squares + b.squares + apart**2 * (a.count * b.count / count))
