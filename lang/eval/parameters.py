"""`param` declarations and typed parameters: types, ranges, defaults and checks of values."""

from __future__ import annotations

from typing import Any

from .. import units
from ..elements import ParamInfo
from ..syntax import ast
from ..units import Quantity
from . import operators
from .coercion import LIGHT_TYPES
from .context import ArgumentValue, Scope
from .values import Builtin, Closure, Color, Mistake, UserFunction, Value, category, describe, is_placeable, show, tag_unit, untag_unit

# The type names of a `param` and of a parameter.
TYPES: tuple[str, ...] = (
    "number", "int", "bool", "string", "color", *units.QUANTITIES, "material", "medium", "texture", "shape", "list", "function",
)  # fmt: skip

_WANTED = {"int": "whole number", "bool": "true or false", "color": "colour"}


def coerce(value: Value, type_name: str, scope: Scope) -> Value:
    """`value` coerced to the named type; a bare number becomes a length in the unit of the file. Raises Mistake."""
    if type_name in units.QUANTITIES:
        return _coerce_quantity(value, type_name, scope)
    if _is(value, type_name):
        return untag_unit(value) if type_name in ("number", "int", "list") else value
    hint = "write rgb(r, g, b), srgb(r, g, b) or #rrggbb" if type_name == "color" and isinstance(value, tuple) else ""
    raise Mistake(f"expected {_WANTED.get(type_name, type_name)}, got {describe(value)}", hint)


def _is(value: Value, type_name: str) -> bool:
    match type_name:
        case "number":
            return operators.is_scalar(value) and not isinstance(value, Quantity)
        case "int":
            return isinstance(value, float) and value == int(value)
        case "bool":
            return isinstance(value, bool)
        case "string":
            return isinstance(value, str)
        case "color":
            return isinstance(value, Color)
        case "list":
            return isinstance(value, tuple)
        case "function":
            return isinstance(value, Closure | UserFunction | Builtin)
        case "shape":
            return is_placeable(value)
    return category(value) == type_name


def _coerce_quantity(value: Value, type_name: str, scope: Scope) -> Value:
    dimension = units.QUANTITIES[type_name][0]
    if isinstance(value, Quantity) and value.dimension == dimension:
        return value
    if isinstance(value, float):
        if type_name in LIGHT_TYPES:
            return float(value)  # a bare light quantity is scene-referred
        return units.quantity(operators.bare(value, dimension, scope), dimension)
    raise Mistake(f"expected {type_name}, got {describe(value)}")


def implied_type(default: ast.Node | None) -> str:
    """The type of a parameter whose default is a literal with a unit, else `""`."""
    if isinstance(default, ast.Number):
        unit = units.UNITS.get(default.unit)
        if unit and unit[1] in (units.LENGTH, units.ANGLE, units.TIME):
            return units.name(unit[1])
    return ""


def type_of(value: Value) -> str:
    """The type of a `param` by its default."""
    if isinstance(value, Quantity):
        name = units.name(value.dimension)
        return name if name in units.QUANTITIES else ""
    simple = {float: "number", bool: "bool", str: "string", Color: "color", tuple: "list"}.get(type(value), "")
    if simple:
        return simple
    kind = category(value)
    return "shape" if is_placeable(value) else kind


Range = tuple[Value, Value] | list[Value]


def param_value(param: ast.Param, argument: ArgumentValue | None, scope: Scope, caller: Scope) -> Value:
    """The checked value of a `param`: the given one or its default. `scope` is the scope of its file.

    Raises Mistake with a span.
    """
    default, type_name = default_of(param, scope)
    allowed = range_of(param, type_name, scope)
    value, span = (default, param.default.span) if argument is None else (argument.value, argument.span)
    try:
        if argument is not None and argument.outside and type_name == "color" and isinstance(value, tuple):
            value = _color_of(value)
        if argument is not None and type_name:
            typed = coerce(value, type_name, caller)
            untyped = param.type is None and type_name in ("number", "list")
            value = tag_unit(value, caller.unit) if untyped and scope.unit != caller.unit else typed
        _check_range(param.name.id, value, allowed, scope)
    except Mistake as mistake:
        mistake.span = mistake.span or span
        raise
    return value


