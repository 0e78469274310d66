"""Arithmetic of tapes on LLVM vectors, for compiler/formula/point_semantics.py and interval_semantics.py."""

from __future__ import annotations

from typing import Any, NamedTuple

from llvmlite import ir

from ...compiler.formula.point_semantics import NumpyMath
from ...lang.noise import PERMUTATION
from ..lanes import crosslane
from ..simd import elementary
from ..simd.llvm_expr import F32, F64, I32, I64, Value, select
from ..simd.polynomials import shared, whole

LANES = crosslane.WIDTH
BYTES = 8 * LANES  # of a vector
POINTER = ir.IntType(8).as_pointer()
WAYS = 8  # word of the state
ROW = 8  # int32 numbers of an instruction
INTERPRETER = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER, POINTER, I64])
"""code, rows, registers, constants, state, vectors side by side"""
DIRECT = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER])  # code, rows, constants, registers; see direct.py
CODE = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER])  # of a compiled tape: x y z, constants, out
ROWS = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, I64])  # the same of many vectors: all x, all y, all z; how many


class Form(NamedTuple):
    """What numbers a program works on."""

    bits: int
    lanes: int

    @property
    def bytes(self) -> int:
        """Of a vector."""
        return self.bits // 8 * self.lanes

    @property
    def vector(self) -> Any:
        return ir.VectorType(F64 if self.bits == 64 else F32, self.lanes)


DOUBLE, SINGLE = Form(64, LANES), Form(32, 16)


class VectorMath:
    """A mathematics on vectors. `state` is where intervals note what they are unsure of, of the `number`th vector; see interpreter.py.
    One that forks (enclosures.one_side) has, from word WAYS of the state on, a vector of numbers whose digits say which ways to go."""

    def __init__(self, builder: Any, state: Any = None, form: Form = DOUBLE, number: Any = None, forks: bool = False) -> None:
        self.builder, self.state, self.form, self.number, self.forks = builder, state, form, number, forks
        self.tells = True  # that something is unbounded
        self.result: list[Value] = []  # bounds that the tape's result is known to have, for operations that may be asked about them
        single = form.bits == 32
        if single:  # where products are too small for it they are not for the points in float64 that it stands for
            self.unit, self.tiny, self.big, self.most, self.lost = 2.0**-23, 1e-36, 1e18, 1e18, True
            self.squares = (2.0**-40, 2.0**70), (2.0**62, 2.0**-70)
        else:
            self.unit, self.tiny, self.big, self.most, self.lost = NumpyMath.unit, NumpyMath.tiny, NumpyMath.big, NumpyMath.most, False
            self.squares = NumpyMath.squares

    def __getattr__(self, name: str) -> Any:
        if name in ("sqrt", "floor", "ceil"):
            return lambda x: x.call(name)
        return elementary.EMITTED[name]

    def where(self, mask: Value, yes: Any, no: Any) -> Value:
        like = yes if isinstance(yes, Value) else no
        if not isinstance(like, Value):
            like = self.everywhere(0.0)
        return select(mask, *(v if isinstance(v, Value) else like.constant(v) for v in (yes, no)))

    def least(self, a: Any, b: Value) -> Value:
        return self.where(a < b, a, b)

    def largest(self, a: Value, b: Value) -> Value:
        return self.where(a > b, a, b)

    def clipped(self, x: Value, low: float, high: float) -> Value:
        x = self.where(x < low, low, x)
        return self.where(x > high, high, x)

    def everywhere(self, number: float) -> Value:
        """A number in every lane."""
        return Value(self.builder, ir.Constant(self.form.vector, [number] * self.form.lanes), "f", self.form.bits)

    # --- what is not certain ---

    def undefined(self, mask: Value) -> None:
        place = self._noted(0)
        self.builder.store(self.builder.or_(self.builder.load(place), self._bits(mask)), place)

    def unbounded(self, mask: Value) -> None:
        """float32 does not reach so far that no sum brings a bound back: such lanes count as undefined."""
        if self.form.bits == 32:
            self.undefined(mask)

    def was_undefined(self, like: Value) -> Value:
        b, lanes = self.builder, self.form.lanes
        few = b.load(self._noted(0))
        few = few if few.type.width == lanes else b.trunc(few, ir.IntType(lanes))
        return Value(b, b.bitcast(few, ir.VectorType(ir.IntType(1), lanes)), "m", self.form.bits)

    def note(self, place: Any, mask: Value) -> None:
        """Keep a mask as a word of the state."""
        self.builder.store(self._bits(mask), self._noted(place))

    def _bits(self, mask: Value) -> Any:
        b, lanes = self.builder, self.form.lanes
        few = b.bitcast(mask.raw, ir.IntType(lanes))
        return few if self.number is not None or lanes == 64 else b.zext(few, I64)

    def _noted(self, place: Any) -> Any:
        """Where a word stands, or, with vectors side by side, the part of it for this vector."""
        b = self.builder
        at = b.gep(b.bitcast(self.state, I64.as_pointer()), [ir.Constant(I64, place) if isinstance(place, int) else place])
        if self.number is None:
            return at
        return b.gep(b.bitcast(at, ir.IntType(self.form.lanes).as_pointer()), [self.number])

    def fork(self, mask: Value) -> Value:
        """As NumpyMath.fork."""
        rest = load(self.builder, self.state, 8 * WAYS)
        left = rest >= 2.0
        self.undefined(mask & ~left)
        half = (rest * 0.5).call("floor")
        store(self.builder, self.state, 8 * WAYS, self.where(mask & left, half, rest))
        return mask & (rest - half * 2.0 > 0.0)

    # --- noise ---

    def index(self, x: Value) -> Value:
        inside = abs(x) < (2.0**50 if x.bits == 64 else 2.0**30)
        kept = select(inside, x, x.constant(0.0))
        return whole(kept) & 255

    def permuted(self, index: Value) -> Value:
        return shared("permuted", _permuted, index & 255)

    def bit(self, index: Value, bits: int) -> Value:
        return (index & bits) != 0


def _permuted(index: Value) -> Value:
    """Perlin's table, lane by lane."""
    b = index.builder
    element = index.raw.type.element
    name = f"maquette.permutation{index.bits}"
    if name not in b.module.globals:
        kind = ir.ArrayType(element, len(PERMUTATION))
        table = ir.GlobalVariable(b.module, kind, name)
        table.linkage, table.global_constant = "internal", True
        table.initializer = ir.Constant(kind, list(PERMUTATION))  # pyright: ignore[reportAttributeAccessIssue]
    table = b.module.globals[name]
    raw: Any = ir.Constant(index.raw.type, ir.Undefined)
    for k in range(index.lanes):
        lane = ir.Constant(I32, k)
        place = b.gep(table, [ir.Constant(element, 0), b.extract_element(index.raw, lane)])
        raw = b.insert_element(raw, b.load(place), lane)
    return index.like(raw)


def load(builder: Any, base: Any, offset: Any, form: Form = DOUBLE) -> Value:
    """A vector at a byte's place."""
    loaded = builder.load(builder.bitcast(_at(builder, base, offset), form.vector.as_pointer()), align=8)
    return Value(builder, loaded, "f", form.bits)


def store(builder: Any, base: Any, offset: Any, value: Value) -> None:
    builder.store(value.raw, builder.bitcast(_at(builder, base, offset), value.raw.type.as_pointer()), align=8)


def _at(builder: Any, base: Any, offset: Any) -> Any:
    return builder.gep(base, [ir.Constant(I64, offset) if isinstance(offset, int) else offset])
