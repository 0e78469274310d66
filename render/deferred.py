"""Deferred shading of a band: what its visibility buffer holds becomes items, each triangle of each pixel once, sixteen side by side.

An item is lit where its pixel's centre meets its triangle, and its light goes to the pixels that its samples count for. Weights of the
triangle's corners are computed in float64 from the corners as they were before snapping; all else in float32, about the eye. Materials,
textures and lights are those all backends share.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import lanes, lights, materials, simd, surface, textures
from .kernels import apart, helper, kernel
from .meshlets import RECORD, SHIFT, place_of
from .records import Lane, Surface, Vec

FLAT = int(ir.Shading.FLAT)
REACH = 2  # pixels on each side that a filter may reach
SIDE = 2 * REACH + 1


class Look(NamedTuple):
    """Where things are seen from."""

    direction: NDArray[np.float32]  # (3, 3) of rays at the picture's top left, and what a pixel right and a pixel down add to it
    place: NDArray[np.float32]  # (instances, 3, 4) from meshes' frames about their origins to the world about the eye


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
    """A thread's items of four rows of pixels, and room for their light. Of one sample a pixel, blocks that are
    seen whole stand in front, sixteen by sixteen; with more, all are in the order of pixels, in which their light is added up."""

    ids: NDArray[np.int32]
    x: NDArray[np.int32]
    y: NDArray[np.int32]
    samples: NDArray[np.int32]  # bits: which of the pixel's samples see it
    at_x: NDArray[np.int32]  # where it is shaded, in 1/256 pixel
    at_y: NDArray[np.int32]
    light: NDArray[np.float32]  # (16, 4), item k at place_of(k): rows of four items
    counts: NDArray[np.int64]  # (3,) of items in whole blocks, of others, which stand from `half` on, and of what was not finite
    half: int
    plane: NDArray[np.float64]  # (12,) of the triangle that filled all lanes last: slot, instance, and `_planes`


def items_for(columns: int, samples: int) -> Items:
    """Room for what four rows of so many pixels can show."""
    half = ((columns + 3) & ~3) * 4 * samples + 16
    ids, x, y, bits, at_x, at_y = (simd.aligned_empty(2 * half, np.int32) for _ in range(6))
    return Items(ids, x, y, bits, at_x, at_y, simd.aligned_empty((16, 4), np.float32), np.zeros(3, np.int64), half, np.full(12, -1.0))


@apart
def collect(pattern, each, band, row, items):
    """The items of a row of blocks: with `each`, one for each sample."""
    samples = len(pattern.x)
    columns = band.place[2] >> 2
    lane = simd.iota(simd.i32x16(0))
    y = (lane >> 2) + (band.place[1] + 4 * row)
    inside_y = (y >= band.clip[1]) & (y < band.clip[3])
    whole, part = 0, items.half
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
            bits = simd.i32x16(1 << s)
            for t in range(s + 1, s + 1 if each else samples):
                bits = simd.select(ids == simd.load_aligned(band.ids, at + 16 * t, simd.i32x16), bits | (1 << t), bits)
            at_x, at_y = (x << 8) + (pattern.x[s] if each else 128), (y << 8) + (pattern.y[s] if each else 128)
            if samples == 1 and simd.all_of(seen):
                simd.store_aligned(items.at_x, whole, at_x)
                simd.store_aligned(items.at_y, whole, at_y)
                simd.store_aligned(items.x, whole, x)
                simd.store_aligned(items.y, whole, y)
                simd.store_aligned(items.ids, whole, ids)
                simd.store_aligned(items.samples, whole, bits)
                whole += 16
            else:
                simd.compress_store(items.at_x, part, at_x, seen)
                simd.compress_store(items.at_y, part, at_y, seen)
                simd.compress_store(items.x, part, x, seen)
                simd.compress_store(items.y, part, y, seen)
                simd.compress_store(items.samples, part, bits, seen)
                part += simd.compress_store(items.ids, part, ids, seen)
    items.counts[0], items.counts[1] = whole, part - items.half


@kernel
def shade_band(shown, pattern, each, meshlets, drawn, tables, look, splat, band, items, crop, rgba):
    """Light what a band shows and add it to the picture, (h, w, 4), of the pixels of `crop`."""
    saved = simd.flush_denormals()
    items.counts[2] = 0
    for row in range(band.place[3] >> 2):
        collect(pattern, each, band, row, items)
        for k in range(0, items.counts[0], 16):
            light_items(shown, meshlets, drawn, tables, look, items, k, 16)
            keep_items(pattern, splat, band, items, k, 16, True, crop, rgba)
        for k in range(0, items.counts[1], 16):
            count = min(items.counts[1] - k, 16)
            light_items(shown, meshlets, drawn, tables, look, items, items.half + k, count)
            keep_items(pattern, splat, band, items, items.half + k, count, False, crop, rgba)
    simd.restore_denormals(saved)


@apart
def keep_items(pattern, splat, band, items, start, count, block, crop, rgba):
    """Add the light of up to sixteen items to the picture; `block`: they are a whole block of pixels."""
    if len(pattern.x) > 1:
        splat_items(splat, band, items, start, count, crop, rgba)
    elif block:
        write_block(items, start, crop, rgba)
    else:
        write_items(items, start, count, crop, rgba)


@helper
def write_block(items: Any, start: int, crop: Any, rgba: Any) -> None:
    """The sixteen pixels of a block, of one sample each."""
    width = crop[2] - crop[0]
    place = ((items.y[start] - crop[1]) * width + items.x[start] - crop[0]) * 4
    for line in range(4):
        for k in range(4):
            simd.store(rgba, place + 4 * k, simd.load(items.light, 16 * k + 4 * line, simd.f32x4))
        place += 4 * width


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


@apart
def light_items(shown, meshlets, drawn, tables, look, items, start, count):
    """The light of `count` items from `start` on, sixteen at the most, as r, g, b, 1 into items.light."""
    ids = simd.load(items.ids, start, simd.i32x16)
    there = simd.first_lanes(count, ids)
    ids = simd.select(there, ids, items.ids[start])
    x = simd.to_f32(simd.load(items.at_x, start, simd.i32x16)) * np.float32(1.0 / 256.0)
    y = simd.to_f32(simd.load(items.at_y, start, simd.i32x16)) * np.float32(1.0 / 256.0)
    row = ids >> SHIFT
    first = simd.lane(row, 0)
    if simd.all_of(row == first):
        instances, slot = simd.i32x16(drawn.instance[first]), ids + (drawn.first[first] - (first << SHIFT))
    else:
        instances, slot = drawn.instance[row], drawn.first[row] + (ids & ((1 << SHIFT) - 1))
    zero = simd.f32x16(0.0)
    red, green, blue = zero, zero, zero
    rest = there
    while simd.any_of(rest):
        i = simd.lane(instances, simd.trailing_zeros(simd.bits(rest)))
        here = rest & (instances == i)
        mine = simd.select(here, slot, simd.lane(slot, simd.trailing_zeros(simd.bits(here))))
        point, viewer = surface_of(shown, meshlets, tables, look, items.plane, i, mine, x, y)
        color = direct_light(tables, point, viewer, here)
        red, green, blue = simd.select(here, color[0], red), simd.select(here, color[1], green), simd.select(here, color[2], blue)
        rest = rest & ~here
    sound = simd.is_finite(red + green + blue)
    items.counts[2] += simd.count(there & ~sound)
    red, green, blue = simd.select(sound, red, 0.0), simd.select(sound, green, 0.0), simd.select(sound, blue, 0.0)
    rows = simd.transpose((red, green, blue, zero + 1.0))
    simd.store_aligned(items.light, 0, rows[0])
    simd.store_aligned(items.light, 16, rows[1])
    simd.store_aligned(items.light, 32, rows[2])
    simd.store_aligned(items.light, 48, rows[3])


@helper
def surface_of(shown: Any, meshlets: Any, tables: Any, look: Any, plane: Any, i: int, slot: Lane, x: Lane, y: Lane) -> tuple[Surface, Vec]:
    """The surface of instance i where triangles are seen through pixel coordinates, about the eye, and the direction to the eye."""
    one = simd.lane(slot, 0)
    alone = simd.all_of(slot == one)
    if alone:
        row = meshlets.corner[one, 3] + simd.i32x16(0)
        a, b, c = spread(meshlets, one, 0), spread(meshlets, one, 1), spread(meshlets, one, 2)
    else:
        corner = simd.gather_rows(meshlets.corner, slot << 2, 4)
        row = corner[3]
        a = simd.gather_rows(meshlets.record, corner[0] * RECORD, RECORD)
        b = simd.gather_rows(meshlets.record, corner[1] * RECORD, RECORD)
        c = simd.gather_rows(meshlets.record, corner[2] * RECORD, RECORD)
    e1, e2 = (b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2])
    if alone:
        u, v, turned = weights_in_plane(shown, meshlets, plane, i, one, x, y)
    else:
        u, v, turned = weights_of(shown, i, (a[0], a[1], a[2]), e1, e2, x, y)
    w = 1.0 - u - v

    g, transform, material = tables.instances.geometry[i], tables.instances.transform[i], tables.instances.material[i]
    matrix, inverse = tables.transforms.matrix, tables.transforms.inverse
    origin = tables.geometries.origin
    d = look.direction
    along = (d[0, 0] + x * d[1, 0] + y * d[2, 0], d[0, 1] + x * d[1, 1] + y * d[2, 1], d[0, 2] + x * d[1, 2] + y * d[2, 2])
    middle = (a[0] + u * e1[0] + v * e2[0], a[1] + u * e1[1] + v * e2[1], a[2] + u * e1[2] + v * e2[2])
    position = lanes.transform_point(look.place, i, middle)
    viewer = lanes.scale(along, -simd.reciprocal_sqrt(lanes.dot(along, along)))

    face = lanes.cross(e1, e2)
    normal = face
    if tables.materials.shading[material] != FLAT:
        n = (w * a[3] + u * b[3] + v * c[3], w * a[4] + u * b[4] + v * c[4], w * a[5] + u * b[5] + v * c[5])
        size = lanes.dot(n, n)
        n = lanes.scale(n, lanes.where(lanes.dot(n, face) < 0.0, -1.0, 1.0))
        normal = lanes.where3((size > 1e-24) & (size < np.inf), n, face)
    normal = lanes.transform_normal(inverse, transform, normal)
    front = turned if tables.transforms.flips[transform] else ~turned
    towards = simd.reciprocal_sqrt(lanes.dot(normal, normal))
    normal = lanes.scale(normal, lanes.where(front, towards, -towards))

    uv, metric, local, outward = (u, v), (u, v), face, face
    if textures.on(tables, material):
        local = (middle[0] + origin[g, 0], middle[1] + origin[g, 1], middle[2] + origin[g, 2])
        outward = lanes.normalize(face)
        uv = (w * a[6] + u * b[6] + v * c[6], w * a[7] + u * b[7] + v * c[7])
        stretch = surface.mean_scale(lanes.affine(matrix, transform))
        du, dv = surface.spans(e1, e2, b[6] - a[6], b[7] - a[7], c[6] - a[6], c[7] - a[7])
        metric = (du * stretch, dv * stretch)
    color = lanes.like3(u, 1.0, 1.0, 1.0)
    if tables.geometries.colors[g] >= 0:
        color = surface.attribute_at(tables, g, tables.geometries.colors[g], u, v, row)
    return Surface(position, local, normal, normal, outward, uv, metric, front, i, material, color, 0.0 * u, None), viewer


@helper
def spread(meshlets: Any, slot: int, corner: int) -> Any:
    """The record of one triangle's corner in all lanes."""
    row = meshlets.record[meshlets.corner[slot, corner]]
    zero = simd.f32x16(0.0)
    return (
        zero + row[0], zero + row[1], zero + row[2], zero + row[3], zero + row[4], zero + row[5], zero + row[6], zero + row[7],
    )  # fmt: skip


