"""Compares a new picture with the kept one: whether both are equal within their noise, as a whole and in each block of pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ...measure.comparison.compare import Comparison

BLOCK = 16  # pixels, side of a block
DEVIATIONS = 8.0  # standard errors by which the mean of a block may differ; few pixels have a heavy tail
VISIBLE = 0.02  # relative difference of a block below which it does not count
EXACT = 1e-3  # √relMSE of pictures without noise, or whose noise is unknown


class Verdict(NamedTuple):
    """The result of a comparison: `why` is "" if the pictures agree."""

    why: str
    error: float  # √relMSE
    center: tuple[int, int] | None = None  # the middle of the block that differs most, in pixels


def judge(comparison: Comparison) -> Verdict:
    """Compare A, the new picture, with B, the kept one."""
    if comparison.error == 0.0:
        return Verdict("", 0.0)
    if comparison.noise.ratio is None or not (comparison.noise.a or comparison.noise.b):
        why = "" if comparison.error <= EXACT else f"√relMSE {comparison.error:.3%}, and neither picture has noise"
        return Verdict(why, comparison.error)
    if not comparison.within_noise:
        return Verdict(f"√relMSE {comparison.error:.3%}, {comparison.noise.ratio:.3g} times what noise alone makes", comparison.error)
    first, second = comparison.a.variance, comparison.b.variance
    if first is None or second is None:
        return Verdict("", comparison.error)
    deviations, relative = block_differences(comparison.a.rgb, comparison.b.rgb, first + second)
    worst = np.where(relative > VISIBLE, deviations, 0.0)
    row, column = np.unravel_index(int(worst.argmax()), worst.shape)
    if worst[row, column] <= DEVIATIONS:
        return Verdict("", comparison.error)
    center = int(column) * BLOCK + BLOCK // 2, int(row) * BLOCK + BLOCK // 2
    share, errors = relative[row, column], worst[row, column]
    message = f"{share:.1%} brighter or darker around pixel {center[0]},{center[1]}: {errors:.3g} standard errors"
    return Verdict(message, comparison.error, center)


def block_differences(
    a: NDArray[np.float64], b: NDArray[np.float64], variance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(rows, columns) of blocks: |mean A − mean B| in standard errors, and relative to the mean of B; the largest of three channels.

    `a`, `b` and `variance` of the difference are (h, w, 3). Blocks at the right and at the bottom may be smaller.
    """

    def means(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        starts = [np.arange(0, size, BLOCK) for size in values.shape[:2]]
        total = np.add.reduceat(np.add.reduceat(values, starts[0], axis=0), starts[1], axis=1)
        count = np.multiply.outer(*(np.diff([*start, size]) for start, size in zip(starts, values.shape[:2], strict=True)))[..., None]
        return total / count, count

    off, count = means(np.nan_to_num(a - b))
    error = np.sqrt(means(variance)[0] / count)
    level = np.abs(means(np.nan_to_num(b))[0])
    floor = 0.05 * float(level.mean())
    with np.errstate(divide="ignore", invalid="ignore"):
        deviations = np.where(off == 0.0, 0.0, np.abs(off) / error)
    return deviations.max(axis=2), (np.abs(off) / np.maximum(level, max(floor, 1e-300))).max(axis=2)
