"""Deferred shading of a band: what its visibility buffer holds becomes items, each triangle of each pixel once, sixteen side by side.

An item is lit in the middle of the samples that see its triangle (faces.py), a place that the triangle covers, and its light goes to the
pixels that these samples count for.
Light is computed in float32, about the eye; materials, textures and lights are those all backends share. What is the same for all of an
instance, which is its whole material where nothing has a pattern, is looked up once and stays a number.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import across, faces, footprints, lanes, lights, materials, simd, textures
from .handles import Handle
from .kernels import apart, helper, kernel
from .meshlets import SHIFT, place_of
from .records import Lane, Surface, Vec

REACH = 2  # pixels on each side that a filter may reach
SIDE = 2 * REACH + 1


class Splat(NamedTuple):
    """Where samples count: weights[part, bits, pixel] of what four samples (`part`) of a pixel give to the pixels around it."""

    weights: NDArray[np.float32]  # (4, 16, SIDE · SIDE), row by row; the middle one is the pixel itself
    reach: int  # pixels
    parts: int


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


class Items(NamedTuple):
    """A thread's items of four rows of pixels, and room for their light. Of one sample a pixel, blocks that one triangle fills stand
    by themselves, and others that are seen whole in front, sixteen by sixteen; with more samples all are in the order of pixels,
    in which their light is added up."""

    ids: NDArray[np.int32]
    rows: NDArray[np.int32]  # their faces', see faces.Faces.row
    x: NDArray[np.int32]
    y: NDArray[np.int32]
    samples: NDArray[np.int32]  # bits: which of the pixel's samples see it
    at_x: NDArray[np.int32]  # where it is shaded, in 1/256 pixel
    at_y: NDArray[np.int32]
    light: NDArray[np.float32]  # (16, 4), item k at place_of(k): rows of four items
    even: NDArray[np.int32]  # blocks that one triangle fills: its id
    even_x: NDArray[np.int32]  # their first pixels
    counts: NDArray[np.int64]  # (4,) items in whole blocks, others, which stand from `half` on, `even` blocks, and what was not finite
    half: int


class Shading(NamedTuple):
    """What lights bands of one picture in one thread: a handle of each."""

    shown: Handle  # bands.Projection
    pattern: Handle
    meshlets: Handle
    drawn: Handle
    lit: Handle  # tables, see `single`
    look: Handle
    splat: Handle
    band: Handle
    faces: Handle
    items: Handle


def items_for(columns: int, samples: int) -> Items:
    """Room for what four rows of so many pixels can show."""
    half = ((columns + 3) & ~3) * 4 * samples + 16
    ids, rows, x, y, bits, at_x, at_y = (simd.aligned_empty(2 * half, np.int32) for _ in range(7))
    even, even_x = np.empty((columns >> 2) + 32, np.int32), np.empty((columns >> 2) + 32, np.int32)
    return Items(ids, rows, x, y, bits, at_x, at_y, simd.aligned_empty((16, 4), np.float32), even, even_x, np.zeros(4, np.int64), half)


@apart
def collect(pattern, each, found, band, row, items):
    """The items of a row of blocks: with `each`, one for each sample. `found` (a Faces or None): also the faces they see."""
    samples = len(pattern.x)
    columns = band.place[2] >> 2
    lane = simd.iota(simd.i32x16(0))
    y = (lane >> 2) + (band.place[1] + 4 * row)
    inside_y = (y >= band.clip[1]) & (y < band.clip[3])
    whole, part, even = 0, items.half, 0
    for block in range(columns):
        at = (row * columns + block) * samples * 16
        x = (lane & 3) + (band.place[0] + 4 * block)
        inside = inside_y & (x >= band.clip[0]) & (x < band.clip[2])
        for s in range(samples):
            ids = simd.load_aligned(band.ids, at + 16 * s, simd.i32x16)
            seen = inside & (ids >= 0)
            for t in range(0 if each else s):
                seen = seen & (ids != simd.load_aligned(band.ids, at + 16 * t, simd.i32x16))
            if simd.none_of(seen):
                continue
            rows = ids
            if found is not None:
                one = simd.lane(ids, 0)
                if samples == 1 and simd.all_of(seen & (ids == one)):
                    items.even[even], items.even_x[even] = faces.row_of(found, one), simd.lane(x, 0)
                    even += 1
                    continue
                rows = faces.rows_of(found, ids, seen)
            bits, count = simd.i32x16(1 << s), simd.i32x16(1)
            at_x, at_y = simd.i32x16(pattern.x[s]), simd.i32x16(pattern.y[s])
            if not each and samples > 1:
                for t in range(s + 1, samples):
                    too = ids == simd.load_aligned(band.ids, at + 16 * t, simd.i32x16)
                    bits, count = simd.select(too, bits | (1 << t), bits), simd.select(too, count + 1, count)
                    at_x, at_y = simd.select(too, at_x + pattern.x[t], at_x), simd.select(too, at_y + pattern.y[t], at_y)
                at_x, at_y = mean(at_x, count), mean(at_y, count)
            at_x, at_y = at_x + (x << 8), at_y + (y << 8)
            if samples == 1 and simd.all_of(seen):
                simd.store_aligned(items.at_x, whole, at_x)
                simd.store_aligned(items.at_y, whole, at_y)
                simd.store_aligned(items.x, whole, x)
                simd.store_aligned(items.y, whole, y)
                simd.store_aligned(items.ids, whole, ids)
                simd.store_aligned(items.rows, whole, rows)
                simd.store_aligned(items.samples, whole, bits)
                whole += 16
            else:
                simd.compress_store(items.at_x, part, at_x, seen)
                simd.compress_store(items.at_y, part, at_y, seen)
                simd.compress_store(items.x, part, x, seen)
                simd.compress_store(items.y, part, y, seen)
                simd.compress_store(items.samples, part, bits, seen)
                simd.compress_store(items.rows, part, rows, seen)
                part += simd.compress_store(items.ids, part, ids, seen)
    items.counts[0], items.counts[1], items.counts[2] = whole, part - items.half, even


@helper
def mean(total: Lane, count: Lane) -> Lane:
    """Whole numbers next to total / count."""
    return simd.to_i32(simd.to_f32(2 * total + count) / simd.to_f32(2 * count))


@kernel
def shade_band(shading, each, patterned, crop, rgba):
    """Light what a band shows and add it to the picture, (h, w, 4), of the pixels of `crop`.

    `shading` is a handle of Shading; `each` see `collect`; `patterned`: True or None.
    """
    shown, pattern, meshlets, drawn, tables = shading.shown, shading.pattern, shading.meshlets, shading.drawn, shading.lit
    look, splat, band, found, items = shading.look, shading.splat, shading.band, shading.faces, shading.items
    saved = simd.flush_denormals()
    items.counts[3] = 0
    known, shader = 0, even_shader(tables, 0)
    for row in range(band.place[3] >> 2):
        faces.make_room(found, items.half)
        collect(pattern, each, found, band, row, items)
        faces.make_all(shown, meshlets, drawn, tables, found, patterned)
        y = band.place[1] + 4 * row
        for k in range(items.counts[2]):
            face, x = items.even[k], items.even_x[k]
            i = drawn.instance[found.owner[face] >> SHIFT]
            if i != known:
                known, shader = i, even_shader(tables, i)
            color = light_block(shown, meshlets, drawn, tables, look, patterned, found, items, i, face, x, y, shader)
            write_block(color, x, y, crop, rgba)
        whole, part = items.counts[0], items.counts[1]
        for group in range(0, whole + part, 16):
            start = group if group < whole else items.half + group - whole
            count = min(items.half + part - start, 16)
            known, shader, color = light_items(shown, meshlets, drawn, tables, look, patterned, found, items, start, count, known, shader)
            if group < whole:
                write_block(color, items.x[start], items.y[start], crop, rgba)
            else:
                keep_light(items.light, color)
                keep_items(pattern, splat, band, items, start, count, crop, rgba)
    simd.restore_denormals(saved)


@apart
def keep_items(pattern, splat, band, items, start, count, crop, rgba):
    """Add the light of up to sixteen items to the picture."""
    if len(pattern.x) > 1:
        splat_items(splat, band, items, start, count, crop, rgba)
    else:
        write_items(items, start, count, crop, rgba)


@helper
def write_block(rows: Any, x: int, y: int, crop: Any, rgba: Any) -> None:
    """The sixteen pixels of a block from (x, y) on, of one sample each: four vectors of the pixels that lie above each other."""
    width = 4 * (crop[2] - crop[0])
    place = (y - crop[1]) * width + 4 * (x - crop[0])
    a, b, c, d = rows
    left, right = simd.joined(_first(a), _first(b)), simd.joined(_first(c), _first(d))
    simd.store(rgba, place, simd.joined(left, right))
    left, right = simd.joined(_second(a), _second(b)), simd.joined(_second(c), _second(d))
    simd.store(rgba, place + width, simd.joined(left, right))
    left, right = simd.joined(_third(a), _third(b)), simd.joined(_third(c), _third(d))
    simd.store(rgba, place + 2 * width, simd.joined(left, right))
    left, right = simd.joined(_fourth(a), _fourth(b)), simd.joined(_fourth(c), _fourth(d))
    simd.store(rgba, place + 3 * width, simd.joined(left, right))


@helper
def _first(x: Lane) -> Lane:
    return simd.low_half(simd.low_half(x))


@helper
def _second(x: Lane) -> Lane:
    return simd.high_half(simd.low_half(x))


@helper
def _third(x: Lane) -> Lane:
    return simd.low_half(simd.high_half(x))


@helper
def _fourth(x: Lane) -> Lane:
    return simd.high_half(simd.high_half(x))


@helper
def write_items(items: Any, start: int, count: int, crop: Any, rgba: Any) -> None:
    """Up to sixteen pixels of one sample."""
    for k in range(count):
        place = ((items.y[start + k] - crop[1]) * (crop[2] - crop[0]) + items.x[start + k] - crop[0]) * 4
        simd.store(rgba, place, simd.load(items.light, 4 * place_of(k), simd.f32x4))


@helper
def splat_items(splat: Any, band: Any, items: Any, start: int, count: int, crop: Any, rgba: Any) -> None:
    """Add sixteen items to the pixels their samples count for, those of this band's own rows."""
    reach, width = splat.reach, crop[2] - crop[0]
    for k in range(count):
        light, bits = simd.load(items.light, 4 * place_of(k), simd.f32x4), items.samples[start + k]
        x, y = items.x[start + k], items.y[start + k]
        for dy in range(-reach, reach + 1):
            if y + dy < band.rows[0] or y + dy >= band.rows[1]:
                continue
            for dx in range(-reach, reach + 1):
                if x + dx < crop[0] or x + dx >= crop[2]:
                    continue
                pixel = (dy + REACH) * SIDE + dx + REACH
                weight = splat.weights[0, bits & 15, pixel]
                for part in range(1, splat.parts):
                    weight += splat.weights[part, bits >> (4 * part) & 15, pixel]
                place = ((y + dy - crop[1]) * width + x + dx - crop[0]) * 4
                simd.store(rgba, place, simd.fma(light, simd.f32x4(weight), simd.load(rgba, place, simd.f32x4)))


