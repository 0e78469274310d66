"""Linter: unknown, duplicate, misplaced and unused names of a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from ..diagnostics import MAX_NAMES, Diagnostics, Span, suggest
from ..schema.argument_types import Catalogue
from ..schema.shapes import GROUP
from ..syntax import ast
from ..syntax.lexer import KEYWORDS
from . import parameters, suggestions
from .modules import Module, use_name

RESERVED = frozenset({"true", "false", "children"})

Report = Callable[[str, Span, str], None]


@dataclass(slots=True)
class Definition:
    """A name in a scope. `kind` is the item that binds it: let, param, use, parameter or loop."""

    name: str
    span: Span
    kind: str
    used: bool = False


Chain = tuple[dict[str, Definition], ...]  # innermost first


def check_file(module: Module, outer: Iterable[str], catalogue: Catalogue, report: Report, diagnostics: Diagnostics, main: bool) -> None:
    """Report the errors in the names of a file. `outer` are the names of the enclosing scopes, those of elements among them.

    In the rendered scene (`main`) an unused `let` gets a warning, unless the file places nothing and so serves other files, or items
    with syntax errors may use it.
    """
    places = any(isinstance(item, ast.ElementItem | ast.For | ast.If) for item in module.file.items)
    checker = _Checker({*outer, *module.broken}, catalogue, report, diagnostics if main and places else None)
    checker.file(module.file)
    module.units_named = checker.units | {item.name.id for item in module.file.items if isinstance(item, ast.Unit)}


def names_of(file: ast.File) -> set[str]:
    """The names that a file defines at its top level."""
    return {d.name for d in _definitions(file.items)}


def _definitions(items: tuple[ast.Item, ...]) -> Iterator[Definition]:
    for item in items:
        if isinstance(item, ast.Let | ast.Param):
            yield Definition(item.name.id, item.name.span, "let" if isinstance(item, ast.Let) else "param")
        elif isinstance(item, ast.Use):
            yield Definition(use_name(item), item.alias.span if item.alias else item.path.span, "use")


class _Checker:
    def __init__(self, outer: set[str], catalogue: Catalogue, report: Report, unused: Diagnostics | None) -> None:
        self.outer = outer
        self.catalogue = catalogue
        self.report = report
        self.unused = unused
        self.is_whole = unused is not None and not unused.failed
        self.units = set[str]()  # of numbers

    def file(self, file: ast.File) -> None:
        for item in file.items:
            if isinstance(item, ast.Use):
                self._use(item)
        self._items(file.items, ())
        names = sorted({*self.outer, *names_of(file)})
        for name in file.called:
            if name.id not in names and suggest(name.id, names):
                message, hint = suggestions.name(name.id, names)
                self.report(message, name.span, hint)

    def _use(self, use: ast.Use) -> None:
        name = use_name(use)
        if not name.isidentifier() or name in KEYWORDS:
            self.report(f"`{name}` cannot be a name", use.path.span, f'write use "{use.path.value}" as …')

    def _items(self, items: tuple[ast.Item, ...], chain: Chain, bound: Iterable[Definition] = ()) -> None:
        """Check a block whose scope has its definitions and `bound`."""
        scope: dict[str, Definition] = {}
        for definition in (*bound, *_definitions(items)):
            self._define(definition, scope)
        for item in items:
            if chain and isinstance(item, ast.Param | ast.Use | ast.Unit):
                what = type(item).__name__.lower()
                self.report(f"`{what}` belongs at the top level of a file, not in a block", item.span, "")
            if isinstance(item, ast.ElementItem):
                self._warn_empty(item.expression, (scope, *chain))
            self._visit(item, (scope, *chain))
        self._warn_unused(scope)

    def _define(self, definition: Definition, scope: dict[str, Definition]) -> None:
        first = scope.setdefault(definition.name, definition)
        if first is not definition:
            self.report(f"`{definition.name}` is defined twice", definition.span, f"the first is in line {first.span.line}")
        elif definition.name in RESERVED:
            self.report(f"`{definition.name}` cannot be a name", definition.span, "it is reserved by the language")

    def _warn_empty(self, node: ast.Node, chain: Chain) -> None:
        """Warn of a block that holds nothing, as `translate(…);` of programs where it concerns the next item."""
        call = node.target if isinstance(node, ast.WithChildren) and not node.block.items else node
        if self.unused is None or not isinstance(call, ast.Call) or not isinstance(call.function, ast.Name):
            return
        if any(isinstance(argument.value, ast.Call) for argument in call.arguments):  # children in parentheses, which is an error
            return
        name = call.function.id
        entry = self.catalogue.get(name)
        moves = entry is not None and entry.category == "block" and entry is not GROUP
        if moves and not any(name in scope for scope in chain):
            self.unused.warning(f"this `{name}` holds nothing", call.function.span, f"write {name}(…) {{ sphere(1) }}")

    def _warn_unused(self, scope: dict[str, Definition]) -> None:
        for d in scope.values():
            if self.unused is not None and self.is_whole and d.kind == "let" and not d.used and not d.name.startswith("_"):
                self.unused.warning(f"`{d.name}` is never used", d.span)

    def _visit(self, node: ast.Node, chain: Chain) -> None:
        match node:
            case ast.Number():
                self.units.add(node.unit)
            case ast.Binary():
                self._visit(node.left, chain)
                self._visit(node.right, chain)
            case ast.Name():
                self._name(node, chain)
            case ast.Member(object=ast.Name() as name) if node.name.id in suggestions.FILES and not self._is_known(name.id, chain):
                self.report(f"there is no `{name.id}` here", name.span, f'a file name is quoted: write "{name.id}.{node.name.id}"')
            case ast.Member():
                self._visit(node.object, chain)
            case ast.Argument():
                self._visit(node.value, chain)
            case ast.Block():
                self._items(node.items, chain)
            case ast.Let():
                self._let(node, chain)
            case ast.Param():
                self._type(node.type)
                self._visit(node.default, chain)
                if node.range is not None:
                    self._visit(node.range, chain)
            case ast.For():
                self._visit(node.source, chain)
                self._items(node.block.items, chain, (Definition(node.name.id, node.name.span, "loop"),))
            case ast.Comprehension():
                self._visit(node.source, chain)
                inner = self._scope((node.name,), "loop", chain)
                for part in (node.condition, node.body):
                    if part is not None:
                        self._visit(part, inner)
            case ast.Function():
                self._visit(node.body, self._scope(node.parameters, "parameter", chain))
            case ast.BlockExpression():
                self._items((*node.lets, node.result), chain)
            case ast.Use() | ast.Unit():
                pass
            case _:
                for child in ast.children(node):
                    self._visit(child, chain)

    def _let(self, let: ast.Let, chain: Chain) -> None:
        if let.parameters is None:
            self._visit(let.value, chain)
            return
        scope: dict[str, Definition] = {}
        for p in let.parameters:
            self._type(p.type)
            if p.default is not None:
                self._visit(p.default, (scope, *chain))
            self._define(Definition(p.name.id, p.name.span, "parameter"), scope)
        self._visit(let.value, (scope, *chain))

    def _scope(self, names: Iterable[ast.Name], kind: str, chain: Chain) -> Chain:
        scope: dict[str, Definition] = {}
        for name in names:
            self._define(Definition(name.id, name.span, kind), scope)
        return (scope, *chain)

    def _type(self, name: ast.Name | None) -> None:
        if name is not None and name.id not in parameters.TYPES:
            near = suggest(name.id, parameters.TYPES)
            hint = "" if near else "one of " + ", ".join(parameters.TYPES)
            self.report(f"there is no type `{name.id}`" + (f"; {near}" if near else ""), name.span, hint)

    def _is_known(self, name: str, chain: Chain) -> bool:
        return name in self.outer or any(name in scope for scope in chain)

    def _name(self, name: ast.Name, chain: Chain) -> None:
        for scope in chain:
            definition = scope.get(name.id)
            if definition is not None:
                definition.used = True
                return
        if name.id not in self.outer:
            is_short = len(self.outer) + sum(map(len, chain)) <= MAX_NAMES
            names = sorted({n for scope in chain for n in scope} | self.outer) if is_short else []
            message, hint = suggestions.name(name.id, names)
            self.report(message, name.span, hint)
