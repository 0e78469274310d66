"""Lights are objects: their shapes cast shadows in other lights, never in their own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .views import channel, grey

ABOVE = "camera(position: [0, 10, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: {})\n"
FLOOR = "plane(y: 0, material: lambert(#ffffff))\n"
GLOW = "sphere(0.3, center: [0, 1, 0], material: emissive(luminance: 1e-9))\n"
PLATE = 'area([0, 1, 0], size: 0.6, shape: "disk", luminance: 1e-9{})\n'


@pytest.mark.long
@pytest.mark.parametrize("bounces", [0, 1])
@pytest.mark.parametrize(
    ("lamp", "shadow"), [(GLOW, 0.6 / math.sqrt(1 - 0.09)), (PLATE.format(""), 0.6), (PLATE.format(", shadows: false"), 0.0)]
)
def test_a_lamp_throws_the_shadow_of_another(draw, lamp, shadow, bounces):
    """Halfway between a point light and the floor: shadows of a ball (a cone) and of an unlit disk."""
    text = ABOVE.format(4) + FLOOR + lamp + "point([0, 2, 0], intensity: 10)\n"
    image = draw(text, aov=("position",), bounces=bounces, samples=16 if bounces else 1)
    position = channel(image, "position")
    radius = np.hypot(position[..., 0], position[..., 2])
    sure = (position[..., 1] < 0.1) & (np.abs(radius - shadow) > (0.15 if bounces else 1e-4))
    lit, dark = sure & (radius > shadow), sure & (radius < shadow)
    assert np.count_nonzero(lit) > 500
    assert np.count_nonzero(dark) > (30 if shadow else -1)
    assert (grey(image)[dark] < 1e-8).all()
    expected = (10 * 2 / (4 + radius[lit] ** 2) ** 1.5 / math.pi).mean()
    assert grey(image)[lit].mean() == pytest.approx(expected, rel=0.01 if bounces else 1e-5)


@pytest.mark.parametrize("bounces", [0, 1])
@pytest.mark.parametrize("far", [0, 100_000])
def test_no_lamp_stands_in_its_own_light(draw_on, far, bounces):
    """Next to another light shapes cast shadows: a floor below a ball (π L sin² a) and a disk, also far from the origin."""
    for lamp in ("sphere(0.5, center: [{0}, {1}, {0}], material: emissive(luminance: 3))\n",
                 'area([{0}, {1}, {0}], size: 1, shape: "disk", luminance: 3)\n'):  # fmt: skip
        height = 0.7 if lamp.startswith("area") else 1.2
        there = lamp.format(far, far + height)
        square = 0.25 / (0.25 + height**2) if lamp.startswith("area") else 0.25 / height**2
        text = f"camera(position: [{far}, {far + 0.1}, {far}], look_at: [{far}, {far}, {far}], up: [0, 0, -1], width: 0.01)\n"
        text += f"plane(y: {far}, material: lambert(#ffffff))\ndirectional(from: [1, 1, 0], illuminance: 1e-9)\n" + there
        for backend in ("ray", "raster") if bounces == 0 else ("ray",):
            image = draw_on(backend, text, size=(8, 8), samples=256, bounces=bounces)
            assert grey(image).mean() == pytest.approx(3.0 * square, rel=2e-3)


def test_a_ball_around_a_lamp_shows_it(draw):
    """A visible marker at a point light blocks nothing."""
    text = ABOVE.format(2) + FLOOR + "sphere(0.1, center: [0, 1, 0], material: emissive(luminance: 1e-9))\n"
    text += "{}point([0, 1, 0], intensity: 2)\n"
    shown, other = draw(text.format("")), draw(text.format("directional(from: [0, 1, 0], illuminance: 1e-9)\n"))
    assert grey(shown)[2, 2] == pytest.approx(grey(other)[2, 2], rel=1e-6)
    assert grey(shown)[2, 2] > 0.1


@pytest.mark.long
def test_groups_of_lights_cast_the_same_shadows(draw_on):
    """The shapes of each light block the other; the picture is the sum of both."""
    text = ABOVE.format(3) + FLOOR
    text += "sphere(0.3, center: [0, 1, 0], material: emissive(luminance: 0.1))\n"
    text += 'area([0.4, 2, 0], size: 0.3, luminance: 30, group: "key")\n'
    whole = grey(draw_on("ray", text, samples=64))
    image = draw_on("ray", text, samples=64, aov=("light:key", "light:rest"))
    key = channel(image, "light:key")[..., 0]
    floor = draw_on("ray", text, aov=("position",))
    at = channel(floor, "position")
    umbra = (np.hypot(at[..., 0] + 0.4, at[..., 2]) < 0.2) & (at[..., 1] < 0.1)
    assert np.count_nonzero(umbra) > 10
    assert key[umbra].max() == 0.0
    assert np.abs(key + channel(image, "light:rest")[..., 0] - whole).mean() < 0.02 * whole.mean()
