"""How far instances of meshes reach along the world's axes, found in the meshes' own trees.

The box around a box that was turned is up to √3 times as wide as what is in it, and rays would enter instances that they are far from.
What is farthest along a direction is found as a ray finds what is nearest: of a node's children those are asked first that reach
farthest, and not at all where they reach less far than what was found (branch and bound).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.kernel import helper, kernel
from ..build.wide_bvh import DEPTH, EMPTY, NODE, WIDTH, Wide, spread32
from . import single_ray

SOME = 64  # turned instances from which on it is worth it
ROUNDING = 2.0**-21  # of the largest sum's parts: what float32 does to three products and their sum


def tighten_bounds(
    boxes: NDArray[np.float64], which: NDArray[np.int64], tree: Wide, roots: NDArray[np.int32], origins: NDArray[np.float64],
    matrices: NDArray[np.float64], slack: float,
) -> None:  # fmt: skip
    """Shrink boxes (instances, 6) of instances of meshes around what those hold.

    Of instance i in `which` the mesh's tree has its root at roots[i], and stands at origins[i] (instances, 3) in the frame that
    matrices[i] (instances, 3, 4) brings to the world; what is found grows by `slack` of its coordinates.
    """
    if len(which) < SOME:
        return
    turned = which[np.count_nonzero(matrices[which, :, :3], axis=(1, 2)) > 3]
    if len(turned) >= SOME:
        shrink(boxes, turned, tree.nodes, tree.links, roots, origins, matrices, slack)


@kernel
def shrink(boxes, which, nodes, links, roots, origins, matrices, slack):
    children, reaches = simd.stack_array(np.int32, DEPTH), simd.stack_array(np.float32, DEPTH)
    for i in which:
        for axis in range(3):
            x, y, z = matrices[i, axis, 0], matrices[i, axis, 1], matrices[i, axis, 2]
            place = matrices[i, axis, 3] + x * origins[i, 0] + y * origins[i, 1] + z * origins[i, 2]
            parts = abs(matrices[i, axis, 3]) + abs(x * origins[i, 0]) + abs(y * origins[i, 1]) + abs(z * origins[i, 2])
            up = farthest(nodes, links, roots[i], x, y, z, children, reaches)
            down = farthest(nodes, links, roots[i], -x, -y, -z, children, reaches)
            grown = slack * (parts + abs(up) + abs(down))
            boxes[i, axis] = max(boxes[i, axis], place - down - grown)
            boxes[i, 3 + axis] = min(boxes[i, 3 + axis], place + up + grown)


@helper
def farthest(nodes: Any, links: Any, root: int, x: float, y: float, z: float, children: Any, reaches: Any) -> float:
    """The most that x · p₀ + y · p₁ + z · p₂ is where p is in the boxes of a tree's leaves, or a little more; a stack is given."""
    sx, sy, sz = spread32(np.float32(x)), spread32(np.float32(y)), spread32(np.float32(z))
    rx, ry, rz = WIDTH if x > 0.0 else 0, (3 if y > 0.0 else 2) * WIDTH, (5 if z > 0.0 else 4) * WIDTH
    best, rounding, most = np.float32(-np.inf), np.float32(0.0), np.float32(np.inf)
    node, top = np.int64(root), np.int64(0)
    while True:
        at = node * NODE
        a, b, c = simd.load(nodes, at + rx, WIDTH) * sx, simd.load(nodes, at + ry, WIDTH) * sy, simd.load(nodes, at + rz, WIDTH) * sz
        link = simd.load(links, node * WIDTH, WIDTH)
        there = link > EMPTY
        reach = simd.select(there, a + b + c, np.float32(-np.inf))
        rounding = max(rounding, simd.max_of(simd.select(there, abs(a) + abs(b) + abs(c), np.float32(0.0))))
        if node == root:
            most = simd.max_of(reach)
        before, best = best, max(best, simd.max_of(simd.select(link < 0, reach, np.float32(-np.inf))))
        if best > before:
            top = single_ray.sifted(children, reaches, 0, top, most - best)
        short = simd.maximum(most - reach, spread32(0.0))  # how much less far than the whole mesh a child reaches
        node, top = single_ray.nearest_first(links, node, short, simd.bits((link >= 0) & (reach > best)), children, reaches, top)
        if top < 0:
            return np.float64(best) + ROUNDING * np.float64(rounding)
