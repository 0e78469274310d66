"""Tests of the Sobol sampler: stratification, independence, numpy against kernels, and pixel filters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.jit.kernel import kernel
from maquette.render.sampling import sobol


def points(n, pixel=5, dimension=3, seed=0):
    u, v = sobol.pair(np.full(n, pixel), np.arange(n), np.full(n, dimension), seed)
    return np.stack([u, v], axis=1)


@given(st.integers(0, 2**40), st.integers(0, 2**50), st.integers(0, 2**31 - 1))
@settings(max_examples=60, deadline=None)
def test_every_elementary_box_of_sixteen_holds_one_of_sixteen_points(pixel, dimension, seed):
    """The first 2^k points of the first two Sobol dimensions are a (0, k, 2)-net in base 2; Owen scrambling keeps that."""
    p = points(16, pixel, dimension, seed)
    assert np.all((p >= 0) & (p < 1))
    for wide in (1, 2, 4, 8, 16):
        cells = np.floor(p * [wide, 16 // wide]).astype(int)
        assert len({tuple(c) for c in cells}) == 16


def test_any_aligned_power_of_two_is_a_net():
    p = points(256)
    for start in range(0, 256, 64):
        cells = np.floor(p[start : start + 64] * 8).astype(int)
        assert len({tuple(c) for c in cells}) == 64


def star_discrepancy(p):
    """The largest error of a box from the origin with corners at the points' coordinates."""
    x, y = np.sort(np.append(p[:, 0], 1)), np.sort(np.append(p[:, 1], 1))
    inside = (p[:, 0][:, None, None] < x[None, :, None]) & (p[:, 1][:, None, None] < y[None, None, :])
    closed = (p[:, 0][:, None, None] <= x[None, :, None]) & (p[:, 1][:, None, None] <= y[None, None, :])
    area = x[:, None] * y[None, :]
    return max(np.max(area - inside.mean(axis=0)), np.max(closed.mean(axis=0) - area))


def test_discrepancy_is_well_below_that_of_random_points():
    random = np.random.default_rng(0)
    ours = np.mean([star_discrepancy(points(128, pixel)) for pixel in range(8)])
    theirs = np.mean([star_discrepancy(random.random((128, 2))) for _ in range(8)])
    assert ours < 0.35 * theirs


def test_pixels_dimensions_and_seeds_are_independent():
    """χ² of the joint 8 × 8 table of a number in one and in the other, 4096 pairs: below the value passed once in 10⁶."""
    n = 4096
    pixel = np.arange(n)
    base = sobol.pair(pixel, np.zeros(n, int), np.full(n, 1), 0)
    others = [
        sobol.pair(pixel, np.zeros(n, int), np.full(n, 2), 0),
        sobol.pair(pixel + 1, np.zeros(n, int), np.full(n, 1), 0),
        sobol.pair(pixel, np.zeros(n, int), np.full(n, 1), 1),
        sobol.pair(pixel, np.ones(n, int), np.full(n, 2), 0),
    ]
    for other in others:
        for a in base:
            for b in other:
                table = np.histogram2d(a, b, bins=8, range=[[0, 1], [0, 1]])[0]
                chi2 = np.sum((table - n / 64) ** 2) / (n / 64)
                assert chi2 < 128  # 63 degrees of freedom: p ≈ 2e-6


def test_the_two_numbers_of_a_pair_are_independent_over_pixels():
    u, v = sobol.pair(np.arange(4096), np.zeros(4096, int), np.full(4096, 1), 0)
    table = np.histogram2d(u, v, bins=8, range=[[0, 1], [0, 1]])[0]
    assert np.sum((table - 64) ** 2) / 64 < 128


def test_the_second_sobol_dimension_by_its_direction_numbers():
    """The product with Pascal's triangle modulo 2, against the direction numbers v₁ = ½, vₖ₊₁ = vₖ xor vₖ/2 (Sobol 1967)."""
    for index in (0, 1, 2, 3, 5, 100, 2**20 + 77, 2**32 - 1):
        expected, v, digits = 0, 1 << 31, index
        while digits:
            if digits & 1:
                expected ^= v
            digits >>= 1
            v ^= v >> 1
        assert int(sobol.sobol_second(np.uint64(index))) == expected


@kernel
def _pairs(pixel, samples, dimension, seed, out):
    for k in range(len(pixel)):
        out[k, 0], out[k, 1] = sobol.pair(pixel[k], samples[k], dimension[k], seed)


@kernel
def _offsets(pixel, samples, total, seed, table, out):
    for k in range(len(pixel)):
        out[k, 0], out[k, 1] = sobol.offset(pixel[k], samples[k], total, seed, table)


@pytest.mark.long
def test_numpy_and_kernels_are_bit_identical():
    random = np.random.default_rng(2)
    pixel, samples, dimension = random.integers(0, 2**40, 500), random.integers(0, 5000, 500), random.integers(0, 2**45, 500)
    out = np.empty((500, 2))
    _pairs(pixel, samples, dimension, 7, out)
    assert np.array_equal(out, np.stack(sobol.pair(pixel, samples, dimension, 7), axis=1))
    table = sobol.filter_table("blackman-harris")
    _offsets(pixel, samples, 64, 7, table, out)
    assert np.array_equal(out, np.stack(sobol.offset(pixel, samples, 64, 7, table), axis=1))


# --- over the picture ---

SIDE = 128
EDGES = {"a disk": lambda u, v: u * u + v * v < 0.6, "a slope": lambda u, v: u + 0.3 * v < 0.55, "even": lambda u, v: u * v}


