"""Mistakes of people who know OpenSCAD, POV-Ray, Blender or three.js: the first message says what to write."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.lang.diagnostics import SceneError, sort_diagnostics

MISTAKES = [
    # OpenSCAD
    ('color("red") sphere(1)', "1:1: a colour belongs to a material | write sphere(…, material: lambert(#c83232))"),
    ("mirror([1, 0, 0]) cube(1)", "1:1: `mirror` of OpenSCAD is written otherwise | write mirrored(…) { cube(…) }"),
    ("resize([1, 2, 3]) sphere(1)", "1:1: `resize` of OpenSCAD is written otherwise | write scale([2, 1, 1]) { sphere(…) }"),
    ("linear_extrude(10) square(2)", "1:1: `linear_extrude` of OpenSCAD is written otherwise | write extrude(profile, height)"),
    ("hull() { sphere(1) }", "1:1: there is no `hull` here | a hull of two balls is capsule(…) or curve([a, b], radius)"),
    ("minkowski() { sphere(1) }", "1:1: there is no `minkowski` here | write offset(radius) { … } to round outwards"),
    ("sphere(r: 1, $fn: 9)",
     "1:14: the language has no `$` | names have no `$`; OpenSCAD's $fn is not needed, as round shapes are drawn round"),
    ("sphere(d: 2)", "1:8: sphere has no `d`; did you mean `radius`? | half of the diameter"),
    ('echo("x")', "1:1: there is no `echo` here | nothing is printed; `maquette inspect` lists the params"),
    ("let a = [for (i = [0:3]) i]", "1:10: `for` is a keyword, not a value | write [f(k) for k in 0..5]"),
    ("function sq(x) = x * x\nsphere(sq(1))", "1:1: the language has no `function` | write let name(…) = …"),
    ("module leg(h) { box(h) }\nleg(1)", "1:1: the language has no `module` | write let name(…) = group { … }"),
    ("r = 10\nsphere(r)", "1:1: a name is bound with `let` | write let r = …"),
    ("let r = 1\nr = r + 1\nsphere(r)", "2:1: `r` is bound once, with `let`, and keeps its value | write let r2 = … for another value"),
    ("r = r + 1", "1:1: `r` is bound once, with `let`, and keeps its value | write let r2 = … for another value"),
    ("param r = 1\nr = 2\nsphere(r)", "2:1: `r` is bound once, with `let`, and keeps its value | write let r2 = … for another value"),
    ("sphere(rands(0, 1, 3))",
     "1:8: there is no `rands` here | noise(x, y, z, seed) is the same each time, and 0 where x, y and z are whole"),
    ("scale(2, 1, 1) { sphere(1) }", "1:10: scale takes 1 argument by position | write scale([x, y, z])"),
    ("rotate(y: 45deg) { sphere(1) }",
     "1:8: rotate has no `y`; did you mean `by`? | three in a list: translate([x, y, z]), rotate([0, 45deg, 0])"),
    # POV-Ray
    ("#declare R = 2;", "1:1: the language has no `#declare` | write let name = …"),
    ('#include "colors.inc"', '1:1: the language has no `#include` | write use "parts.scene" for a file of scenes'),
    ("#while (i < 5)", "1:1: the language has no `#while` | write for (k in 0..5) { … }"),
    ("#end", "1:1: the language has no `#end` | a block ends with `}`"),
    ("sphere(1, material: lambert(rgb <1, 0, 0>))", "1:33: arguments are written in parentheses | write rgb(…, …, …)"),
    ("camera { fov }", "1:1: `camera` takes nothing in braces | write camera(position: [0, 1, 5], look_at: [0, 1, 0])"),
    # Blender
    ('camera(position: [0, 1, 5], lens: 50mm)', "1:29: camera has no `lens`; did you mean `focal`? | a length: 50mm"),
    ("camera(position: [0, 1, 5], f_stop: 2.8)", "1:29: camera has no `f_stop`; did you mean `aperture`?"),
    ("camera(position: [0, 1, 5], rotation: [60deg, 0, 0])",
     "1:29: camera has no `rotation`; did you mean `look_at`? | a camera is turned by the point it looks at"),
    ('render(engine: "cycles")', "1:8: render has no `engine`; did you mean `backend`?"),
    ('render(samples: "128")', '1:17: expected whole number, got the string "128" | write 128 without quotes'),
    ('hdri("sky.hdr")', '1:1: there is no `hdri` here | write dome("…") for a picture, sky() for a colour'),
    ("lamp([0, 3, 0])",
     "1:1: there is no `lamp` here | lights are point, spot, directional, sun, sky, dome, area and ambient"),
    ("area_light([0, 3, 0])", "1:1: there is no `area_light` here | write area(position: …, look_at: …, size: 1)"),
    ("suzanne()", '1:1: there is no `suzanne` here | write mesh("…") with a file of it'),
    ("sphere(1, material: principled(transmission: 1))",
     "1:32: principled has no `transmission`; did you mean `opacity`? | clear solids are made of glass(…)"),
    # three.js, and other languages
    ("PerspectiveCamera(75)", "1:1: there is no `PerspectiveCamera` here | write camera(position: …, look_at: …, fov: 50deg)"),
    ("sphere(1, material: MeshStandardMaterial())", "1:21: there is no `MeshStandardMaterial` here | write principled(…)"),
    ("scene.add(1)", "1:1: there is no `scene` here | an element is placed by writing it: sphere(1, material: …)"),
    ("sphere(1, material: lambert(0xff8000))", "1:29: `0xff8000` is not a number | write #ff8000 for a colour"),
    ("sphere(1, material: lambert(0x0080ff))", "1:29: `0x0080ff` is not a number | write #0080ff for a colour"),
    ('sphere(1, material: lambert("red"))', '1:29: expected colour, number or texture, got the string "red" | write #ff0000'),
    ('sphere(1, material: lambert("a.png"))',
     '1:29: expected colour, number or texture, got the string "a.png" | write image("a.png")'),
    ("let ball = sphere(1)\nball.center = [0, 1, 0]",
     "2:13: an element is not changed after it is made | write center as an argument, as in sphere(1, center: …)"),
    ("sphere(1).center.set(0)", "1:11: a shape has no `center` | an element is not changed: write its arguments in sphere(…)"),
    ("sphere(1, name: `a`)", '1:17: the language has no backquote | strings are written in double quotes: "…"'),
    ('model("a.glb")', '1:1: there is no `model` here | write mesh("…") or usd("…")'),
    ("sphere(1, material: None)", "1:21: there is no `None` here | leave the argument out"),
    ("-- a comment", "1:1: `--` begins no comment | write `//`"),
    ("BOX(1)", "1:1: there is no `BOX` here; did you mean `box`?"),
]  # fmt: skip


@pytest.mark.parametrize(("source", "expected"), MISTAKES)
def test_the_first_message_says_what_to_write(tmp_path: Path, source: str, expected: str) -> None:
    (tmp_path / "a.scene").write_text(source + "\n", encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        maquette.load(tmp_path / "a.scene")
    first = sort_diagnostics(caught.value.diagnostics)[0]
    assert first.span is not None
    assert f"{first.span.line}:{first.span.column}: {first.message}{' | ' if first.hint else ''}{first.hint}" == expected


@pytest.mark.parametrize("source", [source for source, _ in MISTAKES if "\n" in source])
def test_what_a_wrong_item_names_is_not_reported_again(tmp_path: Path, source: str) -> None:
    (tmp_path / "a.scene").write_text(source + "\n", encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        maquette.load(tmp_path / "a.scene")
    assert len({d.span.line for d in caught.value.diagnostics if d.span}) == 1
