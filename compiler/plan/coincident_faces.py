"""Warns of two flat faces in one place that face the same way: rounding decides at each pixel which of them is seen."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...lang.diagnostics import Diagnostics
from .. import ir
from ..ir import F64
from . import enclosed_lights

MOST_FACES = 1 << 15  # that are compared
MOST_PAIRS = 1 << 16
LEAST = 1e-6  # of the smaller face's sides, that two faces have in common
_ALIGNED = 1e-9  # of the largest number of a transform, below which another counts as 0
_KIND = ir.GeometryKind
_FLAT = (_KIND.BOX, _KIND.PLANE, _KIND.RECTANGLE, _KIND.DISK, _KIND.CYLINDER)


class Face(NamedTuple):
    """A face across an axis of the world, seen from the side of `sign`."""

    low: tuple[float, float]  # along the other two axes, ascending
    high: tuple[float, float]
    instance: int


def warn_of_coincident_faces(scene: ir.Scene, diagnostics: Diagnostics) -> None:
    """Warn of the first two faces of opaque shapes with different materials that coincide, on a side that the first camera is on.

    Faces across the axes of the world are compared: of boxes, rectangles and planes, and the squares in disks and in caps of cylinders.
    """
    tables = scene.tables
    if not len(tables.cameras.transform) or tables.cameras.projection[0] == ir.Projection.ORTHOGRAPHIC:
        return
    eye = tables.transforms.matrix[tables.cameras.transform[0], :, 3]
    groups: dict[tuple[int, int, float], list[Face]] = {}
    for count, (axis, sign, offset, face) in enumerate(_faces(tables)):
        if count > MOST_FACES:
            return
        if sign * (eye[axis] - offset) > 0:
            groups.setdefault((axis, sign, float(f"{offset:.9g}") + 0.0), []).append(face)
    remaining = MOST_PAIRS
    for (axis, _, offset), faces in groups.items():
        faces.sort(key=lambda face: face.low[0])
        for k, first in enumerate(faces):
            for other in faces[k + 1 :]:
                remaining -= 1
                if other.low[0] >= first.high[0]:
                    break
                if remaining < 0:
                    return
                if _overlap(first, other) and tables.instances.material[first.instance] != tables.instances.material[other.instance]:
                    _tell(scene, diagnostics, (first.instance, other.instance), "xyz"[axis], offset)
                    return


def _tell(scene: ir.Scene, diagnostics: Diagnostics, rows: tuple[int, int], axis: str, offset: float) -> None:
    first, second = sorted(rows)
    names = [scene.names.instances[row] for row in (first, second)]
    what = f"`{names[0]}` and `{names[1]}`" if names[0] != names[1] else f"two shapes `{names[0]}`"
    message = f"{what} have faces in one place, at {axis} = {offset:.4g}: which of them is seen is chance"
    diagnostics.warning(message, scene.spans.get("instances", second), "move one of them by a millimetre, or make a union of them")


def _overlap(first: Face, second: Face) -> bool:
    for k in (0, 1):
        common = min(first.high[k], second.high[k]) - max(first.low[k], second.low[k])
        if not common > LEAST * min(first.high[k] - first.low[k], second.high[k] - second.low[k]) and not math.isinf(common):
            return False
    return True


def _faces(tables: ir.Tables) -> Iterator[tuple[int, int, float, Face]]:
    """(axis, sign, offset, face) of opaque instances whose axes are those of the world."""
    rows = enclosed_lights.opaque(tables)
    seen = tables.instances.visible[rows] & ir.Visibility.CAMERA != 0
    for row in rows[seen & ir.is_in(tables.geometries.kind[tables.instances.geometry[rows]], _FLAT)][:MOST_FACES].tolist():
        geometry = int(tables.instances.geometry[row])
        flat = _flat(int(tables.geometries.kind[geometry]), tables.geometries.parameters[geometry].tolist())
        matrix = tables.transforms.matrix[tables.instances.transform[row]]
        size = np.abs(matrix[:, :3])
        filled = size > _ALIGNED * size.max()
        if not ((filled.sum(axis=0) == 1) & (filled.sum(axis=1) == 1)).all():
            continue
        to = filled.argmax(axis=0)  # the axis of the world of each own axis
        for axis, sides, offset, half in flat:
            yield from _placed(matrix, to, axis, sides, offset, half, row)


def _placed(
    matrix: F64, to: np.ndarray, axis: int, sides: tuple[int, ...], offset: float, half: tuple[float, float], row: int
) -> Iterator[tuple[int, int, float, Face]]:
    """A face across an own axis in the world: for each of the sides that it is seen from."""
    others = [k for k in range(3) if k != axis]
    spans = {int(to[k]): abs(float(matrix[to[k], k])) * h for k, h in zip(others, half, strict=True)}
    across, axes = int(to[axis]), [k for k in range(3) if k != to[axis]]
    low = tuple(float(matrix[k, 3]) - spans[k] for k in axes)
    high = tuple(float(matrix[k, 3]) + spans[k] for k in axes)
    scale = float(matrix[across, axis])
    for side in sides:
        yield across, int(math.copysign(side, side * scale)), float(matrix[across, 3]) + scale * offset, Face(low, high, row)  # type: ignore[arg-type]


def _flat(kind: int, p: list[float]) -> list[tuple[int, tuple[int, ...], float, tuple[float, float]]]:
    """(own axis, sides that it is seen from, offset, half sides along the other two axes) of the flat faces of a shape."""
    both, square = (1, -1), p[0] / math.sqrt(2.0)
    if kind == _KIND.BOX:
        return [(k, (side,), side * p[k], (p[(1, 0, 0)[k]], p[(2, 2, 1)[k]])) for k in range(3) for side in both]
    if kind == _KIND.PLANE:
        return [(1, both, 0.0, (math.inf, math.inf))]
    if kind == _KIND.RECTANGLE:
        return [(1, both, 0.0, (p[0], p[1]))]
    if kind == _KIND.DISK:
        return [(1, both, 0.0, (square, square))]
    if kind == _KIND.CYLINDER and p[2]:
        return [(1, (side,), side * p[1], (square, square)) for side in both]
    return []
