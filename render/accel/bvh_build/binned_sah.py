"""Builds binary BVHs over boxes by the binned surface area heuristic, in float32, a box a vector.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. A box is the vector (low x, y, z, _, -high x, y, z, count),
so the minimum of two boxes encloses both. The last number counts the items of the box.
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
_SETS = 4  # sets of bins, a power of two
_TURNS = 128  # items from which on several sets pay off
_BIN_FLOATS = 8 * _SETS * _BINS3
NUMBER = 3  # column of an item's box that holds its number, as bits
COUNT = 7  # column of the number of items in a box
TAG = 0x40000000  # bit set in NUMBER: small integers would be denormal floats, which are slow
LEAF = -2
_SAMPLES = 1 << 13  # items sampled to find a split plane
DEEPEST = 48  # level below which nodes split at the median, which bounds the depth
_LATER = 0.01  # cost of a further item of a block, relative to the block


class BinaryBvh(NamedTuple):
    """A binary BVH over n items. The two children of a node stand side by side; the root is node 0."""

    items: NDArray[np.float32]  # (n, 8) boxes of items, in the order of the leaves; their numbers in column NUMBER
    boxes: NDArray[np.float32]  # (2 n, 8) of nodes
    second: NDArray[np.int32]  # (2 n,) row of the second child, after that of the first; 0 at a leaf
    first: NDArray[np.int32]  # (2 n,) first item
    count: NDArray[np.int32]  # (2 n,) number of items


class SplitBuffers(NamedTuple):
    """Buffers of `split_nodes`, on the stack of a kernel."""

    nodes: Any
    bins: Any
    left_costs: Any
    before: Any
    spans: Any


def empty(n: int, memory: Scratch) -> BinaryBvh:
    """Allocate a BVH over n items, uninitialized."""
    return BinaryBvh(
        memory.empty((n, 8), np.float32), memory.empty((2 * n, 8), np.float32), *(memory.empty((2 * n,), np.int32) for _ in range(3))
    )


def bounds_of(items: NDArray[np.float32]) -> NDArray[np.float32]:
    """The box around items (n, 8) and their span, the box around their doubled centers, (2, 8)."""
    middles = items[:, :4] - items[:, 4:]
    return np.stack([items.min(axis=0), np.concatenate([middles, -middles], axis=1).min(axis=0)])


@helper
def allocate_buffers() -> SplitBuffers:
    """Allocate the buffers of `split_nodes`."""
    return SplitBuffers(
        simd.stack_array(np.int32, 256),
        simd.stack_array(np.float32, _BIN_FLOATS),
        simd.stack_array(np.float32, BINS),
        simd.stack_array(np.float32, BINS),
        simd.stack_array(np.float32, 1024),  # two numbers of the stack each
    )


@helper
def half_area(box: Lane) -> Any:
    """Half the surface area of a box."""
    size = simd.low_half(box) + simd.high_half(box)  # low - high: the signs cancel
    x, y, z = simd.lane(size, 0), simd.lane(size, 1), simd.lane(size, 2)
    return x * y + y * z + z * x


@helper
def _empty_box() -> Lane:
    box = simd.f32x8(np.inf)
    return simd.select(_is_count(box), np.float32(0.0), box)


@helper
def _is_count(box: Lane) -> Any:
    return simd.mask_from_bits(1 << COUNT, box)


@helper
def _merge(a: Lane, b: Lane) -> Lane:
    """The box around two boxes, with the sum of their counts."""
    return simd.select(_is_count(a), a + b, simd.minimum(a, b))


@noinline_helper
def split_nodes(tree: BinaryBvh, root: int, free: Any, depth: int, width: int, step: Any, once: bool, buffers: SplitBuffers) -> int:
    """Split the node `root`, which is `depth` levels down, and unless `once` its descendants; return the end of the filled rows.

    New nodes fill rows from `free` on, where the span of the root stands. A leaf of up to `width` items costs one test, a step down costs
    `step` tests. With `once`, only the root splits. Its children are placed so that the first child's subtree fits before them and the
    second's after them, and their spans stand at the start of those rows.
    """
    items, boxes, second, first, count = tree.items, tree.boxes, tree.second, tree.first, tree.count
    stack, bins, left_costs, before, spans = buffers
    simd.write(stack, 0, root)
    simd.write(stack, 1, depth)
    simd.store(spans, 0, simd.load(boxes, free * 8, 8))
    top = 2
    while top > 0:
        top -= 2
        node, depth = np.int64(simd.read(stack, top)), simd.read(stack, top + 1)
        begin, n = np.int64(first[node]), np.int64(count[node])
        second[node] = 0
        if n == 1 or (n <= width and _sum_areas(items, begin, n) >= half_area(simd.load(boxes, node * 8, 8))):
            continue  # items fill the box like a surface: no split pays off
        low = simd.load(spans, 4 * top, 4)
        size = simd.f32x4(0.0) - low - simd.load(spans, 4 * top + 4, 4)
        used = BINS if n > BINS else max(4, min(BINS, n + (n >> 1)))
        scale = simd.f32x4(np.float32(used) * np.float32(0.9999)) / simd.maximum(size, simd.f32x4(1e-30))
        plane, axis, stride = -1, 0, max(1, n // _SAMPLES)
        if depth < DEEPEST or n <= width:
            _fill_bins(items, begin, n, stride, low, scale, used, bins)
            plane, axis = _find_split(simd.load(boxes, node * 8, 8), n, stride, size, used, width, step, bins, left_costs, before)
        if plane == LEAF:
            continue
        if plane < 0:
            middle = begin + n // 2
            box_a, box_b = _enclosing(items, begin, middle), _enclosing(items, middle, begin + n)
            inner, outer = _span(items, begin, middle), _span(items, middle, begin + n)
        else:
            middle, box_a, box_b, inner, outer = _partition(items, begin, n, axis, simd.lane(low, axis), simd.lane(scale, axis), plane)
        a = free + 2 * (middle - begin) - 2 if once else free
        b, free_first, free = a + 1, free, a + 2
        simd.store(boxes, a * 8, box_a)
        simd.store(boxes, b * 8, box_b)
        second[node] = b
        first[a], count[a], first[b], count[b] = begin, middle - begin, middle, begin + n - middle
        second[a], second[b] = 0, 0
        if once:
            if middle > begin + 1:
                simd.store(boxes, free_first * 8, inner)
            if middle < begin + n - 1:
                simd.store(boxes, free * 8, outer)
            return free
        larger, smaller = a, b  # the smaller one first: the stack stays below 32 entries
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
    box = _empty_box()
    for i in range(begin, end):
        box = simd.minimum(box, simd.load(items, i * 8, 8))
    return box


@helper
def _sum_areas(items: Any, begin: int, n: int) -> Any:
    """Half the surface area of all items' boxes."""
    total = np.float32(0.0)
    for i in range(begin, begin + n):
        total += half_area(simd.load(items, i * 8, 8))
    return total


