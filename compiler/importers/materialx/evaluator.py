"""Evaluator: the values of a node graph as names of a texture's tape.

A value is a tuple of names, one for each of its numbers. Nodes of the library that other nodes implement are read through these. A host
supplies what lies outside of graphs: pictures, texture coordinates and primvars; and takes what is not drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ...formula.opcodes import Op
from ...formula.tape import X, Y, Z
from ...texture_graph import opcodes
from ...texture_graph.graph_builder import GraphBuilder
from . import library
from .graph import COUNTS, Node, Port

Names = tuple[int, ...]
MOST_DEPTH = 120  # nodes one behind the other
MOST_NODES = 20_000  # values of a graph
SINGULAR = 1e-30  # determinant of a frame without an inverse


class Host(Protocol):
    """What a graph reads from outside."""

    def picture(self, node: Node, file: Port, wraps: tuple[str, str], nearest: bool) -> tuple[int, Any] | None:
        """(row of Textures, (2, 3) frame of the coordinates) of a file; None where it cannot be read."""

    def coordinates(self, name: str) -> tuple[Sequence[float], Sequence[float]]:
        """The two rows of the frame from the surface's u, v, 1 to the texture coordinates of a name; "" are the first ones."""
        ...

    def primvar(self, name: str, kind: str, default: Sequence[float], place: Any) -> Sequence[float]:
        """The constant value of a primvar."""
        ...

    def is_u(self, name: str) -> bool:
        """Whether u is a primvar of one number that varies over the surface."""
        ...

    def world(self) -> np.ndarray | None:
        """(4, 4) from the frame of tapes to that of the world; None where one surface has several."""
        ...

    @property
    def tell(self) -> Callable[[str, Any], None]:
        """Emits a warning at a place."""
        ...


class NotDrawn(Exception):
    """A node that cannot be a texture; the message says why."""


Handler = Callable[["Evaluator", Node, str, int], Sequence[int]]
HANDLERS: dict[str, Handler] = {}
"""By category: (evaluator, node, output, number of values) → names."""


def handles(*categories: str) -> Callable[[Handler], Handler]:
    """Register a handler."""

    def register(handler: Handler) -> Handler:
        HANDLERS.update(dict.fromkeys(categories, handler))
        return handler

    return register


