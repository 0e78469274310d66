"""Across lanes: one of them, all of them together, and lanes in memory; in numpy and in kernels. See lanes.py."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from .. import simd
from ..jit.kernel import HELPER, helper
from ..types import Lane, Vec
from .kinds import WIDTH
from .ops import full_like


def _vector(kind: Any) -> bool:
    return isinstance(kind, simd.Vector)


def is_mask(kind: Any) -> bool:
    """Whether a Numba type is one of a kernel's masks."""
    return isinstance(kind, types.Boolean) or (isinstance(kind, simd.Vector) and kind.kind == "m")


def width(like: Lane) -> int:
    """How many lanes a kernel's value has."""
    return np.size(like)


@overload(width, jit_options=HELPER)
def _width(like):
    count = like.lanes if _vector(like) else 1
    return lambda like: count


def lane(x: Lane, k: int) -> Lane:
    """Lane k of a value, a scalar."""
    return np.ravel(x)[k]


@overload(lane, jit_options=HELPER)
def _lane(x, k):
    if _vector(x):
        return lambda x, k: simd.lane(x, k)
    return lambda x, k: x


def with_lane(x: Lane, k: int, value: Lane) -> Lane:
    """A value with another lane k."""
    changed = np.array(x)
    changed[k] = value
    return changed


@overload(with_lane, jit_options=HELPER)
def _with_lane(x, k, value):
    if _vector(x):
        return lambda x, k, value: simd.with_lane(x, k, value)
    return lambda x, k, value: value


@helper
def lane3(a: Vec, k: int) -> Vec:
    """Lane k of a vector."""
    return lane(a[0], k), lane(a[1], k), lane(a[2], k)


def load(table: Any, row: int) -> Lane:
    """A row of a (rows, WIDTH) table as a value; in kernels also of a flat one."""
    return table[row]


@overload(load, jit_options=HELPER)
def _load(table, row):
    if WIDTH > 1:
        return lambda table, row: simd.load(table, row * WIDTH, WIDTH)
    return lambda table, row: simd.read(table, row)


def load_at(numbers: Any, first: int) -> Lane:
    """WIDTH numbers from the first on, as they are."""
    return np.asarray(numbers).ravel()[first : first + WIDTH]


@overload(load_at, jit_options=HELPER)
def _load_at(numbers, first):
    if WIDTH > 1:
        return lambda numbers, first: simd.load(numbers, first, WIDTH)
    return lambda numbers, first: simd.read(numbers, first)


def load_rows3(rows: Any, first: int) -> Vec:
    """The columns of WIDTH rows of three numbers, as float64; in kernels of whatever numbers there are."""
    return tuple(np.asarray(rows[first : first + WIDTH], np.float64).T)


@overload(load_rows3, jit_options=HELPER)
def _load_rows3(rows, first):
    if WIDTH > 1:
        what = getattr(simd, f"f64x{WIDTH}")
        return lambda rows, first: simd.load3(rows, first * 3, what)
    return lambda rows, first: (np.float64(rows[first, 0]), np.float64(rows[first, 1]), np.float64(rows[first, 2]))


def load_row(numbers: Any, first: int) -> Lane:
    """WIDTH numbers from the first on, as float64."""
    return np.asarray(numbers[first : first + WIDTH], np.float64)


@overload(load_row, jit_options=HELPER)
def _load_row(numbers, first):
    if WIDTH > 1:
        what = getattr(simd, f"f64x{WIDTH}")
        return lambda numbers, first: simd.load(numbers, first, what)
    return lambda numbers, first: np.float64(simd.read(numbers, first))  # whatever the array's shape, as `load` has it


def store_row(numbers: Any, first: int, x: Lane) -> None:
    """Write a value to WIDTH elements from the first on."""
    numbers[first : first + WIDTH] = x


@overload(store_row, jit_options=HELPER)
def _store_row(numbers, first, x):
    if _vector(x):
        return lambda numbers, first, x: simd.store(numbers, first, x)
    return lambda numbers, first, x: simd.write(numbers, first, x)


def store(table: Any, row: int, x: Lane) -> None:
    """Write a value to a row of a (rows, WIDTH) table; in kernels also of a flat one."""
    table[row] = x


