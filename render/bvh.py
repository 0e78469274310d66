"""Bounding volume hierarchies: a tree for each mesh, one over the instances, built by binned surface area heuristic.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. All trees are flat arrays in one pool, so that a
mesh used by many instances has one tree. What has no bounds (planes) stands in a list beside the tree and is always tried.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from .kernels import kernel

BINS = 16
DEPTH = 64  # of a traversal's stack: below level 32 nodes are halved, so that no tree is deeper
HALVE_BELOW = 32
MESH_LEAF = 4
SLACK = 1e-12  # of its coordinates, by which an instance's box grows: transforms round


class Bvh(NamedTuple):
    """Nodes come in pairs of siblings; an inner node's children are first[node] and first[node] + 1."""

    bounds: NDArray[np.float64]  # (n, 6) lowest x, y, z, highest x, y, z; a mesh's are relative to its origin
    first: NDArray[np.int32]  # (n,) the left child, or a leaf's first item
    count: NDArray[np.int32]  # (n,) items of a leaf; 0: an inner node
    triangles: NDArray[np.int32]  # (t,) items of meshes' leaves: rows of Pools.triangles
    corners: NDArray[np.float32]  # (t, 9) their corners, relative to the mesh's origin
    instances: NDArray[np.int32]  # (i,) items of the leaves of the tree over instances
    endless: NDArray[np.int32]  # instances outside of the tree, rising
    roots: NDArray[np.int32]  # (geometries,) root of a mesh's tree, or -1
    top: int  # root of the tree over instances, or -1: all are in `endless`


def build(tables: ir.Tables, brute: bool = False) -> Bvh:
    """The trees of a scene. With `brute` there is none over the instances: each of them is tried."""
    geometries, instances = tables.geometries, tables.instances
    trees: list[tuple[Any, Any, Any]] = []
    triangles: list[NDArray[np.int32]] = []
    roots = np.full(len(geometries.kind), -1, np.int32)
    nodes = items = 0
    for g in np.unique(instances.geometry[geometries.kind[instances.geometry] == ir.GeometryKind.MESH]):
        first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
        if count == 0:
            continue
        corners = tables.pools.positions[tables.pools.triangles[first : first + count]].astype(np.float64)
        order, tree = _tree(np.concatenate([corners.min(1), corners.max(1)], axis=1), MESH_LEAF)
        roots[g] = nodes
        trees.append(_moved(tree, nodes, items))
        triangles.append((first + order).astype(np.int32))
        nodes += len(tree[1])
        items += count
    boxes = world_bounds(tables)
    drawable = (geometries.kind[instances.geometry] != ir.GeometryKind.MESH) | (roots[instances.geometry] >= 0)
    bounded = np.isfinite(boxes).all(axis=1) & (not brute)
    inside = np.flatnonzero(drawable & bounded).astype(np.int32)
    top = -1
    if len(inside):
        order, tree = _tree(boxes[inside], 1)
        inside, top = inside[order], nodes
        trees.append(_moved(tree, nodes, 0))
    rows = np.concatenate(triangles) if triangles else np.zeros(0, np.int32)
    return Bvh(
        bounds=np.concatenate([t[0] for t in trees]) if trees else np.zeros((0, 6)),
        first=np.concatenate([t[1] for t in trees]) if trees else np.zeros(0, np.int32),
        count=np.concatenate([t[2] for t in trees]) if trees else np.zeros(0, np.int32),
        triangles=rows,
        corners=np.ascontiguousarray(tables.pools.positions[tables.pools.triangles[rows]].reshape(-1, 9)),
        instances=inside,
        endless=np.flatnonzero(drawable & ~bounded).astype(np.int32),
        roots=roots,
        top=top,
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


def _tree(boxes: NDArray[np.float64], leaf: int) -> tuple[NDArray[np.int32], tuple[Any, Any, Any]]:
    """The order of the items in the leaves, and (bounds, first, count) of the nodes."""
    order = np.arange(len(boxes), dtype=np.int32)
    bounds = np.empty((2 * len(boxes) + 1, 6))
    first = np.empty(2 * len(boxes) + 1, np.int32)
    count = np.empty(2 * len(boxes) + 1, np.int32)
    used = build_tree(np.ascontiguousarray(boxes), order, bounds, first, count, leaf)
    return order, (bounds[:used].copy(), first[:used].copy(), count[:used].copy())


def _moved(tree: tuple[Any, Any, Any], nodes: int, items: int) -> tuple[Any, Any, Any]:
    """A tree whose nodes and items stand behind those of others."""
    bounds, first, count = tree
    return bounds, (first + np.where(count == 0, nodes, items)).astype(np.int32), count


@kernel
def build_tree(boxes, order, bounds, first, count, leaf):
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
        _enclose(boxes, order, start, end, bounds, node)
        if end - start == 1:
            first[node], count[node] = start, 1
            continue
        middle, worth = start, True
        if depth < HALVE_BELOW:
            middle, worth = _split(boxes, order, start, end, bounds[node], low, high, filled, cost_right)
        if end - start <= leaf and not worth:
            first[node], count[node] = start, end - start
            continue
        if middle <= start or middle >= end:
            middle = (start + end) // 2
        first[node], count[node] = used, 0
        stack[top, 0], stack[top, 1], stack[top, 2], stack[top, 3] = used + 1, middle, end, depth + 1
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2], stack[top + 1, 3] = used, start, middle, depth + 1
        used += 2
        top += 2
    return used


@kernel
def _enclose(boxes, order, start, end, bounds, node):
    """bounds[node] = the box of items start … end."""
    for k in range(3):
        lo, hi = np.inf, -np.inf
        for i in range(start, end):
            lo = min(lo, boxes[order[i], k])
            hi = max(hi, boxes[order[i], 3 + k])
        bounds[node, k], bounds[node, 3 + k] = lo, hi


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
    extent = around[3:] - around[:3]
    area = extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0]
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
