"""Copies of syntax trees in other lines of a file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cache
from operator import attrgetter
from typing import Any

from ..diagnostics import Span
from . import ast
from .parser import Segment

_PLAIN = ("str", "float", "bool")  # types of fields that are not nodes


def moved(segment: Segment, line: int) -> Segment | None:
    """`segment` with its start in `line`; None if it has to be parsed there, as messages name lines and deep trees are not copied."""
    lines = line - segment.line
    if not lines:
        return segment
    if segment.messages:
        return None
    try:
        items, dangling, calls = (_moved_all(nodes, lines) for nodes in (segment.items, segment.dangling, segment.calls))
    except RecursionError:
        return None
    return segment._replace(line=line, items=items, dangling=dangling, calls=calls)


def _moved_all(nodes: tuple[Any, ...], lines: int) -> tuple[Any, ...]:
    return tuple([_moved(node, lines) for node in nodes])


def _moved(node: ast.Node, lines: int) -> ast.Node:
    kind = type(node)
    values_of, children = _fields(kind)
    span, *values = values_of(node)
    for k in children:
        value = values[k]
        if value:
            values[k] = _moved_all(value, lines) if type(value) is tuple else _moved(value, lines)
    return kind(Span(span.file, span.line + lines, span.column, span.end_line + lines, span.end_column), *values)


@cache
def _fields(kind: type[ast.Node]) -> tuple[Callable[[ast.Node], tuple[Any, ...]], list[int]]:
    """The function from a node to the tuple of its fields, and which of those behind the span hold nodes."""
    span, *others = fields(kind)
    return attrgetter(span.name, *(field.name for field in others)), [k for k, field in enumerate(others) if field.type not in _PLAIN]
