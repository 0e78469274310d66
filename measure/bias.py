"""Bias and noise of a setting, told apart from runs with many seeds: the means of N runs, less what noise alone leaves of them.

With runs I₁ … I_N of a pixel, their mean Ī and variance s², and a reference R whose own variance is σ_R²,

    bias² = ⟨(Ī − R)² − s²/N − σ_R²⟩,   noise² = ⟨s²⟩,

where ⟨⟩ is the mean over pixels and channels weighed as in √relMSE (render/metrics.py): by 1 / (R² + ε²). Both are unbiased, and
noise² + bias² is the relMSE one run is expected to have. Celarek et al. 2019, "Quantifying the error of light transport algorithms".

Their standard errors take pixels as independent and normal, and the three channels of a pixel as fully dependent, which overstates
rather than understates them: var X = 4 b² v + 2 v² + 2 (s²/N)²/(N − 1) + 2 σ_R⁴/(S − 1) with v = s²/N + σ_R² and S reference seeds.
To that of bias² comes what the weights, taken from an uncertain R, may add: with R = μ(1 + x), ⟨(x² − σ²) / (1 + x)²⟩ is 6 σ⁴ + ….
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..render import metrics
from .records import Reference

SIGNIFICANT = 3.0  # standard errors beyond which a bias is one: 1 in 700 by accident
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
    """Squares of bias and noise as estimated (the first may be below 0 by accident), with their standard errors; roots as charted."""

    bias_squared: float
    bias_squared_error: float
    noise_squared: float
    noise_squared_error: float

    @property
    def is_biased(self) -> bool:
        """Whether noise does not explain how far the mean is from the reference."""
        return self.bias_squared > SIGNIFICANT * self.bias_squared_error + ROUNDING**2

    @property
    def bias(self) -> float:
        """As √relMSE; 0 where it is not told from 0."""
        return math.sqrt(self.bias_squared) if self.is_biased else 0.0

    @property
    def bias_error(self) -> float:
        """The standard error of `bias`; where that is 0, what a bias would at most be, at SIGNIFICANT standard errors."""
        if self.is_biased:
            return self.bias_squared_error / (2.0 * self.bias)
        return math.sqrt(max(self.bias_squared, 0.0) + SIGNIFICANT * self.bias_squared_error)

    @property
    def noise(self) -> float:
        """As √relMSE, of one run."""
        return math.sqrt(self.noise_squared)

    @property
    def noise_error(self) -> float:
        """The standard error of `noise`."""
        return self.noise_squared_error / (2.0 * self.noise) if self.noise > 0.0 else 0.0


def split(runs: Sums, reference: Reference) -> Split | None:
    """Bias and noise of at least two runs; None of fewer, or where a picture or the reference is not finite everywhere."""
    if runs.count < 2 or not (np.isfinite(runs.mean).all() and np.isfinite(reference.rgb).all() and np.isfinite(reference.variance).all()):
        return None
    weight = weights(reference.rgb)
    n, seeds = runs.count, max(len(reference.seeds), 2)
    of_mean, of_reference = runs.variance / n, reference.variance
    both = of_mean + of_reference
    away = (runs.mean - reference.rgb) ** 2 - both
    doubt = 2.0 * both**2 + 2.0 * of_mean**2 / (n - 1) + 2.0 * of_reference**2 / (seeds - 1)
    crossed = max(float(np.sum(4.0 * weight**2 * both * away)), 0.0)
    return Split(
        bias_squared=float(np.mean(weight * away)),
        bias_squared_error=math.hypot(
            _of_pixels(float(np.sum(weight**2 * doubt)) + crossed, away.size), 6.0 * float(np.mean((weight * of_reference) ** 2))
        ),
        noise_squared=float(np.mean(weight * runs.variance)),
        noise_squared_error=_of_pixels(float(np.sum(weight**2 * 2.0 * runs.variance**2 / (n - 1))), away.size),
    )


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


def _of_pixels(variance: float, count: int) -> float:
    """The standard error of a mean over `count` numbers whose variances add up to this, three and three of them dependent."""
    return math.sqrt(3.0 * variance) / count


def joined(a: Sums, b: Sums) -> Sums:
    """The sums over the pictures of both (Chan, Golub and LeVeque 1979)."""
    if not (a.count and b.count):
        return a if a.count else b
    count, apart = a.count + b.count, b.mean - a.mean
    return Sums(count, a.mean + apart * (b.count / count), a.squares + b.squares + apart**2 * (a.count * b.count / count))
