"""Backends agree on first hits and light, to float32 rounding, away from outlines."""

from __future__ import annotations

import numpy as np
import pytest

from . import scenes
from .views import channel, interior, relative, rgb, show

CHANNELS = ("id", "depth", "normal", "uv", "albedo")
pytestmark = pytest.mark.usefixtures("files")

LONG = ("formula of glass",)  # a minute of the reference
EVERYTHING = {**scenes.DIRECT, **scenes.SOFT, **scenes.RAYS}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LONG)) for name in EVERYTHING])
def test_ray_agrees_with_the_reference(draw_on, name):
    """Same rays, formulas and random numbers: pixels may differ only where rounding decides between lit and dark."""
    samples = 1 if name in scenes.DIRECT else 4
    alone = {"precision": "float64", "transport.path_reuse": "none", "transport.sky_visibility": "none"}  # these have their own tests
    plan = alone if "interreflection" in name else {}
    a = draw_on("ray", EVERYTHING[name], plan, samples=samples, aov=CHANNELS)
    b = draw_on("reference", EVERYTHING[name], samples=samples, aov=CHANNELS)
    inside = interior(a, b)
    assert inside.mean() > 0.4
    for key in CHANNELS:
        x, y = channel(a, key)[inside], channel(b, key)[inside]
        assert np.allclose(x, y, rtol=1e-5, atol=1e-5), key
    different = inside & (relative(rgb(a), rgb(b)) > 1e-4)
    limit = 0 if name in scenes.DIRECT and name != "far from the origin" else 5
    assert different.sum() <= limit, show(different, limit)


@pytest.mark.parametrize("name", {**scenes.DIRECT, **scenes.SOFT})
def test_raster_agrees_with_ray(draw_on, name):
    """The z-buffer finds the same points as rays, with equal light.

    With corners snapped to 1/256 pixel, a sample that close to an edge inside a mesh may be given to the neighbour of its triangle,
    whose normal and coordinates there differ by that much: hence 1e-4 for what is interpolated.
    """
    a, b = (draw_on(backend, EVERYTHING[name], samples=1, aov=CHANNELS) for backend in ("raster", "ray"))
    inside = interior(a, b)
    assert inside.mean() > 0.4
    for key in CHANNELS:
        x, y = channel(a, key)[inside], channel(b, key)[inside]
        assert np.allclose(x, y, rtol=1e-5, atol=1e-4 if key in ("normal", "uv") else 1e-5), key
    different = inside & (relative(rgb(a), rgb(b)) > 1e-3)
    limit = 0 if name in scenes.DIRECT and name != "far from the origin" else 5
    assert different.sum() <= limit, show(different, limit)
    ids = np.any(a.channels["id"] != b.channels["id"], axis=-1)
    assert ids.mean() < 0.02  # outlines within 0.05 pixels


@pytest.mark.long
def test_raster_says_what_it_does_not_draw(draw_on):
    for name, messages in (
        ("glass", {"raster draws glass without refraction: the sky and the ground's mean light show"}),
        ("mirrors", {
            "raster draws mirrors without reflected objects: the sky and the ground's mean light show",
            "raster draws k_r without reflected objects: the sky and the ground's mean light show",
        }),
        ("every shape", set()),
    ):  # fmt: skip
        image = draw_on("raster", EVERYTHING[name])
        assert {message for message, _, _ in image.metadata["notes"]} == messages
        assert draw_on("ray", EVERYTHING[name]).metadata["notes"] == []
