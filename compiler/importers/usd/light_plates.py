"""Frames and sizes of flat USD lights: rectangles, disks, prisms for cylinders, and grids for textures."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ....lang.diagnostics import Span
from ...ir import F64
from ...scene.builder import SceneBuilder
from .. import images
from . import stage
from .assets import asset, contents
from .materials import Materials
from .shaders import materialx

# The IR's area lights lie in y = 0 of their frame and emit to +y; USD's lie in z = 0 and emit to −z.
TURNED = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
SIDES = 12  # of the prism of a cylinder
CELLS = 8  # of a textured rectangle, along each side
_EVEN = 1e-4  # relative difference of scales, or skew, that counts as none


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A flat light: its frame (4, 4) to the world, half sides or radius in that frame, and its area in the world."""

    frame: F64
    size: tuple[float, float]
    area: float
    turn: F64 | None = None  # (3, 3) its rotation in the frame of its light


def rigid(matrix: np.ndarray) -> np.ndarray:
    """The matrix without scale: z keeps its direction, x stays as near as possible; right-handed even for a mirroring matrix."""
    frame = np.eye(4)
    z = matrix[:3, 2] / max(np.linalg.norm(matrix[:3, 2]), 1e-300)
    x = matrix[:3, 0] - (matrix[:3, 0] @ z) * z
    length = np.linalg.norm(x)
    x = x / length if length > 0 else np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = x, np.cross(z, x), z
    frame[:3, 3] = matrix[:3, 3]
    return frame


def _is_skewed(matrix: F64) -> bool:
    columns = matrix[:3, :3] / np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), 1e-300)
    return bool(np.abs(columns.T @ columns - np.eye(3)).max() > _EVEN)


def _area(matrix: F64) -> float:
    """The area in the world of a unit of area of z = 0."""
    return float(np.linalg.norm(np.cross(matrix[:3, 0], matrix[:3, 1])))


def rectangle(matrix: F64, width: float, height: float) -> Plate:
    """A rectangle about the origin of z = 0; a parallelogram under a skew."""
    area = _area(matrix) * width * height
    if _is_skewed(matrix):
        return Plate(matrix @ TURNED, (width / 2, height / 2), area)
    x, y, _ = np.linalg.norm(matrix[:3, :3], axis=0)
    return Plate(rigid(matrix) @ TURNED, (float(width * x / 2), float(height * y / 2)), area)


def disk(matrix: F64, radius: float) -> Plate:
    """A disk in z = 0; an ellipse under an uneven scale or skew."""
    area = _area(matrix) * math.pi * radius**2
    x, y, _ = np.linalg.norm(matrix[:3, :3], axis=0)
    if _is_skewed(matrix) or abs(x - y) > _EVEN * max(x, y):
        return Plate(matrix @ TURNED, (radius, 0.0), area)
    return Plate(rigid(matrix) @ TURNED, (float(radius * (x + y) / 2), 0.0), area)


def prism(matrix: F64, radius: float, length: float) -> list[Plate]:
    """The sides of a prism around the x axis, with the perimeter and length of a cylinder, as rectangles."""
    side = 2 * math.pi * radius / SIDES
    distance = side / 2 / math.tan(math.pi / SIDES)
    plates = []
    for k in range(SIDES):
        turn = 2 * math.pi * k / SIDES
        outward = np.array([0.0, math.cos(turn), math.sin(turn)])
        local = np.eye(4)
        local[:3, 0], local[:3, 1], local[:3, 2] = (1, 0, 0), np.cross((1, 0, 0), outward), -outward
        local[:3, 3] = distance * outward
        plates.append(replace(rectangle(matrix @ local, length, side), turn=local[:3, :3]))
    return plates


def grid(matrix: F64, width: float, height: float, cells: int) -> list[Plate]:
    """The rectangles of a grid, row by row from the top (+y), left to right (+x)."""
    plates = []
    for row in range(cells):
        for column in range(cells):
            moved = np.eye(4)
            moved[:2, 3] = ((column + 0.5) / cells - 0.5) * width, (0.5 - (row + 0.5) / cells) * height
            plates.append(rectangle(matrix @ moved, width / cells, height / cells))
    return plates


def texture(prim: Any, time: Any, builder: SceneBuilder, materials: Materials, span: Span) -> F64 | None:
    """The mean colours (CELLS, CELLS, 3) of a light's picture, top row first; None without a picture.

    Its lower left corner is at the light's lowest x and y (OpenUSD 25.05).
    """
    value = stage.value(prim.GetAttribute("inputs:texture:file"), time)
    if not getattr(value, "path", ""):
        return None
    picture = asset(value, materials.warnings, prim)
    if picture is None:
        return None
    try:
        name = Path(picture.path).name
        space = materialx.attribute_space(prim.GetAttribute("inputs:texture:file"), builder.files.colors, materials.tell)
        decoded = images.read(contents(picture.path), name, space, config=builder.files.colors)
    except (images.ImageError, OSError) as failure:
        builder.diagnostics.warning(str(failure), span, getattr(failure, "hint", ""))
        return None
    decoded.warn(name, builder.diagnostics, span)
    return _shrunk(_shrunk(np.maximum(decoded.texels[..., :3], 0.0).astype(np.float64)).swapaxes(0, 1)).swapaxes(0, 1)


def _shrunk(texels: F64) -> F64:
    """Texels with CELLS rows, each the mean of the rows that it covers."""
    total = np.concatenate([np.zeros((1, *texels.shape[1:])), np.cumsum(texels, axis=0)])
    edges = np.linspace(0.0, len(texels), CELLS + 1)
    low = np.minimum(edges.astype(int), len(texels) - 1)
    integral = total[low] + (edges - low)[:, None, None] * texels[low]
    return np.diff(integral, axis=0) * (CELLS / len(texels))
