"""Photon maps of media: photons that scattered, stored where they did, and density estimates from them in three dimensions.

Jensen and Christensen 1998, Efficient Simulation of Light Transport in Scenes with Participating Media using Photon Maps. A photon's light
is spread over a ball that holds a number of its neighbors. As on surfaces (`photon_map.py`), balls shrink with the number of photons so
far, and the light of a lookup counts if one of its photons, chosen by its share, is visible. A path gathers at its first collision in a
medium.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...accel import photon_grid
from ...accel.photon_grid import FIRST, LEVELS, MAPS, PRESENCE, WIDER
from ...jit.kernel import helper, kernel, specialize_if_present
from ...lanes import crosslane, ops
from ...material import medium_stack
from ...medium import phase, phase_table
from ...simd.registration import overload
from ...types import Lane, Surface, Tables, Vec
from ..state import flights
from ..state.path_state import FAR, PathSample, PathState, photon_number
from ..state.records import ShadingContext
from .photon_map import CLEAN, MATT, Gathered

NEIGHBOURS = 16.0  # photons in the ball of one, for FIRST of them in a map and in all
SHRINKING = -3.0 / 7.0  # exponent of their number: noise falls as 1 / (N r³), bias as r²
LEAST_SIDE = 0.25  # share of a ball within a medium, below which its light is not raised further
CODE = 2.0  # last column of a stored photon: CODE + the number of its medium; below CODE it is on a surface


class Volume(NamedTuple):
    """MAPS maps of photons in media; see photon_map.Maps."""

    start: NDArray[np.int32]
    slots: int
    present: NDArray[np.int32]
    key: NDArray[np.int32]
    place: NDArray[np.float64]
    toward: NDArray[np.float64]
    power: NDArray[np.float64]  # (3 · n,) over its ball: times 1 − d²/r² the fluence
    medium: NDArray[np.int32]  # (n,) number of the medium
    inverse: NDArray[np.float64]  # (n,) 1 / r²
    origin: NDArray[np.float64]
    cells: NDArray[np.float64]


class Point(NamedTuple):
    """Points where paths scatter."""

    place: Vec  # from Volume.origin
    viewer: Vec  # unit
    weight: Vec  # of the path
    anisotropy: Lane
    draine: Any  # phase_table.Draine, or NoDraine
    medium: Lane  # int
    behind: Lane  # distance to the plane of the boundary where the path entered the medium
    ahead: Lane  # and to that where it would leave it


def empty(kind: type) -> Volume:
    """Return maps without photons, of float32 or float64."""
    none, nothing = np.zeros(0, np.int32), np.zeros(0, kind)
    return Volume(none, 0, np.zeros(MAPS * PRESENCE, np.int32), none, nothing, nothing, nothing, none, nothing, np.zeros(3, kind),
                  np.ones(LEVELS, kind))  # fmt: skip


def split(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(photons on surfaces, photons in media) of stored ones."""
    scattered = rows[:, -1] >= CODE
    return rows[~scattered], rows[scattered]


def build(landed: list[NDArray[np.float32]], emitted: int, so_far: int, width: float, origin: Any, kind: type, threads: int) -> Volume:
    """Build maps from photons in media; arguments as for photon_map.build."""
    near = NEIGHBOURS * emitted / FIRST * (so_far / FIRST) ** SHRINKING
    slots, n, first = photon_grid.empty_columns(landed)
    volume = Volume(
        np.zeros(MAPS * (slots + 1), np.int32), slots, np.zeros(MAPS * PRESENCE, np.int32), np.zeros(n, np.int32),
        np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(n, np.int32), np.zeros(n, kind),
        np.asarray(origin, kind), (2.0 ** np.arange(LEVELS) / width).astype(kind),
    )  # fmt: skip
    photon_grid.fill(volume, landed, first, near, _sort, threads)
    return volume


@helper
def _radius(width: float, radius: float) -> float:
    """That of a ball: that of a disk is as the square root of its share of a cell."""
    half = 0.5 * width
    return half * (radius / half) ** (2.0 / 3.0)


@helper
def _store(rows: Any, i: int, r: float, volume: Any, k: int, key: int) -> None:
    """Write photon i, of radius r, to row k."""
    n = len(volume.inverse)
    volume.key[k], volume.inverse[k] = key, 1.0 / (r * r)
    volume.medium[k] = np.int32(rows[i, 12] - CODE + 0.5)
    for c in range(3):
        volume.place[c * n + k], volume.toward[c * n + k] = rows[i, c], rows[i, 3 + c]
        volume.power[c * n + k] = rows[i, 6 + c] * 15.0 / (8.0 * math.pi * r * r * r)


_sort_by_cell = photon_grid.sorter(_radius, _store)


@kernel
def _sort(rows, number, first, near, maps, buffers):
    """Store the photons of a map by cell."""
    _sort_by_cell(rows, number, first, near, maps, buffers)


# --- in lanes ------------------------------------------------------------------------------------------------------------


def of(maps: Any) -> Any:
    """The volume maps of photon maps; None without any, and in numpy."""
    return None


