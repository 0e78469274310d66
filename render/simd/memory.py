"""Vectors and arrays: load and store, gather and scatter, compress, rows of records, and scratch memory on the stack.

Places are flat: element `i` of the C-contiguous array's data, whatever its shape. Nothing is checked, but where MAQUETTE_CHECKED asks for
it (guard.py); nothing wraps around. What is stored is converted to the array's type first. Arrays may be of float32, float64, int32, int64,
uint32, uint64, uint8 or bool; uint8 becomes int32 lanes and bool a mask.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature, signature
from numba.np.arrayobj import make_array, populate_array

from .. import machine
from . import guard
from . import value as v
from .arrays import CACHE_LINE
from .functions import CONSTRUCTED, shuffled, transposed
from .value import I1, I8, I32, I64, Value
from .vector import Vector, intrinsic, shape_of, value

# --- elements ------------------------------------------------------------------------------------------------------------


def element_shape(array: Any) -> tuple[str, int] | None:
    """Kind and bits of the lanes an array's elements become; None for arrays that can't be read."""
    if not isinstance(array, types.Array) or array.layout != "C":
        return None
    if array.dtype in (types.uint8, types.boolean):
        return ("i", 32) if array.dtype == types.uint8 else ("m", 32)
    shape = shape_of(array.dtype)
    return (shape[0], shape[1]) if shape and shape[1] >= 32 else None


def _is_small(array: Any) -> bool:
    return array.dtype in (types.uint8, types.boolean)


def stored_type(context: Any, array: Any) -> Any:
    """The LLVM type of an element in memory."""
    return I8 if _is_small(array) else context.get_value_type(array.dtype)


def item_bytes(array: Any) -> int:
    return 1 if _is_small(array) else array.dtype.bitwidth // 8


def from_memory(builder: Any, raw: Any, array: Any) -> Value:
    """Lanes (or one element) as loaded, as the kind they are in kernels."""
    if not _is_small(array):
        return value(builder, raw, array.dtype)
    small = Value(builder, raw, "u", 8)
    return small.to("i", 32) if array.dtype == types.uint8 else (small != 0).of("m", (small != 0).raw, 32)


def to_memory(lanes: Value, array: Any) -> Any:
    """Lanes (or one number) as they are stored."""
    if _is_small(array):
        whole = lanes.to("m", 32).to("u", 8) if array.dtype == types.boolean else lanes.to("i", 32).to("u", 8)
        return whole.raw
    shape = shape_of(array.dtype)
    assert shape is not None
    return lanes.to(shape[0], shape[1]).raw


def place(context: Any, builder: Any, array: Any, raw: Any, index: Any, index_type: types.Type, count: int = 1) -> Any:
    """The address of a flat place, from which on `count` elements are read or written (0: it is not known)."""
    made, at = make_array(array)(context, builder, value=raw), context.cast(builder, index, index_type, types.int64)
    guard.one(builder, made, at, count)
    return builder.gep(made.data, [at])


def as_vector(builder: Any, pointer: Any, element: Any, lanes: int) -> Any:
    return builder.bitcast(pointer, ir.VectorType(element, lanes).as_pointer())


def vector_asked(array: Any, what: types.Type | None) -> Vector | None:
    """The type a load gives: of the lanes or the type asked for, else what fills one of the machine's vectors; None: it can't."""
    shape = element_shape(array)
    if shape is None:
        return None
    if what is None or isinstance(what, types.NoneType):
        return Vector(*shape, machine.WIDTH64 if shape[1] == 64 else machine.WIDTH)
    if isinstance(what, types.IntegerLiteral):
        return Vector(*shape, what.literal_value)
    if isinstance(what, types.Function):
        return CONSTRUCTED.get(what.typing_key)
    raise TypingError("the lanes of a load must be constant: a number, or a type such as simd.f32 (simd.WIDTH is no constant to Numba)")


# --- load and store ------------------------------------------------------------------------------------------------------


def _load(array: Any, index: types.Type, what: types.Type | None, aligned: bool) -> Any:
    result = vector_asked(array, what)
    if result is None or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        element = stored_type(context, array)
        pointer = as_vector(builder, place(context, builder, array, args[0], args[1], index, result.lanes), element, result.lanes)
        size = item_bytes(array)
        loaded = builder.load(pointer, align=size * result.lanes if aligned else size)
        return from_memory(builder, loaded, array).to(result.kind, result.bits).raw

    return signature(result, array, index, what or types.none), generate


@intrinsic(prefer_literal=True)
def load(typingctx, array, i, what=None):
    """Elements i, i+1 … of an array: as many as fill a vector, a constant number of them, or a type's lanes, converted (simd.f32)."""
    return _load(array, i, what, False)


