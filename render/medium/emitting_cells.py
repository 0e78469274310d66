"""Cells of media that emit: light samples choose a point by emitted power, and collect the light of all the line through it.

Simon, Hanika, Zirr, Dachsbacher 2017, "Line Integration for Rendering Heterogeneous Emissive Volumes". A direction has the density of all
points on its line: the integral of the density of points times the squared distance, which is a sum over cells.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from ..geometry import bounds
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import tracking

KIND = 30  # of the rows of emitters, beside light.form_samples
MOST_BOXES = 64  # of shapes around one medium; more have one box around all of them
PARTS = 2  # points along each side of a cell, whose mean density counts
COLLECTING = 1e30  # code of the distance of shadow rays that collect emission, in metres
CODES = 1.0 / 128.0  # of it, times the number of the medium


class NoCells(NamedTuple):
    """No medium that emits has light samples."""


class Cells(NamedTuple):
    """Cells of the media that emit, by rows of the emitter table from `first` on."""

    row: Any  # (media,) row of the emitter table by the number of a medium, or -1
    first: int
    number: Any  # (rows,) the number of the medium of row first, first + 1, …
    boxes: Any  # (rows + 1,) the first box of a row
    spans: Any  # (rows + 1,) the first cell of a row
    to_cells: Any  # (boxes, 12) rows of the matrix from the world to the cells of a box: 0 … cells
    from_cells: Any  # (boxes, 12) its inverse
    cells: Any  # (boxes, 4) int: cells along x, y and z, and the first of them
    majorants: Any  # (cells,) density of points per cubic metre
    sums: Any  # (cells,) probability of the cells of a row up to this one
    box: Any  # (cells,) the box of a cell
    steps: int  # of the search for a cell


class Shining(NamedTuple):
    """A medium as a light: its box and its radiant intensity."""

    low: np.ndarray
    high: np.ndarray
    intensity: np.ndarray  # (3,)


class _Box(NamedTuple):
    to_cells: np.ndarray  # (3, 4)
    size: np.ndarray  # (3,) cells
    density: np.ndarray  # (cells,) mean density, x fastest


def build(tables: ir.Tables, first: int, moves: bool, general: bool) -> tuple[Any, list[Shining]]:
    """(Cells, the media as lights, from row `first` of the emitter table on). Media behind real surfaces, and fog, have no light samples.

    With `moves`, neither have those of shapes that move.
    """
    media = getattr(tables.materials, "media", None)
    scatter = getattr(media, "scatter", None)
    if not scatter:
        return NoCells(), []
    row, rows, lights = np.full(len(scatter.emission), -1, np.int64), [], []
    for number in np.flatnonzero(scatter.emission.max(axis=1) > 0.0).tolist():
        boxes = _boxes(tables, media, number, moves)
        volumes = [abs(np.linalg.det(box.to_cells[:, :3])) ** -1 * box.density for box in boxes]
        if boxes and sum(float(volume.sum()) for volume in volumes) > 0.0:
            row[number] = first + len(rows)
            rows.append((number, boxes, volumes))
            lights.append(_light(scatter, number, boxes, volumes))
    if not rows and not general:
        return NoCells(), []
    return _cells(row, first, rows), lights


def _boxes(tables: ir.Tables, media: Any, number: int, moves: bool) -> list[_Box]:
    """The boxes of a medium; none where light samples do not find it."""
    scatter, instances = media.scatter, tables.instances
    materials = np.flatnonzero(media.number == number)
    holders = np.flatnonzero(np.isin(instances.material, materials) & (instances.visible & ir.Visibility.REFLECTION != 0))
    if not len(holders) or not scatter.clear[instances.material[holders]].all():
        return []
    if moves and (tables.transforms.first_key[instances.transform[holders]] >= 0).any():
        return []
    fields = scatter.fields
    if not isinstance(fields, tracking.NoFields) and fields.density[number] >= 0:
        size = fields.cells[number, :3]
        to_cells = fields.to_cells[number].reshape(3, 4)
        return [_Box(to_cells, size, _mean_density(tables, fields, number, to_cells, size))]
    boxes = bounds.world_bounds(tables)[holders]
    if not np.isfinite(boxes).all():
        return []
    if len(boxes) > MOST_BOXES:
        boxes = np.concatenate([boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)])[None]
    cubes = []
    for low, high in zip(boxes[:, :3], boxes[:, 3:], strict=True):
        sides = np.maximum(high - low, 1e-9)
        to_cells = np.concatenate([np.diag(1.0 / sides), -(low / sides)[:, None]], axis=1)
        cubes.append(_Box(to_cells, np.ones(3, np.int64), np.ones(1)))
    return cubes


def _mean_density(tables: ir.Tables, fields: Any, number: int, to_cells: np.ndarray, size: np.ndarray) -> np.ndarray:
    inverse = np.linalg.inv(to_cells[:, :3])
    z, y, x = (a.ravel() for a in np.mgrid[: size[2], : size[1], : size[0]])
    total = np.zeros(len(x))
    for part in np.ndindex(PARTS, PARTS, PARTS):
        place = np.stack([x, y, z]) + (np.array(part)[:, None] + 0.5) / PARTS
        world = inverse @ (place - to_cells[:, 3:])
        zero = np.zeros(len(x))
        ray = ((*world,), (zero, zero, zero), zero, zero)
        with np.errstate(all="ignore"):
            total += tracking.density_at(tables, fields, np.full(len(x), number), ray, zero)
    return np.nan_to_num(total / PARTS**3)


def _light(scatter: Any, number: int, boxes: list[_Box], volumes: list[np.ndarray]) -> Shining:
    """The box of a medium, and its intensity: that of a thin one, less what it absorbs of its own."""
    corners = []
    for box in boxes:
        inverse = np.linalg.inv(box.to_cells[:, :3])
        ends = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)]) * box.size
        corners.append((ends - box.to_cells[:, 3]) @ inverse.T)
    places = np.concatenate(corners)
    low, high = places.min(axis=0), places.max(axis=0)
    x, y, z = np.maximum(high - low, 1e-9)
    amount = sum(float(volume.sum()) for volume in volumes)
    depth = scatter.extinction[number, :3] * amount / (0.5 * (x * y + y * z + z * x))
    passed = np.where(depth > 1e-6, -np.expm1(-depth) / np.maximum(depth, 1e-12), 1.0)
    return Shining(low, high, scatter.emission[number, :3] * amount * passed)


def _cells(row: np.ndarray, first: int, rows: list[Any]) -> Cells:
    boxes = [box for _, of_row, _ in rows for box in of_row]
    counts = [len(box.density) for box in boxes]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    densities, sums = [], []
    for _, of_row, volumes in rows:
        amounts = np.concatenate(volumes)
        share = amounts / amounts.sum()
        sums.append(np.append(np.minimum(np.cumsum(share[:-1]), 1.0), 1.0))
        per_metre = np.concatenate([np.full(len(box.density), abs(np.linalg.det(box.to_cells[:, :3]))) for box in of_row])
        densities.append(share * per_metre)
    backward = []
    for box in boxes:
        inverse = np.linalg.inv(box.to_cells[:, :3])
        backward.append(np.concatenate([inverse, -(inverse @ box.to_cells[:, 3:])], axis=1).ravel())
    box_counts = np.cumsum([0, *(len(of_row) for _, of_row, _ in rows)])
    return Cells(
        row, first, np.array([number for number, _, _ in rows] or [0], np.int64), box_counts.astype(np.int64), starts[box_counts],
        np.array([box.to_cells.ravel() for box in boxes] or [np.zeros(12)]), np.array(backward or [np.zeros(12)]),
        np.array([[*box.size.tolist(), start] for box, start in zip(boxes, starts[:-1].tolist(), strict=True)] or [[1, 1, 1, 0]], np.int64),
        np.concatenate(densities or [np.zeros(1)]), np.concatenate(sums or [np.ones(1)]),
        np.repeat(np.arange(len(boxes)), counts).astype(np.int64) if boxes else np.zeros(1, np.int64),
        int(max(counts, default=1) * max(len(boxes), 1)).bit_length() + 1,
    )  # fmt: skip


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def _some(cells: Any, default: bool) -> bool:
    return len(cells.boxes) > 1


exist = specialize_if_present(_some)  # (cells, False): whether a medium has light samples


@separate_helper
def sample(cells: Any, e: Lane, place: Vec, u: Lane, v: Lane, w: Lane) -> tuple[Vec, Lane]:
    """(direction from a place to a point of row e of the emitter table, its solid angle density)."""
    zero = 0.0 * u
    none = ops.int_like(zero, 0)
    k = none + e - cells.first
    first = none + cells.spans[k]
    low, high = first, none + cells.spans[k + 1] - 1
    for _ in range(cells.steps):
        middle = (low + high) >> 1
        beyond = (cells.sums[middle] <= u) & (low < high)
        low, high = ops.where(beyond, middle + 1, low), ops.where(beyond, high, middle)
    before = ops.where(low > first, cells.sums[ops.maximum(low - 1, 0)], 0.0)
    x = ops.clip((u - before) / ops.maximum(cells.sums[low] - before, 1e-30), 0.0, 1.0)
    box = none + cells.box[low]
    index = ops.to_float(low - (none + cells.cells[box, 3]))
    wide, high_y = ops.to_float(none + cells.cells[box, 0]), ops.to_float(none + cells.cells[box, 1])
    above = ops.floor((index + 0.5) / wide)
    slab = ops.floor((above + 0.5) / high_y)
    point = tracking.transform(cells.from_cells, box, (index - above * wide + x, above - slab * high_y + v, slab + w))
    way = ops.sub(point, place)
    direction = ops.scale(way, 1.0 / ops.maximum(ops.length(way), 1e-20))
    return direction, density(cells, none + e, place, direction)


@separate_helper
def density(cells: Any, e: Lane, place: Vec, direction: Vec) -> Lane:
    """The solid angle density of `sample`: over the line, the density of points times the squared distance."""
    zero = 0.0 * direction[0]
    none = ops.int_like(zero, 0)
    k = none + e - cells.first
    box, last = none + cells.boxes[k], none + cells.boxes[k + 1]
    total, outer = zero, box < last
    while ops.any_lane(outer):
        row = ops.where(outer, box, none)
        walk = tracking.enter_grid(cells, row, (place, direction, zero, zero + math.inf))
        going = outer & (walk.begin < walk.end)
        t = ops.where(going, walk.begin, zero)
        while ops.any_lane(going):
            likely, leaves = tracking.cell_at(cells, walk, t)
            leaves = ops.where(going, ops.minimum(leaves, walk.end), t)
            total = total + likely * (leaves - t) * (leaves * leaves + leaves * t + t * t) * (1.0 / 3.0)
            t = leaves
            going = going & (t < walk.end)
        box = box + 1
        outer = outer & (box < last)
    return total


@helper
def code(number: Lane) -> Lane:
    """The distance that marks a shadow ray which collects the light of a medium."""
    return -COLLECTING * (1.0 + CODES * ops.to_float(number))


@helper
def collected(distance: Lane) -> Lane:
    """The number of the medium whose light a shadow ray collects, by its distance; 0 of other rays."""
    marked = (distance >= 0.5 * COLLECTING) & (distance < math.inf)
    share = ops.where(marked, distance * (1.0 / COLLECTING), 1.0)
    return ops.to_int(ops.floor((share - 1.0) * (1.0 / CODES) + 0.5))
