"""Luminance of pixels and regions against closed forms."""

from __future__ import annotations

import maquette
import pytest
from maquette.compiler import ir
from maquette.measure.light import luminance
from maquette.measure.light.replicates import Effort

SCENE = """
box(size: [40, 1, 40], center: [0, -0.5, 0], material: lambert(0.5))
directional([0, 1, 0], illuminance: 1000lx)
camera([0, 5, 0.01], look_at: [0, 0, 0])
render(size: [64, 48], samples: 1, bounces: 0)
"""


def read(text: str, *regions: luminance.Region, size: tuple[int, int] | None = None) -> list[luminance.Reading]:
    return luminance.read(maquette.load_text(text), ir.Settings(size=size), list(regions), Effort())[0]


def test_a_diffuse_floor() -> None:
    pixel, region = read(SCENE, (32, 24, 33, 25), (0, 0, 64, 48))
    for reading in (pixel, region):
        assert abs(reading.mean.value - 0.5 * 1000 / 3.141592653589793) <= reading.mean.error
    assert pixel.least is None
    assert region.least
    assert region.most
    assert region.pixels.shape == (48, 64)


def test_a_lamp_and_the_sky_behind_it() -> None:
    text = "sphere(1, material: emissive(#ffffff, luminance: 3000nit))\nsky(luminance: 200nit)\ncamera([0, 0, 5], look_at: [0, 0, 0])"
    lamp, sky = read(text, (50, 50, 51, 51), (0, 0, 4, 4), size=(100, 100))
    assert abs(lamp.mean.value - 3000) <= lamp.mean.error
    assert abs(sky.mean.value - 200) <= sky.mean.error


def test_a_pixel_outside_of_the_picture() -> None:
    with pytest.raises(ValueError, match="the pixel 64,0 is outside of the picture of 64x48 pixels"):
        read(SCENE, (64, 0, 65, 1))
    with pytest.raises(ValueError, match="the region 0,0,65,2 is outside of the picture of 64x48 pixels"):
        read(SCENE, (0, 0, 65, 2))
