"""Evaluation of each kind of expression node."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .. import colors, units
from ..diagnostics import Span, suggest
from ..formula_graph import Term
from ..limits import Exhausted
from ..syntax import ast
from . import calls, operators, suggestions
from .context import Evaluator, Scope, Thunk
from .values import Closure, Color, FilePart, Mistake, Poisoned, Value, describe, kind


def _name(evaluator: Evaluator, node: ast.Name, scope: Scope) -> Value:
    value = scope.find(node.id)
    if type(value) is Thunk:
        return value.value if value.state == Thunk.DONE else evaluator.force(value, node.span, scope)
    if value is None:
        evaluator.fail(*_unknown(node), scope)  # lint.py reports it except in a `--set`
    return value


def _unknown(node: ast.Name) -> tuple[str, Span, str]:
    message, hint = suggestions.name(node.id, ())
    return message, node.span, hint


def _number(evaluator: Evaluator, node: ast.Number, scope: Scope) -> Value:
    value = units.literal(node.value, node.unit)
    if value is None:
        number = node.text.removesuffix(node.unit)
        hint = suggestions.unit(node.unit, number, [u for u in units.UNITS if u.isascii()])
        if scope.find(node.unit) is not None:
            hint = f"write {number} * {node.unit}"
        evaluator.fail(f"unknown unit `{node.unit}`", node.span, hint, scope)
    if not math.isfinite(operators.split(value)[0]):
        evaluator.fail("this number is too large", node.span, "", scope)
    return value


def _string(evaluator: Evaluator, node: ast.String, scope: Scope) -> Value:
    return node.value


def _color(evaluator: Evaluator, node: ast.ColorLiteral, scope: Scope) -> Value:
    return Color(*colors.from_hex(node.text))


def _list(evaluator: Evaluator, node: ast.ListLiteral, scope: Scope) -> Value:
    values = []
    good = True
    for item in node.items:
        try:
            values.append(EXPRESSIONS[type(item)](evaluator, item, scope))
        except Poisoned:
            good = False
    if not good:
        raise Poisoned
    return tuple(values)


def _comprehension(evaluator: Evaluator, node: ast.Comprehension, scope: Scope) -> Value:
    values = []
    for value in source(evaluator, node.source, scope, "a list comprehension"):
        evaluator.meter.step()
        inner = scope.inner()
        inner.names[node.name.id] = value
        if node.condition is None or _known_truth(evaluator, node.condition, inner, "`if`"):
            values.append(EXPRESSIONS[type(node.body)](evaluator, node.body, inner))
    return tuple(values)


def truth(evaluator: Evaluator, node: ast.Node, scope: Scope, doing: str) -> Value:
    """The value of an expression that is true, false or a formula's truth value."""
    value = EXPRESSIONS[type(node)](evaluator, node, scope)
    if value is True or value is False or (isinstance(value, Term) and value.truth):
        return value
    evaluator.fail(f"{doing} needs true or false, got {kind(value)}", node.span, "", scope)


def _known_truth(evaluator: Evaluator, node: ast.Node, scope: Scope, doing: str) -> bool:
    value = truth(evaluator, node, scope, doing)
    if not isinstance(value, bool):
        evaluator.fail("the items of a list cannot depend on a formula's parameters", node.span, "", scope)
    return value


def _conditional(evaluator: Evaluator, node: ast.Conditional, scope: Scope) -> Value:
    condition = truth(evaluator, node.condition, scope, "`if`")
    if condition is True:
        return EXPRESSIONS[type(node.yes)](evaluator, node.yes, scope)
    if condition is False:
        return EXPRESSIONS[type(node.no)](evaluator, node.no, scope)
    yes, no = evaluator.value(node.yes, scope), evaluator.value(node.no, scope)
    try:
        return operators.select(condition, yes, no, scope)
    except Mistake as mistake:
        evaluator.fail(mistake.message, node.span, mistake.hint, scope)


def _function(evaluator: Evaluator, node: ast.Function, scope: Scope) -> Value:
    return Closure(node, scope)


def _binary(evaluator: Evaluator, node: ast.Binary, scope: Scope) -> Value:
    left, right, op = node.left, node.right, node.op
    if op == "and" or op == "or":
        return _logic(evaluator, node, scope)
    a = EXPRESSIONS[type(left)](evaluator, left, scope)
    b = EXPRESSIONS[type(right)](evaluator, right, scope)
    if type(a) is float and type(b) is float:
        simple = _PLAIN.get(op)
        if simple is not None:
            result = simple(a, b)
            if math.isfinite(result):
                return result
    try:
        return operators.BINARY[op](a, b, scope)
    except Mistake as mistake:
        evaluator.fail(mistake.message, mistake.span or node.span, mistake.hint, scope)
    except Exhausted as limit:
        raise calls.locate(limit, node.span, scope) from None


