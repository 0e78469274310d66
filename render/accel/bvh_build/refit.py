"""Refits the BVH of a mesh whose vertices moved: same topology, new boxes. A large SAH cost requires a rebuild."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...jit.kernel import kernel
from . import wide_bvh
from .wide_bvh import EMPTY, SLACK, WIDTH, Wide, triangle_of
from .wide_collapse import TEST

MAX_COST_RATIO = 1.25  # largest cost of a refit BVH, relative to its cost when built


def cost(tree: Wide) -> float:
    """Expected cost of a ray through the root's box, in node tests (surface area heuristic)."""
    planes = tree.nodes.reshape(-1, 3, 2, WIDTH).astype(np.float64)
    with np.errstate(invalid="ignore"):
        x, y, z = (np.maximum(planes[:, k, 1] - planes[:, k, 0], 0.0) for k in range(3))
        area = np.where(tree.links > EMPTY, x * y + y * z + z * x, 0.0)
    low, high = planes[0, :, 0].min(axis=1), planes[0, :, 1].max(axis=1)
    a, b, c = (high - low).tolist()
    root_area = a * b + b * c + c * a
    return 1.0 + float((area * np.where(tree.links < 0, TEST, 1.0)).sum()) / root_area if root_area > 0 else 1.0


def refit(tree: Wide, positions: NDArray[np.float32], triangles: NDArray[np.int32]) -> Wide:
    """A BVH with the topology of `tree` for the same triangles (t, 3) at other positions (v, 3).

    Rays have the same hits as in a new BVH. `tree` is not changed.
    """
    refitted = wide_bvh.allocate(len(tree.nodes), len(tree.leaves))
    refitted.links[...], refitted.rows[...] = tree.links, tree.rows  # the rows are part of the leaves
    fit(refitted, positions, triangles)
    return refitted


@kernel
def fit(tree, positions, triangles):
    """Fill the leaves and node boxes of a BVH with given links and rows; nodes come before their children."""
    around = np.empty((len(tree.nodes) + len(tree.leaves), 6), np.float32)  # bounds of nodes, then of leaves
    first = len(tree.nodes)
    most = np.float32(0.0)
    for leaf in range(len(tree.leaves)):
        for k in range(3):
            around[first + leaf, k], around[first + leaf, 3 + k] = np.inf, -np.inf
        for j in range(WIDTH):
            row = triangle_of(tree.leaves, leaf, j)
            for corner in range(3):
                for k in range(3):
                    x = np.float32(np.nan)
                    if row >= 0:
                        x = positions[triangles[row, corner], k]
                        around[first + leaf, k] = min(around[first + leaf, k], x)
                        around[first + leaf, 3 + k] = max(around[first + leaf, 3 + k], x)
                        most = max(most, abs(x))
                    tree.leaves[leaf, (3 * corner + k) * WIDTH + j] = x
    slack = np.float32(SLACK * most)
    for node in range(len(tree.nodes) - 1, -1, -1):
        for k in range(3):
            around[node, k], around[node, 3 + k] = np.inf, -np.inf
        for i in range(WIDTH):
            link = tree.links[node, i]
            for k in range(3):
                low, high = np.float32(np.inf), np.float32(-np.inf)
                if link > EMPTY:
                    child = link if link >= 0 else first - 1 - link
                    low, high = around[child, k], around[child, 3 + k]
                    around[node, k] = min(around[node, k], low)
                    around[node, 3 + k] = max(around[node, 3 + k], high)
                    low, high = low - slack, high + slack
                tree.nodes[node, 2 * k * WIDTH + i], tree.nodes[node, (2 * k + 1) * WIDTH + i] = low, high
