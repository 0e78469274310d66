"""Trees with sixteen children a node (eight without AVX-512), for one ray against as many boxes or triangles at a time.

Made from binary trees (growing.py), of whose nodes some are kept (choice.py). A node is six rows of planes and a row of links; a leaf, as
many triangles side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit import arena, thread_pool
from ...jit.kernel import helper, kernel
from ...jit.packed_struct import Handle
from ...simd import target
from ...simd.atomics import fetch_add
from . import binned_sah, parallel_build, wide_collapse
from .parallel_build import Mesh
from .wide_collapse import DEPTH, WIDTH

NODE = 6 * WIDTH  # planes of a node: rows of low x, high x, low y, high y, low z, high z; of empty places low inf, high -inf
LEAF = 10 * WIDTH  # of a leaf: rows of x, y, z of the first corners, then of the second, of the third; which triangles, as bits of int32
WHICH = 9 * WIDTH
SLACK = 2.0**-22  # of the largest coordinate, by which boxes grow: what rounding to float32 does to a ray's origin, four times
EMPTY = -1 - (1 << 29)
spread32, spread64 = getattr(simd, f"f32x{WIDTH}"), getattr(simd, f"f64x{WIDTH}")  # a number in as many lanes


class Wide(NamedTuple):
    """A mesh's tree. A link is a node's number, ~ a leaf's, or below both where there is none; the root is node 0."""

    nodes: NDArray[np.float32]  # (n, NODE)
    links: NDArray[np.int32]  # (n, WIDTH)
    leaves: NDArray[np.float32]  # (l, LEAF)

    @property
    def rows(self) -> NDArray[np.int32]:
        """(l, WIDTH) which triangle, -1 where there is none."""
        return self.leaves.view(np.int32)[:, WHICH:]

    @property
    def corners(self) -> NDArray[np.float32]:
        """(l, 3, 3, WIDTH) x, y, z of the triangles' first, second and third corners, nan where there is none."""
        return self.leaves[:, :WHICH].reshape(-1, 3, 3, WIDTH)

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return sum(part.nbytes for part in self)


