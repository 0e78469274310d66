"""Triangles that a band shows, as planes over the picture: made once for each of them, sixteen at a time, read by every pixel that sees it.

What is linear on a triangle, divided by the distance along the axis, is linear on the picture (Heckbert and Moreton 1991, Interpolation
for Polygon Texture Mapping). So a face's record holds, as c + a x + b y about a pixel near it: its normal in the world over that distance,
and one over that distance; with textures also coordinates and colours. Corners are those before snapping to fixed point.

Float32 will do for faces that are small on the picture and not steep. Large, steep, long and thin ones, and those on whose corners normals
go to different sides, are `Single`: their corners' weights are computed in float64 where they are seen, and kept inside.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import lanes, simd, surface
from .kernels import apart, helper
from .meshlets import RECORD, SHIFT
from .records import Lane, Vec

FLAT = int(ir.Shading.FLAT)
PLAIN = 16  # floats of a record: c and a of normal and key; b of them, where x and y count from, side, instance
PICTURED = 24  # with u and v
COLORED = 40  # with the metres they span, the triangle's own normal and the colour's planes, too
WIDE = 64.0  # pixels
THIN = 1.0 / 32.0  # pixels of height, below which 1/512 pixel beside a face may lead far from what its corners hold
KNOWN = 256  # single faces that are kept, a power of two
SHORT = 1.5  # pixels; what is thin and short has what its middle has

_NEAR = 11  # in Faces.planes: the box of pixels of `near`'s record: x0 <= x < x1, y0 <= y < y1
# Places in Faces.single: slopes of weights, normals, whether these are all on one side, …
_SLOPES, _NORMALS, _EVEN, _FRONT, _FACE, _DEPTHS, _PLACES, _OWN, _METRIC, _COLORS = 0, 6, 15, 16, 17, 20, 23, 29, 32, 34


class Look(NamedTuple):
    """Where things are seen from."""

    direction: NDArray[np.float32]  # (3, 3) of rays at the picture's top left, and what a pixel right and a pixel down add to it
    start: NDArray[np.float32]  # (3, 3) the same of where they start, about the eye
    local: NDArray[np.float32]  # (instances, 3, 4) from there to each instance's own frame


class Faces(NamedTuple):
    """A thread's faces."""

    row: NDArray[np.int32]  # by id, where a face's record is, plus count[2]; less than that: nowhere
    owner: NDArray[np.int32]  # id
    record: NDArray[np.float32]  # (most, PLAIN, PICTURED or COLORED)
    count: NDArray[np.int64]  # (3,) records, how many of them are made, and how many there were before they were forgotten
    planes: NDArray[np.float64]  # (KNOWN, 16) of the last single ones: id, 0, their corners' weights, and what `near` needs
    single: NDArray[np.float32]  # (KNOWN, 48) what their corners hold


class Seen(NamedTuple):
    """What lanes see of faces of one instance."""

    normal: Vec  # in the world, towards the viewer; of any length
    key: Lane  # one over the depth along the axis; of an orthographic camera, the depth
    facing: Lane  # > 0: from outside
    uv: tuple[Lane, Lane]
    metric: tuple[Lane, Lane]
    spread: Any  # how far u, v go a pixel to the right and below
    outward: Vec  # the triangle's own normal in the mesh's frame; of any length
    color: Vec


def faces_for(drawn: int, most: int, patterned: bool, colored: bool) -> Faces:
    """Room for `most` faces at a time, of `drawn` meshlets, and behind them for those of `near`."""
    most += KNOWN
    record = simd.aligned_empty((most, COLORED if colored else PICTURED if patterned else PLAIN), np.float32)
    row, owner = np.full((drawn + 1) << SHIFT, -1, np.int32), np.full(most + 16, -1, np.int32)
    return Faces(row, owner, record, np.zeros(3, np.int64), np.full((KNOWN, 16), -1.0), np.zeros((KNOWN, 48), np.float32))


@helper
def forget(faces: Any) -> None:
    """Have none: ids may mean others from now on."""
    count = faces.count
    count[2] += count[0]
    count[0] = count[1] = 0
    if count[2] > 1 << 30:
        faces.row[:] = -1
        count[2] = 0
    for k in range(KNOWN):
        faces.planes[k, 0] = -1.0