@intrinsic(prefer_literal=True)
def load_aligned(typingctx, array, i, what=None):
    """`load` from an address that is a multiple of the vector's bytes in memory."""
    return _load(array, i, what, True)


@intrinsic(prefer_literal=True)
def load3(typingctx, array, i, what=None):
    """Three vectors from elements i, i+1 …: every third from the first, the second, the third on, as the columns of rows of three."""
    result = vector_asked(array, what)
    if result is None or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        n = result.lanes
        pointer = as_vector(builder, place(context, builder, array, args[0], args[1], i, 3 * n), stored_type(context, array), 3 * n)
        loaded = builder.load(pointer, align=item_bytes(array))
        columns = [shuffled(builder, loaded, loaded, list(range(k, 3 * n, 3))) for k in range(3)]
        parts = [from_memory(builder, column, array).to(result.kind, result.bits).raw for column in columns]
        return context.make_tuple(builder, sig.return_type, parts)

    return signature(types.UniTuple(result, 3), array, i, what or types.none), generate


def _store(array: Any, index: types.Type, x: types.Type, aligned: bool, past: bool = False) -> Any:
    if element_shape(array) is None or not isinstance(x, Vector) or not isinstance(index, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        pointer = place(context, builder, array, args[0], args[1], index, x.lanes)
        size = item_bytes(array)
        stored = builder.store(raw, builder.bitcast(pointer, raw.type.as_pointer()), align=size * x.lanes if aligned else size)
        if past:
            stored.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(ir.IntType(32), 1)]))
        return context.get_dummy_value()

    return signature(types.void, array, index, x), generate


@intrinsic
def store(typingctx, array, i, x):
    """Write the lanes of x to elements i, i+1 …"""
    return _store(array, i, x, False)


@intrinsic
def store_aligned(typingctx, array, i, x):
    """`store` to an address that is a multiple of the vector's bytes."""
    return _store(array, i, x, True)


@intrinsic
def store_past(typingctx, array, i, x):
    """`store_aligned` past the caches, which neither read what was there nor keep what is written."""
    return _store(array, i, x, True, past=True)


def zero_lanes(builder: Any, element: Any, lanes: int) -> Any:
    return ir.Constant(ir.VectorType(element, lanes), None)


def _suffix(element: Any, lanes: int) -> str:
    return f"v{lanes}{element.intrinsic_name}"


@intrinsic
def masked_load(typingctx, array, i, mask):
    """`load` of the lanes set in the mask; others are 0 and not read, so they may lie outside."""
    shape = element_shape(array)
    if shape is None or not _is_mask(mask):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        element, n = stored_type(context, array), mask.lanes
        pointer = as_vector(builder, place(context, builder, array, args[0], args[1], i, 0), element, n)
        nothing = zero_lanes(builder, element, n)
        arguments = [pointer, ir.Constant(I32, item_bytes(array)), args[2], nothing]
        name = f"llvm.masked.load.{_suffix(element, n)}.p0"
        return from_memory(builder, v.call(builder, name, nothing.type, arguments), array).raw

    return signature(Vector(*shape, mask.lanes), array, i, mask), generate


@intrinsic
def masked_store(typingctx, array, i, x, mask):
    """`store` of the lanes set in the mask; other elements keep their values."""
    if element_shape(array) is None or not _is_mask(mask) or not isinstance(x, Vector) or x.lanes != mask.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        pointer = place(context, builder, array, args[0], args[1], i, 0)
        _masked_store(builder, pointer, raw, args[3], item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, i, x, mask), generate


