"""The arithmetic of tapes on LLVM vectors: what compiler/tape_points.py and compiler/enclosures.py are emitted with."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from ...lang.noise import PERMUTATION
from .. import across
from ..simd import mathematics
from ..simd.precise import shared, whole
from ..simd.value import F64, I32, I64, Value, select

LANES = across.WIDTH
BYTES = 8 * LANES  # of a vector
VECTOR: Any = ir.VectorType(F64, LANES)
POINTER = ir.IntType(8).as_pointer()
ROW = 8  # int32 numbers of an instruction
INTERPRETER = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER, POINTER])  # code, rows, registers, constants, state
DIRECT = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER])  # code, rows, constants, registers; see direct.py
CODE = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER])  # of a compiled tape: x y z, constants, out


class VectorMath:
    """A mathematics on float64 vectors. `state` is where intervals note what they are unsure of; see interpreter.py."""

    unit, tiny, big = 2.0**-52, 1e-300, 1e100

    def __init__(self, builder: Any, state: Any = None) -> None:
        self.builder, self.state = builder, state

    def __getattr__(self, name: str) -> Any:
        if name in ("sqrt", "floor", "ceil"):
            return lambda x: x.call(name)
        return mathematics.EMITTED[name]

    def where(self, mask: Value, yes: Any, no: Any) -> Value:
        like = yes if isinstance(yes, Value) else no
        if not isinstance(like, Value):
            like = self.everywhere(0.0)
        return select(mask, *(v if isinstance(v, Value) else like.constant(v) for v in (yes, no)))

    def everywhere(self, number: float) -> Value:
        """A number in every lane."""
        return Value(self.builder, ir.Constant(VECTOR, [number] * LANES), "f", 64)

    # --- what is not certain ---

    def undefined(self, mask: Value) -> None:
        b, place = self.builder, word(self.builder, self.state, 0)
        b.store(b.or_(b.load(place), bits_of(mask)), place)

    def was_undefined(self, like: Value) -> Value:
        b = self.builder
        few = b.trunc(b.load(word(b, self.state, 0)), ir.IntType(LANES))
        return Value(b, b.bitcast(few, ir.VectorType(ir.IntType(1), LANES)), "m", 64)

    # --- noise ---

    def index(self, x: Value) -> Value:
        inside = abs(x) < 2.0**50
        kept = select(inside, x, x.constant(0.0))
        return whole(kept) & 255

    def permuted(self, index: Value) -> Value:
        return shared("permuted", _permuted, index & 255)

    def bit(self, index: Value, bits: int) -> Value:
        return (index & bits) != 0


def _permuted(index: Value) -> Value:
    """Perlin's table, lane by lane."""
    b = index.builder
    name = "maquette.permutation"
    if name not in b.module.globals:
        kind = ir.ArrayType(I64, len(PERMUTATION))
        table = ir.GlobalVariable(b.module, kind, name)
        table.linkage, table.global_constant = "internal", True
        table.initializer = ir.Constant(kind, list(PERMUTATION))  # pyright: ignore[reportAttributeAccessIssue]
    table = b.module.globals[name]
    raw: Any = ir.Constant(index.raw.type, ir.Undefined)
    for k in range(LANES):
        lane = ir.Constant(I32, k)
        place = b.gep(table, [ir.Constant(I64, 0), b.extract_element(index.raw, lane)])
        raw = b.insert_element(raw, b.load(place), lane)
    return index.like(raw)


def bits_of(mask: Value) -> Any:
    """A mask as an int64."""
    return mask.builder.zext(mask.builder.bitcast(mask.raw, ir.IntType(LANES)), I64) if LANES < 64 else mask.raw


def word(builder: Any, base: Any, index: Any) -> Any:
    """A pointer to an int64 behind a pointer."""
    place = index if not isinstance(index, int) else ir.Constant(I64, index)
    return builder.gep(builder.bitcast(base, I64.as_pointer()), [place])


def load(builder: Any, base: Any, offset: Any) -> Value:
    """A vector at a byte's place."""
    loaded = builder.load(builder.bitcast(_at(builder, base, offset), VECTOR.as_pointer()), align=8)
    return Value(builder, loaded, "f", 64)


def store(builder: Any, base: Any, offset: Any, value: Value) -> None:
    builder.store(value.raw, builder.bitcast(_at(builder, base, offset), VECTOR.as_pointer()), align=8)


def _at(builder: Any, base: Any, offset: Any) -> Any:
    return builder.gep(base, [ir.Constant(I64, offset) if isinstance(offset, int) else offset])
