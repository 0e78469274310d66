"""Pictures of dome lights in other layouts than latitude–longitude, resampled to it.

The middle of every layout is at the light's +z, as that of a latitude–longitude picture (OpenEXR). A mirrored ball is seen from +z along
−z by an orthographic camera; `angular` is the light probe of Debevec (1998), r = acos(z) / π; the vertical cross is the unfolded cube.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....ir import F64

_HEIGHTS = (16, 2048)  # least and greatest, of the result


def _mirrored_ball(way: F64, rows: int, columns: int) -> tuple[F64, F64]:
    """Rows and columns, in texels, at which a ball shows directions (3, h, w): at half of the vector between them and +z."""
    x, y, z = way
    across = np.sqrt(np.maximum(2.0 * (1.0 + z), 1e-12))
    return _disk(x / across, y / across, rows, columns)


def _angular(way: F64, rows: int, columns: int) -> tuple[F64, F64]:
    x, y, z = way
    radius = np.arccos(np.clip(z, -1.0, 1.0)) / np.pi / np.maximum(np.hypot(x, y), 1e-12)
    return _disk(x * radius, y * radius, rows, columns)


def _disk(right: F64, up: F64, rows: int, columns: int) -> tuple[F64, F64]:
    """Texels of points of the unit disk; at most so near its edge that all four texels around lie inside."""
    inside = np.minimum(1.0, (1.0 - 3.0 / min(rows, columns)) / np.maximum(np.hypot(right, up), 1e-12))
    return (1.0 - up * inside) * (rows / 2), (1.0 + right * inside) * (columns / 2)


def _vertical_cross(way: F64, rows: int, columns: int) -> tuple[F64, F64]:
    """Texels of a cross of three by four faces: +y; +x, +z, −x; −y; −z upside down."""
    x, y, z = way
    length = np.abs(way).max(axis=0)
    side = np.argmax(np.abs(way), axis=0) + 3 * (np.take_along_axis(way, np.argmax(np.abs(way), axis=0)[None], axis=0)[0] < 0)
    x, y, z = x / length, y / length, z / length
    corner = np.array([(1, 0), (0, 1), (1, 1), (1, 2), (2, 1), (3, 1)])[side]  # row and column of each face: +x, +y, +z, −x, −y, −z
    down = np.choose(side, [-y, z, -y, -y, -z, y])
    right = np.choose(side, [z, -x, -x, -z, -x, -x])
    high, wide = rows / 4, columns / 3
    within = [np.clip((1.0 + along) / 2, 0.5 / size, 1.0 - 0.5 / size) for along, size in ((down, high), (right, wide))]
    return (corner[..., 0] + within[0]) * high, (corner[..., 1] + within[1]) * wide


LAYOUTS: dict[str, Callable[[F64, int, int], tuple[F64, F64]]] = {
    "mirroredBall": _mirrored_ball, "angular": _angular, "cubeMapVerticalCross": _vertical_cross,
}  # fmt: skip


def latitude_longitude(texels: np.ndarray, layout: str) -> np.ndarray:
    """The picture (h, 2 h, 4) in latitude–longitude of one (rows, columns, 4) in a layout of LAYOUTS, by bilinear interpolation."""
    rows, columns = texels.shape[:2]
    height = int(np.clip(rows // (2 if layout == "cubeMapVerticalCross" else 1), *_HEIGHTS))
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(2 * height) + 0.5) / (2 * height))[None]
    way = np.stack([np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0.0 * turn, np.cos(latitude) * np.cos(turn)])
    row, column = LAYOUTS[layout](way, rows, columns)
    return _bilinear(texels, row - 0.5, column - 0.5).astype(np.float32)


def _bilinear(texels: np.ndarray, row: F64, column: F64) -> np.ndarray:
    high, wide = texels.shape[:2]
    row, column = np.clip(row, 0.0, high - 1.0), np.clip(column, 0.0, wide - 1.0)
    top, left = np.minimum(row.astype(int), max(high - 2, 0)), np.minimum(column.astype(int), max(wide - 2, 0))
    below, right = np.minimum(top + 1, high - 1), np.minimum(left + 1, wide - 1)
    down, across = (row - top)[..., None], (column - left)[..., None]
    upper = texels[top, left] * (1.0 - across) + texels[top, right] * across
    return upper * (1.0 - down) + (texels[below, left] * (1.0 - across) + texels[below, right] * across) * down
