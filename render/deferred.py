"""Deferred shading of a band: the items of its visibility buffer, each triangle of each pixel once, sixteen side by side.

Light is computed in float32, about the eye; materials, textures and lights are those all backends share. What is the same for all of an
instance, which is its whole material where nothing has a pattern, is looked up once and stays a number. Some tens of items go through
each step together, and each lamp shines on all of them in a short loop: one long loop over items would leave the processor waiting.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import across, faces, footprints, items, lanes, lights, materials, simd, single_faces, textures
from .bands import in_block
from .handles import Handle
from .kernels import apart, helper, kernel
from .meshlets import SHIFT
from .records import Lane, Surface, Vec

CAPACITY = 32  # points, of sixteen lanes each, that go through a step together

# Columns of a point: its normal and the direction to the viewer, unit; its light; where it is, about the eye; and what faces.Seen says.
_NORMAL, _VIEWER, _COLOR, _PLACE, _FACING, _UV, _METRIC, _SPREAD, _OUTWARD, _TINT = 0, 3, 6, 9, 12, 13, 15, 17, 21, 24
PLAIN, PICTURED, COLORED = 13, 21, 27


def single(tables: ir.Tables, eye: NDArray[np.float64]) -> ir.Tables:
    """Tables with the numbers that shading reads in float32, and lights about the eye."""

    def narrow(table: Any, *names: str) -> Any:
        return table._replace(**{name: getattr(table, name).astype(np.float32) for name in names})

    lamps = tables.lights._replace(position=tables.lights.position - eye)
    return tables._replace(
        materials=narrow(tables.materials, "values"),
        lights=narrow(lamps, "color", "position", "direction", "cos_cone", "cos_full", "coefficients"),
        transforms=narrow(tables.transforms, "inverse"),
        textures=narrow(tables.textures, "frame", "color_a", "color_b", "gain", "bias"),
    )


class Lamps(NamedTuple):
    """What shines on a scene, for shading about the eye in float32: ambient light, and lights without extent and without shadows."""

    ambient: NDArray[np.float32]  # (3,)
    row: NDArray[np.int32]  # (n,) of Lights
    far: NDArray[np.bool_]  # (n,) whether it comes from one direction, and as much of it, to all points
    direction: NDArray[np.float32]  # (n, 3) that one
    color: NDArray[np.float32]  # (n, 3) irradiance over π
    bare: bool  # whether nothing asks where a point is, or from which side it is seen: all are far, and no mesh is a light


def lamps(tables: ir.Tables) -> Lamps:
    """The lamps of tables."""
    rows = np.flatnonzero(tables.lights.kind != lights.AMBIENT).astype(np.int32)
    near = np.isin(tables.lights.kind[rows], (lights.POINT, lights.SPOT))
    direction, color = np.zeros((len(rows), 3), np.float32), np.zeros((len(rows), 3), np.float32)
    for k in np.flatnonzero(~near).tolist():
        arriving = lights.sample_sharp(tables, int(rows[k]), (np.zeros(1), np.zeros(1), np.zeros(1)))
        direction[k] = [c[0] for c in arriving.direction]
        color[k] = [c[0] / np.pi for c in arriving.irradiance]
    bare = not near.any() and bool((tables.instances.light < 0).all())
    return Lamps(np.array(lights.ambient(tables), np.float32), rows, ~near, direction, color, bare)


class Points(NamedTuple):
    """A thread's points that are lit together: those of one instance among sixteen items, or a block that one face fills."""

    values: NDArray[np.float32]  # (CAPACITY, PLAIN, PICTURED or COLORED, 16)
    instance: NDArray[np.int32]  # (CAPACITY,)
    lanes: NDArray[np.int32]  # bits: which lanes are of that instance
    group: NDArray[np.int32]  # of items, or of blocks and then items, that they belong to


def points_for(patterned: bool, colored: bool) -> Points:
    """Room for CAPACITY points."""
    values = simd.aligned_empty((CAPACITY, COLORED if colored else PICTURED if patterned else PLAIN, 16), np.float32)
    return Points(values, np.zeros(CAPACITY, np.int32), np.zeros(CAPACITY, np.int32), np.zeros(CAPACITY, np.int32))


class Shading(NamedTuple):
    """What lights bands of one picture in one thread: a handle of each."""

    shown: Handle  # bands.Projection
    pattern: Handle
    meshlets: Handle
    drawn: Handle
    lit: Handle  # tables, see `single`
    lamps: Handle
    look: Handle
    splat: Handle
    band: Handle
    faces: Handle
    items: Handle
    points: Handle


