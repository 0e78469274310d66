"""Errors of a picture beside √relMSE (render/metrics.py): what a person would see (FLIP), and how far outlines lie apart."""

from __future__ import annotations

import numpy as np
from flip_evaluator import evaluate
from numpy.typing import NDArray

PIXELS_PER_DEGREE = 67.02  # of the viewer: FLIP's own default, a 0.7 m wide display of 3840 pixels seen from 0.7 m

Pixels = NDArray[np.floating]


def flip(image: Pixels, reference: Pixels) -> float:
    """Mean FLIP of two pictures as shown, 0 (alike) to 1: linear (height, width, 3), exposed and within 0..1.

    Andersson et al. 2020, FLIP: A Difference Evaluator for Alternating Images, by its authors' flip-evaluator.
    """
    if image.size == 0:
        return 0.0
    a, b = (np.ascontiguousarray(np.clip(np.nan_to_num(pixels, nan=0.0), 0.0, 1.0), dtype=np.float32) for pixels in (image, reference))
    _, mean, _ = evaluate(b, a, "LDR", inputsRGB=False, applyMagma=False, parameters={"ppd": PIXELS_PER_DEGREE})
    return float(mean)


def silhouette(coverage: Pixels, reference: Pixels) -> float:
    """How far apart, in pixels, the outlines of two coverages (height, width) lie on the average: |A − B| over the length of B's.

    Where B has no outline, A's length is taken; 0 where both cover the same.
    """
    area = float(np.abs(np.asarray(coverage, np.float64) - reference).sum())
    if area == 0.0:
        return 0.0
    length = outline_length(reference) or outline_length(coverage)
    return area / length if length else float("inf")


def outline_length(coverage: Pixels) -> float:
    """Pixels of outline in a coverage (height, width): its total variation (the coarea formula)."""
    padded = np.pad(np.asarray(coverage, np.float64), 1, mode="edge")
    across = (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
    down = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2
    return float(np.hypot(across, down).sum())
