"""The argument types of media: coefficients per metre, emission per metre, and densities."""

from __future__ import annotations

from typing import Any

from .. import units
from ..schema.argument_types import Arg
from ..units import Dimension, Quantity
from .values import Closure, Color, Element, Mistake, UserFunction, Value, category, describe

PER_LENGTH: Dimension = units.divide(units.NONE, units.LENGTH)
EMISSION: Dimension = units.divide(units.LUMINANCE, units.LENGTH)


def coefficient(value: Value, place: Any, arg: Arg) -> tuple[float, float, float]:
    """Per metre, for red, green and blue. Raises Mistake."""
    return _three(value, place, arg, PER_LENGTH, "1 / 2cm")


def emission(value: Value, place: Any, arg: Arg) -> tuple[float, float, float]:
    """Radiance per metre, for red, green and blue. Raises Mistake."""
    return _three(value, place, arg, EMISSION, "1000nit / 1m")


def _three(value: Value, place: Any, arg: Arg, dimension: Dimension, example: str) -> tuple[float, float, float]:
    if isinstance(value, Color):
        return value.channels
    if isinstance(value, tuple) and len(value) == 3:
        r, g, b = (_one(part, place.item(k), arg, dimension, example) for k, part in enumerate(value))
        return r, g, b
    number = _one(value, place, arg, dimension, example)
    return number, number, number


def _one(value: Value, place: Any, arg: Arg, dimension: Dimension, example: str) -> float:
    if isinstance(value, float):
        return float(value)
    if isinstance(value, Quantity) and value.dimension == dimension:
        return value.value
    wanted = "number per metre, colour or list of three"
    if isinstance(value, Quantity) and value.dimension == units.LENGTH:
        hint = f"write 1 / {units.show(value)}"
    else:
        hint = f"such as {arg.name}: {example}"
    raise Mistake(f"expected {wanted}, got {describe(value)}", hint, span=place.span)


def density(value: Value, place: Any, arg: Arg) -> Any:
    """A number from 0, the formula of a function or pattern, or a volume. Raises Mistake."""
    if isinstance(value, float):
        if value < 0:
            raise Mistake(f"`{arg.name}` must be 0 or more, got {units.show(value)}")
        return float(value)
    if isinstance(value, Closure | UserFunction):
        return place.scope.evaluator.formula(value, place.scope, place.span)
    if isinstance(value, Element) and value.kind == "pattern":
        return value.args["formula"]
    if category(value) == "volume":
        return value
    hint = "a picture has no depth: write a formula |x, y, z| …" if category(value) == "texture" else "write |x, y, z| …, or a number"
    raise Mistake(f"expected number, formula |x, y, z| …, pattern or volume, got {describe(value)}", hint)


def medium(value: Value, place: Any, arg: Arg) -> Any:
    """An element of the category `medium`. Raises Mistake."""
    if category(value) == "medium":
        return value
    hint = "write medium(…)"
    if isinstance(value, UserFunction):
        hint = f"call it: {value.name}(…)"
    elif category(value) == "fog":
        hint = "fog stands at the top level of a scene; write medium(…) for what is inside of a shape"
    elif isinstance(value, Color):
        hint = "write medium(color, depth: 5cm)"
    raise Mistake(f"expected medium, got {describe(value)}", hint)


def is_measured(value: Value) -> bool:
    """Whether a value, or an item of a list, has a unit."""
    return isinstance(value, Quantity) or (isinstance(value, tuple) and any(isinstance(part, Quantity) for part in value))


CONVERTERS = {"medium": medium, "coefficient": coefficient, "emission": emission, "density": density}
