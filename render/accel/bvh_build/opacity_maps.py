"""Opacity maps of triangles: where a cut-out image makes a triangle opaque or absent, so that rays need not evaluate its opacity.

As opacity micromaps (Gruen, Benthin, Woop 2020, Sub-Triangle Opacity Masks for Faster Ray Tracing of Transparent Objects): each triangle
has a grid of cells over its barycentrics. A cell is OPAQUE or ABSENT where all texels that its points interpolate say so, and UNKNOWN
elsewhere: there the opacity is evaluated. So pictures do not change. Triangles with the same texture coordinates share a map.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiler import ir
from ...surface import interaction

UNKNOWN, OPAQUE, ABSENT = 0, 1, 2
SIZES = 64, 32, 16, 8, 4  # cells along an edge
MOST_CELLS = 1 << 22  # of all maps
MOST_TRIANGLES = 1 << 20  # with more, none has a map: a second for a million
EDGE = 1e-3  # texels by which the texels of a cell reach farther, for rounding
OPACITY = int(ir.Slot.OPACITY)

B8 = NDArray[np.uint8]
F64 = NDArray[np.float64]


class OpacityMaps(NamedTuple):
    """Maps of all triangles that have one."""

    first: NDArray[np.int64]  # (instances,) where its triangles begin in `of_triangle`, less its first triangle; NONE without maps
    of_triangle: NDArray[np.int32]  # map of each triangle
    cells: B8  # (maps · size · size) state by v, then u
    size: int  # cells along an edge


NONE = np.int64(np.iinfo(np.int64).min)


def build(tables: ir.Tables, partial: NDArray[np.bool_]) -> OpacityMaps:
    """Return the maps of the instances of `partial` that are meshes with coordinates and a repeated or clamped image as opacity."""
    instances, geometries = tables.instances, tables.geometries
    first = np.full(len(instances.geometry), NONE)
    g, material = instances.geometry, instances.material
    texture = tables.materials.textures[material, OPACITY]
    mapped = partial & (geometries.kind[g] == ir.GeometryKind.MESH) & (geometries.uvs[g] >= 0) & (geometries.triangle_count[g] > 0)
    mapped &= _has_image(tables)[texture] if len(tables.textures.kind) else False
    pairs, pair = np.unique(np.stack([g[mapped], material[mapped]]), axis=1, return_inverse=True)
    triangles = geometries.triangle_count[pairs[0]].astype(np.int64)
    count = int(triangles.sum())
    if not 0 < count <= MOST_TRIANGLES:
        return OpacityMaps(first, np.zeros(0, np.int32), np.zeros(0, np.uint8), SIZES[-1])
    start = geometries.first_triangle[pairs[0]].astype(np.int64)
    first[mapped] = (np.cumsum(triangles) - triangles - start)[pair.ravel()]
    corners = [_corner_uvs(tables, *(int(x) for x in mesh)) for mesh in zip(pairs[0], start, triangles, strict=True)]
    keys = np.column_stack([np.repeat(pairs[1], triangles), np.concatenate(corners)])
    unique, of_triangle = _unique_rows(keys)
    size = next((n for n in SIZES if len(unique) * n * n <= MOST_CELLS), 0)
    if not size:
        return OpacityMaps(np.full_like(first, NONE), np.zeros(0, np.int32), np.zeros(0, np.uint8), SIZES[-1])
    cells = np.zeros((len(unique), size, size), np.uint8)
    for row in np.unique(unique[:, 0]).astype(np.int64):
        chosen = unique[:, 0] == row
        cells[chosen] = _classify(tables, int(row), unique[chosen, 1:], size)
    return OpacityMaps(first, of_triangle.astype(np.int32), cells.ravel(), size)


def _unique_rows(keys: F64) -> tuple[F64, NDArray[np.int64]]:
    """(rows that differ, row of each) by a hash, a twentieth of np.unique's time; rows of equal hashes are compared."""
    factors = np.random.default_rng(1).integers(1 << 62, size=keys.shape[1], dtype=np.uint64) * np.uint64(2) + np.uint64(1)
    mixed = np.ascontiguousarray(keys).view(np.uint64) * factors
    mixed = ((mixed ^ (mixed >> np.uint64(29))) * factors[::-1]).sum(axis=1, dtype=np.uint64)
    _, first, row = np.unique(mixed, return_index=True, return_inverse=True)
    unique, row = keys[first], row.ravel()
    if np.array_equal(unique[row], keys):
        return unique, row
    unique, row = np.unique(keys, axis=0, return_inverse=True)
    return unique, row.ravel()


