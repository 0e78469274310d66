"""The syntax tree of a .scene file, with spans, comments and blank lines, before name resolution."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, TypeVar, dataclass_transform

from ..diagnostics import Span

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def _node(kind: type[T]) -> type[T]:
    """A dataclass that type checkers take as frozen. Node has its other methods: making them for each class takes 15 ms."""
    return dataclass(slots=True, repr=False, eq=False)(kind)


@_node
class Node:
    """A node with its place in the source."""

    span: Span

    def _values(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in _names(type(self)))

    def __eq__(self, other: object) -> bool:
        return self._values() == other._values() if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def __repr__(self) -> str:
        shown = ", ".join(f"{name}={value!r}" for name, value in zip(_names(type(self)), self._values(), strict=True))
        return f"{type(self).__name__}({shown})"


# --- expressions ----------------------------------------------------------------------------------------------------


@_node
class Number(Node):
    """`1.5`, `35cm`, `50%`"""

    value: float
    unit: str  # "" for a bare number, "%" for percent
    text: str  # as written, for the formatter


@_node
class String(Node):
    """`"text"`"""

    value: str  # escapes resolved


@_node
class ColorLiteral(Node):
    """`#rrggbb`"""

    text: str  # "#rgb" or "#rrggbb"


@_node
class Name(Node):
    """`name`"""

    id: str


@_node
class ListLiteral(Node):
    """`[a, b]`"""

    items: tuple[Node, ...]


@_node
class Comprehension(Node):
    """`[body for name in source if condition]`"""

    body: Node
    name: Name
    source: Node
    condition: Node | None


@_node
class Conditional(Node):
    """`if condition then yes else no`"""

    condition: Node
    yes: Node
    no: Node


@_node
class Function(Node):
    """`|a, b| body`"""

    parameters: tuple[Name, ...]
    body: Node


@_node
class Binary(Node):
    """`op` is one of: or and < <= > >= == != .. + - * / ^"""

    op: str
    left: Node
    right: Node


@_node
class Unary(Node):
    """`op` is `-` or `not`."""

    op: str
    operand: Node


@_node
class Parens(Node):
    """`(inner)`"""

    inner: Node


@_node
class Member(Node):
    """`object.name`"""

    object: Node
    name: Name


@_node
class Argument(Node):
    """`value` or `name: value` in a call"""

    name: Name | None
    value: Node


@_node
class Call(Node):
    """`function(arguments)`"""

    function: Node
    arguments: tuple[Argument, ...]


@_node
class Index(Node):
    """`object[index]`"""

    object: Node
    index: Node


@_node
class Comment(Node):
    """`// text`"""

    text: str  # with its slashes


@_node
class Item(Node):
    """A statement. `before` are the comments above it, `after` is the comment after it on its last line."""

    before: tuple[Comment, ...]
    after: Comment | None
    blank_before: bool


@_node
class Block(Node):
    """`{ items }`"""

    items: tuple[Item, ...]
    dangling: tuple[Comment, ...] = ()  # comments after the last item


@_node
class WithChildren(Node):
    """`target { … }`"""

    target: Node
    block: Block


# --- items ----------------------------------------------------------------------------------------------------------


@_node
class Result(Item):
    """`expression`, the value of a block expression"""

    expression: Node


@_node
class Use(Item):
    """`use "path" as alias`"""

    path: String
    alias: Name | None


@_node
class Unit(Item):
    """`unit name`"""

    name: Name


@_node
class Param(Item):
    """`param name: type = default in range "doc"`"""

    name: Name
    type: Name | None
    default: Node
    range: Node | None
    doc: String | None


@_node
class Parameter(Node):
    """`name: type = default` of a function"""

    name: Name
    type: Name | None
    default: Node | None


@_node
class Let(Item):
    """`let name = value` or `let name(parameters) = value`"""

    name: Name
    parameters: tuple[Parameter, ...] | None  # None: a constant; (): a part without parameters
    value: Node


@_node
class BlockExpression(Node):
    """`{ let a = b; result }` as an expression"""

    lets: tuple[Let, ...]
    result: Result
    dangling: tuple[Comment, ...]  # comments after the result


@_node
class For(Item):
    """`for (name in source) { … }`"""

    name: Name
    source: Node
    block: Block


@_node
class If(Item):
    """`if (condition) { … } else { … }`"""

    condition: Node
    yes: Block
    no: Block | If | None


@_node
class ElementItem(Item):
    """An expression as a statement: its value is placed."""

    expression: Node


@_node
class File(Node):
    """A file. `items` are in source order; the spans refer to `text`.

    `broken` are the names that items with syntax errors bind. Later stages do not report them as unknown. `called` are the functions
    called in such items.
    """

    name: str
    text: str
    items: tuple[Item, ...]
    dangling: tuple[Comment, ...] = ()
    broken: frozenset[str] = frozenset()
    called: tuple[Name, ...] = ()


@cache
def _names(kind: type[Node]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def children(node: Node) -> Iterator[Node]:
    """The child nodes of `node`, in source order."""
    for name in _names(type(node)):
        value = getattr(node, name)
        if isinstance(value, Node):
            yield value
        elif isinstance(value, tuple):
            yield from (v for v in value if isinstance(v, Node))


def places_children(node: Node) -> bool:
    """Whether `node` uses `children`, apart from the functions that it defines."""
    stack = [node]
    while stack:
        n = stack.pop()
        if isinstance(n, Name) and n.id == "children":
            return True
        stack.extend(c for c in children(n) if not (isinstance(c, Let) and c.parameters is not None))
    return False
