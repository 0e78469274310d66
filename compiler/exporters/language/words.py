"""Text of the language: numbers, strings, colours, calls."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ....lang import colors

WIDTH = 120  # of a line, from which a call is broken
_DIGITS = 12  # of numbers that are not of single precision


def number(value: float) -> str:
    """The shortest text of a number: the same float32 where it is one, else with 12 digits."""
    value = float(value) + 0.0
    if value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if abs(value) < 1e38 and float(np.float32(value)) == value:
        return str(np.float32(value))
    return f"{value:.{_DIGITS}g}"


def numbers(values: Iterable[float]) -> str:
    """A list of numbers."""
    return f"[{', '.join(map(number, values))}]"


def one_or_all(values: Sequence[float] | np.ndarray) -> str:
    """A list of numbers, or the number if they are equal."""
    return number(values[0]) if len({float(v) for v in values}) == 1 else numbers(values)


def string(text: str) -> str:
    """A string in quotes."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    escaped = plain.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def color(values: Iterable[float]) -> str:
    """A colour: as #rrggbb if it is exactly that one, else as linear light."""
    r, g, b = (float(v) for v in values)
    hexadecimal = colors.to_hex((r, g, b))
    if all(math.isclose(a, c, rel_tol=1e-7) for a, c in zip(colors.from_hex(hexadecimal), (r, g, b), strict=True)):
        return hexadecimal
    return f"rgb({number(r)}, {number(g)}, {number(b)})"


def grey_or_color(values: Iterable[float]) -> str:
    """A colour; one that is grey as a number."""
    r, g, b = (float(v) for v in values)
    return number(r) if r == g == b else color((r, g, b))


def degrees(radians: float, share: float = math.inf) -> str:
    """An angle, with as few digits as give the same one to 10⁻¹² of a turn, and to this share of it."""
    angle = math.degrees(radians)
    for digits in range(13):
        if abs(round(angle, digits) - angle) < min(1e-10, share * abs(angle)):
            return f"{number(round(angle, digits))}deg"
    return f"{number(angle)}deg"


def call(name: str, /, *positional: str, **named: str | None) -> str:
    """A call on a line, or with a line for each argument where it is long. Arguments that are None are left out."""
    arguments = [*positional, *(f"{key.rstrip('_')}: {text}" for key, text in named.items() if text is not None)]
    line = f"{name}({', '.join(arguments)})"
    if len(line) <= WIDTH and "\n" not in line:
        return line
    return "\n".join([f"{name}(", *(f"{argument}," for argument in arguments), ")"])


def differing(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """The values that are not the defaults."""
    return {name: value for name, value in values.items() if value != defaults.get(name)}
