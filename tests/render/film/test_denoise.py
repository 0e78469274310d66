"""Tests of denoising: lower error, the error left, guides, and the message without the package."""

from __future__ import annotations

import importlib.util
import math
import re
from dataclasses import replace
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler.plan import plan as planner
from maquette.render import quality_settings
from maquette.render.backends import prepare, ray
from maquette.render.film import denoise
from maquette.render.image import metrics
from maquette.render.types import View

from .. import pictures

SCENE = """
camera(position: [0, 1.2, 4], look_at: [0, 0.6, 0], fov: 40deg)
plane(y: 0, material: lambert(#a0a0a0))
sphere(0.6, center: [-0.7, 0.6, 0], material: lambert(#d04030))
box([0.6, 0.9, 0.5], center: [0.6, 0.45, 0.3], material: mirror(#c0c0ff))
area([1, 3, 2], look_at: [0, 0, 0], size: [2, 2], luminance: 3)
sky(luminance: 0.2)
"""
ROOM = """
use "std/room"
room.with_window(size: [4, 2.6, 5])
box([0.8, 0.8, 0.8], center: [-0.6, 0.4, -0.6], material: lambert(#c08040))
sun(from: [-3, 2, 0.4], illuminance: 60klx)
sky(luminance: 6000nit, color: #cfe0ff)
camera(position: [1.6, 1.4, 2.3], look_at: [-1, 1.1, -0.6], fov: 62deg)
render(bounces: 8)
"""
SMALL = (96, 72)
needs_package = pytest.mark.skipif(importlib.util.find_spec("pyoidn") is None, reason="pyoidn is not installed")


@pytest.fixture
def scene(tmp_path: Path):
    path = tmp_path / "a.scene"
    path.write_text(SCENE)
    return maquette.load(path)


@pytest.mark.long
@needs_package
def test_it_halves_the_error_of_few_samples_and_is_off_unless_asked(scene) -> None:
    settings = {"size": (96, 72), "threads": 1}
    true = maquette.render(scene, samples=1024, seed=5, **settings)
    noisy, off = (maquette.render(scene, samples=4, denoise=on, **settings) for on in (None, False))
    assert np.array_equal(noisy.channels["rgba"], off.channels["rgba"])
    clean = maquette.render(scene, samples=4, denoise=True, **settings)
    before, after = (maquette.compare(image, true).error for image in (noisy, clean))
    assert after < 0.5 * before
    assert np.array_equal(clean.channels["rgba"][..., 3], noisy.channels["rgba"][..., 3])
    assert clean.metadata["denoised"]
    assert "denoised" not in noisy.metadata


def test_guides_are_what_is_seen_first(scene) -> None:
    """The sky has none; a matt ball its color and the mirror its tint, with unit normals inside of outlines."""
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings(size=(48, 36), samples=4, threads=1))
    view = View(plan["camera"], 48, 36)
    albedo, normal = denoise.guides(ray.Renderer(prepare.prepare(scene, plan, view, pictures.general()), plan, view), plan)
    assert albedo.shape == normal.shape == (36, 48, 3)
    assert not albedo[0].any()
    assert not normal[0].any()
    length = np.linalg.norm(normal, axis=2)
    assert np.mean(np.abs(length[20:] - 1) < 1e-3) > 0.8
    ball = np.abs(albedo - np.array([0.6308, 0.0513, 0.0296])).max(axis=2) < 1e-3
    assert ball.sum() > 60
    assert (np.abs(albedo - np.array([0.5271, 0.5271, 1.0])).max(axis=2) < 1e-3).sum() > 60


def test_without_its_package_it_says_what_to_install(scene, monkeypatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    message = "denoising takes the package pyoidn, which is not installed: pip install maquette-render[denoise]"
    with pytest.raises(planner.PlanError, match=f"^{re.escape(message)}$"):
        maquette.render(scene, denoise=True)


@needs_package
def test_the_chart_has_a_line_for_it(scene) -> None:
    """Where there is noise; `256 denoised samples` are what is written beside a point."""
    knob = next(knob for knob in quality_settings.QUALITY_SETTINGS["ray"] if knob.name == "denoised samples")
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings())
    assert knob.applies(scene, plan)
    assert knob.fixed == {"denoise": True}
    sharp = replace(plan.decisions["area_lights"], value=False)
    assert not knob.applies(scene, planner.Plan({**plan.decisions, "area_lights": sharp}))