@overload(store, jit_options=HELPER)
def _store(table, row, x):
    if _vector(x):
        return lambda table, row, x: simd.store(table, row * WIDTH, x)
    return lambda table, row, x: simd.write(table, row, x)


def write_lanes(table: Any, row: int, k: int, x: Lane, mine: Lane) -> None:
    """Write a value to a row of a (rows, WIDTH) table in the lanes of a mask, or a number to lane k of it; in kernels the table is flat."""
    if np.ndim(x):
        table[row][mine] = x[mine]
    elif mine:
        table[row][k] = x


@overload(write_lanes, jit_options=HELPER)
def _write_lanes(table, row, k, x, mine):
    if _vector(x):
        return lambda table, row, k, x, mine: simd.masked_store(table, row * WIDTH, x, mine)

    def write(table, row, k, x, mine):
        if mine:
            simd.write(table, row * WIDTH + k, x)

    return write


def to_float32(x: Lane) -> Lane:
    """Numbers as single precision has them, in double precision."""
    return np.float64(np.float32(x))


@overload(to_float32, jit_options=HELPER)
def _rounded(x):
    if _vector(x):
        return lambda x: simd.to_f64(simd.to_f32(x))
    return lambda x: np.float64(np.float32(x))


def mask_of(bits: int, like: Lane) -> Lane:
    """The mask whose lane k is bit k of a number, in the lanes of `like`."""
    return (bits >> np.arange(np.size(like)) & 1 != 0).reshape(np.shape(like))


@overload(mask_of, jit_options=HELPER)
def _mask_of(bits, like):
    if _vector(like):
        return lambda bits, like: simd.mask_from_bits(bits, like)
    return lambda bits, like: bits != 0


def lane_indices(first: int) -> Lane:
    """first, first + 1, … in a kernel's WIDTH lanes of int64."""
    return first + np.arange(WIDTH)


@overload(lane_indices, jit_options=HELPER)
def _numbered(first):
    if WIDTH > 1:
        make = getattr(simd, f"i64x{WIDTH}")
        return lambda first: first + simd.iota(make(0))
    return lambda first: np.int64(first)


def total(x: Lane) -> Lane:
    """The sum of all lanes."""
    return np.sum(x)


@overload(total, jit_options=HELPER)
def _total(x):
    if _vector(x):
        return lambda x: simd.sum_of(x)
    return lambda x: x


def reduce_min(x: Lane) -> Lane:
    """The smallest of all lanes."""
    return np.min(x)


@overload(reduce_min, jit_options=HELPER)
def _least(x):
    if _vector(x):
        return lambda x: simd.min_of(x)
    return lambda x: x


def reduce_max(x: Lane) -> Lane:
    """The largest of all lanes."""
    return np.max(x)


@overload(reduce_max, jit_options=HELPER)
def _most(x):
    if _vector(x):
        return lambda x: simd.max_of(x)
    return lambda x: x


def count(mask: Lane) -> Lane:
    """How many lanes of a mask are set."""
    return np.count_nonzero(mask)


@overload(count, jit_options=HELPER)
def _count(mask):
    if _vector(mask):
        return lambda mask: simd.count(mask)
    return lambda mask: 1 if mask else 0


def bits(mask: Lane) -> Lane:
    """The lanes of a mask as the bits of a number."""
    return np.sum(np.ravel(mask) << np.arange(np.size(mask)))


@overload(bits, jit_options=HELPER)
def _bits(mask):
    if _vector(mask):
        return lambda mask: simd.bits(mask)
    return lambda mask: np.int64(mask)


def uniform_group(values: Lane, mask: Lane) -> tuple[Lane, Lane]:
    """Lanes of a mask that can be handled together, and what they have in common: all lanes here, each with its own value.

    In vectors: the value of the first lane of the mask, as a scalar, and the lanes of the mask that share it.
    """
    return values, mask


@overload(uniform_group, jit_options=HELPER)
def _together(values, mask):
    if _vector(values):

        def first(values, mask):
            value = simd.lane(values, simd.trailing_zeros(simd.bits(mask)))
            return value, mask & (values == value)

        return first
    return lambda values, mask: (values, mask)


