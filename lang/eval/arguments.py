"""Argument binding: assigns arguments to parameters and checks arguments of elements against the schema."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from itertools import pairwise
from typing import Any

from .. import units
from ..diagnostics import Span
from ..schema.argument_types import REQUIRED, Arg, Entry
from ..syntax import ast
from ..units import Quantity
from . import medium_values, suggestions
from .coercion import LIGHT_TYPES, Place, convert
from .context import ArgumentValue, Scope
from .values import POISON, Element, Mistake, Poisoned

# Arguments of every element. In the call of a part that does not declare them they apply to its result.
PLACING = ("translate", "rotate", "scale", "material", "name", "medium")

Report = Callable[[str, Span, str], None]


def assign(
    callee: str, positional: Sequence[str], names: Mapping[str, str], givens: Iterable[ArgumentValue], report: Report,
    has_children: bool = False,
) -> tuple[dict[str, ArgumentValue], bool]:  # fmt: skip
    """The arguments by parameter name, and whether all fit. Reports unknown, repeated and surplus arguments.

    `positional` are the positional parameters in order; `names` maps names and aliases to parameters. An element with
    `has_children` takes its children in braces.
    """
    assigned: dict[str, ArgumentValue] = {}
    good = True
    place = 0
    for argument in givens:
        if argument.name is None:
            name = positional[place] if place < len(positional) else None
            place += 1
        else:
            name = names.get(argument.name)
        problem = _problem(callee, argument, name, positional, names, assigned)
        if problem:
            if has_children and name is None and _is_of_elements(argument.value):
                problem = problem[0], f"its children are written in braces: {callee} {{ … }}"
            if argument.name is not None or place == len(positional) + 1:  # of surplus arguments only the first
                report(problem[0], argument.name_span, problem[1])
            good = False
        elif name is not None:
            assigned[name] = argument
    return assigned, good


def _is_of_elements(value: object) -> bool:
    return isinstance(value, Element) or (isinstance(value, tuple) and bool(value) and all(isinstance(item, Element) for item in value))


def _problem(
    callee: str,
    argument: ArgumentValue,
    name: str | None,
    positional: Sequence[str],
    names: Mapping[str, str],
    assigned: Mapping[str, ArgumentValue],
) -> tuple[str, str] | None:
    if name is None and argument.name is None:
        if not names:
            return f"{callee} takes no arguments", ""
        keywords = [n for n in names if n not in positional and n == names[n]]
        takes = f"{callee} takes {len(positional) or 'no'} argument{'s' * (len(positional) != 1)} by position"
        if isinstance(argument.value, float) and positional[:1] == ("color",) and isinstance(assigned.get("color", argument).value, float):
            return takes, f"a colour is one argument: write {callee}(rgb(r, g, b)) or {callee}(#rrggbb)"
        return takes, suggestions.surplus_hint(callee, keywords)
    if name is None:
        return suggestions.argument(callee, argument.name or "", names)
    if name in assigned:
        return f"{callee} gets `{name}` twice", f"`{argument.name}` is another name of it" if argument.name not in (None, name) else ""
    return None


_EXAMPLES = {"length": "10cm", "angle": "30deg", "time": "2s", "int": "3", "point": "[0, 1, 5]", "direction": "[0, 1, 0]", "scale3": "2"}


def report_missing(
    callee: str,
    required: Iterable[str],
    assigned: Mapping[str, ArgumentValue],
    span: Span,
    report: Report,
    args: Mapping[str, Arg] | None = None,
) -> bool:
    """Report missing required parameters, with examples. Returns whether there are any."""
    absent = [name for name in required if name not in assigned]
    if absent:
        examples = [f"{name}: {_EXAMPLES.get(args[name].type, '')}" for name in absent] if args else []
        hint = f"such as {callee}({', '.join(examples)})" if examples and not any(e.endswith(": ") for e in examples) else ""
        if args and any("gold" in args[name].choices for name in absent):
            hint = f'such as {callee}("gold"); {suggestions.METAL}'
        report(f"{callee} needs {' and '.join(f'`{name}`' for name in absent)}", span, hint)
    return bool(absent)


def comma_fraction(givens: Sequence[ArgumentValue]) -> tuple[bool, str, tuple[Span, ...]] | None:
    """A fraction written with a comma, which makes two arguments: whether it ends a formula, the fix, and the places of both."""
    for argument, after in pairwise(givens):
        value, next_node = argument.node, after.node
        innermost = value
        while isinstance(innermost, ast.Function | ast.Binary | ast.Unary):
            if isinstance(innermost, ast.Function):
                innermost = innermost.body
            else:
                innermost = innermost.right if isinstance(innermost, ast.Binary) else innermost.operand
        digits = [node.text for node in (innermost, next_node) if isinstance(node, ast.Number) and node.text.isdigit()]
        near = (after.span.line, after.span.column) == (argument.span.end_line, argument.span.end_column + 1)
        thousand = len(digits) == 2 and digits[0] != "0" and len(digits[1]) == 3
        if len(digits) == 2 and not thousand and near and argument.name is None and after.name is None:
            hint = f"a fraction is written with a point: {'.'.join(digits)}"
            return innermost is not value, hint, (argument.span, after.span, after.name_span)
    return None


class Signature:
    """The arguments of an element, indexed for binding."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry
        self.args = {a.name: a for a in entry.args}
        self.positional = tuple(a.name for a in entry.args if not a.keyword)
        self.names = {a.name: a.name for a in entry.args} | {alias: a.name for a in entry.args for alias in a.aliases}
        self.required = tuple(a.name for a in entry.args if a.default is REQUIRED)
        self.defaults = {a.name: a.default for a in entry.args}


