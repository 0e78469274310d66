"""Ray intersection, normals and surface coordinates of analytic shapes in their own frames, in lanes.

`Hit.primitive` numbers the parts of a shape: the six faces of a box (-x, +x, -y, +y, -z, +z); 0 the side, 1 the bottom cap and 2 the top
cap of a cylinder or cone; 0 otherwise. Directions need no unit length: t is in lengths of the direction.

Surface coordinates (u right, v up, seen from outside with y up; 0 to 1 unless noted):

| kind | u | v |
|---|---|---|
| sphere | longitude: 0.5 at +z, growing toward +x; the seam at -z | latitude, 0 at the south pole |
| box | across each face | up each face; on top toward -z, below toward +z |
| plane | x in metres | -z in metres |
| rectangle, disk, caps | x | -z (bottom cap: z) |
| cylinder, cone | longitude | height |
| torus | longitude | around the tube: 0.5 outermost, 0.75 on top |
| capsule | longitude | along the outline from pole to pole |
| quadric | longitude | y, from 0 to 1 in its box, in metres without one |
"""

from __future__ import annotations

import math

from ...compiler import ir
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from .flat_shapes import box, component, disk, plane, rectangle, triangle
from .round_shapes import capsule, cone, quadric, quadric_gradient, sphere
from .torus import torus

__all__ = ["intersect", "normal", "triangle", "uv"]

INF = math.inf
TURN = 2.0 * math.pi
SPHERE = int(ir.GeometryKind.SPHERE)
BOX = int(ir.GeometryKind.BOX)
PLANE = int(ir.GeometryKind.PLANE)
RECTANGLE = int(ir.GeometryKind.RECTANGLE)
DISK = int(ir.GeometryKind.DISK)
CYLINDER = int(ir.GeometryKind.CYLINDER)
CONE = int(ir.GeometryKind.CONE)
TORUS = int(ir.GeometryKind.TORUS)
CAPSULE = int(ir.GeometryKind.CAPSULE)
QUADRIC = int(ir.GeometryKind.QUADRIC)


