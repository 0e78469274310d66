"""Trees with sixteen children a node (eight without AVX-512), for one ray against as many boxes or triangles at a time.

Made from binary trees, choosing which of their nodes to keep so that the whole costs least (Ylitie, Karras & Laine, "Efficient
Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", 2017). A node is six rows of planes and a row of links; a leaf,
as many triangles side by side.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import halves, machine, simd
from .halves import half_area
from .kernels import helper, kernel
from .workers import Workers

WIDTH = 16 if machine.AVX512 else 8  # children of a node, and triangles of a leaf
NODE = 6 * WIDTH  # planes of a node: rows of low x, high x, low y, high y, low z, high z; of empty places low inf, high -inf
LEAF = 10 * WIDTH  # of a leaf: rows of x, y, z of the first corners, then of the second, of the third; which triangles, as bits of int32
WHICH = 9 * WIDTH
DEPTH = 2048  # of a walk's stack: up to fifteen for each of at most 48 levels, and for the halvings of what lies below
STEP = 0.3  # what going down a level of the binary tree costs, against the test of a leaf
TEST = 3.0  # what that costs, against the test of a node
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


class _Mesh(NamedTuple):
    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]


def build(positions: NDArray[np.float32], triangles: NDArray[np.int32], threads: int = 0) -> Wide:
    """The tree of triangles (t, 3), rows of positions (v, 3); t > 0.

    It is the same on any number of threads (0: all there are).
    """
    by, positions, triangles = Workers(threads or machine.cores()), _read_only(positions), _read_only(triangles)
    items = simd.paged_empty((len(triangles), 8), np.float32)
    shares = _shares(len(items))
    around = np.empty((len(shares), 2, 8), np.float32)
    by.map(lambda k: boxes_of(positions, triangles, items, *shares[k], around, k), range(len(shares)))
    return _collapsed(items, around.min(axis=0), _Mesh(positions, triangles), by)


def links(items: NDArray[np.float32], around: NDArray[np.float32], by: Workers) -> NDArray[np.int32]:
    """The links alone of a tree over items without triangles: ~ an item's number where a leaf's would stand; as halves.build."""
    return _collapsed(items, around, _Mesh(_read_only(np.zeros((0, 3), np.float32)), _read_only(np.zeros((0, 3), np.int32))), by).links


def _read_only(numbers: NDArray[Any]) -> NDArray[Any]:
    """An array that is not written to, as some meshes' are: kernels would compile once for these and once for others."""
    view = numbers.view()
    view.flags.writeable = False
    return view


