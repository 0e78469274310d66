"""Functions of the language, function values, colours, and formulas recorded from functions."""

from __future__ import annotations

import colorsys
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang import colors, formula_graph
from maquette.lang.elements import AxisAngle, Falloff, Quaternion
from maquette.lang.eval import builtins
from maquette.lang.formula_graph import Formula
from maquette.lang.noise import noise
from maquette.lang.schema import argument_types
from maquette.lang.units import Quantity

from .evaluating import elements, mistake, run, unhurried, value


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        ("abs(-3)", 3),
        ("sqrt(16)", 4),
        ("exp(1)", math.e),
        ("log(exp(2))", 2),
        ("sin(90deg)", 1),
        ("cos(0)", 1),
        ("hypot(3, 4)", 5),
        ("hypot(1, 2, 2)", 3),
        ("min(3, 1, 2)", 1),
        ("max([3, 1, 2])", 3),
        ("min(7)", 7),
        ("clamp(5, 0, 1)", 1),
        ("clamp(-5, 0, 1)", 0),
        ("lerp(2, 4, 0.5)", 3),
        ("lerp([0, 0], [2, 4], 0.5)", (1, 2)),
        ("step(1, 0.5)", 0),
        ("step(1, 1)", 1),
        ("smoothstep(0, 1, 0.5)", 0.5),
        ("smoothstep(0, 1, 2)", 1),
        ("floor(-1.5)", -2),
        ("ceil(-1.5)", -1),
        ("round(2.5)", 3),
        ("round(-2.5)", -2),
        ("mod(-1, 3)", 2),
        ("mod(1, 0.1)", 0),
        ("atan2(-0, -1) > 0rad", True),
        ("sign(-2)", -1),
        ("pow(2, 10)", 1024),
        ("dot([1, 2, 3], [4, 5, 6])", 32),
        ("cross([1, 0, 0], [0, 1, 0])", (0, 0, 1)),
        ("length([3, 4])", 5),
        ("normalize([0, 3, 4])", (0, 0.6, 0.8)),
        ("len([1, 2, 3])", 3),
        ('len("four")', 4),
        ("concat([1], [2, 3], [])", (1, 2, 3)),
        ("map(|k| k * k, 1..3)", (1, 4, 9)),
        ("filter(|k| k > 1, 1..3)", (2, 3)),
        ("fold(|sum, k| sum + k, 0, 1..4)", 10),
        ("scan(|sum, k| sum + k, 0, 1..4)", (0, 1, 3, 6, 10)),
        ("map(sqrt, [1, 4])", (1, 2)),
        ("string([1, true, #ff0000])", "[1, true, #ff0000]"),
        ("string(30deg)", "30deg"),
        ("noise(1, 2, 3)", 0),
        ("noise([3.14, 42, 7])", 0.13691995878400012),
        ("clamp(high: 2, value: 3, low: 0)", 2),
        ("pi", math.pi),
    ],
)
def test_known_values(expression: str, expected: Any) -> None:
    assert value(expression) == pytest.approx(expected) if not isinstance(expected, str) else value(expression) == expected


def test_every_documented_function_exists() -> None:
    promised = """abs sqrt exp log sin cos tan asin acos atan atan2 hypot min max clamp lerp step smoothstep floor ceil round mod sign
    pow noise dot cross length normalize len map filter scan fold string rgb srgb hsv kelvin axis quaternion matrix ramp""".split()
    assert [name for name in promised if name not in builtins.FUNCTIONS] == []
    assert [name for name in builtins.FUNCTIONS if name in CATALOGUE] == []
    assert all(f.doc for f in builtins.FUNCTIONS.values())


def test_vectors_of_lengths() -> None:
    size = value("length([3cm, 0.04, 0])")
    assert size.value == pytest.approx(0.05)
    assert value("normalize([3cm, 4cm])") == pytest.approx((0.6, 0.8))
    assert value("dot([1m, 2m], [3, 4])").value == pytest.approx(11)


def test_rotations_matrices_and_fall_off() -> None:
    assert value("axis([0, 1, 0], 180deg)") == AxisAngle((0, 1, 0), math.pi)
    assert value("quaternion(0, 0, 0, 1)") == Quaternion(0, 0, 0, 1)
    assert value("ramp(10cm, 2)") == Falloff("ramp", (0.1, 2.0, 0.0))
    assert value("matrix([1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5])")[2] == (0, 0, 1, 5)


