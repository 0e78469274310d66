"""Stray bright samples: told apart from the errors of edges, by pictures whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render import picture_notes
from maquette.render.film import accumulate, stray_samples
from maquette.render.image import metrics


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


def hidden(samples: np.ndarray) -> tuple[float, float]:
    """(estimated √relMSE, share of its square in dark pixels) of a picture of samples (n, h, w)."""
    _, rgba, differences = of_samples(samples)
    relative, counts = np.empty(rgba.shape[:2]), np.full(rgba.shape[:2], len(samples))
    squared_epsilon = (metrics.EPSILON * float(rgba[..., :3].mean())) ** 2
    accumulate.relative_error(differences, rgba, counts, np.ones(32), squared_epsilon, relative)
    share = stray_samples.share_in_dark_pixels(relative, rgba, differences, counts, np.ones(counts.shape), squared_epsilon, 2)
    return float(np.sqrt(relative.mean())), share


def beside_a_flame(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Samples (n, h, w) of a bright flame on a dark ground, and their expected light (h, w).

    On either side of the flame, one of the samples of 20 pixels is 20 times as bright as the flame.
    """
    rng = np.random.default_rng(seed)
    light = np.ones((40, 50))
    light[10:30, 20:30] = 100.0
    samples = light * (1.0 + 0.01 * rng.standard_normal((n, 40, 50)))
    samples[rng.integers(n, size=2), rng.integers(10, 30, 2), [19, 30]] += 2000.0
    light[10:30, [19, 30]] += 2000.0 / (20 * n)
    return samples, light


@pytest.mark.parametrize("n", [64, 256])
@pytest.mark.parametrize("seed", range(8))
def test_strays_in_dark_pixels_beside_a_flame_are_found(seed: int, n: int) -> None:
    """The flame is brighter than the pixel of the stray, and the estimate takes half of that pixel's mean for its light: it is too low."""
    samples, light = beside_a_flame(seed, n)
    true = float(np.sqrt(np.square((samples.mean(axis=0) - light) / light).mean()))
    estimate, share = hidden(samples)
    assert estimate < 0.5 * true
    assert share > 0.9
    assert stray_samples.share_of_error(*of_samples(samples)) == 0.0


@pytest.mark.parametrize("n", [4, 16, 64, 256])
@pytest.mark.parametrize("seed", range(3))
def test_edges_and_even_noise_hide_no_strays(seed: int, n: int) -> None:
    """A sample of an edge is as bright as a neighbor, and a dark half of few samples is usual there."""
    rng = np.random.default_rng(seed)
    assert hidden(cube(60, 80, n, rng))[1] < picture_notes.SPARSE
    assert hidden(rng.exponential(1.0, (n, 60, 80)))[1] < picture_notes.SPARSE


@pytest.mark.parametrize(
    ("dark", "count", "light"), [(0.25, 256, 0.75), (0.5, 256, None), (0.0, 1024, 1.25 / 16), (0.0, 100, 0.125), (0.0, 10, None)]
)
def test_the_share_of_one_dark_pixel_is_known(dark: float, count: int, light: float | None) -> None:
    """It shows 1.25, and its halves are `dark` and 2.5 - `dark`.

    Its light is their geometric mean, or a share of what it shows; none for halves alike, or of few samples.
    """
    relative = np.full((70, 20), 0.01)
    relative[65, 3] = 1.0
    rgba, differences = np.full((70, 20, 4), 2.0, np.float32), np.zeros((70, 20, 3), np.float32)
    rgba[65, 3, :3], differences[65, 3] = 1.25, 1.25 - dark
    share = stray_samples.share_in_dark_pixels(relative, rgba, differences, np.full((70, 20), count), np.ones((70, 20)), 0.0)
    error = 0.0 if light is None else (1.25 - dark) ** 2 / light**2
    assert share == pytest.approx(error / (1399 * 0.01 + error))


def test_pixels_without_a_known_error_hide_no_strays() -> None:
    relative, rgba, differences = np.full((40, 40), np.inf), np.ones((40, 40, 4), np.float32), np.full((40, 40, 3), np.inf, np.float32)
    counts, shares = np.ones((40, 40), np.int64), np.ones((40, 40))
    assert stray_samples.share_in_dark_pixels(relative, rgba, differences, counts, shares, 0.0) == 0.0
    relative[0, 0], differences[0, 0], rgba[0, 0] = 1.0, 0.0, 0.0  # black: 0 / 0
    assert stray_samples.share_in_dark_pixels(relative, rgba, differences, counts, shares, 0.0) == 0.0
    assert (
        stray_samples.share_in_dark_pixels(np.ones((8, 8)), rgba[:8, :8], differences[:8, :8], counts[:8, :8], shares[:8, :8], 0.0) == 0.0
    )
