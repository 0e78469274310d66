"""Texture mapping, and values of images, checkers, stripes, patterns and texture graphs.

The net of the box mapping, seen from outside with y up, as on a folded cube:

              +------+
              |  +y  |
       +------+------+------+------+
       |  -x  |  +z  |  +x  |  -z  |
       +------+------+------+------+
              |  -y  |
              +------+
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...compiler import ir
from ..jit.kernel import helper, separate_helper
from ..lanes import ops
from ..simd.registration import overload, types
from ..types import Lane, Surface, Tables, Vec
from . import checker_filter, graphs, pixel_mean, procedural
from .image_lookup import Rgba, look_up, look_up_level

UV = int(ir.TextureMapping.UV)
LATLONG = int(ir.TextureMapping.LATLONG)
PROJECTED = int(ir.TextureMapping.PROJECTED)
BOX = int(ir.TextureMapping.BOX)
NET = int(ir.TextureMapping.NET)
IMAGE = int(ir.TextureKind.IMAGE)
MAX_SAMPLES = 16.0  # samples along the long axis of a footprint, at most
_FARTHEST = 1e12  # coordinates beyond this count as 0: they have no fraction left


class Spot(NamedTuple):
    """The parts of a Surface that textures read."""

    local: Vec
    local_normal: Vec
    uv: tuple[Lane, Lane]
    metric: tuple[Lane, Lane]
    instance: Lane
    spread: Any


@helper
def value(tables: Tables, texture: Lane, surface: Surface) -> Vec:
    """The color of each lane's texture (row of Textures) at a surface point; rows < 0 read row 0."""
    spot = Spot(surface.local, surface.local_normal, surface.uv, surface.metric, surface.instance, surface.spread)
    return _value(tables, texture, spot)


@separate_helper
def _value(tables: Tables, texture: Lane, surface: Spot) -> Vec:
    textures = tables.textures
    row = ops.maximum(texture, 0)
    u, v, du, dv = texture_coordinates(tables, row, surface)
    frame = textures.frame
    s = frame[row, 0, 0] * u + frame[row, 0, 1] * v + frame[row, 0, 2]
    t = frame[row, 1, 0] * u + frame[row, 1, 1] * v + frame[row, 1, 2]
    s = ops.where(ops.absolute(s) < _FARTHEST, s, 0.0)
    t = ops.where(ops.absolute(t) < _FARTHEST, t, 0.0)
    spans = _spans(tables, row, (u, v), surface)
    kind, zero = textures.kind[row], 0.0 * s
    texel = (zero, zero, zero, zero + 1.0)
    if ops.any_lane((kind != IMAGE) & (kind != procedural.FORMULA)):
        red, green, blue = checker_filter.color(tables, row, s, t, du, dv, _if_cells(tables, spans))
        texel = (red, green, blue, texel[3])
    if ops.any_lane(kind == IMAGE):
        picture = _image(tables, row, s, t, _if_pictures(tables, spans))
        texel = (
            ops.where(kind == IMAGE, picture[0], texel[0]), ops.where(kind == IMAGE, picture[1], texel[1]),
            ops.where(kind == IMAGE, picture[2], texel[2]), ops.where(kind == IMAGE, picture[3], texel[3]),
        )  # fmt: skip
    if ops.any_lane(kind == procedural.FORMULA):
        r, g, b = _formulas(tables, row, surface)
        formed = kind == procedural.FORMULA
        texel = (ops.where(formed, r, texel[0]), ops.where(formed, g, texel[1]), ops.where(formed, b, texel[2]), texel[3])
    channel = textures.channel[row]
    single = ops.where(channel == 0, texel[0], ops.where(channel == 1, texel[1], ops.where(channel == 2, texel[2], texel[3])))
    color = ops.where3(channel < 0, (texel[0], texel[1], texel[2]), (single, single, single))
    gain, bias = textures.gain, textures.bias
    return (
        gain[row, 0] * color[0] + bias[row, 0],
        gain[row, 1] * color[1] + bias[row, 1],
        gain[row, 2] * color[2] + bias[row, 2],
    )


def _formulas(tables: Any, row: Lane, surface: Spot) -> Vec:
    """The color of patterns, filtered over the footprint; in scenes with texture graphs, of these too."""
    spread = _if_formulas(tables, surface.spread)
    if graphs.are_linked(tables):
        return graphs.evaluate_filtered(tables, row, surface, spread)
    return procedural.evaluate_filtered(tables, row, surface.local, spread)


