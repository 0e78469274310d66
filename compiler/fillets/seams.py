"""Where surfaces of the parts of a union meet: the seams that fillets fill.

Points are projected onto both surfaces by Newton's method. A point is on a seam of the union where each surface leaves the other part as a
face of its own part: a step along it from the seam, away from the other part, stays on its part's surface. At the edge of a face that is
flush with another one, where surfaces touch, and where a gap separates them, there is no such point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import combinations

import numpy as np

from ..formula import numpy_interpreter
from ..formula.builder import Builder
from ..formula.tape import Tape

BOXES = 6  # along each axis of the common bounds of two parts
POINTS = 128  # from which seams are sought, for each two surfaces
STEPS = 12  # of Newton's method
STEP = 1e-3  # of the radius: length of the step along a face
OFF = 0.1  # of a step: largest distance from the surface after it
ON = 1e-6  # of a step: largest distance of a point of a seam from the surfaces
TANGENT = 5e-5  # 1 − |cosine| of surfaces that touch: half a degree
EVEN = 1e-9  # largest difference of equal cosines
FAR = 1e3  # radii: half-extent of what is endless
SEED = 20260


Combine = Callable[[np.ndarray], np.ndarray]


class Seams:
    """The seams of leaves of parts.

    `names` and `part` of the leaves; of the parts their `bounds`, and functions that combine the values of all leaves (leaves, points).
    """

    def __init__(
        self, b: Builder, names: Sequence[int], part: Sequence[int], combine: Sequence[Combine], bounds: Sequence[np.ndarray], radius: float
    ) -> None:
        self._surfaces = [_Surface(b.finish(name), radius) for name in names]
        self._leaves, self._combine = b.finish(*names), combine
        self._part, self._step = np.array(part), STEP * radius
        self._bounds, self._far = bounds, FAR * radius
        self._points: dict[tuple[int, int], np.ndarray] = {}
        self._live: dict[tuple[int, int], bool] = {}
        self._cosines: dict[tuple[int, int], float | None] = {}
        self._joined = {pair for pair in combinations(range(len(combine)), 2) if self._find(*pair)}

    def any(self, first: int, second: int) -> bool:
        """Whether two parts have a seam."""
        return (min(first, second), max(first, second)) in self._joined

    def live(self, first: int, second: int) -> bool:
        """Whether two leaves have a seam."""
        return self._live.get((min(first, second), max(first, second)), False)

    def cosine(self, first: int, second: int) -> float | None:
        """The cosine of the angle between the gradients of two leaves with a seam if it is the same everywhere."""
        return self._cosines[min(first, second), max(first, second)]

    def unit(self, leaf: int) -> bool:
        """Whether the gradient of a leaf has length 1 everywhere."""
        return self._surfaces[leaf].is_unit

    def corner(self, leaves: Sequence[int]) -> bool:
        """Whether three leaves meet in a point of the surfaces of their parts."""
        parts = [int(self._part[leaf]) for leaf in leaves]
        common = self._common(parts)
        if common is None:
            return False
        start, surfaces = _points(*common), [self._surfaces[leaf] for leaf in leaves]
        positions, gradients = _project(surfaces, start, self._step)
        on = _on(surfaces, positions, gradients, self._step)
        values = self._values(positions)
        for part in parts:
            on &= abs(self._combine[part](values)) <= OFF * self._step
        return bool(on.any())

    # --- search ---

    def _values(self, positions: np.ndarray) -> np.ndarray:
        """The values of all leaves (leaves, n) at points (3, n)."""
        return np.stack(numpy_interpreter.points(self._leaves, *positions))

    def _common(self, parts: Sequence[int]) -> tuple[np.ndarray, np.ndarray] | None:
        """(lowest corners (3, n), size (3, 1)) of boxes that hold all common points of the surfaces of parts; None if there are none."""
        low = np.max([self._bounds[part][0] for part in parts], axis=0) - self._step
        high = np.min([self._bounds[part][1] for part in parts], axis=0) + self._step
        if not (high > low).all():
            return None
        low, high = np.where(np.isfinite(low), low, -self._far), np.where(np.isfinite(high), high, self._far)
        size = ((high - low) / BOXES)[:, None]
        corners = low[:, None] + size * np.indices((BOXES,) * 3).reshape(3, -1)
        return corners, size

    def _find(self, first: int, second: int) -> bool:
        """Find the seams of two parts."""
        common = self._common((first, second))
        if common is None:
            return False
        corners, size = common
        mine, others = (
            {k: _may_be_zero(self._surfaces[k].tape, corners, size, self._step) for k in np.flatnonzero(self._part == part).tolist()}
            for part in (first, second)
        )
        rest = [k for k in range(len(self._combine)) if k not in (first, second)]
        for p, near in mine.items():
            for q, close in others.items():
                both = near & close
                start = _points(corners[:, both], size) if both.any() else None
                self._live[p, q] = start is not None and self._has_seam((p, q), start, rest)
                if self._live[p, q] and start is not None:
                    self._cosines[p, q] = self._even_cosine(p, q, start)
        return any(self._live[p, q] for p in mine for q in others)

    def _has_seam(self, leaves: tuple[int, int], start: np.ndarray, rest: Sequence[int]) -> bool:
        surfaces, step = [self._surfaces[leaf] for leaf in leaves], self._step
        if all(surface.normal is not None for surface in surfaces):
            cosine = float(np.dot(*(surface.normal for surface in surfaces)))  # pyright: ignore[reportArgumentType, reportCallIssue]
            if not abs(cosine) < 1 - TANGENT:
                return False
        positions, gradients = _project(surfaces, start, step)
        with np.errstate(all="ignore"):
            n, m = (g / np.linalg.norm(g, axis=0) for g in gradients)
            cosine = (n * m).sum(axis=0)
            sine = np.sqrt(1 - cosine * cosine)
            on = _on(surfaces, positions, gradients, step) & (abs(cosine) < 1 - TANGENT)
            ways = (m - cosine * n) / sine, (n - cosine * m) / sine
        positions, ways, gradients = positions[:, on], [way[:, on] for way in ways], [g[:, on] for g in gradients]
        values, on_seam = self._values(positions), np.ones(positions.shape[1], bool)
        for leaf, way, gradient in zip(leaves, ways, gradients, strict=True):
            combine, size = self._combine[self._part[leaf]], step * np.linalg.norm(gradient, axis=0)
            beside = self._values(positions + step * way)
            on_seam &= (abs(combine(values)) <= OFF * size) & (abs(combine(beside)) <= OFF * size)
            changed = [beside + sign * size * (np.arange(len(beside)) == leaf)[:, None] for sign in (1.0, -1.0)]
            on_seam &= np.logical_or.reduce([abs(combine(other) - combine(beside)) > 0.5 * size for other in changed])
        for part in rest:
            on_seam &= ~(self._combine[part](values) < -OFF * step)
        return bool(on_seam.any())

    def _even_cosine(self, first: int, second: int, start: np.ndarray) -> float | None:
        """The cosine of two gradients if it is the same at all points."""
        reach = np.ptp(start, axis=1, keepdims=True)
        positions = np.concatenate([start, start + reach * np.random.default_rng(SEED).uniform(-1, 1, start.shape)], axis=1)
        gradients = [self._surfaces[leaf].gradient(positions)[1] for leaf in (first, second)]
        with np.errstate(all="ignore"):
            lengths = [np.linalg.norm(gradient, axis=0) for gradient in gradients]
            cosines = (gradients[0] * gradients[1]).sum(axis=0) / (lengths[0] * lengths[1])
        cosines = cosines[np.isfinite(cosines)]
        if not len(cosines) or np.ptp(cosines) > EVEN:
            return None
        middle = float(np.median(cosines))
        return 0.0 if abs(middle) < EVEN else middle


def _may_be_zero(tape: Tape, corners: np.ndarray, size: np.ndarray, slack: float) -> np.ndarray:
    """Whether a field may be 0 in boxes."""
    (low, high), _, maybe = numpy_interpreter.boxes(tape, corners - slack, corners + size + slack)
    return ~((low > 0) | (high < 0)) | maybe


def _points(corners: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Points (3, POINTS) in boxes, as many in each."""
    return np.take(corners, np.arange(POINTS) % corners.shape[1], axis=1) + size * np.random.default_rng(SEED).random((3, POINTS))


