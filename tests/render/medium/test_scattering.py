"""Parts of media: columns of fog, the phase function, majorants of densities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op
from maquette.render.medium import column, phase, scattering_table

HEIGHTS, SLOPES = st.integers(-400, 400).map(lambda k: k / 8), st.integers(-100, 100).map(lambda k: k / 100)


@given(HEIGHTS, SLOPES, HEIGHTS, st.sampled_from([0.0, 0.3, 5.0, 100.0]), st.floats(0.01, 200))
@settings(max_examples=100, deadline=None)
def test_a_column_is_the_integral_of_the_density(height: float, slope: float, top: float, falloff: float, distance: float) -> None:
    like = tuple(np.array([x]) for x in (height, slope, top, falloff))
    t = np.linspace(0, distance, 4001)
    density = column.density_at(height + slope * t, np.full_like(t, top), np.full_like(t, falloff))
    expected = np.sum(0.5 * (density[1:] + density[:-1])) * t[1]
    integral = column.column(*like, np.array([distance]))[0]
    assert integral == pytest.approx(expected, rel=2e-3, abs=2e-4 * distance)


@given(HEIGHTS, SLOPES, HEIGHTS, st.sampled_from([0.0, 0.3, 5.0, 100.0]), st.floats(0.01, 200))
@settings(max_examples=100, deadline=None)
def test_a_distance_has_its_column(height: float, slope: float, top: float, falloff: float, wanted: float) -> None:
    like = tuple(np.array([x]) for x in (height, slope, top, falloff))
    distance = column.distance_of(*like, np.array([wanted]))
    if np.isfinite(distance[0]):
        assert column.column(*like, distance)[0] == pytest.approx(wanted, rel=1e-3)
    else:
        assert column.column(*like, np.array([1e9]))[0] <= wanted * 1.001


@pytest.mark.parametrize("g", [0.0, 0.3, 0.9, -0.7])
def test_the_phase_function_has_its_density_and_mean(g: float) -> None:
    rng = np.random.default_rng(3)
    n = 200_000
    way = tuple(np.full(n, c) for c in (0.6, 0.0, 0.8))
    onward, density = phase.sample(np.full(n, g), way, rng.random(n), rng.random(n))
    cosine = 0.6 * onward[0] + 0.8 * onward[2]
    assert cosine.mean() == pytest.approx(g, abs=5e-3)
    assert np.allclose(density, phase.density(np.full(n, g), cosine), rtol=1e-6)
    edges = np.linspace(-1, 1, 200_001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    assert 2 * math.pi * np.mean(phase.density(np.full(len(middle), g), middle)) * 2 == pytest.approx(1.0, abs=2e-3)


def test_majorants_of_voxels_hold() -> None:
    """No interpolated density of a cell is above its majorant."""
    rng = np.random.default_rng(1)
    for shape, cells in (((5, 7, 9), (4, 6, 32)), ((1, 1, 1), (4, 4, 4)), ((64, 3, 2), (5, 4, 32))):
        voxels = rng.random(shape)
        majorants = scattering_table.voxel_majorants(voxels, np.array(cells))
        places = rng.random((100_000, 3))
        cell = (places * cells).astype(int)
        sizes = np.array(shape[::-1])
        p = np.clip(places * sizes - 0.5, 0, sizes - 1)
        low = np.minimum(p.astype(int), sizes - 1)
        high, part = np.minimum(low + 1, sizes - 1), p - low
        density = np.zeros(len(places))
        for corner in range(8):
            far = [(corner >> k) & 1 for k in range(3)]
            x, y, z = (np.where(far[k], high[:, k], low[:, k]) for k in range(3))
            density += np.prod([part[:, k] if far[k] else 1 - part[:, k] for k in range(3)], axis=0) * voxels[z, y, x]
        assert (density <= majorants[cell[:, 2], cell[:, 1], cell[:, 0]] + 1e-12).all()


@pytest.mark.parametrize("steep", [1.0, 30.0, 1000.0])
def test_majorants_of_formulas_hold(steep: float) -> None:
    """A million points of a steep formula: none is above the majorant of its cell."""
    builder = Builder()
    wave = builder.op(Op.SIN, builder.scale(0, steep))
    tape = builder.finish(builder.op(Op.MULTIPLY, wave, builder.op(Op.EXP, builder.scale(1, 3.0))))
    low, high, cells = np.array([-1.0, -2, 0]), np.array([1.0, 0.5, 3]), np.array([16, 9, 7])
    majorants = scattering_table.bounded_density(tape, low, high, cells)
    places = np.random.default_rng(5).random((1_000_000, 3))
    x, y, z = (low + places * (high - low)).T
    density = numpy_interpreter.points(tape, x, y, z)[0]
    cell = (places * cells).astype(int)
    assert (density <= majorants[cell[:, 2], cell[:, 1], cell[:, 0]]).all()
