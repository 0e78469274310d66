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

from .. import simd
from ..jit import thread_pool
from ..jit.kernel import helper, kernel, noinline_helper
from ..lanes import crosslane, ops
from ..lanes.soa import PAD, compress_store
from ..light import lights
from ..material import bsdf
from ..material.shader import Shader, Uses
from ..simd.registration import overload
from ..surface import interaction
from ..types import Lane, Vec
from .records import ShadingContext

MAPS = 16  # that samples take turns among
LEVELS = 12  # cell sizes, each half of the one before
PRESENCE = 1 << 14  # coarse cells of a map that store which cell sizes are in use
COLUMNS = 13  # of a stored photon: position, direction it came from, power, surface normal, and 1, or -1: for diffuse surfaces alone
FLATNESS = 0.2  # of a photon's radius: how far off the surface it still counts
FACING = 0.7  # smallest cosine between the normals of one surface
NEIGHBOURS = 24.0  # photons in the disk of one, for FIRST of them in a map and in all
FIRST = 32768.0
ENOUGH = 12  # photons in a cell that suffice to estimate their density
DENSE = 0.9  # share of the photons that are in such cells, with the coarsest cells
LOBE, PAST_LOBE, MATT, CLEAN, BESIDE = 1.75, 1.875, 2.0, 3.0, 5.0  # phases of a path, see phase_after
LANES, LISTED = 16, 64  # most lanes of a vector; photons that are listed for each before their light is added
LISTS = LANES * LISTED
WIDER = 1.001  # of the squared radius, by which photons are listed: rounding errors there do not matter
_BITS, _PX, _PY, _PZ, _PL = 0x7FFFFFFF, 73856093, 19349663, 83492791, 40503 * 9973


class NoMaps(NamedTuple):
    """No photons."""


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


class Lists(NamedTuple):
    """Photons near each lane."""

    rows: NDArray[np.int32]  # (LISTS,) LISTED rows of each lane
    counts: NDArray[np.int32]  # (LANES,)


class Gathered(NamedTuple):
    """A density estimate, and the photon that must be visible for it to count."""

    light: Vec  # to the viewer
    start: Vec  # off the surface, on the side that the light comes from
    end: Vec  # off the photon's surface, on the same side
    up: Vec  # their mean normal on that side, not normalized


class Chosen(NamedTuple):
    """The photons of a lookup so far: one is chosen with a probability proportional to its light."""

    light: Vec
    row: Lane  # of the chosen one
    number: Lane  # random number of the next choice


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
    counts = [len(rows) for rows in landed]
    slots = 1 << max(int(max(counts)), 16).bit_length()
    first = np.concatenate([[0], np.cumsum(counts)])
    n = int(first[-1]) + PAD  # loads read vectors
    cells = (2.0 ** np.arange(LEVELS) / width).astype(kind)
    made = Maps(
        np.zeros(MAPS * (slots + 1), np.int32), slots, np.zeros(MAPS * PRESENCE, np.int32), np.zeros(n, np.int32),
        np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(n, kind),
        np.asarray(origin, kind), cells,
    )  # fmt: skip

    def sort(k: int) -> None:
        _sort(landed[k].astype(kind), k, int(first[k]), near, made)

    thread_pool.parallel_for(sort, range(len(landed)), threads)
    return made


def coarsest_width(landed: NDArray[np.float32], width: float, most: float) -> float:
    """Return a width of the coarsest cells, from `width` to `most`, at which the share DENSE of a map's photons has ENOUGH in its cell."""
    while len(landed) and 2.0 * width <= most:
        x, y, z = np.floor(landed[:, :3].astype(np.float64) / width).astype(np.int64).T
        _, cell, count = np.unique((x * _PX) ^ (y * _PY) ^ (z * _PZ), return_inverse=True, return_counts=True)
        if (count[cell] >= ENOUGH).mean() >= DENSE:
            break
        width *= 2.0
    return width


@kernel
def _sort(rows, number, first, near, maps):
    """Choose the radius of each photon of a map, and store the photons by cell."""
    n = len(rows)
    level = np.full(n, -1, np.int32)
    radius = np.zeros(n)
    size = np.int64(16)
    while size < 2 * n:
        size *= 2
    choose_radii(rows, near, maps.cells, np.zeros(size, np.int32), level, radius)
    start, slots, cells = maps.start, maps.slots, maps.cells
    base = number * (slots + 1)
    for i in range(n):
        start[base + slot_of(cell_key(level[i], *cell_of(rows, i, cells[level[i]])), slots) + 1] += 1
    start[base] = first
    for s in range(slots):
        start[base + s + 1] += start[base + s]
    cursor = start[base : base + slots].copy()
    for i in range(n):
        key = cell_key(level[i], *cell_of(rows, i, cells[level[i]]))
        slot = slot_of(key, slots)
        _store(rows, i, radius[i], maps, cursor[slot], key)
        cursor[slot] += 1
        mark_levels(rows, i, radius[i], maps, number, level[i])


