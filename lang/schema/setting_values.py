"""Readers of a setting's value: a text as on the command line (`800x600`, `3%`, `20s`), or the value as Python has it.

Each takes a value, and returns it checked. Each raises ValueError with the correct form.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable
from typing import Any

from .. import colors, units

Reader = Callable[[Any], Any]
MAX_SIDE = 1 << 16  # pixels of a picture's side


def _is_number(value: Any) -> bool:
    """Whether this is a finite number of Python or numpy, and not a truth value."""
    if isinstance(value, bool | str | bytes) or type(value).__name__ == "bool_" or not hasattr(value, "__float__"):
        return False
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):
        return False


def _whole(value: Any) -> int | None:
    """A whole number, of Python, numpy or a text; None for anything else."""
    if isinstance(value, str):
        return int(value) if re.fullmatch(r"[+-]?[0-9]{1,30}", value.strip()) else None
    try:
        return None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        return None


def _items(value: Any) -> list[Any] | None:
    """The items of a list, tuple or array; None for anything else."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return list(value) if isinstance(value, list | tuple) else None


def number(value: Any, message: str) -> float | units.Quantity:
    """A finite number, or a text of one with a unit of the language: `1%`, `20s`, `0.5`. Raises ValueError(message)."""
    if not isinstance(value, str):
        if _is_number(value):
            return float(value)
        raise ValueError(message)
    match = re.fullmatch(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([a-zA-Zµ°]+|%)?", value.strip())
    read = units.literal(float(match[1]), match[2] or "") if match else None
    if read is None or not math.isfinite(read.value if isinstance(read, units.Quantity) else read):
        raise ValueError(message)
    return read


def whole_number(minimum: int, maximum: int) -> Reader:
    """A reader of whole numbers within these limits, which are included."""

    def read(value: Any) -> int:
        number = _whole(value)
        if number is None or not minimum <= number <= maximum:
            raise ValueError(f"write a whole number from {minimum} to {maximum}")
        return number

    return read


def positive(value: Any) -> float:
    """A number above zero."""
    message = "write a number above 0"
    read = number(value, message)
    if isinstance(read, units.Quantity) or read <= 0:
        raise ValueError(message)
    return read


def choice(names: tuple[str, ...]) -> Reader:
    """A reader of one of these names."""

    def read(value: Any) -> str:
        if not isinstance(value, str) or value not in names:
            raise ValueError(f"write one of {', '.join(names)}")
        return value

    return read


def name(value: Any) -> str:
    """A text."""
    if not isinstance(value, str) or not value:
        raise ValueError("write a name")
    return value


def file(value: Any) -> str:
    """The name of a file."""
    if hasattr(value, "__fspath__"):
        value = value.__fspath__()
    if not isinstance(value, str) or not value:
        raise ValueError("write the name of a file")
    return value


def flag(value: Any) -> bool:
    """True or False."""
    if isinstance(value, bool) or type(value).__name__ == "bool_":
        return bool(value)
    raise ValueError("write True or False")


def size(value: Any) -> tuple[int, int]:
    """`800x600`, `512` for a square, or (width, height)."""
    message = "a size is written 800x600, or 512 for a square"
    if isinstance(value, str):
        match = re.fullmatch(r"(\d{1,30})(?:[xX×](\d{1,30}))?", value.strip())
        sides = [int(match[1]), int(match[2] or match[1])] if match else []
    else:
        message = "a size is (width, height) in whole pixels"
        sides = [side for side in map(_whole, _items(value) or ()) if side is not None]
    if len(sides) != 2:
        raise ValueError(message)
    width, height = sides
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE):
        raise ValueError(f"a picture's sides are 1 to {MAX_SIDE} pixels")
    return width, height


def share(value: Any) -> float:
    """`1%` or `0.01`, above zero and below one."""
    message = "a share is written 1% or 0.01, and is more than 0"
    read = number(value, message)
    if isinstance(read, units.Quantity) or read <= 0:
        raise ValueError(message)
    if read >= 1:
        raise ValueError(f"that is {read:.0%}: {f'write {read:g}%' if read < 100 else 'a share is written 1% or 0.01'}")
    return read


def seconds(value: Any) -> float:
    """`20s`, `500ms`, `2min`, or a bare number of seconds."""
    message = "a time is written 20s, 500ms or 2min"
    read = number(value, message)
    if not isinstance(read, units.Quantity):
        return read
    if read.dimension != units.TIME:
        raise ValueError(message)
    return read.value


def duration(value: Any) -> float:
    """A time above zero."""
    read = seconds(value)
    if read <= 0:
        raise ValueError("a budget is more than 0 seconds")
    return read


def exposure(value: Any) -> float:
    """Stops: `-1.5`, or `-1.5ev` as in a scene."""
    message = "an exposure is a number of stops, like -1.5 or 2ev"
    read = number(value, message)
    if isinstance(read, units.Quantity) or abs(read) > 100:
        raise ValueError(message)
    return read


def white(value: Any) -> float | str:
    """Kelvin, `4000K` or 4000, or `auto`."""
    low, high = colors.KELVIN_RANGE
    message = f"a white balance is a temperature of {low:g} to {high:g} kelvin, like 4000K, or auto"
    if value == "auto":
        return "auto"
    read = number(value.strip().removesuffix("K") if isinstance(value, str) else value, message)
    if isinstance(read, units.Quantity) or not low <= read <= high:
        raise ValueError(message)
    return read


def crop(value: Any) -> tuple[int, int, int, int]:
    """`x0,y0,x1,y1` in pixels from the top left; x1 and y1 are exclusive."""
    items: Iterable[Any] = value.split(",") if isinstance(value, str) else _items(value) or ()
    corners = tuple(side for side in map(_whole, items) if side is not None and side >= 0)
    if len(corners) != 4 or len(tuple(items)) != 4:
        raise ValueError("a crop is written x0,y0,x1,y1, in pixels from the top left")
    x0, y0, x1, y1 = corners
    if not (x0 < x1 and y0 < y1):
        raise ValueError("a crop has x0 < x1 and y0 < y1")
    return x0, y0, x1, y1


def background(value: Any) -> str | tuple[float, float, float]:
    """`sky`, `transparent`, an sRGB colour `#rrggbb` (returned linear), or three linear numbers."""
    message = "a background is sky, transparent or a colour like #87b5e0"
    if not isinstance(value, str):
        items = _items(value) or ()
        if len(items) != 3 or not all(_is_number(item) and item >= 0 for item in items):
            raise ValueError(f"{message}, or three linear numbers from 0")
        r, g, b = map(float, items)
        return r, g, b
    if value in ("sky", "transparent"):
        return value
    if not re.fullmatch(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})", value):
        raise ValueError(message)
    return colors.from_hex(value)


def names(value: Any) -> tuple[str, ...]:
    """Names separated by commas, or a list of them."""
    items = value.split(",") if isinstance(value, str) else _items(value) or ()
    if not all(isinstance(item, str) for item in items):
        raise ValueError("channels are names, like depth,normal,albedo")
    channels = tuple(item.strip() for item in items if item.strip())
    if not channels and (isinstance(value, str) or _items(value) is None):
        raise ValueError("channels are written depth,normal,albedo")
    return channels