@helper
def intersect(kind: Lane, parameters, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """(t, part) of the first hit with shape `g` with t_min < t < t_max; t is inf without a hit.

    `parameters` is Geometries.parameters. It does not handle meshes: see `triangle`.
    """
    t, part = usual(kind, parameters, g, origin, direction, t_min, t_max)
    if ops.any_lane(kind > PLANE):
        other_t, other_part = rare(kind, parameters, g, origin, direction, t_min, t_max)
        t, part = ops.where(kind > PLANE, other_t, t), ops.where(kind > PLANE, other_part, part)
    return t, part


@helper
def usual(kind: Lane, parameters, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """`intersect` for spheres, boxes and planes, the usual shapes."""
    t = INF + 0.0 * (kind + t_max)
    part = kind * 0
    if ops.any_lane(kind == SPHERE):
        t = ops.where(kind == SPHERE, sphere(parameters[g, 0], origin, direction, t_min, t_max), t)
    if ops.any_lane(kind == BOX):
        s, face = box((parameters[g, 0], parameters[g, 1], parameters[g, 2]), origin, direction, t_min, t_max)
        t = ops.where(kind == BOX, s, t)
        part = ops.where(kind == BOX, face, part)
    if ops.any_lane(kind == PLANE):
        t = ops.where(kind == PLANE, plane(origin, direction, t_min, t_max), t)
    return t, part


@helper
def rare(kind: Lane, parameters, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """`intersect` for all other shapes."""
    t = INF + 0.0 * (kind + t_max)
    part = kind * 0
    p0, p1, p2 = parameters[g, 0], parameters[g, 1], parameters[g, 2]
    if ops.any_lane(kind == RECTANGLE):
        t = ops.where(kind == RECTANGLE, rectangle(p0, p1, origin, direction, t_min, t_max), t)
    if ops.any_lane(kind == DISK):
        t = ops.where(kind == DISK, disk(p0, origin, direction, t_min, t_max), t)
    round_ = (kind == CYLINDER) | (kind == CONE)
    if ops.any_lane(round_):
        straight = kind == CYLINDER
        s, side = cone(
            p0, ops.where(straight, p0, p1), ops.where(straight, p1, p2),
            ops.where(straight, p2, parameters[g, 3]), origin, direction, t_min, t_max,
        )  # fmt: skip
        t = ops.where(round_, s, t)
        part = ops.where(round_, side, part)
    if ops.any_lane(kind == TORUS):
        t = ops.where(kind == TORUS, torus(p0, p1, origin, direction, t_min, t_max), t)
    if ops.any_lane(kind == CAPSULE):
        t = ops.where(kind == CAPSULE, capsule(p0, p1, origin, direction, t_min, t_max), t)
    if ops.any_lane(kind == QUADRIC):
        t = ops.where(kind == QUADRIC, quadric(parameters, g, origin, direction, t_min, t_max), t)
    return t, part


@helper
def normal(kind: Lane, parameters, g: Lane, part: Lane, p: Vec) -> Vec:
    """Unit normal of shape `g` at its point p, outward; +y for flat shapes, the gradient's direction for quadrics."""
    x, y, z = p
    zero = 0.0 * x
    p0, p1, p2 = parameters[g, 0], parameters[g, 1], parameters[g, 2]
    n = (zero, zero + 1.0, zero)
    n = ops.where3(kind == SPHERE, p, n)
    if ops.any_lane(kind == BOX):
        sign = ops.where(part % 2 == 1, 1.0, -1.0)
        face = (ops.where(part // 2 == 0, sign, 0.0), ops.where(part // 2 == 1, sign, 0.0), ops.where(part // 2 == 2, sign, 0.0))
        n = ops.where3(kind == BOX, face, n)
    round_ = (kind == CYLINDER) | (kind == CONE)
    if ops.any_lane(round_):
        slope = ops.where(kind == CONE, 0.5 * (p1 - p0) / p2, 0.0)
        rho = ops.sqrt(x * x + z * z)
        side = ops.where3(rho > 0.0, (x, -slope * rho, z), (zero, zero - ops.where(slope > 0.0, 1.0, -1.0), zero))
        cap = (zero, ops.where(part == 1, -1.0, 1.0) + zero, zero)
        n = ops.where3(round_, ops.where3(part == 0, side, cap), n)
    if ops.any_lane(kind == TORUS):
        inner = p0 / ops.sqrt(x * x + z * z)
        n = ops.where3(kind == TORUS, (x - inner * x, y, z - inner * z), n)
    if ops.any_lane(kind == CAPSULE):
        n = ops.where3(kind == CAPSULE, (x, y - ops.clip(y, -p1, p1), z), n)
    if ops.any_lane(kind == QUADRIC):
        n = ops.where3(kind == QUADRIC, quadric_gradient(parameters, g, p), n)
    return ops.normalize(n)


@helper
def uv(kind: Lane, parameters, g: Lane, part: Lane, p: Vec) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
    """((u, v), (metres per u, metres per v)) at the point p of shape `g`, by the table above.

    Where the length of u varies over the shape, it is the largest one (a sphere's equator).
    """
    x, y, z = p
    p0, p1, p2 = parameters[g, 0], parameters[g, 1], parameters[g, 2]
    rho = ops.sqrt(x * x + z * z)
    longitude = 0.5 + ops.atan2(x, z) / TURN
    u, v = x, -z
    du = 1.0 + 0.0 * x
    dv = du
    if ops.any_lane(kind == SPHERE):
        here = kind == SPHERE
        u, v = ops.where(here, longitude, u), ops.where(here, 0.5 + ops.atan2(y, rho) / math.pi, v)
        du, dv = ops.where(here, TURN * p0, du), ops.where(here, math.pi * p0, dv)
    if ops.any_lane(kind == BOX):
        here = kind == BOX
        bu, bv, bdu, bdv = _box_uv((p0, p1, p2), part, p)
        u, v, du, dv = ops.where(here, bu, u), ops.where(here, bv, v), ops.where(here, bdu, du), ops.where(here, bdv, dv)
    tall = (kind == CYLINDER) | (kind == CONE)
    if ops.any_lane(tall):
        half = ops.where(kind == CYLINDER, p1, p2)
        widest = ops.where(kind == CYLINDER, p0, ops.maximum(p0, p1))
        lean = ops.where(kind == CYLINDER, 0.0, p1 - p0)
        u, v = ops.where(tall, longitude, u), ops.where(tall, 0.5 + 0.5 * y / half, v)
        du, dv = ops.where(tall, TURN * widest, du), ops.where(tall, ops.sqrt(4.0 * half * half + lean * lean), dv)
    flat = (kind == RECTANGLE) | (kind == DISK) | (tall & (part != 0))
    if ops.any_lane(flat):
        side_x, side_z = _flat_size(kind, part, p0, p1)
        up = ops.where(tall & (part == 1), z, -z)
        u, v = ops.where(flat, 0.5 + 0.5 * x / side_x, u), ops.where(flat, 0.5 + 0.5 * up / side_z, v)
        du, dv = ops.where(flat, 2.0 * side_x, du), ops.where(flat, 2.0 * side_z, dv)
    if ops.any_lane(kind == TORUS):
        here = kind == TORUS
        u, v = ops.where(here, longitude, u), ops.where(here, 0.5 + ops.atan2(y, rho - p0) / TURN, v)
        du, dv = ops.where(here, TURN * (p0 + p1), du), ops.where(here, TURN * p1, dv)
    if ops.any_lane(kind == CAPSULE):
        here = kind == CAPSULE
        whole = math.pi * p0 + 2.0 * p1
        middle = ops.clip(y, -p1, p1)
        along = middle + p0 * ops.atan2(y - middle, rho)
        u, v = ops.where(here, longitude, u), ops.where(here, 0.5 + along / whole, v)
        du, dv = ops.where(here, TURN * p0, du), ops.where(here, whole, dv)
    if ops.any_lane(kind == QUADRIC):
        here = kind == QUADRIC
        half = parameters[g, 11]
        cut = half < INF
        u, v = ops.where(here, longitude, u), ops.where(here, ops.where(cut, 0.5 + 0.5 * y / half, y), v)
        dv = ops.where(here, ops.where(cut, 2.0 * half, 1.0), dv)
    return (u, v), (du, dv)


@helper
def _flat_size(kind: Lane, part: Lane, p0: Lane, p1: Lane) -> tuple[Lane, Lane]:
    """Half the width and depth of a rectangle, a disk or the cap of a cylinder or cone."""
    radius = ops.where((kind == CONE) & (part == 2), p1, p0)
    return radius, ops.where(kind == RECTANGLE, p1, radius)


@helper
def _box_uv(half: Vec, part: Lane, p: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(u, v, metres per u, metres per v) on a face of a box, upright on its sides."""
    axis = part // 2
    side = ops.where(part % 2 == 1, 1.0, -1.0)
    across = ops.where(axis == 0, -side * p[2], ops.where(axis == 1, p[0], side * p[0]))
    up = ops.where(axis == 1, -side * p[2], p[1])
    width = component(half, ops.where(axis == 0, 2, 0))
    height = component(half, ops.where(axis == 1, 2, 1))
    return 0.5 + 0.5 * across / width, 0.5 + 0.5 * up / height, 2.0 * width, 2.0 * height
