"""How a mesh is stored: the digest that finds equal meshes, the origin of its float32 positions, their bounds, and rows of pools."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..io import stage_cache
from .row_records import MeshData


def digest(mesh: MeshData) -> bytes:
    """Hash of a mesh's content."""
    attributes = (mesh.normals, mesh.uvs, mesh.colors)
    return stage_cache.digest(mesh.positions, mesh.triangles, mesh.outlines, attributes)


def stored(mesh: MeshData, content: bytes) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(origin (3,), float32 positions relative to it (v, 3), bounds (2, 3), largest rounding) of a mesh with the digest `content`."""
    return stage_cache.cached("meshes stored", (content,), lambda: _stored(mesh))


def _stored(mesh: MeshData) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    positions = np.asarray(mesh.positions, dtype=np.float64).reshape(-1, 3)
    center = origin(positions)
    with np.errstate(over="ignore", invalid="ignore"):
        relative = (positions - center).astype(np.float32)
        rounding = np.abs(relative.astype(np.float64) + center - positions)
    finite = rounding[np.isfinite(rounding)]
    return center, relative, bounds(relative) + center, math.sqrt(3.0) * float(finite.max(initial=0.0))


def bounds(positions: np.ndarray) -> np.ndarray:
    """(2, 3) float64 bounds of the finite positions (n, 3); 0 without any."""
    finite = positions if np.isfinite(positions).all() else positions[np.isfinite(positions).all(axis=1)]
    by_coordinate = np.ascontiguousarray(finite.T)  # numpy takes forty times as long over rows of three
    return np.stack([by_coordinate.min(axis=1), by_coordinate.max(axis=1)]).astype(np.float64) if len(finite) else np.zeros((2, 3))


def origin(positions: np.ndarray) -> np.ndarray:
    """(3,) origin of a mesh's stored positions (n, 3): the center of its bounds.

    With outliers a thousand times as far out as the median vertex, it is the median, so that most vertices keep their precision.
    """
    box = bounds(positions)
    some = positions[:: max(1, len(positions) // 1024)]
    some = some[np.isfinite(some).all(axis=1)]
    if not len(some):
        return box.mean(axis=0)
    crowd = np.median(some, axis=0)
    away = np.median(np.abs(some - crowd).max(axis=1))
    return crowd if (box[1] - box[0]).max() > 1000.0 * away > 0.0 else box.mean(axis=0)


def pool_rows(pieces: Sequence[np.ndarray], first: int, count: int) -> np.ndarray:
    """Rows first … first + count − 1 of a pool; they lie in one of the arrays added to it."""
    for piece in pieces:
        if first < len(piece):
            return piece[first : first + count]
        first -= len(piece)
    raise IndexError(first)
