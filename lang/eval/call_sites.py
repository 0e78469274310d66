"""Compiles call expressions. A call site keeps a plan for the function that it called last: which argument is which parameter.

Calls with a plan and with common values are made here. All others, and all with errors, go to calls.apply with the evaluated arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ..diagnostics import Span
from ..elements import Element
from ..formula_graph import OPERATIONS
from ..limits import Exhausted
from ..schema.argument_types import Entry
from ..schema.shapes import GROUP
from ..syntax import ast
from . import arguments, assertions, blocks, calls, quick_conversion, suggestions
from . import parameters as eval_parameters
from .coercion import LIGHT_TYPES
from .context import ArgumentValue, Code, Names, Scope, Thunk
from .expressions import MISSING, expression
from .quick_conversion import SLOW
from .values import POISON, AssertionFails, Builtin, FunctionCode, Mistake, Poisoned, UserFunction, Value, tag_unit

Children = tuple[Element, ...] | None
Plan = Callable[[Scope, Any, list[Value], Children], Value]
"""Calls a function with values and children. Returns SLOW where calls.apply has to do it."""


class CallSite:
    """A call in the source: the callee, the arguments and the children in braces."""

    def __init__(self, node: ast.Node, callee: ast.Node, args: tuple[ast.Argument, ...], block: ast.Block | None, names: Names | None):
        self.span = node.span
        self.callee = callee
        self.label = calls.callee_name(callee)
        self.args = args
        self.function = expression(callee, names)
        self.codes = tuple([expression(a.value, names) for a in args])
        self.asserted = assertions.operands(args, names) if self.label == assertions.NAME else ()
        self.collect = blocks.collector(block, names) if block is not None else None
        self.planned: tuple[Any, Plan | None] = (None, None)  # of the function called last

    def plan(self, function: Value) -> Plan | None:
        """The plan for a function; None for one of a rare kind, or with arguments that do not fit."""
        if type(function) is Entry:
            return _element_plan(self, function)
        if type(function) is FunctionCode:
            return _function_plan(self, function)
        return _builtin_plan(self, function) if type(function) is Builtin else None

    def positions(self, positional: tuple[str, ...], names: Any) -> dict[str, int] | None:
        """The index of the argument of each given parameter; None if some argument fits none."""
        indices: dict[str, int] = {}
        for k, a in enumerate(self.args):
            if a.name is None:
                name = positional[k] if k < len(positional) else None
                if any(b.name is not None for b in self.args[:k]):
                    return None  # a rare order, which arguments.assign handles
            else:
                name = names.get(a.name.id)
            if name is None or name in indices:
                return None
            indices[name] = k
        return indices

    def givens(self, values: list[Value]) -> list[ArgumentValue]:
        """The arguments with their places."""
        return [
            ArgumentValue(a.name.id, a.name.span, value, a.value.span, a.value)
            if a.name is not None
            else ArgumentValue(None, a.span, value, a.value.span, a.value)
            for a, value in zip(self.args, values, strict=True)
        ]

    def site(self, scope: Scope, children: Children) -> calls.Site:
        """This call in a scope."""
        return calls.Site(self.label, self.callee.span, self.span, scope, children)


def _call(node: ast.Call, names: Names | None) -> Code:
    return _code(CallSite(node, node.function, node.arguments, None, names))


def _with_children(node: ast.WithChildren, names: Names | None) -> Code:
    target = node.target
    if isinstance(target, ast.Call):
        return _code(CallSite(target, target.function, target.arguments, node.block, names))
    return _code(CallSite(target, target, (), node.block, names))


COMPILERS: dict[type, Callable[[Any, Names | None], Code]] = {ast.Call: _call, ast.WithChildren: _with_children}


def _code(site: CallSite) -> Code:
    """The code of a call."""
    callee, codes, collect = site.function, site.codes, site.collect

    def run(scope: Scope) -> Value:
        function = callee(scope)
        key = function.code if type(function) is UserFunction else function
        if key is not site.planned[0]:
            _check_planned(site, function, scope)
            site.planned = (key, site.plan(key))
        planned, plan = site.planned
        values: list[Value] = []
        try:
            for code in codes:
                values.append(code(scope))
        except Poisoned:
            values, plan = _evaluate_rest(codes, values, scope), None
        children = None
        if collect is not None:
            if not calls.takes_children(function):
                example = function.example.partition("\n")[0] if isinstance(function, Entry) else ""
                hint = "" if codes else f"write {example or f'{site.label}(…)'}"
                scope.evaluator.fail(f"{calls.title(function, site.label)} takes nothing in braces", site.callee.span, hint, scope)
            children = collect(scope)
        try:
            meter = scope.meter
            meter.steps += 1
            if meter.steps > meter.allowed:
                meter.step(0)
            if plan is not None and planned is key:
                result = plan(scope, function, values, children)
                if result is not SLOW:
                    return result
            return calls.apply(scope.evaluator, function, site.givens(values), site.site(scope, children))
        except Mistake as mistake:
            hint = assertions.values_of(site.asserted, scope) if isinstance(mistake, AssertionFails) else mistake.hint
            scope.evaluator.fail(mistake.message, mistake.span or site.span, hint, scope)
        except Exhausted as limit:
            raise calls.locate(limit, site.callee.span, scope) from None

    return run


def _check_planned(site: CallSite, function: Value, scope: Scope) -> None:
    if type(function) is Entry and function.planned:
        scope.evaluator.fail(f"`{site.label}` is not built yet", site.callee.span, suggestions.planned_hint(site.label), scope)


def _evaluate_rest(codes: tuple[Code, ...], values: list[Value], scope: Scope) -> list[Value]:
    """All values after the next one has failed: POISON for it and for others that fail."""
    values = [*values, POISON]
    for code in codes[len(values) :]:
        try:
            values.append(code(scope))
        except Poisoned:
            values.append(POISON)
    return values


# --- elements -------------------------------------------------------------------------------------------------------


def _element_plan(site: CallSite, entry: Entry) -> Plan | None:
    signature = arguments.signature_of(entry)
    positions = site.positions(signature.positional, signature.names)
    if positions is None or any(name not in positions for name in signature.required):
        return None
    if arguments.comma_fraction(site.givens([None] * len(site.args))):
        return None
    return _element_maker(entry, positions, site.span)


def _element_maker(entry: Entry, positions: Mapping[str, int], span: Span) -> Plan | None:
    """Makes an element with these arguments, by the index of their values; SLOW for rare values. None for rare arguments."""
    signature = arguments.signature_of(entry)
    if any(sum(name in group for name in positions) > 1 for group in entry.exclusive):
        return None
    steps = []
    for name, k in positions.items():
        convert = quick_conversion.conversion(signature.args[name])
        if convert is None:
            return None
        steps.append((name, k, convert))
    lights = [k for name, k, _ in steps if signature.args[name].type in LIGHT_TYPES]
    defaults, names, kind = signature.defaults, frozenset(positions), entry.name
    category, shares = entry.category, entry.category in calls.SHARED

    def make(scope: Scope, function: Value, values: list[Value], children: Children) -> Value:
        args = defaults.copy()
        unit = scope.unit
        for name, k, convert in steps:
            value = convert(values[k], unit)
            if value is SLOW:
                return SLOW
            args[name] = value
        photometric = bool(lights) and any(type(values[k]) is not float for k in lights)
        if shares:
            return calls.share(scope, Element(kind, args, span, names, (), scope.path, scope.trace, photometric, 1, category))
        meter = scope.meter
        meter.elements += 1
        if meter.elements > meter.most:
            raise meter.too_many_elements()
        if not children:
            return Element(kind, args, span, names, (), scope.path, scope.trace, photometric, 1, category)
        weight = 1
        for child in children:
            weight += child.weight
        if weight > meter.most:
            raise meter.too_many_elements()
        return Element(kind, args, span, names, children, scope.path, scope.trace, photometric, weight, category)

    return make


# --- functions ------------------------------------------------------------------------------------------------------


_PLAIN = frozenset({"floor", "ceil", "round", "exp", "log", "abs", "sign", "sqrt"})
_PLAIN_OF_TWO = frozenset({"mod", "min", "max", "hypot"})
"""Functions of two or more numbers, as _PLAIN those of one: on plain numbers they are the operations of formulas."""


def all_floats(values: list[Value]) -> bool:
    """Whether all values are plain numbers."""
    for value in values:  # noqa: SIM110 (called for every operation)
        if type(value) is not float:
            return False
    return True


def _builtin_plan(site: CallSite, function: Builtin) -> Plan | None:
    count = len(site.args)
    fits = function.required <= count and (function.variadic or count <= len(function.parameters))
    if not fits or any(a.name is not None for a in site.args):
        return None
    compute, spans = function.run, [a.value.span for a in site.args]
    plain = OPERATIONS[function.name] if function.name in (_PLAIN_OF_TWO if count > 1 else _PLAIN) else None

    def run(scope: Scope, function: Builtin, values: list[Value], children: Children) -> Value:
        if plain is not None and all_floats(values):
            try:
                result = plain(*values)
                if result - result == 0.0:
                    return result
            except (ArithmeticError, ValueError):
                pass  # the function reports it
        try:
            return compute(scope, *values)
        except Mistake as mistake:
            if mistake.argument is not None and mistake.span is None and mistake.argument < count:
                mistake.span = spans[mistake.argument]
            raise
        except OverflowError:
            raise Mistake("the result is too large for a number") from None

    return run


def _function_plan(site: CallSite, code: FunctionCode) -> Plan | None:
    positions = site.positions(code.positional, code.names)
    if positions is None or any(name not in positions for name in code.required):
        return None
    extras = tuple([name for name in positions if name not in code.positional])
    wrap = _element_maker(GROUP, {name: positions[name] for name in extras}, site.span) if extras else None
    if extras and wrap is None:
        return None
    steps = [(p, positions.get(p.name, -1)) for p in code.parameters]
    body, takes_children, label, callee = code.body, code.takes_children, site.label, site.callee.span
    chain: tuple[Any, str, Any, str] = (None, "", (), "")  # of the last call: the caller's trace and path, and those of the call

    def run(scope: Scope, function: UserFunction, values: list[Value], children: Children) -> Value:
        nonlocal chain
        defining = function.scope
        foreign = defining.unit != scope.unit
        if foreign and function.foreign:
            return SLOW
        last = chain
        if last[0] is not scope.trace or last[1] is not scope.path:
            chain = last = (scope.trace, scope.path, ((label, callee), *scope.trace), f"{scope.path}.{label}" if scope.path else label)
        inner = Scope(scope.evaluator, scope.meter, defining.unit, defining, last[2], last[3], defining.plain or scope.plain)
        names = inner.names
        for p, k in steps:
            if k >= 0:
                value = values[k]
                if p.type_name or foreign:
                    value = _coerced(p, value, scope, foreign, site, k)
            elif p.constant is not MISSING:
                value = p.constant
            else:
                value = Thunk(p.name, p.node.span, p.default, inner.snapshot())  # type: ignore[arg-type]
            names[p.name] = value
        if takes_children:
            names["children"] = children or ()
        calls.enter(scope.meter, label)
        try:
            result = body(inner)
        finally:
            scope.meter.calls -= 1
        if wrap is None:
            return result
        if type(result) is Element and calls.is_placeable(result):
            result = (result,)
        elif type(result) is not tuple or not result or not calls.is_placeable(result):
            calls.refuse_extras(label, [(a.name.id, a.name.span) for a in site.args if a.name and a.name.id in extras], scope)
        group = wrap(scope, function, values, result)
        if group is SLOW:
            group = calls.wrap(result, [g for g in site.givens(values) if g.name in extras], site.site(scope, None))
        return group

    return run


def _coerced(p: Any, value: Value, scope: Scope, foreign: bool, site: CallSite, k: int) -> Value:
    """The value given for a parameter, coerced to its declared type or to the dimension of its default."""
    if p.type_name not in eval_parameters.TYPES or (p.node.type is None and not isinstance(value, float)):
        return tag_unit(value, scope.unit) if foreign else value
    try:
        return eval_parameters.coerce(value, p.type_name, scope)
    except Mistake as mistake:
        mistake.span = site.args[k].value.span
        raise
