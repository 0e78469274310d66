"""Fixtures of the language tests: parse text without errors, print a tree."""

from dataclasses import fields

import pytest
from maquette.lang.diagnostics import Diagnostics, render_text
from maquette.lang.syntax import ast, parser


@pytest.fixture(scope="session")
def read():
    """The tree of text that has no error."""
    return _read


@pytest.fixture(scope="session")
def shown():
    """A tree without places, as text: (Kind field …)."""
    return _shown


def _read(text: str) -> ast.File:
    """The tree of text that has no error."""
    diagnostics = Diagnostics()
    file = parser.parse(text, "t", diagnostics)
    assert [render_text(d, lambda _: text) for d in diagnostics.items] == []
    return file


def _shown(node) -> object:
    """A tree without places, as text: (Kind field …)."""
    if isinstance(node, ast.Number):
        return node.text
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.String):
        return f'"{node.value}"'
    if isinstance(node, ast.ColorLiteral):
        return node.text
    if isinstance(node, tuple):
        return "[" + " ".join(str(_shown(n)) for n in node) + "]"
    if isinstance(node, ast.Node):
        left_out = {"span", "before", "after", "blank_before", "dangling"}
        parts = [str(_shown(getattr(node, f.name))) for f in fields(node) if f.name not in left_out]
        return f"({type(node).__name__} {' '.join(parts)})"
    return str(node)
