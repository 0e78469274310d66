"""The functions and constants of the language itself, in one table."""

from __future__ import annotations

import math
from collections.abc import Callable

from .. import colors, limits, units
from ..elements import AxisAngle, Falloff, Quaternion
from ..formula_graph import OPERATIONS
from ..noise import offset
from ..units import Quantity
from . import operators, suggestions
from .context import Scope
from .operators import checked, has_term, record, split, unify, unify_all
from .values import Builtin, Color, Mistake, Value, describe, is_placeable, kind, show

FUNCTIONS: dict[str, Builtin] = {}


def _define(signature: str, doc: str) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Put a function into the table. `signature` is `name a b c? rest*`: `?` may be left out, `*` any number more."""
    name, *parameters = signature.split()
    required = sum(p[-1] not in "?*" for p in parameters)
    variadic = bool(parameters) and parameters[-1].endswith("*")

    def keep(run: Callable[..., Value]) -> Callable[..., Value]:
        names = tuple([p.rstrip("?*") for p in parameters if not p.endswith("*")])
        FUNCTIONS[name] = Builtin(name, names, required, run, variadic, doc)
        return run

    return keep


# --- checks ---------------------------------------------------------------------------------------------------------


def _scalar(value: Value, argument: int = 0) -> Value:
    if not operators.is_scalar(value):
        raise Mistake(f"number wanted, got {describe(value)}", argument=argument)
    return value


def _plain(value: Value, argument: int = 0, hint: str = "") -> Value:
    """A plain number or a term."""
    if type(value) is not float and not (operators.is_scalar(value) and has_term(value)):
        raise Mistake(f"number wanted, got {describe(value)}", hint, argument)
    return value


def _list(value: Value, argument: int) -> tuple[Value, ...]:
    if not isinstance(value, tuple):
        raise Mistake(f"list wanted, got {describe(value)}", suggestions.NO_POINT if has_term(value) else "", argument)
    return value


def _vector(value: Value, argument: int) -> tuple[Value, ...]:
    for item in _list(value, argument):
        if not operators.is_scalar(item):
            raise Mistake(f"list of numbers wanted, got {kind(item)} in it", argument=argument)
    return value


def _apply(op: str, *args: Value) -> Value:
    """An operation on plain numbers, recorded if one is a term."""
    if has_term(*args):
        return record(op, *args)
    try:
        return checked(OPERATIONS[op](*args))
    except (ValueError, ZeroDivisionError):
        given = ", ".join(units.show_number(a) for a in args)
        raise Mistake(f"{op}({given}) is not defined") from None
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


# --- numbers --------------------------------------------------------------------------------------------------------


def _trigonometry(name: str) -> None:
    @_define(f"{name} angle", f"{name} of an angle")
    def run(scope: Scope, angle: Value) -> Value:
        _scalar(angle)
        if has_term(angle):
            return record(name, angle)
        if isinstance(angle, Quantity) and angle.dimension != units.ANGLE:
            raise Mistake(f"angle wanted, got {describe(angle)}", argument=0)
        return checked(OPERATIONS[name](angle.value if isinstance(angle, Quantity) else _radians(angle, scope)))


def _radians(value: float, scope: Scope) -> float:
    try:
        return operators.bare(value, units.ANGLE, scope)
    except Mistake as mistake:
        number = units.show_number(value)
        raise Mistake(mistake.message, f"write {number}deg or {number}rad; * 1rad makes an angle of a number", argument=0) from None


def _inverse(name: str) -> None:
    @_define(f"{name} value", f"the angle whose {name[1:]} is value")
    def run(scope: Scope, value: Value) -> Value:
        result = _apply(name, _plain(value))
        return units.quantity(result, units.ANGLE) if isinstance(result, float) else result


for _name in ("sin", "cos", "tan"):
    _trigonometry(_name)
for _name in ("asin", "acos", "atan"):
    _inverse(_name)


@_define("atan2 y x", "the angle of the direction (x, y)")
def _atan2(scope: Scope, y: Value, x: Value) -> Value:
    if has_term(_scalar(y), _scalar(x, 1)):
        return record("atan2", y, x)
    a, b, _ = unify(y, x, scope, "compare")
    return units.quantity(OPERATIONS["atan2"](a, b), units.ANGLE)


def _on_plain(name: str, doc: str) -> None:
    @_define(f"{name} value", doc)
    def run(scope: Scope, value: Value) -> Value:
        return _apply(name, _plain(value, hint="divide by a unit first, as in floor(x / 1cm)" if isinstance(value, Quantity) else ""))


for _name, _doc in (
    ("exp", "e to the power of value"),
    ("log", "natural logarithm"),
    ("floor", "the whole number below"),
    ("ceil", "the whole number above"),
    ("round", "the nearest whole number, halves up"),
):
    _on_plain(_name, _doc)


@_define("abs value", "without its sign")
def _abs(scope: Scope, value: Value) -> Value:
    if has_term(_scalar(value)):
        return record("abs", value)
    x, dimension = split(value)
    return units.quantity(abs(x), dimension)


@_define("sign value", "-1, 0 or 1")
def _sign(scope: Scope, value: Value) -> Value:
    return record("sign", value) if has_term(_scalar(value)) else OPERATIONS["sign"](split(value)[0])


@_define("sqrt value", "square root; of an area, a length")
def _sqrt(scope: Scope, value: Value) -> Value:
    if has_term(_scalar(value)):
        return record("sqrt", value)
    x, dimension = split(value)
    if x < 0:
        raise Mistake(f"sqrt({units.show(value)}) is not defined", argument=0)
    return units.quantity(math.sqrt(x), units.power(dimension, 0.5))


@_define("pow base exponent", "base ^ exponent")
def _pow(scope: Scope, base: Value, exponent: Value) -> Value:
    return operators.power(base, exponent, scope)


@_define("mod a b", "remainder of a / b, with the sign of b")
def _mod(scope: Scope, a: Value, b: Value) -> Value:
    if has_term(_scalar(a), _scalar(b, 1)):
        return record("mod", a, b)
    x, y, dimension = unify(a, b, scope, "divide")
    if y == 0:
        raise Mistake("division by 0", argument=1)
    return checked(OPERATIONS["mod"](x, y), dimension)


def _combine(op: str, numbers: list[Value], scope: Scope) -> Value:
    """`op` of two, over any count of numbers of one dimension."""
    if has_term(*numbers):
        result = numbers[0]
        for n in numbers[1:]:
            result = record(op, result, n)
        return result
    values, dimension = unify_all(numbers, scope, "compare")
    return checked(OPERATIONS[op](*values), dimension)


def _extreme(name: str, doc: str) -> None:
    @_define(f"{name} first rest*", doc)
    def run(scope: Scope, first: Value, *rest: Value) -> Value:
        numbers = list(_list(first, 0)) if isinstance(first, tuple) and not rest else [first, *rest]
        if not numbers:
            raise Mistake(f"{name} of an empty list", argument=0)
        for i, n in enumerate(numbers):
            _scalar(n, i if len(numbers) == 1 + len(rest) else 0)
        scope.meter.step(len(numbers))
        return _combine(name, numbers, scope) if len(numbers) > 1 else numbers[0]


_extreme("min", "the smallest of its arguments or of a list")
_extreme("max", "the largest of its arguments or of a list")


@_define("hypot a b c?", "√(a² + b² + c²)")
def _hypot(scope: Scope, *numbers: Value) -> Value:
    return _combine("hypot", [_scalar(n, i) for i, n in enumerate(numbers)], scope)


@_define("clamp value low high", "value, but not below low nor above high")
def _clamp(scope: Scope, value: Value, low: Value, high: Value) -> Value:
    for i, n in enumerate((value, low, high)):
        _scalar(n, i)
    return _combine("min", [_combine("max", [value, low], scope), high], scope)


@_define("lerp a b t", "a + t (b - a), of numbers, lists or colours")
def _lerp(scope: Scope, a: Value, b: Value, t: Value) -> Value:
    _plain(t, 2)
    return operators.add(a, operators.multiply(operators.subtract(b, a, scope), t, scope), scope)


@_define("step edge value", "0 below the edge, 1 from it on")
def _step(scope: Scope, edge: Value, value: Value) -> Value:
    below = operators.compare("less", value, edge, scope)
    return (0.0 if below else 1.0) if isinstance(below, bool) else operators.select(below, 0.0, 1.0, scope)


@_define("smoothstep low high value", "0 below low, 1 above high, 3 t² - 2 t³ between")
def _smoothstep(scope: Scope, low: Value, high: Value, value: Value) -> Value:
    for i, n in enumerate((low, high, value)):
        _scalar(n, i)
    t = operators.divide(operators.subtract(value, low, scope), operators.subtract(high, low, scope), scope)
    t = _combine("min", [_combine("max", [t, 0.0], scope), 1.0], scope)
    bend = operators.subtract(3.0, operators.multiply(2.0, t, scope), scope)
    return operators.multiply(operators.multiply(t, t, scope), bend, scope)


@_define("noise x y? z? seed?", "gradient noise in -1..1, 0 at whole coordinates; of one to three numbers or a list; seed: 1 … for others")
def _noise(scope: Scope, x: Value, *rest: Value, **named: Value) -> Value:
    """Perlin's of 2002. A seed is a whole number: it moves the lattice, which repeats every 256, to another of its 2²⁴ places."""
    if isinstance(x, tuple):
        beside = [*rest, *named.values()]
        if len(beside) > 1 or {"y", "z"} & set(named) or not 1 <= len(x) <= 3:
            raise Mistake(f"noise takes one to three numbers, or a list of them, and a seed; got a list of {len(x)}", argument=0)
        parts, seed = [_plain(part, 0) for part in x], beside[0] if beside else 0.0
    else:
        given = {**dict(zip(("y", "z", "seed"), rest, strict=False)), **named}
        parts = [_plain(part, i) for i, part in enumerate((x, given.get("y", 0.0), given.get("z", 0.0)))]
        seed = given.get("seed", 0.0)
    if type(seed) is not float or seed != int(seed):
        raise Mistake(f"a seed is a whole number, got {describe(seed)}", argument=len(rest) + len(named))
    parts += [0.0] * (3 - len(parts))
    moved = [operators.add(part, float(by), scope) if by else part for part, by in zip(parts, offset(int(seed)), strict=True)]
    return _apply("noise", *moved)


