"""Tables of the directional albedo of GGX microfacets of a dielectric, with Fresnel's equations.

R(μ, α, s) = ∫ f cos dω at cosine μ of facets of a boundary with s = (η − 1)/(η + 1), η its relative index above 1: s² is the reflectance
at normal incidence. What is not reflected passes, so 1 − R is what a base under the boundary gets. Integrals are over visible normals, as
those of energy_compensation. Interpolation is an upper bound but at grazing angles of polished facets.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..types import Lane
from . import energy_compensation

INDICES, ROWS, COLUMNS = 25, 20, 32
STEEPEST = 0.64  # greatest s: an index of 4.56
MISSED = 3e-4  # greatest error by quadrature and interpolation

F64 = NDArray[np.float64]


class Reflection(NamedTuple):
    """Tables as kernels read them."""

    each: F64  # (INDICES · ROWS · COLUMNS, 4) R of a column and the next, in this row and in the next
    mean: F64  # (INDICES · ROWS, 4) cosine-weighted mean of R and its standard deviation, in this row and in the next


@helper
def reflectance(cosine: Lane, step: Lane) -> Lane:
    """Fresnel's reflectance of unpolarized light from the rarer side of a boundary with s = `step`."""
    ratio = (1.0 + step) / ops.maximum(1.0 - step, 1e-3)
    g = ops.sqrt(ops.maximum(ratio * ratio - 1.0 + cosine * cosine, 1e-12))
    a, b = (g - cosine) / (g + cosine), (cosine * (g + cosine) - 1.0) / (cosine * (g - cosine) + 1.0)
    return ops.where(step > 0.0, ops.minimum(0.5 * a * a * (1.0 + b * b), 1.0), 0.0)


@helper
def _slices(step: Lane) -> tuple[Lane, Lane]:
    """(slice before √s, fraction to the next)."""
    place = ops.sqrt(ops.clip(step * (1.0 / STEEPEST), 0.0, 1.0)) * (INDICES - 1.0)
    below = ops.minimum(ops.floor_int(place), INDICES - 2)
    return below, place - ops.to_float(below)


@helper
def directional(table: Reflection, cosine: Lane, alpha: Lane, step: Lane) -> Lane:
    """Return R at a cosine from 0 to 1."""
    below, z = _slices(step)
    row, y = energy_compensation.row_of(alpha, ROWS)
    column = energy_compensation.column_of(cosine, alpha) * (COLUMNS - 1.0)
    left = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(left)
    first = (below * ROWS + row) * COLUMNS + left
    a, b, c, d = row_gather.four_at(table.each, first)
    e, f, g, h = row_gather.four_at(table.each, first + ROWS * COLUMNS)
    low, high = ops.lerp(ops.lerp(a, b, x), ops.lerp(c, d, x), y), ops.lerp(ops.lerp(e, f, x), ops.lerp(g, h, x), y)
    return ops.clip(ops.lerp(low, high, z), 0.0, 1.0)


@helper
def means(table: Reflection, alpha: Lane, step: Lane) -> tuple[Lane, Lane]:
    """(mean of R, its standard deviation) over the hemisphere, weighted by the cosine."""
    below, z = _slices(step)
    row, y = energy_compensation.row_of(alpha, ROWS)
    a, b, c, d = row_gather.four_at(table.mean, below * ROWS + row)
    e, f, g, h = row_gather.four_at(table.mean, (below + 1) * ROWS + row)
    return ops.lerp(ops.lerp(a, c, y), ops.lerp(e, g, y), z), ops.lerp(ops.lerp(b, d, y), ops.lerp(f, h, y), z)


# --- tabulation ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def table() -> Reflection:
    """Return the tables, computed on first use."""
    alpha, steps = energy_compensation.alphas(ROWS), STEEPEST * np.linspace(0.0, 1.0, INDICES) ** 2
    cosine = energy_compensation.cosines(alpha, COLUMNS)
    each = np.stack([integrals(*row, steps) for row in zip(cosine, alpha, strict=True)], axis=1)
    for k in range(1, INDICES):
        each[k] = np.minimum(energy_compensation.raise_to_bound(each[k]) + MISSED * min(1.0, k), 1.0)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = 0.5 * (nodes + 1.0)
    even = np.linspace(0.0, 1.0, COLUMNS)
    places = [energy_compensation.column_of(mu, a) for a in alpha]
    at_nodes = np.array([[np.interp(place, even, row) for place, row in zip(places, rows, strict=True)] for rows in each])
    mean = at_nodes @ (weights * mu)
    deviation = np.sqrt(np.maximum(at_nodes**2 @ (weights * mu) - mean**2, 0.0))
    return Reflection(_quads(each), _pairs(mean, deviation))


def _next(table_: F64, axis: int) -> F64:
    """The table moved by one along an axis, with the last entry twice."""
    last = np.take(table_, [-1], axis=axis)
    return np.concatenate([np.delete(table_, 0, axis=axis), last], axis=axis)


def _quads(each: F64) -> F64:
    below = _next(each, 1)
    return np.ascontiguousarray(np.stack([each, _next(each, 2), below, _next(below, 2)], axis=-1).reshape(-1, 4))


def _pairs(mean: F64, deviation: F64) -> F64:
    return np.ascontiguousarray(np.stack([mean, deviation, _next(mean, 1), _next(deviation, 1)], axis=-1).reshape(-1, 4))


def integrals(cosine: Any, alpha: Any, steps: Any, heights: int = 16, turns: int = 10) -> F64:
    """(steps, cosines) R by quadrature."""
    lit, away, _ = energy_compensation.over_visible_normals(cosine, alpha, heights, turns)
    return np.stack([(lit * reflectance(1.0 - away, np.full_like(away, step))).sum(axis=(-2, -1)) for step in np.ravel(steps)])
