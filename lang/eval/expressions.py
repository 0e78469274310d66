"""Compiles each kind of expression node to a closure, once; the closure gives the value in a scope.

The common case of an operation, on plain numbers, is decided in the closure. All others go to the functions of operators.py and calls.py.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from .. import colors, units
from ..diagnostics import suggest
from ..elements import Element
from ..formula_graph import Term
from ..limits import Exhausted
from ..schema.argument_types import Entry
from ..syntax import ast
from . import calls, operators, suggestions
from .context import Code, Evaluator, Names, Scope, Thunk
from .values import Closure, Color, FilePart, Mistake, Poisoned, Value, describe, kind

MISSING = object()  # no constant


def expression(node: ast.Node, names: Names | None) -> Code:
    """The code of an expression. `names` are those of its scope; None where they are not known before evaluation."""
    return COMPILERS[type(node)](node, names)


def lazily(node: ast.Node, names: Names | None) -> Code:
    """The code of an expression, compiled at its first use."""
    code: Code | None = None

    def run(scope: Scope) -> Value:
        nonlocal code
        if code is None:
            code = expression(node, names)
        return code(scope)

    return run


def constant(node: ast.Node | None) -> Value:
    """The value of a literal, of a list of literals or of a negative number; MISSING for other expressions."""
    if isinstance(node, ast.Number):
        value = units.literal(node.value, node.unit)
        return MISSING if value is None or not math.isfinite(operators.split(value)[0]) else value
    if isinstance(node, ast.String):
        return node.value
    if isinstance(node, ast.ColorLiteral):
        return Color(*colors.from_hex(node.text))
    if isinstance(node, ast.Parens):
        return constant(node.inner)
    if isinstance(node, ast.Unary) and node.op == "-" and isinstance(node.operand, ast.Number):
        value = constant(node.operand)
        return -value if isinstance(value, float) else MISSING
    if isinstance(node, ast.ListLiteral):
        values = tuple([constant(item) for item in node.items])
        return MISSING if any(value is MISSING for value in values) else values
    return MISSING


def _always(value: Value) -> Code:
    return lambda scope: value


# --- names ----------------------------------------------------------------------------------------------------------


def _name(node: ast.Name, names: Names | None) -> Code:
    name, span = node.id, node.span
    depth = names.depth(name) if names is not None and name != "children" else None

    def find(scope: Scope) -> Value:
        value = scope.find(name)
        if type(value) is Thunk:
            return value.value if value.state == Thunk.DONE else scope.evaluator.force(value, span, scope)
        if value is None:
            message, hint = suggestions.name(name, ())
            scope.evaluator.fail(message, span, hint, scope)  # lint.py reports it except in a `--set`
        return value

    def innermost(scope: Scope) -> Value:
        value = scope.names.get(name)
        return find(scope) if value is None or type(value) is Thunk else value

    def outer(scope: Scope) -> Value:
        value = scope.parent.names.get(name)  # type: ignore[union-attr]
        return find(scope) if value is None or type(value) is Thunk else value

    def second(scope: Scope) -> Value:
        value = scope.parent.parent.names.get(name)  # type: ignore[union-attr]
        return find(scope) if value is None or type(value) is Thunk else value

    def far(scope: Scope) -> Value:
        ancestor: Any = scope
        for _ in range(depth or 0):
            ancestor = ancestor.parent
        value = ancestor.names.get(name)
        return find(scope) if value is None or type(value) is Thunk else value

    def of_language(scope: Scope) -> Value:
        value = scope.evaluator.language.get(name)
        return find(scope) if value is None or type(value) is Thunk else value

    if depth is None:
        return find
    return of_language if depth < 0 else (innermost, outer, second, far)[min(depth, 3)]


# --- literals -------------------------------------------------------------------------------------------------------


def _number(node: ast.Number, names: Names | None) -> Code:
    value = constant(node)
    return _always(value) if value is not MISSING else lambda scope: _fail_number(node, scope)


def _fail_number(node: ast.Number, scope: Scope) -> Value:
    if node.unit in units.UNITS:
        scope.evaluator.fail("this number is too large", node.span, "", scope)
    number = node.text.removesuffix(node.unit)
    hint = suggestions.unit(node.unit, number, [u for u in units.UNITS if u.isascii()])
    if scope.find(node.unit) is not None:
        hint = f"write {number} * {node.unit}"
    scope.evaluator.fail(f"unknown unit `{node.unit}`", node.span, hint, scope)


def _literal(node: ast.Node, names: Names | None) -> Code:
    return _always(constant(node))


def evaluate_all(codes: tuple[Code, ...], scope: Scope) -> list[Value]:
    """The values of expressions. If some fail, all others are evaluated for their errors, and Poisoned is raised."""
    values: list[Value] = []
    try:
        for code in codes:
            values.append(code(scope))
    except Poisoned:
        for code in codes[len(values) + 1 :]:
            try:
                code(scope)
            except Poisoned:
                continue
        raise
    return values


def _list(node: ast.ListLiteral, names: Names | None) -> Code:
    value = constant(node)
    if value is not MISSING:
        return _always(value)
    codes = tuple([expression(item, names) for item in node.items])
    if len(codes) != 3:
        return lambda scope: tuple(evaluate_all(codes, scope))
    first, second, third = codes

    def point(scope: Scope) -> Value:
        x = y = MISSING
        try:
            x = first(scope)
            y = second(scope)
            return x, y, third(scope)
        except Poisoned:
            evaluate_all(codes[1:] if x is MISSING else codes[2:] if y is MISSING else (), scope)
            raise

    return point


def _comprehension(node: ast.Comprehension, names: Names | None) -> Code:
    items = source(node.source, names, "a list comprehension")
    inside = Names((node.name.id,), names) if names is not None else None
    body, name, place = expression(node.body, inside), node.name.id, node.source.span
    condition = truth(node.condition, inside, "`if`") if node.condition is not None else None

    def run(scope: Scope) -> Value:
        meter, values = scope.meter, []
        before = meter.elements + meter.placed
        try:
            for value in items(scope):
                meter.step()
                inner = scope.inner()
                inner.names[name] = value
                if condition is None or _require_truth(condition(inner), node.condition, scope):
                    values.append(body(inner))
        except Exhausted as limit:
            raise calls.locate_loop(limit, place, before, scope) from None
        return tuple(values)

    return run


def _require_truth(value: Value, node: Any, scope: Scope) -> bool:
    if not isinstance(value, bool):
        scope.evaluator.fail("the items of a list cannot depend on a formula's parameters", node.span, "", scope)
    return value


def source(node: ast.Node, names: Names | None, what: str) -> Code:
    """The code of the list that a loop or comprehension iterates over."""
    code = expression(node, names)

    def run(scope: Scope) -> Value:
        value = code(scope)
        if not isinstance(value, tuple):
            scope.evaluator.fail(f"{what} runs over a list or a range, not over {kind(value)}", node.span, "", scope)
        return value

    return run


# --- operations -----------------------------------------------------------------------------------------------------


def truth(node: ast.Node, names: Names | None, doing: str) -> Code:
    """The code of an expression that is true, false or a formula's truth value."""
    code = expression(node, names)

    def run(scope: Scope) -> Value:
        value = code(scope)
        if value is True or value is False or (isinstance(value, Term) and value.truth):
            return value
        scope.evaluator.fail(f"{doing} needs true or false, got {kind(value)}", node.span, "", scope)

    return run