@helper
def _find_split(
    around: Lane, n: int, stride: int, size: Lane, used: int, width: int, step: float, bins: Any, left_costs: Any, before: Any
) -> tuple[int, int]:
    """(first bin of the second child of n items, its axis); LEAF where a leaf costs less, -1 where no plane separates them."""
    cost, axis, plane = _cheapest_plane(bins, left_costs, before, size, used, np.float32(stride), np.float32(1.0) / np.float32(width))
    if n <= width:
        alone = half_area(around) * (np.float32(1.0) + np.float32(_LATER) * np.float32(n))
        if axis < 0 or alone <= np.float32(step) * half_area(around) + cost:
            return LEAF, 0
    return (plane, axis) if axis >= 0 else (-1, 0)


@helper
def _partition(items: Any, begin: int, n: int, axis: int, base: Any, factor: Any, plane: int) -> tuple[Any, Lane, Lane, Lane, Lane]:
    """Partition items by bin, without a branch; return (start of the items from `plane` on, both boxes, both spans).

    Each item swaps with the first one from `plane` on, and stays there if it belongs in front.
    """
    first = np.int64(begin)
    none = simd.f32x8(np.inf)
    box_a, box_b, inner, outer = none, none, none, none
    for i in range(begin, begin + n):
        box, front = simd.load(items, i * 8, 8), np.int64(_bin(items, i, axis, base, factor) < plane)
        simd.store(items, i * 8, simd.load(items, first * 8, 8))
        simd.store(items, first * 8, box)
        first += front
        middle, mine = center_of(box), simd.mask_from_bits(-front, box)
        box_a, inner = simd.select(mine, simd.minimum(box_a, box), box_a), simd.select(mine, simd.minimum(inner, middle), inner)
        box_b, outer = simd.select(mine, box_b, simd.minimum(box_b, box)), simd.select(mine, outer, simd.minimum(outer, middle))
    return first, box_a, box_b, inner, outer


