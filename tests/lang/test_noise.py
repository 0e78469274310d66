"""Gradient noise: Perlin's of 2002 as published, its lattice, its bounds, its smoothness, its statistics and its seeds."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.formula import numpy_interpreter, tape
from maquette.compiler.formula.point_semantics import NumpyMath, noise
from maquette.lang import noise as plain
from maquette.lang.diagnostics import SceneError

RANDOM = np.random.default_rng(2002)


def at(points: np.ndarray) -> np.ndarray:
    return noise(NumpyMath(), *points.T)[0]


def test_as_the_reference_implementation_has_it():
    """Values of Perlin's ImprovedNoise.java (2002) at some places."""
    known = {(3.14, 42.0, 7.0): 0.13691995878400012, (-4.20, 10.0, 6.0): 0.14208000000000043}
    for place, value in known.items():
        assert plain.noise(*place) == pytest.approx(value, abs=1e-14)
        assert at(np.array([place]))[0] == pytest.approx(value, abs=1e-14)


def test_0_at_every_point_of_the_lattice():
    points = RANDOM.integers(-1000, 1000, (5000, 3)).astype(float)
    assert not at(points).any()


@pytest.mark.long
def test_within_its_bounds():
    """|noise| ≤ 1.0363537 (by search over the gradients of all corners); a random million stays within -1..1."""
    values = at(RANDOM.uniform(-128, 128, (1_000_000, 3)))
    assert 0.9 < np.abs(values).max() <= 1.0


def test_first_and_second_derivatives_are_continuous():
    """Across faces of cells; the derivatives given are differences' limits everywhere."""
    points = RANDOM.uniform(-20, 20, (4000, 3))
    face = np.arange(4000) % 3
    points[np.arange(4000), face] = np.round(points[np.arange(4000), face])
    step = 1e-5
    shift = np.eye(3)[face] * step
    m = NumpyMath()
    before, after = (np.stack(noise(m, *(points + sign * shift).T)) for sign in (-1, 1))
    assert np.abs(after - before)[0].max() < 5 * step
    assert np.abs(after - before)[1:].max() < 50 * step  # the slope has no jump
    second = [np.stack(noise(m, *(points + k * shift).T)[1:])[face, np.arange(4000)] for k in (-2, -1, 1, 2)]
    left, right = (second[1] - second[0]) / step, (second[3] - second[2]) / step
    assert np.abs(left - right).max() < 0.05  # nor has the curvature
    inside = RANDOM.uniform(-20, 20, (4000, 3))
    for axis in range(3):
        by = np.eye(3)[axis] * 1e-6
        difference = (at(inside + by) - at(inside - by)) / 2e-6
        assert np.abs(difference - noise(m, *inside.T)[1 + axis]).max() < 1e-7


@pytest.mark.long
def test_its_statistics():
    """Mean 0, and nearly all power in one band, of waves between five cells and two thirds of one."""
    values = at(RANDOM.uniform(0, 256, (400_000, 3)))
    assert abs(values.mean()) < 4 * values.std() / math.sqrt(400_000) + 2e-3
    assert 0.2 < values.std() < 0.3
    axis = np.arange(96) / 4  # a block of 24³ cells
    block = at(np.stack([c.ravel() for c in np.meshgrid(axis, axis, axis, indexing="ij")], axis=1)).reshape(96, 96, 96)
    power = np.abs(np.fft.fftn(block)) ** 2
    k = np.fft.fftfreq(96, 0.25)  # cycles a cell
    cycles = np.sqrt(k[:, None, None] ** 2 + k[None, :, None] ** 2 + k[None, None, :] ** 2)
    assert power[(cycles > 0.2) & (cycles < 1.5)].sum() > 0.95 * power.sum()


def test_seeds_are_unlike_each_other():
    points = RANDOM.uniform(-30, 30, (20_000, 3))
    rows = np.stack([at(points + plain.lattice_offset(seed)) for seed in range(12)])
    likeness = np.corrcoef(rows)
    assert np.abs(likeness - np.eye(12)).max() < 0.05
    assert plain.lattice_offset(0) == (0, 0, 0)
    assert len({plain.lattice_offset(seed) for seed in range(-500, 500)}) > 990


def value(folder: Path, expression: str, point: tuple[float, float, float]) -> float:
    path = folder / "a.scene"
    path.write_text(f"sphere(1, material: lambert(pattern(|x, y, z| {expression})))\n", encoding="utf-8")
    tables = load.load(path).tables
    return float(numpy_interpreter.points(tape.load_tape(tables, int(tables.textures.tape[0])), *np.array([point]).T)[0][0])


@pytest.mark.parametrize(
    ("written", "place", "seed"),
    [
        ("noise(x, y, z)", (0.3, 0.7, 0.2), 0),
        ("noise(x, y, z, 5)", (0.3, 0.7, 0.2), 5),
        ("noise(x, seed: 5)", (0.3, 0.0, 0.0), 5),
        ("noise(x, z: y, seed: -2)", (0.3, 0.0, 0.7), -2),
        ("noise([x, y], seed: 3)", (0.3, 0.7, 0.0), 3),
        ("noise([x, y, z], 3)", (0.3, 0.7, 0.2), 3),
    ],
)
def test_as_it_is_written(tmp_path, written, place, seed):
    moved = np.array([place]) + plain.lattice_offset(seed)
    assert value(tmp_path, written, (0.3, 0.7, 0.2)) == pytest.approx(float(at(moved)[0]), abs=1e-12)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("noise(x, y, z, 0.5)", "a seed is a whole number, got the bare number 0.5"),
        ("noise(x, seed: y)", "a seed is a whole number, got a formula's number"),
        ("noise([x, y, z, x])", "noise takes one to three numbers, or a list of them, and a seed; got a list of 4"),
    ],
)
def test_wrong_arguments_of_noise(tmp_path, written, message):
    with pytest.raises(SceneError) as caught:
        value(tmp_path, written, (0, 0, 0))
    assert [d.message for d in caught.value.diagnostics] == [message]
