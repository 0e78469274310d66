"""Separation of bias and noise, with synthetic estimators of known bias and noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.measure.chart import bias
from maquette.measure.records import Reference
from maquette.render.image import metrics

SHAPE = (48, 64, 3)
TRUTH = np.random.default_rng(1).uniform(0.2, 2.0, SHAPE)
BLACK = TRUTH.copy()
BLACK[:12] = 0.0  # a part that is dark, where only ε stands in the denominator


def reference_of(truth: np.ndarray, noise: float = 0.0, seeds: int = 16, seed: int = 0) -> Reference:
    """A reference as a long run makes it: the mean of `seeds` pictures, with the variance that they show."""
    halves = bias.RunningStats(), bias.RunningStats()
    random = np.random.default_rng(seed)
    for k in range(seeds):
        halves[k % 2].add(truth * (1.0 + noise * random.standard_normal(SHAPE)))
    sums = bias.merge(*halves)
    return Reference(sums.mean, sums.variance / seeds, "made", 1, tuple(range(seeds)), halves=(halves[0].mean, halves[1].mean))


def runs_of(mean: np.ndarray, noise: float, count: int, seed: int, spread: np.ndarray | None = None) -> bias.RunningStats:
    """Runs of an estimator with this mean and this noise, as a share of the mean or of `spread`."""
    random = np.random.default_rng(1000 + seed)
    sums = bias.RunningStats()
    for _ in range(count):
        sums.add((mean + noise * (mean if spread is None else spread) * random.standard_normal(SHAPE)).astype(np.float32))
    return sums


def split(runs: bias.RunningStats, reference: Reference) -> bias.Decomposition:
    found = bias.decompose(runs, reference)
    assert found is not None
    return found


def rms(difference: np.ndarray, truth: np.ndarray) -> float:
    return math.sqrt(float(np.mean(difference**2 * bias.weights(truth))))


@pytest.mark.long
@pytest.mark.parametrize("noise", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("of_reference", [0.0, 0.3])
def test_an_unbiased_estimator_has_none(noise: float, of_reference: float) -> None:
    """In 40 tries: never significant, as often above 0 as below, and within the errors stated."""
    scores = []
    for seed in range(40):
        found = split(runs_of(TRUTH, noise, 16, seed), reference_of(TRUTH, of_reference, seed=seed))
        assert not found.is_biased
        assert found.bias == 0.0 < found.bias_error
        assert found.noise == pytest.approx(noise * rms(TRUTH, TRUTH), rel=0.05)
        scores.append(found.bias_squared / found.bias_squared_error)
    assert abs(np.mean(scores)) < 0.75
    assert 0.2 < np.std(scores) < 1.3  # no larger than stated, and not stated out of proportion


@pytest.mark.parametrize(
    ("noise", "factor", "block"), [(0.0, 1.02, 1), (0.1, 1.02, 1), (0.3, 0.98, 4), (0.5, 0.98, 16), (0.8, 1.02, 1 << 20), (0.5, 1.1, 1)]
)
def test_a_picture_that_is_too_bright_shows(noise: float, factor: float, block: int) -> None:
    """Scaled by 1.02 under up to forty times as much noise, in ever larger blocks."""
    found = split(runs_of(TRUTH * factor, noise, 16, 3), reference_of(TRUTH, 0.05, seed=3))
    true = rms(TRUTH * (factor - 1.0), TRUTH)
    assert found.is_biased
    assert found.block == block
    assert found.bias == pytest.approx(true, abs=4 * found.bias_error + 1e-6)
    assert found.bias_error < 0.4 * true


def test_a_light_that_is_left_out_of_a_corner_shows() -> None:
    wrong = TRUTH.copy()
    wrong[30:, 40:] *= 0.9
    found = split(runs_of(wrong, 0.2, 16, 5), reference_of(TRUTH, seed=5))
    assert found.is_biased
    assert found.bias == pytest.approx(rms(wrong - TRUTH, TRUTH), abs=4 * found.bias_error)


def test_noise_in_the_dark_is_weighed_as_the_metric_does() -> None:
    """Noise of 0.001 on black: its √relMSE is 0.001 / ε there."""
    found = split(runs_of(BLACK, 0.001, 16, 2, np.ones(SHAPE)), reference_of(BLACK))
    epsilon = metrics.EPSILON * float(metrics.luminance(BLACK).mean())
    expected = math.sqrt(float(np.mean(0.001**2 / (BLACK**2 + epsilon**2))))
    assert not found.is_biased
    assert found.noise == pytest.approx(expected, rel=0.02)


def test_bias_and_noise_add_up_to_the_error_of_one_run() -> None:
    wrong, reference = TRUTH * 1.1, reference_of(TRUTH)
    found = split(runs_of(wrong, 0.2, 64, 7), reference)
    one = wrong * (1.0 + 0.2 * np.random.default_rng(9).standard_normal(SHAPE))
    error = metrics.root_relmse(one, reference.rgb)
    assert error**2 == pytest.approx(found.bias_squared + found.noise_squared, rel=0.05)


def test_the_references_noise_is_no_bias_of_others() -> None:
    """Of a reference ten times noisier than the runs, without the correction nearly all would count as bias."""
    reference = reference_of(TRUTH, 0.4, seeds=16, seed=11)
    found = split(runs_of(TRUTH, 0.01, 16, 11), reference)
    uncorrected = float(np.mean(bias.weights(reference.rgb) * (runs_of(TRUTH, 0.01, 16, 11).mean - reference.rgb) ** 2))
    assert uncorrected > 10 * found.bias_squared_error
    assert not found.is_biased


def test_what_is_the_same_each_time_has_no_noise_and_float32_is_no_bias() -> None:
    found = split(runs_of(TRUTH, 0.0, 5, 0), reference_of(TRUTH, 0.0))
    assert (found.noise, found.bias, found.is_biased) == (0.0, 0.0, False)
    assert found.noise_error == 0.0


def test_one_run_tells_nothing() -> None:
    assert bias.decompose(runs_of(TRUTH, 0.1, 1, 0), reference_of(TRUTH)) is None
    endless = runs_of(TRUTH, 0.1, 3, 0)
    endless.mean[0, 0] = math.inf
    assert bias.decompose(endless, reference_of(TRUTH)) is None


def test_of_a_black_reference_nothing_is_weighed() -> None:
    black = np.zeros(SHAPE)
    assert split(runs_of(black, 0.0, 3, 0), reference_of(black)).bias == 0.0


@pytest.mark.long
@given(st.integers(1, 6), st.integers(1, 6), st.floats(0.0, 1e3))
def test_sums_of_two_parts_are_those_of_all(a: int, b: int, offset: float) -> None:
    pictures = np.random.default_rng(a * 10 + b).standard_normal((a + b, 2, 3, 4)) + offset
    whole, first, second = bias.RunningStats(), bias.RunningStats(), bias.RunningStats()
    for i, picture in enumerate(pictures):
        whole.add(picture)
        (first if i < a else second).add(picture)
    both = bias.merge(first, second)
    assert both.count == a + b
    np.testing.assert_allclose(both.mean, pictures.mean(axis=0), rtol=1e-12, atol=1e-12)
    for sums in (whole, both):
        np.testing.assert_allclose(sums.variance, pictures.var(axis=0, ddof=1), rtol=1e-9, atol=1e-9 * (1 + offset))
    assert bias.merge(first, bias.RunningStats()) is first
    assert np.isinf(runs_of(TRUTH, 0.1, 1, 0).variance).all()


@pytest.mark.parametrize("power", [-1.0, -1.5])
def test_the_slope_of_the_variance(power: float) -> None:
    samples = [4.0, 16.0, 64.0, 256.0]
    assert bias.slope(samples, [n ** (power / 2) for n in samples]) == pytest.approx(power)
    assert bias.slope([4.0, 16.0], [0.1, 0.0]) is None
    assert bias.slope([], []) is None