def _conditional(node: ast.Conditional, names: Names | None) -> Code:
    condition = truth(node.condition, names, "`if`")
    yes, no = expression(node.yes, names), expression(node.no, names)

    def run(scope: Scope) -> Value:
        chosen = condition(scope)
        if chosen is True:
            return yes(scope)
        if chosen is False:
            return no(scope)
        first, second = yes(scope), no(scope)
        try:
            return operators.select(chosen, first, second, scope)
        except Mistake as mistake:
            scope.evaluator.fail(mistake.message, node.span, mistake.hint, scope)

    return run


def _function(node: ast.Function, names: Names | None) -> Code:
    inside = Names([p.id for p in node.parameters], names) if names is not None else None
    body = lazily(node.body, inside)
    return lambda scope: Closure(node, scope, body)


def _binary(node: ast.Binary, names: Names | None) -> Code:
    if node.op in ("and", "or"):
        return _logic(node, names)
    left, right, span = expression(node.left, names), expression(node.right, names), node.span
    general, simple = operators.BINARY[node.op], _PLAIN.get(node.op)

    def apply(a: Value, b: Value, scope: Scope) -> Value:
        try:
            return general(a, b, scope)
        except Mistake as mistake:
            scope.evaluator.fail(mistake.message, mistake.span or span, mistake.hint, scope)
        except Exhausted as limit:
            raise calls.locate(limit, span, scope) from None

    def run(scope: Scope) -> Value:
        a, b = left(scope), right(scope)
        if type(a) is float and type(b) is float:
            result = simple(a, b)  # type: ignore[misc]
            if result - result == 0.0:  # neither infinite nor nan
                return result
        return apply(a, b, scope)

    def divide(scope: Scope) -> Value:
        a, b = left(scope), right(scope)
        if type(a) is float and type(b) is float and b != 0.0:
            result = a / b
            if result - result == 0.0:
                return result
        return apply(a, b, scope)

    def multiply(scope: Scope) -> Value:
        a, b = left(scope), right(scope)
        if type(a) is float and type(b) is float:
            result = a * b
            if result - result == 0.0:
                return result
        elif type(a) is float and type(b) is units.Quantity:
            result = a * b.value
            if result - result == 0.0:
                return units.Quantity(result, b.dimension)  # pyright: ignore[reportAttributeAccessIssue]
        return apply(a, b, scope)

    if node.op == "/":
        return divide
    if node.op == "*":
        return multiply
    return run if simple is not None else lambda scope: apply(left(scope), right(scope), scope)


