"""Tapes of patterns as graphs of MaterialX' nodes, over the position and the normal in the frame of the object, and its coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ... import ir
from ...formula.opcodes import Op
from ...formula.tape import INPUTS, Tape, load_tape
from ...texture_graph.opcodes import CHANNELS, NORMAL_X, STREAMS, U, arity
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
    **dict.fromkeys((GraphOp.PERLIN2_R, GraphOp.PERLIN2_G, GraphOp.PERLIN2_B), ("noise2d", 2)),
    **dict.fromkeys((GraphOp.PERLIN3_R, GraphOp.PERLIN3_G, GraphOp.PERLIN3_B), ("noise3d", 3)),
}  # fmt: skip
_CHANNELS = {op: (op - GraphOp.PERLIN2) % 4 - 1 for op in _NOISES if op <= GraphOp.PERLIN3_B}  # of a noise of three numbers, or −1
Value = Any  # a number, or the output of a node


def is_graph(tables: ir.Tables, texture: int) -> bool:
    """Whether a texture is a tape that nodes of MaterialX say: without our own noise, and without alpha of pictures."""
    if texture < 0 or tables.textures.kind[texture] != ir.TextureKind.FORMULA:
        return False
    tape = load_tape(tables, int(tables.textures.tape[texture]))
    code = tape.code.tolist()
    if not 0 <= len(code) <= MOST or not {op for op, *_ in code} <= {*_BINARY, *_UNARY, *_OWN, *_NOISES, GraphOp.LOOK_UP, GraphOp.CHANNEL}:
        return False
    names = {name for op, *operands in code for name in operands[: arity(op)]} | {*tape.results}
    alphas = {INPUTS + row + CHANNELS - 1 for row, (op, *_) in enumerate(code) if op == GraphOp.LOOK_UP}
    return not names & alphas


class GraphWriter:
    """Writes the graphs of one material. `image` is the output of a picture (a row of Textures) at the output of its coordinates."""

    def __init__(self, tables: ir.Tables, nodes: Nodes, sets: TextureSets, image: Callable[[int, Value], Value]) -> None:
        self.tables, self.nodes, self._sets, self._image = tables, nodes, sets, image
        self._coordinates = "st"

    def write(self, texture: int, kind: str, gain: Sequence[float]) -> Value:
        """The output of the graph of a texture times `gain`, as a "color3" or a "float"."""
        textures = self.tables.textures
        tape = load_tape(self.tables, int(textures.tape[texture]))
        code, results, constants = tape.code.tolist(), tape.results, tape.constants.tolist()
        if any(name in (U, U + 1) for name in [*results, *(name for op, *operands in code for name in operands[: arity(op)])]):
            number = self._sets.add(texture)
            self._coordinates = f"st{number}" if number else "st"
        values = self._values(tape)
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

    def _values(self, tape: Tape) -> list[Value]:
        """The value of each row of a tape."""
        values: list[Value] = []
        constants = tape.constants.tolist()
        for op, *names in tape.code.tolist():
            if op == GraphOp.LOOK_UP:
                s, t = (("float", self._operand(name, values, constants)) for name in names[:2])
                place = self.nodes.add("place", "ND_combine2_vector2", "vector2", in1=s, in2=t)
                color = self._image(int(constants[~names[2]]), place)
                values += [self._extracted("color3", color, k) for k in range(3)] + [1.0]
            elif op != GraphOp.CHANNEL:
                values.append(self._operation(op, [self._operand(name, values, constants) for name in names[: arity(op)]]))
        return values

    def _extracted(self, kind: str, value: Value, index: int) -> Value:
        return self.nodes.add("channel", f"ND_extract_{kind}", "float", **{"in": (kind, value), "index": ("integer", index)})

    def _levelled(self, value: Value, gain: float, bias: float) -> Value:
        value = value if gain == 1.0 else self._binary("multiply", value, gain)
        return value if bias == 0.0 else self._binary("add", value, bias)

    def _operand(self, name: int, values: list[Value], constants: list[float]) -> Value:
        if name < 0:
            return constants[~name]
        if name in (U, U + 1):
            place = self.nodes.add("uv", "ND_geompropvalue_vector2", "vector2", geomprop=("string", self._coordinates))
            return self._extracted("vector2", place, name - U)
        if name in STREAMS or name < INPUTS:
            stream, first = ("position", 0) if name < INPUTS else ("normal", NORMAL_X)
            vector = self.nodes.add(stream, f"ND_{stream}_vector3", "vector3", space=("string", "object"))
            return self._extracted("vector3", vector, name - first)
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
        (name, width), channel = _NOISES[GraphOp(op)], _CHANNELS.get(GraphOp(op), -1)
        labels = dict(zip(("in1", "in2", "in3"), (("float", each) for each in operands), strict=False))
        place = self.nodes.add("place", f"ND_combine{width}_vector{width}", f"vector{width}", **labels)
        port = {"texcoord" if width == 2 else "position": (f"vector{width}", place)}
        if channel < 0:
            return self.nodes.add(name, f"ND_{name}_float", "float", **port)
        return self._extracted("vector3", self.nodes.add(name, f"ND_{name}_vector3", "vector3", **port), channel)
