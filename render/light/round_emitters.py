"""Sampling of emissive cones, cylinders, tori and capsules: points of equal probability for equal areas.

Each is a surface about an axis through its center. The side of a closed cylinder is sampled by solid angle instead, see
shape_solid_angle.py, except for photons.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from . import lights

TUBE, CONE, TORUS, CAPSULE = 21, 22, 23, 24  # emitter kinds: the sides of cylinders and cones
ROUND = (TUBE, CONE, TORUS, CAPSULE)


def area(kind: int, size: tuple[float, float], half: float) -> float:
    """The area in m² of a surface; `size` and `half` as side_u and half the length of emitter_table.Emitters."""
    a, b = size
    if kind == TUBE:
        return 4.0 * math.pi * a * half
    if kind == CONE:
        return math.pi * (a + b) * math.hypot(2.0 * half, a - b)
    return 4.0 * math.pi**2 * a * b if kind == TORUS else 4.0 * math.pi * a * (half + a)


def extent(kind: Any, side_u: Any, side_v: Any, axis: Any) -> Any:
    """(n, 3) half extents of the bounds about the centers."""
    around = np.sqrt(np.maximum(1.0 - axis**2, 0.0))  # of a circle around an axis
    a, b = side_u[:, :1], side_u[:, 1:2]
    shape = kind[:, None]
    found = np.abs(side_v) + np.where(shape == CONE, np.maximum(a, b), a) * around
    found = np.where(shape == TORUS, b + a * around, found)
    return np.where(shape == CAPSULE, np.abs(side_v) + a, found)


@helper
def is_round(kind: Lane) -> Lane:
    """Whether an emitter is of these kinds."""
    return (kind >= TUBE) & (kind <= CAPSULE)


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
    return ops.add(across, ops.scale(axis, along))


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
    found = ops.where3(kind == TORUS, on_torus, ops.where3(kind == CAPSULE, on_capsule, on_side))
    return ops.scale(found, 1.0 / ops.maximum(ops.length(found), lights.TINY))


@helper
def _axis(emitters: Any, e: Lane, zero: Lane) -> tuple[Vec, Lane]:
    """(unit axis, half the length along it)."""
    side = (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)
    axis = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    return axis, ops.length(side)