# --- vectors --------------------------------------------------------------------------------------------------------


def dot(scope: Scope, a: tuple[Value, ...], b: tuple[Value, ...]) -> Value:
    total: Value = None
    for x, y in zip(a, b, strict=True):
        product = operators.multiply(x, y, scope)
        total = product if total is None else operators.add(total, product, scope)
    return total


@_define("dot a b", "scalar product of two lists of one length")
def _dot(scope: Scope, a: Value, b: Value) -> Value:
    if len(_vector(a, 0)) != len(_vector(b, 1)) or not a:
        raise Mistake(f"dot of a list of {len(a)} and a list of {len(b)}", argument=1)
    return dot(scope, *_alike(a, b, scope))


@_define("cross a b", "vector product of two lists of three")
def _cross(scope: Scope, a: Value, b: Value) -> Value:
    for i, v in enumerate((a, b)):
        if len(_vector(v, i)) != 3:
            raise Mistake(f"list of 3 wanted, got a list of {len(v)}", argument=i)
    a, b = _alike(a, b, scope)

    def minor(i: int, j: int) -> Value:
        return operators.subtract(operators.multiply(a[i], b[j], scope), operators.multiply(a[j], b[i], scope), scope)

    return (minor(1, 2), minor(2, 0), minor(0, 1))