@helper
def make_room(faces: Any, most: int) -> None:
    """Have room for `most` more faces; older ones go if there is none."""
    if faces.count[0] + most > len(faces.record) - KNOWN:
        forget(faces)


@helper
def row_of(faces: Any, number: int) -> int:
    """The face of an id, if need be a new one, to be made by `make_all`."""
    row = simd.read(faces.row, number) - faces.count[2]
    return row if row >= 0 else new_row(faces, number)


@helper
def new_row(faces: Any, number: int) -> int:
    """A new face for an id."""
    row = faces.count[0]
    simd.write(faces.row, number, row + faces.count[2])
    simd.write(faces.owner, row, number)
    faces.count[0] = row + 1
    return row


@helper
def rows_of(faces: Any, ids: Any, at: int, seen: Lane) -> Lane:
    """The faces of ids[at:] in the lanes that are `seen`."""
    numbers = simd.load_aligned(ids, at, simd.i32x16)
    rows = simd.gather(faces.row, numbers, seen) - faces.count[2]
    lacking = seen & (rows < 0)
    while simd.any_of(lacking):
        number = simd.read(ids, at + simd.trailing_zeros(simd.bits(lacking)))
        same = lacking & (numbers == number)
        rows = simd.select(same, new_row(faces, number), rows)
        lacking = lacking & ~same
    return rows


@apart
def make_all(shown, meshlets, drawn, tables, faces, patterned, colored):
    """Make the faces that have been asked for."""
    for first in range(faces.count[1], faces.count[0], 16):
        count = min(faces.count[0] - first, 16)
        ids = simd.load(faces.owner, first, simd.i32x16)
        there = simd.first_lanes(count, ids)
        ids = simd.select(there, ids, faces.owner[first])
        row = ids >> SHIFT
        instances, slots = drawn.instance[row], drawn.first[row] + (ids & ((1 << SHIFT) - 1))
        rest = there
        while simd.any_of(rest):
            one = simd.trailing_zeros(simd.bits(rest))
            i = simd.lane(instances, one)
            here = rest & (instances == i)
            _make_of(shown, meshlets, tables, faces, patterned, colored, i, simd.select(here, slots, simd.lane(slots, one)), first, here)
            rest = rest & ~here
    faces.count[1] = faces.count[0]


