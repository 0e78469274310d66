"""Photon beams: the flights of photons through media, and the light that they send along rays.

Jarosz, Nowrouzezahrai, Sadeghi and Jensen 2011, A Comprehensive Theory of Volumetric Radiance Estimation using Photon Points and Beams:
long beams, which end at surfaces, and their one-dimensional estimate. A ray gathers all beams that pass it within their radius, with the
transmittances of both in closed form, in place of the photons around one point. Beams are cut into pieces, whose radius follows from the
density around them and shrinks with the number of photons (Jarosz and others 2011, Progressive Photon Beams). Pieces in Morton order are
the leaves of a complete binary tree of boxes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...accel import photon_grid
from ...accel.photon_grid import FIRST, LANES, LEVELS, LISTED, LISTS, MAPS, Lists
from ...jit import thread_pool
from ...jit.kernel import helper, kernel, separate_helper, specialize_if_present
from ...lanes import crosslane, ops, row_gather
from ...lanes.soa import PAD, compress_store
from ...material import medium_stack
from ...medium import column, phase, phase_table
from ...simd.registration import overload
from ...types import Lane, Tables, Vec
from ..state.flights import Flown
from ..state.path_state import PathSample, PathState
from .photon_map import MATT

CODE = 512.0  # last column of a stored beam: CODE + the number of its medium
NEIGHBOURS = 10.0  # beams that pass a ray in a cell of the density, of 256 in a map and FIRST photons in all
SHRINKING = -1.0 / 5.0  # exponent of their number: noise falls as 1 / (N r), bias as r²
CELL = 16.0  # pieces in a cell by which their density is measured
PIECES = 12.0  # of a long beam
MOST_PIECES = 64  # of any beam
FEWEST, MOST = 256, 1024  # beams of a map; they stand for those that are left out
EMITTED = 64  # photons of a map for each of its beams
LEAF = LANES  # pieces of a leaf
PARALLEL = 1e-6  # squared sine below which a beam and a ray do not meet
NOWHERE = 1e30


class Beams(NamedTuple):
    """MAPS maps of beams; the pieces of each have LEAF · leaves rows."""

    beamed: NDArray[np.bool_]  # (media,) whether photons in a medium are beams
    leaves: int  # of a map, a power of two; 0: no beams
    boxes: NDArray[np.float64]  # (MAPS · 2 · leaves · 6,) low and high corners of nodes; node 1 is the root, those of k are 2 k and 2 k + 1
    start: NDArray[np.float64]  # (3 · n,) of the beam, from `origin`
    direction: NDArray[np.float64]  # (3 · n,) unit
    power: NDArray[np.float64]  # (3 · n,) at its start
    begin: NDArray[np.float64]  # (n,) distance along the beam at which a piece begins
    end: NDArray[np.float64]  # (n,)
    inverse: NDArray[np.float64]  # (n,) 1 / radius
    medium: NDArray[np.int32]  # (n,)
    origin: NDArray[np.float64]
    reach: float  # metres, of beams that leave the scene


class Segment(NamedTuple):
    """Parts of rays in one medium."""

    place: Vec  # origin of the ray, from Beams.origin
    direction: Vec
    near: Lane
    far: Lane
    medium: Lane  # int


def empty(kind: type, beamed: NDArray[np.bool_], reach: float) -> Beams:
    """Return maps without beams, of float32 or float64."""
    nothing = np.zeros(0, kind)
    return Beams(beamed, 0, nothing, nothing, nothing, nothing, nothing, nothing, nothing, np.zeros(0, np.int32), np.zeros(3, kind), reach)


def split(rows: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(photons, beams) of stored ones."""
    beams = rows[:, -1] >= CODE
    return rows[~beams], rows[beams]


