"""Sampling of the sky through openings: a learnt histogram over the faces of a room's box.

All light of the sky that reaches a point in a box passes its faces. Samples choose a cell of a face by the share of the sky that places
in the room see through it, and a point of the cell (Bitterli, Novák, Jarosz 2015, "Portal-Masked Environment Map Sampling", with portals
that are found, and samples by area). Other samples come from the map of the whole sky, all of them outside of the box. The density is that
of the mixture: what was learnt affects noise alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

SIDE = 32  # cells along a side of a face
FACES = 6  # -x, +x, -y, +y, -z, +z; rows of cells run along the next axis, columns along the one after it, cyclically
TINY = 1e-20


class NoOpenings(NamedTuple):
    """The whole sky is sampled everywhere."""


class Openings(NamedTuple):
    """A histogram over the faces of a box."""

    low: NDArray[np.float64]  # (3,) corners of the box
    high: NDArray[np.float64]
    rows: NDArray[np.float64]  # (FACES · SIDE + 1,) cumulative shares of the rows of cells
    columns: NDArray[np.float64]  # (FACES · SIDE · (SIDE + 1),) cumulative shares within each row
    share: float  # of samples that come from the histogram; 0: none
    seen: float = 1.0  # share of the sky's light that places in the room see


def empty() -> Openings:
    """Openings that sample nothing."""
    return make(np.zeros(3), np.ones(3), np.ones((FACES * SIDE, SIDE)), 0.0)


def make(low: NDArray[np.float64], high: NDArray[np.float64], weights: NDArray[np.float64], share: float, seen: float = 1.0) -> Openings:
    """Make the histogram of the weights (FACES · SIDE, SIDE) of cells; without any, `share` is 0."""
    total = float(weights.sum())
    if not total > 0.0:
        weights, total, share = np.ones_like(weights), float(weights.size), 0.0
    columns = np.concatenate([np.zeros((len(weights), 1)), np.cumsum(weights / total, axis=1)], axis=1)
    rows = np.concatenate([[0.0], np.cumsum(columns[:, -1])])
    last = columns[:, -1:]
    columns = np.where(last > 0.0, columns / np.where(last > 0.0, last, 1.0), np.arange(SIDE + 1) / SIDE)
    return Openings(low, high, rows / rows[-1], columns.ravel(), share, seen)


@helper
def search(table: NDArray[np.float64], first: Lane, count: int, u: Lane) -> Lane:
    """The last entry that is not above u, counted from `first`, of `count` cumulative shares from there."""
    low = ops.int_like(u, 0)
    step = 1
    while step < count:
        step *= 2
    while step > 1:
        step //= 2
        further = ops.minimum(low + step, count - 1)
        low = ops.where((low + step < count) & (table[first + further] <= u), further, low)
    return low


@helper
def share_at(openings: Openings, place: Vec) -> Lane:
    """The share of samples from the histogram: 0 outside of the box."""
    inside = ops.bool_like(place[0], True)
    for k in range(3):
        inside = inside & (place[k] > openings.low[k]) & (place[k] < openings.high[k])
    return ops.where(inside, 0.0 * place[0] + openings.share, 0.0)


@helper
def sample(openings: Openings, place: Vec, u: Lane, v: Lane) -> Vec:
    """Sample a direction from a place in the box by two numbers in [0, 1)."""
    r = search(openings.rows, ops.int_like(u, 0), FACES * SIDE, u)
    first = r * (SIDE + 1)
    c = search(openings.columns, first, SIDE, v)
    below, above = openings.rows[r], openings.rows[r + 1]
    du = ops.clip((u - below) / ops.maximum(above - below, TINY), 0.0, 1.0)
    below, above = openings.columns[first + c], openings.columns[first + c + 1]
    dv = ops.clip((v - below) / ops.maximum(above - below, TINY), 0.0, 1.0)
    face = ops.floor_int((ops.to_float(r) + 0.5) * (1.0 / SIDE))
    axis = ops.floor_int((ops.to_float(face) + 0.5) * 0.5)
    over = ops.to_float(face - 2 * axis)
    along, across = (ops.to_float(r - face * SIDE) + du) * (1.0 / SIDE), (ops.to_float(c) + dv) * (1.0 / SIDE)
    on_face = ops.where3(axis == 0, (over, along, across), ops.where3(axis == 1, (across, over, along), (along, across, over)))
    low, high = openings.low, openings.high
    point = (ops.lerp(low[0], high[0], on_face[0]), ops.lerp(low[1], high[1], on_face[1]), ops.lerp(low[2], high[2], on_face[2]))
    return ops.normalize(ops.sub(point, place))


@helper
def density(openings: Openings, place: Vec, direction: Vec) -> Lane:
    """Return the solid angle density of `sample`."""
    low, high = openings.low, openings.high
    tx, ty, tz = _reach(openings, 0, place, direction), _reach(openings, 1, place, direction), _reach(openings, 2, place, direction)
    t = ops.minimum(tx, ops.minimum(ty, tz))
    x = ops.clip((place[0] + t * direction[0] - low[0]) / (high[0] - low[0]), 0.0, 1.0)
    y = ops.clip((place[1] + t * direction[1] - low[1]) / (high[1] - low[1]), 0.0, 1.0)
    z = ops.clip((place[2] + t * direction[2] - low[2]) / (high[2] - low[2]), 0.0, 1.0)
    on_x, on_y = tx <= t, ty <= t
    along, across = ops.where(on_x, y, ops.where(on_y, z, x)), ops.where(on_x, z, ops.where(on_y, x, y))
    towards = ops.where(on_x, direction[0], ops.where(on_y, direction[1], direction[2]))
    unit = ops.int_like(t, 1)
    face = ops.where(on_x, 0 * unit, ops.where(on_y, 2 * unit, 4 * unit)) + ops.where(towards > 0.0, unit, 0 * unit)
    r = face * SIDE + ops.minimum(ops.floor_int(along * SIDE), SIDE - 1)
    c = ops.minimum(ops.floor_int(across * SIDE), SIDE - 1)
    element = r * (SIDE + 1) + c
    probability = (openings.rows[r + 1] - openings.rows[r]) * (openings.columns[element + 1] - openings.columns[element])
    sx, sy, sz = high[0] - low[0], high[1] - low[1], high[2] - low[2]
    area = ops.where(on_x, sy * sz + 0.0 * t, ops.where(on_y, sz * sx + 0.0 * t, sx * sy + 0.0 * t)) * (1.0 / (SIDE * SIDE))
    return probability * t * t / ops.maximum(ops.absolute(towards) * area, TINY)


@helper
def _reach(openings: Openings, k: int, place: Vec, direction: Vec) -> Lane:
    """The distance to the face of an axis that a direction meets."""
    toward = ops.where(direction[k] > 0.0, openings.high[k] - place[k], openings.low[k] - place[k])
    steep = ops.where(ops.absolute(direction[k]) > TINY, direction[k], ops.where(direction[k] > 0.0, TINY, -TINY))
    return toward / steep