@helper
def _make_of(shown: Any, meshlets: Any, tables: Any, faces: Any, patterned: Any, colored: Any, i: int, slot: Lane, first: int,
             here: Lane) -> None:  # fmt: skip
    """Write the records of faces of one instance in the lanes `here`."""
    corner = simd.gather_rows(meshlets.corner, slot << 2, 4)
    a = simd.gather_rows(meshlets.record, corner[0] * RECORD, RECORD)
    b = simd.gather_rows(meshlets.record, corner[1] * RECORD, RECORD)
    c = simd.gather_rows(meshlets.record, corner[2] * RECORD, RECORD)
    e1, e2 = (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2])

    # The first corner about the pixel it lies in, by float64; edges are short.
    low, high = _corner(shown, i, _low(a)), _corner(shown, i, _high(a))
    px, py = simd.joined(low[0], high[0]), simd.joined(low[1], high[1])
    ax, ay, depth = simd.joined(low[2], high[2]), simd.joined(low[3], high[3]), simd.joined(low[4], high[4])
    x1, y1, d1 = _edge(shown, i, e1, px, py)
    x2, y2, d2 = _edge(shown, i, e2, px, py)
    one, zero = simd.f32x16(1.0), simd.f32x16(0.0)
    w0, w1, w2 = (depth, d1, d2) if shown.perspective else (one, zero, zero)

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
    if shown.perspective:
        single = single | ~(simd.maximum(abs(d1), abs(d2)) < depth * np.float32(0.25))
    speck = thin & short
    turned = det > 0.0
    whole = simd.select(speck, 1.0 / w0, 1.0 / det)  # specks: one over the distance is that of the first corner everywhere
    level = (whole * np.float32(1.0 / 3.0), zero, zero)
    area = lanes.where3(speck, (whole, zero, zero), lanes.scale(area, whole))
    eu, ev = lanes.where3(speck, level, lanes.scale(eu, whole)), lanes.where3(speck, level, lanes.scale(ev, whole))

    transform, material = tables.instances.transform[i], tables.instances.material[i]
    inverse = tables.transforms.inverse
    front = turned if tables.transforms.flips[transform] else ~turned
    side = simd.select(front, one, -one)
    face = lanes.cross(e1, e2)
    na, nb, nc = (a[3], a[4], a[5]), (b[3], b[4], b[5]), (c[3], c[4], c[5])
    sa, sb, sc = lanes.dot(na, face), lanes.dot(nb, face), lanes.dot(nc, face)
    none = (lanes.dot(na, na) + lanes.dot(nb, nb) + lanes.dot(nc, nc)) == 0.0
    if tables.materials.shading[material] == FLAT:
        none = none | ~none
    along, against = (sa >= 0.0) & (sb >= 0.0) & (sc >= 0.0), (sa <= 0.0) & (sb <= 0.0) & (sc <= 0.0)
    single = single | ~(none | along | against)
    na, nb, nc = lanes.where3(none, face, na), lanes.where3(none, face, nb), lanes.where3(none, face, nc)
    side = simd.select(none | along, side, -side)
    na = lanes.scale(lanes.transform_normal(inverse, transform, na), side)
    nb = lanes.sub(lanes.scale(lanes.transform_normal(inverse, transform, nb), side), na)
    nc = lanes.sub(lanes.scale(lanes.transform_normal(inverse, transform, nc), side), na)
    nx, ny = _plane(area, eu, ev, na[0], nb[0], nc[0]), _plane(area, eu, ev, na[1], nb[1], nc[1])
    nz = _plane(area, eu, ev, na[2], nb[2], nc[2])
    key = area if shown.perspective else _plane(area, eu, ev, depth, d1, d2)

    facing = simd.select(front, one, -one) * simd.select(single, np.float32(2.0), 1.0)
    record, at = faces.record, first * faces.record.shape[1]
    _write(record, at, here, (nx[0], ny[0], nz[0], key[0], nx[1], ny[1], nz[1], key[1]))
    _write(record, at + 8, here, (nx[2], ny[2], nz[2], key[2], px, py, facing, zero + np.float32(i)))
    if patterned is not None:
        u1, v1, u2, v2 = b[6] - a[6], b[7] - a[7], c[6] - a[6], c[7] - a[7]
        u, v = _plane(area, eu, ev, a[6], u1, u2), _plane(area, eu, ev, a[7], v1, v2)
        du, dv = surface.spans(e1, e2, u1, v1, u2, v2)
        stretch = surface.mean_scale(lanes.affine(tables.transforms.matrix, transform))
        _write(record, at + 16, here, (u[0], u[1], u[2], v[0], v[1], v[2], du * stretch, dv * stretch))
    if colored is not None:
        g = tables.instances.geometry[i]
        red, green, blue = (zero + area[0], zero + area[1], zero + area[2]), area, area
        if tables.geometries.colors[g] >= 0:
            first_color = _color(tables, g, corner[3], 0.0, 0.0)
            b_color = lanes.sub(_color(tables, g, corner[3], 1.0, 0.0), first_color)
            c_color = lanes.sub(_color(tables, g, corner[3], 0.0, 1.0), first_color)
            red = _plane(area, eu, ev, first_color[0], b_color[0], c_color[0])
            green = _plane(area, eu, ev, first_color[1], b_color[1], c_color[1])
            blue = _plane(area, eu, ev, first_color[2], b_color[2], c_color[2])
        _write(record, at + 24, here, (face[0], face[1], face[2], red[0], red[1], red[2], green[0], green[1]))
        _write(record, at + 32, here, (green[2], blue[0], blue[1], blue[2], zero, zero, zero, zero))


@helper
def _write(record: Any, at: int, here: Lane, columns: Any) -> None:
    """Eight floats of sixteen records behind each other, the first from place `at` on, in the lanes `here`."""
    if simd.all_of(here):
        simd.store_rows(record, at, record.shape[1], columns)
    else:
        places = simd.iota(simd.i32x16(0)) * record.shape[1] + at
        for k in range(8):
            simd.scatter(record, places + k, columns[k], here)


@helper
def _plane(area: Vec, eu: Vec, ev: Vec, value: Lane, second: Lane, third: Lane) -> Vec:
    """c, a, b of what is `value` at the first corner and this much more at the others, over the distance."""
    return (
        simd.fma(ev[0], third, simd.fma(eu[0], second, area[0] * value)), simd.fma(ev[1], third, simd.fma(eu[1], second, area[1] * value)),
        simd.fma(ev[2], third, simd.fma(eu[2], second, area[2] * value)),
    )  # fmt: skip


