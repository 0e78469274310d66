"""Builds the BVH over instances, in a frame where all instances lie between -1 and 1.

Nodes have the layout of mesh BVHs. parallel_build and wide_collapse give the topology; node boxes are then computed from the boxes of the
instances. Planes are float32 and move out by the rounding error of planes and rays, a two-millionth of the scene. Where that is large
beside most instances, the few very large ones stay outside (`too_large`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...jit.kernel import helper, kernel
from ...types import Vec
from . import binned_sah, wide_bvh
from .wide_bvh import EMPTY, NODE, WIDTH

SLACK = 2.0**-21  # growth of boxes in the BVH's frame: seven float32 roundings of planes and origins
_MAX_OUTSIDE = 8  # instances that may stay outside of the BVH
_SMALL, _LARGE = 32.0 * SLACK, 0.25  # extents, relative to the scene, of instances that are small beside the slack, and of large ones


class Top(NamedTuple):
    """BVH over instances. A link is a node, ~ an instance or EMPTY; the root is node 0. Without nodes it is empty."""

    nodes: NDArray[np.float32]  # (n, NODE) as in Wide, in the BVH's frame
    links: NDArray[np.int32]  # (n, WIDTH); nodes come before their children
    frame: NDArray[np.float64]  # (4,) origin of the frame in the world, and its scale, a power of two


def too_large(boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) whether an instance with box (n, 6) makes the slack large beside most others; none where there are many such."""
    if len(boxes) <= WIDTH:
        return np.zeros(len(boxes), np.bool_)
    size = (boxes[:, 3:] - boxes[:, :3]).max(axis=1)
    extent = (boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)).max()
    large = size > _LARGE * extent
    return large if np.median(size) < _SMALL * extent and np.count_nonzero(large) <= _MAX_OUTSIDE else np.zeros(len(boxes), np.bool_)


@helper
def to_frame(top: Any, o: Vec, d: Vec) -> tuple[Vec, Vec]:
    """Transform rays to a BVH's frame; t along them stays the same."""
    x, y, z, scale = top.frame[0], top.frame[1], top.frame[2], top.frame[3]
    return ((o[0] - x) * scale, (o[1] - y) * scale, (o[2] - z) * scale), (d[0] * scale, d[1] * scale, d[2] * scale)


def build(boxes: NDArray[np.float64], instances: NDArray[np.int32], threads: int = 0) -> Top:
    """Build the BVH over `instances`, whose rows of `boxes` are finite; independent of the number of threads (0: all cores)."""
    n = len(instances)
    links = np.full((1 if n else 0, WIDTH), EMPTY, np.int32)
    if n <= WIDTH:
        links[:, :n] = ~instances
    else:
        numbers = _links(boxes[instances], threads)
        links = np.where(numbers > EMPTY, np.where(numbers < 0, ~instances[np.minimum(~numbers, n - 1)], numbers), EMPTY).astype(np.int32)
    top = Top(simd.aligned_empty((len(links), NODE), np.float32), links, np.array([0.0, 0.0, 0.0, 1.0]))
    if n:
        refit(top, boxes)
    return top


def _links(boxes: NDArray[np.float64], threads: int) -> NDArray[np.int32]:
    low, high = boxes[:, :3], boxes[:, 3:]
    middle = 0.5 * low.min(axis=0) + 0.5 * high.max(axis=0)
    size = float(np.maximum(high - middle, middle - low).max()) or 1.0
    items = simd.paged_empty((len(boxes), 8), np.float32)
    items[:, :3], items[:, 4:7], items[:, binned_sah.COUNT] = (low - middle) / size, (middle - high) / size, 1.0
    items.view(np.int32)[:, binned_sah.NUMBER] = np.arange(len(boxes)) | binned_sah.TAG
    return wide_bvh.links(items, binned_sah.bounds_of(items), threads)


def refit(top: Top, boxes: NDArray[np.float64]) -> None:
    """Refit the nodes to new boxes (instances, 6) of instances; the topology stays."""
    inside = boxes[~top.links[(top.links < 0) & (top.links > EMPTY)]]
    low, high = inside[:, :3].min(axis=0), inside[:, 3:].max(axis=0)
    middle = 0.5 * low + 0.5 * high
    top.frame[:3] = middle
    top.frame[3] = math.ldexp(1.0, -math.frexp(float(np.maximum(middle - low, high - middle).max()))[1])
    del inside, low, high
    local = boxes.reshape(-1, 2, 3) - middle
    local *= top.frame[3]
    local = local.reshape(-1, 6)
    if len(top.links) > 1:
        enclose(top.nodes, top.links, local)
        return
    used = top.links[0] > EMPTY
    planes = top.nodes[0].reshape(3, 2, WIDTH)
    planes[:, 0], planes[:, 1] = np.inf, -np.inf
    planes[..., used] = local[~top.links[0, used]].reshape(-1, 2, 3).transpose(2, 1, 0)
    planes[:, 0] -= np.float32(SLACK)
    planes[:, 1] += np.float32(SLACK)


@kernel
def enclose(nodes, links, boxes):
    """Compute the planes of all nodes, from the last node to the first."""
    around = np.empty((len(links), 6))
    for node in range(len(links) - 1, -1, -1):
        for k in range(3):
            around[node, k], around[node, 3 + k] = np.inf, -np.inf
        for i in range(links.shape[1]):
            link = links[node, i]
            for k in range(3):
                low, high = np.inf, -np.inf
                if link >= 0:
                    low, high = around[link, k], around[link, 3 + k]
                elif link > EMPTY:
                    low, high = boxes[~link, k], boxes[~link, 3 + k]
                nodes[node, 2 * k * WIDTH + i], nodes[node, (2 * k + 1) * WIDTH + i] = low - SLACK, high + SLACK
                around[node, k] = min(around[node, k], low)
                around[node, 3 + k] = max(around[node, 3 + k], high)
