"""Sampling of a dome's bright spots, for photons, and whether a direction is in one.

Both use the same cells, so that photons and paths together carry all the light, each of it once. Radiance is the dome's own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import caustic_casters
from ..jit.kernel import helper, specialize_if_present
from ..lanes import affine, ops
from ..types import Lane, Tables, Vec
from . import lights
from .sky_openings import search

LEAST = 0.05  # of the mean luminance of the cells: the least by which a cell is sampled


class NoSpots(NamedTuple):
    """No dome has bright spots."""


class Spots(NamedTuple):
    """Cells of directions in a dome's frame."""

    matrix: NDArray[np.float64]  # (1, 3, 4) to the world
    inverse: NDArray[np.float64]
    inside: NDArray[np.bool_]  # (height · width,)
    at_row: NDArray[np.int64]  # (cells,) row of each cell
    at_column: NDArray[np.int64]  # (cells,)
    upto: NDArray[np.float64]  # (cells + 1,) cumulative probability
    density: NDArray[np.float64]  # (cells,) over solid angle
    width: int
    height: int
    irradiance: float  # of all spots, on a surface that faces each
    row: int  # of emitters; -1: none


def build(tables: ir.Tables, row: int) -> Spots | NoSpots:
    """Return the spots of a scene's dome, whose row of emitters is `row`."""
    spots = caustic_casters.bright_spots(tables)
    if spots is None or row < 0:
        return NoSpots()
    height, width = spots.cells.shape
    bright = np.where(spots.cells, spots.luminance, 0.0)
    bright = np.where(spots.cells, np.maximum(bright, LEAST * bright[spots.cells].mean()), 0.0)
    share = (bright * spots.solid).ravel()
    cell = np.flatnonzero(share > 0.0)
    chance = share[cell] / share.sum()
    upto = np.concatenate([[0.0], np.cumsum(chance)])
    upto[-1] = 1.0
    solid = np.broadcast_to(spots.solid, bright.shape).ravel()[cell]
    frame = [int(tables.lights.transform[spots.light])]
    irradiance = float((np.where(spots.cells, spots.luminance, 0.0) * spots.solid).sum())
    matrix, inverse = tables.transforms.matrix[frame], tables.transforms.inverse[frame]
    of_cells = cell // width, cell % width, upto, chance / solid
    return Spots(matrix, inverse, spots.cells.ravel(), *of_cells, width, height, irradiance, row)


def none() -> Spots:
    """Return spots without cells."""
    frame = np.eye(3, 4)[None]
    cumulative = np.array([0.0, 1.0])
    return Spots(frame, frame, np.zeros(1, bool), np.zeros(1, np.int64), np.zeros(1, np.int64), cumulative, np.ones(1), 1, 1, 0.0, -1)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def sample(spots: Spots, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, density) sampled by two numbers in [0, 1)."""
    k = search(spots.upto, ops.int_like(u, 0), len(spots.density), u)
    du = ops.clip((u - spots.upto[k]) / ops.maximum(spots.upto[k + 1] - spots.upto[k], 1e-12), 0.0, 1.0)
    r, c = ops.to_int(spots.at_row[k]), ops.to_int(spots.at_column[k])
    top, bottom = ops.cos(ops.to_float(r) * (math.pi / spots.height)), ops.cos(ops.to_float(r + 1) * (math.pi / spots.height))
    y = ops.lerp(top, bottom, du)
    across = ops.sqrt(ops.maximum(1.0 - y * y, 0.0))
    turn = 2.0 * math.pi * (0.5 - (ops.to_float(c) + v) * (1.0 / spots.width))
    local = (across * ops.sin(turn), y, across * ops.cos(turn))
    return ops.normalize(affine.transform_vector(spots.matrix, 0, local)), spots.density[k]


@helper
def _emission(spots: Spots, default: tuple[Vec, Vec], tables: Tables, row: Lane, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    in_dome = row == spots.row
    if ops.any_lane(in_dome):
        direction, density = sample(spots, u, v)
        light = ops.scale(lights.background(tables, direction, lights.SHADOWED)[0], 1.0 / ops.maximum(density, lights.TINY))
        return ops.where3(in_dome, direction, default[0]), ops.where3(in_dome, light, default[1])
    return default


@helper
def _in_spot(spots: Spots, is_sampled: Lane, row: Lane, direction: Vec) -> Lane:
    height, width = spots.height, spots.width
    x, y, z = ops.normalize(affine.transform_vector(spots.inverse, 0, direction))
    s, t = 0.5 - ops.atan2(x, z) * (0.5 / math.pi), 0.5 - ops.asin(ops.clip(y, -1.0, 1.0)) * (1.0 / math.pi)
    r = ops.maximum(ops.minimum(ops.floor_int(t * height), height - 1), 0)
    c = ops.maximum(ops.minimum(ops.floor_int(s * width), width - 1), 0)
    return is_sampled & ((row != spots.row) | spots.inside[r * width + c])


emission = specialize_if_present(_emission)
"""(spots, (direction, light), tables, row, u, v): replaces both for a dome's row by a sample of its spots: radiance over density."""
only_in_spots = specialize_if_present(_in_spot)
"""(spots, is_sampled, row, direction): `is_sampled`, for a dome's row only in directions of its spots."""
