"""Evaluation: definitions, scopes, parts, loops, params, placing; and expressions against Python's own arithmetic."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.lang.elements import Element

from .evaluating import elements, good, run, unhurried, value


def radii(text: str, **options: object) -> list[float]:
    """The radius of every sphere of a scene, including spheres in blocks."""
    found: list[float] = []

    def walk(things: tuple[Element, ...]) -> None:
        for e in things:
            if e.kind == "sphere":
                found.append(e.args["radius"])
            walk(e.children)

    walk(elements(text, **options))  # type: ignore[arg-type]
    return found


# --- definitions ----------------------------------------------------------------------------------------------------


def test_definitions_are_in_any_order() -> None:
    assert radii("sphere(a)\nlet a = b * 2\nlet b = 3") == [6]


def test_an_empty_scene_is_a_scene() -> None:
    document = good("")
    assert (document.elements, document.cameras, dict(document.settings), document.params) == ((), (), {}, ())


def test_an_inner_definition_hides_an_outer_one_and_ends_with_its_block() -> None:
    assert radii("let r = 1\ngroup {\n  let r = 2\n  sphere(r)\n}\nsphere(r)") == [2, 1]


def test_any_name_hides_one_of_the_language() -> None:
    assert radii("let pi = 3\nlet box(r) = sphere(r)\nbox(pi)") == [3]


def test_scoping_is_lexical() -> None:
    assert radii("let r = 1\nlet ball() = sphere(r)\ngroup {\n  let r = 2\n  sphere(r)\n  ball()\n}") == [2, 1]


def test_defaults_see_earlier_parameters_and_the_scope_outside() -> None:
    assert radii("let k = 10\nlet ball(a, b = a + 1, c = b * k) = sphere(c)\nball(1)\nball(1, 2)\nball(c: 5, a: 0)") == [20, 20, 5]


def test_a_default_of_a_parameters_own_name_is_the_one_outside() -> None:
    assert radii("param r = 4\nlet ball(r = r, s = 2 * r) = sphere(s)\nball()\nball(1)") == [8, 2]


def test_recursion_ends() -> None:
    assert value("f(10)", "let f(n) = if n <= 1 then 1 else n * f(n - 1)") == math.factorial(10)


def test_a_constant_is_one_element_however_often_it_is_used() -> None:
    a, b = elements("let red = lambert(#f00)\nsphere(1, material: red)\nsphere(2, material: red)")
    assert a.args["material"] is b.args["material"]


def test_an_element_is_placed_by_its_name() -> None:
    assert radii("let ball = sphere(2)\nball\nball") == [2, 2]


# --- loops and conditions -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("1..3", [1, 2, 3]),
        ("3..1", []),
        ("2..2", [2]),
        ("[4, 2]", [4, 2]),
        ("[k * k for k in 1..4 if mod(k, 2) == 0]", [4, 16]),
        ("[]", []),
    ],
)
def test_for(source: str, expected: list[float]) -> None:
    assert radii(f"for (r in {source}) {{ sphere(r) }}") == expected


def test_each_iteration_of_a_loop_has_its_own_definitions() -> None:
    assert radii("for (k in 1..3) {\n  let r = 2 * k\n  sphere(r)\n}") == [2, 4, 6]


def test_if_items() -> None:
    scene = "for (k in 1..3) {\n  if (k == 1) { sphere(10) }\n  else if (k == 2) { sphere(20) }\n  else { sphere(30) }\n}"
    assert radii(scene) == [10, 20, 30]


def test_if_expressions_evaluate_one_way_only() -> None:
    assert value("if true then 1 else 1 / 0") == 1
    assert value("false and 1 / 0 == 1") is False
    assert value("true or 1 / 0 == 1") is True


# --- parts ----------------------------------------------------------------------------------------------------------


def test_a_part_places_its_children_as_often_as_it_says() -> None:
    assert radii("let twice() = group {\n  children\n  children\n}\ntwice() { sphere(3) }\ntwice { sphere(4) }\ntwice()") == [3, 3, 4, 4]


def test_children_are_evaluated_in_the_scope_of_the_caller() -> None:
    assert radii("let r = 1\nlet part(r) = group { children }\npart(7) { sphere(r) }") == [1]


def test_children_can_be_counted() -> None:
    assert radii("let counted() = sphere(len(children))\ncounted { box()\n box() }") == [2]


def test_a_part_takes_transform_material_and_name_without_declaring_them() -> None:
    (group,) = elements('let ball(r) = sphere(r)\nball(2, translate: [1, 0, 0], scale: 2, material: lambert(#fff), name: "b")')
    assert group.kind == "group"
    assert group.given == {"translate", "scale", "material", "name"}
    assert group.args["translate"] == (1.0, 0.0, 0.0)
    assert [c.kind for c in group.children] == ["sphere"]


def test_a_part_that_declares_material_gets_it_itself() -> None:
    (ball,) = elements("let ball(material) = sphere(1, material: material)\nball(material: mirror())")
    assert ball.kind == "sphere"
    assert ball.args["material"].kind == "mirror"


def test_lists_of_elements_are_placed_one_by_one() -> None:
    assert radii("[sphere(k) for k in 1..3]\nmap(sphere, [4, 5])") == [1, 2, 3, 4, 5]


def test_scope_and_trace_are_the_calls_of_an_element() -> None:
    (group,) = elements("let rim() = group { sphere() }\nlet wheel() = group { rim() }\nwheel()")
    sphere = group.children[0].children[0]
    assert sphere.scope == "wheel.rim"
    assert [(name, span.line, span.column) for name, span in sphere.trace] == [("rim", 2, 23), ("wheel", 3, 1)]
    assert group.scope == "wheel"


def test_typed_parameters_take_the_unit_of_the_caller() -> None:
    text = 'unit mm\nuse "part.scene"\npart.ball(5)\npart.bead(5)\npart.plain(5)'
    part = "let ball(r: length) = sphere(r)\nlet bead(r = 1cm) = sphere(r)\nlet plain(r) = sphere(r)"
    assert [e.args["radius"] for e in elements(text, {"part.scene": part})] == [0.005, 0.005, 0.005]


# --- files' units ---------------------------------------------------------------------------------------------------


def test_bare_lengths_take_the_unit_of_the_file_and_lists_may_mix() -> None:
    (box,) = elements("unit mm\nbox([10, 2cm, 0.5m], center: [0, 1in, 7])")
    assert box.args["size"] == (0.01, 0.02, 0.5)
    assert box.args["center"] == (0.0, 0.0254, 0.007)


# --- placing --------------------------------------------------------------------------------------------------------


def test_cameras_and_settings_are_separate_from_elements() -> None:
    document = good("camera([0, 0, 5], name: \"a\")\nif (true) { camera([0, 0, 9]) }\nrender(samples: 4)\nanimate(duration: 2s)\nsphere()")
    assert [c.args["position"][2] for c in document.cameras] == [5.0, 9.0]
    assert sorted(document.settings) == ["animate", "render"]
    assert [e.kind for e in document.elements] == ["sphere"]


def test_an_item_with_an_error_leaves_the_others() -> None:
    document, messages = run("sphere(1, 2, 3)\nbox(2)\ngroup {\n  cone(radius: 1s)\n  torus(3)\n}")
    assert len(messages) == 3
    assert [e.kind for e in document.elements] == ["box", "group"]
    assert [e.kind for e in document.elements[1].children] == ["torus"]


def test_time() -> None:
    (block,) = elements("rotate([0, 30deg / 1s * time, 0]) { sphere() }", time=3.0)
    assert block.args["by"].angles[1] == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("light", "photometric"),
    [
        ("point([0, 1, 0], intensity: 40)", False),
        ("point([0, 1, 0], intensity: 40cd)", True),
        ("point([0, 1, 0], intensity: 2 * strength)", True),
        ("sky(color: #fff)", False),
        ("sky(luminance: 0)", False),
        ("area([0, 1, 0], flux: 100lm, size: 2cm)", True),
    ],
)
def test_lights_know_whether_their_strength_has_a_unit(light: str, photometric: bool) -> None:
    (element,) = elements(f"let strength = 3cd\n{light}\n" + "let _unused = strength")
    assert element.photometric is photometric


# --- params ---------------------------------------------------------------------------------------------------------


def test_params_have_values_for_sliders() -> None:
    document = good(
        'unit mm\nparam teeth: int = 18 in 6..60 "per gear"\nparam bore = 4cm in 1..100\nparam turn = 30deg in 0..360deg\n'
        'param size: length = 5\nparam finish = "matte" in ["matte", "gloss", "raw"]\nparam tint = #ff0000\nparam on = true\nparam k = 0.5'
    )
    found = [(p.name, p.type, p.value, p.range, p.unit, p.doc) for p in document.params]
    assert found == [
        ("teeth", "int", 18, (6, 60), "", "per gear"),
        ("bore", "length", 4.0, (0.1, 10.0), "cm", ""),
        ("turn", "angle", 30.0, (0.0, 360.0), "deg", ""),
        ("size", "length", 5.0, None, "mm", ""),
        ("finish", "string", "matte", ("matte", "gloss", "raw"), "", ""),
        ("tint", "color", (1.0, 0.0, 0.0), None, "", ""),
        ("on", "bool", True, None, "", ""),
        ("k", "number", 0.5, None, "", ""),
    ]


@pytest.mark.parametrize(
    ("param", "text", "expected"),
    [
        ("r = 1", "3", 3),
        ("r = 1", "2 * (1 + pi) - 2 * pi", 2),
        ("r = 1cm", "4mm", 0.004),
        ("r: length = 1", "50cm", 0.5),
        ("r: int = 1 in 0..9", "9", 9),
    ],
)
def test_set_gives_a_param_its_value(param: str, text: str, expected: float) -> None:
    assert radii(f"param {param}\nsphere(r)", sets={"r": text}) == [pytest.approx(expected)]


def test_set_of_strings_needs_no_quotes() -> None:
    for text in ("soft red", '"soft red"'):
        (ball,) = elements('param label = "hard"\nsphere(name: label)', sets={"label": text})
        assert ball.args["name"] == "soft red"


def test_params_depend_on_each_other_and_on_definitions() -> None:
    assert radii("param a = 2\nparam b = a * k\nlet k = 5\nsphere(b)", sets={"a": "3"}) == [15]


# --- expressions ----------------------------------------------------------------------------------------------------

NUMBERS = st.integers(0, 40).map(str) | st.floats(0.01, 50).map(lambda x: f"{x:.3f}")


def _operations(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    pairs = st.tuples(inner, st.sampled_from(["+", "-", "*", "/"]), inner).map(lambda t: f"{t[0]} {t[1]} {t[2]}")
    powers = st.tuples(inner, st.integers(0, 3)).map(lambda t: f"({t[0]}) ^ {t[1]}")
    return pairs | powers | inner.map(lambda t: f"({t})") | inner.map(lambda t: f"-({t})")


@pytest.mark.long
@unhurried
@given(st.recursive(NUMBERS, _operations, max_leaves=12))
def test_arithmetic_is_that_of_python(text: str) -> None:
    try:
        expected = float(eval(text.replace("^", "**")))
    except (ZeroDivisionError, OverflowError):
        return
    assert value(text) == pytest.approx(expected, rel=1e-12, abs=1e-12)


COMPARISONS = st.tuples(st.integers(-5, 5), st.sampled_from(["<", "<=", ">", ">=", "==", "!="]), st.integers(-5, 5))


@pytest.mark.long
@unhurried
@given(st.lists(COMPARISONS, min_size=1, max_size=5), st.data())
def test_logic_is_that_of_python(parts: list[tuple[int, str, int]], data: st.DataObject) -> None:
    text = " ".join(
        [("" if i == 0 else data.draw(st.sampled_from([" and ", " or "])))
        + data.draw(st.sampled_from(["", "not "])) + f"{a} {op} {b}" for i, (a, op, b) in enumerate(parts)]
    )
    assert value(text) is eval(text)


@unhurried
@given(st.integers(-20, 20), st.integers(-20, 20))
def test_ranges_are_inclusive_and_never_descend(a: int, b: int) -> None:
    assert value(f"{a}..{b}") == tuple(float(k) for k in range(a, b + 1))


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("2 ^ 3 ^ 2", 512),
        ("-2 ^ 2", -4),
        ("2 ^ -1", 0.5),
        ("1 - 2 - 3", -4),
        ("[1, 2] + [10, 20]", (11, 22)),
        ("[1, 2] - [1, 1]", (0, 1)),
        ("2 * [1, 2] / 4", (0.5, 1)),
        ("-[1, -2]", (-1, 2)),
        ("[[1], [2]] * 2", ((2,), (4,))),
        ("[3, 4, 5][1]", 4),
        ('"a" + "b" + string(2.5)', "ab2.5"),
        ("[1, 2] == [1, 2]", True),
        ("[1, 2] == [1, 3]", False),
        ("[1] == [1, 2]", False),
        ('"a" < "b"', True),
        ("(#ff0000).r", 1),
        ("if 1 < 2 then [1] else [2]", (1,)),
    ],
)
def test_expressions(expression: str, expected: object) -> None:
    assert value(expression) == expected


def test_equal_materials_of_a_call_are_one_element() -> None:
    text = (
        "let brick(c) = lambert(c)\n"
        "let wall(c) = box(material: brick(c))\n"
        "for (k in 0..9) { wall(hsv(mod(k, 2) * 90deg, 1, 1))\n sphere(material: metal(\"gold\", roughness: 0.1 * mod(k, 3))) }"
    )
    placed = elements(text)
    materials = [e.args["material"] for e in placed]
    assert len({id(m) for m in materials}) == 2 + 3
    assert [m.kind for m in materials] == ["lambert", "metal"] * 10
    assert materials[0] is materials[4]
    assert materials[0].args["color"] == (1.0, 0.0, 0.0)


def test_a_material_with_another_error_at_the_same_call_is_not_shared() -> None:
    _, messages = run("for (k in [0, 1, true, 0.5]) { sphere(material: metal(\"gold\", roughness: k)) }")
    assert len(messages) == 1
    assert "expected number or texture, got true" in messages[0]


def test_assertions_that_hold_place_nothing() -> None:
    text = "let tall(h) = group {\n  assert(h > 0m)\n  sphere(h)\n}\nassert(1 < 2, \"order\")\ntall(2)\nsphere(1)"
    assert [e.kind for e in good(text).elements] == ["group", "sphere"]
