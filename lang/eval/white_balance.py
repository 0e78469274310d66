"""The argument type of white balance: kelvin, a colour of kelvin(…), or "auto"."""

from __future__ import annotations

from typing import Any

from .. import colors
from ..schema.argument_types import Arg
from .values import Color, Mistake, Value, describe


def read(value: Value, place: Any, arg: Arg) -> float | str:
    """A temperature in kelvin, or "auto". Raises Mistake."""
    if value == "auto" and isinstance(value, str):
        return "auto"
    if isinstance(value, Color):
        kelvin = colors.temperature((value.r, value.g, value.b))
        if kelvin is None:
            raise Mistake(f"`{arg.name}` takes the light of a black body, and this is another colour", "write kelvin(4000)")
        return round(kelvin, 3)
    if not isinstance(value, float):
        raise Mistake(f'expected temperature in kelvin or "auto", got {describe(value)}', "write 4000")
    low, high = colors.KELVIN_RANGE
    if not low <= value <= high:
        raise Mistake(f"`{arg.name}` must be {low:g}..{high:g} kelvin, got {value:g}")
    return value
