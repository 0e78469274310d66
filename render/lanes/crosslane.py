"""Cross-lane operations: single lanes, reductions, and loads and stores of lanes; in numpy and in kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..simd.registration import overload, types
from ..types import Lane, Vec
from .kinds import WIDTH
from .ops import full_like


def _is_vector(kind: Any) -> bool:
    return isinstance(kind, simd.Vector)


def is_mask(kind: Any) -> bool:
    """Return whether a Numba type is a mask of a kernel."""
    return isinstance(kind, types.Boolean) or (isinstance(kind, simd.Vector) and kind.kind == "m")


def spreader(name: str) -> Callable[[Any], Any]:
    """Make a function of kernels that broadcasts a number to the lanes of a vector type of this name, such as f32x8."""

    def spread(number: Any) -> Any:
        raise NotImplementedError("in kernels only")

    @overload(spread)
    def _in_kernels(number):
        make = getattr(simd, name)
        return lambda number: make(number)

    return spread


def width(like: Lane) -> int:
    """Count the lanes of a kernel value."""
    return np.size(like)


@overload(width)
def _width(like):
    count = like.lanes if _is_vector(like) else 1
    return lambda like: count


def lane(x: Lane, k: int) -> Lane:
    """Extract lane k as a scalar."""
    return np.ravel(x)[k]


@overload(lane)
def _lane(x, k):
    if _is_vector(x):
        return lambda x, k: simd.lane(x, k)
    return lambda x, k: x


def with_lane(x: Lane, k: int, value: Lane) -> Lane:
    """Replace lane k."""
    changed = np.array(x)
    changed[k] = value
    return changed


@overload(with_lane)
def _with_lane(x, k, value):
    if _is_vector(x):
        return lambda x, k, value: simd.with_lane(x, k, value)
    return lambda x, k, value: value


@helper
def lane3(a: Vec, k: int) -> Vec:
    """Extract lane k of a 3D vector."""
    return lane(a[0], k), lane(a[1], k), lane(a[2], k)


def load(table: Any, row: int) -> Lane:
    """Load a row of a (rows, WIDTH) table; in kernels the table may be flat."""
    return table[row]


@overload(load)
def _load(table, row):
    if WIDTH > 1:
        return lambda table, row: simd.load(table, row * WIDTH, WIDTH)
    return lambda table, row: simd.read(table, row)


def load_at(numbers: Any, first: int) -> Lane:
    """Load WIDTH numbers from element `first` on, in the array's type."""
    return np.asarray(numbers).ravel()[first : first + WIDTH]


@overload(load_at)
def _load_at(numbers, first):
    if WIDTH > 1:
        return lambda numbers, first: simd.load(numbers, first, WIDTH)
    return lambda numbers, first: simd.read(numbers, first)


def load_like(numbers: Any, first: int, like: Lane) -> Lane:
    """Load as many numbers as `like` has lanes from element `first` on, as floating-point numbers or integers of its bits."""
    return np.asarray(numbers).ravel()[first : first + np.size(like)]


@overload(load_like)
def _load_like(numbers, first, like):
    if _is_vector(like):
        kind = "f" if isinstance(numbers.dtype, types.Float) else "i"
        what = getattr(simd, f"{kind}{like.bits}x{like.lanes}")
        return lambda numbers, first, like: simd.load(numbers, first, what)
    return lambda numbers, first, like: simd.read(numbers, first)


def load_rows3(rows: Any, first: int) -> Vec:
    """Load the columns of WIDTH rows of three numbers as float64; in kernels the array has any number type."""
    return tuple(np.asarray(rows[first : first + WIDTH], np.float64).T)


@overload(load_rows3)
def _load_rows3(rows, first):
    if WIDTH > 1:
        what = getattr(simd, f"f64x{WIDTH}")
        return lambda rows, first: simd.load3(rows, first * 3, what)
    return lambda rows, first: (np.float64(rows[first, 0]), np.float64(rows[first, 1]), np.float64(rows[first, 2]))


def load_row(numbers: Any, first: int) -> Lane:
    """Load WIDTH numbers from element `first` on as float64."""
    return np.asarray(numbers[first : first + WIDTH], np.float64)


