"""Rays of a mesh, their traversal stacks and their hits, as tables in memory that single-ray kernels read by lane.

Boxes are float32. No box is missed through rounding: the SLACK of the boxes covers the error of the origin and the planes, and all other
errors are relative to the distance and move the far side out (Ize, "Robust BVH Ray Traversal", JCGT 2013). A ray starts where it enters
the mesh's box, which keeps the error of its origin small.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...geometry import triangle_hit as flat
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...types import Hit, Lane, Vec
from ..bvh_build.wide_bvh import DEPTH, WIDTH, spread32
from . import ray_box, triangle_filter

FAR = 1.0 + 2.0**-21  # factor of the far side: eight float32 roundings
STEEP = 1e12  # largest 1 / direction, as a multiple of the smallest: keeps all components finite
RAYS = crosslane.WIDTH  # rays that the tables hold
_SINGLES, _DOUBLES, _INTS = 14 * RAYS, 9 * RAYS, 6 * RAYS
STACK = 2 * DEPTH + 16  # of one ray, over instances and in a mesh; the 16 keep the stacks out of the same cache sets
_STACKS, _POSITIONS, _HITS, _IDS = STACK * RAYS, 3 * RAYS, 4 * RAYS, 2 * RAYS


class StoredRays(NamedTuple):
    """Rays in memory: rows of RAYS lanes."""

    # float32: NodeRay's scale (0-2) and shift (3-5), limit (6), corner error (7), FilterRay's origin and shear (8-12), depth per t (13)
    singles: Any
    doubles: Any  # float64: origin in the shear's axes (0-2), the shear (3-5), t of entry, t_min, t_max (6-8)
    axes: Any  # int64: the shear's axes (0-2) and NodeRay's near rows (3-5)


class TraversalState(NamedTuple):
    """The stack, position and hit of each ray: rows of RAYS lanes, and STACK entries a ray."""

    stack: Any  # int32: nodes or ~ leaves still to visit
    distances: Any  # float32: entry distances of those
    position: Any  # int64: current node or ~ leaf; top of the stack; bottom of the part of the stack that belongs to the current mesh
    hits: Any  # float64: t, weights of the second and third corner times their total, the total
    ids: Any  # int64: instance and primitive, or -1


@helper
def allocate_rays() -> StoredRays:
    """Allocate tables of rays on the stack of a kernel."""
    return StoredRays(simd.stack_array(np.float32, _SINGLES), simd.stack_array(np.float64, _DOUBLES), simd.stack_array(np.int64, _INTS))


@helper
def allocate_state() -> TraversalState:
    """Allocate stacks, positions and hits on the stack of a kernel."""
    return TraversalState(
        simd.stack_array(np.int32, _STACKS), simd.stack_array(np.float32, _STACKS), simd.stack_array(np.int64, _POSITIONS),
        simd.stack_array(np.float64, _HITS), simd.stack_array(np.int64, _IDS),
    )  # fmt: skip


# --- rays ---


@helper
def store_rays(stored: StoredRays, mask: Lane, rays: ray_box.MeshRays, extent: Lane) -> None:
    """Store the rays of a mask; `extent` is the largest coordinate of their mesh."""
    singles, doubles, axes = stored.singles, stored.doubles, stored.axes
    o, d, inverse, enters = rays.origin, rays.direction, rays.box.inverse, rays.enters
    most = STEEP * ops.smallest((abs(inverse[0]), abs(inverse[1]), abs(inverse[2])))
    x, y, z = (
        crosslane.to_float32(o[0] + enters * d[0]),
        crosslane.to_float32(o[1] + enters * d[1]),
        crosslane.to_float32(o[2] + enters * d[2]),
    )
    sx, sy, sz = _clip_inverse(inverse[0], most), _clip_inverse(inverse[1], most), _clip_inverse(inverse[2], most)
    _store3(singles, 0, (sx, sy, sz), mask)
    _store3(singles, 3, (-x * sx, -y * sy, -z * sz), mask)
    _store(singles, 6, (rays.until - enters) * FAR, mask)
    _store(singles, 7, enters * 0.0 + triangle_filter.OFF * extent, mask)
    kx, ky, kz, tx, ty, tz = flat.shear_with_inverse(d, inverse)
    _store3(singles, 8, (flat.component((x, y, z), kx), flat.component((x, y, z), ky), flat.component((x, y, z), kz)), mask)
    _store(singles, 11, tx, mask)
    _store(singles, 12, ty, mask)
    _store(singles, 13, flat.component(d, kz), mask)
    _store3(axes, 0, (kx, ky, kz), mask)
    _store3(axes, 3, (_near_row(sx, kx, 0), _near_row(sy, kx, 2), _near_row(sz, kx, 4)), mask)
    _store3(doubles, 0, (flat.component(o, kx), flat.component(o, ky), flat.component(o, kz)), mask)
    _store3(doubles, 3, (tx, ty, tz), mask)
    _store3(doubles, 6, (enters, rays.t_min, rays.t_max), mask)


@helper
def store_box_rays(stored: StoredRays, entry: Vec, inverse: Vec, limit: Lane) -> None:
    """Store what box tests read: entry points, 1 / direction (its largest component is 1) and lengths of rays."""
    x, y, z = crosslane.to_float32(entry[0]), crosslane.to_float32(entry[1]), crosslane.to_float32(entry[2])
    sx, sy, sz = _clip_inverse(inverse[0], STEEP), _clip_inverse(inverse[1], STEEP), _clip_inverse(inverse[2], STEEP)
    all_ = ops.bool_like(limit, True)
    _store3(stored.singles, 0, (sx, sy, sz), all_)
    _store3(stored.singles, 3, (-x * sx, -y * sy, -z * sz), all_)
    _store(stored.singles, 6, limit * FAR, all_)
    _store3(stored.axes, 3, (_near_row(sx, limit, 0), _near_row(sy, limit, 2), _near_row(sz, limit, 4)), all_)


@helper
def _store(table: Any, row: int, x: Lane, mask: Lane) -> None:
    crosslane.write_lanes(table, row, 0, x, mask)


@helper
def _store3(table: Any, row: int, v: Vec, mask: Lane) -> None:
    _store(table, row, v[0], mask)
    _store(table, row + 1, v[1], mask)
    _store(table, row + 2, v[2], mask)


@helper
def _clip_inverse(inverse: Lane, most: Lane) -> Lane:
    return crosslane.to_float32(ops.clip(inverse, -most, most))


@helper
def _near_row(inverse: Lane, like: Lane, row: int) -> Lane:
    """The row of a node's near planes on the axis whose low planes stand in row `row`."""
    return ops.where(inverse > 0.0, ops.int_like(like, row * WIDTH), ops.int_like(like, (row + 1) * WIDTH))


