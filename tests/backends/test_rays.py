"""Mirrors and interreflection on the tracing backends, and the bounce limit; tests/accuracy has the figures."""

from __future__ import annotations

import math

import numpy as np

from .views import centres, channel, grey, rgb

DARK = "ambient(#ffffff, luminance: 1)\n"  # in place of the default sun and sky; what is only clear, a mirror or a lamp shows none of it


def test_a_mirror_shows_what_stands_beside_it(trace):
    """A mirror in the plane x = z reflects rays along −z, which hit it at z = x, to −x."""
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
    """Between mirrors at z = ±1 a ray of slope s hits ⌊(h/s + 1)/2⌋ of them before a light at height h: r to that power."""
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


HOLLOW = (
    "camera(position: [0.2, 0.1, 0.3], look_at: [1, 0.2, -0.4], fov: 60deg)\nsphere(2, material: lambert(0.6))\n"
    "point([0, 0, 0], intensity: 5)\n"
)


def test_interreflection_is_a_decision_that_can_be_overruled(trace):
    without = trace(HOLLOW, {"interreflection": "off"}, size=(16, 16), bounces=3)
    assert np.allclose(grey(without), 0.6 * 5 / (math.pi * 4), rtol=1e-6)


def test_what_stands_in_a_mirror_is_not_covered_by_it_in_depth(trace):
    """Channels are those of the first surface: a mirror's own depth and normal."""
    text = "camera(position: [0, 0, 0], look_at: [0, 0, -1], fov: 40deg)\nbox([9, 9, 1], center: [0, 0, -3], material: mirror())\nsky()\n"
    image = trace(text, size=(8, 8), aov=("depth", "normal"))
    assert np.allclose(channel(image, "depth"), 2.5)
    assert np.allclose(channel(image, "normal"), [0, 0, 1])
