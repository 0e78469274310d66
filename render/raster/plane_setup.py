"""Sets up the attribute planes of triangles, sixteen at a time."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import affine, ops
from ..surface import interaction
from ..types import Lane, Vec
from .meshlets import RECORD, SHIFT
from .triangle_planes import EVEN, OUTWARD, PRECISE, READY, ROWS, UV

FLAT = int(ir.Shading.FLAT)
WIDE = 64.0  # pixels: larger triangles need float64
THIN = 1.0 / 32.0  # pixels of height: attributes of thinner triangles are extrapolated too far by 1/512 pixel
SHORT = 1.5  # pixels: thin triangles shorter than this have their mean attributes everywhere


class Corners(NamedTuple):
    """Sixteen triangles of one instance: the records of their corners, and the edges from the first corner."""

    a: Any
    b: Any
    c: Any
    e1: Vec
    e2: Vec
    triangle: Lane  # row of Model.triangles


class Weights(NamedTuple):
    """Planes c, a, b relative to a pixel, over the distance along the axis, of sixteen triangles' interpolation weights."""

    area: Vec  # one
    u: Vec  # the weight of the second corner
    v: Vec  # of the third


class ScreenTriangles(NamedTuple):
    """Sixteen triangles on the screen."""

    weights: Weights
    x: Lane  # the pixel of the first corner, where the planes' x and y count from
    y: Lane
    depth: Lane  # distance along the axis: the first corner's
    depth1: Lane  # the second's, less the first's
    depth2: Lane  # the third's
    single: Lane  # bool: float32 is too coarse, see precise_planes.py
    turned: Lane  # bool: seen counterclockwise


@noinline_helper
def setup_planes(shading, textured, colored):
    """Set up the new records of the cache; `shading` is a handle of deferred_shading.Shading."""
    visible, cache = shading.visible, shading.planes
    for first in range(cache.count[READY], cache.count[ROWS], 16):
        count = min(cache.count[ROWS] - first, 16)
        ids = simd.load(cache.owner, first, simd.i32x16)
        exists = simd.first_lanes(count, ids)
        ids = simd.select(exists, ids, cache.owner[first])
        row = ids >> SHIFT
        instances, slots = visible.instance[row], visible.first[row] + (ids & ((1 << SHIFT) - 1))
        pending = exists
        while simd.any_of(pending):
            first_lane = simd.trailing_zeros(simd.bits(pending))
            i = simd.lane(instances, first_lane)
            lanes = pending & (instances == i)
            setup_instance(shading, textured, colored, i, simd.select(lanes, slots, simd.lane(slots, first_lane)), first, lanes)
            pending = pending & ~lanes
    cache.count[READY] = cache.count[ROWS]


@helper
def setup_instance(shading: Any, textured: Any, colored: Any, i: int, slot: Lane, first: int, lanes: Lane) -> None:
    """Write the records of triangles of one instance, rows `first` to `first` + 15, in the lanes `lanes`."""
    meshlets, tables, record = shading.meshlets, shading.tables, shading.planes.record
    corner = simd.gather_rows(meshlets.corner, slot << 2, 4)
    a = simd.gather_rows(meshlets.record, corner[0] * RECORD, RECORD)
    b = simd.gather_rows(meshlets.record, corner[1] * RECORD, RECORD)
    c = simd.gather_rows(meshlets.record, corner[2] * RECORD, RECORD)
    corners = Corners(a, b, c, (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]), corner[3])
    screen = project(shading.projection, i, corners)
    transform, zero = tables.instances.transform[i], simd.f32x16(0.0)
    front = screen.turned if tables.transforms.flips[transform] else ~screen.turned
    face = ops.cross(corners.e1, corners.e2)
    normals, single = corner_normals(tables, i, corners, face, front)
    single = screen.single | single
    weights, (na, nb, nc) = screen.weights, normals
    nx, ny = plane_of(weights, na[0], nb[0], nc[0]), plane_of(weights, na[1], nb[1], nc[1])
    nz = plane_of(weights, na[2], nb[2], nc[2])
    key = weights.area if shading.projection.perspective else plane_of(weights, screen.depth, screen.depth1, screen.depth2)
    level = is_zero(nb) & is_zero(nc)
    facing = simd.select(front, simd.f32x16(1.0), simd.f32x16(-1.0))
    facing = facing * simd.select(single, np.float32(PRECISE), simd.select(level, np.float32(EVEN), 1.0))
    offset = first * record.shape[1]
    write_floats(record, offset, lanes, (nx[0], ny[0], nz[0], key[0], nx[1], ny[1], nz[1], key[1]))
    write_floats(record, offset + 8, lanes, (nx[2], ny[2], nz[2], key[2], screen.x, screen.y, facing, zero + np.float32(i)))
    if textured is not None:
        write_uvs(tables, record, offset, lanes, transform, colored, corners, weights)
    if colored is not None:
        write_colors(tables, record, offset, lanes, tables.instances.geometry[i], corners.triangle, face, weights)


