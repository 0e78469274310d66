"""Wide BVHs of sixteen children a node (eight without AVX-512): a ray tests as many boxes or triangles at a time.

A wide BVH is collapsed (wide_collapse.py) from a binary one (parallel_build.py). A node is six rows of planes and a row of links; a leaf
is WIDTH triangles side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit import arena, thread_pool
from ...jit.kernel import helper, kernel
from ...jit.packed_struct import Handle
from ...lanes import crosslane
from ...simd import target
from ...simd.atomics import fetch_add
from . import binned_sah, parallel_build, wide_collapse
from .parallel_build import Mesh
from .wide_collapse import DEPTH, WIDTH

NODE = 6 * WIDTH  # floats of a node: rows of low x, high x, low y, high y, low z, high z; low inf, high -inf without a child
LEAF = 10 * WIDTH  # floats of a leaf: rows of x, y, z of the first, second and third corners, then triangle numbers as bits of int32
WHICH = 9 * WIDTH
SLACK = 2.0**-22  # growth of boxes, relative to the largest coordinate: four float32 roundings of a ray's origin
EMPTY = -1 - (1 << 29)
spread32, spread64 = crosslane.spreader(f"f32x{WIDTH}"), crosslane.spreader(f"f64x{WIDTH}")  # a number in all lanes


class Wide(NamedTuple):
    """The BVH of a mesh. A link is a node, ~ a leaf or EMPTY, which is below both; the root is node 0."""

    nodes: NDArray[np.float32]  # (n, NODE)
    links: NDArray[np.int32]  # (n, WIDTH)
    leaves: NDArray[np.float32]  # (l, LEAF)

    @property
    def rows(self) -> NDArray[np.int32]:
        """Triangle numbers, -1: none, (l, WIDTH)."""
        return self.leaves.view(np.int32)[:, WHICH:]

    @property
    def corners(self) -> NDArray[np.float32]:
        """x, y, z of the triangles' first, second and third corners, NaN without a triangle, (l, 3, 3, WIDTH)."""
        return self.leaves[:, :WHICH].reshape(-1, 3, 3, WIDTH)

    @property
    def nbytes(self) -> int:
        """Size in memory, in bytes."""
        return sum(part.nbytes for part in self)