def _alike(a: tuple[Value, ...], b: tuple[Value, ...], scope: Scope) -> tuple[tuple[Value, ...], tuple[Value, ...]]:
    """Each list with all items of one dimension, so that sums of their products agree."""
    return _even(a, scope), _even(b, scope)


def _even(v: tuple[Value, ...], scope: Scope) -> tuple[Value, ...]:
    if has_term(*v) or all(type(n) is float for n in v):
        return v
    numbers, dimension = unify_all(list(v), scope, "combine")
    return tuple([units.quantity(n, dimension) for n in numbers])


@_define("length vector", "length of a list of numbers")
def _length(scope: Scope, vector: Value) -> Value:
    parts = list(_even(_vector(vector, 0), scope))
    if not parts:
        raise Mistake("length of an empty list", "write len(…) to count", argument=0)
    return _combine("hypot", parts, scope) if len(parts) > 1 else _abs(scope, parts[0])


@_define("normalize vector", "a list of numbers scaled to length 1")
def _normalize(scope: Scope, vector: Value) -> Value:
    size = _length(scope, vector)
    if not has_term(size) and split(size)[0] == 0:
        raise Mistake("a vector of length 0 has no direction", argument=0)
    return operators.divide(_even(vector, scope), size, scope)


# --- lists and strings ----------------------------------------------------------------------------------------------


