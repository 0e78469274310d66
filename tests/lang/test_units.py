"""Units as dimensions: every unit, arithmetic of dimensions, bare numbers, and laws that hold for any quantity."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang import units
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.eval import operators
from maquette.lang.eval.evaluator import Evaluator
from maquette.lang.eval.values import Mistake
from maquette.lang.units import Quantity

from .eval.evaluating import Files, mistake, unhurried, value

HERE = Evaluator(CATALOGUE, Files({}), Diagnostics(), 0.0).root  # the scope of a file in metres

EVERY_UNIT = {
    "1m": 1, "1cm": 0.01, "1mm": 0.001, "1km": 1000, "1um": 1e-6, "1µm": 1e-6, "1μm": 1e-6, "1nm": 1e-9, "1in": 0.0254, "1ft": 0.3048,
    "180deg": math.pi, "180°": math.pi, "1rad": 1, "1turn": 2 * math.pi, "1sr": 1,
    "1s": 1, "1ms": 0.001, "1min": 60, "1h": 3600,
    "1cd": 1, "1kcd": 1000, "1mcd": 0.001, "1lx": 1, "1klx": 1000, "1nit": 1, "1knit": 1000, "1lm": 1, "1klm": 1000, "1mlm": 0.001,
}  # fmt: skip


@pytest.mark.parametrize(("text", "base"), EVERY_UNIT.items())
def test_every_unit_in_base_units(text: str, base: float) -> None:
    assert value(text).value == pytest.approx(base, rel=1e-15)


def test_percent_and_ev_are_plain_numbers() -> None:
    assert value("5%") == pytest.approx(0.05)
    assert value("8ev") == 8.0


@pytest.mark.parametrize(
    ("expression", "base", "dimension"),
    [
        ("2m * 3m", 6, units.AREA),
        ("1lm / 1m^2", 1, units.ILLUMINANCE),
        ("1cd / 1m^2", 1, units.LUMINANCE),
        ("6cd * 2sr", 12, units.FLUX),
        ("30deg / 1s * 2s", math.pi / 3, units.ANGLE),
        ("sqrt(9m * 4m)", 6, units.LENGTH),
        ("(8m * 1m * 1m) ^ (1 / 3)", 2, units.LENGTH),
        ("1 / 4s", 0.25, (0, 0, -1, 0)),
        ("-3cm", -0.03, units.LENGTH),
        ("3cm + 2mm", 0.032, units.LENGTH),
        ("1m - 0", 1, units.LENGTH),
        ("0 + 30deg", math.pi / 6, units.ANGLE),
        ("max(1cm, 1in, 0)", 0.0254, units.LENGTH),
        ("hypot(3cm, 4cm)", 0.05, units.LENGTH),
        ("mod(25cm, 10cm)", 0.05, units.LENGTH),
        ("clamp(3m, 0, 50cm)", 0.5, units.LENGTH),
        ("lerp(1m, 2m, 25%)", 1.25, units.LENGTH),
        ("abs(-3lx)", 3, units.ILLUMINANCE),
        ("atan2(1, 1)", math.pi / 4, units.ANGLE),
        ("asin(1)", math.pi / 2, units.ANGLE),
    ],
)
def test_arithmetic_of_dimensions(expression: str, base: float, dimension: units.Dimension) -> None:
    result = value(expression)
    assert result.value == pytest.approx(base, rel=1e-12)
    assert result.dimension == dimension


@pytest.mark.parametrize(
    ("expression", "plain"),
    [("10cm / 1m", 0.1), ("sin(30deg)", 0.5), ("cos(pi * 1rad)", -1), ("tan(45deg)", 1), ("sign(-3m)", -1), ("smoothstep(0, 2m, 1m)", 0.5)],
)
def test_dimensions_that_cancel_leave_a_plain_number(expression: str, plain: float) -> None:
    result = value(expression)
    assert isinstance(result, float)
    assert result == pytest.approx(plain)


@pytest.mark.parametrize(
    ("expression", "truth"),
    [
        ("1m > 99cm", True),
        ("100cm == 1m", True),
        ("1in < 2.54cm", False),
        ("0 < 3deg", True),
        ("2.5 >= 250cm", True),
        ("1s != 1000ms", False),
    ],
)
def test_comparisons_across_units(expression: str, truth: bool) -> None:
    assert value(expression) is truth


def test_a_bare_number_beside_a_length_is_in_the_unit_of_the_file() -> None:
    assert value("3 + 1cm", "unit mm").value == pytest.approx(0.013)
    assert value("3 + 1cm").value == pytest.approx(3.01)


@pytest.mark.parametrize(
    ("expression", "message"),
    [
        ("1m + 1s", "cannot add a length and a time"),
        ("1m - 1deg", "cannot subtract a length and an angle"),
        ("1lx < 1nit", "cannot compare an illuminance and a luminance"),
        ("1m == 1kcd", "cannot compare a length and an intensity"),
        ("30deg + 24", "expected angle, got the bare number 24 | write 24deg"),
        ("2s - 1", "expected time, got the bare number 1 | write 1s"),
        ("800lm + 200", "expected flux, got the bare number 200 | write 200lm"),
        ("1m * 1m + 3", "expected area, got the bare number 3 | give it a unit: m²"),
        ("2 ^ 1m", "an exponent is a plain number, not a length"),
        ("1m / 0", "division by 0"),
        ("sin(24)", "expected angle, got the bare number 24 | write 24deg or 24rad; * 1rad makes an angle of a number"),
        ("sin(1m)", "expected angle, got the length 1m"),
        ("floor(2.7cm)", "expected number, got the length 0.027m | divide by a unit first, as in floor(x / 1cm)"),
        ("3mmm", "unknown unit `mmm` | did you mean `mm`?"),
        ("2pi", "unknown unit `pi` | write 2 * pi"),
        (
            "2abc",
            "unknown unit `abc` | lengths are in m, cm, mm, km, um, nm, in, inch, ft; angles in deg, rad, turn; times in s, ms, min, h; "
            "light is in cd, lx, nit, lm",
        ),
        ("1e300 * 1e300", "the result is too large for a number"),
        ("10 ^ 400", "the result is too large for a number"),
        ("(-8) ^ 0.5", "a negative number has no such power"),
        ("sqrt(-1m * 1m)", "sqrt(-1m²) is not defined"),
        ("log(0)", "log(0) is not defined"),
        ("acos(2)", "acos(2) is not defined"),
    ],
)
def test_dimensions_that_do_not_fit(expression: str, message: str) -> None:
    assert mistake(expression) == message


NUMBERS = st.floats(-1e6, 1e6)
DIMENSIONS = st.tuples(*[st.integers(-3, 3)] * 4)
QUANTITIES = st.builds(units.quantity, NUMBERS, DIMENSIONS)


@pytest.mark.long
@unhurried
@given(QUANTITIES, QUANTITIES)
def test_products_commute_and_add_exponents(a: float | Quantity, b: float | Quantity) -> None:
    product = operators.multiply(a, b, HERE)
    assert product == operators.multiply(b, a, HERE)
    expected = tuple(x + y for x, y in zip(operators.split(a)[1], operators.split(b)[1], strict=True))
    assert operators.split(product) == (operators.split(a)[0] * operators.split(b)[0], expected)


@pytest.mark.long
@unhurried
@given(QUANTITIES, QUANTITIES.filter(lambda q: abs(operators.split(q)[0]) > 1e-3))
def test_division_undoes_multiplication(a: float | Quantity, b: float | Quantity) -> None:
    back, dimension = operators.split(operators.divide(operators.multiply(a, b, HERE), b, HERE))
    assert dimension == operators.split(a)[1]
    assert back == pytest.approx(operators.split(a)[0], rel=1e-12, abs=1e-12)


@unhurried
@given(st.floats(1e-3, 1e3), DIMENSIONS, st.sampled_from([2, 3, 4, 6]))
def test_a_power_and_its_root_give_the_quantity_back(size: float, dimension: units.Dimension, n: int) -> None:
    a = units.quantity(size, dimension)
    back = operators.power(operators.power(a, float(n), HERE), 1 / n, HERE)
    assert operators.split(back)[1] == dimension
    assert operators.split(back)[0] == pytest.approx(size)


@unhurried
@given(QUANTITIES, QUANTITIES)
def test_a_sum_is_of_one_dimension_or_a_mistake(a: float | Quantity, b: float | Quantity) -> None:
    (x, da), (y, db) = operators.split(a), operators.split(b)
    bare_length = {da, db} == {units.NONE, units.LENGTH}
    zero = (da == units.NONE and x == 0) or (db == units.NONE and y == 0)
    if da == db or bare_length or zero:
        assert operators.split(operators.add(a, b, HERE))[0] == x + y
    else:
        with pytest.raises(Mistake):
            operators.add(a, b, HERE)


@unhurried
@given(NUMBERS, st.sampled_from([u for u in units.UNITS if u.isascii() and u.isalpha()]))
def test_a_literal_is_the_number_times_its_unit(number: float, unit: str) -> None:
    size = abs(round(number, 3))
    assert operators.split(value(f"{size:f}{unit}")) == operators.split(units.literal(float(f"{size:f}"), unit) or 0.0)


@pytest.mark.parametrize(
    ("quantity", "text"),
    [
        (24.0, "24"),
        (Quantity(math.pi / 6, units.ANGLE), "30deg"),
        (Quantity(0.3, units.LENGTH), "0.3m"),
        (Quantity(5e-5, units.LENGTH), "50um"),
        (Quantity(3.0, units.ILLUMINANCE), "3lx"),
        (Quantity(2.0, (1, 0, -1, 0)), "2m/s"),
        (Quantity(2.0, (0, 0, -1, 0)), "2 1/s"),
        (Quantity(2.0, (0.5, 0, 0, 0)), "2m^0.5"),
    ],
)
def test_how_quantities_are_shown(quantity: float | Quantity, text: str) -> None:
    assert units.show(quantity) == text


@unhurried
@given(st.floats(0.001, 1e5), st.sampled_from(["mm", "cm", "in", "deg", "ms", "klx"]))
def test_in_unit_inverts_literal(number: float, unit: str) -> None:
    number = float(f"{number:.6g}")
    assert units.in_unit(number * units.UNITS[unit][0], unit) == number