@overload(_formulas)
def _formulas_in_kernels(tables, row, surface):
    if tables.field("textures.lookups") is not None:
        return lambda tables, row, surface: graphs.evaluate_filtered(tables, row, surface, _if_formulas(tables, surface.spread))
    return lambda tables, row, surface: procedural.evaluate_filtered(tables, row, surface.local, _if_formulas(tables, surface.spread))


@helper
def has_texture(tables: Tables, material: Lane) -> Lane:
    """Whether a material has a texture in any slot."""
    return tables.materials.textured[material]


# --- mappings -----------------------------------------------------------------------------------------------------------


@helper
def texture_coordinates(tables: Tables, row: Lane, surface: Spot | Surface) -> tuple[Lane, Lane, Lane, Lane]:
    """(u, v, metres per u, metres per v) by the texture's mapping."""
    mapping = tables.textures.mapping[row]
    u, v = surface.uv
    du, dv = surface.metric
    round_ = (mapping == LATLONG) | (mapping == PROJECTED)
    if ops.any_lane(round_):
        x, y, z = ops.normalize(surface.local)
        latlong = mapping == LATLONG
        size = ops.length(surface.local)
        u = ops.where(round_, ops.where(latlong, 0.5 + ops.atan2(x, z) / (2.0 * math.pi), x), u)
        v = ops.where(round_, ops.where(latlong, 0.5 + ops.asin(y) / math.pi, y), v)
        du = ops.where(round_, ops.where(latlong, 2.0 * math.pi * size, size), du)
        dv = ops.where(round_, ops.where(latlong, math.pi * size, size), dv)
    boxed = (mapping == BOX) | (mapping == NET)
    if ops.any_lane(boxed):
        bu, bv, bdu, bdv, column, line = _box_face(tables, surface)
        net = mapping == NET
        u = ops.where(boxed, ops.where(net, (column + bu) / 4.0, bu), u)
        v = ops.where(boxed, ops.where(net, (line + bv) / 3.0, bv), v)
        du = ops.where(boxed, ops.where(net, 4.0 * bdu, bdu), du)
        dv = ops.where(boxed, ops.where(net, 3.0 * bdv, bdv), dv)
    return u, v, du, dv


@helper
def _box_face(tables: Tables, surface: Spot | Surface) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    """(u, v, lengths, column, row from below in the net) on the side of the bounding box that the normal faces."""
    g = tables.instances.geometry[surface.instance]
    bounds = tables.geometries.bounds
    x, dx = _along_side(surface.local[0], bounds[g, 0, 0], bounds[g, 1, 0])
    y, dy = _along_side(surface.local[1], bounds[g, 0, 1], bounds[g, 1, 1])
    z, dz = _along_side(surface.local[2], bounds[g, 0, 2], bounds[g, 1, 2])
    nx, ny, nz = surface.local_normal
    ax, ay, az = ops.absolute(nx), ops.absolute(ny), ops.absolute(nz)
    on_y = (ay >= ax) & (ay >= az)
    on_x = ops.not_(on_y) & (ax > az)
    on_z = ops.not_(on_y) & ops.not_(on_x)
    u = ops.where(on_x, ops.where(nx > 0.0, 1.0 - z, z), ops.where(on_z & (nz < 0.0), 1.0 - x, x))
    v = ops.where(on_y, ops.where(ny > 0.0, 1.0 - z, z), y)
    column = ops.where(on_x, ops.where(nx > 0.0, 2.0, 0.0), ops.where(on_z & (nz < 0.0), 3.0, 1.0))
    line = ops.where(on_y, ops.where(ny > 0.0, 2.0, 0.0), 1.0)
    return u, v, ops.where(on_x, dz, dx), ops.where(on_y, dz, dy), column, line


@helper
def _along_side(p: Lane, low: Lane, high: Lane) -> tuple[Lane, Lane]:
    """(position of p between two bounds, 0 to 1; their distance); (p, 1) without bounds or distance."""
    size = high - low
    bounded = (size > 0.0) & ops.is_finite(size)
    return ops.where(bounded, (p - low) / ops.where(bounded, size, 1.0), p), ops.where(bounded, size, 1.0)


# --- footprints -------------------------------------------------------------------------------------------------


