"""Packed structs: nested NamedTuples of arrays that kernels receive as one pointer.

A NamedTuple of arrays passed by value costs several words and a reference count an array at each call. A Handle is the address of one
packed block: [data pointer, length] for an array, one word for a number, nested tuples in place, and the address of another Handle. In a
kernel, `handle.lights.color[i, 0]` reads as on the tuple itself. The type contains the block's layout, so that field places and row shapes
are constants. Loads are marked invariant, so that LLVM moves them out of loops.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    overload,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np import numpy_support
from numba.np.arrayobj import make_array, populate_array
from numpy.typing import NDArray

from .kernel import HELPER

WORD = 8  # bytes
_BYTE = ctypes.c_char
_BITS, _FLOAT = struct.Struct("q"), struct.Struct("d")

# A layout describes a packed tuple: ((name, word, kind), …). A kind is a layout, ("array", dtype, row shape), ("handle", type), "int",
# "float" or "bool".
Layout = tuple[tuple[str, int, Any], ...]


class Handle:
    """A packed nest of NamedTuples, which keeps the arrays alive; `tables` is the nest itself, for numpy code.

    Raises ValueError for an array that is not C-contiguous.
    """

    __slots__ = ("_block", "_numba_type_", "address", "tables")  # Numba reads the type of a value from `_numba_type_`

    def __init__(self, tables: Any) -> None:
        words: list[int] = []
        layout = _pack(tables, words)
        self.tables = tables
        self._block = np.array(words or [0], np.int64)
        self.address = int(self._block.ctypes.data)
        self._numba_type_ = _type_of(layout)

    @property
    def numba_type(self) -> HandleType:
        """Type of the handle in kernels."""
        return self._numba_type_

    @numba_type.setter
    def numba_type(self, kind: HandleType) -> None:
        self._numba_type_ = kind

    def part(self, name: str) -> types.Type:
        """Numba type of a field."""
        found = self.numba_type.field(name)
        assert found is not None, name
        return _numba_type(found[1])

    def put(self, name: str, number: int) -> None:
        """Set an integer field of the packed tuple, or of a nested one ("inner.name"), before kernels read it.

        Raises ValueError for other fields.
        """
        found = self.numba_type.field(name)
        if found is None or found[1] != "int":
            raise ValueError(f"{name} is not an integer field of this tuple")
        self._block[found[0]] = number

    def point(self, name: str, other: Handle) -> None:
        """Replace a Handle field by another Handle of its type, while no kernel reads it. Raises ValueError for other fields."""
        found = self.numba_type.field(name)
        if found is None or found[1] != ("handle", other.numba_type):
            raise ValueError(f"{name} is not a handle of that type")
        self._block[found[0]] = other.address
        self.tables = self.tables._replace(**{name: other})


def _pack(value: Any, words: list[int]) -> Layout:
    """Append the words of a NamedTuple; return its layout, whose places count from the block's start."""
    layout = []
    for name, item in zip(value._fields, value, strict=True):
        if isinstance(item, np.ndarray):
            if not item.flags.c_contiguous:
                raise ValueError(f"{name} is not contiguous")
            layout.append((name, len(words), ("array", item.dtype.str, item.shape[1:])))
            words.extend((_address(item), len(item)))
        elif isinstance(item, Handle):
            layout.append((name, len(words), ("handle", item.numba_type)))
            words.append(item.address)
        elif hasattr(item, "_fields"):
            layout.append((name, len(words), _pack(item, words)))
        else:
            kind = "bool" if isinstance(item, bool | np.bool_) else "int" if isinstance(item, int | np.integer) else "float"
            layout.append((name, len(words), kind))
            words.append(_BITS.unpack(_FLOAT.pack(item))[0] if kind == "float" else int(item))
    return tuple(layout)


def _address(array: NDArray[Any]) -> int:
    """Address of an array's elements; 0 for an empty array.

    `array.ctypes.data` takes three times as long, and longer than the rest of packing.
    """
    if not array.size:
        return 0
    if not array.flags.writeable:
        return int(array.ctypes.data)
    return ctypes.addressof(_BYTE.from_buffer(array))  # pyright: ignore[reportArgumentType]


