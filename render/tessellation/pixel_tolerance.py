"""Tessellation tolerance of each instance: a number of pixels, in metres of the instance's own frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..geometry.bounds import world_bounds
from ..types import View

_NEAREST = 0.01  # of a shape's size: the least distance from the eye at which a pixel is measured


def pixel_size(tables: ir.Tables, view: View) -> float:
    """The shorter side of a pixel in metres: at a distance of 1 m for a perspective camera, everywhere for an orthographic one."""
    cameras = tables.cameras
    aspect, vertical = float(cameras.pixel_aspect[view.camera]), cameras.fit[view.camera] == ir.Fit.VERTICAL
    pixels = view.height if vertical else view.width
    return 2.0 * float(cameras.extent[view.camera]) / pixels * min(1.0, aspect if vertical else 1.0 / aspect)


def nearest_depths(tables: ir.Tables, view: View, boxes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For (n, 6) boxes: (n,) the depth at which each begins, at least the near plane's, and (n,) the least depth for its tolerance."""
    to_camera = tables.transforms.inverse[tables.cameras.transform[view.camera]]
    middle, half = 0.5 * (boxes[:, :3] + boxes[:, 3:]), 0.5 * (boxes[:, 3:] - boxes[:, :3])
    depth = -(middle @ to_camera[2, :3] + to_camera[2, 3]) - half @ np.abs(to_camera[2, :3])
    return np.maximum(depth, float(tables.cameras.near[view.camera])), _NEAREST * np.linalg.norm(half, axis=1)


def instance_tolerances(tables: ir.Tables, view: View, pixels: float) -> NDArray[np.float64]:
    """(instances,) the length of `pixels` in each instance's frame, at its nearest point and its largest scale; nan if unbounded.

    Rounded down to powers of √2, so that similar instances share one tessellation.
    """
    boxes = world_bounds(tables)
    with np.errstate(all="ignore"):
        nearest, least = nearest_depths(tables, view, boxes)
        size = np.full(len(boxes), pixel_size(tables, view))
        if tables.cameras.projection[view.camera] == ir.Projection.PERSPECTIVE:
            size = size * np.maximum(nearest, least)
        linear = tables.transforms.matrix[tables.instances.transform][:, :, :3]
        tolerance = pixels * size / np.linalg.norm(linear, ord=2, axis=(1, 2))
        return np.where(np.isfinite(boxes).all(axis=1), 2.0 ** (np.floor(2 * np.log2(tolerance)) / 2), np.nan)
