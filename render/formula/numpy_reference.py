"""Reference intersection of rays with implicit surfaces in numpy: bisection of segments until each holds one root or none.

It is slow: it bisects every segment that bounds do not decide, down to FINEST, and takes the first root.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler.formula import numpy_interpreter
from ...compiler.formula.opcodes import Op
from ...compiler.formula.point_semantics import NumpyMath
from ...compiler.formula.point_semantics import slopes as point_slopes
from ...compiler.formula.tape import Tape
from ..types import Vec
from . import discontinuities
from .bracketing import LARGEST
from .hit_geometry import BACK, encode_normal
from .root_isolation import FINEST, JUMP, NEIGHBOURS

PIECES = 16  # initial segments of a ray
BISECTIONS = 80
APART = 2.0**-48  # of the largest coordinate: distance before and behind a root at which its jump is evaluated
_BATCH = 1 << 15
Floats = NDArray[np.float64]


def first_hit(
    tape: Tape, parameters: Floats, bounds: Floats, origin: Vec, direction: Vec, t_min: Floats, t_max: Floats
) -> tuple[Floats, NDArray[np.int64], Floats, Floats, NDArray[np.bool_]]:
    """(t, spacing, u, v, unproved), each (n,), of the first hit of n rays with a surface, as intersect.first_hit returns it."""
    n = len(t_min)
    t, unproved = np.full(n, np.inf), np.zeros(n, bool)
    spacing, u, v = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
    for first in range(0, n, _BATCH):
        part = slice(first, min(first + _BATCH, n))
        o, d = (np.stack([np.broadcast_to(p, n)[part] for p in vector]) for vector in (origin, direction))
        size = np.linalg.norm(d, axis=0)
        size = np.where(size > 0, size, 1.0)
        unit = d / size
        low, high = _clip_to_bounds(parameters, bounds, o, unit, t_min[part] * size, t_max[part] * size)
        start = o + np.where(low < high, low, 0.0) * unit
        root, inside, doubt = _first_root(tape, bool(parameters[0]), float(parameters[5]), start, unit, high - low, low)
        hit = np.isfinite(root)
        t[part] = np.where(hit, (low + root) / size, np.inf)
        unproved[part] = doubt
        where = first + np.flatnonzero(hit)
        spacing[where], u[where], v[where] = _complete_hits(tape, parameters, start[:, hit], unit[:, hit], root[hit], inside[hit])
    return t, spacing, u, v, unproved


def _clip_to_bounds(parameters: Floats, bounds: Floats, o: Floats, d: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Clip low … high to the box, and to the ball if there is one."""
    with np.errstate(all="ignore"):
        for axis in range(3):
            near, far = (bounds[0, axis] - o[axis]) / d[axis], (bounds[1, axis] - o[axis]) / d[axis]
            parallel, within = d[axis] == 0, (o[axis] >= bounds[0, axis]) & (o[axis] <= bounds[1, axis])
            low = np.maximum(low, np.where(parallel, np.where(within, -np.inf, np.inf), np.minimum(near, far)))
            high = np.minimum(high, np.where(parallel, np.inf, np.maximum(near, far)))
        if parameters[4] > 0:
            f = parameters[1:4, None] - o
            along = (f * d).sum(axis=0)
            discriminant = parameters[4] ** 2 - ((f - along * d) ** 2).sum(axis=0)
            half = np.sqrt(np.maximum(discriminant, 0.0))
            low, high = np.where(discriminant > 0, np.maximum(low, along - half), np.inf), np.minimum(high, along + half)
    return low, high


