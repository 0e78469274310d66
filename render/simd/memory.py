"""Vector loads and stores, single elements, and arrays on the stack.

A place is flat: element `i` of the data of a C-contiguous array of any shape. Places are unchecked unless MAQUETTE_CHECKED is set
(bounds_check.py); negative places do not wrap around. Stores convert to the array's type. Arrays may be of float32, float64, int32, int64,
uint32, uint64, uint8 or bool; uint8 loads as int32 lanes and bool as a mask.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature, signature
from numba.np.arrayobj import make_array, populate_array

from . import bounds_check, target
from . import llvm_expr as v
from .aligned_arrays import CACHE_LINE
from .constructors import CONSTRUCTED
from .llvm_expr import I8, I32, Value
from .shuffles import shuffle
from .vector_type import Vector, intrinsic, shape_of, value

# --- elements ------------------------------------------------------------------------------------------------------------


def element_shape(array: Any) -> tuple[str, int] | None:
    """Kind and bits of the lanes that an array's elements load as; None for unsupported arrays."""
    if not isinstance(array, types.Array) or array.layout != "C":
        return None
    if array.dtype in (types.uint8, types.boolean):
        return ("i", 32) if array.dtype == types.uint8 else ("m", 32)
    shape = shape_of(array.dtype)
    return (shape[0], shape[1]) if shape and shape[1] >= 32 else None


def is_small(array: Any) -> bool:
    """Return whether elements have one byte."""
    return array.dtype in (types.uint8, types.boolean)


def stored_type(context: Any, array: Any) -> Any:
    """LLVM type of an element in memory."""
    return I8 if is_small(array) else context.get_value_type(array.dtype)


def item_bytes(array: Any) -> int:
    """Bytes of an element."""
    return 1 if is_small(array) else array.dtype.bitwidth // 8


def from_memory(builder: Any, raw: Any, array: Any) -> Value:
    """Convert loaded lanes (or one element) to their kind in kernels."""
    if not is_small(array):
        return value(builder, raw, array.dtype)
    small = Value(builder, raw, "u", 8)
    return small.to("i", 32) if array.dtype == types.uint8 else (small != 0).of("m", (small != 0).raw, 32)


def to_memory(lanes: Value, array: Any) -> Any:
    """Convert lanes (or one number) to their type in memory."""
    if is_small(array):
        byte = lanes.to("m", 32).to("u", 8) if array.dtype == types.boolean else lanes.to("i", 32).to("u", 8)
        return byte.raw
    shape = shape_of(array.dtype)
    assert shape is not None
    return lanes.to(shape[0], shape[1]).raw


def place(context: Any, builder: Any, array: Any, raw: Any, index: Any, index_type: types.Type, count: int = 1) -> Any:
    """Emit the address of a flat place, from which `count` elements are accessed (0: unknown, not checked)."""
    struct, offset = make_array(array)(context, builder, value=raw), context.cast(builder, index, index_type, types.int64)
    bounds_check.check_range(builder, struct, offset, count)
    return builder.gep(struct.data, [offset])


def as_vector(builder: Any, pointer: Any, element: Any, lanes: int) -> Any:
    """Cast a pointer to one of a vector."""
    return builder.bitcast(pointer, ir.VectorType(element, lanes).as_pointer())


def load_type(array: Any, what: types.Type | None) -> Vector | None:
    """Result type of a load: the requested lanes or type, else one native vector; None for unsupported arrays.

    Raises TypingError where the number of lanes is not constant.
    """
    shape = element_shape(array)
    if shape is None:
        return None
    if what is None or isinstance(what, types.NoneType):
        return Vector(*shape, target.WIDTH64 if shape[1] == 64 else target.WIDTH)
    if isinstance(what, types.IntegerLiteral):
        return Vector(*shape, what.literal_value)
    if isinstance(what, types.Function):
        return CONSTRUCTED.get(what.typing_key)
    raise TypingError("the lanes of a load must be constant: a number, or a type such as simd.f32 (simd.WIDTH is no constant to Numba)")


# --- load and store ------------------------------------------------------------------------------------------------------


def _load(array: Any, index: types.Type, what: types.Type | None, aligned: bool) -> Any:
    result = load_type(array, what)
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
    """Load elements i, i+1 …: one native vector, a constant number of lanes, or the lanes of a type, converted (simd.f32)."""
    return _load(array, i, what, False)


@intrinsic(prefer_literal=True)
def load_aligned(typingctx, array, i, what=None):
    """`load` from an address that is a multiple of the vector's bytes in memory."""
    return _load(array, i, what, True)


@intrinsic(prefer_literal=True)
def load3(typingctx, array, i, what=None):
    """Load three vectors from elements i, i+1 …: the columns of rows of three numbers."""
    result = load_type(array, what)
    if result is None or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        n = result.lanes
        pointer = as_vector(builder, place(context, builder, array, args[0], args[1], i, 3 * n), stored_type(context, array), 3 * n)
        loaded = builder.load(pointer, align=item_bytes(array))
        columns = [shuffle(builder, loaded, loaded, list(range(k, 3 * n, 3))) for k in range(3)]
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
    """Store the lanes of x to elements i, i+1 …"""
    return _store(array, i, x, False)


@intrinsic
def store_aligned(typingctx, array, i, x):
    """`store` to an address that is a multiple of the vector's bytes."""
    return _store(array, i, x, True)


