"""Tests of solid angle sampling of rectangles: closed form, uniformity, and variance."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.render.light import rectangle_solid_angle


def closed(a, b, d):
    """The solid angle of a rectangle of half sides a, b, straight above its middle at d: 4 asin(ab / √((a² + d²)(b² + d²)))."""
    return 4.0 * math.asin(a * b / math.sqrt((a * a + d * d) * (b * b + d * d)))


def frame(n=1):
    ones = np.ones(n)
    return (ones, 0.0 * ones, 0.0 * ones), (0.0 * ones, 0.0 * ones, ones)


@pytest.mark.parametrize(("a", "b", "d"), [(0.5, 0.5, 0.1), (1.0, 0.3, 0.5), (2.0, 1.0, 1.0), (0.5, 0.5, 0.001)])
def test_solid_angles(a, b, d):
    rect = rectangle_solid_angle.spherical_rectangle((np.zeros(1), np.full(1, d), np.zeros(1)), *frame(), np.full(1, a), np.full(1, b))
    assert rect.solid[0] == pytest.approx(closed(a, b, d), rel=1e-10)


def test_parts_add_up():
    """Aside of the middle: a rectangle is its four quarters."""
    rng = np.random.default_rng(2)
    way = tuple(rng.uniform(-1, 1, (3, 100)))
    half = np.full(100, 0.6), np.full(100, 0.4)
    total = rectangle_solid_angle.spherical_rectangle(way, *frame(100), *half).solid
    parts = [
        rectangle_solid_angle.spherical_rectangle(
            (way[0] + i * 0.3, way[1], way[2] + j * 0.2), *frame(100), 0.5 * half[0], 0.5 * half[1]
        ).solid
        for i in (-1, 1) for j in (-1, 1)
    ]  # fmt: skip
    assert np.sum(parts, axis=0) == pytest.approx(total, rel=1e-8)


@pytest.mark.parametrize("way", [(0.0, 0.5, 0.0), (0.4, 0.2, -0.3), (1.2, -0.6, 0.8)])
def test_samples_are_even_over_the_solid_angle(way):
    """The share of samples on each of 16 parts is that part's share of the solid angle, and none is outside."""
    n = 256
    u, v = ((c.ravel() + 0.5) / n for c in np.mgrid[:n, :n])
    ways = tuple(np.full(u.size, c) for c in way)
    a, b = rectangle_solid_angle.sample(
        rectangle_solid_angle.spherical_rectangle(ways, *frame(u.size), np.full(u.size, 0.8), np.full(u.size, 0.5)), u, v
    )
    assert max(np.abs(a).max(), np.abs(b).max()) <= 1.0
    total = rectangle_solid_angle.spherical_rectangle(
        way, *((np.array(v[0]), v[1], v[2]) for v in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))), 0.8, 0.5
    ).solid
    for i in range(4):
        for j in range(4):
            part = (way[0] + 0.8 * (i - 1.5) / 2, way[1], way[2] + 0.5 * (j - 1.5) / 2)
            share = rectangle_solid_angle.spherical_rectangle(part, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.2, 0.125).solid / total
            inside = (np.floor((a + 1) * 2).clip(0, 3) == i) & (np.floor((b + 1) * 2).clip(0, 3) == j)
            assert inside.mean() == pytest.approx(share, abs=2e-3)


def test_what_is_even_has_no_variance():
    """Light from all of it over the density is the same for each sample; by area it strays by more than the whole."""
    rng = np.random.default_rng(1)
    n = 10_000
    u, v = rng.random((2, n))
    way = tuple(np.full(n, c) for c in (0.3, 0.1, 0.2))
    rect = rectangle_solid_angle.spherical_rectangle(way, *frame(n), np.full(n, 0.8), np.full(n, 0.5))
    assert np.ptp(rect.solid) == 0.0
    x, z = way[0] + 0.8 * (2 * u - 1), way[2] + 0.5 * (2 * v - 1)
    by_area = 1.6 * way[1] / (x * x + way[1] ** 2 + z * z) ** 1.5
    assert by_area.mean() == pytest.approx(rect.solid[0], rel=0.1)
    assert by_area.std() > rect.solid[0]
