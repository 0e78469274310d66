"""Rays against boxes in double precision: each of several rays against one box, one ray or a bundle of them against a node's.

Boxes are tested so that none is missed through rounding: the far side is moved out by 2 γ₃ (Ize, "Robust BVH Ray Traversal",
JCGT 2013), the origin by its own error, and comparisons are written so that the NaN of 0 · ∞ (a ray along a box's face)
decides nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ... import simd
from ...jit.kernel import helper
from ...lanes import crosslane, ops
from ...types import Lane, Vec
from ..build.wide_bvh import NODE, WIDTH, spread64

FAR = 1.0 + 2.0 * 3.4e-16  # 1 + 2 γ₃ for float64
WORLD_ERROR = 1e-12  # of the origin's coordinates: what transforms and their inverses may round
LOCAL_ERROR = 1e-15
STEEP = 1e14  # times the smallest inverse of a component: none is larger in the world, where boxes are wide enough for that


class BoxRay(NamedTuple):
    """Rays made ready for boxes: origins moved against and along the ray, 1 / direction, and which way they go."""

    near: Vec
    far: Vec
    inverse: Vec
    x: Lane  # bool: toward greater x
    y: Lane
    z: Lane


@helper
def local_ray(o: Vec, d: Vec) -> BoxRay:
    """For boxes in a mesh's own frame, which hold their contents exactly."""
    return _ready(o, (1.0 / d[0], 1.0 / d[1], 1.0 / d[2]), LOCAL_ERROR)


@helper
def world_ray(o: Vec, d: Vec) -> BoxRay:
    """For boxes of the tree over instances, in its frame, which have some slack. All numbers are finite, so that there is no NaN."""
    x, y, z = 1.0 / d[0], 1.0 / d[1], 1.0 / d[2]
    most = STEEP * ops.smallest((abs(x), abs(y), abs(z)))
    return _ready(o, (ops.clip(x, -most, most), ops.clip(y, -most, most), ops.clip(z, -most, most)), WORLD_ERROR)


@helper
def _ready(o: Vec, inverse: Vec, share: float) -> BoxRay:
    error = share * ops.largest((abs(o[0]), abs(o[1]), abs(o[2])))
    x, y, z = inverse[0] > 0.0, inverse[1] > 0.0, inverse[2] > 0.0
    e = (ops.where(x, error, -error), ops.where(y, error, -error), ops.where(z, error, -error))
    return BoxRay(ops.add(o, e), ops.sub(o, e), inverse, x, y, z)


@helper
def enter(box: Any, ray: BoxRay, t_min: Lane, t_max: Lane) -> Lane:
    """Where each ray enters a box (low x, y, z, high x, y, z, …), inf where it misses it or comes too late."""
    near = ops.maximum((ops.where(ray.x, box[0], box[3]) - ray.near[0]) * ray.inverse[0], t_min)
    far = ops.minimum((ops.where(ray.x, box[3], box[0]) - ray.far[0]) * ray.inverse[0] * FAR, t_max)
    near = ops.maximum((ops.where(ray.y, box[1], box[4]) - ray.near[1]) * ray.inverse[1], near)
    far = ops.minimum((ops.where(ray.y, box[4], box[1]) - ray.far[1]) * ray.inverse[1] * FAR, far)
    near = ops.maximum((ops.where(ray.z, box[2], box[5]) - ray.near[2]) * ray.inverse[2], near)
    far = ops.minimum((ops.where(ray.z, box[5], box[2]) - ray.far[2]) * ray.inverse[2] * FAR, far)
    return ops.where(near <= far, near, np.inf)


class Bundle(NamedTuple):
    """Rays of one octant, or one ray, for a node's boxes: intervals of what a BoxRay holds, and which of a node's rows are near."""

    near: Vec
    far: Vec
    least: Vec  # of 1 / direction
    most: Vec
    rows: tuple[int, int, int]


@helper
def bundle(ray: BoxRay, active: Lane, first: int) -> Bundle:
    """The bundle of the active lanes, of which `first` is one."""
    x, y, z = crosslane.lane(ray.x, first), crosslane.lane(ray.y, first), crosslane.lane(ray.z, first)
    nx, fx, lx, mx = _interval(ray.near[0], ray.far[0], ray.inverse[0], x, active, first)
    ny, fy, ly, my = _interval(ray.near[1], ray.far[1], ray.inverse[1], y, active, first)
    nz, fz, lz, mz = _interval(ray.near[2], ray.far[2], ray.inverse[2], z, active, first)
    return Bundle((nx, ny, nz), (fx, fy, fz), (lx, ly, lz), (mx, my, mz), rows_of(x, y, z))