@cache
def signature_of(entry: Entry) -> Signature:
    """The signature of an element, built once."""
    return Signature(entry)


def element_arguments(
    signature: Signature, givens: list[ArgumentValue], span: Span, scope: Scope, report: Report
) -> tuple[dict[str, Any], frozenset[str], bool] | None:
    """An element's arguments in base units, the names of the given ones, and whether a light quantity has a unit.

    None after reporting errors.
    """
    entry = signature.entry
    assigned, good = assign(entry.name, signature.positional, signature.names, givens, report, entry.children)
    if good:  # an argument with a misspelt name is not also missing
        good = not report_missing(entry.name, signature.required, assigned, span, report, signature.args)
    if entry.exclusive and _report_exclusive(entry, assigned, report):
        good = False
    args = signature.defaults.copy()
    photometric = False
    for name, argument in assigned.items():
        if argument.value is POISON:
            good = False
            continue
        arg = signature.args[name]
        try:
            args[name] = convert(argument.value, arg, Place(argument.span, argument.node, scope))
        except Mistake as mistake:
            report(mistake.message, mistake.span or argument.span, mistake.hint or _dimension_hint(entry, argument, arg))
            good = False
        except Poisoned:
            good = False
        photometric = photometric or (arg.type in (*LIGHT_TYPES, "emission") and medium_values.is_measured(argument.value))
    return (args, frozenset(assigned), photometric) if good else None


def _dimension_hint(entry: Entry, argument: ArgumentValue, arg: Arg) -> str:
    """The hint for a quantity of a wrong dimension: the argument that takes it, or the unit of this one."""
    if not isinstance(argument.value, Quantity):
        return ""
    wanted = units.name(argument.value.dimension)
    other = next((a.name for a in entry.args if a.type == wanted and a.name != argument.name), "")
    if other and wanted in LIGHT_TYPES:
        return f"`{other}` takes {'an' if wanted[0] in 'aeiou' else 'a'} {wanted}"
    return f"its unit is {units.QUANTITIES[arg.type][1]}" if arg.type in LIGHT_TYPES else ""


def _report_exclusive(entry: Entry, assigned: Mapping[str, ArgumentValue], report: Report) -> bool:
    for group in entry.exclusive:
        both = [name for name in assigned if name in group]
        if len(both) > 1:
            report(f"`{both[0]}` and `{both[1]}` of {entry.name} exclude each other", assigned[both[1]].name_span, "give one of them")
            return True
    return False
