"""Transforms of instances as exporters write them, and the extent of a scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lights import LIGHTS, POINTS
from ...lights.contract import ExportedLight, Form
from .. import ir

F64 = NDArray[np.float64]


def world(tables: ir.Tables, instance: int) -> F64:
    """(4, 4) object-to-world matrix of an instance."""
    return square(tables.transforms.matrix[tables.instances.transform[instance]])


def square(matrix: Any) -> F64:
    """A (3, 4) transform as (4, 4)."""
    full = np.eye(4)
    full[:3] = matrix
    return full


def frame_along(axis: F64) -> F64:
    """(3, 3) rotation from +z to a unit axis."""
    side = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(side, axis)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def light_frame(light: ExportedLight) -> F64:
    """(4, 4) frame of a light by its form: at its position with +z against its direction, +z to a distant light, or its own frame."""
    kind, frame = LIGHTS[light.kind], light.frame.copy()
    if kind.FORM == Form.POINT:
        frame[:3, 3] = light.position
        if kind.profile is not None:
            frame[:3, :3] = frame_along(-light.direction)
    elif kind.FORM == Form.DISTANT:
        frame[:3, :3] = frame_along(light.direction)
    return frame


def even_scale(matrix: F64) -> float | None:
    """The scale factor of a uniformly scaling transform (4, 4) or (3, 4); else None."""
    linear = matrix[:3, :3]
    gram = linear.T @ linear
    square_scale = float(np.trace(gram)) / 3.0
    if np.abs(gram - square_scale * np.eye(3)).max() > 1e-9 * square_scale:
        return None
    return math.sqrt(square_scale)


def mean_scale(matrix: F64) -> float:
    """The mean length of a transform's axes: the scale factor applied to texture cells."""
    return float(np.linalg.norm(matrix[:3, :3], axis=0).mean())


def reach(tables: ir.Tables) -> tuple[F64, float]:
    """(center, radius) of a bounding sphere of all bounded instances, the camera and the lights."""
    points = [square(tables.transforms.matrix[row])[:3, 3] for row in tables.cameras.transform.tolist()]
    for i, g in enumerate(tables.instances.geometry.tolist()):
        low, high = tables.geometries.bounds[g]
        if np.isfinite([low, high]).all():
            corners = np.array([[x, y, z, 1.0] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
            points += list((corners @ world(tables, i).T)[:, :3])
    placed = ir.is_in(tables.lights.kind, POINTS)
    points += list(tables.lights.position[placed])
    cloud = np.array(points)
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    return (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-3)