def stack_store(stack: Any, place: Lane, field: int, value: Lane, mask: Lane) -> None:
    """Write stack[place, field, lane] in the lanes of a mask; `stack` is (rows, fields, lanes)."""
    lane = np.flatnonzero(np.broadcast_to(mask, stack.shape[2:]))
    stack[np.broadcast_to(place, stack.shape[2:])[lane], field, lane] = np.broadcast_to(value, stack.shape[2:])[lane]


@overload(stack_store, jit_options=HELPER)
def _put(stack, place, field, value, mask):
    if _vector(mask):

        def scatter(stack, place, field, value, mask):
            n = stack.shape[2]
            simd.scatter(stack, (place * stack.shape[1] + field) * n + simd.iota(place), full_like(mask, value), mask)

        return scatter

    def write(stack, place, field, value, mask):
        if mask:
            stack[place, field, 0] = value

    return write


def put_at(array: Any, place: Lane, value: Lane, mask: Lane) -> None:
    """Write array[place] in the lanes of a mask; lanes have places of their own."""
    array[np.broadcast_to(place, np.shape(mask))[mask]] = np.broadcast_to(value, np.shape(mask))[mask]


@overload(put_at, jit_options=HELPER)
def _put_at(array, place, value, mask):
    if _vector(mask):
        return lambda array, place, value, mask: simd.scatter(array, place, value, mask)

    def write(array, place, value, mask):
        if mask:
            array[place] = value

    return write


def stack_load(stack: Any, place: Lane, field: int) -> Lane:
    """Read stack[place, field, lane]."""
    return stack[place, field, np.arange(stack.shape[2])]


@overload(stack_load, jit_options=HELPER)
def _take(stack, place, field):
    if _vector(place):
        return lambda stack, place, field: simd.gather(stack, (place * stack.shape[1] + field) * stack.shape[2] + simd.iota(place))
    return lambda stack, place, field: stack[place, field, 0]


@helper
def put3(stack: Any, place: Lane, field: int, value: Vec, mask: Lane) -> None:
    """Write a vector to three fields."""
    stack_store(stack, place, field, value[0], mask)
    stack_store(stack, place, field + 1, value[1], mask)
    stack_store(stack, place, field + 2, value[2], mask)


@helper
def take3(stack: Any, place: Lane, field: int) -> Vec:
    """Read a vector from three fields."""
    return stack_load(stack, place, field), stack_load(stack, place, field + 1), stack_load(stack, place, field + 2)


def narrow(nest: Any) -> Any:
    """A NamedTuple of numbers, or of tuples of them, with its floats as float32 (in kernels)."""
    return nest


@overload(narrow, jit_options=HELPER)
def _narrow_nest(nest):
    made: dict[str, Any] = {"single": np.float32}

    def said(kind, at: str) -> str:
        if hasattr(kind, "types"):
            name = f"kind{len(made)}"
            named = isinstance(kind, types.BaseNamedTuple)
            made[name] = getattr(kind, "instance_class", None)
            parts = "".join(f"{said(part, f'{at}[{k}]')}, " for k, part in enumerate(kind.types))
            return f"{name}({parts})" if named else f"({parts})"
        return f"single({at})" if isinstance(kind, types.Float) else at

    exec(f"def narrowed(nest): return {said(nest, 'nest')}", made)  # Numba has no loops over tuples of several types
    return made["narrowed"]


# --- two vectors side by side -------------------------------------------------------------------------------------------


def is_twice(x: Any) -> bool:
    """Whether a value of this Numba type is two vectors of lanes side by side."""
    return isinstance(x, simd.Vector) and x.lanes > WIDTH


@helper
def joined3(a: Vec, b: Vec) -> Vec:
    return simd.joined(a[0], b[0]), simd.joined(a[1], b[1]), simd.joined(a[2], b[2])


@helper
def low3(a: Vec) -> Vec:
    return simd.low_half(a[0]), simd.low_half(a[1]), simd.low_half(a[2])


@helper
def high3(a: Vec) -> Vec:
    return simd.high_half(a[0]), simd.high_half(a[1]), simd.high_half(a[2])