def _logic(node: ast.Binary, names: Names | None) -> Code:
    left, right = truth(node.left, names, f"`{node.op}`"), truth(node.right, names, f"`{node.op}`")
    decisive, combine = node.op == "or", operators.logical_or if node.op == "or" else operators.logical_and

    def run(scope: Scope) -> Value:
        a = left(scope)
        return a if a is decisive else combine(a, right(scope))

    return run


def _unary(node: ast.Unary, names: Names | None) -> Code:
    operand, negates = expression(node.operand, names), node.op == "-"

    def run(scope: Scope) -> Value:
        value = operand(scope)
        if negates and type(value) is float:
            return -value
        try:
            return operators.negate(value, scope) if negates else operators.logical_not(value)
        except Mistake as mistake:
            scope.evaluator.fail(mistake.message, node.span, mistake.hint, scope)

    return run


def _parens(node: ast.Parens, names: Names | None) -> Code:
    return expression(node.inner, names)


def _index(node: ast.Index, names: Names | None) -> Code:
    owner, place = expression(node.object, names), expression(node.index, names)

    def run(scope: Scope) -> Value:
        items, index = owner(scope), place(scope)
        if type(items) is tuple and type(index) is float and 0 <= index < len(items) and index == int(index):
            return items[int(index)]
        _fail_index(node, items, index, scope)
        return items[int(index)]

    return run


def _fail_index(node: ast.Index, items: Value, index: Value, scope: Scope) -> None:
    fail = scope.evaluator.fail
    if not isinstance(items, tuple):
        fail(f"only a list has items, not {kind(items)}", node.object.span, "", scope)
    if not isinstance(index, float) or index != int(index):
        fail(f"expected whole number, got {describe(index)}", node.index.span, "", scope)
    if not 0 <= index < len(items):
        last = f"the last is [{len(items) - 1}]" if items else "it is empty"
        fail(f"there is no item {int(index)} in a list of {len(items)}", node.index.span, f"items count from 0; {last}", scope)


def _member(node: ast.Member, names: Names | None) -> Code:
    code, name = expression(node.object, names), node.name.id

    def run(scope: Scope) -> Value:
        owner = code(scope)
        if isinstance(owner, FilePart):
            return _file_member(owner, node.name, scope)
        if isinstance(owner, Color) and name in ("r", "g", "b"):
            return getattr(owner, name)
        hint = ""
        if isinstance(owner, tuple) and name in ("x", "y", "z"):
            hint = f"write [{'xyz'.index(name)}]"
        elif isinstance(owner, Color):
            hint = "a colour has r, g and b"
        elif operators.has_term(owner):
            hint = suggestions.NO_POINT
        elif isinstance(owner, Element):
            hint = f"an element is not changed: write its arguments in {owner.kind}(…)"
        elif isinstance(owner, Entry):
            hint = f"write it as an argument in {owner.name}(…)"
        what = f"`{owner.name}`" if isinstance(owner, Entry) else kind(owner)
        scope.evaluator.fail(f"{what} has no `{name}`", node.name.span, hint, scope)

    return run


def _file_member(part: FilePart, name: ast.Name, scope: Scope) -> Value:
    evaluator: Evaluator = scope.evaluator
    if name.id not in part.members:
        near = suggest(name.id, part.members)
        evaluator.fail(f"{part.name} has no `{name.id}`" + (f"; {near}" if near else ""), name.span, "", scope)
    value = evaluator.module_scope(part.module, evaluator.outer).names[name.id]
    return evaluator.force(value, name.span, scope) if isinstance(value, Thunk) else value


# Arithmetic on two plain numbers that cannot raise.
_PLAIN: dict[str, Callable[[float, float], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}

COMPILERS: dict[type, Callable[[Any, Names | None], Code]] = {
    ast.Number: _number,
    ast.String: _literal,
    ast.ColorLiteral: _literal,
    ast.Name: _name,
    ast.ListLiteral: _list,
    ast.Comprehension: _comprehension,
    ast.Conditional: _conditional,
    ast.Function: _function,
    ast.Binary: _binary,
    ast.Unary: _unary,
    ast.Parens: _parens,
    ast.Index: _index,
    ast.Member: _member,
}
"""The compilers of nodes by type; evaluator.py adds those of calls and blocks."""
