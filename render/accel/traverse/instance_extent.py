"""Tight world bounds of mesh instances, found by branch and bound in the meshes' BVHs.

The bounding box of a rotated box is up to √3 times as wide as its contents, so rays would enter instances far from them. The farthest point
along a direction is found like a nearest hit: children that reach farthest are visited first, and pruned below the best found so far.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.kernel import helper, kernel
from ..bvh_build.wide_bvh import DEPTH, EMPTY, NODE, WIDTH, Wide, spread32
from . import node_stack

Frames = Callable[[NDArray[np.int64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
_CHUNK = 1 << 16  # instances whose matrices are gathered at once
MIN_ROTATED = 64  # rotated instances from which on tight bounds pay off
ROUNDING = 2.0**-21  # relative to the parts of the largest sum: float32 error of three products and their sum


def tighten_bounds(
    boxes: NDArray[np.float64], which: NDArray[np.int64], tree: Wide, roots: NDArray[np.int32], frames: Frames, slack: float,
) -> None:  # fmt: skip
    """Shrink boxes (instances, 6) of the mesh instances in `which` to their contents, in place.

    The mesh of instance i has its root at roots[i]. `frames` gives the origins (n, 3) of the meshes of some instances, and the matrices
    (n, 3, 4) that take these to the world. Bounds grow by `slack`, relative to their coordinates.
    """
    parts = np.array_split(which, len(which) // _CHUNK + 1)
    parts = [part[np.count_nonzero(frames(part)[1][:, :, :3], axis=(1, 2)) > 3] for part in parts]
    if sum(map(len, parts)) < MIN_ROTATED:
        return
    for part in parts:
        close = boxes[part]
        shrink(close, tree.nodes, tree.links, roots[part], *frames(part), slack)
        boxes[part] = close


@kernel
def shrink(boxes, nodes, links, roots, origins, matrices, slack):
    """Kernel of `tighten_bounds` for boxes (n, 6) of instances that are all rotated."""
    stack, distances = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    for i in range(len(boxes)):
        for axis in range(3):
            x, y, z = matrices[i, axis, 0], matrices[i, axis, 1], matrices[i, axis, 2]
            place = matrices[i, axis, 3] + x * origins[i, 0] + y * origins[i, 1] + z * origins[i, 2]
            parts = abs(matrices[i, axis, 3]) + abs(x * origins[i, 0]) + abs(y * origins[i, 1]) + abs(z * origins[i, 2])
            up = farthest(nodes, links, roots[i], x, y, z, stack, distances)
            down = farthest(nodes, links, roots[i], -x, -y, -z, stack, distances)
            grown = slack * (parts + abs(up) + abs(down))
            boxes[i, axis] = max(boxes[i, axis], place - down - grown)
            boxes[i, 3 + axis] = min(boxes[i, 3 + axis], place + up + grown)


@helper
def farthest(nodes: Any, links: Any, root: int, x: float, y: float, z: float, stack: Any, distances: Any) -> float:
    """Upper bound of the support x·p₀ + y·p₁ + z·p₂ over a BVH's leaf boxes; `stack` and `distances` are buffers."""
    sx, sy, sz = spread32(np.float32(x)), spread32(np.float32(y)), spread32(np.float32(z))
    rx, ry, rz = WIDTH if x > 0.0 else 0, (3 if y > 0.0 else 2) * WIDTH, (5 if z > 0.0 else 4) * WIDTH
    best, rounding, most = np.float32(-np.inf), np.float32(0.0), np.float32(np.inf)
    node, top = np.int64(root), np.int64(0)
    while True:
        start = node * NODE
        a, b, c = (
            simd.load(nodes, start + rx, WIDTH) * sx,
            simd.load(nodes, start + ry, WIDTH) * sy,
            simd.load(nodes, start + rz, WIDTH) * sz,
        )
        link = simd.load(links, node * WIDTH, WIDTH)
        used = link > EMPTY
        reach = simd.select(used, a + b + c, np.float32(-np.inf))
        rounding = max(rounding, simd.max_of(simd.select(used, abs(a) + abs(b) + abs(c), np.float32(0.0))))
        if node == root:
            most = simd.max_of(reach)
        before, best = best, max(best, simd.max_of(simd.select(link < 0, reach, np.float32(-np.inf))))
        if best > before:
            top = node_stack.cull(stack, distances, 0, top, most - best)
        short = simd.maximum(most - reach, spread32(0.0))  # distance of a child's support from that of the whole mesh
        node, top = node_stack.descend_nearest(links, node, short, simd.bits((link >= 0) & (reach > best)), stack, distances, top)
        if top < 0:
            return np.float64(best) + ROUNDING * np.float64(rounding)