@helper
def light_block(shown: Any, meshlets: Any, drawn: Any, tables: Any, look: Any, patterned: Any, found: Any, items: Any,
                i: int, face: int, x: int, y: int, shader: Any) -> Any:  # fmt: skip
    """The light of a block of pixels that one face of instance i fills, as `light_items` gives it."""
    lane = simd.iota(simd.i32x16(0))
    at_x, at_y = ((lane & 3) << 8) + (256 * x + 128), ((lane >> 2) << 8) + (256 * y + 128)
    if faces.is_single(found, face):
        point = faces.seen_single(shown, meshlets, drawn, tables, found, patterned, i, face, at_x, at_y)
    else:
        point = faces.seen(shown, patterned, faces.spread(found, patterned, face), at_x, at_y)
    red, green, blue = light_of(shown, tables, look, patterned, i, shader, point, at_x, at_y)
    return rows_of(red, green, blue, lane >= 0, items)


@helper
def light_items(shown: Any, meshlets: Any, drawn: Any, tables: Any, look: Any, patterned: Any, found: Any, items: Any,
                start: int, count: int, known: int, shader: Any) -> Any:  # fmt: skip
    """The light of `count` items from `start` on, sixteen at the most, as four vectors of four items' r, g, b, 1, see `place_of`.

    `shader` is what all of instance `known` looks like; the two as they are afterwards are returned before it.
    """
    rows = simd.load(items.rows, start, simd.i32x16)
    there = simd.first_lanes(count, rows)
    rows = simd.select(there, rows, items.rows[start])
    at_x, at_y = simd.load(items.at_x, start, simd.i32x16), simd.load(items.at_y, start, simd.i32x16)
    record = faces.gathered(found, patterned, rows)
    instances, single = faces.instances(record), faces.singles(record)
    zero = simd.f32x16(0.0)
    red, green, blue = zero, zero, zero
    rest = there
    while simd.any_of(rest):
        first = simd.trailing_zeros(simd.bits(rest))
        i, face = simd.lane(instances, first), simd.lane(rows, first)
        if i != known:
            known, shader = i, even_shader(tables, i)
        here = rest & (instances == i) & ~single
        if simd.bits(single) >> first & 1:
            here = rest & (rows == face)
            point = faces.seen_single(shown, meshlets, drawn, tables, found, patterned, i, face, at_x, at_y)
        else:
            point = faces.seen(shown, patterned, record, at_x, at_y)
        color = light_of(shown, tables, look, patterned, i, shader, point, at_x, at_y)
        red, green, blue = simd.select(here, color[0], red), simd.select(here, color[1], green), simd.select(here, color[2], blue)
        rest = rest & ~here
    return known, shader, rows_of(red, green, blue, there, items)


