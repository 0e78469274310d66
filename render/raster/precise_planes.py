"""Attributes of precise triangles (large, steep, long and thin ones): float64 weights of the corners at each pixel.

The attributes of a few hundred triangles are cached. A triangle that covers whole blocks also gets a float32 record like other triangles,
valid near a block. See triangle_planes.py.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import affine, ops
from ..surface import interaction
from ..types import Lane, Vec
from .meshlets import SHIFT
from .plane_setup import FLAT, WIDE
from .triangle_planes import CACHED, COLOR, FACING, INSTANCE, KEY, KEY_X, KEY_Y, METRIC, ORIGIN_X, ORIGIN_Y, OUTWARD, UV, Attributes

_FLAT = 2.0  # at _EVEN: corners have one normal
# Places in PlaneCache.precise: planes of the second, third and first corners' weights; the block record's box of pixels x0, x1, y0, y1.
_SECOND, _THIRD, _FIRST, _NEAR = 2, 5, 8, 11
# Places in PlaneCache.corners: slopes of weights, normals, whether these lie on one side or are equal, …
_SLOPES, _NORMALS, _EVEN, _FRONT, _FACE, _DEPTHS, _PLACES, _OWN, _METRIC, _COLORS = 0, 6, 15, 16, 17, 20, 23, 29, 32, 34


@noinline_helper
def interpolate(shading, textured, colored, i, row, at_x, at_y):
    """The same as `triangle_planes.interpolate`, of one triangle, in float64. `shading` is a handle of deferred_shading.Shading."""
    p, s = corner_attributes(shading, textured, colored, i, row)
    bx, by = simd.floor(at_x * 0.25) * 4.0, simd.floor(at_y * 0.25) * 4.0  # blocks of pixels; relative to these, float32
    x, y = at_x - bx, at_y - by
    zero = simd.f32x16(0.0)
    low_x, high_x = simd.to_f64(simd.low_half(bx)), simd.to_f64(simd.high_half(bx))
    low_y, high_y = simd.to_f64(simd.low_half(by)), simd.to_f64(simd.high_half(by))
    eu = simd.concatenate(simd.to_f32(weight_at(p, _SECOND, low_x, low_y)), simd.to_f32(weight_at(p, _SECOND, high_x, high_y)))
    ev = simd.concatenate(simd.to_f32(weight_at(p, _THIRD, low_x, low_y)), simd.to_f32(weight_at(p, _THIRD, high_x, high_y)))
    ew = simd.concatenate(simd.to_f32(weight_at(p, _FIRST, low_x, low_y)), simd.to_f32(weight_at(p, _FIRST, high_x, high_y)))
    eu = simd.maximum(simd.fma(x, s[_SLOPES], simd.fma(y, s[_SLOPES + 1], eu)), 0.0)
    ev = simd.maximum(simd.fma(x, s[_SLOPES + 2], simd.fma(y, s[_SLOPES + 3], ev)), 0.0)
    ew = simd.maximum(simd.fma(x, s[_SLOPES + 4], simd.fma(y, s[_SLOPES + 5], ew)), 0.0)
    normal = blend(s, _NORMALS, eu, ev, ew)  # not normalized: saves a division
    total = eu + ev + ew
    scale = simd.select(total > 0.0, simd.reciprocal(total), 0.0)
    u, v = eu * scale, ev * scale
    w = simd.select(total > 0.0, ew * scale, 1.0)
    if s[_EVEN] == 0.0:
        normal = blend(s, _NORMALS, u, v, w)
        face = (zero + s[_FACE], zero + s[_FACE + 1], zero + s[_FACE + 2])
        size = ops.dot(normal, normal)
        normal = ops.scale(normal, simd.select(ops.dot(normal, face) < 0.0, simd.f32x16(-1.0), 1.0))
        normal = ops.where3((size > 1e-24) & (size < np.inf), normal, face)
    depth = simd.fma(w, s[_DEPTHS], simd.fma(u, s[_DEPTHS + 1], v * s[_DEPTHS + 2]))
    uv, metric, spread, outward, color = (zero, zero), (zero, zero), (zero, zero, zero, zero), normal, normal
    if textured is not None:
        uv = (
            w * s[_PLACES] + u * s[_PLACES + 2] + v * s[_PLACES + 4], w * s[_PLACES + 1] + u * s[_PLACES + 3] + v * s[_PLACES + 5]
        )  # fmt: skip
        metric = (zero + s[_METRIC], zero + s[_METRIC + 1])
        right, below = uv_slope(s, uv, 0), uv_slope(s, uv, 1)
        spread = (right[0] * scale, right[1] * scale, below[0] * scale, below[1] * scale)
    if colored is not None:
        outward = (zero + s[_OWN], zero + s[_OWN + 1], zero + s[_OWN + 2])
        color = blend(s, _COLORS, u, v, w)
    key = simd.reciprocal(depth) if shading.projection.perspective else depth
    return Attributes(normal, key, zero + s[_FRONT], uv, metric, spread, outward, color)


@helper
def corner_attributes(shading: Any, textured: Any, colored: Any, i: int, row: int) -> Any:
    """The weights' planes of a triangle of instance i, and its corners' attributes; computed unless the cache holds them."""
    cache, visible = shading.planes, shading.visible
    number, k = cache.owner[row], row & (CACHED - 1)
    p, s = cache.precise[k], cache.corners[k]
    if p[0] != number:
        p[0], p[_NEAR], p[_NEAR + 1] = number, 0.0, 0.0
        slot = visible.first[number >> SHIFT] + (number & ((1 << SHIFT) - 1))
        setup_corners(shading.projection, shading.meshlets, shading.tables, p, s, textured, colored, i, slot)
    return p, s


@helper
def block_record(shading: Any, textured: Any, colored: Any, i: int, row: int, x: int, y: int) -> int:
    """The row of a float32 record of a triangle that covers the block at pixel (x, y); -1 if its normals change sides.

    The record also holds for the blocks around, in a box of up to WIDE pixels where the sum of weights varies little.
    """
    cache, k = shading.planes, row & (CACHED - 1)
    p, offset, last = cache.precise, 16 * k, len(cache.record) - CACHED + k
    if (simd.read(p, offset) == simd.read(cache.owner, row) and simd.read(p, offset + _NEAR) <= x and x < simd.read(p, offset + _NEAR + 1)
            and simd.read(p, offset + _NEAR + 2) <= y and y < simd.read(p, offset + _NEAR + 3)):  # fmt: skip
        return last
    return make_block_record(shading, textured, colored, i, row, x, y, last)


@noinline_helper
def make_block_record(shading, textured, colored, i, row, x, y, last):
    """Write that record to row `last`; returns `last`, or -1."""
    p, s = corner_attributes(shading, textured, colored, i, row)
    if s[_EVEN] == 0.0:
        return -1
    left, top = x & ~(int(WIDE) - 1), y & ~(int(WIDE) - 1)
    right, bottom = left + int(WIDE), top + int(WIDE)
    if not is_level(p, left, top, right, bottom):
        top, bottom = y, y + 4
        if not is_level(p, left, top, right, bottom):
            left, right = x, x + 4
    p[_NEAR], p[_NEAR + 1], p[_NEAR + 2], p[_NEAR + 3] = left, right, top, bottom
    y = top
    perspective, record = shading.projection.perspective, shading.planes.record
    weight = weight_sum(p, left, y)
    if perspective:  # the sum of weights times depths is constant
        first, second, third = weight_at(p, _FIRST, left, y), weight_at(p, _SECOND, left, y), weight_at(p, _THIRD, left, y)
        weight = first * s[_DEPTHS] + second * s[_DEPTHS + 1] + third * s[_DEPTHS + 2]
    scale = 1.0 / weight
    for k in range(3):
        record[last, k], record[last, k + 4], record[last, k + 8] = plane_about(p, left, y, corner_values(s, _NORMALS + k, 3, scale))
    if perspective:
        record[last, KEY] = weight_sum(p, left, y) * scale
        record[last, KEY_X], record[last, KEY_Y] = (p[3] + p[6] + p[9]) * scale, (p[4] + p[7] + p[10]) * scale
    else:
        record[last, KEY], record[last, KEY_X], record[last, KEY_Y] = plane_about(p, left, y, corner_values(s, _DEPTHS, 1, scale))
    record[last, ORIGIN_X], record[last, ORIGIN_Y], record[last, FACING], record[last, INSTANCE] = left, y, s[_FRONT], i
    if textured is not None:
        for k in range(2):
            c = UV + 3 * k
            record[last, c], record[last, c + 1], record[last, c + 2] = plane_about(p, left, y, corner_values(s, _PLACES + k, 2, scale))
            record[last, METRIC + k] = s[_METRIC + k]
    if colored is not None:
        for k in range(3):
            c = COLOR + 3 * k
            record[last, OUTWARD + k] = s[_OWN + k]
            record[last, c], record[last, c + 1], record[last, c + 2] = plane_about(p, left, y, corner_values(s, _COLORS + k, 3, scale))
    return last


@helper
def is_flat(shading: Any, i: int, row: int) -> bool:
    """Whether the corners of a triangle have one normal."""
    _, s = corner_attributes(shading, None, None, i, row)
    return s[_EVEN] == _FLAT


@helper
def flat_normal(cache: Any, row: int) -> Vec:
    """The normal of a triangle after `is_flat`; not normalized."""
    s = cache.corners[row & (CACHED - 1)]
    return s[_NORMALS], s[_NORMALS + 1], s[_NORMALS + 2]


@helper
def block_record_end(cache: Any, row: int) -> int:
    """The x at which the validity of the last block record ends."""
    return int(simd.read(cache.precise, 16 * (row & (CACHED - 1)) + _NEAR + 1))


@helper
def is_level(p: Any, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether the sum of weights varies less than fourfold in a box."""
    a, b, c, d = weight_sum(p, x0, y0), weight_sum(p, x1, y0), weight_sum(p, x0, y1), weight_sum(p, x1, y1)
    return min(min(a, b), min(c, d)) > 0.25 * max(max(a, b), max(c, d))


