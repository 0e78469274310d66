"""World-space bounds of instances, at the shutter's opening and swept over its interval."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from . import instance_transform

CHUNK = 1 << 16  # instances whose matrices are gathered at once: a million of them are 96 MB
_SWEEP = 0.25  # radians of rotation between the moments at which swept bounds evaluate a transform
SLACK = 1e-12  # relative growth of an instance's box: covers the rounding of transforms


def world_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """World boxes of instances, (instances, 6), with the rounding error of transforms; not finite for unbounded shapes."""
    boxes = np.empty((len(tables.instances.geometry), 6))
    for first in range(0, len(boxes), CHUNK):
        boxes[first : first + CHUNK] = _world_bounds(tables, slice(first, first + CHUNK))
    return boxes


def _world_bounds(tables: ir.Tables, chosen: slice) -> NDArray[np.float64]:
    boxes = tables.geometries.bounds[tables.instances.geometry[chosen]]
    matrix = tables.transforms.matrix[tables.instances.transform[chosen]]
    with np.errstate(invalid="ignore"):
        middle, half = 0.5 * (boxes[:, 0] + boxes[:, 1]), 0.5 * (boxes[:, 1] - boxes[:, 0])
        centre = np.einsum("nij,nj->ni", matrix[:, :, :3], middle) + matrix[:, :, 3]
        reach = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), half)
        magnitude = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), np.abs(middle)) + np.abs(matrix[:, :, 3]) + reach
        reach = reach + SLACK * magnitude.max(axis=1, keepdims=True, initial=0.0)
    return np.concatenate([centre - reach, centre + reach], axis=1)


def swept_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """`world_bounds` over all positions between the shutter's opening and closing.

    Between two evaluated times, a corner deviates from the line between its positions by at most h²/8 of its acceleration, which is
    ω² r + 2 ω r' for a rotation of ω radians a key and a corner at radius r that scales by r' a key.
    """
    boxes, instances, keys = world_bounds(tables), tables.instances, tables.keys
    first, count = tables.transforms.first_key[instances.transform], tables.transforms.keys[instances.transform]
    for i in np.flatnonzero(first >= 0):
        bounds = tables.geometries.bounds[instances.geometry[i]]
        corners = np.array([[bounds[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])
        for key in range(first[i], first[i] + count[i] - 1):
            turn = 2.0 * np.arccos(np.clip(keys.turn[key] @ keys.turn[key + 1], -1.0, 1.0))
            parts = int(np.ceil(turn / _SWEEP)) or 1
            with np.errstate(invalid="ignore"):
                ends = [corners @ keys.stretch[k].T for k in (key, key + 1)]
                reach = max(np.linalg.norm(end, axis=1).max() for end in ends)
                stray = (turn * turn * reach + 2.0 * turn * np.linalg.norm(ends[1] - ends[0], axis=1).max()) / (8.0 * parts * parts)
                points = _matrices_between(keys, key, np.arange(parts + 1) / parts) @ np.vstack([corners.T, np.ones(8)])
                stray += SLACK * (np.abs(points).max() + reach)
                boxes[i, :3] = np.minimum(boxes[i, :3], points.min(axis=(0, 2)) - stray)
                boxes[i, 3:] = np.maximum(boxes[i, 3:], points.max(axis=(0, 2)) + stray)
    return boxes


def _matrices_between(keys: ir.Keys, key: int, shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices (n, 3, 4) at fractions (n,) of the time from a key to the next."""
    return np.stack(instance_transform.interpolate_keys(keys, key, np.full(len(shares), 2), shares), axis=1).reshape(-1, 3, 4)
