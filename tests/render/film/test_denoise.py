"""Tests of denoising: lower error, guides, and the message without the package."""

from __future__ import annotations

import importlib.util
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
from maquette.render.types import View

SCENE = """
camera(position: [0, 1.2, 4], look_at: [0, 0.6, 0], fov: 40deg)
plane(y: 0, material: lambert(#a0a0a0))
sphere(0.6, center: [-0.7, 0.6, 0], material: lambert(#d04030))
box([0.6, 0.9, 0.5], center: [0.6, 0.45, 0.3], material: mirror(#c0c0ff))
area([1, 3, 2], look_at: [0, 0, 0], size: [2, 2], luminance: 3)
sky(luminance: 0.2)
"""
needs_package = pytest.mark.skipif(importlib.util.find_spec("pyoidn") is None, reason="pyoidn is not installed")


@pytest.fixture
def scene(tmp_path: Path):
    path = tmp_path / "a.scene"
    path.write_text(SCENE)
    return maquette.load(path)


@needs_package
def test_it_halves_the_error_of_few_samples_and_is_off_unless_asked(scene) -> None:
    asked = {"size": (96, 72), "threads": 1}
    true = maquette.render(scene, samples=1024, seed=5, **asked)
    noisy, plain = (maquette.render(scene, samples=4, denoise=on, **asked) for on in (None, False))
    assert np.array_equal(noisy.channels["rgba"], plain.channels["rgba"])
    clean = maquette.render(scene, samples=4, denoise=True, **asked)
    before, after = (maquette.compare(image, true).error for image in (noisy, clean))
    assert after < 0.5 * before
    assert np.array_equal(clean.channels["rgba"][..., 3], noisy.channels["rgba"][..., 3])
    assert clean.metadata["denoised"]
    assert "denoised" not in noisy.metadata


def test_guides_are_what_is_seen_first(scene) -> None:
    """The sky has none; a matt ball its color and the mirror its tint, with unit normals inside of outlines."""
    plan = planner.make_plan(scene, maquette.compiler.ir.Settings(size=(48, 36), samples=4, threads=1))
    view = View(plan["camera"], 48, 36)
    albedo, normal = denoise.guides(ray.Renderer(prepare.prepare(scene, plan, view), plan, view), plan)
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
