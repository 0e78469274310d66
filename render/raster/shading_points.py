"""Structure-of-arrays buffer of points to shade, sixteen lanes each: interpolation writes columns, each light reads them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit.kernel import helper
from ..lanes import ops
from ..surface import texture_footprint
from ..types import Lane, Vec
from . import triangle_planes

CAPACITY = 32  # points that go through a step together

# Columns of a point: unit normal, unit direction to the viewer, radiance, position relative to the eye, and triangle_planes.Attributes.
NORMAL, VIEWER, RADIANCE, POSITION, FACING, UV, METRIC, SPREAD, OUTWARD, VERTEX_COLOR = 0, 3, 6, 9, 12, 13, 15, 17, 21, 24
PLAIN, TEXTURED, COLORED = 13, 21, 27


class Points(NamedTuple):
    """A thread's points: one of each instance among sixteen fragments, or a block that one triangle covers."""

    values: NDArray[np.float32]  # (CAPACITY, PLAIN, TEXTURED or COLORED, 16)
    instance: NDArray[np.int32]  # (CAPACITY,)
    lanes: NDArray[np.int32]  # bits: the lanes of that instance
    group: NDArray[np.int32]  # group of fragments, see fragments.fragment_start


def point_buffer(textured: bool, colored: bool) -> Points:
    """A buffer for CAPACITY points."""
    values = simd.aligned_empty((CAPACITY, COLORED if colored else TEXTURED if textured else PLAIN, 16), np.float32)
    return Points(values, np.zeros(CAPACITY, np.int32), np.zeros(CAPACITY, np.int32), np.zeros(CAPACITY, np.int32))


@helper
def store_point(shading: Any, textured: Any, colored: Any, k: int, point: triangle_planes.Attributes, x: Lane, y: Lane, i: int, lanes: Lane,
         group: int) -> None:  # fmt: skip
    """Write point k: attributes at (x, y) of instance i in the lanes `lanes`."""
    points, rays = shading.points, shading.rays
    simd.write(points.instance, k, i)
    simd.write(points.lanes, k, simd.bits(lanes))
    simd.write(points.group, k, group)
    along = at_pixel(rays.direction, x, y)
    put3(points, k, NORMAL, ops.scale(point.normal, simd.reciprocal_sqrt(ops.dot(point.normal, point.normal))))
    put3(points, k, VIEWER, ops.scale(along, -simd.reciprocal_sqrt(ops.dot(along, along))))
    if colored is not None or not shading.sources.bare:
        place = ops.scale(along, simd.reciprocal(point.key) if shading.projection.perspective else point.key)
        if not shading.projection.perspective:
            place = ops.add(place, at_pixel(rays.start, x, y))
        put3(points, k, POSITION, place)
    if textured is not None or not shading.sources.bare:
        put1(points, k, FACING, point.facing)
    if textured is not None:
        put2(points, k, UV, point.uv)
        _put_spread(points, k, texture_footprint.is_known(shading.tables), point.spread)
    if colored is not None:
        put2(points, k, METRIC, point.metric)
        put3(points, k, OUTWARD, point.outward)
        put3(points, k, VERTEX_COLOR, point.color)


@helper
def _put_spread(points: Any, k: int, used: Any, spread: Any) -> None:
    if used is None:
        return
    put2(points, k, SPREAD, (spread[0], spread[1]))
    put2(points, k, SPREAD + 2, (spread[2], spread[3]))


@helper
def put1(points: Any, k: int, column: int, x: Lane) -> None:
    """Write a column of point k."""
    simd.store_aligned(points.values, (k * points.values.shape[1] + column) * 16, x)


@helper
def put2(points: Any, k: int, column: int, v: tuple[Lane, Lane]) -> None:
    """Write two columns of point k."""
    put1(points, k, column, v[0])
    put1(points, k, column + 1, v[1])


@helper
def put3(points: Any, k: int, column: int, v: Vec) -> None:
    """Write three columns of point k."""
    put2(points, k, column, (v[0], v[1]))
    put1(points, k, column + 2, v[2])


@helper
def get1(points: Any, k: int, column: int) -> Lane:
    """A column of point k."""
    return simd.load_aligned(points.values, (k * points.values.shape[1] + column) * 16, simd.f32x16)


@helper
def get2(points: Any, k: int, column: int) -> tuple[Lane, Lane]:
    """Two columns of point k."""
    return get1(points, k, column), get1(points, k, column + 1)


@helper
def get3(points: Any, k: int, column: int) -> Vec:
    """Three columns of point k."""
    return get1(points, k, column), get1(points, k, column + 1), get1(points, k, column + 2)


@helper
def at_pixel(table: Any, x: Lane, y: Lane) -> Vec:
    """A vector linear on the picture, at (x, y): `table` holds its value at the corner and its differences per pixel."""
    return (
        simd.fma(x, table[1, 0], simd.fma(y, table[2, 0], table[0, 0])), simd.fma(x, table[1, 1], simd.fma(y, table[2, 1], table[0, 1])),
        simd.fma(x, table[1, 2], simd.fma(y, table[2, 2], table[0, 2])),
    )  # fmt: skip
