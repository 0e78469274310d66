"""Builds shading records of mesh triangles: a hit reads one row of memory instead of sixty gathers.

A triangle of a mesh without textures and colors needs its outer normal and, where normals are interpolated, those of its corners. Both are
stored in world space, for each instance. Where that would take too much memory, hits read the mesh (interaction.make_interaction).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import simd
from ..jit.kernel import helper
from ..lanes import ops
from ..simd.registration import overload
from ..types import Lane, Vec
from . import interaction

MOST = 1 << 22  # triangles with rows, over all instances
EXACT = 1 << 24  # integers up to this are exact in float32
NONE = -(1 << 30)  # in `first`, for an instance without rows
PLAIN, ROUNDED = 1.0, 2.0  # shading of a row: by its own normal, by those of its corners
CORNERS = 16  # columns: three normals; their products with both edges over their squares, for Surface.lift; padding


class Flat(NamedTuple):
    """The absence of interpolated normals."""


class Rounded(NamedTuple):
    """Normals of the corners of triangles, from row `start` on."""

    corners: NDArray[np.float64]  # (m · CORNERS,)
    start: int  # the first triangle's row


def build(
    tables: ir.Tables, chosen: list[tuple[int, float]], start: int, general: bool = False
) -> tuple[NDArray[Any], NDArray[np.int32], Flat | Rounded]:
    """(rows (n, 8) as in PrimitiveRecords, first row minus first triangle of each instance, normals of corners).

    `chosen` lists (instance, PLAIN or ROUNDED); `start` is the number of rows before these. With `general`, normals of corners are
    Rounded even if there are none.
    """
    first = np.full(len(tables.instances.geometry), NONE, np.int32)
    rows, corners, budget = [np.zeros((0, 8), np.float32)], [], MOST
    for i, how in sorted(chosen, key=lambda pair: -pair[1]):
        g = int(tables.instances.geometry[i])
        begin, count = int(tables.geometries.first_triangle[g]), int(tables.geometries.triangle_count[g])
        if count > budget or begin + count > EXACT or (how == ROUNDED and not _has_uniform_scale(tables, i)):
            continue
        first[i] = start + sum(map(len, rows)) - begin
        rows.append(_rows(tables, i, g, how))
        if how == ROUNDED:
            corners.append(_corners(tables, i, g))
        budget -= count
    if general and not corners:
        corners.append(np.zeros((1, CORNERS)))
    rounded = Rounded(np.concatenate(corners).ravel(), start) if corners else Flat()
    return np.concatenate(rows), first, rounded


def _has_uniform_scale(tables: ir.Tables, i: int) -> bool:
    """Whether an instance's scale is 1 on all axes, which keeps angles."""
    linear = tables.transforms.matrix[tables.instances.transform[i]][:, :3]
    even = linear.T @ linear
    return bool(np.allclose(even, even[0, 0] * np.eye(3), rtol=0, atol=1e-6 * even[0, 0]))


def _to_world(tables: ir.Tables, i: int) -> NDArray[np.float32]:
    """Matrix (3, 3) that takes an instance's normals, as row vectors, to the world."""
    return tables.transforms.inverse[tables.instances.transform[i]][:, :3].astype(np.float32)


def _range(tables: ir.Tables, g: int) -> slice:
    first = int(tables.geometries.first_triangle[g])
    return slice(first, first + int(tables.geometries.triangle_count[g]))


def _rows(tables: ir.Tables, i: int, g: int, how: float) -> NDArray[np.float32]:
    part, positions = _range(tables, g), tables.pools.positions
    a, b, c = (positions[tables.pools.triangles[part, k]] for k in range(3))
    outward = np.cross(b - a, c - a) @ _to_world(tables, i)
    rows = np.zeros((len(outward), 8), np.float32)
    rows[:, 3] = -_corner_errors(tables, i, g, (a, b, c))
    rows[:, :3] = outward / np.maximum(np.linalg.norm(outward.astype(np.float64), axis=1, keepdims=True), 1e-300)
    rows[:, 4], rows[:, 5] = i, np.arange(part.start, part.stop)
    rows[:, 6], rows[:, 7] = tables.instances.material[i], how
    return rows