@helper
def weight_sum(p: Any, x: float, y: float) -> float:
    """The sum of the three weights at a pixel position."""
    return weight_at(p, _SECOND, x, y) + weight_at(p, _THIRD, x, y) + weight_at(p, _FIRST, x, y)


@helper
def corner_values(s: Any, offset: int, step: int, scale: float) -> Vec:
    """An attribute of the three corners, at s[at], s[at + step] and s[at + 2 · step], times `scale`."""
    return s[offset] * scale, s[offset + step] * scale, s[offset + 2 * step] * scale


@helper
def plane_about(p: Any, x: float, y: float, values: Vec) -> Vec:
    """The plane c, a, b about (x, y) of the corners' values, each times its weight."""
    first, second, third = values
    return (
        weight_at(p, _FIRST, x, y) * first + weight_at(p, _SECOND, x, y) * second + weight_at(p, _THIRD, x, y) * third,
        p[9] * first + p[3] * second + p[6] * third, p[10] * first + p[4] * second + p[7] * third,
    )  # fmt: skip


@helper
def uv_slope(s: Any, uv: tuple[Lane, Lane], k: int) -> tuple[Lane, Lane]:
    """Derivatives of u and v along x or y, times the sum of weights, by the quotient rule."""
    b, c, a = s[_SLOPES + k], s[_SLOPES + 2 + k], s[_SLOPES + 4 + k]
    return (
        (b * s[_PLACES + 2] + c * s[_PLACES + 4] + a * s[_PLACES]) - uv[0] * (a + b + c),
        (b * s[_PLACES + 3] + c * s[_PLACES + 5] + a * s[_PLACES + 1]) - uv[1] * (a + b + c),
    )


