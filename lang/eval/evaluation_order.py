"""Order in which a block expression evaluates its constants, so that long chains of them need no recursion."""

from __future__ import annotations

from collections.abc import Mapping

from ..syntax import ast


def evaluation_order(block: ast.BlockExpression) -> tuple[str, ...]:
    """The constants of a block that its result always evaluates, each after those that it always evaluates itself.

    Others, as those in a branch of a choice, are left out. Empty if constants depend on each other in a circle.
    """
    values: dict[str, ast.Node] = {}
    for let in block.lets:
        if let.parameters is None:
            values.setdefault(let.name.id, let.value)
    functions = {let.name.id for let in block.lets if let.parameters is not None}
    constants = {name: value for name, value in values.items() if name not in functions}
    order: list[str] = []
    done: dict[str, bool] = {}  # whether the constants that a constant evaluates are all in `order`
    stack = [*_evaluated(block.result.expression, constants)]
    while stack:
        name = stack[-1]
        if name in done:
            stack.pop()
            if not done[name]:
                done[name] = True
                order.append(name)
            continue
        done[name] = False
        for needed in _evaluated(constants[name], constants):
            if done.get(needed) is False:
                return ()
            if needed not in done:
                stack.append(needed)
    return tuple(order)


def _evaluated(node: ast.Node, constants: Mapping[str, ast.Node]) -> list[str]:
    """Those of `constants` whose value an expression needs whatever values other names have."""
    names: list[str] = []
    stack = [node]
    while stack:
        node = stack.pop()
        match node:
            case ast.Name():
                if node.id in constants:
                    names.append(node.id)
            case ast.Conditional():
                stack.append(node.condition)
            case ast.Comprehension():
                stack.append(node.source)
            case ast.Binary(op="and" | "or"):
                stack.append(node.left)
            case ast.Member() | ast.Argument():
                stack.append(node.object if isinstance(node, ast.Member) else node.value)
            case ast.Function() | ast.BlockExpression() | ast.WithChildren():
                pass
            case _:
                stack.extend(ast.children(node))
    return names
