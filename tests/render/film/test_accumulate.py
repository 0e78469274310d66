"""The estimate of √relMSE from halves of samples, on pictures of known light and noise."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from maquette.render.film import accumulate
from maquette.render.image import metrics

HEIGHT, WIDTH = 60, 80
SIZE = (HEIGHT, WIDTH)
Sampler = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]


def normal(spread: float) -> Sampler:
    return lambda rng, size: 1.0 + spread * rng.standard_normal(size)


def strays(chance: float) -> Sampler:
    """Samples of mean 1, most of them 0."""
    return lambda rng, size: (rng.random(size) < chance) / chance


def exponential(rng: np.random.Generator, size: tuple[int, ...]) -> np.ndarray:
    return rng.exponential(1.0, size)


def told(light: np.ndarray, sampler: Sampler, samples: int, seed: int) -> tuple[float, float]:
    """(estimated √relMSE, true one) of a picture of (h, w) light from independent samples of mean 1 times that light."""
    drawn = light[..., None, None] * sampler(np.random.default_rng(seed), (*light.shape, 3, samples))
    halves = drawn[..., : samples // 2].mean(axis=3), drawn[..., samples // 2 :].mean(axis=3)
    rgba = np.dstack([(halves[0] + halves[1]) / 2, np.ones(light.shape)]).astype(np.float32)
    errors = estimate(rgba, ((halves[0] - halves[1]) / 2).astype(np.float32))
    return math.sqrt(errors.mean()), metrics.root_relmse(rgba, np.repeat(light[..., None], 3, axis=2))


def estimate(rgba: np.ndarray, differences: np.ndarray) -> np.ndarray:
    out = np.empty(rgba.shape[:2])
    least = (metrics.EPSILON * float(metrics.luminance(rgba[..., :3]).mean())) ** 2
    accumulate.relative_error(differences, rgba, np.full(out.shape, 16), np.ones(32), least, out)
    return out


SMOOTH = np.full(SIZE, 0.5)
RAMP = np.linspace(0.05, 1.0, WIDTH) * np.ones((HEIGHT, 1))
CHECKER = np.where(np.add.outer(np.arange(HEIGHT) // 6, np.arange(WIDTH) // 6) % 2, 0.9, 0.05)


@pytest.mark.parametrize("light", [SMOOTH, RAMP, CHECKER], ids=["smooth", "ramp", "checker"])
@pytest.mark.parametrize(
    ("sampler", "samples"), [(normal(0.3), 16), (exponential, 16), (exponential, 4), (strays(0.2), 16), (strays(0.05), 64)],
    ids=["little noise", "exponential", "few", "strays", "rare strays"],
)  # fmt: skip
def test_it_is_about_the_true_error(light: np.ndarray, sampler: Sampler, samples: int) -> None:
    """Also of noise as large as the light: pixels that are dark by chance count by the light that they should have."""
    errors = np.array([told(light, sampler, samples, seed) for seed in range(4)])
    ratios = errors[:, 1] / errors[:, 0]
    assert ratios.min() > 0.7
    assert ratios.max() < 1.1


def test_a_stray_is_as_large_as_what_its_neighbors_say() -> None:
    """One sample in one pixel: its error is that of its light beside the neighbors'."""
    rgba, differences = np.ones((9, 9, 4), np.float32), np.full((9, 9, 3), 0.01, np.float32)
    rgba[4, 4, :3], differences[4, 4] = 11.0, 10.0
    out = estimate(rgba, differences)
    assert out[4, 4] == pytest.approx(100.0, rel=0.02)
    assert np.delete(out.ravel(), 40).max() < 2e-4


def test_a_stray_in_the_dark_has_a_limit() -> None:
    """Its light is taken for 1/16 of what it shows, as the pixel may be bright in truth."""
    rgba, differences = np.zeros((9, 9, 4), np.float32), np.zeros((9, 9, 3), np.float32)
    rgba[4, 4, :3] = differences[4, 4] = 1.0
    assert 100.0 < estimate(rgba, differences)[4, 4] < 300.0


def test_pixels_of_one_batch_are_unknown_and_change_no_other() -> None:
    rgba, differences = np.ones((8, 12, 4), np.float32), np.full((8, 12, 3), 0.1, np.float32)
    complete = estimate(rgba, differences)
    differences[:, 6:] = np.inf
    part = estimate(rgba, differences)
    assert np.isinf(part[:, 6:]).all()
    assert part[:, :6] == pytest.approx(complete[:, :6])
    assert estimate(rgba[:1, :1], differences[:1, :1]) == pytest.approx(np.full((1, 1), 0.01), rel=1e-3)