@helper
def weight_at(planes: Any, first: int, x: Lane, y: Lane) -> Lane:
    """One weight at a pixel position."""
    return planes[first] + planes[first + 1] * x + planes[first + 2] * y


@helper
def blend(s: Any, offset: int, u: Lane, v: Lane, w: Lane) -> Vec:
    """A vector attribute of the corners, weighted by w, u and v."""
    return (
        simd.fma(v, s[offset + 6], simd.fma(u, s[offset + 3], w * s[offset])),
        simd.fma(v, s[offset + 7], simd.fma(u, s[offset + 4], w * s[offset + 1])),
        simd.fma(v, s[offset + 8], simd.fma(u, s[offset + 5], w * s[offset + 2])),
    )  # fmt: skip


@noinline_helper
def setup_corners(projection, meshlets, tables, planes, s, textured, colored, i, slot):
    """Write a triangle's planes of weights (of second, third, first corner) and its corners' attributes.

    The cross of two corners' rows (X - x W, Y - y W) is X₁Y₂ - X₂Y₁ + x (W₂Y₁ - W₁Y₂) + y (X₂W₁ - X₁W₂). Weights are scaled to fit
    float32 and are positive inside.
    """
    row_a, row_b = corner_row(projection, meshlets, i, slot, 0), corner_row(projection, meshlets, i, slot, 1)
    row_c = corner_row(projection, meshlets, i, slot, 2)
    first, second, third = cross(row_b, row_c), cross(row_c, row_a), cross(row_a, row_b)
    det = row_a[0] * first[1] + row_a[1] * first[2] + row_a[2] * first[0]
    for n in range(3):
        planes[_SECOND + n], planes[_THIRD + n], planes[_FIRST + n] = second[n], third[n], first[n]
    largest = 1e-300
    for n in range(2, 11):
        largest = max(largest, abs(planes[n]))
    for n in range(2, 11):
        planes[n] *= (1.0 if det > 0.0 else -1.0) / largest
    for n in range(3):
        s[_SLOPES + 2 * n], s[_SLOPES + 2 * n + 1] = planes[3 + 3 * n], planes[4 + 3 * n]
    transform, material, g = tables.instances.transform[i], tables.instances.material[i], tables.instances.geometry[i]
    side = 1.0 if (det > 0.0) == tables.transforms.flips[transform] else -1.0
    s[_FRONT] = side
    p, q, r = corner_position(meshlets, slot, 0), corner_position(meshlets, slot, 1), corner_position(meshlets, slot, 2)
    e1, e2 = ops.sub(q, p), ops.sub(r, p)
    face = ops.normalize(ops.cross(e1, e2))
    outward = ops.normalize(ops.scale(affine.transform_normal(tables.transforms.inverse, transform, face), side))
    s[_OWN], s[_OWN + 1], s[_OWN + 2] = face
    s[_FACE], s[_FACE + 1], s[_FACE + 2] = outward
    even, flat = True, True
    for corner in range(3):
        vertex = meshlets.corner[slot, corner]
        n = (np.float64(meshlets.record[vertex, 3]), np.float64(meshlets.record[vertex, 4]), np.float64(meshlets.record[vertex, 5]))
        if tables.materials.shading[material] == FLAT:
            n = face
        even = even and ops.dot(n, face) > 0.0
        n = ops.scale(affine.transform_normal(tables.transforms.inverse, transform, n), side)
        s[_NORMALS + 3 * corner], s[_NORMALS + 3 * corner + 1], s[_NORMALS + 3 * corner + 2] = n
        flat = flat and s[_NORMALS + 3 * corner] == s[_NORMALS] and s[_NORMALS + 3 * corner + 1] == s[_NORMALS + 1]
        flat = flat and s[_NORMALS + 3 * corner + 2] == s[_NORMALS + 2]
        s[_PLACES + 2 * corner], s[_PLACES + 2 * corner + 1] = meshlets.record[vertex, 6], meshlets.record[vertex, 7]
        s[_DEPTHS + corner] = corner_depth(projection, meshlets, i, slot, corner)
    s[_EVEN] = _FLAT if even and flat else 1.0 if even else 0.0
    if textured is not None:
        stretch = interaction.mean_scale(affine.load12(tables.transforms.matrix, transform))
        u1, v1 = s[_PLACES + 2] - s[_PLACES], s[_PLACES + 3] - s[_PLACES + 1]
        u2, v2 = s[_PLACES + 4] - s[_PLACES], s[_PLACES + 5] - s[_PLACES + 1]
        du, dv = interaction.uv_metric(e1, e2, u1, v1, u2, v2)
        s[_METRIC], s[_METRIC + 1] = du * stretch, dv * stretch
    if colored is not None:
        for corner in range(3):
            color = (1.0, 1.0, 1.0)
            if tables.geometries.colors[g] >= 0:
                u, v = (1.0 if corner == 1 else 0.0), (1.0 if corner == 2 else 0.0)
                color = interaction.attribute_at(tables, g, tables.geometries.colors[g], u, v, meshlets.corner[slot, 3], True)
            s[_COLORS + 3 * corner], s[_COLORS + 3 * corner + 1], s[_COLORS + 3 * corner + 2] = color