def _color_of(value: tuple[Value, ...]) -> Value:
    """The colour of a list of three numbers, as rgb(r, g, b), of values from outside of the scene; another list as it is."""
    if len(value) != 3 or not all(isinstance(part, float) and part >= 0 for part in value):
        return value
    return Color(*map(float, value))  # type: ignore[arg-type]


def default_of(param: ast.Param, scope: Scope) -> tuple[Value, str]:
    """The default of a `param` and its type, which is declared or follows from the default."""
    default = scope.evaluator.value(param.default, scope)
    if param.type is None:
        return default, type_of(default)
    if param.type.id not in TYPES:
        return default, ""  # reported by lint.py
    try:
        return coerce(default, param.type.id, scope), param.type.id
    except Mistake as mistake:
        mistake.span = param.default.span
        raise


def range_of(param: ast.Param, type_name: str, scope: Scope) -> Range | None:
    """The ends of a `param`'s range, or the list of its choices. Raises Mistake with a span."""
    node = param.range
    while isinstance(node, ast.Parens):
        node = node.inner
    if node is None:
        return None
    try:
        if isinstance(node, ast.Binary) and node.op == "..":
            ends = [scope.evaluator.value(end, scope) for end in (node.left, node.right)]
            if type_name in units.QUANTITIES:
                ends = [coerce(end, type_name, scope) for end in ends]
            operators.compare("less", ends[0], ends[1], scope)
            return (ends[0], ends[1])
        choices = scope.evaluator.value(node, scope)
        if not isinstance(choices, tuple) or not choices:
            raise Mistake(f"expected a range low..high or a list of choices, got {describe(choices)}")
        return [coerce(c, type_name, scope) for c in choices] if type_name else list(choices)
    except Mistake as mistake:
        mistake.span = mistake.span or node.span
        raise


def _check_range(name: str, value: Value, allowed: Range | None, scope: Scope) -> None:
    if isinstance(allowed, tuple):
        low, high = allowed
        if operators.compare("less", value, low, scope) is True or operators.compare("greater", value, high, scope) is True:
            raise Mistake(f"`{name}` is {show(value, 1)}, outside of {show(low)}..{show(high)}")
    elif allowed is not None and not any(operators.equal(value, choice, scope) is True for choice in allowed):
        raise Mistake(f"`{name}` is one of {', '.join([show(c, 1) for c in allowed])}, not {show(value, 1)}")


def info(param: ast.Param, value: Value, scope: Scope, file_unit: str) -> ParamInfo:
    """A `param` for sliders and sweeps. Numbers are in the unit of its default."""
    default, type_name = default_of(param, scope)
    allowed = range_of(param, type_name, scope)
    unit = _shown_unit(param.default, type_name, default, file_unit)

    def plain(v: Value) -> Any:
        return int(v) if type_name == "int" else _plain(v, unit, scope)

    shown = None if allowed is None else tuple([plain(v) for v in allowed])
    doc = param.doc.value if param.doc else ""
    return ParamInfo(param.name.id, type_name, plain(value), plain(default), shown, doc, unit, param.span)


def _shown_unit(node: ast.Node, type_name: str, default: Value, file_unit: str) -> str:
    if isinstance(node, ast.Number) and node.unit and node.unit != "%":
        return node.unit
    if type_name == "length":
        return file_unit
    return units.QUANTITIES[type_name][1] if type_name in units.QUANTITIES and isinstance(default, Quantity) else ""


def _plain(value: Value, unit: str, scope: Scope) -> Any:
    scope.meter.step()
    if isinstance(value, Quantity):
        return units.in_unit(value.value, unit) if unit else value.value
    if isinstance(value, Color):
        return value.channels
    if isinstance(value, tuple):
        return tuple([_plain(v, "", scope) for v in value])
    return value if isinstance(value, float | bool | str) else describe(value)
