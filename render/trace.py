"""What a ray meets: `closest` and `occluded`, by brute force in numpy and by the trees of bvh.py in kernels.

Both give the same answer. Rays go to a shape's own frame without being normalised, so that t stays what it was; of hits at
the same t the lowest instance wins, then the lowest primitive.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from ..compiler import ir
from . import across, lanes, shapes, traverse
from .kernels import HELPER
from .records import Hit, Lane, Ray, Vec

CHUNK = 1 << 17  # ray–triangle pairs tested at a time: bounds memory to a few dozen MB
MESH = int(ir.GeometryKind.MESH)
SHADOW = int(ir.Visibility.SHADOW)


class Brute(NamedTuple):
    """The accelerator that is none: every instance and every triangle is tried."""


def closest(accel: Any, tables: ir.Tables, ray: Ray, active: Lane, visible_bit: Lane) -> Hit:
    """The first thing along each active ray that has one of `visible_bit` in Instances.visible; instance -1 where none."""
    rays, active = _flat(ray, active)
    n = len(active)
    t, instance, primitive = np.full(n, np.inf), np.full(n, -1), np.full(n, -1)
    u, v = np.zeros(n), np.zeros(n)
    with np.errstate(all="ignore"):
        for i in range(len(tables.instances.geometry)):
            lane = np.flatnonzero(active & ((tables.instances.visible[i] & visible_bit) != 0))
            if len(lane) == 0:
                continue
            found = _meet(tables, i, _rows(rays, lane))
            nearer = found.t < t[lane]
            lane = lane[nearer]
            t[lane], instance[lane], primitive[lane] = found.t[nearer], i, found.primitive[nearer]
            u[lane], v[lane] = found.u[nearer], found.v[nearer]
    return Hit(t, instance, primitive, u, v)


def occluded(accel: Any, tables: ir.Tables, ray: Ray, active: Lane) -> Lane:
    """Whether anything that casts shadows stands between t_min and t_max; False where not active."""
    rays, active = _flat(ray, active)
    blocked = np.zeros(len(active), bool)
    with np.errstate(all="ignore"):
        for i in np.flatnonzero(tables.instances.visible & SHADOW):
            lane = np.flatnonzero(active & ~blocked)
            if len(lane):
                blocked[lane] = _meet(tables, int(i), _rows(rays, lane)).t < np.inf
    return blocked


def _flat(ray: Ray, active: Lane) -> tuple[np.ndarray, np.ndarray]:
    """Rays as (8, n): origin, direction, t_min, t_max."""
    columns = np.broadcast_arrays(*ray.origin, *ray.direction, ray.t_min, ray.t_max, active)
    return np.stack([np.ravel(c) for c in columns[:8]]).astype(np.float64), np.ravel(columns[8]).astype(bool)


def _rows(rays: np.ndarray, lane: np.ndarray) -> Ray:
    x, y, z, dx, dy, dz, t_min, t_max = rays[:, lane]
    return Ray((x, y, z), (dx, dy, dz), t_min, t_max)


def _meet(tables: ir.Tables, i: int, ray: Ray) -> Hit:
    """The first meeting of each ray with instance i."""
    geometry, row = tables.instances.geometry[i], tables.instances.transform[i]
    o = lanes.transform_point(tables.transforms.inverse, row, ray.origin)
    d = lanes.transform_vector(tables.transforms.inverse, row, ray.direction)
    kind = tables.geometries.kind[geometry]
    if kind == MESH:
        return _meet_mesh(tables, geometry, Ray(o, d, ray.t_min, ray.t_max))
    t, part = shapes.intersect(kind, tables.geometries.parameters, geometry, o, d, ray.t_min, ray.t_max)
    zero = np.zeros(len(t))
    return Hit(t, zero, part + 0 * zero.astype(np.int64), zero, zero)


def _meet_mesh(tables: ir.Tables, g: int, ray: Ray) -> Hit:
    """The first meeting of each ray with a mesh: all pairs, a chunk at a time."""
    geometries, pools = tables.geometries, tables.pools
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    corners = pools.positions[pools.triangles[first : first + count]].astype(np.float64)
    origin = lanes.sub(ray.origin, tuple(geometries.origin[g]))
    n = len(ray.t_min)
    best = Hit(np.full(n, np.inf), np.full(n, -1), np.full(n, -1), np.zeros(n), np.zeros(n))
    step = max(1, CHUNK // max(count, 1))
    for start in range(0, n if count else 0, step):
        part = slice(start, start + step)
        o, d = _column(origin, part), _column(ray.direction, part)
        a, b, c = ((corners[:, k, 0], corners[:, k, 1], corners[:, k, 2]) for k in range(3))
        t, u, v = shapes.triangle(a, b, c, o, d, ray.t_min[part, None], ray.t_max[part, None])
        k = np.argmin(t, axis=1)[:, None]
        best.t[part], best.primitive[part] = np.take_along_axis(t, k, 1)[:, 0], first + k[:, 0]
        best.u[part], best.v[part] = np.take_along_axis(u, k, 1)[:, 0], np.take_along_axis(v, k, 1)[:, 0]
    return best


def _column(v: Vec, part: slice) -> Vec:
    return v[0][part, None], v[1][part, None], v[2][part, None]


@overload(closest, jit_options=HELPER)
def _closest_kernel(accel, tables, ray, active, visible_bit):
    def through_trees(accel, tables, ray, active, visible_bit):
        return traverse.find(  # pyright: ignore[reportCallIssue]
            accel.search, (accel, ray.origin, ray.direction, ray.t_min, ray.t_max, active, np.int64(visible_bit), False)
        )

    return through_trees if across.is_mask(active) else None


@overload(occluded, jit_options=HELPER)
def _occluded_kernel(accel, tables, ray, active):
    def through_trees(accel, tables, ray, active):
        found = traverse.find(  # pyright: ignore[reportCallIssue]
            accel.search, (accel, ray.origin, ray.direction, ray.t_min, ray.t_max, active, np.int64(SHADOW), True)
        )
        return found.instance >= 0

    return through_trees if across.is_mask(active) else None
