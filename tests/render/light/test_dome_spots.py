"""Tests of the sampling of bright spots of domes."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import load
from maquette.render.light import dome_spots, lights

TEXT = """
dome(pattern: |x, y, z| 1 + 3000 * min(max(1e3 * (0.6 * x + 0.8 * y - 0.998), 0), 1), rotate: [20deg, 70deg, 0])
sphere(0.5, material: glass())
plane(y: -1)
camera(position: [0, 0, 5], look_at: [0, 0, 0])
"""


def test_samples_lie_in_spots_and_carry_their_light(tmp_path):
    """The mean of radiance over density is the light of the masked cells; all of it comes from inside of them."""
    path = tmp_path / "a.scene"
    path.write_text(TEXT, encoding="utf-8")
    tables = load.load(path).tables
    spots = dome_spots.build(tables, 0)
    assert isinstance(spots, dome_spots.Spots)
    u, v = np.random.default_rng(3).random((2, 200_000))
    zero = 0.0 * u
    row = np.zeros(len(u), np.int64)
    direction, light = dome_spots.emission(spots, ((zero, zero, zero), (zero, zero, zero)), tables, row, u, v)
    assert np.allclose(sum(c * c for c in direction), 1.0)
    everywhere = np.ones(len(u), bool)
    assert np.mean(dome_spots.only_in_spots(spots, everywhere, row, direction)) > 0.9999
    assert dome_spots.only_in_spots(spots, everywhere, row + 1, direction).all()
    around = np.random.default_rng(4).normal(size=(3, 1_000_000))
    around = tuple(around / np.linalg.norm(around, axis=0))
    inside = dome_spots.only_in_spots(spots, np.ones(1_000_000, bool), np.zeros(1_000_000, np.int64), around)
    masked = np.where(inside, lights.background(tables, around)[0][0], 0.0) * 4.0 * np.pi
    error = masked.std() / 1000.0
    assert light[0].mean() == pytest.approx(masked.mean(), abs=4.0 * error)
    assert light[0].std() < light[0].mean()
    assert spots.irradiance == pytest.approx(masked.mean(), rel=0.05)
