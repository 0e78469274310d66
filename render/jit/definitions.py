"""The definitions of a module: digests of their syntax trees, and the names that each refers to.

Docstrings, comments, layout and annotations of functions leave a digest unchanged. cache_key.py follows the names.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterator
from typing import Any, NamedTuple

OTHER = ""
"""Name of the statements of a module that define nothing, such as a call or a loop. They belong to each definition of the module."""


class Definition(NamedTuple):
    """What a module defines under one name."""

    digest: str
    names: tuple[str, ...]  # that it refers to: of the module, dotted where it reads an attribute of one


class Module(NamedTuple):
    """The definitions of a module, and what its import statements bind."""

    definitions: dict[str, Definition]
    imports: dict[str, tuple[tuple[str, str], ...]]  # local name → (dotted module, name in it), relative imports alone


def read_module(text: str, package: tuple[str, ...]) -> Module:
    """The definitions of the source of a module in a package. Raises SyntaxError for text that is no Python."""
    tree = ast.parse(text)
    statements: dict[str, list[ast.stmt]] = {OTHER: []}
    for statement in tree.body:
        if not isinstance(statement, ast.Import | ast.ImportFrom) and not _is_constant(statement):
            for name in _defined(statement):
                statements.setdefault(name, []).append(statement)
    overloads = {name: _decorator_arguments(parts) & statements.keys() for name, parts in statements.items()}
    definitions = {name: _definition(parts) for name, parts in statements.items()}
    for name, targets in overloads.items():  # a function needs its overloads
        for target in targets:
            definitions[target] = definitions[target]._replace(names=(*definitions[target].names, name))
    return Module(definitions, _imports(tree, package))


def _is_constant(statement: ast.stmt) -> bool:
    """Whether a statement is a docstring."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a statement of a module binds; OTHER for one that may do more than bind."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {statement.name}
    names = {node.id for node in ast.walk(statement) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    if isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        return names or {OTHER}
    return {OTHER, *names, *(node.name for node in ast.walk(statement) if isinstance(node, ast.FunctionDef | ast.ClassDef))}


def _decorator_arguments(statements: list[ast.stmt]) -> set[str]:
    """The names in calls that decorate functions: `f` of @overload(f)."""
    functions = (each for each in statements if isinstance(each, ast.FunctionDef))
    calls = (each for function in functions for each in function.decorator_list if isinstance(each, ast.Call))
    return {argument.id for call in calls for argument in call.args if isinstance(argument, ast.Name)}


def _definition(statements: list[ast.stmt]) -> Definition:
    """The digest of statements, and the names they refer to. The statements lose their docstrings and annotations."""
    parts, names = [], dict[str, None]()
    for statement in statements:
        _strip(statement)
        parts.append(ast.dump(statement))
        names.update(dict.fromkeys(_names(statement)))
    return Definition(hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16], tuple(names))


def _strip(tree: ast.AST) -> None:
    """Remove docstrings and the annotations of functions."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            statements = [each for each in body if not (isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant))]
            node.body = statements or [ast.Pass()]  # type: ignore[attr-defined]
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            node.returns = None
        elif isinstance(node, ast.arg):
            node.annotation = None


_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)
_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


def _names(node: ast.AST, local: frozenset[str] = frozenset()) -> Iterator[str]:
    """The names of the module that a tree reads, dotted where it reads attributes of one; `local` names are of a function around it."""
    if isinstance(node, ast.Attribute | ast.Name):
        parts, inner = list[str](), node
        while isinstance(inner, ast.Attribute):
            parts.append(inner.attr)
            inner = inner.value
        if isinstance(inner, ast.Name):
            if inner.id not in local:
                yield ".".join([inner.id, *reversed(parts)])
            return
        node = inner
    if isinstance(node, _FUNCTIONS):
        outside = [*getattr(node, "decorator_list", ()), *node.args.defaults, *filter(None, node.args.kw_defaults)]
        for child in outside:
            yield from _names(child, local)
        local |= _bound(node)
        inside = node.body if isinstance(node.body, list) else [node.body]
    else:
        if isinstance(node, _COMPREHENSIONS):
            local |= {each.id for part in node.generators for each in ast.walk(part.target) if isinstance(each, ast.Name)}
        inside = [child for field, value in ast.iter_fields(node) if field != "annotation"
                  for child in (value if isinstance(value, list) else [value]) if isinstance(child, ast.AST)]  # fmt: skip
    for child in inside:
        yield from _names(child, local)


def _bound(function: Any) -> frozenset[str]:
    """The parameters and local variables of a function, without those of functions and comprehensions in it."""
    arguments = function.args
    every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg)
    names, shared = {each.arg for each in every if each is not None}, set[str]()
    todo: list[ast.AST] = list(function.body) if isinstance(function.body, list) else [function.body]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Global | ast.Nonlocal):
            shared.update(node.names)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        if not isinstance(node, (*_FUNCTIONS, *_COMPREHENSIONS, ast.ClassDef)):
            todo += ast.iter_child_nodes(node)
    return frozenset(names - shared)


def _imports(tree: ast.Module, package: tuple[str, ...]) -> dict[str, tuple[tuple[str, str], ...]]:
    """What the relative imports of a module bind, those inside of functions too."""
    bindings: dict[str, tuple[tuple[str, str], ...]] = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join([*package[: len(package) - node.level + 1], *(node.module.split(".") if node.module else [])])
            for alias in node.names:
                name = alias.asname or alias.name
                bindings[name] = (*bindings.get(name, ()), (base, alias.name))
    return bindings
