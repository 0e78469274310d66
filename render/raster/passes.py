"""Sample passes: a picture's samples in groups of at most sixteen a pixel, each with a sample pattern and filter weights."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan import raster_rules
from ..jit.packed_struct import Handle
from ..sampling import sobol
from . import band_buffer, coverage, fragments

SAMPLES = raster_rules.BAND_SAMPLES  # of a pass, at most

WEIGHT_STEPS = 2.0**22  # weights are multiples of its inverse: float32 sums are exact, and full coverage is 1


class Pass(NamedTuple):
    """A group of samples of all pixels that one pass draws."""

    first: int  # number of the first sample
    pattern: band_buffer.Pattern
    places: Handle  # of `pattern`
    weights: Handle  # of a fragments.Splat


@functools.cache
def passes(samples: int, random: bool, name: str) -> tuple[Pass, ...]:
    """The passes for a number of samples and a filter; at least two for `random` samples, to estimate the error from halves."""
    count = max(-(-samples // SAMPLES), 2 if random and samples >= 4 else 1)  # a single sample fills its pixel
    ends = [samples * k // count for k in range(count + 1)]
    shares = np.diff(np.round(np.array(ends) / samples * WEIGHT_STEPS)) / WEIGHT_STEPS
    sample_passes = []
    for first, end, share in zip(ends[:-1], ends[1:], shares.tolist(), strict=True):
        pattern = band_buffer.pattern(samples) if count == 1 else band_buffer.pattern_from(first, end - first)
        sample_passes.append(Pass(first, pattern, Handle(pattern), Handle(filter_weights(name, pattern, share, samples))))
    return tuple(sample_passes)


def filter_weights(name: str, pattern: band_buffer.Pattern, share: float, samples: int) -> fragments.Splat:
    """The weights of a pixel's samples in the pixels around it; all weights of a pixel sum to `share`."""
    side, count = fragments.SIDE, len(pattern.x)
    reach = int(np.ceil(sobol.FILTER_RADIUS[name] - 0.5)) if samples > 1 else 0
    away = np.arange(side, dtype=np.float64) - fragments.REACH
    inner = 0.5 - 1e-6  # samples on a pixel's border belong to it, for filters that end there
    dx: NDArray[np.float64] = np.maximum(pattern.x / coverage.ONE - 0.5, -inner)[:, None] - away
    dy: NDArray[np.float64] = np.maximum(pattern.y / coverage.ONE - 0.5, -inner)[:, None] - away
    weight = sobol.filter_weight(name, dy)[:, :, None] * sobol.filter_weight(name, dx)[:, None, :]
    if samples == 1:
        weight = np.zeros_like(weight)
        weight[0, fragments.REACH, fragments.REACH] = 1.0
    weight = np.round(weight / weight.sum() * share * WEIGHT_STEPS) / WEIGHT_STEPS
    weight[np.unravel_index(weight.argmax(), weight.shape)] += share - weight.sum()
    table = np.zeros((4, 16, side * side))
    for s in range(count):
        for bits in range(16):
            if bits >> (s % 4) & 1:
                table[s // 4, bits] += weight[s].ravel()
    return fragments.Splat(table.astype(np.float32), reach, -(-count // 4), reach == 0 and share == 1.0)