@helper
def weights_in_plane(shown: Any, meshlets: Any, plane: Any, i: int, slot: int, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane]:
    """As `weights_of`, of one triangle: areas are linear on the screen. They are taken in float64 at the first lane's place."""
    if plane[0] != slot or plane[1] != i:
        plane[0], plane[1] = slot, i
        _planes(shown, meshlets, i, slot, plane)
    x0, y0 = np.float64(simd.lane(x, 0)), np.float64(simd.lane(y, 0))
    dx, dy = x - simd.lane(x, 0), y - simd.lane(y, 0)
    eu = dx * plane[3] + (dy * plane[4] + (plane[2] + plane[3] * x0 + plane[4] * y0))
    ev = dx * plane[6] + (dy * plane[7] + (plane[5] + plane[6] * x0 + plane[7] * y0))
    area = dx * plane[9] + (dy * plane[10] + (plane[8] + plane[9] * x0 + plane[10] * y0))
    u, v, area = inside(eu, ev, area)
    return u, v, area > 0.0


@apart
def _planes(shown, meshlets, i, slot, plane):
    """Write c, a, b of c + a x + b y to plane[2:]: the areas that belong to a triangle's second and third corner, and the whole one.

    The cross of two corners' rows (X - x W, Y - y W) is X₁Y₂ - X₂Y₁ + x (W₂Y₁ - W₁Y₂) + y (X₂W₁ - X₁W₂). Scaled,
    so that float32 can hold them.
    """
    one, two, three = _row(shown, meshlets, i, slot, 0), _row(shown, meshlets, i, slot, 1), _row(shown, meshlets, i, slot, 2)
    first, second, third = _cross(two, three), _cross(three, one), _cross(one, two)
    for n in range(3):
        plane[2 + n], plane[5 + n], plane[8 + n] = second[n], third[n], first[n] + second[n] + third[n]
    largest = 1e-300
    for n in range(2, 11):
        largest = max(largest, abs(plane[n]))
    for n in range(2, 11):
        plane[n] /= largest


