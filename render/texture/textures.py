"""Texture mapping, wrap modes and lookup of images, checkers and stripes.

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
from .. import simd
from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..simd.registration import overload, types
from ..types import Lane, Surface, Tables, Vec
from . import checker_filter, procedural

UV = int(ir.TextureMapping.UV)
LATLONG = int(ir.TextureMapping.LATLONG)
PROJECTED = int(ir.TextureMapping.PROJECTED)
BOX = int(ir.TextureMapping.BOX)
NET = int(ir.TextureMapping.NET)
IMAGE = int(ir.TextureKind.IMAGE)
REPEAT = int(ir.Wrap.REPEAT)
CLAMP = int(ir.Wrap.CLAMP)
MIRROR = int(ir.Wrap.MIRROR)
BLACK = int(ir.Wrap.BLACK)
MAX_SAMPLES = 16.0  # samples along the long axis of a footprint, at most
_FARTHEST = 1e12  # coordinates beyond this count as 0: they have no fraction left

Rgba = tuple[Lane, Lane, Lane, Lane]


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


@noinline_helper
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
        r, g, b = procedural.evaluate_filtered(tables, row, surface.local, _if_formulas(tables, surface.spread))
        made = kind == procedural.FORMULA
        texel = (ops.where(made, r, texel[0]), ops.where(made, g, texel[1]), ops.where(made, b, texel[2]), texel[3])
    channel = textures.channel[row]
    single = ops.where(channel == 0, texel[0], ops.where(channel == 1, texel[1], ops.where(channel == 2, texel[2], texel[3])))
    color = ops.where3(channel < 0, (texel[0], texel[1], texel[2]), (single, single, single))
    gain, bias = textures.gain, textures.bias
    return (
        gain[row, 0] * color[0] + bias[row, 0],
        gain[row, 1] * color[1] + bias[row, 1],
        gain[row, 2] * color[2] + bias[row, 2],
    )


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
    known = spread is not None and len(spread) >= procedural.WITH_PLACES
    return _spread_of_formulas(tables, spread) if known and hasattr(getattr(tables.images, "footprint", None), "formulas") else None


@overload(_if_formulas)
def _if_formulas_in_kernels(tables, spread):
    known = isinstance(spread, types.BaseTuple) and len(spread) >= procedural.WITH_PLACES
    if known and tables.field("images.footprint.formulas") is not None:
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
    with_places = len(surface.spread) >= procedural.WITH_PLACES
    return _texture_spans(tables, row, _coordinate_spans(tables, row, uv, surface) if with_places else surface.spread)


@overload(_spans)
def _spans_in_kernels(tables, row, uv, surface):
    spread = dict(zip(surface.fields, surface.types, strict=True))["spread"]
    if not isinstance(spread, types.BaseTuple):
        return lambda tables, row, uv, surface: None
    if len(spread) >= procedural.WITH_PLACES:
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


@noinline_helper
def _coordinate_change(tables: Any, row: Lane, uv: tuple[Lane, Lane], surface: Spot, way: Vec) -> tuple[Lane, Lane]:
    """Change of u and v along a displacement from a point in the instance's frame."""
    there = Spot(ops.add(surface.local, way), surface.local_normal, surface.uv, surface.metric, surface.instance, None)
    u, v, _, _ = texture_coordinates(tables, row, there)
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