@helper
def _interval(near: Lane, far: Lane, inverse: Lane, up: Any, active: Lane, first: int) -> tuple[Lane, Lane, Lane, Lane]:
    """(near and far origin, least and most inverse) on one axis, in all lanes each."""
    n = ops.where(active, near, crosslane.lane(near, first))
    f = ops.where(active, far, crosslane.lane(far, first))
    i = ops.where(active, inverse, crosslane.lane(inverse, first))
    behind, ahead = (crosslane.reduce_max(n), crosslane.reduce_min(f)) if up else (crosslane.reduce_min(n), crosslane.reduce_max(f))
    return spread64(behind), spread64(ahead), spread64(crosslane.reduce_min(i)), spread64(crosslane.reduce_max(i))


@helper
def rows_of(x: Any, y: Any, z: Any) -> tuple[int, int, int]:
    """The rows of a node's planes that rays meet first which go toward greater x, y, z, or not."""
    return 0 if x else WIDTH, 2 * WIDTH if y else 3 * WIDTH, 4 * WIDTH if z else 5 * WIDTH


@helper
def enter_node(nodes: Any, node: int, rays: Bundle, t_min: Any, t_max: Any) -> tuple[Lane, Lane, int]:
    """Where the first of some rays may enter a node's boxes, where the last one leaves them, and bits of those that one may enter.

    That is between t_min and t_max.
    For a single ray, `least` and `most` are one value, and the compiler leaves the second product out.
    """
    at = node * NODE
    near, far = spread64(t_min), spread64(t_max)
    near, far = _slabs(nodes, at, rays, 0, near, far)
    near, far = _slabs(nodes, at, rays, 1, near, far)
    near, far = _slabs(nodes, at, rays, 2, near, far)
    return _sooner(near), simd.to_f32(far), simd.bits(near <= far)


@helper
def _slabs(nodes: Any, at: int, rays: Bundle, k: int, near: Lane, far: Lane) -> tuple[Lane, Lane]:
    lo = simd.to_f64(simd.load(nodes, at + rays.rows[k], WIDTH)) - rays.near[k]
    hi = simd.to_f64(simd.load(nodes, at + (rays.rows[k] ^ WIDTH), WIDTH)) - rays.far[k]
    near = simd.maximum(near, simd.minimum(lo * rays.least[k], lo * rays.most[k]))
    return near, simd.minimum(far, simd.maximum(hi * rays.least[k], hi * rays.most[k]) * FAR)


@helper
def enter_each(nodes: Any, node: int, ray: BoxRay, t_min: Lane, t_max: Lane) -> tuple[Lane, int]:
    """The same for rays that go anywhere, each for itself."""
    first = simd.stack_array(np.float64, WIDTH)
    simd.store(first, 0, spread64(np.inf))
    at = node * NODE
    for i in range(WIDTH):
        if simd.read(nodes, at + i) == np.inf:  # there are no more
            break
        near, far = t_min, t_max
        near, far = _side(nodes, at + i, ray.near[0], ray.far[0], ray.inverse[0], ray.x, near, far)
        near, far = _side(nodes, at + 2 * WIDTH + i, ray.near[1], ray.far[1], ray.inverse[1], ray.y, near, far)
        near, far = _side(nodes, at + 4 * WIDTH + i, ray.near[2], ray.far[2], ray.inverse[2], ray.z, near, far)
        simd.write(first, i, crosslane.reduce_min(ops.where(near <= far, near, np.inf)))
    least = simd.load(first, 0, WIDTH)
    return _sooner(least), simd.bits(least < np.inf)


@helper
def _sooner(t: Lane) -> Lane:
    """In single precision, not later."""
    near = simd.to_f32(t)
    return near - abs(near) * np.float32(2.0**-23)


@helper
def _side(nodes: Any, at: int, behind: Lane, ahead: Lane, inverse: Lane, up: Lane, near: Lane, far: Lane) -> tuple[Lane, Lane]:
    low, high = np.float64(simd.read(nodes, at)), np.float64(simd.read(nodes, at + WIDTH))
    near = ops.maximum((ops.where(up, low, high) - behind) * inverse, near)
    return near, ops.minimum((ops.where(up, high, low) - ahead) * inverse * FAR, far)
