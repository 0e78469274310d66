"""Attribute planes of visible triangles, cached by id, and their interpolation at pixels.

Attributes linear on a triangle are linear on the screen after division by the distance along the axis. Source: Heckbert and Moreton,
Interpolation for Polygon Texture Mapping, 1991. A triangle's record holds planes c + a x + b y relative to a pixel near it: of the world
normal and of 1, both over the distance; with textures also of coordinates and colours. Corners are those before snapping to fixed point.

Float32 is accurate enough for triangles that are small on the screen and not steep. Large, steep, long and thin triangles, and those whose
corner normals lie on different sides, are precise: float64 weights at each pixel, clamped to the triangle (precise_planes.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..types import Lane, Vec
from .meshlets import SHIFT

PLAIN = 16  # floats of a record: c and a of normal and key; b of them, origin x and y, facing, instance
TEXTURED = 24  # and planes of u and v
COLORED = 40  # and metres a unit of u and v, geometric normal, planes of the colour
KEY, KEY_X, KEY_Y, ORIGIN_X, ORIGIN_Y, FACING, INSTANCE, UV, METRIC, OUTWARD, COLOR = 3, 7, 11, 12, 13, 14, 15, 16, 22, 24, 27
"""Places of these floats in a record; a plane takes three."""
CACHED = 256  # precise triangles, a power of two
EVEN, PRECISE = 1.25, 2.0  # absolute value of a record's facing: corners have one normal; precise; else 1
ROWS, READY, CLEARED = range(3)  # of PlaneCache.count


class PixelRays(NamedTuple):
    """Camera rays, for positions relative to the eye."""

    direction: NDArray[np.float32]  # (3, 3) ray direction at the picture's top left; its differences to the next pixel right and below
    start: NDArray[np.float32]  # (3, 3) the same of ray origins, relative to the eye
    local: NDArray[np.float32]  # (instances, 3, 4) from the world relative to the eye to each instance's frame


class PlaneCache(NamedTuple):
    """A thread's cache of records."""

    row: NDArray[np.int32]  # by id: the record's row + count[2]; smaller values: none
    owner: NDArray[np.int32]  # the id of each row
    record: NDArray[np.float32]  # (most, PLAIN, TEXTURED or COLORED)
    count: NDArray[np.int64]  # (3,) rows, rows that are set up, rows before the last `clear`
    precise: NDArray[np.float64]  # (CACHED, 16) of precise triangles: id, 0, planes of weights, box of the block record
    corners: NDArray[np.float32]  # (CACHED, 48) attributes of their corners


class Attributes(NamedTuple):
    """Interpolated attributes at pixels, of triangles of one instance."""

    normal: Vec  # in the world, towards the viewer; not normalized
    key: Lane  # 1 / depth; orthographic: depth
    facing: Lane  # > 0: seen from outside
    uv: tuple[Lane, Lane]
    metric: tuple[Lane, Lane]
    spread: Any  # differences of u, v to the next pixel right and below
    outward: Vec  # geometric normal in the mesh's frame; not normalized
    color: Vec


def plane_cache(visible: int, most: int, textured: bool, colored: bool) -> PlaneCache:
    """A cache of `most` records, for ids of `drawn` meshlets, and of CACHED block records behind them."""
    most += CACHED
    record = simd.aligned_empty((most, COLORED if colored else TEXTURED if textured else PLAIN), np.float32)
    row, owner = np.full((visible + 1) << SHIFT, -1, np.int32), np.full(most + 16, -1, np.int32)
    return PlaneCache(row, owner, record, np.zeros(3, np.int64), np.full((CACHED, 16), -1.0), np.zeros((CACHED, 48), np.float32))


@helper
def clear(cache: Any) -> None:
    """Remove all records: ids change."""
    count = cache.count
    count[CLEARED] += count[ROWS]
    count[ROWS] = count[READY] = 0
    if count[CLEARED] > 1 << 30:
        cache.row[:] = -1
        count[CLEARED] = 0
    cache.precise[:, 0] = -1.0


@helper
def reserve(cache: Any, most: int) -> None:
    """Ensure capacity for `most` more records; clears the cache if it is full."""
    if cache.count[ROWS] + most > len(cache.record) - CACHED:
        clear(cache)


@helper
def find_row(cache: Any, number: int) -> int:
    """The row of an id's record; a new row is set up by `plane_setup.setup_planes`."""
    row = simd.read(cache.row, number) - cache.count[CLEARED]
    return row if row >= 0 else add_row(cache, number)


@helper
def add_row(cache: Any, number: int) -> int:
    """Add a row for an id."""
    row = cache.count[ROWS]
    simd.write(cache.row, number, row + cache.count[CLEARED])
    simd.write(cache.owner, row, number)
    cache.count[ROWS] = row + 1
    return row


