"""The definition of where a ray meets a formula's surface, in numpy: stretches of rays cut in two until each holds one root or none.

Brute and slow: every stretch that bounds cannot decide is looked at, down to FINEST, and the first root of all counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...compiler.formula import numpy_interpreter
from ...compiler.formula.tape import Tape
from ..types import Vec
from . import discontinuities, numpy_discontinuities
from .intersect import BACK, packed
from .root_isolation import FINEST, JUMP, LARGEST, NEIGHBOURS

PIECES = 16  # of each ray, to begin with
BISECTIONS = 80
APART = 2.0**-48  # of the largest coordinate, before and behind a root, where its jump is looked at
_BATCH = 1 << 15
Floats = NDArray[np.float64]


def meet(
    tape: Tape, parameters: Floats, bounds: Floats, origin: Vec, direction: Vec, t_min: Floats, t_max: Floats
) -> tuple[Floats, NDArray[np.int64], Floats, Floats, NDArray[np.bool_]]:
    """(t, spacing, u, v, unproved) of the first meeting of rays with a surface, as formulas.meet gives it."""
    n = len(t_min)
    found, unproved = np.full(n, np.inf), np.zeros(n, bool)
    spacing, u, v = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
    for first in range(0, n, _BATCH):
        part = slice(first, min(first + _BATCH, n))
        o, d = (np.stack([np.broadcast_to(p, n)[part] for p in vector]) for vector in (origin, direction))
        size = np.linalg.norm(d, axis=0)
        size = np.where(size > 0, size, 1.0)
        way = d / size
        low, high = _clipped(parameters, bounds, o, way, t_min[part] * size, t_max[part] * size)
        start = o + np.where(low < high, low, 0.0) * way
        root, inside, doubt = _first(tape, bool(parameters[0]), float(parameters[5]), start, way, high - low, low)
        hit = np.isfinite(root)
        found[part] = np.where(hit, (low + root) / size, np.inf)
        unproved[part] = doubt
        where = first + np.flatnonzero(hit)
        spacing[where], u[where], v[where] = _finished(tape, parameters, start[:, hit], way[:, hit], root[hit], inside[hit])
    return found, spacing, u, v, unproved


def _clipped(parameters: Floats, bounds: Floats, o: Floats, d: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The part of low … high in the box, and in the ball if there is one."""
    with np.errstate(all="ignore"):
        for axis in range(3):
            near, far = (bounds[0, axis] - o[axis]) / d[axis], (bounds[1, axis] - o[axis]) / d[axis]
            still, within = d[axis] == 0, (o[axis] >= bounds[0, axis]) & (o[axis] <= bounds[1, axis])
            low = np.maximum(low, np.where(still, np.where(within, -np.inf, np.inf), np.minimum(near, far)))
            high = np.minimum(high, np.where(still, np.inf, np.maximum(near, far)))
        if parameters[4] > 0:
            f = parameters[1:4, None] - o
            along = (f * d).sum(axis=0)
            rest = parameters[4] ** 2 - ((f - along * d) ** 2).sum(axis=0)
            half = np.sqrt(np.maximum(rest, 0.0))
            low, high = np.where(rest > 0, np.maximum(low, along - half), np.inf), np.minimum(high, along + half)
    return low, high


def _first(tape: Tape, sheet: bool, reach: float, o: Floats, d: Floats, length: Floats, begin: Floats) -> tuple[Floats, NDArray, NDArray]:
    """(distance of the first root or inf, whether the ray is inside before it, whether not all is proved) of rays o + t d, t ≤ length."""
    n = o.shape[1]
    root, inside, open_ = np.full(n, np.inf), np.zeros(n, bool), [(np.zeros(0, np.int64), np.zeros(0))]
    rays = np.flatnonzero(length > 0)
    step = np.arange(PIECES)
    ray = np.repeat(rays, PIECES)
    a = (length[rays][:, None] * step / PIECES).ravel()
    b = (length[rays][:, None] * (step + 1) / PIECES).ravel()
    finest = FINEST * (reach + np.abs(begin))
    while len(ray):
        keep = a < root[ray]
        ray, a, b = ray[keep], a[keep], b[keep]
        p, q, way = o[:, ray] + a * d[:, ray], o[:, ray] + b * d[:, ray], d[:, ray]
        (low, high), (least, most), maybe = numpy_interpreter.boxes(tape, np.minimum(p, q), np.maximum(p, q), way)
        with np.errstate(invalid="ignore"):
            in_a, in_b = (numpy_interpreter.points(tape, *x)[0] <= 0 for x in (p, q))
            change = in_a != in_b
            finite = np.maximum.reduce([abs(bound) for bound in (low, high, least, most)]) < LARGEST  # ∞ − ∞ has no slope
            one_way = ((least > 0) | (most < 0)) & finite & ~maybe
            away = ~(low <= 0) | ((high < 0) & ~maybe)
        none = ~change & (away | one_way)
        small = (b - a <= finest[ray]) & ~none
        jumps = sheet & ~((least > -JUMP) & (most < JUMP))
        crossed = change & (one_way | (small & ~jumps))
        left_open = np.flatnonzero(small & (sheet | ~change) & ~crossed)
        left_open = left_open[~_passes(tape, sheet, p[:, left_open], q[:, left_open], in_a[left_open])]
        open_.append((ray[left_open], a[left_open]))
        if crossed.any():
            at = _bisected(tape, o[:, ray[crossed]], d[:, ray[crossed]], a[crossed], b[crossed], in_a[crossed])
            order = np.argsort(at)[::-1]  # the first root of a ray is written last
            which = np.flatnonzero(crossed)[order]
            nearer = at[order] < root[ray[which]]
            root[ray[which[nearer]]], inside[ray[which[nearer]]] = at[order][nearer], in_a[which[nearer]]
        left = ~none & ~crossed & ~small
        middle = 0.5 * (a + b)
        ray = np.concatenate([ray[left], ray[left]])
        a, b = np.concatenate([a[left], middle[left]]), np.concatenate([middle[left], b[left]])
    doubt, (ray, at) = np.zeros(n, bool), (np.concatenate(parts) for parts in zip(*open_, strict=True))
    first, near = np.minimum(root, length), NEIGHBOURS * finest  # a root makes what is next to it undecidable: also one at a ray's ends
    doubt[ray[(at > near[ray]) & (at < first[ray] - near[ray])]] = True
    return root, inside, doubt