def _masked_store(builder: Any, pointer: Any, raw: Any, mask: Any, alignment: int) -> None:
    pointer = builder.bitcast(pointer, raw.type.as_pointer())
    name = f"llvm.masked.store.{_suffix(raw.type.element, raw.type.count)}.p0"
    v.call(builder, name, ir.VoidType(), [raw, pointer, ir.Constant(I32, alignment), mask])


def _is_mask(kind: types.Type) -> bool:
    return isinstance(kind, Vector) and kind.kind == "m"


# --- one element ---------------------------------------------------------------------------------------------------------


@intrinsic
def read(typingctx, array, i):
    """Element i as a number."""
    if element_shape(array) is None or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return from_memory(builder, builder.load(place(context, builder, array, args[0], args[1], i)), array).raw

    small = {types.uint8: types.int32}
    return signature(small.get(array.dtype, array.dtype), array, i), generate


@intrinsic
def write(typingctx, array, i, number):
    """Write one number to element i."""
    if element_shape(array) is None or not isinstance(i, types.Integer) or shape_of(types.unliteral(number)) is None:
        return None
    number = types.unliteral(number)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        one = Value(builder, context.cast(builder, args[2], number, array.dtype), *shape_of(array.dtype)[:2])  # pyright: ignore
        raw = one.raw if array.dtype == types.uint8 else to_memory(one, array)
        builder.store(raw, place(context, builder, array, args[0], args[1], i))
        return context.get_dummy_value()

    return signature(types.void, array, i, number), generate


# --- gather and scatter --------------------------------------------------------------------------------------------------


class _Addresses(ir.Type):
    """A vector of pointers, for which llvmlite has no name."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes

    def _to_string(self) -> str:
        return f"<{self.lanes} x ptr>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Addresses) and other.lanes == self.lanes

    def __hash__(self) -> int:
        return hash((_Addresses, self.lanes))


class _AddressesOf(ir.instructions.Instruction):
    """getelementptr of one base by a vector of indices, as LLVM's gathers want it."""

    def __init__(self, block: Any, element: Any, base: Any, index: Any) -> None:
        self.element = element
        super().__init__(block, _Addresses(index.type.count), "getelementptr", [base, index])

    def descr(self, buf: list[str]) -> None:
        base, index = self.operands
        buf.append(f"getelementptr {self.element}, ptr {base.get_reference()}, {index.type} {index.get_reference()}\n")


def addresses(builder: Any, element: Any, base: Any, index: Any) -> Any:
    made = _AddressesOf(builder.block, element, base, index)
    builder._insert(made)
    return made


def gathered(context: Any, builder: Any, array: Any, base: Any, index: Value, mask: Any = None) -> Value:
    """Elements base[index] where the mask is set (all lanes without one), else 0."""
    element, n = stored_type(context, array), index.lanes
    where = addresses(builder, element, base, index.raw)
    every = ir.Constant(ir.VectorType(I1, n), [1] * n) if mask is None else mask
    nothing = zero_lanes(builder, element, n)
    name = f"llvm.masked.gather.{_suffix(element, n)}.v{n}p0"
    raw = v.call(builder, name, nothing.type, [where, ir.Constant(I32, item_bytes(array)), every, nothing])
    return from_memory(builder, raw, array)


def _is_index(kind: types.Type) -> bool:
    return isinstance(kind, Vector) and kind.kind in "iu"


@intrinsic
def gather(typingctx, array, index, mask=None):
    """array's elements at a vector of places, as the array's own type; lanes off in the mask are 0 and not read."""
    shape = element_shape(array)
    if shape is None or not _is_index(index) or not (mask is None or _is_mask(mask)):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        made, places = make_array(array)(context, builder, value=args[0]), value(builder, args[1], index)
        guard.each(builder, made.nitems, places, args[2] if mask else None)
        return gathered(context, builder, array, made.data, places, args[2] if mask else None).raw

    return signature(Vector(*shape, index.lanes), array, index, mask or types.none), generate


