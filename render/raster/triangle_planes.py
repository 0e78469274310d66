"""Triangles that a band shows, as planes over the picture: made once for each of them, sixteen at a time, read by every pixel that sees it.

What is linear on a triangle, divided by the distance along the axis, is linear on the picture (Heckbert and Moreton 1991, Interpolation
for Polygon Texture Mapping). So a face's record holds, as c + a x + b y about a pixel near it: its normal in the world over that distance,
and one over that distance; with textures also coordinates and colours. Corners are those before snapping to fixed point.

Float32 will do for faces that are small on the picture and not steep. Large, steep, long and thin ones, and those on whose corners normals
go to different sides, are single: their corners' weights are computed in float64 where they are seen, and kept inside (single_faces.py).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..types import Lane, Vec
from .meshlets import SHIFT

PLAIN = 16  # floats of a record: c and a of normal and key; b of them, where x and y count from, side, instance
TEXTURED = 24  # with u and v
COLORED = 40  # with the metres they span, the triangle's own normal and the colour's planes, too
CACHED = 256  # single faces that are kept, a power of two
EVEN, PRECISE = 1.25, 2.0  # sizes of a record's side, else 1: where corners have one normal; where faces are by themselves


class PixelRays(NamedTuple):
    """Where things are seen from."""

    direction: NDArray[np.float32]  # (3, 3) of rays at the picture's top left, and what a pixel right and a pixel down add to it
    start: NDArray[np.float32]  # (3, 3) the same of where they start, about the eye
    local: NDArray[np.float32]  # (instances, 3, 4) from there to each instance's own frame


class PlaneCache(NamedTuple):
    """A thread's faces."""

    row: NDArray[np.int32]  # by id, where a face's record is, plus count[2]; less than that: nowhere
    owner: NDArray[np.int32]  # id
    record: NDArray[np.float32]  # (most, PLAIN, PICTURED or COLORED)
    count: NDArray[np.int64]  # (3,) records, how many of them are made, and how many there were before they were forgotten
    precise: NDArray[np.float64]  # (KNOWN, 16) of the last single ones: id, 0, their corners' weights, and what `near` needs
    corners: NDArray[np.float32]  # (KNOWN, 48) what their corners hold


class Attributes(NamedTuple):
    """What lanes see of faces of one instance."""

    normal: Vec  # in the world, towards the viewer; of any length
    key: Lane  # one over the depth along the axis; of an orthographic camera, the depth
    facing: Lane  # > 0: from outside
    uv: tuple[Lane, Lane]
    metric: tuple[Lane, Lane]
    spread: Any  # how far u, v go a pixel to the right and below
    outward: Vec  # the triangle's own normal in the mesh's frame; of any length
    color: Vec


def plane_cache(visible: int, most: int, textured: bool, colored: bool) -> PlaneCache:
    """Room for `most` faces at a time, of `drawn` meshlets, and behind them for those of `near`."""
    most += CACHED
    record = simd.aligned_empty((most, COLORED if colored else TEXTURED if textured else PLAIN), np.float32)
    row, owner = np.full((visible + 1) << SHIFT, -1, np.int32), np.full(most + 16, -1, np.int32)
    return PlaneCache(row, owner, record, np.zeros(3, np.int64), np.full((CACHED, 16), -1.0), np.zeros((CACHED, 48), np.float32))


@helper
def clear(cache: Any) -> None:
    """Have none: ids may mean others from now on."""
    count = cache.count
    count[2] += count[0]
    count[0] = count[1] = 0
    if count[2] > 1 << 30:
        cache.row[:] = -1
        count[2] = 0
    cache.precise[:, 0] = -1.0


@helper
def reserve(cache: Any, most: int) -> None:
    """Have room for `most` more faces; older ones go if there is none."""
    if cache.count[0] + most > len(cache.record) - CACHED:
        clear(cache)


@helper
def find_row(cache: Any, number: int) -> int:
    """The face of an id, if need be a new one, to be made by `make_all`."""
    row = simd.read(cache.row, number) - cache.count[2]
    return row if row >= 0 else add_row(cache, number)