@overload(load_row)
def _load_row(numbers, first):
    if WIDTH > 1:
        what = getattr(simd, f"f64x{WIDTH}")
        return lambda numbers, first: simd.load(numbers, first, what)
    return lambda numbers, first: np.float64(simd.read(numbers, first))  # a flat place in an array of any shape, as in `load`


def store_row(numbers: Any, first: int, x: Lane) -> None:
    """Store a value to WIDTH elements from element `first` on."""
    numbers[first : first + WIDTH] = x


@overload(store_row)
def _store_row(numbers, first, x):
    if _is_vector(x):
        return lambda numbers, first, x: simd.store(numbers, first, x)
    return lambda numbers, first, x: simd.write(numbers, first, x)


def store(table: Any, row: int, x: Lane) -> None:
    """Store a value to a row of a (rows, WIDTH) table; in kernels the table may be flat."""
    table[row] = x


@overload(store)
def _store(table, row, x):
    if _is_vector(x):
        return lambda table, row, x: simd.store(table, row * WIDTH, x)
    return lambda table, row, x: simd.write(table, row, x)


def write_lanes(table: Any, row: int, k: int, x: Lane, mine: Lane) -> None:
    """Store to a row of a (rows, WIDTH) table: a value in the lanes of a mask, or a number to lane k; flat table in kernels."""
    if np.ndim(x):
        table[row][mine] = x[mine]
    elif mine:
        table[row][k] = x


@overload(write_lanes)
def _write_lanes(table, row, k, x, mine):
    if _is_vector(x):
        return lambda table, row, k, x, mine: simd.masked_store(table, row * WIDTH, x, mine)

    def write(table, row, k, x, mine):
        if mine:
            simd.write(table, row * WIDTH + k, x)

    return write


def to_float32(x: Lane) -> Lane:
    """Round to single precision; the result is double."""
    return np.float64(np.float32(x))


@overload(to_float32)
def _to_float32(x):
    if _is_vector(x):
        return lambda x: simd.to_f64(simd.to_f32(x))
    return lambda x: np.float64(np.float32(x))


def mask_of(bits: int, like: Lane) -> Lane:
    """Build a mask with the lanes of `like` from an integer: lane k is bit k."""
    return (bits >> np.arange(np.size(like)) & 1 != 0).reshape(np.shape(like))


@overload(mask_of)
def _mask_of(bits, like):
    if _is_vector(like):
        return lambda bits, like: simd.mask_from_bits(bits, like)
    return lambda bits, like: bits != 0


def lane_indices(first: int) -> Lane:
    """Return first, first + 1, … in the WIDTH int64 lanes of a kernel."""
    return first + np.arange(WIDTH)


@overload(lane_indices)
def _lane_indices(first):
    if WIDTH > 1:
        make = getattr(simd, f"i64x{WIDTH}")
        return lambda first: first + simd.iota(make(0))
    return lambda first: np.int64(first)


def total(x: Lane) -> Lane:
    """Sum all lanes."""
    return np.sum(x)


@overload(total)
def _total(x):
    if _is_vector(x):
        return lambda x: simd.sum_of(x)
    return lambda x: x


def reduce_min(x: Lane) -> Lane:
    """Return the smallest lane."""
    return np.min(x)


@overload(reduce_min)
def _reduce_min(x):
    if _is_vector(x):
        return lambda x: simd.min_of(x)
    return lambda x: x


def reduce_max(x: Lane) -> Lane:
    """Return the largest lane."""
    return np.max(x)


@overload(reduce_max)
def _reduce_max(x):
    if _is_vector(x):
        return lambda x: simd.max_of(x)
    return lambda x: x


def count(mask: Lane) -> Lane:
    """Count the set lanes of a mask."""
    return np.count_nonzero(mask)


@overload(count)
def _count(mask):
    if _is_vector(mask):
        return lambda mask: simd.count(mask)
    return lambda mask: 1 if mask else 0


def bits(mask: Lane) -> Lane:
    """Convert a mask to an integer: bit k is lane k."""
    return np.sum(np.ravel(mask) << np.arange(np.size(mask)))


