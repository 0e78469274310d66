"""Compiles the items of files and blocks: definitions to bindings, other items to code that places elements in a sink."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ..elements import Element
from ..limits import MAX_LIST, Exhausted
from ..schema.argument_types import Catalogue
from ..syntax import ast
from . import arguments, calls
from . import parameters as eval_parameters
from .context import Code, Names, Scope, Thunk
from .evaluation_order import evaluation_order
from .expressions import MISSING, constant, expression, lazily, source, truth
from .modules import Module, use_name
from .values import PLACEABLE, FunctionCode, Mistake, ParameterCode, Poisoned, UserFunction, Value


@dataclass
class Sink:
    """Receiver of placed elements. `role` is `scene` for the rendered file, `file` for a used file, `block` for blocks."""

    role: str
    elements: list[Element] = field(default_factory=list)
    cameras: list[Element] = field(default_factory=list)
    settings: dict[str, Element] = field(default_factory=dict)


Placing = Callable[[Scope, Sink], None]
Definition = tuple[str, Callable[[Scope], Value]]  # a name, and its binding in a scope


class FileCode:
    """The definitions and the items of a file, compiled at their first use."""

    def __init__(self, file: ast.File) -> None:
        self._file = file
        uses = [use_name(i) for i in file.items if isinstance(i, ast.Use)]
        self._names = Names([*uses, *[i.name.id for i in file.items if isinstance(i, ast.Param | ast.Let)], *file.broken])

    @cached_property
    def definitions(self) -> tuple[Definition, ...]:
        return definitions(self._file.items, self._names)

    @cached_property
    def items(self) -> tuple[tuple[ast.Item, Placing], ...]:
        """The items that place elements."""
        compiled = [(node, item(node, self._names)) for node in self._file.items]
        return tuple([(node, place) for node, place in compiled if place is not None])


def code_of(module: Module) -> FileCode:
    """The code of a file."""
    if module.parsed.code is None:
        module.parsed.code = FileCode(module.file)
    return module.parsed.code


# --- definitions ----------------------------------------------------------------------------------------------------


def definitions(items: Iterable[ast.Item], names: Names | None) -> tuple[Definition, ...]:
    """The `let`s among the items of a scope with these names; of two with one name, the first."""
    by_name: dict[str, Definition] = {}
    for item in items:
        if isinstance(item, ast.Let) and item.name.id not in by_name:
            by_name[item.name.id] = _constant(item, names) if item.parameters is None else _function(item, item.parameters, names)
    return tuple(by_name.values())


def bind(bindings: tuple[Definition, ...], scope: Scope) -> None:
    """Bind definitions in a scope, unevaluated, except names that it has already."""
    for name, binding in bindings:
        if name not in scope.names:
            scope.names[name] = binding(scope)


def _constant(let: ast.Let, names: Names | None) -> Definition:
    name, span, code = let.name.id, let.value.span, lazily(let.value, names)
    return name, lambda scope: Thunk(name, span, code, scope)


def _function(let: ast.Let, parameters: tuple[ast.Parameter, ...], names: Names | None) -> Definition:
    positional = tuple([p.name.id for p in parameters])
    inside = Names(positional, names) if names is not None else None
    parameter_names = {name: name for name in (*positional, *arguments.PLACING)}
    code = FunctionCode(
        let,
        tuple([_parameter(p, positional[:k], names) for k, p in enumerate(parameters)]),
        positional,
        parameter_names,
        tuple([p.name.id for p in parameters if p.default is None]),
        ast.places_children(let.value),
        lazily(let.value, inside),
    )
    return let.name.id, lambda scope: UserFunction(code, scope)


def _parameter(p: ast.Parameter, before: tuple[str, ...], names: Names | None) -> ParameterCode:
    """A parameter whose default may use the parameters before it and the enclosing scope."""
    type_name = p.type.id if p.type else eval_parameters.implied_type(p.default)
    if p.default is None:
        return ParameterCode(p.name.id, p, type_name, None, MISSING)
    value = constant(p.default) if p.type is None else MISSING
    inside = Names(before, names) if names is not None else None
    return ParameterCode(p.name.id, p, type_name, _default(p, lazily(p.default, inside)), value)


def _default(p: ast.Parameter, code: Code) -> Code:
    default = p.default
    if p.type is None or p.type.id not in eval_parameters.TYPES or default is None:
        return code
    name = p.type.id

    def coerced(scope: Scope) -> Value:
        value = code(scope)
        try:
            return eval_parameters.coerce(value, name, scope)
        except Mistake as mistake:
            scope.evaluator.fail(mistake.message, default.span, mistake.hint, scope)

    return coerced


# --- items ----------------------------------------------------------------------------------------------------------


def item(node: ast.Item, names: Names | None) -> Placing | None:
    """The code of an item that places elements; None for other items."""
    if isinstance(node, ast.ElementItem):
        return _element(node, names)
    if isinstance(node, ast.For):
        return _for(node, names)
    return _if(node, names) if isinstance(node, ast.If) else None


def block(node: ast.Block, names: Names | None, variable: str | None = None) -> Callable[[Scope, Sink, Any], None]:
    """The code of a block: `run(scope, sink, value)` places its items in a new scope, with `value` for the variable of a loop."""
    bound = [let.name.id for let in node.items if isinstance(let, ast.Let)]
    inside = Names([*bound, variable] if variable else bound, names) if names is not None else None
    bindings = definitions(node.items, inside)
    placings = [code for code in (item(i, inside) for i in node.items) if code is not None]

    def run(scope: Scope, sink: Sink, value: Value = None) -> None:
        inner = scope.inner()
        if variable is not None:
            inner.names[variable] = value
        if bindings:
            bind(bindings, inner)
        for place in placings:
            try:
                place(inner, sink)
            except Poisoned:
                continue
        if bindings and sink.role != "file":
            force_unused(inner)

    return run


def _block_expression(node: ast.BlockExpression, names: Names | None) -> Code:
    """The code of `{ let a = b; result }`. Definitions that the result does not use are not evaluated."""
    inside = Names([let.name.id for let in node.lets], names) if names is not None else None
    bindings, needed = definitions(node.lets, inside), evaluation_order(node)
    result = expression(node.result.expression, inside)

    def run(scope: Scope) -> Value:
        inner = scope.inner()
        bind(bindings, inner)
        for name in needed:
            thunk = inner.names[name]
            if type(thunk) is Thunk:
                try:
                    scope.evaluator.force(thunk, thunk.span, inner)
                except Poisoned:
                    continue  # the result raises it again, after the errors of other definitions
        return result(inner)

    return run


COMPILERS: dict[type, Callable[[Any, Names | None], Code]] = {ast.BlockExpression: _block_expression}


def collector(node: ast.Block, names: Names | None) -> Callable[[Scope], tuple[Element, ...]]:
    """The code of the children in braces of an element or a part."""
    run = block(node, names)

    def collect(scope: Scope) -> tuple[Element, ...]:
        sink = Sink("block")
        run(scope, sink, None)
        return tuple(sink.elements)

    return collect


def force_unused(scope: Scope) -> None:
    """Evaluate the unused definitions of a scope, to report their errors."""
    for thunk in list(scope.names.values()):
        if type(thunk) is Thunk and thunk.state == Thunk.WAITING:
            try:
                scope.evaluator.force(thunk, thunk.span, scope)
            except Poisoned:
                continue


def _element(node: ast.ElementItem, names: Names | None) -> Placing:
    expr = node.expression
    code = expression(expr, names)

    def place(scope: Scope, sink: Sink) -> None:
        value = code(scope)
        if type(value) is Element and value.category in PLACEABLE:
            meter = scope.meter
            if sink.role != "scene" or meter.placed + value.weight <= meter.most:
                sink.elements.append(value)
                meter.placed += value.weight if sink.role == "scene" else 0
                return
        try:
            scope.evaluator.place(value, expr, scope, sink)
        except Exhausted as limit:
            raise calls.locate(limit, expr.span, scope) from None

    return place


def _for(node: ast.For, names: Names | None) -> Placing:
    items, run, place = source(node.source, names, "`for`"), block(node.block, names, node.name.id), node.source.span
    fewest: tuple[Catalogue | None, int] = (None, 0)  # of the catalogue of the last evaluation

    def loop(scope: Scope, sink: Sink) -> None:
        nonlocal fewest
        meter, catalogue = scope.meter, scope.evaluator.catalogue
        if fewest[0] is not catalogue:
            fewest = catalogue, _fewest(node.block, catalogue)
        before = meter.elements + meter.placed
        try:
            values = items(scope)
            if len(values) * fewest[1] > meter.most:  # known before the first is made
                before = -1  # all elements count as those of this loop
                raise meter.too_many_elements()
            for value in values:
                meter.step()
                run(scope, sink, value)
        except Exhausted as limit:
            if limit.of_elements:
                raise calls.locate_loop(limit, place, before, scope) from None
            raise calls.locate(limit, place, scope) from None

    return loop


def _fewest(body: ast.Block, catalogue: Catalogue) -> int:
    """The fewest elements that a block makes, whatever its values are."""
    total = 0
    for node in body.items:
        if isinstance(node, ast.ElementItem):
            call = node.expression.target if isinstance(node.expression, ast.WithChildren) else node.expression
            called = call.function if isinstance(call, ast.Call) else None
            entry = catalogue.get(called.id) if isinstance(called, ast.Name) else None
            total += entry is not None and entry.category in PLACEABLE
        elif isinstance(node, ast.For) and isinstance(node.source, ast.Binary) and node.source.op == "..":
            start, stop = constant(node.source.left), constant(node.source.right)
            if isinstance(start, float) and isinstance(stop, float):
                total += max(int(min(stop - start + 1, MAX_LIST)), 0) * _fewest(node.block, catalogue)
    return total


def _if(node: ast.If, names: Names | None) -> Placing:
    condition, span = truth(node.condition, names, "`if`"), node.condition.span
    yes = block(node.yes, names)
    no = block(node.no, names) if isinstance(node.no, ast.Block) else None
    other = _if(node.no, names) if isinstance(node.no, ast.If) else None

    def choose(scope: Scope, sink: Sink) -> None:
        value = condition(scope)
        if not isinstance(value, bool):
            scope.evaluator.fail("placement cannot depend on a formula's parameters", span, "", scope)
        if value:
            yes(scope, sink, None)
        elif no is not None:
            no(scope, sink, None)
        elif other is not None:
            other(scope, sink)

    return choose
