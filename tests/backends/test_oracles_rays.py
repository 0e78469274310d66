"""Mirrors, glass and light between surfaces, on the backends that follow rays: deviations, energy, series of bounces."""

from __future__ import annotations

import math

import numpy as np
import pytest

from .views import alpha, centres, channel, grey, rgb

DARK = "ambient(#ffffff, luminance: 1)\n"  # in place of the default sun and sky; what is only clear, a mirror or a lamp shows none of it
CLEAR = "phong(0, specular: 0, transmission: 1, ior: 1.5)"  # refracts all: one path, no Fresnel
RAMP = np.zeros((2, 4096, 3))
RAMP[..., 0] = (np.arange(4096) + 0.5) / 4096  # linear in u, so that what is seen tells where a ray ended
RAMP[..., 1] = 1.0


def _screen(z: float, half: float) -> str:
    """A wall at z on which red is (x + half) / (2 half)."""
    return (
        f"polygon([[{-half}, {-half}, {z}], [{half}, {-half}, {z}], [{half}, {half}, {z}], [{-half}, {half}, {z}]], "
        'uv: [[0, 0], [1, 0], [1, 1], [0, 1]], material: emissive(image("a.exr", wrap: "clamp")))\n'
    )


def _ends(image, half: float) -> np.ndarray:
    """Where on a screen's x axis the pixels' rays end."""
    assert np.allclose(rgb(image)[..., 1], 1.0, rtol=1e-6)
    return 2 * half * rgb(image)[..., 0] - half


# --- Snell --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0, 20, 45, 70])
def test_a_slab_shifts_what_is_seen_through_it(trace, picture, degrees):
    """By s sin θ (1 − cos θ / √(n² − sin² θ)), whatever the place; directions stay."""
    picture("a.exr", RAMP)
    angle, thick = math.radians(degrees), 0.7
    text = "camera(position: [0, 0, 9], width: 1)\n" + _screen(-4, 2)
    text += f"box([20, 20, {thick}], rotate: [0, {degrees}deg, 0], material: {CLEAR})\n"
    image = trace(text, size=(16, 16))
    x, _ = centres(image)
    shift = thick * math.sin(angle) * (1 - math.cos(angle) / math.sqrt(1.5**2 - math.sin(angle) ** 2))
    straight = (x - 8) / 16
    moved = _ends(image, 2) - straight
    assert np.abs(moved - moved.mean()).max() < 2e-6
    assert moved.mean() == pytest.approx(-shift, abs=2e-6)  # the slab's front is turned to the right, and rays bend against its normal


def test_the_least_deviation_of_a_prism(trace, picture):
    """60° of n = 1.5 turn light by 2 asin(n sin(A/2)) − A = 37.1808° where it passes symmetrically.

    Then the ray inside is parallel to the base and half the deviation off the ray outside. Where the ray goes is read from two
    screens one metre apart.
    """
    picture("a.exr", RAMP)
    apex = math.radians(60)
    deviation = 2 * math.asin(1.5 * math.sin(apex / 2)) - apex
    corners = [(0.5 * math.sin(a), 0.5 * math.cos(a)) for a in (math.radians(90 + 120 * k) + deviation / 2 for k in range(3))]
    points = ", ".join(f"[{x}, {y}, {z}]" for y in (3, -3) for x, z in corners)
    text = (
        f"camera(position: [0, 0, 9], width: 1cm)\nmesh(points: [{points}], "
        f"faces: [[0, 1, 2], [3, 5, 4], [0, 3, 4, 1], [1, 4, 5, 2], [2, 5, 3, 0]], material: {CLEAR})\n"
    )
    ends = [_ends(trace(text + _screen(z, 8), size=(8, 8)), 8) for z in (-3, -4)]
    turned = np.degrees(np.arctan(ends[0] - ends[1]))
    assert math.degrees(deviation) == pytest.approx(37.1808, abs=1e-4)
    assert np.allclose(turned, math.degrees(deviation), atol=1e-3)


