"""Measures the difference of two pictures or renders: metrics, outlines, objects, bias and noise.

The second side is the reference. All figures are of linear light, except FLIP, which uses the displayed pictures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler.scene import serialize
from ...render.image import metrics
from .. import errors
from ..metric_table import compared
from . import object_errors, scene_diff
from .sides import Side, match_encoding, recorded_exposure, zero_shared_nonfinite

NOISE_RATIO = 1.2  # largest ratio of a difference to the noise estimate that is noise; independent noise gives 0.7 to 1.1
SIGNIFICANCE = 4.0  # standard errors above which a mean difference is significant


@dataclass(frozen=True, slots=True)
class Region:
    """A part of the picture: `share` of the squared error (0..1), √relMSE (`error`) and largest |A − B| (`maximum`) of its pixels."""

    pixels: int
    share: float
    error: float
    maximum: float

    def to_json(self) -> dict[str, Any]:
        """This region as plain data."""
        return {"pixels": self.pixels, "share": self.share, "error": self.error, "maximum": self.maximum}


@dataclass(frozen=True, slots=True)
class Bias:
    """(mean A − mean B) / mean B of red, green and blue, with standard errors (None if the noise is unknown)."""

    channels: tuple[float, float, float]
    standard_error: tuple[float, float, float] | None

    @property
    def largest(self) -> float:
        """The largest absolute value of the three."""
        return max(abs(c) for c in self.channels)

    @property
    def significance(self) -> float | None:
        """The largest of the three in standard errors; None if the noise is unknown."""
        if self.standard_error is None:
            return None
        return max(abs(c) / d if d > 0 else math.inf if c else 0.0 for c, d in zip(self.channels, self.standard_error, strict=True))


@dataclass(frozen=True, slots=True)
class Noise:
    """The estimated noise of each side as √relMSE, and the ratio of the difference to the difference that noise explains.

    None if unknown. `shared`: both sides have the same random numbers, so that their noise cancels where they agree.
    """

    a: float | None
    b: float | None
    ratio: float | None
    shared: bool


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The result of `compare`; `at`, `differing` and `pixels` as in metrics.Difference."""

    a: Side
    b: Side
    figures: Mapping[str, float | None]  # by the names of metric_table.compared(); None where unknown
    at: tuple[int, int]
    differing: int
    pixels: int
    exposure: float  # stops of both pictures for FLIP
    bias: Bias
    noise: Noise
    outline: Region | None
    interior: Region | None
    objects: tuple[object_errors.ObjectError, ...]
    largest_on: str  # the object at `at`
    changes: tuple[scene_diff.Change, ...]

    @property
    def error(self) -> float:
        """√relMSE."""
        return self.figures["relmse"] or 0.0

    @property
    def within_noise(self) -> bool | None:
        """Whether noise explains the difference; None if the noise is unknown."""
        return None if self.noise.ratio is None else self.noise.ratio <= NOISE_RATIO

    @property
    def biased(self) -> bool | None:
        """Whether the difference of the means is significant; None if the noise is unknown."""
        significance = self.bias.significance
        return None if significance is None else significance > SIGNIFICANCE

    def value(self, metric: str) -> float | None:
        """The figure of a metric, or "bias", "noise" or "significance"; None if it is unknown."""
        figures = {"bias": self.bias.largest, "noise": self.noise.ratio, "significance": self.bias.significance}
        return {**self.figures, **figures}[metric]

    def to_json(self) -> dict[str, Any]:
        """Every figure as plain data."""
        return {
            "a": _side(self.a), "b": _side(self.b),
            **self.figures, "at": list(self.at),
            "at_object": self.largest_on, "differing": self.differing, "pixels": self.pixels, "exposure": self.exposure,
            "bias": self.bias.channels, "bias_standard_error": self.bias.standard_error, "bias_significance": self.bias.significance,
            "biased": self.biased,
            "noise": {"a": self.noise.a, "b": self.noise.b, "ratio": self.noise.ratio, "shared": self.noise.shared},
            "within_noise": self.within_noise,
            "outline": None if self.outline is None else self.outline.to_json(),
            "interior": None if self.interior is None else self.interior.to_json(),
            "objects": [entry.to_json() for entry in self.objects],
            "changes": [change.to_json() for change in self.changes],
        }  # fmt: skip


def _side(side: Side) -> dict[str, Any]:
    image = side.image
    return {
        "name": side.name, "size": [image.width, image.height], "noise": side.noise, "adjusted": list(side.changes),
        "plan": None if side.plan is None else side.plan.values(),
        "samples": image.metadata.get("samples_mean"), "seconds": image.metadata.get("seconds"),
        "not_drawn": [note.to_json() for note in side.notes],
    }  # fmt: skip