@helper
def _color(tables: Any, g: int, triangle: Lane, u: float, v: float) -> Vec:
    return surface.attribute_at(tables, g, tables.geometries.colors[g], simd.f32x16(u), simd.f32x16(v), triangle)


@helper
def _corner(shown: Any, i: int, p: Vec) -> Any:
    """x, y of the pixels that points lie in, X - x W and Y - y W about them, and D, in float32."""
    m = shown.matrix
    cx = m[i, 0, 0] * p[0] + m[i, 0, 1] * p[1] + m[i, 0, 2] * p[2] + m[i, 0, 3]
    cy = m[i, 1, 0] * p[0] + m[i, 1, 1] * p[1] + m[i, 1, 2] * p[2] + m[i, 1, 3]
    d = m[i, 3, 0] * p[0] + m[i, 3, 1] * p[1] + m[i, 3, 2] * p[2] + m[i, 3, 3]
    w = d if shown.perspective else simd.f64x8(1.0)
    px, py = simd.floor(cx / w), simd.floor(cy / w)
    return simd.to_f32(px), simd.to_f32(py), simd.to_f32(cx - px * w), simd.to_f32(cy - py * w), simd.to_f32(d)


@helper
def _edge(shown: Any, i: int, e: Vec, x: Lane, y: Lane) -> Vec:
    """(X - x W, Y - y W, D) of directions, in float32."""
    m = shown.matrix
    d = e[0] * m[i, 3, 0] + e[1] * m[i, 3, 1] + e[2] * m[i, 3, 2]
    w = d if shown.perspective else simd.f32x16(0.0)
    cx = e[0] * m[i, 0, 0] + e[1] * m[i, 0, 1] + e[2] * m[i, 0, 2] - x * w
    cy = e[0] * m[i, 1, 0] + e[1] * m[i, 1, 1] + e[2] * m[i, 1, 2] - y * w
    return cx, cy, d


@helper
def _low(p: Any) -> Vec:
    return simd.to_f64(simd.low_half(p[0])), simd.to_f64(simd.low_half(p[1])), simd.to_f64(simd.low_half(p[2]))


@helper
def _high(p: Any) -> Vec:
    return simd.to_f64(simd.high_half(p[0])), simd.to_f64(simd.high_half(p[1])), simd.to_f64(simd.high_half(p[2]))


# --- what is seen of them -----------------------------------------------------------------------------------------------------


@helper
def gathered(faces: Any, patterned: Any, colored: Any, row: Lane) -> Any:
    """The columns of records."""
    at = row * faces.record.shape[1]
    first, second = simd.gather_rows(faces.record, at, 8), simd.gather_rows(faces.record, at + 8, 8)
    if patterned is None:
        return first, second, first, first, first
    third = simd.gather_rows(faces.record, at + 16, 8)
    if colored is None:
        return first, second, third, first, first
    return first, second, third, simd.gather_rows(faces.record, at + 24, 8), simd.gather_rows(faces.record, at + 32, 8)


@helper
def spread(faces: Any, patterned: Any, colored: Any, row: int) -> Any:
    """The same of one record in all lanes."""
    at = row * faces.record.shape[1]
    first, second = _spread(faces.record, at), _spread(faces.record, at + 8)
    if patterned is None:
        return first, second, first, first, first
    if colored is None:
        return first, second, _spread(faces.record, at + 16), first, first
    return first, second, _spread(faces.record, at + 16), _spread(faces.record, at + 24), _spread(faces.record, at + 32)


@helper
def _spread(table: Any, at: int) -> Any:
    """Eight numbers in all lanes."""
    return (
        simd.f32x16(simd.read(table, at)), simd.f32x16(simd.read(table, at + 1)), simd.f32x16(simd.read(table, at + 2)),
        simd.f32x16(simd.read(table, at + 3)), simd.f32x16(simd.read(table, at + 4)), simd.f32x16(simd.read(table, at + 5)),
        simd.f32x16(simd.read(table, at + 6)), simd.f32x16(simd.read(table, at + 7)),
    )  # fmt: skip


@helper
def instances(record: Any) -> Lane:
    return simd.to_i32(record[1][7])


