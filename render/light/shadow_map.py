"""Shadow map lookup with percentage closer filtering (Williams 1978; Reeves, Salesin, Cook 1987).

A texel holds the key (1 / depth, or -depth) of the surface nearest to the light along the ray through its center. Each texel is compared
with the tangent plane of the shaded point, as keys of planes are linear in texel coordinates. So flat surfaces do not shadow themselves
at any slant, and the bias covers only the rounding of keys. Texels of the shaded instance itself, which may be curved, get an additional
bias of the filter's width. Sixteen texels are compared, with the weights of a 3 × 3 box under bilinear interpolation. `shadow_map_pass`
renders the maps.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import affine, ops
from ..surface import interaction
from ..types import Lane, Surface, Tables, Vec
from . import light_kinds

ROUNDING = 2.0**-21  # relative, of keys: float32 has 2⁻²⁴, and keys are rounded a few times
REACH = 2.0  # texels from a point to the farthest texel of its filter, minus half a texel


class Maps(NamedTuple):
    """The shadow maps of a scene.

    Matrices map world space to (X, Y, D): X / W and Y / W are texels, D is the depth, W = D for point lights and spotlights, and 1 for
    distant lights.
    """

    first: NDArray[np.int64]  # (lights,) row of the first map; -1: shadow rays instead
    count: NDArray[np.int64]  # (lights,) 1, or the 6 sides of a cube: -x, +x, -y, +y, -z, +z
    matrix: NDArray[np.float64]  # (maps, 3, 4)
    inverse: NDArray[np.float64]  # (maps, 3, 4) of the first three columns; the fourth is 0
    texel: NDArray[np.float64]  # (maps,) width in metres, at a depth of 1 for point lights and spotlights
    size: NDArray[np.int64]  # (maps,) texels a side
    start: NDArray[np.int64]  # (maps,) first texel
    key: NDArray[np.float32]  # larger is nearer; -inf: nothing
    instance: NDArray[np.int32]


@helper
def lit(maps: Any, tables: Tables, light: int, point: Surface) -> Lane:
    """Return the visibility of a light from a point, 0 to 1."""
    p, zero = interaction.shadow_origin(point), 0.0 * point.offset
    row = ops.int_like(zero, maps.first[light])
    cube = maps.count[light] == 6
    parallel = light_kinds.is_distant(tables.lights.kind[light])
    if cube:
        positions = tables.lights.position
        row = row + _side(ops.sub(p, (positions[light, 0] + zero, positions[light, 1] + zero, positions[light, 2] + zero)))
    projected = affine.transform_point12(affine.load12(maps.matrix, row), p)
    size = ops.to_float(maps.size[row])
    depth = projected[2]
    w = zero + 1.0 if parallel else depth
    ahead = w > 0.0
    safe = ops.where(ahead, w, 1.0)
    x, y = projected[0] / safe, projected[1] / safe
    inside = ahead & (x > 0.0) & (y > 0.0) & (x < size) & (y < size)
    x, y = ops.clip(x, 0.0, size), ops.clip(y, 0.0, size)
    # the plane through the point: m · (x, y, 1) / m · (px, py, 1) = depth / D, or m · (x, y, D) constant, with m = A⁻ᵀ n
    inverse, n = affine.load12(maps.inverse, row), point.geometric
    mx = n[0] * inverse[0] + n[1] * inverse[4] + n[2] * inverse[8]
    my = n[0] * inverse[1] + n[1] * inverse[5] + n[2] * inverse[9]
    mz = n[0] * inverse[2] + n[1] * inverse[6] + n[2] * inverse[10]
    key = -depth if parallel else 1.0 / safe
    steep = mz if parallel else depth * (mx * x + my * y + mz)
    steep = ops.where(abs(steep) > 1e-300, steep, 1e-300)
    right, down = mx / steep, my / steep
    wide = maps.texel[row] * (zero + 1.0 if parallel else key)  # a texel's width there, in keys
    rounding = ROUNDING * abs(key)
    first_column, first_row = ops.floor_int(x - 0.5) - 1, ops.floor_int(y - 0.5) - 1
    fx, fy = x - 0.5 - ops.to_float(first_column + 1), y - 0.5 - ops.to_float(first_row + 1)
    last = maps.size[row] - 1
    open_ = zero
    for j in range(4):
        ty = ops.minimum(ops.maximum(first_row + j, 0), last)
        wy = 1.0 - fy if j == 0 else (fy if j == 3 else zero + 1.0)
        for i in range(4):
            tx = ops.minimum(ops.maximum(first_column + i, 0), last)
            wx = 1.0 - fx if i == 0 else (fx if i == 3 else zero + 1.0)
            texel = maps.start[row] + ty * (last + 1) + tx
            nearest, whose = ops.to_float(maps.key[texel]), ops.to_int(maps.instance[texel])
            off_x, off_y = ops.to_float(tx) + 0.5 - x, ops.to_float(ty) + 0.5 - y
            plane = key + ops.clip(right * off_x + down * off_y, -0.5 * abs(key), 0.5 * abs(key))
            slack = rounding + ops.where(whose == point.instance, (REACH + 0.5) * wide, 0.0)
            open_ = open_ + wx * wy * ops.where(nearest > plane + slack, 0.0, 1.0)
    return ops.where(inside, open_ / 9.0, 1.0)


@helper
def _side(way: Vec) -> Lane:
    """The cube side, 0 to 5, that a direction points to."""
    ax, ay, az = abs(way[0]), abs(way[1]), abs(way[2])
    along_x, along_y = (ax >= ay) & (ax >= az), ay >= az
    of_x, of_y, of_z = ops.where(way[0] > 0.0, 1, 0), ops.where(way[1] > 0.0, 3, 2), ops.where(way[2] > 0.0, 5, 4)
    return ops.where(along_x, of_x, ops.where(along_y, of_y, of_z))