def build(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """The tree of triangles (t, 3), rows of positions (v, 3); t > 0.

    It is the same on any number of threads (0: all there are).
    """
    mesh, threads = Mesh(np.ascontiguousarray(positions), np.ascontiguousarray(triangles)), threads or target.cores()
    with arena.arena(parallel_build.bytes_of(len(triangles))) as memory:
        return _collapsed(parallel_build.of_mesh(mesh, threads, memory), threads)


def links(items: NDArray[np.float32], around: NDArray[np.float32], threads: int = 0) -> NDArray[np.int32]:
    """The links alone of a tree over items without triangles: ~ an item's number where a leaf's would stand; as growing.of_items."""
    threads = threads or target.cores()
    with arena.arena(parallel_build.bytes_of(len(items))) as memory:
        return _collapsed(parallel_build.of_items(items, around, threads, memory), threads).links


def _collapsed(growth: Handle, threads: int) -> Wide:
    """The tree with eight or more children a node; its parts, on threads, stand one behind the other, after what is above them."""
    parts, nodes, leaves = (int(n) for n in growth.tables.sizes)
    whole, threads = allocate(nodes, leaves if growth.tables.width > 1 else 0), min(threads, parts)
    thread_pool.parallel_for(lambda _: collapse(growth, whole), range(threads), threads)
    return whole


def allocate(nodes: int, leaves: int) -> Wide:
    """A tree's arrays, not filled."""
    return Wide(
        simd.aligned_empty((nodes, NODE), np.float32), simd.aligned_empty((nodes, WIDTH), np.int32),
        simd.aligned_empty((leaves, LEAF), np.float32),
    )


def concatenate(trees: list[Wide], rows: list[int]) -> Wide:
    """Trees one behind the other, with links that fit; the triangles of each are numbered from its entry in `rows` on."""
    if len(trees) == 1 and rows == [0]:
        return trees[0]
    whole = allocate(sum(len(tree.nodes) for tree in trees), sum(len(tree.leaves) for tree in trees))
    node = leaf = 0
    for tree, row in zip(trees, rows, strict=True):
        copy_into_pool(whole, tree, node, leaf, row)
        node, leaf = node + len(tree.nodes), leaf + len(tree.leaves)
    return whole


def median_leaf_extent(tree: Wide, some: int = 64) -> float:
    """How wide leaves are: the median of the largest sides of the boxes of some nodes' leaves."""
    step = max(1, len(tree.nodes) // some)
    planes, links = tree.nodes[::-step], tree.links[::-step]  # the last node has leaves alone
    size = planes[:, WIDTH : 2 * WIDTH] - planes[:, :WIDTH]
    for row in (2 * WIDTH, 4 * WIDTH):
        np.maximum(size, planes[:, row + WIDTH : row + 2 * WIDTH] - planes[:, row : row + WIDTH], out=size)
    rising = np.sort(size[(links < 0) & (links > EMPTY)])  # np.median takes three times as long
    return float(rising[len(rising) >> 1])


@kernel
def collapse(growth, out):
    """Put the nodes and leaves of a binary tree's parts into `out`; threads take turns."""
    stack, children = np.empty((DEPTH, 2), np.int64), np.empty((WIDTH, 2), np.int64)
    most = np.float32(0.0)
    for k in range(3):
        most = max(most, max(abs(growth.tree.boxes[0, k]), abs(growth.tree.boxes[0, 4 + k])))
    while True:
        k = fetch_add(growth.counters, parallel_build.COLLAPSED, 1)
        if k >= growth.sizes[0]:
            break
        _collapse(growth, growth.parts[k, 0], growth.parts[k, 1], growth.parts[k, 2], np.float32(SLACK) * most, out, stack, children)


@helper
def _collapse(growth: Any, root: int, first: int, leaf: int, slack: Any, out: Any, stack: Any, children: Any) -> None:
    """One part, from its first node and leaf on."""
    tree, used = growth.tree, first + 1
    stack[0, 0], stack[0, 1] = root, first
    top = 1
    while top > 0:
        top -= 1
        node = stack[top, 1]
        n = wide_collapse.children(tree, growth.share, stack[top, 0], children)
        for i in range(WIDTH):
            if i >= n:
                for k in range(3):
                    out.nodes[node, 2 * k * WIDTH + i], out.nodes[node, (2 * k + 1) * WIDTH + i] = np.inf, -np.inf
                out.links[node, i] = EMPTY
                continue
            child = np.int64(children[i, 0])
            for k in range(3):
                out.nodes[node, 2 * k * WIDTH + i] = tree.boxes[child, k] - slack
                out.nodes[node, (2 * k + 1) * WIDTH + i] = slack - tree.boxes[child, 4 + k]
            if child != root and wide_collapse.is_apart(growth.share, child):
                out.links[node, i] = _part(growth, child)
            elif tree.second[child] != 0:
                out.links[node, i] = used
                stack[top, 0], stack[top, 1] = child, used
                used += 1
                top += 1
            elif len(growth.mesh.triangles) == 0:
                out.links[node, i] = -1 - (simd.float_bits(tree.items[tree.first[child], binned_sah.NUMBER]) & ~binned_sah.TAG)
            else:
                _fill(tree, child, growth.mesh, out.leaves, leaf)
                out.links[node, i] = -1 - leaf
                leaf += 1


@helper
def _part(growth: Any, root: int) -> int:
    """The first node of the part with this root, which is not the first one."""
    low, high = 1, growth.sizes[0] - 1
    while low < high:
        middle = (low + high) >> 1
        if growth.parts[middle, 0] < root:
            low = middle + 1
        else:
            high = middle
    return growth.parts[low, 1]


@helper
def triangle_of(leaves: Any, leaf: int, j: int) -> Any:
    """Which triangle is the j-th of a leaf, -1 where there is none."""
    return simd.float_bits(simd.read(leaves, leaf * LEAF + WHICH + j))


@helper
def set_triangle(leaves: Any, leaf: int, j: int, row: Any) -> None:
    """Say which it is."""
    leaves.view(np.int32)[leaf, WHICH + j] = row


@helper
def _fill(tree: Any, node: int, mesh: Any, leaves: Any, leaf: int) -> None:
    """Put a binary leaf's triangles side by side."""
    first, n = tree.first[node], tree.count[node]
    for j in range(WIDTH):
        if j < n:
            row = simd.float_bits(tree.items[first + j, binned_sah.NUMBER]) & ~binned_sah.TAG
            for corner in range(3):
                v = mesh.triangles[row, corner]
                for k in range(3):
                    leaves[leaf, (3 * corner + k) * WIDTH + j] = mesh.positions[v, k]
            set_triangle(leaves, leaf, j, row)
        else:
            for k in range(9):
                leaves[leaf, k * WIDTH + j] = np.nan  # which nothing passes through
            set_triangle(leaves, leaf, j, -1)


@kernel
def copy_into_pool(whole, part, node, leaf, row):
    """Copy a part to its place, from `node` and `leaf` on; its triangles are numbered from `row` on."""
    for i in range(len(part.nodes)):
        for k in range(NODE):
            whole.nodes[node + i, k] = part.nodes[i, k]
        for k in range(WIDTH):
            link = part.links[i, k]
            if link >= 0:
                link += node
            elif link < 0 and link > EMPTY:
                link -= leaf
            whole.links[node + i, k] = link
    for i in range(len(part.leaves)):
        for k in range(WHICH):
            whole.leaves[leaf + i, k] = part.leaves[i, k]
        for j in range(WIDTH):
            number = triangle_of(part.leaves, i, j)
            set_triangle(whole.leaves, leaf + i, j, number + row if number >= 0 else -1)
