"""Interleaved traversal of a mesh's BVH: rays advance in turn, one node or leaf each, which hides memory latency."""

from __future__ import annotations

from typing import Any

import numpy as np

from ... import simd
from ...jit.kernel import helper, noinline_helper
from ...lanes import crosslane, ops
from ...types import Hit
from . import entry_point, ray_box, ray_state, single_ray


@helper
def intersect_mesh(tree: Any, root: int, rays: ray_box.MeshRays, active: int, extent: Any, coherent: bool, any_hit: bool) -> Hit:
    """First hits of the rays whose bits are set in `active` with the mesh whose BVH starts at `root`; their instance is 0.

    `extent` is the mesh's largest coordinate; `coherent` is that of packet.is_coherent.
    """
    entry, stored, state = entry_point.allocate(), ray_state.allocate_rays(), ray_state.allocate_state()
    entry_point.build(entry, tree, root, rays, active, coherent)
    ray_state.store_rays(stored, crosslane.mask_of(active, rays.enters), rays, extent)
    zero = 0.0 * rays.enters
    nothing = ops.int_like(zero, -1)
    ray_state.set_hits(state, Hit(zero + np.inf, nothing, nothing, zero, zero))
    todo = active
    while todo != 0:
        k = simd.trailing_zeros(todo)
        todo &= todo - 1
        if not single_ray.start_ray(tree, entry.nodes, entry.links, stored, state, k, any_hit):
            active &= ~(1 << k)
    _trace_interleaved(tree, stored, state, active, any_hit)
    return ray_state.load_hits(state)


@noinline_helper
def _trace_interleaved(tree, rays, state, active, any_hit):
    """Advance the rays whose bits are set in `active` in turn, one step each, until all have ended."""
    while active != 0:
        todo = active
        while todo != 0:
            k = simd.trailing_zeros(todo)
            todo &= todo - 1
            if not single_ray.traverse_step(tree, rays, state, k, 0, any_hit):
                active &= ~(1 << k)