def build(landed: list[NDArray[np.float32]], emitted: int, so_far: int, origin: Any, plain: Beams, threads: int) -> Beams:
    """Build maps from beams; arguments as for photon_map.build. `plain` are maps without beams."""
    kind, most = plain.origin.dtype, max(len(rows) for rows in landed)
    if most == 0:
        return plain
    every = -(-most // min(max(emitted // EMITTED, FEWEST), MOST))
    scale = [len(rows) / max(len(rows[::every]), 1) for rows in landed]
    landed = [rows[::every] for rows in landed]
    longest = float(np.quantile(np.concatenate([rows[:, 9] for rows in landed]), 0.9))
    piece = max(min(longest, 0.25 * plain.reach), 1e-6) / PIECES
    near = NEIGHBOURS * most / every / FEWEST * (so_far / FIRST) ** SHRINKING
    pieces: list[Any] = [None] * len(landed)
    thread_pool.parallel_for(lambda k: pieces.__setitem__(k, _cut(landed[k].astype(np.float64), piece, near)), range(len(landed)), threads)
    leaves = 1 << (-(-max(len(part[1]) for part in pieces) // LEAF) - 1).bit_length()
    n = MAPS * leaves * LEAF + PAD
    beams = Beams(
        plain.beamed, leaves, np.zeros(MAPS * 2 * leaves * 6, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind), np.zeros(3 * n, kind),
        np.ones(n, kind), np.zeros(n, kind), np.ones(n, kind), np.zeros(n, np.int32), np.asarray(origin, kind), plain.reach,
    )  # fmt: skip
    thread_pool.parallel_for(lambda k: _fill(beams, k, landed[k], scale[k], *pieces[k]), range(len(landed)), threads)
    return beams


def _cut(rows: NDArray[np.float64], piece: float, near: float) -> tuple[Any, ...]:
    """(beam of each piece, its begin, its end, its radius), in Morton order."""
    if not len(rows):
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0)
    counts = np.clip(np.ceil(rows[:, 9] / piece), 1, MOST_PIECES).astype(np.int64)
    beam = np.repeat(np.arange(len(rows)), counts)
    number = np.arange(len(beam)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = (rows[:, 9] / counts)[beam]
    begin, end = number * step, (number + 1) * step
    middle = rows[beam, :3] - rows[beam, 3:6] * (0.5 * (begin + end))[:, None]
    widths = 8.0 * piece * 0.5 ** np.arange(LEVELS)
    level, radius = np.full(len(beam), -1, np.int32), np.zeros(len(beam))
    _measure(middle, CELL, 1.0 / widths, np.zeros(max(16, 1 << (2 * len(beam) - 1).bit_length()), np.int32), level, radius)
    width = widths[level]
    count = CELL * (0.5 * width / np.maximum(radius, 1e-30)) ** 2
    radius = np.minimum(near * width * width / (2.0 * count * piece), 0.5 * width)
    order = np.argsort(_morton(middle), kind="stable")
    return beam[order], begin[order], end[order], radius[order]


def _morton(points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The place of points on a curve in Z order."""
    low = points.min(axis=0)
    cells = ((points - low) * (1023.0 / np.maximum((points.max(axis=0) - low).max(), 1e-30))).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _fill(beams: Beams, k: int, rows: NDArray[np.float32], scale: float, beam: Any, begin: Any, end: Any, radius: Any) -> None:
    """Write the pieces of map k and the boxes around them."""
    n, first, count = len(beams.begin), k * beams.leaves * LEAF, len(beam)
    at = slice(first, first + count)
    for axis in range(3):
        column = slice(axis * n + first, axis * n + first + count)
        beams.start[column], beams.direction[column] = rows[beam, axis], -rows[beam, 3 + axis]
        beams.power[column] = scale * rows[beam, 6 + axis]
    beams.begin[at], beams.end[at], beams.inverse[at] = begin, end, 1.0 / radius
    beams.medium[at] = (rows[beam, 12] - CODE + 0.5).astype(np.int32)
    ends = [rows[beam, :3] - rows[beam, 3:6] * t[:, None] for t in (begin, end)]
    low, high = np.full((beams.leaves * LEAF, 3), NOWHERE), np.full((beams.leaves * LEAF, 3), -NOWHERE)
    wide = radius[:, None] * 1.001
    low[:count], high[:count] = np.minimum(*ends) - wide, np.maximum(*ends) + wide
    low, high = low.reshape(-1, LEAF, 3).min(axis=1), high.reshape(-1, LEAF, 3).max(axis=1)
    boxes = beams.boxes.reshape(MAPS, 2 * beams.leaves, 6)[k]
    size = beams.leaves
    while size:
        boxes[size : 2 * size, :3], boxes[size : 2 * size, 3:] = low, high
        size //= 2
        if size:
            low, high = low.reshape(-1, 2, 3).min(axis=1), high.reshape(-1, 2, 3).max(axis=1)


@kernel
def _measure(points, near, cells, counts, level, radius):
    """Write the level and radius of points, by the finest cells with enough of them."""
    photon_grid.choose_radii(points, near, cells, counts, level, radius)


# --- in lanes ------------------------------------------------------------------------------------------------------------


def of(maps: Any) -> Any:
    """The beams of photon maps; None without any, and in numpy."""
    return None


@overload(of)
def _of_in_kernels(maps):
    if maps.layout and maps.field("beams")[1] != ():
        return lambda maps: maps.beams
    return lambda maps: None


@helper
def _along(beams: Any, flown: Flown, tables: Tables, path: PathState, active: Lane, end: Lane, index: PathSample, most: int) -> Flown:
    if beams.leaves == 0 or index.depth > most:
        return flown
    medium = ops.where(active & (path.phase < MATT), medium_stack.top(path.inside), 0)
    lanes = (medium > 0) & (beams.beamed[medium])
    if ops.not_(ops.any_lane(lanes)):
        return flown
    place = ops.sub(path.origin, (beams.origin[0], beams.origin[1], beams.origin[2]))
    segment = Segment(place, path.direction, path.near, end, medium)
    light = _gather(beams, medium_stack.scattering(tables), segment, lanes, index.sample)
    light = ops.mul(path.weight, light)
    zero = 0.0 * end
    return Flown(flown.weight, flown.scattered, flown.t, ops.add(flown.emitted, ops.where3(lanes, light, (zero, zero, zero))))


along = specialize_if_present(_along)
"""(beams, flown, tables, paths before their flight, active, distance of hits or inf, index, most bounces): with the light of beams."""


@helper
def _beam(beams: Any, plain: Any, path: PathState, flying: Lane, end: Lane) -> tuple[Lane, Lane, Lane]:
    number = ops.where(flying, medium_stack.top(path.inside), 0)
    lands = (number > 0) & beams.beamed[number] & (ops.largest(path.weight) > 0.0)
    length = ops.minimum(end, beams.reach) - path.near
    return lands & (length > 0.0), length, ops.to_float(number) + CODE


beam = specialize_if_present(_beam)
"""(beams, None, photons before their flight, those to store, distance of hits or inf): (beams to store, their length, their code)."""


@helper
def _unbeamed(beams: Any, plain: Lane, path: PathState) -> Lane:
    return plain & ops.not_(beams.beamed[medium_stack.top(path.inside)])


unbeamed = specialize_if_present(_unbeamed)  # (beams, mask, photons): without those in media whose photons are beams


@helper
def _closest(way: Vec, d: Vec, v: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(distances along a ray and a beam at which they are nearest, their squared distance, the squared sine between them).

    `way` is from the origin of the ray to the start of the beam, `d` and `v` are their directions.
    """
    x, y, z = d[1] * v[2] - d[2] * v[1], d[2] * v[0] - d[0] * v[2], d[0] * v[1] - d[1] * v[0]
    squared = x * x + y * y + z * z
    inverse = 1.0 / ops.maximum(squared, PARALLEL)
    apart = way[0] * x + way[1] * y + way[2] * z
    a, b, c = y * d[2] - z * d[1], z * d[0] - x * d[2], x * d[1] - y * d[0]  # (d × v) × d: along the beam
    s = -(way[0] * a + way[1] * b + way[2] * c) * inverse
    a, b, c = y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]
    t = -(way[0] * a + way[1] * b + way[2] * c) * inverse
    return t, s, apart * apart * inverse, squared


@helper
def _list_leaf(beams: Any, first: int, o: Vec, d: Vec, span: tuple[Lane, Lane], like: Lane, lists: Lists, k: int) -> None:
    """Add to the list of lane k the pieces of a leaf that pass its ray within their radius."""
    n, width = len(beams.begin), crosslane.width(like)
    for at in range(first, first + LEAF, width):
        way = (
            crosslane.load_like(beams.start, at, like) - o[0], crosslane.load_like(beams.start, at + n, like) - o[1],
            crosslane.load_like(beams.start, at + 2 * n, like) - o[2],
        )  # fmt: skip
        v = (
            crosslane.load_like(beams.direction, at, like), crosslane.load_like(beams.direction, at + n, like),
            crosslane.load_like(beams.direction, at + 2 * n, like),
        )  # fmt: skip
        t, s, apart, squared = _closest(way, d, v)
        inverse = crosslane.load_like(beams.inverse, at, like)
        meets = (squared > PARALLEL) & (apart * inverse * inverse < 1.0) & (t >= span[0]) & (t < span[1])
        meets = meets & (s >= crosslane.load_like(beams.begin, at, like)) & (s < crosslane.load_like(beams.end, at, like))
        if ops.any_lane(meets):
            count = lists.counts[k]
            compress_store(lists.rows, k * LISTED + count, simd.iota(ops.int_like(like, 0)) + at, meets)
            lists.counts[k] = count + crosslane.count(meets)


@helper
def _enters(beams: Any, at: int, o: Any, inverse: Any, near: float, far: float) -> bool:
    """Whether a ray enters a box."""
    for axis in range(3):
        low, high = float(beams.boxes[at + axis]), float(beams.boxes[at + 3 + axis])
        a = ((low if inverse[axis] > 0.0 else high) - o[axis]) * inverse[axis]
        b = ((high if inverse[axis] > 0.0 else low) - o[axis]) * inverse[axis]
        near, far = max(near, a), min(far, b)
    return near <= far


@helper
def _inverse(x: float) -> float:
    return 1.0 / x if abs(x) > 1e-18 else (1e18 if x >= 0.0 else -1e18)


@separate_helper
def _gather(beams, table, segment, active, sample):
    """The light that beams send along rays, at their origin."""
    number = (sample + (sample >> 4) * 5) & (MAPS - 1)
    zero = 0.0 * segment.near
    light = (zero, zero, zero)
    lists = Lists(simd.stack_array(np.int32, LISTS), simd.stack_array(np.int32, LANES))
    stack = simd.stack_array(np.int32, 64)
    for k in range(LANES):
        lists.counts[k] = 0
    lanes = crosslane.bits(active)
    for k in range(crosslane.width(zero)):
        if (lanes >> k) & 1 == 0:
            continue
        m = np.int64(crosslane.lane(number, k))
        o, d = crosslane.lane3(segment.place, k), crosslane.lane3(segment.direction, k)
        near, far = crosslane.lane(segment.near, k), crosslane.lane(segment.far, k)
        inverse = (_inverse(d[0]), _inverse(d[1]), _inverse(d[2]))
        stack[0] = np.int32(1)
        depth = 1
        while depth > 0:
            depth -= 1
            node = np.int64(stack[depth])
            if _enters(beams, (m * 2 * beams.leaves + node) * 6, o, inverse, near, far):
                if node < beams.leaves:
                    stack[depth] = np.int32(2 * node)
                    stack[depth + 1] = np.int32(2 * node + 1)
                    depth += 2
                else:
                    first = (m * beams.leaves + node - beams.leaves) * LEAF
                    _list_leaf(beams, first, o, d, (near, far), zero, lists, k)
                    if lists.counts[k] > LISTED - LEAF:
                        light = _add_listed(beams, table, segment, light, lists)
    return _add_listed(beams, table, segment, light, lists)


@separate_helper
def _add_listed(beams, table, segment, light, lists):
    """Add the light of the listed pieces, and empty the lists."""
    zero = ops.int_like(segment.near, 0)
    counts, base = zero + crosslane.load_like(lists.counts, 0, segment.near), simd.iota(zero) * LISTED
    for k in range(crosslane.reduce_max(counts)):
        mine = counts > k
        light = ops.add(light, _beam_light(beams, table, segment, mine, ops.where(mine, lists.rows[base + k], 0)))
    for k in range(LANES):
        lists.counts[k] = 0
    return light


@helper
def _beam_light(beams: Any, table: Any, segment: Segment, mine: Lane, row: Lane) -> Vec:
    n, d, x = len(beams.begin), segment.direction, segment.place
    v = (beams.direction[row], beams.direction[row + n], beams.direction[row + 2 * n])
    start = (beams.start[row], beams.start[row + n], beams.start[row + 2 * n])
    way = ops.sub(start, x)
    t, s, apart, squared = _closest(way, d, v)
    t, s, inverse = ops.maximum(t, segment.near), ops.maximum(s, 0.0), beams.inverse[row]
    blur = 0.75 * inverse * ops.maximum(1.0 - apart * inverse * inverse, 0.0) / ops.sqrt(ops.maximum(squared, PARALLEL))
    medium, zero = segment.medium, 0.0 * t
    top, falloff = zero + table.top[medium], zero + table.falloff[medium]
    at, from_ = x[1] + beams.origin[1] + segment.near * d[1], start[1] + beams.origin[1]
    length = column.column(at, d[1], top, falloff, t - segment.near) + column.column(from_, v[1], top, falloff, s)
    red, green, blue, _ = row_gather.four_at(table.extinction, medium)
    back_r, back_g, back_b, _ = row_gather.four_at(table.scattering, medium)
    cosine = ops.clip(-ops.dot(d, v), -1.0, 1.0)
    density = phase_table.density(table.draine, phase.density(zero + table.anisotropy[medium], cosine), medium, cosine)
    density = density * column.density_at(at + d[1] * (t - segment.near), top, falloff)
    share = ops.where(mine & (beams.medium[row] == medium), blur * density, 0.0)
    return (
        share * beams.power[row] * back_r * ops.exp(-ops.minimum(red * length, 80.0)),
        share * beams.power[row + n] * back_g * ops.exp(-ops.minimum(green * length, 80.0)),
        share * beams.power[row + 2 * n] * back_b * ops.exp(-ops.minimum(blue * length, 80.0)),
    )  # fmt: skip