@helper
def project(projection: Any, i: int, corners: Corners) -> ScreenTriangles:
    """Project sixteen triangles of instance i."""
    # The first corner relative to its pixel, in float64; edges are short and need only float32.
    low, high = corner_to_pixel(projection, i, low_half(corners.a)), corner_to_pixel(projection, i, high_half(corners.a))
    px, py = simd.concatenate(low[0], high[0]), simd.concatenate(low[1], high[1])
    ax, ay, depth = simd.concatenate(low[2], high[2]), simd.concatenate(low[3], high[3]), simd.concatenate(low[4], high[4])
    x1, y1, d1 = edge_to_pixel(projection, i, corners.e1, px, py)
    x2, y2, d2 = edge_to_pixel(projection, i, corners.e2, px, py)
    ones, zero = simd.f32x16(1.0), simd.f32x16(0.0)
    w0, w1, w2 = (depth, d1, d2) if projection.perspective else (ones, zero, zero)

    area = (x1 * y2 - y1 * x2, w2 * y1 - w1 * y2, w1 * x2 - w2 * x1)
    eu = (x2 * ay - y2 * ax, y2 * w0 - w2 * ay, w2 * ax - x2 * w0)
    ev = (ax * y1 - ay * x1, w1 * ay - y1 * w0, x1 * w0 - w1 * ax)
    det = ax * area[1] + ay * area[2] + w0 * area[0]

    reach = simd.maximum(simd.maximum(abs(x1), abs(y1)), simd.maximum(abs(x2), abs(y2)))
    x3, y3 = x2 - x1, y2 - y1
    longest = simd.sqrt(simd.maximum(simd.maximum(x1 * x1 + y1 * y1, x2 * x2 + y2 * y2), x3 * x3 + y3 * y3))
    thin = abs(area[0]) < longest * w0 * np.float32(THIN)
    short = longest < w0 * np.float32(SHORT)
    single = ~(reach <= w0 * np.float32(WIDE)) | (thin & ~short)
    if projection.perspective:
        single = single | ~(simd.maximum(abs(d1), abs(d2)) < depth * np.float32(0.25))
    speck = thin & short
    scale = simd.select(speck, 1.0 / w0, 1.0 / det)  # specks: the first corner's distance
    level = (scale * np.float32(1.0 / 3.0), zero, zero)
    area = ops.where3(speck, (scale, zero, zero), ops.scale(area, scale))
    eu, ev = ops.where3(speck, level, ops.scale(eu, scale)), ops.where3(speck, level, ops.scale(ev, scale))
    return ScreenTriangles(Weights(area, eu, ev), px, py, depth, d1, d2, single, det > 0.0)


@helper
def corner_normals(tables: Any, i: int, corners: Corners, face: Vec, front: Lane) -> tuple[tuple[Vec, Vec, Vec], Lane]:
    """World normals on the viewer's side: the first corner's, and the second's and third's less it; and where they change sides.

    Triangles without corner normals, and flat materials, have the normal `face`.
    """
    transform, inverse = tables.instances.transform[i], tables.transforms.inverse
    ones = simd.f32x16(1.0)
    side = simd.select(front, ones, -ones)
    a, b, c = corners.a, corners.b, corners.c
    na, nb, nc = (a[3], a[4], a[5]), (b[3], b[4], b[5]), (c[3], c[4], c[5])
    sa, sb, sc = ops.dot(na, face), ops.dot(nb, face), ops.dot(nc, face)
    none = (ops.dot(na, na) + ops.dot(nb, nb) + ops.dot(nc, nc)) == 0.0
    if tables.materials.shading[tables.instances.material[i]] == FLAT:
        none = none | ~none
    along, against = (sa >= 0.0) & (sb >= 0.0) & (sc >= 0.0), (sa <= 0.0) & (sb <= 0.0) & (sc <= 0.0)
    na, nb, nc = ops.where3(none, face, na), ops.where3(none, face, nb), ops.where3(none, face, nc)
    side = simd.select(none | along, side, -side)
    na = ops.scale(affine.transform_normal(inverse, transform, na), side)
    nb = ops.sub(ops.scale(affine.transform_normal(inverse, transform, nb), side), na)
    nc = ops.sub(ops.scale(affine.transform_normal(inverse, transform, nc), side), na)
    return (na, nb, nc), ~(none | along | against)


@helper
def write_uvs(tables: Any, record: Any, offset: int, lanes: Lane, transform: int, colored: Any, corners: Corners,
              weights: Weights) -> None:  # fmt: skip
    """Write the planes of u and v; with `colored`, the metres that they span, which only bump maps read."""
    a, b, c = corners.a, corners.b, corners.c
    u1, v1, u2, v2 = b[6] - a[6], b[7] - a[7], c[6] - a[6], c[7] - a[7]
    u, v = plane_of(weights, a[6], u1, u2), plane_of(weights, a[7], v1, v2)
    zero = simd.f32x16(0.0)
    du, dv = zero, zero
    if colored is not None:
        du, dv = interaction.uv_metric(corners.e1, corners.e2, u1, v1, u2, v2)
        stretch = interaction.mean_scale(affine.load12(tables.transforms.matrix, transform))
        du, dv = du * stretch, dv * stretch
    write_floats(record, offset + UV, lanes, (u[0], u[1], u[2], v[0], v[1], v[2], du, dv))