def test_a_ball_brings_rays_together_behind_it(trace, picture):
    """n = 1.5: a ray .3 R off the axis crosses it .461978 R behind the ball; near the axis at (2 − n) / (2 (n − 1)) R = R / 2."""
    picture("a.exr", RAMP)
    for height, focus, bound in ((0.3, 0.461978, 1e-5), (0.003, 0.5, 1e-4)):
        text = f"camera(position: [{height}, 0, 9], look_at: [{height}, 0, 0], width: 0.1mm)\nsphere(1, material: {CLEAR})\n"
        image = trace(text + _screen(-1 - focus, 1), size=(9, 9))
        assert _ends(image, 1)[4, 4] == pytest.approx(0, abs=bound * height + 1e-6)


def test_total_reflection_sends_everything_back(trace):
    """Light in glass that meets its side beyond 41.81°: a right-angled prism is a mirror that shows all of a lamp beside it."""
    text = DARK + (
        "camera(position: [0, 0, 5], width: 1)\nmesh(points: [[-1, -1, 1], [-1, 1, 1], [1, -1, 1], [1, 1, 1], [-1, -1, -1], [-1, 1, -1]], "
        "faces: [[0, 2, 3, 1], [0, 1, 5, 4], [2, 4, 5, 3], [0, 4, 2], [1, 3, 5]], material: glass(ior: 1.5))\n"
        "box([0.1, 4, 4], center: [-3, 0, 0], material: emissive(1, luminance: 1))\n"
    )
    # In at one face and out at another, both at right angles, and to and fro between the two: as through a slab.
    assert np.allclose(grey(trace(text, size=(8, 8))), 2 * 1.5 / (1.5**2 + 1), atol=1e-4)


def test_a_slab_of_glass_lets_through_what_fresnel_says(trace):
    """T = 2n / (n² + 1) with all reflections between its faces: 0.923077; seen against black, R = 1 − T of a lamp behind the eye."""
    text = DARK + "camera(position: [0, 0, 1], width: 1, near: 1cm)\nbox([40, 40, 0.1], material: glass(ior: 1.5))\n"
    behind = "disk(30, center: [0, 0, -3], normal: [0, 0, 1], material: emissive(1, luminance: 1))\n"
    before = "disk(30, center: [0, 0, 3], normal: [0, 0, -1], material: emissive(1, luminance: 1))\n"
    through = 2 * 1.5 / (1.5**2 + 1)
    assert np.allclose(grey(trace(text + behind, size=(8, 8))), through, atol=1e-4)
    assert np.allclose(grey(trace(text + before, size=(8, 8))), 1 - through, atol=1e-4)


# --- mirrors ------------------------------------------------------------------------------------------------------------


def test_a_mirror_shows_what_stands_beside_it(trace):
    """A mirror in the plane x = z turns rays along −z, which meet it at z = x, into rays along −x."""
    text = DARK + (
        "camera(position: [0, 0, 5], width: 4)\nmesh(points: [[0, -9, -9], [0, 9, -9], [0, 9, 9], [0, -9, 9]], faces: [[0, 1, 2, 3]], "
        "rotate: [0, 45deg, 0], material: mirror())\n"
        "sphere(0.5, center: [-6, 0.8, 1], material: emissive(rgb(1, 0.5, 0.25), luminance: 1))\n"
    )
    image = trace(text, size=(64, 64))
    x, y = centres(image)
    distance = np.hypot((x - 32) / 16 - 1, (32 - y) / 16 - 0.8)
    assert np.abs(distance - 0.5).min() > 1e-6
    assert np.allclose(rgb(image), np.where((distance < 0.5)[..., None], [1, 0.5, 0.25], 0))