class NodeRay(NamedTuple):
    """One ray, spread over all lanes, for the test of a node's boxes."""

    scale: Vec  # 1 / direction
    shift: Vec  # -origin / direction
    near: tuple[int, int, int]  # rows of the node's near planes


@helper
def node_ray(rays: StoredRays, k: int) -> NodeRay:
    """Load ray k for node tests."""
    return NodeRay(
        _spread(_single(rays, 0, k), _single(rays, 1, k), _single(rays, 2, k)),
        _spread(_single(rays, 3, k), _single(rays, 4, k), _single(rays, 5, k)),
        (_axis(rays, 3, k), _axis(rays, 4, k), _axis(rays, 5, k)),
    )


@helper
def filter_ray(rays: StoredRays, k: int) -> triangle_filter.FilterRay:
    """Load ray k for the single-precision triangle test."""
    x, y, z = _axis(rays, 0, k), _axis(rays, 1, k), _axis(rays, 2, k)
    off, along, twice = _single(rays, 7, k), _single(rays, 13, k), np.float32(2.0)
    sign = np.float32(1.0) if along > np.float32(0.0) else np.float32(-1.0)
    return triangle_filter.FilterRay(
        WIDTH * x, WIDTH * y, WIDTH * z, spread32(sign), _spread(_single(rays, 8, k), _single(rays, 9, k), sign * _single(rays, 10, k)),
        (spread32(sign * _single(rays, 11, k)), spread32(sign * _single(rays, 12, k))), spread32(off), spread32(twice * off * off),
        abs(along), triangle_filter.unsure_bits(off),
    )  # fmt: skip


