"""Looks up images: bilinear or nearest, in a level, with wrap modes."""

from __future__ import annotations

from typing import Any

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, separate_helper
from ..lanes import ops
from ..simd.registration import overload
from ..types import Lane, Tables

REPEAT = int(ir.Wrap.REPEAT)
MIRROR = int(ir.Wrap.MIRROR)
BLACK = int(ir.Wrap.BLACK)

Rgba = tuple[Lane, Lane, Lane, Lane]


@helper
def look_up(tables: Tables, image: Lane, s: Lane, t: Lane, wrap_u: Lane, wrap_v: Lane, nearest: Lane) -> Rgba:
    """Row `image` of Images at s (right) and t (up), 0 to 1 over the image."""
    images = tables.images
    return _bilinear(tables, images.first[image], images.width[image], images.height[image], s, t, wrap_u, wrap_v, nearest)


@helper
def look_up_level(tables: Any, image: Lane, level: Lane, s: Lane, t: Lane, wraps: Any, nearest: Lane) -> Rgba:
    """`look_up` in one level."""
    images = tables.images
    first, width, height = images.level_first[image, level], images.level_width[image, level], images.level_height[image, level]
    return _bilinear(tables, first, width, height, s, t, wraps[0], wraps[1], nearest)


@separate_helper
def _bilinear(tables: Tables, first: Lane, width: Lane, height: Lane, s: Lane, t: Lane, wrap_u: Lane, wrap_v: Lane, nearest: Lane) -> Rgba:
    half = ops.where(nearest, 0.0, 0.5)
    x, y = s * width - half, (1.0 - t) * height - half
    x0, y0 = ops.floor_int(x), ops.floor_int(y)
    fx, fy = ops.where(nearest, 0.0, x - x0), ops.where(nearest, 0.0, y - y0)
    (a, in_a), (b, in_b) = _wrap_index(x0, width, wrap_u)
    (c, in_c), (d, in_d) = _wrap_index(y0, height, wrap_v)
    rows = (first + c * width + a, first + c * width + b, first + d * width + a, first + d * width + b)
    gx, gy = 1.0 - fx, 1.0 - fy
    if ops.any_lane((wrap_u == BLACK) | (wrap_v == BLACK)):
        fx, gx, fy, gy = fx * in_b, gx * in_a, fy * in_d, gy * in_c
    return mix_texels(tables.images.texels, rows, (gx * gy, fx * gy, gx * fy, fx * fy))


def mix_texels(texels: Any, rows: Rgba, weights: Rgba) -> Rgba:
    """The weighted sum of four texels."""
    r, g, b, a = ((weights[0] * texels[rows[0], c] + weights[1] * texels[rows[1], c])
                  + (weights[2] * texels[rows[2], c] + weights[3] * texels[rows[3], c]) for c in range(4))  # fmt: skip
    return r, g, b, a


@overload(mix_texels)
def _mix_texels_in_kernels(texels, rows, weights):
    if isinstance(rows[0], simd.Vector) and rows[0].bits == 32:
        return lambda texels, rows, weights: _mix_by_rows(texels, rows, weights)
    return lambda texels, rows, weights: (
        _mix(texels, rows, weights, 0), _mix(texels, rows, weights, 1), _mix(texels, rows, weights, 2), _mix(texels, rows, weights, 3)
    )  # fmt: skip


@helper
def _mix_by_rows(texels: Any, rows: Rgba, weights: Rgba) -> Rgba:
    """`mix_texels` by rows: a texel's four numbers are contiguous, usually followed by those of its right neighbor."""
    above, below = (weights[0], weights[1]), (weights[2], weights[3])
    if simd.all_of((rows[1] == rows[0] + 1) & (rows[3] == rows[2] + 1)):
        return _add(_pair(simd.gather_rows(texels, rows[0] << 2, 8), above), _pair(simd.gather_rows(texels, rows[2] << 2, 8), below))
    p, q = simd.gather_rows(texels, rows[0] << 2, 4), simd.gather_rows(texels, rows[1] << 2, 4)
    m, n = simd.gather_rows(texels, rows[2] << 2, 4), simd.gather_rows(texels, rows[3] << 2, 4)
    return _add(
        _pair((p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]), above), _pair((m[0], m[1], m[2], m[3], n[0], n[1], n[2], n[3]), below)
    )


@helper
def _pair(t: Any, weights: tuple[Lane, Lane]) -> Rgba:
    """The weighted sum of two adjacent texels."""
    a, b = weights
    return a * t[0] + b * t[4], a * t[1] + b * t[5], a * t[2] + b * t[6], a * t[3] + b * t[7]


@helper
def _add(p: Rgba, q: Rgba) -> Rgba:
    return p[0] + q[0], p[1] + q[1], p[2] + q[2], p[3] + q[3]


@helper
def _mix(texels: Any, rows: Rgba, weights: Rgba, channel: int) -> Lane:
    a, b = weights[0] * texels[rows[0], channel], weights[1] * texels[rows[1], channel]
    return (a + b) + (weights[2] * texels[rows[2], channel] + weights[3] * texels[rows[3], channel])


@helper
def _wrap_index(i: Lane, n: Lane, wrap: Lane) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
    """Indices i and i + 1 wrapped to 0 … n-1, each with weight 1, or 0 outside of an image on black."""
    index, after = i, i + 1
    if ops.any_lane(wrap == MIRROR):
        index = ops.where(wrap == MIRROR, _mirror(i, n), index)
        after = ops.where(wrap == MIRROR, _mirror(i + 1, n), after)
    if ops.any_lane(wrap == REPEAT):
        wrapped = _remainder(i, n)
        index = ops.where(wrap == REPEAT, wrapped, index)
        after = ops.where(wrap == REPEAT, ops.where(wrapped + 1 < n, wrapped + 1, 0), after)
    last = n - 1
    inside = ops.where((i < 0) | (i > last), 0.0, 1.0), ops.where((i < -1) | (i + 1 > last), 0.0, 1.0)
    return (
        (ops.maximum(0, ops.minimum(index, last)), ops.where(wrap == BLACK, inside[0], 1.0)),
        (ops.maximum(0, ops.minimum(after, last)), ops.where(wrap == BLACK, inside[1], 1.0)),
    )


@helper
def _mirror(i: Lane, n: Lane) -> Lane:
    twice = _remainder(i, 2 * n)
    return ops.where(twice < n, twice, 2 * n - 1 - twice)


@helper
def _remainder(i: Lane, n: Lane) -> Lane:
    """i modulo n without integer division, which is not vectorized."""
    remainder = i - ops.floor_int(ops.to_float(i) * (1.0 / ops.to_float(n))) * n
    return ops.where(remainder < 0, remainder + n, ops.where(remainder >= n, remainder - n, remainder))
