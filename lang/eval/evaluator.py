"""Evaluator entry point: syntax tree to elements. Walks the items of files and blocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from itertools import groupby
from typing import Any, NoReturn

from .. import limits, units
from ..diagnostics import Diagnostics, Span, suggest
from ..elements import Document, Element, ParamInfo
from ..formula_graph import Formula, Graph, Term
from ..limits import Exhausted, Meter, TooManyErrors
from ..schema.argument_types import Catalogue, Entry
from ..syntax import ast
from . import blocks, builtins, call_sites, calls, lint, operators, parameters
from .blocks import Sink
from .context import ArgumentValue, Scope, Thunk
from .expressions import COMPILERS, expression
from .modules import PRELUDE, Loader, Module, Reader, ReadError, Source, asset_kind, is_asset, use_name
from .values import PLACEABLE, AssetPart, Closure, Color, FilePart, Mistake, Poisoned, UserFunction, Value, category, kind

__all__ = ["Evaluator", "ReadError", "Reader", "Source", "evaluate", "values"]

COMPILERS.update(call_sites.COMPILERS | blocks.COMPILERS)

MAX_TRACE = 12  # calls of a chain in a message
_linted: set[tuple[str, str, frozenset[str]]] = set()  # library files without lint errors: text, name, outer names


def evaluate(
    source: Source, catalogue: Catalogue, reader: Reader, diagnostics: Diagnostics, *, sets: Mapping[str, str] | None = None,
    time: float = 0.0, max_elements: int | None = None, seconds: dict[str, float] | None = None,
) -> Document:  # fmt: skip
    """The elements of a scene at `time` seconds. `catalogue` has the elements that it can use, `sets` the texts of `--set` by param.

    `max_elements` limits the elements made, and those placed with the repetitions of blocks (None: limits.MAX_ELEMENTS).
    Never raises on input: adds errors to `diagnostics` and returns the elements without errors. Sets `seconds["parse"]` to the
    parsing time.
    """
    limits.raise_recursion_limit()
    evaluator = Evaluator(catalogue, reader, diagnostics, time, max_elements)
    document = evaluator.document(source, sets or {})
    if seconds is not None:
        seconds["parse"] = evaluator.loader.parsing
    return document


def values(source: Source, catalogue: Catalogue, reader: Reader) -> dict[str, Value]:
    """The values of the names at the top level of a scene at time 0, without those with errors. Never raises on input."""
    limits.raise_recursion_limit()
    evaluator = Evaluator(catalogue, reader, Diagnostics(), 0.0)
    evaluator.document(source, {})
    names = evaluator.scene.names if evaluator.scene else {}
    return {name: value for name, value in names.items() if not isinstance(value, Thunk)}


class Evaluator:
    """One evaluation: its files, counters and messages. Implements context.Evaluator."""

    def __init__(
        self, catalogue: Catalogue, reader: Reader, diagnostics: Diagnostics, time: float, max_elements: int | None = None
    ) -> None:
        self.catalogue = catalogue
        self.diagnostics = diagnostics
        self.meter = Meter(max_elements)
        self.loader = Loader(reader, diagnostics, self._check)
        self.shared: dict[Any, Element] = {}
        self.root = Scope(self, self.meter)
        self.root.names.update(catalogue)
        self.root.names.update(builtins.FUNCTIONS)
        self.root.names.update(builtins.CONSTANTS)
        self.root.names["time"] = units.Quantity(time, units.TIME)
        self.root.names["children"] = ()
        self.scene: Scope | None = None
        self.outer = self.root  # replaced by the scope of the prelude
        self.language: dict[str, Any] = self.root.names.copy()
        self.graph: Graph | None = None
        self._instances: dict[Module, Scope] = {}
        self._reported: set[tuple[Span | None, str]] = set()
        self._limits: set[str] = set()
        self._running: list[Thunk] = []

    # --- messages ---

    def report(self, message: str, span: Span | None, hint: str = "", trace: tuple[tuple[str, Span], ...] = ()) -> None:
        """Report an error at `span`, once for each place.

        An error inside the library is reported at the call from outside, with the parameters of the called function.
        """
        calls = [k for k, (_, span) in enumerate(trace) if not span.in_library]
        if span and span.in_library and calls:
            (name, call_span), inner = trace[calls[0]], trace[calls[0] - 1][1] if calls[0] else span
            message, span, trace = f"{name} cannot be made with these arguments: {message}", call_span, trace[calls[0] + 1 :]
            hint = _parameter_hint(name, self.loader.sources.get(inner.file))
        key = (span, "" if span else message)
        if key not in self._reported:
            if len(self._reported) >= limits.MAX_ERRORS:
                raise TooManyErrors
            self._reported.add(key)
            self.diagnostics.error(message, span, hint, _shorten(trace))

    def fail(self, message: str, span: Span | None, hint: str, scope: Scope) -> NoReturn:
        self.report(message, span, hint, scope.trace)
        raise Poisoned

    def _report_limit(self, limit: Exhausted) -> None:
        if limit.message not in self._limits:
            self._limits.add(limit.message)
            self.report(limit.message, limit.span, limit.hint, limit.trace)

    # --- files ---

    def document(self, source: Source, sets: Mapping[str, str]) -> Document:
        """The evaluated scene of `source`. It ends at limits.MAX_ERRORS errors."""
        sink = Sink("scene")
        infos: list[ParamInfo] = []
        names_length = False
        try:
            self._load_prelude(source)
            module = self.loader.load(source, library=False)
            names_length = any(units.UNITS.get(name, (0, units.NONE))[1] == units.LENGTH for name in module.units_named)
            scope = self.scene = self.instance(module, self.read_sets(module, sets), "", None, self.outer)
            self._place_scene(module, scope, sink)
            infos = self._infos(module, scope)
        except Exhausted as limit:
            self._report_limit(limit)
        except TooManyErrors:
            self.diagnostics.error(f"more than {limits.MAX_ERRORS:,} errors: the rest of the scene is not checked", Span(source.name))
        read, files = self.loader.sources, tuple(self.loader.files)
        return Document(source.name, tuple(sink.elements), tuple(sink.cameras), sink.settings, tuple(infos), read, files, names_length)

    def _load_prelude(self, source: Source) -> None:
        span = Span(source.name)
        try:
            prelude = self.loader.reader.scene(PRELUDE, source.path, span)
        except ReadError:
            return  # a library without a prelude
        self.outer = self.module_scope(self.loader.load(prelude, library=True, prelude=True), self.root)
        self.language |= self.outer.names

    def _check(self, module: Module) -> None:
        outer = set(self.root.names)
        if self.loader.prelude and self.loader.prelude is not module:
            outer |= lint.names_of(self.loader.prelude.file) | self.loader.prelude.broken
        main = len(self.loader.chain) == 1 and module is not self.loader.prelude
        key = module.source.text, module.source.name, frozenset(outer)
        if not main and key in _linted:
            return
        before = len(self.diagnostics.items)
        lint.check_file(module, outer, self.catalogue, self.report, self.diagnostics, main)
        if module.of_library and not module.broken and len(self.diagnostics.items) == before:
            _linted.add(key)

    def module_scope(self, module: Module, outer: Scope) -> Scope:
        """The scope of a file with the defaults of its `param`s, created once."""
        if module not in self._instances:
            self._instances[module] = self.instance(module, {}, "", None, outer)
        return self._instances[module]

    def instance(self, module: Module, arguments: Mapping[str, ArgumentValue], label: str, call: Span | None, caller: Scope) -> Scope:
        """A new scope of a file with these values for its `param`s."""
        outer = self.outer if module is not self.loader.prelude else self.root
        scope = Scope(self, self.meter, module.scale, outer)
        if call is not None:
            scope.trace = ((label, call), *caller.trace)
            scope.path = f"{caller.path}.{label}" if caller.path else label
        for item in module.file.items:
            if isinstance(item, ast.Use):
                name = use_name(item)
                scope.names.setdefault(name, self._bind_use(item, name, module))
            elif isinstance(item, ast.Param):
                code = calls.param_code(item, arguments.get(item.name.id), caller)
                scope.names.setdefault(item.name.id, Thunk(item.name.id, item.name.span, code, scope))
        blocks.bind(blocks.code_of(module).definitions, scope)
        for name in module.broken:
            scope.names.setdefault(name, Thunk.make_failed(name, scope))
        return scope

    def _bind_use(self, use: ast.Use, name: str, module: Module) -> Value:
        path = use.path.value
        if is_asset(path):
            entry = self.catalogue.get(asset_kind(path))
            if entry is None:
                self.report(f"there is no element `{asset_kind(path)}`, which places such files", use.path.span)
                return Thunk.make_failed(name, self.root)
            return AssetPart(name, entry, path)
        used = module.uses.get(id(use))
        return FilePart(name, used) if used else Thunk.make_failed(name, self.root)

    def _infos(self, module: Module, scope: Scope) -> list[ParamInfo]:
        infos = []
        for item in module.file.items:
            if isinstance(item, ast.Param):
                try:
                    value = scope.names[item.name.id]
                    value = self.force(value, item.name.span, scope) if isinstance(value, Thunk) else value
                    infos.append(parameters.info(item, value, scope, module.unit))
                except (Poisoned, Mistake):
                    continue  # reported when the `param` was evaluated
                except Exhausted as limit:
                    raise calls.locate(limit, item.name.span, scope) from None
        return infos

    def read_sets(self, module: Module, sets: Mapping[str, str]) -> dict[str, ArgumentValue]:
        """`--set` as arguments of the scene."""
        params = {item.name.id: item for item in module.file.items if isinstance(item, ast.Param)}
        scope = Scope(self, self.meter, module.scale, self.outer)
        arguments = {}
        for name, text in sets.items():
            if name not in params:
                near = suggest(name, params)
                has = ", ".join(params) or "no params"
                self.report(f"the scene has no param `{name}`" + (f"; {near}" if near else ""), None, f"it has {has}")
                continue
            try:
                arguments[name] = calls.set_value(params[name], text, scope, self)
            except Poisoned:
                continue
            except RecursionError:
                self.report("this is nested too deeply", Span(f"--set {name}"), "give it fewer nested blocks")
        return arguments

    # --- items ---

    def _place_scene(self, module: Module, scope: Scope, sink: Sink) -> None:
        """Evaluate the items of the scene. An item that reaches a limit does not stop the others."""
        for item, place in blocks.code_of(module).items:
            self._run_guarded(item.span, lambda place=place: _place_item(place, scope, sink))
        for thunk in list(scope.names.values()):
            if isinstance(thunk, Thunk):
                self._run_guarded(thunk.span, lambda thunk=thunk: self._force_unused(thunk, scope))

    def _run_guarded(self, span: Span, run: Callable[[], None]) -> None:
        try:
            run()
        except Exhausted as limit:
            self._report_limit(limit)
        except RecursionError:
            self.report("this is nested too deeply", span, "reduce nested expressions in a recursive function")

    def _force_unused(self, thunk: Thunk, scope: Scope) -> None:
        """Evaluate an unused definition to report its errors."""
        if thunk.state == Thunk.WAITING:
            try:
                self.force(thunk, thunk.span, scope)
            except Poisoned:
                return

    def collect_file(self, module: Module, scope: Scope) -> tuple[Element, ...]:
        """The shapes and lights that a used file places."""
        sink = Sink("file")
        for _, place in blocks.code_of(module).items:
            _place_item(place, scope, sink)
        return tuple(sink.elements)

    def place(self, value: Value, node: ast.Node, scope: Scope, sink: Sink) -> None:
        """Add the value of an item to the sink. Fails for values that cannot be placed."""
        if isinstance(value, tuple):
            for v in value:
                self.meter.step()
                self.place(v, node, scope, sink)
            return
        kind = category(value)
        if kind in PLACEABLE:
            sink.elements.append(value)
            if sink.role == "scene":
                self._weigh(sink)
        elif kind in ("camera", "setting", "fog"):
            self._place_setting(value, kind, node, scope, sink)
        else:
            message, hint = _unplaceable(value, kind, node)
            self.fail(message, node.span, hint, scope)

    def _weigh(self, sink: Sink) -> None:
        self.meter.placed += sink.elements[-1].weight
        if self.meter.placed > self.meter.most:
            sink.elements.pop()
            raise self.meter.too_many_elements()

    def _place_setting(self, element: Element, kind: str, node: ast.Node, scope: Scope, sink: Sink) -> None:
        if sink.role == "file":
            return  # of a used file only shapes and lights are placed
        if sink.role == "block":
            self.fail(f"`{element.kind}` belongs at the top level of a scene, not in a block", node.span, "", scope)
        if kind == "camera":
            sink.cameras.append(element)
        elif element.kind in sink.settings:
            first = sink.settings[element.kind].span
            self.fail(f"`{element.kind}` occurs twice in this scene", node.span, f"the first is in line {first.line}", scope)
        else:
            sink.settings[element.kind] = element

    # --- names ---

    def force(self, thunk: Thunk, span: Span, scope: Scope) -> Value:
        """The value of a definition, evaluated at its first use."""
        if thunk.state == Thunk.DONE:
            return thunk.value
        if thunk.state == Thunk.FAILED:
            raise Poisoned
        if thunk.state == Thunk.RUNNING:
            names = [t.label for t in self._running[self._running.index(thunk) :]]
            hint = f"`{thunk.label}` refers to the definition itself; rename one of them" if len(names) == 1 else ""
            self.fail(f"`{thunk.label}` depends on itself: {' → '.join([*names, thunk.label])}", span, hint, scope)
        thunk.state = Thunk.RUNNING
        self._running.append(thunk)
        try:
            thunk.value = thunk.code(thunk.scope)
            thunk.state = Thunk.DONE
            names = thunk.scope.names
            if names.get(thunk.label) is thunk:
                names[thunk.label] = thunk.value  # later uses need no thunk, and the scope has no cycle
        except BaseException:
            thunk.state = Thunk.FAILED
            raise
        finally:
            self._running.pop()
        return thunk.value

    def value(self, node: ast.Node, scope: Scope) -> Value:
        """The value of an expression. Raises Poisoned after reporting errors."""
        return expression(node, None)(scope)

    # --- for built-in functions ---

    def call_values(self, function: Value, values: list[Value], scope: Scope) -> Value:
        """Call a function with values, from a built-in function such as `map`. The place is that of the call."""
        return calls.apply_values(self, function, values, scope)

    def formula(self, function: Closure | UserFunction, scope: Scope, span: Span) -> Formula:
        """The formula that a function records, with coordinates in the unit of its own file. Raises Mistake."""
        graph = Graph(function.scope.unit)
        if isinstance(function, Closure):
            names = tuple([p.id for p in function.node.parameters])
        else:
            names = function.code.positional
        inner = scope.inner()
        inner.plain = True
        outer, self.graph = self.graph, graph
        try:
            result = calls.apply_values(self, function, [graph.parameter(i) for i in range(len(names))], inner)
        finally:
            self.graph = outer
        parts, result_kind = _results(result)
        terms = [operators.lift(graph, part) for part in parts]
        if result_kind == "number" and terms[0].truth:
            result_kind = "truth"
        return graph.formula(names, terms, result_kind, span)


def _place_item(place: blocks.Placing, scope: Scope, sink: Sink) -> None:
    """Evaluate an item, unless it has an error."""
    try:
        place(scope, sink)
    except Poisoned:
        return


def _results(result: Value) -> tuple[tuple[Value, ...], str]:
    if isinstance(result, Color):
        return result.channels, "color"
    if isinstance(result, tuple):
        return result, "list"
    if operators.is_scalar(result) or isinstance(result, bool | Term):
        return (result,), "number"
    raise Mistake(f"a formula gives a number, a truth value, a list or a colour, not {kind(result)}")


_USES = {"material": "sphere(material: …)", "medium": "sphere(medium: …)", "volume": "medium(density: …)", "texture": "lambert(…)"}


def _unplaceable(value: Value, value_kind: str, node: ast.Node) -> tuple[str, str]:
    """The message and the hint for a value that cannot be placed."""
    if value_kind in _USES:
        return f"a {value_kind} cannot be placed", f"use it as an argument, as in {_USES[value_kind]}, or name it with `let`"
    if isinstance(node, ast.Name | ast.Member) and isinstance(value, Entry | UserFunction | FilePart | AssetPart):
        name = calls.callee_name(node)
        return f"`{name}` is not called", f"write {name}()"
    if isinstance(node, ast.Call):
        return f"{calls.callee_name(node.function)} gives {kind(value)}, which cannot be placed", "name it with `let` to use it"
    return f"{kind(value)} cannot be placed", "shapes, lights and blocks can"


def _parameter_hint(name: str, text: str | None) -> str:
    """The hint with the parameters of a library function, as its source text declares them."""
    signature = re.search(rf"^let {re.escape(name.rpartition('.')[2])}\((.*?)\) =", text or "", re.MULTILINE | re.DOTALL)
    return f"it takes {' '.join(signature[1].split())}" if signature else ""


def _shorten(trace: tuple[tuple[str, Span], ...]) -> tuple[tuple[str, Span], ...]:
    """A chain of calls of at most MAX_TRACE entries, without its middle; calls that repeat in it are one entry."""
    runs = [(call, len([*same])) for call, same in groupby(trace)]
    if len(runs) < len(trace):
        trace = tuple([(f"{name}, {count} times" if count > 1 else name, span) for (name, span), count in runs])
    if len(trace) <= MAX_TRACE:
        return trace
    head = MAX_TRACE // 2
    left_out = len(trace) - MAX_TRACE + 1
    return (*trace[:head], (f"… {left_out} more …", trace[head][1]), *trace[len(trace) - MAX_TRACE + head + 1 :])
