"""Ray/box tests in double precision: several rays against one box, and one ray or a packet against the boxes of a node.

No box is missed through rounding: the far side moves out by 2 γ₃ (Ize, "Robust BVH Ray Traversal", JCGT 2013), the origin by its own
error. Comparisons ignore the NaN of 0 · ∞, which a ray along a box's face gives.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...types import Lane, Vec
from ..bvh_build.wide_bvh import NODE, WIDTH, spread64

FAR = 1.0 + 2.0 * 3.4e-16  # 1 + 2 γ₃ for float64
WORLD_ERROR = 1e-12  # relative error of the origin's coordinates: rounding of transforms and their inverses
LOCAL_ERROR = 1e-15
STEEP = 1e14  # largest 1 / direction in the world, as a multiple of the smallest; the slack of world boxes covers the error


class BoxRay(NamedTuple):
    """Rays prepared for box tests."""

    near: Vec  # origin, moved against the direction by its error
    far: Vec  # origin, moved along the direction by its error
    inverse: Vec  # 1 / direction
    x: Lane  # bool: toward greater x
    y: Lane
    z: Lane


class MeshRays(NamedTuple):
    """Rays in the frame of a mesh, relative to its origin."""

    origin: Vec
    direction: Vec
    box: BoxRay
    enters: Lane  # t at which they enter the mesh's box, 0 where they miss it
    t_min: Lane
    t_max: Lane
    until: Lane  # t beyond which hits are not needed, at most t_max


class SceneRays(NamedTuple):
    """Rays in the world and in the frame of the BVH over instances."""

    origin: Vec
    direction: Vec
    t_min: Lane
    until: Lane  # t_max, -inf for inactive rays
    top_origin: Vec
    top_direction: Vec
    box: BoxRay  # in the frame of the BVH


@helper
def local_ray(o: Vec, d: Vec) -> BoxRay:
    """Prepare rays for boxes in a mesh's own frame, which enclose their contents exactly."""
    return _box_ray(o, (1.0 / d[0], 1.0 / d[1], 1.0 / d[2]), LOCAL_ERROR)


@helper
def world_ray(o: Vec, d: Vec) -> BoxRay:
    """Prepare rays for the boxes of the BVH over instances, which have slack. All numbers are finite, so no NaN arises."""
    x, y, z = 1.0 / d[0], 1.0 / d[1], 1.0 / d[2]
    most = STEEP * ops.smallest((abs(x), abs(y), abs(z)))
    return _box_ray(o, (ops.clip(x, -most, most), ops.clip(y, -most, most), ops.clip(z, -most, most)), WORLD_ERROR)


@helper
def _box_ray(o: Vec, inverse: Vec, relative: float) -> BoxRay:
    error = relative * ops.largest((abs(o[0]), abs(o[1]), abs(o[2])))
    x, y, z = inverse[0] > 0.0, inverse[1] > 0.0, inverse[2] > 0.0
    e = (ops.where(x, error, -error), ops.where(y, error, -error), ops.where(z, error, -error))
    return BoxRay(ops.add(o, e), ops.sub(o, e), inverse, x, y, z)


@helper
def intersect_box(box: Any, ray: BoxRay, t_min: Lane, t_max: Lane) -> Lane:
    """t at which each ray enters a box (low x, y, z, high x, y, z, …); inf where it misses it between t_min and t_max."""
    near = ops.maximum((ops.where(ray.x, box[0], box[3]) - ray.near[0]) * ray.inverse[0], t_min)
    far = ops.minimum((ops.where(ray.x, box[3], box[0]) - ray.far[0]) * ray.inverse[0] * FAR, t_max)
    near = ops.maximum((ops.where(ray.y, box[1], box[4]) - ray.near[1]) * ray.inverse[1], near)
    far = ops.minimum((ops.where(ray.y, box[4], box[1]) - ray.far[1]) * ray.inverse[1] * FAR, far)
    near = ops.maximum((ops.where(ray.z, box[2], box[5]) - ray.near[2]) * ray.inverse[2], near)
    far = ops.minimum((ops.where(ray.z, box[5], box[2]) - ray.far[2]) * ray.inverse[2] * FAR, far)
    return ops.where(near <= far, near, np.inf)


class RayInterval(NamedTuple):
    """Intervals that hold the BoxRays of one octant, for the boxes of a node."""

    near: Vec
    far: Vec
    least: Vec  # 1 / direction
    most: Vec
    rows: tuple[int, int, int]  # of the node's near planes


