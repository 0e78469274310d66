"""Which nodes of a binary tree one with more children a node keeps, so that the whole costs least.

Ylitie, Karras & Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017. Where a node shall have up to j
children, those are shared out between its halves in the best of all ways; a half that gets one is a child itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.arena import Scratch
from ...jit.kernel import helper, noinline_helper
from ...simd import target
from .binned_sah import Halves, half_area

WIDTH = 16 if target.AVX512 else 8  # children of a node, and triangles of a leaf
TEST = 3.0  # what the test of a leaf costs, against that of a node
DEPTH = 2048  # of a walk's stack: up to fifteen for each of at most 48 levels, and for the halvings of what lies below
ROW = 2 * WIDTH  # numbers that the costs of a node take: what cannot be, then the costs as up to 1, 2, … children of another
_spread, _spread_whole = getattr(simd, f"f32x{WIDTH}"), getattr(simd, f"i32x{WIDTH}")


def empty(n: int, memory: Scratch) -> NDArray[np.uint8]:
    """Room for the shares (2 n, WIDTH) of nodes of a tree over n items.

    [i, j - 1] is how many of node i's j children its first half has, 0 where one less is as good; [i, -1] is that of a node of its own, and
    [i, 0] is 1 where another part of the tree begins, which was chosen apart.
    """
    return memory.empty((2 * n, WIDTH), np.uint8)


@helper
def set_cost(cost: Any, row: int, known: Any) -> None:
    """A node that is one child, whatever it might have been, costs so much."""
    simd.store(cost, row * ROW, _spread(np.inf))
    simd.store(cost, row * ROW + WIDTH, _spread(known))


@helper
def cost_of(cost: Any, row: int) -> Any:
    """What a node costs as one child of another."""
    return simd.read(cost, row * ROW + WIDTH)


@helper
def distribute_slots(tree: Halves, share: Any, node: int, cost: Any, row: int, a: int, b: int) -> None:
    """Find what a node costs, whose halves' costs stand in rows a and b, and how it shares its children out between them."""
    best, shares = _spread(np.inf), _spread_whole(0)
    for p in range(1, WIDTH):
        both = simd.load(cost, b * ROW + WIDTH - p, WIDTH) + simd.read(cost, a * ROW + WIDTH + p - 1)
        better = both < best
        best, shares = simd.select(better, both, best), simd.select(better, np.int32(p), shares)
    at = row * ROW + WIDTH
    simd.store(cost, at - WIDTH, _spread(np.inf))
    simd.store(cost, at, best)
    simd.store(share, node * WIDTH, shares)
    simd.write(share, node * WIDTH, np.uint8(0))
    least = simd.read(cost, at + WIDTH - 1) + half_area(simd.load(tree.boxes, node * 8, 8))
    simd.write(cost, at, least)
    for j in range(1, WIDTH - 1):
        here = simd.read(cost, at + j)
        if least <= here:
            simd.write(cost, at + j, least)
            simd.write(share, node * WIDTH + j, np.uint8(0))
        else:
            least = here


@noinline_helper
def choose_wide_nodes(tree: Halves, share: Any, root: int, begin: int, end: int, width: int, cost: Any) -> None:
    """Find how a wide tree takes all below `root`, which stands from `begin` to `end`; its cost is then in row 0.

    Where a leaf costs less, of up to `width` items, a node becomes one. `cost` has a row more than there are nodes below.
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
    """Another part of the tree begins there, which was chosen apart."""
    simd.write(share, node * WIDTH, np.uint8(1))


@helper
def is_apart(share: Any, node: int) -> bool:
    """Whether another part of the tree begins there."""
    return simd.read(share, node * WIDTH) != 0


@helper
def children(tree: Halves, share: Any, root: int, chosen: Any) -> int:
    """Put the children of a node of the wide tree into chosen[:, 0]; how many there are."""
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
def counted(tree: Halves, share: Any, root: int, stack: Any, chosen: Any) -> tuple[int, int]:
    """How many nodes and leaves the wide tree has from a node down, without other parts."""
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
