"""Coercion of values to the argument types of the schema, in base units."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from .. import units
from ..diagnostics import Span, suggest
from ..elements import AxisAngle, Element, Euler, Falloff, Quaternion
from ..schema.argument_types import Arg, Entry
from ..syntax import ast
from ..units import Quantity
from . import medium_values, operators, suggestions, white_balance
from .context import Scope
from .values import Closure, Color, Mistake, UserFunction, Value, category, describe

LIGHT_TYPES = ("intensity", "illuminance", "luminance", "flux")


class Place:
    """The place of a value in the source and its scope, for messages and the unit of the file."""

    __slots__ = ("node", "scope", "span")

    def __init__(self, span: Span, node: ast.Node | None, scope: Scope) -> None:
        self.span = span
        self.node = node
        self.scope = scope

    def item(self, index: int) -> Place:
        """The place of an item of a list; that of the list if the item is not a list literal's."""
        node = self.node
        while isinstance(node, ast.Parens):
            node = node.inner
        if isinstance(node, ast.ListLiteral) and index < len(node.items):
            return Place(node.items[index].span, node.items[index], self.scope)
        return Place(self.span, None, self.scope)


def convert(value: Value, arg: Arg, place: Place) -> Any:
    """`value` coerced to the type of `arg` and checked against its limits. Raises Mistake with a span."""
    try:
        result = _CONVERTERS[arg.type](value, place, arg)
        if result is not None and any(limit is not None for limit in (arg.minimum, arg.maximum, arg.above, arg.below)):
            _check_limits(result, arg, place)
    except Mistake as mistake:
        mistake.span = mistake.span or place.span
        raise
    return result


def _check_limits(result: Any, arg: Arg, place: Place) -> None:
    if isinstance(result, tuple):
        for i, part in enumerate(result):
            _check_limits(part, arg, place.item(i))
        return
    if isinstance(result, Element):
        return
    if arg.above is not None and not result > arg.above:
        wanted = f"more than {_show(arg.above, arg)}"
    elif arg.minimum is not None and result < arg.minimum:
        wanted = f"{_show(arg.minimum, arg)} or more"
    elif arg.maximum is not None and result > arg.maximum:
        wanted = f"at most {_show(arg.maximum, arg)}"
    elif arg.below is not None and not result < arg.below:
        wanted = f"less than {_show(arg.below, arg)}"
    else:
        return
    hint = suggestions.BY_CORNERS if arg.type == "size3" and arg.name == "size" and place.node is not None else ""
    raise Mistake(f"`{arg.name}` must be {wanted}, got {_show(result, arg)}", hint, span=place.span)


def _show(value: float, arg: Arg) -> str:
    dimension = units.QUANTITIES.get({"size2": "length", "size3": "length"}.get(arg.type, arg.type), (units.NONE, ""))[0]
    return units.show(units.quantity(float(value), dimension)) if value else "0"


def _type_error(value: Value, wanted: str, hint: str = "") -> Mistake:
    if not hint and category(value) == "material" and isinstance(value, Element):
        hint = f"write material: {value.kind}(…)"
    return Mistake(f"expected {wanted}, got {describe(value)}", hint)


# --- numbers --------------------------------------------------------------------------------------------------------


def _number(value: Value, place: Place, arg: Arg) -> float:
    if isinstance(value, float):
        return float(value)
    raise _type_error(value, "number", _unquoted(value))


def _int(value: Value, place: Place, arg: Arg) -> int:
    if isinstance(value, float) and value == int(value):
        return int(value)
    raise _type_error(value, "whole number", _unquoted(value))


def _bool(value: Value, place: Place, arg: Arg) -> bool:
    if isinstance(value, bool):
        return value
    raise _type_error(value, "true or false")


def _length(value: Value, place: Place, arg: Arg) -> float:
    if isinstance(value, float):
        return operators.bare(value, units.LENGTH, place.scope)
    if isinstance(value, Quantity) and value.dimension == units.LENGTH:
        return value.value
    raise _type_error(value, "length", _unquoted(value))


def _unquoted(value: Value) -> str:
    """The hint for a number in quotes."""
    number = isinstance(value, str) and re.fullmatch(r"-?\d+(\.\d+)?([a-z]+|%)?", value)
    return f"write {value} without quotes" if number else ""


def _of_dimension(name: str) -> Callable[[Value, Place, Arg], float]:
    dimension = units.QUANTITIES[name][0]

    def convert_quantity(value: Value, place: Place, arg: Arg) -> float:
        if isinstance(value, Quantity) and value.dimension == dimension:
            return value.value
        if isinstance(value, float):
            if value == 0 or name in LIGHT_TYPES:
                return float(value)
            raise operators.bare_number_error(value, dimension)
        raise _type_error(value, name, _unquoted(value))

    return convert_quantity


