"""The daylight sky: Preetham's figures at the zenith, what its picture gives level ground, and what it answers to wrong suns."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.lights import daylight_sky

LUMINANCE = np.array([0.2126729, 0.7151522, 0.0721750])


def directions(n):
    """(3, n) even over the ball (González 2010)."""
    k = np.arange(n) + 0.5
    y = 1.0 - 2.0 * k / n
    turn = k * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - y * y)
    return np.stack([across * np.cos(turn), y, across * np.sin(turn)])


def test_the_zenith_is_the_formulas():
    """Written out for T = 3 and a sun 45° high: χ = (4/9 − 1/40) π/2."""
    chi = (4 / 9 - 3 / 120) * math.pi / 2
    luminance, x, y = daylight_sky.zenith(math.pi / 4, 3.0)
    assert luminance == pytest.approx(1000 * ((4.0453 * 3 - 4.9710) * math.tan(chi) - 0.2155 * 3 + 2.4192))
    assert 0.2 < x < 0.3
    assert 0.2 < y < 0.33
    found = daylight_sky.luminance(np.array([1.0]), np.array([math.cos(math.pi / 4)]), math.pi / 4, 3.0)
    assert [float(v[0]) for v in found] == pytest.approx([luminance, x, y])


@pytest.mark.long
@pytest.mark.parametrize("turbidity", [1.8, 3.0, 6.0, 10.0])
@pytest.mark.parametrize("height", [0.02, 0.3, 1.0])
def test_level_ground_gets_pi(turbidity, height):
    """By brute force over 200,000 directions, looked up in the picture."""
    across = math.sqrt(1.0 - height * height)
    sun = np.array([across * 0.6, height, across * 0.8])
    picture = daylight_sky.picture(sun, turbidity, (0.2, 0.2, 0.2))
    assert np.isfinite(picture).all()
    assert picture.min() >= 0.0
    x, y, z = directions(200_000)
    s, t = 0.5 - np.arctan2(x, z) / (2 * math.pi), 0.5 - np.arcsin(y) / math.pi
    row = np.minimum((t * daylight_sky.HEIGHT).astype(int), daylight_sky.HEIGHT - 1)
    column = (s * daylight_sky.WIDTH).astype(int) % daylight_sky.WIDTH
    light = picture[row, column, :3] @ LUMINANCE
    assert np.mean(light * np.maximum(y, 0.0)) * 4 * math.pi == pytest.approx(math.pi, rel=2e-3)
    assert light[y < -0.1] == pytest.approx(0.2, rel=1e-5)  # E ρ / π of the ground
    brightest = np.argmax(light)
    assert height > 0.5 or np.array([x, y, z])[:, brightest] @ sun > 0.9  # about the sun


def test_its_picture_is_a_dome(compiled):
    scene = compiled("sky(turbidity: 3, sun: [1, 1, 0], luminance: 2)\nsky(turbidity: 3, sun: [1, 1, 0])\nsphere(1)\ncamera([0, 1, 5])\n")
    lights = scene.tables.lights
    assert lights.kind.tolist() == [ir.LightKind.DOME] * 2
    assert lights.color.tolist() == [[2.0] * 3, [1.0] * 3]
    assert lights.image.tolist() == [0, 0]  # one picture


@pytest.mark.parametrize(
    ("text", "above", "below"),
    [
        ("sky(luminance: 3000nit, color: #0000ff)", [0, 0, 3000], [0.2 * 0.072175 * 3000] * 3),  # grey, not blue
        ("sky(luminance: 3000nit, color: #0000ff, ground: #00ff00)", [0, 0, 3000], [0, 0.072175 * 3000, 0]),
        ("sky(luminance: 2, ground: rgb(0.1, 0.2, 0.3))", [2, 2, 2], [0.2, 0.4, 0.6]),
    ],
)
def test_under_an_even_sky_lies_ground_that_it_lights(compiled, text, above, below):
    """Luminance of matt ground: albedo × illuminance / π, and the illuminance of level ground under an even sky is π × its luminance."""
    tables = compiled(text + "\nsphere(1)\ncamera([0, 1, 5])\n").tables
    assert tables.lights.kind.tolist() == [ir.LightKind.DOME]
    light = tables.images.texels[:, :3] * tables.lights.color[0]
    assert light[: len(light) // 2] == pytest.approx(np.tile(np.array(above, float), (len(light) // 2, 1)), rel=1e-5)
    assert light[len(light) // 2 :] == pytest.approx(np.tile(np.array(below, float), (len(light) // 2, 1)), rel=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        "sky(luminance: 3000nit)",  # without a color: for measurements
        "sky(luminance: 0.5, color: #87b5e0)",  # without a unit
        "sky(luminance: 3000nit, color: rgb(0.4, 0.4, 0.4), ground: #ffffff)",  # white ground has the luminance of the sky
    ],
)
def test_a_sky_is_even_all_around(compiled, text):
    assert compiled(text + "\nsphere(1)\ncamera([0, 1, 5])\n").tables.lights.kind.tolist() == [ir.LightKind.SKY]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sky(turbidity: 3, sun: [1, -1, 0])", "the sun of this sky stands below the horizon"),
        ("sky(sun: [1, 1, 0])", "an even sky has no `sun`"),
    ],
)
def test_what_cannot_be(said, text, message):
    assert said(text + "\nsphere(1)\ncamera([0, 1, 5])\n").startswith(f"a.scene:1:1: error: {message}\n")