def _first_root(
    tape: Tape, sheet: bool, reach: float, o: Floats, d: Floats, length: Floats, begin: Floats
) -> tuple[Floats, NDArray, NDArray]:
    """(distance of the first root or inf, whether the ray is inside before it, whether it is unproved) of rays o + t d, t ≤ length."""
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
        p, q, direction = o[:, ray] + a * d[:, ray], o[:, ray] + b * d[:, ray], d[:, ray]
        (low, high), (least, most), maybe = numpy_interpreter.boxes(tape, np.minimum(p, q), np.maximum(p, q), direction)
        with np.errstate(invalid="ignore"):
            in_a, in_b = (numpy_interpreter.points(tape, *x)[0] <= 0 for x in (p, q))
            change = in_a != in_b
            finite = np.maximum.reduce([abs(bound) for bound in (low, high, least, most)]) < LARGEST  # ∞ − ∞ has no slope
            monotonic = ((least > 0) | (most < 0)) & finite & ~maybe
            away = ~(low <= 0) | ((high < 0) & ~maybe)
        none = ~change & (away | monotonic)
        small = (b - a <= finest[ray]) & ~none
        jumps = sheet & ~((least > -JUMP) & (most < JUMP))
        crossed = change & (monotonic | (small & ~jumps))
        left_open = np.flatnonzero(small & (sheet | ~change) & ~crossed)
        left_open = left_open[~_branches_exclude_root(tape, sheet, p[:, left_open], q[:, left_open], in_a[left_open])]
        open_.append((ray[left_open], a[left_open]))
        if crossed.any():
            distance = _bisect(tape, o[:, ray[crossed]], d[:, ray[crossed]], a[crossed], b[crossed], in_a[crossed])
            order = np.argsort(distance)[::-1]  # of several roots of a ray, the first is written last
            which = np.flatnonzero(crossed)[order]
            nearer = distance[order] < root[ray[which]]
            root[ray[which[nearer]]], inside[ray[which[nearer]]] = distance[order][nearer], in_a[which[nearer]]
        undecided = ~none & ~crossed & ~small
        middle = 0.5 * (a + b)
        ray = np.concatenate([ray[undecided], ray[undecided]])
        a, b = np.concatenate([a[undecided], middle[undecided]]), np.concatenate([middle[undecided], b[undecided]])
    doubt, (ray, distance) = np.zeros(n, bool), (np.concatenate(parts) for parts in zip(*open_, strict=True))
    first, near = np.minimum(root, length), NEIGHBOURS * finest  # near a root bounds stay undecided, also at a ray's ends
    doubt[ray[(distance > near[ray]) & (distance < first[ray] - near[ray])]] = True
    return root, inside, doubt


def _branches_exclude_root(tape: Tape, sheet: bool, p: Floats, q: Floats, inside: NDArray) -> NDArray[np.bool_]:
    """Whether boxes in which the formula jumps hold no root: see root_isolation."""
    n, branches = p.shape[1], np.arange(8, 16)
    low, high = (np.repeat(f(p, q), len(branches), axis=1) for f in (np.minimum, np.maximum))
    (least, most), _, maybe = numpy_interpreter.boxes(tape, low, high, ways=np.tile(branches, n))
    outside, within = ~(least <= 0), most < 0
    excluded = (outside | within) if sheet else np.where(np.repeat(inside, len(branches)), within, outside)
    return (excluded & ~maybe).reshape(n, len(branches)).all(axis=1)


def _bisect(tape: Tape, o: Floats, d: Floats, a: Floats, b: Floats, in_a: NDArray) -> Floats:
    for _ in range(BISECTIONS):
        middle = 0.5 * (a + b)
        with np.errstate(invalid="ignore"):
            same = (numpy_interpreter.points(tape, *(o + middle * d))[0] <= 0) == in_a
        a, b = np.where(same, middle, a), np.where(same, b, middle)
    return 0.5 * (a + b)


