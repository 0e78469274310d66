"""Deferred shading of a band: the items of its visibility buffer, each triangle of each pixel once, sixteen side by side.

Light is computed in float32, about the eye; materials, textures and lights are those all backends share. What is the same for all of an
instance, which is its whole material where nothing has a pattern, is looked up once and stays a number. Some tens of items go through
each step together, and each lamp shines on all of them in a short loop: one long loop over items would leave the processor waiting.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import affine, crosslane, ops
from ..light import lights
from ..material import bsdf, principled
from ..surface import texture_footprint
from ..surface.interaction import spanning
from ..texture import textures
from ..types import Surface
from . import fragments, precise_planes, spans, triangle_planes
from .shading_points import CAPACITY, COLOR, FACING, METRIC, NORMAL, OUTWARD, PLACE, SPREAD, TINT, UV, VIEWER, get1, get2, get3, keep, put3


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


def lights_flat(tables: ir.Tables, known: Lamps, patterned: bool) -> bool:
    """Whether flat faces are lit run by run: by far lamps alone, with nothing on them, and by the course's equations."""
    return known.bare and not patterned and not isinstance(tables.materials, principled.Layered)


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
def shade_band(shading, each, fresh, patterned, colored, flat, crop, rgba):
    """Light what a band shows and add it to its rows of the picture, (h, w, 4), of the pixels of `crop`; `fresh`: nothing is there yet.

    `shading` is a handle of Shading; `each` see items.collect; `patterned`, `colored`: True or None, see faces.py; `flat`: True or None,
    whether flat faces are lit run by run.
    """
    splat, band, found, listed = shading.splat, shading.band, shading.faces, shading.items
    saved = simd.flush_denormals()
    listed.counts[3] = 0
    alone = splat.alone and not each
    if fresh and not alone:
        fragments.clear(rgba, band, crop, band.rows[0], band.rows[1])
    middle = fragments.middle(shading.pattern)
    known, shader = -1, even_shader(shading.lit, 0)
    for row in range(band.place[3] >> 2):
        triangle_planes.make_room(found, listed.half)
        fragments.build_fragments(shading.pattern, each, alone, found, band, row, listed)
        triangle_planes.setup_planes(shading.shown, shading.meshlets, shading.drawn, shading.lit, found, patterned, colored)
        y = band.place[1] + 4 * row
        whole, part, even = listed.counts[0], listed.counts[1], listed.counts[2]
        full = alone and whole + 16 * even >= 4 * (crop[2] - crop[0])
        if alone and not full:
            fragments.clear(rgba, band, crop, y, y + 4)
        group, groups = 0, even + ((whole + part + 15) >> 4)
        while group < groups:
            if group < even:
                start = group
                group, count = spans.see(shading, patterned, colored, flat, group, y, middle)
                if flat is not None and group == start:
                    i = spans.instance_of(shading, simd.read(listed.even, group))
                    if i != known:
                        known, shader = i, even_shader(shading.lit, i)
                    group = spans.light_flat(shading, shader, group, y, middle, crop, full, rgba)
                    continue
            else:
                group, count = see(shading, patterned, colored, group, groups)
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
def see(shading: Any, patterned: Any, colored: Any, group: int, groups: int) -> tuple[int, int]:
    """Have the points of items, sixteen by sixteen, from `group` on, as many as there is room for: the next one, and how many."""
    shown, found, listed = shading.shown, shading.faces, shading.items
    count = 0
    while group < groups and count <= CAPACITY - 16:
        start = fragments.start_of(listed, group)
        rows = simd.load(listed.rows, start, simd.i32x16)
        there = simd.first_lanes(listed.half + listed.counts[1] - start, rows)
        rows = simd.select(there, rows, simd.read(listed.rows, start))
        at_x = simd.to_f32(simd.load(listed.at_x, start, simd.i32x16)) * np.float32(1.0 / 256.0)
        at_y = simd.to_f32(simd.load(listed.at_y, start, simd.i32x16)) * np.float32(1.0 / 256.0)
        record = triangle_planes.gathered(found, patterned, colored, rows)
        point = triangle_planes.interpolate(shown, patterned, colored, record, at_x, at_y)
        instances, single = triangle_planes.instances(record), triangle_planes.singles(record)
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
                other = precise_planes.seen(
                    shown, shading.meshlets, shading.drawn, shading.lit, found, patterned, colored, i, face, at_x, at_y
                )  # fmt: skip
            keep(shading, patterned, colored, count, other, at_x, at_y, i, here, group)
            count += 1
            rest = rest & ~here
        group += 1
    return group, count


# --- their light ---------------------------------------------------------------------------------------------------------------


@noinline_helper
def even_shader(tables, i):
    """The material of an instance without patterns, as numbers; of one with patterns, what is not asked for."""
    none = (0.0, 0.0, 0.0)
    plain = Surface(
        none, none, none, none, none, None, (1.0, 1.0), True, i, tables.instances.material[i], (1.0, 1.0, 1.0), 0.0, None, None, None, None
    )
    return crosslane.narrow(bsdf.evaluate_shader(tables, plain))


