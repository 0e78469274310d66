"""Texture footprints of pixels: derivatives of texture coordinates at a surface, and mip pyramids of images.

The derivatives are those of the tangent plane (Igehy 1999, Tracing Ray Differentials), in closed form for camera rays. Secondary rays carry
a cone of the pixel's width. Planes keep it and mirroring spheres widen it (Amanatides, "Ray Tracing with Cones", 1984; Akenine-Möller and
others 2019, Texture Level of Detail Strategies for Real-Time Ray Tracing). After other curved surfaces, images are not filtered. A pixel is
an ellipse on the image: its short axis selects the level (Williams 1983, Pyramidal Parametrics), and up to sixteen samples lie along its
long axis (McCormack and others 1999, Feline). On checkers and stripes it is a parallelogram, see checker_filter.py.
"""

from __future__ import annotations

import functools
import weakref
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_rules
from .. import camera
from ..jit.kernel import helper, make_replace, separate_helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import affine, crosslane, ops
from ..simd.registration import overload, types
from ..texture import textures
from ..types import Hit, Lane, Ray, Surface, Tables, Vec, View
from . import interaction, normal_map

MESH = int(ir.GeometryKind.MESH)
LEVELS = 20  # levels of an image, at most
BAND = 1 << 16  # texels that are averaged together: so many stay in the processor's cache
LARGEST = np.finfo(np.float32).max
HALF = np.float32(0.5)
WIDEST = 2048  # texels of an odd side that are averaged in one matrix product
BLOCK = 128  # averages of a wider side in each of several products
FOOTPRINT_PARTS = {
    "pictures": "images are filtered",
    "cells": "checkers and stripes are filtered",
    "formulas": "patterns are filtered",
    "coordinates": "changes of u and v are stored, which all textures but formulas need",
    "places": "changes of the position are stored, in the instance's frame",
    "cones": "secondary rays have cones; the last numbers of a spread are the width, its growth per metre, and whether mirrored",
}  # a part of value 0 is compiled and not used
WITH_CONE = (7, 13)  # lengths of Surface.spread whose last three lanes describe the ray's cone
SPHERE = int(ir.GeometryKind.SPHERE)
BOX, PLANE, RECTANGLE, DISK = (int(getattr(ir.GeometryKind, name)) for name in ("BOX", "PLANE", "RECTANGLE", "DISK"))
_lying = make_replace(Surface, "geometric", "spread")


class Eye(NamedTuple):
    """Origin of camera rays, and their change from pixel to pixel."""

    place: NDArray[np.float64]  # (3,)
    axis: NDArray[np.float64]  # (3,) unit
    right: NDArray[np.float64]  # (3,) change of a ray's direction at depth 1 per pixel; for an orthographic camera, of its origin
    down: NDArray[np.float64]
    perspective: bool
    step: float  # width of a sample, in pixels


class Pyramids(NamedTuple):
    """Images with their mip levels; the first four columns are those of ir.Images."""

    first: NDArray[np.int64]
    width: NDArray[np.int32]
    height: NDArray[np.int32]
    texels: NDArray[np.float32]
    levels: NDArray[np.int32]  # (n,) number of levels
    level_first: NDArray[np.int64]  # (n, LEVELS)
    level_width: NDArray[np.int32]
    level_height: NDArray[np.int32]
    eye: Eye
    footprint: Any  # a NamedTuple: the types of its fields select the code of kernels


_made: dict[int, tuple[Any, Pyramids]] = {}  # by id of the source images, while these exist


def without_filter(tables: ir.Tables) -> ir.Tables:
    """Tables for kernels that can filter textures, with every filter off and no mip levels."""
    images = tables.images
    levels = (len(images.width), LEVELS)
    first = np.repeat(images.first, LEVELS).reshape(levels)
    width, height = np.repeat(images.width, LEVELS).reshape(levels), np.repeat(images.height, LEVELS).reshape(levels)
    nowhere = Eye(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), True, 1.0)
    parts = _footprint_type(tuple(FOOTPRINT_PARTS))._make([0] * len(FOOTPRINT_PARTS))
    return tables._replace(images=Pyramids(*images, np.ones(len(images.width), np.int32), first, width, height, nowhere, parts))