def _face_normals(
    tape: Tape, normal: Floats, start: Floats, direction: Floats, root: Floats, reach: float, size: Floats, toward: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """(normals, replaced by those of faces where the formula jumps over 0 or ends to be defined; which are replaced)."""
    if not np.isin(tape.code[:, 0], discontinuities.JUMPING + discontinuities.ENDING).any():
        return normal, np.zeros(len(root), bool)
    before, after = start + (root - APART * reach) * direction, start + (root + APART * reach) * direction
    apart = np.abs(numpy_interpreter.points(tape, *after)[0] - numpy_interpreter.points(tape, *before)[0])
    face = _face_gradients(tape, before, after)
    face = face / np.linalg.norm(face, axis=0)
    face = np.where(toward * (face * direction).sum(axis=0) < 0, -face, face)
    on_face = np.isfinite(face).all(axis=0) & ~(apart <= discontinuities.LEAST * reach * size) & ~(apart >= np.inf)
    return np.where(on_face, face, normal), on_face


def _complete_hits(
    tape: Tape, parameters: Floats, start: Floats, direction: Floats, root: Floats, inside: NDArray
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """(spacing, u, v) of roots."""
    point, reach, toward = start + root * direction, parameters[5], np.where(inside, 1.0, -1.0)
    _, gradient = numpy_interpreter.gradients(tape, *point)
    with np.errstate(all="ignore"):
        _, before = numpy_interpreter.gradients(tape, *(start + (root - BACK * reach) * direction))
        gradient = np.where((gradient == 0.0).all(axis=0), before, gradient)
        size = np.linalg.norm(gradient, axis=0)
        usable = (size > 0) & np.isfinite(size)
        normal = np.where(usable, gradient / size, toward * direction)
        normal, on_face = _face_normals(tape, normal, start, direction, root, reach, size, toward)
        if not parameters[0]:
            along = (normal * direction).sum(axis=0)
            normal = np.where(toward * along < 0, normal - 2 * along * direction, normal)
        (low, high), _, _ = numpy_interpreter.boxes(tape, point, point)
        off = np.where(on_face, discontinuities.OFF * reach, np.maximum(np.abs(low), np.abs(high)) / size)
        units = np.where((usable | on_face) & (off < reach), off / (2.0**-53 * reach), 0.0)
    u, v = encode_normal((normal[0], normal[1], normal[2]))
    return np.minimum(units, 1e15).astype(np.int64), u, v


# --- discontinuities ----------------------------------------------------------------------------------------------------


def _face_gradients(tape: Tape, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(3, n) gradients of the operand that makes a tape jump or end between neighbouring points (3, n); NaN where none does.

    The operand is that of a floor, a sign, a choice, an angle's cut, or a root or logarithm at the edge of its domain. The face is a level
    set of the operand.
    """
    shape = np.shape(before[0])
    gradient = np.full((3, *shape), np.nan)

    def look(op: int, operands: list[Any], slopes: list[list[Any]]) -> None:
        step = _branch(op, operands)
        if step is not None:
            operand_slopes = (
                point_slopes(NumpyMath(), Op.DIVIDE, operands, operands[0] / operands[1], slopes) if op == Op.MOD else slopes[0]
            )
            fresh = (step[0] != step[1]) & np.isnan(gradient[0])
            np.copyto(gradient, np.stack([np.broadcast_to(slope, (2, *shape))[1] for slope in operand_slopes]), where=fresh)

    numpy_interpreter.gradients(tape, *np.stack([before, after], axis=1), look=look)
    return gradient


def _branch(op: int, operands: list[Any]) -> Any:
    """The step of a jumping operation, or whether the operand is in the domain of an ending one; None for other operations."""
    match op:
        case Op.FLOOR | Op.CEIL:
            return np.floor(operands[0]) if op == Op.FLOOR else np.ceil(operands[0])
        case Op.MOD:
            return np.floor(operands[0] / operands[1])
        case Op.SIGN:
            return np.sign(operands[0])
        case Op.CHOOSE:
            return operands[0] <= 0.0
        case Op.ATAN2:
            return np.signbit(operands[0]) & (operands[1] < 0.0)
        case Op.SQRT | Op.POWER:
            return operands[0] < 0.0
        case Op.LOG:
            return operands[0] <= 0.0
        case Op.ASIN | Op.ACOS:
            return np.abs(operands[0]) > 1.0
    return None
