"""Walking the trees of bvh.py, in kernels: over instances all lanes go together, in meshes each for itself.

Boxes are tested so that none is missed through rounding: the far side is moved out by 2 γ₃ (Ize, "Robust BVH Ray Traversal",
JCGT 2013), the origin by its own error, and comparisons are written so that the NaN of 0 · ∞ (a ray along a box's face)
decides nothing.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..compiler import ir
from . import across, lanes, shapes, simd, walk
from .bvh import COUNT, DEPTH, FIRST
from .handles import Handle
from .kernels import apart, helper
from .links import FLOAT, MASK, VEC, Linked
from .records import Hit, Lane, Vec

MESH = int(ir.GeometryKind.MESH)
FAR = 1.0 + 2.0 * 3.4e-16  # 1 + 2 γ₃ for float64
WORLD_ERROR = 1e-12  # of the origin's coordinates: what transforms and their inverses may round
LOCAL_ERROR = 1e-15
_STACK = 2 * DEPTH
_LANES = across.WIDTH
_FOUND = 3 * _LANES


class BoxRay(NamedTuple):
    """Rays made ready for boxes: origins moved against and along the ray, 1 / direction, and which way they go."""

    near: Vec
    far: Vec
    inverse: Vec
    x: Lane  # bool: toward greater x
    y: Lane
    z: Lane


@helper
def _box_ray(o: Vec, d: Vec, share: float) -> BoxRay:
    error = share * lanes.largest((abs(o[0]), abs(o[1]), abs(o[2])))
    inverse = (1.0 / d[0], 1.0 / d[1], 1.0 / d[2])
    x, y, z = inverse[0] > 0.0, inverse[1] > 0.0, inverse[2] > 0.0
    e = (lanes.where(x, error, -error), lanes.where(y, error, -error), lanes.where(z, error, -error))
    return BoxRay(lanes.add(o, e), lanes.sub(o, e), inverse, x, y, z)


@helper
def _enter(nodes: Any, node: int, ray: BoxRay, t_min: Lane, t_max: Lane) -> Lane:
    """Where each ray enters a node's box, inf where it misses it or comes too late."""
    low_x, low_y, low_z, high_x, high_y, high_z = (
        nodes[node, 0], nodes[node, 1], nodes[node, 2], nodes[node, 3], nodes[node, 4], nodes[node, 5],
    )  # fmt: skip
    near = lanes.maximum((lanes.where(ray.x, low_x, high_x) - ray.near[0]) * ray.inverse[0], t_min)
    far = lanes.minimum((lanes.where(ray.x, high_x, low_x) - ray.far[0]) * ray.inverse[0] * FAR, t_max)
    near = lanes.maximum((lanes.where(ray.y, low_y, high_y) - ray.near[1]) * ray.inverse[1], near)
    far = lanes.minimum((lanes.where(ray.y, high_y, low_y) - ray.far[1]) * ray.inverse[1] * FAR, far)
    near = lanes.maximum((lanes.where(ray.z, low_z, high_z) - ray.near[2]) * ray.inverse[2], near)
    far = lanes.minimum((lanes.where(ray.z, high_z, low_z) - ray.far[2]) * ray.inverse[2] * FAR, far)
    return lanes.where(near <= far, near, np.inf)