class ShearedRay(NamedTuple):
    """One ray for the double-precision test of a triangle."""

    x: int  # rows of a leaf for the shear's axes
    y: int
    z: int
    origin: Vec
    shear: Vec


@helper
def sheared_ray(rays: StoredRays, k: int) -> ShearedRay:
    """Load ray k for the double-precision triangle test."""
    return ShearedRay(
        WIDTH * _axis(rays, 0, k), WIDTH * _axis(rays, 1, k), WIDTH * _axis(rays, 2, k),
        (_double(rays, 0, k), _double(rays, 1, k), _double(rays, 2, k)),
        (_double(rays, 3, k), _double(rays, 4, k), _double(rays, 5, k)),
    )  # fmt: skip


@helper
def limit(rays: StoredRays, k: int) -> Any:
    """The length of ray k from its entry on."""
    return _single(rays, 6, k)


@helper
def set_limit(rays: StoredRays, k: int, length: Any) -> None:
    """Set the length of ray k from its entry on."""
    simd.write(rays.singles, 6 * RAYS + k, length)


@helper
def _spread(x: Any, y: Any, z: Any) -> Vec:
    return spread32(x), spread32(y), spread32(z)


@helper
def _single(rays: StoredRays, row: int, k: int) -> Any:
    return simd.read(rays.singles, row * RAYS + k)


@helper
def _double(rays: StoredRays, row: int, k: int) -> Any:
    return simd.read(rays.doubles, row * RAYS + k)


@helper
def _axis(rays: StoredRays, row: int, k: int) -> Any:
    return simd.read(rays.axes, row * RAYS + k)


@helper
def entry(rays: StoredRays, k: int) -> Any:
    """t at which ray k enters its mesh's box."""
    return _double(rays, 6, k)


@helper
def interval(rays: StoredRays, k: int) -> tuple[Any, Any]:
    """(t_min, t_max) of ray k."""
    return _double(rays, 7, k), _double(rays, 8, k)


# --- hits and positions ---


@helper
def set_hits(state: TraversalState, hit: Hit) -> None:
    """Start from the hits of a vector of rays; instance -1: none."""
    crosslane.store(state.hits, 0, hit.t)
    crosslane.store(state.hits, 1, hit.u)
    crosslane.store(state.hits, 2, hit.v)
    crosslane.store(state.hits, 3, ops.full_like(hit.t, 1.0))
    crosslane.store(state.ids, 0, hit.instance)
    crosslane.store(state.ids, 1, hit.primitive)


@helper
def load_hits(state: TraversalState) -> Hit:
    """The hits of all rays so far."""
    total = crosslane.load(state.hits, 3)
    return Hit(
        crosslane.load(state.hits, 0), crosslane.load(state.ids, 0), crosslane.load(state.ids, 1),
        crosslane.load(state.hits, 1) / total, crosslane.load(state.hits, 2) / total,
    )  # fmt: skip


@helper
def set_hit(state: TraversalState, k: int, t: Any, weights: tuple[Any, Any, Any], instance: int, primitive: int) -> None:
    """Record a hit of ray k; `weights` are those of the second and third corner times their total, and the total."""
    simd.write(state.hits, k, t)
    simd.write(state.hits, RAYS + k, weights[0])
    simd.write(state.hits, 2 * RAYS + k, weights[1])
    simd.write(state.hits, 3 * RAYS + k, weights[2])
    simd.write(state.ids, k, instance)
    simd.write(state.ids, RAYS + k, primitive)


@helper
def is_closer(state: TraversalState, k: int, t: Any, instance: int, primitive: int) -> bool:
    """Whether a hit comes before that of ray k so far; at equal t the lower instance, then the lower primitive wins."""
    before = simd.read(state.hits, k)
    if t != before:
        return t < before
    other = simd.read(state.ids, k)
    return t < np.inf and (instance < other or (instance == other and primitive < simd.read(state.ids, RAYS + k)))


@helper
def set_position(state: TraversalState, k: int, node: int, top: int) -> None:
    """Put ray k at a node or ~ leaf, with `top` as the top of its stack."""
    simd.write(state.position, k, node)
    simd.write(state.position, RAYS + k, top)