@helper
def add_row(cache: Any, number: int) -> int:
    """A new face for an id."""
    row = cache.count[0]
    simd.write(cache.row, number, row + cache.count[2])
    simd.write(cache.owner, row, number)
    cache.count[0] = row + 1
    return row


@helper
def find_rows(cache: Any, ids: Any, at: int, seen: Lane) -> Lane:
    """The faces of ids[at:] in the lanes that are `seen`."""
    numbers = simd.load_aligned(ids, at, simd.i32x16)
    rows = simd.gather(cache.row, numbers, seen) - cache.count[2]
    lacking = seen & (rows < 0)
    while simd.any_of(lacking):
        number = simd.read(ids, at + simd.trailing_zeros(simd.bits(lacking)))
        same = lacking & (numbers == number)
        rows = simd.select(same, add_row(cache, number), rows)
        lacking = lacking & ~same
    return rows


@helper
def gather_records(cache: Any, textured: Any, colored: Any, row: Lane) -> Any:
    """The columns of records."""
    at = row * cache.record.shape[1]
    first, second = simd.gather_rows(cache.record, at, 8), simd.gather_rows(cache.record, at, 8, 8)
    if textured is None:
        return first, second, first, first, first
    third = simd.gather_rows(cache.record, at, 8, 16)
    if colored is None:
        return first, second, third, first, first
    return first, second, third, simd.gather_rows(cache.record, at, 8, 24), simd.gather_rows(cache.record, at, 8, 32)


@helper
def broadcast_record(cache: Any, textured: Any, colored: Any, row: int) -> Any:
    """The same of one record in all lanes."""
    at = row * cache.record.shape[1]
    first, second = _broadcast(cache.record, at), _broadcast(cache.record, at + 8)
    if textured is None:
        return first, second, first, first, first
    if colored is None:
        return first, second, _broadcast(cache.record, at + 16), first, first
    return first, second, _broadcast(cache.record, at + 16), _broadcast(cache.record, at + 24), _broadcast(cache.record, at + 32)


@helper
def _broadcast(table: Any, at: int) -> Any:
    """Eight numbers in all lanes."""
    return (
        simd.f32x16(simd.read(table, at)), simd.f32x16(simd.read(table, at + 1)), simd.f32x16(simd.read(table, at + 2)),
        simd.f32x16(simd.read(table, at + 3)), simd.f32x16(simd.read(table, at + 4)), simd.f32x16(simd.read(table, at + 5)),
        simd.f32x16(simd.read(table, at + 6)), simd.f32x16(simd.read(table, at + 7)),
    )  # fmt: skip


@helper
def instances(record: Any) -> Lane:
    return simd.to_i32(record[1][7])


@helper
def are_precise(record: Any) -> Lane:
    """Which faces are computed by themselves, by single_faces.py."""
    return abs(record[1][6]) == PRECISE


@helper
def is_precise(cache: Any, row: int) -> bool:
    return abs(simd.read(cache.record, row * cache.record.shape[1] + 14)) == PRECISE


@helper
def is_flat(cache: Any, row: int) -> bool:
    """Whether the corners of a face that is not single have one normal."""
    return abs(simd.read(cache.record, row * cache.record.shape[1] + 14)) == EVEN


@helper
def interpolate(projection: Any, textured: Any, colored: Any, record: Any, at_x: Lane, at_y: Lane) -> Attributes:
    """What is seen of faces, not of single ones, at places in pixels: multiples of 1/256, which float32 has in pictures of up to 65,536."""
    first, second, t, r, q = record
    x, y = at_x - second[4], at_y - second[5]
    normal = (
        simd.fma(x, first[4], simd.fma(y, second[0], first[0])), simd.fma(x, first[5], simd.fma(y, second[1], first[1])),
        simd.fma(x, first[6], simd.fma(y, second[2], first[2])),
    )  # fmt: skip
    key = simd.fma(x, first[7], simd.fma(y, second[3], first[3]))
    zero = simd.f32x16(0.0)
    uv, metric, spread, outward, color = (zero, zero), (zero, zero), (zero, zero, zero, zero), normal, normal
    share, right, below = zero + 1.0, zero, zero  # one over what planes are divided by, and how that grows
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
