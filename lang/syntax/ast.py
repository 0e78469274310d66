"""The syntax tree of a .scene file: what was written, with places, comments and blank lines, before any meaning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache

from ..diagnostics import Span


@dataclass(frozen=True, slots=True)
class Node:
    span: Span


# --- expressions ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Number(Node):
    value: float
    unit: str  # "" for a bare number, "%" for percent
    text: str  # as written, for the formatter


@dataclass(frozen=True, slots=True)
class String(Node):
    value: str  # escapes resolved


@dataclass(frozen=True, slots=True)
class ColorLiteral(Node):
    text: str  # "#rgb" or "#rrggbb"


@dataclass(frozen=True, slots=True)
class Name(Node):
    id: str


@dataclass(frozen=True, slots=True)
class ListLiteral(Node):
    items: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Each(Node):
    """`[body for name in source if condition]`"""

    body: Node
    name: Name
    source: Node
    condition: Node | None


@dataclass(frozen=True, slots=True)
class Choose(Node):
    """`if condition then yes else no`"""

    condition: Node
    yes: Node
    no: Node


@dataclass(frozen=True, slots=True)
class Function(Node):
    """`|a, b| body`"""

    parameters: tuple[Name, ...]
    body: Node


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """`op` is one of: or and < <= > >= == != .. + - * / ^"""

    op: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """`op` is `-` or `not`."""

    op: str
    operand: Node


@dataclass(frozen=True, slots=True)
class Parens(Node):
    """Parentheses as written (kept for the formatter)."""

    inner: Node


@dataclass(frozen=True, slots=True)
class Member(Node):
    object: Node
    name: Name


@dataclass(frozen=True, slots=True)
class Argument(Node):
    name: Name | None
    value: Node


@dataclass(frozen=True, slots=True)
class Call(Node):
    function: Node
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class Index(Node):
    object: Node
    index: Node


@dataclass(frozen=True, slots=True)
class Comment(Node):
    text: str  # with its slashes


@dataclass(frozen=True, slots=True)
class Item(Node):
    """A thing on a line of its own. `before` are the comments above it, `after` the one behind it on its line."""

    before: tuple[Comment, ...]
    after: Comment | None
    blank_before: bool


@dataclass(frozen=True, slots=True)
class Block(Node):
    items: tuple[Item, ...]
    dangling: tuple[Comment, ...] = ()  # comments after the last item


@dataclass(frozen=True, slots=True)
class WithChildren(Node):
    """`target { … }`"""

    target: Node
    block: Block


# --- items ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Use(Item):
    path: String
    alias: Name | None


@dataclass(frozen=True, slots=True)
class Unit(Item):
    name: Name


@dataclass(frozen=True, slots=True)
class Param(Item):
    name: Name
    type: Name | None
    default: Node
    range: Node | None
    doc: String | None


@dataclass(frozen=True, slots=True)
class Parameter(Node):
    name: Name
    type: Name | None
    default: Node | None


@dataclass(frozen=True, slots=True)
class Let(Item):
    name: Name
    parameters: tuple[Parameter, ...] | None  # None: a constant; (): a part without parameters
    value: Node


@dataclass(frozen=True, slots=True)
class For(Item):
    name: Name
    source: Node
    block: Block


@dataclass(frozen=True, slots=True)
class If(Item):
    condition: Node
    yes: Block
    no: Block | If | None


@dataclass(frozen=True, slots=True)
class ElementItem(Item):
    """An expression on a line of its own: what it evaluates to is placed."""

    expression: Node


@dataclass(frozen=True, slots=True)
class File(Node):
    """A whole file. `items` lie in the order written; `text` is the source the spans point into.

    `broken` are the names that items with a syntax error would have bound: later stages do not call them unknown.
    """

    name: str
    text: str
    items: tuple[Item, ...]
    dangling: tuple[Comment, ...] = ()
    broken: frozenset[str] = frozenset()


@cache
def _names(kind: type[Node]) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def children(node: Node) -> Iterator[Node]:
    """The nodes directly below `node`, in the order written."""
    for name in _names(type(node)):
        value = getattr(node, name)
        if isinstance(value, Node):
            yield value
        elif isinstance(value, tuple):
            yield from (v for v in value if isinstance(v, Node))


def places_children(node: Node) -> bool:
    """Whether `children` stands anywhere in `node`, other than in functions defined in it."""
    waiting = [node]
    while waiting:
        n = waiting.pop()
        if isinstance(n, Name) and n.id == "children":
            return True
        waiting.extend(c for c in children(n) if not (isinstance(c, Let) and c.parameters is not None))
    return False
