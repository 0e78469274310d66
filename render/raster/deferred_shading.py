"""Deferred shading of a band: each fragment of its visibility buffer once, sixteen side by side.

Light is computed in float32, relative to the eye; materials, textures and lights are shared with all backends. Values constant on an
instance, such as its material without textures, are looked up once and stay scalars. Some tens of fragments go through each step together;
an inner loop over fragments for each light keeps the processor busy, one long loop over all steps would stall it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...lights import AMBIENT, POINTS
from .. import simd
from ..jit.kernel import helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import affine, crosslane, ops
from ..light import light_samples, lights
from ..material import bsdf, principled
from ..material.shader import Shader, evaluate_shader
from ..surface import texture_footprint
from ..surface.interaction import replace_spread
from ..texture import textures
from ..types import Surface
from . import fragments, plane_setup, precise_planes, spans, triangle_planes
from .fragments import FULL, NOT_FINITE, PARTIAL, UNIFORM
from .shading_points import (
    CAPACITY,
    FACING,
    METRIC,
    NORMAL,
    OUTWARD,
    POSITION,
    RADIANCE,
    SPREAD,
    UV,
    VERTEX_COLOR,
    VIEWER,
    get1,
    get2,
    get3,
    put3,
    store_point,
)

MOST_POINTS = 17  # of sixteen fragments: one without lanes, and one for each where all are of precise triangles


def to_float32(tables: ir.Tables, eye: NDArray[np.float64]) -> ir.Tables:
    """Tables whose shading columns are float32; lights are relative to the eye."""

    def narrow(table: Any, *names: str) -> Any:
        """Convert columns to float32."""
        return table._replace(**{name: getattr(table, name).astype(np.float32) for name in names})

    sources = tables.lights._replace(position=tables.lights.position - eye)
    return tables._replace(
        materials=narrow(tables.materials, "values"),
        lights=narrow(sources, "color", "position", "direction", "cos_cone", "cos_full", "coefficients"),
        transforms=narrow(tables.transforms, "inverse"),
        textures=narrow(tables.textures, "frame", "color_a", "color_b", "gain", "bias"),
    )


class LightSources(NamedTuple):
    """Ambient light and point, spot and directional lights without shadows, in float32, relative to the eye."""

    ambient: NDArray[np.float32]  # (3,)
    row: NDArray[np.int32]  # (n,) of Lights
    far: NDArray[np.bool_]  # (n,) whether direction and irradiance are constant
    direction: NDArray[np.float32]  # (n, 3) of far lights
    color: NDArray[np.float32]  # (n, 3) irradiance over π, of far lights
    bare: bool  # shading needs neither position nor side: all lights are far, and no mesh is a light


def light_sources(tables: ir.Tables) -> LightSources:
    """The light sources of tables."""
    rows = np.flatnonzero(~ir.is_in(tables.lights.kind, AMBIENT)).astype(np.int32)
    near = ir.is_in(tables.lights.kind[rows], POINTS)
    direction, color = np.zeros((len(rows), 3), np.float32), np.zeros((len(rows), 3), np.float32)
    for k in np.flatnonzero(~near).tolist():
        arriving = light_samples.sample_sharp(tables, int(rows[k]), (np.zeros(1), np.zeros(1), np.zeros(1)))
        direction[k] = [c[0] for c in arriving.direction]
        color[k] = [c[0] / np.pi for c in arriving.irradiance]
    bare = not near.any() and bool((tables.instances.light < 0).all())
    return LightSources(np.array(lights.ambient(tables), np.float32), rows, ~near, direction, color, bare)


def shades_flat_runs(tables: ir.Tables, sources: LightSources, textured: bool) -> bool:
    """Whether flat triangles are shaded run by run: only far lights, no textures, no layered materials."""
    return sources.bare and not textured and not isinstance(tables.materials, principled.Layered)


class Shading(NamedTuple):
    """Inputs and buffers of `shade_band` in one thread: a Handle each."""

    projection: Handle
    pattern: Handle
    meshlets: Handle
    visible: Handle
    tables: Handle  # see `to_float32`
    sources: Handle
    rays: Handle
    splat: Handle
    band: Handle
    planes: Handle
    fragments: Handle
    points: Handle


@kernel
def shade_band(shading, per_sample, first_pass, textured, colored, flat_runs, crop, rgba):
    """Shade a band and add its light to the pixels of `crop` of the picture, (h, w, 4); `first_pass`: the picture is uninitialized.

    `shading` is a handle of Shading; `per_sample` as in fragments.build_fragments. `textured`, `colored` and `flat_runs` are True or None,
    see raster_scene.RasterScene.
    """
    splat, band, cache, buffer = shading.splat, shading.band, shading.planes, shading.fragments
    saved = simd.flush_denormals()
    buffer.counts[NOT_FINITE] = 0
    single_pixel = splat.single_pixel and not per_sample
    if first_pass and not single_pixel:
        fragments.clear_rows(rgba, band, crop, band.rows[0], band.rows[1])
    middle = fragments.mean_position(shading.pattern)
    shaded_instance, shader = -1, uniform_shader(shading.tables, 0)
    for row in range(band.window[3] >> 2):
        triangle_planes.reserve(cache, buffer.half)
        fragments.build_fragments(shading.pattern, per_sample, single_pixel, cache, band, row, buffer)
        plane_setup.setup_planes(shading, textured, colored)
        y = band.window[1] + 4 * row
        full_fragments, part, even = buffer.counts[FULL], buffer.counts[PARTIAL], buffer.counts[UNIFORM]
        full = single_pixel and full_fragments + 16 * even >= 4 * (crop[2] - crop[0])
        if single_pixel and not full:
            fragments.clear_rows(rgba, band, crop, y, y + 4)
        group, groups = 0, even + ((full_fragments + part + 15) >> 4)
        while group < groups:
            if group < even:
                start = group
                group, count = spans.interpolate_run(shading, textured, colored, flat_runs, group, y, middle)
                if flat_runs is not None and group == start:
                    i = spans.instance_of(shading, simd.read(buffer.blocks, group))
                    if i != shaded_instance:
                        shaded_instance, shader = i, uniform_shader(shading.tables, i)
                    group = spans.shade_flat_run(shading, shader, group, y, middle, crop, full, rgba)
                    continue
            else:
                group, count = interpolate_fragments(shading, textured, colored, group, groups)
            first = 0
            while first < count:
                i, last = shading.points.instance[first], first + 1
                while last < count and shading.points.instance[last] == i:
                    last += 1
                if i != shaded_instance:
                    shaded_instance, shader = i, uniform_shader(shading.tables, i)
                shade_points(shading, textured, colored, i, shader, first, last)
                first = last
            write_points(shading, count, y, crop, full, rgba)
    simd.restore_denormals(saved)


# --- interpolation --------------------------------------------------------------------------------------------------------------


@helper
def interpolate_fragments(shading: Any, textured: Any, colored: Any, group: int, groups: int) -> tuple[int, int]:
    """Interpolate the points of fragments from `group` on, up to CAPACITY; returns the next group and the number of points."""
    projection, cache, buffer = shading.projection, shading.planes, shading.fragments
    count = 0
    while group < groups and count <= CAPACITY - MOST_POINTS:
        start = fragments.fragment_start(buffer, group)
        rows = simd.load(buffer.rows, start, simd.i32x16)
        exists = simd.first_lanes(buffer.half + buffer.counts[PARTIAL] - start, rows)
        rows = simd.select(exists, rows, simd.read(buffer.rows, start))
        at_x = simd.to_f32(simd.load(buffer.at_x, start, simd.i32x16)) * np.float32(1.0 / 256.0)
        at_y = simd.to_f32(simd.load(buffer.at_y, start, simd.i32x16)) * np.float32(1.0 / 256.0)
        record = triangle_planes.gather_records(cache, textured, colored, rows)
        point = triangle_planes.interpolate(projection, textured, colored, record, at_x, at_y)
        instances, single = triangle_planes.instances(record), triangle_planes.are_precise(record)
        i = simd.lane(instances, 0)
        pending = single | (instances != i)
        store_point(shading, textured, colored, count, point, at_x, at_y, i, ~pending, group)
        count += 1
        while simd.any_of(pending):
            first = simd.trailing_zeros(simd.bits(pending))
            i, face = simd.lane(instances, first), simd.lane(rows, first)
            lanes, other = pending & (instances == i) & ~single, point
            if simd.bits(single) >> first & 1:
                lanes = pending & (rows == face)
                other = precise_planes.interpolate(shading, textured, colored, i, face, at_x, at_y)
            store_point(shading, textured, colored, count, other, at_x, at_y, i, lanes, group)
            count += 1
            pending = pending & ~lanes
        group += 1
    return group, count


# --- light ---------------------------------------------------------------------------------------------------------------


@noinline_helper
def uniform_shader(tables, i):
    """The shader of an instance, as scalars; meaningless for textured instances."""
    none = (0.0, 0.0, 0.0)
    surface = Surface(
        none, none, none, none, none, None, (1.0, 1.0), True, i, tables.instances.material[i], (1.0, 1.0, 1.0), 0.0, None, None, None,
        None, None,
    )  # fmt: skip
    return crosslane.narrow(evaluate_shader(tables, surface))


@helper
def shade_points(shading: Any, textured: Any, colored: Any, i: int, shader: Shader, first: int, last: int) -> None:
    """Shade the points first <= k < last of instance i; `shader` is its shader without textures."""
    if textured is not None:
        tables = shading.tables
        if textures.has_texture(tables, tables.instances.material[i]) or tables.geometries.colors[tables.instances.geometry[i]] >= 0:
            for k in range(first, last):
                direct_light(shading, evaluate_shader(tables, textured_surface(shading, colored, i, k)), i, k, k + 1)
            return
    direct_light(shading, shader, i, first, last)


@helper
def textured_surface(shading: Any, colored: Any, i: int, k: int) -> Surface:
    """Point k of instance i as a Surface, for texture lookups."""
    tables, points = shading.tables, shading.points
    normal, zero = get3(points, k, NORMAL), simd.f32x16(0.0)
    ones = zero + 1.0
    position, local, outward, color, metric = (zero, zero, zero), (zero, zero, zero), normal, (ones, ones, ones), (ones, ones)
    if colored is not None:
        position, outward = get3(points, k, POSITION), ops.normalize(get3(points, k, OUTWARD))
        local, metric = affine.transform_point(shading.rays.local, i, position), get2(points, k, METRIC)
        color = get3(points, k, VERTEX_COLOR)
    spread = (get1(points, k, SPREAD), get1(points, k, SPREAD + 1), get1(points, k, SPREAD + 2), get1(points, k, SPREAD + 3))
    uv, front, material = get2(points, k, UV), get1(points, k, FACING) > 0.0, tables.instances.material[i]
    point = Surface(position, local, normal, normal, outward, uv, metric, front, i, material, color, zero, None, None, None, None, None)
    return replace_spread(point, texture_footprint.of_pixel(tables, spread, point))


@helper
def direct_light(shading: Any, shader: Shader, i: int, first: int, last: int) -> None:
    """Add emission, ambient light and light sources without shadows to points: a subset of whitted.local_light."""
    points, sources = shading.points, shading.sources
    zero = simd.f32x16(0.0)
    ambient = ops.add(ops.mul(shader.ambient, (sources.ambient[0], sources.ambient[1], sources.ambient[2])), (zero, zero, zero))
    glow = ops.add(shader.emission, ambient)
    one_sided = shading.tables.instances.light[i] >= 0
    for k in range(first, last if one_sided or len(sources.row) == 0 else first):
        before = glow
        if one_sided:
            before = ops.where3(get1(points, k, FACING) > 0.0, glow, ambient)
        put3(points, k, RADIANCE, before)
    for source in range(len(sources.row)):
        c, d, summed = sources.color, sources.direction, one_sided or source > 0  # else the sum starts with the glow
        color = (simd.f32x16(c[source, 0]), simd.f32x16(c[source, 1]), simd.f32x16(c[source, 2]))
        direction = (simd.f32x16(d[source, 0]), simd.f32x16(d[source, 1]), simd.f32x16(d[source, 2]))
        far = sources.far[source]
        for k in range(first, last):
            if not far:
                arriving = light_samples.sample_sharp(shading.tables, sources.row[source], get3(points, k, POSITION))
                direction, color = arriving.direction, ops.scale(arriving.irradiance, np.float32(1.0 / np.pi))
            share = bsdf.reflected(shader, get3(points, k, NORMAL), direction, get3(points, k, VIEWER))
            before = glow
            if summed:
                before = get3(points, k, RADIANCE)
            put3(points, k, RADIANCE, ops.add(before, ops.mul(share, color)))


# --- output ----------------------------------------------------------------------------------------------------------


@helper
def write_points(shading: Any, count: int, y: int, crop: Any, full: bool, rgba: Any) -> None:
    """Write points to the picture; `y` is the first row of full blocks; `full`: all blocks are."""
    points, buffer = shading.points, shading.fragments
    k = 0
    while k < count:
        group, lanes = simd.read(points.group, k), simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0))
        color = get3(points, k, RADIANCE)
        red, green, blue = simd.select(lanes, color[0], 0.0), simd.select(lanes, color[1], 0.0), simd.select(lanes, color[2], 0.0)
        k += 1
        while k < count and simd.read(points.group, k) == group:  # other instances of the same sixteen fragments
            lanes, color = simd.mask_from_bits(simd.read(points.lanes, k), simd.f32x16(0.0)), get3(points, k, RADIANCE)
            red, green, blue = simd.select(lanes, color[0], red), simd.select(lanes, color[1], green), simd.select(lanes, color[2], blue)
            k += 1
        if group < buffer.counts[UNIFORM]:
            rows = fragments.to_rgba_rows(red, green, blue, 16, buffer)
            fragments.write_block(rows, simd.read(buffer.block_x, group), y, crop, full, rgba)
            continue
        start = fragments.fragment_start(buffer, group)
        if start < buffer.half:
            fragments.write_block(fragments.to_rgba_rows(red, green, blue, 16, buffer), simd.read(buffer.x, start), y, crop, full, rgba)
        else:
            fragment_count = min(buffer.half + buffer.counts[PARTIAL] - start, 16)
            fragments.store_fragment_light(buffer.light, fragments.to_rgba_rows(red, green, blue, fragment_count, buffer))
            fragments.resolve_fragments(shading.pattern, shading.splat, shading.band, buffer, start, fragment_count, crop, rgba)
