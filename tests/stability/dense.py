"""Where rays meet a relation, looked at in thousands of points of each ray in plain numpy: nothing is proved, and nothing shared."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from maquette.compiler.formula.point_semantics import NumpyMath
from maquette.compiler.formula.point_semantics import noise as gradient_noise

BISECTIONS = 60


def _folded(f: Callable[..., Any]) -> Callable[..., Any]:
    def of(*numbers: Any) -> Any:
        found = numbers[0]
        for number in numbers[1:]:
            found = f(found, number)
        return found

    return of


def _noise(*point: Any) -> Any:
    return gradient_noise(NumpyMath(), *np.broadcast_arrays(*(np.asarray(p, float) for p in point)))[0]


NAMES = {
    "abs": np.abs, "sqrt": np.sqrt, "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin,
    "acos": np.arccos, "atan2": lambda y, x: np.arctan2(y + 0.0, x + 0.0),  # −0 is 0
    "floor": np.floor, "ceil": np.ceil, "sign": np.sign, "noise": _noise, "pi": np.pi,
    "hypot": lambda *numbers: np.sqrt(sum(x * x for x in numbers)), "min": _folded(np.fmin), "max": _folded(np.maximum),
    "mod": lambda a, b: a - b * np.floor(a / b), "round": lambda a: np.floor(a + 0.5),
}  # fmt: skip


class Relation:
    """A relation of the language as numpy has it: an inequality of x, y and z, joined with `and`, or an equality."""

    def __init__(self, text: str, low: np.ndarray, high: np.ndarray) -> None:
        body = text.replace("^", "**")
        self.sheet, self.low, self.high = "==" in body, low, high
        if self.sheet:
            body = "({})-({})".format(*body.split("=="))
        else:
            body = "&".join(f"({part})" for part in re.split(r"\band\b", body))
        self._of = eval(f"lambda x, y, z: {body}", dict(NAMES))

    def __call__(self, p: np.ndarray) -> np.ndarray:
        """Of a solid whether points (…, 3) are in it and in the box; of a sheet the two sides' difference."""
        with np.errstate(all="ignore"):
            found = np.broadcast_to(self._of(p[..., 0], p[..., 1], p[..., 2]), p.shape[:-1])
            return found if self.sheet else found & ((p >= self.low) & (p <= self.high)).all(axis=-1)

    def first(self, o: np.ndarray, d: np.ndarray, points: int) -> np.ndarray:
        """(n,) distance of the first change that `points` places of each ray in the box show; inf where they show none."""
        near, far = self._clipped(o, d)
        found, share = np.full(len(o), np.inf), np.linspace(0.0, 1.0, points)
        for begin in range(0, len(o), max(1, 1_000_000 // points)):
            part = slice(begin, begin + max(1, 1_000_000 // points))
            t = near[part, None] + (far - near)[part, None] * share
            value = self(o[part, None] + t[..., None] * d[part, None])
            changes = (value[:, 1:] <= 0) != (value[:, :-1] <= 0) if self.sheet else value[:, 1:] != value[:, :-1]
            changes &= (far > near)[part, None]
            row, column = np.nonzero(changes)
            at, root = self._narrowed(o[part][row], d[part][row], t[row, column], t[row, column + 1])
            np.minimum.at(found, begin + row[root], at[root])
        return found

    def _clipped(self, o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(all="ignore"):
            one, other = (self.low - o) / d, (self.high - o) / d
        near, far = np.nanmax(np.minimum(one, other), axis=1), np.nanmin(np.maximum(one, other), axis=1)
        slack = 0.0 if self.sheet else 1e-4 * (self.high - self.low).max()  # a solid ends at its box
        return np.maximum(near - slack, 0.0), far + slack

    def _narrowed(self, o: np.ndarray, d: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(where the change is, whether it is a root: of a sheet not where the formula jumps)."""
        first, begun = self(o + a[:, None] * d), self(o + a[:, None] * d)
        last = self(o + b[:, None] * d)
        for _ in range(BISECTIONS):
            middle = 0.5 * (a + b)
            value = self(o + middle[:, None] * d)
            same = (value <= 0) == (begun <= 0) if self.sheet else value == begun
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        if not self.sheet:
            return 0.5 * (a + b), np.ones(len(a), bool)
        left = np.maximum(abs(self(o + a[:, None] * d)), abs(self(o + b[:, None] * d)))
        return 0.5 * (a + b), left <= 1e-3 * (1.0 + abs(first) + abs(last))

    def changes(self, o: np.ndarray, d: np.ndarray, t: np.ndarray, reach: float) -> np.ndarray:
        """(n,) whether the relation changes within `reach` of t: there is a surface, though it may be too thin for `first`."""
        found = np.zeros(len(t), bool)
        for size in reach * np.array([1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0]):
            value = self(o[:, None] + (t[:, None] + np.linspace(-size, size, 81))[..., None] * d[:, None])
            found |= np.nanmin(value, axis=1) * np.nanmax(value, axis=1) <= 0 if self.sheet else value.any(axis=1) & ~value.all(axis=1)
        return found