@helper
def singles(record: Any) -> Lane:
    """Which faces are computed by themselves, by `seen_single`."""
    return abs(record[1][6]) > 1.5


@helper
def is_single(faces: Any, row: int) -> bool:
    return abs(faces.record[row, 14]) > 1.5


@helper
def seen(shown: Any, patterned: Any, colored: Any, record: Any, at_x: Lane, at_y: Lane) -> Seen:
    """What is seen of faces, not of single ones, at places in pixels: multiples of 1/256, which float32 has in pictures of up to 65,536."""
    first, second, t, r, q = record
    x, y = at_x - second[4], at_y - second[5]
    normal = (
        simd.fma(x, first[4], simd.fma(y, second[0], first[0])), simd.fma(x, first[5], simd.fma(y, second[1], first[1])),
        simd.fma(x, first[6], simd.fma(y, second[2], first[2])),
    )  # fmt: skip
    key = simd.fma(x, first[7], simd.fma(y, second[3], first[3]))
    zero = simd.f32x16(0.0)
    uv, metric, spread, outward, color = (zero, zero), (zero, zero), (zero, zero, zero, zero), normal, normal
    share, right, below = zero + 1.0, zero, zero  # one over what planes are divided by, and how that grows
    if shown.perspective:
        share, right, below = simd.reciprocal(key), first[7], second[3]
    if patterned is not None:
        uv = (simd.fma(x, t[1], simd.fma(y, t[2], t[0])) * share, simd.fma(x, t[4], simd.fma(y, t[5], t[3])) * share)
        metric = (t[6], t[7])
        spread = (
            (t[1] - uv[0] * right) * share, (t[4] - uv[1] * right) * share, (t[2] - uv[0] * below) * share, (t[5] - uv[1] * below) * share
        )  # fmt: skip
    if colored is not None:
        outward = (r[0], r[1], r[2])
        color = (
            simd.fma(x, r[4], simd.fma(y, r[5], r[3])) * share, simd.fma(x, r[7], simd.fma(y, q[0], r[6])) * share,
            simd.fma(x, q[2], simd.fma(y, q[3], q[1])) * share,
        )  # fmt: skip
    return Seen(normal, key, second[6], uv, metric, spread, outward, color)


@apart
def seen_single(shown, meshlets, drawn, tables, faces, patterned, colored, i, row, at_x, at_y):
    """The same of one face by itself."""
    p, s = _known(shown, meshlets, drawn, tables, faces, patterned, colored, i, row)
    bx, by = simd.floor(at_x * 0.25) * 4.0, simd.floor(at_y * 0.25) * 4.0  # blocks of pixels: from there on in float32
    x, y = at_x - bx, at_y - by
    zero = simd.f32x16(0.0)
    low_x, high_x = simd.to_f64(simd.low_half(bx)), simd.to_f64(simd.high_half(bx))
    low_y, high_y = simd.to_f64(simd.low_half(by)), simd.to_f64(simd.high_half(by))
    eu = simd.joined(simd.to_f32(_over(p, 2, low_x, low_y)), simd.to_f32(_over(p, 2, high_x, high_y)))
    ev = simd.joined(simd.to_f32(_over(p, 5, low_x, low_y)), simd.to_f32(_over(p, 5, high_x, high_y)))
    ew = simd.joined(simd.to_f32(_over(p, 8, low_x, low_y)), simd.to_f32(_over(p, 8, high_x, high_y)))
    eu = simd.maximum(simd.fma(x, s[_SLOPES], simd.fma(y, s[_SLOPES + 1], eu)), 0.0)
    ev = simd.maximum(simd.fma(x, s[_SLOPES + 2], simd.fma(y, s[_SLOPES + 3], ev)), 0.0)
    ew = simd.maximum(simd.fma(x, s[_SLOPES + 4], simd.fma(y, s[_SLOPES + 5], ew)), 0.0)
    normal = _blend(s, _NORMALS, eu, ev, ew)  # of any length, so that nothing waits for a division
    total = eu + ev + ew
    scale = simd.select(total > 0.0, simd.reciprocal(total), 0.0)
    u, v = eu * scale, ev * scale
    w = simd.select(total > 0.0, ew * scale, 1.0)
    if s[_EVEN] == 0.0:
        normal = _blend(s, _NORMALS, u, v, w)
        face = (zero + s[_FACE], zero + s[_FACE + 1], zero + s[_FACE + 2])
        size = lanes.dot(normal, normal)
        normal = lanes.scale(normal, simd.select(lanes.dot(normal, face) < 0.0, simd.f32x16(-1.0), 1.0))
        normal = lanes.where3((size > 1e-24) & (size < np.inf), normal, face)
    depth = simd.fma(w, s[_DEPTHS], simd.fma(u, s[_DEPTHS + 1], v * s[_DEPTHS + 2]))
    uv, metric, spread, outward, color = (zero, zero), (zero, zero), (zero, zero, zero, zero), normal, normal
    if patterned is not None:
        uv = (
            w * s[_PLACES] + u * s[_PLACES + 2] + v * s[_PLACES + 4], w * s[_PLACES + 1] + u * s[_PLACES + 3] + v * s[_PLACES + 5]
        )  # fmt: skip
        metric = (zero + s[_METRIC], zero + s[_METRIC + 1])
        right, below = _slope(s, uv, 0), _slope(s, uv, 1)
        spread = (right[0] * scale, right[1] * scale, below[0] * scale, below[1] * scale)
    if colored is not None:
        outward = (zero + s[_OWN], zero + s[_OWN + 1], zero + s[_OWN + 2])
        color = _blend(s, _COLORS, u, v, w)
    key = simd.reciprocal(depth) if shown.perspective else depth
    return Seen(normal, key, zero + s[_FRONT], uv, metric, spread, outward, color)


