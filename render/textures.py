"""Textures: where a surface point lies in one (mappings, wraps), and what it is there (images, checkers, stripes).

The net, seen from outside with y up; each face stands as a folded cube shows it:

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

from ..compiler import ir
from . import lanes, patterns
from .kernels import apart, helper
from .records import Lane, Surface, Tables, Vec

LATLONG = int(ir.Mapping_.LATLONG)
PROJECTED = int(ir.Mapping_.PROJECTED)
BOX = int(ir.Mapping_.BOX)
NET = int(ir.Mapping_.NET)
IMAGE = int(ir.TextureKind.IMAGE)
CHECKER = int(ir.TextureKind.CHECKER)
CLAMP = int(ir.Wrap.CLAMP)
MIRROR = int(ir.Wrap.MIRROR)
BLACK = int(ir.Wrap.BLACK)
CELLS = 8.0  # of a checker without a size, over u and over v
_FARTHEST = 1e12  # coordinates beyond this are taken as 0: they hold no fraction any more

Rgba = tuple[Lane, Lane, Lane, Lane]


@apart
def value(tables: Tables, texture: Lane, surface: Surface) -> Vec:
    """The colour of each lane's texture (row of Textures) at a surface point; rows < 0 give row 0's."""
    textures = tables.textures
    row = lanes.maximum(texture, 0)
    u, v, du, dv = place(tables, row, surface)
    frame = textures.frame
    s = frame[row, 0, 0] * u + frame[row, 0, 1] * v + frame[row, 0, 2]
    t = frame[row, 1, 0] * u + frame[row, 1, 1] * v + frame[row, 1, 2]
    s = lanes.where(lanes.absolute(s) < _FARTHEST, s, 0.0)
    t = lanes.where(lanes.absolute(t) < _FARTHEST, t, 0.0)
    kind = textures.kind[row]
    texel = _pattern(tables, row, s, t, du, dv)
    if lanes.any_lane(kind == IMAGE):
        picture = _image(tables, row, s, t)
        texel = (
            lanes.where(kind == IMAGE, picture[0], texel[0]), lanes.where(kind == IMAGE, picture[1], texel[1]),
            lanes.where(kind == IMAGE, picture[2], texel[2]), lanes.where(kind == IMAGE, picture[3], texel[3]),
        )  # fmt: skip
    if lanes.any_lane(kind == patterns.FORMULA):
        r, g, b = patterns.texel(tables, row, surface.local)
        made = kind == patterns.FORMULA
        texel = (lanes.where(made, r, texel[0]), lanes.where(made, g, texel[1]), lanes.where(made, b, texel[2]), texel[3])
    channel = textures.channel[row]
    single = lanes.where(channel == 0, texel[0], lanes.where(channel == 1, texel[1], lanes.where(channel == 2, texel[2], texel[3])))
    color = lanes.where3(channel < 0, (texel[0], texel[1], texel[2]), (single, single, single))
    gain, bias = textures.gain, textures.bias
    return (
        gain[row, 0] * color[0] + bias[row, 0],
        gain[row, 1] * color[1] + bias[row, 1],
        gain[row, 2] * color[2] + bias[row, 2],
    )


@helper
def on(tables: Tables, material: Lane) -> Lane:
    """Whether a material has a texture in any slot."""
    return tables.materials.textured[material]


# --- mappings -----------------------------------------------------------------------------------------------------------


@helper
def place(tables: Tables, row: Lane, surface: Surface) -> tuple[Lane, Lane, Lane, Lane]:
    """u, v by the texture's mapping, and the metres they span."""
    mapping = tables.textures.mapping[row]
    u, v = surface.uv
    du, dv = surface.metric
    round_ = (mapping == LATLONG) | (mapping == PROJECTED)
    if lanes.any_lane(round_):
        x, y, z = lanes.normalize(surface.local)
        latlong = mapping == LATLONG
        size = lanes.length(surface.local)
        u = lanes.where(round_, lanes.where(latlong, 0.5 + lanes.atan2(x, z) / (2.0 * math.pi), x), u)
        v = lanes.where(round_, lanes.where(latlong, 0.5 + lanes.asin(y) / math.pi, y), v)
        du = lanes.where(round_, lanes.where(latlong, 2.0 * math.pi * size, size), du)
        dv = lanes.where(round_, lanes.where(latlong, math.pi * size, size), dv)
    boxed = (mapping == BOX) | (mapping == NET)
    if lanes.any_lane(boxed):
        bu, bv, bdu, bdv, column, line = _box_face(tables, surface)
        net = mapping == NET
        u = lanes.where(boxed, lanes.where(net, (column + bu) / 4.0, bu), u)
        v = lanes.where(boxed, lanes.where(net, (line + bv) / 3.0, bv), v)
        du = lanes.where(boxed, lanes.where(net, 4.0 * bdu, bdu), du)
        dv = lanes.where(boxed, lanes.where(net, 3.0 * bdv, bdv), dv)
    return u, v, du, dv


