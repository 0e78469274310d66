"""Numeric backend on LLVM vectors for compiler/formula/point_semantics.py and interval_semantics.py."""

from __future__ import annotations

from typing import Any, NamedTuple

from llvmlite import ir

from ...compiler.formula.point_semantics import NumpyMath
from ...lang.noise import PERMUTATION
from ..lanes import crosslane
from ..simd.emitters import EMITTED
from ..simd.llvm_expr import F32, F64, I32, I64, Value, select
from ..simd.polynomials import call_shared, to_integer

LANES = crosslane.WIDTH
BYTES = 8 * LANES  # of a vector
POINTER = ir.IntType(8).as_pointer()
BRANCH_WORD = 8  # first word of the state that holds branch numbers
ROW = 8  # int32 numbers of an instruction
INTERPRETER = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER, POINTER, I64])
"""Arguments: code, rows, registers, constants, state, number of vectors."""
DIRECT = ir.FunctionType(ir.VoidType(), [POINTER, I64, POINTER, POINTER])  # code, rows, constants, registers; see interpreter.py
CODE = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER])  # of a compiled tape: x y z, constants, out
ROWS = ir.FunctionType(ir.VoidType(), [POINTER, POINTER, POINTER, I64])  # of many vectors: all x, y and z, constants, out, their number


class Form(NamedTuple):
    """Number format of a program."""

    bits: int
    lanes: int

    @property
    def bytes(self) -> int:
        """Size of a vector."""
        return self.bits // 8 * self.lanes

    @property
    def vector(self) -> Any:
        return ir.VectorType(F64 if self.bits == 64 else F32, self.lanes)


DOUBLE, SINGLE = Form(64, LANES), Form(32, 16)


class VectorMath:
    """Arithmetic on vectors, with the interface of NumpyMath.

    Intervals record undefined lanes of the `number`th vector in `state`; see interpreter.py. With `forks`, the state holds a vector of
    branch numbers from word BRANCH_WORD on: their binary digits select the branches of jumps (interval_arithmetic.one_side).
    """

    def __init__(self, builder: Any, state: Any = None, form: Form = DOUBLE, number: Any = None, forks: bool = False) -> None:
        self.builder, self.state, self.form, self.number, self.forks = builder, state, form, number, forks
        self.tells = True  # that a value is unbounded
        self.result: list[Value] = []  # known bounds of the tape's result, for operations that use them
        single = form.bits == 32
        if single:  # products that underflow in float32 do not in the float64 points that it bounds
            self.unit, self.tiny, self.big, self.most, self.lost = 2.0**-23, 1e-36, 1e18, 1e18, True
            self.squares = (2.0**-40, 2.0**70), (2.0**62, 2.0**-70)
        else:
            self.unit, self.tiny, self.big, self.most, self.lost = NumpyMath.unit, NumpyMath.tiny, NumpyMath.big, NumpyMath.most, False
            self.squares = NumpyMath.squares

    def __getattr__(self, name: str) -> Any:
        if name in ("sqrt", "floor", "ceil"):
            return lambda x: x.call(name)
        return EMITTED[name]

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
        """Broadcast a number."""
        return Value(self.builder, ir.Constant(self.form.vector, [number] * self.form.lanes), "f", self.form.bits)

    # --- undefined and unbounded values ---

    def undefined(self, mask: Value) -> None:
        """Record the lanes of a mask as undefined."""
        place = self._state_word(0)
        self.builder.store(self.builder.or_(self.builder.load(place), self._bits(mask)), place)

    def unbounded(self, mask: Value) -> None:
        """Record the lanes of a mask as undefined in float32: its range does not keep later sums from making a bound finite."""
        if self.form.bits == 32:
            self.undefined(mask)

    def was_undefined(self, like: Value) -> Value:
        b, lanes = self.builder, self.form.lanes
        few = b.load(self._state_word(0))
        few = few if few.type.width == lanes else b.trunc(few, ir.IntType(lanes))
        return Value(b, b.bitcast(few, ir.VectorType(ir.IntType(1), lanes)), "m", self.form.bits)

    def note(self, place: Any, mask: Value) -> None:
        """Store a mask to a word of the state."""
        self.builder.store(self._bits(mask), self._state_word(place))

    def _bits(self, mask: Value) -> Any:
        b, lanes = self.builder, self.form.lanes
        few = b.bitcast(mask.raw, ir.IntType(lanes))
        return few if self.number is not None or lanes == 64 else b.zext(few, I64)

    def _state_word(self, place: Any) -> Any:
        """Address of a word of the state, or of this vector's part of it."""
        b = self.builder
        address = b.gep(b.bitcast(self.state, I64.as_pointer()), [ir.Constant(I64, place) if isinstance(place, int) else place])
        if self.number is None:
            return address
        return b.gep(b.bitcast(address, ir.IntType(self.form.lanes).as_pointer()), [self.number])

    def fork(self, mask: Value) -> Value:
        """Take the next binary digit of the branch numbers, as NumpyMath.fork."""
        digits = load(self.builder, self.state, 8 * BRANCH_WORD)
        has_digit = digits >= 2.0
        self.undefined(mask & ~has_digit)
        half = (digits * 0.5).call("floor")
        store(self.builder, self.state, 8 * BRANCH_WORD, self.where(mask & has_digit, half, digits))
        return mask & (digits - half * 2.0 > 0.0)

    # --- noise ---

    def index(self, x: Value) -> Value:
        inside = abs(x) < (2.0**50 if x.bits == 64 else 2.0**30)
        bounded = select(inside, x, x.constant(0.0))
        return to_integer(bounded) & 255

    def permuted(self, index: Value) -> Value:
        return call_shared("permuted", _look_up_permutation, index & 255)

    def bit(self, index: Value, bits: int) -> Value:
        return (index & bits) != 0


def _look_up_permutation(index: Value) -> Value:
    """Look up Perlin's permutation table, lane by lane."""
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
    """Load a vector at an offset in bytes."""
    loaded = builder.load(builder.bitcast(_at(builder, base, offset), form.vector.as_pointer()), align=8)
    return Value(builder, loaded, "f", form.bits)


def store(builder: Any, base: Any, offset: Any, value: Value) -> None:
    """Store a vector at an offset in bytes."""
    builder.store(value.raw, builder.bitcast(_at(builder, base, offset), value.raw.type.as_pointer()), align=8)


def _at(builder: Any, base: Any, offset: Any) -> Any:
    return builder.gep(base, [ir.Constant(I64, offset) if isinstance(offset, int) else offset])
