"""Builds a binary BVH on threads, which take nodes to split, or small subtrees to build whole, from a shared task list.

A split node adds two tasks. Each thread stays in one kernel call: returning to Python in between would wait for locks. The BVH does not
depend on the assignment of tasks to threads.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit import thread_pool
from ...jit.arena import Scratch
from ...jit.kernel import allocating_helper, helper, kernel, noinline_helper
from ...jit.packed_struct import Handle
from ...simd.atomics import fetch_add, load_acquire, store_release
from . import binned_sah, wide_collapse
from .binned_sah import BinaryBvh

STEP = 0.3  # cost of a step down the binary BVH, relative to the test of a leaf
PART = 4096  # items of a subtree that one task builds, which then stays in the cache
_PIECE = 8192  # items whose boxes one step computes
_PATIENCE = 300_000  # polls after which a waiting thread yields its core
_PAUSE = 2e-5  # seconds of that
NODE, FREE, LEVEL, BELOW, NODES, LEAVES = range(6)  # columns of `tasks`
BEGUN, ENDED, MADE, TAKEN, LEFT, COLLAPSED = (8 * k for k in range(6))  # positions in `counters`, a cache line each


class Mesh(NamedTuple):
    """The input triangles, or none."""

    positions: NDArray[np.float32]
    triangles: NDArray[np.int32]


class BuildState(NamedTuple):
    """A binary BVH during the build, its collapse to a wide BVH, and the state shared by threads."""

    mesh: Mesh
    tree: BinaryBvh
    share: NDArray[np.uint8]  # see wide_collapse.empty
    width: int  # items of a leaf
    around: NDArray[np.float32]  # (pieces, 2, 8) box and span of each piece of the items; empty where those of all are known
    tasks: NDArray[np.int64]
    """(m, 8): node, first row of its children, level, task of its first child (that of the second follows; 0: a part), and the numbers of
    nodes and leaves of the part's wide BVH."""
    cost: NDArray[np.float32]  # (m,) SAH cost of parts
    ready: NDArray[np.int64]  # (m,) whether a task may start
    counters: NDArray[np.int64]  # pieces begun and ended, tasks made and taken, items left to build, parts collapsed
    parts: NDArray[np.int64]  # (m, 3) binary roots, ascending, first wide nodes and leaves; the nodes above all parts are row 0
    sizes: NDArray[np.int64]  # (3,) numbers of parts, nodes and leaves


def bytes_of(n: int) -> int:
    """Upper bound of the memory that the build of a BVH over n items uses, in bytes."""
    return n * (3 * 8 * 4 + 3 * 2 * 4 + 2 * wide_collapse.WIDTH) + 8 * simd.CACHE_LINE


def build_over_triangles(mesh: Mesh, threads: int, memory: Scratch) -> Handle:
    """Build the BVH over the triangles of a mesh."""
    return _run_workers(allocate_state(mesh, len(mesh.triangles), memory), threads)


def build_over_items(items: NDArray[np.float32], around: NDArray[np.float32], threads: int, memory: Scratch) -> Handle:
    """Build the BVH over items (n, 8), each a leaf, whose box and span are `around` (2, 8)."""
    growth = allocate_state(Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), len(items), memory)
    growth.tree.items[:], growth.tree.boxes[:2], growth.ready[0] = items, around, 1
    return _run_workers(growth, threads)


