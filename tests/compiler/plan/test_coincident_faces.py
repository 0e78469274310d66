"""Warnings about two faces in one place; and faces that touch, face each other, or are alike, which are right."""

from __future__ import annotations

from collections.abc import Callable

import pytest

VIEW = "let red = lambert(#ff0000)\nlet blue = lambert(#0000ff)\ncamera([3, 4, 5], look_at: [0, 0, 0])\nsun()\n"
HINT = "move one of them by a millimetre, or make a union of them"


@pytest.mark.parametrize(
    ("shapes", "what", "place"),
    [
        ("plane(y: 0, material: red)\ndisk(1, material: blue)", "`plane` and `disk`", "y = 0"),
        ("box(2, material: red)\nbox([1, 2, 1], material: blue)", "`box` and `box`", "y = 1"),
        ('box(2, material: red, name: "a")\nbox(1, center: [1.2, 0, 0.5], material: blue, name: "b")', "`a` and `b`", "z = 1"),
        ("box(2, material: red)\ncylinder(0.5, 2, material: blue)", "`box` and `cylinder`", "y = 1"),
        ("box(2, material: red)\nbox(1, center: [0.5, 0, 0], rotate: [90deg, 0, 0], material: blue)", "`box` and `box`", "x = 1"),
        ("box(2, material: red)\nbox(1, scale: [2, 2, 2], material: blue)", "`box` and `box`", "x = 1"),
    ],
)  # fmt: skip
def test_two_faces_in_one_place(said: Callable[..., str], shapes: str, what: str, place: str) -> None:
    line = shapes.splitlines()[1]
    what = "two shapes `box`" if what == "`box` and `box`" else what
    assert said(VIEW + shapes) == (
        f"a.scene:6:1: warning: {what} have faces in one place, at {place}: which of them is seen is chance\n"
        f"   6 | {line}\n     | {'^' * len(line)} {HINT}"
    )


@pytest.mark.parametrize(
    "shapes",
    [
        "plane(y: 0, material: red)\nbox(1, center: [0, 0.5, 0], material: blue)",  # stands on it
        "box(1, material: red)\nbox(1, center: [1, 0, 0], material: blue)",  # side by side
        "box(1, material: red)\nbox(1, center: [0, 1, 0], material: blue)",  # on top
        "box(2, material: red)\nbox([1, 2, 1], material: red)",  # alike: nothing is seen of it
        "box(2, material: red)\nbox([1, 2, 1], material: glass())",
        "box(2, center: [0, 1, 0], material: red)\nbox([1, 4, 1], center: [0, 2, 0], material: blue)",  # bottoms, seen from above
        "box(2, material: red)\nbox([1, 2, 1], rotate: [0, 30deg, 0], center: [5, 0, 0], material: blue)",
        "box(2, material: red)\ndisk(1, center: [0, 1.0001, 0], material: blue)",
        "cylinder(1, 2, material: red, center: [0.9, 0, 0.9])\ncylinder(1, 2, material: blue, center: [-0.9, 0, -0.9])",
        "for (i in 0..40) { for (k in 0..40) { box(1, center: [i, 0, k], material: if mod(i + k, 2) == 0 then red else blue) } }",
        "difference { box(2, material: red) box([1, 2, 1], material: blue) }",
    ],
)  # fmt: skip
def test_faces_that_are_right(said: Callable[..., str], shapes: str) -> None:
    assert "in one place" not in said(VIEW + shapes)
