"""Light on every backend: colours, cones, lobes, shadows and scale; tests/accuracy has the other closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .views import centres, channel, grey, rgb

ABOVE = "camera(position: [0, 10, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: {})\n"
FLOOR = "plane(y: 0, material: lambert(#ffffff))\n"


def _place(image) -> tuple[np.ndarray, np.ndarray]:
    position = channel(image, "position")
    return position[..., 0], position[..., 2]


# --- lamps over a floor: L = ρE/π ---------------------------------------------------------------------------------------


def test_every_light_adds_its_own_colour(draw):
    text = ABOVE.format(2) + FLOOR + (
        "directional(from: [0, 1, 0], illuminance: 1, color: rgb(1, 0.5, 0))\n"
        "directional(from: [1, 1, 0], illuminance: 2, color: rgb(0, 0.25, 1))\nambient(rgb(0.1, 0.2, 0.3), luminance: 0.5)\n"
    )
    slant = 2 * math.sqrt(0.5) / math.pi
    expected = [1 / math.pi + 0.05, 0.5 / math.pi + 0.25 * slant + 0.1, slant + 0.15]
    assert np.allclose(rgb(draw(text)), expected, rtol=1e-5)


def test_a_hard_spot_is_dark_outside_its_cone(draw):
    image = draw(ABOVE.format(3) + FLOOR + "spot([0, 1, 0], cone: 40deg, soft: 0, intensity: 7)\n", aov=("position",))
    x, z = _place(image)
    radius = np.hypot(x, z)
    expected = np.where(radius < math.tan(math.radians(40)), 7 / (1 + radius**2) ** 1.5 / math.pi, 0)
    assert np.allclose(grey(image), expected, rtol=1e-5, atol=1e-12)


# --- a lamp with an extent: the mean over samples, within 4 standard errors ------------------------------------------------


def test_irradiance_of_a_wide_sun(draw):
    """The sun's disk of half angle a has a given illuminance: E cos θ for any size."""
    camera = "camera(position: [0, 0.5, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 1mm, near: 1cm)\n"
    values = grey(draw(camera + FLOOR + "sun(from: [1, 1, 0], illuminance: 2, angle: 20deg)\n", size=(16, 16), samples=16))
    error = values.std(ddof=1) / 16
    assert abs(values.mean() - 2 / math.pi * math.sqrt(0.5)) <= 4 * error
    assert error < 0.002


# --- the course's models ------------------------------------------------------------------------------------------------

@pytest.mark.parametrize(("model", "exponent"), [("phong", 20), ("blinn_phong", 80)])
def test_the_lobes_of_phong_and_blinn(draw, model, exponent):
    """Seen from above with light at angle θ off the axis: R·V = cos θ, N·H = cos(θ/2)."""
    for degrees in (0, 10, 25, 50):
        angle = math.radians(degrees)
        text = ABOVE.format(1) + (
            f"plane(y: 0, material: {model}(0, specular: 1, shininess: {exponent}))\n"
            f"directional(from: [{math.sin(angle)}, {math.cos(angle)}, 0])\n"
        )
        lobe = math.cos(angle if model == "phong" else angle / 2) ** exponent
        assert np.allclose(grey(draw(text, size=(8, 8))), lobe, rtol=2e-5)


def test_no_highlight_on_the_side_away_from_a_light(draw):
    """N·L < 0 and R·V < 0 are clamped before any power: nothing negative, nothing undefined, no light from below."""
    for model in ("phong", "blinn_phong"):
        for way in ([0.3, -1, 0], [1, -0.001, 0.2]):
            text = ABOVE.format(1) + f"plane(y: 0, material: {model}(0.5, specular: 1, shininess: 2.5))\ndirectional(from: {way})\n"
            assert np.array_equal(grey(draw(text, size=(8, 8))), np.zeros((8, 8)))


# --- shadows ------------------------------------------------------------------------------------------------------------


def test_the_shadow_of_a_disk_under_a_point_light(draw):
    """Halfway between light and floor a disk of radius r shadows a disk of radius 2r, except from a light without shadows."""
    text = ABOVE.format(4) + FLOOR + "disk(0.3, center: [0, 1, 0], material: lambert(0))\npoint([0, 2, 0], intensity: 10{})\n"
    shaded, open_ = draw(text.format(""), aov=("position",)), draw(text.format(", shadows: false"), aov=("position",))
    position = channel(shaded, "position")
    radius = np.hypot(position[..., 0], position[..., 2])
    floor = position[..., 1] < 0.5
    expected = 10 * 2 / (4 + radius**2) ** 1.5 / math.pi
    assert np.allclose(grey(open_)[floor], expected[floor], rtol=1e-5)
    sure = floor & (np.abs(radius - 0.6) > 1e-5)
    assert np.allclose(grey(shaded)[sure], np.where(radius > 0.6, expected, 0)[sure], rtol=1e-5)
    assert np.count_nonzero(floor & (radius < 0.6)) > 50


@pytest.mark.long
def test_a_light_without_shadows_shines_beside_one_that_casts_them(draw):
    """With interreflection: each path samples one of two lights of equal power."""
    text = ABOVE.format(1).replace("10", "0.9") + FLOOR + "disk(3, center: [0, 1, 0], material: lambert(0))\n"
    lights = "directional(from: [0, 1, 0], illuminance: 1, shadows: false)\ndirectional(from: [0, 1, 0], illuminance: 1)\n"
    image = draw(text + lights, bounces=1, samples=64)
    assert float(grey(image).mean()) == pytest.approx(1 / math.pi, rel=0.02)


def test_no_surface_shades_itself(draw):
    """All points of a ball that face the light are lit, also far from the origin, where a fixed offset would vanish in rounding."""
    for at in ([0, 0, 0], [1e5, 1e5, -1e5]):
        x, y, z = at
        text = (
            f"camera(position: [{x}, {y}, {z + 4}], look_at: [{x}, {y}, {z}], fov: 40deg)\nsphere(1, center: [{x}, {y}, {z}], "
            f"material: lambert(1))\ndirectional(from: [1, 1, 1])\n"
        )
        image = draw(text, aov=("normal", "id"))
        cosine = channel(image, "normal") @ np.full(3, math.sqrt(1 / 3))
        lit = (channel(image, "id")[..., 0] == 0) & (cosine > 0.05)
        assert lit.sum() > 300
        assert np.allclose(grey(image)[lit], cosine[lit], rtol=1e-4)


@pytest.mark.long
def test_light_scales_exactly(draw):
    """Scaling all lights by 2^±40 scales the picture, to the last bit."""
    text = ABOVE.format(3) + (
        "plane(y: 0, material: blinn_phong(0.7, specular: 0.2))\npoint([1, 2, 0], intensity: {})\nsun(from: [1, 3, 0], illuminance: {})\n"
    )
    plain = grey(draw(text.format(1, 2), samples=2))
    for power in (-40, 40):
        assert np.array_equal(grey(draw(text.format(2.0**power, 2.0 ** (power + 1)), samples=2)), plain * 2.0**power)


def test_the_picture_has_no_seam_between_tiles(draw):
    """A smooth picture is smooth across tile borders, between pixels 31 and 32."""
    image = draw(ABOVE.format(6) + FLOOR + "point([0.5, 2, -0.25], intensity: 5)\n", size=(70, 40))
    x, _ = centres(image)
    second = np.abs(np.diff(grey(image), n=2, axis=1))
    assert second[:, 28:36].max() <= 1.5 * second.max(axis=1).max()
    assert x.shape == (40, 70)
