"""Trees with eight children a node, for one ray against eight boxes or eight triangles at a time.

Made from binary trees: the child of largest area is opened until there are eight (Wald, Benthin & Boulos, "Getting Rid of
Packets", 2008). A node is six rows of planes and eight links; a leaf, eight triangles side by side.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import halves, simd
from .halves import Run, half_area
from .kernels import helper, kernel

WIDTH = 8
NODE = 6 * WIDTH  # planes of a node: rows of low x, high x, low y, high y, low z, high z; of empty places low inf, high -inf
LEAF = 9 * WIDTH  # coordinates of a leaf: rows of x, y, z of the first corners, then of the second, of the third
DEPTH = 1024  # of a walk's stack: seven for each of at most 48 levels, and for the halvings of what lies below
STEP = 0.5  # what going down a level costs against the test of eight triangles
SLACK = 2.0**-22  # of the largest coordinate, by which boxes grow: what rounding to float32 does to a ray's origin, four times
PART = -(1 << 30)  # links of the topmost nodes to parts, before those have their places
EMPTY = -1 - (1 << 29)


class Wide(NamedTuple):
    """A mesh's tree. A link is a node's number, ~ a leaf's, or below both where there is none; the root is node 0."""

    nodes: NDArray[np.float32]  # (n, NODE)
    links: NDArray[np.int32]  # (n, WIDTH)
    leaves: NDArray[np.float32]  # (l, LEAF)
    rows: NDArray[np.int32]  # (l, WIDTH) which triangle, -1 where there is none

    @property
    def nbytes(self) -> int:
        """Bytes in memory."""
        return sum(part.nbytes for part in self)


class _Mesh(NamedTuple):
    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]
    first: int


def build(positions: NDArray[np.float32], triangles: NDArray[np.int32], first: int = 0, threads: int = 0) -> Wide:
    """The tree of triangles (t, 3), rows of positions (v, 3), which are numbered from `first` on; t > 0.

    It is the same on any number of threads (0: all there are).
    """
    with halves.pool(threads or len(os.sched_getaffinity(0))) as pool:
        items = simd.aligned_empty((len(triangles), 8), np.float32)
        list(pool.map(lambda k: boxes_of(positions, triangles, items, *k), _shares(len(items))))
        tree, parts = halves.build(items, WIDTH, STEP, pool.map)
        return _collapsed(tree, parts, _Mesh(positions, triangles, first), pool.map)


