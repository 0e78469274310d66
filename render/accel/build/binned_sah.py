"""Binary trees over boxes by binned surface area heuristic: float32, eight numbers at a time.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. A box is one vector (low x, y, z, _, -high x, y, z, _),
so that the smaller of two of them encloses both. Its last number is how many things are in it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.arena import Scratch
from ...jit.kernel import helper, noinline_helper
from ...types import Lane

BINS = 16
_BINS3 = 3 * BINS  # of three axes
_SETS = 4  # of bins, a power of two
_TURNS = 128  # items from which on they are worth it
_ROOM = 8 * _SETS * _BINS3
NUMBER = 3  # column of an item's box that holds its number, as bits
COUNT = 7  # column that holds how many items a box is of: 1
TAG = 0x40000000  # set in those bits: small integers are denormal floats, which are slow
LEAF = -2
_SAMPLES = 1 << 13  # items that are enough to find a plane by
DEEPEST = 48  # below this level nodes are halved, so that no tree is much deeper
_LATER = 0.01  # cost of an item that fills up a block, against that of the block


class Halves(NamedTuple):
    """A tree over n items. Halves of a node stand side by side; the root is node 0."""

    items: NDArray[np.float32]  # (n, 8) boxes of items, in the order of the leaves; their numbers in column NUMBER
    boxes: NDArray[np.float32]  # (2 n, 8) of nodes
    second: NDArray[np.int32]  # (2 n,) place of the second half, behind that of the first; 0 at a leaf
    first: NDArray[np.int32]  # (2 n,) the first item
    count: NDArray[np.int32]  # (2 n,) how many there are


class Room(NamedTuple):
    """What dividing nodes needs, on the stack of a kernel."""

    nodes: Any
    bins: Any
    left: Any
    before: Any
    spans: Any


def empty(n: int, memory: Scratch) -> Halves:
    """A tree over n items, not filled."""
    return Halves(
        memory.empty((n, 8), np.float32), memory.empty((2 * n, 8), np.float32), *(memory.empty((2 * n,), np.int32) for _ in range(3))
    )


def bounds_of(items: NDArray[np.float32]) -> NDArray[np.float32]:
    """(2, 8) the box around items (n, 8), and their span: the box around their middles, doubled."""
    middles = items[:, :4] - items[:, 4:]
    return np.stack([items.min(axis=0), np.concatenate([middles, -middles], axis=1).min(axis=0)])


@helper
def room() -> Room:
    """The memory that `grow` wants."""
    return Room(
        simd.stack_array(np.int32, 256),
        simd.stack_array(np.float32, _ROOM),
        simd.stack_array(np.float32, BINS),
        simd.stack_array(np.float32, BINS),
        simd.stack_array(np.float32, 1024),  # for each two numbers of the stack
    )


@helper
def half_area(box: Lane) -> Any:
    """Half the surface of a box."""
    size = simd.low_half(box) + simd.high_half(box)  # low - high: the signs cancel
    x, y, z = simd.lane(size, 0), simd.lane(size, 1), simd.lane(size, 2)
    return x * y + y * z + z * x


@helper
def _nothing() -> Lane:
    box = simd.f32x8(np.inf)
    return simd.select(_is_count(box), np.float32(0.0), box)


@helper
def _is_count(box: Lane) -> Any:
    return simd.mask_from_bits(1 << COUNT, box)


@helper
def _joined(a: Lane, b: Lane) -> Lane:
    """The box around two, with their counts added."""
    return simd.select(_is_count(a), a + b, simd.minimum(a, b))


@noinline_helper
def split_nodes(tree: Halves, root: int, free: Any, depth: int, width: int, step: Any, once: bool, room: Room) -> int:
    """Divide the node `root`, so many levels down, and unless `once` all below it, side by side from the place `free` on, where its
    span stands. The end of what was filled.

    A leaf of up to `width` items costs one test; a step down costs `step` of that. With `once`, its halves stand so that the first one
    has room before them, the second one behind, and their spans where those begin.
    """
    items, boxes, second, first, count = tree.items, tree.boxes, tree.second, tree.first, tree.count
    stack, bins, left, before, spans = room
    simd.write(stack, 0, root)
    simd.write(stack, 1, depth)
    simd.store(spans, 0, simd.load(boxes, free * 8, 8))
    top = 2
    while top > 0:
        top -= 2
        node, depth = np.int64(simd.read(stack, top)), simd.read(stack, top + 1)
        begin, n = np.int64(first[node]), np.int64(count[node])
        second[node] = 0
        if n == 1 or (n <= width and _areas(items, begin, n) >= half_area(simd.load(boxes, node * 8, 8))):
            continue  # what fills its box as well as a surface does is not worth a closer look
        low = simd.load(spans, 4 * top, 4)
        size = simd.f32x4(0.0) - low - simd.load(spans, 4 * top + 4, 4)
        used = BINS if n > BINS else max(4, min(BINS, n + (n >> 1)))
        scale = simd.f32x4(np.float32(used) * np.float32(0.9999)) / simd.maximum(size, simd.f32x4(1e-30))
        plane, axis, stride = -1, 0, max(1, n // _SAMPLES)
        if depth < DEEPEST or n <= width:
            _fill(items, begin, n, stride, low, scale, used, bins)
            plane, axis = _divide(simd.load(boxes, node * 8, 8), n, stride, size, used, width, step, bins, left, before)
        if plane == LEAF:
            continue
        if plane < 0:
            middle = begin + n // 2
            one, other = _enclosing(items, begin, middle), _enclosing(items, middle, begin + n)
            inner, outer = _span(items, begin, middle), _span(items, middle, begin + n)
        else:
            middle, one, other, inner, outer = _sort(items, begin, n, axis, simd.lane(low, axis), simd.lane(scale, axis), plane)
        a = free + 2 * (middle - begin) - 2 if once else free
        b, free_first, free = a + 1, free, a + 2
        simd.store(boxes, a * 8, one)
        simd.store(boxes, b * 8, other)
        second[node] = b
        first[a], count[a], first[b], count[b] = begin, middle - begin, middle, begin + n - middle
        second[a], second[b] = 0, 0
        if once:
            if middle > begin + 1:
                simd.store(boxes, free_first * 8, inner)
            if middle < begin + n - 1:
                simd.store(boxes, free * 8, outer)
            return free
        larger, smaller = a, b  # the smaller one next: the stack stays below 32
        if count[b] > count[a]:
            larger, smaller, inner, outer = b, a, outer, inner
        simd.store(spans, 4 * top, inner)
        simd.store(spans, 4 * top + 8, outer)
        simd.write(stack, top, larger)
        simd.write(stack, top + 1, depth + 1)
        simd.write(stack, top + 2, smaller)
        simd.write(stack, top + 3, depth + 1)
        top += 4
    return free


@helper
def _enclosing(items: Any, begin: int, end: int) -> Lane:
    box = _nothing()
    for i in range(begin, end):
        box = simd.minimum(box, simd.load(items, i * 8, 8))
    return box


@helper
def _areas(items: Any, begin: int, n: int) -> Any:
    """Half the surface of all items' boxes."""
    total = np.float32(0.0)
    for i in range(begin, begin + n):
        total += half_area(simd.load(items, i * 8, 8))
    return total