@helper
def choose_radii(rows: Any, near: float, cells: Any, counts: Any, level: Any, radius: Any) -> None:
    """Write the level and radius of each photon: of the finest cells with ENOUGH photons, and with `near`.

    `counts` is a buffer, a power of two long.
    """
    n, size, enough = len(rows), len(counts), max(ENOUGH, near)
    for step in range(LEVELS):
        fine = LEVELS - 1 - step
        counts[:] = 0
        for i in range(n):
            counts[slot_of(cell_key(fine, *cell_of(rows, i, cells[fine])), size)] += 1
        left = 0
        for i in range(n):
            if level[i] < 0:
                there = counts[slot_of(cell_key(fine, *cell_of(rows, i, cells[fine])), size)]
                if there >= enough or fine == 0:
                    level[i] = fine
                    radius[i] = 0.5 / cells[fine] * math.sqrt(min(1.0, near / there))
                else:
                    left += 1
        if left == 0:
            break


@helper
def _store(rows: Any, i: int, r: float, maps: Any, k: int, key: int) -> None:
    """Write photon i, of radius r, to row k."""
    whole = len(maps.inverse)
    maps.key[k] = key
    maps.inverse[k] = rows[i, 12] / (r * r)
    for c in range(3):
        maps.place[c * whole + k], maps.toward[c * whole + k] = rows[i, c], rows[i, 3 + c]
        maps.power[c * whole + k] = rows[i, 6 + c] * 2.0 / (math.pi * r * r)
        maps.normal[c * whole + k] = rows[i, 9 + c]


@helper
def mark_levels(rows: Any, i: int, r: float, maps: Any, number: int, level: int) -> None:
    """Set a level's bit in the coarse cells that the box around photon i reaches into."""
    inverse = maps.cells[0]
    for corner in range(8):
        x = np.int64(math.floor((rows[i, 0] + (r if corner & 1 else -r)) * inverse))
        y = np.int64(math.floor((rows[i, 1] + (r if corner & 2 else -r)) * inverse))
        z = np.int64(math.floor((rows[i, 2] + (r if corner & 4 else -r)) * inverse))
        maps.present[number * PRESENCE + slot_of(cell_key(0, x, y, z), PRESENCE)] |= np.int32(1 << level)


@helper
def cell_of(rows: Any, i: int, inverse: float) -> Any:
    return (
        np.int64(math.floor(rows[i, 0] * inverse)), np.int64(math.floor(rows[i, 1] * inverse)), np.int64(math.floor(rows[i, 2] * inverse)),
    )  # fmt: skip


@helper
def cell_key(level: Lane, x: Lane, y: Lane, z: Lane) -> Lane:
    """A cell's hash, of 31 bits, which are the same in 32-bit and 64-bit arithmetic."""
    return ((x * _PX) ^ (y * _PY) ^ (z * _PZ) ^ (level * _PL)) & _BITS


@helper
def slot_of(key: Lane, count: int) -> Lane:
    return (key ^ (key >> 15)) & (count - 1)


# --- in lanes ------------------------------------------------------------------------------------------------------------


def estimate(maps: Any, *of: Any) -> Any:
    """(maps, shading, uses, weight, here, diffuse_only, sample, number): the photons' light to the viewer; None without maps, and in numpy.

    In lanes of `diffuse_only` only the diffuse part of the BSDF reflects it. `number` chooses the photon of Gathered.
    """
    return None


@overload(estimate)
def _estimate_in_kernels(maps, shading, uses, weight, here, diffuse_only, sample, number):
    if maps.layout:
        return lambda maps, shading, uses, weight, here, diffuse_only, sample, number: _estimate(
            maps, shading, uses, weight, here, diffuse_only, sample, number
        )
    return lambda maps, shading, uses, weight, here, diffuse_only, sample, number: None


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
        matt = ops.where(lobe, LOBE, ops.where(clean & covered, BESIDE, CLEAN))
        return ops.where(sharp, phase, ops.where(bsdf.has_matt(shader), matt, beside))

    return counted