@helper
def find_rows(cache: Any, ids: Any, start: int, seen: Lane) -> Lane:
    """The rows of records of ids[at:], in the lanes `seen`."""
    numbers = simd.load_aligned(ids, start, simd.i32x16)
    rows = simd.gather(cache.row, numbers, seen) - cache.count[CLEARED]
    lacking = seen & (rows < 0)
    while simd.any_of(lacking):
        number = simd.read(ids, start + simd.trailing_zeros(simd.bits(lacking)))
        same = lacking & (numbers == number)
        rows = simd.select(same, add_row(cache, number), rows)
        lacking = lacking & ~same
    return rows


@helper
def gather_records(cache: Any, textured: Any, colored: Any, row: Lane) -> Any:
    """The columns of records, in lanes."""
    offset = row * cache.record.shape[1]
    first, second = simd.gather_rows(cache.record, offset, 8), simd.gather_rows(cache.record, offset, 8, 8)
    if textured is None:
        return first, second, first, first, first
    third = simd.gather_rows(cache.record, offset, 8, 16)
    if colored is None:
        return first, second, third, first, first
    return first, second, third, simd.gather_rows(cache.record, offset, 8, 24), simd.gather_rows(cache.record, offset, 8, 32)


@helper
def broadcast_record(cache: Any, textured: Any, colored: Any, row: int) -> Any:
    """The columns of one record, equal in all lanes."""
    offset = row * cache.record.shape[1]
    first, second = broadcast8(cache.record, offset), broadcast8(cache.record, offset + 8)
    if textured is None:
        return first, second, first, first, first
    if colored is None:
        return first, second, broadcast8(cache.record, offset + 16), first, first
    return (
        first,
        second,
        broadcast8(cache.record, offset + 16),
        broadcast8(cache.record, offset + 24),
        broadcast8(cache.record, offset + 32),
    )


@helper
def broadcast8(table: Any, offset: int) -> Any:
    """Eight numbers, equal in all lanes."""
    return (
        simd.f32x16(simd.read(table, offset)), simd.f32x16(simd.read(table, offset + 1)), simd.f32x16(simd.read(table, offset + 2)),
        simd.f32x16(simd.read(table, offset + 3)), simd.f32x16(simd.read(table, offset + 4)), simd.f32x16(simd.read(table, offset + 5)),
        simd.f32x16(simd.read(table, offset + 6)), simd.f32x16(simd.read(table, offset + 7)),
    )  # fmt: skip


@helper
def instances(record: Any) -> Lane:
    """The instances of records."""
    return simd.to_i32(record[1][7])


@helper
def are_precise(record: Any) -> Lane:
    """Whether records are of precise triangles, by lane."""
    return abs(record[1][6]) == PRECISE


@helper
def is_precise(cache: Any, row: int) -> bool:
    """Whether a record is of a precise triangle."""
    return abs(simd.read(cache.record, row * cache.record.shape[1] + FACING)) == PRECISE


@helper
def is_flat(cache: Any, row: int) -> bool:
    """Whether the corners of a triangle, not a precise one, have one normal."""
    return abs(simd.read(cache.record, row * cache.record.shape[1] + FACING)) == EVEN


@helper
def interpolate(projection: Any, textured: Any, colored: Any, record: Any, at_x: Lane, at_y: Lane) -> Attributes:
    """Interpolate records, not precise ones, at positions in pixels: multiples of 1/256, exact in float32 up to 65,536 pixels."""
    first, second, t, r, q = record
    x, y = at_x - second[4], at_y - second[5]
    normal = (
        simd.fma(x, first[4], simd.fma(y, second[0], first[0])), simd.fma(x, first[5], simd.fma(y, second[1], first[1])),
        simd.fma(x, first[6], simd.fma(y, second[2], first[2])),
    )  # fmt: skip
    key = simd.fma(x, first[7], simd.fma(y, second[3], first[3]))
    zero = simd.f32x16(0.0)
    uv, metric, spread, outward, color = (zero, zero), (zero, zero), (zero, zero, zero, zero), normal, normal
    share, right, below = zero + 1.0, zero, zero  # reciprocal of the planes' denominator, and its differences
    if projection.perspective:
        share, right, below = simd.reciprocal(key), first[7], second[3]
    if textured is not None:
        uv = (simd.fma(x, t[1], simd.fma(y, t[2], t[0])) * share, simd.fma(x, t[4], simd.fma(y, t[5], t[3])) * share)
        metric = (t[6], t[7])
        spread = (
            (t[1] - uv[0] * right) * share, (t[4] - uv[1] * right) * share, (t[2] - uv[0] * below) * share, (t[5] - uv[1] * below) * share
        )  # fmt: skip
    if colored is not None:
        outward = (r[0], r[1], r[2])
        color = (
            simd.fma(x, r[4], simd.fma(y, r[5], r[3])) * share, simd.fma(x, r[7], simd.fma(y, q[0], r[6])) * share,
            simd.fma(x, q[2], simd.fma(y, q[3], q[1])) * share,
        )  # fmt: skip
    return Attributes(normal, key, second[6], uv, metric, spread, outward, color)
