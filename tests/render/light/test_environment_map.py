"""Tests of environment map sampling: normalization, densities, and uniform skies without an emitter."""

from __future__ import annotations

from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler import load
from maquette.render.jit import packed_struct
from maquette.render.light import environment_map, lights


def write(path, picture):
    height, width, _ = picture.shape
    out: Any = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(width, height, 3, "float"))
    out.write_image(np.ascontiguousarray(picture, np.float32))
    out.close()


@pytest.fixture
def sky_of(tmp_path):
    def made(picture, text="", horizon=None):
        write(tmp_path / "sky.exr", picture)
        path = tmp_path / "a.scene"
        path.write_text('sphere(1)\ndome("sky.exr", rotate: [20deg, 50deg, 0])\n' + text, encoding="utf-8")
        return environment_map.build(load.load(path).tables, 0, horizon)

    return made


def bright(height=32, width=64):
    picture = np.random.default_rng(3).uniform(0.0, 1.0, (height, width, 3))
    picture[height // 4, width // 3] = 400.0
    return picture


def directions(n):
    """Even over the ball: a spiral (González 2010), of equal solid angles."""
    k = np.arange(n) + 0.5
    y = 1.0 - 2.0 * k / n
    turn = k * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - y * y)
    return across * np.cos(turn), y, across * np.sin(turn)


@pytest.mark.parametrize("text", ["", "sky(luminance: 0.5)\n", 'dome("sky.exr", rotate: [0, 120deg, 0])\n'])
def test_densities_add_up_to_one(sky_of, text):
    sky = sky_of(bright(), text)
    assert np.mean(environment_map.density(sky, (0.0, 0.0, 0.0), directions(400_000))) * 4.0 * np.pi == pytest.approx(1.0, rel=0.015)


@pytest.mark.long
@pytest.mark.parametrize("size", [(32, 64), (75, 150), (1200, 2400)])
def test_samples_have_the_density_that_is_told(sky_of, size):
    sky = sky_of(bright(*size))
    u, v = np.random.default_rng(1).random((2, 20_000))
    direction, densities = environment_map.sample_map(sky, u, v)
    assert np.sqrt(np.sum(np.square(direction), axis=0)) == pytest.approx(1.0, abs=1e-12)
    same = np.isclose(densities, environment_map.density(sky, (0.0, 0.0, 0.0), direction), rtol=1e-9)
    assert same.mean() > 0.9999  # at the edges of cells rounding may choose the next
    # A density's reciprocal, averaged over its samples, is the solid angle where it is not nothing.
    covered = np.mean(environment_map.density(sky, (0.0, 0.0, 0.0), directions(200_000)) > 0.0) * 4.0 * np.pi
    assert np.mean(1.0 / densities) == pytest.approx(covered, rel=0.1)


def test_all_that_is_brighter_than_the_mean_can_be_drawn(sky_of):
    sky = sky_of(bright())
    assert sky.density.max() > 100.0 * sky.density[sky.density > 0].min()
    assert (sky.density == 0.0).any()


def test_kernels_serve_maps_of_every_size(sky_of):
    first, second = (packed_struct.Handle(sky_of(bright(*size))).type for size in ((16, 32), (40, 100)))
    assert first == second


def test_what_is_even_is_no_emitter(sky_of):
    assert isinstance(sky_of(np.full((16, 32, 3), 0.7)), environment_map.Even)
    assert isinstance(sky_of(np.zeros((16, 32, 3))), environment_map.Even)


def test_nothing_is_drawn_from_below_the_horizon(sky_of):
    up = np.array([0.0, 1.0, 0.0])
    sky = sky_of(bright(), horizon=up)
    u, v = np.random.default_rng(1).random((2, 20_000))
    assert environment_map.sample_map(sky, u, v)[0][1].min() > -0.2


@pytest.mark.long
def test_a_tilted_plate_gets_what_a_brute_force_integral_says(tmp_path):
    """A day's sky of turbidity 3 over a white disk that looks up and aside: ∫ L max(0, n·ω) dω over 400,000 even directions."""
    path = tmp_path / "a.scene"
    path.write_text(
        "sky(turbidity: 3, sun: [1, 0.3, 0.2])\ndisk(1, normal: [1, 1, 0], material: lambert(1))\n"
        'camera(position: [3, 3, 0], look_at: [0, 0, 0], width: 0.5)\nrender(bounces: 1)\n',
        encoding="utf-8",
    )
    x, y, z = directions(400_000)
    tables = load.load(path).tables
    facing = np.maximum((x + y) / np.sqrt(2.0), 0.0)
    answer = [np.mean(c * facing) * 4.0 for c in lights.background(tables, (x, y, z))[0]]
    runs = []
    for seed in range(6):
        image = maquette.render(path, size=(8, 8), samples=64, seed=seed, filter="box", threads=1)
        assert image.metadata["issues"] == 0
        runs.append(image.channels["rgba"][..., :3].astype(float).mean(axis=(0, 1)))
    error = np.std(runs, axis=0, ddof=1) / np.sqrt(len(runs))
    assert np.all(error < 0.002 * np.array(answer))
    assert np.all(np.abs(np.mean(runs, axis=0) - answer) < 4.0 * error + 1e-3 * np.array(answer))
