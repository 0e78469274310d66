"""Trees with sixteen children a node (eight without AVX-512), for one ray against as many boxes or triangles at a time.

Made from binary trees, choosing which of their nodes to keep so that the whole costs least (Ylitie, Karras & Laine, "Efficient
Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017). A node is six rows of planes and a row of links; a leaf,
as many triangles side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import halves, machine, simd
from .halves import Part, Run, half_area
from .kernels import helper, kernel

WIDTH = 16 if machine.AVX512 else 8  # children of a node, and triangles of a leaf
NODE = 6 * WIDTH  # planes of a node: rows of low x, high x, low y, high y, low z, high z; of empty places low inf, high -inf
LEAF = 9 * WIDTH  # coordinates of a leaf: rows of x, y, z of the first corners, then of the second, of the third
DEPTH = 2048  # of a walk's stack: up to fifteen for each of at most 48 levels, and for the halvings of what lies below
STEP = 0.3  # what going down a level of the binary tree costs, against the test of a leaf
TEST = 3.0  # what that costs, against the test of a node
SLACK = 2.0**-22  # of the largest coordinate, by which boxes grow: what rounding to float32 does to a ray's origin, four times
PART = -(1 << 30)  # links of the topmost nodes to parts, before those have their places
EMPTY = -1 - (1 << 29)
spread32, spread64 = getattr(simd, f"f32x{WIDTH}"), getattr(simd, f"f64x{WIDTH}")  # a number in as many lanes


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


def build(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """The tree of triangles (t, 3), rows of positions (v, 3); t > 0.

    It is the same on any number of threads (0: all there are).
    """
    with halves.runner(threads or machine.cores()) as run:
        items = simd.aligned_empty((len(triangles), 8), np.float32)
        shares = _shares(len(items))
        around = np.empty((len(shares), 8), np.float32)
        list(run(lambda k: boxes_of(positions, triangles, items, *shares[k], around, k), range(len(shares))))
        tree, parts = halves.build(items, around.min(axis=0), WIDTH, STEP, run)
        return _collapsed(tree, parts, _Mesh(positions, triangles), run)


def links(tree: halves.Halves, parts: list[Part], run: Run) -> NDArray[np.int32]:
    """The links alone of a tree over items without triangles: ~ an item's number where a leaf's would stand."""
    return _collapsed(tree, parts, _Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), run).links


def _shares(n: int, least: int = 1 << 15) -> list[tuple[int, int]]:
    """0 … n in pieces for threads."""
    step = max(least, -(-n // 16))
    return [(k, min(k + step, n)) for k in range(0, n, step)]


def _collapsed(tree: halves.Halves, parts: list[Part], mesh: _Mesh, run: Run) -> Wide:
    """The tree with eight or more children a node; its parts, on threads, then stand one behind the other."""
    slack = np.float32(SLACK * np.abs(tree.boxes[0][[0, 1, 2, 4, 5, 6]]).max())
    width = WIDTH if len(mesh.triangles) else 1

    def collapsed(part: Part, closed: NDArray[np.int64], known: NDArray[np.float32]) -> tuple[Wide, np.float32]:
        rows = 2 * int(tree.count[part.root])
        costs, shares = np.empty((rows, WIDTH), np.float32), np.empty((rows, WIDTH), np.int8)
        kept = int(share_out(tree, *part, closed, known, width, costs, shares))
        made = room(kept, kept if len(mesh.triangles) else 0)
        nodes, leaves = collapse(tree, *part, closed, shares, mesh, slack, made)
        return Wide(made.nodes[:nodes], made.links[:nodes], made.leaves[:leaves], made.rows[:leaves]), costs[0, 0]

    none = np.zeros(0)
    below = list(run(lambda part: collapsed(part, none.astype(np.int64), none.astype(np.float32)), parts))
    if len(parts) == 1:
        return below[0][0]
    closed = np.array([part.root for part in parts], np.int64)
    made = [collapsed(Part(0, 1), closed, np.array([cost for _, cost in below], np.float32))[0], *(one for one, _ in below)]
    node = np.cumsum([0, *(len(one.nodes) for one in made)])
    leaf = np.cumsum([0, *(len(one.leaves) for one in made)])
    top = made[0].links
    np.copyto(top, node[np.clip(PART - top, 0, len(parts) - 1) + 1], where=top <= PART, casting="unsafe")
    whole = room(int(node[-1]), int(leaf[-1]))
    list(run(lambda k: join(whole, made[k], node[k], leaf[k], 0), range(len(made))))
    return whole


def room(nodes: int, leaves: int) -> Wide:
    """A tree's arrays, not filled."""
    return Wide(
        simd.aligned_empty((nodes, NODE), np.float32), simd.aligned_empty((nodes, WIDTH), np.int32),
        simd.aligned_empty((leaves, LEAF), np.float32), simd.aligned_empty((leaves, WIDTH), np.int32),
    )  # fmt: skip


