"""Gather, scatter, compress, and loads and stores of records as rows. Places are flat, as in memory.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import Signature, signature
from numba.np.arrayobj import make_array

from . import bounds_check
from . import llvm_expr as v
from . import target as simd_target
from .llvm_expr import I1, I8, I32, I64, Value
from .memory import (
    as_vector,
    element_shape,
    entry_alloca,
    from_memory,
    is_mask,
    is_small,
    item_bytes,
    place,
    store_masked,
    stored_type,
    suffix_of,
    to_memory,
    zero_lanes,
)
from .shuffles import shuffle, transpose_blocks
from .vector_type import Vector, intrinsic, value

# --- gather and scatter --------------------------------------------------------------------------------------------------


class _Addresses(ir.Type):
    """The type of a vector of pointers, which llvmlite lacks."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes

    def _to_string(self) -> str:
        return f"<{self.lanes} x ptr>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Addresses) and other.lanes == self.lanes

    def __hash__(self) -> int:
        return hash((_Addresses, self.lanes))


class _AddressesOf(ir.instructions.Instruction):
    """getelementptr of one base by a vector of indices, the address operand of LLVM's gathers."""

    def __init__(self, block: Any, element: Any, base: Any, index: Any) -> None:
        self.element = element
        super().__init__(block, _Addresses(index.type.count), "getelementptr", [base, index])

    def descr(self, buf: list[str]) -> None:
        base, index = self.operands
        buf.append(f"getelementptr {self.element}, ptr {base.get_reference()}, {index.type} {index.get_reference()}\n")


def addresses(builder: Any, element: Any, base: Any, index: Any) -> Any:
    """Emit the addresses of elements base[index] for a vector of indices."""
    instruction = _AddressesOf(builder.block, element, base, index)
    builder._insert(instruction)
    return instruction


def emit_gather(context: Any, builder: Any, array: Any, base: Any, index: Value, mask: Any = None) -> Value:
    """Emit a gather of base[index] in the lanes of the mask (all lanes without one); other lanes are 0."""
    element, n = stored_type(context, array), index.lanes
    where = addresses(builder, element, base, index.raw)
    every = ir.Constant(ir.VectorType(I1, n), [1] * n) if mask is None else mask
    nothing = zero_lanes(builder, element, n)
    name = f"llvm.masked.gather.{suffix_of(element, n)}.v{n}p0"
    raw = v.call(builder, name, nothing.type, [where, ir.Constant(I32, item_bytes(array)), every, nothing])
    return from_memory(builder, raw, array)


def _is_index(kind: types.Type) -> bool:
    return isinstance(kind, Vector) and kind.kind in "iu"


@intrinsic
def gather(typingctx, array, index, mask=None):
    """Gather array elements at a vector of places, in the array's own type; lanes off in the mask are 0 and not read."""
    shape = element_shape(array)
    if shape is None or not _is_index(index) or not (mask is None or is_mask(mask)):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        struct, places = make_array(array)(context, builder, value=args[0]), value(builder, args[1], index)
        bounds_check.check_lanes(builder, struct.nitems, places, args[2] if mask else None)
        return emit_gather(context, builder, array, struct.data, places, args[2] if mask else None).raw

    return signature(Vector(*shape, index.lanes), array, index, mask or types.none), generate


@intrinsic
def scatter(typingctx, array, index, x, mask=None):
    """Scatter the lanes of x to a vector of places; the last lane wins at equal places. Lanes off in the mask write nothing."""
    if element_shape(array) is None or not _is_index(index) or not isinstance(x, Vector) or x.lanes != index.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        struct = make_array(array)(context, builder, value=args[0])
        bounds_check.check_lanes(builder, struct.nitems, value(builder, args[1], index), args[3] if mask else None)
        where = addresses(builder, raw.type.element, struct.data, args[1])
        every = args[3] if mask else ir.Constant(ir.VectorType(I1, x.lanes), [1] * x.lanes)
        name = f"llvm.masked.scatter.{suffix_of(raw.type.element, x.lanes)}.v{x.lanes}p0"
        v.call(builder, name, ir.VoidType(), [raw, where, ir.Constant(I32, item_bytes(array)), every])
        return context.get_dummy_value()

    return signature(types.void, array, index, x, mask or types.none), generate