@helper
def _known(shown: Any, meshlets: Any, drawn: Any, tables: Any, faces: Any, patterned: Any, colored: Any, i: int,
           row: int) -> Any:  # fmt: skip
    """A single face's planes, and what its corners hold."""
    number, k = faces.owner[row], row & (KNOWN - 1)
    p, s = faces.planes[k], faces.single[k]
    if p[0] != number:
        p[0], p[_NEAR], p[_NEAR + 1] = number, 0.0, 0.0
        slot = drawn.first[number >> SHIFT] + (number & ((1 << SHIFT) - 1))
        _single(shown, meshlets, tables, p, s, patterned, colored, i, slot)
    return p, s


@helper
def near(shown: Any, meshlets: Any, drawn: Any, tables: Any, faces: Any, patterned: Any, colored: Any, i: int, row: int,
         x: int, y: int) -> int:  # fmt: skip
    """A row with the record, as of faces that are not single, of what a single face is where it fills the block from (x, y) on.

    It holds for blocks around that one, too, in a box of up to WIDE pixels in which weights do not grow too much, and is made anew for
    others. -1 where normals go to different sides of the face.
    """
    k = row & (KNOWN - 1)
    p, at, last = faces.planes, 16 * k, len(faces.record) - KNOWN + k
    if (simd.read(p, at) == simd.read(faces.owner, row) and simd.read(p, at + _NEAR) <= x and x < simd.read(p, at + _NEAR + 1)
            and simd.read(p, at + _NEAR + 2) <= y and y < simd.read(p, at + _NEAR + 3)):  # fmt: skip
        return last
    return _make_near(shown, meshlets, drawn, tables, faces, patterned, colored, i, row, x, y, last)


@apart
def _make_near(shown, meshlets, drawn, tables, faces, patterned, colored, i, row, x, y, last):
    """Write that record to row `last`, and return that, or -1."""
    p, s = _known(shown, meshlets, drawn, tables, faces, patterned, colored, i, row)
    if s[_EVEN] == 0.0:
        return -1
    left, top = x & ~(int(WIDE) - 1), y & ~(int(WIDE) - 1)
    right, bottom = left + int(WIDE), top + int(WIDE)
    if not _level(p, left, top, right, bottom):
        top, bottom = y, y + 4
        if not _level(p, left, top, right, bottom):
            left, right = x, x + 4
    p[_NEAR], p[_NEAR + 1], p[_NEAR + 2], p[_NEAR + 3] = left, right, top, bottom
    y = top
    weight = _sum(p, left, y)
    if shown.perspective:  # weights times depths are the same everywhere
        weight = _over(p, 8, left, y) * s[_DEPTHS] + _over(p, 2, left, y) * s[_DEPTHS + 1] + _over(p, 5, left, y) * s[_DEPTHS + 2]
    scale, record = 1.0 / weight, faces.record
    for k in range(3):
        _near_plane(p, s, _NORMALS + k, 3, scale, left, y, record, last, k, k + 4, k + 8)
    if shown.perspective:
        _near_sum(p, scale, left, y, record, last, 3, 7, 11)
    else:
        _near_plane(p, s, _DEPTHS, 1, scale, left, y, record, last, 3, 7, 11)
    record[last, 12], record[last, 13], record[last, 14], record[last, 15] = left, y, s[_FRONT], i
    if patterned is not None:
        for k in range(2):
            _near_plane(p, s, _PLACES + k, 2, scale, left, y, record, last, 16 + 3 * k, 17 + 3 * k, 18 + 3 * k)
            record[last, 22 + k] = s[_METRIC + k]
    if colored is not None:
        for k in range(3):
            record[last, 24 + k] = s[_OWN + k]
            _near_plane(p, s, _COLORS + k, 3, scale, left, y, record, last, 27 + 3 * k, 28 + 3 * k, 29 + 3 * k)
    return last