def _passes(tape: Tape, sheet: bool, p: Floats, q: Floats, inside: NDArray) -> NDArray[np.bool_]:
    """Whether boxes in which the formula jumps hold no root: see search._passes."""
    n, ways = p.shape[1], np.arange(8, 16)
    low, high = (np.repeat(f(p, q), len(ways), axis=1) for f in (np.minimum, np.maximum))
    (least, most), _, maybe = numpy_interpreter.boxes(tape, low, high, ways=np.tile(ways, n))
    outside, within = ~(least <= 0), most < 0
    wanted = (outside | within) if sheet else np.where(np.repeat(inside, len(ways)), within, outside)
    return (wanted & ~maybe).reshape(n, len(ways)).all(axis=1)


def _bisected(tape: Tape, o: Floats, d: Floats, a: Floats, b: Floats, in_a: NDArray) -> Floats:
    for _ in range(BISECTIONS):
        middle = 0.5 * (a + b)
        with np.errstate(invalid="ignore"):
            same = (numpy_interpreter.points(tape, *(o + middle * d))[0] <= 0) == in_a
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    return 0.5 * (a + b)


def _on_faces(
    tape: Tape, normal: Floats, start: Floats, way: Floats, at: Floats, reach: float, size: Floats, toward: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """The same normals, but of faces where the formula jumps over 0 or ends to be defined; and which these are."""
    if not np.isin(tape.code[:, 0], discontinuities.JUMPING + discontinuities.ENDING).any():
        return normal, np.zeros(len(at), bool)
    before, after = start + (at - APART * reach) * way, start + (at + APART * reach) * way
    apart = np.abs(numpy_interpreter.points(tape, *after)[0] - numpy_interpreter.points(tape, *before)[0])
    turn = numpy_discontinuities.faces(tape, before, after)
    turn = turn / np.linalg.norm(turn, axis=0)
    turn = np.where(toward * (turn * way).sum(axis=0) < 0, -turn, turn)
    here = np.isfinite(turn).all(axis=0) & ~(apart <= discontinuities.LEAST * reach * size) & ~(apart >= np.inf)
    return np.where(here, turn, normal), here


def _finished(
    tape: Tape, parameters: Floats, start: Floats, way: Floats, at: Floats, inside: NDArray
) -> tuple[NDArray[np.int64], Floats, Floats]:
    point, reach, toward = start + at * way, parameters[5], np.where(inside, 1.0, -1.0)
    _, gradient = numpy_interpreter.gradients(tape, *point)
    with np.errstate(all="ignore"):
        _, before = numpy_interpreter.gradients(tape, *(start + (at - BACK * reach) * way))
        gradient = np.where((gradient == 0.0).all(axis=0), before, gradient)
        size = np.linalg.norm(gradient, axis=0)
        usable = (size > 0) & np.isfinite(size)
        normal = np.where(usable, gradient / size, toward * way)
        normal, faced = _on_faces(tape, normal, start, way, at, reach, size, toward)
        if not parameters[0]:
            along = (normal * way).sum(axis=0)
            normal = np.where(toward * along < 0, normal - 2 * along * way, normal)
        (low, high), _, _ = numpy_interpreter.boxes(tape, point, point)
        off = np.where(faced, discontinuities.OFF * reach, np.maximum(np.abs(low), np.abs(high)) / size)
        units = np.where((usable | faced) & (off < reach), off / (2.0**-53 * reach), 0.0)
    u, v = packed((normal[0], normal[1], normal[2]))
    return np.minimum(units, 1e15).astype(np.int64), u, v
