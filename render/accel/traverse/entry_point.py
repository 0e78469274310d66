"""A root of their own for rays near each other: the boxes of a mesh's tree that any of them may enter, gathered as one node.

Those of several levels are tested once for all rays; each then goes on by itself from there, without the levels above.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane
from ...types import Lane, Vec
from ..build.wide_bvh import NODE, WIDTH
from . import packet, packet_nodes, ray_box
from .packet import BUNDLES
from .single_ray import push

FEW = 3 * crosslane.WIDTH // 2  # rays from which on it is worth it: most of two vectors
TRIES = 12  # nodes that are opened at most
_ROW = 2 * WIDTH  # what is appended to a row is a whole vector
_ROWS = 6 * _ROW


class Root(NamedTuple):
    """A node as those of a tree."""

    nodes: Any  # float32: planes
    links: Any  # int32


@helper
def room() -> Root:
    """Where a root is made."""
    return Root(simd.stack_array(np.float32, NODE), simd.stack_array(np.int32, _ROW))


@helper
def make(made: Root, tree: Any, root: int, o: Vec, d: Vec, ray: ray_box.BoxRay, enters: Lane, until: Lane, left: int, alike: bool) -> None:
    """Make the root of the rays whose bits are set in `left`, which enter a mesh's box at `enters` and end at `until`.

    It is that of the tree where they are few or not `bundle.alike`.
    """
    if BUNDLES and alike and simd.population(left) >= FEW:
        rays = packet.group(left, simd.trailing_zeros(left), o, d, ray, enters, until)
        limits = simd.select(simd.mask_from_bits(left, rays.limits), rays.limits, np.float32(-np.inf))
        _gather(tree, root, packet_nodes.beam_of(rays), simd.max_of(limits), made)
    else:
        for row in range(6):
            simd.store(made.nodes, row * WIDTH, _plane(tree, root, row))
        simd.store(made.links, 0, _children(tree, root))


@helper
def _plane(tree: Any, node: int, row: int) -> Lane:
    return simd.load(tree.nodes, node * NODE + row * WIDTH, WIDTH)


@helper
def _children(tree: Any, node: int) -> Lane:
    return simd.load(tree.links, node * WIDTH, WIDTH)


@helper
def _gather(tree: Any, root: int, beam: packet_nodes.Beam, limit: Any, made: Root) -> None:
    """Fill a node with the boxes that rays of a beam may enter before `limit`: they are opened as long as what they hold has room."""
    planes, links = simd.stack_array(np.float32, _ROWS), made.links
    held = _append(tree, root, packet_nodes.enter(tree.nodes, root, beam, limit)[1], planes, links, 0)
    i = tries = 0
    while i < held and held < WIDTH and tries < TRIES:
        node = np.int64(simd.read(links, i))
        if node < 0:
            i += 1
            continue
        tries += 1
        hits = packet_nodes.enter(tree.nodes, node, beam, limit)[1]
        if held + simd.population(hits) > WIDTH + 1:
            i += 1
            continue
        held -= 1
        for row in range(6):
            simd.write(planes, row * _ROW + i, simd.read(planes, row * _ROW + held))
        simd.write(links, i, simd.read(links, held))
        held = _append(tree, node, hits, planes, links, held)
    for row in range(6):
        plane = simd.load(planes, row * _ROW, WIDTH)
        there = simd.iota(plane) < np.int32(held)
        simd.store(made.nodes, row * WIDTH, simd.select(there, plane, np.float32(np.inf if row % 2 == 0 else -np.inf)))


@helper
def _append(tree: Any, node: int, hits: int, planes: Any, links: Any, held: int) -> int:
    """Add the children of a node whose bits are set to `held` others; how many there are then."""
    for row in range(6):
        push(planes, row * _ROW + held, _plane(tree, node, row), hits)
    return push(links, held, _children(tree, node), hits)
