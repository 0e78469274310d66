"""Predicates over scene tables: motion, a ground plane, extents. Those of materials are in materials/traits.py."""

from __future__ import annotations

import numpy as np

from ...lights import PICTURED
from ...materials import traits
from .. import ir


def ground(tables: ir.Tables) -> int:
    """The instance of a plane that casts shadows and has everything else on its upper side, or -1.

    Objects may touch it, within 1e-9 of their coordinates.
    """
    instances, geometries, transforms = tables.instances, tables.geometries, tables.transforms
    boxes, matrix = geometries.bounds[instances.geometry], transforms.matrix[instances.transform]
    solid = (geometries.kind[instances.geometry] == ir.GeometryKind.PLANE) & (instances.visible & ir.Visibility.SHADOW != 0)
    solid &= ~traits.partial(tables)[instances.material]
    for row in np.flatnonzero(solid)[:4].tolist():
        others = np.arange(len(boxes)) != row
        below = transforms.inverse[instances.transform[row], 1]  # height over the plane, of a point of the world
        along = np.einsum("j,njk->nk", below[:3], matrix[others, :, :3])
        with np.errstate(invalid="ignore"):
            middle, half = boxes[others].mean(axis=1), 0.5 * (boxes[others, 1] - boxes[others, 0])
            height = np.sum(along * middle, axis=1) + matrix[others, :, 3] @ below[:3] + below[3]
            reach = np.sum(np.abs(along) * half, axis=1)
            size = np.abs(height) + reach + np.abs(below[3])
            if np.all(height - reach >= -1e-9 * size):  # nan and inf of unbounded shapes compare false
                return row
    return -1


def used_rows(rows: np.ndarray) -> np.ndarray:
    """The distinct rows of a column in ascending order, without −1. np.unique sorts, and loads numpy.ma."""
    return np.flatnonzero(np.bincount(rows.ravel() + 1))[1:] - 1 if (rows < 0).any() else np.flatnonzero(np.bincount(rows.ravel()))


def profiled(tables: ir.Tables) -> np.ndarray:
    """(lights,) bool: lights whose emission depends on the direction by an image."""
    return (tables.lights.image >= 0) & ~ir.is_in(tables.lights.kind, PICTURED)


def moving(tables: ir.Tables, camera: int) -> bool:
    """Whether an instance or the camera moves while the camera's shutter is open."""
    rows = np.append(tables.instances.transform, tables.cameras.transform[camera])
    return bool(tables.cameras.shutter[camera] > 0.0 and (tables.transforms.first_key[rows] >= 0).any())


def open_during(tables: ir.Tables, camera: int) -> tuple[float, float]:
    """(opening, duration) of a camera's shutter, as shares of the time that the keys span."""
    cameras = tables.cameras
    blurred = cameras.shutter > 0.0
    start, end = cameras.opening[blurred].min(), (cameras.opening + cameras.shutter)[blurred].max()
    return float((cameras.opening[camera] - start) / (end - start)), float(cameras.shutter[camera] / (end - start))


def extents(tables: ir.Tables) -> tuple[float, float]:
    """(largest coordinate of bounded instances and cameras, half diagonal of the smallest instance), in metres; 1 without instances."""
    instances, matrix = tables.instances, tables.transforms.matrix[tables.instances.transform]
    bounds = tables.geometries.bounds[instances.geometry]
    finite = np.isfinite(bounds).all(axis=(1, 2))
    middle, half = bounds[finite].mean(axis=1), 0.5 * (bounds[finite, 1] - bounds[finite, 0])
    centre = np.einsum("nij,nj->ni", matrix[finite, :, :3], middle) + matrix[finite, :, 3]
    reach = np.einsum("nij,nj->ni", np.abs(matrix[finite, :, :3]), half)
    eyes = np.abs(tables.transforms.matrix[tables.cameras.transform, :, 3])
    largest = max(float(np.abs(centre).max(initial=0.0) + reach.max(initial=0.0)), float(eyes.max(initial=0.0)))
    return largest, float(np.linalg.norm(reach, axis=1).min(initial=np.inf)) if finite.any() else 1.0
