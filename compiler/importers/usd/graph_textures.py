"""Rows of textures for graphs of MaterialX: their tapes, with the pictures and primvars that they read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ....lang.diagnostics import Span
from ... import ir
from ...formula.opcodes import Op
from ...formula.tape import X, Y, Z
from ...scene.builder import NONE, SceneBuilder
from ...scene.row_records import Input, TextureData
from ...texture_graph.graph_builder import GraphBuilder, TooLarge
from ...texture_graph.opcodes import NORMAL_X, NORMAL_Y, NORMAL_Z, U, V
from .. import images
from ..common import uv_sets
from ..materialx import library
from ..materialx.evaluator import Evaluator, Names, NotDrawn
from ..materialx.graph import COUNTS, Node, Port
from .assets import asset
from .shaders import materialx
from .shaders.graphs import FLAKES
from .shaders.network import Fit, Graph
from .stage import Warnings, primvar_mean

_BUMP_SCALE = 1.0 / 16.0  # MaterialX' factor of heights
_STEP = 1.0 / 1024.0  # of u and v, of slopes
MIXED = "the texture coordinates `{}` have no affine map from the first ones: these are drawn"


@dataclass(slots=True)
class FileHost:
    """What graphs of a part of a mesh read: files of the stage, texture coordinates by the part's maps, mean values of primvars."""

    builder: SceneBuilder
    warnings: Warnings
    fit: Fit
    wraps: dict[str, ir.Wrap]
    prim: Any
    plain: str  # the coordinates that are the mesh's own
    frame: np.ndarray | None = None  # (4, 4) from that of tapes to the world of the stage; None where it has several
    white: str | None = None  # a primvar with 1 in place of its value

    def picture(self, node: Node, file: Port, wraps: tuple[str, str], nearest: bool) -> tuple[int, Any] | None:
        opened = asset(file.value, self.warnings, node.place)
        opened = None if opened is None else opened.among(self.fit.tiles)
        if opened is None:
            return None
        color = "_color" in node.definition
        try:
            space = materialx.known_space(file.space or "auto", self.builder.files.colors, self.tell, node.place) if color else "linear"
            row = opened.row(self.builder, space, color, self.warnings.opened.span(node.place))
        except images.ImageError as failure:
            self.builder.diagnostics.warning(failure.message, self.warnings.opened.span(node.place), failure.hint)
            return None
        frame: Any = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        wrap_u, wrap_v = (self.wraps.get(name, ir.Wrap.REPEAT) for name in wraps)
        if opened.tiles is not None:
            wrap_u, wrap_v, frame = ir.Wrap.CLAMP, ir.Wrap.CLAMP, opened.tiles.frame(frame)
        texture = TextureData(ir.TextureKind.IMAGE, row, wrap_u=wrap_u, wrap_v=wrap_v, nearest=nearest)
        return self.builder.texture(texture, self.warnings.opened.span(node.place)), frame

    def coordinates(self, name: str) -> tuple[Sequence[float], Sequence[float]]:
        frame = self.fit.maps.get(name or self.plain, uv_sets.PLAIN)
        if frame is None:
            self.warnings.tell(MIXED.format(name or self.plain), self.prim)
        if frame is None or frame is uv_sets.PLAIN:
            return (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        return frame[0].tolist(), frame[1].tolist()

    def primvar(self, name: str, kind: str, default: Sequence[float], place: Any) -> Sequence[float]:
        if name == self.white:
            return [1.0] * COUNTS[kind]
        mean, count = primvar_mean(self.prim, name, self.warnings.opened.time)
        if count > 1:
            self.warnings.tell(f"the primvar `{name}` varies over the surface: its mean is drawn", self.prim)
        return default if mean is None else np.ravel(mean).tolist()

    def is_u(self, name: str) -> bool:
        return name == self.fit.number

    def world(self) -> np.ndarray | None:
        return self.frame

    def tell(self, message: str, place: Any) -> None:
        self.warnings.tell(message, place)


def row(host: FileHost, graph: Graph, count: int, span: Span) -> int:
    """The row of a graph's texture of 1 or 3 numbers; NONE, with a warning, where it cannot be drawn."""
    evaluator = Evaluator(replace(host, white=graph.factor) if graph.of_white else host)
    try:
        names = evaluator.node(graph.node, graph.output)
        return _texture(host, graph, evaluator.builder, of_count(evaluator, names, count), span)
    except (NotDrawn, TooLarge) as reason:
        host.tell(f"{reason}: the input it feeds takes its default", graph.node.place)
        return NONE


def of_count(evaluator: Evaluator, names: Names, count: int) -> Sequence[int]:
    """As many numbers: the mean of a colour's, or one three times."""
    if count == 1 and len(names) > 1:
        few = names[:3]
        return [evaluator.builder.scale(evaluator.builder.total(few), 1.0 / len(few))]
    return evaluator.sized(names, count)


def _texture(host: FileHost, graph: Graph, builder: GraphBuilder, names: Sequence[int], span: Span) -> int:
    tape = host.builder.tape(builder.finish(*names))
    gain, bias = (graph.gain, graph.gain, graph.gain), (graph.bias, graph.bias, graph.bias)
    return host.builder.texture(TextureData(ir.TextureKind.FORMULA, tape=tape, gain=gain, bias=bias), span)


# --- normals ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Bent:
    """What bends the normals of a surface: a row of a normal map with its strength, or of heights in metres."""

    normal: int = NONE
    bump: int = NONE
    strength: tuple[float, float] = (1.0, 1.0)
    flakes: Mapping[ir.Slot, Input] = field(default_factory=dict)  # of slabs


def bent(host: FileHost, graph: Graph, span: Span) -> Bent:
    """The normal map, or the heights, of a node that gives a normal."""
    evaluator, node = Evaluator(host), graph.node
    try:
        category = library.category(node)
        if category in FLAKES:
            return Bent(flakes=_flakes(host, evaluator, graph, span))
        if category == "bump":
            return _of_heights(host, evaluator, node, evaluator.scalar(node, "scale", 1.0), span)
        if category == "normalmap":
            port = evaluator.port(node, "in")
            scale = evaluator.input(node, "scale", 2, 1.0)
            numbers = [evaluator.builder.number(name) for name in scale]
            if port is not None and port.source is not None and library.category(port.source) == "heighttonormal":
                factor = evaluator.builder.multiply(evaluator.scalar(port.source, "scale", 1.0), scale[0])
                return _of_heights(host, evaluator, port.source, factor, span, "in")
            if None in numbers:
                host.tell(f"the scale of {node.definition} is drawn only as a number: 1 is drawn", node.place)
                numbers = [1.0, 1.0]
            texels = [evaluator.builder.offset(evaluator.builder.scale(name, 2.0), -1.0) for name in evaluator.input(node, "in", 3)]
            strength = float(numbers[0] or 0.0), float(numbers[1] or 0.0)
            return Bent(normal=_texture(host, graph, evaluator.builder, texels, span), strength=strength)
        raise NotDrawn(f"a normal by {node.definition} is not drawn")
    except (NotDrawn, TooLarge) as reason:
        host.tell(f"{reason}: the surface's own normal is drawn", node.place)
        return Bent()


def _flakes(host: FileHost, evaluator: Evaluator, graph: Graph, span: Span) -> dict[ir.Slot, Input]:
    """Flakes of the base: cells of a lattice with sides of `size`, tilts of GGX by `roughness`, and the share of cells that have one."""
    node, place = graph.node, evaluator.input(graph.node, "position", 3)
    if library.category(node) == "flake2d":
        host.tell("the flakes of a flake2d lie in the frame of the object: its size counts in units of that, not of u and v", node.place)
    elif place != (X, Y, Z):
        host.tell(f"the flakes of {node.definition} lie in the frame of the object: its input `position` is not drawn", node.place)
    size = evaluator.fixed(node, "size", 0.01)
    if not size > 0.0:
        host.tell(f"the flakes of {node.definition} have no size: they are not drawn", node.place)
        return {}
    slots = {ir.Slot.FLAKE_SIZE: Input.number(size)}
    for slot, name in ((ir.Slot.FLAKE_TILT, "roughness"), (ir.Slot.FLAKE_COVERAGE, "coverage")):
        value = evaluator.scalar(node, name)
        number = evaluator.builder.number(value)
        if number is None:
            slots[slot] = Input.number(1.0, _texture(host, graph, evaluator.builder, [value], span))
        else:
            slots[slot] = Input.number(min(max(number, 0.0), 1.0))
    return slots


def _of_heights(host: FileHost, evaluator: Evaluator, node: Node, scale: int, span: Span, name: str = "height") -> Bent:
    """A normal map by differences of heights along u and v; heights in metres where these depend on the position."""
    b = evaluator.builder
    height = b.multiply(evaluator.scalar(node, name), b.scale(scale, _BUMP_SCALE))
    if b.reads(height, (X, Y, Z, NORMAL_X, NORMAL_Y, NORMAL_Z)) or not b.reads(height, (U, V)):
        graph = Graph(node, "out", "float")
        return Bent(bump=_texture(host, graph, b, [height], span))
    slopes = []
    for stream in (U, V):
        ends = [b.replayed(height, {stream: b.offset(stream, step)}) for step in (0.5 * _STEP, -0.5 * _STEP)]
        slopes.append(b.scale(b.subtract(*ends), -1.0 / _STEP))
    size = b.op(Op.SQRT, b.offset(b.add(b.multiply(slopes[0], slopes[0]), b.multiply(slopes[1], slopes[1])), 1.0))
    normal = [b.divide(slope, size) for slope in slopes] + [b.divide(b.constant(1.0), size)]
    return Bent(normal=_texture(host, Graph(node, "out", "vector3"), b, normal, span))