@kernel
def shade_band(shading, each, fresh, patterned, colored, crop, rgba):
    """Light what a band shows and add it to its rows of the picture, (h, w, 4), of the pixels of `crop`; `fresh`: nothing is there yet.

    `shading` is a handle of Shading; `each` see items.collect; `patterned`, `colored`: True or None, see faces.py.
    """
    splat, band, found, listed = shading.splat, shading.band, shading.faces, shading.items
    saved = simd.flush_denormals()
    listed.counts[3] = 0
    alone = splat.alone and not each
    if fresh and not alone:
        items.clear(rgba, band, crop, band.rows[0], band.rows[1])
    middle = items.middle(shading.pattern)
    known, shader = -1, even_shader(shading.lit, 0)
    for row in range(band.place[3] >> 2):
        faces.make_room(found, listed.half)
        items.collect(shading.pattern, each, alone, found, band, row, listed)
        faces.make_all(shading.shown, shading.meshlets, shading.drawn, shading.lit, found, patterned, colored)
        y = band.place[1] + 4 * row
        whole, part, even = listed.counts[0], listed.counts[1], listed.counts[2]
        full = alone and whole + 16 * even >= 4 * (crop[2] - crop[0])
        if alone and not full:
            items.clear(rgba, band, crop, y, y + 4)
        group, groups = 0, even + ((whole + part + 15) >> 4)
        while group < groups:
            group, count = see(shading, patterned, colored, group, groups, y, middle)
            first = 0
            while first < count:
                i, last = shading.points.instance[first], first + 1
                while last < count and shading.points.instance[last] == i:
                    last += 1
                if i != known:
                    known, shader = i, even_shader(shading.lit, i)
                light(shading, patterned, colored, i, shader, first, last)
                first = last
            put(shading, count, y, crop, full, rgba)
    simd.restore_denormals(saved)


# --- what is seen --------------------------------------------------------------------------------------------------------------


@helper
def see(shading: Any, patterned: Any, colored: Any, group: int, groups: int, y: int, middle: tuple[float, float]) -> tuple[int, int]:
    """Have the points of groups from `group` on, of the blocks from row y on, as many as there is room for: the next one, and how many.

    `middle`: where in pixels that one face fills it is lit.
    """
    shown, meshlets, drawn, tables = shading.shown, shading.meshlets, shading.drawn, shading.lit
    found, listed = shading.faces, shading.items
    column, line = in_block(simd.iota(simd.i32x16(0)))
    none = column < 0
    count = 0
    while group < groups and count <= CAPACITY - 16:
        if group < listed.counts[2]:
            face, x = simd.read(listed.even, group), simd.read(listed.even_x, group)
            at_x, at_y = simd.to_f32(column) + np.float32(x + middle[0]), simd.to_f32(line) + np.float32(y + middle[1])
            i, rest = drawn.instance[simd.read(found.owner, face) >> SHIFT], none
            rows, instances, single = simd.i32x16(face), simd.i32x16(i), none
            if faces.is_single(found, face):
                face = single_faces.near(shown, meshlets, drawn, tables, found, patterned, colored, i, face, x, y)
                if face < 0:
                    face, single, rest = 0, ~none, ~none
            point = faces.seen(shown, patterned, colored, faces.spread(found, patterned, colored, face), at_x, at_y)
        else:
            start = items.start_of(listed, group)
            rows = simd.load(listed.rows, start, simd.i32x16)
            there = simd.first_lanes(listed.half + listed.counts[1] - start, rows)
            rows = simd.select(there, rows, simd.read(listed.rows, start))
            at_x = simd.to_f32(simd.load(listed.at_x, start, simd.i32x16)) * np.float32(1.0 / 256.0)
            at_y = simd.to_f32(simd.load(listed.at_y, start, simd.i32x16)) * np.float32(1.0 / 256.0)
            record = faces.gathered(found, patterned, colored, rows)
            point = faces.seen(shown, patterned, colored, record, at_x, at_y)
            instances, single = faces.instances(record), faces.singles(record)
            i = simd.lane(instances, 0)
            rest = single | (instances != i)
        keep(shading, patterned, colored, count, point, at_x, at_y, i, ~rest, group)
        count += 1
        while simd.any_of(rest):
            first = simd.trailing_zeros(simd.bits(rest))
            i, face = simd.lane(instances, first), simd.lane(rows, first)
            here, other = rest & (instances == i) & ~single, point
            if simd.bits(single) >> first & 1:
                here = rest & (rows == face)
                other = single_faces.seen(shown, meshlets, drawn, tables, found, patterned, colored, i, face, at_x, at_y)
            keep(shading, patterned, colored, count, other, at_x, at_y, i, here, group)
            count += 1
            rest = rest & ~here
        group += 1
    return group, count


