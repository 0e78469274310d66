"""Traversal of the cell grid of an implicit surface: the first root along each ray.

All lanes step side by side, each to its next cell that may hold a part of the surface. In a cell, the values at both ends of the ray
segment and the bounds of the slope mostly decide between one root and none. `root_isolation` subdivides the undecided segments.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import simd
from ..jit.kernel import helper
from ..lanes import crosslane, ops
from ..simd.atomics import count_up
from ..types import Lane, Vec
from . import root_isolation
from .bracketing import ULP, Bracket, SegmentBounds, excludes_root, refine_bracket, sphere_trace
from .evaluate import EvalBuffers, RayFunction, value_on
from .interval_grid import PENDING, ensure_block
from .tables import CELLS_ALONG, CELLS_PER_UNIT, FIRST_CELL, IS_SHEET, LARGEST_COORDINATE

_FAR = 1e30


class GridRays(NamedTuple):
    """Rays in the grid of surface `k`."""

    k: int
    memory: EvalBuffers
    start: Vec
    direction: Vec
    end: Lane
    begin: Lane  # distance of `start` from the rays' origins
    cells: Vec  # `start` in cells
    cell_direction: Vec  # `direction` in cells


class Cell(NamedTuple):
    """A cell, and the distance at which a ray enters it."""

    x: Lane
    y: Lane
    z: Lane
    entry: Lane


class LeafSegment(NamedTuple):
    """The segment a … b of a ray in a leaf, and the cell behind it."""

    leaf: Lane
    a: Lane
    b: Lane
    after: Cell


class Roots(NamedTuple):
    """First roots of rays so far."""

    distance: Lane  # inf without a root
    tape: Lane
    inside: Lane  # mask: the ray is inside before the root
    unproved: Lane  # 1 where a segment before it is not proved to be free of roots
    rounds: Lane  # of root_isolation, spent on the ray


@helper
def first_roots(
    forms: Any, k: int, memory: EvalBuffers, start: Vec, direction: Vec, end: Lane, begin: Lane, active: Lane
) -> tuple[Lane, Lane, Lane, Lane]:
    """(distance of the first root or inf, its tape, whether the ray is inside before it, 1 where unproved) of rays inside the box.

    Rays go from `start`, which lies `begin` from their origins, to the distance `end`.
    """
    rays = _grid_rays(forms, k, memory, start, direction, end, begin)
    zero, never = ops.full_like(end, 0.0), active & ops.not_(active)
    last = forms.places[k, CELLS_ALONG] - 1
    cell = Cell(_cell_index(rays.cells[0], 0, last), _cell_index(rays.cells[1], 0, last), _cell_index(rays.cells[2], 0, last), zero)
    value, has_value = zero, never  # the value at the entry of the cell, and the lanes in which it is known
    roots = Roots(zero + np.inf, ops.int_like(zero, 0), never, zero, zero)
    while ops.any_lane(active):
        cell, segment, at_leaf, has_value, active = _advance_to_leaf(forms, rays, cell, has_value, active)
        if ops.any_lane(at_leaf):
            value, roots, active = _intersect_leaf(forms, rays, segment, value, has_value, at_leaf, roots, active)
            cell, has_value = _select_cell(at_leaf, segment.after, cell), has_value | at_leaf
            active = active & ops.not_(at_leaf & _has_left(segment.after, last, end))
    doubts = crosslane.count(roots.unproved > 0.0)
    if doubts > 0:
        count_up(forms.unproved, 0, doubts)
    return roots.distance, roots.tape, roots.inside, roots.unproved


@helper
def _grid_rays(forms: Any, k: int, memory: EvalBuffers, start: Vec, direction: Vec, end: Lane, begin: Lane) -> GridRays:
    numbers = forms.numbers
    density = (numbers[k, CELLS_PER_UNIT], numbers[k, CELLS_PER_UNIT + 1], numbers[k, CELLS_PER_UNIT + 2])
    cells = ((start[0] - numbers[k, 0]) * density[0], (start[1] - numbers[k, 1]) * density[1], (start[2] - numbers[k, 2]) * density[2])
    cell_direction = (direction[0] * density[0], direction[1] * density[1], direction[2] * density[2])
    return GridRays(k, memory, start, direction, end, begin, cells, cell_direction)


@helper
def _advance_to_leaf(
    forms: Any, rays: GridRays, cell: Cell, has_value: Lane, active: Lane
) -> tuple[Cell, LeafSegment, Lane, Lane, Lane]:  # fmt: skip
    """Move each lane to its next leaf: (cells, segments, lanes at a leaf, lanes whose value is still known, active lanes)."""
    count, grid = forms.places[rays.k, CELLS_ALONG], forms.places[rays.k, FIRST_CELL]
    zero = ops.full_like(rays.end, 0.0)
    looking, at_leaf = active, active & ops.not_(active)
    segment = LeafSegment(ops.int_like(zero, 0), zero, zero, Cell(cell.x, cell.y, cell.z, zero))
    while ops.any_lane(looking):
        mark = ops.to_int(forms.grid[ops.where(looking, grid + (cell.x * count + cell.y) * count + cell.z, 0)])
        if _subdivide_pending(forms, rays.k, mark, looking):
            continue
        full = mark >= 0
        extent = ops.int_like(zero, 1) << ops.where(full, 0, 2 * (-1 - ops.maximum(ops.minimum(mark, -1), PENDING)))
        after = _next_cell(rays.cells, rays.cell_direction, cell, extent)
        arrived, passing = looking & full, looking & ops.not_(full)
        segment = LeafSegment(
            ops.where(arrived, mark, segment.leaf), ops.where(arrived, cell.entry, segment.a),
            ops.where(arrived, ops.minimum(after.entry, rays.end), segment.b), _select_cell(arrived, after, segment.after),
        )  # fmt: skip
        at_leaf = at_leaf | arrived
        cell, has_value = _select_cell(passing, after, cell), has_value & ops.not_(passing)
        finished = passing & _has_left(after, count - 1, rays.end)
        active, looking = active & ops.not_(finished), passing & ops.not_(finished)
    return cell, segment, at_leaf & active, has_value, active


@helper
def _subdivide_pending(forms: Any, k: int, mark: Lane, looking: Lane) -> bool:
    """Subdivide the pending blocks that lanes have reached; return whether there were any."""
    pending = crosslane.bits(looking & (mark <= PENDING))
    some = pending != 0
    while pending != 0:
        ensure_block(forms, k, PENDING - crosslane.lane(mark, simd.trailing_zeros(pending)))
        pending &= pending - 1
    return some


@helper
def _select_cell(mask: Lane, yes: Cell, no: Cell) -> Cell:
    return Cell(
        ops.where(mask, yes.x, no.x), ops.where(mask, yes.y, no.y), ops.where(mask, yes.z, no.z), ops.where(mask, yes.entry, no.entry)
    )  # fmt: skip


@helper
def _intersect_leaf(
    forms: Any, rays: GridRays, segment: LeafSegment, value: Lane, has_value: Lane, at_leaf: Lane, roots: Roots, active: Lane
) -> tuple[Lane, Roots, Lane]:
    """Find the first roots in leaf segments, in the lanes `at_leaf`: (values at the far ends, roots, active lanes)."""
    a, b = segment.a, segment.b
    tape = ops.to_int(forms.leaf_tape[segment.leaf])
    ray = RayFunction(forms, rays.k, tape, rays.memory, rays.start, rays.direction)
    if ops.any_lane(at_leaf & ops.not_(has_value)):
        value = ops.where(has_value, value, value_on(ray, a, at_leaf))
    far = value_on(ray, b, at_leaf)
    low, high = _slope_bounds(forms, segment.leaf, rays.direction)
    monotonic = (low > 0.0) | (high < 0.0)
    in_a, in_b = value <= 0.0, far <= 0.0
    change = (in_a & ops.not_(in_b)) | (in_b & ops.not_(in_a))
    ends = SegmentBounds(value, far, low, high)
    none = ops.not_(change) & (monotonic | excludes_root(ends, b - a))
    certain = at_leaf & change & monotonic
    undecided = at_leaf & ops.not_(none) & ops.not_(certain)
    if ops.any_lane(certain):
        root = refine_bracket(ray, Bracket(a, b, value, far), rays.begin, forms.numbers[rays.k, LARGEST_COORDINATE], certain)
        roots, active = _with_roots(roots, certain, root, tape, in_a), active & ops.not_(certain)
    if ops.any_lane(undecided):
        roots, active = _search_segments(ray, rays.begin, segment, ends, undecided, roots, active)
    return ops.where(at_leaf, far, value), roots, active


@helper
def _with_roots(roots: Roots, mask: Lane, distance: Lane, tape: Lane, inside: Lane) -> Roots:
    """Replace the roots in the lanes of a mask."""
    return Roots(
        ops.where(mask, distance, roots.distance), ops.where(mask, tape, roots.tape), (roots.inside & ops.not_(mask)) | (mask & inside),
        roots.unproved, roots.rounds,
    )  # fmt: skip


@helper
def _search_segments(
    ray: RayFunction, begin: Lane, segment: LeafSegment, ends: SegmentBounds, mask: Lane, roots: Roots, active: Lane
) -> tuple[Roots, Lane]:
    """Isolate the first root in each segment of a mask, lane by lane: (roots, active lanes)."""
    forms, k, b = ray.forms, ray.k, segment.b
    sheet, zero = forms.places[k, IS_SHEET] != 0, ops.full_like(segment.a, 0.0)
    begins, undecided = sphere_trace(ray, segment.a, b, ends, mask)
    remaining = crosslane.bits(undecided)
    while remaining != 0:
        j = simd.trailing_zeros(remaining)
        remaining &= remaining - 1
        rounds = max(root_isolation.MAX_ROUNDS - int(crosslane.lane(roots.rounds, j)), root_isolation.MIN_ROUNDS)
        lane_ray = RayFunction(
            forms, k, crosslane.lane(ray.tape, j), ray.memory, crosslane.lane3(ray.start, j), crosslane.lane3(ray.direction, j)
        )  # fmt: skip
        root, within, doubt, used = root_isolation.isolate_first_root(
            lane_ray, crosslane.lane(begins, j), crosslane.lane(b, j), 0.0, crosslane.lane(begin, j), sheet, zero, rounds
        )  # fmt: skip
        mine = ops.to_int(crosslane.lane_indices(0)) == j
        unproved = ops.where(mine & (doubt > 0), 1.0, roots.unproved)
        roots = Roots(roots.distance, roots.tape, roots.inside, unproved, ops.where(mine, roots.rounds + used, roots.rounds))
        if root < np.inf:
            roots, active = _with_roots(roots, mine, ops.full_like(zero, root), ray.tape, within & mine), active & ops.not_(mine)
    return roots, active


@helper
def _cell_index(q: Lane, low: Lane, high: Lane) -> Lane:
    return ops.maximum(ops.minimum(ops.to_int(ops.floor(q)), high), low)


@helper
def _has_left(cell: Cell, last: int, end: Lane) -> Lane:
    """Whether a ray has left the grid or reached its end."""
    x, y, z = cell.x, cell.y, cell.z
    return (x < 0) | (y < 0) | (z < 0) | (x > last) | (y > last) | (z > last) | (cell.entry >= end)


@helper
def _next_cell(q: Vec, d: Vec, cell: Cell, extent: Lane) -> Cell:
    """The cell behind the block of `extent` cells along an axis that contains `cell`."""
    bx, by, bz = cell.x & -extent, cell.y & -extent, cell.z & -extent
    tx, ty, tz = _exit_distance(q[0], d[0], bx, extent), _exit_distance(q[1], d[1], by, extent), _exit_distance(q[2], d[2], bz, extent)
    out = ops.minimum(tx, ops.minimum(ty, tz))
    by_x = tx <= out
    by_y = (ty <= out) & ops.not_(by_x)
    by_z = ops.not_(by_x) & ops.not_(by_y)
    top = extent - 1
    reach = ops.where(out < _FAR, out, 0.0)
    return Cell(
        _next_index(by_x, q[0] + reach * d[0], d[0], bx, top), _next_index(by_y, q[1] + reach * d[1], d[1], by, top),
        _next_index(by_z, q[2] + reach * d[2], d[2], bz, top), ops.maximum(out, cell.entry),
    )  # fmt: skip


@helper
def _exit_distance(q: Lane, d: Lane, low: Lane, extent: Lane) -> Lane:
    """Distance at which a ray leaves a block along one axis."""
    edge = ops.to_float(ops.where(d > 0.0, low + extent, low))
    return ops.where(d == 0.0, np.inf, (edge - q) / ops.where(d == 0.0, 1.0, d))


@helper
def _next_index(exits: Lane, q: Lane, d: Lane, low: Lane, top: Lane) -> Lane:
    """Index along one axis behind a block: the neighbour where the ray exits through that axis, else the index of q in the block."""
    return ops.where(exits, ops.where(d > 0.0, low + top + 1, low - 1), _cell_index(q, low, low + top))


@helper
def _slope_bounds(forms: Any, leaf: Lane, direction: Vec) -> tuple[Lane, Lane]:
    """Bounds of the slope along rays in their leaves."""
    slopes, zero = forms.leaf_slopes, 0.0 * direction[0]
    low, high, total = zero, zero, zero
    for axis in range(3):
        d = direction[0] if axis == 0 else direction[1] if axis == 1 else direction[2]
        p, q = d * slopes[leaf, 2 * axis], d * slopes[leaf, 2 * axis + 1]
        low, high = low + ops.minimum(p, q), high + ops.maximum(p, q)
        total = total + abs(p) + abs(q)
    slack = 8.0 * ULP * total
    return low - slack, high + slack
