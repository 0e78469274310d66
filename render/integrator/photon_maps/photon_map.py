"""Photon maps: storage of photons in a hashed grid, and kernel density estimates from them.

Jensen 1996, Global Illumination using Photon Maps; progressive as Knaus and Zwicker 2011, Progressive Photon Mapping: A Probabilistic
Approach. The samples of a pixel take turns among independent maps. The more photons there are so far, the smaller the disk of each (its
area falls as (photons so far)^(−1/3)), so that noise and blur both vanish. A photon's light is spread over a disk that holds a number of
its neighbors (a sample-point estimator: Abramson 1982, On Bandwidth Variation in Kernel Estimates), which conserves energy for any radii.
The grid has LEVELS cell sizes; a photon is stored in cells at least twice as wide as its disk. A lookup reads eight cells of each size
in use.

A disk may reach through a wall, or around an edge. So one of a lookup's photons is chosen with a probability proportional to its light, and
the light of all counts if nothing lies between it and the surface (resampling: Talbot, Cline, Egbert 2005, Importance Resampling for Global
Illumination). The estimate has no bias, has no noise where all photons or none are visible, and is 0 in a closed room without light.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...accel import photon_grid
from ...accel.photon_grid import FIRST, LEVELS, MAPS, PRESENCE, WIDER, Chosen
from ...jit.kernel import helper, kernel
from ...lanes import crosslane, ops
from ...material import bsdf
from ...material.shader import Shader, Uses
from ...simd.registration import overload
from ...surface import interaction
from ...types import Lane, Vec
from ..state.path_state import NoMaps
from ..state.records import ShadingContext

COLUMNS = 13  # of a stored photon: position, direction it came from, power, surface normal, and 1, or -1: for diffuse surfaces alone
FLATNESS = 0.2  # of a photon's radius: how far off the surface it still counts
FACING = 0.7  # smallest cosine between the normals of one surface
STORED = 2.0**-22  # of its largest coordinate, by which a photon may be off its surface: it is stored in single precision
NEIGHBOURS = 24.0  # photons in the disk of one, for FIRST of them in a map and in all
LOBE, PAST_LOBE, MATT, CLEAN, BESIDE = 1.75, 1.875, 2.0, 3.0, 5.0  # phases of a path, see phase_after


class Maps(NamedTuple):
    """MAPS photon maps, one after the other in each array."""

    start: NDArray[np.int32]  # (MAPS · (slots + 1),) first photon of each slot of cells
    slots: int  # of a map, a power of two
    present: NDArray[np.int32]  # (MAPS · PRESENCE,) bits of the levels that reach into a coarse cell
    key: NDArray[np.int32]  # (n,) of a photon's cell and level
    place: NDArray[np.float64]  # (3 · n,) x of all, y of all, z of all, from `origin`
    toward: NDArray[np.float64]  # (3 · n,) unit, where it came from
    power: NDArray[np.float64]  # (3 · n,) over its disk: times 1 − d²/r² its irradiance
    normal: NDArray[np.float64]  # (3 · n,)
    inverse: NDArray[np.float64]  # (n,) 1 / r², negative of photons for diffuse surfaces alone
    origin: NDArray[np.float64]  # (3,)
    cells: NDArray[np.float64]  # (LEVELS,) 1 / width
    volume: Any = NoMaps()  # photon_volume.Volume in scenes with scattering media
    beams: Any = NoMaps()  # photon_beams.Beams likewise


class Gathered(NamedTuple):
    """A density estimate, and the photon that must be visible for it to count."""

    light: Vec  # to the viewer
    start: Vec  # off the surface, on the side that the light comes from
    end: Vec  # off the photon's surface, on the same side
    up: Vec  # their mean normal on that side, not normalized


class Lookup(NamedTuple):
    """A density estimate to be made."""

    place: Vec  # from Maps.origin
    shading: ShadingContext
    uses: Uses
    weight: Vec  # of the path
    diffuse: Lane  # bool: photons for diffuse surfaces count, too
    diffuse_only: Lane  # bool: only the diffuse part of the BSDF counts


def empty(kind: type) -> Maps:
    """Return maps without photons, of float32 or float64."""
    none = np.zeros(0, np.int32)
    nothing = np.zeros(0, kind)
    return Maps(none, 0, np.zeros(MAPS * PRESENCE, np.int32), none, nothing, nothing, nothing, nothing, nothing, np.zeros(3, kind),
                np.ones(LEVELS, kind))  # fmt: skip


def build(landed: list[NDArray[np.float32]], emitted: int, so_far: int, width: float, origin: Any, kind: type, threads: int) -> Maps:
    """Build maps from stored photons, (n, COLUMNS) each, relative to `origin`.

    `emitted` counts the photons of each map, `so_far` those of all maps up to now. The coarsest cells are `width` wide, in metres.
    """
    near = NEIGHBOURS * emitted / FIRST * (so_far / FIRST) ** (-1.0 / 3.0)
    slots, n, first = photon_grid.empty_columns(landed)
    cells = (2.0 ** np.arange(LEVELS) / width).astype(kind)
    maps = Maps(
        np.zeros(MAPS * (slots + 1), np.int32), slots, np.zeros(MAPS * PRESENCE, np.int32), np.zeros(n, np.int32),
        np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(n, kind),
        np.asarray(origin, kind), cells,
    )  # fmt: skip
    photon_grid.fill(maps, landed, first, near, _sort, threads)
    return maps


@helper
def _radius(width: float, radius: float) -> float:
    return radius


@helper
def _store(rows: Any, i: int, r: float, maps: Any, k: int, key: int) -> None:
    """Write photon i, of radius r, to row k."""
    n = len(maps.inverse)
    maps.key[k] = key
    maps.inverse[k] = rows[i, 12] / (r * r)
    for c in range(3):
        maps.place[c * n + k], maps.toward[c * n + k] = rows[i, c], rows[i, 3 + c]
        maps.power[c * n + k] = rows[i, 6 + c] * 2.0 / (math.pi * r * r)
        maps.normal[c * n + k] = rows[i, 9 + c]


_sort_by_cell = photon_grid.sorter(_radius, _store)


@kernel
def _sort(rows, number, first, near, maps, buffers):
    """Store the photons of a map by cell."""
    _sort_by_cell(rows, number, first, near, maps, buffers)


# --- in lanes ------------------------------------------------------------------------------------------------------------


def estimate(maps: Any, *arguments: Any) -> Any:
    """(maps, shading, uses, weight, here, diffuse_only, sample, number): the photons' light to the viewer; None without maps, and in numpy.

    In lanes of `diffuse_only` only the diffuse part of the BSDF reflects it. `number` chooses the photon of Gathered.
    """
    return None


@overload(estimate)
def _estimate_in_kernels(maps, shading, uses, weight, lanes, diffuse_only, sample, number):
    if maps.layout:
        return lambda maps, shading, uses, weight, lanes, diffuse_only, sample, number: _estimate(
            maps, shading, uses, weight, lanes, diffuse_only, sample, number
        )
    return lambda maps, shading, uses, weight, lanes, diffuse_only, sample, number: None


def no_estimate(maps: Any, shading: ShadingContext) -> Any:
    """An estimate of no light; None without maps, and in numpy."""
    return None


@overload(no_estimate)
def _no_estimate_in_kernels(maps, shading):
    if maps.layout:
        return lambda maps, shading: _nothing(shading)
    return lambda maps, shading: None


@helper
def _nothing(shading: ShadingContext) -> Gathered:
    position, zero = shading.point.position, 0.0 * shading.point.offset
    return Gathered((zero, zero, zero), position, position, shading.point.geometric)


def phase_after(maps: Any, phase: Lane, shader: Shader, sharp: Lane, covered: Lane, lobe: Lane) -> Lane:
    """Return the phase of a path that goes on from a surface: 0, no diffuse surface so far;

    LOBE: since then, a narrow lobe over a diffuse base (`lobe`, see photon_coverage.split_lobe) and specular surfaces; PAST_LOBE: metals or
    rough glass after it;
    MATT (2): the photon map has been read; CLEAN (3): since then, only specular surfaces and polished metals; 4: a metal among them;
    BESIDE (5): as CLEAN, but the small lights that it hits next count elsewhere: in photons that the surface's highlight reflects
    (`covered`), and in light samples of its diffuse part.
    """
    return phase


@overload(phase_after)
def _phase_after_in_kernels(maps, phase, shader, sharp, covered, lobe):
    if not maps.layout:
        return lambda maps, phase, shader, sharp, covered, lobe: phase

    def counted(maps, phase, shader, sharp, covered, lobe):
        clean = phase >= CLEAN
        past = ops.where(phase == LOBE, PAST_LOBE, phase)
        beside = ops.where(bsdf.is_polished(shader), ops.where(clean, 4.0, past), ops.where(clean, MATT, past))
        diffuse = ops.where(lobe, LOBE, ops.where(clean & covered, BESIDE, CLEAN))
        return ops.where(sharp, phase, ops.where(bsdf.has_matt(shader), diffuse, beside))

    return counted


@helper
def _estimate(
    maps: Any, shading: ShadingContext, uses: Uses, weight: Vec, lanes: Lane, diffuse_only: Lane, sample: Lane, number: Lane
) -> Gathered:  # fmt: skip
    lit = lanes & bsdf.is_lit(shading.shader)
    if len(maps.key) > 0 and ops.any_lane(lit):
        position = shading.point.position
        place = (position[0] - maps.origin[0], position[1] - maps.origin[1], position[2] - maps.origin[2])
        lookup = Lookup(place, shading, uses, weight, bsdf.has_matt(shading.shader), diffuse_only)
        return _gathered(maps, _gather(maps, lookup, lit, sample, number), shading)
    return _nothing(shading)


@helper
def _gathered(maps: Any, chosen: Chosen, shading: ShadingContext) -> Gathered:
    """The estimate of the chosen photons, with the points that must see each other."""
    row, n, point = chosen.row, len(maps.key), shading.point
    toward = (maps.toward[row], maps.toward[row + n], maps.toward[row + 2 * n])
    normal = (maps.normal[row], maps.normal[row + n], maps.normal[row + 2 * n])
    place = (maps.place[row], maps.place[row + n], maps.place[row + 2 * n])
    side, photon_side = ops.sign_of(ops.dot(toward, point.geometric)), ops.sign_of(ops.dot(toward, normal))
    lift = ops.maximum(2.0 * point.offset, STORED * ops.largest((ops.absolute(place[0]), ops.absolute(place[1]), ops.absolute(place[2]))))
    end = ops.along(ops.add(place, (maps.origin[0], maps.origin[1], maps.origin[2])), normal, photon_side * lift)
    start = ops.along(interaction.shadow_origin(point), point.geometric, side * point.offset)
    return Gathered(chosen.light, start, end, ops.add(ops.scale(point.geometric, side), ops.scale(normal, photon_side)))


@helper
def _photon_light(maps: Any, row: Lane, same: Lane, lookup: Lookup) -> Vec:
    """A photon's light to the viewer: f cos over the cosine of its arrival, times its irradiance."""
    n, x, point, shader = len(maps.key), lookup.place, lookup.shading.point, lookup.shading.shader
    off = (x[0] - maps.place[row], x[1] - maps.place[row + n], x[2] - maps.place[row + 2 * n])
    signed = maps.inverse[row]
    inverse = ops.absolute(signed)
    falloff = 1.0 - ops.dot(off, off) * inverse
    height = ops.dot(off, point.geometric)
    normal = (maps.normal[row], maps.normal[row + n], maps.normal[row + 2 * n])
    near = same & (falloff > 0.0) & (lookup.diffuse | (signed > 0.0)) & (height * height * inverse < FLATNESS * FLATNESS)
    zero = 0.0 * falloff
    light = (zero, zero, zero)
    if ops.any_lane(near):
        toward = (maps.toward[row], maps.toward[row + n], maps.toward[row + 2 * n])
        cosine = ops.dot(toward, point.geometric)
        near = near & (ops.dot(normal, point.geometric) * ops.sign_of(cosine * ops.dot(toward, normal)) > FACING)
        near = near & bsdf.scatters_through(shader, cosine > 0.0)
        share = _bsdf_share(near, lookup.diffuse_only, shader, lookup.uses, point.normal, toward, lookup.shading.viewer)
        strength = falloff * (1.0 / math.pi) / ops.maximum(ops.absolute(cosine), 1e-2)
        power = (maps.power[row], maps.power[row + n], maps.power[row + 2 * n])
        radiance = ops.scale(ops.mul(ops.mul(lookup.weight, share), power), strength)
        light = ops.where3(near, radiance, light)
    return light


