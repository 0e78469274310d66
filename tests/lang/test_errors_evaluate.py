"""Mistakes of meaning as people see them: each source with its whole messages."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from .evaluating import run

# A source, a line `-----`, its messages; `=====` between cases.
CASES = r'''
spot([0, 1, 2], cone: 24)
-----
a.scene:1:23: error: angle wanted, got the bare number 24
   1 | spot([0, 1, 2], cone: 24)
     |                       ^^ write 24deg or 24rad
=====
spher(1)
-----
a.scene:1:1: error: there is no `spher` here; did you mean `sphere`?
   1 | spher(1)
     | ^^^^^
=====
sphere(radus: 1, center: [0, 1])
-----
a.scene:1:8: error: sphere has no `radus`; did you mean `radius`?
   1 | sphere(radus: 1, center: [0, 1])
     |        ^^^^^
a.scene:1:26: error: list of three lengths wanted, got a list of 2
   1 | sphere(radus: 1, center: [0, 1])
     |                          ^^^^^^
=====
sphere(1, material: #d0402a)
-----
a.scene:1:21: error: material wanted, got the colour #d0402a
   1 | sphere(1, material: #d0402a)
     |                     ^^^^^^^ write lambert(…) round it
=====
sphere(1, material: lambert([1, 0, 0]))
-----
a.scene:1:29: error: colour, number or texture wanted, got a list of 3
   1 | sphere(1, material: lambert([1, 0, 0]))
     |                             ^^^^^^^^^ write rgb(r, g, b) for linear values, srgb(r, g, b) or #rrggbb
=====
lambert(0.5)
sphere(material: lambert("red"))
-----
a.scene:1:1: error: a material cannot be placed by itself
   1 | lambert(0.5)
     | ^^^^^^^^^^^^ give it to something, as in sphere(material: …), or name it with `let`
a.scene:2:26: error: colour, number or texture wanted, got the string "red"
   2 | sphere(material: lambert("red"))
     |                          ^^^^^ write #rrggbb
=====
sphere
-----
a.scene:1:1: error: `sphere` is not called
   1 | sphere
     | ^^^^^^ write sphere()
=====
box(size: [1, 2])
-----
a.scene:1:11: error: length, or list of three wanted, got a list of 2
   1 | box(size: [1, 2])
     |           ^^^^^^
=====
box(size: [1, 2s, -3])
-----
a.scene:1:15: error: length wanted, got the time 2s
   1 | box(size: [1, 2s, -3])
     |               ^^
=====
sphere(-1m)
-----
a.scene:1:8: error: `radius` must be more than 0, got -1m
   1 | sphere(-1m)
     |        ^^^
=====
camera([0, 0, 5], fov: 200deg)
-----
a.scene:1:24: error: `fov` must be at most 179.9deg, got 200deg
   1 | camera([0, 0, 5], fov: 200deg)
     |                        ^^^^^^
=====
camera([0, 0, 5], fov: 40deg, focal: 50mm)
-----
a.scene:1:31: error: `fov` and `focal` of camera exclude each other
   1 | camera([0, 0, 5], fov: 40deg, focal: 50mm)
     |                               ^^^^^ give one of them
=====
camera()
-----
a.scene:1:1: error: camera needs `position`
   1 | camera()
     | ^^^^^^
=====
group { camera([0, 0, 5]) }
-----
a.scene:1:9: error: `camera` stands at the top level of a scene, not in a block
   1 | group { camera([0, 0, 5]) }
     |         ^^^^^^^^^^^^^^^^^
=====
render(samples: 4)
render(samples: 8)
-----
a.scene:2:1: error: `render` stands twice in this scene
   2 | render(samples: 8)
     | ^^^^^^^^^^^^^^^^^^ the first is in line 1
=====
let room() = group { render(samples: 4) }
room()
-----
a.scene:1:22: error: `render` stands at the top level of a scene, not in a block
   1 | let room() = group { render(samples: 4) }
     |                      ^^^^^^^^^^^^^^^^^^
  in room, called at a.scene:2:1
=====
implicit(|x, y, z| x)
-----
a.scene:1:1: error: `implicit` is not built yet
   1 | implicit(|x, y, z| x)
     | ^^^^^^^^
=====
camera([0, 0, 5], aperture: 2.8)
-----
a.scene:1:19: error: `aperture` of camera is not built yet
   1 | camera([0, 0, 5], aperture: 2.8)
     |                   ^^^^^^^^
=====
render(backend: "rya")
-----
a.scene:1:17: error: `backend` is one of "auto", "ray", "raster", "reference", not "rya"; did you mean "ray"?
   1 | render(backend: "rya")
     |                 ^^^^^
=====
render(size: [800, 600.5])
-----
a.scene:1:20: error: whole number from 1 wanted, got the bare number 600.5
   1 | render(size: [800, 600.5])
     |                    ^^^^^
=====
let a = 1
let a = 2
sphere(a)
-----
a.scene:2:5: error: `a` is defined twice
   2 | let a = 2
     |     ^ the first is in line 1
=====
let a = b
let b = c + 1
let c = a
sphere(a)
-----
a.scene:3:9: error: `a` is defined by itself: a → b → c → a
   3 | let c = a
     |         ^
=====
let wheel(r, width = r / 2) = cylinder(r, width)
wheel()
wheel(1, 2, 3)
wheel(1, withd: 2)
wheel(1, r: 2)
-----
a.scene:2:1: error: wheel needs `r`
   2 | wheel()
     | ^^^^^
a.scene:3:13: error: wheel takes 2 arguments by position
   3 | wheel(1, 2, 3)
     |             ^ by name it takes translate, rotate, scale, material, name
a.scene:4:10: error: wheel has no `withd`; did you mean `width`?
   4 | wheel(1, withd: 2)
     |          ^^^^^
a.scene:5:10: error: wheel gets `r` twice
   5 | wheel(1, r: 2)
     |          ^
=====
let half(x) = x / 2
half(3)
sphere(half(1s))
sphere(half(2, material: mirror()))
-----
a.scene:2:1: error: half gives a number, which cannot be placed
   2 | half(3)
     | ^^^^^^^ name it with `let` to use it
a.scene:3:8: error: length wanted, got the time 0.5s
   3 | sphere(half(1s))
     |        ^^^^^^^^
a.scene:4:16: error: half has no `material`
   4 | sphere(half(2, material: mirror()))
     |                ^^^^^^^^ it makes no shape
=====
let wheel(r) = cylinder(r, height: 2s)
let car() = group { wheel(1) }
car()
-----
a.scene:1:36: error: length wanted, got the time 2s
   1 | let wheel(r) = cylinder(r, height: 2s)
     |                                    ^^
  in wheel, called at a.scene:2:21
  in car, called at a.scene:3:1
=====
let points = [[0, 0, 0], [1, 0, 0]]
sphere(center: points[2])
sphere(center: points[-1])
sphere(center: points[0.5])
sphere(center: points.x)
-----
a.scene:2:23: error: there is no item 2 in a list of 2
   2 | sphere(center: points[2])
     |                       ^ items count from 0; the last is [1]
a.scene:3:23: error: there is no item -1 in a list of 2
   3 | sphere(center: points[-1])
     |                       ^^ items count from 0; the last is [1]
a.scene:4:23: error: whole number wanted, got the bare number 0.5
   4 | sphere(center: points[0.5])
     |                       ^^^
a.scene:5:23: error: a list has no `x`
   5 | sphere(center: points.x)
     |                       ^ write [0]
=====
for (k in 5) { sphere(k) }
-----
a.scene:1:11: error: `for` runs over a list or a range, not over a number
   1 | for (k in 5) { sphere(k) }
     |           ^
=====
if (1) { sphere(1) }
-----
a.scene:1:5: error: `if` wants true or false, got a number
   1 | if (1) { sphere(1) }
     |     ^
=====
sphere(1) { box(1) }
-----
a.scene:1:1: error: `sphere` takes nothing in braces
   1 | sphere(1) { box(1) }
     | ^^^^^^
=====
sphere(1)
let unused = 3
-----
a.scene:2:5: warning: `unused` is never used
   2 | let unused = 3
     |     ^^^^^^
=====
param n: int = 2.5
sphere(n)
-----
a.scene:1:16: error: whole number wanted, got the bare number 2.5
   1 | param n: int = 2.5
     |                ^^^
=====
param n = 5 in 6..10
sphere(n)
-----
a.scene:1:11: error: `n` is 5, outside of 6..10
   1 | param n = 5 in 6..10
     |           ^
=====
param n: intt = 5
sphere(n)
-----
a.scene:1:10: error: there is no type `intt`; did you mean `int`?
   1 | param n: intt = 5
     |          ^^^^
=====
param shade = "matte" in ["matte", "gloss"]
sphere(name: shde)
-----
a.scene:2:14: error: there is no `shde` here; did you mean `shade`?
   2 | sphere(name: shde)
     |              ^^^^
=====
unit deg
sphere(1)
-----
a.scene:1:6: error: unit of length wanted, got `deg`
   1 | unit deg
     |      ^^^ one of cm, ft, in, km, m, mm, nm, um
=====
unit mm
unit cm
sphere(1)
-----
a.scene:2:1: error: `unit` stands twice in this file
   2 | unit cm
     | ^^^^^^^ the first is in line 1
=====
group {
  unit mm
  param a = 1
  use "std/room"
}
-----
a.scene:2:3: error: `unit` stands at the top level of a file, not in a block
   2 |   unit mm
     |   ^^^^^^^
a.scene:3:3: error: `param` stands at the top level of a file, not in a block
   3 |   param a = 1
     |   ^^^^^^^^^^^
a.scene:4:3: error: `use` stands at the top level of a file, not in a block
   4 |   use "std/room"
     |   ^^^^^^^^^^^^^^
=====
let true = 1
-----
a.scene:1:5: error: `true` cannot be a name
   1 | let true = 1
     |     ^^^^ the language has it
=====
sphere(1m + 1s)
-----
a.scene:1:8: error: cannot add a length and a time
   1 | sphere(1m + 1s)
     |        ^^^^^^^
=====
transform(rotate: 30deg) { sphere() }
-----
a.scene:1:19: error: three angles, axis(v, angle) or quaternion(x, y, z, w) wanted, got the angle 30deg
   1 | transform(rotate: 30deg) { sphere() }
     |                   ^^^^^ about which axis? write [0, 30deg, 0] to turn about y
=====
transform(rotate: [0, 30, 0]) { sphere() }
-----
a.scene:1:23: error: angle wanted, got the bare number 30
   1 | transform(rotate: [0, 30, 0]) { sphere() }
     |                       ^^ write 30deg or 30rad
=====
transform(scale: 0) { sphere() }
-----
a.scene:1:18: error: `scale` by 0 leaves nothing
   1 | transform(scale: 0) { sphere() }
     |                  ^
=====
plane(normal: [0, 0, 0])
-----
a.scene:1:15: error: `normal` must have a direction, got [0, 0, 0]
   1 | plane(normal: [0, 0, 0])
     |               ^^^^^^^^^
=====
transform(matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1]]) { sphere() }
-----
a.scene:1:48: error: row of four numbers wanted, got a list of 3
   1 | transform(matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1]]) { sphere() }
     |                                                ^^^^^^^^^
=====
mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1]], faces: [[0, 1, -2]])
-----
a.scene:1:37: error: list of three lengths wanted, got a list of 2
   1 | mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1]], faces: [[0, 1, -2]])
     |                                     ^^^^^^
a.scene:1:61: error: whole number from 0 wanted, got the bare number -2
   1 | mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1]], faces: [[0, 1, -2]])
     |                                                             ^^
=====
let f(x) = if x then 1 else 2
sphere(f(3))
-----
a.scene:1:15: error: `if` wants true or false, got a number
   1 | let f(x) = if x then 1 else 2
     |               ^
  in f, called at a.scene:2:8
=====
sphere(radius: 3mmm, center: [0, nought, 0])
-----
a.scene:1:16: error: unknown unit `mmm`
   1 | sphere(radius: 3mmm, center: [0, nought, 0])
     |                ^^^^ did you mean `mm`?
a.scene:1:34: error: there is no `nought` here
   1 | sphere(radius: 3mmm, center: [0, nought, 0])
     |                                  ^^^^^^
=====
sphere(1, name: 5)
plane(y: "0")
-----
a.scene:1:17: error: string wanted, got the bare number 5
   1 | sphere(1, name: 5)
     |                 ^
a.scene:2:10: error: length wanted, got the string "0"
   2 | plane(y: "0")
     |          ^^^
=====
sky(luminance: 3000lx)
-----
a.scene:1:16: error: luminance wanted, got the illuminance 3000lx
   1 | sky(luminance: 3000lx)
     |                ^^^^^^
=====
sky(color: [1, 1, 1])
sky(color: "#fff")
sky(color: 0.5)
-----
a.scene:1:12: error: colour wanted, got a list of 3
   1 | sky(color: [1, 1, 1])
     |            ^^^^^^^^^ write rgb(r, g, b) for linear values, srgb(r, g, b) or #rrggbb
a.scene:2:12: error: colour wanted, got the string "#fff"
   2 | sky(color: "#fff")
     |            ^^^^^^ write #rrggbb without quotes
a.scene:3:12: error: colour wanted, got the bare number 0.5
   3 | sky(color: 0.5)
     |            ^^^ write rgb(0.5, 0.5, 0.5)
=====
image("a.png")
-----
a.scene:1:1: error: a texture cannot be placed by itself
   1 | image("a.png")
     | ^^^^^^^^^^^^^^ give it to something, as in lambert(…), or name it with `let`
=====
3(4)
-----
a.scene:1:1: error: only functions and parts are called, not the bare number 3
   1 | 3(4)
     | ^
=====
sphere(radius: sphere)
-----
a.scene:1:16: error: length wanted, got `sphere` itself
   1 | sphere(radius: sphere)
     |                ^^^^^^
=====
sphere(radius: sphere(1))
-----
a.scene:1:16: error: length wanted, got the shape `sphere`
   1 | sphere(radius: sphere(1))
     |                ^^^^^^^^^
=====
let ring(n) = group { for (k in 0..n) { sphere(0.1, centre: [k, 0, 0]) } }
ring(20)
-----
a.scene:1:53: error: sphere has no `centre`; did you mean `center`?
   1 | let ring(n) = group { for (k in 0..n) { sphere(0.1, centre: [k, 0, 0]) } }
     |                                                     ^^^^^^
  in ring, called at a.scene:2:1
=====
sphere(foo: 1, 2, 3, radius: 4)
-----
a.scene:1:8: error: sphere has no `foo`
   1 | sphere(foo: 1, 2, 3, radius: 4)
     |        ^^^ it takes radius, center, material, name, translate, rotate, scale
a.scene:1:19: error: list of three lengths wanted, got the bare number 3
   1 | sphere(foo: 1, 2, 3, radius: 4)
     |                   ^
a.scene:1:22: error: sphere gets `radius` twice
   1 | sphere(foo: 1, 2, 3, radius: 4)
     |                      ^^^^^^
=====
cylinder(radius: true, capped: 1)
-----
a.scene:1:18: error: length wanted, got true
   1 | cylinder(radius: true, capped: 1)
     |                  ^^^^
a.scene:1:32: error: true or false wanted, got the bare number 1
   1 | cylinder(radius: true, capped: 1)
     |                                ^
=====
checker(#fff, #000)
sphere(material: lambert(checker(#fff, #000, size: 0)))
-----
a.scene:1:1: error: a texture cannot be placed by itself
   1 | checker(#fff, #000)
     | ^^^^^^^^^^^^^^^^^^^ give it to something, as in lambert(…), or name it with `let`
a.scene:2:52: error: `size` must be more than 0, got 0
   2 | sphere(material: lambert(checker(#fff, #000, size: 0)))
     |                                                    ^
=====
phong(#fff, k_d: #000)
sphere(material: phong(#fff, k_d: #000))
-----
a.scene:1:13: error: phong gets `color` twice
   1 | phong(#fff, k_d: #000)
     |             ^^^ `k_d` is another name of it
a.scene:2:30: error: phong gets `color` twice
   2 | sphere(material: phong(#fff, k_d: #000))
     |                              ^^^ `k_d` is another name of it
=====
point([0, 1, 0], falloff: [0, 0, 0])
-----
a.scene:1:27: error: a fall-off has no negative numbers and one above 0
   1 | point([0, 1, 0], falloff: [0, 0, 0])
     |                           ^^^^^^^^^
=====
let x = children
sphere(1)
-----
a.scene:1:5: warning: `x` is never used
   1 | let x = children
     |     ^
=====
let part() = group { sphere(1) }
part() { box() }
part { box() }
-----
a.scene:2:1: error: `part` takes nothing in braces
   2 | part() { box() }
     | ^^^^
a.scene:3:1: error: `part` takes nothing in braces
   3 | part { box() }
     | ^^^^
=====
render(bounces: 2.5, samples: 0, budget: 20)
-----
a.scene:1:17: error: whole number wanted, got the bare number 2.5
   1 | render(bounces: 2.5, samples: 0, budget: 20)
     |                 ^^^
a.scene:1:31: error: `samples` must be 1 or more, got 0
   1 | render(bounces: 2.5, samples: 0, budget: 20)
     |                               ^
a.scene:1:42: error: time wanted, got the bare number 20
   1 | render(bounces: 2.5, samples: 0, budget: 20)
     |                                          ^^ write 20s
=====
sphere(1, translate: 3)
let v = [1, 2, 3]
sphere(v, center: v + 1)
-----
a.scene:1:22: error: list of three lengths wanted, got the bare number 3
   1 | sphere(1, translate: 3)
     |                      ^
a.scene:3:8: error: length wanted, got a list of 3
   3 | sphere(v, center: v + 1)
     |        ^
a.scene:3:19: error: cannot add a list and a number
   3 | sphere(v, center: v + 1)
     |                   ^^^^^
=====
polygon([[0, 0, 0], 5])
-----
a.scene:1:21: error: list of three lengths wanted, got the bare number 5
   1 | polygon([[0, 0, 0], 5])
     |                     ^
=====
use "gear"
sphere(1)
-----
a.scene:1:5: error: cannot use "gear"
   1 | use "gear"
     |     ^^^^^^ write "gear.scene"
=====
use "notes.txt"
sphere(1)
-----
a.scene:1:5: error: cannot use "notes.txt"
   1 | use "notes.txt"
     |     ^^^^^^^^^^^ a file ends with one of .scene .usd .usda .usdc .usdz .obj .ply .stl .glb .gltf
=====
use "std/roof"
roof.box()
-----
a.scene:1:5: error: there is no std/roof
   1 | use "std/roof"
     |     ^^^^^^^^^^ is it spelt so?
=====
let f(a, a) = a
sphere(f(1, 2))
-----
a.scene:1:10: error: `a` is defined twice
   1 | let f(a, a) = a
     |          ^ the first is in line 1
=====
let f(x: length) = sphere(x)
f(2s)
f(30deg, name: "a")
-----
a.scene:2:3: error: length wanted, got the time 2s
   2 | f(2s)
     |   ^^
a.scene:3:3: error: length wanted, got the angle 30deg
   3 | f(30deg, name: "a")
     |   ^^^^^
=====
sphere(1 / 0)
sphere(1m ^ 0.5)
-----
a.scene:1:8: error: division by 0
   1 | sphere(1 / 0)
     |        ^^^^^
a.scene:2:8: error: length wanted, got the quantity 1m^0.5
   2 | sphere(1m ^ 0.5)
     |        ^^^^^^^^
=====
rotate([0, 1m, 0]) { sphere() }
rotate(axis([0, 1, 0], 90)) { sphere() }
-----
a.scene:1:12: error: angle wanted, got the length 1m
   1 | rotate([0, 1m, 0]) { sphere() }
     |            ^^
a.scene:2:24: error: angle wanted, got the bare number 90
   2 | rotate(axis([0, 1, 0], 90)) { sphere() }
     |                        ^^ write 90deg or 90rad
=====
sphere(1, material: mirror)
let red(k = 1) = lambert(#f00)
sphere(1, material: red)
-----
a.scene:1:21: error: material wanted, got `mirror` itself
   1 | sphere(1, material: mirror)
     |                     ^^^^^^ call it: mirror(…)
a.scene:3:21: error: material wanted, got the function `red`
   3 | sphere(1, material: red)
     |                     ^^^ call it: red(…)
=====
transform(matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], scale: 2) { sphere() }
-----
a.scene:1:63: error: `matrix` and `scale` of transform exclude each other
   1 | transform(matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], scale: 2) { sphere() }
     |                                                               ^^^^^ give one of them
'''


def _cases() -> list[tuple[str, str]]:
    pairs = [case.split("-----\n") for case in CASES.lstrip("\n").split("=====\n")]
    return [(source, messages.rstrip("\n")) for source, messages in pairs]


@pytest.mark.parametrize(("source", "expected"), _cases())
def test_messages(source: str, expected: str) -> None:
    _, messages = run(source)
    assert "\n".join(messages) == expected


def test_there_are_many_mistakes() -> None:
    assert len(_cases()) >= 40


WORDS = re.compile(r"\w+|[^\w\s]")


@given(st.data())
def test_a_scene_with_a_word_of_another_in_place_of_its_own_is_a_document_and_messages(data: st.DataObject) -> None:
    source, _ = data.draw(st.sampled_from(_cases()))
    other, _ = data.draw(st.sampled_from(_cases()))
    words = list(WORDS.finditer(source))
    for _ in range(data.draw(st.integers(1, 3))):
        word = data.draw(st.sampled_from(words))
        replacement = data.draw(st.sampled_from(WORDS.findall(other)))
        source = source[: word.start()] + replacement + source[word.end() :]
    document, messages = run(source)
    assert document.name == "a.scene"
    assert all(re.match(r"(--set \w+|\S+)(:\d+:\d+)?: (error|warning): .", m) for m in messages)
