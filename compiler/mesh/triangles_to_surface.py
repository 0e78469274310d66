"""How far triangles are from the surface of a formula: a bound over all of their points, by division of triangles.

The centre of a piece has a change of the field's sign near it, and the other points of the piece are no farther from the surface than this
and their distance from the centre. Where bounds of the gradient show that the surface at a piece is the graph of a function of small slope,
the values of the field at its corners and the change of its gradient give a nearer bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..formula import numpy_interpreter
from ..formula.tape import Tape
from .surface_to_triangles import STEEPEST, slopes_in_cubes

SHARE = 1.25  # of the farthest point that was found: the bound that is enough
MOST, LEVELS = 1 << 19, 40  # pieces of one level; a level halves sides
_BATCH = 1 << 12
_STEPS = (1.0, 1.0001, 1.05, 1.5, 2.0, 4.0, 16.0, 64.0)  # of the distance to first order, at which a change of sign is looked for
_HALVINGS = 10
Floats = NDArray[np.float64]


def bound(tape: Tape, positions: Floats, triangles: NDArray[np.int64], enough: float) -> float:
    """A bound of the distance of points of triangles from the surface, at least `enough`, and within SHARE where it is more."""
    if not len(triangles):
        return 0.0
    pieces, most, found = positions[triangles], enough, 0.0
    extent = float(np.ptp(positions, axis=0).max())
    for _ in range(LEVELS):
        far = np.zeros(len(pieces))
        for first in range(0, len(pieces), _BATCH):
            part = slice(first, first + _BATCH)
            middles = pieces[part].mean(axis=1)
            near = _to_change(tape, middles, extent, max(enough, SHARE * found))
            found = max(found, float(near.max(initial=0.0)))
            radius = np.linalg.norm(pieces[part] - middles[:, None], axis=2).max(axis=1)
            far[part] = near + radius
            rows = first + np.flatnonzero(far[part] > max(enough, SHARE * found))
            far[rows] = np.minimum(far[rows], _on_graph(tape, pieces[rows]))
        left = far > max(enough, SHARE * found)
        most = max(most, float(far[~left].max(initial=0.0)))
        if not left.any() or 2 * int(left.sum()) > MOST:
            break
        pieces = _halves(pieces[left])
    return max(most, float(far.max(initial=0.0)))


def _halves(pieces: Floats) -> Floats:
    """The two halves of triangles (n, 3, 3), divided at their longest sides."""
    length = np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2)
    first = length.argmax(axis=1)[:, None, None]
    a, b, c = (np.take_along_axis(pieces, (first + k) % 3, axis=1)[:, 0] for k in range(3))
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _to_change(tape: Tape, places: Floats, extent: float, enough: float) -> Floats:
    """(n,) distances at which the field has another sign, the least that was found: along the gradient, and along axes where that fails."""
    value, gradient = numpy_interpreter.gradients(tape, *places.T)
    inside = value <= 0.0
    with np.errstate(all="ignore"):
        length = np.linalg.norm(gradient, axis=0)
        off = np.abs(value) / length
        way = (gradient / length).T * np.where(inside, 1.0, -1.0)[:, None]
    known = np.isfinite(off) & np.isfinite(way).all(axis=1)
    off, way = np.where(known, np.minimum(off, extent), extent), np.where(known[:, None], way, np.eye(3)[0])
    found = np.full(len(places), np.inf)
    least = 1e-10 * extent
    for share in _STEPS:
        rows = np.flatnonzero(found == np.inf)
        size = share * off[rows] + least
        found[rows] = np.where(_inside(tape, places[rows] + size[:, None] * way[rows]) != inside[rows], size, np.inf)
    rows = np.flatnonzero(found > enough)
    for k in range(_HALVINGS):
        size = np.minimum(found[rows], extent) * 0.5**k
        for direction in (*np.eye(3), *-np.eye(3)):
            other = _inside(tape, places[rows] + size[:, None] * direction) != inside[rows]
            found[rows] = np.where(other, np.minimum(found[rows], size), found[rows])
    return found


def _inside(tape: Tape, places: Floats) -> NDArray[np.bool_]:
    return numpy_interpreter.points(tape, *places.T)[0] <= 0.0


def _on_graph(tape: Tape, pieces: Floats) -> Floats:
    """(n,) bounds of the distance of pieces from the surface where it is a graph of at most the slope STEEPEST; infinite elsewhere."""
    if not len(pieces):
        return np.zeros(0)
    low, high = pieces.min(axis=1), pieces.max(axis=1)
    size = (high - low).max(axis=1)
    middles = 0.5 * (low + high)
    slopes, known = slopes_in_cubes(tape, middles, 1.5 * size)
    (least, greatest), *across = slopes
    value = numpy_interpreter.points(tape, *pieces.reshape(-1, 3).T)[0].reshape(-1, 3)
    with np.errstate(all="ignore"):
        side = np.sqrt(sum(np.maximum(np.abs(one), np.abs(two)) ** 2 for one, two in across))
        change = np.sqrt(sum((two - one) ** 2 for one, two in ((least, greatest), *across)))
        off = (np.abs(value).max(axis=1) + change * size) / least
        graph = known & (least > 0.0) & (side <= STEEPEST * least) & (off <= 0.25 * size)
    return np.where(graph & np.isfinite(off), off, np.inf)