@helper
def _box_face(tables: Tables, surface: Surface) -> tuple[Lane, Lane, Lane, Lane, Lane, Lane]:
    """u, v on the side of the bounding box the normal faces, the side's lengths, and its column and line (from below) in the net."""
    g = tables.instances.geometry[surface.instance]
    bounds = tables.geometries.bounds
    x, dx = _along_side(surface.local[0], bounds[g, 0, 0], bounds[g, 1, 0])
    y, dy = _along_side(surface.local[1], bounds[g, 0, 1], bounds[g, 1, 1])
    z, dz = _along_side(surface.local[2], bounds[g, 0, 2], bounds[g, 1, 2])
    nx, ny, nz = surface.local_normal
    ax, ay, az = lanes.absolute(nx), lanes.absolute(ny), lanes.absolute(nz)
    on_y = (ay >= ax) & (ay >= az)
    on_x = lanes.not_(on_y) & (ax > az)
    on_z = lanes.not_(on_y) & lanes.not_(on_x)
    u = lanes.where(on_x, lanes.where(nx > 0.0, 1.0 - z, z), lanes.where(on_z & (nz < 0.0), 1.0 - x, x))
    v = lanes.where(on_y, lanes.where(ny > 0.0, 1.0 - z, z), y)
    column = lanes.where(on_x, lanes.where(nx > 0.0, 2.0, 0.0), lanes.where(on_z & (nz < 0.0), 3.0, 1.0))
    line = lanes.where(on_y, lanes.where(ny > 0.0, 2.0, 0.0), 1.0)
    return u, v, lanes.where(on_x, dz, dx), lanes.where(on_y, dz, dy), column, line


@helper
def _along_side(p: Lane, low: Lane, high: Lane) -> tuple[Lane, Lane]:
    """Where p lies from 0 to 1 between two bounds, and their distance; p itself and 1 where there are none or no distance."""
    size = high - low
    bounded = (size > 0.0) & lanes.is_finite(size)
    return lanes.where(bounded, (p - low) / lanes.where(bounded, size, 1.0), p), lanes.where(bounded, size, 1.0)


# --- kinds --------------------------------------------------------------------------------------------------------------


@helper
def _pattern(tables: Tables, row: Lane, s: Lane, t: Lane, du: Lane, dv: Lane) -> Rgba:
    """Checkers and stripes, cells half open."""
    textures = tables.textures
    size = textures.size[row]
    sized = size > 0.0
    safe = lanes.where(sized, size, 1.0)
    across = lanes.floor_int(s * lanes.where(sized, du / safe, CELLS))
    up = lanes.floor_int(t * lanes.where(sized, dv / safe, CELLS))
    cell = lanes.where(textures.kind[row] == CHECKER, across + up, across)
    first = (cell & 1) == 0
    a, b = textures.color_a, textures.color_b
    one = lanes.full_like(s, 1.0)
    return (
        lanes.where(first, a[row, 0], b[row, 0]),
        lanes.where(first, a[row, 1], b[row, 1]),
        lanes.where(first, a[row, 2], b[row, 2]),
        one,
    )


@helper
def _image(tables: Tables, row: Lane, s: Lane, t: Lane) -> Rgba:
    """A picture at s, t: bilinear between pixel centres, or the nearest pixel."""
    textures = tables.textures
    return look_up(tables, lanes.maximum(textures.image[row], 0), s, t, textures.wrap_u[row], textures.wrap_v[row], textures.nearest[row])


@helper
def look_up(tables: Tables, image: Lane, s: Lane, t: Lane, wrap_u: Lane, wrap_v: Lane, nearest: Lane) -> Rgba:
    """Row `image` of Images at s (right) and t (up), 0 to 1 over the picture."""
    width, height = tables.images.width[image], tables.images.height[image]
    half = lanes.where(nearest, 0.0, 0.5)
    x, y = s * width - half, (1.0 - t) * height - half
    x0, y0 = lanes.floor_int(x), lanes.floor_int(y)
    fx, fy = lanes.where(nearest, 0.0, x - x0), lanes.where(nearest, 0.0, y - y0)
    a, in_a = _wrapped(x0, width, wrap_u)
    b, in_b = _wrapped(x0 + 1, width, wrap_u)
    c, in_c = _wrapped(y0, height, wrap_v)
    d, in_d = _wrapped(y0 + 1, height, wrap_v)
    first = tables.images.first[image]
    w_ac, w_bc = (1.0 - fx) * (1.0 - fy) * in_a * in_c, fx * (1.0 - fy) * in_b * in_c
    w_ad, w_bd = (1.0 - fx) * fy * in_a * in_d, fx * fy * in_b * in_d
    rows = (first + c * width + a, first + c * width + b, first + d * width + a, first + d * width + b)
    weights = (w_ac, w_bc, w_ad, w_bd)
    return (
        _mix(tables, rows, weights, 0), _mix(tables, rows, weights, 1), _mix(tables, rows, weights, 2), _mix(tables, rows, weights, 3),
    )  # fmt: skip


@helper
def _mix(tables: Tables, rows: Rgba, weights: Rgba, channel: int) -> Lane:
    texels = tables.images.texels
    a, b = weights[0] * texels[rows[0], channel], weights[1] * texels[rows[1], channel]
    return (a + b) + (weights[2] * texels[rows[2], channel] + weights[3] * texels[rows[3], channel])


@helper
def _wrapped(i: Lane, n: Lane, wrap: Lane) -> tuple[Lane, Lane]:
    """A pixel index brought into 0 … n-1, and 1 or, outside of a picture on black, 0."""
    repeated = i % n
    clamped = lanes.maximum(0, lanes.minimum(i, n - 1))
    twice = i % (2 * n)
    mirrored = lanes.where(twice < n, twice, 2 * n - 1 - twice)
    index = lanes.where(wrap == MIRROR, mirrored, lanes.where((wrap == CLAMP) | (wrap == BLACK), clamped, repeated))
    outside = (wrap == BLACK) & ((i < 0) | (i >= n))
    return index, lanes.where(outside, 0.0, 1.0)
