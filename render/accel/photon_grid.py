"""Hashed grid of photons: cells of LEVELS sizes, and lookups of the photons near points.

A photon is stored in cells at least twice as wide as its disk or ball. A lookup reads eight cells of each size in use. Photons on surfaces
(`integrator/photon_maps/photon_map.py`) and in media (`photon_volume.py` there) say what is near, and what light a photon gives.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import simd
from ..jit import thread_pool
from ..jit.kernel import helper, separate_helper
from ..lanes import crosslane, ops
from ..lanes.soa import PAD, compress_store
from ..types import Lane, Vec

MAPS = 16  # that samples take turns among
LEVELS = 12  # cell sizes, each half of the one before
PRESENCE = 1 << 14  # coarse cells of a map that store which cell sizes are in use
FIRST = 32768.0  # photons, by which the number in a disk or ball is given
ENOUGH = 12  # photons in a cell that suffice to estimate their density
DENSE = 0.9  # share of the photons that are in such cells, with the coarsest cells
LANES, LISTED = 16, 64  # most lanes of a vector; photons that are listed for each before their light is added
LISTS = LANES * LISTED
WIDER = 1.001  # of the squared radius, by which photons are listed: rounding errors there do not matter
LEAST = 1e-30  # light by which shares are divided at least
_BITS, _PX, _PY, _PZ, _PL = 0x7FFFFFFF, 73856093, 19349663, 83492791, 40503 * 9973


class Lists(NamedTuple):
    """Photons near each lane."""

    rows: NDArray[np.int32]  # (LISTS,) LISTED rows of each lane
    counts: NDArray[np.int32]  # (LANES,)


class Chosen(NamedTuple):
    """The photons of a lookup so far: one is chosen with a probability proportional to its light."""

    light: Vec
    row: Lane  # of the chosen one
    number: Lane  # random number of the next choice


def coarsest_width(landed: NDArray[np.float32], width: float, most: float) -> float:
    """Return a width of the coarsest cells, from `width` to `most`, at which the share DENSE of a map's photons has ENOUGH in its cell."""
    while len(landed) and 2.0 * width <= most:
        x, y, z = np.floor(landed[:, :3].astype(np.float64) / width).astype(np.int64).T
        _, cell, count = np.unique((x * _PX) ^ (y * _PY) ^ (z * _PZ), return_inverse=True, return_counts=True)
        if (count[cell] >= ENOUGH).mean() >= DENSE:
            break
        width *= 2.0
    return width


class SortBuffers(NamedTuple):
    """Memory for sorting the photons of a map."""

    level: NDArray[np.int32]  # (n,) -1
    radius: NDArray[np.float64]  # (n,) 0
    counts: NDArray[np.int32]  # (a power of two of at least 2 n,)
    cursor: NDArray[np.int64]  # (slots,)


def fill(maps: Any, landed: list[NDArray[Any]], first: NDArray[np.int64], near: float, sort: Any, threads: int) -> None:
    """Sort photons, (n, …) of each map, into empty maps of `empty_columns`, from the rows `first` on, by a kernel of `sorter`."""
    kind = maps.place.dtype

    def one_map(k: int) -> None:
        n = len(landed[k])
        counts = np.zeros(1 << max(2 * n - 1, 15).bit_length(), np.int32)
        buffers = SortBuffers(np.full(n, -1, np.int32), np.zeros(n), counts, np.zeros(maps.slots, maps.start.dtype))
        sort(landed[k].astype(kind), k, int(first[k]), near, maps, buffers)

    thread_pool.parallel_for(one_map, range(len(landed)), threads)


def empty_columns(landed: list[NDArray[Any]]) -> tuple[int, int, NDArray[np.int64]]:
    """(slots of a map, rows of all maps, first row of each) for photons (n, …) of each map."""
    counts = [len(rows) for rows in landed]
    first = np.concatenate([[0], np.cumsum(counts)])
    return 1 << max(int(max(counts)), 16).bit_length(), int(first[-1]) + PAD, first  # loads read vectors


def sorter(radius_of: Callable[..., float], store: Callable[..., None]) -> Any:
    """The helper (photons, number of the map, first row, photons in a disk or ball, maps, SortBuffers) that stores photons by cell.

    `radius_of(width of the cells, radius of a disk)` is that of a photon, `store(photons, i, radius, maps, row, key)` writes one. A kernel
    of a module calls it: the code of kernels with free variables is not kept on disk.
    """

    @helper
    def sort(rows, number, first, near, maps, buffers):
        """Choose the radius of each photon of a map, and store the photons by cell."""
        n, level, radius, cursor = len(rows), buffers.level, buffers.radius, buffers.cursor
        choose_radii(rows, near, maps.cells, buffers.counts, level, radius)
        start, slots, cells = maps.start, maps.slots, maps.cells
        base = number * (slots + 1)
        for i in range(n):
            radius[i] = radius_of(1.0 / cells[level[i]], radius[i])
            start[base + slot_of(cell_key(level[i], *cell_of(rows, i, cells[level[i]])), slots) + 1] += 1
        start[base] = first
        for s in range(slots):
            start[base + s + 1] += start[base + s]
        for s in range(slots):
            cursor[s] = start[base + s]
        for i in range(n):
            key = cell_key(level[i], *cell_of(rows, i, cells[level[i]]))
            slot = slot_of(key, slots)
            store(rows, i, radius[i], maps, cursor[slot], key)
            cursor[slot] += 1
            mark_levels(rows, i, radius[i], maps, number, level[i])

    return sort


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
        sparse = 0
        for i in range(n):
            if level[i] < 0:
                count = counts[slot_of(cell_key(fine, *cell_of(rows, i, cells[fine])), size)]
                if count >= enough or fine == 0:
                    level[i] = fine
                    radius[i] = 0.5 / cells[fine] * math.sqrt(min(1.0, near / count))
                else:
                    sparse += 1
        if sparse == 0:
            break


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


