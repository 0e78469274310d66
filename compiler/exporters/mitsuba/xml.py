"""Mitsuba XML elements, typed by their Python values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from ..number_text import number, numbers


@dataclass(frozen=True, slots=True)
class Node:
    """One XML element with attributes and children."""

    tag: str
    attributes: dict[str, str]
    children: Sequence[Node] = ()

    def with_(self, *children: Node) -> Node:
        return Node(self.tag, self.attributes, (*self.children, *children))

    def lines(self, indent: str = "") -> list[str]:
        head = f"{indent}<{self.tag}" + "".join(f" {k}={quoteattr(v)}" for k, v in self.attributes.items())
        if not self.children:
            return [head + "/>"]
        return [head + ">", *(line for child in self.children for line in child.lines(indent + "    ")), f"{indent}</{self.tag}>"]

    def __str__(self) -> str:
        return "\n".join(self.lines())


def node(tag: str, kind: str, name: str = "", **values: Any) -> Node:
    """A plugin element `<tag type="kind">` with parameters `values`; `name` is its name in the parent."""
    attributes = {"type": kind} | ({"name": name} if name else {})
    return Node(tag, attributes, tuple(value(key, v) for key, v in values.items()))


def value(name: str, content: Any) -> Node:
    """A parameter: bool, int, float, str, a (4, 4) transform or a child Node."""
    if isinstance(content, Node):
        return Node(content.tag, {**content.attributes, "name": name}, content.children)
    if isinstance(content, bool):
        return Node("boolean", {"name": name, "value": "true" if content else "false"})
    if isinstance(content, int):
        return Node("integer", {"name": name, "value": str(content)})
    if isinstance(content, str):
        return Node("string", {"name": name, "value": content})
    if isinstance(content, np.ndarray):
        return Node("transform", {"name": name}, (Node("matrix", {"value": numbers(content, " ")}),))
    return Node("float", {"name": name, "value": number(content)})


def rgb(name: str, color: Any) -> Node:
    """A linear colour."""
    return Node("rgb", {"name": name, "value": numbers(color)})


def vector(name: str, components: Any) -> Node:
    x, y, z = (number(v) for v in components)
    return Node("vector", {"name": name, "x": x, "y": y, "z": z})