@helper
def _level(p: Any, x0: float, y0: float, x1: float, y1: float) -> bool:
    """Whether the sum of weights is much the same in a box."""
    a, b, c, d = _sum(p, x0, y0), _sum(p, x1, y0), _sum(p, x0, y1), _sum(p, x1, y1)
    return min(min(a, b), min(c, d)) > 0.25 * max(max(a, b), max(c, d))


@helper
def _sum(p: Any, x: float, y: float) -> float:
    """Of a single face's weights at a place."""
    return _over(p, 2, x, y) + _over(p, 5, x, y) + _over(p, 8, x, y)


@helper
def _near_plane(p: Any, s: Any, at: int, step: int, scale: float, x: float, y: float, record: Any, row: int,
                c: int, a: int, b: int) -> None:  # fmt: skip
    """Write the plane about (x, y) of what corners hold at s[at], s[at + step] and s[at + 2 · step], times their weights."""
    first, second, third = s[at] * scale, s[at + step] * scale, s[at + 2 * step] * scale
    record[row, c] = _over(p, 8, x, y) * first + _over(p, 2, x, y) * second + _over(p, 5, x, y) * third
    record[row, a] = p[9] * first + p[3] * second + p[6] * third
    record[row, b] = p[10] * first + p[4] * second + p[7] * third


@helper
def _near_sum(p: Any, scale: float, x: float, y: float, record: Any, row: int, c: int, a: int, b: int) -> None:
    """Write the plane of the weights' sum."""
    record[row, c], record[row, a], record[row, b] = _sum(p, x, y) * scale, (p[3] + p[6] + p[9]) * scale, (p[4] + p[7] + p[10]) * scale


@helper
def _slope(s: Any, uv: tuple[Lane, Lane], k: int) -> tuple[Lane, Lane]:
    """How u and v grow along x or y, times all weights: by the quotient's rule."""
    b, c, a = s[_SLOPES + k], s[_SLOPES + 2 + k], s[_SLOPES + 4 + k]
    return (
        (b * s[_PLACES + 2] + c * s[_PLACES + 4] + a * s[_PLACES]) - uv[0] * (a + b + c),
        (b * s[_PLACES + 3] + c * s[_PLACES + 5] + a * s[_PLACES + 1]) - uv[1] * (a + b + c),
    )


@helper
def _over(planes: Any, first: int, x: Lane, y: Lane) -> Lane:
    """A plane of weights at a place."""
    return planes[first] + planes[first + 1] * x + planes[first + 2] * y


@helper
def _blend(s: Any, at: int, u: Lane, v: Lane, w: Lane) -> Vec:
    """Three numbers at each of three corners."""
    return (
        simd.fma(v, s[at + 6], simd.fma(u, s[at + 3], w * s[at])), simd.fma(v, s[at + 7], simd.fma(u, s[at + 4], w * s[at + 1])),
        simd.fma(v, s[at + 8], simd.fma(u, s[at + 5], w * s[at + 2])),
    )  # fmt: skip