@overload(bits)
def _bits(mask):
    if _is_vector(mask):
        return lambda mask: simd.bits(mask)
    return lambda mask: np.int64(mask)


def uniform_group(values: Lane, mask: Lane) -> tuple[Lane, Lane]:
    """Return a value and the lanes of a mask that share it.

    In numpy: all values, and the whole mask. In vectors: the value of the mask's first lane as a scalar, and the mask's lanes with that
    value.
    """
    return values, mask


@overload(uniform_group)
def _uniform_group(values, mask):
    if _is_vector(values):

        def first(values, mask):
            value = simd.lane(values, simd.trailing_zeros(simd.bits(mask)))
            return value, mask & (values == value)

        return first
    return lambda values, mask: (values, mask)


def stack_store(stack: Any, place: Lane, field: int, value: Lane, mask: Lane) -> None:
    """Store to stack[place, field, lane] in the lanes of a mask; `stack` is (rows, fields, lanes)."""
    lane = np.flatnonzero(np.broadcast_to(mask, stack.shape[2:]))
    stack[np.broadcast_to(place, stack.shape[2:])[lane], field, lane] = np.broadcast_to(value, stack.shape[2:])[lane]


@overload(stack_store)
def _stack_store(stack, place, field, value, mask):
    if _is_vector(mask):

        def scatter(stack, place, field, value, mask):
            n = stack.shape[2]
            simd.scatter(stack, (place * stack.shape[1] + field) * n + simd.iota(place), full_like(mask, value), mask)

        return scatter

    def write(stack, place, field, value, mask):
        if mask:
            stack[place, field, 0] = value

    return write


def scatter_masked(array: Any, place: Lane, value: Lane, mask: Lane) -> None:
    """Scatter to array[place] in the lanes of a mask; places differ between lanes."""
    array[np.broadcast_to(place, np.shape(mask))[mask]] = np.broadcast_to(value, np.shape(mask))[mask]


@overload(scatter_masked)
def _put_at(array, place, value, mask):
    if _is_vector(mask):
        return lambda array, place, value, mask: simd.scatter(array, place, value, mask)

    def write(array, place, value, mask):
        if mask:
            array[place] = value

    return write


def stack_load(stack: Any, place: Lane, field: int) -> Lane:
    """Load stack[place, field, lane]."""
    return stack[place, field, np.arange(stack.shape[2])]


@overload(stack_load)
def _stack_load(stack, place, field):
    if _is_vector(place):
        return lambda stack, place, field: simd.gather(stack, (place * stack.shape[1] + field) * stack.shape[2] + simd.iota(place))
    return lambda stack, place, field: stack[place, field, 0]


@helper
def stack_store3(stack: Any, place: Lane, field: int, value: Vec, mask: Lane) -> None:
    """Store a 3D vector to three stack fields."""
    stack_store(stack, place, field, value[0], mask)
    stack_store(stack, place, field + 1, value[1], mask)
    stack_store(stack, place, field + 2, value[2], mask)


@helper
def stack_load3(stack: Any, place: Lane, field: int) -> Vec:
    """Load a 3D vector from three stack fields."""
    return stack_load(stack, place, field), stack_load(stack, place, field + 1), stack_load(stack, place, field + 2)


def narrow(nest: Any) -> Any:
    """In kernels: convert the floats of a nested tuple or NamedTuple of numbers to float32."""
    return nest


@overload(narrow)
def _narrow(nest):
    names: dict[str, Any] = {"single": np.float32}

    def source(kind, expression: str) -> str:
        if hasattr(kind, "types"):
            name = f"kind{len(names)}"
            named = isinstance(kind, types.BaseNamedTuple)
            names[name] = getattr(kind, "instance_class", None)
            parts = "".join(f"{source(part, f'{expression}[{k}]')}, " for k, part in enumerate(kind.types))
            return f"{name}({parts})" if named else f"({parts})"
        return f"single({expression})" if isinstance(kind, types.Float) else expression

    exec(f"def narrow(nest): return {source(nest, 'nest')}", names)  # Numba does not loop over heterogeneous tuples
    return names["narrow"]
