"""Camera models: rays of pinhole, orthographic, thin-lens and panorama cameras, and their view and projection matrices.

Image coordinates are in pixels from the top left; (0.5, 0.5) is the center of the first pixel. Cameras look down -z of their frame.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from .geometry import instance_transform
from .jit.kernel import helper, specialize_if_present
from .lanes import affine, ops
from .sampling import sobol
from .types import ClippingPlanes, Lane, Lens, Ray, Tables, Unclipped, Vec, View

PERSPECTIVE = int(ir.Projection.PERSPECTIVE)
PANORAMIC = int(ir.Projection.PANORAMIC)
HORIZONTAL = int(ir.Fit.HORIZONTAL)
PINHOLE, THIN_LENS, PANORAMA = range(3)  # kinds of Lens; a pinhole may be orthographic


@helper
def half_extent(tables: Tables, view: View) -> tuple[float, float]:
    """Half the width and height of the view in metres, at distance 1 (perspective) or everywhere (orthographic)."""
    cameras = tables.cameras
    extent = cameras.extent[view.camera]
    aspect = view.width / view.height * cameras.pixel_aspect[view.camera]
    if cameras.fit[view.camera] == HORIZONTAL:
        return extent, extent / aspect
    return extent * aspect, extent


@helper
def image_plane(tables: Tables, view: View, x: Lane, y: Lane) -> tuple[Lane, Lane]:
    """Coordinates of pixels on the image plane at distance 1, right and up, shift included."""
    half_x, half_y = half_extent(tables, view)
    shift = tables.cameras.shift
    px = (2.0 * x / view.width - 1.0 + 2.0 * shift[view.camera, 0]) * half_x
    py = (1.0 - 2.0 * y / view.height + 2.0 * shift[view.camera, 1]) * half_y
    return px, py


@helper
def generate_pinhole_ray(tables: Tables, view: View, x: Lane, y: Lane, time: Any = None) -> Ray:
    """The ray of a pinhole or orthographic camera through pixel coordinates x, y, between the near and far planes.

    `time` is that of Ray and selects the camera's position.
    """
    cameras = tables.cameras
    c = view.camera
    px, py = image_plane(tables, view, x, y)
    zero = ops.full_like(px, 0.0)
    matrix = instance_transform.transform_at(tables, cameras.transform[c], time).matrix
    if cameras.projection[c] == PERSPECTIVE:
        local = (px, py, zero - 1.0)
        stretch = ops.length(local)  # distance along the ray per distance along the axis
        origin = affine.transform_point12(matrix, (zero, zero, zero))
        direction = ops.normalize(affine.transform_vector12(matrix, local))
        return Ray(origin, direction, cameras.near[c] * stretch, cameras.far[c] * stretch, time)
    origin = affine.transform_point12(matrix, (px, py, zero))
    direction = ops.normalize(affine.transform_vector12(matrix, (zero, zero, zero - 1.0)))
    return Ray(origin, direction, zero + cameras.near[c], zero + cameras.far[c], time)


def lens_of(tables: Tables, view: View, general: bool = False) -> Lens:
    """The lens of a camera, as `generate_ray` takes it. With `general` it has clipping planes, though there may be none."""
    cameras, c = tables.cameras, view.camera
    count = int(cameras.planes[c].any(axis=1).sum())
    planes = ClippingPlanes(count) if count or general else Unclipped()
    if cameras.projection[c] == PANORAMIC:
        return Lens(PANORAMA, middle=float(cameras.shift[c, 0]), planes=planes)
    if cameras.lens[c] > 0.0:
        return Lens(THIN_LENS, float(cameras.lens[c]), float(cameras.focus[c]), planes=planes)
    return Lens(PINHOLE, planes=planes)


@helper
def generate_ray(tables: Tables, view: View, lens: Lens, x: Lane, y: Lane, pixel: Lane, sample: Lane, seed: int, time: Any) -> Ray:
    """The ray of a sample at pixel coordinates x, y, between clipping planes; `pixel` and `sample` are those of sobol.zorder_index."""
    return between_planes(lens.planes, _lens_ray(tables, view, lens, x, y, pixel, sample, seed, time), tables, view)


@helper
def _lens_ray(tables: Tables, view: View, lens: Lens, x: Lane, y: Lane, pixel: Lane, sample: Lane, seed: int, time: Any) -> Ray:
    if lens.kind == THIN_LENS:
        return _generate_lens_ray(tables, view, lens, x, y, sobol.sample_lens(pixel, sample, seed), time)
    if lens.kind == PANORAMA:
        return panorama_ray(tables, view, lens, x, y, time)
    return generate_pinhole_ray(tables, view, x, y, time)


def pinhole_ray(tables: Tables, view: View, x: NDArray[np.float64], y: NDArray[np.float64]) -> Ray:
    """The ray through pixel coordinates and the center of the lens; numpy lanes."""
    lens = lens_of(tables, view)
    ray = panorama_ray(tables, view, lens, x, y) if lens.kind == PANORAMA else generate_pinhole_ray(tables, view, x, y)
    return between_planes(lens.planes, ray, tables, view)


@helper
def _between_planes(planes: Any, ray: Ray, tables: Tables, view: View) -> Ray:
    """The part of a ray with a x + b y + c z + d >= 0 for the clipping planes (a, b, c, d) of its camera's frame, which may be empty."""
    inverse = instance_transform.transform_at(tables, tables.cameras.transform[view.camera], ray.time).inverse
    origin, along = affine.transform_point12(inverse, ray.origin), affine.transform_vector12(inverse, ray.direction)
    start, end = ray.t_min + 0.0 * along[0], ray.t_max + 0.0 * along[0]
    coefficients = tables.cameras.planes
    for k in range(planes.count):
        a, b, c = coefficients[view.camera, k, 0], coefficients[view.camera, k, 1], coefficients[view.camera, k, 2]
        height = a * origin[0] + b * origin[1] + c * origin[2] + coefficients[view.camera, k, 3]
        slope = a * along[0] + b * along[1] + c * along[2]
        cut = -height / ops.where(slope == 0.0, 1.0, slope)
        start = ops.where(slope > 0.0, ops.maximum(start, cut), start)
        end = ops.where(slope < 0.0, ops.minimum(end, cut), end)
        end = ops.where((slope == 0.0) & (height < 0.0), start, end)
    return Ray(ray.origin, ray.direction, start, ops.maximum(start, end), ray.time)