@apart
def _single(shown, meshlets, tables, planes, s, patterned, colored, i, slot):
    """Fill in a face: planes of the areas that belong to its second, third and first corner, and what corners hold.

    The cross of two corners' rows (X - x W, Y - y W) is X₁Y₂ - X₂Y₁ + x (W₂Y₁ - W₁Y₂) + y (X₂W₁ - X₁W₂). Scaled,
    so that float32 can hold them, and positive inside.
    """
    one, two, three = _row(shown, meshlets, i, slot, 0), _row(shown, meshlets, i, slot, 1), _row(shown, meshlets, i, slot, 2)
    first, second, third = _cross(two, three), _cross(three, one), _cross(one, two)
    det = one[0] * first[1] + one[1] * first[2] + one[2] * first[0]
    for n in range(3):
        planes[2 + n], planes[5 + n], planes[8 + n] = second[n], third[n], first[n]
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
    p, q, r = _place(meshlets, slot, 0), _place(meshlets, slot, 1), _place(meshlets, slot, 2)
    e1, e2 = lanes.sub(q, p), lanes.sub(r, p)
    face = lanes.normalize(lanes.cross(e1, e2))
    outward = lanes.normalize(lanes.scale(lanes.transform_normal(tables.transforms.inverse, transform, face), side))
    s[_OWN], s[_OWN + 1], s[_OWN + 2] = face
    s[_FACE], s[_FACE + 1], s[_FACE + 2] = outward
    even = True
    for corner in range(3):
        at = meshlets.corner[slot, corner]
        n = (np.float64(meshlets.record[at, 3]), np.float64(meshlets.record[at, 4]), np.float64(meshlets.record[at, 5]))
        if tables.materials.shading[material] == FLAT:
            n = face
        even = even and lanes.dot(n, face) > 0.0
        n = lanes.scale(lanes.transform_normal(tables.transforms.inverse, transform, n), side)
        s[_NORMALS + 3 * corner], s[_NORMALS + 3 * corner + 1], s[_NORMALS + 3 * corner + 2] = n
        s[_PLACES + 2 * corner], s[_PLACES + 2 * corner + 1] = meshlets.record[at, 6], meshlets.record[at, 7]
        s[_DEPTHS + corner] = _depth(shown, meshlets, i, slot, corner)
    s[_EVEN] = 1.0 if even else 0.0
    if patterned is not None:
        stretch = surface.mean_scale(lanes.affine(tables.transforms.matrix, transform))
        u1, v1 = s[_PLACES + 2] - s[_PLACES], s[_PLACES + 3] - s[_PLACES + 1]
        u2, v2 = s[_PLACES + 4] - s[_PLACES], s[_PLACES + 5] - s[_PLACES + 1]
        du, dv = surface.spans(e1, e2, u1, v1, u2, v2)
        s[_METRIC], s[_METRIC + 1] = du * stretch, dv * stretch
    if colored is not None:
        for corner in range(3):
            color = (1.0, 1.0, 1.0)
            if tables.geometries.colors[g] >= 0:
                u, v = (1.0 if corner == 1 else 0.0), (1.0 if corner == 2 else 0.0)
                color = surface.attribute_at(tables, g, tables.geometries.colors[g], u, v, meshlets.corner[slot, 3])
            s[_COLORS + 3 * corner], s[_COLORS + 3 * corner + 1], s[_COLORS + 3 * corner + 2] = color


@helper
def _place(meshlets: Any, slot: int, corner: int) -> Vec:
    """A corner in the mesh's frame."""
    at = meshlets.corner[slot, corner]
    return np.float64(meshlets.record[at, 0]), np.float64(meshlets.record[at, 1]), np.float64(meshlets.record[at, 2])


@helper
def _depth(shown: Any, meshlets: Any, i: int, slot: int, corner: int) -> float:
    m, (x, y, z) = shown.matrix, _place(meshlets, slot, corner)
    return m[i, 3, 0] * x + m[i, 3, 1] * y + m[i, 3, 2] * z + m[i, 3, 3]


@helper
def _row(shown: Any, meshlets: Any, i: int, slot: int, corner: int) -> Vec:
    """X, Y, W of a triangle's corner."""
    m, (x, y, z) = shown.matrix, _place(meshlets, slot, corner)
    w = _depth(shown, meshlets, i, slot, corner) if shown.perspective else 1.0
    return m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z + m[i, 0, 3], m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z + m[i, 1, 3], w


@helper
def _cross(p: Vec, q: Vec) -> Vec:
    """c, a, b of the area that two corners make."""
    return p[0] * q[1] - q[0] * p[1], q[2] * p[1] - p[2] * q[1], q[0] * p[2] - p[0] * q[2]