@helper
def interval_of(ray: BoxRay, active: Lane, first: int) -> RayInterval:
    """The interval of the active lanes, of which `first` is one."""
    x, y, z = crosslane.lane(ray.x, first), crosslane.lane(ray.y, first), crosslane.lane(ray.z, first)
    nx, fx, lx, mx = _interval(ray.near[0], ray.far[0], ray.inverse[0], x, active, first)
    ny, fy, ly, my = _interval(ray.near[1], ray.far[1], ray.inverse[1], y, active, first)
    nz, fz, lz, mz = _interval(ray.near[2], ray.far[2], ray.inverse[2], z, active, first)
    return RayInterval((nx, ny, nz), (fx, fy, fz), (lx, ly, lz), (mx, my, mz), near_rows(x, y, z))


@helper
def _interval(near: Lane, far: Lane, inverse: Lane, up: Any, active: Lane, first: int) -> tuple[Lane, Lane, Lane, Lane]:
    """(near and far origin, least and most inverse) on one axis, spread over all lanes."""
    n = ops.where(active, near, crosslane.lane(near, first))
    f = ops.where(active, far, crosslane.lane(far, first))
    i = ops.where(active, inverse, crosslane.lane(inverse, first))
    behind, ahead = (crosslane.reduce_max(n), crosslane.reduce_min(f)) if up else (crosslane.reduce_min(n), crosslane.reduce_max(f))
    return spread64(behind), spread64(ahead), spread64(crosslane.reduce_min(i)), spread64(crosslane.reduce_max(i))


@helper
def near_rows(x: Any, y: Any, z: Any) -> tuple[int, int, int]:
    """Rows of a node's near planes for rays toward greater x, y, z, or not."""
    return 0 if x else WIDTH, 2 * WIDTH if y else 3 * WIDTH, 4 * WIDTH if z else 5 * WIDTH


@helper
def intersect_node(nodes: Any, node: int, rays: RayInterval, t_min: Any, t_max: Any) -> tuple[Lane, Lane, int]:
    """(first entry t, last exit t, bits) of a node's boxes that rays of an interval enter between t_min and t_max.

    For a single ray, `least` and `most` are the same value, and the compiler drops the second product.
    """
    start = node * NODE
    near, far = spread64(t_min), spread64(t_max)
    near, far = _clip_to_slabs(nodes, start, rays, 0, near, far)
    near, far = _clip_to_slabs(nodes, start, rays, 1, near, far)
    near, far = _clip_to_slabs(nodes, start, rays, 2, near, far)
    return _round_down(near), simd.to_f32(far), simd.bits(near <= far)


@helper
def _clip_to_slabs(nodes: Any, start: int, rays: RayInterval, k: int, near: Lane, far: Lane) -> tuple[Lane, Lane]:
    lo = simd.to_f64(simd.load(nodes, start + rays.rows[k], WIDTH)) - rays.near[k]
    hi = simd.to_f64(simd.load(nodes, start + (rays.rows[k] ^ WIDTH), WIDTH)) - rays.far[k]
    near = simd.maximum(near, simd.minimum(lo * rays.least[k], lo * rays.most[k]))
    return near, simd.minimum(far, simd.maximum(hi * rays.least[k], hi * rays.most[k]) * FAR)


@helper
def intersect_node_each(nodes: Any, node: int, ray: BoxRay, t_min: Lane, t_max: Lane) -> tuple[Lane, int]:
    """(first entry t, bits of the boxes entered) for rays in any directions, one box at a time."""
    first = simd.stack_array(np.float64, WIDTH)
    simd.store(first, 0, spread64(np.inf))
    start = node * NODE
    for i in range(WIDTH):
        if simd.read(nodes, start + i) == np.inf:
            break
        near, far = t_min, t_max
        near, far = _clip_to_slab(nodes, start + i, ray.near[0], ray.far[0], ray.inverse[0], ray.x, near, far)
        near, far = _clip_to_slab(nodes, start + 2 * WIDTH + i, ray.near[1], ray.far[1], ray.inverse[1], ray.y, near, far)
        near, far = _clip_to_slab(nodes, start + 4 * WIDTH + i, ray.near[2], ray.far[2], ray.inverse[2], ray.z, near, far)
        simd.write(first, i, crosslane.reduce_min(ops.where(near <= far, near, np.inf)))
    least = simd.load(first, 0, WIDTH)
    return _round_down(least), simd.bits(least < np.inf)


@helper
def _round_down(t: Lane) -> Lane:
    """Round to float32, toward smaller values."""
    near = simd.to_f32(t)
    return near - abs(near) * np.float32(2.0**-23)


@helper
def _clip_to_slab(nodes: Any, element: int, behind: Lane, ahead: Lane, inverse: Lane, up: Lane, near: Lane, far: Lane) -> tuple[Lane, Lane]:
    low, high = np.float64(simd.read(nodes, element)), np.float64(simd.read(nodes, element + WIDTH))
    near = ops.maximum((ops.where(up, low, high) - behind) * inverse, near)
    return near, ops.minimum((ops.where(up, high, low) - ahead) * inverse * FAR, far)
