"""Calls of built-in functions, user functions, parts, files and elements."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from ..diagnostics import Diagnostics, Span
from ..elements import Element
from ..limits import MAX_CALLS, MAX_ELEMENTS, Exhausted, too_many_elements
from ..schema.argument_types import Entry
from ..schema.elements import SCHEMA
from ..syntax import ast
from ..syntax.parser import parse
from . import arguments, suggestions
from . import parameters as eval_parameters
from .context import ArgumentValue, Evaluator, Scope, Thunk
from .values import (
    POISON,
    AssetPart,
    Builtin,
    Closure,
    FilePart,
    Mistake,
    Poisoned,
    UserFunction,
    Value,
    callable_name,
    describe,
    is_placeable,
    kind,
    tag_unit,
    untag_unit,
)

_NUMBER = re.compile(r"[0-9]{1,15}(\.[0-9]{1,15})?")  # without sign, exponent and unit


@dataclass(frozen=True, slots=True)
class ParamUse:
    """A `param` in one use of its file: the given value and the scope of the caller."""

    param: ast.Param
    given: ArgumentValue | None
    caller: Scope

    @property
    def span(self) -> Span:
        return self.param.name.span


@dataclass(frozen=True, slots=True)
class Site:
    """A call site: the callee as written and its place, the place and scope of the call, the children in braces."""

    label: str
    callee: Span
    span: Span
    scope: Scope
    children: tuple[Element, ...] | None = None


def call(
    evaluator: Evaluator, node: ast.Node, callee: ast.Node, args: tuple[ast.Argument, ...], block: ast.Block | None, scope: Scope
) -> Value:
    """The value of a call expression."""
    function = evaluator.value(callee, scope)
    label = callee_name(callee)
    if type(function) is Entry and function.planned:
        evaluator.fail(f"`{label}` is not built yet", callee.span, suggestions.planned_hint(label), scope)
    givens = []
    for a in args:
        try:
            value = evaluator.value(a.value, scope)
        except Poisoned:
            value = POISON
        if a.name is None:
            givens.append(ArgumentValue(None, a.span, value, a.value.span, a.value))
        else:
            givens.append(ArgumentValue(a.name.id, a.name.span, value, a.value.span, a.value))
    children = None
    if block is not None:
        if not _takes_children(function):
            evaluator.fail(f"{_title(function, label)} takes nothing in braces", callee.span, "", scope)
        children = evaluator.collect(block, scope)
    try:
        evaluator.meter.step()
        return apply(evaluator, function, givens, Site(label, callee.span, node.span, scope, children))
    except Mistake as mistake:
        evaluator.fail(mistake.message, mistake.span or node.span, mistake.hint, scope)
    except Exhausted as limit:
        raise locate(limit, callee.span, scope) from None


def apply_values(evaluator: Evaluator, function: Value, values: list[Value], scope: Scope) -> Value:
    """The value of a function for values without a place in the source, for `map` and for recording a formula."""
    evaluator.meter.step()
    span = scope.trace[0][1] if scope.trace else Span("")
    if isinstance(function, Closure):
        span = function.node.span
    elif isinstance(function, UserFunction):
        span = function.let.name.span
    givens = [ArgumentValue(None, span, v, span) for v in values]
    label = callable_name(function) if _is_function(function) else ""
    return apply(evaluator, function, givens, Site(label, span, span, scope))


def apply(evaluator: Evaluator, function: Value, givens: list[ArgumentValue], site: Site) -> Value:
    """The value of any callable. Raises Mistake for errors that the caller locates."""
    if type(function) is Entry:
        return make_element(evaluator, function, givens, site)
    if type(function) is Builtin:
        return _builtin(evaluator, function, givens, site)
    if type(function) is UserFunction:
        return _user(evaluator, function, givens, site)
    if type(function) is Closure:
        return _closure(evaluator, function, givens, site)
    if type(function) is FilePart:
        return _file(evaluator, function, givens, site)
    if type(function) is AssetPart:
        given = ArgumentValue("file", site.callee, function.file, site.callee)
        return make_element(evaluator, function.entry, [given, *givens], site)
    is_made = isinstance(function, Element) and is_placeable(function)
    hint = f"it is an element already: write transform(…) {{ {site.label} }}" if is_made else ""
    raise Mistake(f"only functions and parts are called, not {describe(function)}", hint, span=site.callee)


def _is_function(value: Value) -> bool:
    return isinstance(value, Entry | Builtin | UserFunction | Closure | FilePart | AssetPart)


def _takes_children(function: Value) -> bool:
    if isinstance(function, Entry):
        return function.children
    if isinstance(function, UserFunction):
        return function.takes_children
    if isinstance(function, FilePart):
        return any(ast.places_children(i) for i in function.module.file.items if not (isinstance(i, ast.Let) and i.parameters is not None))
    return False


def _title(function: Value, label: str) -> str:
    return f"`{label}`" if _is_function(function) else kind(function)


# --- each kind of function ------------------------------------------------------------------------------------------


def make_element(evaluator: Evaluator, entry: Entry, givens: list[ArgumentValue], site: Site) -> Element:
    """An element with checked arguments."""
    scope = site.scope
    signature = arguments.signature_of(entry)
    fraction = arguments.comma_fraction(givens)

    def report(message: str, span: Span, hint: str) -> None:
        evaluator.report(message, span, fraction[1] if fraction and (span in fraction[2] or not hint) else hint, scope.trace)

    bound = arguments.element_arguments(signature, givens, site.callee, scope, report)
    if bound is None:
        raise Poisoned
    args, given, photometric = bound
    if fraction and fraction[0]:
        evaluator.diagnostics.warning("the formula ends at this comma", fraction[2][1], fraction[1])
    evaluator.meter.element()
    children = site.children or ()
    element = Element(entry.name, args, site.span, given, children, scope.path, scope.trace, photometric)
    if children:
        weight = 1 + sum([evaluator.weights.get(c, 1) for c in children])
        if weight > MAX_ELEMENTS:
            raise too_many_elements()
        evaluator.weights[element] = weight
    return element


def _assign(
    evaluator: Evaluator, positional: tuple[str, ...], names: dict[str, str], required: list[str], givens: list[ArgumentValue], site: Site
) -> dict[str, ArgumentValue]:
    """The arguments by parameter. Raises Poisoned after reporting errors."""

    def report(message: str, span: Span, hint: str) -> None:
        evaluator.report(message, span, hint, site.scope.trace)

    assigned, good = arguments.assign(site.label, positional, names, givens, report)
    if not good or arguments.report_missing(site.label, required, assigned, site.callee, report):
        raise Poisoned
    for given in givens:
        if given.value is POISON:
            raise Poisoned
    return assigned


def _builtin(evaluator: Evaluator, function: Builtin, givens: list[ArgumentValue], site: Site) -> Value:
    names = function.parameters
    rest: list[ArgumentValue] = []
    if function.variadic:
        position = [g for g in givens if g.name is None]
        rest = position[len(names) :]
        givens = position[: len(names)] + [g for g in givens if g.name is not None]
    assigned = _assign(evaluator, names, {n: n for n in names}, list(names[: function.required]), givens, site)
    if any(g.value is POISON for g in rest):
        raise Poisoned
    gap = next((k for k, n in enumerate(names) if n not in assigned), len(names))
    named = {n: assigned[n] for n in names[gap:] if n in assigned}
    given = [assigned[n] for n in names[:gap]] + rest
    try:
        return function.run(site.scope, *[g.value for g in given], **{n: g.value for n, g in named.items()})
    except Mistake as mistake:
        given += named.values()
        if mistake.argument is not None and mistake.span is None and mistake.argument < len(given):
            mistake.span = given[mistake.argument].span
        raise
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


def _enter(evaluator: Evaluator, site: Site) -> None:
    evaluator.meter.calls += 1
    if evaluator.meter.calls > MAX_CALLS:
        evaluator.meter.calls -= 1
        raise Exhausted(f"{site.label} calls itself too deeply: {MAX_CALLS} nested calls", "end it with `if … then … else …`")


def _user(evaluator: Evaluator, function: UserFunction, givens: list[ArgumentValue], site: Site) -> Value:
    let = function.let
    parameters = let.parameters or ()
    positional = tuple([p.name.id for p in parameters])
    names = {n: n for n in positional}
    for extra in arguments.PLACING:
        names.setdefault(extra, extra)
    assigned = _assign(evaluator, positional, names, [p.name.id for p in parameters if p.default is None], givens, site)
    inner = function.scope.call_scope(site.label, site.callee, site.scope)
    foreign = function.scope.unit != site.scope.unit
    if foreign and function.foreign:
        assigned = {n: replace(g, value=untag_unit(g.value)) for n, g in assigned.items()}
    for p in parameters:
        given = assigned.get(p.name.id)
        # A default sees the parameters before it and the enclosing scope.
        inner.names[p.name.id] = (
            Thunk(p.name.id, p, inner.snapshot()) if given is None else _coerce(p, given, site, foreign and not function.foreign)
        )
    if function.takes_children:
        inner.names["children"] = site.children or ()
    _enter(evaluator, site)
    try:
        result = evaluator.value(let.value, inner)
    finally:
        evaluator.meter.calls -= 1
    if foreign and function.foreign:
        result = tag_unit(result, function.scope.unit)
    extras = [g for name, g in assigned.items() if name not in positional]
    return _wrap(evaluator, result, extras, site) if extras else result


def _coerce(parameter: ast.Parameter, given: ArgumentValue, site: Site, foreign: bool) -> Value:
    """The value given for a parameter, coerced to its declared type or to the dimension of its default.

    `foreign`: the call comes from a file with another unit. Bare numbers have the unit of that file.
    """
    type_name = parameter.type.id if parameter.type else eval_parameters.implied_type(parameter.default)
    if type_name not in eval_parameters.TYPES or (parameter.type is None and not isinstance(given.value, float)):
        return tag_unit(given.value, site.scope.unit) if foreign else given.value
    try:
        return eval_parameters.coerce(given.value, type_name, site.scope)
    except Mistake as mistake:
        mistake.span = given.span
        raise


def _wrap(evaluator: Evaluator, result: Value, extras: list[ArgumentValue], site: Site) -> Value:
    """The elements of a part in a group with the transform, material and name of its call."""
    if not is_placeable(result) or result == ():
        for given in extras:
            evaluator.report(f"{site.label} has no `{given.name}`", given.name_span, "it makes no shape", site.scope.trace)
        raise Poisoned
    children = result if isinstance(result, tuple) else (result,)
    return make_element(evaluator, SCHEMA["group"], extras, Site(site.label, site.callee, site.span, site.scope, children))


def _closure(evaluator: Evaluator, function: Closure, givens: list[ArgumentValue], site: Site) -> Value:
    names = tuple([p.id for p in function.node.parameters])
    if len(givens) != len(names) and all(g.name is None for g in givens):
        wants = f"{len(names)} argument{'s' * (len(names) != 1)}"
        raise Mistake(f"{callable_name(function)} takes {wants}, got {len(givens)}", span=site.callee)
    assigned = _assign(evaluator, names, {n: n for n in names}, list(names), givens, site)
    inner = function.scope.inner()
    inner.plain = True
    inner.trace = site.scope.trace
    foreign = function.scope.unit != site.scope.unit
    for name in names:
        inner.names[name] = untag_unit(assigned[name].value) if foreign else assigned[name].value
    _enter(evaluator, site)
    try:
        result = evaluator.value(function.node.body, inner)
        return tag_unit(result, function.scope.unit) if foreign else result
    finally:
        evaluator.meter.calls -= 1


def _file(evaluator: Evaluator, function: FilePart, givens: list[ArgumentValue], site: Site) -> Value:
    """A used file as a part: a group of the shapes and lights it places."""
    module = function.module
    own = tuple([i.name.id for i in module.file.items if isinstance(i, ast.Param)])
    names = {n: n for n in own}
    for extra in arguments.PLACING:
        names.setdefault(extra, extra)
    assigned = _assign(evaluator, own, names, [], givens, site)
    scope = evaluator.instance(module, {n: g for n, g in assigned.items() if n in own}, site.label, site.callee, site.scope)
    scope.names["children"] = site.children or ()
    _enter(evaluator, site)
    try:
        for name in own:
            _force_param(evaluator, scope, name)
        children = evaluator.collect_file(module, scope)
    finally:
        evaluator.meter.calls -= 1
    extras = [g for name, g in assigned.items() if name not in own]
    return make_element(evaluator, SCHEMA["group"], extras, Site(site.label, site.callee, site.span, site.scope, children))


def _force_param(evaluator: Evaluator, scope: Scope, name: str) -> None:
    """Evaluate a `param`, used or not, to check the given value."""
    thunk = scope.names[name]
    if isinstance(thunk, Thunk):
        evaluator.force(thunk, thunk.label_span(), scope)


# --- definitions ----------------------------------------------------------------------------------------------------


def evaluate_definition(thunk: Thunk, evaluator: Evaluator) -> Value:
    """The value of a `let`, of the default of a parameter or of a `param`."""
    node, scope = thunk.node, thunk.scope
    if isinstance(node, ParamUse):
        return _param(node, evaluator, scope)
    if isinstance(node, ast.Parameter):
        assert node.default is not None
        value = evaluator.value(node.default, scope)
        if node.type is None or node.type.id not in eval_parameters.TYPES:
            return value
        try:
            return eval_parameters.coerce(value, node.type.id, scope)
        except Mistake as mistake:
            evaluator.fail(mistake.message, node.default.span, mistake.hint, scope)
    return evaluator.value(node, scope)


def _param(use: ParamUse, evaluator: Evaluator, scope: Scope) -> Value:
    try:
        return eval_parameters.param_value(use.param, use.given, scope, use.caller)
    except Mistake as mistake:
        trace = scope.trace if mistake.span and mistake.span.file == use.param.span.file else use.caller.trace
        evaluator.report(mistake.message, mistake.span, mistake.hint, trace)
        raise Poisoned from None


def set_value(param: ast.Param, text: str, scope: Scope, evaluator: Evaluator) -> ArgumentValue:
    """The value of `--set name=text`: an expression, or for a string the text. Raises Poisoned after reporting."""
    name = param.name.id
    is_string = param.type.id == "string" if param.type else isinstance(param.default, ast.String)
    if is_string and not text.lstrip().startswith('"'):
        return ArgumentValue(name, param.span, text, param.default.span)
    shown = f"--set {name}"
    line = f"let {name} = {text}"
    evaluator.loader.sources[shown] = line
    if _NUMBER.fullmatch(text):  # a fast path for sliders, ten times as fast
        node = ast.Number(Span(shown, 1, len(line) - len(text) + 1, 1, len(line) + 1), float(text), "", text)
        return ArgumentValue(name, node.span, evaluator.value(node, scope), node.span, node)
    found = Diagnostics()
    file = parse(line, shown, found)
    evaluator.diagnostics.items.extend(found.items)
    if found.failed or len(file.items) != 1 or not isinstance(file.items[0], ast.Let):
        if not found.failed:
            evaluator.report(f"`{text}` is not one value", Span(shown, 1, len(line) - len(text) + 1, 1, len(line) + 1))
        raise Poisoned
    node = file.items[0].value
    return ArgumentValue(name, node.span, evaluator.value(node, scope), node.span, node)


# --- helpers --------------------------------------------------------------------------------------------------------


def callee_name(node: ast.Node) -> str:
    """The callee as written: `sphere`, `room.box`."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Member):
        return f"{callee_name(node.object)}.{node.name.id}"
    if isinstance(node, ast.Parens):
        return callee_name(node.inner)
    return "the function"


def locate(limit: Exhausted, span: Span, scope: Scope) -> Exhausted:
    """The limit with this place, unless it has a more precise one."""
    if limit.span is None:
        limit.span = span
        limit.trace = scope.trace
    return limit