def compare(a: Side, b: Side, exposure: float | None = None) -> Comparison:
    """Measure `a` against `b`. Raises metrics.SizeError.

    FLIP uses `exposure` stops, by default those recorded in B or A. 8 and 16-bit pictures are not exposed.
    """
    a, b = zero_shared_nonfinite(*match_encoding(a, b, exposure))
    stops = 0.0 if a.bits else common_exposure(a, b) if exposure is None else exposure
    difference = metrics.difference(a.rgb, b.rgb)
    changed, same = _changes(a, b)
    owner = object_errors.pixel_owners(a, b, same)
    variance = _variance(a, b)
    outline = _outline(a, b)
    distance = metrics.distance(a.rgb, b.rgb).max(axis=2)
    of_luminance = None if variance is None else variance @ metrics.LUMINANCE**2
    pair = errors.Pair(a.rgb, a.coverage, b.rgb, b.coverage, stops)
    figures = {name: metric.value(pair) for name, metric in compared().items()}
    return Comparison(
        a, b, figures, difference.at, difference.differing, difference.pixels,
        exposure=stops,
        bias=_bias(a, b, variance),
        noise=_noise(a, b, variance, difference.error),
        outline=None if outline is None else _region(outline, pair.squared, distance),
        interior=None if outline is None else _region(~outline, pair.squared, distance),
        objects=() if owner is None else tuple(object_errors.measure(a, b, owner, pair.squared, of_luminance)),
        largest_on="" if owner is None else object_errors.owner_name(a, b, int(owner[difference.at[1], difference.at[0]])),
        changes=tuple(changed),
    )  # fmt: skip


def common_exposure(a: Side, b: Side) -> float:
    """The stops recorded in or planned for B, else A; 0 by default."""
    return next((stops for stops in (recorded_exposure(b), recorded_exposure(a)) if stops is not None), 0.0)


def _changes(a: Side, b: Side) -> tuple[list[scene_diff.Change], dict[int, int]]:
    """The changes between two versions of a scene, and the mapping from instances of A to those of B."""
    if a.scene is None or b.scene is None or a.scene is b.scene or serialize.content_hash(a.scene) == serialize.content_hash(b.scene):
        ids = a.ids
        both = ids is not None and b.ids is not None
        return [], {k: k for k in range(int(ids.max(initial=-1)) + 1)} if both and ids is not None else {}
    return scene_diff.diff(a.scene, b.scene)


def _outline(a: Side, b: Side) -> NDArray[np.bool_] | None:
    masks = [mask for mask in (object_errors.outline_mask(a), object_errors.outline_mask(b)) if mask is not None]
    return np.logical_or.reduce(masks) if masks else None


def _region(where: NDArray[np.bool_], squared: NDArray[np.float64], distance: NDArray[np.float64]) -> Region:
    count, weights = int(np.count_nonzero(where)), object_errors.error_shares(squared.mean(axis=2))
    error = math.sqrt(float(squared[where].mean())) if count else 0.0
    return Region(count, float(weights[where].sum()), error, float(distance[where].max(initial=0.0)))


def _bias(a: Side, b: Side, variance: NDArray[np.float64] | None) -> Bias:
    with np.errstate(invalid="ignore"):
        ours, theirs = a.rgb.sum(axis=(0, 1)), b.rgb.sum(axis=(0, 1))
    standard_error = None if variance is None else np.sqrt(variance.sum(axis=(0, 1)))
    return Bias(_channel_ratios(ours - theirs, theirs), None if standard_error is None else _channel_ratios(standard_error, np.abs(theirs)))


def _channel_ratios(values: NDArray[np.float64], totals: NDArray[np.float64]) -> tuple[float, float, float]:
    red, green, blue = (object_errors.ratio(x, y) for x, y in zip(values, totals, strict=True))
    return red, green, blue


def _variance(a: Side, b: Side) -> NDArray[np.float64] | None:
    """(h, w, 3) variance of A − B for independent noise, an upper bound for shared random numbers."""
    first, second = a.variance, b.variance
    return None if first is None or second is None else first + second


def _noise(a: Side, b: Side, variance: NDArray[np.float64] | None, error: float) -> Noise:
    """The noise of both sides. With pixel variances the ratio compares equally weighted sums of squares.

    The weights use the mean of both sides: in √relMSE a pixel that is dark in one by chance would have an unlimited weight.
    """
    ratio = None
    if variance is not None:
        middle = (a.rgb + b.rgb) / 2
        weight = 1.0 / (middle**2 + (metrics.EPSILON * metrics.luminance(b.rgb).mean()) ** 2 + np.finfo(np.float64).tiny)
        ratio = _ratio(math.sqrt(float(((a.rgb - b.rgb) ** 2 * weight).mean())), math.sqrt(float((variance * weight).mean())))
    elif a.noise is not None and b.noise is not None:
        ratio = _ratio(error, math.hypot(a.noise, b.noise))
    return Noise(a.noise, b.noise, ratio, _share_randomness(a, b))


def _ratio(difference: float, noise: float) -> float:
    if math.isnan(difference):
        return math.inf
    return difference / noise if noise > 0 else 0.0 if difference == 0 else math.inf


def _share_randomness(a: Side, b: Side) -> bool:
    if a.plan is None or b.plan is None:
        return False
    return all(a.plan[name] == b.plan[name] for name in ("seed", "samples", "error", "filter", "size"))