_angle = _of_dimension("angle")


def _number_or_length(value: Value, place: Place, arg: Arg) -> float:
    return float(value) if isinstance(value, float) else _length(value, place, arg)


# --- lists ----------------------------------------------------------------------------------------------------------

Item = Callable[[Value, Place, Arg], Any]


def _each(values: tuple[Value, ...], place: Place, arg: Arg, item: Item | tuple[Item, ...]) -> tuple[Any, ...]:
    """Every item converted by `item`, or each by its own. An error has the place of its item, `item` itself only that of a list."""
    result = []
    for i, v in enumerate(values):
        try:
            result.append((item[i] if isinstance(item, tuple) else item)(v, place.item(i) if isinstance(v, tuple) else place, arg))
        except Mistake as mistake:
            mistake.span = mistake.span or place.item(i).span
            raise
    return tuple(result)


def _exactly(count: int, item: Item | tuple[Item, ...], wanted: str, hint: str = "") -> Item:
    def convert_list(value: Value, place: Place, arg: Arg) -> tuple[Any, ...]:
        if isinstance(value, tuple) and len(value) == count:
            return _each(value, place, arg, item)
        raise _type_error(value, wanted, hint if isinstance(value, float | Quantity | tuple) else "")

    return convert_list


def _one_or(count: int, item: Item, wanted: str) -> Item:
    def convert_either(value: Value, place: Place, arg: Arg) -> tuple[Any, ...]:
        if isinstance(value, tuple):
            if len(value) == count:
                return _each(value, place, arg, item)
            raise _type_error(value, wanted)
        if isinstance(value, float | Quantity):
            return (item(value, place, arg),) * count
        raise _type_error(value, wanted)

    return convert_either


