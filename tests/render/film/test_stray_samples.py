"""Stray bright samples: told apart from the errors of edges, by pictures whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.film import stray_samples


def of_samples(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(relative squared error (h, w), rgba, differences) of a picture that is the mean of samples (n, h, w)."""
    mean, variance = samples.mean(axis=0), samples.var(axis=0) / len(samples)
    rgba = np.repeat(mean[..., None], 4, axis=2).astype(np.float32)
    half = len(samples) // 2
    difference = 0.5 * (samples[:half].mean(axis=0) - samples[half:].mean(axis=0))
    return variance / (np.median(mean) ** 2), rgba, np.repeat(difference[..., None], 3, axis=2).astype(np.float32)


def cube(h: int, w: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Samples of a bright square, slightly turned, before a dark ground: noise at its edges alone."""
    y, x = np.mgrid[:h, :w][:, None] + rng.random((2, n, h, w))
    u, v = x - w / 2 + 0.07 * (y - h / 2), y - h / 2 - 0.07 * (x - w / 2)
    return np.where((np.abs(u) < w / 5) & (np.abs(v) < h / 4), 0.8, 0.02)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("size", "n"), [((60, 80), 4), ((120, 160), 16), ((240, 320), 4)])
def test_the_edges_of_a_cube_are_no_strays(seed: int, size: tuple[int, int], n: int) -> None:
    samples = cube(*size, n, np.random.default_rng(seed))
    assert stray_samples.share_of_error(*of_samples(samples)) < 0.02


@pytest.mark.parametrize("seed", range(5))
def test_fireflies_are_strays(seed: int) -> None:
    """One sample of one pixel in a thousand is a hundred times as bright."""
    rng = np.random.default_rng(seed)
    samples = 0.5 + 0.005 * rng.standard_normal((16, 120, 160))
    for pixel in rng.choice(120 * 160, 15, replace=False):
        samples.reshape(16, -1)[rng.integers(16), pixel] += 50.0
    assert stray_samples.share_of_error(*of_samples(samples)) > 0.9


def test_even_noise_has_no_strays() -> None:
    samples = np.random.default_rng(1).exponential(1.0, (4, 120, 160))
    assert stray_samples.share_of_error(*of_samples(samples)) < 0.02


@pytest.mark.parametrize("relative", [np.zeros((4, 4)), np.full((4, 4), np.inf), np.ones((1, 1))])
def test_pictures_without_a_known_error(relative: np.ndarray) -> None:
    ones = np.ones((*relative.shape, 4), np.float32)
    assert stray_samples.share_of_error(relative, ones, ones[..., :3]) == 0.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("covered", [0.2, 0.5, 0.9])
def test_a_lamp_of_one_pixel_is_no_stray(seed: int, covered: float) -> None:
    """A lamp that covers a part of one pixel: nearly all of the error is there, and more samples do not remove it."""
    rng = np.random.default_rng(seed)
    samples = 0.5 + 0.005 * rng.standard_normal((256, 40, 50))
    samples[:, 17, 23] += 50.0 * (rng.random(256) < covered)
    relative, rgba, differences = of_samples(samples)
    assert relative[17, 23] > 0.9 * relative.sum()
    assert stray_samples.share_of_error(relative, rgba, differences) == 0.0


@pytest.mark.parametrize(("size", "reported"), [((1, 1), False), ((8, 8), False), ((24, 32), False), ((32, 32), True), ((25, 40), True)])
def test_one_pixel_of_a_tiny_picture_is_more_than_a_thousandth_of_it(size: tuple[int, int], reported: bool) -> None:
    samples = 0.5 + 0.005 * np.random.default_rng(3).standard_normal((16, *size))
    samples[3, size[0] // 2, size[1] // 2] += 50.0
    share = stray_samples.share_of_error(*of_samples(samples))
    assert share > 0.9 if reported else share == 0.0
