"""Shadow-map pass: rasterizes the depth seen from each light without extent, by one camera or six."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...lights import DISTANT, LIGHTS, POINTS
from ..geometry.bounds import world_bounds
from ..jit import packed_struct
from ..light.shadow_map import Maps
from ..tessellation.view import ViewTessellator
from ..types import ShadowRays, View
from . import band_buffer, integrator_shading, meshlet_culling, raster_scene, triangle_setup, view_geometry
from .meshlets import SHIFT

SIZE = 2048  # texels, side of the map of a directional light or spot
FACE = 1024  # texels, side of each of a point light's six maps
ROWS = 64  # of a band
SPOT_ANGLE = 1.2  # radians, half angle: wider spots use six maps
BORDER = 3.0  # texels around a map, for the filter
TOLERANCE = 0.5  # texels, of tessellation


def build(tables: ir.Tables, accel: packed_struct.Handle) -> Maps | ShadowRays:
    """The shadow maps of a scene's lights; `accel` is a handle of its BVH."""
    lights = tables.lights
    first, count, map_cameras = np.full(len(lights.kind), -1), np.zeros(len(lights.kind), np.int64), []
    for light in range(len(lights.kind)):
        if lights.kind[light] in POINTS + DISTANT and lights.shadows[light] and (lights.color[light] > 0.0).any():
            first[light] = len(map_cameras)
            map_cameras += _cameras_of(tables, light)
            count[light] = len(map_cameras) - first[light]
    if not map_cameras:
        return ShadowRays()
    seen = _with_cameras(tables, map_cameras)
    views = [View(len(tables.cameras.projection) + k, camera.size, camera.size) for k, camera in enumerate(map_cameras)]
    texels = [_render(seen, view, accel) for view in views]
    clip = np.stack([view_geometry.world_to_clip(seen, view)[[0, 1, 3]] for view in views])
    inverse = np.zeros_like(clip)
    inverse[:, :, :3] = np.linalg.inv(clip[:, :, :3])
    size = np.array([camera.size for camera in map_cameras], np.int64)
    texel = np.array([2.0 * camera.extent / camera.size for camera in map_cameras])
    start = np.concatenate([[0], np.cumsum(size * size)[:-1]]).astype(np.int64)
    key, instance = (np.concatenate(columns) for columns in zip(*texels, strict=True))
    return Maps(first.astype(np.int64), count, np.ascontiguousarray(clip), np.ascontiguousarray(inverse), texel, size, start, key, instance)


class _ShadowCamera(NamedTuple):
    """A camera at a light."""

    frame: NDArray[np.float64]  # (3, 4) to the world
    extent: float
    parallel: bool
    size: int


def _cameras_of(tables: ir.Tables, light: int) -> list[_ShadowCamera]:
    """The cameras whose views hold all that a light illuminates: one, or six around it."""
    lights = tables.lights
    kind, position, direction = int(lights.kind[light]), lights.position[light], lights.direction[light]
    if kind in DISTANT:
        return [_parallel_camera(tables, direction)]
    widest = LIGHTS[kind].widest
    if widest is not None and (angle := widest(lights, light)) < SPOT_ANGLE:
        extent = math.tan(angle) * (1.0 + 2.0 * BORDER / SIZE)
        return [_ShadowCamera(_frame(-direction, position), extent, False, SIZE)]
    sides = [sign * axis for axis in np.eye(3) for sign in (-1.0, 1.0)]
    return [_ShadowCamera(_frame(-side, position), 1.0 + 2.0 * BORDER / FACE, False, FACE) for side in sides]


def _parallel_camera(tables: ir.Tables, towards: NDArray[np.float64]) -> _ShadowCamera:
    """An orthographic camera along a directional light, whose view holds all bounded instances."""
    boxes = world_bounds(tables)
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    low, high = (boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)) if len(boxes) else (-np.ones(3), np.ones(3))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    frame = _frame(towards, middle)
    reach = np.abs(frame[:, :3].T) @ half
    extent = max(float(reach[:2].max()), 1e-9) * (1.0 + 2.0 * BORDER / SIZE)
    frame[:, 3] += towards / np.linalg.norm(towards) * (float(reach[2]) + extent)
    return _ShadowCamera(frame, extent, True, SIZE)