@intrinsic
def scatter(typingctx, array, index, x, mask=None):
    """Write lanes of x to a vector of places; of lanes with one place the last is kept. Lanes off in the mask write nothing."""
    if element_shape(array) is None or not _is_index(index) or not isinstance(x, Vector) or x.lanes != index.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        made = make_array(array)(context, builder, value=args[0])
        guard.each(builder, made.nitems, value(builder, args[1], index), args[3] if mask else None)
        where = addresses(builder, raw.type.element, made.data, args[1])
        every = args[3] if mask else ir.Constant(ir.VectorType(I1, x.lanes), [1] * x.lanes)
        name = f"llvm.masked.scatter.{_suffix(raw.type.element, x.lanes)}.v{x.lanes}p0"
        v.call(builder, name, ir.VoidType(), [raw, where, ir.Constant(I32, item_bytes(array)), every])
        return context.get_dummy_value()

    return signature(types.void, array, index, x, mask or types.none), generate


# --- compress ------------------------------------------------------------------------------------------------------------


def _has_compress(raw: Any) -> bool:
    width = raw.type.count * getattr(raw.type.element, "width", 64 if isinstance(raw.type.element, ir.DoubleType) else 32)
    return width in ((128, 256, 512) if machine.AVX512 else (256,) if machine.AVX2 else ()) and raw.type.element != I8


def _packed(builder: Any, raw: Any, mask: Any) -> Any:
    """The set lanes moved to the front, in a register."""
    if not machine.AVX512:
        return _permuted(builder, raw, mask)
    name = f"llvm.x86.avx512.mask.compress.{_suffix(raw.type.element, raw.type.count)}"
    return v.call(builder, name, raw.type, [raw, raw, mask])


def _permuted(builder: Any, raw: Any, mask: Any) -> Any:
    """The same with AVX2: each mask has its permutation of eight parts of 32 bits, a byte for each, in a table."""
    count, eight = raw.type.count, ir.VectorType(I32, 8)
    each = 8 // count
    orders = []
    for bits in range(1 << count):
        parts = [each * k + j for k in range(count) if bits >> k & 1 for j in range(each)]
        orders.append(int.from_bytes(bytes(parts + [0] * (8 - len(parts))), "little"))
    kind = ir.ArrayType(I64, len(orders))
    table = cgutils.global_constant(builder, f"permutations{count}", ir.Constant(kind, orders))
    number = builder.zext(builder.bitcast(mask, ir.IntType(count)), I64)
    row = builder.load(builder.gep(table, [ir.Constant(I64, 0), number]))
    order = builder.zext(builder.bitcast(row, ir.VectorType(I8, 8)), eight)
    return builder.bitcast(v.call(builder, "llvm.x86.avx2.permd", eight, [builder.bitcast(raw, eight), order]), raw.type)


def _store_packed(builder: Any, pointer: Any, raw: Any, mask: Any) -> None:
    """Lane by lane without branches: a lane that is off writes to a spare place, so nothing behind the last one changes."""
    element = raw.type.element
    spare = entry_alloca(builder, element, 1)
    pointer, at = builder.bitcast(pointer, element.as_pointer()), ir.Constant(I64, 0)
    for k in range(raw.type.count):
        on = builder.extract_element(mask, ir.Constant(I32, k))
        target = builder.select(on, builder.gep(pointer, [at]), spare)
        builder.store(builder.extract_element(raw, ir.Constant(I32, k)), target)
        at = builder.add(at, builder.zext(on, I64))


@intrinsic
def compress(typingctx, x, mask):
    """The lanes of x set in the mask, moved to the front in order; what the others hold is undefined."""
    if not isinstance(x, Vector) or not _is_mask(mask) or x.lanes != mask.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        if x.kind != "m" and _has_compress(args[0]):
            return _packed(builder, args[0], args[1])
        lanes = value(builder, args[0], x)
        raw = lanes.to("u", 8).raw if x.kind == "m" else lanes.raw
        room = entry_alloca(builder, raw.type.element, x.lanes)
        builder.store(zero_lanes(builder, raw.type.element, x.lanes), builder.bitcast(room, raw.type.as_pointer()))
        _store_packed(builder, room, raw, args[1])
        packed = builder.load(builder.bitcast(room, raw.type.as_pointer()))
        return Value(builder, packed, "u", 8).to("m", x.bits).raw if x.kind == "m" else packed

    return signature(x, x, mask), generate