@intrinsic
def store_past(typingctx, array, i, x):
    """`store_aligned` that bypasses the caches (a non-temporal store)."""
    return _store(array, i, x, True, past=True)


def zero_lanes(builder: Any, element: Any, lanes: int) -> Any:
    """Zero vector constant."""
    return ir.Constant(ir.VectorType(element, lanes), None)


def suffix_of(element: Any, lanes: int) -> str:
    """Type suffix of an LLVM intrinsic's name."""
    return f"v{lanes}{element.intrinsic_name}"


@intrinsic
def masked_load(typingctx, array, i, mask):
    """`load` of the lanes set in the mask; other lanes are 0 and not read, so they may lie outside of the array."""
    shape = element_shape(array)
    if shape is None or not is_mask(mask):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        element, n = stored_type(context, array), mask.lanes
        pointer = as_vector(builder, place(context, builder, array, args[0], args[1], i, 0), element, n)
        nothing = zero_lanes(builder, element, n)
        arguments = [pointer, ir.Constant(I32, item_bytes(array)), args[2], nothing]
        name = f"llvm.masked.load.{suffix_of(element, n)}.p0"
        return from_memory(builder, v.call(builder, name, nothing.type, arguments), array).raw

    return signature(Vector(*shape, mask.lanes), array, i, mask), generate


@intrinsic
def masked_store(typingctx, array, i, x, mask):
    """`store` of the lanes set in the mask; other elements stay unchanged."""
    if element_shape(array) is None or not is_mask(mask) or not isinstance(x, Vector) or x.lanes != mask.lanes:
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        raw = to_memory(value(builder, args[2], x), array)
        pointer = place(context, builder, array, args[0], args[1], i, 0)
        store_masked(builder, pointer, raw, args[3], item_bytes(array))
        return context.get_dummy_value()

    return signature(types.void, array, i, x, mask), generate


def store_masked(builder: Any, pointer: Any, raw: Any, mask: Any, alignment: int) -> None:
    """Emit LLVM's masked store."""
    pointer = builder.bitcast(pointer, raw.type.as_pointer())
    name = f"llvm.masked.store.{suffix_of(raw.type.element, raw.type.count)}.p0"
    v.call(builder, name, ir.VoidType(), [raw, pointer, ir.Constant(I32, alignment), mask])


def is_mask(kind: types.Type) -> bool:
    """Return whether a type is a mask vector."""
    return isinstance(kind, Vector) and kind.kind == "m"


# --- one element ---------------------------------------------------------------------------------------------------------


@intrinsic
def read(typingctx, array, i):
    """Load element i as a scalar."""
    if element_shape(array) is None or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        return from_memory(builder, builder.load(place(context, builder, array, args[0], args[1], i)), array).raw

    small = {types.uint8: types.int32}
    return signature(small.get(array.dtype, array.dtype), array, i), generate


@intrinsic
def write(typingctx, array, i, number):
    """Store a scalar to element i."""
    if element_shape(array) is None or not isinstance(i, types.Integer) or shape_of(types.unliteral(number)) is None:
        return None
    number = types.unliteral(number)

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        scalar = Value(builder, context.cast(builder, args[2], number, array.dtype), *shape_of(array.dtype)[:2])  # pyright: ignore
        raw = scalar.raw if array.dtype == types.uint8 else to_memory(scalar, array)
        builder.store(raw, place(context, builder, array, args[0], args[1], i))
        return context.get_dummy_value()

    return signature(types.void, array, i, number), generate


# --- stack memory --------------------------------------------------------------------------------------------------------


def entry_alloca(builder: Any, element: Any, count: int) -> Any:
    """Allocate uninitialized stack memory in the entry block: once a call, also in a loop."""
    with builder.goto_entry_block():
        memory = builder.alloca(ir.ArrayType(element, count))
        memory.align = CACHE_LINE
    return builder.bitcast(memory, element.as_pointer())


@intrinsic(prefer_literal=True)
def stack_array(typingctx, dtype, count):
    """Allocate an uninitialized array of `count` (constant) numbers on the stack, 64-byte aligned, freed when the function returns.

    An inlined helper may return one that it has not written to.
    """
    if not isinstance(dtype, types.NumberClass) or not isinstance(count, types.IntegerLiteral):
        return None
    array, n = types.Array(dtype.dtype, 1, "C"), count.literal_value

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        struct = make_array(array)(context, builder)
        size = context.get_constant(types.intp, item_bytes(array))
        memory = entry_alloca(builder, context.get_data_type(array.dtype), n)
        shape = cgutils.pack_array(builder, [context.get_constant(types.intp, n)])
        populate_array(struct, memory, shape, cgutils.pack_array(builder, [size]), size, None)
        return struct._getvalue()

    return signature(array, dtype, count), generate


@intrinsic
def prefetch(typingctx, array, i):
    """Prefetch the cache line of element i; any i is safe."""
    if not isinstance(array, types.Array) or not isinstance(i, types.Integer):
        return None

    def generate(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
        pointer = builder.bitcast(place(context, builder, array, args[0], args[1], i, 0), I8.as_pointer())
        v.call(builder, "llvm.prefetch.p0", ir.VoidType(), [pointer, *(ir.Constant(I32, n) for n in (0, 3, 1))])
        return context.get_dummy_value()

    return signature(types.void, array, i), generate
