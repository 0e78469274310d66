"""Dimensions, quantities and the table of units, with their names in messages."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Exponents of length, angle, time and luminous intensity. Angle is a dimension, so that lm = cd·rad² and lx = lm/m² differ from
# cd and nit. Exponents are integers, or floats after roots.
Dimension = tuple[float, float, float, float]

NONE: Dimension = (0, 0, 0, 0)
LENGTH: Dimension = (1, 0, 0, 0)
AREA: Dimension = (2, 0, 0, 0)
ANGLE: Dimension = (0, 1, 0, 0)
TIME: Dimension = (0, 0, 1, 0)
INTENSITY: Dimension = (0, 0, 0, 1)
ILLUMINANCE: Dimension = (-2, 2, 0, 1)
LUMINANCE: Dimension = (-2, 0, 0, 1)
FLUX: Dimension = (0, 2, 0, 1)

# The argument types and `param` types that are one quantity, with the unit shown in messages.
QUANTITIES: dict[str, tuple[Dimension, str]] = {
    "length": (LENGTH, "m"),
    "angle": (ANGLE, "deg"),
    "time": (TIME, "s"),
    "intensity": (INTENSITY, "cd"),
    "illuminance": (ILLUMINANCE, "lx"),
    "luminance": (LUMINANCE, "nit"),
    "flux": (FLUX, "lm"),
}

_NAMES: dict[Dimension, str] = {
    NONE: "number",
    **{dimension: name for name, (dimension, _) in QUANTITIES.items()},
    AREA: "area",
    (3, 0, 0, 0): "volume",
    (0, 2, 0, 0): "solid angle",
    (1, 0, -1, 0): "speed",
    (0, 1, -1, 0): "angular speed",
    (0, 0, -1, 0): "frequency",
}

_DEGREE = math.pi / 180
SMALL = 1e-4  # metres, below which lengths are shown in micrometres

# Symbol -> (value in base units, dimension). The base units are metre, radian, second, candela and their products.
UNITS: dict[str, tuple[float, Dimension]] = {
    "": (1.0, NONE),
    "%": (0.01, NONE),
    "ev": (1.0, NONE),
    "m": (1.0, LENGTH),
    "cm": (0.01, LENGTH),
    "mm": (0.001, LENGTH),
    "km": (1000.0, LENGTH),
    "um": (1e-6, LENGTH),
    "µm": (1e-6, LENGTH),  # micro sign
    "μm": (1e-6, LENGTH),  # Greek mu
    "nm": (1e-9, LENGTH),
    "in": (0.0254, LENGTH),
    "inch": (0.0254, LENGTH),  # `in` is a keyword, so `unit inch`
    "ft": (0.3048, LENGTH),
    "deg": (_DEGREE, ANGLE),
    "°": (_DEGREE, ANGLE),
    "rad": (1.0, ANGLE),
    "turn": (2 * math.pi, ANGLE),
    "sr": (1.0, (0, 2, 0, 0)),
    "s": (1.0, TIME),
    "ms": (0.001, TIME),
    "min": (60.0, TIME),
    "h": (3600.0, TIME),
    **{
        prefix + symbol: (factor, dimension)
        for prefix, factor in (("", 1.0), ("k", 1000.0), ("m", 0.001))
        for symbol, dimension in (("cd", INTENSITY), ("lx", ILLUMINANCE), ("nit", LUMINANCE), ("lm", FLUX))
    },
}


_LISTED = (
    ("lengths are", (LENGTH,)), ("angles", (ANGLE,)), ("times", (TIME,)), ("light is", (INTENSITY, ILLUMINANCE, LUMINANCE, FLUX)),
)  # fmt: skip


def listed() -> str:
    """The units by what they measure, for messages, without k and m before those of light."""
    plain = [(u, d) for u, (factor, d) in UNITS.items() if u.isascii() and (factor == 1.0 or d in (LENGTH, ANGLE, TIME))]
    return "; ".join(f"{what} in {', '.join(unit for unit, d in plain if d in dimensions)}" for what, dimensions in _LISTED)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with a dimension, in base units (m, rad, s, cd and their products). Plain numbers are floats."""

    value: float
    dimension: Dimension


def quantity(value: float, dimension: Dimension) -> float | Quantity:
    """`value` in base units as a Quantity, or as a float without a dimension."""
    return value if dimension == NONE else Quantity(value, dimension)


def literal(value: float, unit: str) -> float | Quantity | None:
    """The quantity of a literal such as 35cm; None for an unknown unit."""
    unit_value = UNITS.get(unit)
    return None if unit_value is None else quantity(scale(value, unit_value[0]), unit_value[1])


def scale(value: float, factor: float) -> float:
    """`value · factor`. Divides if the factor is the inverse of an integer, so that 35cm is exactly 0.35."""
    if factor >= 1:
        return value * factor
    inverse = 1 / factor
    rounded = round(inverse)
    return value / rounded if abs(inverse - rounded) < 1e-9 * inverse else value * factor


def multiply(a: Dimension, b: Dimension) -> Dimension:
    """The dimension of a product."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def divide(a: Dimension, b: Dimension) -> Dimension:
    """The dimension of a quotient."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3])


def power(a: Dimension, exponent: float) -> Dimension:
    """The dimension of a quantity raised to `exponent`, rounded to 9 digits so that ∛ and ^3 are inverse."""
    length, angle, time, light = (_whole(round(e * exponent, 9)) for e in a)
    return (length, angle, time, light)


def _whole(value: float) -> float:
    return int(value) if value == int(value) else value


def name(dimension: Dimension) -> str:
    """The name of a dimension in messages: `length`, `speed`; without a name, its units."""
    return _NAMES.get(dimension) or f"quantity in {symbol(dimension)}"


def symbol(dimension: Dimension) -> str:
    """The base unit of a dimension: `m`, `lx`, `rad/s`, `m^0.5`."""
    for other, unit in QUANTITIES.values():
        if other == dimension and unit != "deg":
            return unit
    parts = list(zip(("m", "rad", "s", "cd"), dimension, strict=True))
    over = "·".join(_with_exponent(base, e) for base, e in parts if e > 0)
    under = "·".join(_with_exponent(base, -e) for base, e in parts if e < 0)
    return f"{over or '1'}/{under}" if under else over


def _with_exponent(base: str, exponent: float) -> str:
    return base if exponent == 1 else base + {2.0: "²", 3.0: "³"}.get(exponent, f"^{exponent:g}")


def show_number(value: float) -> str:
    """A number as text, with at most 6 digits unless it is an integer: 24, 0.333333, 1e+09."""
    return f"{int(value)}" if value == int(value) and abs(value) < 1e9 else f"{value:.6g}"


def show(value: float | Quantity) -> str:
    """A number or quantity in the syntax of a scene: 24, 30deg, 0.3m."""
    if not isinstance(value, Quantity):
        return show_number(value)
    if value.dimension == ANGLE:
        return f"{show_number(round(value.value / _DEGREE, 9))}deg"
    if value.dimension == LENGTH and 0.0 < abs(value.value) < SMALL:
        return f"{show_number(in_unit(value.value, 'um'))}um"
    unit = symbol(value.dimension)
    return f"{show_number(value.value)}{' ' if unit.startswith('1') else ''}{unit}"


def in_unit(value: float, unit: str) -> float:
    """A value in base units converted to `unit`, rounded to 15 digits to hide the rounding error of the division."""
    scaled = value / UNITS[unit][0]
    return float(f"{scaled:.15g}")