@noinline_helper
def _over_pixel(tables: Any, row: Lane, image: Lane, s: Lane, t: Lane, wraps: Any, spans: Any) -> Rgba:
    """An image filtered over the ellipse of a pixel: samples along its long axis, in levels selected by the short one.

    There are up to MAX_SAMPLES. The samples' filters reach from end to end of the long axis; they coincide where the ellipse is a circle.
    """
    textures, images = tables.textures, tables.images
    nearest = textures.nearest[row]
    width, height = ops.to_float(images.width[image]), ops.to_float(images.height[image])
    plain = ops.where(nearest, 0.0, 1.0)
    ax, ay, bx, by = spans[0] * width * plain, spans[1] * height * plain, spans[2] * width * plain, spans[3] * height * plain
    longest, shortest, x, y = ellipse(ax, ay, bx, by)
    whole = look_up(tables, image, s, t, wraps[0], wraps[1], nearest)
    wide = longest > 1.0
    if not ops.any_lane(wide):
        return whole
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
        near = _look_up_level(tables, image, lower, at_s, at_t, wraps, nearest)
        far = near
        if ops.any_lane(share > 0.0):
            far = _look_up_level(tables, image, upper, at_s, at_t, wraps, nearest)
        red, green = red + weight * ops.lerp(near[0], far[0], share), green + weight * ops.lerp(near[1], far[1], share)
        blue, alpha = blue + weight * ops.lerp(near[2], far[2], share), alpha + weight * ops.lerp(near[3], far[3], share)
        k += 1
    return (
        ops.where(wide, red, whole[0]), ops.where(wide, green, whole[1]), ops.where(wide, blue, whole[2]),
        ops.where(wide, alpha, whole[3]),
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


@helper
def look_up(tables: Tables, image: Lane, s: Lane, t: Lane, wrap_u: Lane, wrap_v: Lane, nearest: Lane) -> Rgba:
    """Row `image` of Images at s (right) and t (up), 0 to 1 over the image."""
    images = tables.images
    return _bilinear(tables, images.first[image], images.width[image], images.height[image], s, t, wrap_u, wrap_v, nearest)


@helper
def _look_up_level(tables: Any, image: Lane, level: Lane, s: Lane, t: Lane, wraps: Any, nearest: Lane) -> Rgba:
    """`look_up` in one level."""
    images = tables.images
    first, width, height = images.level_first[image, level], images.level_width[image, level], images.level_height[image, level]
    return _bilinear(tables, first, width, height, s, t, wraps[0], wraps[1], nearest)


@noinline_helper
def _bilinear(tables: Tables, first: Lane, width: Lane, height: Lane, s: Lane, t: Lane, wrap_u: Lane, wrap_v: Lane, nearest: Lane) -> Rgba:
    half = ops.where(nearest, 0.0, 0.5)
    x, y = s * width - half, (1.0 - t) * height - half
    x0, y0 = ops.floor_int(x), ops.floor_int(y)
    fx, fy = ops.where(nearest, 0.0, x - x0), ops.where(nearest, 0.0, y - y0)
    (a, in_a), (b, in_b) = _wrap_index(x0, width, wrap_u)
    (c, in_c), (d, in_d) = _wrap_index(y0, height, wrap_v)
    rows = (first + c * width + a, first + c * width + b, first + d * width + a, first + d * width + b)
    gx, gy = 1.0 - fx, 1.0 - fy
    if ops.any_lane((wrap_u == BLACK) | (wrap_v == BLACK)):
        fx, gx, fy, gy = fx * in_b, gx * in_a, fy * in_d, gy * in_c
    return mix_texels(tables.images.texels, rows, (gx * gy, fx * gy, gx * fy, fx * fy))


def mix_texels(texels: Any, rows: Rgba, weights: Rgba) -> Rgba:
    """The weighted sum of four texels."""
    r, g, b, a = ((weights[0] * texels[rows[0], c] + weights[1] * texels[rows[1], c])
                  + (weights[2] * texels[rows[2], c] + weights[3] * texels[rows[3], c]) for c in range(4))  # fmt: skip
    return r, g, b, a


@overload(mix_texels)
def _mix_texels_in_kernels(texels, rows, weights):
    if isinstance(rows[0], simd.Vector) and rows[0].bits == 32:

        return lambda texels, rows, weights: _mix_by_rows(texels, rows, weights)
    return lambda texels, rows, weights: (
        _mix(texels, rows, weights, 0), _mix(texels, rows, weights, 1), _mix(texels, rows, weights, 2), _mix(texels, rows, weights, 3)
    )  # fmt: skip


@helper
def _mix_by_rows(texels: Any, rows: Rgba, weights: Rgba) -> Rgba:
    """`mix_texels` by rows: a texel's four numbers are contiguous, usually followed by those of its right neighbor."""
    above, below = (weights[0], weights[1]), (weights[2], weights[3])
    if simd.all_of((rows[1] == rows[0] + 1) & (rows[3] == rows[2] + 1)):
        return _add(_pair(simd.gather_rows(texels, rows[0] << 2, 8), above), _pair(simd.gather_rows(texels, rows[2] << 2, 8), below))
    p, q = simd.gather_rows(texels, rows[0] << 2, 4), simd.gather_rows(texels, rows[1] << 2, 4)
    m, n = simd.gather_rows(texels, rows[2] << 2, 4), simd.gather_rows(texels, rows[3] << 2, 4)
    return _add(
        _pair((p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]), above), _pair((m[0], m[1], m[2], m[3], n[0], n[1], n[2], n[3]), below)
    )


@helper
def _pair(t: Any, weights: tuple[Lane, Lane]) -> Rgba:
    """The weighted sum of two adjacent texels."""
    a, b = weights
    return a * t[0] + b * t[4], a * t[1] + b * t[5], a * t[2] + b * t[6], a * t[3] + b * t[7]


@helper
def _add(p: Rgba, q: Rgba) -> Rgba:
    return p[0] + q[0], p[1] + q[1], p[2] + q[2], p[3] + q[3]


@helper
def _mix(texels: Any, rows: Rgba, weights: Rgba, channel: int) -> Lane:
    a, b = weights[0] * texels[rows[0], channel], weights[1] * texels[rows[1], channel]
    return (a + b) + (weights[2] * texels[rows[2], channel] + weights[3] * texels[rows[3], channel])


@helper
def _wrap_index(i: Lane, n: Lane, wrap: Lane) -> tuple[tuple[Lane, Lane], tuple[Lane, Lane]]:
    """Indices i and i + 1 wrapped to 0 … n-1, each with weight 1, or 0 outside of an image on black."""
    index, after = i, i + 1
    if ops.any_lane(wrap == MIRROR):
        index = ops.where(wrap == MIRROR, _mirror(i, n), index)
        after = ops.where(wrap == MIRROR, _mirror(i + 1, n), after)
    if ops.any_lane(wrap == REPEAT):
        rest = _remainder(i, n)
        index = ops.where(wrap == REPEAT, rest, index)
        after = ops.where(wrap == REPEAT, ops.where(rest + 1 < n, rest + 1, 0), after)
    last = n - 1
    inside = ops.where((i < 0) | (i > last), 0.0, 1.0), ops.where((i < -1) | (i + 1 > last), 0.0, 1.0)
    return (
        (ops.maximum(0, ops.minimum(index, last)), ops.where(wrap == BLACK, inside[0], 1.0)),
        (ops.maximum(0, ops.minimum(after, last)), ops.where(wrap == BLACK, inside[1], 1.0)),
    )


@helper
def _mirror(i: Lane, n: Lane) -> Lane:
    twice = _remainder(i, 2 * n)
    return ops.where(twice < n, twice, 2 * n - 1 - twice)


@helper
def _remainder(i: Lane, n: Lane) -> Lane:
    """i modulo n without integer division, which is not vectorized."""
    rest = i - ops.floor_int(ops.to_float(i) * (1.0 / ops.to_float(n))) * n
    return ops.where(rest < 0, rest + n, ops.where(rest >= n, rest - n, rest))
