"""Parser callbacks that build the syntax tree: one method for each rule of the grammar."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

from ..diagnostics import Span
from . import ast, block_errors
from .grammar import Token
from .trivia import Comments, Place

MAX_DEPTH = 1000  # nested nodes, so that later stages can walk the tree recursively
BROKEN = "\0"  # the name that replaces the head of an item with a syntax error

_NUMBER = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)(.*)", re.DOTALL)
_ESCAPES = {"n": "\n", '"': '"', "\\": "\\"}


class TooDeep(Exception):
    """A node has descendants more than MAX_DEPTH levels below it."""

    def __init__(self, span: Span) -> None:
        super().__init__()
        self.span = span


class TreeBuilder:
    """Builds the tree of one file at a time. Each method takes the parts of its rule, tokens and nodes, and returns a node."""

    def __init__(self) -> None:
        self.begin("", Comments())

    def begin(self, file: str, comments: Comments) -> None:
        """Start the tree of `file`."""
        self.file, self.comments = file, comments
        self.depths: dict[int, int] = {}  # height of each subtree, by id(node); a reused id is overwritten

    # --- helpers --------------------------------------------------------------------------------------------------

    def _span(self, parts: list[Any]) -> Span:
        first, last = parts[0], parts[-1]
        a = first.span if isinstance(first, ast.Node) else first
        b = last.span if isinstance(last, ast.Node) else last
        return Span(self.file, a.line, a.column, b.end_line, b.end_column)

    def _check_depth(self, node: Any, *below: Any) -> Any:
        """`node`, whose parts are `below`. Raises TooDeep."""
        depth = 1 + max([self.depths.get(id(b), 0) for b in below], default=0)
        if depth > MAX_DEPTH:
            raise TooDeep(node.span)
        self.depths[id(node)] = depth
        return node

    def _name(self, token: Token) -> ast.Name:
        return ast.Name(self._span([token]), str(token))

    def _string(self, token: Token) -> ast.String:
        value = re.sub(r"\\(.)", lambda m: _ESCAPES.get(m[1], m[0]), token[1:-1])
        return ast.String(self._span([token]), value)

    # --- leaves ---------------------------------------------------------------------------------------------------

    def number(self, parts: list[Token]) -> ast.Number:
        match = _NUMBER.fullmatch(parts[0])
        assert match is not None
        return ast.Number(self._span(parts), float(match[1]), match[2], str(parts[0]))

    def string(self, parts: list[Token]) -> ast.String:
        return self._string(parts[0])

    def color(self, parts: list[Token]) -> ast.ColorLiteral:
        return ast.ColorLiteral(self._span(parts), str(parts[0]))

    def name(self, parts: list[Token]) -> ast.Name:
        return self._name(parts[0])

    # --- expressions ----------------------------------------------------------------------------------------------

    def parens(self, parts: list[Any]) -> ast.Parens:
        return self._check_depth(ast.Parens(self._span(parts), parts[1]), parts[1])

    def list_(self, parts: list[Any]) -> ast.ListLiteral:
        items = tuple(p for p in parts if isinstance(p, ast.Node))
        return self._check_depth(ast.ListLiteral(self._span(parts), items), *items)

    def comprehension(self, parts: list[Any]) -> ast.Comprehension:
        body, source = parts[1], parts[5]
        condition = parts[7] if len(parts) > 7 else None
        return self._check_depth(
            ast.Comprehension(self._span(parts), body, self._name(parts[3]), source, condition), body, source, condition
        )

    def conditional(self, parts: list[Any]) -> ast.Conditional:
        return self._check_depth(ast.Conditional(self._span(parts), parts[1], parts[3], parts[5]), *parts)

    def function(self, parts: list[Any]) -> ast.Function:
        names = tuple(self._name(p) for p in parts[:-1] if isinstance(p, Token) and p.type == "NAME")
        return self._check_depth(ast.Function(self._span(parts), names, parts[-1]), parts[-1])

    def binary(self, parts: list[Any]) -> ast.Binary:
        left, op, right = parts
        return self._check_depth(ast.Binary(self._span(parts), str(op), left, right), left, right)

    def unary(self, parts: list[Any]) -> ast.Unary:
        return self._check_depth(ast.Unary(self._span(parts), str(parts[0]), parts[1]), parts[1])

    def member(self, parts: list[Any]) -> ast.Member:
        return self._check_depth(ast.Member(self._span(parts), parts[0], self._name(parts[2])), parts[0])

    def index(self, parts: list[Any]) -> ast.Index:
        return self._check_depth(ast.Index(self._span(parts), parts[0], parts[2]), parts[0], parts[2])

    def call(self, parts: list[Any]) -> ast.Call:
        arguments: tuple[ast.Argument, ...] = parts[2] if isinstance(parts[2], tuple) else ()
        return self._check_depth(ast.Call(self._span(parts), parts[0], arguments), parts[0], *arguments)

    def arguments(self, parts: list[Any]) -> tuple[ast.Argument, ...]:
        return tuple(p for p in parts if isinstance(p, ast.Argument))

    def named(self, parts: list[Any]) -> ast.Argument:
        return self._check_depth(ast.Argument(self._span(parts), self._name(parts[0]), parts[2]), parts[2])

    def positional(self, parts: list[Any]) -> ast.Argument:
        return self._check_depth(ast.Argument(self._span(parts), None, parts[0]), parts[0])

    def with_children(self, parts: list[Any]) -> ast.WithChildren:
        return self._check_depth(ast.WithChildren(self._span(parts), parts[0], parts[1]), *parts)

    def block_expression(self, parts: list[Any]) -> ast.BlockExpression:
        """Raises WrongBlock."""
        span = self._span(parts)
        block_errors.check_items([p for p in parts if isinstance(p, ast.Item)], span)
        (*lets, result), dangling = self._attach(parts, (span.line, span.column), (span.end_line, span.end_column))
        return self._check_depth(ast.BlockExpression(span, tuple(lets), result, dangling), *parts)  # type: ignore[arg-type]

    def result(self, parts: list[Any]) -> ast.Result:
        return self._check_depth(ast.Result(self._span(parts), (), None, False, parts[0]), parts[0])

    # --- items ----------------------------------------------------------------------------------------------------

    def use(self, parts: list[Any]) -> ast.Use:
        alias = self._name(parts[3]) if len(parts) > 3 else None
        return ast.Use(self._span(parts), (), None, False, self._string(parts[1]), alias)

    def unit(self, parts: list[Any]) -> ast.Unit:
        return ast.Unit(self._span(parts), (), None, False, self._name(parts[1]))

    def param(self, parts: list[Any]) -> ast.Param:
        after = {str(p): q for p, q in pairwise(parts) if isinstance(p, Token) and p.type in ("COLON", "EQUAL", "IN")}
        type_ = self._name(after[":"]) if ":" in after else None
        doc = self._string(parts[-1]) if isinstance(parts[-1], Token) else None
        default, range_ = after["="], after.get("in")
        span = self._span(parts)
        return self._check_depth(ast.Param(span, (), None, False, self._name(parts[1]), type_, default, range_, doc), default, range_)

    def let(self, parts: list[Any]) -> ast.Let:
        parameters = None
        if parts[2] == "(":
            parameters = parts[3] if isinstance(parts[3], tuple) else ()
        let = ast.Let(self._span(parts), (), None, False, self._name(parts[1]), parameters, parts[-1])
        return self._check_depth(let, let.value, *parameters or ())

    def parameters(self, parts: list[Any]) -> tuple[ast.Parameter, ...]:
        return tuple(p for p in parts if isinstance(p, ast.Parameter))

    def parameter(self, parts: list[Any]) -> ast.Parameter:
        type_ = self._name(parts[2]) if len(parts) > 2 and parts[1] == ":" else None
        default = parts[-1] if isinstance(parts[-1], ast.Node) else None
        return self._check_depth(ast.Parameter(self._span(parts), self._name(parts[0]), type_, default), default)

    def for_(self, parts: list[Any]) -> ast.For:
        source, block = parts[4], parts[6]
        return self._check_depth(ast.For(self._span(parts), (), None, False, self._name(parts[2]), source, block), source, block)

    def if_(self, parts: list[Any]) -> ast.If:
        no = parts[6] if len(parts) > 6 else None
        return self._check_depth(ast.If(self._span(parts), (), None, False, parts[2], parts[4], no), *parts)

    def element(self, parts: list[Any]) -> ast.ElementItem:
        return self._check_depth(ast.ElementItem(self._span(parts), (), None, False, parts[0]), parts[0])

    def block(self, parts: list[Any]) -> ast.Block:
        span = self._span(parts)
        items, dangling = self._attach(parts, (span.line, span.column), (span.end_line, span.end_column))
        return self._check_depth(ast.Block(span, items, dangling), *(p for p in parts if isinstance(p, ast.Node)))

    def start(self, parts: list[Any]) -> tuple[tuple[ast.Item, ...], tuple[ast.Comment, ...]]:
        return self._attach(parts, (0, 0), (1 << 60, 0))

    def _attach(self, parts: list[Any], start: Place, end: Place) -> tuple[tuple[ast.Item, ...], tuple[ast.Comment, ...]]:
        return self.comments.attach([p for p in parts if isinstance(p, ast.Item) and not _is_broken(p)], start, end)


def _is_broken(item: ast.Item) -> bool:
    if isinstance(item, ast.Let):
        return item.name.id == BROKEN
    head: ast.Node | None = item.expression if isinstance(item, ast.ElementItem) else None
    while head is not None and not isinstance(head, ast.Name):
        head = next(ast.children(head), None)  # the leftmost leaf, as in `{ … }.a { … }(1)`
    return head is not None and head.id == BROKEN