@helper
def _row(shown: Any, meshlets: Any, i: int, slot: int, corner: int) -> Vec:
    """X, Y, W of a triangle's corner."""
    m, at = shown.matrix, meshlets.corner[slot, corner]
    x, y, z = np.float64(meshlets.record[at, 0]), np.float64(meshlets.record[at, 1]), np.float64(meshlets.record[at, 2])
    w = m[i, 3, 0] * x + m[i, 3, 1] * y + m[i, 3, 2] * z + m[i, 3, 3] if shown.perspective else 1.0
    return m[i, 0, 0] * x + m[i, 0, 1] * y + m[i, 0, 2] * z + m[i, 0, 3], m[i, 1, 0] * x + m[i, 1, 1] * y + m[i, 1, 2] * z + m[i, 1, 3], w


@helper
def _cross(p: Vec, q: Vec) -> Vec:
    """c, a, b of the area that two corners make."""
    return p[0] * q[1] - q[0] * p[1], q[2] * p[1] - p[2] * q[1], q[0] * p[2] - p[0] * q[2]


@helper
def weights_of(shown: Any, i: int, a: Vec, e1: Vec, e2: Vec, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane]:
    """Weights of triangles' second and third corner at pixel coordinates, and whether they go clockwise on the screen.

    As raster.weights, from a corner and two edges: with A the corner's row (X - x W, Y - y W), E1 and E2 the edges' rows, weights are
    E2 × A, A × E1 and, in all, E1 × E2. The corner is taken to clip space in float64; edges are not long, and float32 will do for
    them, unless they go far along the axis.
    """
    low = about(shown, i, _low(a), simd.low_half(x), simd.low_half(y))
    high = about(shown, i, _high(a), simd.high_half(x), simd.high_half(y))
    ax, ay, depth = simd.joined(low[0], high[0]), simd.joined(low[1], high[1]), simd.joined(low[2], high[2])
    x1, y1, d1 = edge_about(shown, i, e1, x, y)
    x2, y2, d2 = edge_about(shown, i, e2, x, y)
    u, v, area = inside(x2 * ay - y2 * ax, ax * y1 - ay * x1, x1 * y2 - y1 * x2)
    steep = simd.maximum(abs(d1), abs(d2)) > depth * np.float32(0.25)
    if shown.perspective and simd.any_of(steep):
        low = exact(shown, i, _low(a), _low(e1), _low(e2), simd.low_half(x), simd.low_half(y))
        high = exact(shown, i, _high(a), _high(e1), _high(e2), simd.high_half(x), simd.high_half(y))
        u, v = simd.select(steep, simd.joined(low[0], high[0]), u), simd.select(steep, simd.joined(low[1], high[1]), v)
        area = simd.select(steep, simd.joined(low[2], high[2]), area)
    return u, v, area > 0.0


