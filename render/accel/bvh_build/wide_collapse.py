"""Collapses a binary BVH into the wide BVH of least SAH cost, by dynamic programming.

Ylitie, Karras & Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017. The slots of a wide node are
distributed optimally between the two children of the binary node; a child that gets one slot becomes a child of the wide node.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.arena import Scratch
from ...jit.kernel import helper, noinline_helper
from ...lanes import crosslane
from ...simd import target
from .binned_sah import BinaryBvh, half_area

WIDTH = 16 if target.WIDTH == 16 else 8  # children of a node and triangles of a leaf
TEST = 3.0  # cost of a leaf test, relative to a node test
DEPTH = 2048  # entries of a traversal stack: up to fifteen for each of at most 48 levels, and for the median splits below
ROW = 2 * WIDTH  # floats of a node's costs: WIDTH times inf, then the costs with up to 1, 2, … slots
_spread, _spread_whole = crosslane.spreader(f"f32x{WIDTH}"), crosslane.spreader(f"i32x{WIDTH}")


def empty(n: int, memory: Scratch) -> NDArray[np.uint8]:
    """Allocate the slot distribution (2 n, WIDTH) of a BVH over n items.

    [i, j - 1] is the number of node i's j slots that its first child gets, 0 where one slot less is as good. [i, -1] is that of a wide
    node. [i, 0] is 1 where a separately collapsed part begins.
    """
    return memory.empty((2 * n, WIDTH), np.uint8)


@helper
def set_cost(cost: Any, row: int, node_cost: Any) -> None:
    """Set the costs of a node that takes one slot in any case."""
    simd.store(cost, row * ROW, _spread(np.inf))
    simd.store(cost, row * ROW + WIDTH, _spread(node_cost))


@helper
def cost_of(cost: Any, row: int) -> Any:
    """Cost of a node with one slot."""
    return simd.read(cost, row * ROW + WIDTH)


@helper
def distribute_slots(tree: BinaryBvh, share: Any, node: int, cost: Any, row: int, a: int, b: int) -> None:
    """Compute the costs of a node from those of its children in rows a and b, and its slot distribution."""
    best, shares = _spread(np.inf), _spread_whole(0)
    for p in range(1, WIDTH):
        both = simd.load(cost, b * ROW + WIDTH - p, WIDTH) + simd.read(cost, a * ROW + WIDTH + p - 1)
        better = both < best
        best, shares = simd.select(better, both, best), simd.select(better, np.int32(p), shares)
    start = row * ROW + WIDTH
    simd.store(cost, start - WIDTH, _spread(np.inf))
    simd.store(cost, start, best)
    simd.store(share, node * WIDTH, shares)
    simd.write(share, node * WIDTH, np.uint8(0))
    least = simd.read(cost, start + WIDTH - 1) + half_area(simd.load(tree.boxes, node * 8, 8))
    simd.write(cost, start, least)
    for j in range(1, WIDTH - 1):
        slot_cost = simd.read(cost, start + j)
        if least <= slot_cost:
            simd.write(cost, start + j, least)
            simd.write(share, node * WIDTH + j, np.uint8(0))
        else:
            least = slot_cost


@noinline_helper
def choose_wide_nodes(tree: BinaryBvh, share: Any, root: int, begin: int, end: int, width: int, cost: Any) -> None:
    """Choose the wide nodes of the subtree of `root`, whose nodes are rows `begin` to `end`; row 0 of `cost` is then its cost.

    A node of up to `width` items becomes a leaf where that costs less. `cost` has one row more than the subtree has nodes.
    """
    for k in range(end - begin, -1, -1):
        node = root if k == 0 else begin + k - 1
        half = np.int64(tree.second[node]) - 1
        alone = half_area(simd.load(tree.boxes, node * 8, 8)) * np.float32(TEST)
        if half >= 0:
            row = half - begin + 1
            distribute_slots(tree, share, node, cost, k, row, row + 1)
            if k == 0 or tree.count[node] > width or alone > cost_of(cost, k):
                continue
            tree.second[node] = 0
        simd.write(share, node * WIDTH, np.uint8(0))
        set_cost(cost, k, alone)


@helper
def set_apart(share: Any, node: int) -> None:
    """Mark a node as the root of a separately collapsed part."""
    simd.write(share, node * WIDTH, np.uint8(1))


@helper
def is_apart(share: Any, node: int) -> bool:
    """Whether a node is the root of a separately collapsed part."""
    return simd.read(share, node * WIDTH) != 0


@helper
def children(tree: BinaryBvh, share: Any, root: int, chosen: Any) -> int:
    """Write the children of a wide node to chosen[:, 0]; return their number."""
    chosen[0, 0], chosen[0, 1] = root, WIDTH
    n, i = 1, 0
    while i < n:
        node, j = chosen[i, 0], np.int64(chosen[i, 1])
        half = np.int64(tree.second[node]) - 1
        if half < 0 or (node != root and is_apart(share, node)):
            j = 1
        while j > 1 and share[node, j - 1] == 0:
            j -= 1
        if j == 1:
            i += 1
            continue
        k = np.int64(share[node, j - 1])
        chosen[i, 0], chosen[i, 1] = half, k
        chosen[n, 0], chosen[n, 1] = half + 1, j - k
        n += 1
    return n


@noinline_helper
def count_nodes(tree: BinaryBvh, share: Any, root: int, stack: Any, chosen: Any) -> tuple[int, int]:
    """(nodes, leaves) of the wide BVH below a node, without other parts."""
    stack[0] = root
    top, nodes, leaves = 1, 1, 0
    while top > 0:
        top -= 1
        for k in range(children(tree, share, stack[top], chosen)):
            node = np.int64(chosen[k, 0])
            if node != root and is_apart(share, node):
                continue
            if tree.second[node] == 0:
                leaves += 1
            else:
                stack[top] = node
                nodes, top = nodes + 1, top + 1
    return nodes, leaves
