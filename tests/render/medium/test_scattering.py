"""Parts of media: columns of fog, the phase function, majorants of densities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.opcodes import Op
from maquette.compiler.scene import phase_functions
from maquette.render.medium import column, phase, phase_table, scattering_table

from ..chi2 import chi2

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
def test_a_distance_has_its_column(height: float, slope: float, top: float, falloff: float, target: float) -> None:
    like = tuple(np.array([x]) for x in (height, slope, top, falloff))
    distance = column.distance_of(*like, np.array([target]))
    if np.isfinite(distance[0]):
        assert column.column(*like, distance)[0] == pytest.approx(target, rel=1e-3)
    else:
        assert column.column(*like, np.array([1e9]))[0] <= target * 1.001


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


SHAPES = [  # g, α, diameter of droplets in metres
    (0.0, 1.0, None), (0.5, 1.0, None), (-0.6, 2.0, None), (0.9, 20.0, None), (0.0, 0.0, 5e-6), (0.0, 0.0, 2e-5), (0.0, 0.0, 5e-5),
]  # fmt: skip


def draine(shape: tuple[float, ...]) -> phase_table.Draine:
    """The table of a medium, after one of Henyey and Greenstein."""
    media = ir.table_of("media", {"draine": np.array([np.zeros(4), shape])})
    table = phase_table.build(ir.empty_tables()._replace(media=media), np.array([0, 1]))
    assert isinstance(table, phase_table.Draine)
    return table


@pytest.mark.parametrize("shape", SHAPES)
def test_phase_functions_of_draine_are_normalised_and_have_their_mean(shape: tuple[float, float, float | None]) -> None:
    mean, parameters = phase_functions.of(*shape)
    versine = 2.0 * np.expm1(25.0 * np.linspace(0.0, 1.0, 1_000_001)) / np.expm1(25.0)
    versine = np.union1d(versine, 2.0 - versine)
    density = phase_table.density(draine(parameters), np.zeros(1), np.ones(len(versine), int), 1.0 - versine)
    integral, cosine = (2.0 * math.pi * np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(versine)) for y in (density, density * (1.0 - versine)))
    assert integral == pytest.approx(1.0, abs=1e-5)
    assert cosine == pytest.approx(mean, abs=1e-5)


@pytest.mark.parametrize("shape", SHAPES)
def test_samples_of_draine_have_their_density(shape: tuple[float, float, float | None]) -> None:
    table, rng, n = draine(phase_functions.of(*shape)[1]), np.random.default_rng(2), 60_000
    number, up = np.ones(n, int), (np.zeros(n), np.ones(n), np.zeros(n))
    onward, weight, density = phase_table.sample(table, (up, np.ones(n), np.ones(n)), number, up, rng.random(n), rng.random(n))
    assert np.allclose(density, phase_table.density(table, np.ones(n), number, onward[1]), rtol=1e-6)
    assert weight.mean() == pytest.approx(1.0, abs=2e-3)
    assert 0.2 < weight.min() <= weight.max() < 4.0
    assert (weight * onward[1]).mean() == pytest.approx(phase_functions.of(*shape)[0], abs=6e-3)

    def value(directions: tuple[np.ndarray, ...]) -> np.ndarray:
        y = directions[1]
        return np.asarray(phase_table.density(table, np.ones(y.size), np.ones(y.size, int), y.ravel())).reshape(y.shape)

    if shape[2] is None or shape[2] < 1e-5:  # of larger droplets the peak is narrower than the cells' nodes
        chi2(onward, np.ones(n, bool), value, fine=64)
    versine = 2.0 * np.expm1(25.0 * np.linspace(0.0, 1.0, 100_001)) / np.expm1(25.0)
    middle = 0.5 * (versine[1:] + versine[:-1])
    inside = 2.0 * math.pi * np.cumsum(value((middle, 1.0 - middle)) * np.diff(versine))
    for v in (1e-5, 1e-4, 1e-3, 0.03, 0.3, 1.0, 1.7):
        assert np.mean(weight * (1.0 - onward[1] < v)) == pytest.approx(inside[np.searchsorted(middle, v)], abs=0.008)


def test_droplets_become_sharper_with_their_size() -> None:
    """And a medium of Henyey and Greenstein beside them is left alone."""
    blends = [draine(phase_functions.of(0.0, 0.0, d)[1]) for d in (5e-6, 2e-5, 5e-5)]
    peaks = [phase_table.density(blend, np.zeros(1), np.array([1]), np.ones(1))[0] for blend in blends]
    assert peaks[0] < peaks[1] < peaks[2]
    media = draine(phase_functions.of(0.0, 1.0, None)[1])
    assert phase_table.density(media, np.full(1, 0.7), np.array([0]), np.ones(1))[0] == 0.7


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