@helper
def light(shading: Any, patterned: Any, colored: Any, i: int, shader: bsdf.Shader, first: int, last: int) -> None:
    """Light the points first <= k < last, all of instance i. `shader`: what it looks like where it has no patterns."""
    if patterned is not None:
        tables = shading.lit
        if textures.on(tables, tables.instances.material[i]) or tables.geometries.colors[tables.instances.geometry[i]] >= 0:
            for k in range(first, last):
                direct_light(shading, bsdf.evaluate_shader(tables, patterned_point(shading, colored, i, k)), i, k, k + 1)
            return
    direct_light(shading, shader, i, first, last)


@helper
def patterned_point(shading: Any, colored: Any, i: int, k: int) -> Surface:
    """A point of instance i, for its textures."""
    tables, points = shading.lit, shading.points
    normal, zero = get3(points, k, NORMAL), simd.f32x16(0.0)
    one = zero + 1.0
    position, local, outward, color, metric = (zero, zero, zero), (zero, zero, zero), normal, (one, one, one), (one, one)
    if colored is not None:
        position, outward = get3(points, k, PLACE), ops.normalize(get3(points, k, OUTWARD))
        local, color, metric = affine.transform_point(shading.look.local, i, position), get3(points, k, TINT), get2(points, k, METRIC)
    spread = (get1(points, k, SPREAD), get1(points, k, SPREAD + 1), get1(points, k, SPREAD + 2), get1(points, k, SPREAD + 3))
    uv, front, material = get2(points, k, UV), get1(points, k, FACING) > 0.0, tables.instances.material[i]
    point = Surface(position, local, normal, normal, outward, uv, metric, front, i, material, color, zero, None, None, None, None)
    return spanning(point, texture_footprint.of_pixel(tables, spread, point))


@helper
def direct_light(shading: Any, shader: bsdf.Shader, i: int, first: int, last: int) -> None:
    """Emission, ambient light and that of lamps without extent and without shadows: integrate.local_light for what needs no more."""
    points, lamps = shading.points, shading.lamps
    zero = simd.f32x16(0.0)
    ambient = ops.add(ops.mul(shader.ambient, (lamps.ambient[0], lamps.ambient[1], lamps.ambient[2])), (zero, zero, zero))
    glow = ops.add(shader.emission, ambient)
    one_sided = shading.lit.instances.light[i] >= 0
    for k in range(first, last if one_sided or len(lamps.row) == 0 else first):
        before = glow
        if one_sided:
            before = ops.where3(get1(points, k, FACING) > 0.0, glow, ambient)
        put3(points, k, COLOR, before)
    for lamp in range(len(lamps.row)):
        c, d, begun = lamps.color, lamps.direction, one_sided or lamp > 0  # else what there was before is the glow
        color = (simd.f32x16(c[lamp, 0]), simd.f32x16(c[lamp, 1]), simd.f32x16(c[lamp, 2]))
        direction = (simd.f32x16(d[lamp, 0]), simd.f32x16(d[lamp, 1]), simd.f32x16(d[lamp, 2]))
        far = lamps.far[lamp]
        for k in range(first, last):
            if not far:
                arriving = lights.sample_sharp(shading.lit, lamps.row[lamp], get3(points, k, PLACE))
                direction, color = arriving.direction, ops.scale(arriving.irradiance, np.float32(1.0 / np.pi))
            share = bsdf.reflected(shader, get3(points, k, NORMAL), direction, get3(points, k, VIEWER))
            before = glow
            if begun:
                before = get3(points, k, COLOR)
            put3(points, k, COLOR, ops.add(before, ops.mul(share, color)))


# --- into the picture ----------------------------------------------------------------------------------------------------------


@helper
def put(shading: Any, count: int, y: int, crop: Any, full: bool, rgba: Any) -> None:
    """Write points into the picture; `y` is where blocks are that one face fills, or that are seen whole; `full`: all are."""
    points, listed = shading.points, shading.items
    k = 0
    while k < count:
        group, here = simd.read(points.group, k), simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0))
        color = get3(points, k, COLOR)
        red, green, blue = simd.select(here, color[0], 0.0), simd.select(here, color[1], 0.0), simd.select(here, color[2], 0.0)
        k += 1
        while k < count and simd.read(points.group, k) == group:  # those of other instances among the same sixteen
            here, color = simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0)), get3(points, k, COLOR)
            red, green, blue = simd.select(here, color[0], red), simd.select(here, color[1], green), simd.select(here, color[2], blue)
            k += 1
        if group < listed.counts[2]:
            fragments.write_block(fragments.rows_of(red, green, blue, 16, listed), simd.read(listed.even_x, group), y, crop, full, rgba)
            continue
        start = fragments.start_of(listed, group)
        if start < listed.half:
            fragments.write_block(fragments.rows_of(red, green, blue, 16, listed), simd.read(listed.x, start), y, crop, full, rgba)
        else:
            left = min(listed.half + listed.counts[1] - start, 16)
            fragments.store_fragment_light(listed.light, fragments.rows_of(red, green, blue, left, listed))
            fragments.resolve_fragments(shading.pattern, shading.splat, shading.band, listed, start, left, crop, rgba)
