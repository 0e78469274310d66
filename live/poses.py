"""Camera poses: reads one from a scene's tables, puts one into them, and writes one in the language."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..compiler import ir
from ..compiler.scene import transforms
from ..compiler.scene.row_records import as_color
from .state import Pose

FILM_HEIGHT = 0.024  # metres, of an aperture number
DISTANCE = 5.0  # metres to the point that a camera looks at, if nothing is there


def read(scene: ir.Scene, camera: int, distance: float | None = None) -> Pose:
    """The pose of a camera. `distance` is to the point that it looks at, in metres."""
    cameras = scene.tables.cameras
    matrix = scene.tables.transforms.matrix[cameras.transform[camera]]
    eye, up, back = matrix[:, 3], matrix[:, 1], matrix[:, 2]
    away = distance if distance is not None and math.isfinite(distance) and distance > 0.0 else DISTANCE
    target = eye - away * back / max(float(np.linalg.norm(back)), 1e-300)
    return Pose(as_color(eye), as_color(target), as_color(up / max(float(np.linalg.norm(up)), 1e-300)), float(cameras.extent[camera]))


def place(scene: ir.Scene, camera: int, pose: Pose) -> ir.Scene:
    """The scene with a camera at `pose`, without motion. The same scene if the pose has no direction."""
    frame = transforms.looking(pose.position, pose.look_at, pose.up)
    inverse = None if frame is None else transforms.inverse(frame)
    if frame is None or inverse is None:
        return scene
    tables, cameras = scene.tables, scene.tables.cameras
    old = tables.transforms
    row = len(old.matrix)
    moved = ir.Transforms(
        np.concatenate([old.matrix, frame[None, :3]]), np.concatenate([old.inverse, inverse[None, :3]]),
        np.append(old.flips, False), np.append(old.first_key, np.int32(-1)), np.append(old.keys, np.int32(0)),
    )  # fmt: skip
    of_camera, extent = cameras.transform.copy(), cameras.extent.copy()
    of_camera[camera] = row
    if pose.extent is not None:
        extent[camera] = pose.extent
    focus = cameras.focus.copy()
    if cameras.lens[camera] > 0.0:
        focus[camera] = math.dist(pose.position, pose.look_at)
    placed = cameras._replace(transform=of_camera, extent=extent, focus=focus)
    return replace(scene, tables=tables._replace(transforms=moved, cameras=placed))


def source_text(scene: ir.Scene, camera: int, pose: Pose, size: tuple[int, int]) -> str:
    """The camera as source of a .scene file, with lengths in metres. `size` is that of the picture in pixels."""
    cameras = scene.tables.cameras
    extent = float(cameras.extent[camera]) if pose.extent is None else pose.extent
    parts = [f"position: {_lengths(pose.position)}", f"look_at: {_lengths(pose.look_at)}"]
    if math.dist(pose.up, (0.0, 1.0, 0.0)) > 1e-6:
        parts.append(f"up: [{', '.join(_short(v) for v in pose.up)}]")
    horizontal = cameras.fit[camera] == ir.Fit.HORIZONTAL
    projection = cameras.projection[camera]
    aspect = size[0] / size[1]
    if projection == ir.Projection.PANORAMIC:
        parts.append('projection: "panoramic"')
    elif projection == ir.Projection.ORTHOGRAPHIC:
        parts.append(f"width: {_short(2.0 * extent * (1.0 if horizontal else aspect))}m")
    else:
        extent = extent / aspect if horizontal else extent
        parts.append(f"fov: {_short(math.degrees(2.0 * math.atan(extent)))}deg")
        if cameras.lens[camera] > 0.0:
            aperture = FILM_HEIGHT / 2.0 / extent / (2.0 * float(cameras.lens[camera]))
            parts += [f"aperture: {_short(aperture)}", f"focus: {_short(math.dist(pose.position, pose.look_at))}m"]
    if math.isfinite(cameras.exposure[camera]):
        parts.append(f"exposure: {_short(float(cameras.exposure[camera]))}ev")
    names = scene.names.cameras
    if camera < len(names) and names[camera] and not any(d.startswith("camera") for d in scene.defaults):
        parts.append(f'name: "{names[camera]}"')
    return f"camera({', '.join(parts)})"


def _lengths(values: tuple[float, float, float]) -> str:
    return f"[{', '.join(f'{_short(v)}m' for v in values)}]"


def _short(value: float) -> str:
    text = f"{value:.5g}"
    return f"{value:.6f}".rstrip("0").rstrip(".") if "e" in text else ("0" if text == "-0" else text)
