"""Checkers and stripes over parallelograms, against sums of points on a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from maquette.render.texture import checker_filter

Array = np.ndarray
SIDE = 192  # places along each side of a parallelogram, in the sums


def summed(checker: bool, x: Array, y: Array, p: tuple[float, float], q: tuple[float, float]) -> Array:
    """Share of even cells among SIDE × SIDE points around each x, y."""
    a, b = np.meshgrid(*[(np.arange(SIDE) + 0.5) / SIDE - 0.5] * 2)
    across, up = (np.floor(c[:, None, None] + p[k] * a + q[k] * b) for k, c in enumerate((x, y)))
    return ((across + checker * up) % 2 == 0).mean(axis=(1, 2))


def mean(checker: bool, x: Array, y: Array, p: tuple[float, float], q: tuple[float, float]) -> Array:
    ones = np.ones(x.shape, x.dtype)
    share = checker_filter.mean_share(np.full(x.shape, checker), x, y, (p[0] * ones, p[1] * ones, q[0] * ones, q[1] * ones))
    assert ((share >= 0) & (share <= 1)).all()
    return share


def places(seed: int, kind: type = np.float64) -> tuple[Array, Array]:
    x, y = np.random.default_rng(seed).uniform(-40, 40, (2, 24)).astype(kind)
    return x, y


width = st.floats(-3, 1.2).map(lambda e: round(10.0**e, 6))


@pytest.mark.long
@given(width, width, st.integers(0, 99), st.booleans(), st.booleans())
@settings(max_examples=60, deadline=None)
def test_axis_aligned_means_are_exact(wide: float, high: float, seed: int, checker: bool, turned: bool):
    p, q = ((0.0, wide), (high, 0.0)) if turned else ((wide, 0.0), (0.0, high))
    x, y = places(seed)
    off = np.abs(mean(checker, x, y, p, q) - summed(checker, x, y, p, q)).max()
    assert off < 1.6 / SIDE * (1 + max(wide, high) / 8)  # what the sum misses at two edges, or at the ends of many cells


@pytest.mark.long
@given(width, width, st.floats(0, 180), st.integers(0, 99), st.sampled_from([np.float32, np.float64]))
@settings(max_examples=60, deadline=None)
@example(0.01, 0.421697, 29.0, 71, np.float32)
@example(0.01, 0.421697, 29.0, 35, np.float32)
@example(10.326622, 0.017864, 108.36335289212074, 41, np.float64)  # thin and slanted: parts of a cell each
@example(0.023824, 12.975045, 18.312149238358593, 0, np.float64)
def test_oblique_means_are_close(long: float, short: float, angle: float, seed: int, kind: type):
    """Within a tenth of the contrast, mostly far less, in single and double precision."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    x, y = places(seed, kind)
    p, q = (c * long, s * long), (-s * short, c * short)
    off = np.abs(mean(True, x, y, p, q) - summed(True, x.astype(float), y.astype(float), p, q))
    assert off.max() < 0.12
    assert np.sqrt(np.mean(off**2)) < 0.04


def test_oblique_stripes_are_exact():
    x, y = places(3)
    p, q = (0.7, 5.0), (0.4, -3.0)
    assert np.abs(mean(False, x, y, p, q) - summed(False, x, y, p, q)).max() < 1e-2


@pytest.mark.parametrize("checker", [True, False])
def test_a_point_has_its_cell(checker: bool):
    x, y = places(4)
    assert np.array_equal(mean(checker, x, y, (0.0, 0.0), (0.0, 0.0)), summed(checker, x, y, (0.0, 0.0), (0.0, 0.0)))


def test_huge_footprints_are_a_half():
    x, y = places(5)
    for p, q in (((1e9, 3e8), (2e3, -1e3)), ((1e20, 0.0), (0.0, 1e20))):
        assert mean(True, x, y, p, q) == pytest.approx(0.5, abs=1e-3)