@helper
def _bsdf_share(lanes: Lane, diffuse_only: Lane, shader: Shader, uses: Uses, normal: Vec, toward: Vec, viewer: Vec) -> Vec:
    """π f cos; in lanes of `diffuse_only` that of the diffuse part."""
    if (uses.glossy or uses.sharp) and ops.any_lane(lanes & bsdf.has_more_than_diffuse(shader)):
        share = bsdf.eval_diffuse(shader, normal, toward, viewer)
        if ops.any_lane(lanes & ops.not_(diffuse_only)):
            share = ops.where3(diffuse_only, share, bsdf.reflected(shader, normal, toward, viewer))
        return share
    return ops.scale(shader.diffuse, ops.maximum(ops.dot(normal, toward), 0.0))


@helper
def _probe(lookup: Lookup, k: int) -> Vec:
    return crosslane.lane3(lookup.shading.point.geometric, k)


@helper
def _is_near(maps: Any, first: int, off: Vec, normal: Vec, like: Lane) -> Lane:
    """Whether photons are near a point in its plane, with this normal."""
    inverse = ops.absolute(crosslane.load_like(maps.inverse, first, like))
    height = off[0] * normal[0] + off[1] * normal[1] + off[2] * normal[2]
    return (ops.dot(off, off) * inverse < WIDER) & (height * height * inverse < WIDER * FLATNESS * FLATNESS)


_gather = photon_grid.gatherer(_probe, _is_near, _photon_light)