# --- compress ------------------------------------------------------------------------------------------------------------


def _has_compress(raw: Any) -> bool:
    width = raw.type.count * getattr(raw.type.element, "width", 64 if isinstance(raw.type.element, ir.DoubleType) else 32)
    return width in ((128, 256, 512) if simd_target.AVX512 else (256,) if simd_target.AVX2 else ()) and raw.type.element != I8


def _pack(builder: Any, raw: Any, mask: Any) -> Any:
    """Move the set lanes to the front, in a register."""
    if not simd_target.AVX512:
        return _pack_avx2(builder, raw, mask)
    name = f"llvm.x86.avx512.mask.compress.{suffix_of(raw.type.element, raw.type.count)}"
    return v.call(builder, name, raw.type, [raw, raw, mask])


def _pack_avx2(builder: Any, raw: Any, mask: Any) -> Any:
    """`_packed` for AVX2: a table holds each mask's permutation of eight 32-bit parts, one byte a part."""
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
    """Store lane by lane without branches: an unset lane writes to a spare element, so nothing behind the last set lane changes."""
    element = raw.type.element
    spare = entry_alloca(builder, element, 1)
    pointer, offset = builder.bitcast(pointer, element.as_pointer()), ir.Constant(I64, 0)
    for k in range(raw.type.count):
        on = builder.extract_element(mask, ir.Constant(I32, k))
        target = builder.select(on, builder.gep(pointer, [offset]), spare)
        builder.store(builder.extract_element(raw, ir.Constant(I32, k)), target)
        offset = builder.add(offset, builder.zext(on, I64))


@intrinsic
def compress(typingctx, x, mask):
    """Move the lanes of x set in the mask to the front in order; the other lanes are undefined."""
    if not isinstance(x, Vector) or not is_mask(mask) or x.lanes != mask.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        if x.kind != "m" and _has_compress(args[0]):
            return _pack(builder, args[0], args[1])
        lanes = value(builder, args[0], x)
        raw = lanes.to("u", 8).raw if x.kind == "m" else lanes.raw
        buffer = entry_alloca(builder, raw.type.element, x.lanes)
        builder.store(zero_lanes(builder, raw.type.element, x.lanes), builder.bitcast(buffer, raw.type.as_pointer()))
        _store_packed(builder, buffer, raw, args[1])
        packed = builder.load(builder.bitcast(buffer, raw.type.as_pointer()))
        return Value(builder, packed, "u", 8).to("m", x.bits).raw if x.kind == "m" else packed

    return signature(x, x, mask), generate


@intrinsic
def compress_store(typingctx, array, i, x, mask):
    """Store the lanes of x set in the mask contiguously from element i on; return their count (int64)."""
    if element_shape(array) is None or not isinstance(x, Vector) or not is_mask(mask) or x.lanes != mask.lanes:
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
            store_masked(builder, pointer, _pack(builder, raw, args[3]), front, item_bytes(array))
        else:
            _store_packed(builder, pointer, raw, args[3])
        return total

    return signature(types.int64, array, i, x, mask), generate


# --- rows of records -----------------------------------------------------------------------------------------------------


