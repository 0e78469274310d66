"""What rough microfacets send on after one bounce, tabled: energy compensation and layers need it of every direction.

E(μ, α) = ∫ f cos dω of a GGX highlight that reflects everything (Smith's shadowing, height-correlated) seen under the cosine μ, and B(μ, α)
the part of it that Schlick's (1 − cos)⁵ weighs, so that a highlight of Schlick's law reflects f0 (E − B) + f90 B: the split sum (Karis
2013, Real Shading in Unreal Engine 4). Both are integrated over the microfacets that are seen (Dupuy and Benyoub 2023, Sampling Visible
GGX Normals with Spherical Caps), which takes some 50 ms, once a process and only where a scene has such materials.

No surface may send on more than it gets, so E and B are never less than the truth (`raised`) and their means never more than the tables':
what is tabled as lost is less than what is lost, and comes back in full at the most. That costs 0.03 % of the light.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..types import Lane

COLUMNS = 64  # of directions
ROWS = 48  # of roughness, by its root √√α
FIRST = 0.1  # root of the first row: α 10⁻⁴
MISSED = 1.5e-4  # of E or B, the most that quadrature and straight lines between nodes miss
ROUNDED = 5e-5  # of a mean, the most that straight lines between rows make it more than the mean of the table

F64 = NDArray[np.float64]


class Albedo(NamedTuple):
    """Tables as kernels read them; row j is for √√α = FIRST + (1 - FIRST) j / (ROWS - 1)."""

    each: F64  # (ROWS · COLUMNS, 4) of a column and of the one after it E, and what B is more than (1 − μ)⁵ E, all that it is where smooth
    mean: F64  # (ROWS, 4) cosine-weighted means of E and B, standard deviation of B, 0


@helper
def seen(table: Albedo, cosine: Lane, alpha: Lane) -> tuple[Lane, Lane]:
    """(E, B) under a cosine from 0 to 1, at a roughness α."""
    row, part = row_of(alpha, ROWS)
    column = column_of(cosine, alpha) * (COLUMNS - 1.0)
    left = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(left)
    e, b, e_next, b_next = row_gather.four_at(table.each, row * COLUMNS + left)
    e_below, b_below, e_last, b_last = row_gather.four_at(table.each, (row + 1) * COLUMNS + left)
    whole = ops.lerp(ops.lerp(e, e_next, x), ops.lerp(e_below, e_last, x), part)
    more = ops.lerp(ops.lerp(b, b_next, x), ops.lerp(b_below, b_last, x), part)
    away = 1.0 - cosine
    squared = away * away
    return whole, ops.clip(more + squared * squared * away * whole, 0.0, whole)


@helper
def means(table: Albedo, alpha: Lane) -> tuple[Lane, Lane, Lane]:
    """(mean of E, mean of B, standard deviation of B) over a hemisphere weighed by the cosine."""
    row, part = row_of(alpha, ROWS)
    one, next_ = row_gather.four_at(table.mean, row), row_gather.four_at(table.mean, row + 1)
    return ops.lerp(one[0], next_[0], part), ops.lerp(one[1], next_[1], part), ops.lerp(one[2], next_[2], part)


@helper
def row_of(alpha: Lane, rows: int) -> tuple[Lane, Lane]:
    """(the row before a roughness, how far on to the next)."""
    place = ops.maximum(ops.sqrt(ops.sqrt(alpha)) - FIRST, 0.0) * ((rows - 1.0) / (1.0 - FIRST))
    row = ops.minimum(ops.floor_int(place), rows - 2)
    return row, place - ops.to_float(row)


@helper
def column_of(cosine: Lane, alpha: Lane) -> Lane:
    """Where in a row from 0 to 1 a cosine stands: half of them by itself, half where facets begin to hide each other."""
    return ops.sqrt(0.5 * (cosine + cosine * (1.0 + alpha) / (cosine + alpha)))


# --- making them ---------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def table() -> Albedo:
    """The tables, made when first asked for."""
    alpha = alphas(ROWS)
    cosine = cosines(alpha, COLUMNS)
    e, b = (np.stack(x) for x in zip(*(integrals(*row) for row in zip(cosine, alpha, strict=True)), strict=True))
    grazing = (1.0 - cosine) ** 5
    b = np.minimum(b, e) - grazing * e
    e = np.minimum(raised(e) + MISSED, 1.0)
    b = np.minimum(raised(b) + MISSED, (1.0 - grazing) * e)
    each = np.stack([e, b, np.roll(e, -1, 1), np.roll(b, -1, 1)], axis=-1).reshape(-1, 4)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = np.broadcast_to(0.5 * (nodes + 1.0), (ROWS, 64))
    rows = np.repeat(alpha, 64)
    made = Albedo(np.ascontiguousarray(each), np.zeros((ROWS, 4)))
    at_nodes = [x.reshape(ROWS, 64) for x in seen(made, mu.ravel(), rows)]
    mean_e, mean_b, mean_b2 = ((x * mu) @ weights for x in (*at_nodes, at_nodes[1] ** 2))
    deviation = np.sqrt(np.maximum(mean_b2 - mean_b**2, 0.0))
    mean_e, mean_b = mean_e - np.minimum(ROUNDED, 0.05 * (1.0 - mean_e)), np.maximum(mean_b - ROUNDED, 0.0)
    return made._replace(mean=np.ascontiguousarray(np.stack([mean_e, mean_b, deviation, 0.0 * deviation], axis=-1)))


def raised(rows: F64) -> F64:
    """A table whose straight lines between nodes lie above the curve through them: by what it bends, f″ h²/8, along both of its axes."""
    more = np.zeros_like(rows)
    for axis in (0, 1):
        f = np.moveaxis(rows, axis, -1)
        bend = np.maximum(2.0 * f[..., 1:-1] - f[..., :-2] - f[..., 2:], 0.0) / 8.0
        bend = np.concatenate([bend[..., :1], bend, bend[..., -1:]], axis=-1)
        more += np.moveaxis(bend, -1, axis)
    return rows + more


def alphas(rows: int) -> F64:
    """(rows,) the roughness of each."""
    return np.linspace(FIRST, 1.0, rows) ** 4


def cosines(alpha: F64, columns: int) -> F64:
    """(rows, columns) whose column_of is evenly from 0 to 1."""
    place, alpha = 2.0 * np.linspace(0.0, 1.0, columns) ** 2, alpha[:, None]
    k = 1.0 + 2.0 * alpha - place
    root = np.sqrt(k * k + 4.0 * place * alpha)
    return np.clip(np.where(k > 0.0, 2.0 * place * alpha / (np.abs(k) + root), 0.5 * (root - k)), 1e-6, 1.0)


def integrals(cosine: Any, alpha: Any, heights: int = 12, turns: int = 8) -> tuple[Any, Any]:
    """(E, B) by quadrature, within 10⁻⁴; both of the arrays' common shape.

    Over facets' directions in the space in which they are a sphere, in polar coordinates about the normal: at each turn what is lit ends at
    a slope τ that solves μ α² τ² = 2 √(1 − μ²) cos φ α τ + μ, so that nodes stand on smooth ground alone. They are closer at that end, and
    behind the viewer where facets are seen edge on.
    """
    nodes, w = np.polynomial.legendre.leggauss(heights)
    ahead, behind = np.polynomial.legendre.leggauss(turns), np.polynomial.legendre.leggauss(turns - 2)
    back = 0.5 * (1.0 + behind[0])
    turned = np.cos(0.5 * np.pi * np.concatenate([0.5 * (1.0 + ahead[0]), 1.0 + back * back]))
    turn_weight = np.concatenate([0.25 * ahead[1], 0.5 * back * behind[1]])
    mu, a = (y[..., None] for y in np.broadcast_arrays(np.asarray(cosine, float), np.asarray(alpha, float)))
    sine = np.sqrt(1.0 - mu * mu)
    length = np.sqrt((a * sine) ** 2 + mu * mu)
    flat = sine * turned
    root = np.sqrt(flat * flat + mu * mu)
    end = np.arctan2(np.where(flat > 0.0, flat + root, mu * mu / (root - flat)), mu * a)[..., None]
    mu, a, flat, length = mu[..., None], a[..., None], flat[..., None], length[..., None]
    left = 0.5 * (1.0 - nodes)
    tilt = end * (1.0 - left * left)
    sin, cos = np.sin(tilt), np.cos(tilt)
    slope = a * sin
    size = slope * slope + cos * cos
    facing = flat * slope + mu * cos
    out = np.maximum(2.0 * facing * cos / size - mu, 1e-12)
    near, far = np.sqrt(a * a + (1.0 - a * a) * mu * mu) / mu, np.sqrt(a * a + (1.0 - a * a) * out * out)
    weight = end * (w * left) * turn_weight[:, None] * 4.0 * sin * facing / (length + mu)
    lit = weight * (1.0 + near) * out / (near * out + far)
    away = np.clip(1.0 - facing / np.sqrt(size), 0.0, 1.0)
    return lit.sum(axis=(-2, -1)), (lit * away**5).sum(axis=(-2, -1))
