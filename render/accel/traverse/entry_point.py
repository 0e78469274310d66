"""Entry node of a packet: the boxes of several levels of a mesh's BVH that its rays may enter, gathered as one node.

The upper levels are tested once for all rays. Each ray then traverses the BVH alone, from the entry node on.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane
from ...types import Lane
from ..bvh_build.wide_bvh import NODE, WIDTH
from . import packet, packet_nodes, ray_box
from .node_stack import push
from .packet import PACKETS

MIN_RAYS = 3 * crosslane.WIDTH // 2  # of a packet that gets an entry node of its own
MAX_OPENED = 12  # nodes opened to make it
_ROW = 2 * WIDTH  # appending to a row writes a whole vector
_ROWS = 6 * _ROW


class EntryNode(NamedTuple):
    """A node in the layout of Wide, outside of any tree."""

    nodes: Any  # float32: planes
    links: Any  # int32


@helper
def allocate() -> EntryNode:
    """Allocate an entry node on the stack of a kernel."""
    return EntryNode(simd.stack_array(np.float32, NODE), simd.stack_array(np.int32, _ROW))


@helper
def build(entry: EntryNode, tree: Any, root: int, rays: ray_box.MeshRays, active: int, coherent: bool) -> None:
    """Fill the entry node of the rays whose bits are set in `active`.

    It is a copy of the root where the rays are few or not coherent.
    """
    if PACKETS and coherent and simd.population(active) >= MIN_RAYS:
        group = packet.make_packet(active, simd.trailing_zeros(active), rays)
        limits = simd.select(simd.mask_from_bits(active, group.limits), group.limits, np.float32(-np.inf))
        _gather(tree, root, packet_nodes.make_beam(group), simd.max_of(limits), entry)
    else:
        for row in range(6):
            simd.store(entry.nodes, row * WIDTH, _plane(tree, root, row))
        simd.store(entry.links, 0, _children(tree, root))


@helper
def _plane(tree: Any, node: int, row: int) -> Lane:
    return simd.load(tree.nodes, node * NODE + row * WIDTH, WIDTH)


@helper
def _children(tree: Any, node: int) -> Lane:
    return simd.load(tree.links, node * WIDTH, WIDTH)


@helper
def _gather(tree: Any, root: int, beam: packet_nodes.Beam, limit: Any, entry: EntryNode) -> None:
    """Fill the entry node with boxes that a beam may enter before `limit`; inner nodes are opened while their children fit."""
    planes, links = simd.stack_array(np.float32, _ROWS), entry.links
    count = _append(tree, root, packet_nodes.intersect_boxes(tree.nodes, root, beam, limit)[1], planes, links, 0)
    i = opened = 0
    while i < count and count < WIDTH and opened < MAX_OPENED:
        node = np.int64(simd.read(links, i))
        if node < 0:
            i += 1
            continue
        opened += 1
        hits = packet_nodes.intersect_boxes(tree.nodes, node, beam, limit)[1]
        if count + simd.population(hits) > WIDTH + 1:
            i += 1
            continue
        count -= 1
        for row in range(6):
            simd.write(planes, row * _ROW + i, simd.read(planes, row * _ROW + count))
        simd.write(links, i, simd.read(links, count))
        count = _append(tree, node, hits, planes, links, count)
    for row in range(6):
        plane = simd.load(planes, row * _ROW, WIDTH)
        used = simd.iota(plane) < np.int32(count)
        simd.store(entry.nodes, row * WIDTH, simd.select(used, plane, np.float32(np.inf if row % 2 == 0 else -np.inf)))


@helper
def _append(tree: Any, node: int, hits: int, planes: Any, links: Any, count: int) -> int:
    """Append the children of a node whose bits are set to `count` boxes; return the new count."""
    for row in range(6):
        push(planes, row * _ROW + count, _plane(tree, node, row), hits)
    return push(links, count, _children(tree, node), hits)
