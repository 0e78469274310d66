"""How far the surface of a formula is from triangles: a bound over its edges, corners and thin parts, by subdivision of boxes.

A box has no surface where interval bounds of the field exclude 0. Elsewhere no point of the surface in it is farther from the triangles
than its centre is and half of its diagonal. Where bounds of the gradient show that the surface in a box is the graph of a function of small
slope, and triangles pass through it, the surface is about as far from the triangles as they are from it. The other boxes are divided:
those at edges, at corners and in parts that triangles miss.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..formula import numpy_interpreter
from ..formula.interval_arithmetic import Interval
from ..formula.tape import Tape
from . import nearest_triangle
from .nearest_triangle import TriangleTree

FIRST = 16  # boxes along the longest axis, at the beginning
STEEPEST = 0.25  # slope of a graph: triangles that are `off` from it have it within off · SLANT
SLANT = (1.0 + STEEPEST**2) ** 0.5
SHARE = 1.25  # of the farthest point that was found: the bound that is enough
MOST = 1 << 19  # boxes of one size
LEVELS = 24
LOOKED_AT = 256  # points of the surface at a time whose distance is found
_BATCH = 1 << 12
_STEPS = 3  # of Newton's method, from the centre of a box to the surface
_BESIDE = 1e-3  # of the side of a box: distance at which a sign of the field tells that a point is on the surface
_HALF = 0.5 * 3.0**0.5  # of a diagonal
_SLACK = 1e-9  # of the side of a box
_OFFSETS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
_AROUND = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def bound(
    tape: Tape, box: Floats, positions: Floats, triangles: Ints, near: tuple[float, float], enough: float, ball: Floats | None = None
) -> float:  # fmt: skip
    """A bound of the distance of the surface's points in a box (2, 3) from triangles, at least `enough`, and within SHARE where it is more.

    `near` is the largest distance of a point of the triangles from the surface, and the side of cells in which no part was missed that has
    a gradient of one direction. `ball` (center, radius) limits the surface. Infinite without triangles.
    """
    off, cell = near
    enough = max(enough, SLANT * off)
    if not len(triangles):
        return np.inf
    tree, pieces = TriangleTree(positions, triangles), positions[triangles]
    size = float((box[1] - box[0]).max()) / FIRST
    count = np.maximum(np.ceil((box[1] - box[0]) / size - 1e-9), 1).astype(np.int64)
    cells = np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), axis=-1).reshape(-1, 3) + 1
    low = box.mean(axis=0) - 0.5 * size * (count + 2)  # a cell beside the first ones has no negative number
    found, most, far = 0.0, enough, np.zeros(0)
    for _ in range(LEVELS):
        cells = _may_hold(tape, low, cells, size)
        if ball is not None:
            cells = cells[np.linalg.norm(low + size * (cells + 0.5) - ball[:3], axis=1) <= ball[3] + _HALF * size]
        pieces = _beside(pieces, low, cells, size)
        limit = max(enough, SHARE * found)
        far = _reach(tree, low, cells, size, pieces, limit)
        rows = np.flatnonzero(far > limit)
        flat, places = _flat(tape, low + size * (cells[rows] + 0.5), size)
        rows = rows[flat]
        touched = (far[rows] <= 4.0 * _HALF * size) | (size >= cell)
        far[rows] = np.where(touched, np.minimum(far[rows], SLANT * off), far[rows])
        found = max(found, float(tree.distance(places[:: len(places) // LOOKED_AT + 1], found).max(initial=0.0)))
        left = far > max(enough, SHARE * found)
        most = max(most, float(far[~left].max(initial=0.0)))
        if not left.any() or 8 * int(left.sum()) > MOST:
            break
        size *= 0.5
        cells = (2 * cells[left][:, None] + _OFFSETS).reshape(-1, 3)
    return max(most, float(far.max(initial=0.0)))


def _code(cells: Ints) -> Ints:
    return (cells[:, 0] << 40) + (cells[:, 1] << 20) + cells[:, 2]


def _beside(pieces: Floats, low: Floats, cells: Ints, size: float) -> Floats:
    """Pieces (n, 3, 3) of triangles no longer than `size`, of which the middles are in cells (m, 3) or beside these."""
    near = np.unique(_code((cells[:, None] + _AROUND).reshape(-1, 3)))
    return nearest_triangle.divided(pieces, size, lambda corners: _is_touched(near, low, corners, size))


def _is_touched(near: Ints, low: Floats, corners: Floats, size: float) -> NDArray[np.bool_]:
    """(n,) whether the box of a triangle that is as short as a cell has its middle in a cell of `near`; True for longer ones."""
    least, most = corners.min(axis=1), corners.max(axis=1)
    long = (most - least).max(axis=1) > size
    return long | _holds(near, _code(np.floor((corners.mean(axis=1) - low) / size).astype(np.int64)))


def _holds(codes: Ints, wanted: Ints) -> NDArray[np.bool_]:
    """(n,) whether sorted codes hold those that are wanted."""
    if not len(codes):
        return np.zeros(len(wanted), bool)
    return codes[np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)] == wanted


def _reach(tree: TriangleTree, low: Floats, cells: Ints, size: float, pieces: Floats, limit: float) -> Floats:
    """(n,) bounds of the distance of points of cells from triangles, of which `limit` is enough.

    They are a diagonal where a cell has a piece of a triangle, and two where a cell beside it has one.
    """
    middles = np.unique(_code(np.floor((pieces.mean(axis=1) - low) / size).astype(np.int64)))
    own = _holds(middles, _code(cells))
    beside = _holds(middles, _code((cells[:, None] + _AROUND).reshape(-1, 3))).reshape(-1, len(_AROUND)).any(axis=1)
    far = np.where(own, 2.0, 4.0) * _HALF * size
    far[~beside] = tree.distance(low + size * (cells[~beside] + 0.5), limit - _HALF * size) + _HALF * size
    return far


def _may_hold(tape: Tape, low: Floats, cells: Ints, size: float) -> Ints:
    """The cells (n, 3) that may have a part of the surface."""
    kept = []
    for first in range(0, len(cells), _BATCH):
        part = cells[first : first + _BATCH]
        (least, most), _, maybe = numpy_interpreter.boxes(tape, (low + size * (part - _SLACK)).T, (low + size * (part + (1.0 + _SLACK))).T)
        kept.append(part[(least <= 0.0) & (~(most < 0.0) | maybe)])
    return np.concatenate([cells[:0], *kept])


def _flat(tape: Tape, centers: Floats, size: float) -> tuple[NDArray[np.bool_], Floats]:
    """(which cubes have a surface that `_is_flat`, points of the surface near the centres of some others)"""
    flat, places = np.zeros(len(centers), bool), [centers[:0]]
    for first in range(0, len(centers), _BATCH):
        part = slice(first, first + _BATCH)
        flat[part] = _is_flat(tape, centers[part], size)
        sharp = centers[part][~flat[part]]
        places.append(_on_surface(tape, sharp[:: len(sharp) // LOOKED_AT + 1], size))
    return flat, np.concatenate(places)


def _is_flat(tape: Tape, centers: Floats, size: float) -> NDArray[np.bool_]:
    """(n,) whether the surface in a cube, and around it, is the graph of a function of at most the slope STEEPEST."""
    ((least, _), *across), known = slopes_in_cubes(tape, centers, np.full(len(centers), 1.5 * size))
    with np.errstate(all="ignore"):
        side = np.sqrt(sum(np.maximum(np.abs(low), np.abs(high)) ** 2 for low, high in across))
        return known & (least > 0.0) & (side <= STEEPEST * least)


def slopes_in_cubes(tape: Tape, centers: Floats, sizes: Floats) -> tuple[list[Interval], NDArray[np.bool_]]:
    """(bounds over cubes of the slopes along the gradient at their centres and along two directions across it, whether they are known)"""
    _, gradient = numpy_interpreter.gradients(tape, *centers.T)
    with np.errstate(all="ignore"):
        length = np.linalg.norm(gradient, axis=0)
        known = np.isfinite(length) & (length > 0.0)
        axis = np.where(known, gradient / np.where(known, length, 1.0), np.array([[1.0], [0.0], [0.0]]))
    other = np.eye(3)[np.argmin(np.abs(axis), axis=0)].T
    one = np.cross(axis.T, other.T).T
    one /= np.linalg.norm(one, axis=0)
    half = 0.5 * sizes[:, None]
    _, slopes, maybe = numpy_interpreter.slope_boxes(tape, (centers - half).T, (centers + half).T, (axis, one, np.cross(axis.T, one.T).T))
    return slopes, known & ~maybe


def _on_surface(tape: Tape, centers: Floats, size: float) -> Floats:
    """Points of the surface in cubes, from their centres by Newton's method; not of all cubes."""
    places = centers
    for _ in range(_STEPS):
        value, gradient = numpy_interpreter.gradients(tape, *places.T)
        with np.errstate(all="ignore"):
            step = (value / (gradient**2).sum(axis=0) * gradient).T
        moved = np.clip(places - step, centers - 0.5 * size, centers + 0.5 * size)
        places = np.where(np.isfinite(step).all(axis=1)[:, None], moved, places)
    _, gradient = numpy_interpreter.gradients(tape, *places.T)
    with np.errstate(all="ignore"):
        beside = _BESIDE * size * (gradient / np.linalg.norm(gradient, axis=0)).T
    one, two = (numpy_interpreter.points(tape, *(places + way * beside).T)[0] <= 0.0 for way in (1, -1))
    return places[one != two]
