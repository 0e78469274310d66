"""Backends agree on first hits and light, to float32 rounding, away from outlines."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render.image.image import Image

from . import scenes
from .views import channel, rgb

CHANNELS = ("id", "depth", "normal", "uv", "albedo")
pytestmark = pytest.mark.usefixtures("files")

EVERYTHING = {**scenes.DIRECT, **scenes.SOFT, **scenes.RAYS}


def _interior(*images: Image) -> np.ndarray:
    """(h, w) pixels whose neighbours belong to the same instance in every picture: no outline passes."""
    h, w = images[0].height, images[0].width
    inside = np.ones((h, w), bool)
    for image in images:
        ids = np.pad(image.channels["id"][..., 0], 1, mode="edge")
        for dy in range(3):
            for dx in range(3):
                inside &= ids[dy : dy + h, dx : dx + w] == image.channels["id"][..., 0]
    return inside


def _relative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(h, w) largest difference of channels, relative to the pixel's largest value or a thousandth of the picture's."""
    size = np.maximum(np.abs(b).max(-1), 1e-3 * np.abs(b).max())
    return np.abs(a - b).max(-1) / np.where(size > 0, size, 1.0)


def _show(different: np.ndarray, limit: int) -> str:
    where = np.argwhere(different)
    return f"{len(where)} pixels differ, at most {limit} may: {where[:10].tolist()}"


@pytest.mark.parametrize("name", EVERYTHING)
def test_ray_agrees_with_the_reference(draw_on, name):
    """Same rays, formulas and random numbers: pixels may differ only where rounding decides between lit and dark."""
    samples = 1 if name in scenes.DIRECT else 4
    alone = {"precision": "float64", "transport.path_reuse": "none"}  # float32 and path reuse have their own tests
    plan = alone if "interreflection" in name else {}
    a = draw_on("ray", EVERYTHING[name], plan, samples=samples, aov=CHANNELS)
    b = draw_on("reference", EVERYTHING[name], samples=samples, aov=CHANNELS)
    inside = _interior(a, b)
    assert inside.mean() > 0.4
    for key in CHANNELS:
        x, y = channel(a, key)[inside], channel(b, key)[inside]
        assert np.allclose(x, y, rtol=1e-5, atol=1e-5), key
    different = inside & (_relative(rgb(a), rgb(b)) > 1e-4)
    limit = 0 if name in scenes.DIRECT and name != "far from the origin" else 5
    assert different.sum() <= limit, _show(different, limit)


@pytest.mark.parametrize("name", {**scenes.DIRECT, **scenes.SOFT})
def test_raster_agrees_with_ray(draw_on, name):
    """The z-buffer finds the same points as rays, with equal light.

    With corners snapped to 1/256 pixel, a sample that close to an edge inside a mesh may be given to the neighbour of its triangle,
    whose normal and coordinates there differ by that much: hence 1e-4 for what is interpolated.
    """
    a, b = (draw_on(backend, EVERYTHING[name], samples=1, aov=CHANNELS) for backend in ("raster", "ray"))
    inside = _interior(a, b)
    assert inside.mean() > 0.4
    for key in CHANNELS:
        x, y = channel(a, key)[inside], channel(b, key)[inside]
        assert np.allclose(x, y, rtol=1e-5, atol=1e-4 if key in ("normal", "uv") else 1e-5), key
    different = inside & (_relative(rgb(a), rgb(b)) > 1e-3)
    limit = 0 if name in scenes.DIRECT and name != "far from the origin" else 5
    assert different.sum() <= limit, _show(different, limit)
    ids = np.any(a.channels["id"] != b.channels["id"], axis=-1)
    assert ids.mean() < 0.02  # outlines within 0.05 pixels


def test_raster_says_what_it_does_not_draw(draw_on):
    for name, messages in (
        ("glass", {"raster draws glass without refraction: it shows the sky straight behind"}),
        ("mirrors", {
            "raster draws mirrors without reflections of objects: only the sky is reflected",
            "raster draws k_r without reflections of objects: only the sky is reflected",
        }),
        ("every shape", set()),
    ):  # fmt: skip
        image = draw_on("raster", EVERYTHING[name])
        assert {message for message, _, _ in image.metadata["notes"]} == messages
        assert draw_on("ray", EVERYTHING[name]).metadata["notes"] == []
