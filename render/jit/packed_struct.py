"""Packed structs: nested NamedTuples of arrays that kernels receive as one pointer.

A NamedTuple of arrays passed by value costs several words and a reference count an array at each call. A Handle is the address of one
packed block. The block has [data pointer, length] for an array, one word for a number, nested tuples in place, and the address of another
Handle. In a kernel, `handle.lights.color[i, 0]` reads as on the tuple itself. The type contains the block's layout, so that field places
and row shapes are constants. Loads are marked invariant, so that LLVM moves them out of loops.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..simd.registration import overload
from .value_types import TYPE_OF, HandleType, Layout, ValueType, address, field_type, handle_type

_BITS, _FLOAT = struct.Struct("q"), struct.Struct("d")


class Handle:
    """A packed nest of NamedTuples, which keeps the arrays alive; `tables` is the nest itself, for numpy code.

    Raises ValueError for an array that is not C-contiguous.
    """

    __slots__ = ("_block", "address", "tables", "type")

    def __init__(self, tables: Any) -> None:
        words: list[int] = []
        layout = _pack(tables, words)
        self.tables = tables
        self._block = np.array(words or [0], np.int64)
        self.address = int(self._block.ctypes.data)
        self.type: HandleType = handle_type(layout)

    @property
    def words(self) -> NDArray[np.int64]:
        """The packed block, of which kernels may change integers and lengths of arrays before others read it."""
        return self._block

    def part(self, name: str) -> ValueType:
        """Type of a field in kernels."""
        field = self.type.field(name)
        assert field is not None, name
        return field_type(field[1])

    def place(self, name: str) -> int:
        """The number of a field's first word; that of an array's length follows. Raises ValueError for an unknown field."""
        field = self.type.field(name)
        if field is None:
            raise ValueError(f"this tuple has no field {name}")
        return field[0]

    def put(self, name: str, number: int) -> None:
        """Set an integer field of the packed tuple, or of a nested one ("inner.name"), before kernels read it.

        Raises ValueError for other fields.
        """
        field = self.type.field(name)
        if field is None or field[1] != "int":
            raise ValueError(f"{name} is not an integer field of this tuple")
        self._block[field[0]] = number

    def point(self, name: str, other: Handle) -> None:
        """Replace a Handle field by another Handle of its type, while no kernel reads it. Raises ValueError for other fields."""
        field = self.type.field(name)
        if field is None or field[1] != ("handle", other.type):
            raise ValueError(f"{name} is not a handle of that type")
        self._block[field[0]] = other.address
        self.tables = self.tables._replace(**{name: other})


def _pack(value: Any, words: list[int]) -> Layout:
    """Append the words of a NamedTuple; return its layout, whose places count from the block's start."""
    layout = []
    for name, item in zip(value._fields, value, strict=True):
        if isinstance(item, np.ndarray):
            if not item.flags.c_contiguous:
                raise ValueError(f"{name} is not contiguous")
            layout.append((name, len(words), ("array", item.dtype.str, item.shape[1:])))
            words.extend((address(item), len(item)))
        elif isinstance(item, Handle):
            layout.append((name, len(words), ("handle", item.type)))
            words.append(item.address)
        elif hasattr(item, "_fields"):
            layout.append((name, len(words), _pack(item, words)))
        else:
            kind = "bool" if isinstance(item, bool | np.bool_) else "int" if isinstance(item, int | np.integer) else "float"
            layout.append((name, len(words), kind))
            words.append(_BITS.unpack(_FLOAT.pack(item))[0] if kind == "float" else int(item))
    return tuple(layout)


TYPE_OF[Handle] = lambda handle: handle.type


@functools.cache
def with_type_tags(kind: HandleType, *tags: str) -> HandleType:
    """The type of the same block with tags: fields without words, which state facts about its contents.

    A kernel that is compiled for the tagged type and called by address omits the code that the tags make unnecessary.
    """
    return handle_type(kind.layout + tuple((tag, 0, ()) for tag in tags))


def skip_when_tagged(tag: str, otherwise: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorate a helper whose first argument is a Handle: kernels call `otherwise` instead where the Handle's type has the tag."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        def select(handle: Any, *arguments: Any) -> Any:
            return function(handle, *arguments)

        @overload(select)
        def _in_kernels(handle, *arguments):
            if handle.field(tag) is None:
                return lambda handle, *arguments: function(handle, *arguments)
            return lambda handle, *arguments: otherwise(handle, *arguments)

        return select

    return decorate
