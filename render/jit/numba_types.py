"""Numba's side of value_types.py: conversion of types, packed structs in kernels, and the entry function that Python calls."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default as register_model
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.np import numpy_support
from numba.np.arrayobj import make_array, populate_array

from ..simd.vector_type import Vector
from . import cache_key, value_types
from .value_types import HandleType, ValueType

WORD = 8  # bytes
_I64, _BYTES = llvm.IntType(64), llvm.IntType(8).as_pointer()


class NumbaHandle(types.Type, HandleType):
    """Numba type of a packed tuple. Its name is short, because every symbol name contains it."""

    def __init__(self, kind: HandleType) -> None:
        self.layout = kind.layout
        types.Type.__init__(self, name=f"Handle{kind.digest}")


def to_numba(kind: ValueType) -> types.Type:
    """The Numba type of a type."""
    numba_kind = _numba_types.get(kind)
    if numba_kind is None:
        numba_kind = _numba_types[kind] = _to_numba(kind)
    return numba_kind


_numba_types: dict[ValueType, types.Type] = {}


def _to_numba(kind: ValueType) -> types.Type:
    if isinstance(kind, value_types.Scalar):
        return getattr(types, kind.name)
    if isinstance(kind, value_types.Array):
        element = numpy_support.from_dtype(np.dtype(kind.dtype))
        return types.Array(element, kind.ndim, kind.layout, readonly=not kind.writeable, aligned=kind.aligned)
    if isinstance(kind, value_types.Tuple):
        return types.BaseTuple.from_types([to_numba(item) for item in kind.items], kind.cls)  # pyright: ignore[reportReturnType]
    if isinstance(kind, value_types.Vector):
        return Vector(kind.kind, kind.bits, kind.lanes)
    assert isinstance(kind, HandleType)
    return NumbaHandle(kind)


def from_numba(kind: Any) -> ValueType:
    """The type of a Numba type of results. Raises TypeError for a type that kernels do not return."""
    kind = types.unliteral(kind)
    if isinstance(kind, types.NoneType):
        return value_types.NONE
    if isinstance(kind, types.Boolean):
        return value_types.BOOL
    if isinstance(kind, types.Number):
        return value_types.scalar(kind.name)
    if isinstance(kind, Vector):
        return value_types.vector(kind.kind, kind.bits, kind.lanes)
    if isinstance(kind, types.BaseTuple):
        named = kind.instance_class if isinstance(kind, types.BaseNamedTuple) else None  # pyright: ignore[reportAttributeAccessIssue]
        return value_types.tuple_type(named, tuple(map(from_numba, kind)))  # pyright: ignore[reportArgumentType]
    raise TypeError(f"a kernel does not return {kind}")


class UnknownType(Exception):
    """A type that a file cannot describe."""


def to_plain(kind: Any) -> Any:
    """A type as lists, strings and numbers, equal for equal types in all processes. Raises UnknownType."""
    if isinstance(kind, NumbaHandle):
        return value_types.handle_type(kind.layout).plain
    if isinstance(kind, types.BaseNamedTuple):
        return ["named", *_class(kind.instance_class), [to_plain(item) for item in kind.types]]  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(kind, types.BaseTuple):
        starred = isinstance(kind, types.StarArgTuple | types.StarArgUniTuple)
        return ["starred" if starred else "tuple", [to_plain(item) for item in kind.types]]  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(kind, Vector):
        return ["vector", kind.kind, kind.bits, kind.lanes]
    if isinstance(kind, types.Array) and isinstance(kind.dtype, types.Number | types.Boolean):
        return ["array", numpy_support.as_dtype(kind.dtype).str, kind.ndim, kind.layout, not kind.mutable, kind.aligned]
    if isinstance(kind, types.Optional):
        return ["optional", to_plain(kind.type)]
    if isinstance(kind, types.Literal):
        value = kind.literal_value
        return ["literal", value] if isinstance(value, bool | int | str) else ["literal", type(kind).__name__, repr(value)]
    text = str(kind)
    if " at 0x" in text:
        raise UnknownType
    return [type(kind).__name__, text]


def _class(cls: Any) -> tuple[str, str, str]:
    """Module, name and definition of the class of a NamedTuple."""
    name = cls.__module__, cls.__qualname__
    return *name, cache_key.digest_of(*name) if cache_key.is_ours(cls.__module__) else ",".join(cls._fields)


def from_plain(data: Any) -> Any:
    """The type of plain data. Raises UnknownType for types that `to_plain` only names."""
    name, *parts = data
    if name == "handle":
        return to_numba(value_types.from_plain(data))
    if name == "named":
        return types.BaseTuple.from_types([from_plain(item) for item in parts[3]], value_types.class_of(parts[0], parts[1]))
    if name == "tuple":
        return types.BaseTuple.from_types([from_plain(item) for item in parts[0]])
    if name == "vector":
        return Vector(*parts)
    if name == "array":
        dtype, ndim, layout, readonly, aligned = parts
        return types.Array(numpy_support.from_dtype(np.dtype(dtype)), ndim, layout, readonly=readonly, aligned=aligned)
    if name == "optional":
        return types.Optional(from_plain(parts[0]))
    if name == "literal" and len(parts) == 1:
        return types.literal(parts[0])
    if name in ("Integer", "Float", "Boolean", "NoneType"):
        return getattr(types, parts[0])
    raise UnknownType


# --- packed structs ------------------------------------------------------------------------------------------------------


def _field_type(kind: Any) -> types.Type:
    """Numba type of a field of a layout."""
    return to_numba(value_types.field_type(kind))


@register_model(NumbaHandle)
class _HandleModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: NumbaHandle) -> None:
        super().__init__(manager, kind, _BYTES)


@infer_getattr
class _HandleAttributes(AttributeTemplate):
    key = NumbaHandle

    def generic_resolve(self, typ: NumbaHandle, attr: str) -> types.Type | None:
        field = typ.field(attr)
        return _field_type(field[1]) if field else None


@lower_getattr_generic(NumbaHandle)
def _load(context: Any, builder: Any, typ: NumbaHandle, value: Any, attr: str) -> Any:
    field = typ.field(attr)
    assert field is not None
    word, kind = field
    if isinstance(kind, tuple) and not (kind and kind[0] in ("array", "handle")):
        return value  # a nested tuple: its words count from the start of the block
    if kind == "float":
        return _word(builder, value, word, llvm.DoubleType())
    integer = _word(builder, value, word, _I64)
    if kind == "int":
        return integer
    if kind == "bool":
        return builder.icmp_signed("!=", integer, llvm.Constant(integer.type, 0))
    if kind[0] == "handle":
        return builder.inttoptr(integer, _BYTES)
    length = _word(builder, value, word + 1, _I64)
    return _array(context, builder, _field_type(kind), integer, [length, *(llvm.Constant(_I64, n) for n in kind[2])])


def _array(context: Any, builder: Any, kind: Any, data: Any, shape: list[Any], strides: list[Any] | None = None) -> Any:
    """An array value from its address and shape; C-contiguous without strides."""
    array = make_array(kind)(context, builder)
    item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    if strides is None:
        strides, step = [], llvm.Constant(_I64, item)
        for n in reversed(shape):
            strides.insert(0, step)
            constant = isinstance(n, llvm.Constant) and isinstance(step, llvm.Constant)
            step = llvm.Constant(_I64, step.constant * n.constant) if constant else builder.mul(step, n)  # pyright: ignore
    populate_array(array, builder.inttoptr(data, array.data.type), shape, strides, llvm.Constant(_I64, item), None)
    return array._getvalue()


def _word(builder: Any, value: Any, word: int, kind: Any) -> Any:
    place = builder.gep(value, [llvm.Constant(_I64, word * WORD)])
    loaded = builder.load(builder.bitcast(place, kind.as_pointer()))
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


# --- the entry -----------------------------------------------------------------------------------------------------------

ENTRY = "maquette_entry"


def add_entry(context: Any, library: Any, described: Any, kinds: tuple[ValueType, ...], result: ValueType) -> None:
    """Add the function that Python calls: ENTRY(words) loads the arguments, calls the kernel and writes its result behind them.

    It returns the kernel's status, 0 without an error.
    """
    module = library.create_ir_module(ENTRY)
    function = llvm.Function(module, llvm.FunctionType(llvm.IntType(32), [_I64.as_pointer()]), ENTRY)
    builder = llvm.IRBuilder(function.append_basic_block("entry"))
    words = _Words(context, builder, function.args[0])
    values = [words.read(kind) for kind in kinds]
    native = context.declare_function(module, described)
    numba_kinds = tuple(map(to_numba, kinds))
    status, returned = context.call_conv.call_function(builder, native, described.restype, numba_kinds, values, attrs=("noinline",))
    with builder.if_then(status.is_ok, likely=True):
        words.write(result, context.cast(builder, returned, described.restype, to_numba(result)))
    builder.ret(status.code)
    library.add_ir_module(module)


class _Words:
    """The words of arguments, and then of the result, from a pointer on."""

    def __init__(self, context: Any, builder: Any, base: Any) -> None:
        self.context, self.builder, self.base, self.at = context, builder, base, 0

    def _place(self) -> Any:
        self.at += 1
        return self.builder.gep(self.base, [llvm.Constant(_I64, self.at - 1)])

    def _next(self) -> Any:
        return self.builder.load(self._place())

    def read(self, kind: ValueType) -> Any:
        """The next argument."""
        context, b, numba_kind = self.context, self.builder, to_numba(kind)
        if isinstance(kind, value_types.Tuple):
            return context.make_tuple(b, numba_kind, [self.read(item) for item in kind.items])
        if isinstance(kind, value_types.Array):
            data = self._next()
            shape = [self._next() for _ in range(kind.ndim)]
            return _array(context, b, numba_kind, data, shape, None if kind.layout == "C" else [self._next() for _ in range(kind.ndim)])
        if isinstance(kind, HandleType):
            return b.inttoptr(self._next(), _BYTES)
        if not kind.format:
            return cgutils.get_null_value(context.get_value_type(numba_kind))
        word = self._next()
        if kind.format == "d":
            return context.cast(b, b.bitcast(word, llvm.DoubleType()), types.float64, numba_kind)
        if kind is value_types.BOOL:
            return b.icmp_signed("!=", word, llvm.Constant(_I64, 0))
        return context.cast(b, word, types.int64, numba_kind)

    def write(self, kind: ValueType, value: Any) -> None:
        """Write a result."""
        context, b, numba_kind = self.context, self.builder, to_numba(kind)
        if isinstance(kind, value_types.Tuple):
            for item, part in zip(kind.items, cgutils.unpack_tuple(b, value, len(kind.items)), strict=True):
                self.write(item, part)
        elif kind.format == "d":
            b.store(b.bitcast(context.cast(b, value, numba_kind, types.float64), _I64), self._place())
        elif kind is value_types.BOOL:
            b.store(b.zext(value, _I64), self._place())
        elif kind.format:
            b.store(context.cast(b, value, numba_kind, types.int64), self._place())