@helper
def _divide(
    around: Lane, n: int, stride: int, size: Lane, used: int, width: int, step: float, bins: Any, left: Any, before: Any
) -> tuple[int, int]:
    """(the first bin of the second half of n items, its axis); LEAF: better a leaf; -1: no plane divides them."""
    cost, axis, plane = _cheapest(bins, left, before, size, used, np.float32(stride), np.float32(1.0) / np.float32(width))
    if n <= width:
        alone = half_area(around) * (np.float32(1.0) + np.float32(_LATER) * np.float32(n))
        if axis < 0 or alone <= np.float32(step) * half_area(around) + cost:
            return LEAF, 0
    return (plane, axis) if axis >= 0 else (-1, 0)


@helper
def _sort(items: Any, begin: int, n: int, axis: int, base: Any, factor: Any, plane: int) -> tuple[Any, Lane, Lane, Lane, Lane]:
    """Bring the items of bins before `plane` to the front, without a branch; where the others begin, and both boxes and spans.

    Each item changes places with the first of the others, and stays there if it is to be in front.
    """
    first = np.int64(begin)
    none = simd.f32x8(np.inf)
    one, other, inner, outer = none, none, none, none
    for i in range(begin, begin + n):
        box, front = simd.load(items, i * 8, 8), np.int64(_bin(items, i, axis, base, factor) < plane)
        simd.store(items, i * 8, simd.load(items, first * 8, 8))
        simd.store(items, first * 8, box)
        first += front
        middle, mine = middle_of(box), simd.mask_from_bits(-front, box)
        one, inner = simd.select(mine, simd.minimum(one, box), one), simd.select(mine, simd.minimum(inner, middle), inner)
        other, outer = simd.select(mine, other, simd.minimum(other, box)), simd.select(mine, outer, simd.minimum(outer, middle))
    return first, one, other, inner, outer