def test_a_function_literal_is_a_closure() -> None:
    assert value("map(add, [1, 2])", "let k = 10\nlet add = |x| x + k") == (11, 12)
    assert value("make(3)(4)", "let make(a) = |b| a * b") == 12


def test_trigonometry_in_a_function_literal_takes_radians() -> None:
    assert value("map(|t| sin(t), [pi / 2])") == pytest.approx((1,))
    assert value("map(|t| wave(t), [pi / 2])", "let wave(t) = sin(t)") == pytest.approx((1,))
    assert mistake("wave(pi / 2)", "let wave(t) = sin(t)").startswith("expected angle, got the bare number 1.5708")


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("clamp(1, 2)", "clamp needs `high`"),
        ("clamp(1, 2, 3, 4)", "clamp takes 3 arguments by position"),
        ("clamp(1, 2, hihg: 3)", "clamp has no `hihg`; did you mean `high`?"),
        ("clamp(1, 2, 3, low: 4)", "clamp gets `low` twice"),
        ("dot([1], [1, 2])", "dot of a list of 1 and a list of 2"),
        ("cross([1, 2], [1, 2, 3])", "expected list of 3, got a list of 2"),
        ("normalize([0, 0, 0])", "a vector of length 0 has no direction"),
        ("max([])", "max of an empty list"),
        ("map(3, [1])", "only functions and parts are called, not the bare number 3"),
        ("map(|a, b| a, [1])", "|a, b| … takes 2 arguments, got 1"),
        ("filter(|k| k, [1])", "filter expects a function with a truth value, got a number"),
        ("len(3)", "expected list, got the bare number 3"),
        ("rgb(-1, 0, 0)", "a channel is 0 or more, got -1"),
        ("srgb(255, 0, 0)", "a channel is 0..1, got 255 | write n / 255, or #rrggbb"),
        ("hsv(120, 1, 1)", "expected angle, got the bare number 120 | write 120deg or 120rad; * 1rad makes an angle of a number"),
        ("kelvin(3)", "expected temperature in 800..40000 kelvin, got the bare number 3"),
        ("axis([0, 0, 0], 1deg)", "an axis of length 0 has no direction"),
        ("axis([0, 1, 0], 90)", "expected angle, got the bare number 90 | write 90deg"),
        ("ramp(2, 1)", "a ramp starts at 0 or more and ends after its start"),
        ("[1, 2] + [1]", "cannot add a list of 2 and a list of 1 | `+` adds item by item; write concat(a, b) to join them"),
        ("[1, 2] * [1, 2]", "cannot multiply a list and a list | write dot(a, b) or cross(a, b)"),
        ('"a" + 1', "cannot add a string and a number | write string(…) to make a string of it"),
        ("#fff + 1", "cannot add a colour and a number"),
        ("not 1", "`not` needs true or false, got a number"),
        ("1 and true", "`and` needs true or false, got a number"),
        ('1 == "a"', "cannot compare a number and a string"),
    ],
)
def test_misuse(expression: str, message: str) -> None:
    assert mistake(expression) == message


# --- colours --------------------------------------------------------------------------------------------------------


def test_colours() -> None:
    assert value("#fff").channels == pytest.approx((1, 1, 1))
    assert value("#808080").channels == pytest.approx((0.21586050011389926,) * 3)
    assert value("#f80") == value("#ff8800")
    assert value("rgb(0.1, 2, 3)").channels == (0.1, 2, 3)
    assert value("srgb(1, 0.5, 0)").channels == pytest.approx((1, 0.21404114048223255, 0))
    assert value("#fff * 0.5").channels == pytest.approx((0.5, 0.5, 0.5))
    assert value("lerp(#000, #fff, 25%)").channels == pytest.approx((0.25, 0.25, 0.25))
    assert value("rgb(1, 2, 3) * rgb(2, 2, 2) + rgb(0, 0, 1)").channels == (2, 4, 7)


@unhurried
@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 255))
def test_hex_and_back(r: int, g: int, b: int) -> None:
    text = f"#{r:02x}{g:02x}{b:02x}"
    assert colors.to_hex(colors.from_hex(text)) == text


@unhurried
@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_hsv_is_that_of_colorsys(h: float, s: float, v: float) -> None:
    assert colors.hsv_to_srgb(h * 2 * math.pi, s, v) == pytest.approx(colorsys.hsv_to_rgb(h, s, v), abs=1e-9)