def pooled(trees: list[Wide], rows: list[int]) -> Wide:
    """Trees one behind the other, with links that fit; the triangles of each are numbered from its entry in `rows` on."""
    if len(trees) == 1 and rows == [0]:
        return trees[0]
    whole = room(sum(len(tree.nodes) for tree in trees), sum(len(tree.leaves) for tree in trees))
    node = leaf = 0
    for tree, row in zip(trees, rows, strict=True):
        join(whole, tree, node, leaf, row)
        node, leaf = node + len(tree.nodes), leaf + len(tree.leaves)
    return whole


def fineness(tree: Wide, some: int = 512) -> float:
    """How wide leaves are: the median of the largest sides of some of their boxes."""
    step = max(1, len(tree.leaves) // some)
    corners = tree.leaves[::step].reshape(-1, 3, 3, WIDTH)
    there = (tree.rows[::step] >= 0)[:, None, None]
    low, high = np.where(there, corners, np.inf).min(axis=(1, 3)), np.where(there, corners, -np.inf).max(axis=(1, 3))
    return float(np.median((high - low).max(axis=1)))


@kernel
def boxes_of(positions, triangles, items, start, end, around, k):
    """Set the boxes of triangles start … end as halves.py wants them, and row k of `around` to the box of all."""
    whole = simd.f32x8(np.inf)
    numbers = items.view(np.int32)
    for i in range(start, end):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        for j in range(3):
            x, y, z = positions[a, j], positions[b, j], positions[c, j]
            items[i, j] = min(x, min(y, z))
            items[i, 4 + j] = -max(x, max(y, z))
        numbers[i, halves.NUMBER] = i | halves.TAG
        items[i, halves.COUNT] = 1.0
        whole = simd.minimum(whole, simd.load(items, i * 8, 8))
    simd.store(around, k * 8, whole)


@kernel
def share_out(tree, root, free, closed, known, width, costs, shares):
    """Find what the binary tree below `root` costs at least as a wide one, and how; no more nodes or leaves than are returned.

    Rows of the tables are those of `_row`. costs[i, j - 1] is that of a node as at most j children of another; shares[i, j - 1], how
    many of them its first half has then, 0 where one less is as good. shares[i, -1] is that of a node of its own. Where a leaf costs
    less, of up to `width` items, the node becomes one. Those that are `closed` have costs that are `known`.
    """
    order = np.empty(2 * tree.count[root], np.int64)
    order[0], n, done = root, 1, 0
    while done < n:
        s = order[done]
        done += 1
        if tree.second[s] != 0 and not _is_closed(closed, s):
            order[n], order[n + 1] = tree.second[s] - 1, tree.second[s]
            n += 2
    best = np.empty(WIDTH + 1, np.float32)
    for k in range(n - 1, -1, -1):
        s = order[k]
        i = _row(s, root, free)
        area = half_area(simd.load(tree.boxes, s * 8, 8))
        if tree.second[s] == 0 or _is_closed(closed, s):
            costs[i] = area * np.float32(TEST) if tree.second[s] == 0 else known[_number(closed, s)]
            continue
        b = _row(np.int64(tree.second[s]), root, free)
        a = b - 1
        for j in range(2, WIDTH + 1):
            best[j] = np.inf
            for p in range(max(1, j + 1 - WIDTH), min(j, WIDTH)):
                cost = costs[a, p - 1] + costs[b, j - p - 1]
                if cost < best[j]:
                    best[j], shares[i, j - 1] = cost, p
        costs[i, 0] = best[WIDTH] + area
        if tree.count[s] <= width and area * np.float32(TEST) <= costs[i, 0] and s != root:
            tree.second[s] = 0
            costs[i] = area * np.float32(TEST)
            continue
        for j in range(2, WIDTH):
            costs[i, j - 1] = best[j]
            if costs[i, j - 2] <= best[j]:
                costs[i, j - 1], shares[i, j - 1] = costs[i, j - 2], 0
    return n


@helper
def _row(s: int, root: int, free: int) -> int:
    return 0 if s == root else s - free + 1


@helper
def _is_closed(closed: Any, node: int) -> bool:
    found = False
    for k in range(len(closed)):
        found |= closed[k] == node
    return found


@kernel
def collapse(tree, root, free, closed, shares, mesh, slack, out):
    """Fill `out` with the nodes and leaves below `root` of a binary tree; how many of both. Closed nodes become links to parts."""
    stack = np.empty((DEPTH, 2), np.int64)
    chosen = np.empty((WIDTH, 2), np.int64)
    stack[0, 0], stack[0, 1] = root, 0
    top, used, ends = 1, 1, 0
    while top > 0:
        top -= 1
        node = stack[top, 1]
        n = _children(tree, stack[top, 0], root, free, closed, shares, chosen)
        for i in range(WIDTH):
            if i >= n:
                for k in range(3):
                    out.nodes[node, 2 * k * WIDTH + i], out.nodes[node, (2 * k + 1) * WIDTH + i] = np.inf, -np.inf
                out.links[node, i] = EMPTY
                continue
            child = chosen[i, 0]
            for k in range(3):
                out.nodes[node, 2 * k * WIDTH + i] = tree.boxes[child, k] - slack
                out.nodes[node, (2 * k + 1) * WIDTH + i] = slack - tree.boxes[child, 4 + k]
            if _is_closed(closed, child):
                out.links[node, i] = PART - _number(closed, child)
            elif tree.second[child] == 0 and len(mesh.triangles) == 0:
                out.links[node, i] = -1 - (simd.float_bits(tree.items[tree.first[child], halves.NUMBER]) & ~halves.TAG)
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
def _number(closed: Any, node: int) -> Any:
    return np.searchsorted(closed, node)


@helper
def _children(tree: Any, s: int, root: int, free: int, closed: Any, shares: Any, chosen: Any) -> int:
    """Put the children of a node as `share_out` found them into chosen[:, 0]; how many there are."""
    chosen[0, 0], chosen[0, 1] = s, 1
    if tree.second[s] == 0:
        return 1
    chosen[0, 1] = WIDTH
    n, i = 1, 0
    while i < n:
        s, j = chosen[i, 0], chosen[i, 1]
        row = _row(s, root, free)
        while j > 1 and shares[row, j - 1] == 0:
            j -= 1
        if j == 1 or tree.second[s] == 0 or _is_closed(closed, s):
            i += 1
            continue
        k = np.int64(shares[row, j - 1])
        chosen[i, 0], chosen[i, 1] = tree.second[s] - 1, k
        chosen[n, 0], chosen[n, 1] = tree.second[s], j - k
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
            rows[leaf, j] = row
        else:
            for k in range(9):
                leaves[leaf, k * WIDTH + j] = np.nan  # which nothing passes through
            rows[leaf, j] = -1


@kernel
def join(whole, part, node, leaf, row):
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
        for k in range(LEAF):
            whole.leaves[leaf + i, k] = part.leaves[i, k]
        for k in range(WIDTH):
            whole.rows[leaf + i, k] = part.rows[i, k] + row if part.rows[i, k] >= 0 else -1
