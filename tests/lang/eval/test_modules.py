"""`use`: files as parts, their members and params, the prelude, assets, cycles, and chains of calls in messages."""

from __future__ import annotations

import pytest
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.eval import evaluator

from .evaluating import Files, elements, good, run

GEAR = """unit mm
param teeth: int = 18 in 6..60
let rim(n) = cylinder(n, 8)
let tint = #ff0000
rim(teeth)
point([0, 10, 0])
camera([0, 0, 5])
render(samples: 4)
"""


def test_a_file_is_a_part_with_its_params_as_arguments() -> None:
    first, second = elements('use "gear.scene"\ngear()\ngear(teeth: 24, translate: [1, 0, 0], material: mirror())', {"gear.scene": GEAR})
    assert first.kind == second.kind == "group"
    assert [e.kind for e in first.children] == ["cylinder", "point"]
    assert first.children[0].args["radius"] == 0.018
    assert second.children[0].args["radius"] == 0.024
    assert second.args["translate"] == (1.0, 0.0, 0.0)
    assert second.args["material"].kind == "mirror"


def test_cameras_and_settings_of_a_used_file_are_ignored() -> None:
    document = good('use "gear.scene"\ngear()', {"gear.scene": GEAR})
    assert document.cameras == ()
    assert document.settings == {}
    assert document.params == ()


def test_members_of_a_file() -> None:
    rim, sphere = elements('use "gear.scene" as g\ng.rim(5)\nsphere(g.teeth, material: lambert(g.tint))', {"gear.scene": GEAR})
    assert rim.args["radius"] == 5.0  # a bare length is in the unit of the file that calls
    assert rim.scope == "g.rim"
    assert sphere.args["radius"] == 18.0  # bare, so in the unit of the file that uses it as a length


def test_scopes_of_elements_in_used_files() -> None:
    (group,) = elements('use "gear.scene"\ngear()', {"gear.scene": GEAR})
    rim = group.children[0]
    assert rim.scope == "gear.rim"
    assert [(name, str(span)) for name, span in rim.trace] == [("rim", "gear.scene:5:1"), ("gear", "a.scene:2:1")]


def test_children_given_to_a_file() -> None:
    frame = "transform(translate: [0, 1, 0]) { children }"
    (group,) = elements('use "frame.scene"\nframe() { sphere(3) }', {"frame.scene": frame})
    assert group.children[0].children[0].kind == "sphere"


def test_a_file_is_read_once_however_often_it_is_used() -> None:
    files = Files({"a/x.scene": 'use "c.scene"\nc()', "b/x.scene": 'use "c.scene"\nc()', "c.scene": "sphere()"})
    diagnostics = Diagnostics()
    text = 'use "a/x.scene" as a\nuse "b/x.scene" as b\na()\nb()'
    document = evaluator.evaluate(evaluator.Source("m.scene", text, "m.scene"), CATALOGUE, files, diagnostics)
    assert not diagnostics.items
    assert sorted(document.files) == ["a/x.scene", "b/x.scene", "c.scene", "m.scene"]
    assert document.sources["c.scene"] == "sphere()"
    assert len(document.elements) == 2


def test_a_constant_of_a_file_is_one_element() -> None:
    a, b = elements('use "m.scene"\nsphere(material: m.red)\nbox(material: m.red)', {"m.scene": "let red = lambert(#f00)"})
    assert a.args["material"] is b.args["material"]


def test_assets() -> None:
    uses = 'use "models/robot.usdz" as robot\nuse "bunny.obj"\n'
    robot, bunny = elements(uses + 'robot(prim: "/Arm", translate: [0, 1, 0])\nbunny(height: 3cm)')
    assert (robot.kind, robot.args["file"], robot.args["prim"]) == ("usd", "models/robot.usdz", "/Arm")
    assert (bunny.kind, bunny.args["file"], bunny.args["height"]) == ("mesh", "bunny.obj", 0.03)


def test_nothing_leaks_from_a_used_file() -> None:
    _, messages = run('use "gear.scene"\ngear()\nrim(3)', {"gear.scene": GEAR})
    assert messages == ["a.scene:3:1: error: there is no `rim` here\n   3 | rim(3)\n     | ^^^ let, param or use define a name"]


PRELUDE = {
    "std/prelude": 'use "std/base"\nlet gold = base.shiny(#ffcc66)\nlet sphere2() = sphere(2)',
    "std/base": "let shiny(c) = phong(c)",
}


def test_the_prelude_is_there_without_asking_and_any_name_hides_it() -> None:
    a, b = elements("sphere2()\nlet gold = mirror()\nbox(material: gold)", PRELUDE)
    assert a.args["radius"] == 2.0
    assert b.args["material"].kind == "mirror"
    assert elements("box(material: gold)", PRELUDE)[0].args["material"].kind == "phong"


def test_used_files_see_the_prelude_too() -> None:
    (group,) = elements('use "x.scene"\nx()', PRELUDE | {"x.scene": "box(material: gold)"})
    assert group.children[0].args["material"].kind == "phong"


def test_the_library_is_not_among_the_files_to_watch() -> None:
    assert good("sphere()", PRELUDE).files == ("a.scene",)


def test_an_unused_definition_of_a_library_is_not_evaluated() -> None:
    assert good('use "x.scene"\nx.a()', {"x.scene": "let a() = sphere()\nlet b = 1m + 1s"}).elements


