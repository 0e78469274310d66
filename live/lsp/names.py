"""Name resolution for the editor: the definitions, references and scopes of a piece of source."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from ...lang.diagnostics import Span
from ...lang.eval.modules import use_name
from ...lang.syntax import ast

Scopes = tuple["Scope", ...]  # innermost first


@dataclass(eq=False, slots=True)
class Definition:
    """A name that `node` binds. `kind` is let, param, use, parameter or loop. Lines count from the start of the piece."""

    name: str
    span: Span
    kind: str
    node: ast.Node


@dataclass(eq=False, slots=True)
class Scope:
    """The names that a block or function binds, visible in `span`."""

    span: Span
    names: dict[str, Definition] = field(default_factory=dict)


@dataclass(eq=False, slots=True)
class Names:
    """All names of a piece. `free` names are bound by another piece of the file, or by the language."""

    top: dict[str, Definition] = field(default_factory=dict)
    definitions: list[Definition] = field(default_factory=list)
    scopes: list[Scope] = field(default_factory=list)  # outer ones first
    bound: list[tuple[ast.Name, Definition]] = field(default_factory=list)
    free: list[ast.Name] = field(default_factory=list)
    members: list[tuple[ast.Member, Definition | None]] = field(default_factory=list)  # of a name: the definition, None if it is free
    calls: list[ast.Call] = field(default_factory=list)
    colors: list[ast.ColorLiteral] = field(default_factory=list)
    types: list[ast.Name] = field(default_factory=list)

    def visible(self, line: int, column: int) -> dict[str, Definition]:
        """The inner names that are visible at a place of the piece."""
        definitions: dict[str, Definition] = {}
        for scope in self.scopes:
            if contains(scope.span, line, column):
                definitions |= scope.names
        return definitions

    def local(self, name: ast.Name) -> Definition | None:
        """The definition in this piece that a used name means."""
        return next((definition for used, definition in self.bound if used is name), None)


def contains(span: Span, line: int, column: int) -> bool:
    """Whether a place lies in a span; both of its ends count."""
    return (span.line, span.column) <= (line, column) <= (span.end_line, span.end_column)


def names_of(file: ast.File) -> Names:
    """The names of a piece. As in the evaluator, the names of a block are visible in the whole block."""
    walker = _Walker(Names())
    walker.items(file.items, (), walker.names.top)
    return walker.names


class _Walker:
    def __init__(self, names: Names) -> None:
        self.names = names

    def items(self, items: Iterable[ast.Item], chain: Scopes, names: dict[str, Definition]) -> None:
        """Define the names of a block in `names`, which the innermost scope of `chain` holds, and visit its items."""
        items = tuple(items)
        for item in items:
            match item:
                case ast.Let():
                    self._define(item.name.id, item.name.span, "let", item, names)
                case ast.Param():
                    self._define(item.name.id, item.name.span, "param", item, names)
                case ast.Use():
                    self._define(use_name(item), item.alias.span if item.alias else item.path.span, "use", item, names)
        for item in items:
            self._visit(item, chain)

    def _define(self, name: str, span: Span, kind: str, node: ast.Node, names: dict[str, Definition]) -> None:
        definition = Definition(name, span, kind, node)
        self.names.definitions.append(definition)
        names.setdefault(name, definition)

    def _scope(self, span: Span, names: Iterable[tuple[ast.Name, ast.Node]], kind: str, chain: Scopes) -> Scopes:
        scope = Scope(span)
        self.names.scopes.append(scope)
        for name, node in names:
            self._define(name.id, name.span, kind, node, scope.names)
        return (scope, *chain)

    def _visit(self, node: ast.Node, chain: Scopes) -> None:
        match node:
            case ast.Name():
                self._name(node, chain)
            case ast.ColorLiteral():
                self.names.colors.append(node)
            case ast.Member():
                if isinstance(node.object, ast.Name):
                    self.names.members.append((node, self._name(node.object, chain)))
                else:
                    self._visit(node.object, chain)
            case ast.Argument():
                self._visit(node.value, chain)
            case ast.Call():
                self.names.calls.append(node)
                self._visit(node.function, chain)
                for argument in node.arguments:
                    self._visit(argument.value, chain)
            case ast.Block():
                inner = self._scope(node.span, (), "", chain)
                self.items(node.items, inner, inner[0].names)
            case ast.BlockExpression():
                inner = self._scope(node.span, (), "", chain)
                self.items((*node.lets, node.result), inner, inner[0].names)
            case ast.Let():
                self._let(node, chain)
            case ast.Param():
                self._parts((node.default, node.range), chain)
                self._types(node.type)
            case ast.For():
                self._visit(node.source, chain)
                inner = self._scope(node.block.span, [(node.name, node)], "loop", chain)
                self.items(node.block.items, inner, inner[0].names)
            case ast.Comprehension():
                self._visit(node.source, chain)
                self._parts((node.condition, node.body), self._scope(node.span, [(node.name, node)], "loop", chain))
            case ast.Function():
                self._visit(node.body, self._scope(node.span, [(p, node) for p in node.parameters], "parameter", chain))
            case ast.Use() | ast.Unit():
                pass
            case _:
                self._parts(ast.children(node), chain)

    def _parts(self, nodes: Iterable[ast.Node | None], chain: Scopes) -> None:
        for node in nodes:
            if node is not None:
                self._visit(node, chain)

    def _let(self, let: ast.Let, chain: Scopes) -> None:
        inner = chain
        if let.parameters is not None:
            inner = self._scope(let.span, [(p.name, p) for p in let.parameters], "parameter", chain)
            for p in let.parameters:
                self._types(p.type)
                self._parts((p.default,), inner)
        self._visit(let.value, inner)

    def _types(self, name: ast.Name | None) -> None:
        if name is not None:
            self.names.types.append(name)

    def _name(self, name: ast.Name, chain: Scopes) -> Definition | None:
        for scope in chain:
            definition = scope.names.get(name.id)
            if definition is not None:
                self.names.bound.append((name, definition))
                return definition
        definition = self.names.top.get(name.id)
        if definition is not None:
            self.names.bound.append((name, definition))
        else:
            self.names.free.append(name)
        return definition