@helper
def write_colors(tables: Any, record: Any, offset: int, lanes: Lane, g: int, triangle: Lane, face: Vec, weights: Weights) -> None:
    """Write the triangles' own normals `face` and the planes of the colours of geometry g."""
    zero, area = simd.f32x16(0.0), weights.area
    red, green, blue = (zero + area[0], zero + area[1], zero + area[2]), area, area
    if tables.geometries.colors[g] >= 0:
        first_color = color_at(tables, g, triangle, 0.0, 0.0)
        b_color = ops.sub(color_at(tables, g, triangle, 1.0, 0.0), first_color)
        c_color = ops.sub(color_at(tables, g, triangle, 0.0, 1.0), first_color)
        red = plane_of(weights, first_color[0], b_color[0], c_color[0])
        green = plane_of(weights, first_color[1], b_color[1], c_color[1])
        blue = plane_of(weights, first_color[2], b_color[2], c_color[2])
    write_floats(record, offset + OUTWARD, lanes, (face[0], face[1], face[2], red[0], red[1], red[2], green[0], green[1]))
    write_floats(record, offset + 32, lanes, (green[2], blue[0], blue[1], blue[2], zero, zero, zero, zero))


@helper
def is_zero(v: Vec) -> Lane:
    """Whether a vector is 0, by lane."""
    return (v[0] == 0.0) & (v[1] == 0.0) & (v[2] == 0.0)


@helper
def write_floats(record: Any, offset: int, lanes: Lane, columns: Any) -> None:
    """Write eight consecutive floats of sixteen consecutive records, from place `offset` on, in the lanes `lanes`."""
    if simd.all_of(lanes):
        simd.store_rows(record, offset, record.shape[1], columns)
    else:
        places = simd.iota(simd.i32x16(0)) * record.shape[1] + offset
        for k in range(8):
            simd.scatter(record, places + k, columns[k], lanes)


@helper
def plane_of(weights: Weights, value: Lane, second: Lane, third: Lane) -> Vec:
    """The plane c, a, b, over the distance, of an attribute: its value at the first corner, and the others' less that."""
    area, eu, ev = weights
    return (
        simd.fma(ev[0], third, simd.fma(eu[0], second, area[0] * value)), simd.fma(ev[1], third, simd.fma(eu[1], second, area[1] * value)),
        simd.fma(ev[2], third, simd.fma(eu[2], second, area[2] * value)),
    )  # fmt: skip


@helper
def color_at(tables: Any, g: int, triangle: Lane, u: float, v: float) -> Vec:
    return interaction.attribute_at(tables, g, tables.geometries.colors[g], simd.f32x16(u), simd.f32x16(v), triangle, triangle >= 0)


@helper
def corner_to_pixel(projection: Any, i: int, p: Vec) -> Any:
    """Pixels (x, y) of points, X - x W and Y - y W, and D, in float32."""
    m = projection.matrix
    cx = m[i, 0, 0] * p[0] + m[i, 0, 1] * p[1] + m[i, 0, 2] * p[2] + m[i, 0, 3]
    cy = m[i, 1, 0] * p[0] + m[i, 1, 1] * p[1] + m[i, 1, 2] * p[2] + m[i, 1, 3]
    d = m[i, 3, 0] * p[0] + m[i, 3, 1] * p[1] + m[i, 3, 2] * p[2] + m[i, 3, 3]
    w = d if projection.perspective else simd.f64x8(1.0)
    px, py = simd.floor(cx / w), simd.floor(cy / w)
    return simd.to_f32(px), simd.to_f32(py), simd.to_f32(cx - px * w), simd.to_f32(cy - py * w), simd.to_f32(d)


@helper
def edge_to_pixel(projection: Any, i: int, e: Vec, x: Lane, y: Lane) -> Vec:
    """(X - x W, Y - y W, D) of directions, in float32."""
    m = projection.matrix
    d = e[0] * m[i, 3, 0] + e[1] * m[i, 3, 1] + e[2] * m[i, 3, 2]
    w = d if projection.perspective else simd.f32x16(0.0)
    cx = e[0] * m[i, 0, 0] + e[1] * m[i, 0, 1] + e[2] * m[i, 0, 2] - x * w
    cy = e[0] * m[i, 1, 0] + e[1] * m[i, 1, 1] + e[2] * m[i, 1, 2] - y * w
    return cx, cy, d


@helper
def low_half(p: Any) -> Vec:
    return simd.to_f64(simd.low_half(p[0])), simd.to_f64(simd.low_half(p[1])), simd.to_f64(simd.low_half(p[2]))


@helper
def high_half(p: Any) -> Vec:
    return simd.to_f64(simd.high_half(p[0])), simd.to_f64(simd.high_half(p[1])), simd.to_f64(simd.high_half(p[2]))