@helper
def inside(eu: Lane, ev: Lane, area: Lane) -> Vec:
    """Weights made from areas, brought inside where a sample is just outside, and the whole area; 0, 0 where it is none."""
    turn = simd.select(area < 0.0, -1.0, 1.0)
    ew = simd.maximum(turn * (area - eu - ev), 0.0)
    eu, ev = simd.maximum(turn * eu, 0.0), simd.maximum(turn * ev, 0.0)
    total = eu + ev + ew
    scale = simd.select(total > 0.0, 1.0 / total, 0.0)
    return eu * scale, ev * scale, area


@helper
def exact(shown: Any, i: int, a: Vec, e1: Vec, e2: Vec, x: Lane, y: Lane) -> Any:
    """The same in float64."""
    x0, y0, _ = about64(shown, i, a, x, y)
    x1, y1, _ = about64(shown, i, lanes.add(a, e1), x, y)
    x2, y2, _ = about64(shown, i, lanes.add(a, e2), x, y)
    ew, eu, ev = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
    u, v, area = inside(eu, ev, ew + eu + ev)
    return simd.to_f32(u), simd.to_f32(v), simd.to_f32(area)


@helper
def about(shown: Any, i: int, p: Vec, x: Lane, y: Lane) -> Vec:
    """(X - x W, Y - y W, D) of points in clip space, in float32."""
    cx, cy, d = about64(shown, i, p, x, y)
    return simd.to_f32(cx), simd.to_f32(cy), simd.to_f32(d)


