"""Lamps inside of opaque solids are said; those that light what the camera sees are not."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.lang.diagnostics import Diagnostics

MESSAGE = "this light is inside of an opaque solid: nothing outside is lit by it"
AROUND = "camera(position: [0, 1, 9], look_at: [0, 0, 0])\nplane(y: -3)\n"
POINT = "point([0.2, 0.1, 0.3], intensity: 3)\n"
SOLIDS = {
    "sphere": "sphere(1)", "box": "box(2)", "cylinder": "cylinder(1, 2)", "cone": "cone(2, 4)", "capsule": "capsule(1, 2)",
    "ellipsoid": "ellipsoid([1, 2, 1])", "formula": "implicit(|x, y, z| x^4 + y^4 + z^4 <= 1, within: sphere(2))",
    "solid": "union { sphere(1); box(1.5) }", "mesh": 'mesh("a.obj")',
}  # fmt: skip
TETRAHEDRON = "v -2 -2 -2\nv 9 -2 -2\nv -2 9 -2\nv -2 -2 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def said(tmp_path: Path, text: str) -> list[tuple[str, int]]:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    (tmp_path / "a.obj").write_text(TETRAHEDRON, encoding="utf-8")
    found = Diagnostics()
    maquette.load(tmp_path / "a.scene", diagnostics=found)
    return [(d.message, d.span.line if d.span else 0) for d in found.items if d.severity == "warning"]


@pytest.mark.parametrize("name", SOLIDS)
def test_a_lamp_in_a_solid_is_said(tmp_path, name):
    assert said(tmp_path, AROUND + SOLIDS[name] + "\n" + POINT) == [(MESSAGE, 4)]


@pytest.mark.parametrize("name", SOLIDS)
def test_a_lamp_beside_a_solid_is_not(tmp_path, name):
    assert said(tmp_path, AROUND + SOLIDS[name] + "\npoint([5, 5, 5], intensity: 3)\n") == []


def test_a_lamp_in_a_turned_and_moved_solid_is_said(tmp_path):
    text = AROUND + "box([0.5, 6, 0.5], rotate: [0, 0, 45deg], translate: [3, 0, 0])\npoint([4.5, -1.5, 0], intensity: 1)\n"
    assert said(tmp_path, text) == [(MESSAGE, 4)]


@pytest.mark.parametrize(
    "text",
    [
        "sphere(1, material: glass())\n" + POINT,
        "sphere(1, material: lambert(opacity: 0.5))\n" + POINT,
        "sphere(1, material: subsurface(#fed, radius: 5cm))\n" + POINT,
        "box(2, material: translucent(#876, transmission: #876))\n" + POINT,
        "sphere(1, material: openpbr(#fed, subsurface_weight: 1))\n" + POINT,
        "sphere(1)\npoint([0, 0, 0], intensity: 3, shadows: false)\n",
        "box(30)\n" + POINT,  # the camera is in the room, too
        "cylinder(1, 2, capped: false)\n" + POINT,
        "torus(2, 0.5)\n" + POINT,
        "sphere(1, material: emissive(3))\n",  # a lamp is not inside of itself
        "disk(1)\n" + POINT,
    ],
)  # fmt: skip
def test_a_lamp_that_lights_something_is_not(tmp_path, text):
    assert said(tmp_path, AROUND + text) == []


def test_an_area_light_in_a_solid_is_said(tmp_path):
    text = AROUND + "sphere(1)\narea([0, 0.2, 0], look_at: [0, -1, 0], size: [0.3, 0.3])\n"
    assert said(tmp_path, text) == [(MESSAGE, 4)]