@helper
def _span(items: Any, begin: int, end: int) -> Lane:
    """The box around the doubled centers of items begin … end."""
    span = simd.f32x8(np.inf)
    for i in range(begin, end):
        span = simd.minimum(span, center_of(simd.load(items, i * 8, 8)))
    return span


@helper
def center_of(box: Lane) -> Lane:
    """The doubled center of a box, as a box."""
    middle = simd.low_half(box) - simd.high_half(box)
    return simd.concatenate(middle, simd.f32x4(0.0) - middle)


@helper
def _fill_bins(items: Any, begin: int, n: int, stride: int, low: Lane, scale: Lane, used: int, bins: Any) -> None:
    """Fill the bins of the three axes with boxes and counts of every `stride`th item.

    Neighbors often share a bin, where each store waits for the one before. Several sets of bins take turns and are merged at the end.
    """
    sets = _SETS if n >= _TURNS else 1
    for k in range(sets):
        for j in range(k * _BINS3, k * _BINS3 + 3 * used):
            simd.store(bins, j * 8, _empty_box())
    first, turn = simd.iota(simd.i32x4(0)) * simd.i32x4(np.int32(used)), 0
    for i in range(begin, begin + n, stride):
        box = simd.load(items, i * 8, 8)
        places = simd.to_i32((simd.low_half(box) - simd.high_half(box) - low) * scale) + first
        bin_set, turn = (turn & (sets - 1)) * _BINS3, turn + 1
        _add_to_bin(bins, bin_set + np.int64(simd.lane(places, 0)), box)
        _add_to_bin(bins, bin_set + np.int64(simd.lane(places, 1)), box)
        _add_to_bin(bins, bin_set + np.int64(simd.lane(places, 2)), box)
    for k in range(1, sets):
        for j in range(3 * used):
            _add_to_bin(bins, j, simd.load(bins, (k * _BINS3 + j) * 8, 8))


@helper
def _add_to_bin(bins: Any, k: int, box: Lane) -> None:
    simd.store(bins, k * 8, _merge(simd.load(bins, k * 8, 8), box))


@helper
def _bin(items: Any, i: int, axis: int, base: Any, factor: Any) -> Any:
    """The bin of item i on one axis, as in `_fill_bins`."""
    middle = simd.read(items, i * 8 + axis) - simd.read(items, i * 8 + 4 + axis)
    return np.int64(np.int32((middle - base) * factor))


@helper
def _cheapest_plane(bins: Any, left_costs: Any, before: Any, size: Lane, used: int, times: Any, share: Any) -> tuple[Any, int, int]:
    """(cost, axis, first bin of the second child) of the best plane; axis -1 where none has items on both sides."""
    best, best_axis, best_plane = np.float32(np.inf), -1, 0
    for axis in range(3):
        if not simd.lane(size, axis) > np.float32(0.0):
            continue
        box = _empty_box()
        for k in range(axis * used, (axis + 1) * used - 1):
            box = _merge(box, simd.load(bins, k * 8, 8))
            n = simd.lane(box, COUNT) * times
            simd.write(left_costs, k - axis * used, half_area(box) * _item_cost(n, share))
            simd.write(before, k - axis * used, n)
        box = _empty_box()
        for plane in range(used - 1, 0, -1):
            box = _merge(box, simd.load(bins, (axis * used + plane) * 8, 8))
            n = simd.lane(box, COUNT) * times
            cost = simd.read(left_costs, plane - 1) + half_area(box) * _item_cost(n, share)
            if cost < best and n > np.float32(0.0) and simd.read(before, plane - 1) > np.float32(0.0):
                best, best_axis, best_plane = cost, axis, plane
    return best, best_axis, best_plane


@helper
def _item_cost(n: Any, share: Any) -> Any:
    """Cost of n items: blocks of 1 / share items, and _LATER for each item."""
    return simd.ceil(n * share) + np.float32(_LATER) * n
