"""Whether pictures agree within their noise: known differences in blocks of pixels."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.cli.scene_tests import verdict


def test_a_block_differs_by_its_standard_errors() -> None:
    """One of 16 × 16 pixels is 10 % brighter; the variance of a pixel's difference is 4, that of the mean 4 / 256."""
    b = np.full((40, 50, 3), 10.0)
    a = b.copy()
    a[16:32, 32:48, 1] += 1.0
    deviations, relative = verdict.block_differences(a, b, np.full(b.shape, 4.0))
    assert deviations.shape == (3, 4)
    assert deviations[1, 2] == pytest.approx(1.0 / np.sqrt(4.0 / 256))
    assert relative[1, 2] == pytest.approx(0.1)
    assert np.count_nonzero(deviations) == 1


def test_smaller_blocks_at_the_edges_count_their_own_pixels() -> None:
    """A block of 8 × 2 pixels at the right and at the bottom."""
    a, b = np.full((24, 34, 3), 3.0), np.full((24, 34, 3), 2.0)
    deviations, relative = verdict.block_differences(a, b, np.ones(b.shape))
    assert deviations[1, 2] == pytest.approx(np.sqrt(16))
    assert relative[1, 2] == pytest.approx(0.5)


@pytest.mark.long
def test_noise_alone_stays_below_the_limit() -> None:
    """Of 10,000 blocks of normal noise none differs by DEVIATIONS standard errors, and some by 3."""
    random = np.random.default_rng(1)
    b = np.full((1600, 1600, 3), 5.0)
    a = b + random.normal(0.0, 2.0, b.shape)
    deviations, _ = verdict.block_differences(a, b, np.full(b.shape, 4.0))
    assert 3.0 < deviations.max() < verdict.DEVIATIONS