def _gate(what: str) -> Any:
    """A function of (tables, spans) that returns spans, or None where this kind of texture is not filtered."""

    def gate(tables: Any, spans: Any) -> Any:
        return spans if hasattr(getattr(tables.images, "footprint", None), what) else None

    @overload(gate)
    def gate_in_kernels(tables, spans):
        if tables.field(f"images.footprint.{what}") is not None:
            return lambda tables, spans: spans
        return lambda tables, spans: None

    return gate


def _if_formulas(tables: Any, spread: Any) -> Any:
    """Surface.spread, with changes of the position 0 or None where patterns are not filtered."""
    has_places = spread is not None and len(spread) >= pixel_mean.WITH_PLACES
    return _spread_of_formulas(tables, spread) if has_places and hasattr(getattr(tables.images, "footprint", None), "formulas") else None


@overload(_if_formulas)
def _if_formulas_in_kernels(tables, spread):
    has_places = isinstance(spread, types.BaseTuple) and len(spread) >= pixel_mean.WITH_PLACES
    if has_places and tables.field("images.footprint.formulas") is not None:
        return lambda tables, spread: _spread_of_formulas(tables, spread)
    return lambda tables, spread: None


@helper
def _spread_of_formulas(tables: Any, spread: Any) -> Any:
    used = tables.images.footprint.formulas
    right, down = (spread[4] * used, spread[5] * used, spread[6] * used), (spread[7] * used, spread[8] * used, spread[9] * used)
    return (spread[0], spread[1], spread[2], spread[3], *right, *down)


_if_cells, _if_pictures = _gate("cells"), _gate("pictures")


def _spans(tables: Any, row: Lane, uv: tuple[Lane, Lane], surface: Spot) -> Any:
    """Change of a texture's s and t along the two sides of the footprint, (s, t, s, t); None without one."""
    if surface.spread is None:
        return None
    with_places = len(surface.spread) >= pixel_mean.WITH_PLACES
    return _texture_spans(tables, row, _coordinate_spans(tables, row, uv, surface) if with_places else surface.spread)


@overload(_spans)
def _spans_in_kernels(tables, row, uv, surface):
    spread = dict(zip(surface.fields, surface.types, strict=True))["spread"]
    if not isinstance(spread, types.BaseTuple):
        return lambda tables, row, uv, surface: None
    if len(spread) >= pixel_mean.WITH_PLACES:
        return lambda tables, row, uv, surface: _texture_spans(tables, row, _coordinate_spans(tables, row, uv, surface))
    return lambda tables, row, uv, surface: _texture_spans(tables, row, surface.spread)


@helper
def _texture_spans(tables: Any, row: Lane, spread: Any) -> tuple[Lane, Lane, Lane, Lane]:
    frame = tables.textures.frame
    return (
        frame[row, 0, 0] * spread[0] + frame[row, 0, 1] * spread[1], frame[row, 1, 0] * spread[0] + frame[row, 1, 1] * spread[1],
        frame[row, 0, 0] * spread[2] + frame[row, 0, 1] * spread[3], frame[row, 1, 0] * spread[2] + frame[row, 1, 1] * spread[3],
    )  # fmt: skip


@helper
def _coordinate_spans(tables: Any, row: Lane, uv: tuple[Lane, Lane], surface: Spot) -> tuple[Lane, Lane, Lane, Lane]:
    """Change of u and v by the texture's mapping; mappings by position are evaluated again a pixel away."""
    spread = surface.spread
    u0, v0, u1, v1 = spread[0], spread[1], spread[2], spread[3]
    other = tables.textures.mapping[row] != UV
    if ops.any_lane(other):
        a0, b0 = _coordinate_change(tables, row, uv, surface, (spread[4], spread[5], spread[6]))
        a1, b1 = _coordinate_change(tables, row, uv, surface, (spread[7], spread[8], spread[9]))
        u0, v0 = ops.where(other, a0, u0), ops.where(other, b0, v0)
        u1, v1 = ops.where(other, a1, u1), ops.where(other, b1, v1)
    return u0, v0, u1, v1


@separate_helper
def _coordinate_change(tables: Any, row: Lane, uv: tuple[Lane, Lane], surface: Spot, way: Vec) -> tuple[Lane, Lane]:
    """Change of u and v along a displacement from a point in the instance's frame."""
    moved = Spot(ops.add(surface.local, way), surface.local_normal, surface.uv, surface.metric, surface.instance, None)
    u, v, _, _ = texture_coordinates(tables, row, moved)
    u, v = u - uv[0], v - uv[1]
    return ops.where(tables.textures.mapping[row] == LATLONG, u - ops.floor(u + 0.5), u), v  # latlong has a seam


