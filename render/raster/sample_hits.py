"""Converts rasterized samples to ray hits: of the triangle itself, or of the shape that its tessellation approximates."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler import ir
from ..accel.traverse import two_level
from ..jit.kernel import helper
from ..lanes import affine, crosslane, ops
from ..types import Hit, Lane, Ray, View
from . import coverage

MESH = int(ir.GeometryKind.MESH)
CAMERA = int(ir.Visibility.CAMERA)
OUTSIDE = 1.0 / 64.0  # of their sum: how far below 0 the weights of a sample beside its triangle may go


@helper
def intersect(accel: Any, instance: int, ray: Ray, active: Lane) -> Hit:
    """The hits of rays with one instance, in the active lanes."""
    zero = 0.0 * ray.direction[0]
    nothing = ops.int_like(zero, -1)
    none = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = ops.where(active, ray.t_max, zero - np.inf)
    return two_level.intersect_instance(accel, instance, ray.origin, ray.direction, ray.t_min, until, CAMERA, False, none)


@helper
def axis_cosine(tables: Any, view: View, ray: Ray) -> Lane:
    """The cosine between rays and the camera's axis: depth over distance."""
    return -affine.transform_vector(tables.transforms.inverse, tables.cameras.transform[view.camera], ray.direction)[2]


@helper
def find_hits(model: Any, tables: Any, accel: Any, view: View, ray: Ray, px: Lane, py: Lane, instances: Lane, triangle: Lane) -> Hit:
    """The hits of the rays through samples of the z-buffer, as intersect.closest_hit gives them."""
    zero = 0.0 * ray.direction[0]
    nothing = ops.int_like(zero, -1)
    t, instance, primitive, u, v = zero + np.inf, nothing, nothing, zero, zero
    pending = instances >= 0
    while ops.any_lane(pending):
        i, lanes = crosslane.uniform_group(instances, pending)
        hit = _intersect_instance(model, tables, accel, view, ray, px, py, i, triangle, lanes)
        is_hit = lanes & (hit.t < np.inf)
        t, instance, primitive = ops.where(is_hit, hit.t, t), ops.where(is_hit, i, instance), ops.where(is_hit, hit.primitive, primitive)
        u, v = ops.where(is_hit, hit.u, u), ops.where(is_hit, hit.v, v)
        pending = pending & ops.not_(lanes)
    return Hit(t, instance, primitive, u, v)


@helper
def _intersect_instance(model: Any, tables: Any, accel: Any, view: View, ray: Ray, px: Lane, py: Lane, i: int, triangle: Lane,
                        lanes: Lane) -> Hit:  # fmt: skip
    """The hits of the lanes `lanes` with instance i; t is inf where the z-buffer's triangle has none."""
    zero = 0.0 * ray.direction[0]
    t, u, v, part = zero + np.inf, zero, zero, ops.int_like(zero, -1)
    flat = lanes & (triangle >= 0)
    if ops.any_lane(flat):
        row = ops.where(flat, triangle, 0)
        depth, wu, wv = weights(model, i, row, px / coverage.ONE, py / coverage.ONE)
        t = ops.where(flat, depth / axis_cosine(tables, view, ray), t)
        u, v = ops.where(flat, wu, u), ops.where(flat, wv, v)
        part = ops.where(flat, ops.to_int(model.parts[row]), part)
    t = ops.where(abs(t) < np.inf, t, np.inf)  # an unbounded plane at its horizon
    if tables.geometries.kind[tables.instances.geometry[i]] != MESH:
        exact = intersect(accel, i, ray, lanes)
        is_hit = exact.instance >= 0
        t, part = ops.where(is_hit, exact.t, t), ops.where(is_hit, exact.primitive, part)
        u, v = ops.where(is_hit, exact.u, u), ops.where(is_hit, exact.v, v)
    return Hit(t, ops.int_like(zero, i), part, u, v)


@helper
def weights(model: Any, instance: int, triangle: Lane, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane]:
    """(depth, u, v) of triangles at pixel coordinates: perspective-correct weights of their second and third corners.

    The corners' rows (X - x W, Y - y W) are relative to the sample; the cross of two of them is the third's unnormalized weight. Samples
    just outside because of snapping have extrapolated weights where those are small and the plane lies before the eye, else clamped ones.
    """
    m, p, corners = model.matrix, model.positions, model.triangles
    x0, y0, d0, v0 = relative_to_sample(m, instance, p, corners[triangle, 0], x, y)
    x1, y1, d1, v1 = relative_to_sample(m, instance, p, corners[triangle, 1], x, y)
    x2, y2, d2, v2 = relative_to_sample(m, instance, p, corners[triangle, 2], x, y)
    e0, e1, e2 = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
    area = e0 + e1 + e2
    turn = ops.where(area < 0.0, -1.0, 1.0)
    e0, e1, e2 = turn * e0, turn * e1, turn * e2
    least = ops.minimum(e0, ops.minimum(e1, e2))
    beside = (least > turn * area * -OUTSIDE) & (e0 * d0 + e1 * d1 + e2 * d2 > 0.0) & (e0 * v0 + e1 * v1 + e2 * v2 > 0.0)
    least = ops.where(beside, least, 0.0)
    e0, e1, e2 = ops.maximum(e0, least), ops.maximum(e1, least), ops.maximum(e2, least)
    total = e0 + e1 + e2
    thin = total == 0.0  # edge-on: use the first corner
    e0, total = ops.where(thin, 1.0, e0), ops.where(thin, 1.0, total)
    return (e0 * d0 + e1 * d1 + e2 * d2) / (e0 * v0 + e1 * v1 + e2 * v2), e1 / total, e2 / total


@helper
def relative_to_sample(matrix: Any, instance: int, positions: Any, row: Lane, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(X - x W, Y - y W, D, V) of vertices: clip space relative to pixel coordinates (x, y)."""
    row = ops.to_int(row)
    px, py, pz, pw = positions[row, 0], positions[row, 1], positions[row, 2], positions[row, 3]
    m = matrix
    w = m[instance, 2, 0] * px + m[instance, 2, 1] * py + m[instance, 2, 2] * pz + m[instance, 2, 3] * pw
    cx = m[instance, 0, 0] * px + m[instance, 0, 1] * py + m[instance, 0, 2] * pz + m[instance, 0, 3] * pw - x * w
    cy = m[instance, 1, 0] * px + m[instance, 1, 1] * py + m[instance, 1, 2] * pz + m[instance, 1, 3] * pw - y * w
    depth = m[instance, 3, 0] * px + m[instance, 3, 1] * py + m[instance, 3, 2] * pz + m[instance, 3, 3] * pw
    return cx, cy, depth, pw