def _shares(n: int, least: int = 1 << 15) -> list[tuple[int, int]]:
    """0 … n in pieces for threads."""
    step = max(least, -(-n // 16))
    return [(k, min(k + step, n)) for k in range(0, n, step)]


def _collapsed(tree: halves.Halves, parts: list[int], mesh: _Mesh, run: Run) -> Wide:
    """The tree with eight children a node; its parts, on threads, then stand one behind the other."""
    slack = np.float32(SLACK * np.abs(tree.boxes[0][[0, 1, 2, 4, 5, 6]]).max())
    none = np.zeros(0, np.int64)

    def part(root: int, closed: NDArray[np.int64]) -> Wide:
        ends = int(count_leaves(tree.second, root, closed))
        made = _room(2 * len(closed) + 1 if len(closed) else ends, ends)
        nodes, leaves = collapse(tree, root, closed, mesh, slack, made)
        return Wide(made.nodes[:nodes], made.links[:nodes], made.leaves[:leaves], made.rows[:leaves])

    made = list(run(lambda root: part(root, none), parts))
    if parts == [0]:
        return made[0]
    made = [part(0, np.array(parts, np.int64)), *made]
    node = np.cumsum([0, *(len(one.nodes) for one in made)])
    leaf = np.cumsum([0, *(len(one.leaves) for one in made)])
    top = made[0].links
    np.copyto(top, node[np.clip(PART - top, 0, len(parts) - 1) + 1], where=top <= PART, casting="unsafe")
    whole = _room(int(node[-1]), int(leaf[-1]))
    list(run(lambda k: join(whole, made[k], node[k], leaf[k]), range(len(made))))
    return whole


def _room(nodes: int, leaves: int) -> Wide:
    return Wide(
        simd.aligned_empty((nodes, NODE), np.float32), simd.aligned_empty((nodes, WIDTH), np.int32),
        simd.aligned_empty((leaves, LEAF), np.float32), simd.aligned_empty((leaves, WIDTH), np.int32),
    )  # fmt: skip


def pooled(trees: list[Wide]) -> Wide:
    """Trees one behind the other, with links that fit."""
    if len(trees) == 1:
        return trees[0]
    whole = _room(sum(len(tree.nodes) for tree in trees), sum(len(tree.leaves) for tree in trees))
    node = leaf = 0
    for tree in trees:
        join(whole, tree, node, leaf)
        node, leaf = node + len(tree.nodes), leaf + len(tree.leaves)
    return whole


@kernel
def boxes_of(positions, triangles, items, start, end):
    """Set the boxes of triangles start … end as halves.py wants them."""
    numbers = items.view(np.int32)
    for i in range(start, end):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        for k in range(3):
            x, y, z = positions[a, k], positions[b, k], positions[c, k]
            items[i, k] = min(x, min(y, z))
            items[i, 4 + k] = -max(x, max(y, z))
        numbers[i, halves.NUMBER] = i | halves.TAG
        items[i, 7] = 0.0


@kernel
def count_leaves(second, root, closed):
    """How many leaves the binary tree below `root` has; none below nodes that are closed."""
    stack = np.empty(128, np.int64)
    stack[0], top, ends = root, 1, 0
    while top > 0:
        top -= 1
        node = stack[top]
        if _is_closed(closed, node):
            continue
        if second[node] == 0:
            ends += 1
            continue
        stack[top], stack[top + 1] = second[node], node + 1
        top += 2
    return ends


@helper
def _is_closed(closed: Any, node: int) -> bool:
    for k in range(len(closed)):
        if closed[k] == node:
            return True
    return False


@kernel
def collapse(tree, root, closed, mesh, slack, out):
    """Fill `out` with the nodes and leaves below `root` of a binary tree; how many of both. Closed nodes become links to parts."""
    stack = np.empty((DEPTH, 2), np.int64)
    chosen = np.empty(WIDTH, np.int64)
    stack[0, 0], stack[0, 1] = root, 0
    top, used, ends = 1, 1, 0
    while top > 0:
        top -= 1
        node = stack[top, 1]
        chosen[0] = stack[top, 0]
        n = _open(tree, chosen, closed)
        for i in range(WIDTH):
            if i >= n:
                for k in range(3):
                    out.nodes[node, 2 * k * WIDTH + i], out.nodes[node, (2 * k + 1) * WIDTH + i] = np.inf, -np.inf
                out.links[node, i] = EMPTY
                continue
            child = chosen[i]
            for k in range(3):
                out.nodes[node, 2 * k * WIDTH + i] = tree.boxes[child, k] - slack
                out.nodes[node, (2 * k + 1) * WIDTH + i] = slack - tree.boxes[child, 4 + k]
            if _is_closed(closed, child):
                out.links[node, i] = PART - _number(closed, child)
            elif tree.second[child] == 0:
                _fill(tree, child, mesh, out.leaves, out.rows, ends)
                out.links[node, i] = -1 - ends
                ends += 1
            else:
                out.links[node, i] = used
                stack[top, 0], stack[top, 1] = child, used
                used += 1
                top += 1
    return used, ends


@helper
def _number(closed: Any, node: int) -> int:
    return np.searchsorted(closed, node)


@helper
def _open(tree: Any, chosen: Any, closed: Any) -> int:
    """Open the largest of the chosen nodes, from the one in chosen[0] on, until eight or none is inner; how many there are."""
    n = 1
    while n < WIDTH:
        largest, where = np.float32(-1.0), -1
        for i in range(n):
            s = chosen[i]
            if tree.second[s] != 0 and not _is_closed(closed, s):
                area = half_area(simd.load(tree.boxes, s * 8, 8))
                if area > largest:
                    largest, where = area, i
        if where < 0:
            break
        s = chosen[where]
        chosen[where], chosen[n] = s + 1, tree.second[s]
        n += 1
    return n


@helper
def _fill(tree: Any, node: int, mesh: Any, leaves: Any, rows: Any, leaf: int) -> None:
    """Put a binary leaf's triangles side by side."""
    first, n = tree.first[node], tree.count[node]
    for j in range(WIDTH):
        if j < n:
            row = simd.float_bits(tree.items[first + j, halves.NUMBER]) & ~halves.TAG
            for corner in range(3):
                v = mesh.triangles[row, corner]
                for k in range(3):
                    leaves[leaf, (3 * corner + k) * WIDTH + j] = mesh.positions[v, k]
            rows[leaf, j] = mesh.first + row
        else:
            for k in range(9):
                leaves[leaf, k * WIDTH + j] = 0.0
            rows[leaf, j] = -1


@kernel
def join(whole, part, node, leaf):
    """Copy a part to its place, from `node` and `leaf` on."""
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
        for k in range(LEAF):
            whole.leaves[leaf + i, k] = part.leaves[i, k]
        for k in range(WIDTH):
            whole.rows[leaf + i, k] = part.rows[i, k]
