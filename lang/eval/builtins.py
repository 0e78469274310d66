"""The built-in functions and constants of the language: `FUNCTIONS` and `CONSTANTS`."""

from __future__ import annotations

import math

from .. import colors, limits, units
from ..elements import AxisAngle, Falloff, Quaternion
from ..units import Quantity
from . import operators
from .builtin_table import FUNCTIONS, bare_radians, define, require_list, require_number, require_vector
from .builtin_vectors import same_dimension
from .context import Scope
from .operators import has_term, split
from .values import AssertionFails, Color, Mistake, Value, describe, is_placeable, kind, show

__all__ = ["CONSTANTS", "FUNCTIONS"]

# --- lists and strings ----------------------------------------------------------------------------------------------


@define("len list", "number of items of a list, or of characters of a string")
def _len(scope: Scope, value: Value) -> Value:
    if isinstance(value, str):
        return float(len(value))
    return float(len(require_list(value, 0)))


@define("concat first rest*", "concatenation of lists")
def _concat(scope: Scope, *lists: Value) -> Value:
    limits.check_list(sum(len(require_list(v, i)) for i, v in enumerate(lists)))
    joined: list[Value] = []
    for v in lists:
        joined.extend(v)
    scope.meter.step(1 + len(joined) // 64)
    return tuple(joined)


@define("map function list", "the function applied to every item")
def _map(scope: Scope, function: Value, items: Value) -> Value:
    return tuple([scope.call(function, [v]) for v in require_list(items, 1)])


@define("filter function list", "the items for which the function is true")
def _filter(scope: Scope, function: Value, items: Value) -> Value:
    selected = []
    for v in require_list(items, 1):
        passes = scope.call(function, [v])
        if not isinstance(passes, bool):
            raise Mistake(f"filter expects a function with a truth value, got {kind(passes)}", argument=0)
        if passes:
            selected.append(v)
    return tuple(selected)


@define("fold function start list", "result = function(result, item) for every item, from result = start: the last result")
def _fold(scope: Scope, function: Value, start: Value, items: Value) -> Value:
    for v in require_list(items, 2):
        start = scope.call(function, [start, v])
    return start


@define("scan function start list", "as fold, but the list of start and all results")
def _scan(scope: Scope, function: Value, start: Value, items: Value) -> Value:
    results = [start]
    for v in require_list(items, 2):
        results.append(scope.call(function, [results[-1], v]))
    return tuple(results)


@define("string value", "text of a value")
def _string(scope: Scope, value: Value) -> Value:
    if is_placeable(value) and value != ():
        raise Mistake(f"cannot make a string of {describe(value)}", argument=0)
    text = show(value)
    limits.check_text(len(text))
    return text


@define("assert condition message?", "an error with this message and the values in the condition where it is false")
def _assert(scope: Scope, condition: Value, message: Value = "") -> Value:
    if not isinstance(condition, bool):
        raise Mistake(f"expected truth value, got {describe(condition)}", argument=0)
    if not isinstance(message, str):
        raise Mistake(f"expected string, got {describe(message)}", argument=1)
    if not condition:
        raise AssertionFails(f"the assertion fails: {message}" if message else "the assertion fails", argument=0)
    return ()  # which places nothing


# --- colours --------------------------------------------------------------------------------------------------------


def _check_channels(values: tuple[Value, ...], highest: float, hint: str) -> tuple[Value, ...]:
    for i, v in enumerate(values):
        require_number(v, i)
        if isinstance(v, float) and not 0 <= v <= highest:
            wanted = f"0..{highest:g}" if math.isfinite(highest) else "0 or more"
            raise Mistake(f"a channel is {wanted}, got {units.show_number(v)}", hint, argument=i)
    return values


@define("rgb r g b", "a colour from linear Rec.709 channels")
def _rgb(scope: Scope, r: Value, g: Value, b: Value) -> Value:
    return Color(*_check_channels((r, g, b), math.inf, ""))


@define("srgb r g b", "a colour from sRGB channels, 0..1")
def _srgb(scope: Scope, r: Value, g: Value, b: Value) -> Value:
    channels = _check_channels((r, g, b), 1.0, "write n / 255, or #rrggbb")
    if has_term(*channels):
        raise Mistake("srgb(…) cannot depend on a formula's parameters", "use rgb(…)")
    return Color(*[colors.srgb_to_linear(c) for c in channels])


@define("hsv hue saturation value", "a colour from hue (an angle), saturation and value (0..1) in sRGB")
def _hsv(scope: Scope, hue: Value, saturation: Value, value: Value) -> Value:
    if has_term(hue, saturation, value):
        raise Mistake("hsv(…) cannot depend on a formula's parameters", "use rgb(…)")
    if isinstance(hue, Quantity) and hue.dimension != units.ANGLE:
        raise Mistake(f"expected angle, got {describe(hue)}", argument=0)
    radians = hue.value if isinstance(hue, Quantity) else bare_radians(require_number(hue), scope)
    for i, v in enumerate((saturation, value), 1):
        if not 0 <= require_number(v, i) <= 1:
            raise Mistake(f"saturation and value are 0..1, got {units.show_number(v)}", argument=i)
    return Color(*[colors.srgb_to_linear(min(max(c, 0.0), 1.0)) for c in colors.hsv_to_srgb(radians, saturation, value)])


@define("kelvin temperature", "colour of a black body at this temperature, with luminance 1")
def _kelvin(scope: Scope, temperature: Value) -> Value:
    low, high = colors.KELVIN_RANGE
    if not isinstance(temperature, float) or not low <= temperature <= high:
        raise Mistake(f"expected temperature in {low:g}..{high:g} kelvin, got {describe(temperature)}", argument=0)
    return Color(*colors.kelvin(temperature))


# --- rotations, matrices, fall-off ----------------------------------------------------------------------------------


@define("axis direction angle", "a rotation by angle about a direction")
def _axis(scope: Scope, direction: Value, angle: Value) -> Value:
    if len(require_vector(direction, 0)) != 3 or has_term(*direction):
        raise Mistake("an axis is a list of three numbers", argument=0)
    x, y, z = [split(v)[0] for v in same_dimension(direction, scope)]
    if x == y == z == 0:
        raise Mistake("an axis of length 0 has no direction", argument=0)
    if isinstance(angle, Quantity) and angle.dimension == units.ANGLE:
        return AxisAngle((x, y, z), angle.value)
    if isinstance(angle, float):
        return AxisAngle((x, y, z), _radians_of(angle, scope))
    raise Mistake(f"expected angle, got {describe(angle)}", argument=1)


def _radians_of(angle: float, scope: Scope) -> float:
    try:
        return operators.bare(angle, units.ANGLE, scope)
    except Mistake as mistake:
        raise Mistake(mistake.message, mistake.hint, argument=1) from None


@define("quaternion x y z w", "a rotation as a quaternion; normalised when used")
def _quaternion(scope: Scope, *parts: Value) -> Value:
    for i, p in enumerate(parts):
        if not isinstance(p, float):
            raise Mistake(f"expected number, got {describe(p)}", argument=i)
    if not any(parts):
        raise Mistake("a quaternion of length 0 is not a rotation")
    return Quaternion(*parts)


@define("matrix row0 row1 row2 row3?", "the rows of a matrix, for transform(matrix: …)")
def _matrix(scope: Scope, *rows: Value) -> Value:
    for i, row in enumerate(rows):
        if len(require_vector(row, i)) != 4:
            raise Mistake(f"expected row of four numbers, got a list of {len(row)}", argument=i)
    return rows


@define("ramp start end", "a fall-off: 1 up to the distance start, then linear to 0 at end")
def _ramp(scope: Scope, start: Value, end: Value) -> Value:
    distances = []
    for i, v in enumerate((start, end)):
        if not isinstance(v, float) and not (isinstance(v, Quantity) and v.dimension == units.LENGTH):
            raise Mistake(f"expected length, got {describe(v)}", argument=i)
        distances.append(v.value if isinstance(v, Quantity) else operators.bare(v, units.LENGTH, scope))
    if not 0 <= distances[0] < distances[1]:
        raise Mistake("a ramp starts at 0 or more and ends after its start", argument=1)
    return Falloff("ramp", (distances[0], distances[1], 0.0))


CONSTANTS: dict[str, Value] = {"pi": math.pi, "true": True, "false": False}
