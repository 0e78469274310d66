"""The default bounces of a camera in an enclosed space."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner

WHITE = "material: lambert(0.8)"
LAMP = "area([0, 0.9, 0], look_at: [0, 0, 0], size: [0.3, 0.3], luminance: 10)\n"
INSIDE = "camera(position: [0, 0, 0.8], look_at: [0, 0, 0], fov: 60deg)\n"
AWAY = "camera(position: [0, 0, 40], look_at: [0, 0, 0], fov: 10deg)\n"


def walls(*sides: str, material: str = WHITE) -> str:
    """Some sides of a room of 2 m as boards."""
    boards = {
        "floor": "[2.2, 0.1, 2.2], center: [0, -1.05, 0]", "ceiling": "[2.2, 0.1, 2.2], center: [0, 1.05, 0]",
        "back": "[2.2, 2.2, 0.1], center: [0, 0, -1.05]", "front": "[2.2, 2.2, 0.1], center: [0, 0, 1.05]",
        "left": "[0.1, 2.2, 2.2], center: [-1.05, 0, 0]", "right": "[0.1, 2.2, 2.2], center: [1.05, 0, 0]",
    }  # fmt: skip
    return "".join(f"box({boards[side]}, {material})\n" for side in sides)


ALL = ("floor", "ceiling", "back", "front", "left", "right")
SOLID_ROOM = f"difference({WHITE}) {{ box(2.4); box(2) }}\n"


def planned(tmp_path: Path, text: str, **settings: object) -> planner.Plan:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    return planner.make_plan(maquette.load(tmp_path / "a.scene"), ir.Settings(**settings))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "bounces"),
    [
        (f"box(2, {WHITE})\n" + LAMP + INSIDE, 20),
        (f"sphere(1, {WHITE})\n" + LAMP + INSIDE, 20),
        (walls(*ALL) + LAMP + INSIDE, 20),
        (walls(*ALL[:3], *ALL[4:]) + LAMP + INSIDE.replace("0.8", "0.1"), 20),  # an open box, from its middle
        (SOLID_ROOM + LAMP + INSIDE, 20),
        ("box(2, material: lambert(0.3))\n" + LAMP + INSIDE, 8),  # dark walls: the least
        ("box(2, material: lambert(1))\n" + LAMP + INSIDE, 64),
        (f"box(2, {WHITE})\n" + INSIDE, 20),  # a closed room without a lamp
        (walls(*ALL[1:]) + walls("floor", material="material: glass()") + LAMP + INSIDE.replace("0.8", "0.1"), 20),  # a glass floor
        ("box(2, material: emissive(#ffffff, luminance: 1))\n" + INSIDE, 0),
        ("box(2, material: mirror())\nsphere(0.1, material: lambert(0.8))\n" + LAMP + INSIDE, 8),  # by the mirrors alone
        ("box(2, material: glass())\nsphere(0.1, material: lambert(0.8))\n" + LAMP + INSIDE, 8),
        (f"box(2, {WHITE})\n" + LAMP + AWAY, 0),
        (walls("floor", "back", "left", "right", "ceiling") + LAMP + AWAY, 0),  # from outside, looking in
        (f"box(0.1, {WHITE})\nplane(y: -1, {WHITE})\n" + LAMP + INSIDE, 0),
        (f"torus(radius: 3, tube: 0.2, center: [0, 1, 0], {WHITE})\nplane(y: -1, {WHITE})\n" + LAMP + INSIDE, 0),
        (f"cylinder(radius: 2, height: 2, {WHITE})\n" + LAMP + INSIDE, 20),
        (walls("floor", "back", "left") + LAMP + INSIDE, 0),
        (f"box(2, {WHITE})\nambient(#101010)\n" + LAMP + INSIDE, 0),
    ],
    ids=[
        "box", "ball", "six walls", "open box", "solid", "dark walls", "white walls", "no lamp", "glass floor", "emissive walls", "mirrors",
        "glass", "far away", "looking in", "outdoors", "ring", "drum", "corner", "ambient light",
    ],
)  # fmt: skip
def test_bounces_of_spaces(tmp_path: Path, text: str, bounces: int) -> None:
    plan = planned(tmp_path, text)
    assert plan["bounces"] == bounces
    assert plan["interreflection"] == (plan["enclosed_bounces"] > 0)
    assert plan["interreflection"] == (bounces > 0 and "mirror" not in text and "material: glass())\nsphere" not in text)


@pytest.mark.parametrize("bounces", [0, 3])
def test_bounces_that_are_asked_for_hold(tmp_path: Path, bounces: int) -> None:
    text = f"box(2, {WHITE})\n" + LAMP + INSIDE
    for plan in (planned(tmp_path, text, bounces=bounces), planned(tmp_path, text + f"render(bounces: {bounces})\n")):
        assert (plan["bounces"], plan["interreflection"]) == (bounces, bounces > 0)
        assert plan.decisions["enclosed_bounces"].reason == "a number of bounces was asked for"


def test_the_reasons(tmp_path: Path) -> None:
    text = f"box(2, {WHITE})\n" + LAMP
    found = planned(tmp_path, text + INSIDE).decisions
    walls = "the camera stands in an enclosed space: 100 % of all directions around it have a wall, and these reflect 80 % of the light"
    assert found["bounces"].reason == walls
    assert found["interreflection"].reason == "the camera stands in an enclosed space: diffuse surfaces light each other"
    open_air = planned(tmp_path, text + AWAY).decisions["enclosed_bounces"].reason
    assert open_air == "the camera stands in the open: 100 % of all directions around it have no wall"
    raster = planned(tmp_path, text + INSIDE, backend="raster").decisions["enclosed_bounces"]
    assert (raster.value, raster.reason) == (0, "the raster backend draws no light that bounces unless it is asked for")
