"""Walking the trees of bvh.py with one ray, in kernels.

Boxes are tested so that none is missed through rounding: the far side is moved out by 2 γ₃ (Ize, "Robust BVH Ray Traversal",
JCGT 2013), the origin by its own error, and comparisons are written so that the NaN of 0 · ∞ (a ray along a box's face)
decides nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.extending import intrinsic
from numba.np.numpy_support import carray

from ..compiler import ir
from . import lanes, shapes
from .bvh import COUNT, DEPTH, FIRST
from .kernels import helper, kernel
from .records import Hit, Vec

MESH = int(ir.GeometryKind.MESH)
FAR = 1.0 + 2.0 * 3.4e-16  # 1 + 2 γ₃ for float64
WORLD_ERROR = 1e-12  # of the origin's coordinates: what transforms and their inverses may round
LOCAL_ERROR = 1e-15


@intrinsic
def _stack_memory(typing: Any):
    """A pointer to room for 2 · DEPTH float64 on the machine's stack; free, unlike np.empty in each call."""

    def lower(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        with builder.goto_entry_block():
            memory = builder.alloca(llvm.ArrayType(llvm.DoubleType(), 2 * DEPTH))
        return builder.bitcast(memory, llvm.DoubleType().as_pointer())

    return types.CPointer(types.float64)(), lower


class BoxRay(NamedTuple):
    """A ray made ready for boxes: origins moved against and along the ray, 1 / direction, columns of the near planes."""

    near_x: float
    near_y: float
    near_z: float
    far_x: float
    far_y: float
    far_z: float
    inverse_x: float
    inverse_y: float
    inverse_z: float
    x: int
    y: int
    z: int


@helper
def _box_ray(o: Vec, d: Vec, share: float) -> BoxRay:
    error = share * max(abs(o[0]), max(abs(o[1]), abs(o[2])))
    ix, iy, iz = 1.0 / d[0], 1.0 / d[1], 1.0 / d[2]
    ex = error if ix > 0.0 else -error
    ey = error if iy > 0.0 else -error
    ez = error if iz > 0.0 else -error
    x = 0 if ix > 0.0 else 3
    y = 1 if iy > 0.0 else 4
    z = 2 if iz > 0.0 else 5
    return BoxRay(o[0] + ex, o[1] + ey, o[2] + ez, o[0] - ex, o[1] - ey, o[2] - ez, ix, iy, iz, x, y, z)


@helper
def _enter(nodes: Any, node: int, ray: BoxRay, t_min: float, t_max: float) -> float:
    """Where the ray enters a node's box, inf where it misses it or comes too late."""
    near, far = t_min, t_max
    t = (nodes[node, ray.x] - ray.near_x) * ray.inverse_x
    near = t if t > near else near
    t = (nodes[node, 3 - ray.x] - ray.far_x) * ray.inverse_x * FAR
    far = t if t < far else far
    t = (nodes[node, ray.y] - ray.near_y) * ray.inverse_y
    near = t if t > near else near
    t = (nodes[node, 5 - ray.y] - ray.far_y) * ray.inverse_y * FAR
    far = t if t < far else far
    t = (nodes[node, ray.z] - ray.near_z) * ray.inverse_z
    near = t if t > near else near
    t = (nodes[node, 7 - ray.z] - ray.far_z) * ray.inverse_z * FAR
    far = t if t < far else far
    return near if near <= far else np.inf


@kernel
def closest(accel, origin, direction, t_min, t_max, active, visible_bit):
    """The first hit of each active lane's ray with what has `visible_bit`."""
    zero = lanes.full_like(t_min, 0.0)
    nothing = lanes.int_like(zero, -1)
    best = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = lanes.where(active, t_max, zero - np.inf)
    for k in range(len(accel.endless)):
        best = _try(accel, accel.endless[k], origin, direction, t_min, until, visible_bit, False, best)
    if accel.top >= 0:
        for k in range(lanes.width(zero)):
            if lanes.lane(active, k):
                ray = lanes.lane3(origin, k), lanes.lane3(direction, k)
                found = search(accel, ray[0], ray[1], lanes.lane(t_min, k), lanes.lane(t_max, k), visible_bit, False, _lane_of(best, k))
                best = _with_lane(best, k, found)
    return best


@kernel
def occluded(accel, origin, direction, t_min, t_max, active, visible_bit):
    """Whether the ray of each active lane meets anything that has `visible_bit`."""
    zero = lanes.full_like(t_min, 0.0)
    nothing = lanes.int_like(zero, -1)
    best = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = lanes.where(active, t_max, zero - np.inf)
    for k in range(len(accel.endless)):
        best = _try(accel, accel.endless[k], origin, direction, t_min, until, visible_bit, True, best)
        if lanes.not_(lanes.any_lane(active & (best.instance < 0))):
            return best.instance >= 0
    blocked = best.instance >= 0
    if accel.top >= 0:
        for k in range(lanes.width(zero)):
            if lanes.lane(active & lanes.not_(blocked), k):
                ray = lanes.lane3(origin, k), lanes.lane3(direction, k)
                none = Hit(np.inf, -1, -1, 0.0, 0.0)
                found = search(accel, ray[0], ray[1], lanes.lane(t_min, k), lanes.lane(t_max, k), visible_bit, True, none)
                blocked = lanes.with_lane(blocked, k, found.instance >= 0)
    return blocked


@helper
def _lane_of(hit: Hit, k: int) -> Hit:
    """A lane of a hit as scalars."""
    return Hit(lanes.lane(hit.t, k), lanes.lane(hit.instance, k), lanes.lane(hit.primitive, k), lanes.lane(hit.u, k), lanes.lane(hit.v, k))


@helper
def _with_lane(hit: Hit, k: int, one: Hit) -> Hit:
    """A hit with another lane k."""
    return Hit(
        lanes.with_lane(hit.t, k, one.t), lanes.with_lane(hit.instance, k, one.instance),
        lanes.with_lane(hit.primitive, k, one.primitive), lanes.with_lane(hit.u, k, one.u), lanes.with_lane(hit.v, k, one.v),
    )  # fmt: skip


@kernel
def search(accel, origin, direction, t_min, t_max, visible_bit, any_hit, best):
    """`best`, or the first hit of one ray with the instances of the tree where that comes first; with `any_hit`, the first one found."""
    memory = _stack_memory()  # pyright: ignore[reportCallIssue]
    stack = carray(memory, 2 * DEPTH)
    ray = _box_ray(origin, direction, WORLD_ERROR)
    node, near = np.int64(accel.top), _enter(accel.nodes, accel.top, ray, t_min, t_max)
    depth = 0
    while True:
        if near <= min(best.t, t_max) and near < np.inf:
            first = np.int64(accel.nodes[node, FIRST])
            if accel.nodes[node, COUNT] == 0.0:
                limit = min(best.t, t_max)
                left = _enter(accel.nodes, first, ray, t_min, limit)
                right = _enter(accel.nodes, first + 1, ray, t_min, limit)
                swap = right < left
                later, later_near = (first, left) if swap else (first + 1, right)
                node, near = (first + 1, right) if swap else (first, left)
                if later_near < np.inf:
                    stack[depth], stack[DEPTH + depth] = later_near, float(later)
                    depth += 1
                continue
            for k in range(first, first + np.int64(accel.nodes[node, COUNT])):
                best = _try(accel, accel.instances[k], origin, direction, t_min, t_max, visible_bit, any_hit, best)
                if any_hit and best.instance >= 0:
                    return best
        if depth == 0:
            return best
        depth -= 1
        node, near = np.int64(stack[DEPTH + depth]), stack[depth]


@helper
def _try(accel, i, origin, direction, t_min, t_max, visible_bit, any_hit, best):
    """`best`, or the hits with instance i in the lanes where that comes first."""
    if (accel.placed[i, 0] & visible_bit) == 0:
        return best
    row, g, kind = accel.placed[i, 1], accel.placed[i, 2], accel.placed[i, 3]
    o = lanes.transform_point(accel.inverse, row, origin)
    d = lanes.transform_vector(accel.inverse, row, direction)
    zero = lanes.full_like(t_min, 0.0)
    found = Hit(zero + np.inf, lanes.int_like(zero, i), lanes.int_like(zero, -1), zero, zero)
    if kind == MESH:
        o = lanes.sub(o, (accel.origin[g, 0], accel.origin[g, 1], accel.origin[g, 2]))
        limit = lanes.minimum(best.t, t_max)
        for k in range(lanes.width(zero)):
            if lanes.lane(limit, k) > lanes.lane(t_min, k):
                ray = lanes.lane3(o, k), lanes.lane3(d, k)
                t, primitive, u, v = _mesh(
                    accel.nodes, accel.triangles, accel.corners, accel.placed[i, 4], ray[0], ray[1], lanes.lane(t_min, k),
                    lanes.lane(t_max, k), lanes.lane(best.t, k), any_hit,
                )  # fmt: skip
                found = _with_lane(found, k, Hit(t, np.int64(i), primitive, u, v))
    else:
        t, part = shapes.intersect(kind, accel.parameters, g, o, d, t_min, t_max)
        found = Hit(t, found.instance, lanes.int_like(zero, 0) + part, zero, zero)
    nearer = (found.t < best.t) | ((found.t == best.t) & (found.t < np.inf) & (i < best.instance))
    return Hit(
        lanes.where(nearer, found.t, best.t), lanes.where(nearer, found.instance, best.instance),
        lanes.where(nearer, found.primitive, best.primitive), lanes.where(nearer, found.u, best.u), lanes.where(nearer, found.v, best.v),
    )  # fmt: skip


@kernel
def _mesh(nodes, triangles, corners, root, o, d, t_min, t_max, limit, any_hit):
    """(t, triangle, u, v) of the first meeting with the mesh whose tree begins at `root`, not beyond `limit`."""
    best, primitive, best_u, best_v = np.inf, np.int64(-1), 0.0, 0.0
    memory = _stack_memory()  # pyright: ignore[reportCallIssue]
    stack = carray(memory, 2 * DEPTH)
    ray = _box_ray(o, d, LOCAL_ERROR)
    kx, ky, kz, sx, sy, sz = shapes.shear(d)
    ox, oy, oz = shapes.component(o, kx), shapes.component(o, ky), shapes.component(o, kz)
    limit = min(limit, t_max)
    node, near = np.int64(root), _enter(nodes, root, ray, t_min, limit)
    depth = 0
    while True:
        if near <= limit and near < np.inf:
            first = np.int64(nodes[node, FIRST])
            if nodes[node, COUNT] == 0.0:
                left = _enter(nodes, first, ray, t_min, limit)
                right = _enter(nodes, first + 1, ray, t_min, limit)
                swap = right < left
                later, later_near = (first, left) if swap else (first + 1, right)
                node, near = (first + 1, right) if swap else (first, left)
                if later_near < np.inf:
                    stack[depth], stack[DEPTH + depth] = later_near, float(later)
                    depth += 1
                continue
            for k in range(first, first + np.int64(nodes[node, COUNT])):
                c = corners[k]
                t, u, v = shapes.sheared_triangle(
                    (c[kx] - ox, c[ky] - oy, c[kz] - oz),
                    (c[3 + kx] - ox, c[3 + ky] - oy, c[3 + kz] - oz),
                    (c[6 + kx] - ox, c[6 + ky] - oy, c[6 + kz] - oz),
                    sx, sy, sz, t_min, t_max,
                )  # fmt: skip
                if t < best or (t == best and t < np.inf and triangles[k] < primitive):
                    best, primitive, best_u, best_v = t, np.int64(triangles[k]), u, v
                    limit = min(limit, t)
                    if any_hit:
                        return best, primitive, best_u, best_v
        if depth == 0:
            return best, primitive, best_u, best_v
        depth -= 1
        node, near = np.int64(stack[DEPTH + depth]), stack[depth]