# --- kinds --------------------------------------------------------------------------------------------------------------


@helper
def _image(tables: Tables, row: Lane, s: Lane, t: Lane, spans: Any) -> Rgba:
    """An image at s, t: nearest texel, or bilinear and, with a footprint, filtered over that."""
    textures = tables.textures
    image, wraps = ops.maximum(textures.image[row], 0), (textures.wrap_u[row], textures.wrap_v[row])
    if spans is None:
        return look_up(tables, image, s, t, wraps[0], wraps[1], textures.nearest[row])
    return _over_pixel(tables, row, image, s, t, wraps, spans)


@separate_helper
def _over_pixel(tables: Any, row: Lane, image: Lane, s: Lane, t: Lane, wraps: Any, spans: Any) -> Rgba:
    """An image filtered over the ellipse of a pixel: samples along its long axis, in levels selected by the short one.

    There are up to MAX_SAMPLES. The samples' filters reach from end to end of the long axis; they coincide where the ellipse is a circle.
    """
    textures, images = tables.textures, tables.images
    nearest = textures.nearest[row]
    width, height = ops.to_float(images.width[image]), ops.to_float(images.height[image])
    smooth = ops.where(nearest, 0.0, 1.0)
    ax, ay, bx, by = spans[0] * width * smooth, spans[1] * height * smooth, spans[2] * width * smooth, spans[3] * height * smooth
    longest, shortest, x, y = ellipse(ax, ay, bx, by)
    unfiltered = look_up(tables, image, s, t, wraps[0], wraps[1], nearest)
    wide = longest > 1.0
    if not ops.any_lane(wide):
        return unfiltered
    count = -ops.floor(-ops.clip(longest / ops.maximum(shortest, 1.0), 1.0, MAX_SAMPLES))
    size = ops.maximum(ops.maximum(shortest, longest / count), 1.0)
    level = ops.log(size) * (1.0 / math.log(2.0))
    level = ops.minimum(level, ops.to_float(images.levels[image] - 1))
    low = ops.floor(level)
    share, lower = level - low, ops.to_int(low)
    upper = ops.minimum(lower + 1, ops.to_int(images.levels[image] - 1))
    zero = 0.0 * s
    red, green, blue, alpha = zero, zero, zero, zero
    step = (longest - size) / ops.maximum(count - 1.0, 1.0)
    k = 0
    while ops.any_lane(wide & (count > k)):
        along = (k - 0.5 * (count - 1.0)) * step
        at_s, at_t = s + along * x / width, t + along * y / height
        weight = ops.where(count > k, 1.0 / count, 0.0)
        near = look_up_level(tables, image, lower, at_s, at_t, wraps, nearest)
        far = near
        if ops.any_lane(share > 0.0):
            far = look_up_level(tables, image, upper, at_s, at_t, wraps, nearest)
        red, green = red + weight * ops.lerp(near[0], far[0], share), green + weight * ops.lerp(near[1], far[1], share)
        blue, alpha = blue + weight * ops.lerp(near[2], far[2], share), alpha + weight * ops.lerp(near[3], far[3], share)
        k += 1
    return (
        ops.where(wide, red, unfiltered[0]), ops.where(wide, green, unfiltered[1]), ops.where(wide, blue, unfiltered[2]),
        ops.where(wide, alpha, unfiltered[3]),
    )  # fmt: skip


@helper
def ellipse(ax: Lane, ay: Lane, bx: Lane, by: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(long axis, short axis, direction of the long axis) of the ellipse of a pixel with sides (ax, ay) and (bx, by)."""
    a, b, c = ax * ax + bx * bx, ax * ay + bx * by, ay * ay + by * by
    half = 0.5 * (a - c)
    root = ops.sqrt(half * half + b * b)
    x, y = ops.where(half >= 0.0, half + root, b), ops.where(half >= 0.0, b, root - half)
    x, y, _ = ops.normalize((x, y, 0.0 * x))
    longest = ops.sqrt(0.5 * (a + c) + root)
    return longest, ops.absolute(ax * by - ay * bx) / ops.maximum(longest, 1e-18), x, y
