"""Which objects carry a difference between two pictures, by what the centre of each pixel shows.

A pixel that an outline crosses shows several objects, and its whole difference is counted to the one at its centre; where the
two pictures show different objects there, to the nearer of them: it is what appeared, went or moved.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lang.diagnostics import Span
from ...render.image import metrics
from . import scene_diff
from .sides import Side


@dataclass(frozen=True, slots=True)
class Carrier:
    """All instances of one name that come from one line. Shares are 0..1 of the whole picture's.

    `error` is √relMSE over its pixels; `bias` (mean A − mean B) / mean B of their luminance, `doubt` its standard error (None where
    the noise is not known).
    """

    label: str
    place: Span | None
    count: int  # instances
    pixels: int
    share: float
    error: float
    bias: float
    doubt: float | None

    def __str__(self) -> str:
        many = f"{self.count} × " if self.count > 1 else ""
        return f"{many}{self.label}{f' {self.place}' if self.place else ''}"

    def to_json(self) -> dict[str, Any]:
        """This row as plain data."""
        return {
            "label": self.label, "place": str(self.place or ""), "instances": self.count, "pixels": self.pixels, "share": self.share,
            "error": self.error, "bias": self.bias, "bias_standard_error": self.doubt,
        }  # fmt: skip


def owners(a: Side, b: Side, same: Mapping[int, int]) -> NDArray[np.int64] | None:
    """(h, w) whose pixel it is: k ≥ 0 instance k of B, -1 nothing's, -2 - k instance k of A, which B does not have.

    `same` maps instances of A to those of B. A picture beside a scene may be of another scene: what it says of objects is not
    used. None where neither side tells.
    """
    one, other = a.ids, b.ids
    if one is not None and other is not None and (a.scene is None) != (b.scene is None):
        one, other = (None, other) if a.scene is None else (one, None)
    if one is not None:
        one = _translated(one, same)
    if one is None or other is None:
        return other if one is None else one
    nearer = a.depth < b.depth
    return np.where((one != other) & nearer, one, other)


def _translated(ids: NDArray[np.int64], same: Mapping[int, int]) -> NDArray[np.int64]:
    """Instances of A by the numbers of `owners`."""
    table = np.arange(int(ids.max(initial=-1)) + 2) - 1
    for k in range(len(table) - 1):
        table[k + 1] = same.get(k, -2 - k)
    return table[np.maximum(ids, -1) + 1]


def carriers(
    a: Side, b: Side, owner: NDArray[np.int64], squared: NDArray[np.float64], variance: NDArray[np.float64] | None
) -> list[Carrier]:
    """Every object that has pixels, the one with most of the error first.

    `owner` is from `owners`; `squared` (h, w, 3) from metrics.squared_relative; `variance` (h, w) of the difference's luminance.
    """
    keys, group = np.unique(owner.ravel(), return_inverse=True)
    names = [_named(a, b, int(key)) for key in keys]
    distinct = list(dict.fromkeys(names))
    places = {name: i for i, name in enumerate(distinct)}
    instances = np.array([places[name] for name in names])  # of each key
    rows, of = instances[group], np.bincount(instances)

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(rows, values.ravel(), len(distinct)).astype(np.float64)

    weight = weights(squared.mean(axis=2))
    pixels = np.bincount(rows)
    shares, errors = total(weight), np.sqrt(total(squared.mean(axis=2)) / pixels)
    with np.errstate(invalid="ignore"):
        ours, theirs = total(metrics.luminance(a.rgb)), total(metrics.luminance(b.rgb))
    doubt = None if variance is None else np.sqrt(total(variance))
    found = [
        Carrier(
            *distinct[i], int(of[i]), int(pixels[i]), float(shares[i]), float(errors[i]), relative(ours[i] - theirs[i], theirs[i]),
            None if doubt is None else relative(doubt[i], theirs[i]),
        )
        for i in range(len(distinct))
    ]  # fmt: skip
    return sorted(found, key=lambda c: -c.share)


def weights(squared: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shares of the whole; pixels of infinite error have all of it."""
    endless = np.isinf(squared)
    weight = endless.astype(np.float64) if endless.any() else squared
    total = weight.sum()
    return weight / total if total > 0 else weight


def relative(value: float, whole: float) -> float:
    """value / whole, 0 of nothing being 0 and anything else of nothing endless."""
    if not math.isfinite(value):
        return math.inf
    return float(value / whole) if whole else 0.0 if value == 0 else float(np.copysign(np.inf, value))


def _named(a: Side, b: Side, owner: int) -> tuple[str, Span | None]:
    if owner == -1:
        return "background", None
    side, row = (b, owner) if owner >= 0 else (a, -2 - owner)
    scene = side.scene if side.scene is not None else (a if side is b else b).scene
    if scene is None or row >= len(scene.tables.instances.geometry):
        return f"instance {row}", None
    return scene_diff.label(scene, "instances", row), scene.spans.at("instances", row)


def outlines(side: Side) -> NDArray[np.bool_] | None:
    """(h, w) pixels whose filter an outline may cross: another object's pixel within its reach, or half covered.

    An outline between two pixel centres is no further from either than the filter reaches. None where objects are not known.
    """
    ids = side.ids
    if ids is None:
        return None
    low, high = ids, ids
    for axis in (0, 1):
        low, high = _spread(low, axis, side.reach, np.minimum), _spread(high, axis, side.reach, np.maximum)
    mixed = low != high
    return mixed if side.coverage is None else mixed | ((side.coverage > 0) & (side.coverage < 1))


def _spread(values: NDArray[np.int64], axis: int, reach: int, fold: np.ufunc) -> NDArray[np.int64]:
    """Least or largest value within `reach` along an axis."""
    width = [(0, 0), (0, 0)]
    width[axis] = (reach, reach)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, width, mode="edge"), 2 * reach + 1, axis)
    return fold.reduce(windows, axis=-1)


def name_of(a: Side, b: Side, owner: int) -> str:
    """Who `owners` says has a pixel, with its place."""
    label, place = _named(a, b, owner)
    return f"{label} {place}" if place else label