def _has_image(tables: ir.Tables) -> NDArray[np.bool_]:
    """(textures,) whether the texture is an image by coordinates that repeats or is clamped; the last row also serves row -1."""
    textures = tables.textures
    wraps = (ir.Wrap.REPEAT, ir.Wrap.CLAMP)
    fits = (textures.kind == ir.TextureKind.IMAGE) & (textures.mapping == ir.TextureMapping.UV) & (textures.image >= 0)
    fits &= np.isin(textures.wrap_u, wraps) & np.isin(textures.wrap_v, wraps)
    return np.append(fits, False)


def _corner_uvs(tables: ir.Tables, geometry: int, start: int, count: int) -> F64:
    """(count, 6) coordinates of the corners of a mesh's triangles."""
    triangle = np.arange(start, start + count)
    of, row = np.full(count, geometry), np.full(count, int(tables.geometries.uvs[geometry]))
    has = np.ones(count, np.bool_)
    return np.column_stack([x for k in range(3) for x in interaction.corner_uv(tables, of, row, triangle, k, has)]).astype(np.float64)


def _classify(tables: ir.Tables, material: int, corners: F64, size: int) -> B8:
    """(n, size, size) states of the cells of n triangles."""
    row = int(tables.materials.textures[material, OPACITY])
    textures = tables.textures
    image = int(textures.image[row])
    width, height = int(tables.images.width[image]), int(tables.images.height[image])
    sums = [_sums(texels) for texels in _certain(tables, material, row, image)]
    half = 0.0 if textures.nearest[row] else 0.5
    frame = textures.frame[row]
    s, t = (corners[:, 0::2] * frame[k, 0] + corners[:, 1::2] * frame[k, 1] + frame[k, 2] for k in range(2))
    spans = [
        _texels(s * width - half, width, size, bool(textures.wrap_u[row] == ir.Wrap.CLAMP)),
        _texels((1.0 - t) * height - half, height, size, bool(textures.wrap_v[row] == ir.Wrap.CLAMP)),
    ]
    (left, right), (above, below) = spans
    area = (right - left) * (below - above)
    opaque, absent = (a[below, right] - a[above, right] - a[below, left] + a[above, left] == area for a in sums)
    finite = np.isfinite(s).all(axis=1) & np.isfinite(t).all(axis=1)
    states = np.where(opaque, OPAQUE, np.where(absent, ABSENT, UNKNOWN)).astype(np.uint8)
    states[~finite] = UNKNOWN
    return states


def _certain(tables: ir.Tables, material: int, row: int, image: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(texels that are opaque, texels that are absent), (height, width)."""
    images, textures = tables.images, tables.textures
    width, height, first = int(images.width[image]), int(images.height[image]), int(images.first[image])
    channel = max(int(textures.channel[row]), 0)
    texels = images.texels[first : first + width * height, channel].reshape(height, width).astype(np.float64)
    value = tables.materials.values[material, OPACITY, 0] * (textures.gain[row, 0] * texels + textures.bias[row, 0])
    threshold = float(tables.materials.threshold[material])
    if threshold > 0.0:
        return value >= threshold + 1e-6, value < threshold - 1e-6
    return value >= 1.0, value <= 0.0


def _sums(texels: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(2 height + 1, 2 width + 1) counts above and to the left of each corner, of the image beside and above itself."""
    return np.pad(np.tile(texels, (2, 2)).astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))


def _texels(corners: F64, count: int, size: int, clamped: bool) -> tuple[Any, Any]:
    """(n, size, size) first texel, and the one after the last, that the cells of triangles interpolate along one axis."""
    origin, along = corners[:, 0], (corners[:, 1:] - corners[:, :1]) / size
    low = origin + np.minimum(along, 0.0).sum(axis=1) - EDGE
    spread = np.abs(along).sum(axis=1) + 2.0 * EDGE
    steps = np.arange(size)
    low = low[:, None, None] + along[:, 0, None, None] * steps + along[:, 1, None, None] * steps[:, None]
    first = np.floor(np.clip(np.nan_to_num(low), -1e9, 1e9)).astype(np.int64)
    last = np.floor(np.clip(np.nan_to_num(low + spread[:, None, None]), -1e9, 1e9)).astype(np.int64) + 1
    if clamped:
        return np.clip(first, 0, count - 1), np.clip(last, 0, count - 1) + 1
    length = np.minimum(last - first + 1, count)
    first = first % count
    return first, first + length
