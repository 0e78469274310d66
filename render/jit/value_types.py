"""Types of values that kernels receive and return, without Numba: numbers, arrays, tuples, NamedTuples, packed structs and vectors.

Equal types are one object. A type packs a value into 64-bit words for a kernel's entry function, and reads a result from such words.
`plain` and `from_plain` convert a type to and from lists and strings, for files and for other processes.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import mmap
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

_BYTE = ctypes.c_char
_C, _F, _ALIGNED, _WRITEABLE = 1, 2, 0x100, 0x400  # bits of ndarray.flags.num

# A layout describes a packed tuple: ((name, word, kind), …). A kind is a layout, ("array", dtype, row shape), ("handle", type), "int",
# "float" or "bool".
Layout = tuple[tuple[str, int, Any], ...]


class ValueType:
    """A type of values in kernels; `format` has one letter of `struct` for each 64-bit word."""

    format = ""

    def pack(self, value: Any, words: list[Any]) -> None:
        """Append the words of a value. Raises TypeError for types that Python does not pass to kernels."""
        raise TypeError(f"a value of type {self} cannot be passed to a kernel")

    def unpack(self, words: Iterator[Any]) -> Any:
        """Read a result from its words. Raises TypeError for types that kernels do not return to Python."""
        raise TypeError(f"a kernel cannot return a value of type {self}")

    @functools.cached_property
    def plain(self) -> Any:
        """This type as nested lists, strings and integers."""
        raise NotImplementedError

    @functools.cached_property
    def text(self) -> str:
        """This type as text, equal for equal types in all processes."""
        return json.dumps(self.plain, separators=(",", ":"))

    def __repr__(self) -> str:
        return self.text


class Scalar(ValueType):
    """A number, a boolean, or None."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.format = "" if name == "none" else "d" if name.startswith("float") else "Q" if name == "uint64" else "q"

    def pack(self, value: Any, words: list[Any]) -> None:
        if self.name == "boolean":
            words.append(bool(value))
        elif self.format:
            words.append(value)

    def unpack(self, words: Iterator[Any]) -> Any:
        if not self.format:
            return None
        number = next(words)
        return bool(number) if self.name == "boolean" else number

    @functools.cached_property
    def plain(self) -> Any:
        return self.name


class Array(ValueType):
    """An array: its data address, its shape, and its strides unless it is C-contiguous."""

    def __init__(self, dtype: str, ndim: int, layout: str, writeable: bool, aligned: bool) -> None:
        self.dtype, self.ndim, self.layout, self.writeable, self.aligned = dtype, ndim, layout, writeable, aligned
        self.format = "q" * (1 + ndim * (1 if layout == "C" else 2))

    def pack(self, value: Any, words: list[Any]) -> None:
        words.append(address(value))
        words.extend(value.shape)
        if self.layout != "C":
            words.extend(value.strides)

    @functools.cached_property
    def plain(self) -> Any:
        return ["array", self.dtype, self.ndim, self.layout, self.writeable, self.aligned]


class Tuple(ValueType):
    """A tuple, or a NamedTuple of class `cls`."""

    def __init__(self, cls: type | None, items: tuple[ValueType, ...]) -> None:
        self.cls, self.items = cls, items
        self.format = "".join(item.format for item in items)

    def pack(self, value: Any, words: list[Any]) -> None:
        for kind, item in zip(self.items, value, strict=True):
            kind.pack(item, words)

    def unpack(self, words: Iterator[Any]) -> Any:
        values = tuple(kind.unpack(words) for kind in self.items)
        return values if self.cls is None else self.cls(*values)

    @functools.cached_property
    def plain(self) -> Any:
        items = [item.plain for item in self.items]
        if self.cls is None:
            return ["tuple", items]
        return ["named", self.cls.__module__, self.cls.__qualname__, list(self.cls._fields), items]  # pyright: ignore[reportAttributeAccessIssue]


class Vector(ValueType):
    """`lanes` values of 32 or 64 bits of a kind: "f" float, "i" int, "u" unsigned, "m" mask. Only kernels pass vectors."""

    def __init__(self, kind: str, bits: int, lanes: int) -> None:
        self.kind, self.bits, self.lanes = kind, bits, lanes

    @functools.cached_property
    def plain(self) -> Any:
        return ["vector", self.kind, self.bits, self.lanes]


