"""Sampling of emissive cones, cylinders, tori, capsules and ellipsoids.

All but ellipsoids are surfaces about an axis through their center, and equal areas have equal probability. Points of an ellipsoid are those
of a sphere under its transform. Light samples of the side of a closed cylinder are by solid angle instead (shape_solid_angle.py); photons
start from it by area.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from . import lights

TUBE, CONE, TORUS, CAPSULE, ELLIPSOID = 21, 22, 23, 24, 25  # sides: TUBE of closed cylinders, CONE of cones and open cylinders
ROUND = (TUBE, CONE, TORUS, CAPSULE, ELLIPSOID)


def area(kind: int, size: tuple[float, float], half: float) -> float:
    """The area in m² of a surface; `size` and `half` as side_u and half the length of emitter_table.Emitters."""
    a, b = size
    if kind == TUBE:
        return 4.0 * math.pi * a * half
    if kind == CONE:
        return math.pi * (a + b) * math.hypot(2.0 * half, a - b)
    return 4.0 * math.pi**2 * a * b if kind == TORUS else 4.0 * math.pi * a * (half + a)


def ellipsoid_area(axes: Any) -> float:
    """The area in m² of an ellipsoid with axes (3, 3), to 1 % (Knud Thomsen's formula)."""
    a, b, c = np.linalg.svd(axes, compute_uv=False)
    p = 1.6075
    return float(4.0 * math.pi * (((a * b) ** p + (b * c) ** p + (c * a) ** p) / 3.0) ** (1.0 / p))


def extent(kind: Any, side_u: Any, side_v: Any, axis: Any) -> Any:
    """(n, 3) half extents of the bounds about the centers."""
    around = np.sqrt(np.maximum(1.0 - axis**2, 0.0))  # of a circle around an axis
    a, b = side_u[:, :1], side_u[:, 1:2]
    shape = kind[:, None]
    half_extent = np.abs(side_v) + np.where(shape == CONE, np.maximum(a, b), a) * around
    half_extent = np.where(shape == TORUS, b + a * around, half_extent)
    half_extent = np.where(shape == CAPSULE, np.abs(side_v) + a, half_extent)
    return np.where(shape == ELLIPSOID, np.sqrt(side_u**2 + side_v**2 + axis**2), half_extent)


@helper
def is_round(kind: Lane) -> Lane:
    """Whether an emitter is of these kinds."""
    return (kind >= TUBE) & (kind <= ELLIPSOID)


@helper
def point(emitters: Any, e: Lane, u: Lane, v: Lane) -> Vec:
    """A point of emitter e from its center, by two numbers in [0, 1)."""
    kind, zero = emitters.kind[e], 0.0 * u
    a, b = emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero
    axis, half = _axis(emitters, e, zero)
    # cones: the share of the height below which lies the share u of the area
    wide = ops.where(kind == TUBE, a, b)
    slope = wide - a
    height = u * (a + wide) / ops.maximum(a + ops.sqrt(ops.maximum(a * a + u * slope * (a + wide), 0.0)), lights.TINY)
    height = ops.minimum(height, 1.0)
    radius, along = a + height * slope, (2.0 * height - 1.0) * half
    # tori: angles around the tube with density 1 + b/a cos: a mirrored pair shares its probability by this factor
    torus = kind == TORUS
    turn = 2.0 * math.pi * u
    ratio = b / ops.maximum(a, lights.TINY)
    other = v * 1024.0
    other = other - ops.floor(other)
    turn = ops.where(other < 0.5 * (1.0 + ratio * ops.cos(turn)), turn, math.pi - turn)
    radius, along = ops.where(torus, a + b * ops.cos(turn), radius), ops.where(torus, b * ops.sin(turn), along)
    # capsules: the height by area, as that of a sphere's slices
    capsule = kind == CAPSULE
    level = (2.0 * u - 1.0) * (half + a)
    over = level - ops.clip(level, 0.0 - half, half)
    radius = ops.where(capsule, ops.sqrt(ops.maximum(a * a - over * over, 0.0)), radius)
    along = ops.where(capsule, level, along)
    s, t = ops.basis(axis)
    angle = 2.0 * math.pi * v
    across = ops.add(ops.scale(s, radius * ops.cos(angle)), ops.scale(t, radius * ops.sin(angle)))
    position = ops.add(across, ops.scale(axis, along))
    stretched = kind == ELLIPSOID
    if ops.any_lane(stretched):
        x, y, z = lights.cone_direction(ops.like3(u, 0.0, 0.0, 1.0), 2.0 * u, v)
        axes = _axes(emitters, e, zero)
        position = ops.where3(stretched, ops.add(ops.scale(axes[0], x), ops.add(ops.scale(axes[1], y), ops.scale(axes[2], z))), position)
    return position


@helper
def normal(emitters: Any, e: Lane, place: Vec) -> Vec:
    """The outward unit normal at a point of emitter e, given from its center."""
    kind, zero = emitters.kind[e], 0.0 * place[0]
    a, b = emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero
    axis, half = _axis(emitters, e, zero)
    along = ops.dot(place, axis)
    across = ops.sub(place, ops.scale(axis, along))
    radius = ops.maximum(ops.length(across), lights.TINY)
    outward = ops.scale(across, 1.0 / radius)
    lean = ops.where(kind == CONE, a - b, 0.0)
    on_side = ops.add(ops.scale(outward, 2.0 * half), ops.scale(axis, lean))
    on_torus = ops.add(ops.scale(outward, radius - a), ops.scale(axis, along))
    on_capsule = ops.add(across, ops.scale(axis, along - ops.clip(along, 0.0 - half, half)))
    direction = ops.where3(kind == TORUS, on_torus, ops.where3(kind == CAPSULE, on_capsule, on_side))
    if ops.any_lane(kind == ELLIPSOID):
        direction = ops.where3(kind == ELLIPSOID, _stretched_normal(emitters, e, place), direction)
    return ops.scale(direction, 1.0 / ops.maximum(ops.length(direction), lights.TINY))


@helper
def area_of(emitters: Any, e: Lane, place: Vec) -> Lane:
    """One over the probability density by area of a point of emitter e, given from its center."""
    area = emitters.area[e] + 0.0 * place[0]
    stretched = emitters.kind[e] == ELLIPSOID
    if ops.any_lane(stretched):
        area = ops.where(stretched, 4.0 * math.pi * ops.length(_stretched_normal(emitters, e, place)), area)
    return area


@helper
def _stretched_normal(emitters: Any, e: Lane, place: Vec) -> Vec:
    """The outward normal of an ellipsoid, as long as the transform's stretch of area there."""
    u, v, w = _axes(emitters, e, 0.0 * place[0])
    vw, wu, uv = ops.cross(v, w), ops.cross(w, u), ops.cross(u, v)
    volume = ops.dot(u, vw)
    inverse = 1.0 / ops.where(ops.absolute(volume) > lights.TINY, volume, lights.TINY)
    x, y, z = ops.dot(vw, place) * inverse, ops.dot(wu, place) * inverse, ops.dot(uv, place) * inverse
    scaled_normal = ops.add(ops.scale(vw, x), ops.add(ops.scale(wu, y), ops.scale(uv, z)))
    return ops.scale(scaled_normal, ops.sign_of(volume))


@helper
def _axes(emitters: Any, e: Lane, zero: Lane) -> tuple[Vec, Vec, Vec]:
    """The three axes of an ellipsoid."""
    return (
        (emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero, emitters.side_u[e, 2] + zero),
        (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero),
        (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero),
    )


@helper
def _axis(emitters: Any, e: Lane, zero: Lane) -> tuple[Vec, Lane]:
    """(unit axis, half the length along it)."""
    side = (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)
    axis = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    return axis, ops.length(side)
