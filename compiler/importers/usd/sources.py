"""Reads the inputs of shaders: values, pictures, primvars and graphs, through node graphs and interfaces."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import UsdShade

from ...scene.row_records import Color
from . import stage
from .audit import Audit
from .shaders import connections, graphs, materialx
from .shaders.network import Graph, Picture, Primvar
from .stage import Warnings

READERS = ("UsdPrimvarReader_", "ND_UsdPrimvarReader_", "ND_geompropvalue_")
MOST_NODES = 64  # shaders one behind the other


@dataclass(slots=True)
class Sources:
    """The sources of inputs of one stage."""

    warnings: Warnings
    audit: Audit
    graphs: graphs.Graphs = field(init=False)
    _depth: int = 0  # of the shader that is being read
    _loops: bool = False  # shaders feed each other

    def __post_init__(self) -> None:
        self.graphs = graphs.Graphs(self.warnings.opened.time, _linear, self.warnings.tell)

    def source(self, shader_input: Any, fallback: Any) -> Any:
        """Source of an input: a value, Picture, Primvar or Graph, resolved through node graphs and interfaces."""
        if not shader_input:
            return fallback
        if self._depth == MOST_NODES:
            self.warnings.tell(f"more than {MOST_NODES} shaders feed each other: the input takes its default", shader_input.GetPrim())
            self._loops = True
            return fallback
        self._depth += 1
        try:
            return self._resolved(shader_input, fallback)
        finally:
            self._depth -= 1
            self._loops = self._loops and self._depth > 0

    def value(self, shader_input: Any, fallback: Any) -> Any:
        """An input that is a value; `fallback` for other sources."""
        value = self.source(shader_input, fallback)
        return fallback if isinstance(value, Picture | Primvar | Graph) else value

    def text(self, node: Any, name: str) -> str:
        return str(self.value(materialx.alias(node, name), ""))

    def _resolved(self, shader_input: Any, fallback: Any) -> Any:
        for attribute in shader_input.GetValueProducingAttributes():
            node = _node(attribute)
            if node is None:
                value = stage.value(attribute, self.warnings.opened.time)
                return fallback if value is None else _linear(attribute, value)
            kind = str(node.GetIdAttr().Get())
            if fallback is None and kind == graphs.OWN_NORMAL:
                return None
            output = str(attribute.GetName()).rpartition(":")[2]
            if materialx.is_picture(kind) and (place := self._coordinates(node, kind)) is not None:
                self.audit.shader(node.GetPrim(), kind)
                return Picture(node, output, *place)
            if kind.startswith(READERS):
                self.audit.shader(node.GetPrim(), kind)
                name = self.text(node, "varname") or self.text(node, "geomprop")
                return Primvar(name, self.source(node.GetInput("fallback") or node.GetInput("default"), fallback))
            passed = materialx.through(node, kind, output, self.source, fallback)
            if passed is not NotImplemented:
                self.audit.shader(node.GetPrim(), kind)
                return passed
            return fallback if self._loops else self.graphs.read(node, output, fallback)
        connections.tell_circle(shader_input, self.warnings.tell)
        return fallback

    def _coordinates(self, node: Any, kind: str) -> tuple[str, Any] | None:
        """The primvar of a texture's st input, and the frame of the UsdTransform2d nodes between: scaled, rotated, translated.

        None where other nodes of MaterialX make the coordinates.
        """
        frame = materialx.tiling(node, self.value) if kind.startswith("ND_tiledimage_") else np.eye(3)
        shader_input = node.GetInput("st") or node.GetInput("texcoord")
        for _ in range(16):
            attributes = shader_input.GetValueProducingAttributes() if shader_input else []
            source = _node(attributes[0]) if attributes else None
            if source is None:
                return "st", rows(frame)
            kind = str(source.GetIdAttr().Get())
            if kind in ("UsdTransform2d", "ND_UsdTransform2d", "ND_place2d_vector2") and self._is_fixed(source):
                self.audit.shader(source.GetPrim(), kind)
                placed = kind == "ND_place2d_vector2"
                frame = frame @ (materialx.place2d(source, self.value) if placed else self._transform2d(source))
                shader_input = source.GetInput("in") or source.GetInput("texcoord")
                continue
            if kind.startswith((*READERS, "ND_texcoord_")):
                self.audit.shader(source.GetPrim(), kind)
                return self.text(source, "varname") or self.text(source, "geomprop") or "st", rows(frame)
            if kind.startswith("ND_"):
                return None
            self.warnings.tell(f"the shader `{kind}` gives no texture coordinates: `st` is taken", source.GetPrim())
            break
        return "st", rows(frame)

    def _is_fixed(self, node: Any) -> bool:
        """Whether the inputs of a frame are values."""
        names = ("pivot", "scale", "rotate", "offset", "operationorder", "rotation", "translation")
        sources = [self.source(node.GetInput(name), 0.0) for name in names]
        return not any(isinstance(source, Picture | Primvar | Graph) for source in sources) and not sources[4]

    def _transform2d(self, node: Any) -> np.ndarray:
        turn = math.radians(float(self.value(node.GetInput("rotation"), 0.0)))
        sx, sy = self.value(node.GetInput("scale"), (1.0, 1.0))
        tx, ty = self.value(node.GetInput("translation"), (0.0, 0.0))
        c, s = math.cos(turn), math.sin(turn)
        return np.array([[c * sx, -s * sy, tx], [s * sx, c * sy, ty], [0.0, 0.0, 1.0]])


def _linear(attribute: Any, value: Any) -> Any:
    """A value, in linear colours with the primaries of sRGB if it is one of three numbers."""
    if attribute.GetTypeName().role != "Color" or len(value) != 3:
        return value
    return type(value)(*map(float, stage.linear(attribute, np.array(value, np.float64))))


def _node(attribute: Any) -> Any:
    """The shader that owns an output attribute; None for a value."""
    shader = UsdShade.Shader(attribute.GetPrim())
    return shader if shader and UsdShade.Output.IsOutput(attribute) else None


def rows(frame: np.ndarray) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """The first two rows of a frame."""
    u, v = (frame[:2] + 0.0).tolist()
    return (u[0], u[1], u[2]), (v[0], v[1], v[2])


def floats(value: Any) -> np.ndarray:
    """A value as numbers; none where it is no number or array of numbers."""
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)


def rgb(value: Any, fallback: Color) -> Color:
    """Three numbers of a colour or of a grey; `fallback` where a value has none."""
    try:
        numbers = [float(v) for v in value][:3] if hasattr(value, "__len__") else [float(value)] * 3
    except (TypeError, ValueError):
        return fallback
    return (numbers[0], numbers[1], numbers[2]) if len(numbers) == 3 and all(map(math.isfinite, numbers)) else fallback
