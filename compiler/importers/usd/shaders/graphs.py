"""Graphs of MaterialX in USD: shaders as nodes, and which of them are one value."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import UsdShade

from ....texture_graph import evaluate
from ....texture_graph.graph_builder import TooLarge
from ...materialx import elementary, library, patterns, physical, pictures
from ...materialx.evaluator import Evaluator, NotDrawn
from ...materialx.graph import Node, Port
from . import connections
from .network import Graph

Tell = Callable[[str, Any], None]
HANDLER_MODULES = (elementary, patterns, physical, pictures)  # importing them registers their nodes
OWN_NORMAL = "ND_normal_vector3"  # as the source of a normal it changes nothing
FLAKES, FLAKE_NORMAL = ("flake2d", "flake3d"), "flakenormal"
_BENT = ("normalmap", "bump", "heighttonormal", "hextilednormalmap")


@dataclass(slots=True)
class Trial:
    """A host that notes what a graph reads."""

    tell: Tell
    varnames: dict[str, None] = field(default_factory=dict)
    primvars: dict[str, str] = field(default_factory=dict)  # types
    values: dict[str, Sequence[float]] = field(default_factory=dict)  # of primvars
    in_world: bool = False
    pictures: int = 0

    def picture(self, node: Node, file: Port, wraps: tuple[str, str], nearest: bool) -> tuple[int, Any] | None:
        self.pictures += 1
        return 0, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

    def coordinates(self, name: str) -> tuple[Sequence[float], Sequence[float]]:
        self.varnames[name or "st"] = None
        return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

    def primvar(self, name: str, kind: str, default: Sequence[float], place: Any) -> Sequence[float]:
        self.primvars[name] = kind
        return self.values.get(name, default)

    def is_u(self, name: str) -> bool:
        return False

    def world(self) -> np.ndarray | None:
        self.in_world = True
        return np.eye(4)

    def graph(self, node: Node, output: str, kind: str, factor: str | None = None) -> Graph:
        """The graph that was read."""
        of_one = tuple(name for name, type_ in self.primvars.items() if type_ == "float")
        return Graph(node, output, kind, tuple(self.varnames), tuple(self.primvars), of_one, factor, self.in_world)


@dataclass(slots=True)
class Graphs:
    """The graphs of a stage. `linear` makes a colour of an attribute linear."""

    time: Any
    linear: Callable[[Any, Any], Any]
    tell: Tell
    nodes: dict[str, Node] = field(default_factory=dict)  # by path of the prim

    def read(self, shader: Any, output: str, fallback: Any) -> Any:
        """The value of a shader's output, or a Graph; `fallback` with a warning for nodes that are not drawn."""
        return self.source(self.node(shader), output, fallback)

    def source(self, node: Node, output: str, fallback: Any) -> Any:
        """The value of a node's output, or a Graph."""
        if library.document() is None:
            hint = "install the package MaterialX"
            self.tell(f"the shader `{node.definition}` is not drawn: the input it feeds takes its default ({hint})", node.place)
            return fallback
        if library.definition(node.definition) is None:
            self.tell(f"the shader `{node.definition}` is not drawn: the input it feeds takes its default", node.place)
            return fallback
        if library.category(node) in _BENT or (library.category(node) in FLAKES and output == FLAKE_NORMAL):
            return self._of_normals(node).graph(node, output, "vector3")
        trial = Trial(self.tell)
        evaluator = Evaluator(trial)
        try:
            names = evaluator.node(node, output)
            evaluator.builder.finish(*names[:3])
        except (NotDrawn, TooLarge) as reason:
            self.tell(f"{reason}: the input it feeds takes its default", node.place)
            return fallback
        numbers = [evaluator.builder.number(name) for name in names]
        if None not in numbers and not trial.primvars and not trial.in_world:
            return numbers[0] if len(numbers) == 1 else tuple(numbers)
        colors = [name for name, kind in trial.primvars.items() if kind == "color3"]
        factor = next((name for name in colors if len(names) == 3 and self._is_multiple(node, output, name)), None)
        return trial.graph(node, output, evaluator.kind(node, output), factor)

    def _is_multiple(self, node: Node, output: str, name: str) -> bool:
        """Whether each channel of a colour is that of a primvar times a number of the rest of the graph: tried at random points."""
        rng = np.random.default_rng(1)
        points = np.concatenate([rng.uniform(-2.0, 2.0, (3, 32)), rng.uniform(0.0, 1.0, (2, 32)), rng.normal(size=(3, 32))])
        points[5:] /= np.linalg.norm(points[5:], axis=0)
        white: np.ndarray | None = None
        for color in (np.ones(3), np.array([0.3, 0.7, 0.9]), np.array([0.05, 1.6, 0.4])):
            evaluator = Evaluator(Trial(lambda message, place: None, values={name: color.tolist()}))
            tape = evaluator.builder.finish(*evaluator.node(node, output)[:3])
            drawn = np.array(evaluate.results(tape, list(points), _picture))
            white = drawn if white is None else white
            if not np.allclose(drawn, white * color[:, None], rtol=1e-9, atol=1e-12):
                return False
        return True

    def _of_normals(self, node: Node) -> Trial:
        """What a node for normals reads."""
        trial = Trial(self.tell)
        evaluator = Evaluator(trial)
        for name in ("in", "height"):
            try:
                evaluator.input(node, name)
            except (NotDrawn, TooLarge):
                continue
        return trial

    def node(self, shader: Any) -> Node:
        """The node of a shader, with those that feed it."""
        waiting: list[Any] = []
        result = self._begun(shader, waiting)
        while waiting:
            begun = waiting.pop()
            node = self.nodes[str(begun.GetPath())]
            for shader_input in begun.GetInputs():
                if (port := self._port(shader_input, waiting)) is not None:
                    node.inputs[str(shader_input.GetBaseName())] = port
        return result

    def _begun(self, shader: Any, waiting: list[Any]) -> Node:
        """The node of a shader; one without inputs, to read later, for a shader that is new."""
        path = str(shader.GetPath())
        if path not in self.nodes:
            self.nodes[path] = Node(str(shader.GetPath().name), str(shader.GetIdAttr().Get()), {}, shader.GetPrim())
            waiting.append(shader)
        return self.nodes[path]

    def _port(self, shader_input: Any, waiting: list[Any]) -> Port | None:
        """An input: a value, or the output of a node; None without either."""
        kind = _TYPES.get(str(shader_input.GetTypeName()), "float")
        for attribute in shader_input.GetValueProducingAttributes():
            source = UsdShade.Shader(attribute.GetPrim())
            if source and UsdShade.Output.IsOutput(attribute):
                return Port(kind, source=self._begun(source, waiting), output=str(attribute.GetName()).rpartition(":")[2])
            value = attribute.Get(self.time)
            if value is not None:
                return Port(kind, _plain(self.linear(attribute, value), kind), space=str(attribute.GetColorSpace() or ""))
        connections.tell_circle(shader_input, self.tell)
        return None


def _picture(texture: int, s: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
    """Four channels that change with s and t, in place of a picture."""
    return [0.5 + 0.5 * np.sin(40.0 * s + 7.0 * k + 23.0 * t * t) for k in range(4)]


_TYPES = {
    "float": "float", "half": "float", "double": "float", "int": "integer", "bool": "boolean", "string": "string", "token": "string",
    "asset": "filename", "color3f": "color3", "color3h": "color3", "color3d": "color3", "color4f": "color4", "float2": "vector2",
    "texCoord2f": "vector2", "float3": "vector3", "vector3f": "vector3", "normal3f": "vector3", "point3f": "vector3", "float4": "vector4",
    "matrix3d": "matrix33", "matrix4d": "matrix44",
}  # fmt: skip


def _plain(value: Any, kind: str) -> Any:
    """A value of USD as numbers, a truth value, a text or a file."""
    if kind in ("filename", "string") or isinstance(value, bool | int | float | str):
        return str(value) if kind == "string" else value
    numbers: list[float] = []
    for part in value:
        numbers += [float(p) for p in part] if hasattr(part, "__len__") else [float(part)]
    return tuple(numbers)