@unhurried
@given(st.floats(*colors.KELVIN_RANGE))
def test_a_black_body_has_luminance_1_and_no_negative_channel(temperature: float) -> None:
    rgb = colors.kelvin(temperature)
    assert min(rgb) >= 0
    assert sum(w * c for w, c in zip(colors.LUMINANCE, rgb, strict=True)) == pytest.approx(1)


@pytest.mark.parametrize(
    ("temperature", "xy"),
    [(2856, (0.4476, 0.4074)), (6500, (0.3135, 0.3237)), (4000, (0.3805, 0.3768))],  # CIE 15, Planckian locus
)
def test_black_bodies_lie_on_the_planckian_locus(temperature: float, xy: tuple[float, float]) -> None:
    r, g, b = colors.kelvin(temperature)
    x, y, z = (  # Rec.709 to XYZ
        0.4124564 * r + 0.3575761 * g + 0.1804375 * b,
        0.2126729 * r + 0.7151522 * g + 0.0721750 * b,
        0.0193339 * r + 0.1191920 * g + 0.9503041 * b,
    )
    assert (x / (x + y + z), y / (x + y + z)) == pytest.approx(xy, abs=0.003)


@unhurried
@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-50, 50))
def test_noise_is_bounded_and_repeats(x: float, y: float, z: float) -> None:
    assert -1.05 <= noise(x, y, z) <= 1.05
    assert noise(x, y, z) == pytest.approx(noise(x + 256, y - 256, z), abs=1e-9)


# --- formulas -------------------------------------------------------------------------------------------------------


FORMULAS = {
    **CATALOGUE,
    "implicit": argument_types.Entry("implicit", "shape", "for tests", (argument_types.Arg("f", "formula", argument_types.REQUIRED),)),
}
"""The catalogue with an element that takes a formula alone."""


def recorded(text: str, before: str = "") -> Formula:
    (element,) = elements(f"{before}\nimplicit({text})", catalogue=FORMULAS)
    return element.args["f"]


@pytest.mark.parametrize(
    ("text", "python"),
    [
        ("|x, y, z| x + 2 * y - z / 4", lambda x, y, z: x + 2 * y - z / 4),
        ("|x, y, z| hypot(x, y, z) - 1", lambda x, y, z: math.hypot(x, y, z) - 1),
        ("|x, y, z| length([x, y, z])", lambda x, y, z: math.hypot(x, y, z)),
        ("|x, y, z| sin(x) * cos(y) + tan(z)", lambda x, y, z: math.sin(x) * math.cos(y) + math.tan(z)),
        ("|x, y, z| atan2(z, x) / pi", lambda x, y, z: math.atan2(z, x) / math.pi),
        ("|x, y, z| x ^ 2 + abs(y) + sqrt(abs(z))", lambda x, y, z: x * x + abs(y) + math.sqrt(abs(z))),
        ("|x, y, z| if x < y then x else max(y, z)", lambda x, y, z: x if x < y else max(y, z)),
        ("|x, y, z| clamp(x, 0, 1) + min(y, z)", lambda x, y, z: min(max(x, 0), 1) + min(y, z)),
        ("|x, y, z| floor(x) + ceil(y) + round(z)", lambda x, y, z: math.floor(x) + math.ceil(y) + math.floor(z + 0.5)),
        ("|x, y, z| mod(x, 3) + sign(y) + exp(z / 9)", lambda x, y, z: x - 3 * math.floor(x / 3) + (y > 0) - (y < 0) + math.exp(z / 9)),
        ("|x, y, z| noise(x, y, z)", noise),
        ("|x, y, z| x <= y and not (y == z or x > 2)", lambda x, y, z: x <= y and not (y == z or x > 2)),
        ("|x, y, z| dot([x, y, z], normalize([1, 2, 2]))", lambda x, y, z: (x + 2 * y + 2 * z) / 3),
        ("|x, y, z| fold(|s, k| s + k * x, y, 1..3)", lambda x, y, z: y + 6 * x),
        ("|x, y, z| lerp(x, y, 0.25) + step(0, z) + smoothstep(0, 2, x)",
         lambda x, y, z: x + 0.25 * (y - x) + (z >= 0) + (lambda t: t * t * (3 - 2 * t))(min(max(x / 2, 0), 1))),
    ],
)  # fmt: skip
def test_a_formula_computes_the_same_as_python(text: str, python: Any) -> None:
    f = recorded(text)
    assert f.parameters == ("x", "y", "z")
    for point in ((0.3, -1.2, 2.5), (-2.0, 0.7, 0.1), (4.0, 4.5, -3.25)):
        assert formula_graph.evaluate(f, point) == pytest.approx(python(*point))