class _Surface:
    """The field of a leaf at points."""

    def __init__(self, tape: Tape, size: float) -> None:
        self.tape, self.size = tape, size

    def gradient(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(values (n,), gradients (3, n)) at points (3, n)."""
        return numpy_interpreter.gradients(self.tape, *positions)

    @cached_property
    def _sampled(self) -> np.ndarray:
        spread = np.random.default_rng(SEED).normal(size=(3, POINTS)) * np.geomspace(1, 100, POINTS) * self.size
        return self.gradient(spread)[1]

    @cached_property
    def normal(self) -> np.ndarray | None:
        """The gradient, if it is the same everywhere, with length 1."""
        if np.ptp(self._sampled, axis=1).max() > 1e-12 * abs(self._sampled).max():
            return None
        length = float(np.linalg.norm(self._sampled[:, 0]))
        return self._sampled[:, 0] / length if length else None

    @cached_property
    def is_unit(self) -> bool:
        length = np.linalg.norm(self._sampled, axis=0)
        length = length[np.isfinite(length)]
        return len(length) > 0 and bool(abs(length - 1).max() < EVEN)


def _project(surfaces: Sequence[_Surface], positions: np.ndarray, step: float) -> tuple[np.ndarray, list[np.ndarray]]:
    """(points (3, n) moved onto two or three surfaces by Newton's method, with the least change; the gradients there)."""
    reach = math.sqrt(3) * float(np.ptp(positions, axis=1).max()) + step
    flat = all(surface.normal is not None for surface in surfaces)
    with np.errstate(all="ignore"):
        for _ in range(1 if flat else STEPS):
            fields = [surface.gradient(positions) for surface in surfaces]
            slopes = np.stack([gradient for _, gradient in fields], axis=1).transpose(2, 1, 0)  # (n, surfaces, 3)
            values = np.stack([value for value, _ in fields], axis=1)
            gram = slopes @ slopes.transpose(0, 2, 1)
            size = np.trace(gram, axis1=1, axis2=2)
            good = np.isfinite(gram).all(axis=(1, 2)) & np.isfinite(values).all(axis=1) & (size > 0)
            least = 1e-14 * np.where(good, size, 1.0)[:, None, None] * np.eye(len(surfaces))
            gram = np.where(good[:, None, None], gram, np.eye(len(surfaces))) + least
            move = (slopes * np.linalg.solve(gram, np.where(good[:, None], values, 0.0)[:, :, None])).sum(axis=1).T
            move = np.where(good, move, 0.0)
            length = np.linalg.norm(move, axis=0)
            positions = positions - move * np.minimum(1.0, reach / np.maximum(length, 1e-300))
            if np.quantile(length, 0.75) < 1e-3 * ON * step:
                break
    return positions, [surface.gradient(positions)[1] for surface in surfaces]


def _on(surfaces: Sequence[_Surface], positions: np.ndarray, gradients: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Whether points lie on all surfaces."""
    on = np.ones(positions.shape[1], bool)
    for surface, gradient in zip(surfaces, gradients, strict=True):
        on &= abs(numpy_interpreter.points(surface.tape, *positions)[0]) <= ON * step * np.linalg.norm(gradient, axis=0)
    return on
