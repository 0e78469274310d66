"""Cameras in world space, as formats of scene files have them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import ir
from .export import Export
from .placement import F64


class Eye(NamedTuple):
    """A camera in world space. A point of the picture is `position + forward + x right + y up` (perspective), x and y in -1…1."""

    position: F64
    right: F64  # from the picture's center to its right edge, at distance 1; orthographic: in metres
    up: F64
    forward: F64  # unit
    shift: F64  # (2,) of the center, in half pictures: in units of `right` and `up`
    perspective: bool
    regular: bool  # right, up and forward are orthogonal, and the frame has one scale


def eye(scene: ir.Scene, camera: int, size: tuple[int, int]) -> Eye:
    """The camera (a row) for a picture of `size` pixels."""
    cameras, tables = scene.tables.cameras, scene.tables
    aspect, extent = size[0] / size[1] * float(cameras.pixel_aspect[camera]), float(cameras.extent[camera])
    half = (extent, extent / aspect) if cameras.fit[camera] == ir.Fit.HORIZONTAL else (extent * aspect, extent)
    matrix = tables.transforms.matrix[cameras.transform[camera]]
    x, y, z = matrix[:, 0], matrix[:, 1], matrix[:, 2]
    perspective = bool(cameras.projection[camera] == ir.Projection.PERSPECTIVE)
    long = float(np.linalg.norm(z))
    if perspective:
        x, y = x / long, y / long
    angles = np.abs([x @ y, x @ z / long, y @ z / long])
    regular = bool(angles.max() < 1e-9 * float(x @ x) and abs(float(x @ x) - float(y @ y)) < 1e-9 * float(x @ x))
    return Eye(matrix[:, 3], x * half[0], y * half[1], -z / long, 2.0 * cameras.shift[camera], perspective, regular)


class PlacedCamera(NamedTuple):
    """A camera as formats of scene files have it: it looks along −z of a frame without scale."""

    name: str
    seen: Eye
    half: tuple[float, float]  # half of the picture's width and height at distance 1; orthographic: in metres
    frame: F64  # (4, 4) to the world


def placed_camera(out: Export, row: int, size: tuple[int, int]) -> PlacedCamera | None:
    """The camera (a row) for a picture of `size` pixels; None, with a report, for a panoramic one."""
    scene = out.scene
    if scene.tables.cameras.projection[row] not in (ir.Projection.PERSPECTIVE, ir.Projection.ORTHOGRAPHIC):
        out.cannot("panoramic cameras are not carried", "cameras", row)
        return None
    seen = eye(scene, row, size)
    if not seen.regular:
        out.cannot("the camera's frame is stretched or sheared: not carried", "cameras", row)
    half = float(np.linalg.norm(seen.right)), float(np.linalg.norm(seen.up))
    frame = np.eye(4)
    frame[:3] = np.stack([seen.right / half[0], seen.up / half[1], -seen.forward, seen.position], axis=1)
    names = scene.names.cameras
    return PlacedCamera((names[row] if row < len(names) else "") or "camera", seen, half, frame)


def report_planes(out: Export, row: int) -> None:
    """A report for a camera (a row) with clipping planes."""
    if out.scene.tables.cameras.planes[row].any():
        out.cannot("clipping planes are not carried", "cameras", row)