@helper
def rows_of(red: Lane, green: Lane, blue: Lane, there: Lane, items: Any) -> Any:
    """Colours of sixteen items as four vectors of four items'; what is not finite is counted and 0."""
    sound = simd.is_finite(red + green + blue)
    if not simd.all_of(sound):
        items.counts[3] += simd.count(there & ~sound)
        red, green, blue = simd.select(sound, red, 0.0), simd.select(sound, green, 0.0), simd.select(sound, blue, 0.0)
    return simd.transpose((red, green, blue, simd.f32x16(1.0)))


@helper
def keep_light(light: Any, rows: Any) -> None:
    """The transposed light of sixteen items to where `place_of` says."""
    simd.store_aligned(light, 0, rows[0])
    simd.store_aligned(light, 16, rows[1])
    simd.store_aligned(light, 32, rows[2])
    simd.store_aligned(light, 48, rows[3])


@helper
def even_shader(tables: Any, i: int) -> materials.Shader:
    """The material of an instance without patterns, as numbers; of one with patterns, what is not asked for."""
    none = (0.0, 0.0, 0.0)
    plain = Surface(none, none, none, none, none, None, (1.0, 1.0), True, i, tables.instances.material[i], (1.0, 1.0, 1.0), 0.0, None, None)
    return across.narrow(materials.at(tables, plain))


