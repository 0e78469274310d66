"""Solids of formulas refract as the shapes that they are: entering is told from leaving on every backend that follows rays."""

from __future__ import annotations

import numpy as np
import pytest

from .views import rgb

ROOM = (
    "camera(position: [0, 0.6, 3], look_at: [0, 0, 0], fov: 40deg)\nsky(color: #9fc4ff, luminance: 1)\n"
    "plane(y: -0.8, material: lambert(checker(#d04030, #f0f0e0, scale: 0.4)))\n"
)
BALL = "sphere(0.7, material: glass())\n"
QUARTIC = "implicit(|x, y, z| (x^2 + y^2 + z^2)^2 <= 0.2401, material: glass())\n"


@pytest.mark.parametrize(("shape", "formula"), [(BALL, QUARTIC)], ids=["ball"])
def test_a_ball_of_glass_is_a_ball_of_glass(draw_on, shape, formula):
    sharp = {"textures": "sharp"}  # the floor is filtered in what a ball mirrors, and not in a formula, whose bend is not known
    one, other = (rgb(draw_on("ray", ROOM + text, sharp, samples=1)) for text in (shape, formula))
    apart = np.abs(one - other).max(axis=-1) > 1e-3 * np.abs(one).max()
    assert apart.mean() < 0.005  # where a square of the floor begins
    floor = rgb(draw_on("ray", ROOM, sharp, samples=1))
    assert (np.abs(one - floor).max(axis=-1) > 1e-3).mean() > 0.1
