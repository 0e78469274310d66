"""Evaluates the transform of an instance at a time: static, or interpolated between two motion keys.

A transform is (3, 4) numbers, row by row, in lanes. `time` is 0 at the shutter's opening and 1 at its closing. Without motion it is None,
a constant at compile time, so kernels only read the tables.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..jit.kernel import helper
from ..lanes import affine, ops
from ..simd.registration import overload, types
from ..types import Hit, Lane, Tables, Vec

Affine = tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]
STRAIGHT = 0.9995  # cosine between quaternions above which interpolation is linear: sines would lose precision


class Frame(NamedTuple):
    """The frame of an instance."""

    matrix: Affine  # instance to world
    inverse: Affine


def transform_at(tables: Tables, row: Lane, time: Lane | None) -> Frame:
    """The frame of a row of Transforms at a time."""
    return _static_frame(tables, row) if time is None else _moving_frame(tables, row, time)


@overload(transform_at)
def _at_in_kernels(tables, row, time):
    if isinstance(time, types.NoneType):
        return lambda tables, row, time: _static_frame(tables, row)
    return lambda tables, row, time: _moving_frame(tables, row, time)


@helper
def row_of(tables: Tables, hit: Hit) -> Lane:
    """The row of Transforms of the instances that were hit; that of the first instance without a hit."""
    return ops.to_int(tables.instances.transform[ops.where(hit.instance >= 0, hit.instance, 0)])


def moves(tables: Tables, row: Lane, time: Lane | None) -> bool:
    """Whether the transform of some lane changes with time."""
    return time is not None and bool(np.any(tables.transforms.first_key[row] >= 0))


@overload(moves)
def _moves_in_kernels(tables, row, time):
    if isinstance(time, types.NoneType):
        return lambda tables, row, time: False
    return lambda tables, row, time: ops.any_lane(tables.transforms.first_key[row] >= 0)


@helper
def _static_frame(tables: Tables, row: Lane) -> Frame:
    return Frame(affine.load12(tables.transforms.matrix, row), affine.load12(tables.transforms.inverse, row))


@helper
def _moving_frame(tables: Tables, row: Lane, time: Lane) -> Frame:
    still = _static_frame(tables, row)
    first = ops.to_int(tables.transforms.first_key[row])
    moves = first >= 0
    matrix, inverse = _like(time, still.matrix), _like(time, still.inverse)
    if ops.any_lane(moves):
        moved = interpolate_keys(tables.keys, ops.where(moves, first, 0), ops.where(moves, tables.transforms.keys[row], 2), time)
        inverse = _select(moves, invert(moved), inverse)
        matrix = _select(moves, moved, matrix)
    return Frame(matrix, inverse)


@helper
def _like(time: Lane, m: Affine) -> Affine:
    """The transform spread over the lanes of `time`."""
    z = ops.full_like(time, 0.0)
    return (
        m[0] + z, m[1] + z, m[2] + z, m[3] + z, m[4] + z, m[5] + z, m[6] + z, m[7] + z, m[8] + z, m[9] + z, m[10] + z, m[11] + z,
    )  # fmt: skip


@helper
def _select(moves: Lane, a: Affine, b: Affine) -> Affine:
    return (
        ops.where(moves, a[0], b[0]), ops.where(moves, a[1], b[1]), ops.where(moves, a[2], b[2]), ops.where(moves, a[3], b[3]),
        ops.where(moves, a[4], b[4]), ops.where(moves, a[5], b[5]), ops.where(moves, a[6], b[6]), ops.where(moves, a[7], b[7]),
        ops.where(moves, a[8], b[8]), ops.where(moves, a[9], b[9]), ops.where(moves, a[10], b[10]), ops.where(moves, a[11], b[11]),
    )  # fmt: skip


@helper
def interpolate_keys(keys: Any, first: Lane, count: Lane, time: Lane) -> Affine:
    """The matrix at a time between the keys from `first` on: linear translation and scale, slerp rotation (Shoemake 1985)."""
    move, turn, stretch = keys.move, keys.turn, keys.stretch
    steps = ops.to_float(count - 1) + 0.0 * time
    place = ops.clip(time, 0.0, 1.0) * steps
    k = ops.minimum(ops.floor_int(place), ops.to_int(steps) - 1)
    f = place - ops.to_float(k)
    a = first + k
    b = a + 1
    ax, ay, az, aw = turn[a, 0], turn[a, 1], turn[a, 2], turn[a, 3]
    bx, by, bz, bw = turn[b, 0], turn[b, 1], turn[b, 2], turn[b, 3]
    cosine = ax * bx + ay * by + az * bz + aw * bw
    bent = cosine < STRAIGHT
    angle = ops.acos(ops.where(bent, cosine, 0.0))
    sine = ops.sin(angle)
    wa = ops.where(bent, ops.sin((1.0 - f) * angle) / sine, 1.0 - f)
    wb = ops.where(bent, ops.sin(f * angle) / sine, f)
    x, y, z, w = wa * ax + wb * bx, wa * ay + wb * by, wa * az + wb * bz, wa * aw + wb * bw
    size = 1.0 / ops.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x * size, y * size, z * size, w * size
    r0 = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y))
    r1 = (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x))
    r2 = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    s0 = _column(stretch, a, b, f, 0)
    s1 = _column(stretch, a, b, f, 1)
    s2 = _column(stretch, a, b, f, 2)
    return (
        ops.dot(r0, s0), ops.dot(r0, s1), ops.dot(r0, s2), ops.lerp(move[a, 0], move[b, 0], f),
        ops.dot(r1, s0), ops.dot(r1, s1), ops.dot(r1, s2), ops.lerp(move[a, 1], move[b, 1], f),
        ops.dot(r2, s0), ops.dot(r2, s1), ops.dot(r2, s2), ops.lerp(move[a, 2], move[b, 2], f),
    )  # fmt: skip


@helper
def _column(stretch: Any, a: Lane, b: Lane, f: Lane, j: int) -> Vec:
    return (
        ops.lerp(stretch[a, 0, j], stretch[b, 0, j], f), ops.lerp(stretch[a, 1, j], stretch[b, 1, j], f),
        ops.lerp(stretch[a, 2, j], stretch[b, 2, j], f),
    )  # fmt: skip


@helper
def invert(m: Affine) -> Affine:
    """The inverse of a transform, by cofactors."""
    a, b, c, x, d, e, f, y, g, h, i, z = m
    ei, fg, dh = e * i - f * h, f * g - d * i, d * h - e * g
    k = 1.0 / (a * ei + b * fg + c * dh)
    r0 = (ei * k, (c * h - b * i) * k, (b * f - c * e) * k)
    r1 = (fg * k, (a * i - c * g) * k, (c * d - a * f) * k)
    r2 = (dh * k, (b * g - a * h) * k, (a * e - b * d) * k)
    p = (x, y, z)
    return (
        r0[0], r0[1], r0[2], -ops.dot(r0, p), r1[0], r1[1], r1[2], -ops.dot(r1, p), r2[0], r2[1], r2[2], -ops.dot(r2, p),
    )  # fmt: skip


# --- the time of rays -------------------------------------------------------------------------------------------


def is_open(shutter: Any) -> bool:
    """Whether a shutter of this Numba type opens for more than a moment."""
    return bool(shutter.layout)