@overload(of)
def _of_in_kernels(maps):
    if maps.layout and maps.field("volume")[1] != ():
        return lambda maps: maps.volume
    return lambda maps: None


@helper
def _at_collisions(
    volume: Any, default: Gathered, shading: ShadingContext, path: PathState, lanes: Lane, index: PathSample, ahead: tuple[Lane, Lane]
) -> Gathered:  # fmt: skip
    event: Any = shading.event
    gathers = lanes & event.scattered & (path.phase < MATT)
    if len(volume.key) == 0 or ops.not_(ops.any_lane(gathers)):
        return default
    position = event.position
    t = ops.dot(ops.sub(position, path.origin), path.direction)
    point = Point(
        ops.sub(position, (volume.origin[0], volume.origin[1], volume.origin[2])), shading.viewer, path.weight, event.anisotropy,
        event.draine,
        ops.where(gathers, medium_stack.top(path.inside), 0), (t - path.near) * path.leaving, (ahead[0] - t) * ahead[1],
    )  # fmt: skip
    chosen = _gather(volume, point, gathers, index.sample, photon_number(index))
    row, n = chosen.row, len(volume.key)
    photon = (volume.place[row], volume.place[row + n], volume.place[row + 2 * n])
    end = ops.add(photon, (volume.origin[0], volume.origin[1], volume.origin[2]))
    zero = 0.0 * position[0]
    return Gathered(
        ops.where3(gathers, chosen.light, default.light), ops.where3(gathers, position, default.start),
        ops.where3(gathers, end, default.end),
        ops.where3(gathers, (zero, zero, zero), default.up),
    )  # fmt: skip


at_collisions = specialize_if_present(_at_collisions)
"""(volume maps, Gathered, shading, path, vertices, index, wall): with the light of photons near collisions in media."""


@helper
def _leaving(volume: Any, default: Any, point: Surface, direction: Vec, before: Lane, after: Lane) -> Lane:
    return flights.boundary_cosine(point, direction, before, after)


leaving = specialize_if_present(_leaving)
"""(volume maps, None, point, direction, stack before it, and after it): see PathState.leaving."""


@helper
def _wall(volume: Any, default: Any, tables: Tables, path: PathState, point: Surface, t: Lane) -> tuple[Lane, Lane]:
    after = medium_stack.cross_boundary(path.inside, None, tables, point, path.direction)
    return ops.where(t < FAR, t, FAR), flights.boundary_cosine(point, path.direction, path.inside, after)


wall = specialize_if_present(_wall)
"""(volume maps, None, tables, path, point, t): (distance of the next surface, cosine there; FAR if it does not bound the medium)."""


@helper
def _after_collision(volume: Any, default: Lane, shading: ShadingContext) -> Lane:
    event: Any = shading.event
    return ops.where(event.scattered, CLEAN, default)


phase_after = specialize_if_present(_after_collision)
"""(volume maps, phase, shading): the phase of a path that goes on; after a collision the photon map has been read."""


@helper
def _photon_light(volume: Any, row: Lane, same: Lane, point: Point) -> Vec:
    """A photon's light to the viewer."""
    n, x = len(volume.key), point.place
    off = (x[0] - volume.place[row], x[1] - volume.place[row + n], x[2] - volume.place[row + 2 * n])
    weight = 1.0 - ops.dot(off, off) * volume.inverse[row]
    near = same & (weight > 0.0) & (volume.medium[row] == point.medium)
    toward = (volume.toward[row], volume.toward[row + n], volume.toward[row + 2 * n])
    weight = weight / ops.maximum(_side(point.behind, volume.inverse[row]) + _side(point.ahead, volume.inverse[row]) - 1.0, LEAST_SIDE)
    cosine = -ops.dot(toward, point.viewer)
    density = phase_table.density(point.draine, phase.density(point.anisotropy, cosine), point.medium, cosine)
    share = ops.where(near, weight * density, 0.0)
    power = (volume.power[row], volume.power[row + n], volume.power[row + 2 * n])
    return ops.scale(ops.mul(point.weight, power), share)


@helper
def _side(distance: Lane, inverse: Lane) -> Lane:
    """The share of a ball's weight, 1 − d²/r², on this side of a plane: there are no photons of a medium beyond its boundary.

    The weight at a height z of a ball of radius 1 is as (1 − z²)². Lookups divide by its integral (Diggle 1985, edge correction).
    """
    u = ops.clip(distance * ops.sqrt(inverse), 0.0, 1.0)
    squared = u * u
    return 0.5 + 0.9375 * u * (1.0 - squared * (2.0 / 3.0) + squared * squared * 0.2)


@helper
def _probe(point: Point, k: int) -> float:
    return 0.0


@helper
def _is_near(volume: Any, first: int, off: Vec, _: float, like: Lane) -> Lane:
    return ops.dot(off, off) * crosslane.load_like(volume.inverse, first, like) < WIDER


_gather = photon_grid.gatherer(_probe, _is_near, _photon_light)
