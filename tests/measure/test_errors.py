"""Errors of pictures with known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.measure import errors
from maquette.render.image import metrics

SHAPE = (40, 50, 3)
GREY = np.full(SHAPE, 0.5)
EVERYWHERE = np.ones(SHAPE[:2])


def measured(rgb: np.ndarray, reference: np.ndarray, exposure: float = 0.0) -> dict[str, float]:
    return errors.measures(rgb.astype(np.float32), EVERYWHERE, reference, EVERYWHERE, exposure)


def test_a_picture_of_itself_has_none() -> None:
    assert measured(GREY, GREY) == dict.fromkeys(("relmse", "relmse 99.9%", "blocks", "flip", "max", "silhouette"), 0.0)
    assert "flip" not in errors.measures(GREY, None, GREY, None, 0.0, with_slow=False)


def test_a_tenth_too_bright() -> None:
    found = measured(GREY * 1.1, GREY)
    expected = 0.05 / math.hypot(0.5, metrics.EPSILON * 0.5)
    assert found["relmse"] == found["relmse 99.9%"] == pytest.approx(expected, rel=1e-6)
    assert found["max"] == pytest.approx(0.05, rel=1e-6)
    assert 0.0 < found["flip"] < 1.0
    assert found["silhouette"] == 0.0


def test_two_pixels_in_two_thousand_are_trimmed() -> None:
    spark = GREY.copy()
    spark[3, 4] = spark[9, 9] = 50.0
    found = measured(spark, GREY)
    assert found["relmse"] > 3.0
    assert found["relmse 99.9%"] == 0.0
    spark[20, 20] = 0.6
    assert measured(spark, GREY)["relmse 99.9%"] == pytest.approx(math.sqrt(0.1**2 / 0.250025 / 1998), rel=1e-5)


def test_block_means_keep_shared_noise_alone() -> None:
    """Independent noise falls to a quarter, noise that 4 × 4 pixels share keeps its size, and a mean of 0 leaves nothing."""
    rng = np.random.default_rng(3)
    alone = measured(GREY + rng.normal(0.0, 0.01, SHAPE), GREY)
    assert alone["blocks"] == pytest.approx(alone["relmse"] / 4.0, rel=0.1)
    shared = np.repeat(np.repeat(rng.normal(0.0, 0.01, (10, 13, 3)), 4, axis=0), 4, axis=1)[:40, :50]
    together = measured(GREY + shared, GREY)
    assert together["blocks"] == pytest.approx(together["relmse"], rel=0.05)
    sign = np.where(np.add.outer(np.arange(40), np.arange(50)) % 2, 0.01, -0.01)[..., None]
    assert measured(GREY + sign, GREY)["blocks"] < 1e-6


def test_blocks_are_cropped_at_the_edges() -> None:
    values = np.arange(30.0).reshape(5, 6)
    expected = [[values[:4, :4].mean(), values[:4, 4:].mean()], [values[4:, :4].mean(), values[4:, 4:].mean()]]
    assert metrics.block_means(values) == pytest.approx(np.array(expected))
    assert metrics.block_means(np.dstack([values, 2 * values])) == pytest.approx(np.dstack([expected, 2 * np.array(expected)]))


def test_flip_sees_what_is_shown_at_the_exposure() -> None:
    """Differences beyond white are not seen, until the exposure brings them within."""
    bright = GREY * 8.0
    assert measured(bright * 1.2, bright)["flip"] == 0.0
    assert measured(bright * 1.2, bright, exposure=-4.0)["flip"] > 0.01
    assert measured(np.where(GREY > 0, np.inf, 0.0), bright)["flip"] == 0.0


def test_an_outline_one_pixel_off() -> None:
    a, b = np.zeros(SHAPE[:2]), np.zeros(SHAPE[:2])
    a[:, 20:] = b[:, 21:] = 1.0
    assert errors.measures(GREY, a, GREY, b, 0.0)["silhouette"] == pytest.approx(1.0)
    assert "silhouette" not in errors.measures(GREY, None, GREY, b, 0.0)


def test_what_is_not_finite_in_one_alone_is_endless() -> None:
    broken = GREY.copy()
    broken[0, 0] = np.nan
    found = errors.measures(broken, None, GREY, None, 0.0)
    assert found["relmse"] == found["max"] == math.inf
    assert math.isfinite(found["flip"])
