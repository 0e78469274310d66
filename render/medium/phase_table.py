"""Phase functions beyond that of Henyey and Greenstein: Draine 2003, and its blend with the former that stands for droplets.

Draine 2003, Scattering by Interstellar Dust Grains: that of Henyey and Greenstein times 1 + α cos². Jendersie and d'Eon 2023, An
Approximate Mie Scattering Function for Fog and Cloud Rendering: a blend of both by the diameter of droplets. Angles of deflection are
sampled by a table of BINS + 1 quantiles. It holds 1 − cos, which is precise next to the forward peak. A weight, which is almost 1, corrects
for the density within a bin. Scenes without such media compile nothing of it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops, row_gather
from ..types import Lane, Vec

BINS = 1024
POINTS = 1 << 15  # of the integral
PEAK = 20.0  # logarithm of the ratio of the points' distances behind and ahead

F64 = NDArray[np.float64]


class NoDraine(NamedTuple):
    """All phase functions are those of Henyey and Greenstein."""


class Draine(NamedTuple):
    """Phase functions by the number of the medium."""

    shape: F64  # (n, 4) g of Henyey and Greenstein, g of Draine, α, weight of Draine; a weight of 0: Henyey and Greenstein alone
    quantiles: F64  # (n · (BINS + 1),) 1 − cos of the angle of deflection, from 0 to 2


def build(tables: ir.Tables, rows: np.ndarray, general: bool = False) -> Draine | NoDraine:
    """The phase functions of media `rows` (n,) of ir.Media, -1 without one."""
    shape = np.concatenate([tables.media.draine, np.zeros((1, 4))])[rows]
    if not (shape[:, 3] > 0.0).any() and not general:
        return NoDraine()
    quantiles = np.zeros((len(rows), BINS + 1))
    for number in np.flatnonzero(shape[:, 3] > 0.0).tolist():
        quantiles[number] = _quantiles(shape[number])
    return Draine(np.ascontiguousarray(shape), quantiles.ravel())


def _quantiles(shape: F64) -> F64:
    """(BINS + 1,) 1 − cos below which the light of equal shares is."""
    versine = 2.0 * np.expm1(PEAK * np.linspace(0.0, 1.0, POINTS)) / np.expm1(PEAK)
    if shape[0] < 0.0 or shape[1] < 0.0:  # a peak backwards
        versine = np.union1d(versine, 2.0 - versine)
    p = 2.0 * math.pi * np.asarray(value(*shape, versine))
    cumulative = np.concatenate([[0.0], np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(versine))])
    return np.interp(np.linspace(0.0, 1.0, BINS + 1), cumulative / cumulative[-1], versine)


@helper
def _henyey_greenstein(g: Lane, versine: Lane) -> Lane:
    squared = ops.maximum((1.0 - g) * (1.0 - g) + 2.0 * g * versine, 1e-12)
    return (1.0 - g * g) / (4.0 * math.pi * squared * ops.sqrt(squared))


@helper
def value(g: Lane, of_draine: Lane, alpha: Lane, weight: Lane, versine: Lane) -> Lane:
    """The phase function at 1 − cos of the angle of deflection."""
    cosine = 1.0 - versine
    factor = (1.0 + alpha * cosine * cosine) / (1.0 + alpha * (1.0 + 2.0 * of_draine * of_draine) * (1.0 / 3.0))
    return (1.0 - weight) * _henyey_greenstein(g, versine) + weight * factor * _henyey_greenstein(of_draine, versine)


@helper
def _density(draine: Any, default: Lane, number: Lane, cosine: Lane) -> Lane:
    g, of_draine, alpha, weight = row_gather.four_at(draine.shape, number)
    blended = weight > 0.0
    if ops.not_(ops.any_lane(blended)):
        return default
    return ops.where(blended, value(g, of_draine, alpha, weight, 1.0 - cosine), default)


@helper
def _sample(draine: Any, default: tuple[Vec, Lane, Lane], number: Lane, direction: Vec, u: Lane, v: Lane) -> tuple[Vec, Lane, Lane]:
    g, of_draine, alpha, weight = row_gather.four_at(draine.shape, number)
    blended = weight > 0.0
    if ops.not_(ops.any_lane(blended)):
        return default
    place = u * float(BINS)
    row = ops.minimum(ops.floor_int(place), BINS - 1)
    bin = ops.to_int(number) * (BINS + 1) + row
    low, high = draine.quantiles[bin], draine.quantiles[bin + 1]
    versine = ops.clip(low + (high - low) * (place - ops.to_float(row)), 0.0, 2.0)
    density = value(g, of_draine, alpha, weight, versine)
    factor = density * (2.0 * math.pi * BINS) * (high - low)
    sine = ops.sqrt(versine * (2.0 - versine))
    s, t = ops.basis(direction)
    onward = ops.in_basis(s, t, direction, sine * ops.cos(2.0 * math.pi * v), sine * ops.sin(2.0 * math.pi * v), 1.0 - versine)
    return ops.where3(blended, onward, default[0]), ops.where(blended, factor, default[1]), ops.where(blended, density, default[2])


density = specialize_if_present(_density)
"""(Draine, density of Henyey and Greenstein, number of the medium, cosine of the deflection) → the phase function."""
sample = specialize_if_present(_sample)
"""(Draine, (direction, weight, density), number of the medium, direction of the light, u, v) → a sample of the phase function."""
