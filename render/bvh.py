"""Bounding volume hierarchies: a wide tree for each mesh, a binary one over the instances, by binned surface area heuristic.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. All meshes' trees stand in one pool, so that a
mesh used by many instances has one tree. What has no bounds (planes) stands in a list beside the tree and is always tried.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import wide
from .kernels import kernel
from .wide import Wide

BINS = 16
DEPTH = 64  # of a traversal's stack: below level 32 nodes are halved, so that no tree is deeper
HALVE_BELOW = 32
FIRST, COUNT = 6, 7  # columns of a node
SLACK = 1e-12  # of its coordinates, by which an instance's box grows: transforms round


class Bvh(NamedTuple):
    """All that traversal reads, in few arrays: Numba hands each part of each array from function to function.

    A node is (lowest x, y, z, highest x, y, z, first, count). Inner nodes have count 0 and children first and first + 1;
    leaves hold count items from first on. A mesh's boxes and corners are relative to its origin.
    """

    wide: Wide  # of meshes; its rows are those of Pools.triangles
    boxes: NDArray[np.float64]  # (geometries, 8) of meshes: lowest x, y, z, highest x, y, z
    nodes: NDArray[np.float64]  # (n, 8) over instances
    instances: NDArray[np.int32]  # (i,) items of the leaves of the tree over instances
    endless: NDArray[np.int32]  # instances outside of the tree, rising
    top: int  # root of the tree over instances, or -1: all are in `endless`
    placed: NDArray[np.int32]  # (instances, 5) visibility, transform, geometry, kind, root of a mesh's tree
    inverse: NDArray[np.float64]  # Transforms.inverse
    parameters: NDArray[np.float64]  # Geometries.parameters
    origin: NDArray[np.float64]  # Geometries.origin
    search: int = 0  # address of traverse.search, for kernels


def build(tables: ir.Tables, brute: bool = False) -> Bvh:
    """The trees of a scene. With `brute` there is none over the instances: each of them is tried."""
    geometries, instances = tables.geometries, tables.instances
    used = instances.geometry[geometries.kind[instances.geometry] == ir.GeometryKind.MESH]
    meshes, roots = mesh_trees(tables, np.unique(used))
    boxes = world_bounds(tables)
    kind = geometries.kind[instances.geometry]
    root = roots[instances.geometry]
    drawable = (kind != ir.GeometryKind.MESH) | (root >= 0)
    bounded = np.isfinite(boxes).all(axis=1) & (not brute)
    inside = np.flatnonzero(drawable & bounded).astype(np.int32)
    top = -1
    nodes = np.zeros((0, 8))
    if len(inside):
        order, nodes = _tree(boxes[inside])
        inside, top = inside[order], 0
    placed = np.stack([instances.visible, instances.transform, instances.geometry, kind, root], axis=1)
    return Bvh(
        wide=meshes,
        boxes=local_bounds(tables),
        nodes=nodes,
        instances=inside,
        endless=np.flatnonzero(drawable & ~bounded).astype(np.int32),
        top=top,
        placed=np.ascontiguousarray(placed, np.int32),
        inverse=tables.transforms.inverse,
        parameters=geometries.parameters,
        origin=geometries.origin,
    )


def world_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """(instances, 6) boxes in the world, grown by what rounding may move a thing; not finite where a thing is endless."""
    instances = tables.instances
    boxes = tables.geometries.bounds[instances.geometry]
    matrix = tables.transforms.matrix[instances.transform]
    with np.errstate(invalid="ignore"):
        middle, half = 0.5 * (boxes[:, 0] + boxes[:, 1]), 0.5 * (boxes[:, 1] - boxes[:, 0])
        centre = np.einsum("nij,nj->ni", matrix[:, :, :3], middle) + matrix[:, :, 3]
        reach = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), half)
        magnitude = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), np.abs(middle)) + np.abs(matrix[:, :, 3]) + reach
        reach = reach + SLACK * magnitude.max(axis=1, keepdims=True, initial=0.0)
    return np.concatenate([centre - reach, centre + reach], axis=1)


def mesh_trees(tables: ir.Tables, used: NDArray[np.int32]) -> tuple[Wide, NDArray[np.int32]]:
    """The trees of meshes, and where each geometry's begins: -1 where it has none."""
    geometries, pools = tables.geometries, tables.pools
    roots = np.full(len(geometries.kind), -1, np.int32)
    made, nodes = [], 0
    for g in used:
        first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
        if count > 0:
            tree = wide.build(pools.positions, pools.triangles[first : first + count], first)
            made.append(tree)
            roots[g] = nodes
            nodes += len(tree.nodes)
    return wide.pooled(made), roots


def local_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """(geometries, 8) the boxes of geometries relative to their origins, as nodes."""
    low, high = (tables.geometries.bounds[:, k] - tables.geometries.origin for k in range(2))
    return np.ascontiguousarray(np.concatenate([low, high, np.zeros((len(low), 2))], axis=1))


