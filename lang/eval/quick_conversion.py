"""Conversions of the common values of arguments, without their places: the same results as coercion.convert, or SLOW.

A value that is wrong, rare or out of limits is SLOW; coercion.convert then converts or refuses it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .. import units
from ..elements import AxisAngle, Element, Euler, Quaternion
from ..schema.argument_types import Arg
from ..units import Quantity
from .coercion import LIGHT_TYPES
from .values import Color, Value

SLOW: Any = object()
Conversion = Callable[[Value, float], Any]  # of a value in a file whose bare lengths are in `unit` metres


def conversion(arg: Arg) -> Conversion | None:
    """The quick conversion to the type and limits of `arg`; None for rare types."""
    if arg.type == "choice":
        choices = arg.choices
        return lambda value, unit: value if type(value) is str and value in choices else SLOW
    plain = _CONVERSIONS.get(arg.type)
    if plain is None or all(limit is None for limit in (arg.minimum, arg.maximum, arg.above, arg.below)):
        return plain
    return _limited(plain, arg)


def _limited(plain: Conversion, arg: Arg) -> Conversion:
    low = -math.inf if arg.minimum is None else arg.minimum
    high = math.inf if arg.maximum is None else arg.maximum
    low = low if arg.above is None else max(low, math.nextafter(arg.above, math.inf))
    high = high if arg.below is None else min(high, math.nextafter(arg.below, -math.inf))

    def limited(value: Value, unit: float) -> Any:
        result = plain(value, unit)
        if type(result) is tuple:
            for part in result:
                if not low <= part <= high:
                    return SLOW
            return result
        return result if result is SLOW or type(result) is Element or low <= result <= high else SLOW

    return limited


def _of_type(kind: type) -> Conversion:
    return lambda value, unit: value if type(value) is kind else SLOW


def _int(value: Value, unit: float) -> Any:
    return int(value) if type(value) is float and value == int(value) else SLOW


def _length(value: Value, unit: float) -> Any:
    if type(value) is float:
        if unit == 1.0:
            return value + 0.0  # -0 becomes 0
        scaled = units.scale(value, unit)
        return 0.0 if value == 0.0 else scaled if scaled - scaled == 0.0 else SLOW
    return value.value if type(value) is Quantity and value.dimension == units.LENGTH else SLOW


def _lengths(value: Value, unit: float) -> Any:
    converted = tuple([_length(part, unit) for part in value])
    return SLOW if SLOW in converted else converted


def _point(value: Value, unit: float) -> Any:
    if type(value) is not tuple or len(value) != 3:
        return SLOW
    x, y, z = value
    if unit == 1.0 and type(x) is float and type(y) is float and type(z) is float:
        return (x + 0.0, y + 0.0, z + 0.0)
    return _lengths(value, unit)


def _size(count: int) -> Conversion:
    def convert(value: Value, unit: float) -> Any:
        if type(value) is tuple:
            return _lengths(value, unit) if len(value) == count else SLOW
        edge = _length(value, unit)
        return SLOW if edge is SLOW else (edge,) * count

    return convert


def _numbers(count: int, one_for_all: bool = True, all_but_0: bool = False) -> Conversion:
    def convert(value: Value, unit: float) -> Any:
        if one_for_all and type(value) is float and (value or not all_but_0):
            return (value,) * count
        if type(value) is not tuple or len(value) != count:
            return SLOW
        for part in value:
            if type(part) is not float or (all_but_0 and not part):
                return SLOW
        return value

    return convert


def _direction(value: Value, unit: float) -> Any:
    vector = _three_numbers(value, unit)
    return vector if vector is SLOW or any(vector) else SLOW


_three_numbers = _numbers(3, one_for_all=False)


def _quantity(name: str) -> Conversion:
    """Bare numbers are light in the unit of the scene; other bare numbers are SLOW."""
    dimension, is_light = units.QUANTITIES[name][0], name in LIGHT_TYPES

    def convert(value: Value, unit: float) -> Any:
        if type(value) is Quantity and value.dimension == dimension:
            return value.value
        return value if is_light and type(value) is float else SLOW

    return convert


def _color(value: Value, unit: float) -> Any:
    return (value.r, value.g, value.b) if type(value) is Color else SLOW


def _color_map(value: Value, unit: float) -> Any:
    if type(value) is Color:
        return (value.r, value.g, value.b)
    return (value,) * 3 if type(value) is float else _texture(value, unit)


def _number_map(value: Value, unit: float) -> Any:
    return value if type(value) is float else _texture(value, unit)


def _element(category: str) -> Conversion:
    return lambda value, unit: value if type(value) is Element and value.category == category else SLOW


_texture = _element("texture")


def _rotation(value: Value, unit: float) -> Any:
    if type(value) is tuple and len(value) == 3:
        x, y, z = [part.value if type(part) is Quantity and part.dimension == units.ANGLE else SLOW for part in value]
        return SLOW if SLOW in (x, y, z) else Euler((x, y, z))
    return value if type(value) in (AxisAngle, Quaternion, Euler) else SLOW


_CONVERSIONS: dict[str, Conversion] = {
    "number": _of_type(float),
    "int": _int,
    "bool": _of_type(bool),
    "string": _of_type(str),
    "length": _length,
    **{name: _quantity(name) for name in units.QUANTITIES if name != "length"},
    "color": _color,
    "color_map": _color_map,
    "number_map": _number_map,
    "texture": _texture,
    "material": _element("material"),
    "medium": _element("medium"),
    "point": _point,
    "size3": _size(3),
    "size2": _size(2),
    "numbers2": _numbers(2),
    "scale3": _numbers(3, all_but_0=True),
    "direction": _direction,
    "rotation": _rotation,
}
