"""The syntax tree of a .scene file, with spans, comments and blank lines, before name resolution."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache

from ..diagnostics import Span


@dataclass(frozen=True, slots=True)
class Node:
    """A node with its place in the source."""

    span: Span


# --- expressions ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Number(Node):
    """`1.5`, `35cm`, `50%`"""

    value: float
    unit: str  # "" for a bare number, "%" for percent
    text: str  # as written, for the formatter


@dataclass(frozen=True, slots=True)
class String(Node):
    """`"text"`"""

    value: str  # escapes resolved


@dataclass(frozen=True, slots=True)
class ColorLiteral(Node):
    """`#rrggbb`"""

    text: str  # "#rgb" or "#rrggbb"


@dataclass(frozen=True, slots=True)
class Name(Node):
    """`name`"""

    id: str


@dataclass(frozen=True, slots=True)
class ListLiteral(Node):
    """`[a, b]`"""

    items: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Comprehension(Node):
    """`[body for name in source if condition]`"""

    body: Node
    name: Name
    source: Node
    condition: Node | None


@dataclass(frozen=True, slots=True)
class Conditional(Node):
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
    """`(inner)`"""

    inner: Node


@dataclass(frozen=True, slots=True)
class Member(Node):
    """`object.name`"""

    object: Node
    name: Name


@dataclass(frozen=True, slots=True)
class Argument(Node):
    """`value` or `name: value` in a call"""

    name: Name | None
    value: Node


@dataclass(frozen=True, slots=True)
class Call(Node):
    """`function(arguments)`"""

    function: Node
    arguments: tuple[Argument, ...]


@dataclass(frozen=True, slots=True)
class Index(Node):
    """`object[index]`"""

    object: Node
    index: Node


@dataclass(frozen=True, slots=True)
class Comment(Node):
    """`// text`"""

    text: str  # with its slashes


@dataclass(frozen=True, slots=True)
class Item(Node):
    """A statement. `before` are the comments above it, `after` is the comment after it on its last line."""

    before: tuple[Comment, ...]
    after: Comment | None
    blank_before: bool


@dataclass(frozen=True, slots=True)
class Block(Node):
    """`{ items }`"""

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
    """`use "path" as alias`"""

    path: String
    alias: Name | None


@dataclass(frozen=True, slots=True)
class Unit(Item):
    """`unit name`"""

    name: Name


@dataclass(frozen=True, slots=True)
class Param(Item):
    """`param name: type = default in range "doc"`"""

    name: Name
    type: Name | None
    default: Node
    range: Node | None
    doc: String | None


@dataclass(frozen=True, slots=True)
class Parameter(Node):
    """`name: type = default` of a function"""

    name: Name
    type: Name | None
    default: Node | None


@dataclass(frozen=True, slots=True)
class Let(Item):
    """`let name = value` or `let name(parameters) = value`"""

    name: Name
    parameters: tuple[Parameter, ...] | None  # None: a constant; (): a part without parameters
    value: Node


@dataclass(frozen=True, slots=True)
class For(Item):
    """`for (name in source) { … }`"""

    name: Name
    source: Node
    block: Block


@dataclass(frozen=True, slots=True)
class If(Item):
    """`if (condition) { … } else { … }`"""

    condition: Node
    yes: Block
    no: Block | If | None


@dataclass(frozen=True, slots=True)
class ElementItem(Item):
    """An expression as a statement: its value is placed."""

    expression: Node


@dataclass(frozen=True, slots=True)
class File(Node):
    """A file. `items` are in source order; the spans refer to `text`.

    `broken` are the names that items with syntax errors bind. Later stages do not report them as unknown.
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
