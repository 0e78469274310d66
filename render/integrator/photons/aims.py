"""Aims of photons: how many each light sends toward which caustic casters.

Photons are aimed at balls around the casters, by a mixture whose whole density weighs them (Veach 1997, §9.2.3).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiler import ir
from ....compiler.plan import caustic_casters
from ...light import dome_spots, emitter_table
from ...light.emitter_table import Emitters
from ...light.form_samples import DISK, DISTANT, RECTANGLE, SKY, TRIANGLE
from ...medium import emitting_cells

F64 = NDArray[np.float64]
TARGETS = 32  # most balls; further ones are merged


class NoStacks(NamedTuple):
    """No medium scatters light."""


class Aims(NamedTuple):
    """Probabilities of (emitter, ball) pairs, and the balls."""

    upto: F64  # (emitters,) cumulative probability of the rows of emitters
    within: F64  # (emitters · targets,) cumulative, of the targets of a row
    chance: F64  # (emitters · targets,) of both
    centre: F64  # (targets, 3)
    radius: F64  # (targets,) inf: all directions
    targets: int
    reach: float  # metres, from the origin to beyond the scene
    effort: float  # factor of the number of photons: faint light needs fewer for the same noise, by the square of the reflectance
    inside: Any = NoStacks()  # (emitters,) medium stacks where they are, in scenes with scattering media


def carried_by_photons(tables: ir.Tables, table: Emitters, spots: Any, all_sizes: bool) -> NDArray[np.bool_]:
    """(emitters,) whether photons carry an emitter's light; that of a dome only in its `spots`."""
    lamps, shining = caustic_casters.caustic_lights(tables, all_sizes)
    carried = np.zeros(len(table.kind), bool)
    light = table.light >= 0
    carried[light] = lamps[table.light[light]] & (table.kind[light] != SKY)
    if isinstance(spots, dome_spots.Spots):
        carried[spots.row] = True
    for i in np.flatnonzero(shining & (table.first >= 0)):
        later = table.first[table.first > table.first[i]]
        later_lights = np.flatnonzero((np.arange(len(light)) > table.first[i]) & light)
        end = min([len(carried), *later.tolist(), *later_lights.tolist()])
        carried[table.first[i] : end] = True
    return carried & (table.kind != emitting_cells.KIND)


def photon_targets(tables: ir.Tables, table: Emitters, spots: Any, chosen: NDArray[np.bool_]) -> Aims | None:
    """Return the aims of chosen emitters; None if they light no caster."""
    if isinstance(spots, dome_spots.Spots):
        row = np.arange(len(table.kind)) == spots.row
        table = table._replace(color=np.where(row[:, None], spots.irradiance, table.color))
    centre, radius = caustic_casters.bounding_spheres(tables)
    mirrors = caustic_casters.gathering(tables)
    centre, radius, gain = _merge(centre[mirrors], radius[mirrors], caustic_casters.gains(tables)[mirrors])
    flux = np.where(chosen[:, None], _flux(tables, table, centre, radius) * gain, 0.0)
    if not flux.any():
        return None
    centres, bounds = caustic_casters.bounding_spheres(tables)
    ends = np.concatenate([centres[np.isfinite(bounds)], table.place])
    reach = 4.0 * float(np.abs(ends).max(initial=1.0) + bounds[np.isfinite(bounds)].max(initial=1.0))
    flux = np.where(flux > 0.0, np.maximum(flux, 1e-3 * flux.max(axis=1, keepdims=True)), 0.0)
    chance = flux / flux.sum()
    of_row = chance.sum(axis=1)
    within = np.cumsum(chance, axis=1) / np.maximum(of_row, 1e-300)[:, None]
    return Aims(_close(np.cumsum(of_row)), np.ascontiguousarray(within.ravel()), np.ascontiguousarray(chance.ravel()),
                np.ascontiguousarray(centre), radius, len(radius), reach, float(gain.max()) ** 2)  # fmt: skip


def _close(upto: F64) -> F64:
    """Set the last of cumulative probabilities, and those equal to it, above 1."""
    return np.where(upto >= upto[-1], 1.0 + 1e-9, upto)


def _merge(centre: F64, radius: F64, gain: F64) -> tuple[F64, F64, F64]:
    """Merge balls into at most TARGETS: bisect along the widest axis, and bound each part by a ball with its greatest gain."""
    groups = [np.arange(len(radius))]
    endless = ~np.isfinite(radius)
    if endless.any():
        return np.zeros((1, 3)), np.array([np.inf]), np.ones(1)
    while len(groups) < min(TARGETS, len(radius)):
        widest = max(range(len(groups)), key=lambda g: (len(groups[g]) > 1) * (1.0 + float(np.ptp(centre[groups[g]], axis=0).max())))
        rows = groups.pop(widest)
        axis = int(np.argmax(np.ptp(centre[rows], axis=0)))
        rows = rows[np.argsort(centre[rows, axis], kind="stable")]
        groups += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]
    middles, sizes, gains = [], [], []
    for rows in groups:
        low, high = (centre[rows] - radius[rows, None]).min(axis=0), (centre[rows] + radius[rows, None]).max(axis=0)
        middle = 0.5 * (low + high)
        middles.append(middle)
        sizes.append(float((np.linalg.norm(centre[rows] - middle, axis=1) + radius[rows]).max()))
        gains.append(float(gain[rows].max()))
    return np.array(middles), np.array(sizes) * (1.0 + 1e-9), np.array(gains)


def _flux(tables: ir.Tables, table: Emitters, centre: F64, radius: F64) -> F64:
    """(emitters, targets) estimated flux from each emitter to each ball; 0 only where there is surely none."""
    way = centre[None] - table.place[:, None]
    away = np.linalg.norm(way, axis=2)
    size = np.where(table.area > 0, np.linalg.norm(np.abs(table.side_u) + np.abs(table.side_v), axis=1), 0.0)
    grown = radius[None] + size[:, None]
    inside = away <= grown
    sine = np.where(inside, 1.0, grown / np.maximum(away, 1e-300))
    solid = np.where(inside, 4.0 * math.pi, 2.0 * math.pi * (1.0 - np.sqrt(np.maximum(1.0 - sine * sine, 0.0))))
    color = table.color.mean(axis=1)
    flux = color[:, None] * np.where(table.area > 0, table.area, 1.0)[:, None] * solid
    flat = np.isin(table.kind, (RECTANGLE, DISK, TRIANGLE)) & ~table.both
    height = np.sum(way * table.normal[:, None], axis=2)
    flux = np.where(flat[:, None] & (height <= -grown), 0.0, flux)
    for e in np.flatnonzero(table.profile >= 0):
        edge = emitter_table.widest_angle(tables, int(table.light[e]))
        off = np.arccos(np.clip(height[e] / np.maximum(away[e], 1e-300), -1.0, 1.0))
        flux[e] = np.where(inside[e] | (off - np.arcsin(np.minimum(sine[e], 1.0)) < edge), flux[e], 0.0)
    far = np.isin(table.kind, (DISTANT, SKY))
    return np.where(far[:, None], color[:, None] * math.pi * radius[None] ** 2, flux)
