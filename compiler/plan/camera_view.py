"""Warns of a camera that sees none of the shapes, and of one that is shut in an opaque solid with nothing else."""

from __future__ import annotations

import numpy as np

from ...lang.diagnostics import Diagnostics
from .. import ir
from ..ir import F64
from . import enclosed_lights

WIDEST = 4.0  # times the field of view, beyond which a shape is outside of pictures of any shape
MOST_INSTANCES = 1 << 18  # that are tested: a tenth of a second
MOST_TRIANGLES = 1 << 20  # of all meshes around a camera


def warn_of_cameras(scene: ir.Scene, diagnostics: Diagnostics, is_whole: bool = True) -> None:
    """Warn of the scene's camera if it certainly sees no shape, or the inner side of one opaque solid alone.

    In a scene that is not whole, boxes stand in for meshes and solids: they are not tested for what is inside of them.
    A camera, or an instance, that moves while the shutter is open is not tested.
    """
    tables = scene.tables
    count = len(tables.instances.geometry)
    if not len(tables.cameras.transform) or not 0 < count <= MOST_INSTANCES or (tables.transforms.first_key >= 0).any():
        return
    named = scene.settings.camera
    camera = scene.names.cameras.index(named) if named and named in scene.names.cameras else 0
    bounds = tables.geometries.bounds[tables.instances.geometry]
    span = scene.spans.get("cameras", camera)
    if _sees_nothing(tables, camera, bounds):
        where = "the shape is" if count == 1 else f"all {count:,} shapes are"
        diagnostics.warning(f"the camera sees no shape: {where} behind it or outside of its view", span, _middle(tables, bounds))
        return
    solid = _solid_around(tables, camera, bounds, is_whole)
    if solid >= 0:
        name = scene.names.instances[solid]
        message = f"the camera is inside of `{name}`, and nothing else is: the picture shows its inner side alone"
        diagnostics.warning(message, span, "move the camera out of it")


def instance_boxes(tables: ir.Tables, bounds: F64, frame: F64) -> F64:
    """(n, 2, 3) bounds of the instances in another frame, to which `frame` (3, 4) leads from the world; all of it for unbounded ones."""
    matrices = tables.transforms.matrix[tables.instances.transform]
    bounded = np.asarray(np.isfinite(bounds).all(axis=(1, 2)))
    finite = np.where(bounded[:, None, None], bounds, 0.0)
    linear = frame[:, :3] @ matrices[:, :, :3]
    moved = matrices[:, :, 3] @ frame[:, :3].T + frame[:, 3]
    middle = np.einsum("nij,nj->ni", linear, finite.mean(axis=1)) + moved
    half = np.einsum("nij,nj->ni", np.abs(linear), (finite[:, 1] - finite[:, 0]) / 2.0)
    boxes = np.stack([middle - half, middle + half], axis=1)
    boxes[~bounded] = [[-np.inf], [np.inf]]
    return boxes


def _sees_nothing(tables: ir.Tables, camera: int, bounds: F64) -> bool:
    """Whether the boxes of all instances are outside of what the camera could see, in a picture of any shape."""
    cameras = tables.cameras
    if cameras.projection[camera] == ir.Projection.PANORAMIC or cameras.shift[camera].any() or cameras.near[camera] < 0:
        return False
    boxes = instance_boxes(tables, bounds, tables.transforms.inverse[cameras.transform[camera]])
    low, high = boxes[:, 0] - cameras.lens[camera], boxes[:, 1] + cameras.lens[camera]
    reach = WIDEST * cameras.extent[camera]
    at_one, per_depth = (reach, 0.0) if cameras.projection[camera] == ir.Projection.ORTHOGRAPHIC else (0.0, reach)
    with np.errstate(invalid="ignore"):  # an unbounded box is never outside by a comparison with NaN
        outside = (low[:, 2] > -cameras.near[camera]) | (high[:, 2] < -cameras.far[camera])
        for axis in (0, 1):
            outside |= low[:, axis] + per_depth * low[:, 2] > at_one
            outside |= -high[:, axis] + per_depth * low[:, 2] > at_one
    return bool(outside.all())


def _middle(tables: ir.Tables, bounds: F64) -> str:
    """The hint with the middle of the bounded shapes."""
    boxes = instance_boxes(tables, bounds, np.eye(4)[:3])
    boxes = boxes[np.isfinite(boxes).all(axis=(1, 2))]
    if not len(boxes):
        return ""
    x, y, z = (f"{value:.3g}" for value in (boxes[:, 0].min(axis=0) + boxes[:, 1].max(axis=0)) / 2)
    return f"their middle is [{x}, {y}, {z}]: look_at: [{x}, {y}, {z}]"


def _solid_around(tables: ir.Tables, camera: int, bounds: F64, is_whole: bool) -> int:
    """The row of the opaque instance that encloses the camera, if no other shape and no lamp is in its bounds; else -1.

    A room has something in it. A solid that shines lights itself, and one that is clipped away is not seen.
    """
    cameras, materials, instances = tables.cameras, tables.materials, tables.instances
    if cameras.near[camera] > 0.0 or cameras.planes[camera].any():
        return -1
    frame = tables.transforms.matrix[cameras.transform[camera]]
    eye = frame[:, 3] - frame[:, 2] * (enclosed_lights.AHEAD * (1.0 + np.linalg.norm(frame[:, 3])))
    boxes, remaining = instance_boxes(tables, bounds, np.eye(4)[:3]), MOST_TRIANGLES
    around = np.asarray(((boxes[:, 0] < eye) & (boxes[:, 1] > eye) & np.isfinite(boxes).all(axis=1)).all(axis=1))
    shines = (materials.values[:, ir.Slot.EMISSION] > 0.0).any(axis=1) | (materials.textures[:, ir.Slot.EMISSION] >= 0)
    lights = np.flatnonzero(ir.is_in(tables.lights.kind, enclosed_lights.PLACED))
    for row in enclosed_lights.dark_inside(tables).tolist():
        if not around[row] or shines[instances.material[row]] or not instances.visible[row] & ir.Visibility.CAMERA:
            continue
        if not is_whole and tables.geometries.kind[instances.geometry[row]] in (ir.GeometryKind.MESH, ir.GeometryKind.FORMULA):
            continue
        low, high = boxes[row]
        others = np.asarray(((boxes[:, 0] < high) & (boxes[:, 1] > low)).all(axis=1) & np.isfinite(boxes).all(axis=(1, 2)))
        others[row] = False
        remaining -= int(tables.geometries.triangle_count[instances.geometry[row]])
        if others.any() or remaining < 0:
            continue
        points = [enclosed_lights.corners(tables, int(light)) for light in lights]
        if any(((point > low) & (point < high)).all(axis=1).any() for point in points):
            continue
        inverse = tables.transforms.inverse[instances.transform[row]]
        if enclosed_lights.inside(tables, int(instances.geometry[row]), (inverse[:, :3] @ eye + inverse[:, 3])[None])[0]:
            return row
    return -1