def _frame(back: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 4) frame of a camera at a position that looks opposite to `back`."""
    z = back / np.linalg.norm(back)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z, position], axis=1)


def _with_cameras(tables: ir.Tables, map_cameras: list[_ShadowCamera]) -> ir.Tables:
    """Tables with one more camera for each map; shadow casters are visible to cameras."""
    n, rows = len(map_cameras), len(tables.transforms.matrix)
    frames = np.stack([camera.frame for camera in map_cameras])
    turned = frames[:, :, :3].transpose(0, 2, 1)
    inverse = np.concatenate([turned, -(turned @ frames[:, :, 3:])], axis=2)
    more = {"matrix": frames, "inverse": inverse, "flips": np.zeros(n, bool), "first_key": np.full(n, -1), "keys": np.zeros(n, int)}
    transforms = ir.table_of("transforms", {k: np.concatenate([v, more[k]]) for k, v in tables.transforms._asdict().items()})
    none = np.zeros(n)
    cameras = {
        "projection": [ir.Projection.ORTHOGRAPHIC if camera.parallel else ir.Projection.PERSPECTIVE for camera in map_cameras],
        "transform": rows + np.arange(n), "extent": [camera.extent for camera in map_cameras], "fit": np.full(n, int(ir.Fit.VERTICAL)),
        "aspect": none, "near": none, "far": none + np.inf, "shift": np.zeros((n, 2)), "exposure": none + np.nan,
        "opening": none, "shutter": none, "lens": none, "focus": none + 1.0, "pixel_aspect": none + 1.0,
        "planes": np.zeros((n, ir.CLIP_PLANES, 4)),
    }  # fmt: skip
    grown = ir.table_of("cameras", {k: np.concatenate([v, np.asarray(cameras[k])]) for k, v in tables.cameras._asdict().items()})
    casts = tables.instances.visible & ir.Visibility.SHADOW != 0
    visible = np.where(casts, int(ir.Visibility.CAMERA), 0)
    return tables._replace(
        transforms=transforms, cameras=grown, instances=ir.table_of("instances", {**tables.instances._asdict(), "visible": visible})
    )


def _render(tables: ir.Tables, view: View, accel: packed_struct.Handle) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """(keys, instances) of a map's texels, row by row; -inf and -1 where empty."""
    tessellations = ViewTessellator(tables, view, TOLERANCE).tessellations(tables)
    scene, packed, pattern = (
        raster_scene.build(tables, view, tessellations),
        packed_struct.Handle(tables),
        packed_struct.Handle(band_buffer.pattern(1)),
    )
    visible = meshlet_culling.find_visible(scene.projection, scene.meshlets, scene.meshlet_ranges, (0, 0, view.width, view.height), 0, ROWS)
    band = packed_struct.Handle(band_buffer.band_buffer(view.width, ROWS, 1))
    filling = packed_struct.Handle(band_buffer.Filling(scene.projection, pattern, scene.meshlets, visible, band))
    keys, ids = np.empty((view.height, view.width), np.float32), np.empty((view.height, view.width), np.int32)
    rows: Any = band.tables
    for number, top in enumerate(range(0, view.height, ROWS)):
        rows.window[:2] = 0, top
        rows.clip[:] = 0, top, view.width, top + ROWS
        triangle_setup.draw_band(filling, number)
        if len(scene.untessellated):
            integrator_shading.draw_untessellated(scene.model, scene.untessellated, scene.boxes, packed, accel, view, pattern, band)
        for texels, part in ((keys, rows.key), (ids, rows.ids)):
            texels[top : top + ROWS] = band_buffer.to_rows(part, ROWS, view.width)
    mapped: Any = visible.tables
    exact = ids > integrator_shading.UNTESSELLATED
    owner = np.where(exact, ids & integrator_shading.UNTESSELLATED, mapped.instance[np.where(exact, 0, np.maximum(ids, 0) >> SHIFT)])
    return np.where(ids >= 0, keys, -np.inf).astype(np.float32).ravel(), np.where(ids >= 0, owner, -1).astype(np.int32).ravel()