@intrinsic
def compress_store(typingctx, array, i, x, mask):
    """Write the lanes of x set in the mask one after the other from element i; how many there were (int64)."""
    if element_shape(array) is None or not isinstance(x, Vector) or not _is_mask(mask) or x.lanes != mask.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        pointer = place(context, builder, array, args[0], args[1], i, 0)
        number = builder.zext(builder.bitcast(args[3], ir.IntType(x.lanes)), I64)
        total = v.call(builder, "llvm.ctpop.i64", I64, [number])
        if _has_compress(raw):
            wide = ir.IntType(x.lanes)
            front = builder.not_(builder.shl(ir.Constant(I64, -1), total))
            front = builder.bitcast(builder.trunc(front, wide), args[3].type)
            _masked_store(builder, pointer, _packed(builder, raw, args[3]), front, item_bytes(array))
        else:
            _store_packed(builder, pointer, raw, args[3])
        return total

    return signature(types.int64, array, i, x, mask), generate


# --- rows of records -----------------------------------------------------------------------------------------------------


@intrinsic(prefer_literal=True)
def gather_rows(typingctx, array, index, k, first=None):
    """The k elements (2, 4 or 8, constant) from each place of an index vector on, as k vectors: records to structure of arrays.

    `first`, the same for all, is added to the places: several parts of a record share the work of taking places out of the vector.
    """
    shape = element_shape(array)
    if shape is None or not _is_index(index) or not isinstance(k, types.IntegerLiteral) or _is_small(array):
        return None
    if not isinstance(first or types.none, types.Integer | types.NoneType):
        return None
    columns, lanes = k.literal_value, index.lanes
    if columns not in (2, 4, 8):
        return None
    result = types.UniTuple(Vector(*shape, lanes), columns)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        made = make_array(array)(context, builder, value=args[0])
        further = context.cast(builder, args[3], first, types.int64) if isinstance(first, types.Integer) else ir.Constant(I64, 0)
        guard.each(builder, builder.sub(made.nitems, further), value(builder, args[1], index), count=columns)
        rows = []
        for n in range(lanes):
            at = value(builder, builder.extract_element(args[1], ir.Constant(I32, n)), index.scalar).to("i", 64).raw
            place = builder.gep(builder.gep(made.data, [at]), [further])
            pointer = as_vector(builder, place, stored_type(context, array), columns)
            rows.append(builder.load(pointer, align=item_bytes(array)))
        return context.make_tuple(builder, result, _columns(builder, rows, columns))

    return signature(result, array, index, k, first or types.none), generate