between_planes = specialize_if_present(_between_planes)  # clipping planes, ray, tables, view; the ray itself without clipping planes


@helper
def _generate_lens_ray(tables: Tables, view: View, lens: Any, x: Lane, y: Lane, place: tuple[Lane, Lane], time: Any) -> Ray:
    """The ray from a point on the unit lens to the pinhole ray's point in the plane of focus (Cook, Porter, Carpenter 1984)."""
    cameras, c = tables.cameras, view.camera
    px, py = image_plane(tables, view, x, y)
    from_x, from_y = place[0] * lens.radius, place[1] * lens.radius
    zero = ops.full_like(px, 0.0)
    local = (px - from_x / lens.focus, py - from_y / lens.focus, zero - 1.0)
    stretch = ops.length(local)
    matrix = instance_transform.transform_at(tables, cameras.transform[c], time).matrix
    origin = affine.transform_point12(matrix, (from_x, from_y, zero))
    direction = ops.normalize(affine.transform_vector12(matrix, local))
    return Ray(origin, direction, cameras.near[c] * stretch, cameras.far[c] * stretch, time)


@helper
def panorama_ray(tables: Tables, view: View, lens: Any, x: Lane, y: Lane, time: Any = None) -> Ray:
    """The ray of a panorama: its center is straight ahead, left and right edges join behind; near and far are distances."""
    cameras, c = tables.cameras, view.camera
    turn = (x / view.width - 0.5 + lens.middle) * (2.0 * math.pi)
    rise = (0.5 - y / view.height) * math.pi
    level = ops.cos(rise)
    zero = ops.full_like(turn, 0.0)
    matrix = instance_transform.transform_at(tables, cameras.transform[c], time).matrix
    origin = affine.transform_point12(matrix, (zero, zero, zero))
    direction = affine.transform_vector12(matrix, (level * ops.sin(turn), ops.sin(rise), zero - level * ops.cos(turn)))
    return Ray(origin, ops.normalize(direction), zero + cameras.near[c], zero + cameras.far[c], time)


def depth(tables: Tables, view: View, point: Vec) -> Lane:
    """Distance of a world point along the camera's axis, or from a panorama's position, in metres; numpy lanes."""
    row = tables.cameras.transform[view.camera]
    local = affine.transform_point(tables.transforms.inverse, row, point)
    return ops.length(local) if tables.cameras.projection[view.camera] == PANORAMIC else -local[2]


def projection_matrices(tables: Tables, view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """View matrix C⁻¹ (world to camera) and projection matrix P (camera to clip space) of the course, (4, 4) each.

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
