"""Tests of light samples that aim at openings: their density, the room that is found, the picture's mean, threads and kernels."""

from __future__ import annotations

import maquette
import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.ir import Settings
from maquette.compiler.plan import sky_visibility
from maquette.compiler.plan.plan import make_plan
from maquette.render.light import sky_openings

ROOM = """
use "std/room"
room.with_window(size: [4, 2.6, 5], opening: [1.2, 1.2], bars: false)
box([0.8, 0.8, 0.8], center: [-0.6, 0.4, -0.6], material: principled(#c08040, roughness: 0.4))
sky(luminance: 6000nit)
camera(position: [1.6, 1.4, 2.3], look_at: [-1, 1.1, -0.6], fov: 62deg)
render(bounces: 3)
"""
LEARNT, NONE = ({"transport.sky_visibility": value} for value in ("learnt", "none"))
SIZE = (24, 16)


def scene_of(folder, text=ROOM):
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    return load.load(path)


def openings_of(rng):
    weights = rng.uniform(0.2, 1.0, (sky_openings.FACES * sky_openings.SIDE, sky_openings.SIDE))
    weights[rng.random(len(weights)) < 0.5] = 0.0
    return sky_openings.make(np.array([-1.0, 0.0, -2.0]), np.array([2.0, 2.5, 1.0]), weights, 0.8)


@pytest.mark.long
@pytest.mark.parametrize("place", [(0.0, 1.0, 0.0), (-0.9, 2.4, 0.9)])
def test_densities_are_those_of_samples(place):
    """The mean of 1 / density over samples is the solid angle of the cells; the mean of the density over the sphere is 1 / 4π."""
    rng = np.random.default_rng(4)
    openings, n = openings_of(rng), 400_000
    places = tuple(np.full(n, c) for c in place)
    way = rng.normal(size=(3, n))
    even = tuple(way / np.linalg.norm(way, axis=0))
    density = sky_openings.density(openings, places, even)
    error = 4.0 * np.pi * density.std() / np.sqrt(n)
    assert 4.0 * np.pi * density.mean() == pytest.approx(1.0, abs=4.0 * error)
    sampled = sky_openings.density(openings, places, sky_openings.sample(openings, places, rng.random(n), rng.random(n)))
    covered = 4.0 * np.pi * np.mean(density > 0.0)
    assert np.mean(sampled > 0.0) > 0.9999
    assert np.mean(1.0 / sampled[sampled > 0.0]) == pytest.approx(covered, rel=0.02)


def test_no_sample_aims_from_outside_of_the_box():
    openings = openings_of(np.random.default_rng(1))
    share = sky_openings.share_at(openings, (np.array([0.0, 3.0]), np.array([1.0, 1.0]), np.array([0.0, 0.0])))
    assert share.tolist() == [0.8, 0.0]


@pytest.mark.long
def test_the_room_is_found(tmp_path):
    room = sky_visibility.find_room(scene_of(tmp_path).tables, 0)
    assert room.low == pytest.approx([-2.0, 0.0, -2.5], abs=0.2)
    assert room.high == pytest.approx([2.0, 2.6, 2.5], abs=0.2)
    assert 0.0 < room.seen < 0.05


@pytest.mark.parametrize(
    ("change", "value", "reason"),
    [
        (("", ""), "learnt", "of all directions: light samples aim at openings"),
        (("sky(", "sun(from: [-3, 2, 0.4], illuminance: 60klx)\nsky("), "none", "a sun lights the scene: what its patches"),
        (("sky(luminance: 6000nit)", "point([0, 2, 0], flux: 900lm)"), "none", "no sky casts shadows"),
        (('room.with_window(size: [4, 2.6, 5], opening: [1.2, 1.2], bars: false)', "ground()"), "none", "of all directions"),
    ],
)  # fmt: skip
def test_the_plan_decides_by_what_is_seen(tmp_path, change, value, reason):
    text = ROOM.replace(*change).replace("ground()", "plane(normal: [0, 1, 0])")
    decision = make_plan(scene_of(tmp_path, text), Settings(bounces=3)).decisions["transport.sky_visibility"]
    assert decision.value == value
    assert reason in decision.reason


@pytest.mark.long
def test_the_picture_keeps_its_mean_and_loses_noise(tmp_path):
    scene = scene_of(tmp_path)

    def draw(plan):
        many = [maquette.render(scene, size=SIZE, samples=256, seed=k, denoise=False, plan=plan) for k in range(8)]
        return np.array([image.channels["rgba"][..., :3].astype(float) for image in many])

    with_, without = draw(LEARNT), draw(NONE)
    means = [pictures.mean(axis=(1, 2, 3)) for pictures in (with_, without)]
    error = np.sqrt(sum(m.var(ddof=1) / len(m) for m in means))
    assert abs(means[0].mean() - means[1].mean()) < 4.0 * error
    assert error < 0.01 * means[1].mean()
    assert with_.var(axis=0).mean() < 0.4 * without.var(axis=0).mean()


@pytest.mark.long
@pytest.mark.parametrize("kind", [pytest.param("special", marks=pytest.mark.long), "general"])
def test_threads_and_kernels_do_not_change_the_picture(tmp_path, monkeypatch, kind):
    scene = scene_of(tmp_path)

    def draw(threads):
        return maquette.render(scene, size=SIZE, samples=4, plan=LEARNT, threads=threads, denoise=False).channels["rgba"]

    general = draw(1)
    monkeypatch.setenv("MAQUETTE_KERNELS", kind)
    assert np.array_equal(general, draw(2))