def _columns(builder: Any, rows: list[Any], k: int) -> list[Any]:
    """Of n rows of k lanes, the k columns of n lanes."""
    n = len(rows)
    if n < k:
        return [_column(builder, rows, j) for j in range(k)]
    # Rows j, j + k, j + 2k … side by side make vector j; its k×k blocks are then transposed.
    beside = [_side_by_side(builder, [rows[k * block + j] for block in range(n // k)]) for j in range(k)]
    return transposed(builder, beside, n)


def _side_by_side(builder: Any, rows: list[Any]) -> Any:
    while len(rows) > 1:
        count = 2 * rows[0].type.count
        rows = [shuffled(builder, a, b, list(range(count))) for a, b in zip(rows[::2], rows[1::2], strict=True)]
    return rows[0]


def _column(builder: Any, rows: Sequence[Any], j: int) -> Any:
    whole = ir.Constant(ir.VectorType(rows[0].type.element, len(rows)), ir.Undefined)
    for n, row in enumerate(rows):
        whole = builder.insert_element(whole, builder.extract_element(row, ir.Constant(I32, j)), ir.Constant(I32, n))
    return whole


@intrinsic
def scatter_rows(typingctx, array, index, columns):
    """The other way: lane n of each of the k vectors (a tuple) to the k elements from place index[n]."""
    if element_shape(array) is None or not _is_index(index) or not isinstance(columns, types.UniTuple):
        return None
    kind, k = columns.dtype, columns.count
    if not isinstance(kind, Vector) or kind.lanes != index.lanes or _is_small(array):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        made = make_array(array)(context, builder, value=args[0])
        guard.each(builder, made.nitems, value(builder, args[1], index), count=k)
        parts = [to_memory(value(builder, builder.extract_value(args[2], j), kind), array) for j in range(k)]
        beside = transposed(builder, parts, kind.lanes) if k in (2, 4, 8) and kind.lanes >= k else None
        for n in range(kind.lanes):
            at = value(builder, builder.extract_element(args[1], ir.Constant(I32, n)), index.scalar).to("i", 64).raw
            if beside is None:
                row = _column(builder, parts, n)
            else:
                row = shuffled(builder, beside[n % k], beside[n % k], list(range(n - n % k, n - n % k + k)))
            pointer = as_vector(builder, builder.gep(made.data, [at]), row.type.element, k)
            builder.store(row, pointer, align=item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, index, columns), generate


@intrinsic
def store_rows(typingctx, array, i, stride, columns):
    """`scatter_rows` to places i, i + stride …"""
    if element_shape(array) is None or not isinstance(columns, types.UniTuple):
        return None
    kind, k = columns.dtype, columns.count
    if not isinstance(i, types.Integer) or not isinstance(stride, types.Integer) or not isinstance(kind, Vector):
        return None
    if k not in (2, 4, 8) or kind.lanes < k:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        start = place(context, builder, array, args[0], args[1], i)
        parts = [to_memory(value(builder, builder.extract_value(args[3], j), kind), array) for j in range(k)]
        beside, step = transposed(builder, parts, kind.lanes), context.cast(builder, args[2], stride, types.int64)
        for n in range(kind.lanes):
            row = shuffled(builder, beside[n % k], beside[n % k], list(range(n - n % k, n - n % k + k)))
            pointer = builder.gep(start, [builder.mul(step, ir.Constant(I64, n))])
            builder.store(row, as_vector(builder, pointer, row.type.element, k), align=item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, i, stride, columns), generate


# --- memory of a kernel's own --------------------------------------------------------------------------------------------


def entry_alloca(builder: Any, element: Any, count: int) -> Any:
    """Room on the stack, not filled, taken once a call however often the code runs."""
    with builder.goto_entry_block():
        room = builder.alloca(ir.ArrayType(element, count))
        room.align = CACHE_LINE
    return builder.bitcast(room, element.as_pointer())


@intrinsic(prefer_literal=True)
def stack_array(typingctx, dtype, count):
    """An array of `count` (constant) numbers on the stack, 64-byte aligned and not filled, gone when the function returns.

    A helper, of which nothing is left in who calls it, may return one that it has not written to.
    """
    if not isinstance(dtype, types.NumberClass) or not isinstance(count, types.IntegerLiteral):
        return None
    array, n = types.Array(dtype.dtype, 1, "C"), count.literal_value

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        made = make_array(array)(context, builder)
        size = context.get_constant(types.intp, item_bytes(array))
        room = entry_alloca(builder, context.get_data_type(array.dtype), n)
        shape = cgutils.pack_array(builder, [context.get_constant(types.intp, n)])
        populate_array(made, room, shape, cgutils.pack_array(builder, [size]), size, None)
        return made._getvalue()

    return signature(array, dtype, count), generate


@intrinsic
def prefetch(typingctx, array, i):
    """Ask for the cache line of element i, which will be read soon; any i is safe."""
    if not isinstance(array, types.Array) or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        pointer = builder.bitcast(place(context, builder, array, args[0], args[1], i, 0), I8.as_pointer())
        v.call(builder, "llvm.prefetch.p0", ir.VoidType(), [pointer, *(ir.Constant(I32, n) for n in (0, 3, 1))])
        return context.get_dummy_value()

    return signature(types.void, array, i), generate
