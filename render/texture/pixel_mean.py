"""Mean of a pattern over the footprint of a pixel: points of a parallelogram, more of them where the first ones differ much.

The points are those of Roberts' R2 sequence ("The unreasonable effectiveness of quasirandom sequences", 2018), which is evenly distributed
for any number of points. Each comes with its opposite, so that linear patterns are exact.
"""

from __future__ import annotations

from typing import NamedTuple

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

WITH_PLACES = 10  # length of Surface.spread with changes of the position
SOME, MOST = 16, 64  # points of a footprint, and points where the first ones differ much
ROUGH = 1 / 64  # error of the mean above which more points are evaluated
_STEP_A, _STEP_B = 0.7548776662466927, 0.5698402909980532  # powers of the inverse plastic number, for the R2 sequence


class PixelMean(NamedTuple):
    """Sums over the points so far."""

    total: Vec
    square: Lane  # of the sum of the channels
    count: Lane
    open: Lane  # bool: takes further points


@helper
def begin(zero: Lane) -> PixelMean:
    """Return the sums of no points."""
    return PixelMean((zero, zero, zero), zero, zero, ops.bool_like(zero, True))


@helper
def offset(k: int) -> tuple[float, float]:
    """Return the place of point k in the parallelogram, from -0.5 to 0.5 along each side."""
    number, side = (k >> 1) + 1, 1.0 - 2.0 * (k & 1)
    return side * ((0.5 + _STEP_A * number) % 1.0 - 0.5), side * ((0.5 + _STEP_B * number) % 1.0 - 0.5)


@helper
def add(mean: PixelMean, color: Vec, k: int, wide: Lane) -> PixelMean:
    """Add the colour of point k; lanes without a `wide` footprint have one point."""
    grey = color[0] + color[1] + color[2]
    total = ops.where3(mean.open, ops.add(mean.total, color), mean.total)
    square = ops.where(mean.open, mean.square + grey * grey, mean.square)
    count = ops.where(mean.open, mean.count + 1.0, mean.count)
    further = mean.open & wide & (k + 1 < MOST)
    if k + 1 == SOME:  # the mean's error for random points, an upper bound for these
        middle = (total[0] + total[1] + total[2]) / count
        further = further & (square / count - middle * middle > SOME * ROUGH * ROUGH * middle * middle)
    return PixelMean(total, square, count, further)


@helper
def result(mean: PixelMean) -> Vec:
    """Return the mean colour."""
    return ops.scale(mean.total, 1.0 / mean.count)
