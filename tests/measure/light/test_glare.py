"""The unified glare rating against its formula, with lamps of known solid angles in an integrating sphere of known background."""

from __future__ import annotations

import math

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics
from maquette.measure.light import glare, illuminance
from maquette.measure.light.replicates import Effort

RHO, RADIUS, LAMP, LUMINANCE = 0.5, 5.0, 0.1, 20000.0


def rate(text: str) -> tuple[glare.Rating, list[str]]:
    scene = maquette.load_text(text, diagnostics=Diagnostics())
    rating, told = glare.rate(scene, ir.Settings(), Effort())
    return rating, [d.message for d in told]


def lamp(x: float, y: float, z: float) -> str:
    return f'translate([{x}, {y}, {z}]) {{ sphere({LAMP}, material: emissive(#ffffff, luminance: {LUMINANCE}nit), name: "lamp") }}\n'


def room(*lamps: tuple[float, float, float]) -> str:
    shown = "".join(lamp(*place) for place in lamps)
    return f"sphere({RADIUS}, material: lambert({RHO}))\ncamera([0, 0, 0], look_at: [0, 0, -1])\n{shown}"


def guth(x: float, y: float, z: float) -> float:
    """Above the line of sight, by its two angles in degrees."""
    a, b = math.degrees(math.atan2(abs(x), y)), math.degrees(math.acos(-z / math.hypot(x, y, z)))
    return math.exp((35.2 - 0.31889 * a - 1.22 * math.exp(-2 * a / 9)) * 1e-3 * b + (21 + 0.26667 * a - 0.002963 * a**2) * 1e-5 * b**2)


def test_two_lamps_by_the_formula() -> None:
    places = [(0.0, 1.5, -3.0), (1.0, 1.0, -3.0)]
    rating, told = rate(room(*places))
    scene = maquette.load_text(room(*places) + "meter(facing: [0, 0, -1])", diagnostics=Diagnostics())
    whole = illuminance.read(scene, scene.meters, Effort(0.003))[0][0].mean
    direct = sum(math.pi * LUMINANCE * LAMP**2 * -z / math.hypot(x, y, z) ** 3 for x, y, z in places)
    background = (whole.value - direct) / math.pi
    assert abs(rating.background.value - background) <= rating.background.error + whole.error / math.pi
    angles = [2 * math.pi * (1 - math.sqrt(1 - (LAMP / math.hypot(*place)) ** 2)) for place in places]
    glaring = sum(LUMINANCE**2 * angle / guth(*place) ** 2 for angle, place in zip(angles, places, strict=True))
    right = 8 * math.log10(0.25 / background * glaring)
    assert rating.ugr is not None
    assert rating.ugr.error < 0.3
    assert abs(rating.ugr.value - right) <= rating.ugr.error + 0.05
    assert [source.solid_angle.value for source in rating.sources] == pytest.approx(angles, rel=5e-3)
    assert told == []


def test_lamps_behind_the_eye_and_hidden_ones_do_not_glare() -> None:
    wall = "box(size: [2, 2, 0.1], center: [0, 1.5, -2])\n"
    rating, _ = rate(room((0.0, 1.0, 3.0), (0.0, 1.5, -3.0)) + wall)
    assert rating.ugr is None
    assert rating.sources == ()
    assert rating.background.value > 0.0


def test_a_point_has_no_luminance() -> None:
    rating, told = rate(room((0.0, 1.5, -3.0)) + 'point([1, 1, -2], flux: 100lm, name: "bulb")')
    assert len(rating.sources) == 1
    assert told == ["bulb is a point, which has no luminance: the glare rating leaves it out"]


def test_without_light_there_is_no_rating() -> None:
    rating, _ = rate("sphere(5, material: lambert(0.5))\ncamera([0, 0, 0], look_at: [0, 0, -1])\npoint([0, 1, 0], intensity: 0)")
    assert rating.ugr is None
    assert rating.background.value == 0.0


def test_a_panorama_has_no_rating() -> None:
    with pytest.raises(ValueError, match="a glare rating is that of an eye: the camera must be a perspective one"):
        rate('sphere(1)\ncamera([0, 0, 5], projection: "panoramic")')


def test_the_position_index_on_the_line_of_sight_is_one() -> None:
    zero = np.zeros(1)
    assert glare.position_index(zero, zero, zero + 1.0) == pytest.approx(1.0)
    assert np.isinf(glare.position_index(zero, zero, zero - 1.0))
    assert glare.position_index(zero, zero - 0.5, zero + 1.0) == pytest.approx(1.4)