def _corner_errors(tables: ir.Tables, i: int, g: int, corners: tuple[NDArray[np.float32], ...]) -> NDArray[np.float32]:
    """Error of ray distances from the triangles' corners, in metres, (triangles,): see interaction.origin_offset."""
    matrix = tables.transforms.matrix[tables.instances.transform[i]][:, :3]
    origin = tables.geometries.origin[g].astype(np.float32)
    most = np.maximum(np.maximum(abs(corners[0] + origin), abs(corners[1] + origin)), abs(corners[2] + origin))
    return most.sum(axis=1) * np.float32(np.mean(np.linalg.norm(matrix, axis=0)))


def _corners(tables: ir.Tables, i: int, g: int) -> NDArray[np.float64]:
    part, values = _range(tables, g), tables.pools.values
    row, numbers = int(tables.geometries.normals[g]), np.arange(part.start, part.stop)
    a, b, c = (tables.pools.positions[tables.pools.triangles[part, k]] for k in range(3))
    linear = tables.transforms.matrix[tables.instances.transform[i]][:, :3].T.astype(np.float32)
    edges = (b - a) @ linear, (c - a) @ linear
    face = np.cross(*edges)
    face /= np.maximum(np.linalg.norm(face, axis=1, keepdims=True), 1e-30)
    records = np.zeros((len(numbers), CORNERS))
    for k in range(3):
        begin = interaction.attribute_row(tables, g, row, numbers, k, True)
        normal = values[begin[:, None] + np.arange(3)] @ _to_world(tables, i)
        records[:, 3 * k : 3 * k + 3] = normal
        size = np.sum(normal * normal, axis=1)
        round_ = np.sum(normal * face, axis=1) ** 2 > interaction.COARSEST**2 * size
        for j in range(2):
            along = np.sum(normal * edges[j], axis=1) / np.maximum(size, 1e-30)
            records[:, 9 + 2 * k + j] = np.where(round_ & np.isfinite(along), along, 0.0)
    return records


# --- in lanes ------------------------------------------------------------------------------------------------------------


def interpolate_normal(rounded: Any, normal: Vec, row: Lane, lanes: Lane, u: Lane, v: Lane, side: Lane) -> tuple[Vec, Vec]:
    """(`normal`, or the interpolated one on its side in the lanes `lanes`; Surface.lift, for the outside where `side` is 1)."""
    raise NotImplementedError


@helper
def _interpolate_normal(rounded: Any, normal: Vec, row: Lane, lanes: Lane, u: Lane, v: Lane, side: Lane) -> tuple[Vec, Vec]:
    element = ops.where(lanes, row - rounded.start, 0) * CORNERS
    ax, ay, az, bx, by, bz, cx, cy = simd.gather_rows(rounded.corners, element, 8)
    cz, a1, a2, b1, b2, c1, c2, _ = simd.gather_rows(rounded.corners, element, 8, 8)
    w = 1.0 - u - v
    blended = (ax * w + bx * u + cx * v, ay * w + by * u + cy * v, az * w + bz * u + cz * v)
    size = ops.length(blended)
    good = lanes & (size > 1e-12) & ops.is_finite(size)
    turned = ops.where(ops.dot(blended, normal) < 0.0, -1.0, 1.0)
    scale = turned / ops.where(good, size, 1.0)
    side = side * turned
    wa = side * w * ops.maximum(-side * (u * a1 + v * a2), 0.0)
    wb = side * u * ops.maximum(side * ((1.0 - u) * b1 - v * b2), 0.0)
    wc = side * v * ops.maximum(side * ((1.0 - v) * c2 - u * c1), 0.0)
    zero = 0.0 * u
    lift = (ax * wa + bx * wb + cx * wc, ay * wa + by * wb + cy * wc, az * wa + bz * wb + cz * wc)
    return ops.where3(good, ops.scale(blended, scale), normal), ops.where3(good, lift, (zero, zero, zero))


@overload(interpolate_normal)
def _interpolate_normal_in_kernels(rounded, normal, row, lanes, u, v, side):
    if rounded.layout:
        return lambda rounded, normal, row, lanes, u, v, side: _interpolate_normal(rounded, normal, row, lanes, u, v, side)
    return lambda rounded, normal, row, lanes, u, v, side: (normal, (0.0 * u, 0.0 * u, 0.0 * u))