@helper
def _estimate(
    maps: Any, shading: ShadingContext, uses: Uses, weight: Vec, here: Lane, diffuse_only: Lane, sample: Lane, number: Lane
) -> Gathered:  # fmt: skip
    lit = here & bsdf.is_lit(shading.shader)
    if len(maps.key) > 0 and ops.any_lane(lit):
        return _gather_levels(maps, shading, uses, weight, lit, diffuse_only, sample, number)
    return _nothing(shading)


@noinline_helper
def _gather_levels(maps, shading, uses, weight, here, diffuse_only, sample, random):
    """The light of the photons near each lane. Most photons of its cells are too far: a vector of one cell's is tested at a time."""
    number = (sample + (sample >> 4) * 5) & (MAPS - 1)  # samples of neighboring pixels read other maps, whatever their count
    position = shading.point.position
    x = (position[0] - maps.origin[0], position[1] - maps.origin[1], position[2] - maps.origin[2])
    wide = maps.cells[0]
    coarse = cell_key(0, ops.floor_int(x[0] * wide), ops.floor_int(x[1] * wide), ops.floor_int(x[2] * wide))
    there = ops.where(here, maps.present[number * PRESENCE + slot_of(coarse, PRESENCE)], 0)
    base = number * (maps.slots + 1)
    lists = Lists(simd.stack_array(np.int32, LISTS), simd.stack_array(np.int32, LANES))
    for k in range(LANES):
        lists.counts[k] = 0
    zero = 0.0 * position[0]
    chosen = Chosen((zero, zero, zero), ops.int_like(zero, 0), random)
    for level in range(LEVELS):
        some = ((there >> level) & 1) != 0
        if ops.any_lane(some):
            inverse, lanes = maps.cells[level], crosslane.bits(some)
            low = ops.floor_int(x[0] * inverse - 0.5), ops.floor_int(x[1] * inverse - 0.5), ops.floor_int(x[2] * inverse - 0.5)
            for k in range(crosslane.width(x[0])):
                if (lanes >> k) & 1 == 0:
                    continue
                place, normal, cell = crosslane.lane3(x, k), crosslane.lane3(shading.point.geometric, k), crosslane.lane3(low, k)
                for corner in range(8):
                    key = cell_key(level, cell[0] + (corner & 1), cell[1] + ((corner >> 1) & 1), cell[2] + (corner >> 2))
                    slot = crosslane.lane(base, k) + slot_of(key, maps.slots)
                    at, end = maps.start[slot], maps.start[slot + 1]
                    while at < end:
                        full = _list_near(maps, at, end, key, place, normal, x[0], lists, k)
                        at += crosslane.width(x[0])
                        if full:
                            chosen = _add_listed(maps, chosen, shading, uses, weight, diffuse_only, x, lists)
    return _gathered(maps, _add_listed(maps, chosen, shading, uses, weight, diffuse_only, x, lists), shading)


@helper
def _gathered(maps: Any, chosen: Chosen, shading: ShadingContext) -> Gathered:
    """The estimate of the chosen photons, with the points that must see each other."""
    row, n, point = chosen.row, len(maps.key), shading.point
    toward = (maps.toward[row], maps.toward[row + n], maps.toward[row + 2 * n])
    normal = (maps.normal[row], maps.normal[row + n], maps.normal[row + 2 * n])
    place = (maps.place[row], maps.place[row + n], maps.place[row + 2 * n])
    here, there = ops.sign_of(ops.dot(toward, point.geometric)), ops.sign_of(ops.dot(toward, normal))
    end = ops.along(ops.add(place, (maps.origin[0], maps.origin[1], maps.origin[2])), normal, 2.0 * there * point.offset)
    start = ops.along(interaction.shadow_origin(point), point.geometric, here * point.offset)
    return Gathered(chosen.light, start, end, ops.add(ops.scale(point.geometric, here), ops.scale(normal, there)))


@helper
def _list_near(maps: Any, at: int, end: int, key: int, x: Vec, normal: Vec, like: Lane, lists: Lists, k: int) -> bool:
    """Add to the list of lane k those of a vector of photons that are near it; return whether the list is full."""
    n, width = len(maps.inverse), crosslane.width(like)
    off = (
        x[0] - crosslane.load_like(maps.place, at, like), x[1] - crosslane.load_like(maps.place, at + n, like),
        x[2] - crosslane.load_like(maps.place, at + 2 * n, like),
    )  # fmt: skip
    inverse = ops.absolute(crosslane.load_like(maps.inverse, at, like))
    height = off[0] * normal[0] + off[1] * normal[1] + off[2] * normal[2]
    near = simd.first_lanes(end - at, like) & (crosslane.load_like(maps.key, at, like) == key)
    near = near & (ops.dot(off, off) * inverse < WIDER) & (height * height * inverse < WIDER * FLATNESS * FLATNESS)
    if ops.any_lane(near):
        count = lists.counts[k]
        row = simd.iota(ops.int_like(like, 0)) + at
        compress_store(lists.rows, k * LISTED + count, row, near)
        lists.counts[k] = count + crosslane.count(near)
    return lists.counts[k] > LISTED - width


