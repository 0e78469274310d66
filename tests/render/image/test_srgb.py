"""Tests of the 8-bit codes against the sRGB curve in double precision, at every threshold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.render.image import srgb
from numpy.typing import NDArray

STOPS = (0.0, 1.0, -1.0, 0.37, -2.61, 7.3, -11.9, 40.0, -64.0, 64.0, 80.0, -200.0)


def by_the_curve(rgb: NDArray[np.float32], stops: float) -> NDArray[np.uint8]:
    return np.rint(srgb.encode_srgb(rgb.astype(np.float64) * 2.0**stops) * 255).astype(np.uint8)


@pytest.mark.long
@pytest.mark.parametrize("stops", STOPS)
def test_where_codes_begin(stops: float) -> None:
    begins = srgb.decode_srgb((np.arange(1, 256) - 0.5) / 255) / 2.0**stops
    with np.errstate(over="ignore"):
        about = begins.astype(np.float32).view(np.int32)
    light = np.clip(about[:, None] + np.arange(-3000, 3000, dtype=np.int64), 0, 0x7F800000).astype(np.int32).view(np.float32)
    codes = srgb.codes(light, stops)
    assert np.array_equal(codes, by_the_curve(light, stops))
    if abs(stops) <= 64:
        assert set(codes.ravel()) == set(range(256))


@pytest.mark.parametrize("stops", STOPS)
def test_all_kinds_of_numbers(stops: float) -> None:
    """Every upper half of a float32's bits, the first, the last and some lower halves: what is no number, negative, endless, tiny."""
    lower = np.array([0, 1, 0x7FFF, 0x8000, 0xFFFF, *np.random.default_rng(1).integers(0, 65536, 5)])
    light = (np.arange(65536, dtype=np.uint32)[:, None] << 16 | lower.astype(np.uint32)).view(np.float32)
    with np.errstate(all="ignore"):
        assert np.array_equal(srgb.codes(light, stops), by_the_curve(light, stops))


def test_odd_light_is_no_warning() -> None:
    light = np.array([np.nan, np.inf, -np.inf, -1.0, -0.0, 0.0, 1.0, 2.0, 1e-40], np.float32)
    with np.errstate(all="raise"):
        assert srgb.codes(light, 0.0).tolist() == [0, 255, 0, 0, 0, 0, 255, 255, 0]


@pytest.mark.long
@given(st.lists(st.floats(0, 2, width=32), min_size=1), st.floats(-20, 20))
def test_any_light_at_any_exposure(light: list[float], stops: float) -> None:
    given_light = np.array(light, np.float32)
    assert np.array_equal(srgb.codes(given_light, stops), by_the_curve(given_light, stops))


def test_rows_of_pixels_with_more_channels() -> None:
    rgba = np.random.default_rng(2).random((5, 7, 4), dtype=np.float32)
    codes = srgb.codes(rgba[..., :3], 0.5)
    assert np.array_equal(codes, by_the_curve(rgba[..., :3], 0.5))
    assert codes.flags.c_contiguous


@pytest.mark.parametrize("stops", STOPS)
def test_light_and_coverage(stops: float) -> None:
    """Associated alpha of all kinds, and what stands in a file: 0 and 1 and beyond, edges, and coverage that is none."""
    random = np.random.default_rng(3)
    alpha = random.choice(np.array([0.0, 1.0, 0.5, 1e-30, 1.0 - 2.0**-24, 2.0, -1.0, -0.0, 0.3], np.float32), (40, 50))
    alpha[:20] = np.where(alpha[:20] == 0.5, random.random((20, 50), dtype=np.float32), alpha[:20])
    rgba = np.concatenate([random.random((40, 50, 3), dtype=np.float32) * alpha[..., None], alpha[..., None]], axis=2)
    rgba[0, :3, 0] = np.nan, np.inf, -np.inf
    covered = np.clip(rgba[..., 3:].astype(np.float64), 0.0, 1.0)
    with np.errstate(all="ignore"):
        light = rgba[..., :3].astype(np.float64) * 2.0**stops / np.where(covered > 0, covered, 1.0)
        expected = np.rint(np.concatenate([srgb.encode_srgb(light), covered], axis=2) * 255).astype(np.uint8)
        assert np.array_equal(srgb.codes_with_alpha(rgba, stops), expected)
