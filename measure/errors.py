"""Errors of a picture: √relMSE, that of block means, trimmed √relMSE, FLIP, maximum and silhouette distance."""

from __future__ import annotations

import numpy as np
from flip_evaluator import evaluate
from numpy.typing import NDArray

from ..render.image import metrics

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


def measures(
    rgb: Pixels, alpha: Pixels | None, reference: Pixels, covered: Pixels | None, exposure: float, with_flip: bool = True
) -> dict[str, float]:
    """Every error of a picture (height, width, 3) by name. FLIP takes longer than all others together and is optional.

    "relmse": √relMSE; "relmse 99.9%": without the 0.1 % of pixels with the largest error; "blocks": √relMSE of means over
    4 × 4 pixels; "flip": mean FLIP after exposure by
    `exposure` stops; "max": the largest linear |I − R| of any channel; "silhouette": in pixels, if both coverages are known.
    """
    squared = metrics.squared_relative(rgb, reference)
    found = {
        "relmse": float(np.sqrt(squared.mean())),
        "relmse 99.9%": trim(squared),
        "blocks": metrics.block_relmse(rgb, reference),
        "max": float(metrics.distance(np.asarray(rgb, np.float64), np.asarray(reference, np.float64)).max()),
    }
    if with_flip:
        found["flip"] = flip(_expose(rgb, exposure), _expose(reference, exposure))
    if alpha is not None and covered is not None:
        found["silhouette"] = silhouette(alpha, covered)
    return found


def trim(squared: NDArray[np.float64], kept: float = 0.999) -> float:
    """Root of the mean squared error (height, width, 3) over the share `kept` of the pixels with the smallest errors."""
    of_pixels = np.sort(squared.mean(axis=2), axis=None)
    return float(np.sqrt(of_pixels[: max(round(kept * of_pixels.size), 1)].mean()))


def _expose(rgb: Pixels, stops: float) -> Pixels:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.clip(np.nan_to_num(rgb, nan=0.0, posinf=1e30) * 2.0**stops, 0.0, 1.0)
