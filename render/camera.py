"""Cameras: from a place in the picture to a ray, and the matrices that take the world to the picture.

Picture coordinates are in pixels from the top left; (0.5, 0.5) is the first pixel's centre. Cameras look down -z of their own frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import lanes, placed
from .kernels import helper
from .records import Lane, Ray, Tables, Vec, View

PERSPECTIVE = int(ir.Projection.PERSPECTIVE)
HORIZONTAL = int(ir.Fit.HORIZONTAL)


@helper
def half_extent(tables: Tables, view: View) -> tuple[float, float]:
    """Half the width and height of what is seen, at distance 1 (perspective) or everywhere (orthographic), in metres."""
    cameras = tables.cameras
    extent = cameras.extent[view.camera]
    aspect = view.width / view.height
    if cameras.fit[view.camera] == HORIZONTAL:
        return extent, extent / aspect
    return extent * aspect, extent


@helper
def image_plane(tables: Tables, view: View, x: Lane, y: Lane) -> tuple[Lane, Lane]:
    """Where pixel coordinates lie on the image plane at distance 1, right and up, shift included."""
    half_x, half_y = half_extent(tables, view)
    shift = tables.cameras.shift
    px = (2.0 * x / view.width - 1.0 + 2.0 * shift[view.camera, 0]) * half_x
    py = (1.0 - 2.0 * y / view.height + 2.0 * shift[view.camera, 1]) * half_y
    return px, py


@helper
def ray(tables: Tables, view: View, x: Lane, y: Lane, time: Any = None) -> Ray:
    """The ray through pixel coordinates x, y; its ends are the near and far planes. An orthographic one without near has no start.

    `time` as in Ray: where the camera is then.
    """
    cameras = tables.cameras
    c = view.camera
    px, py = image_plane(tables, view, x, y)
    zero = lanes.full_like(px, 0.0)
    matrix = placed.at(tables, cameras.transform[c], time).matrix
    if cameras.projection[c] == PERSPECTIVE:
        local = (px, py, zero - 1.0)
        stretch = lanes.length(local)  # of the axis' metres to the ray's
        origin = lanes.point_by(matrix, (zero, zero, zero))
        direction = lanes.normalize(lanes.vector_by(matrix, local))
        return Ray(origin, direction, cameras.near[c] * stretch, cameras.far[c] * stretch, time)
    origin = lanes.point_by(matrix, (px, py, zero))
    direction = lanes.normalize(lanes.vector_by(matrix, (zero, zero, zero - 1.0)))
    start = cameras.near[c] if cameras.near[c] > 0.0 else -np.inf
    return Ray(origin, direction, zero + start, zero + cameras.far[c], time)


@helper
def depth(tables: Tables, view: View, point: Vec) -> Lane:
    """Distance of a world point along the camera's axis, in metres."""
    row = tables.cameras.transform[view.camera]
    return -lanes.transform_point(tables.transforms.inverse, row, point)[2]


def matrices(tables: Tables, view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The course's C⁻¹ (world to camera) and P (camera to clip space), (4, 4) each.

    With X a world point, (x, y, z, w) = P · C⁻¹ · X: x / w and y / w run from -1 to 1 over the picture, right and up, and
    z / w is 1/distance reversed: 1 at the near plane, towards 0 far away (perspective); linear, 1 to 0, between near and far
    (orthographic).
    """
    cameras = tables.cameras
    c = view.camera
    world = np.eye(4)
    world[:3] = tables.transforms.inverse[cameras.transform[c]]
    half_x, half_y = half_extent(tables, view)
    shift_x, shift_y = cameras.shift[c]
    near, far = float(cameras.near[c]), float(cameras.far[c])
    p = np.zeros((4, 4))
    p[0, 0], p[1, 1] = 1.0 / half_x, 1.0 / half_y
    if cameras.projection[c] == PERSPECTIVE:
        p[0, 2], p[1, 2] = 2.0 * shift_x, 2.0 * shift_y
        p[2, 3] = near if near > 0.0 else 1.0
        p[3, 2] = -1.0
    else:
        p[0, 3], p[1, 3] = -2.0 * shift_x, -2.0 * shift_y
        depth_range = far - near if np.isfinite(far) else 1.0
        p[2, 2], p[2, 3] = 1.0 / depth_range, 1.0 + near / depth_range
        p[3, 3] = 1.0
    return world, p