class HandleType(types.Type):
    """Numba type of a packed tuple. Equal layouts share a type; its name is short, because every symbol name contains it."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        super().__init__(name=f"Handle{hashlib.sha256(repr(layout).encode()).hexdigest()[:12]}")

    def field(self, name: str) -> tuple[int, Any] | None:
        """(word, kind) of a field or of a field of a nested tuple ("outer.inner"), not of another Handle; None if there is none."""
        found, layout = None, self.layout
        for part in name.split("."):
            found = next(((word, kind) for known, word, kind in layout if known == part), None)
            layout = found[1] if found and isinstance(found[1], tuple) and found[1][:1] != ("handle",) else ()
        return found


_type_of = functools.cache(HandleType)  # hashing the name takes longer than packing


@functools.cache
def with_type_tags(kind: HandleType, *tags: str) -> HandleType:
    """The type of the same block with tags: fields without words, which state facts about its contents.

    A kernel that is compiled for the tagged type and called by address omits the code that the tags make unnecessary.
    """
    return _type_of(kind.layout + tuple((tag, 0, ()) for tag in tags))


def skip_when_tagged(tag: str, otherwise: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a helper whose first argument is a Handle: kernels call `otherwise` instead where the Handle's type has the tag."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        def select(handle: Any, *of: Any) -> Any:
            return function(handle, *of)

        @overload(select, jit_options=HELPER)
        def _in_kernels(handle, *of):
            if handle.field(tag) is None:
                return lambda handle, *of: function(handle, *of)
            return lambda handle, *of: otherwise(handle, *of)

        return select

    return decorate


def _numba_type(kind: Any) -> types.Type:
    if kind == "int":
        return types.int64
    if kind == "float":
        return types.float64
    if kind == "bool":
        return types.boolean
    if kind and kind[0] == "array":
        return types.Array(numpy_support.from_dtype(np.dtype(kind[1])), 1 + len(kind[2]), "C")
    if kind and kind[0] == "handle":
        return kind[1]
    return _type_of(kind)


@typeof_impl.register(Handle)
def _typeof(value: Handle, context: Any) -> HandleType:
    return value.numba_type


@register_model(HandleType)
class _HandleModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: HandleType) -> None:
        super().__init__(manager, kind, llvm.IntType(8).as_pointer())


@unbox(HandleType)
def _unbox(kind: HandleType, value: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(value, "address")
    address = c.pyapi.long_as_longlong(number)
    c.pyapi.decref(number)
    pointer = c.builder.inttoptr(address, llvm.IntType(8).as_pointer())
    return NativeValue(pointer, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@infer_getattr
class _HandleAttributes(AttributeTemplate):
    key = HandleType

    def generic_resolve(self, typ: HandleType, attr: str) -> types.Type | None:
        found = typ.field(attr)
        return _numba_type(found[1]) if found else None


@lower_getattr_generic(HandleType)
def _load(context: Any, builder: Any, typ: HandleType, value: Any, attr: str) -> Any:
    found = typ.field(attr)
    assert found is not None
    word, kind = found
    if isinstance(kind, tuple) and not (kind and kind[0] in ("array", "handle")):
        return value  # a nested tuple: its words count from the start of the block
    if kind == "float":
        return _word(builder, value, word, llvm.DoubleType())
    whole = _word(builder, value, word, llvm.IntType(64))
    if kind == "int":
        return whole
    if kind == "bool":
        return builder.icmp_signed("!=", whole, llvm.Constant(whole.type, 0))
    if kind[0] == "handle":
        return builder.inttoptr(whole, llvm.IntType(8).as_pointer())
    return _array(context, builder, _numba_type(kind), value, word, kind[2])


def _array(context: Any, builder: Any, kind: types.Type, value: Any, word: int, row: tuple[int, ...]) -> Any:
    array = make_array(kind)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))  # pyright: ignore[reportAttributeAccessIssue]
    size = llvm.IntType(64)
    length = _word(builder, value, word + 1, size)
    shape = [length, *(llvm.Constant(size, n) for n in row)]
    strides, step = [], item
    for n in reversed(row):
        strides.append(llvm.Constant(size, step))
        step *= n
    strides.append(llvm.Constant(size, step))
    data = builder.inttoptr(_word(builder, value, word, size), array.data.type)
    populate_array(array, data, shape, strides[::-1], llvm.Constant(size, item), None)
    return array._getvalue()


def _word(builder: Any, value: Any, word: int, kind: Any) -> Any:
    place = builder.gep(value, [llvm.Constant(llvm.IntType(64), word * WORD)])
    loaded = builder.load(builder.bitcast(place, kind.as_pointer()))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded
