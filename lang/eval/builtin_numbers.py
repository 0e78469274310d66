"""Built-in functions of numbers: trigonometry, rounding, interpolation, noise."""

from __future__ import annotations

import math

from .. import units
from ..formula_graph import OPERATIONS
from ..noise import lattice_offset
from ..units import Quantity
from . import operators
from .builtin_table import apply_operation, bare_radians, define, require_list, require_number, require_scalar
from .context import Scope
from .operators import check_finite, has_term, record, split, unify
from .values import Color, ForeignNumber, Mistake, Value, describe


def _trigonometry(name: str) -> None:
    @define(f"{name} angle", f"{name} of an angle")
    def run(scope: Scope, angle: Value) -> Value:
        require_scalar(angle)
        if has_term(angle):
            return record(name, angle)
        if isinstance(angle, Quantity) and angle.dimension != units.ANGLE:
            raise Mistake(f"expected angle, got {describe(angle)}", argument=0)
        return check_finite(OPERATIONS[name](angle.value if isinstance(angle, Quantity) else bare_radians(angle, scope)))


def _inverse(name: str) -> None:
    @define(f"{name} value", f"the angle whose {name[1:]} is value")
    def run(scope: Scope, value: Value) -> Value:
        result = apply_operation(name, require_number(value))
        return units.quantity(result, units.ANGLE) if isinstance(result, float) else result


for _name in ("sin", "cos", "tan"):
    _trigonometry(_name)
for _name in ("asin", "acos", "atan"):
    _inverse(_name)


@define("atan2 y x", "the angle of the direction (x, y)")
def _atan2(scope: Scope, y: Value, x: Value) -> Value:
    if has_term(require_scalar(y), require_scalar(x, 1)):
        return record("atan2", y, x)
    a, b, _ = unify(y, x, scope, "compare")
    return units.quantity(OPERATIONS["atan2"](a, b), units.ANGLE)


def _on_plain(name: str, doc: str) -> None:
    @define(f"{name} value", doc)
    def run(scope: Scope, value: Value) -> Value:
        hint = "divide by a unit first, as in floor(x / 1cm)" if isinstance(value, Quantity) else ""
        return apply_operation(name, require_number(value, hint=hint))


for _name, _doc in (
    ("exp", "e to the power of value"),
    ("log", "natural logarithm"),
    ("floor", "the largest integer not above value"),
    ("ceil", "the smallest integer not below value"),
    ("round", "the nearest integer, halves up"),
):
    _on_plain(_name, _doc)


@define("abs value", "absolute value")
def absolute(scope: Scope, value: Value) -> Value:
    """The built-in `abs`."""
    if has_term(require_scalar(value)):
        return record("abs", value)
    x, dimension = split(value)
    if isinstance(x, ForeignNumber):
        return operators.foreign_number(abs(x), abs(x.metres))
    return units.quantity(abs(x), dimension)


@define("sign value", "-1, 0 or 1")
def _sign(scope: Scope, value: Value) -> Value:
    return record("sign", value) if has_term(require_scalar(value)) else OPERATIONS["sign"](split(value)[0])


@define("sqrt value", "square root; the square root of an area is a length")
def _sqrt(scope: Scope, value: Value) -> Value:
    if has_term(require_scalar(value)):
        return record("sqrt", value)
    x, dimension = split(value)
    if x < 0:
        raise Mistake(f"sqrt({units.show(value)}) is not defined", argument=0)
    if isinstance(x, ForeignNumber):
        return operators.power(x, 0.5, scope)
    return units.quantity(math.sqrt(x), units.power(dimension, 0.5))


@define("pow base exponent", "base ^ exponent")
def _pow(scope: Scope, base: Value, exponent: Value) -> Value:
    return operators.power(base, exponent, scope)


@define("mod a b", "remainder of a / b, with the sign of b")
def _mod(scope: Scope, a: Value, b: Value) -> Value:
    if has_term(require_scalar(a), require_scalar(b, 1)):
        return record("mod", a, b)
    x, y, dimension = unify(a, b, scope, "divide")
    if y == 0:
        raise Mistake("division by 0", argument=1)
    return check_finite(OPERATIONS["mod"](x, y), dimension)


def combine(op: str, numbers: list[Value], scope: Scope) -> Value:
    """The binary operation `op` over any count of numbers of one dimension."""
    if has_term(*numbers):
        result = numbers[0]
        for n in numbers[1:]:
            result = record(op, result, n)
        return result
    return operators.combine(op, numbers, scope)


def _extreme(name: str, doc: str) -> None:
    @define(f"{name} first rest*", doc)
    def run(scope: Scope, first: Value, *rest: Value) -> Value:
        numbers = list(require_list(first, 0)) if isinstance(first, tuple) and not rest else [first, *rest]
        if not numbers:
            raise Mistake(f"{name} of an empty list", argument=0)
        for i, n in enumerate(numbers):
            require_scalar(n, i if len(numbers) == 1 + len(rest) else 0)
        scope.meter.step(len(numbers))
        return combine(name, numbers, scope) if len(numbers) > 1 else numbers[0]


_extreme("min", "the smallest of its arguments or of a list")
_extreme("max", "the largest of its arguments or of a list")


@define("hypot a b c?", "√(a² + b² + c²)")
def _hypot(scope: Scope, *numbers: Value) -> Value:
    return combine("hypot", [require_scalar(n, i) for i, n in enumerate(numbers)], scope)


@define("clamp value low high", "value limited to low..high")
def _clamp(scope: Scope, value: Value, low: Value, high: Value) -> Value:
    for i, n in enumerate((value, low, high)):
        require_scalar(n, i)
    return combine("min", [combine("max", [value, low], scope), high], scope)


@define("lerp a b t", "a + t (b - a), of numbers, lists or colours")
def _lerp(scope: Scope, a: Value, b: Value, t: Value) -> Value:
    require_number(t, 2)
    return operators.add(a, operators.multiply(operators.subtract(b, a, scope), t, scope), scope)


@define("step edge value", "0 below the edge, else 1")
def _step(scope: Scope, edge: Value, value: Value) -> Value:
    below = operators.compare("less", value, edge, scope)
    return (0.0 if below else 1.0) if isinstance(below, bool) else operators.select(below, 0.0, 1.0, scope)


@define("smoothstep low high value", "0 below low, 1 above high, 3 t² - 2 t³ between")
def _smoothstep(scope: Scope, low: Value, high: Value, value: Value) -> Value:
    for i, n in enumerate((low, high, value)):
        require_scalar(n, i)
    t = operators.divide(operators.subtract(value, low, scope), operators.subtract(high, low, scope), scope)
    t = combine("min", [combine("max", [t, 0.0], scope), 1.0], scope)
    bend = operators.subtract(3.0, operators.multiply(2.0, t, scope), scope)
    return operators.multiply(operators.multiply(t, t, scope), bend, scope)


@define("noise x y? z? seed?", "gradient noise in -1..1 of one to three numbers or a list, 0 at integers; a seed gives other noise")
def _noise(scope: Scope, x: Value, *rest: Value, **named: Value) -> Value:
    """Perlin noise (2002). An integer seed selects one of the 2²⁴ offsets of the lattice, whose period is 256."""
    if isinstance(x, tuple):
        others = [*rest, *named.values()]
        if len(others) > 1 or {"y", "z"} & set(named) or not 1 <= len(x) <= 3:
            raise Mistake(f"noise takes one to three numbers, or a list of them, and a seed; got a list of {len(x)}", argument=0)
        parts, seed = [require_number(part, 0) for part in x], others[0] if others else 0.0
    else:
        options = {**dict(zip(("y", "z", "seed"), rest, strict=False)), **named}
        parts = [require_number(part, i) for i, part in enumerate((x, options.get("y", 0.0), options.get("z", 0.0)))]
        seed = options.get("seed", 0.0)
    if not isinstance(seed, float) or seed != int(seed):
        raise Mistake(f"a seed is a whole number, got {describe(seed)}", argument=len(rest) + len(named))
    parts += [0.0] * (3 - len(parts))
    moved = [operators.add(part, float(by), scope) if by else part for part, by in zip(parts, lattice_offset(int(seed)), strict=True)]
    return apply_operation("noise", *moved)


# --- noise of patterns ------------------------------------------------------------------------------------------------


def _of_pattern(op: str, parts: tuple[Value, ...], scope: Scope) -> Value:
    """A noise that patterns alone have. Raises Mistake for plain numbers."""
    for i, part in enumerate(parts):
        require_number(part, i)
    graph = operators.graph_of(scope, *parts)
    if graph is None:
        name = op.partition("_")[0]
        raise Mistake(f"{name} has values inside of a pattern alone", "noise(x, y, z, seed) has them everywhere")
    return graph.apply(op, *[operators.lift(graph, part) for part in parts])


def _noise_of_pattern(name: str, parameters: str, doc: str, color_parameters: str, color_doc: str) -> None:
    """Define a noise of one number, and `name_color` of three."""

    @define(f"{name} {parameters}", doc)
    def number(scope: Scope, *parts: Value, **named: Value) -> Value:
        if named:
            raise Mistake(f"{name} has no y here", f"write {name}(x, y, z)")
        return _of_pattern(name, parts, scope)

    @define(f"{name}_color {color_parameters}", color_doc)
    def color(scope: Scope, *parts: Value) -> Value:
        return Color(*[_of_pattern(f"{name}_{channel}", parts, scope) for channel in "rgb"])


_noise_of_pattern(
    "perlin", "x y z?", "MaterialX's gradient noise of two or three numbers, about -1..1, in patterns",
    "x y z?", "a colour of three gradient noises, as MaterialX's noise2d and noise3d of three numbers, in patterns",
)  # fmt: skip
_noise_of_pattern(
    "cellnoise", "x y? z?", "MaterialX's random number 0..1 of the cell with whole sides that contains the point, in patterns",
    "x y z", "a colour of three random numbers of the cell that contains the point, in patterns",
)  # fmt: skip