@pytest.mark.long
@needs_package
def test_a_default_picture_above_its_error_is_denoised_and_tells_what_is_left(tmp_path: Path) -> None:
    """A room that only a small window lights: 256 samples leave noise where pixels share no paths.

    The error after denoising is about the true one.
    """
    path = tmp_path / "a.scene"
    path.write_text(ROOM)
    room = maquette.load(path)
    true = np.mean([maquette.render(room, samples=4096, seed=50 + k, size=SMALL).channels["rgba"].astype(float) for k in range(2)], axis=0)
    alone = {"transport.path_reuse": "none"}
    clean = maquette.render(room, size=SMALL, plan=alone)
    noisy = maquette.render(room, size=SMALL, denoise=False, plan=alone)
    assert noisy.metadata["error"] == clean.metadata["error"] > 0.03
    assert noisy.metadata["samples"] == 256
    assert clean.metadata["denoised"]
    remaining = metrics.root_relmse(clean.channels["rgba"], true)
    assert remaining < 0.5 * metrics.root_relmse(noisy.channels["rgba"], true)
    assert 0.6 < remaining / clean.metadata["denoised_error"] < 1.4


@needs_package
def test_a_picture_that_reaches_the_default_error_keeps_its_pixels(scene) -> None:
    image = maquette.render(scene, size=(48, 36))
    assert image.metadata["error"] <= 0.03
    assert "denoised" not in image.metadata
    assert np.array_equal(image.channels["rgba"], maquette.render(scene, size=(48, 36), denoise=False).channels["rgba"])


