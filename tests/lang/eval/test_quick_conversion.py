"""The quick conversions give the results of coercion.convert, or leave the value to it."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang import units
from maquette.lang.elements import AxisAngle, Element, Euler
from maquette.lang.eval import coercion, evaluator, quick_conversion
from maquette.lang.eval.context import Scope
from maquette.lang.eval.values import Color, ForeignNumber, Mistake
from maquette.lang.schema.argument_types import Arg
from maquette.lang.units import Quantity

from .evaluating import Files, elements, unhurried

numbers = st.one_of(st.sampled_from([0.0, -0.0, 1.0, 2.0, -3.0, 1e300, 1e-320]), st.floats(-1e6, 1e6))
quantities = st.builds(Quantity, numbers, st.sampled_from([units.LENGTH, units.ANGLE, units.TIME, units.LUMINANCE, units.FLUX]))
scalars = st.one_of(numbers, quantities, st.builds(ForeignNumber, numbers, numbers))
ELEMENTS = [*elements("sphere(1, material: lambert(#f00))\nbox()"), elements("sphere(1, material: lambert(#f00))")[0].args["material"]]
values = st.one_of(
    scalars, st.booleans(), st.sampled_from(["x", "linear", "smooth"]), st.builds(Color, numbers, numbers, numbers),
    st.lists(scalars, min_size=1, max_size=4).map(tuple), st.lists(numbers, min_size=2, max_size=3).map(tuple),
    st.sampled_from(ELEMENTS), st.just(AxisAngle((0.0, 1.0, 0.0), 1.0)), st.just(Euler((0.0, 1.0, 2.0))),
)  # fmt: skip
ARGS = sorted(
    {(a.type, a.minimum, a.maximum, a.above, a.below, a.choices) for entry in CATALOGUE.values() for a in entry.args}, key=lambda a: str(a)
)


def _scope(unit: float) -> Scope:
    machine: Any = evaluator.Evaluator(CATALOGUE, Files({}), evaluator.Diagnostics(), 0.0)
    return Scope(machine, machine.meter, unit)


def _bits(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple([_bits(part) for part in value])
    return (type(value), value.hex()) if isinstance(value, float) else value if isinstance(value, Element) else (type(value), value)


@unhurried
@given(st.sampled_from(ARGS), values, st.sampled_from([1.0, 0.001, 0.0254, 1000.0]))
def test_a_quick_conversion_is_that_of_coercion(kind: tuple[Any, ...], value: Any, unit: float) -> None:
    name, minimum, maximum, above, below, choices = kind
    arg = Arg("a", name, minimum=minimum, maximum=maximum, above=above, below=below, choices=choices)
    quick = quick_conversion.conversion(arg)
    result = quick(value, unit) if quick else quick_conversion.SLOW
    if result is quick_conversion.SLOW:
        return
    try:
        expected = coercion.convert(value, arg, coercion.Place(evaluator.Span("a"), None, _scope(unit)))
    except Mistake as mistake:
        pytest.fail(f"{name} {value!r} in {unit} m: {mistake.message}, got {result!r}")
    assert _bits(result) == _bits(expected)


def test_common_values_are_quick() -> None:
    for name, value in (
        ("length", 2.0), ("length", Quantity(2.0, units.LENGTH)), ("point", (1.0, 2.0, 3.0)), ("size3", 2.0), ("size3", (1.0, 2.0, 3.0)),
        ("color_map", Color(1.0, 0.5, 0.0)), ("color_map", 0.5), ("number", 1.0), ("material", ELEMENTS[2]), ("direction", (0.0, 1.0, 0.0)),
        ("rotation", (Quantity(1.0, units.ANGLE),) * 3), ("scale3", 2.0), ("int", 3.0), ("string", "x"), ("bool", True),
    ):  # fmt: skip
        quick = quick_conversion.conversion(Arg("a", name))
        assert quick is not None
        assert quick(value, 1.0) is not quick_conversion.SLOW, name


def test_a_limit_leaves_the_value_to_coercion() -> None:
    quick = quick_conversion.conversion(Arg("a", "size3", above=0.0, maximum=4.0))
    assert quick is not None
    assert quick((1.0, 5e-324, 4.0), 1.0) == (1.0, 5e-324, 4.0)
    assert quick((1.0, 0.0, 4.0), 1.0) is quick_conversion.SLOW
    assert quick((1.0, 1.0, math.nextafter(4.0, 5.0)), 1.0) is quick_conversion.SLOW
