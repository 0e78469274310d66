"""Warnings about cameras that see no shape, or are shut in a solid; and the cameras that look the same and are right."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from maquette.compiler.mesh import built_geometry

BALL = 'sphere(1, material: lambert(0.5), name: "ball")\n'
ALONE = "the shape is behind it or outside of its view|their middle is [0, 0, 0]: look_at: [0, 0, 0]"
SUN = "sun()\nsky()\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera([0, 0, 5], look_at: [0, 0, 9])", ALONE),
        ("camera([0, 0, 5], look_at: [9, 0, 5])", ALONE),
        ("camera([0, 0, 5], look_at: [0, 9, 5], up: [0, 0, 1])",
         ALONE),
        ("box(1, center: [0, 4, 0])\ncamera([0, 0, 5], look_at: [0, 0, 9])",
         "all 2 shapes are behind it or outside of its view|their middle is [0, 1.75, 0]: look_at: [0, 1.75, 0]"),
    ],
)  # fmt: skip
def test_a_camera_that_sees_no_shape(said: Callable[..., str], text: str, message: str) -> None:
    shown, hint = message.split("|")
    line = text.splitlines()[-1]
    place = len((BALL + text).splitlines())
    assert said(BALL + text + "\n" + SUN) == (
        f"a.scene:{place}:1: warning: the camera sees no shape: {shown}\n   {place} | {line}\n     | {'^' * len(line)} {hint}"
    )


@pytest.mark.parametrize(
    "text",
    [
        BALL + "camera([0, 0, 5], look_at: [0, 0, 0])",
        BALL + "camera([0, 0, 5], look_at: [3, 0, 0], fov: 20deg)",  # near the edge: a wide picture shows it
        BALL + 'camera([0, 0, 5], look_at: [0, 0, 9], projection: "panoramic")',
        BALL + "plane(y: -1)\ncamera([0, 0, 5], look_at: [0, 0, 9])",
        "sky()\ncamera([0, 0, 5], look_at: [0, 0, 9])",
        "triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]])\ncamera([0, 0, 3], look_at: [0, 0, 0])",
        "heightfield(|x, z| 0.2 * sin(x * 180deg), size: [100, 100])\ncamera([0, 1, 0], look_at: [5, 0.8, 0])",
    ],
)
def test_cameras_that_may_see_something(said: Callable[..., str], text: str) -> None:
    assert "camera" not in said(text + "\n" + SUN)


CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 1 5 8 4\n"""
INSIDE = "camera([0.2, 0.1, 0.3], look_at: [0, 0, 0])\n"


@pytest.mark.parametrize(
    "solid",
    [
        BALL, BALL + "plane(y: -0.5)", 'box(2, name: "ball")', BALL + "sphere(1, center: [9, 0, 0])",
        'implicit(|x, y, z| x^2 + y^2 + z^2 <= 1, name: "ball")', 'mesh("cube.obj", name: "ball")',
    ],
)  # fmt: skip
def test_a_camera_inside_of_a_solid(said: Callable[..., str], tmp_path, solid: str) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    name = "ball/cube" if "mesh" in solid else "ball"
    text = INSIDE + SUN + solid
    line = INSIDE.strip()
    assert said(text) == (
        f"a.scene:1:1: warning: the camera is inside of `{name}`, and nothing else is: the picture shows its inner side alone\n"
        f"   1 | {line}\n     | {'^' * len(line)} move the camera out of it"
    )


@pytest.mark.parametrize(
    "solid",
    [
        BALL + "sphere(0.1)",  # a room with something in it
        BALL + "point([0, 0.5, 0])",  # a room with a lamp
        "box([6, 3, 6], center: [0, 1, 0])\narea(position: [0, 2, 0], look_at: [0, 0, 0], size: 0.5)",
        "sphere(1, material: glass())", "sphere(1, material: lambert(0.5, opacity: 0.5))", "sphere(50, material: emissive(#87b5e0))",
        "sphere(1, center: [3, 0, 0])", "difference { box(2) box(1.9) box([1, 1, 9], center: [0, 0, 4]) }",
        "heightfield(|x, z| -0.5, size: [100, 100])", "cylinder(1, 2, capped: false)", "plane(y: 1)", "plane(a: -2, b: -4, c: -4, d: 10)",
        "quadric([1, 1, -1, 0, 0, 0, 0, 0, 0, -1])",
    ],
)  # fmt: skip
def test_rooms_glass_and_skies_around_a_camera(said: Callable[..., str], solid: str) -> None:
    assert "inside" not in said(INSIDE + SUN + solid)


def test_boxes_that_stand_in_for_solids_shut_no_camera_in(said: Callable[..., str], tmp_path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    with built_geometry.left_out():
        assert "inside" not in said(INSIDE + SUN + 'difference { box(6) mesh("cube.obj") box([1, 1, 9], center: [0, 0, 4]) }')
        assert "inside of `sphere`" in said(INSIDE + SUN + "sphere(1)")