def _list_of(item: Item, wanted: str) -> Item:
    def convert_list(value: Value, place: Place, arg: Arg) -> tuple[Any, ...]:
        if isinstance(value, tuple):
            place.scope.meter.step(1 + len(value) // 16)
            return _each(value, place, arg, item)
        raise _type_error(value, wanted)

    return convert_list


def _direction(value: Value, place: Place, arg: Arg) -> tuple[float, ...]:
    """A vector of numbers and lengths; in a mix, bare numbers are in the unit of the file."""
    mixed = isinstance(value, tuple) and any(isinstance(v, Quantity) for v in value)
    wanted = "list of three numbers or lengths"
    if isinstance(value, str) and value.strip("+-").lower() in suggestions.AXES:
        raise _type_error(value, wanted, f"write {suggestions.AXES[value.strip('+-').lower()]}, or its negative")
    vector = _exactly(3, _length if mixed else _number_or_length, wanted)(value, place, arg)
    if not any(vector):
        raise Mistake(f"`{arg.name}` must have a direction, got [0, 0, 0]")
    return vector


def _scale3(value: Value, place: Place, arg: Arg) -> tuple[float, ...]:
    scale = _one_or(3, _number, "number, or list of three")(value, place, arg)
    if not all(scale):
        axes = " and ".join(axis for axis, factor in zip("xyz", scale, strict=True) if not factor)
        raise Mistake(f"`{arg.name}` cannot be 0" + (f" along {axes}" if isinstance(value, tuple) else ""))
    return scale


def _whole_from(least: int) -> Item:
    def convert_whole(value: Value, place: Place, arg: Arg) -> int:
        if isinstance(value, float) and value == int(value) and value >= least:
            return int(value)
        raise _type_error(value, f"whole number from {least}")

    return convert_whole


def _pixels(value: Value, place: Place, arg: Arg) -> tuple[Any, ...]:
    size = re.fullmatch(r"\s*(\d+)\s*[x×*, ]\s*(\d+)\s*", value) if isinstance(value, str) else None
    if size:
        raise _type_error(value, "[width, height] in pixels", f"write [{size[1]}, {size[2]}]")
    return _exactly(2, _whole_from(1), "[width, height] in pixels", "write [width, height]")(value, place, arg)


# --- colours, textures, materials -----------------------------------------------------------------------------------


def _color(value: Value, place: Place, arg: Arg) -> Any:
    if isinstance(value, Color):
        return value.channels
    hint = ""
    if isinstance(value, tuple) and len(value) == 3:
        hint = "write rgb(r, g, b) for linear values, srgb(r, g, b) or #rrggbb"
    elif isinstance(value, float):
        grey = units.show_number(value)
        hint = f"write rgb({grey}, {grey}, {grey})"
    elif isinstance(value, str):
        hint = suggestions.color(value)
    raise _type_error(value, "colour", hint)


def _color_map(value: Value, place: Place, arg: Arg) -> Any:
    if isinstance(value, float):
        return (float(value),) * 3
    if category(value) == "texture":
        return value
    try:
        return _color(value, place, arg)
    except Mistake as mistake:
        raise _type_error(value, "colour, number or texture", mistake.hint or _texture_hint(value)) from None


def _number_map(value: Value, place: Place, arg: Arg) -> Any:
    if isinstance(value, float):
        return float(value)
    if category(value) == "texture":
        return value
    raise _type_error(value, "number or texture", _texture_hint(value))


def _texture(value: Value, place: Place, arg: Arg) -> Any:
    if category(value) == "texture":
        return value
    raise _type_error(value, "texture", _texture_hint(value))


def _texture_hint(value: Value) -> str:
    return 'write image("…") for a picture from a file' if isinstance(value, str) else ""


def _material(value: Value, place: Place, arg: Arg) -> Any:
    if category(value) == "material":
        return value
    hint = ""
    if isinstance(value, Color) or category(value) == "texture":
        hint = "wrap it: lambert(…)"
    elif isinstance(value, UserFunction) or (isinstance(value, Entry) and value.category == "material"):
        hint = f"call it: {value.name}(…)"
    elif isinstance(value, str) and isinstance(place.scope.find(value), UserFunction | Entry):
        hint = f"write {value}() without quotes"
    elif isinstance(value, str) and place.scope.find(value) is not None:
        hint = f"write {value} without quotes"
    elif isinstance(value, str):
        hint = "write lambert(#c83232) for a colour"
    raise _type_error(value, "material", hint)


def _materials(value: Value, place: Place, arg: Arg) -> tuple[Any, ...]:
    wanted = "list of pairs of a name and a material"
    if category(value) == "material" or (isinstance(value, tuple) and value[:1] and isinstance(value[0], str)):
        raise _type_error(value, wanted, 'write [["name", material]]; one material for all of the file is material:')
    pair = _exactly(2, (_string, _material), "pair of a name and a material", 'write ["name", material]')
    return _list_of(pair, wanted)(value, place, arg)


# --- strings, transforms, fall-off, formulas ------------------------------------------------------------------------


def _string(value: Value, place: Place, arg: Arg) -> str:
    if isinstance(value, str):
        return value
    raise _type_error(value, "string")


def _choice(value: Value, place: Place, arg: Arg) -> str:
    listed = ", ".join(f'"{c}"' for c in arg.choices)
    if not isinstance(value, str):
        named = next((f'write it in quotes: "{c}"' for c in arg.choices if describe(value).endswith(f" `{c}`")), "")
        raise _type_error(value, f"one of {listed}", suggestions.METAL if isinstance(value, Color) and "gold" in arg.choices else named)
    if value not in arg.choices:
        near = suggest(value, arg.choices).replace("`", '"')
        raise Mistake(
            f'`{arg.name}` is one of {listed}, not "{value}"' + (f"; {near}" if near else ""), suggestions.choice(arg.name, value)
        )
    return value


def _rotation(value: Value, place: Place, arg: Arg) -> Any:
    if isinstance(value, AxisAngle | Quaternion | Euler):
        return value
    if isinstance(value, tuple) and len(value) == 3:
        x, y, z = _each(value, place, arg, _angle)
        return Euler((x, y, z))
    hint = ""
    if isinstance(value, Quantity) and value.dimension == units.ANGLE:
        hint = f"about which axis? write [0, {units.show(value)}, 0] to turn about y"
    elif isinstance(value, float):
        degrees = f"{units.show_number(value)}deg"
        hint = f"write [0, {degrees}, 0] to turn about y, or axis([0, 1, 0], {degrees})"
    raise _type_error(value, "three angles, axis(v, angle) or quaternion(x, y, z, w)", hint)


def _row(value: Value, place: Place, arg: Arg) -> tuple[float, ...]:
    if not isinstance(value, tuple) or len(value) != 4:
        raise _type_error(value, "row of four numbers")
    return _each(value[:3], place, arg, _number) + (_length(value[3], place, arg),)


def _matrix(value: Value, place: Place, arg: Arg) -> tuple[tuple[float, ...], ...]:
    if not isinstance(value, tuple) or len(value) not in (3, 4):
        raise _type_error(value, "four rows of four numbers")
    last = (0.0, 0.0, 0.0, 1.0)
    if len(value) == 4 and value[3] != last:
        raise Mistake("the last row of a matrix is [0, 0, 0, 1]", span=place.item(3).span)
    return (*_each(value[:3], place, arg, _row), last)


def _falloff(value: Value, place: Place, arg: Arg) -> Falloff:
    if isinstance(value, Falloff):
        return value
    constant, linear, quadratic = _exactly(3, _number, "[constant, linear, quadratic] or ramp(start, end)")(value, place, arg)
    if min(constant, linear, quadratic) < 0 or constant == linear == quadratic == 0:
        raise Mistake("a fall-off has no negative numbers and one above 0")
    return Falloff("polynomial", (constant, linear, quadratic))


def _formula(value: Value, place: Place, arg: Arg) -> Any:
    if isinstance(value, Closure | UserFunction):
        return place.scope.evaluator.formula(value, place.scope, place.span)
    hint = "write it without quotes, after |x, y, z|" if isinstance(value, str) else ""
    raise _type_error(value, "formula |x, y, z| …", hint)


def _heights(value: Value, place: Place, arg: Arg) -> Any:
    """The name of a picture's file, a formula of x and z, or rows of heights in metres."""
    if isinstance(value, str):
        return value
    if isinstance(value, Closure | UserFunction):
        return place.scope.evaluator.formula(value, place.scope, place.span)
    if isinstance(value, tuple):
        return _list_of(_list_of(_length, "list of lengths"), "list of lists of lengths")(value, place, arg)
    hint = "write the name of its file alone" if category(value) == "texture" else ""
    raise _type_error(value, "file of a picture, formula |x, z| … or list of rows", hint)


def _within(value: Value, place: Place, arg: Arg) -> Any:
    """Bounds in metres: (lowest corner, highest corner, (x, y, z, radius) of a sphere or zeros)."""
    none = (0.0, 0.0, 0.0, 0.0)
    if isinstance(value, Element) and value.kind in ("sphere", "box"):
        args = value.args
        if any(args[name] is not None for name in ("translate", "rotate", "scale")):
            raise Mistake(f"the {value.kind} that bounds a surface is placed by its `center` alone", span=place.span)
        center = args["center"]
        half = (args["radius"],) * 3 if value.kind == "sphere" else tuple(edge / 2 for edge in args["size"])
        low, high = (tuple(c + side * h for c, h in zip(center, half, strict=True)) for side in (-1, 1))
        return low, high, (*center, args["radius"]) if value.kind == "sphere" else none
    wanted = "length, list of three, two corners, sphere or box"
    if isinstance(value, tuple) and len(value) == 2:
        low, high = _each(value, place, arg, _exactly(3, _length, wanted))
        if not all(a < b for a, b in zip(low, high, strict=True)):
            raise Mistake("each coordinate of the first corner must be below that of the second")
        return low, high, none
    half = _one_or(3, _length, wanted)(value, place, arg)
    if not all(h > 0 for h in half):
        raise Mistake("the bounds of a surface must have a size above 0 along each axis")
    return tuple(-h for h in half), half, none


def _lengths(value: Value, place: Place, arg: Arg) -> tuple[float, ...]:
    return _list_of(_length, "length, or list of lengths")(value if isinstance(value, tuple) else (value,), place, arg)


_point = _exactly(3, _length, "list of three lengths", "write [x, y, z]")
_point2 = _exactly(2, _length, "list of two lengths", "write [x, y]")

_CONVERTERS: dict[str, Item] = {
    "number": _number,
    "int": _int,
    "bool": _bool,
    "string": _string,
    "choice": _choice,
    "length": _length,
    **{name: _of_dimension(name) for name in units.QUANTITIES if name != "length"},
    "color": _color,
    "factors": lambda value, place, arg: (value,) * 3 if isinstance(value, float) else _color(value, place, arg),
    "number_map": _number_map,
    "color_map": _color_map,
    "texture": _texture,
    "material": _material,
    "point": _point,
    "size3": _one_or(3, _length, "length, or list of three"),
    "size2": _one_or(2, _length, "length, or list of two"),
    "direction": _direction,
    "numbers2": _one_or(2, _number, "number, or list of two"),
    "scale3": _scale3,
    "rotation": _rotation,
    "matrix": _matrix,
    "numbers": _list_of(_number, "list of numbers"),
    "points": _list_of(_point, "list of points"),
    "point_lists": _list_of(_list_of(_point, "list of points"), "list of lists of points"),
    "lengths": _lengths,
    "points2": _list_of(_point2, "list of points [x, y]"),
    "point2_lists": _list_of(_list_of(_point2, "list of points"), "list of lists of points"),
    "vectors3": _list_of(_exactly(3, _number, "list of three numbers"), "list of lists of three numbers"),
    "vectors2": _list_of(_exactly(2, _number, "list of two numbers"), "list of lists of two numbers"),
    "faces": _list_of(_list_of(_whole_from(0), "list of whole numbers"), "list of lists of whole numbers"),
    "falloff": _falloff,
    "formula": _formula,
    "heights": _heights,
    "within": _within,
    "pixels": _pixels,
    "materials": _materials,
    "strings": _list_of(_string, "list of strings"),
    "white": white_balance.read,
    **medium_values.CONVERTERS,
}
