"""Attributes the difference of two pictures to objects, by the object at each pixel centre.

The difference of a pixel that shows several objects counts for the one at its centre. Where the two pictures differ in that object, it
counts for the nearer one: the object that appeared, vanished or moved.
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
class ObjectError:
    """The error of all instances with one name and one source line. `share` is the share of the whole squared error (0..1).

    `error` is √relMSE over its pixels; `bias` is (mean A − mean B) / mean B of their luminance, with its standard error (None if the noise
    is unknown).
    """

    label: str
    place: Span | None
    count: int  # instances
    pixels: int
    share: float
    error: float
    bias: float
    standard_error: float | None

    def __str__(self) -> str:
        many = f"{self.count} × " if self.count > 1 else ""
        return f"{many}{self.label}{f' {self.place}' if self.place else ''}"

    def to_json(self) -> dict[str, Any]:
        """This row as plain data."""
        return {
            "label": self.label, "place": str(self.place or ""), "instances": self.count, "pixels": self.pixels, "share": self.share,
            "error": self.error, "bias": self.bias, "bias_standard_error": self.standard_error,
        }  # fmt: skip


def pixel_owners(a: Side, b: Side, same: Mapping[int, int]) -> NDArray[np.int64] | None:
    """(h, w) owner of each pixel: k ≥ 0 instance k of B, -1 none, -2 - k instance k of A that B does not have.

    `same` maps instances of A to those of B. The ids of a picture compared with a scene are ignored, as it may show another scene. None
    without ids.
    """
    first, second = a.ids, b.ids
    if first is not None and second is not None and (a.scene is None) != (b.scene is None):
        first, second = (None, second) if a.scene is None else (first, None)
    if first is not None:
        first = _to_owner_numbers(first, same)
    if first is None or second is None:
        return second if first is None else first
    nearer = a.depth < b.depth
    return np.where((first != second) & nearer, first, second)


def _to_owner_numbers(ids: NDArray[np.int64], same: Mapping[int, int]) -> NDArray[np.int64]:
    """Instances of A as owner numbers."""
    table = np.arange(int(ids.max(initial=-1)) + 2) - 1
    for k in range(len(table) - 1):
        table[k + 1] = same.get(k, -2 - k)
    return table[np.maximum(ids, -1) + 1]


def measure(
    a: Side, b: Side, owner: NDArray[np.int64], squared: NDArray[np.float64], variance: NDArray[np.float64] | None
) -> list[ObjectError]:
    """All visible objects, those with the largest share first.

    `owner` is from `pixel_owners`; `squared` (h, w, 3) from metrics.squared_relative; `variance` (h, w) of the difference's luminance.
    """
    keys, group = np.unique(owner.ravel(), return_inverse=True)
    names = [_identify(a, b, int(key)) for key in keys]
    distinct = list(dict.fromkeys(names))
    places = {name: i for i, name in enumerate(distinct)}
    instances = np.array([places[name] for name in names])  # of each key
    rows, counts = instances[group], np.bincount(instances)

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(rows, values.ravel(), len(distinct)).astype(np.float64)

    weight = error_shares(squared.mean(axis=2))
    pixels = np.bincount(rows)
    shares, errors = total(weight), np.sqrt(total(squared.mean(axis=2)) / pixels)
    with np.errstate(invalid="ignore"):
        ours, theirs = total(metrics.luminance(a.rgb)), total(metrics.luminance(b.rgb))
    standard_error = None if variance is None else np.sqrt(total(variance))
    objects = [
        ObjectError(
            *distinct[i], int(counts[i]), int(pixels[i]), float(shares[i]), float(errors[i]), ratio(ours[i] - theirs[i], theirs[i]),
            None if standard_error is None else ratio(standard_error[i], theirs[i]),
        )
        for i in range(len(distinct))
    ]  # fmt: skip
    return sorted(objects, key=lambda c: -c.share)


def error_shares(squared: NDArray[np.float64]) -> NDArray[np.float64]:
    """The share of each pixel in the sum; pixels with infinite error share all of it."""
    infinite = np.isinf(squared)
    weight = infinite.astype(np.float64) if infinite.any() else squared
    total = weight.sum()
    return weight / total if total > 0 else weight


def ratio(value: float, total: float) -> float:
    """value / whole; 0 / 0 is 0, other divisions by 0 are ±inf."""
    if not math.isfinite(value):
        return math.inf
    return float(value / total) if total else 0.0 if value == 0 else float(np.copysign(np.inf, value))


def _identify(a: Side, b: Side, owner: int) -> tuple[str, Span | None]:
    if owner == -1:
        return "background", None
    side, row = (b, owner) if owner >= 0 else (a, -2 - owner)
    scene = side.scene if side.scene is not None else (a if side is b else b).scene
    if scene is None or row >= len(scene.tables.instances.geometry):
        return f"instance {row}", None
    return scene_diff.label(scene, "instances", row), scene.spans.get("instances", row)


def outline_mask(side: Side) -> NDArray[np.bool_] | None:
    """(h, w) mask of pixels whose filter an outline may cross: another object within its reach, or partial coverage.

    None without ids.
    """
    ids = side.ids
    if ids is None:
        return None
    low, high = ids, ids
    for axis in (0, 1):
        low, high = _windowed(low, axis, side.reach, np.minimum), _windowed(high, axis, side.reach, np.maximum)
    mixed = low != high
    return mixed if side.coverage is None else mixed | ((side.coverage > 0) & (side.coverage < 1))


def _windowed(values: NDArray[np.int64], axis: int, reach: int, fold: np.ufunc) -> NDArray[np.int64]:
    """The least or largest value within `reach` along an axis."""
    width = [(0, 0), (0, 0)]
    width[axis] = (reach, reach)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, width, mode="edge"), 2 * reach + 1, axis)
    return fold.reduce(windows, axis=-1)


def owner_name(a: Side, b: Side, owner: int) -> str:
    """The name of an owner, with its source position."""
    label, place = _identify(a, b, owner)
    return f"{label} {place}" if place else label