def with_pyramids(tables: ir.Tables, view: View, samples: int, further: bool, general: bool = False) -> ir.Tables:
    """Tables whose images have mip levels, for pixels of a view with `samples` samples; `further` if there are secondary rays.

    With `general`, the parts of footprints that the scene does not need are there, too, with value 0.
    """
    images = tables.images
    key = id(images.texels)
    if key not in _made or _made[key][0]() is not images.texels:
        _made[key] = weakref.ref(images.texels, lambda _: _made.pop(key, None)), build_pyramids(images)
    pyramids = _made[key][1]
    ray = camera.generate_pinhole_ray(tables, view, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    start, direction = (np.stack([np.broadcast_to(c, 3) for c in vector], axis=1) for vector in (ray.origin, ray.direction))
    matrix = tables.transforms.matrix[tables.cameras.transform[view.camera]]
    axis = -matrix[:, 2] / np.linalg.norm(matrix[:, 2])
    perspective = bool(tables.cameras.projection[view.camera] == ir.Projection.PERSPECTIVE)
    moved = direction / (direction @ axis)[:, None] if perspective else start
    step = 1.0 / np.sqrt(samples)
    eye = Eye(matrix[:, 3].copy(), axis, (moved[1] - moved[0]) * step, (moved[2] - moved[0]) * step, perspective, float(step))
    return tables._replace(images=pyramids._replace(eye=eye, footprint=_footprint_parts(tables.textures, samples, further, general)))


def _footprint_parts(rows: ir.Textures, samples: int, further: bool, general: bool) -> Any:
    """The parts of a footprint that a scene's textures need, and which textures need them."""
    formula = rows.kind == ir.TextureKind.FORMULA
    formulas = formula.any() and samples < scene_rules.MANY_SAMPLES
    pictures = (rows.kind == ir.TextureKind.IMAGE) & ~rows.nearest
    cells = ir.is_in(rows.kind, (ir.TextureKind.CHECKER, ir.TextureKind.STRIPES))
    places = formulas or (~formula & (rows.mapping != ir.TextureMapping.UV)).any()
    graphs = formulas and hasattr(rows, "lookups")
    needed = (pictures.any(), cells.any(), formulas, (pictures | cells).any() or graphs, places)
    needed += (further and bool(pictures.any() or cells.any() or formulas),)
    parts = {name: int(yes) for name, yes in zip(FOOTPRINT_PARTS, needed, strict=True) if yes or general}
    return _footprint_type(tuple(parts))(**parts)


@functools.cache
def _footprint_type(names: tuple[str, ...]) -> Any:
    return namedtuple("Footprint", names)


def build_pyramids(images: ir.Images) -> Pyramids:
    """The mip pyramids of a scene's images, in tables for kernels."""
    count = len(images.width)
    first = np.zeros((count, LEVELS), np.int64)
    width, height = np.ones((count, LEVELS), np.int32), np.ones((count, LEVELS), np.int32)
    levels, total = np.zeros(count, np.int32), 0
    for row in range(count):
        w, h = int(images.width[row]), int(images.height[row])
        for k in range(LEVELS):
            first[row, k], width[row, k], height[row, k] = total, w, h
            total += w * h
            levels[row] = k + 1
            if (w, h) == (1, 1):
                break
            w, h = max(w // 2, 1), max(h // 2, 1)
    texels = np.empty((total, 4), np.float32)
    for row in range(count):
        chain = [
            texels[start : start + w * h].reshape(h, w, 4)
            for start, w, h in zip(first[row].tolist(), width[row].tolist(), height[row].tolist(), strict=True)
        ][: levels[row]]
        start = int(images.first[row])
        chain[0][...] = images.texels[start : start + chain[0].size // 4].reshape(chain[0].shape)
        for k in range(1, len(chain)):
            _halve(chain[k - 1], chain[k])
    nowhere = Eye(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), True, 1.0)
    return Pyramids(first[:, 0].copy(), images.width, images.height, texels, levels, first, width, height, nowhere, _footprint_type(())())


def _halve(level: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Write half as many texels along both axes, each the mean of its area, which keeps the image's mean."""
    even = level.shape[:2] == (2 * out.shape[0], 2 * out.shape[1])
    step = max(1, BAND // level.shape[1]) if even else len(out)
    for first in range(0, len(out), step):
        rows = level[2 * first : 2 * (first + step)] if even else level
        out[first : first + step] = _halve_along(_halve_along(rows, 0), 1)


def _halve_along(level: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Half as many texels along an axis."""
    n = level.shape[axis]
    m = max(n // 2, 1)
    if n == 2 * m:
        even, odd = (level[::2], level[1::2]) if axis == 0 else (level[:, ::2], level[:, 1::2])
        try:
            with np.errstate(over="raise"):
                half = even + odd
                half *= HALF
        except FloatingPointError:  # sums of texels near the largest float
            half = even * HALF + odd * HALF
        return half
    edges, parts = np.arange(m + 1) * (n / m), []
    block = m if n <= WIDEST else BLOCK  # products with all texels of a wide image take time as the square of its width
    for first in range(0, m, block):
        bounds, texels = edges[first : first + block + 1, None], slice(2 * first, min(2 * (first + block) + 1, n))
        places = np.arange(texels.start, texels.stop)
        share = np.clip(np.minimum(bounds[1:], places + 1) - np.maximum(bounds[:-1], places), 0.0, None) * (m / n)
        block_texels = level[texels] if axis == 0 else level[:, texels]
        with np.errstate(over="ignore"):  # shares may add up to little more than 1
            mean = np.tensordot(share.astype(np.float32), block_texels, axes=(1, axis))
        parts.append(np.moveaxis(np.clip(mean, -LARGEST, LARGEST, out=mean), 0, axis))
    return np.concatenate(parts, axis=axis) if len(parts) > 1 else parts[0]


# --- derivatives of coordinates ----------------------------------------------------------------------------------------------------


def on_surface(tables: Tables, ray: Ray, hit: Hit, point: Surface, cone: Any) -> Surface:
    """The surface at a hit with its footprint (Surface.spread), from the ray's cone for secondary rays.

    In scenes without filtered textures, the surface is unchanged.
    """
    return _on_surface(tables, ray, hit, point, cone) if isinstance(tables.images, Pyramids) else point


@overload(on_surface)
def _on_surface_in_kernels(tables, ray, hit, point, cone):
    if isinstance(tables, HandleType) and tables.field("images.levels") is not None:
        return lambda tables, ray, hit, point, cone: _on_surface(tables, ray, hit, point, cone)
    return lambda tables, ray, hit, point, cone: point


def is_known(tables: Tables) -> Any:
    """True, or None in scenes without filtered textures."""
    return True if isinstance(tables.images, Pyramids) else None


@overload(is_known)
def _is_known_in_kernels(tables):
    if isinstance(tables, HandleType) and tables.field("images.levels") is not None:
        return lambda tables: True
    return lambda tables: None


def of_pixel(tables: Tables, spread: Any, point: Surface) -> Any:
    """The footprint from derivatives over a whole pixel; the point's position is relative to the eye."""
    raise NotImplementedError("in kernels only")


@overload(of_pixel)
def _of_pixel_in_kernels(tables, spread, point):
    if not isinstance(tables, HandleType) or tables.field("images.levels") is None:
        return lambda tables, spread, point: None
    if tables.field("images.footprint.places") is not None:
        return lambda tables, spread, point: (*_of_pixel(tables, spread), *_places_of_pixel(tables, point))
    return lambda tables, spread, point: _of_pixel(tables, spread)


@helper
def _of_pixel(tables: Any, spread: Any) -> Any:
    step = tables.images.eye.step
    return spread[0] * step, spread[1] * step, spread[2] * step, spread[3] * step


@helper
def _places_of_pixel(tables: Any, point: Surface) -> Any:
    """Change of the position per pixel, right and down, in the instance's frame."""
    eye = tables.images.eye
    along, depth = (eye.axis[0], eye.axis[1], eye.axis[2]), 1.0 + 0.0 * point.offset
    outward = affine.transform_normal(tables.transforms.inverse, tables.instances.transform[point.instance], point.local_normal)
    d = ops.add(along, (depth - 1.0, depth - 1.0, depth - 1.0))
    if eye.perspective:
        depth = ops.dot(point.position, along)
        d = ops.scale(point.position, 1.0 / depth)
    facing = ops.dot(d, outward)
    facing = ops.where(ops.absolute(facing) > 1e-12, facing, 1e-12)
    flat = _lying(point, outward, None)
    right = _over_pixel(tables, (eye.right[0], eye.right[1], eye.right[2]), depth, d, facing, flat)
    below = _over_pixel(tables, (eye.down[0], eye.down[1], eye.down[2]), depth, d, facing, flat)
    return (*right, *below)


@separate_helper
def _on_surface(tables: Any, ray: Ray, hit: Hit, point: Surface, cone: Any) -> Surface:
    zero = 0.0 * point.offset
    spread = (zero, zero, zero, zero)
    right, down = (zero, zero, zero), (zero, zero, zero)
    eye: Any = tables.images.eye
    d = ray.direction
    along = d[0] * eye.axis[0] + d[1] * eye.axis[1] + d[2] * eye.axis[2]
    from_eye = (ray.origin[0] == eye.place[0]) & (ray.origin[1] == eye.place[1]) & (ray.origin[2] == eye.place[2])
    distance = ops.where(ops.is_finite(hit.t), hit.t, 0.0)
    depth = distance * along
    if not eye.perspective:
        from_eye, depth = along >= 1.0 - 1e-12, zero + 1.0
    wide = width_at(cone, zero, distance)
    has_footprint = (from_eye | (wide > 0.0)) & textures.has_texture(tables, point.material) & _is_used(tables)
    if ops.any_lane(has_footprint):
        facing = ops.minimum(ops.dot(d, point.geometric), -1e-9)
        to_right = ops.like3(zero, eye.right[0], eye.right[1], eye.right[2])
        below = ops.like3(zero, eye.down[0], eye.down[1], eye.down[2])
        to_right, below, depth = _of_cone(cone, (to_right, below, depth), from_eye, d, wide)
        right = _over_pixel(tables, to_right, depth, d, facing, point)
        down = _over_pixel(tables, below, depth, d, facing, point)
        u0, v0 = _coordinates(tables, right, hit, point)
        u1, v1 = _coordinates(tables, down, hit, point)
        spread = (
            ops.where(has_footprint, u0, 0.0), ops.where(has_footprint, v0, 0.0), ops.where(has_footprint, u1, 0.0),
            ops.where(has_footprint, v1, 0.0)
        )  # fmt: skip
        nowhere = (zero, zero, zero)
        right, down = ops.where3(has_footprint, right, nowhere), ops.where3(has_footprint, down, nowhere)
    return interaction.replace_spread(point, _with_cone(cone, _make_spread(tables, spread, right, down), tables, point, wide))


# --- secondary rays ----------------------------------------------------------------------------------------------------


def cone_of_eye(tables: Tables, ray: Ray) -> Any:
    """(width of camera rays at their origin, growth per metre), by the area of a pixel; None without filtered textures."""
    return _cone_of_eye(tables, ray) if hasattr(getattr(tables.images, "footprint", None), "cones") else None


@overload(cone_of_eye)
def _cone_of_eye_in_kernels(tables, ray):
    if isinstance(tables, HandleType) and tables.field("images.levels") is not None and tables.field("images.footprint.cones") is not None:
        return lambda tables, ray: _cone_of_eye(tables, ray)
    return lambda tables, ray: None


@helper
def _cone_of_eye(tables: Any, ray: Ray) -> tuple[Lane, Lane]:
    eye = tables.images.eye
    zero = 0.0 * ray.direction[0]
    if tables.images.footprint.cones == 0:
        return zero, zero
    across = ops.cross((eye.right[0], eye.right[1], eye.right[2]), (eye.down[0], eye.down[1], eye.down[2]))
    side = ops.sqrt(zero + ops.length(across))
    if not eye.perspective:
        return side, zero
    along = ray.direction[0] * eye.axis[0] + ray.direction[1] * eye.axis[1] + ray.direction[2] * eye.axis[2]
    return zero, side * along * ops.sqrt(ops.maximum(along, 0.0))  # an oblique pixel is farther away and foreshortened


@helper
def _width_at(cone: Any, default: Any, distance: Lane) -> Lane:
    return ops.absolute(cone[0] + cone[1] * distance)


@helper
def _steps_of_cone(cone: Any, steps: Any, from_eye: Lane, d: Vec, wide: Lane) -> tuple[Vec, Vec, Lane]:
    right, down, depth = steps
    first, second = ops.basis(d)
    right = ops.where3(from_eye, right, ops.scale(first, wide))
    return right, ops.where3(from_eye, down, ops.scale(second, wide)), ops.where(from_eye, depth, 1.0)


@helper
def _spread_with_cone(cone: Any, spread: Any, tables: Any, point: Surface, wide: Lane) -> Any:
    g = ops.to_int(tables.instances.geometry[point.instance])
    kind = ops.to_int(tables.geometries.kind[g])
    flat, ball = (kind == MESH) | (kind == BOX) | (kind == PLANE) | (kind == RECTANGLE) | (kind == DISK), kind == SPHERE
    wide, on = ops.where(flat | ball, wide, 0.0), ops.where(flat | ball, cone[1], 0.0)
    bent = 0.0 * wide
    if ops.any_lane(ball):
        first, second = ops.basis(point.geometric)
        matrix, rows = tables.transforms.inverse, ops.to_int(tables.instances.transform[point.instance])
        stretch_u, stretch_v = affine.transform_vector(matrix, rows, first), affine.transform_vector(matrix, rows, second)
        size = ops.sqrt(ops.length(stretch_u) * ops.length(stretch_v))
        curved = size / ops.where(ball, tables.geometries.parameters[g, 0], 1.0)
        bent = ops.where(ball, 2.0 * wide * ops.where(point.front, curved, -curved), 0.0)
    return *spread, wide, on, on + bent


@helper
def _put_cone(point: Surface, direction: Vec, stack: Any, place: Lane, field: int, active: Lane) -> None:
    wide, on, mirrored = point.spread[-3], point.spread[-2], point.spread[-1]
    back = ops.dot(direction, point.geometric) > 0.0
    keeps_cone = ops.dot(point.normal, point.geometric) > 1.0 - 1e-9  # neither an interpolated nor a perturbed normal
    keeps_cone = keeps_cone & (back | (mirrored == on))
    crosslane.stack_store(stack, place, field, ops.where(keeps_cone, wide, 0.0), active)
    crosslane.stack_store(stack, place, field + 1, ops.where(keeps_cone, ops.where(back, mirrored, on), 0.0), active)


def put_cone(point: Surface, direction: Vec, stack: Any, place: Lane, field: int, active: Lane) -> None:
    """Write the cone of rays that leave a surface to two fields, where it is known."""
    if point.spread is not None and len(point.spread) in WITH_CONE:
        _put_cone(point, direction, stack, place, field, active)


@overload(put_cone)
def _put_cone_in_kernels(point, direction, stack, place, field, active):
    spread = dict(zip(point.fields, point.types, strict=True))["spread"]
    if isinstance(spread, types.BaseTuple) and len(spread) in WITH_CONE:
        return lambda point, direction, stack, place, field, active: _put_cone(point, direction, stack, place, field, active)
    return lambda point, direction, stack, place, field, active: None


@helper
def _take_cone(cone: Any, default: Any, stack: Any, place: Lane, field: int) -> tuple[Lane, Lane]:
    return crosslane.stack_load(stack, place, field), crosslane.stack_load(stack, place, field + 1)


width_at = specialize_if_present(_width_at)
_of_cone = specialize_if_present(_steps_of_cone)
_with_cone = specialize_if_present(_spread_with_cone)
take_cone = specialize_if_present(_take_cone)  # of queued rays: None, stack, position, first field


# --- along a surface ----------------------------------------------------------------------------------------------------


def _is_used(tables: Any) -> bool:
    """Whether some part of a footprint is used."""
    return any(tables.images.footprint)


@overload(_is_used)
def _is_used_in_kernels(tables):
    """A part is 0 in general kernels alone, which have all of them."""
    if all(tables.field(f"images.footprint.{name}") is not None for name in FOOTPRINT_PARTS):
        return lambda tables: tables.images.footprint.coordinates + tables.images.footprint.places > 0
    return lambda tables: True


def _make_spread(tables: Any, spread: Any, right: Vec, down: Vec) -> Any:
    """Surface.spread."""
    return spread + right + down if hasattr(tables.images.footprint, "places") else spread


@overload(_make_spread)
def _make_spread_in_kernels(tables, spread, right, down):
    if tables.field("images.footprint.places") is not None:
        return lambda tables, spread, right, down: (*spread, *right, *down)
    return lambda tables, spread, right, down: spread


@helper
def _over_pixel(tables: Any, step: Vec, depth: Lane, d: Vec, facing: Lane, point: Surface) -> Vec:
    """Change of the position from pixel to pixel along the tangent plane, in the instance's frame."""
    moved = ops.sub(ops.scale(step, depth), ops.scale(d, ops.dot(step, point.geometric) * depth / facing))
    return affine.transform_vector(tables.transforms.inverse, ops.to_int(tables.instances.transform[point.instance]), moved)


def _coordinates(tables: Any, way: Vec, hit: Hit, point: Surface) -> tuple[Lane, Lane]:
    """Change of texture coordinates along a displacement."""
    return _mapped_change(tables, way, hit, point)


@overload(_coordinates)
def _coordinates_in_kernels(tables, way, hit, point):
    if tables.field("images.footprint.coordinates") is not None:
        return lambda tables, way, hit, point: _change_if_used(tables, way, hit, point)
    return lambda tables, way, hit, point: (0.0 * way[0], 0.0 * way[0])


@helper
def _change_if_used(tables: Any, way: Vec, hit: Hit, point: Surface) -> tuple[Lane, Lane]:
    if tables.images.footprint.coordinates == 0:
        return 0.0 * way[0], 0.0 * way[0]
    return _mapped_change(tables, way, hit, point)


@separate_helper
def _mapped_change(tables: Any, way: Vec, hit: Hit, point: Surface) -> tuple[Lane, Lane]:
    moved = normal_map.shift_point(tables, point, hit, way, 1.0)
    du, dv = moved.uv[0] - point.uv[0], moved.uv[1] - point.uv[1]
    kind = tables.geometries.kind[tables.instances.geometry[point.instance]]
    return ops.where(kind == MESH, du, du - ops.floor(du + 0.5)), dv  # other shapes may have a seam