def allocate_state(mesh: Mesh, n: int, memory: Scratch) -> BuildState:
    """The state of a build of n triangles, with memory for the deepest tree."""
    triangle_count = len(mesh.triangles)
    most = 2 * (n // PART) * (binned_sah.DEEPEST + n.bit_length()) + 1  # each level splits at most n // PART nodes
    growth = BuildState(
        mesh, binned_sah.empty(n, memory), wide_collapse.empty(n, memory), wide_collapse.WIDTH if triangle_count else 1,
        np.empty((-(-triangle_count // _PIECE), 2, 8), np.float32), np.zeros((most, 8), np.int64), np.empty(most, np.float32),
        np.zeros(most, np.int64), np.zeros(6 * 8, np.int64), np.empty((most + 1, 3), np.int64), np.empty(3, np.int64),
    )  # fmt: skip
    growth.tasks[0, FREE], growth.counters[MADE], growth.counters[LEFT] = 1, 1, n
    growth.tree.first[0], growth.tree.count[0] = 0, n
    return growth


def _run_workers(growth: BuildState, threads: int) -> Handle:
    shared = Handle(growth)

    def work(_: int) -> None:
        mine = np.full(1, -1)
        try:
            while not build_worker(shared, mine):
                time.sleep(_PAUSE)
        except BaseException:
            growth.counters[LEFT] = 0  # ends the wait of other threads
            raise

    threads = min(threads, -(-len(growth.tree.items) // PART))
    thread_pool.parallel_for(work, range(threads), threads)
    return shared


@kernel
def build_worker(growth, mine):
    """Work on tasks until none is left and return True, or return False after a long wait for tasks of other threads.

    `mine` holds the task that this thread waits for, -1: none.
    """
    _compute_boxes(growth)
    counters, ready, polls = growth.counters, growth.ready, 0
    buffers, cost = binned_sah.allocate_buffers(), np.empty(2 * PART * wide_collapse.ROW, np.float32)
    stack, children = np.empty(wide_collapse.DEPTH, np.int64), np.empty((wide_collapse.WIDTH, 2), np.int64)
    while load_acquire(counters, LEFT) > 0:
        if mine[0] < 0:
            mine[0] = fetch_add(counters, TAKEN, 1)
        k = mine[0]
        if k >= len(ready) or load_acquire(ready, k) == 0:
            polls += 1
            if polls > _PATIENCE:
                return False
            continue
        mine[0], polls = -1, 0
        node, n = growth.tasks[k, NODE], np.int64(growth.tree.count[growth.tasks[k, NODE]])
        end = binned_sah.split_nodes(
            growth.tree, node, growth.tasks[k, FREE], growth.tasks[k, LEVEL], growth.width, np.float32(STEP), n > PART, buffers
        )
        if n > PART:
            _add_child_tasks(growth, k)
        elif _collapse_part(growth, k, end, cost, stack, children) == n:
            _place_parts(growth, stack, children)
    return True


@helper
def _compute_boxes(growth: Any) -> None:
    """Compute the boxes of triangles, piece by piece; the thread that finishes the last piece makes the root a task."""
    around, counters = growth.around, growth.counters
    pieces = len(around)
    while pieces > 0:
        k = fetch_add(counters, BEGUN, 1)
        if k >= pieces:
            break
        _compute_piece(growth.mesh, growth.tree.items, k, around)
        if fetch_add(counters, ENDED, 1) == pieces - 1:
            for j in range(2):
                box = simd.f32x8(np.inf)
                for piece in range(pieces):
                    box = simd.minimum(box, simd.load(around, piece * 16 + j * 8, 8))
                simd.store(growth.tree.boxes, j * 8, box)
            store_release(growth.ready, 0)


@helper
def _compute_piece(mesh: Any, items: Any, piece: int, around: Any) -> None:
    """Compute the boxes of one piece, and their box and span."""
    bounds, span = simd.f32x8(np.inf), simd.f32x8(np.inf)
    xyz = simd.iota(simd.i32x4(0)) < 3
    for i in range(piece * _PIECE, min((piece + 1) * _PIECE, len(mesh.triangles))):
        a = simd.masked_load(mesh.positions, np.int64(mesh.triangles[i, 0]) * 3, xyz)
        b = simd.masked_load(mesh.positions, np.int64(mesh.triangles[i, 1]) * 3, xyz)
        c = simd.masked_load(mesh.positions, np.int64(mesh.triangles[i, 2]) * 3, xyz)
        low, high = simd.minimum(a, simd.minimum(b, c)), simd.maximum(a, simd.maximum(b, c))
        low = simd.with_lane(low, binned_sah.NUMBER, simd.bits_float(np.int32(i | binned_sah.TAG)))
        high = simd.with_lane(simd.f32x4(0.0) - high, binned_sah.COUNT - 4, np.float32(1.0))
        box = simd.concatenate(low, high)
        simd.store(items, i * 8, box)
        bounds, span = simd.minimum(bounds, box), simd.minimum(span, binned_sah.center_of(box))
    simd.store(around, piece * 16, bounds)
    simd.store(around, piece * 16 + 8, span)


@helper
def _add_child_tasks(growth: Any, k: int) -> None:
    """Make tasks of the children of a task's node."""
    tasks, slot = growth.tasks, fetch_add(growth.counters, MADE, 2)
    second = np.int64(growth.tree.second[tasks[k, NODE]])
    tasks[k, BELOW] = slot
    for j in range(2):
        tasks[slot + j, NODE], tasks[slot + j, FREE] = second - 1 + j, second + 1 if j else tasks[k, FREE]
        tasks[slot + j, LEVEL] = tasks[k, LEVEL] + 1
        store_release(growth.ready, slot + j)


@helper
def _collapse_part(growth: Any, k: int, end: int, cost: Any, stack: Any, children: Any) -> int:
    """Choose the wide nodes of a finished part; return how many items were left before."""
    tree, share, tasks = growth.tree, growth.share, growth.tasks
    node = tasks[k, NODE]
    wide_collapse.choose_wide_nodes(tree, share, node, tasks[k, FREE], end, growth.width, cost)
    tasks[k, NODES], tasks[k, LEAVES] = wide_collapse.count_nodes(tree, share, node, stack, children)
    growth.cost[k] = wide_collapse.cost_of(cost, 0)
    if k > 0:
        wide_collapse.set_apart(share, node)
    return fetch_add(growth.counters, LEFT, -np.int64(tree.count[node]))


@noinline_helper
def _place_parts(growth: Any, stack: Any, children: Any) -> None:
    """Choose the wide nodes above all parts, and assign the parts their rows: after those, one after another."""
    tree, share, tasks, parts = growth.tree, growth.share, growth.tasks, growth.parts
    part_count = node = leaf = 0
    if tasks[0, BELOW] > 0:
        _collapse_above(growth)
        parts[0, 0], parts[0, 1], parts[0, 2] = 0, 0, 0
        part_count, node = 1, wide_collapse.count_nodes(tree, share, 0, stack, children)[0]
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        k = stack[top]
        if tasks[k, BELOW] > 0:
            stack[top], stack[top + 1] = tasks[k, BELOW] + 1, tasks[k, BELOW]
            top += 2
            continue
        parts[part_count, 0], parts[part_count, 1], parts[part_count, 2] = tasks[k, NODE], node, leaf
        part_count, node, leaf = part_count + 1, node + tasks[k, NODES], leaf + tasks[k, LEAVES]
    growth.sizes[0], growth.sizes[1], growth.sizes[2] = part_count, node, leaf


@allocating_helper
def _collapse_above(growth: Any) -> None:
    tasks, task_count = growth.tasks, growth.counters[MADE]
    cost = np.empty(task_count * wide_collapse.ROW, np.float32)
    for k in range(task_count - 1, -1, -1):  # children became tasks after their parents
        below = tasks[k, BELOW]
        if below == 0:
            wide_collapse.set_cost(cost, k, growth.cost[k])
        else:
            wide_collapse.distribute_slots(growth.tree, growth.share, tasks[k, NODE], cost, k, below, below + 1)
