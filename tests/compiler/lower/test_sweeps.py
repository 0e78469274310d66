"""What is said of swept shapes that are impossible, as whole messages."""

from __future__ import annotations

import pytest

REST = "\ncamera([0, 1, 5])\nsun()\n"
NO_ORDER = "write its points in order around the area, none of them twice"


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("revolve([[0, 0], [1, 0]])", "the profile has three points or more, got 2", ""),
        ("revolve([[0, 0]], closed: false)", "the profile has two points or more, got 1", ""),
        ("revolve([[0, 0], [1, 0], [-20cm, 1]])", "point 3 of the profile, [-0.2, 1] m, has a radius below 0",
         "write [radius, y]: a radius is 0 or more"),
        ("revolve([[0, 0], [0, 1], [0, 2]])", "the profile has no area: its points lie on one line",
         "write the corners of an area, one after the other"),
        ("revolve([[0, 0], [0, 1]], closed: false)", "the profile lies on the axis: it has no radius", "write [radius, y]"),
        ("revolve([[0, 0], [1, 1], [1, 0], [0, 1]])", "the profile crosses or touches itself near [0.5, 0.5] m", NO_ORDER),
        ("revolve([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0.5]], kind: \"catmull_rom\")",
         "the curve of the profile crosses the axis near [-0.04339, 0.864] m", "move its points away from the axis"),
        ("revolve([[0, 0], [1, 0], [1, 1], [0, 1]], kind: \"bezier\")", "the profile: a closed Bézier curve has 3, 6, 9, … points, got 4",
         "each piece has a point on the curve and two handles after it"),
        ("extrude([[0, 0], [1, 0]])", "the profile has three points or more, got 2", ""),
        ("extrude([[0, 0], [1, 0], [2, 0]])", "the profile has no area: its points lie on one line",
         "write the corners of an area, one after the other"),
        ("extrude([[0, 0], [1, 1], [1, 0], [0, 1]])", "the profile crosses or touches itself near [0.5, 0.5] m", NO_ORDER),
        ("extrude([[0, 0], [1, 0], [1, 1], [0, 1]], holes: [[[2, 2], [3, 2], [3, 3]]])", "hole 1 lies outside of the outline",
         "keep each hole inside the outline"),
        ("extrude([[0, 0], [1, 0], [1, 1], [0, 1]], holes: [[[2, 2], [3, 2]]])", "hole 1 has three points or more, got 2", ""),
        ("extrude([[0, 0], [1, 0], [1, 1], [0, 1]], taper: [1, 0])", "`taper` is 0 along z alone: the top would be an edge",
         "write taper: 0 for a point, or a number above 0 for each axis"),
        ("extrude([[0, 0], [1, 0], [1, 1], [0, 1]], twist: 99999deg)",
         "this twist takes 14,108,640 triangles: 2,097,152 at the most", "twist it less"),
    ],
)  # fmt: skip
def test_swept_shapes_that_are_impossible(said, text, message, hint):
    found = said(text + REST).splitlines()
    assert found[0] == f"a.scene:1:1: error: {message}"
    assert found[2].endswith(f"^ {hint}" if hint else "^")
    assert len(found) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("revolve([1, 2])", "a.scene:1:10: error: expected list of two lengths, got the bare number 1"),
        ('extrude("star")', 'a.scene:1:9: error: expected list of points [x, y], got the string "star"'),
        ("revolve([[0, 0], [1, 0], [1, 1]], segments: 9)", "a.scene:1:35: error: revolve has no `segments`"),
        ("extrude([[0, 0, 0]])", "a.scene:1:10: error: expected list of two lengths, got a list of 3"),
        ("extrude([[0, 0], [1, 0], [1, 1]], -1)", "a.scene:1:35: error: `height` must be more than 0, got -1m"),
        ("revolve([[0, 0], [1, 0], [1, 1]], 400deg)", "a.scene:1:35: error: `angle` must be at most 360deg, got 400deg"),
        ("extrude([[0, 0], [1, 0], [1, 1]], center: true)", "a.scene:1:35: error: extrude has no `center`; did you mean `centered`?"),
    ],
)
def test_arguments_that_do_not_fit(said, text, message):
    assert said(text + REST).splitlines()[0] == message
