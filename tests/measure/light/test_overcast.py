"""Daylight factors under the CIE overcast sky against closed forms."""

from __future__ import annotations

import math

import maquette
from maquette.measure.light import illuminance, overcast
from maquette.measure.light.replicates import Effort


def factors(text: str) -> list[illuminance.Value]:
    scene = maquette.load_text(text)
    return [reading.mean for reading in overcast.read(scene, scene.meters, Effort(0.005))[0]]


def test_the_open_field_has_all_daylight_whatever_the_lamps_are() -> None:
    lamps = "sun([1, 1, 0], illuminance: 80000lx)\narea([0, 2, 0], size: 10cm, flux: 5000lm)\nsky(luminance: 90nit)\n"
    (open_field,) = factors(lamps + "sphere(1cm, center: [0, -1, 0], material: emissive(#ff0000, luminance: 500nit))\nmeter()")
    assert abs(open_field.value - 1.0) <= open_field.error + 1e-3
    assert open_field.error <= 0.006


def test_a_vertical_plane_receives_its_share() -> None:
    """Over a black ground, E_v is (π/6 + 4/9) L_zenith (Moon and Spencer 1942)."""
    (vertical,) = factors("sphere(1cm, center: [0, -1, 0])\nmeter(facing: [1, 0, 0])")
    right = (math.pi / 6 + 4 / 9) / (7 * math.pi / 9)
    assert abs(vertical.value - right) <= vertical.error + 1e-3


def test_a_round_skylight_in_a_black_room() -> None:
    """∫ (1 + 2 cos θ)/3 cos θ dω over a cone of half angle φ: π/3 sin² φ + 4π/9 (1 − cos³ φ)."""
    text = "translate([0, 1, 0]) { difference { box(size: [40, 0.001, 40])\ncylinder(radius: 1, height: 1, center: [0, 0, 0]) } }\nmeter()"
    (factor,) = factors(text)
    cosine = math.cos(math.pi / 4)
    right = (math.pi / 3 * (1 - cosine**2) + 4 * math.pi / 9 * (1 - cosine**3)) / (7 * math.pi / 9)
    assert abs(factor.value - right) <= factor.error + 0.02 * right
