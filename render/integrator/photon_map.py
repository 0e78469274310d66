"""Photons where they landed, and what a place makes of those around it: kernel density estimates that sharpen as photons add up.

Jensen 1996, Global Illumination using Photon Maps; progressive as Knaus and Zwicker 2011, Progressive Photon Mapping: A Probabilistic
Approach: the samples of a pixel take turns among maps that know nothing of each other, and of more photons each spreads its light less
(its area as (photons so far)^(−1/3)), so that noise and blur both vanish. A photon's light is spread over a disk as wide as a number of
its neighbours need (a sample-point estimator: Abramson 1982, On Bandwidth Variation in Kernel Estimates), so what all of them
bring is kept whatever their radii are. Photons stand in cells of a hashed grid, of one of LEVELS sizes, at least twice as wide as they
spread; eight cells of each size that is there are looked at.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ..jit import thread_pool
from ..jit.kernel import HELPER, helper, kernel, noinline_helper
from ..lanes import ops
from ..material import bsdf
from ..material.bsdf import Shader, Uses
from ..types import Lane, Surface, Vec

MAPS = 16  # that samples take turns among
LEVELS = 12  # of cells, each half as wide as the one before
PRESENCE = 1 << 14  # coarse cells of a map that tell which sizes are there
COLUMNS = 13  # of a photon as it lands: place, where it came from, power, the surface's normal, and 1, or -1: for what is matt alone
FLATNESS = 0.2  # of a photon's radius, how far off the surface it still counts
FACING = 0.7  # cosine between normals up to which surfaces are one
NEIGHBOURS = 24.0  # photons that one is spread among, for FIRST of them in a map and in all
FIRST = 32768.0
ENOUGH = 12  # photons in a cell that tells their density
MATT, CLEAN, BESIDE = 2.0, 3.0, 5.0  # phases of a path, see phase_after
_BITS = 0x7FFFFFFF
_PX, _PY, _PZ, _PL = 73856093, 19349663, 83492791, 40503 * 9973


class NoMaps(NamedTuple):
    """Nothing is gathered."""


class Maps(NamedTuple):
    """MAPS of photons, one behind the other."""

    start: NDArray[np.int32]  # (MAPS · (slots + 1),) the first photon of each slot of cells
    slots: int  # of a map, a power of two
    present: NDArray[np.int32]  # (MAPS · PRESENCE,) bits of levels that reach into a coarse cell
    key: NDArray[np.int32]  # (n,) of a photon's cell and level
    place: NDArray[np.float64]  # (3 · n,) x of all, y of all, z of all, from `origin`
    toward: NDArray[np.float64]  # (3 · n,) unit, where it came from
    power: NDArray[np.float64]  # (3 · n,) over its disk: times 1 − d²/r² what it adds to the irradiance
    normal: NDArray[np.float64]  # (3 · n,)
    inverse: NDArray[np.float64]  # (n,) 1 / r², negative of photons for what is matt alone
    origin: NDArray[np.float64]  # (3,)
    cells: NDArray[np.float64]  # (LEVELS,) 1 / width


def empty(kind: type) -> Maps:
    """Maps without photons, in the numbers of waves."""
    none = np.zeros(0, np.int32)
    nothing = np.zeros(0, kind)
    return Maps(none, 0, np.zeros(MAPS * PRESENCE, np.int32), none, nothing, nothing, nothing, nothing, nothing, np.zeros(3, kind),
                np.ones(LEVELS, kind))  # fmt: skip


def build(landed: list[NDArray[np.float32]], emitted: int, so_far: int, width: float, origin: Any, kind: type, threads: int) -> Maps:
    """Maps of photons as they landed, (n, COLUMNS) each about `origin`; `emitted` in each map, `so_far` in all and before.

    The coarsest cells are as wide as `width`.
    """
    near = NEIGHBOURS * emitted / FIRST * (so_far / FIRST) ** (-1.0 / 3.0)
    counts = [len(rows) for rows in landed]
    slots = 1 << max(int(max(counts)), 16).bit_length()
    first = np.concatenate([[0], np.cumsum(counts)])
    n = int(first[-1])
    cells = (2.0 ** np.arange(LEVELS) / width).astype(kind)
    made = Maps(
        np.zeros(MAPS * (slots + 1), np.int32), slots, np.zeros(MAPS * PRESENCE, np.int32), np.zeros(n, np.int32),
        np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(n, kind),
        np.asarray(origin, kind), cells,
    )  # fmt: skip

    def sort(k: int) -> None:
        _sort(landed[k].astype(kind), k, int(first[k]), near, made.start, slots, made.present, made.key, made.place, made.toward,
              made.power, made.normal, made.inverse, cells)  # fmt: skip

    thread_pool.parallel_for(sort, range(len(landed)), threads)
    return made


@kernel
def _sort(rows, number, first, near, start, slots, present, key, place, toward, power, normal, inverse, cells):
    """Choose the radius of each photon of a map and put them in the order of their cells."""
    n = len(rows)
    whole = len(inverse)
    level = np.full(n, -1, np.int32)
    radius = np.zeros(n)
    size = np.int64(16)
    while size < 2 * n:
        size *= 2
    counts = np.zeros(size, np.int32)
    for step in range(LEVELS):  # the finest cells first, in which there are enough
        fine = LEVELS - 1 - step
        counts[:] = 0
        for i in range(n):
            counts[_slot(_key(fine, *_cell(rows, i, cells[fine])), size)] += 1
        left = 0
        for i in range(n):
            if level[i] < 0:
                there = counts[_slot(_key(fine, *_cell(rows, i, cells[fine])), size)]
                if there >= ENOUGH or fine == 0:
                    level[i] = fine
                    radius[i] = 0.5 / cells[fine] * math.sqrt(min(1.0, near / there))
                else:
                    left += 1
        if left == 0:
            break
    base = number * (slots + 1)
    for i in range(n):
        start[base + _slot(_key(level[i], *_cell(rows, i, cells[level[i]])), slots) + 1] += 1
    start[base] = first
    for s in range(slots):
        start[base + s + 1] += start[base + s]
    cursor = start[base : base + slots].copy()
    for i in range(n):
        found = _key(level[i], *_cell(rows, i, cells[level[i]]))
        slot = _slot(found, slots)
        k = cursor[slot]
        cursor[slot] += 1
        r = radius[i]
        key[k] = found
        inverse[k] = rows[i, 12] / (r * r)
        for c in range(3):
            place[c * whole + k], toward[c * whole + k] = rows[i, c], rows[i, 3 + c]
            power[c * whole + k] = rows[i, 6 + c] * 2.0 / (math.pi * r * r)
            normal[c * whole + k] = rows[i, 9 + c]
        for corner in range(8):
            x = np.int64(math.floor((rows[i, 0] + (r if corner & 1 else -r)) * cells[0]))
            y = np.int64(math.floor((rows[i, 1] + (r if corner & 2 else -r)) * cells[0]))
            z = np.int64(math.floor((rows[i, 2] + (r if corner & 4 else -r)) * cells[0]))
            present[number * PRESENCE + _slot(_key(0, x, y, z), PRESENCE)] |= np.int32(1 << level[i])


@helper
def _cell(rows: Any, i: int, inverse: float) -> Any:
    return (
        np.int64(math.floor(rows[i, 0] * inverse)), np.int64(math.floor(rows[i, 1] * inverse)), np.int64(math.floor(rows[i, 2] * inverse)),
    )  # fmt: skip


@helper
def _key(level: Lane, x: Lane, y: Lane, z: Lane) -> Lane:
    """A number of a cell that hardly another has: its lower 31 bits are the same in ints of 32 and of 64."""
    return ((x * _PX) ^ (y * _PY) ^ (z * _PZ) ^ (level * _PL)) & _BITS


@helper
def _slot(key: Lane, count: int) -> Lane:
    return (key ^ (key >> 15)) & (count - 1)


# --- in lanes ------------------------------------------------------------------------------------------------------------


def gathered(maps: Any, sent: Vec, *of: Any) -> Vec:
    """`sent`, and what photons around a place send to the viewer; kernels alone have them."""
    return sent


@overload(gathered, jit_options=HELPER)
def _gathered_in_kernels(maps, sent, shader, uses, point, viewer, weight, here, sample):
    if maps.layout:
        return lambda maps, sent, shader, uses, point, viewer, weight, here, sample: _gathered(
            maps, sent, shader, uses, point, viewer, weight, here, sample
        )
    return lambda maps, sent, shader, uses, point, viewer, weight, here, sample: sent


def phase_after(maps: Any, phase: Lane, shader: Shader, sharp: Lane, throws: Lane) -> Lane:
    """The phase of a path that goes on from a surface: 0, nothing matt has been met, or

    MATT (2): it has gathered; CLEAN (3): and since then it has met mirrors, glass and polished metals alone; 4: a metal among them;
    BESIDE (5): as CLEAN, but small lamps that it meets next have been seen to: by photons as its highlight `throws` them, and by looking
    for them from what is matt under it.
    """
    return phase


@overload(phase_after, jit_options=HELPER)
def _phase_after_in_kernels(maps, phase, shader, sharp, throws):
    if not maps.layout:
        return lambda maps, phase, shader, sharp, throws: phase

    def counted(maps, phase, shader, sharp, throws):
        clean = phase >= CLEAN
        beside = ops.where(bsdf.is_polished(shader), ops.where(clean, 4.0, phase), ops.where(clean, MATT, phase))
        matt = ops.where(clean & throws, BESIDE, CLEAN)
        return ops.where(sharp, phase, ops.where(bsdf.has_matt(shader), matt, beside))

    return counted


@helper
def _gathered(
    maps: Any, sent: Vec, shader: Shader, uses: Uses, point: Surface, viewer: Vec, weight: Vec, here: Lane, sample: Lane
) -> Vec:
    lit = here & bsdf.is_lit(shader)
    if len(maps.key) > 0 and ops.any_lane(lit):
        return _all_levels(maps, sent, shader, uses, point, viewer, weight, lit, sample)
    return sent


@noinline_helper
def _all_levels(maps, sent, shader, uses, point, viewer, weight, here, sample):
    number = (sample + (sample >> 4) * 5) & (MAPS - 1)  # neighbours' samples take others, however many each has
    x = (point.position[0] - maps.origin[0], point.position[1] - maps.origin[1], point.position[2] - maps.origin[2])
    wide = maps.cells[0]
    coarse = _key(0, ops.floor_int(x[0] * wide), ops.floor_int(x[1] * wide), ops.floor_int(x[2] * wide))
    there = ops.where(here, maps.present[number * PRESENCE + _slot(coarse, PRESENCE)], 0)
    base = number * (maps.slots + 1)
    all_ = bsdf.has_matt(shader)
    total = sent
    for level in range(LEVELS):
        some = ((there >> level) & 1) != 0
        if ops.any_lane(some):
            total = _one_level(maps, level, base, some, all_, total, x, shader, uses, point, viewer, weight)
    return total


@helper
def _one_level(
    maps: Any, level: int, base: Lane, some: Lane, all_: Lane, total: Vec, x: Vec,
    shader: Shader, uses: Uses, point: Surface, viewer: Vec, weight: Vec,
) -> Vec:  # fmt: skip
    """Add what photons of one size of cells bring."""
    inverse = maps.cells[level]
    i = ops.floor_int(x[0] * inverse - 0.5)
    j = ops.floor_int(x[1] * inverse - 0.5)
    k = ops.floor_int(x[2] * inverse - 0.5)
    for corner in range(8):
        key = _key(level, i + (corner & 1), j + ((corner >> 1) & 1), k + (corner >> 2))
        slot = base + _slot(key, maps.slots)
        at = ops.where(some, maps.start[slot], 0)
        end = ops.where(some, maps.start[slot + 1], 0)
        left = at < end
        while ops.any_lane(left):
            row = ops.where(left, at, 0)
            total = ops.add(total, _one(maps, row, left & (maps.key[row] == key), all_, x, shader, uses, point, viewer, weight))
            at = at + 1
            left = at < end
    return total


@helper
def _one(maps: Any, row: Lane, same: Lane, all_: Lane, x: Vec, shader: Shader, uses: Uses, point: Surface, viewer: Vec, weight: Vec) -> Vec:
    """What a photon sends to the viewer by the place: f cos over the cosine by which it landed, times its irradiance."""
    n = len(maps.key)
    off = (x[0] - maps.place[row], x[1] - maps.place[row + n], x[2] - maps.place[row + 2 * n])
    signed = maps.inverse[row]
    inverse = ops.absolute(signed)
    left = 1.0 - ops.dot(off, off) * inverse
    height = ops.dot(off, point.geometric)
    normal = (maps.normal[row], maps.normal[row + n], maps.normal[row + 2 * n])
    near = same & (left > 0.0) & (all_ | (signed > 0.0)) & (height * height * inverse < FLATNESS * FLATNESS)
    near = near & (ops.absolute(ops.dot(normal, point.geometric)) > FACING)
    zero = 0.0 * left
    found = (zero, zero, zero)
    if ops.any_lane(near):
        toward = (maps.toward[row], maps.toward[row + n], maps.toward[row + 2 * n])
        cosine = ops.dot(toward, point.geometric)
        near = near & bsdf.is_rough_glass(shader, cosine > 0.0)
        share = _share(near, shader, uses, point.normal, toward, viewer)
        strength = left * (1.0 / math.pi) / ops.maximum(ops.absolute(cosine), 1e-2)
        power = (maps.power[row], maps.power[row + n], maps.power[row + 2 * n])
        given = ops.scale(ops.mul(ops.mul(weight, share), power), strength)
        found = ops.where3(near, given, found)
    return found


@helper
def _share(here: Lane, shader: Shader, uses: Uses, normal: Vec, toward: Vec, viewer: Vec) -> Vec:
    """π f cos."""
    if (uses.glossy or uses.sharp) and ops.any_lane(here & bsdf.is_shiny(shader)):
        return _of_all(shader, normal, toward, viewer)
    return ops.scale(shader.diffuse, ops.maximum(ops.dot(normal, toward), 0.0))


_of_all = noinline_helper(bsdf.reflected)