@noinline_helper
def _add_listed(maps, chosen, shading, uses, weight, diffuse_only, x, lists):
    """Add the light of the listed photons, choose among them, and empty the lists."""
    lookup = Lookup(x, shading, uses, weight, bsdf.has_matt(shading.shader), diffuse_only)
    zero = ops.int_like(x[0], 0)
    counts, base = zero + crosslane.load_like(lists.counts, 0, x[0]), simd.iota(zero) * LISTED
    for k in range(crosslane.reduce_max(counts)):
        mine = counts > k
        row = ops.where(mine, lists.rows[base + k], 0)
        chosen = choose_photon(chosen, row, _photon_light(maps, row, mine, lookup))
    for k in range(LANES):
        lists.counts[k] = 0
    return chosen


@helper
def choose_photon(chosen: Chosen, row: Lane, light: Vec) -> Chosen:
    """Add a photon's light; choose it with the probability of its share of the light so far. One random number serves all choices."""
    total, number = ops.add(chosen.light, light), chosen.number
    share = (light[0] + light[1] + light[2]) / ops.maximum(total[0] + total[1] + total[2], lights.TINY)
    taken = number < share
    left = ops.where(taken, number / ops.maximum(share, lights.TINY), (number - share) / ops.maximum(1.0 - share, lights.TINY))
    return Chosen(total, ops.where(taken, row, chosen.row), left)


@helper
def _photon_light(maps: Any, row: Lane, same: Lane, lookup: Lookup) -> Vec:
    """A photon's light to the viewer: f cos over the cosine of its arrival, times its irradiance."""
    n, x, point, shader = len(maps.key), lookup.place, lookup.shading.point, lookup.shading.shader
    off = (x[0] - maps.place[row], x[1] - maps.place[row + n], x[2] - maps.place[row + 2 * n])
    signed = maps.inverse[row]
    inverse = ops.absolute(signed)
    left = 1.0 - ops.dot(off, off) * inverse
    height = ops.dot(off, point.geometric)
    normal = (maps.normal[row], maps.normal[row + n], maps.normal[row + 2 * n])
    near = same & (left > 0.0) & (lookup.diffuse | (signed > 0.0)) & (height * height * inverse < FLATNESS * FLATNESS)
    zero = 0.0 * left
    light = (zero, zero, zero)
    if ops.any_lane(near):
        toward = (maps.toward[row], maps.toward[row + n], maps.toward[row + 2 * n])
        cosine = ops.dot(toward, point.geometric)
        near = near & (ops.dot(normal, point.geometric) * ops.sign_of(cosine * ops.dot(toward, normal)) > FACING)
        near = near & bsdf.scatters_through(shader, cosine > 0.0)
        share = _bsdf_share(near, lookup.diffuse_only, shader, lookup.uses, point.normal, toward, lookup.shading.viewer)
        strength = left * (1.0 / math.pi) / ops.maximum(ops.absolute(cosine), 1e-2)
        power = (maps.power[row], maps.power[row + n], maps.power[row + 2 * n])
        given = ops.scale(ops.mul(ops.mul(lookup.weight, share), power), strength)
        light = ops.where3(near, given, light)
    return light


@helper
def _bsdf_share(here: Lane, diffuse_only: Lane, shader: Shader, uses: Uses, normal: Vec, toward: Vec, viewer: Vec) -> Vec:
    """π f cos; in lanes of `diffuse_only` that of the diffuse part."""
    if (uses.glossy or uses.sharp) and ops.any_lane(here & bsdf.has_more_than_diffuse(shader)):
        share = bsdf.eval_diffuse(shader, normal, toward, viewer)
        if ops.any_lane(here & ops.not_(diffuse_only)):
            share = ops.where3(diffuse_only, share, _reflected(shader, normal, toward, viewer))
        return share
    return ops.scale(shader.diffuse, ops.maximum(ops.dot(normal, toward), 0.0))


_reflected = noinline_helper(bsdf.reflected)
