"""Nodes of MaterialX, from a document or a USD stage."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

COUNTS = {
    "float": 1, "integer": 1, "boolean": 1, "color3": 3, "color4": 4, "vector2": 2, "vector3": 3, "vector4": 4, "matrix33": 9,
    "matrix44": 16,
}  # fmt: skip
"""Numbers of the values of a type."""


@dataclass(eq=False, slots=True)
class Port:
    """An input: a value (numbers, a truth value, a text or a file), an output of a node, or a property of the geometry."""

    type: str
    value: Any = None
    source: Node | None = None
    output: str = "out"
    geometry: str = ""  # UV0, Pobject, Nworld …
    space: str = ""  # colour space of a file; colours are linear


@dataclass(eq=False, slots=True)
class Node:
    """A node: the name of its definition, as ND_add_float, and its inputs. `place` is where diagnostics point."""

    name: str
    definition: str
    inputs: dict[str, Port] = field(default_factory=dict)
    place: Any = None


def constant(type_: str, value: Any) -> Port:
    return Port(type_, value)


def operation(definition: str, place: Any, **inputs: Port) -> Node:
    """A node of the library that no file holds."""
    return Node(definition, definition, dict(inputs), place)