def test_a_formula_inlines_functions_and_folds_constants() -> None:
    f = recorded("|x| twice(x) * (k + 1)", "let twice(v) = 2 * v\nlet k = 2")
    assert [(n.op, n.args, n.value) for n in f.nodes] == [
        ("parameter", (), 0.0), ("constant", (), 2.0), ("multiply", (1, 0), 0.0), ("constant", (), 3.0), ("multiply", (2, 3), 0.0),
    ]  # fmt: skip
    assert f.results == (4,)
    assert f.kind == "number"


def test_equal_operations_of_a_formula_are_shared() -> None:
    assert [n.op for n in recorded("|x| sin(x) * sin(x)").nodes] == ["parameter", "sin", "multiply"]


@pytest.mark.long
def test_lengths_in_a_formula_become_numbers_in_the_unit_of_the_file() -> None:
    f = recorded("|x| x - r + a + 90deg * 0", "unit mm\nlet r = 2cm\nlet a = 0")
    assert f.unit == 0.001
    assert formula_graph.evaluate(f, [25.0]) == pytest.approx(5.0)
    assert formula_graph.evaluate(recorded("|x| x * area", "unit cm\nlet area = 1m * 1m"), [1.0]) == pytest.approx(1e4)


def test_kinds_of_formula() -> None:
    assert recorded("|x, y, z| x == y").kind == "truth"
    surface = recorded("|u, v| [u, v, u * v]")
    assert (surface.kind, formula_graph.evaluate(surface, (2.0, 3.0))) == ("list", (2, 3, 6))
    pattern = recorded("|x, y, z| lerp(#000, #fff, x)")
    assert (pattern.kind, formula_graph.evaluate(pattern, (0.25, 0, 0))) == ("color", pytest.approx((0.25,) * 3))
    named = recorded("wave", "let wave(x) = sin(x)")
    assert formula_graph.evaluate(named, [1.0]) == pytest.approx(math.sin(1))


@pytest.mark.parametrize(
    ("text", "result"),
    [("|x| 1 / x", math.inf), ("|x| log(x)", -math.inf), ("|x| exp(1000 + x)", math.inf)],
)
def test_formulas_never_raise(text: str, result: float) -> None:
    assert formula_graph.evaluate(recorded(text), [0.0]) == result


def test_formulas_are_nan_outside_their_domain() -> None:
    for text in ("|x| sqrt(x)", "|x| log(x)", "|x| x ^ 0.5", "|x| acos(x - 1)"):
        assert math.isnan(formula_graph.evaluate(recorded(text), [-1.0]))
    assert math.isnan(formula_graph.evaluate(recorded("|x| mod(1, x)"), [0.0]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("|x| [1, 2][x]", "expected whole number, got a formula's number"),
        ("|x| string(1) + x", "cannot add a string and a formula's number"),
        ("|x| [k for k in 1..3 if k < x]", "the items of a list cannot depend on a formula's parameters"),
        ("|x| sphere(x)", "expected length, got a formula's number"),
        ("|x| lambert(#fff)", "a formula gives a number, a truth value, a list or a colour, not a material"),
        ("|x| if x then 1 else 2", "`if` needs true or false, got a formula's number"),
        ("|x| if x < 1 then 1 else true", "both branches of an `if` in a formula must be of one kind, got a number and a truth value"),
        ("|x| f(x)", "f calls itself too deeply: 200 nested calls"),
        ("|x| hsv(x, 1, 1)", "hsv(…) cannot depend on a formula's parameters"),
    ],
)
def test_limits_of_formulas(text: str, message: str) -> None:
    _, messages = run(f"let f(n) = if n > 0 then f(n - 1) else 0\nimplicit({text})\n" + "let _f = f", catalogue=FORMULAS)
    assert len(messages) == 1
    assert message in messages[0]


def test_angles_that_functions_give() -> None:
    assert isinstance(value("acos(0)"), Quantity)
