"""Binary trees over boxes by binned surface area heuristic: float32, eight numbers at a time, their parts on threads.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. A box is one vector (low x, y, z, _, -high x, y, z, _),
so that the smaller of two of them encloses both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import simd
from .kernels import helper, kernel
from .records import Lane

BINS = 16
_BINS3 = 3 * BINS  # of three axes
_SETS = 4  # of bins, a power of two
_TURNS = 128  # items from which on they are worth it
_ROOM, _COUNTS = 8 * _SETS * _BINS3, _SETS * _BINS3
NUMBER = 3  # column of an item's box that holds its number, as bits
TAG = 0x40000000  # set in those bits: small integers are denormal floats, which are slow
_GRAIN = 32  # parts of at least this many, so that threads come out even
LEAF = -2
_SMALL = 4096  # items that are not worth a thread
DEEPEST = 48  # below this level nodes are halved, so that no tree is much deeper
_LATER = 0.01  # cost of an item that fills up a block, against that of the block

Run = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]  # `map`, or a pool's


class Halves(NamedTuple):
    """A tree over n items. A node with m items has the place s, its first half s + 1, its second half s + 2 · (m of the first)."""

    items: NDArray[np.float32]  # (n, 8) boxes of items, in the order of the leaves; their numbers in column NUMBER
    boxes: NDArray[np.float32]  # (2 n, 8) of nodes
    second: NDArray[np.int32]  # (2 n,) place of the second half, 0 at a leaf
    first: NDArray[np.int32]  # (2 n,) the first item
    count: NDArray[np.int32]  # (2 n,) how many there are


def numbers(items: NDArray[np.float32]) -> NDArray[np.int32]:
    """The items' numbers."""
    return items.view(np.int32)[:, NUMBER] & ~TAG


def pool(threads: int) -> ThreadPoolExecutor:
    """Threads to build on."""
    return ThreadPoolExecutor(max(threads, 1), thread_name_prefix="trees")