def test_a_cycle_shows_the_chain() -> None:
    files = {"b.scene": 'use "c.scene"\nc()', "c.scene": 'use "b.scene"\nb()'}
    _, messages = run('use "b.scene"\nb()', files)
    assert messages == [
        "c.scene:1:5: error: b.scene uses itself: b.scene → c.scene → b.scene\n"
        '   1 | use "b.scene"\n     |     ^^^^^^^^^\n'
        "  in c.scene, called at b.scene:1:1\n"
        "  in b.scene, called at a.scene:1:1"
    ]


def test_a_file_that_uses_itself() -> None:
    diagnostics = Diagnostics()
    text = 'use "a.scene" as me\nme()'
    evaluator.evaluate(evaluator.Source("a.scene", text, "a.scene"), CATALOGUE, Files({"a.scene": text}), diagnostics)
    assert [d.message for d in diagnostics.items] == ["a.scene uses itself: a.scene → a.scene"]


def test_messages_from_inside_a_part_show_the_calls() -> None:
    files = {"room.scene": "let box(size, wall = #fff) = group { panel(size) }\nlet panel(s) = cylinder(s, height: s * 1s)"}
    _, messages = run('use "room.scene"\nroom.box(2)\nroom.box(2, wal: #000)\nroom.boxx(3)', files)
    assert messages == [
        "room.scene:2:36: error: expected length, got the time 2s\n"
        "   2 | let panel(s) = cylinder(s, height: s * 1s)\n     |                                    ^^^^^^\n"
        "  in panel, called at room.scene:1:38\n"
        "  in room.box, called at a.scene:2:1",
        "a.scene:3:13: error: room.box has no `wal`; did you mean `wall`?\n   3 | room.box(2, wal: #000)\n     |             ^^^",
        "a.scene:4:6: error: room has no `boxx`; did you mean `box`?\n   4 | room.boxx(3)\n     |      ^^^^",
    ]


def test_errors_of_a_used_file_show_how_it_was_reached() -> None:
    _, messages = run('use "x.scene"\nx()', {"x.scene": "sphere(1\nbox(nought)\n"})
    assert messages[0].startswith("x.scene:1:7: error: this `(` is not closed")
    assert all(m.endswith("  in x.scene, called at a.scene:1:1") for m in messages)


def test_params_of_a_file_are_checked_at_the_call() -> None:
    _, messages = run('use "gear.scene"\ngear(teeth: 99)\ngear(teeth: 2.5)\ngear(teth: 9)\ngear(teeth: 1m)', {"gear.scene": GEAR})
    assert messages == [
        "a.scene:2:13: error: `teeth` is 99, outside of 6..60\n   2 | gear(teeth: 99)\n     |             ^^",
        "a.scene:3:13: error: expected whole number, got the bare number 2.5\n   3 | gear(teeth: 2.5)\n     |             ^^^",
        "a.scene:4:6: error: gear has no `teth`; did you mean `teeth`?\n   4 | gear(teth: 9)\n     |      ^^^^",
        "a.scene:5:13: error: expected whole number, got the length 1m\n   5 | gear(teeth: 1m)\n     |             ^^",
    ]


SLIDERS = """param n: int = 5 in 1..9
param tilt = 30deg
param shade = "matte" in ["matte", "gloss"]
sphere(n)
rotate([0, tilt, 0]) { box(name: shade) }
"""


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("m", "3", "error: the scene has no param `m`\n  it has n, tilt, shade"),
        ("shad", "3", "error: the scene has no param `shad`; did you mean `shade`?\n  it has n, tilt, shade"),
        ("n", "12", "--set n:1:9: error: `n` is 12, outside of 1..9\n   1 | let n = 12\n     |         ^^"),
        (
            "tilt",
            "24",
            "--set tilt:1:12: error: expected angle, got the bare number 24\n"
            "   1 | let tilt = 24\n     |            ^^ write 24deg",
        ),
        ("n", "nought",
         "--set n:1:9: error: there is no `nought` here\n   1 | let n = nought\n     |         ^^^^^^ let, param or use define a name"),
        ("n", "1; cone()", "--set n:1:9: error: `1; cone()` is not one value\n   1 | let n = 1; cone()\n     |         ^^^^^^^^^"),
        (
            "shade",
            "wet",
            'a.scene:3:15: error: `shade` is one of "matte", "gloss", not "wet"\n'
            '   3 | param shade = "matte" in ["matte", "gloss"]\n     |               ^^^^^^^',
        ),
    ],
)
def test_sets_are_checked(name: str, text: str, message: str) -> None:
    _, messages = run(SLIDERS, sets={name: text})
    assert messages == [message]


def test_a_set_that_cannot_be_parsed_is_a_message_too() -> None:
    _, messages = run(SLIDERS, sets={"n": "2 +"})
    assert len(messages) == 1
    assert messages[0].startswith("--set n:1:")


@pytest.mark.parametrize("path", ["my-gear.scene", "2d.scene", "for.scene"])
def test_a_file_whose_name_cannot_be_a_name_needs_another(path: str) -> None:
    _, messages = run(f'use "{path}"\nsphere()', {path: "sphere()"})
    name = path.removesuffix(".scene")
    line = f'   1 | use "{path}"\n     |     {"^" * (len(path) + 2)} write use "{path}" as …'
    assert messages == [f"a.scene:1:5: error: `{name}` cannot be a name\n{line}"]
    assert elements(f'use "{path}" as part\npart()', {path: "sphere()"})