def _shares(n: int, least: int = 1 << 13) -> list[tuple[int, int]]:
    """0 … n in pieces for threads."""
    step = max(least, -(-n // 16))
    return [(k, min(k + step, n)) for k in range(0, n, step)]


class _Choice(NamedTuple):
    """Rows of the nodes of a binary tree below one of them, level by level, and which of them a wide one keeps."""

    node: NDArray[np.int32]
    below: NDArray[np.int32]  # row of the first half, before that of the second; 0 where there are none
    share: NDArray[np.int8]  # (n, WIDTH) see share_out
    cost: NDArray[np.float32]  # (n, WIDTH)


def _choice(rows: int, room: Callable[[tuple[int, ...], Any], NDArray[Any]] = simd.paged_empty) -> _Choice:
    return _Choice(np.empty(rows, np.int32), np.empty(rows, np.int32), room((rows, WIDTH), np.int8), room((rows, WIDTH), np.float32))


def _collapsed(items: NDArray[np.float32], around: NDArray[np.float32], mesh: _Mesh, by: Workers) -> Wide:
    """The tree with eight or more children a node; its parts, on threads, stand one behind the other, after what is above them."""
    width = WIDTH if len(mesh.triangles) else 1
    none, unknown, most = np.zeros(0, np.int32), np.zeros(0, np.float32), 2 * halves.most_of(len(items))
    free: list[_Choice] = []

    def chosen(tree: halves.Halves, part: halves.Part) -> tuple[_Choice, int, int]:
        try:
            found = free.pop()
        except IndexError:
            found = _choice(most)
        n, nodes, leaves = share_out(tree, part.root, none, unknown, width, found)
        kept = _Choice(found.node[:n].copy(), found.below[:n].copy(), found.share[:n].copy(), found.cost[:1].copy())
        free.append(found)
        return kept, nodes, leaves

    tree, parts = halves.build(items, around, width, STEP, by, chosen)
    made, closed = [found for _, found in parts], none
    if len(parts) > 1:
        closed, top = np.array([part.root for part, _ in parts], np.int32), _choice(2 * len(parts), np.empty)
        known = np.array([choice.cost[0, 0] for choice, _, _ in made])
        made.insert(0, (top, *share_out(tree, 0, closed, known, width, top)[1:]))
    firsts, ends = (list(itertools.accumulate((each[k] for each in made), initial=0)) for k in (1, 2))
    whole = room(firsts[-1], ends[-1] if len(mesh.triangles) else 0)
    places = np.array(firsts[1:-1])
    slack = np.float32(SLACK * np.abs(tree.boxes[0, [0, 1, 2, 4, 5, 6]]).max())
    by.map(lambda k: collapse(tree, made[k][0], none if k else closed, places, mesh, slack, whole, firsts[k], ends[k]), range(len(made)))
    return whole


def room(nodes: int, leaves: int) -> Wide:
    """A tree's arrays, not filled."""
    return Wide(
        simd.aligned_empty((nodes, NODE), np.float32), simd.aligned_empty((nodes, WIDTH), np.int32),
        simd.aligned_empty((leaves, LEAF), np.float32),
    )


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


def fineness(tree: Wide, some: int = 64) -> float:
    """How wide leaves are: the median of the largest sides of the boxes of some nodes' leaves."""
    step = max(1, len(tree.nodes) // some)
    planes, links = tree.nodes[::-step].reshape(-1, 3, 2, WIDTH), tree.links[::-step]  # the last node has leaves alone
    size = (planes[:, :, 1] - planes[:, :, 0]).max(axis=1)
    rising = np.sort(size[(links < 0) & (links > EMPTY)])  # np.median takes three times as long
    return float(rising[len(rising) >> 1])


@kernel
def boxes_of(positions, triangles, items, start, end, around, k):
    """Set the boxes of triangles start … end as halves.py wants them, and around[k] to the box and the span of all."""
    whole, span = simd.f32x8(np.inf), simd.f32x8(np.inf)
    numbers = items.view(np.int32)
    for i in range(start, end):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        for j in range(3):
            x, y, z = positions[a, j], positions[b, j], positions[c, j]
            items[i, j] = min(x, min(y, z))
            items[i, 4 + j] = -max(x, max(y, z))
        numbers[i, halves.NUMBER] = i | halves.TAG
        items[i, halves.COUNT] = 1.0
        box = simd.load(items, i * 8, 8)
        whole, span = simd.minimum(whole, box), simd.minimum(span, halves.middle_of(box))
    simd.store(around, k * 16, whole)
    simd.store(around, k * 16 + 8, span)


@kernel
def share_out(tree, root, closed, known, width, found):
    """Find what the binary tree below `root` costs at least as a wide one, and how: how many rows, wide nodes and leaves that takes.

    cost[i, j - 1] is that of a node as at most j children of another; share[i, j - 1], how many of them its first half has then, 0 where
    one less is as good. share[i, -1] is that of a node of its own. Where a leaf costs less, of up to `width` items, the node becomes one.
    Those that are `closed` have costs that are `known`.
    """
    node, below, share, cost = found
    node[0], n, done = root, 1, 0
    while done < n:
        s = np.int64(node[done])
        below[done] = 0
        if tree.second[s] != 0 and not _is_closed(closed, s):
            below[done] = n
            node[n], node[n + 1] = tree.second[s] - 1, tree.second[s]
            n += 2
        done += 1
    best = np.empty(WIDTH + 1, np.float32)
    for i in range(n - 1, -1, -1):
        s, a = np.int64(node[i]), np.int64(below[i])
        area = half_area(simd.load(tree.boxes, s * 8, 8))
        if a == 0:
            cost[i] = area * np.float32(TEST) if tree.second[s] == 0 else known[_number(closed, s)]
            continue
        b = a + 1
        for j in range(2, WIDTH + 1):
            best[j] = np.inf
            for p in range(max(1, j + 1 - WIDTH), min(j, WIDTH)):
                both = cost[a, p - 1] + cost[b, j - p - 1]
                if both < best[j]:
                    best[j], share[i, j - 1] = both, p
        cost[i, 0] = best[WIDTH] + area
        if tree.count[s] <= width and area * np.float32(TEST) <= cost[i, 0] and i > 0:
            below[i] = 0
            cost[i] = area * np.float32(TEST)
            continue
        for j in range(2, WIDTH):
            cost[i, j - 1] = best[j]
            if cost[i, j - 2] <= best[j]:
                cost[i, j - 1], share[i, j - 1] = cost[i, j - 2], 0
    nodes, leaves = _counted(found, closed, np.empty(DEPTH, np.int64), np.empty((WIDTH, 2), np.int64))
    return n, nodes, leaves


@helper
def _counted(found: Any, closed: Any, stack: Any, chosen: Any) -> tuple[int, int]:
    """How many nodes and leaves a wide tree has."""
    stack[0] = 0
    top, nodes, leaves = 1, 1, 0
    while top > 0:
        top -= 1
        for k in range(_children(found, stack[top], chosen)):
            row = chosen[k, 0]
            if found.below[row] == 0:
                leaves += 0 if _is_closed(closed, np.int64(found.node[row])) else 1
            else:
                stack[top] = row
                nodes, top = nodes + 1, top + 1
    return nodes, leaves


@helper
def _is_closed(closed: Any, node: int) -> bool:
    found = False
    for k in range(len(closed)):
        found |= closed[k] == node
    return found


@kernel
def collapse(tree, found, closed, places, mesh, slack, out, first, ends):
    """Put the nodes and leaves that were chosen into `out`, from node `first` and leaf `ends` on; closed nodes stand at `places`."""
    stack = np.empty((DEPTH, 2), np.int64)
    chosen = np.empty((WIDTH, 2), np.int64)
    stack[0, 0], stack[0, 1] = 0, first
    top, used = 1, first + 1
    while top > 0:
        top -= 1
        node = stack[top, 1]
        n = _children(found, stack[top, 0], chosen)
        for i in range(WIDTH):
            if i >= n:
                for k in range(3):
                    out.nodes[node, 2 * k * WIDTH + i], out.nodes[node, (2 * k + 1) * WIDTH + i] = np.inf, -np.inf
                out.links[node, i] = EMPTY
                continue
            row = chosen[i, 0]
            child = np.int64(found.node[row])
            for k in range(3):
                out.nodes[node, 2 * k * WIDTH + i] = tree.boxes[child, k] - slack
                out.nodes[node, (2 * k + 1) * WIDTH + i] = slack - tree.boxes[child, 4 + k]
            if found.below[row] != 0:
                out.links[node, i] = used
                stack[top, 0], stack[top, 1] = row, used
                used += 1
                top += 1
            elif _is_closed(closed, child):
                out.links[node, i] = places[_number(closed, child)]
            elif len(mesh.triangles) == 0:
                out.links[node, i] = -1 - (simd.float_bits(tree.items[tree.first[child], halves.NUMBER]) & ~halves.TAG)
            else:
                _fill(tree, child, mesh, out.leaves, ends)
                out.links[node, i] = -1 - ends
                ends += 1


@helper
def _number(closed: Any, node: int) -> Any:
    return np.searchsorted(closed, node)


@helper
def _children(found: Any, row: int, chosen: Any) -> int:
    """Put the rows of the children of a node as `share_out` found them into chosen[:, 0]; how many there are."""
    chosen[0, 0], chosen[0, 1] = row, 1
    if found.below[row] == 0:
        return 1
    chosen[0, 1] = WIDTH
    n, i = 1, 0
    while i < n:
        row, j = chosen[i, 0], chosen[i, 1]
        while j > 1 and found.share[row, j - 1] == 0:
            j -= 1
        half = np.int64(found.below[row])
        if j == 1 or half == 0:
            i += 1
            continue
        k = np.int64(found.share[row, j - 1])
        chosen[i, 0], chosen[i, 1] = half, k
        chosen[n, 0], chosen[n, 1] = half + 1, j - k
        n += 1
    return n


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
            row = simd.float_bits(tree.items[first + j, halves.NUMBER]) & ~halves.TAG
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
        for k in range(WHICH):
            whole.leaves[leaf + i, k] = part.leaves[i, k]
        for j in range(WIDTH):
            number = triangle_of(part.leaves, i, j)
            set_triangle(whole.leaves, leaf + i, j, number + row if number >= 0 else -1)
