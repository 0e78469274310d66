"""What all pixels of a picture show: squares of differences, and the brightest light."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.film import picture_statistics


@pytest.mark.parametrize("shape", [(1, 1), (64, 3), (130, 7), (0, 4)])
def test_squares_are_those_of_numpy(shape: tuple[int, int]) -> None:
    values = np.random.default_rng(1).normal(size=(*shape, 3)).astype(np.float32)
    values[..., :1] = np.inf
    assert np.array_equal(picture_statistics.squares(values, 3), np.square(values, dtype=np.float64))


def test_the_brightest_light_leaves_out_what_is_not_finite_and_not_covered() -> None:
    rgba = np.zeros((130, 5, 4), np.float32)
    assert picture_statistics.brightest(rgba, True, 3) == (-np.inf, False)
    assert picture_statistics.brightest(rgba, False, 3) == (0.0, False)
    rgba[129, 4] = 0.25, 0.5, 0.125, 1.0
    rgba[0, 0] = 9.0, 0.0, 0.0, 0.0
    rgba[1, 0] = np.inf, 0.0, 0.0, 1.0
    rgba[2, 0] = 99.0, np.nan, 0.0, 1.0
    assert picture_statistics.brightest(rgba, True, 3) == (0.5, True)
    assert picture_statistics.brightest(rgba, False, 1) == (9.0, True)
    assert picture_statistics.brightest(-np.abs(rgba[129:]) - np.float32(1.0), False, 1) == (-1.0, False)
