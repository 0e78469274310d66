"""Values in the message of an assertion that fails: those of the names in its condition."""

from __future__ import annotations

from collections.abc import Iterator

from ..syntax import ast
from ..units import Quantity
from .context import Code, Names, Scope
from .expressions import expression
from .values import Color, Mistake, Poisoned, show

NAME = "assert"
MOST = 6  # values in a message
LONGEST = 60  # characters of a value
SHOWN = (bool, float, Quantity, str, Color, tuple)

Operands = tuple[tuple[str, Code], ...]


def operands(args: tuple[ast.Argument, ...], names: Names | None) -> Operands:
    """The names and members of the condition of an assertion, with the code of each."""
    parts = {_text(part): part for a in args if a.name is None or a.name.id == "condition" for part in _parts(a.value)}
    return tuple([(text, expression(part, names)) for text, part in parts.items()])


def values_of(shown: Operands, scope: Scope) -> str:
    """The values as text: "wall is 2mm, gap is 3mm"."""
    texts = []
    for name, code in shown:
        try:
            value = code(scope)
        except (Poisoned, Mistake):
            continue  # in a branch of the condition that was not evaluated
        if isinstance(value, SHOWN):
            text = show(value, 1)
            texts.append(f"{name} is {text if len(text) <= LONGEST else text[: LONGEST - 1] + '…'}")
    return ", ".join(texts[:MOST])


def _parts(node: ast.Node) -> Iterator[ast.Name | ast.Member]:
    """The outermost names and members in an expression, without callees and the contents of functions, comprehensions and blocks."""
    if isinstance(node, ast.Name | ast.Member):
        yield node
    elif not isinstance(node, ast.Function | ast.Comprehension | ast.BlockExpression):
        callee = node.function if isinstance(node, ast.Call) else None
        for child in ast.children(node):
            if child is not callee:
                yield from _parts(child.value if isinstance(child, ast.Argument) else child)


def _text(node: ast.Node) -> str:
    if isinstance(node, ast.Member):
        return f"{_text(node.object)}.{node.name.id}"
    return node.id if isinstance(node, ast.Name) else "…"