def _tree(boxes: NDArray[np.float64]) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """The order of the items in the leaves, and the nodes."""
    order = np.arange(len(boxes), dtype=np.int32)
    nodes = np.empty((2 * len(boxes) + 1, 8))
    used = build_tree(np.ascontiguousarray(boxes), order, nodes, 1)
    return order, nodes[:used].copy()


@kernel
def build_tree(boxes, order, nodes, leaf):
    """Fill the nodes of a tree over `boxes` (n, 6) and sort `order` into its leaves; returns how many nodes there are."""
    stack = np.empty((2 * DEPTH, 4), np.int64)
    low, high = np.empty((BINS, 3)), np.empty((BINS, 3))
    filled = np.empty(BINS, np.int64)
    cost_right = np.empty(BINS)
    used = 1
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, len(order), 0
    top = 1
    while top > 0:
        top -= 1
        node, start, end, depth = stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3]
        _enclose(boxes, order, start, end, nodes[node])
        middle, worth = start, end - start > 1
        if end - start > 1 and depth < HALVE_BELOW:
            middle, worth = _split(boxes, order, start, end, nodes[node], low, high, filled, cost_right)
        if end - start <= leaf and not worth:
            nodes[node, FIRST], nodes[node, COUNT] = start, end - start
            continue
        if middle <= start or middle >= end:
            middle = (start + end) // 2
        nodes[node, FIRST], nodes[node, COUNT] = used, 0
        stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = used + 1, middle, end, depth + 1
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2], stack[top + 1, 3] = used, start, middle, depth + 1
        used += 2
        top += 2
    return used


@kernel
def _enclose(boxes, order, start, end, node):
    """Set a node's box to that of items start … end."""
    for k in range(3):
        lo, hi = np.inf, -np.inf
        for i in range(start, end):
            lo = min(lo, boxes[order[i], k])
            hi = max(hi, boxes[order[i], 3 + k])
        node[k], node[3 + k] = lo, hi


@kernel
def _split(boxes, order, start, end, around, low, high, filled, cost_right):
    """Part the items where the heuristic says: (where the second half begins, whether that beats a leaf).

    The first number is `start` where all middles coincide on every axis.
    """
    best, best_axis, best_bin, best_lo, best_scale = np.inf, -1, 0, 0.0, 0.0
    for axis in range(3):
        c_lo, c_hi = np.inf, -np.inf
        for i in range(start, end):
            c = boxes[order[i], axis] + boxes[order[i], 3 + axis]
            c_lo, c_hi = min(c_lo, c), max(c_hi, c)
        if not c_hi > c_lo:
            continue
        scale = BINS * (1.0 - 1e-9) / (c_hi - c_lo)
        if not np.isfinite(scale):
            continue
        low[:, :], high[:, :], filled[:] = np.inf, -np.inf, 0
        for i in range(start, end):
            row = order[i]
            b = int((boxes[row, axis] + boxes[row, 3 + axis] - c_lo) * scale)
            filled[b] += 1
            for k in range(3):
                low[b, k] = min(low[b, k], boxes[row, k])
                high[b, k] = max(high[b, k], boxes[row, 3 + k])
        cost, b = _cheapest(low, high, filled, cost_right)
        if cost < best:
            best, best_axis, best_bin, best_lo, best_scale = cost, axis, b, c_lo, scale
    if best_axis < 0:
        return start, False
    left, right = start, end - 1
    while left <= right:
        row = order[left]
        if int((boxes[row, best_axis] + boxes[row, 3 + best_axis] - best_lo) * best_scale) <= best_bin:
            left += 1
        else:
            order[left], order[right] = order[right], row
            right -= 1
    x, y, z = around[3] - around[0], around[4] - around[1], around[5] - around[2]
    area = x * y + y * z + z * x
    return left, best + area < (end - start) * area


@kernel
def _cheapest(low, high, filled, cost_right):
    """(cost, bin) of the best plane after a bin: area times count, left and right; a step down costs as much as an item."""
    lo, hi = np.full(3, np.inf), np.full(3, -np.inf)
    number = 0
    for b in range(BINS - 1, 0, -1):
        number += filled[b]
        cost_right[b] = number * _grow(lo, hi, low[b], high[b])
    lo[:], hi[:] = np.inf, -np.inf
    number, best, where = 0, np.inf, 0
    for b in range(BINS - 1):
        number += filled[b]
        cost = number * _grow(lo, hi, low[b], high[b]) + cost_right[b + 1]
        if cost < best:
            best, where = cost, b
    return best, where


@kernel
def _grow(lo, hi, low, high):
    """Grow a box by another; half its area (0 while it is empty)."""
    for k in range(3):
        lo[k], hi[k] = min(lo[k], low[k]), max(hi[k], high[k])
    x, y, z = hi[0] - lo[0], hi[1] - lo[1], hi[2] - lo[2]
    return x * y + y * z + z * x if x >= 0.0 else 0.0