def _lister(is_near: Callable[..., Any]) -> Any:
    """The function that lists a vector of photons for one lane; see `gatherer`."""

    @helper
    def list_near(maps: Any, first: int, end: int, key: int, x: Vec, aside: Any, like: Lane, lists: Lists, k: int) -> bool:
        """Add to the list of lane k those of a vector of photons that are near it; return whether the list is full."""
        n, width = len(maps.inverse), crosslane.width(like)
        off = (
            x[0] - crosslane.load_like(maps.place, first, like), x[1] - crosslane.load_like(maps.place, first + n, like),
            x[2] - crosslane.load_like(maps.place, first + 2 * n, like),
        )  # fmt: skip
        near = simd.first_lanes(end - first, like) & (crosslane.load_like(maps.key, first, like) == key)
        near = near & is_near(maps, first, off, aside, like)
        if ops.any_lane(near):
            count = lists.counts[k]
            row = simd.iota(ops.int_like(like, 0)) + first
            compress_store(lists.rows, k * LISTED + count, row, near)
            lists.counts[k] = count + crosslane.count(near)
        return lists.counts[k] > LISTED - width

    return list_near


def _adder(photon_light: Callable[..., Any]) -> Any:
    """The function that adds the light of the photons on the lists; see `gatherer`."""

    @separate_helper
    def add_listed(maps, chosen, lookup, lists):
        """Add the light of the listed photons, choose among them, and empty the lists."""
        zero = ops.int_like(lookup.place[0], 0)
        counts, base = zero + crosslane.load_like(lists.counts, 0, lookup.place[0]), simd.iota(zero) * LISTED
        for k in range(crosslane.reduce_max(counts)):
            mine = counts > k
            row = ops.where(mine, lists.rows[base + k], 0)
            chosen = choose_photon(chosen, row, photon_light(maps, row, mine, lookup))
        for k in range(LANES):
            lists.counts[k] = 0
        return chosen

    return add_listed


def gatherer(probe: Callable[..., Any], is_near: Callable[..., Any], photon_light: Callable[..., Any]) -> Any:
    """The function (maps, lookup, active lanes, sample, random number) → Chosen: the light of the photons near each lane.

    `probe(lookup, k)` has what `is_near(maps, first, offset, probe, like)` reads of lane k: whether photons from row `first` on are near.
    `photon_light(maps, row, active lanes, lookup)` is a photon's light. Most photons of a lookup's cells are too far: a vector of one
    cell's is tested at a time.
    """
    list_near, add_listed = _lister(is_near), _adder(photon_light)

    @separate_helper
    def gather(maps, lookup, lanes, sample, random):
        """The light of the photons near each lane."""
        number = (sample + (sample >> 4) * 5) & (MAPS - 1)  # samples of neighboring pixels read other maps, whatever their count
        x, wide = lookup.place, maps.cells[0]
        coarse = cell_key(0, ops.floor_int(x[0] * wide), ops.floor_int(x[1] * wide), ops.floor_int(x[2] * wide))
        levels = ops.where(lanes, maps.present[number * PRESENCE + slot_of(coarse, PRESENCE)], 0)
        base = number * (maps.slots + 1)
        lists = Lists(simd.stack_array(np.int32, LISTS), simd.stack_array(np.int32, LANES))
        for k in range(LANES):
            lists.counts[k] = 0
        zero = 0.0 * x[0]
        chosen = Chosen((zero, zero, zero), ops.int_like(zero, 0), random)
        for level in range(LEVELS):
            some = ((levels >> level) & 1) != 0
            if ops.any_lane(some):
                inverse, lane_bits = maps.cells[level], crosslane.bits(some)
                low = ops.floor_int(x[0] * inverse - 0.5), ops.floor_int(x[1] * inverse - 0.5), ops.floor_int(x[2] * inverse - 0.5)
                for k in range(crosslane.width(x[0])):
                    if (lane_bits >> k) & 1 == 0:
                        continue
                    place, aside, cell = crosslane.lane3(x, k), probe(lookup, k), crosslane.lane3(low, k)
                    for corner in range(8):
                        key = cell_key(level, cell[0] + (corner & 1), cell[1] + ((corner >> 1) & 1), cell[2] + (corner >> 2))
                        slot = crosslane.lane(base, k) + slot_of(key, maps.slots)
                        first, end = maps.start[slot], maps.start[slot + 1]
                        while first < end:
                            full = list_near(maps, first, end, key, place, aside, x[0], lists, k)
                            first += crosslane.width(x[0])
                            if full:
                                chosen = add_listed(maps, chosen, lookup, lists)
        return add_listed(maps, chosen, lookup, lists)

    return gather


@helper
def choose_photon(chosen: Chosen, row: Lane, light: Vec) -> Chosen:
    """Add a photon's light; choose it with the probability of its share of the light so far. One random number serves all choices."""
    total, number = ops.add(chosen.light, light), chosen.number
    share = (light[0] + light[1] + light[2]) / ops.maximum(total[0] + total[1] + total[2], LEAST)
    is_chosen = number < share
    rescaled = ops.where(is_chosen, number / ops.maximum(share, LEAST), (number - share) / ops.maximum(1.0 - share, LEAST))
    return Chosen(total, ops.where(is_chosen, row, chosen.row), rescaled)