@helper
def light_of(shown: Any, tables: Any, look: Any, patterned: Any, i: int, shader: materials.Shader, point: faces.Seen,
             at_x: Lane, at_y: Lane) -> Vec:  # fmt: skip
    """What goes from points of instance i to the eye."""
    x, y = simd.to_f32(at_x) * np.float32(1.0 / 256.0), simd.to_f32(at_y) * np.float32(1.0 / 256.0)
    along = over_picture(look.direction, x, y)
    viewer = lanes.scale(along, -simd.reciprocal_sqrt(lanes.dot(along, along)))
    normal = lanes.scale(point.normal, simd.reciprocal_sqrt(lanes.dot(point.normal, point.normal)))
    position = lanes.scale(along, point.depth)
    if not shown.perspective:
        position = lanes.add(position, over_picture(look.start, x, y))
    if patterned is None:
        return direct_light(tables, shader, i, point.front, position, normal, viewer)
    m, g = tables.instances.material[i], tables.instances.geometry[i]
    if not (textures.on(tables, m) or tables.geometries.colors[g] >= 0):
        return direct_light(tables, shader, i, point.front, position, normal, viewer)
    local = lanes.transform_point(look.local, i, position)
    outward = lanes.normalize(point.outward)
    there = Surface(
        position, local, normal, normal, outward, point.uv, point.metric, point.front, i, m, point.color, 0.0 * x, None,
        footprints.of_pixel(tables, point.spread),
    )  # fmt: skip
    return direct_light(tables, materials.at(tables, there), i, point.front, position, normal, viewer)


@helper
def over_picture(table: Any, x: Lane, y: Lane) -> Vec:
    """Three vectors: at the picture's corner, and what a pixel right and a pixel down add."""
    return (
        simd.fma(x, table[1, 0], simd.fma(y, table[2, 0], table[0, 0])), simd.fma(x, table[1, 1], simd.fma(y, table[2, 1], table[0, 1])),
        simd.fma(x, table[1, 2], simd.fma(y, table[2, 2], table[0, 2])),
    )  # fmt: skip


@helper
def direct_light(tables: Any, shader: materials.Shader, i: int, front: Lane, position: Vec, normal: Vec, viewer: Vec) -> Vec:
    """Emission, ambient light and that of lamps without extent and without shadows: integrate.local_light for what needs no more."""
    zero = simd.f32x16(0.0)
    shines = lanes.bool_like(zero, True)
    if tables.instances.light[i] >= 0:
        shines = front
    total = lanes.where3(shines, lanes.add(shader.emission, (zero, zero, zero)), (zero, zero, zero))
    total = lanes.add(total, lanes.mul(shader.ambient, lights.ambient(tables)))
    for light in range(len(tables.lights.kind)):
        if tables.lights.kind[light] != lights.AMBIENT:
            arriving = lights.sample_sharp(tables, light, position)
            share = materials.reflected(shader, normal, arriving.direction, viewer)
            total = lanes.add(total, lanes.scale(lanes.mul(share, arriving.irradiance), 1.0 / np.pi))
    return total