def test_reflections_multiply_until_the_bounces_end(trace):
    """Between mirrors at z = ±1 a ray of slope s meets ⌊(h/s + 1)/2⌋ of them before it meets a lamp at height h: r to that power."""
    text = DARK + (
        "camera(position: [0, 0, 0], look_at: [0, 0.2, -1], fov: 20deg)\n"
        "polygon([[-9, -90, -1], [9, -90, -1], [9, 90, -1], [-9, 90, -1]], material: phong(0, specular: 0, k_r: 0.5))\n"
        "polygon([[9, -90, 1], [-9, -90, 1], [-9, 90, 1], [9, 90, 1]], material: phong(0, specular: 0, k_r: 0.5))\n"
        "plane(y: 1.7, material: emissive(1, luminance: 1))\n"
    )
    image = trace(text, size=(1, 64), bounces=12)
    _, y = centres(image)
    up = (1 - 2 * y / 64) * math.tan(math.radians(10))  # of (0, 1, 0.2), added to (0, 0.2, −1): both as long
    slope = (0.2 + up) / (1 - 0.2 * up)
    met = np.floor((1.7 / slope + 1) / 2)
    assert (met > 12).any()
    assert (met <= 12).sum() > 40
    assert np.allclose(grey(image), np.where((slope > 0) & (met <= 12), 0.5**met, 0), rtol=1e-6)


# --- energy -------------------------------------------------------------------------------------------------------------


def test_a_mirror_in_a_furnace_shows_one(trace):
    text = "camera(position: [0, 0, 4], fov: 30deg)\nsphere(1, material: mirror())\nsky(color: #ffffff, luminance: 1)\n"
    image = trace(text)
    assert np.allclose(grey(image), 1.0, rtol=1e-6)
    assert 0 < alpha(image).sum() < 48 * 48


def test_glass_in_a_furnace_shows_one(trace):
    """Reflected and refracted shares add to one at each surface.

    Rays that could add less than 1e-4 are not followed: of the series of those that leave a ball of reflectance r, (1 − r)² rᵏ,
    what is cut sums up to no more than 1e-4 / (1 − r), besides the one inside. Off the axis by less than 0.95 R, r is below 0.2.
    """
    text = "camera(position: [0, 0, 4], width: 2)\nsphere(1, material: glass(ior: 1.5))\nsky(color: #ffffff, luminance: 1)\n"
    image = trace(text, bounces=40)
    x, y = centres(image)
    within = np.hypot(x - 24, y - 24) < 0.95 * 24
    assert np.abs(grey(image)[within] - 1).max() < 1e-4 / 0.8 + 1e-4
    assert grey(image).max() < 1 + 1e-6


HOLLOW = (
    "camera(position: [0.2, 0.1, 0.3], look_at: [1, 0.2, -0.4], fov: 60deg)\nsphere(2, material: lambert(0.6))\n"
    "point([0, 0, 0], intensity: 5)\n"
)


@pytest.mark.parametrize("bounces", [0, 1, 3])
def test_light_between_the_walls_of_a_hollow_sphere(trace, bounces):
    """A lamp of intensity I in the middle: every wall shows ρI/(πR²) directly and ρᵏ of that after each further bounce."""
    direct = 0.6 * 5 / (math.pi * 4)
    expected = direct * (1 - 0.6 ** (bounces + 1)) / (1 - 0.6)
    assert np.allclose(grey(trace(HOLLOW, size=(16, 16), bounces=bounces)), expected, rtol=1e-6)


def test_interreflection_is_a_decision_that_can_be_overruled(trace):
    without = trace(HOLLOW, {"interreflection": "off"}, size=(16, 16), bounces=3)
    assert np.allclose(grey(without), 0.6 * 5 / (math.pi * 4), rtol=1e-6)


def test_what_stands_in_a_mirror_is_not_covered_by_it_in_depth(trace):
    """Channels are those of the first surface: a mirror's own depth and normal."""
    text = "camera(position: [0, 0, 0], look_at: [0, 0, -1], fov: 40deg)\nbox([9, 9, 1], center: [0, 0, -3], material: mirror())\nsky()\n"
    image = trace(text, size=(8, 8), aov=("depth", "normal"))
    assert np.allclose(channel(image, "depth"), 2.5)
    assert np.allclose(channel(image, "normal"), [0, 0, 1])