@helper
def keep(shading: Any, patterned: Any, colored: Any, k: int, point: faces.Seen, x: Lane, y: Lane, i: int, here: Lane,
         group: int) -> None:  # fmt: skip
    """Write a point."""
    points, look = shading.points, shading.look
    simd.write(points.instance, k, i)
    simd.write(points.lanes, k, simd.bits(here))
    simd.write(points.group, k, group)
    along = over_picture(look.direction, x, y)
    _put3(points, k, _NORMAL, lanes.scale(point.normal, simd.reciprocal_sqrt(lanes.dot(point.normal, point.normal))))
    _put3(points, k, _VIEWER, lanes.scale(along, -simd.reciprocal_sqrt(lanes.dot(along, along))))
    if colored is not None or not shading.lamps.bare:
        place = lanes.scale(along, simd.reciprocal(point.key) if shading.shown.perspective else point.key)
        if not shading.shown.perspective:
            place = lanes.add(place, over_picture(look.start, x, y))
        _put3(points, k, _PLACE, place)
    if patterned is not None or not shading.lamps.bare:
        _put1(points, k, _FACING, point.facing)
    if patterned is not None:
        _put2(points, k, _UV, point.uv)
        _put_spread(points, k, footprints.is_known(shading.lit), point.spread)
    if colored is not None:
        _put2(points, k, _METRIC, point.metric)
        _put3(points, k, _OUTWARD, point.outward)
        _put3(points, k, _TINT, point.color)


@helper
def _put_spread(points: Any, k: int, used: Any, spread: Any) -> None:
    if used is None:
        return
    _put2(points, k, _SPREAD, (spread[0], spread[1]))
    _put2(points, k, _SPREAD + 2, (spread[2], spread[3]))


@helper
def _put1(points: Any, k: int, column: int, x: Lane) -> None:
    simd.store_aligned(points.values, (k * points.values.shape[1] + column) * 16, x)


@helper
def _put2(points: Any, k: int, column: int, v: tuple[Lane, Lane]) -> None:
    _put1(points, k, column, v[0])
    _put1(points, k, column + 1, v[1])


@helper
def _put3(points: Any, k: int, column: int, v: Vec) -> None:
    _put2(points, k, column, (v[0], v[1]))
    _put1(points, k, column + 2, v[2])


@helper
def _get1(points: Any, k: int, column: int) -> Lane:
    return simd.load_aligned(points.values, (k * points.values.shape[1] + column) * 16, simd.f32x16)


@helper
def _get2(points: Any, k: int, column: int) -> tuple[Lane, Lane]:
    return _get1(points, k, column), _get1(points, k, column + 1)


@helper
def _get3(points: Any, k: int, column: int) -> Vec:
    return _get1(points, k, column), _get1(points, k, column + 1), _get1(points, k, column + 2)


@helper
def over_picture(table: Any, x: Lane, y: Lane) -> Vec:
    """Three vectors: at the picture's corner, and what a pixel right and a pixel down add."""
    return (
        simd.fma(x, table[1, 0], simd.fma(y, table[2, 0], table[0, 0])), simd.fma(x, table[1, 1], simd.fma(y, table[2, 1], table[0, 1])),
        simd.fma(x, table[1, 2], simd.fma(y, table[2, 2], table[0, 2])),
    )  # fmt: skip


# --- their light ---------------------------------------------------------------------------------------------------------------


@apart
def even_shader(tables, i):
    """The material of an instance without patterns, as numbers; of one with patterns, what is not asked for."""
    none = (0.0, 0.0, 0.0)
    plain = Surface(none, none, none, none, none, None, (1.0, 1.0), True, i, tables.instances.material[i], (1.0, 1.0, 1.0), 0.0, None, None)
    return across.narrow(materials.at(tables, plain))


@helper
def light(shading: Any, patterned: Any, colored: Any, i: int, shader: materials.Shader, first: int, last: int) -> None:
    """Light the points first <= k < last, all of instance i. `shader`: what it looks like where it has no patterns."""
    if patterned is not None:
        tables = shading.lit
        if textures.on(tables, tables.instances.material[i]) or tables.geometries.colors[tables.instances.geometry[i]] >= 0:
            for k in range(first, last):
                direct_light(shading, materials.at(tables, patterned_point(shading, colored, i, k)), i, k, k + 1)
            return
    direct_light(shading, shader, i, first, last)


