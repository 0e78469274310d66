"""The runtime values of the language, and their names in messages.

Numbers are Python floats, truth values bools, strings str, lists tuples. Numbers with a dimension are units.Quantity. Rotations,
fall-offs and elements are classes of elements.py.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from .. import colors, units
from ..diagnostics import Span
from ..elements import AxisAngle, Element, Euler, Falloff, Quaternion
from ..formula_graph import Formula, Term
from ..input_error import InputError
from ..schema.argument_types import Entry
from ..syntax import ast
from ..units import Quantity
from .context import Code, Scope
from .modules import Module

Value = Any


class ForeignNumber(float):
    """A bare number from a file with another unit, with its length in `metres` in the unit of that file."""

    __slots__ = ("metres",)
    metres: float

    def __new__(cls, value: float, metres: float) -> ForeignNumber:
        number = super().__new__(cls, value)
        number.metres = metres
        return number


class Poisoned(Exception):
    """The value of an expression with a reported error was used."""


POISON = object()  # the value of an expression with a reported error

PLACEABLE = ("shape", "solid", "block", "light", "meter")


class Mistake(InputError):
    """An error of a value. `span` is its place, None for that of the expression; `argument` is the index of a wrong argument."""

    def __init__(self, message: str, hint: str = "", argument: int | None = None, span: Span | None = None) -> None:
        super().__init__(message, hint)
        self.argument = argument
        self.span = span


class AssertionFails(Mistake):
    """The condition of an `assert` is false."""


@dataclass(frozen=True, slots=True)
class Color:
    """A colour in scene-linear Rec.709. In a formula the channels can be terms."""

    r: Any
    g: Any
    b: Any

    @property
    def channels(self) -> tuple[Any, Any, Any]:
        return (self.r, self.g, self.b)


@dataclass(frozen=True, slots=True, eq=False)
class Builtin:
    """A built-in function, called as `run(scope, *arguments)`. The first `required` of its `parameters` are required.

    With `variadic`, any number of arguments can follow the last parameter.
    """

    name: str
    parameters: tuple[str, ...]
    required: int
    run: Callable[..., Value]
    variadic: bool = False
    doc: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class ParameterCode:
    """A parameter of a `let`. `type_name` is the declared type or that of a default with a unit; `constant` is a default without code."""

    name: str
    node: ast.Parameter
    type_name: str
    default: Code | None
    constant: Value


@dataclass(frozen=True, slots=True, eq=False)
class FunctionCode:
    """`let name(parameters) = …`, compiled. `names` are the parameters and, for the elements that it makes, arguments of every element."""

    let: ast.Let
    parameters: tuple[ParameterCode, ...]
    positional: tuple[str, ...]
    names: Mapping[str, str]
    required: tuple[str, ...]
    takes_children: bool
    body: Code


@dataclass(frozen=True, slots=True, eq=False)
class UserFunction:
    """`let name(parameters) = …` with its defining scope."""

    code: FunctionCode
    scope: Scope
    foreign: bool = False  # passed as an argument to a part in a file with another unit

    @property
    def name(self) -> str:
        return self.code.let.name.id


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """`|parameters| …` with its defining scope."""

    node: ast.Function
    scope: Scope
    body: Code


@dataclass(frozen=True, slots=True, eq=False)
class FilePart:
    """A scene file bound by `use`: a part whose parameters are the `param`s of the file and whose members are its `let`s."""

    name: str
    module: Module

    @property
    def members(self) -> frozenset[str]:
        return self.module.members


@dataclass(frozen=True, slots=True, eq=False)
class AssetPart:
    """A mesh or USD file bound by `use`."""

    name: str
    entry: Entry
    file: str


Function = Builtin | UserFunction | Closure | FilePart | AssetPart | Entry


def category(value: Value) -> str:
    """The schema category of an element value; "" for anything else."""
    return value.category if isinstance(value, Element) else ""


def is_placeable(value: Value) -> bool:
    """Whether a block can contain it: a shape, light or block, or a list of these."""
    stack, seen = [value], set()
    while stack:
        v = stack.pop()
        if isinstance(v, tuple):
            if id(v) not in seen:  # a list can contain another one many times
                seen.add(id(v))
                stack.extend(v)
        elif category(v) not in PLACEABLE:
            return False
    return True


def kind(value: Value) -> str:
    """The kind of a value with its article: `a number`, `a length`, `a list`."""
    if isinstance(value, Quantity):
        return _article(units.name(value.dimension))
    if isinstance(value, Element):
        return _article(category(value))
    if isinstance(value, Term):
        return "a formula's truth value" if value.truth else "a formula's number"
    return _KINDS.get(type(value), "a value")


_KINDS: dict[type, str] = {
    bool: "a truth value",
    float: "a number",
    ForeignNumber: "a number",
    str: "a string",
    tuple: "a list",
    Color: "a colour",
    Euler: "a rotation",
    AxisAngle: "a rotation",
    Quaternion: "a rotation",
    Falloff: "a fall-off",
    Builtin: "a function",
    UserFunction: "a function",
    Closure: "a function",
    FilePart: "a part",
    AssetPart: "a part",
    Entry: "an element's name",
    Formula: "a formula",
}


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def describe(value: Value) -> str:
    """A value in a message about a wrong type: `the bare number 24`, `the angle 30deg`, `a list of 2`."""
    match value:
        case float():
            return f"the bare number {units.show(value)}"
        case Quantity():
            return f"the {units.name(value.dimension).split(' in ')[0]} {units.show(value)}"
        case bool():
            return "true" if value else "false"
        case str():
            return f'the string "{_short(value)}"'
        case tuple():
            return f"a list of {len(value)}" if value else "an empty list"
        case Color():
            return f"the colour {show(value)}"
        case Element():
            return f"the {category(value)} `{value.kind}`"
        case UserFunction():
            return f"the function `{value.name}`"
        case Builtin() | FilePart() | AssetPart() | Entry():
            return f"{kind(value)} `{value.name}`" if not isinstance(value, Entry) else f"`{value.name}` itself"
    return kind(value)


def show(value: Value, depth: int = 0) -> str:
    """A value in the syntax of a scene, as `string(…)` returns it. Long and deeply nested lists are abbreviated."""
    match value:
        case bool():
            return "true" if value else "false"
        case float() | Quantity():
            return units.show(value)
        case str():
            return value if depth == 0 else f'"{value}"'
        case Color():
            if any(isinstance(c, Term) for c in value.channels):
                return "a colour"
            hexed = colors.to_hex(value.channels)
            exact = all(abs(a - b) < 1e-9 for a, b in zip(colors.from_hex(hexed), value.channels, strict=True))
            return hexed if exact else f"rgb({', '.join(units.show_number(c) for c in value.channels)})"
        case tuple():
            if depth > 2 or len(value) > 64:
                return "[…]"
            return f"[{', '.join([show(v, depth + 1) for v in value])}]"
    return describe(value)


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}…"


def callable_name(function: Function) -> str:
    """The name of a function by its definition."""
    match function:
        case Closure():
            return "|" + ", ".join([p.id for p in function.node.parameters]) + "| …"
    return function.name


def tag_unit(value: Value, unit: float) -> Value:
    """An argument for a part in a file with another unit. Its bare numbers record their length in metres per `unit`."""
    if isinstance(value, float):
        return ForeignNumber(value, units.scale(value, unit)) if value else value
    if isinstance(value, tuple):
        return tuple([tag_unit(v, unit) for v in value])
    return replace(value, foreign=True) if isinstance(value, UserFunction) else value


def untag_unit(value: Value) -> Value:
    """A value with floats in place of ForeignNumbers."""
    if isinstance(value, ForeignNumber):
        return float(value)
    return tuple([untag_unit(v) for v in value]) if isinstance(value, tuple) else value