@_define("len list", "how many items a list has, or characters a string")
def _len(scope: Scope, value: Value) -> Value:
    if isinstance(value, str):
        return float(len(value))
    return float(len(_list(value, 0)))


@_define("concat first rest*", "lists one behind the other")
def _concat(scope: Scope, *lists: Value) -> Value:
    limits.check_list(sum(len(_list(v, i)) for i, v in enumerate(lists)))
    joined: list[Value] = []
    for v in lists:
        joined.extend(v)
    scope.meter.step(1 + len(joined) // 64)
    return tuple(joined)


@_define("map function list", "the function of every item")
def _map(scope: Scope, function: Value, items: Value) -> Value:
    return tuple([scope.call(function, [v]) for v in _list(items, 1)])


@_define("filter function list", "the items for which the function is true")
def _filter(scope: Scope, function: Value, items: Value) -> Value:
    kept = []
    for v in _list(items, 1):
        keep = scope.call(function, [v])
        if not isinstance(keep, bool):
            raise Mistake(f"filter wants a function that gives true or false, got {kind(keep)}", argument=0)
        if keep:
            kept.append(v)
    return tuple(kept)


@_define("fold function start list", "start, then function(that, item) for every item: the last")
def _fold(scope: Scope, function: Value, start: Value, items: Value) -> Value:
    for v in _list(items, 2):
        start = scope.call(function, [start, v])
    return start


@_define("scan function start list", "start, then function(that, item) for every item: all of them")
def _scan(scope: Scope, function: Value, start: Value, items: Value) -> Value:
    results = [start]
    for v in _list(items, 2):
        results.append(scope.call(function, [results[-1], v]))
    return tuple(results)


@_define("string value", "a value as text")
def _string(scope: Scope, value: Value) -> Value:
    if is_placeable(value) and value != ():
        raise Mistake(f"cannot make a string of {describe(value)}", argument=0)
    text = show(value)
    limits.check_text(len(text))
    return text


# --- colours --------------------------------------------------------------------------------------------------------


def _channels(values: tuple[Value, ...], highest: float, hint: str) -> tuple[Value, ...]:
    for i, v in enumerate(values):
        _plain(v, i)
        if isinstance(v, float) and not 0 <= v <= highest:
            wanted = f"0..{highest:g}" if math.isfinite(highest) else "0 or more"
            raise Mistake(f"a channel is {wanted}, got {units.show_number(v)}", hint, argument=i)
    return values


@_define("rgb r g b", "a colour by its linear Rec.709 channels")
def _rgb(scope: Scope, r: Value, g: Value, b: Value) -> Value:
    return Color(*_channels((r, g, b), math.inf, ""))


@_define("srgb r g b", "a colour by its sRGB channels, 0..1")
def _srgb(scope: Scope, r: Value, g: Value, b: Value) -> Value:
    channels = _channels((r, g, b), 1.0, "write n / 255, or #rrggbb")
    if has_term(*channels):
        raise Mistake("srgb(…) cannot depend on a formula's parameters", "use rgb(…)")
    return Color(*[colors.srgb_to_linear(c) for c in channels])


@_define("hsv hue saturation value", "a colour by hue (an angle), saturation and value (0..1) of sRGB")
def _hsv(scope: Scope, hue: Value, saturation: Value, value: Value) -> Value:
    if has_term(hue, saturation, value):
        raise Mistake("hsv(…) cannot depend on a formula's parameters", "use rgb(…)")
    if isinstance(hue, Quantity) and hue.dimension != units.ANGLE:
        raise Mistake(f"angle wanted, got {describe(hue)}", argument=0)
    turned = hue.value if isinstance(hue, Quantity) else _radians(_plain(hue), scope)
    for i, v in enumerate((saturation, value), 1):
        if not 0 <= _plain(v, i) <= 1:
            raise Mistake(f"saturation and value are 0..1, got {units.show_number(v)}", argument=i)
    return Color(*[colors.srgb_to_linear(min(max(c, 0.0), 1.0)) for c in colors.hsv_to_srgb(turned, saturation, value)])


@_define("kelvin temperature", "the colour of a black body, of luminance 1")
def _kelvin(scope: Scope, temperature: Value) -> Value:
    low, high = colors.KELVIN_RANGE
    if type(temperature) is not float or not low <= temperature <= high:
        raise Mistake(f"temperature in {low:g}..{high:g} kelvin wanted, got {describe(temperature)}", argument=0)
    return Color(*colors.kelvin(temperature))


# --- rotations, matrices, fall-off ----------------------------------------------------------------------------------


@_define("axis direction angle", "a turn about a direction")
def _axis(scope: Scope, direction: Value, angle: Value) -> Value:
    if len(_vector(direction, 0)) != 3 or has_term(*direction):
        raise Mistake("an axis is a list of three numbers", argument=0)
    x, y, z = [split(v)[0] for v in _even(direction, scope)]
    if x == y == z == 0:
        raise Mistake("an axis of length 0 has no direction", argument=0)
    if isinstance(angle, Quantity) and angle.dimension == units.ANGLE:
        return AxisAngle((x, y, z), angle.value)
    if type(angle) is float:
        return AxisAngle((x, y, z), _radians_of(angle, scope))
    raise Mistake(f"angle wanted, got {describe(angle)}", argument=1)


def _radians_of(angle: float, scope: Scope) -> float:
    try:
        return operators.bare(angle, units.ANGLE, scope)
    except Mistake as mistake:
        raise Mistake(mistake.message, mistake.hint, argument=1) from None


@_define("quaternion x y z w", "a turn as a quaternion; normalised when used")
def _quaternion(scope: Scope, *parts: Value) -> Value:
    for i, p in enumerate(parts):
        if type(p) is not float:
            raise Mistake(f"number wanted, got {describe(p)}", argument=i)
    if not any(parts):
        raise Mistake("a quaternion of length 0 is no rotation")
    return Quaternion(*parts)


@_define("matrix row0 row1 row2 row3?", "the rows of a matrix, for transform(matrix: …)")
def _matrix(scope: Scope, *rows: Value) -> Value:
    for i, row in enumerate(rows):
        if len(_vector(row, i)) != 4:
            raise Mistake(f"row of four numbers wanted, got a list of {len(row)}", argument=i)
    return rows


@_define("ramp start end", "a fall-off: full up to start, then linear to nothing at end")
def _ramp(scope: Scope, start: Value, end: Value) -> Value:
    distances = []
    for i, v in enumerate((start, end)):
        if type(v) is not float and not (isinstance(v, Quantity) and v.dimension == units.LENGTH):
            raise Mistake(f"length wanted, got {describe(v)}", argument=i)
        distances.append(v.value if isinstance(v, Quantity) else operators.bare(v, units.LENGTH, scope))
    if not 0 <= distances[0] < distances[1]:
        raise Mistake("a ramp starts at 0 or more and ends after its start", argument=1)
    return Falloff("ramp", (distances[0], distances[1], 0.0))


CONSTANTS: dict[str, Value] = {"pi": math.pi, "true": True, "false": False}