def errors(function, order, seed, shared):
    """(SIDE, SIDE) errors of pixels' means of 2^order samples of a function of a pair."""
    y, x = (c.ravel() for c in np.mgrid[:SIDE, :SIDE])
    total = 0.0
    for s in range(1 << order):
        pixel, index = sobol.zorder_index(x, y, np.full(x.size, s), SIDE, order if shared else sobol.ALONE)
        total = total + function(*sobol.pair(pixel, index, np.full(x.size, 3), seed))
    mean = (total / (1 << order)).reshape(SIDE, SIDE)
    grid = (np.arange(1 << 11) + 0.5) / (1 << 11)
    return mean - np.mean(function(grid[None, :], grid[:, None]))


def spectrum(error):
    """Power of an error by frequency: below 1/16 of a cycle a pixel, and above ¼."""
    power = np.abs(np.fft.fft2(error)) ** 2
    f = np.fft.fftfreq(len(error))
    away = np.hypot(f[:, None], f[None, :])
    return power[away < 1 / 16].mean(), power[away > 1 / 4].mean()


@pytest.mark.parametrize("order", [0, 2, 4])
@pytest.mark.parametrize("name", EDGES)
def test_errors_of_neighbours_that_share_a_sequence_are_blue_noise(name, order):
    """Where pixels share a sequence the slow part of their error has a third at most of the power it has where each has its own."""
    shared = np.mean([spectrum(errors(EDGES[name], order, seed, True)) for seed in range(3)], axis=0)
    alone = np.mean([spectrum(errors(EDGES[name], order, seed, False)) for seed in range(3)], axis=0)
    assert shared[0] < 0.33 * alone[0]
    assert shared[0] < 0.33 * shared[1]
    assert 0.7 < alone[0] / alone[1] < 1.4  # white
    assert shared[1] < 2.5 * alone[1]  # nothing is gained by more noise in all


def test_each_pixel_of_a_block_has_a_stretch_of_its_own():
    y, x = (c.ravel() for c in np.mgrid[:64, :64])
    pixel, index = sobol.zorder_index(x + 64, y, np.zeros(x.size, int), 200, 3)
    assert set(pixel) == {1}
    assert np.array_equal(np.sort(index), 8 * np.arange(64 * 64))
    assert sobol.zorder_index(5, 130, 7, 200, 3)[0] == 2 * 4
    assert sobol.zorder_index(5, 130, 7, 200, sobol.ALONE) == (130 * 200 + 5, 7)


@given(st.integers(0, 127), st.integers(0, 127), st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_a_stretch_is_a_net(x, y, seed):
    pixel, index = sobol.zorder_index(np.full(16, x), np.full(16, y), np.arange(16), SIDE, 4)
    p = np.stack(sobol.pair(pixel, index, np.full(16, 3), seed), axis=1)
    for wide in (1, 2, 4, 8, 16):
        cells = np.floor(p * [wide, 16 // wide]).astype(int)
        assert len({tuple(c) for c in cells}) == 16


def test_stretches_are_as_long_as_what_they_are_for_or_there_are_none():
    assert [sobol.order_of(n) for n in (1, 2, 3, 16, 100, 1 << 18)] == [0, 1, 2, 4, 7, 18]
    assert sobol.order_of((1 << 18) + 1) == sobol.ALONE
    assert (64 * 64 << 18) - 1 < 1 << 31


# --- filters ---


def offsets(name, n=16384):
    pixel = np.repeat(np.arange(n // 64), 64)
    return sobol.offset(pixel, np.tile(np.arange(64), n // 64), 64, 0, sobol.filter_table(name))


@pytest.mark.parametrize("name", sobol.FILTERS)
def test_offsets_lie_on_the_grid_and_are_even_about_the_centre(name):
    for d in offsets(name):
        assert np.array_equal(d * 256, np.round(d * 256))
        assert abs(d.mean()) < 4 * d.std() / math.sqrt(len(d))


@pytest.mark.parametrize("a", [-0.4, 0.0, 0.25])
def test_half_planes_under_box_and_tent(a):
    """The share of an edge at offset a: box ½ + a, unit tent ½ + a − a|a|/2; a sample on the border counts half."""

    def share(name):
        x, _ = offsets(name)
        return np.mean(x < a) + np.mean(x == a) / 2

    assert share("box") == pytest.approx(0.5 + a, abs=0.004)
    assert share("tent") == pytest.approx(0.5 + a - a * abs(a) / 2, abs=0.004)


@pytest.mark.parametrize(("name", "variance"), [("box", 1 / 12), ("tent", 1 / 6)])
def test_variances(name, variance):
    assert np.var(offsets(name)[0]) == pytest.approx(variance, rel=0.02)


def test_gaussian_is_cut_and_lowered_at_its_radius():
    """Density exp(−2x²) − exp(−4.5) within 1.5 pixels: its distribution at ½ by quadrature."""
    x = np.linspace(-1.5, 1.5, 30001)
    density = np.exp(-2 * x * x) - math.exp(-4.5)
    expected = density[x < 0.5].sum() / density.sum()
    assert np.mean(offsets("gaussian")[0] < 0.5) == pytest.approx(expected, abs=0.004)
    assert abs(offsets("gaussian")[0]).max() <= 1.5


def test_one_sample_in_all_is_the_pixels_centre():
    dx, dy = sobol.offset(np.arange(9), np.zeros(9, int), 1, 3, sobol.filter_table("tent"))
    assert np.all(dx == 0)
    assert np.all(dy == 0)