class HandleType(ValueType):
    """A packed tuple, see packed_struct.py. Equal layouts share a type."""

    format = "q"

    def __init__(self, layout: Layout) -> None:
        self.layout = layout

    def pack(self, value: Any, words: list[Any]) -> None:
        words.append(value.address)

    def field(self, name: str) -> tuple[int, Any] | None:
        """(word, kind) of a field or of a field of a nested tuple ("outer.inner"), not of another Handle; None if there is none."""
        place, layout = None, self.layout
        for part in name.split("."):
            place = next(((word, kind) for field, word, kind in layout if field == part), None)
            layout = place[1] if place and isinstance(place[1], tuple) and place[1][:1] != ("handle",) else ()
        return place

    @functools.cached_property
    def plain(self) -> Any:
        return ["handle", _plain_layout(self.layout)]

    @functools.cached_property
    def digest(self) -> str:
        """A short name, equal for equal layouts."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:12]


def _plain_layout(layout: Layout) -> list[Any]:
    return [[name, word, _plain_kind(kind)] for name, word, kind in layout]


def _plain_kind(kind: Any) -> Any:
    if isinstance(kind, str):
        return kind
    if kind and kind[0] == "array":
        return ["array", kind[1], list(kind[2])]
    if kind and kind[0] == "handle":
        return kind[1].plain
    return ["layout", _plain_layout(kind)]


def _kind_of_plain(description: Any) -> Any:
    if isinstance(description, str):
        return description
    if description[0] == "array":
        return "array", description[1], tuple(description[2])
    if description[0] == "handle":
        return "handle", from_plain(description)
    return _layout_of_plain(description[1])


def _layout_of_plain(description: Any) -> Layout:
    return tuple((name, word, _kind_of_plain(kind)) for name, word, kind in description)


def field_type(kind: Any) -> ValueType:
    """The type of a field of a layout."""
    if isinstance(kind, str):
        return {"int": INT64, "float": FLOAT64, "bool": BOOL}[kind]
    if kind and kind[0] == "array":
        return array_type(kind[1], 1 + len(kind[2]))
    if kind and kind[0] == "handle":
        return kind[1]
    return handle_type(kind)


scalar = functools.cache(Scalar)
tuple_type = functools.cache(Tuple)
vector = functools.cache(Vector)
handle_type = functools.cache(HandleType)
_array = functools.cache(Array)

NONE, BOOL, INT64, FLOAT64, FLOAT32 = (scalar(name) for name in ("none", "boolean", "int64", "float64", "float32"))


def array_type(dtype: Any, ndim: int) -> Array:
    """A C-contiguous array that kernels may write to."""
    return _array(np.dtype(dtype).str, ndim, "C", True, True)


def tuple_of(*items: ValueType) -> Tuple:
    """A tuple of these types."""
    return tuple_type(None, items)


def from_plain(description: Any) -> ValueType:
    """The type that `description` describes. Raises ValueError, LookupError, TypeError, AttributeError or ImportError for other data."""
    if isinstance(description, str):
        return scalar(description)
    name, *parts = description
    if name == "array":
        return _array(*parts)
    if name == "tuple":
        return tuple_type(None, tuple(map(from_plain, parts[0])))
    if name == "named":
        cls = class_of(parts[0], parts[1])
        if list(cls._fields) != parts[2]:
            raise ValueError(f"{cls} has other fields")
        return tuple_type(cls, tuple(map(from_plain, parts[3])))
    if name == "vector":
        return vector(*parts)
    if name == "handle":
        return handle_type(_layout_of_plain(parts[0]))
    raise ValueError(f"{name} is not a type of values")


def class_of(module: str, name: str) -> Any:
    """The class of a dotted name in a module."""
    return functools.reduce(getattr, name.split("."), import_module(module))


TYPE_OF: dict[type, Callable[[Any], ValueType]] = {}
"""The type of a value by its class."""


def typeof(value: Any) -> ValueType:
    """The type of a value in kernels. Raises TypeError for values that kernels do not take."""
    cls = type(value)
    rule = TYPE_OF.get(cls)
    if rule is None:
        rule = TYPE_OF[cls] = _rule(cls)
    return rule(value)


def _rule(cls: type) -> Callable[[Any], ValueType]:
    if issubclass(cls, np.ndarray):
        return _typeof_array
    if issubclass(cls, tuple):
        named = cls if hasattr(cls, "_fields") else None
        return lambda value: tuple_type(named, tuple(map(typeof, value)))
    if issubclass(cls, np.generic):
        number = BOOL if cls is np.bool_ else scalar(np.dtype(cls).name)
        return lambda value: number
    kind = NONE if cls is type(None) else BOOL if cls is bool else INT64 if issubclass(cls, int) else FLOAT64 if cls is float else None
    if kind is not None:
        return lambda value: kind
    raise TypeError(f"a kernel takes no {cls.__name__}")


_arrays: dict[Any, Array] = {}


def _typeof_array(value: NDArray[Any]) -> Array:
    flags = value.flags.num
    key = value.dtype, value.ndim, flags
    kind = _arrays.get(key)
    if kind is None:
        layout = "C" if flags & _C else "F" if flags & _F else "A"
        kind = _arrays[key] = _array(value.dtype.str, value.ndim, layout, bool(flags & _WRITEABLE), bool(flags & _ALIGNED))
    return kind


NO_ROWS = 1 << 16  # bytes of zeros on both sides of the address of an empty array


@functools.cache
def _zeros() -> NDArray[np.uint8]:
    """(2 NO_ROWS,) zeros that nobody can write to."""
    return np.frombuffer(mmap.mmap(-1, 2 * NO_ROWS, access=mmap.ACCESS_READ), np.uint8)


@functools.cache
def address_of_zeros() -> int:
    """Address amid zeros, which kernels receive for an empty array.

    Lanes that a mask excludes may read row 0 of a table without rows: they get zeros, and the process does not end.
    MAQUETTE_CHECKED=1 reports such a read.
    """
    return int(_zeros().ctypes.data) + NO_ROWS


def address(array: NDArray[Any]) -> int:
    """Address of an array's elements; for an empty array of zeros, see `address_of_zeros`.

    `array.ctypes.data` takes three times as long, and longer than the rest of packing.
    """
    if not array.size:
        return address_of_zeros()
    if not array.flags.writeable or not array.flags.c_contiguous:
        return int(array.ctypes.data)
    return ctypes.addressof(_BYTE.from_buffer(array))  # pyright: ignore[reportArgumentType]
