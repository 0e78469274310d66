"""Translates formulas with texture coordinates, normals, pictures or MaterialX's noise to tapes of texture graphs."""

from __future__ import annotations

from collections.abc import Sequence

from ...lang.formula_graph import CHANNELS, PATTERN_OPERATIONS, Formula, Node
from ..formula.from_formula import NodeTranslator
from ..formula.opcodes import Op
from .graph_builder import GraphBuilder
from .opcodes import Op as GraphOp

Texel = tuple[int, int, int, int]
_PERLIN = {
    2: {"perlin": GraphOp.PERLIN2, "perlin_r": GraphOp.PERLIN2_R, "perlin_g": GraphOp.PERLIN2_G, "perlin_b": GraphOp.PERLIN2_B},
    3: {"perlin": GraphOp.PERLIN3, "perlin_r": GraphOp.PERLIN3_R, "perlin_g": GraphOp.PERLIN3_G, "perlin_b": GraphOp.PERLIN3_B},
}
_CELLS = {1: GraphOp.CELL1, 2: GraphOp.CELL2, 3: GraphOp.CELL3}
_CELL_CHANNELS = {"cellnoise_r": GraphOp.CELL4_0, "cellnoise_g": GraphOp.CELL4_1, "cellnoise_b": GraphOp.CELL4_2}


def needs_graph(formula: Formula) -> bool:
    """Whether a pattern reads more than the point, or has an operation of texture graphs alone."""
    return len(formula.parameters) != 3 or any(node.op in PATTERN_OPERATIONS for node in formula.nodes)


class PictureRow:
    """A picture of a formula: the row of its image texture, the frame of its coordinates, and the levels of its channels."""

    def __init__(self, row: int, frame: Sequence[Sequence[float]], gain: Sequence[float], bias: Sequence[float]) -> None:
        self.row, self.frame = row, frame
        self.gain, self.bias = (*gain, 1.0), (*bias, 0.0)  # alpha stays

    def texel(self, b: GraphBuilder, u: int, v: int) -> Texel:
        """Red, green, blue and alpha at u and v."""
        s, t = (b.linear([(line[0], u), (line[1], v)], line[2]) for line in self.frame)
        channels = b.look_up(self.row, s, t)
        r, g, b_, a = (b.offset(b.scale(c, gain), bias) for c, gain, bias in zip(channels, self.gain, self.bias, strict=True))
        return r, g, b_, a


class GraphTranslator(NodeTranslator):
    """Translates a formula whose truth values are conditions at points."""

    builder: GraphBuilder

    def __init__(self, builder: GraphBuilder, formula: Formula, inputs: Sequence[int], pictures: Sequence[PictureRow]) -> None:
        self.builder, self.pictures = builder, pictures
        super().__init__(formula, inputs)

    def results(self) -> tuple[int, ...]:
        """The numbers of a formula; a truth value is 1 or 0."""
        if self.formula.kind != "truth":
            return tuple(self.number(i) for i in self.formula.results)
        b, (index,) = self.builder, self.formula.results
        return (b.op(Op.CHOOSE, self.field(index, exact=True), b.constant(1.0), b.constant(0.0)),)

    def of_pattern(self, node: Node, names: Sequence[int]) -> int:
        if node.op in CHANNELS:
            u, v = names
            return self.pictures[int(node.value)].texel(self.builder, u, v)[CHANNELS.index(node.op)]
        if node.op in _CELL_CHANNELS:
            return self.builder.op(_CELL_CHANNELS[node.op], *names)
        return self.builder.op(_CELLS[len(names)] if node.op == "cellnoise" else _PERLIN[len(names)][node.op], *names)

    def quotient(self, a: int, b: int) -> int:
        return self.builder.divide(a, b)

    def remainder(self, a: int, b: int) -> int:
        return self.builder.op(Op.MOD, a, b)

    def inequality(self, node: Node, relation: str, exact: bool) -> int:
        b = self.builder
        first, second = (self.number(i) for i in node.args)
        if relation in ("greater", "at_least"):
            first, second = second, first
        if relation in ("at_most", "at_least"):
            return b.subtract(first, second)
        return b.at_most(second, first, b.constant(1.0), b.constant(-1.0))

    def equality(self, node: Node, equal: bool, exact: bool) -> int:
        b = self.builder
        distance = b.op(Op.ABS, b.subtract(*(self.number(i) for i in node.args)))
        return distance if equal else b.op(Op.CHOOSE, distance, b.constant(1.0), b.constant(-1.0))
