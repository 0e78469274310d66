"""Triangles that a band shows, as planes over the picture: made once for each of them, sixteen at a time, read by every pixel that sees it.

What is linear on a triangle, divided by the distance along the axis, is linear on the picture (Heckbert and Moreton 1991, Interpolation
for Polygon Texture Mapping). So a face's record holds, as c + a x + b y about a pixel near it: its normal in the world over that distance,
and one over that distance; with textures also coordinates and colours. Corners are those before snapping to fixed point.

Float32 will do for faces that are small on the picture and not steep. Large, steep, long and thin ones, and those on whose corners normals
go to different sides, are single: their corners' weights are computed in float64 where they are seen, and kept inside (single_faces.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import affine, ops
from ..surface import interaction
from ..types import Lane, Vec
from .meshlets import RECORD, SHIFT

FLAT = int(ir.Shading.FLAT)
PLAIN = 16  # floats of a record: c and a of normal and key; b of them, where x and y count from, side, instance
PICTURED = 24  # with u and v
COLORED = 40  # with the metres they span, the triangle's own normal and the colour's planes, too
WIDE = 64.0  # pixels
THIN = 1.0 / 32.0  # pixels of height, below which 1/512 pixel beside a face may lead far from what its corners hold
KNOWN = 256  # single faces that are kept, a power of two
EVEN, SINGLE = 1.25, 2.0  # sizes of a record's side, else 1: where corners have one normal; where faces are by themselves
SHORT = 1.5  # pixels; what is thin and short has what its middle has


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
    faces.planes[:, 0] = -1.0


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


@noinline_helper
def setup_planes(shown, meshlets, drawn, tables, faces, patterned, colored):
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
    area = ops.where3(speck, (whole, zero, zero), ops.scale(area, whole))
    eu, ev = ops.where3(speck, level, ops.scale(eu, whole)), ops.where3(speck, level, ops.scale(ev, whole))

    transform, material = tables.instances.transform[i], tables.instances.material[i]
    inverse = tables.transforms.inverse
    front = turned if tables.transforms.flips[transform] else ~turned
    side = simd.select(front, one, -one)
    face = ops.cross(e1, e2)
    na, nb, nc = (a[3], a[4], a[5]), (b[3], b[4], b[5]), (c[3], c[4], c[5])
    sa, sb, sc = ops.dot(na, face), ops.dot(nb, face), ops.dot(nc, face)
    none = (ops.dot(na, na) + ops.dot(nb, nb) + ops.dot(nc, nc)) == 0.0
    if tables.materials.shading[material] == FLAT:
        none = none | ~none
    along, against = (sa >= 0.0) & (sb >= 0.0) & (sc >= 0.0), (sa <= 0.0) & (sb <= 0.0) & (sc <= 0.0)
    single = single | ~(none | along | against)
    na, nb, nc = ops.where3(none, face, na), ops.where3(none, face, nb), ops.where3(none, face, nc)
    side = simd.select(none | along, side, -side)
    na = ops.scale(affine.transform_normal(inverse, transform, na), side)
    nb = ops.sub(ops.scale(affine.transform_normal(inverse, transform, nb), side), na)
    nc = ops.sub(ops.scale(affine.transform_normal(inverse, transform, nc), side), na)
    nx, ny = _plane(area, eu, ev, na[0], nb[0], nc[0]), _plane(area, eu, ev, na[1], nb[1], nc[1])
    nz = _plane(area, eu, ev, na[2], nb[2], nc[2])
    key = area if shown.perspective else _plane(area, eu, ev, depth, d1, d2)

    level = _is_zero(nb) & _is_zero(nc)
    facing = simd.select(front, one, -one) * simd.select(single, np.float32(SINGLE), simd.select(level, np.float32(EVEN), 1.0))
    record, at = faces.record, first * faces.record.shape[1]
    _write(record, at, here, (nx[0], ny[0], nz[0], key[0], nx[1], ny[1], nz[1], key[1]))
    _write(record, at + 8, here, (nx[2], ny[2], nz[2], key[2], px, py, facing, zero + np.float32(i)))
    if patterned is not None:
        u1, v1, u2, v2 = b[6] - a[6], b[7] - a[7], c[6] - a[6], c[7] - a[7]
        u, v = _plane(area, eu, ev, a[6], u1, u2), _plane(area, eu, ev, a[7], v1, v2)
        du, dv = zero, zero  # which only bumps ask for
        if colored is not None:
            du, dv = interaction.spans(e1, e2, u1, v1, u2, v2)
            stretch = interaction.mean_scale(affine.load12(tables.transforms.matrix, transform))
            du, dv = du * stretch, dv * stretch
        _write(record, at + 16, here, (u[0], u[1], u[2], v[0], v[1], v[2], du, dv))
    if colored is not None:
        g = tables.instances.geometry[i]
        red, green, blue = (zero + area[0], zero + area[1], zero + area[2]), area, area
        if tables.geometries.colors[g] >= 0:
            first_color = _color(tables, g, corner[3], 0.0, 0.0)
            b_color = ops.sub(_color(tables, g, corner[3], 1.0, 0.0), first_color)
            c_color = ops.sub(_color(tables, g, corner[3], 0.0, 1.0), first_color)
            red = _plane(area, eu, ev, first_color[0], b_color[0], c_color[0])
            green = _plane(area, eu, ev, first_color[1], b_color[1], c_color[1])
            blue = _plane(area, eu, ev, first_color[2], b_color[2], c_color[2])
        _write(record, at + 24, here, (face[0], face[1], face[2], red[0], red[1], red[2], green[0], green[1]))
        _write(record, at + 32, here, (green[2], blue[0], blue[1], blue[2], zero, zero, zero, zero))


@helper
def _is_zero(v: Vec) -> Lane:
    return (v[0] == 0.0) & (v[1] == 0.0) & (v[2] == 0.0)


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
    return interaction.attribute_at(tables, g, tables.geometries.colors[g], simd.f32x16(u), simd.f32x16(v), triangle, triangle >= 0)


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
    first, second = simd.gather_rows(faces.record, at, 8), simd.gather_rows(faces.record, at, 8, 8)
    if patterned is None:
        return first, second, first, first, first
    third = simd.gather_rows(faces.record, at, 8, 16)
    if colored is None:
        return first, second, third, first, first
    return first, second, third, simd.gather_rows(faces.record, at, 8, 24), simd.gather_rows(faces.record, at, 8, 32)


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
    """Which faces are computed by themselves, by single_faces.py."""
    return abs(record[1][6]) == SINGLE


@helper
def is_single(faces: Any, row: int) -> bool:
    return abs(simd.read(faces.record, row * faces.record.shape[1] + 14)) == SINGLE


@helper
def is_flat(faces: Any, row: int) -> bool:
    """Whether the corners of a face that is not single have one normal."""
    return abs(simd.read(faces.record, row * faces.record.shape[1] + 14)) == EVEN


@helper
def interpolate(shown: Any, patterned: Any, colored: Any, record: Any, at_x: Lane, at_y: Lane) -> Seen:
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
