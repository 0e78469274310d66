"""Indexing of arrays by vectors in kernels: `array[index_vector]` and `array[i, 0, j]` are gathers.

The result has the lane width of the index: 4-byte indices load float32 and float64 arrays as f32 lanes, 8-byte indices as f64 lanes;
integers likewise. So lane code keeps one width without conversions. Indices are unchecked, and negative ones do not wrap around. With
4-byte indices an array must have fewer than 2³¹ elements. All lanes are read: clamp unused indices to an existing row.
"""

from __future__ import annotations

import operator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, Signature, infer_global, signature
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array

from . import bounds_check
from .gather_scatter import emit_gather
from .llvm_expr import Value
from .memory import element_shape
from .vector_type import Vector, value


class Gather:
    """Key of this implementation, beside Numba's own indexing."""


def _indices(array: types.Type, index: types.Type) -> tuple[types.Type, ...] | None:
    """Types of the indices if all dimensions are indexed by integers, at least one of them a vector; else None."""
    kinds = tuple(index.types) if isinstance(index, types.BaseTuple) else (index,)  # pyright: ignore[reportAttributeAccessIssue]
    vectors = [k for k in kinds if isinstance(k, Vector)]
    if not vectors or element_shape(array) is None or len(kinds) != array.ndim:  # pyright: ignore[reportAttributeAccessIssue]
        return None
    if any(k.kind not in "iu" or (k.bits, k.lanes) != (vectors[0].bits, vectors[0].lanes) for k in vectors):
        return None
    return kinds if all(isinstance(k, Vector | types.Integer) for k in kinds) else None


@infer_global(operator.getitem)  # pyright: ignore[reportOptionalCall]
class _GetItem(AbstractTemplate):
    key = operator.getitem

    def generic(self, args: Any, kws: Any) -> Signature | None:
        array, index = args
        kinds = _indices(array, index)
        shape = element_shape(array)
        if kinds is None or shape is None:
            return None
        first = next(k for k in kinds if isinstance(k, Vector))
        return signature(Vector(shape[0], first.bits, first.lanes), array, index)

    def get_impl_key(self, sig: Any) -> Any:
        return Gather


@lower_builtin(Gather, types.Array, types.Any)
def _gather(context: Any, builder: Any, sig: Signature, args: Any) -> Any:
    array, index = sig.args
    result = sig.return_type
    kinds = _indices(array, index)
    assert kinds is not None
    raw = cgutils.unpack_tuple(builder, args[1], len(kinds)) if isinstance(index, types.BaseTuple) else [args[1]]
    struct = make_array(array)(context, builder, value=args[0])
    sizes = cgutils.unpack_tuple(builder, struct.shape, array.ndim)
    # Scalar indices move the base address; only the vector indices are computed in lanes.
    base, lanes, step = ir.Constant(ir.IntType(64), 0), None, ir.Constant(ir.IntType(64), 1)
    for kind, raw_index, size in reversed(list(zip(kinds, raw, sizes, strict=True))):
        if isinstance(kind, Vector):
            part = value(builder, raw_index, kind)
            bounds_check.check_lanes(builder, size, part)
            part = part * Value(builder, step, "i", 64).to(part.kind, part.bits).splat(part.lanes)
            lanes = part if lanes is None else lanes + part
        else:
            base = builder.add(base, builder.mul(context.cast(builder, raw_index, kind, types.int64), step))
        step = builder.mul(step, size)
    assert lanes is not None
    elements = emit_gather(context, builder, array, builder.gep(struct.data, [base]), lanes)
    return elements.to(result.kind, result.bits).raw