@helper
def about64(shown: Any, i: int, p: Vec, x: Lane, y: Lane) -> Vec:
    """(X - x W, Y - y W, D) of points in clip space."""
    m = shown.matrix
    d = m[i, 3, 0] * p[0] + m[i, 3, 1] * p[1] + m[i, 3, 2] * p[2] + m[i, 3, 3]
    w = d if shown.perspective else simd.f64x8(1.0)
    cx = m[i, 0, 0] * p[0] + m[i, 0, 1] * p[1] + m[i, 0, 2] * p[2] + m[i, 0, 3] - simd.to_f64(x) * w
    cy = m[i, 1, 0] * p[0] + m[i, 1, 1] * p[1] + m[i, 1, 2] * p[2] + m[i, 1, 3] - simd.to_f64(y) * w
    return cx, cy, d


@helper
def edge_about(shown: Any, i: int, e: Vec, x: Lane, y: Lane) -> Vec:
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


@helper
def direct_light(tables: Any, point: Surface, viewer: Vec, here: Lane) -> Vec:
    """Emission, ambient light and that of lamps without extent and without shadows: integrate.local_light for what needs no more."""
    shader = materials.at(tables, point)
    zero = 0.0 * point.offset
    shines = lanes.bool_like(zero, True)
    if tables.instances.light[point.instance] >= 0:
        shines = point.front
    total = lanes.where3(shines, lanes.add(shader.emission, (zero, zero, zero)), (zero, zero, zero))
    total = lanes.add(total, lanes.mul(shader.ambient, lights.ambient(tables)))
    for light in range(len(tables.lights.kind)):
        if tables.lights.kind[light] != lights.AMBIENT:
            arriving = lights.sample_sharp(tables, light, point.position)
            share = materials.reflected(shader, point.normal, arriving.direction, viewer)
            total = lanes.add(total, lanes.scale(lanes.mul(share, arriving.irradiance), 1.0 / np.pi))
    return total
