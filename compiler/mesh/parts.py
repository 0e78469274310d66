"""Parts: the objects of a scene as triangles in the world, for files that hold triangles alone and for measuring."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Material(NamedTuple):
    """The properties of a material that a file holds."""

    name: str
    color: tuple[float, ...]  # sRGB, 0 to 1
    plain: bool = False  # what a scene has without a material: of a mesh with colours, these alone are written


class Part(NamedTuple):
    """One object in world space: metres, counter-clockwise from outside."""

    name: str
    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    deviation: float  # largest distance of its triangles from the true surface, in metres
    open_edges: int  # edges with a triangle on one side only
    materials: tuple[Material, ...] = ()
    material: NDArray[np.int64] | None = None  # (m,) of each triangle, in `materials`
    instance: int = -1  # its row
    is_mesh: bool = False  # in the scene, too: of a file, or generated
    is_contour: bool = False  # of a formula: its deviation is measured at samples
    missing: float = 0.0  # metres: parts thinner than this are missing in it
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) linear, of the corners of triangles: factors of the materials' colours
    rows: tuple[int, ...] = ()  # of the materials in the scene


MIN_SEPARATION = 2.0**-20  # of the largest coordinate: least distance by which touching edges are separated
WELDED = 2.0**-23  # of the largest coordinate: corners nearer than this are merged
_TURNS = 4
FAR = 64.0  # distance from the origin, in object extents, from which single precision is insufficient


def separate(parts: Sequence[Part], single: bool) -> tuple[list[Part], int]:
    """Separates touching edges: (parts, number of edges that still coincide). `single`: of a file in single precision.

    Programs identify corners by position, in about single precision. An edge along which two objects touch, or one touches itself, thus
    has four triangles. Its corners move inwards by a millionth.
    """
    parts = list(parts)
    low, high = _box(parts)
    middle = np.zeros(3) if single else 0.5 * (low + high)
    reach = float(np.maximum(high - middle, middle - low).max())
    for turn in range(_TURNS):
        coincident = _coincident_sides(parts, middle, reach)
        if not any(mask.any() for mask in coincident):
            return parts, 0
        step = MIN_SEPARATION * reach * 4.0**turn
        for i, (part, mask) in enumerate(zip(parts, coincident, strict=True)):
            corners = np.unique(part.triangles[mask.any(axis=1)])
            if len(corners):
                moved = part.positions.copy()
                moved[corners] -= step * _normals(part)[corners]
                parts[i] = part._replace(positions=moved, deviation=part.deviation + step)
    return parts, sum(int(mask.sum()) for mask in _coincident_sides(parts, middle, reach)) // 2


def _coincident_sides(parts: Sequence[Part], middle: NDArray[np.float64], reach: float) -> list[NDArray[np.bool_]]:
    """For each part, mask (m, 3) of triangle sides shared in the same direction by another triangle, rounded as in the file."""
    positions, triangles = joined(parts)
    _, place = np.unique(np.round((positions - middle) / (WELDED * reach)).astype(np.int64), axis=0, return_inverse=True)
    sides = place.reshape(-1)[triangles]
    key = sides * np.int64(len(positions)) + np.roll(sides, -1, axis=1)
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    coincident = (count[index.reshape(key.shape)] > 1) & (sides != np.roll(sides, -1, axis=1))
    return np.split(coincident, np.cumsum([len(part.triangles) for part in parts])[:-1])


def _normals(part: Part) -> NDArray[np.float64]:
    """(n, 3) vertex normals, weighted by triangle area."""
    a, b, c = (part.positions[part.triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    total = np.stack([sum(np.bincount(part.triangles[:, k], faces[:, i], len(part.positions)) for k in range(3)) for i in range(3)], axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def center(parts: Sequence[Part]) -> tuple[list[Part], NDArray[np.float64] | None]:
    """(parts, offset by which they were moved to the origin; None if single precision suffices in place)."""
    low, high = _box(parts)
    if max(np.abs(low).max(), np.abs(high).max()) <= FAR * (high - low).max():
        return list(parts), None
    middle = 0.5 * (low + high)
    return [part._replace(positions=part.positions - middle) for part in parts], -middle


def _box(parts: Sequence[Part]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ends = np.array([[part.positions.min(axis=0), part.positions.max(axis=0)] for part in parts])
    return ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)


def joined(parts: Sequence[Part]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(positions, triangles) of all parts as one mesh."""
    firsts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    triangles = [part.triangles + first for part, first in zip(parts, firsts, strict=True)]
    return np.concatenate([part.positions for part in parts]), np.concatenate(triangles)


def corner_colors(part: Part) -> NDArray[np.uint8]:
    """(m, 3, 3) the sRGB colours of the corners of triangles; white without a material."""
    if not part.materials:
        return np.full((len(part.triangles), 3, 3), 255, np.uint8)
    rows = np.zeros(len(part.triangles), np.int64) if part.material is None else part.material
    if part.colors is None:
        table = np.round(255 * np.clip([material.color for material in part.materials], 0.0, 1.0)).astype(np.uint8)
        return np.repeat(table[rows][:, None], 3, axis=1)
    factors = np.array([(1.0, 1.0, 1.0) if m.plain else tuple(map(to_linear, m.color)) for m in part.materials])
    return np.round(255 * to_srgb(part.colors * factors[rows][:, None])).astype(np.uint8)


def to_srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB colours from 0 to 1 of linear ones."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def to_linear(value: float) -> float:
    """A linear value from 0 to 1 of one in sRGB."""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