def build(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """Build the BVH of triangles (t, 3), rows of positions (v, 3); t > 0. Independent of the number of threads (0: all cores)."""
    mesh, threads = Mesh(np.ascontiguousarray(positions), np.ascontiguousarray(triangles)), threads or target.cores()
    with arena.arena(parallel_build.bytes_of(len(triangles))) as memory:
        return _collapse_parts(parallel_build.build_over_triangles(mesh, threads, memory), threads)


def links(items: NDArray[np.float32], around: NDArray[np.float32], threads: int = 0) -> NDArray[np.int32]:
    """The links of a BVH over items, with ~ an item for a leaf; arguments as of parallel_build.build_over_items."""
    threads = threads or target.cores()
    with arena.arena(parallel_build.bytes_of(len(items))) as memory:
        return _collapse_parts(parallel_build.build_over_items(items, around, threads, memory), threads).links


def _collapse_parts(growth: Handle, threads: int) -> Wide:
    """Collapse to a wide BVH on threads; the parts stand one after another, after the nodes above them."""
    parts, nodes, leaves = (int(n) for n in growth.tables.sizes)
    pool, threads = allocate(nodes, leaves if growth.tables.width > 1 else 0), min(threads, parts)
    thread_pool.parallel_for(lambda _: collapse(growth, pool), range(threads), threads)
    return pool


def allocate(nodes: int, leaves: int) -> Wide:
    """Allocate a BVH, uninitialized."""
    return Wide(
        simd.aligned_empty((nodes, NODE), np.float32), simd.aligned_empty((nodes, WIDTH), np.int32),
        simd.aligned_empty((leaves, LEAF), np.float32),
    )


def concatenate(trees: list[Wide], rows: list[int]) -> Wide:
    """Concatenate BVHs into one pool, with adjusted links; triangles of each are numbered from its entry in `rows` on."""
    if len(trees) == 1 and rows == [0]:
        return trees[0]
    pool = allocate(sum(len(tree.nodes) for tree in trees), sum(len(tree.leaves) for tree in trees))
    node = leaf = 0
    for tree, row in zip(trees, rows, strict=True):
        copy_into_pool(pool, tree, node, leaf, row)
        node, leaf = node + len(tree.nodes), leaf + len(tree.leaves)
    return pool


def median_leaf_extent(tree: Wide, some: int = 64) -> float:
    """Median of the largest sides of leaf boxes, over a sample of nodes."""
    step = max(1, len(tree.nodes) // some)
    planes, links = tree.nodes[::-step], tree.links[::-step]  # the last node has only leaves
    size = planes[:, WIDTH : 2 * WIDTH] - planes[:, :WIDTH]
    for row in (2 * WIDTH, 4 * WIDTH):
        np.maximum(size, planes[:, row + WIDTH : row + 2 * WIDTH] - planes[:, row : row + WIDTH], out=size)
    rising = np.sort(size[(links < 0) & (links > EMPTY)])  # np.median takes three times as long
    return float(rising[len(rising) >> 1])


@kernel
def collapse(growth, out):
    """Write the nodes and leaves of the parts of a binary BVH to `out`; threads share the parts."""
    stack, children = np.empty((DEPTH, 2), np.int64), np.empty((WIDTH, 2), np.int64)
    most = np.float32(0.0)
    for k in range(3):
        most = max(most, max(abs(growth.tree.boxes[0, k]), abs(growth.tree.boxes[0, 4 + k])))
    while True:
        k = fetch_add(growth.counters, parallel_build.COLLAPSED, 1)
        if k >= growth.sizes[0]:
            break
        _write_part(growth, growth.parts[k, 0], growth.parts[k, 1], growth.parts[k, 2], np.float32(SLACK) * most, out, stack, children)


@helper
def _write_part(growth: Any, root: int, first: int, leaf: int, slack: Any, out: Any, stack: Any, children: Any) -> None:
    """Write one part, from its first node and leaf on."""
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
                out.links[node, i] = _first_node(growth, child)
            elif tree.second[child] != 0:
                out.links[node, i] = used
                stack[top, 0], stack[top, 1] = child, used
                used += 1
                top += 1
            elif len(growth.mesh.triangles) == 0:
                out.links[node, i] = -1 - (simd.float_bits(tree.items[tree.first[child], binned_sah.NUMBER]) & ~binned_sah.TAG)
            else:
                _write_leaf(tree, child, growth.mesh, out.leaves, leaf)
                out.links[node, i] = -1 - leaf
                leaf += 1


@helper
def _first_node(growth: Any, root: int) -> int:
    """The first wide node of the part with a root, other than the first part."""
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
    """The number of triangle j of a leaf, -1: none."""
    return simd.float_bits(simd.read(leaves, leaf * LEAF + WHICH + j))


@helper
def set_triangle(leaves: Any, leaf: int, j: int, row: Any) -> None:
    """Set the number of triangle j of a leaf."""
    leaves.view(np.int32)[leaf, WHICH + j] = row


@helper
def _write_leaf(tree: Any, node: int, mesh: Any, leaves: Any, leaf: int) -> None:
    """Write the triangles of a binary leaf side by side."""
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
                leaves[leaf, k * WIDTH + j] = np.nan  # never hit
            set_triangle(leaves, leaf, j, -1)


@kernel
def copy_into_pool(pool, part, node, leaf, row):
    """Copy a BVH into a pool, from `node` and `leaf` on; its triangles are numbered from `row` on."""
    for i in range(len(part.nodes)):
        for k in range(NODE):
            pool.nodes[node + i, k] = part.nodes[i, k]
        for k in range(WIDTH):
            link = part.links[i, k]
            if link >= 0:
                link += node
            elif link < 0 and link > EMPTY:
                link -= leaf
            pool.links[node + i, k] = link
    for i in range(len(part.leaves)):
        for k in range(WHICH):
            pool.leaves[leaf + i, k] = part.leaves[i, k]
        for j in range(WIDTH):
            number = triangle_of(part.leaves, i, j)
            set_triangle(pool.leaves, leaf + i, j, number + row if number >= 0 else -1)
