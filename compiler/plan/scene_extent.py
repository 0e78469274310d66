"""Warns of a .scene file whose bare lengths, in metres, make a scene of the size of a town."""

from __future__ import annotations

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from .camera_view import instance_boxes

LARGE = 100.0  # metres: between opposite sides of the bounds of all shapes, and from the camera to the nearest of them


def warn_of_large_scene(scene: ir.Scene, diagnostics: Diagnostics) -> None:
    """Warn of a scene of LARGE metres, seen from LARGE metres away. Its file names no unit of length.

    Unbounded shapes do not count. Files of meshes and stages have units of their own: a scene that reads one gets no note. A wide floor
    with a camera near it is not such a scene.
    """
    tables = scene.tables
    if not len(tables.instances.geometry) or not len(tables.cameras.transform):
        return
    if any(file.lower().endswith((*file_types.MESH, *file_types.USD)) for file in scene.files):
        return
    bounds = instance_boxes(tables, tables.geometries.bounds[tables.instances.geometry], np.eye(4)[:3])
    bounds = bounds[np.isfinite(bounds).all(axis=(1, 2))]
    if not len(bounds):
        return
    low, high = bounds[:, 0], bounds[:, 1]
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    eye = tables.transforms.matrix[tables.cameras.transform[0]][:, 3]
    away = float(np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0.0), axis=1).min())
    if extent >= LARGE and away >= LARGE:
        hint = "write `unit cm` in the first line if centimetres are meant, or `unit m` if it is so"
        diagnostics.warning(f"the scene is {extent:,.4g} m across: lengths without a unit are in metres", Span(scene.name, 1), hint)
