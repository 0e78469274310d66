"""The tree over instances: as many children a node as a mesh's, made from their boxes and filled with double-precision planes.

Its shape comes from halves.py and wide.py, in single precision; which boxes lie around what is computed afterwards from the
instances' own, so that a scene with a wide ground and small things on it loses nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import halves, machine, simd, wide
from .kernels import kernel
from .wide import EMPTY, NODE, WIDTH
from .workers import Workers

_MANY = 4096  # instances from which on threads are worth starting


class Top(NamedTuple):
    """A link is a node's number, ~ an instance's, or `EMPTY`; the root is node 0. Without nodes there is nothing."""

    nodes: NDArray[np.float64]  # (n, NODE) as those of wide.Wide
    links: NDArray[np.int32]  # (n, WIDTH); nodes come before their children


def build(boxes: NDArray[np.float64], instances: NDArray[np.int32], threads: int = 0) -> Top:
    """The tree over instances with finite boxes, rows (instances, 6) of the whole scene's; the same on any number of threads (0: all)."""
    n = len(instances)
    links = np.full((1 if n else 0, WIDTH), EMPTY, np.int32)
    if n <= WIDTH:
        links[:, :n] = ~instances
    else:
        numbers = _links(boxes[instances], threads)
        links = np.where(numbers > EMPTY, np.where(numbers < 0, ~instances[np.minimum(~numbers, n - 1)], numbers), EMPTY).astype(np.int32)
    top = Top(simd.aligned_empty((len(links), NODE), np.float64), links)
    if n:
        refit(top, boxes)
    return top


def _links(boxes: NDArray[np.float64], threads: int) -> NDArray[np.int32]:
    low, high = boxes[:, :3], boxes[:, 3:]
    middle = 0.5 * low.min(axis=0) + 0.5 * high.max(axis=0)
    size = float(np.abs(boxes - np.tile(middle, 2)).max()) or 1.0
    items = simd.paged_empty((len(boxes), 8), np.float32)
    items[:, :3], items[:, 4:7], items[:, halves.COUNT] = (low - middle) / size, (middle - high) / size, 1.0
    items.view(np.int32)[:, halves.NUMBER] = np.arange(len(boxes)) | halves.TAG
    by = Workers(1 if len(boxes) < _MANY else threads or machine.cores())
    return wide.links(items, items.min(axis=0), by)


def refit(top: Top, boxes: NDArray[np.float64]) -> None:
    """Fit the nodes around the boxes (instances, 6) that things have now; the tree's shape stays."""
    if len(top.links) > 1:
        enclose(top.nodes, top.links, boxes)
        return
    there = top.links[0] > EMPTY
    planes = top.nodes[0].reshape(3, 2, WIDTH)
    planes[:, 0], planes[:, 1] = np.inf, -np.inf
    planes[..., there] = boxes[~top.links[0, there]].reshape(-1, 2, 3).transpose(2, 1, 0)


@kernel
def enclose(nodes, links, boxes):
    """Set all nodes' planes, from the last node to the first."""
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
                nodes[node, 2 * k * WIDTH + i], nodes[node, (2 * k + 1) * WIDTH + i] = low, high
                around[node, k] = min(around[node, k], low)
                around[node, 3 + k] = max(around[node, 3 + k], high)