@helper
def _span(items: Any, begin: int, end: int) -> Lane:
    """The box around the middles of items begin … end, doubled."""
    span = simd.f32x8(np.inf)
    for i in range(begin, end):
        span = simd.minimum(span, middle_of(simd.load(items, i * 8, 8)))
    return span


@helper
def middle_of(box: Lane) -> Lane:
    """A box's middle, doubled, as a box."""
    middle = simd.low_half(box) - simd.high_half(box)
    return simd.joined(middle, simd.f32x4(0.0) - middle)


@helper
def _fill(items: Any, begin: int, n: int, stride: int, low: Lane, scale: Lane, used: int, bins: Any) -> None:
    """Boxes and numbers of the items, or of each `stride`th, in each of the three axes' bins.

    Neighbours fall into one bin, where each waits for the one before. So they take turns in several sets, which are then joined.
    """
    sets = _SETS if n >= _TURNS else 1
    for k in range(sets):
        for j in range(k * _BINS3, k * _BINS3 + 3 * used):
            simd.store(bins, j * 8, _nothing())
    first, turn = simd.iota(simd.i32x4(0)) * simd.i32x4(np.int32(used)), 0
    for i in range(begin, begin + n, stride):
        box = simd.load(items, i * 8, 8)
        places = simd.to_i32((simd.low_half(box) - simd.high_half(box) - low) * scale) + first
        at, turn = (turn & (sets - 1)) * _BINS3, turn + 1
        _put(bins, at + np.int64(simd.lane(places, 0)), box)
        _put(bins, at + np.int64(simd.lane(places, 1)), box)
        _put(bins, at + np.int64(simd.lane(places, 2)), box)
    for k in range(1, sets):
        for j in range(3 * used):
            _put(bins, j, simd.load(bins, (k * _BINS3 + j) * 8, 8))


@helper
def _put(bins: Any, k: int, box: Lane) -> None:
    simd.store(bins, k * 8, _joined(simd.load(bins, k * 8, 8), box))


@helper
def _bin(items: Any, i: int, axis: int, base: Any, factor: Any) -> Any:
    """The bin `_fill` put item i into, of one axis."""
    middle = simd.read(items, i * 8 + axis) - simd.read(items, i * 8 + 4 + axis)
    return np.int64(np.int32((middle - base) * factor))


@helper
def _cheapest(bins: Any, left: Any, before: Any, size: Lane, used: int, times: Any, share: Any) -> tuple[Any, int, int]:
    """(cost, axis, first bin of the second half) of the best plane, axis -1 where none has items on both sides."""
    best, best_axis, best_plane = np.float32(np.inf), -1, 0
    for axis in range(3):
        if not simd.lane(size, axis) > np.float32(0.0):
            continue
        box = _nothing()
        for k in range(axis * used, (axis + 1) * used - 1):
            box = _joined(box, simd.load(bins, k * 8, 8))
            n = simd.lane(box, COUNT) * times
            simd.write(left, k - axis * used, half_area(box) * _tests(n, share))
            simd.write(before, k - axis * used, n)
        box = _nothing()
        for plane in range(used - 1, 0, -1):
            box = _joined(box, simd.load(bins, (axis * used + plane) * 8, 8))
            n = simd.lane(box, COUNT) * times
            cost = simd.read(left, plane - 1) + half_area(box) * _tests(n, share)
            if cost < best and n > np.float32(0.0) and simd.read(before, plane - 1) > np.float32(0.0):
                best, best_axis, best_plane = cost, axis, plane
    return best, best_axis, best_plane


@helper
def _tests(n: Any, share: Any) -> Any:
    """What n items cost: the blocks of 1 / share they fill, and a little each."""
    return simd.ceil(n * share) + np.float32(_LATER) * n
