"""Arguments of elements: binding by position, name and alias, defaults, and every type of the schema in base units."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang.elements import AxisAngle, Element, Euler, Falloff, Quaternion
from maquette.lang.formula_graph import Formula
from maquette.lang.schema import argument_types

from .evaluating import elements, good, run, unhurried


def one(text: str) -> Element:
    (element,) = elements(text)
    return element


def test_positions_names_and_defaults() -> None:
    by_position = one("cylinder(2, 3, [0, 1, 0])")
    by_name = one("cylinder(center: [0, 1, 0], height: 3, radius: 2)")
    mixed = one("cylinder(center: [0, 1, 0], 2, 3)")
    assert by_position.args == by_name.args == mixed.args
    assert by_position.given == {"radius", "height", "center"}
    assert by_position.args["capped"] is True
    assert by_position.args["material"] is None


def test_every_argument_is_there_whether_given_or_not() -> None:
    for entry in CATALOGUE.values():
        required = any(a.default is argument_types.REQUIRED for a in entry.args)
        if entry.planned or required or entry.category not in ("shape", "light", "block"):
            continue
        element = one(f"{entry.name}()" + (" { sphere(1) }" if entry.category == "block" else ""))
        assert set(element.args) == {a.name for a in entry.args}
        assert element.given == frozenset()
        assert element.kind == entry.name


def test_an_alias_names_its_argument() -> None:
    sun = one("sun(irradiance: 3)")
    assert sun.args["illuminance"] == 3.0
    assert sun.given == {"illuminance"}


@pytest.mark.parametrize("type_name", argument_types.TYPES)
def test_every_type_of_the_schema_refuses_a_light(type_name: str) -> None:
    """A light is no value of any type: each type answers with a diagnostic."""
    entry = argument_types.Entry("probe", "shape", "for tests", (argument_types.Arg("value", type_name, argument_types.REQUIRED),))
    document, found = run("probe(sun())", catalogue={**CATALOGUE, "probe": entry})
    assert not document.elements
    assert len(found) == 1


def test_arguments_have_types_of_the_schema() -> None:
    assert {a.type for e in CATALOGUE.values() for a in e.args} <= set(argument_types.TYPES)


@pytest.fixture
def probe() -> Any:
    """A function that returns the value of an argument of a type for a text, in a file in centimetres."""

    def convert_text(type_name: str, text: str, **limits: Any) -> Any:
        entry = argument_types.Entry(
            "probe", "shape", "for tests", (argument_types.Arg("value", type_name, argument_types.REQUIRED, **limits),)
        )
        (element,) = elements(f"unit cm\nprobe({text})", catalogue={**CATALOGUE, "probe": entry})
        return element.args["value"]

    return convert_text


@pytest.mark.parametrize(
    ("type_name", "text", "expected"),
    [
        ("number", "2.5", 2.5),
        ("number", "50%", 0.5),
        ("int", "3", 3),
        ("bool", "1 < 2", True),
        ("string", '"a"', "a"),
        ("length", "35", 0.35),
        ("length", "2m", 2.0),
        ("angle", "180deg", math.pi),
        ("angle", "0", 0.0),
        ("time", "2min", 120.0),
        ("intensity", "2", 2.0),
        ("intensity", "2kcd", 2000.0),
        ("illuminance", "20lm / (2 * 1m^2)", 10.0),
        ("luminance", "3nit", 3.0),
        ("flux", "800lm", 800.0),
        ("color", "rgb(1, 2, 3)", (1, 2, 3)),
        ("factors", "0.5", (0.5, 0.5, 0.5)),
        ("factors", "rgb(1, 2, 3)", (1, 2, 3)),
        ("number_map", "0.5", 0.5),
        ("color_map", "0.5", (0.5, 0.5, 0.5)),
        ("color_map", "#fff", (1, 1, 1)),
        ("point", "[1, 2m, 3mm]", (0.01, 2.0, 0.003)),
        ("size3", "5", (0.05, 0.05, 0.05)),
        ("size3", "[1, 2, 3]", (0.01, 0.02, 0.03)),
        ("size2", "1m", (1.0, 1.0)),
        ("size2", "[1, 2]", (0.01, 0.02)),
        ("direction", "[1, 0, 2]", (1, 0, 2)),
        ("direction", "[1m, 0, 100]", (1, 0, 1)),
        ("numbers2", "2", (2, 2)),
        ("numbers2", "[2, 3]", (2, 3)),
        ("scale3", "2", (2, 2, 2)),
        ("scale3", "[1, -2, 3]", (1, -2, 3)),
        ("rotation", "[0, 90deg, 0]", Euler((0, math.pi / 2, 0))),
        ("rotation", "axis([0, 2m, 0], 1rad)", AxisAngle((0, 2, 0), 1)),
        ("rotation", "quaternion(0, 1, 0, 0)", Quaternion(0, 1, 0, 0)),
        (
            "matrix",
            "[[1, 0, 0, 5], [0, 1, 0, 2m], [0, 0, 1, 0]]",
            ((1, 0, 0, 0.05), (0, 1, 0, 2), (0, 0, 1, 0), (0, 0, 0, 1)),
        ),
        ("matrix", "matrix([2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0])", ((2, 0, 0, 0), (0, 2, 0, 0), (0, 0, 2, 0), (0, 0, 0, 1))),
        ("numbers", "[1, 2]", (1, 2)),
        ("points", "[[0, 0, 0], [100, 0, 1m]]", ((0, 0, 0), (1, 0, 1))),
        ("point_lists", "[[[100, 0, 0]]]", (((1, 0, 0),),)),
        ("lengths", "50", (0.5,)),
        ("lengths", "[50, 2m]", (0.5, 2)),
        ("heights", '"a.png"', "a.png"),
        ("heights", "[[0, 50], [1m, 2m]]", ((0, 0.5), (1, 2))),
        ("points2", "[[0, 2m], [100, 0]]", ((0, 2), (1, 0))),
        ("point2_lists", "[[[100, 1mm]]]", (((1, 0.001),),)),
        ("vectors3", "[[1, 2, 3]]", ((1, 2, 3),)),
        ("vectors2", "[[1, 2]]", ((1, 2),)),
        ("faces", "[[0, 1, 2], [2, 1, 3, 0]]", ((0, 1, 2), (2, 1, 3, 0))),
        ("falloff", "[1, 0, 2]", Falloff("polynomial", (1, 0, 2))),
        ("falloff", "ramp(50, 2m)", Falloff("ramp", (0.5, 2.0, 0.0))),
        ("pixels", "[640, 480]", (640, 480)),
        ("strings", '["a", "b"]', ("a", "b")),
    ],
)
def test_types(probe: Any, type_name: str, text: str, expected: Any) -> None:
    result = probe(type_name, text)
    assert result == (pytest.approx(expected) if isinstance(expected, float) else expected)
    assert type(result) is type(expected)


def test_types_that_are_elements_and_formulas(probe: Any) -> None:
    assert probe("material", "mirror()").kind == "mirror"
    assert probe("texture", 'image("a.png")').kind == "image"
    assert probe("color_map", "checker()").kind == "checker"
    assert probe("number_map", "checker()").kind == "checker"
    assert isinstance(probe("formula", "|x| x"), Formula)
    assert probe("choice", '"b"', choices=("a", "b")) == "b"


def test_limits_of_an_argument_are_its_own(probe: Any) -> None:
    assert probe("number", "0", minimum=0.0) == 0
    assert probe("number", "1", maximum=1.0) == 1
    assert probe("size3", "[1, 2, 3]", above=0.0) == (0.01, 0.02, 0.03)


NUMBERS = st.lists(st.floats(-1e3, 1e3).map(lambda x: round(x, 4)), min_size=3, max_size=3)


@pytest.mark.long
@unhurried
@given(NUMBERS, st.sampled_from(["m", "cm", "mm", "km", "ft"]))
def test_bare_points_are_points_with_the_unit_of_the_file_written_out(numbers: list[float], unit: str) -> None:
    bare = one(f"unit {unit}\nsphere(center: [{', '.join(f'{n:f}' for n in numbers)}])")
    written = one(f"sphere(center: [{', '.join(f'{n:f}{unit}' for n in numbers)}])")
    assert bare.args["center"] == written.args["center"]


def test_all_wrong_arguments_of_a_call_are_reported() -> None:
    _, messages = run('sphere("a", center: 3, colour: 4, material: 5)')
    assert [m.split(": ", 2)[2].split("\n")[0] for m in messages] == [
        'expected length, got the string "a"',
        "expected list of three lengths, got the bare number 3",
        "sphere has no `colour`; did you mean `material`?",
        "expected material, got the bare number 5",
    ]


def test_a_misspelt_argument_is_not_missing_as_well() -> None:
    _, messages = run("point(positoin: [0, 1, 0])")
    assert len(messages) == 1
    assert "point has no `positoin`; did you mean `position`?" in messages[0]


@pytest.mark.parametrize(
    ("text", "near"),
    [
        ('text("a", center: [0, 1, 0])', "translate"), ("sphere(centre: [0, 1, 0])", "center"),
        ("implicit(|x, y, z| x, bounds: 2)", "within"),
    ],
)
def test_an_argument_of_another_name_is_suggested(text: str, near: str) -> None:
    assert run(text)[1][0].splitlines()[0].endswith(f"; did you mean `{near}`?")


def test_a_wrong_value_is_reported_once() -> None:
    _, messages = run("let r = 1m + 1s\nlet ball(k) = sphere(k)\nsphere(r)\nball(r)\nbox([r, r, 2 * r])\nfor (k in [r]) { sphere(k) }")
    assert len(messages) == 1


def test_known_scene() -> None:
    document = good(
        "param radius = 1 in 0.2..2\nlet grey = checker(#e8e8e8, #8a8a8a, size: 50cm)\nlet red = phong(#d0402a, shininess: 40)\n"
        "plane(y: 0, material: lambert(grey))\nsphere(center: [0, radius, 0], radius: radius, material: red)\n"
        "sun(from: [2, 4, 3], illuminance: 20000lx)\nsky(color: #87b5e0, luminance: 3000nit)\n"
        "camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)\nrender(size: [800, 600], error: 1%)"
    )
    assert [e.kind for e in document.elements] == ["plane", "sphere", "sun", "sky"]
    assert document.settings["render"].args["size"] == (800, 600)
    assert document.settings["render"].args["error"] == 0.01
    assert document.cameras[0].args["fov"] == pytest.approx(math.radians(35))
    assert document.elements[0].args["material"].args["color"].args["size"] == 0.5


def test_a_scene_uses_the_elements_of_its_catalogue_alone() -> None:
    """The language has no element of its own but groups of parts; a file's kind without an element is refused."""
    few = {name: CATALOGUE[name] for name in ("sphere", "lambert")}
    document, found = run("sphere(1, material: lambert(#fff))", catalogue=few)
    assert ([e.kind for e in document.elements], found) == (["sphere"], [])
    assert run("box(1)", catalogue=few)[1][0].startswith("a.scene:1:1: error: there is no `box` here")
    assert run('use "a.obj" as a\na()', catalogue=few)[1][0].startswith("a.scene:1:5: error: there is no element `mesh`")
    assert run("for (k in 1..3) { sphere(k) }\nlet pair() = [sphere(), sphere()]\npair(translate: [1, 0, 0])", catalogue=few)[1] == []


def test_equal_text_is_evaluated_with_each_catalogue() -> None:
    """Code of a file is kept for later evaluations: none of it holds the elements of a catalogue."""
    ball = argument_types.Entry("ball", "shape", "for tests", (argument_types.Arg("r", "number", 1.0),))
    text = "for (k in 1..2) { ball(3) }"
    assert len(elements(text, catalogue={"ball": ball})) == 2
    assert run(text)[1][0].startswith("a.scene:1:19: error: there is no `ball` here")
    sized = argument_types.Entry("ball", "shape", "for tests", (argument_types.Arg("r", "length", 1.0),))
    assert [e.args["r"] for e in elements(f"unit cm\n{text}", catalogue={"ball": sized})] == [0.03, 0.03]