@intrinsic(prefer_literal=True)
def gather_rows(typingctx, array, index, k, first=None):
    """Load k elements (2, 4 or 8, constant) from each place of an index vector on, as k vectors: records to structure of arrays.

    A scalar `first` is added to all places, so that loads of several parts of a record share the extraction of the indices.
    """
    shape = element_shape(array)
    if shape is None or not _is_index(index) or not isinstance(k, types.IntegerLiteral) or is_small(array):
        return None
    if not isinstance(first or types.none, types.Integer | types.NoneType):
        return None
    columns, lanes = k.literal_value, index.lanes
    if columns not in (2, 4, 8):
        return None
    result = types.UniTuple(Vector(*shape, lanes), columns)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        struct = make_array(array)(context, builder, value=args[0])
        further = context.cast(builder, args[3], first, types.int64) if isinstance(first, types.Integer) else ir.Constant(I64, 0)
        bounds_check.check_lanes(builder, builder.sub(struct.nitems, further), value(builder, args[1], index), count=columns)
        rows = []
        for n in range(lanes):
            row_index = value(builder, builder.extract_element(args[1], ir.Constant(I32, n)), index.scalar).to("i", 64).raw
            place = builder.gep(builder.gep(struct.data, [row_index]), [further])
            pointer = as_vector(builder, place, stored_type(context, array), columns)
            rows.append(builder.load(pointer, align=item_bytes(array)))
        return context.make_tuple(builder, result, _columns(builder, rows, columns))

    return signature(result, array, index, k, first or types.none), generate


def _columns(builder: Any, rows: list[Any], k: int) -> list[Any]:
    """Turn n rows of k lanes into k columns of n lanes."""
    n = len(rows)
    if n < k:
        return [_column(builder, rows, j) for j in range(k)]
    # Rows j, j + k, j + 2k … side by side form vector j; then its k×k blocks are transposed.
    beside = [_side_by_side(builder, [rows[k * block + j] for block in range(n // k)]) for j in range(k)]
    return transpose_blocks(builder, beside, n)


def _side_by_side(builder: Any, rows: list[Any]) -> Any:
    while len(rows) > 1:
        count = 2 * rows[0].type.count
        rows = [shuffle(builder, a, b, list(range(count))) for a, b in zip(rows[::2], rows[1::2], strict=True)]
    return rows[0]


def _column(builder: Any, rows: Sequence[Any], j: int) -> Any:
    column = ir.Constant(ir.VectorType(rows[0].type.element, len(rows)), ir.Undefined)
    for n, row in enumerate(rows):
        column = builder.insert_element(column, builder.extract_element(row, ir.Constant(I32, j)), ir.Constant(I32, n))
    return column


@intrinsic
def scatter_rows(typingctx, array, index, columns):
    """Inverse of `gather_rows`: store lane n of each of the k vectors (a tuple) to the k elements from index[n] on."""
    if element_shape(array) is None or not _is_index(index) or not isinstance(columns, types.UniTuple):
        return None
    kind, k = columns.dtype, columns.count
    if not isinstance(kind, Vector) or kind.lanes != index.lanes or is_small(array):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        struct = make_array(array)(context, builder, value=args[0])
        bounds_check.check_lanes(builder, struct.nitems, value(builder, args[1], index), count=k)
        parts = [to_memory(value(builder, builder.extract_value(args[2], j), kind), array) for j in range(k)]
        beside = transpose_blocks(builder, parts, kind.lanes) if k in (2, 4, 8) and kind.lanes >= k else None
        for n in range(kind.lanes):
            row_index = value(builder, builder.extract_element(args[1], ir.Constant(I32, n)), index.scalar).to("i", 64).raw
            if beside is None:
                row = _column(builder, parts, n)
            else:
                row = shuffle(builder, beside[n % k], beside[n % k], list(range(n - n % k, n - n % k + k)))
            pointer = as_vector(builder, builder.gep(struct.data, [row_index]), row.type.element, k)
            builder.store(row, pointer, align=item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, index, columns), generate


@intrinsic
def store_rows(typingctx, array, i, stride, columns):
    """`scatter_rows` to the places i, i + stride …"""
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
        beside, step = transpose_blocks(builder, parts, kind.lanes), context.cast(builder, args[2], stride, types.int64)
        for n in range(kind.lanes):
            row = shuffle(builder, beside[n % k], beside[n % k], list(range(n - n % k, n - n % k + k)))
            pointer = builder.gep(start, [builder.mul(step, ir.Constant(I64, n))])
            builder.store(row, as_vector(builder, pointer, row.type.element, k), align=item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, i, stride, columns), generate