def build(items: NDArray[np.float32], width: int, step: float, run: Run) -> tuple[Halves, list[int]]:
    """The tree over items (n, 8), which are sorted in place, and the places of its parts that threads may work on.

    A leaf of up to `width` items costs one test; a step down costs `step` of that. `run` is `map` or that of a pool.
    """
    n = len(items)
    tree = Halves(items, simd.aligned_empty((2 * n, 8), np.float32), *np.empty((3, 2 * n), np.int32))
    tree.boxes[0] = items.min(axis=0)
    tree.first[0], tree.count[0] = 0, n
    grain = max(n // _GRAIN, _SMALL)  # more than a leaf holds
    parts, wave = [], [0]
    while wave:
        parts += [s for s in wave if tree.count[s] <= grain]
        wave = [s for s in wave if tree.count[s] > grain]
        list(run(lambda s: grow(*tree, s, width, step, True), wave))
        wave = [child for s in wave for child in (s + 1, int(tree.second[s]))]
    list(run(lambda s: grow(*tree, s, width, step, False), sorted(parts, key=lambda s: -tree.count[s])))
    return tree, sorted(parts)


@helper
def half_area(box: Lane) -> Any:
    """Half the surface of a box."""
    size = simd.low_half(box) + simd.high_half(box)  # low - high: the signs cancel
    x, y, z = simd.lane(size, 0), simd.lane(size, 1), simd.lane(size, 2)
    return x * y + y * z + z * x


@helper
def _nothing() -> Lane:
    return simd.f32x8(np.inf)


@kernel
def grow(items, boxes, second, first, count, root, width, step, once):
    """Divide the node `root` and, unless `once`, all below it."""
    stack = simd.stack_array(np.int32, 256)
    bins = simd.stack_array(np.float32, _ROOM)
    filled = simd.stack_array(np.int32, _COUNTS)
    left = simd.stack_array(np.float32, BINS)
    before = simd.stack_array(np.int32, BINS)
    aside = np.empty((count[root], 8), np.float32)
    simd.write(stack, 0, root)
    simd.write(stack, 1, 0)
    top = 2
    while top > 0:
        top -= 2
        node, depth = np.int64(simd.read(stack, top)), simd.read(stack, top + 1)
        begin, n = np.int64(first[node]), np.int64(count[node])
        second[node] = 0
        if n == 1:
            continue
        low, size = _centres(items, begin, n)
        used = BINS if n > BINS else max(4, min(BINS, n + (n >> 1)))
        scale = simd.f32x4(np.float32(used) * np.float32(0.9999)) / simd.maximum(size, simd.f32x4(1e-30))
        plane, axis = -1, 0
        if depth < DEEPEST or n <= width:
            _fill(items, begin, n, low, scale, used, bins, filled)
            plane, axis = _divide(simd.load(boxes, node * 8, 8), n, size, used, width, step, bins, filled, left, before)
        if plane == LEAF:
            continue
        if plane < 0:
            middle = begin + n // 2
            one, other = _enclosing(items, begin, middle), _enclosing(items, middle, begin + n)
        else:
            middle = _sort(items, begin, n, axis, simd.lane(low, axis), simd.lane(scale, axis), plane, aside)
            one, other = _enclosing(bins, axis * used, axis * used + plane), _enclosing(bins, axis * used + plane, (axis + 1) * used)
        a, b = node + 1, node + 2 * (middle - begin)
        simd.store(boxes, a * 8, one)
        simd.store(boxes, b * 8, other)
        second[node] = b
        first[a], count[a], first[b], count[b] = begin, middle - begin, middle, begin + n - middle
        second[a], second[b] = 0, 0
        if once:
            return
        larger, smaller = (a, b) if count[a] > count[b] else (b, a)  # the smaller one next: the stack stays below 32
        simd.write(stack, top, larger)
        simd.write(stack, top + 1, depth + 1)
        simd.write(stack, top + 2, smaller)
        simd.write(stack, top + 3, depth + 1)
        top += 4


@helper
def _enclosing(items: Any, begin: int, end: int) -> Lane:
    box = _nothing()
    for i in range(begin, end):
        box = simd.minimum(box, simd.load(items, i * 8, 8))
    return box


@helper
def _divide(
    around: Lane, n: int, size: Lane, used: int, width: int, step: float, bins: Any, filled: Any, left: Any, before: Any
) -> tuple[int, int]:
    """(the first bin of the second half of n items, its axis); LEAF: better a leaf; -1: no plane divides them."""
    cost, axis, plane = _cheapest(bins, filled, left, before, size, used, width)
    if n <= width:
        alone = half_area(around) * (np.float32(1.0) + np.float32(_LATER) * np.float32(n))
        if axis < 0 or alone <= np.float32(step) * half_area(around) + cost:
            return LEAF, 0
    return (plane, axis) if axis >= 0 else (-1, 0)


@helper
def _sort(items: Any, begin: int, n: int, axis: int, base: Any, factor: Any, plane: int, aside: Any) -> Any:
    """Bring the items of bins before `plane` to the front, in their order, without a branch; where the others begin."""
    first, others = np.int64(begin), np.int64(0)
    for i in range(begin, begin + n):
        box, front = simd.load(items, i * 8, 8), np.int64(_bin(items, i, axis, base, factor) < plane)
        simd.store(items, first * 8, box)  # over one that has its place already, or itself
        simd.store(aside, others * 8, box)
        first, others = first + front, others + 1 - front
    for k in range(others):
        simd.store(items, (first + k) * 8, simd.load(aside, k * 8, 8))
    return first


@helper
def _centres(items: Any, begin: int, n: int) -> tuple[Lane, Lane]:
    """(lowest, extent) of the items' middles, doubled."""
    low, high = simd.f32x4(np.inf), simd.f32x4(-np.inf)
    for i in range(begin, begin + n):
        box = simd.load(items, i * 8, 8)
        middle = simd.low_half(box) - simd.high_half(box)
        low, high = simd.minimum(low, middle), simd.maximum(high, middle)
    return low, high - low


@helper
def _fill(items: Any, begin: int, n: int, low: Lane, scale: Lane, used: int, bins: Any, filled: Any) -> None:
    """Boxes and numbers of the items in each of the three axes' bins.

    Neighbours fall into one bin, where each waits for the one before. So they take turns in several sets, which are then joined.
    """
    sets = _SETS if n >= _TURNS else 1
    for k in range(sets):
        for j in range(k * _BINS3, k * _BINS3 + 3 * used):
            simd.store(bins, j * 8, _nothing())
            simd.write(filled, j, 0)
    last = simd.i32x4(np.int32(used - 1))
    first = simd.iota(last) * simd.i32x4(np.int32(used))
    for i in range(begin, begin + n):
        box = simd.load(items, i * 8, 8)
        places = simd.to_i32((simd.low_half(box) - simd.high_half(box) - low) * scale)
        places = simd.minimum(simd.maximum(places, simd.i32x4(0)), last) + first
        at = (i & (sets - 1)) * _BINS3
        _put(bins, filled, at + np.int64(simd.lane(places, 0)), box)
        _put(bins, filled, at + np.int64(simd.lane(places, 1)), box)
        _put(bins, filled, at + np.int64(simd.lane(places, 2)), box)
    for k in range(1, sets):
        for j in range(3 * used):
            other = k * _BINS3 + j
            simd.store(bins, j * 8, simd.minimum(simd.load(bins, j * 8, 8), simd.load(bins, other * 8, 8)))
            simd.write(filled, j, simd.read(filled, j) + simd.read(filled, other))


@helper
def _put(bins: Any, filled: Any, k: int, box: Lane) -> None:
    simd.store(bins, k * 8, simd.minimum(simd.load(bins, k * 8, 8), box))
    simd.write(filled, k, simd.read(filled, k) + np.int32(1))


@helper
def _bin(items: Any, i: int, axis: int, base: Any, factor: Any) -> Any:
    """The bin `_fill` put item i into, of one axis."""
    middle = simd.read(items, i * 8 + axis) - simd.read(items, i * 8 + 4 + axis)
    return np.int64(np.int32((middle - base) * factor))


@helper
def _cheapest(bins: Any, filled: Any, left: Any, before: Any, size: Lane, used: int, width: int) -> tuple[Any, int, int]:
    """(cost, axis, first bin of the second half) of the best plane, axis -1 where none has items on both sides."""
    best, best_axis, best_plane = np.float32(np.inf), -1, 0
    for axis in range(3):
        if not simd.lane(size, axis) > np.float32(0.0):
            continue
        box, n = _nothing(), 0
        for k in range(axis * used, (axis + 1) * used - 1):
            box, n = simd.minimum(box, simd.load(bins, k * 8, 8)), n + np.int64(simd.read(filled, k))
            simd.write(left, k - axis * used, half_area(box))
            simd.write(before, k - axis * used, n)
        box, n = _nothing(), 0
        for plane in range(used - 1, 0, -1):
            k = axis * used + plane
            box, n = simd.minimum(box, simd.load(bins, k * 8, 8)), n + np.int64(simd.read(filled, k))
            m = np.int64(simd.read(before, plane - 1))
            if m == 0 or n == 0:
                continue
            cost = simd.read(left, plane - 1) * _tests(m, width) + half_area(box) * _tests(n, width)
            if cost < best:
                best, best_axis, best_plane = cost, axis, plane
    return best, best_axis, best_plane


@helper
def _tests(n: int, width: int) -> Any:
    """What n items cost: the blocks they fill, and a little each."""
    return np.float32((n + width - 1) // width) + np.float32(_LATER) * np.float32(n)