def _search(accel, origin, direction, t_min, t_max, active, visible_bit, any_hit):
    """The first hit of each active lane's ray with what has `visible_bit`; with `any_hit`, the first one found."""
    zero = lanes.full_like(t_min, 0.0)
    nothing = lanes.int_like(zero, -1)
    best = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = lanes.where(active, t_max, zero - np.inf)
    for k in range(len(accel.endless)):
        best = attempt(accel, accel.endless[k], origin, direction, t_min, until, visible_bit, any_hit, best)
        if any_hit:
            until = lanes.where(best.instance >= 0, zero - np.inf, until)
    if accel.top < 0 or lanes.not_(lanes.any_lane(until > t_min)):
        return best
    if accel.nodes[accel.top, COUNT] == 1.0:  # a single thing: its own box is asked
        return attempt(accel, accel.instances[0], origin, direction, t_min, until, visible_bit, any_hit, best)
    stack = simd.stack_array(np.float64, _STACK)
    ray = _box_ray(origin, direction, WORLD_ERROR)
    node, depth = np.int64(accel.top), 0
    while True:
        limit = lanes.minimum(best.t, until)
        if lanes.any_lane(_enter(accel.nodes, node, ray, t_min, limit) < np.inf):
            first = np.int64(accel.nodes[node, FIRST])
            if accel.nodes[node, COUNT] == 0.0:
                node, later, reach = _children(accel.nodes, first, ray, t_min, limit)
                if reach < np.inf:
                    stack[depth], stack[DEPTH + depth] = reach, float(later)
                    depth += 1
                continue
            for k in range(first, first + np.int64(accel.nodes[node, COUNT])):
                best = attempt(accel, accel.instances[k], origin, direction, t_min, until, visible_bit, any_hit, best)
            if any_hit:
                until = lanes.where(best.instance >= 0, zero - np.inf, until)
        longest = across.most(lanes.minimum(best.t, until))
        while depth > 0 and stack[depth - 1] > longest:
            depth -= 1
        if depth == 0:
            return best
        depth -= 1
        node = np.int64(stack[DEPTH + depth])


search = Linked(_search)
find = search.call  # what kernels call, with its address and its arguments


def link(accel: Handle) -> None:
    """Compile or load `search` for the packed trees, and tell them where it is."""
    accel.put("search", search.link(accel.numba_type, VEC, VEC, FLOAT, FLOAT, MASK, types.int64, types.boolean))


@helper
def _children(nodes: Any, first: int, ray: BoxRay, t_min: Lane, limit: Lane) -> tuple[int, int, float]:
    """(the child to go to, the other one, where the first of the rays enters that)."""
    left = across.least(_enter(nodes, first, ray, t_min, limit))
    right = across.least(_enter(nodes, first + 1, ray, t_min, limit))
    if right < left:
        return first + 1, first, left
    return first, first + 1, right


@helper
def attempt(accel: Any, i: int, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane, visible_bit: int, any_hit: bool, best: Hit) -> Hit:
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
        t, primitive, u, v = _mesh(accel, g, np.int64(accel.placed[i, 4]), o, d, t_min, t_max, best.t, any_hit)
        found = Hit(t, found.instance, primitive, u, v)
    else:
        t, part = shapes.intersect(kind, accel.parameters, g, o, d, t_min, t_max)
        found = Hit(t, found.instance, lanes.int_like(zero, 0) + part, zero, zero)
    nearer = (found.t < best.t) | ((found.t == best.t) & (found.t < np.inf) & (i < best.instance))
    return Hit(
        lanes.where(nearer, found.t, best.t), lanes.where(nearer, found.instance, best.instance),
        lanes.where(nearer, found.primitive, best.primitive), lanes.where(nearer, found.u, best.u), lanes.where(nearer, found.v, best.v),
    )  # fmt: skip


@apart
def _mesh(accel, g, root, o, d, t_min, t_max, nearest, any_hit):
    """(t, triangle, u, v) of the first meeting with mesh g, whose tree begins at `root`, not beyond `nearest`."""
    until = lanes.minimum(nearest, t_max)
    ray = _box_ray(o, d, LOCAL_ERROR)
    enters = _enter(accel.boxes, g, ray, t_min, until)
    zero = lanes.full_like(t_min, 0.0)
    left = across.bits(enters < np.inf)
    if left == 0:
        return zero + np.inf, lanes.int_like(zero, -1), zero, zero
    rays = walk.keep(o, d, ray.inverse, lanes.where(enters < np.inf, enters, 0.0), t_min, t_max, until)
    found, triangle = simd.stack_array(np.float64, _FOUND), simd.stack_array(np.int64, _LANES)
    across.store(found, 0, zero + np.inf)
    across.store(triangle, 0, lanes.int_like(zero, -1))
    while left != 0:
        k = simd.trailing_zeros(left)
        left &= left - 1
        if any_hit:
            met = walk.blocked(accel.wide, root, rays, k)
        else:
            met = walk.closest(accel.wide, root, rays, k)
        simd.write(found, k, met.t)
        simd.write(triangle, k, met.triangle)
        simd.write(found, _LANES + k, met.u)
        simd.write(found, 2 * _LANES + k, met.v)
    return across.load(found, 0), across.load(triangle, 0), across.load(found, 1), across.load(found, 2)