@dataclass(eq=False)
class Evaluator:
    """Evaluates nodes into one builder; each value once."""

    host: Host
    builder: GraphBuilder = field(default_factory=GraphBuilder)
    _values: dict[tuple[int, str], Names] = field(default_factory=dict)
    _instances: dict[int, dict[str, Port]] = field(default_factory=dict)
    _kept: list[Node] = field(default_factory=list)  # so that their ids stay their own
    _depth: int = 0

    # --- inputs -------------------------------------------------------------------------------------------------------------

    def port(self, node: Node, name: str) -> Port | None:
        """The input of a node, or its default."""
        if (port := node.inputs.get(name)) is not None:
            return port
        defined = library.definition(node.definition)
        return defined.inputs.get(name) if defined else None

    def input(self, node: Node, name: str, count: int = 0, default: Sequence[float] | float = 0.0) -> Names:
        """The names of an input, repeated to `count` values where it has one; zeros fill up."""
        port = self.port(node, name)
        names = self.value(port) if port is not None else ()
        if not names:
            numbers = default if isinstance(default, Sequence) else (default,)
            names = tuple(self.builder.constant(number) for number in numbers)
        return self.sized(names, count) if count else names

    def sized(self, names: Names, count: int) -> Names:
        if len(names) == 1:
            return names * count
        return (names + (self.builder.constant(0.0),) * count)[:count]

    def scalar(self, node: Node, name: str, default: float = 0.0) -> int:
        return self.input(node, name, 1, default)[0]

    def value(self, port: Port) -> Names:
        """The names of a port's value."""
        if port.source is not None:
            return self.node(port.source, port.output)
        if port.geometry:
            return self.geometry(port.geometry)
        if port.value is None or isinstance(port.value, str):
            return ()
        numbers = port.value if isinstance(port.value, Sequence) else (port.value,)
        return tuple(self.builder.constant(float(number)) for number in numbers)

    def text(self, node: Node, name: str, default: str = "") -> str:
        """The text of an input, also through inputs of graphs."""
        port = self.port(node, name)
        while port is not None and port.source is not None and "value" in port.source.inputs:
            port = port.source.inputs["value"]
        return str(port.value) if port is not None and port.value is not None else default

    def fixed(self, node: Node, name: str, default: float) -> float:
        """An input that must be a constant."""
        number = self.builder.number(self.scalar(node, name, default))
        if number is None:
            self.host.tell(f"the input `{name}` of {node.definition} is drawn only as a number: its default is drawn", node.place)
            return default
        return number

    def kind(self, node: Node, output: str = "out") -> str:
        """The type of an output."""
        defined = library.definition(node.definition)
        if defined and defined.outputs:
            return defined.outputs.get(output) or next(iter(defined.outputs.values()))
        return next((part for part in reversed(node.definition.split("_")) if part in COUNTS), "float")

    # --- nodes --------------------------------------------------------------------------------------------------------------

    def node(self, node: Node, output: str = "out") -> Names:
        """The names of an output's value."""
        key = id(node), output
        if key not in self._values:
            if self._depth >= MOST_DEPTH or len(self._values) >= MOST_NODES:
                raise NotDrawn(f"more than {MOST_DEPTH} nodes feed each other, or a node feeds itself")
            self._depth += 1
            self._kept.append(node)
            try:
                self._values[key] = self._evaluated(node, output)
            finally:
                self._depth -= 1
        return self._values[key]

    def _evaluated(self, node: Node, output: str) -> Names:
        kind = self.kind(node, output)
        if kind not in COUNTS:
            raise NotDrawn(f"the node `{node.definition}` gives a {kind}, which is no texture")
        count = COUNTS[kind]
        if handler := HANDLERS.get(library.category(node)):
            return self.sized(tuple(handler(self, node, output, count)), count)
        if names := self.implemented(node, output):
            return self.sized(names, count)
        self.host.tell(f"the shader `{node.definition}` is not drawn: the input it feeds takes its default", node.place)
        return self.sized(self.input(node, "in" if "in" in node.inputs else "default", count), count)

    def implemented(self, node: Node, output: str) -> Names:
        """The value of a node that a graph of the library implements; () for others."""
        defined = library.definition(node.definition)
        if not defined or defined.graph is None:
            return ()
        if id(node) not in self._instances:
            self._instances[id(node)] = library.instance(node, defined)
        outputs = self._instances[id(node)]
        return self.value(outputs.get(output) or next(iter(outputs.values())))

    # --- geometry -----------------------------------------------------------------------------------------------------------

    def coordinates(self, name: str = "") -> Names:
        """Texture coordinates by name of the primvar."""
        u, v = self.host.coordinates(name)
        b = self.builder
        return tuple(b.linear([(row[0], opcodes.U), (row[1], opcodes.V)], row[2]) for row in (u, v))

    def geometry(self, name: str) -> Names:
        """A property of the geometry that is the default of an input."""
        if name.startswith("UV"):
            return self.coordinates()
        if name.startswith("V"):
            return self.view(name.endswith("world"), None)
        kind = {"P": "point", "N": "normal"}.get(name[:1], "")
        names = (X, Y, Z) if kind == "point" else (opcodes.NORMAL_X, opcodes.NORMAL_Y, opcodes.NORMAL_Z)
        if kind:
            return self.moved(names, kind, None) if name.endswith("world") else names
        raise NotDrawn(f"the {'tangent' if name.startswith(('T', 'B')) else name} of the surface is not drawn in textures")

    def view(self, in_world: bool, place: Any) -> Names:
        """The direction from a viewer above the point: a texture is the same from all sides."""
        self.host.tell("the direction of the view is drawn as that straight onto the surface, where textures read it", place)
        return tuple(self.builder.op(Op.NEGATE, name) for name in self.geometry("Nworld" if in_world else "Nobject"))

    def moved(self, names: Names, kind: str, place: Any, back: bool = False) -> Names:
        """A point, vector or normal of the object's frame in that of the world; or `back`. Normals have a length of 1."""
        frame, b = self.host.world(), self.builder
        if frame is None or abs(float(np.linalg.det(frame[:3, :3]))) < SINGULAR:
            self.host.tell(f"a {kind} in the space `world` is drawn as that in the frame of the object: it has several places", place)
            return names
        matrix = np.linalg.inv(frame) if back else frame
        if kind == "normal":
            matrix = np.linalg.inv(matrix).T
        shift = matrix[:3, 3] if kind == "point" else np.zeros(3)
        parts = [
            b.linear([(float(m), name) for name, m in zip(names, row[:3], strict=True)], float(t))
            for row, t in zip(matrix[:3], shift, strict=True)
        ]
        if kind != "normal":
            return tuple(parts)
        size = b.op(Op.SQRT, b.total([b.multiply(part, part) for part in parts]))
        return tuple(b.divide(part, size) for part in parts)