def _logic(evaluator: Evaluator, node: ast.Binary, scope: Scope) -> Value:
    a = truth(evaluator, node.left, scope, f"`{node.op}`")
    if a is (node.op == "or"):
        return a
    b = truth(evaluator, node.right, scope, f"`{node.op}`")
    return operators.logical_and(a, b) if node.op == "and" else operators.logical_or(a, b)


def _unary(evaluator: Evaluator, node: ast.Unary, scope: Scope) -> Value:
    value = EXPRESSIONS[type(node.operand)](evaluator, node.operand, scope)
    try:
        return operators.negate(value, scope) if node.op == "-" else operators.logical_not(value)
    except Mistake as mistake:
        evaluator.fail(mistake.message, node.span, mistake.hint, scope)


def _parens(evaluator: Evaluator, node: ast.Parens, scope: Scope) -> Value:
    return EXPRESSIONS[type(node.inner)](evaluator, node.inner, scope)


def _index(evaluator: Evaluator, node: ast.Index, scope: Scope) -> Value:
    items = evaluator.value(node.object, scope)
    index = evaluator.value(node.index, scope)
    if not isinstance(items, tuple):
        evaluator.fail(f"only a list has items, not {kind(items)}", node.object.span, "", scope)
    if not isinstance(index, float) or index != int(index):
        evaluator.fail(f"expected whole number, got {describe(index)}", node.index.span, "", scope)
    if not 0 <= index < len(items):
        last = f"the last is [{len(items) - 1}]" if items else "it is empty"
        evaluator.fail(f"there is no item {int(index)} in a list of {len(items)}", node.index.span, f"items count from 0; {last}", scope)
    return items[int(index)]


def _member(evaluator: Evaluator, node: ast.Member, scope: Scope) -> Value:
    owner = evaluator.value(node.object, scope)
    name = node.name.id
    if isinstance(owner, Color) and name in ("r", "g", "b"):
        return getattr(owner, name)
    if isinstance(owner, FilePart):
        return _file_member(evaluator, owner, node.name, scope)
    hint = ""
    if isinstance(owner, tuple) and name in ("x", "y", "z"):
        hint = f"write [{'xyz'.index(name)}]"
    elif isinstance(owner, Color):
        hint = "a colour has r, g and b"
    elif operators.has_term(owner):
        hint = suggestions.NO_POINT
    evaluator.fail(f"{kind(owner)} has no `{name}`", node.name.span, hint, scope)


def _file_member(evaluator: Evaluator, part: FilePart, name: ast.Name, scope: Scope) -> Value:
    known = {i.name.id for i in part.module.file.items if isinstance(i, ast.Let | ast.Param)} | part.module.broken
    if name.id not in known:
        near = suggest(name.id, known)
        evaluator.fail(f"{part.name} has no `{name.id}`" + (f"; {near}" if near else ""), name.span, "", scope)
    value = evaluator.module_scope(part.module, evaluator.outer).names[name.id]
    return evaluator.force(value, name.span, scope) if isinstance(value, Thunk) else value


def _call(evaluator: Evaluator, node: ast.Call, scope: Scope) -> Value:
    return calls.call(evaluator, node, node.function, node.arguments, None, scope)


def _with_children(evaluator: Evaluator, node: ast.WithChildren, scope: Scope) -> Value:
    target = node.target
    if isinstance(target, ast.Call):
        return calls.call(evaluator, target, target.function, target.arguments, node.block, scope)
    return calls.call(evaluator, target, target, (), node.block, scope)


def source(evaluator: Evaluator, node: ast.Node, scope: Scope, what: str) -> tuple[Value, ...]:
    """The list that a loop or comprehension iterates over."""
    value = evaluator.value(node, scope)
    if not isinstance(value, tuple):
        evaluator.fail(f"{what} runs over a list or a range, not over {kind(value)}", node.span, "", scope)
    return value


# Arithmetic on two plain numbers that cannot raise.
_PLAIN: dict[str, Callable[[float, float], Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
}

EXPRESSIONS: dict[type, Callable[[Any, Any, Scope], Value]] = {
    ast.Number: _number,
    ast.String: _string,
    ast.ColorLiteral: _color,
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
    ast.Call: _call,
    ast.WithChildren: _with_children,
}
