"""Errors of a picture: √relMSE, that of block means, trimmed √relMSE, FLIP, maximum and silhouette distance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from flip_evaluator import evaluate
from numpy.typing import NDArray

from ..render.image import metrics
from .metric_table import METRICS

PIXELS_PER_DEGREE = 67.02  # FLIP's default: a display 0.7 m and 3840 pixels wide, seen from 0.7 m

Pixels = NDArray[np.floating]


def flip(image: Pixels, reference: Pixels) -> float:
    """Mean FLIP of two displayed pictures, 0 (equal) to 1; both linear (height, width, 3), exposed and within 0..1.

    Andersson et al. 2020, FLIP: A Difference Evaluator for Alternating Images, by its authors' flip-evaluator.
    """
    if image.size == 0:
        return 0.0
    a, b = (np.ascontiguousarray(np.clip(np.nan_to_num(pixels, nan=0.0), 0.0, 1.0), dtype=np.float32) for pixels in (image, reference))
    _, mean, _ = evaluate(b, a, "LDR", inputsRGB=False, applyMagma=False, parameters={"ppd": PIXELS_PER_DEGREE})
    return float(mean)


def silhouette(coverage: Pixels, reference: Pixels) -> float:
    """Mean distance in pixels of the outlines of two coverages (height, width): Σ|A − B| over the outline length of B.

    The outline length of A is used if B has none; 0 for equal coverages.
    """
    area = float(np.abs(np.asarray(coverage, np.float64) - reference).sum())
    if area == 0.0:
        return 0.0
    length = outline_length(reference) or outline_length(coverage)
    return area / length if length else float("inf")


def outline_length(coverage: Pixels) -> float:
    """Outline length in pixels of a coverage (height, width): its total variation (coarea formula)."""
    padded = np.pad(np.asarray(coverage, np.float64), 1, mode="edge")
    across = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    down = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    return float(np.hypot(across, down).sum())


@dataclass(frozen=True, eq=False)
class Pair:
    """A linear picture and its reference, (height, width, 3) each, with their coverages (height, width), None where unknown.

    FLIP shows both after `exposure` stops. Each method is a metric of metric_table.METRICS.
    """

    rgb: Pixels
    alpha: Pixels | None
    reference: Pixels
    covered: Pixels | None
    exposure: float

    @cached_property
    def squared(self) -> NDArray[np.float64]:
        """(height, width, 3) squared relative errors."""
        return metrics.squared_relative(self.rgb, self.reference)

    def relmse(self) -> float:
        """√relMSE; 0 of an empty picture."""
        return float(np.sqrt(self.squared.mean())) if self.squared.size else 0.0

    def trimmed(self) -> float:
        """√relMSE without the 0.1 % of pixels with the largest error."""
        return trim(self.squared)

    def blocks(self) -> float:
        """√relMSE of means over 4 × 4 pixels."""
        return metrics.block_relmse(self.rgb, self.reference)

    def flip(self) -> float:
        """Mean FLIP after exposure."""
        return flip(_expose(self.rgb, self.exposure), _expose(self.reference, self.exposure))

    def largest(self) -> float:
        """The largest linear |I − R| of any channel."""
        return float(metrics.distance(np.asarray(self.rgb, np.float64), np.asarray(self.reference, np.float64)).max(initial=0.0))

    def silhouette(self) -> float | None:
        """The mean distance of the outlines in pixels; None without both coverages."""
        return None if self.alpha is None or self.covered is None else silhouette(self.alpha, self.covered)


def measures(
    rgb: Pixels, alpha: Pixels | None, reference: Pixels, covered: Pixels | None, exposure: float, with_slow: bool = True
) -> dict[str, float]:
    """The value of each metric of METRICS that is known, by name; without the slow ones on demand."""
    pair = Pair(rgb, alpha, reference, covered, exposure)
    values = {name: metric.value(pair) for name, metric in METRICS.items() if with_slow or not metric.slow}
    return {name: value for name, value in values.items() if value is not None}


def trim(squared: NDArray[np.float64], share: float = 0.999) -> float:
    """Root of the mean squared error (height, width, 3) over the share `share` of the pixels with the smallest errors."""
    if not squared.size:
        return 0.0
    of_pixels = np.sort(squared.mean(axis=2), axis=None)
    return float(np.sqrt(of_pixels[: max(round(share * of_pixels.size), 1)].mean()))


def _expose(rgb: Pixels, stops: float) -> Pixels:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.clip(np.nan_to_num(rgb, nan=0.0, posinf=1e30) * 2.0**stops, 0.0, 1.0)
