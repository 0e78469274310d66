"""Units as dimensions: quantities, the table of units, and how both are named in messages."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Exponents of length, angle, time and luminous intensity. An angle is a dimension of its own, so that lm = cd·rad² and
# lx = lm/m² stay apart from cd and nit. Exponents are whole, or floats where roots were taken.
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

# The types of entries.TYPES and `param` that are one quantity, and the unit to write them in.
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

# Symbol -> (value in base units: metre, radian, second, candela and what follows from them; dimension).
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


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number with a dimension, in base units (m, rad, s, cd and their products). A plain number is a float, not this."""

    value: float
    dimension: Dimension


def quantity(value: float, dimension: Dimension) -> float | Quantity:
    """`value` in base units as a Quantity, or as a float where the dimension has gone."""
    return value if dimension == NONE else Quantity(value, dimension)


def literal(value: float, unit: str) -> float | Quantity | None:
    """The number written as `value` and `unit`; None for an unknown unit."""
    known = UNITS.get(unit)
    return None if known is None else quantity(scale(value, known[0]), known[1])


def scale(value: float, factor: float) -> float:
    """`value · factor`, divided where the factor is one over a whole number: so 35cm is 0.35 to the last digit."""
    if factor >= 1:
        return value * factor
    inverse = 1 / factor
    whole = round(inverse)
    return value / whole if abs(inverse - whole) < 1e-9 * inverse else value * factor


def multiply(a: Dimension, b: Dimension) -> Dimension:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3])


def divide(a: Dimension, b: Dimension) -> Dimension:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3])


def power(a: Dimension, exponent: float) -> Dimension:
    """The dimension of a quantity raised to `exponent`; rounded so that ∛ and ^3 undo each other."""
    length, angle, time, light = (_whole(round(e * exponent, 9)) for e in a)
    return (length, angle, time, light)


def _whole(value: float) -> float:
    return int(value) if value == int(value) else value


def name(dimension: Dimension) -> str:
    """What a dimension is called in messages: `length`, `speed`, or its units where it has no name."""
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
    """A number as a person would write it: 24, 0.333333, 1e+09."""
    return f"{int(value)}" if value == int(value) and abs(value) < 1e9 else f"{value:.6g}"


def show(value: float | Quantity) -> str:
    """A number or quantity as it would be written in a scene: 24, 30deg, 0.3m."""
    if not isinstance(value, Quantity):
        return show_number(value)
    if value.dimension == ANGLE:
        return f"{show_number(round(value.value / _DEGREE, 9))}deg"
    unit = symbol(value.dimension)
    return f"{show_number(value.value)}{' ' if unit.startswith('1') else ''}{unit}"


def in_unit(value: float, unit: str) -> float:
    """A value in base units, expressed in `unit`; rounded past the last digit that the division can spoil."""
    scaled = value / UNITS[unit][0]
    return float(f"{scaled:.15g}")
