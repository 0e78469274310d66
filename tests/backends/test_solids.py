"""Implicit solids refract like the equal shapes, on every tracing backend: entry and exit differ."""

from __future__ import annotations

import numpy as np
import pytest

from .views import rgb

ROOM = "sky(color: #9fc4ff, luminance: 1)\nplane(y: -0.8, material: lambert(checker(#d04030, #f0f0e0, scale: 0.4)))\n"
OUTSIDE = "camera(position: [0, 0.6, 3], look_at: [0, 0, 0], fov: 40deg)\n"
WITHIN = "camera(position: [0, 0.1, 0.6], look_at: [0, -0.1, -0.3], fov: 60deg)\n"
SHARP = {"texture_filter": "point"}  # the floor is filtered in what a ball mirrors, and not in a formula, whose bend is not known


def ball(radius: float, x: float = 0.0, y: float = 0.0, arguments: str = "") -> str:
    return f"sphere(radius: {radius}, center: [{x}, {y}, 0]{arguments})"


def quartic(radius: float, x: float = 0.0, y: float = 0.0, arguments: str = "") -> str:
    """The same ball as an implicit surface without a closed form."""
    return f"implicit(|x, y, z| ((x - {x})^2 + (y - {y})^2 + z^2)^2 <= {radius**4!r}{arguments})"


def of(ior: float) -> str:
    return f", material: glass(ior: {ior})"


SOLIDS = {
    "a ball": (OUTSIDE, lambda b: b(0.7, 0, 0, of(1.5))),
    "a ball of glass in water": (OUTSIDE, lambda b: f"{b(0.7, 0, 0, of(1.33))}; {b(0.35, 0.1, 0.05, of(1.6))}"),
    "a bubble in glass": (OUTSIDE, lambda b: f"{b(0.7, 0, 0, of(1.5))}; {b(0.4, 0.1, 0, of(1.0))}"),
    "a thin wall, which reflects all at a slant": (OUTSIDE, lambda b: f"{b(0.7, 0, 0, of(1.5))}; {b(0.62, 0.05, 0.02, of(1.0))}"),
    "balls that overlap": (OUTSIDE, lambda b: f"{b(0.5, -0.3, 0, of(1.33))}; {b(0.5, 0.3, 0.1, of(1.5))}"),
    "hollowed": (OUTSIDE, lambda b: f"difference(material: glass()) {{ {b(0.7)}; {b(0.6)} }}"),
    "cut": (OUTSIDE, lambda b: f"difference(material: glass()) {{ {b(0.7)}; {b(0.5, 0.3, 0.3)} }}"),
    "united": (OUTSIDE, lambda b: f"union(material: glass()) {{ {b(0.5, -0.3)}; {b(0.5, 0.3, 0.1)} }}"),
    "a lens": (OUTSIDE, lambda b: f"intersection(material: glass()) {{ {b(0.7, -0.3)}; {b(0.7, 0.3, 0.1)} }}"),
    "seen from within": (WITHIN, lambda b: b(0.75, 0, 0, of(1.5))),
    "seen from within water": (WITHIN, lambda b: f"{b(0.75, 0, 0, of(1.33))}; {b(0.3, 0, 0, of(1.5))}"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", SOLIDS)
def test_glass_of_formulas_is_glass_of_balls(draw_on, name):
    """Equal except for pixels at a floor tile's edge, or where rounding changes a random choice."""
    camera, text = SOLIDS[name]
    settings = {"samples": 1, "bounces": 8}
    balls, formulas = (camera + ROOM + text(shape) + "\n" for shape in (ball, quartic))
    true, found = (rgb(draw_on("reference", scene, SHARP, **settings)) for scene in (balls, formulas))
    assert apart(true, found) <= 0.001
    for scene, share in ((formulas, 0.001), (balls, 0.005)):
        assert apart(true, rgb(draw_on("ray", scene, SHARP, **settings))) <= share
    assert apart(true, rgb(draw_on("reference", camera + ROOM, SHARP, **settings))) > 0.05


def test_a_blend_that_reaches_nothing_leaves_glass_as_it_is(draw_on):
    two = f"{{ {quartic(0.4, -0.5)}; {quartic(0.4, 0.5)} }}\n"
    one, other = (OUTSIDE + ROOM + f"union(material: glass(){blend}) {two}" for blend in ("", ", round: 0.1"))
    pictures = [rgb(draw_on("ray", scene, SHARP, samples=1, bounces=8)) for scene in (one, other)]
    assert apart(*pictures) <= 0.001


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """The share of pixels that differ."""
    return float((np.abs(one - other).max(axis=-1) > 1e-3).mean())