@helper
def patterned_point(shading: Any, colored: Any, i: int, k: int) -> Surface:
    """A point of instance i, for its textures."""
    tables, points = shading.lit, shading.points
    normal, zero = _get3(points, k, _NORMAL), simd.f32x16(0.0)
    one = zero + 1.0
    position, local, outward, color, metric = (zero, zero, zero), (zero, zero, zero), normal, (one, one, one), (one, one)
    if colored is not None:
        position, outward = _get3(points, k, _PLACE), lanes.normalize(_get3(points, k, _OUTWARD))
        local, color, metric = lanes.transform_point(shading.look.local, i, position), _get3(points, k, _TINT), _get2(points, k, _METRIC)
    spread = (_get1(points, k, _SPREAD), _get1(points, k, _SPREAD + 1), _get1(points, k, _SPREAD + 2), _get1(points, k, _SPREAD + 3))
    uv, front, material = _get2(points, k, _UV), _get1(points, k, _FACING) > 0.0, tables.instances.material[i]
    point = Surface(position, local, normal, normal, outward, uv, metric, front, i, material, color, zero, None, None)
    known = footprints.of_pixel(tables, spread, point)
    return Surface(position, local, normal, normal, outward, uv, metric, front, i, material, color, zero, None, known)


@helper
def direct_light(shading: Any, shader: materials.Shader, i: int, first: int, last: int) -> None:
    """Emission, ambient light and that of lamps without extent and without shadows: integrate.local_light for what needs no more."""
    points, lamps = shading.points, shading.lamps
    zero = simd.f32x16(0.0)
    ambient = lanes.add(lanes.mul(shader.ambient, (lamps.ambient[0], lamps.ambient[1], lamps.ambient[2])), (zero, zero, zero))
    glow = lanes.add(shader.emission, ambient)
    one_sided = shading.lit.instances.light[i] >= 0
    for k in range(first, last if one_sided or len(lamps.row) == 0 else first):
        before = glow
        if one_sided:
            before = lanes.where3(_get1(points, k, _FACING) > 0.0, glow, ambient)
        _put3(points, k, _COLOR, before)
    for lamp in range(len(lamps.row)):
        c, d, begun = lamps.color, lamps.direction, one_sided or lamp > 0  # else what there was before is the glow
        color = (simd.f32x16(c[lamp, 0]), simd.f32x16(c[lamp, 1]), simd.f32x16(c[lamp, 2]))
        direction = (simd.f32x16(d[lamp, 0]), simd.f32x16(d[lamp, 1]), simd.f32x16(d[lamp, 2]))
        far = lamps.far[lamp]
        for k in range(first, last):
            if not far:
                arriving = lights.sample_sharp(shading.lit, lamps.row[lamp], _get3(points, k, _PLACE))
                direction, color = arriving.direction, lanes.scale(arriving.irradiance, np.float32(1.0 / np.pi))
            share = materials.reflected(shader, _get3(points, k, _NORMAL), direction, _get3(points, k, _VIEWER))
            before = glow
            if begun:
                before = _get3(points, k, _COLOR)
            _put3(points, k, _COLOR, lanes.add(before, lanes.mul(share, color)))


# --- into the picture ----------------------------------------------------------------------------------------------------------


@helper
def put(shading: Any, count: int, y: int, crop: Any, full: bool, rgba: Any) -> None:
    """Write points into the picture; `y` is where blocks are that one face fills, or that are seen whole; `full`: all are."""
    points, listed = shading.points, shading.items
    k = 0
    while k < count:
        group, here = simd.read(points.group, k), simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0))
        color = _get3(points, k, _COLOR)
        red, green, blue = simd.select(here, color[0], 0.0), simd.select(here, color[1], 0.0), simd.select(here, color[2], 0.0)
        k += 1
        while k < count and simd.read(points.group, k) == group:  # those of other instances among the same sixteen
            here, color = simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0)), _get3(points, k, _COLOR)
            red, green, blue = simd.select(here, color[0], red), simd.select(here, color[1], green), simd.select(here, color[2], blue)
            k += 1
        if group < listed.counts[2]:
            items.write_block(rows_of(red, green, blue, 16, listed), simd.read(listed.even_x, group), y, crop, full, rgba)
            continue
        start = items.start_of(listed, group)
        if start < listed.half:
            items.write_block(rows_of(red, green, blue, 16, listed), simd.read(listed.x, start), y, crop, full, rgba)
        else:
            left = min(listed.half + listed.counts[1] - start, 16)
            items.keep_light(listed.light, rows_of(red, green, blue, left, listed))
            items.keep_items(shading.pattern, shading.splat, shading.band, listed, start, left, crop, rgba)


@helper
def rows_of(red: Lane, green: Lane, blue: Lane, count: int, listed: Any) -> Any:
    """Colours of sixteen items as r, g, b, 1 in four vectors: every fourth item's, see meshlets.place_of.

    What is not finite among the first `count` is counted, and 0.
    """
    sound = simd.is_finite(red + green + blue)
    if not simd.all_of(sound):
        listed.counts[3] += simd.count(simd.first_lanes(count, red) & ~sound)
        red, green, blue = simd.select(sound, red, 0.0), simd.select(sound, green, 0.0), simd.select(sound, blue, 0.0)
    return simd.transpose((red, green, blue, simd.f32x16(1.0)))
