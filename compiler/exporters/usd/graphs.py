"""Tapes of patterns as graphs of MaterialX' nodes, over the position in the frame of the object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ... import ir
from ...formula.opcodes import Op
from ...formula.tape import INPUTS
from ...texture_graph.opcodes import NORMAL_X, NORMAL_Z, STREAMS, U, arity
from ...texture_graph.opcodes import Op as GraphOp
from ..texture_sets import TextureSets
from .nodes import Nodes

MOST = 600  # operations of a graph
_BINARY = {
    Op.ADD: "add", Op.SUBTRACT: "subtract", Op.MULTIPLY: "multiply", Op.DIVIDE: "divide", Op.MIN: "min", Op.MAX: "max", Op.MOD: "modulo",
    Op.POWER: "power",
}  # fmt: skip
_UNARY = {
    Op.ABS: "absval", Op.SQRT: "sqrt", Op.EXP: "exp", Op.LOG: "ln", Op.SIN: "sin", Op.COS: "cos", Op.TAN: "tan", Op.ASIN: "asin",
    Op.ACOS: "acos", Op.FLOOR: "floor", Op.CEIL: "ceil", Op.SIGN: "sign",
}  # fmt: skip
_OWN = {Op.COPY, Op.NEGATE, Op.SQUARE, Op.CUBE, Op.HYPOT, Op.CHOOSE, Op.ATAN, Op.ATAN2, Op.ANGLE}
_NOISES = {
    GraphOp.PERLIN2: ("noise2d", 2), GraphOp.PERLIN3: ("noise3d", 3), GraphOp.CELL2: ("cellnoise2d", 2), GraphOp.CELL3: ("cellnoise3d", 3),
}  # fmt: skip
Value = Any  # a number, or the output of a node


def _rows(tables: ir.Tables, tape: int) -> tuple[np.ndarray, list[float], list[int]]:
    t, first, start = tables.tapes, int(tables.tapes.first[tape]), int(tables.tapes.first_constant[tape])
    code = np.asarray(tables.pools.code[first : first + int(t.count[tape])])
    constants = tables.pools.constants[start : start + int(t.constant_count[tape])].tolist()
    return code, constants, t.results[tape, : int(t.result_count[tape])].tolist()


def is_graph(tables: ir.Tables, texture: int) -> bool:
    """Whether a texture is a tape that nodes of MaterialX say: without our own noise, pictures and normals."""
    if texture < 0 or tables.textures.kind[texture] != ir.TextureKind.FORMULA:
        return False
    code, _, results = _rows(tables, int(tables.textures.tape[texture]))
    if not 0 <= len(code) <= MOST or not set(code[:, 0].tolist()) <= {*_BINARY, *_UNARY, *_OWN, *_NOISES}:
        return False
    names = [*results, *(name for op, *operands in code.tolist() for name in operands[: arity(op)])]
    return not any(NORMAL_X <= name <= NORMAL_Z for name in names)


class GraphWriter:
    """Writes the graphs of one material."""

    def __init__(self, tables: ir.Tables, nodes: Nodes, sets: TextureSets) -> None:
        self.tables, self.nodes, self._sets = tables, nodes, sets
        self._coordinates = "st"

    def write(self, texture: int, kind: str, gain: Sequence[float]) -> Value:
        """The output of the graph of a texture times `gain`, as a "color3" or a "float"."""
        textures = self.tables.textures
        code, constants, results = _rows(self.tables, int(textures.tape[texture]))
        if any(name in STREAMS for name in [*results, *code[:, 1:].ravel().tolist()]):
            number = self._sets.add(texture)
            self._coordinates = f"st{number}" if number else "st"
        values: list[Value] = []
        for op, *operands in code.tolist():
            values.append(self._operation(op, [self._operand(name, values, constants) for name in operands[: arity(op)]]))
        channels = [self._operand(name, values, constants) for name in results]
        levels = [textures.gain[texture] * gain, textures.bias[texture] * gain]
        width = 3 if kind == "color3" else 1
        channels = [self._levelled(channels[k % len(channels)], float(levels[0][k]), float(levels[1][k])) for k in range(width)]
        if kind == "float":
            return channels[0]
        if len(results) == 1 and len(set(levels[0].tolist())) == len(set(levels[1].tolist())) == 1:
            return self.nodes.add("grey", "ND_convert_float_color3", "color3", **{"in": ("float", channels[0])})
        labels = dict(zip(("in1", "in2", "in3"), (("float", channel) for channel in channels), strict=True))
        return self.nodes.add("color", "ND_combine3_color3", "color3", **labels)

    def _levelled(self, value: Value, gain: float, bias: float) -> Value:
        value = value if gain == 1.0 else self._binary("multiply", value, gain)
        return value if bias == 0.0 else self._binary("add", value, bias)

    def _operand(self, name: int, values: list[Value], constants: list[float]) -> Value:
        if name < 0:
            return constants[~name]
        if name in STREAMS:
            place = self.nodes.add("uv", "ND_geompropvalue_vector2", "vector2", geomprop=("string", self._coordinates))
            return self.nodes.add("coordinate", "ND_extract_vector2", "float", **{"in": ("vector2", place), "index": ("integer", name - U)})
        if name < INPUTS:
            place = self.nodes.add("position", "ND_position_vector3", "vector3", space=("string", "object"))
            return self.nodes.add("coordinate", "ND_extract_vector3", "float", **{"in": ("vector3", place), "index": ("integer", name)})
        return values[name - INPUTS]

    def _binary(self, name: str, a: Value, b: Value) -> Value:
        return self.nodes.add(name, f"ND_{name}_float", "float", in1=("float", a), in2=("float", b))

    def _unary(self, name: str, a: Value) -> Value:
        return self.nodes.add(name, f"ND_{name}_float", "float", **{"in": ("float", a)})

    def _operation(self, op: int, operands: list[Value]) -> Value:
        if op in _BINARY:
            return self._binary(_BINARY[Op(op)], operands[0], operands[1])
        if op in _UNARY:
            return self._unary(_UNARY[Op(op)], operands[0])
        if op in _NOISES:
            return self._noise(op, operands)
        a = operands[0]
        if op == Op.COPY:
            return a
        if op == Op.NEGATE:
            return self._binary("multiply", a, -1.0)
        if op in (Op.SQUARE, Op.CUBE):
            square = self._binary("multiply", a, a)
            return square if op == Op.SQUARE else self._binary("multiply", square, a)
        if op == Op.HYPOT:
            squares = [self._binary("multiply", each, each) for each in operands]
            return self._unary("sqrt", self._binary("add", *squares))
        if op == Op.CHOOSE:
            labels = {"value1": ("float", a), "value2": ("float", 0.0), "in1": ("float", operands[2]), "in2": ("float", operands[1])}
            return self.nodes.add("choose", "ND_ifgreater_float", "float", **labels)
        over = 1.0 if op == Op.ATAN else operands[1]
        return self.nodes.add("atan2", "ND_atan2_float", "float", iny=("float", a), inx=("float", over))

    def _noise(self, op: int, operands: list[Value]) -> Value:
        name, width = _NOISES[GraphOp(op)]
        labels = dict(zip(("in1", "in2", "in3"), (("float", each) for each in operands), strict=False))
        place = self.nodes.add("place", f"ND_combine{width}_vector{width}", f"vector{width}", **labels)
        port = {"texcoord" if width == 2 else "position": (f"vector{width}", place)}
        return self.nodes.add(name, f"ND_{name}_float", "float", **port)