def test_the_error_left_is_that_of_blur_and_of_noise() -> None:
    """Of a filter with known errors: one that returns the truth off by a tenth, and one that changes nothing."""
    rng = np.random.default_rng(2)
    halves = 1.0 + 0.3 * rng.standard_normal((2, 240, 320, 3))
    noisy, half = (np.asarray(part, np.float32) for part in ((halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2))
    blurred = np.full_like(noisy, 1.1)
    expected = denoise.CERTAIN * 0.1 / 1.1
    assert denoise.error_left(noisy, half, 1.0, blurred, lambda color: blurred) == pytest.approx(expected, rel=0.1)
    of_noise = denoise.error_left(noisy, half, 1.0, noisy, lambda color: color)
    assert of_noise == pytest.approx(denoise.CERTAIN * 0.3 / math.sqrt(2.0), rel=0.05)
    exact = np.ones_like(noisy)
    assert denoise.error_left(noisy, half, 1.0, exact, lambda color: exact) < 0.02


def test_pixels_that_are_dark_after_denoising_tell_no_error_of_their_own() -> None:
    """Where all samples are black but those of one half, the half is denoised to light and the whole nearly to none."""
    rng = np.random.default_rng(3)
    halves = 1.0 + 0.1 * rng.standard_normal((2, 64, 64, 3))
    halves[:, :, :8] = 0.0
    noisy, half = (np.asarray(part, np.float32) for part in ((halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2))
    denoised, first = (np.where(noisy > 0.5, 1.0, value).astype(np.float32) for value in (0.0, 0.2))
    assert denoise.error_left(noisy, half, 1.0, denoised, lambda color: first) < 1.0


@pytest.mark.long
@needs_package
@pytest.mark.parametrize("samples", [4, 16])
def test_the_error_told_is_about_that_against_the_truth(tmp_path, samples: int) -> None:
    """A room by a window: told 12.1 % for 2.65 % and 4.6 % for 1.8 % before."""
    path = tmp_path / "room.scene"
    path.write_text(ROOM, encoding="utf-8")
    true = maquette.render(path, size=(96, 72), samples=1024, seed=9, denoise=False)
    for seed in (1, 2, 3):
        picture = maquette.render(path, size=(96, 72), samples=samples, seed=seed, denoise=True)
        assert 0.6 < maquette.compare(picture, true).error / picture.metadata["denoised_error"] < 1.2


@needs_package
def test_a_default_picture_keeps_noise_that_denoising_would_not_lessen(scene, monkeypatch) -> None:
    """The picture is that without denoising; the note tells what denoising would leave."""
    monkeypatch.setattr(denoise, "error_left", lambda *_: 0.5)
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings(size=(48, 36), threads=1, error=0.001))
    noisy = maquette.render(scene, size=(48, 36), samples=8, denoise=False)
    image = maquette.render(scene, size=(48, 36), samples=8, denoise=False)
    image.metadata.update(half_difference=0.1 * image.channels["rgba"][..., :3], variance_share=1.0, error=0.1)
    view = View(plan["camera"], 48, 36)
    by_default = planner.Plan({**plan.decisions, "denoise": replace(plan.decisions["denoise"], value="above_error")})
    denoise.denoise(image, ray.Renderer(prepare.prepare(scene, plan, view, pictures.general()), plan, view), by_default)
    assert np.array_equal(image.channels["rgba"], noisy.channels["rgba"])
    assert (image.metadata["denoised"], image.metadata["denoised_error"]) == (False, 0.5)


@pytest.mark.long
@needs_package
@pytest.mark.parametrize("columns", [16, 48, 80])
def test_a_turned_panorama_is_the_denoised_one_turned(columns: int) -> None:
    """The filter goes on over the seam and the poles. Without margins, columns at the seam are off by their whole light."""
    rng = np.random.default_rng(1)
    y, x = np.mgrid[:64, :160]
    light = 0.5 + 0.4 * np.sin(2.0 * np.pi * x / 160 * 3) * np.cos(np.pi * y / 64)
    noisy = np.asarray(light[..., None] * rng.gamma(1.0, 1.0, (64, 160, 3)), np.float32)
    albedo = np.repeat(0.5 + 0.4 * np.sign(np.sin(2.0 * np.pi * x / 160 * 5))[..., None], 3, axis=2).astype(np.float32)
    normal = np.broadcast_to(np.array([0.0, 1.0, 0.0], np.float32), albedo.shape)

    def turned(pixels: np.ndarray) -> np.ndarray:
        return np.roll(pixels, columns, axis=1)

    margins = denoise.Margins(True, True, True)
    turned_after = turned(denoise.make_filter(albedo, normal, margins)(noisy))
    turned_before = denoise.make_filter(turned(albedo), turned(normal), margins)(turned(noisy))
    assert np.abs(turned_after - turned_before).max() < 0.01 * turned_after.mean()
    without = denoise.make_filter(turned(albedo), turned(normal))(turned(noisy))
    assert np.abs(turned_after - without).max() > 0.1 * turned_after.mean()


def test_a_panorama_has_the_margins_of_the_edges_that_it_goes_on_over(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text("sphere(1)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0], projection: \"panoramic\")\n")
    room, settings = maquette.load(path), maquette.compiler.ir.Settings
    for crop, sides in {None: (True, True, True), (0, 0, 64, 16): (True, True, False), (0, 0, 63, 32): (False, False, False)}.items():
        assert denoise.margins_of(planner.make_plan(room, settings(size=(64, 32), crop=crop))) == sides
    pixels = np.arange(32.0).reshape(4, 8, 1).astype(np.float32)
    around, inner = denoise.Margins(True, True, False).around(pixels)
    assert np.array_equal(around[inner], pixels)
    assert around.shape == (8, 24, 1)
    assert around[3, 8:16, 0].tolist() == [4, 5, 6, 7, 0, 1, 2, 3]  # over the pole: the opposite side of the first row
    assert around[4, :8, 0].tolist() == around[4, 16:, 0].tolist() == pixels[0, :, 0].tolist()


def test_places_without_light_stay_black() -> None:
    """A dark room beside a lit one; single samples without light are noise; pixels without coverage have none."""
    rgba = np.ones((40, 60, 4), np.float32)
    rgba[:, :20, :3] = 0.0  # a dark wall
    rgba[7, 40, :3] = rgba[20:26, 40:46, :3] = 0.0  # noise
    rgba[0, 59] = 0.0  # nothing
    dark = denoise.unlit(rgba)
    assert dark[:, :20].all()
    assert dark.sum() == 40 * 20 + 1
    assert dark[0, 59]


@needs_package
def test_an_outline_has_no_glow(tmp_path: Path) -> None:
    """Over a transparent background denoised light ends where coverage ends."""
    path = tmp_path / "a.scene"
    lit = "sphere(0.8, material: emissive(1, luminance: 9))\nsphere(0.1, center: [0, 2, 0])\n"
    path.write_text(lit + "camera([0, 0, 5], look_at: [0, 0, 0])\n")
    rgba = maquette.render(path, size=(48, 36), samples=2, denoise=True, background="transparent").channels["rgba"]
    assert not rgba[rgba[..., 3] == 0.0].any()
