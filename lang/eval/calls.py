"""Calls of any function with evaluated arguments: built-in functions, user functions, parts, files and elements."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NoReturn

from ..diagnostics import Diagnostics, Span
from ..elements import Element
from ..limits import MAX_CALLS, Exhausted, Meter
from ..schema.argument_types import Entry
from ..schema.shapes import GROUP
from ..syntax import ast
from ..syntax.parser import parse
from . import arguments, texture_calls
from . import parameters as eval_parameters
from .context import ArgumentValue, Code, Evaluator, Scope, Thunk
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
    category,
    describe,
    is_placeable,
    kind,
    tag_unit,
    untag_unit,
)

SHARED = ("material", "medium", "texture")  # categories whose equal elements of one call site are one element
_NUMBER = re.compile(r"[0-9]{1,15}(\.[0-9]{1,15})?")  # without sign, exponent and unit


@dataclass(frozen=True, slots=True)
class Site:
    """A call site: the callee as written and its place, the place and scope of the call, the children in braces."""

    label: str
    callee: Span
    span: Span
    scope: Scope
    children: tuple[Element, ...] | None = None


def apply_values(evaluator: Evaluator, function: Value, values: list[Value], scope: Scope) -> Value:
    """The value of a function for values without a place in the source, for `map` and for recording a formula."""
    evaluator.meter.step()
    span = scope.trace[0][1] if scope.trace else Span("")
    if isinstance(function, Closure):
        span = function.node.span
    elif isinstance(function, UserFunction):
        span = function.code.let.name.span
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
        file = ArgumentValue("file", site.callee, function.file, site.callee)
        return make_element(evaluator, function.entry, [file, *givens], site)
    if category(function) == "texture":
        return texture_calls.call(function, givens, site.scope, site.label)
    is_made = isinstance(function, Element) and is_placeable(function)
    hint = f"it is an element already: write transform(…) {{ {site.label} }}" if is_made else ""
    raise Mistake(f"only functions and parts are called, not {describe(function)}", hint, span=site.callee)


def _is_function(value: Value) -> bool:
    return isinstance(value, Entry | Builtin | UserFunction | Closure | FilePart | AssetPart)


def takes_children(function: Value) -> bool:
    """Whether a callable takes children in braces."""
    if isinstance(function, Entry):
        return function.children
    if isinstance(function, UserFunction):
        return function.code.takes_children
    if isinstance(function, FilePart):
        return any(ast.places_children(i) for i in function.module.file.items if not (isinstance(i, ast.Let) and i.parameters is not None))
    return False


def title(function: Value, label: str) -> str:
    """A callee in a message."""
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
    args, written, photometric = bound
    if fraction and fraction[0]:
        evaluator.diagnostics.warning("the formula ends at this comma", fraction[2][1], fraction[1])
    children = site.children or ()
    if entry.category in SHARED:
        return share(scope, Element(entry.name, args, site.span, written, (), scope.path, scope.trace, photometric, 1, entry.category))
    evaluator.meter.element()
    weight = 1 + sum([child.weight for child in children])
    if weight > evaluator.meter.most:
        raise evaluator.meter.too_many_elements()
    return Element(entry.name, args, site.span, written, children, scope.path, scope.trace, photometric, weight, entry.category)


def share(scope: Scope, element: Element) -> Element:
    """The first element of the same call site and chain of calls with the same arguments: equal materials are one element."""
    evaluator, args = scope.evaluator, element.args
    key = (id(element.span), id(element.trace), element.photometric, *[args[name] for name in element.given])
    shared = evaluator.shared.setdefault(key, element)  # the element keeps both alive
    if shared is element:
        evaluator.meter.element()
    return shared


def _assign(
    evaluator: Evaluator, positional: tuple[str, ...], names: Mapping[str, str], required: Iterable[str], givens: list[ArgumentValue],
    site: Site,
) -> dict[str, ArgumentValue]:  # fmt: skip
    """The arguments by parameter. Raises Poisoned after reporting errors."""

    def report(message: str, span: Span, hint: str) -> None:
        evaluator.report(message, span, hint, site.scope.trace)

    assigned, good = arguments.assign(site.label, positional, names, givens, report)
    if not good or arguments.report_missing(site.label, required, assigned, site.callee, report):
        raise Poisoned
    for argument in givens:
        if argument.value is POISON:
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
    ordered = [assigned[n] for n in names[:gap]] + rest
    try:
        return function.run(site.scope, *[g.value for g in ordered], **{n: g.value for n, g in named.items()})
    except Mistake as mistake:
        ordered += named.values()
        if mistake.argument is not None and mistake.span is None and mistake.argument < len(ordered):
            mistake.span = ordered[mistake.argument].span
        raise
    except OverflowError:
        raise Mistake("the result is too large for a number") from None


def enter(meter: Meter, label: str) -> None:
    """Count a call that begins. Raises Exhausted."""
    meter.calls += 1
    if meter.calls > MAX_CALLS:
        meter.calls -= 1
        hint = "end it: if (…) { … } around elements, `if … then … else …` in values"
        raise Exhausted(f"{label} calls itself too deeply: {MAX_CALLS} nested calls", hint)


def _user(evaluator: Evaluator, function: UserFunction, givens: list[ArgumentValue], site: Site) -> Value:
    code, scope = function.code, site.scope
    assigned = _assign(evaluator, code.positional, code.names, code.required, givens, site)
    inner = function.scope.inner()
    inner.trace = ((site.label, site.callee), *scope.trace)
    inner.path = f"{scope.path}.{site.label}" if scope.path else site.label
    inner.plain = inner.plain or scope.plain
    foreign = function.scope.unit != scope.unit
    if foreign and function.foreign:
        assigned = {n: replace(g, value=untag_unit(g.value)) for n, g in assigned.items()}
    for p in code.parameters:
        argument = assigned.get(p.name)
        if argument is not None:
            inner.names[p.name] = _coerce(p.node, argument, site, foreign and not function.foreign)
        elif p.default is not None:
            inner.names[p.name] = Thunk(p.name, p.node.span, p.default, inner.snapshot())
    if code.takes_children:
        inner.names["children"] = site.children or ()
    enter(evaluator.meter, site.label)
    try:
        result = code.body(inner)
    finally:
        evaluator.meter.calls -= 1
    if foreign and function.foreign:
        result = tag_unit(result, function.scope.unit)
    extras = [g for name, g in assigned.items() if name not in code.positional]
    return wrap(result, extras, site) if extras else result


def _coerce(parameter: ast.Parameter, argument: ArgumentValue, site: Site, foreign: bool) -> Value:
    """The value given for a parameter, coerced to its declared type or to the dimension of its default.

    `foreign`: the call comes from a file with another unit. Bare numbers have the unit of that file.
    """
    type_name = parameter.type.id if parameter.type else eval_parameters.implied_type(parameter.default)
    if type_name not in eval_parameters.TYPES or (parameter.type is None and not isinstance(argument.value, float)):
        return tag_unit(argument.value, site.scope.unit) if foreign else argument.value
    try:
        return eval_parameters.coerce(argument.value, type_name, site.scope)
    except Mistake as mistake:
        mistake.span = argument.span
        raise


def wrap(result: Value, extras: list[ArgumentValue], site: Site) -> Value:
    """The elements of a part in a group with the transform, material and name of its call."""
    scope = site.scope
    if not is_placeable(result) or result == ():
        refuse_extras(site.label, [(g.name or "", g.name_span) for g in extras], scope)
    children = result if isinstance(result, tuple) else (result,)
    return make_element(scope.evaluator, GROUP, extras, Site(site.label, site.callee, site.span, scope, children))


def refuse_extras(label: str, extras: Iterable[tuple[str, Span]], scope: Scope) -> NoReturn:
    """Report arguments of elements, by name and place, that are given to a function that makes none."""
    for name, span in extras:
        scope.evaluator.report(f"{label} has no `{name}`", span, "it makes no shape", scope.trace)
    raise Poisoned


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
    enter(evaluator.meter, site.label)
    try:
        result = function.body(inner)
        return tag_unit(result, function.scope.unit) if foreign else result
    finally:
        evaluator.meter.calls -= 1


def _file(evaluator: Evaluator, function: FilePart, givens: list[ArgumentValue], site: Site) -> Value:
    """A used file as a part: a group of the shapes and lights it places."""
    module = function.module
    param_names = tuple([i.name.id for i in module.file.items if isinstance(i, ast.Param)])
    names = {n: n for n in param_names}
    for extra in arguments.PLACING:
        names.setdefault(extra, extra)
    assigned = _assign(evaluator, param_names, names, [], givens, site)
    scope = evaluator.instance(module, {n: g for n, g in assigned.items() if n in param_names}, site.label, site.callee, site.scope)
    scope.names["children"] = site.children or ()
    enter(evaluator.meter, site.label)
    try:
        for name in param_names:
            _force_param(evaluator, scope, name)
        children = evaluator.collect_file(module, scope)
    finally:
        evaluator.meter.calls -= 1
    extras = [g for name, g in assigned.items() if name not in param_names]
    return make_element(evaluator, GROUP, extras, Site(site.label, site.callee, site.span, site.scope, children))


def _force_param(evaluator: Evaluator, scope: Scope, name: str) -> None:
    """Evaluate a `param`, used or not, to check the given value."""
    thunk = scope.names[name]
    if isinstance(thunk, Thunk):
        evaluator.force(thunk, thunk.span, scope)


# --- definitions ----------------------------------------------------------------------------------------------------


def param_code(param: ast.Param, argument: ArgumentValue | None, caller: Scope) -> Code:
    """The code of a `param` in one use of its file: the given value or the default. `caller` is the scope of the call."""

    def run(scope: Scope) -> Value:
        try:
            return eval_parameters.param_value(param, argument, scope, caller)
        except Mistake as mistake:
            trace = scope.trace if mistake.span and mistake.span.file == param.name.span.file else caller.trace
            scope.evaluator.report(mistake.message, mistake.span, mistake.hint, trace)
            raise Poisoned from None

    return run


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
    mistakes = Diagnostics()
    file = parse(line, shown, mistakes)
    evaluator.diagnostics.items.extend(mistakes.items)
    if mistakes.failed or len(file.items) != 1 or not isinstance(file.items[0], ast.Let):
        if not mistakes.failed:
            evaluator.report(f"`{text}` is not one value", Span(shown, 1, len(line) - len(text) + 1, 1, len(line) + 1))
        raise Poisoned
    node = file.items[0].value
    return ArgumentValue(name, node.span, evaluator.value(node, scope), node.span, node, outside=True)


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


def locate_loop(limit: Exhausted, span: Span, before: int, scope: Scope) -> Exhausted:
    """The limit on elements with the place of a loop that made most of them, of nested ones the innermost; other limits as they are.

    `before` is the meter's number of elements at the beginning of the loop.
    """
    count = scope.meter.elements + scope.meter.placed
    if limit.of_elements and 2 * (count - before) > count:
        limit.of_elements = False
        limit.span, limit.trace = span, scope.trace
        limit.message += ", most of them in this loop"
    return limit