@helper
def corner_position(meshlets: Any, slot: int, corner: int) -> Vec:
    """The position of a corner in the mesh's frame."""
    vertex = meshlets.corner[slot, corner]
    return np.float64(meshlets.record[vertex, 0]), np.float64(meshlets.record[vertex, 1]), np.float64(meshlets.record[vertex, 2])


@helper
def corner_depth(projection: Any, meshlets: Any, i: int, slot: int, corner: int) -> float:
    """The distance of a corner along the camera's axis."""
    m, (x, y, z) = projection.matrix, corner_position(meshlets, slot, corner)
    return m[i, 3, 0] * x + m[i, 3, 1] * y + m[i, 3, 2] * z + m[i, 3, 3]


@helper
def corner_row(projection: Any, meshlets: Any, i: int, slot: int, corner: int) -> Vec:
    """(X, Y, W) of a corner."""
    m, (x, y, z) = projection.matrix, corner_position(meshlets, slot, corner)
    w = corner_depth(projection, meshlets, i, slot, corner) if projection.perspective else 1.0
    return m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z + m[i, 0, 3], m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z + m[i, 1, 3], w


@helper
def cross(p: Vec, q: Vec) -> Vec:
    """The plane c, a, b of the weight between two corners, opposite the third."""
    return p[0] * q[1] - q[0] * p[1], q[2] * p[1] - p[2] * q[1], q[0] * p[2] - p[0] * q[2]
