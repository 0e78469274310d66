"""Tables of the directional albedo of GGX microfacets, for energy compensation and layering.

E(μ, α) = ∫ f cos dω of a GGX highlight with reflectance 1 (Smith's height-correlated shadowing) at cosine μ. B(μ, α) is the same integral
weighted by Schlick's (1 − cos)⁵, so that a highlight with Schlick's approximation reflects f0 (E − B) + f90 B: the split sum (Karis 2013,
Real Shading in Unreal Engine 4). Both are integrated over visible normals (Dupuy and Benyoub 2023, Sampling Visible GGX Normals with
Spherical Caps), which takes about 0.3 s, once a process and only in scenes with such materials.

Light of further bounces leaves in a GGX lobe of its own (`spread_alpha`), with h(μₒ) h(μᵢ) k instead of Fresnel's reflectance. The factor
k is fitted to random walks (module further_bounces). The table of h solves ∫ f h(μₒ) h(μᵢ) k cos dω = 1 − E(μₒ, α) for every μₒ, by
symmetric scaling (Sinkhorn and Knopp 1967, Concerning Nonnegative Matrices and Doubly Stochastic Matrices). So the lobe returns what one
bounce loses, in either direction of light, and is reciprocal.

Energy must not increase. So E and B are upper bounds (`raised`), and their means lower bounds of the tables' means: the tabulated loss is
below the true one, and compensation returns at most that. It costs 0.03 % of the light.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..types import Lane
from . import further_bounces as further

COLUMNS = 64  # of directions
ROWS = 48  # of roughness, by its root √√α
FIRST = 0.1  # root of the first row: α 10⁻⁴
MISSED = 1.5e-4  # greatest error of E or B by quadrature and linear interpolation
SPREAD = 1.15  # root of the roughness α of the lobe of further bounces over the root of the facets': nearest to random walks
SCALINGS = 40  # iterations for h
GREY = 0.3  # reflectance of facets for which the mean Schlick term is exact
SCALED = 2e-3, 0.05  # greatest relative excess of the lobe of further bounces by linear interpolation; more of polished facets
ROUNDED = 5e-5  # greatest excess of a mean by linear interpolation between rows

F64 = NDArray[np.float64]


class Albedo(NamedTuple):
    """Tables as kernels read them; row j is for √√α = FIRST + (1 - FIRST) j / (ROWS - 1)."""

    each: F64  # (ROWS · COLUMNS, 4) E and B − (1 − μ)⁵ E of a column, and of the next
    mean: F64  # (ROWS, 4) cosine-weighted means of E and B, standard deviation of B, 0
    again: F64  # (ROWS · COLUMNS, 4) h of a column and of the next, in this row and in the next
    after: F64  # (ROWS · COLUMNS, 4) s and c of the light of further bounces of a column, and of the next; see further_bounces.colour
    pairs: F64  # further_bounces.table


@helper
def directional_albedo(table: Albedo, cosine: Lane, alpha: Lane) -> tuple[Lane, Lane]:
    """(E, B) at a cosine from 0 to 1 and a roughness α."""
    row, part = row_of(alpha, ROWS)
    column = column_of(cosine, alpha) * (COLUMNS - 1.0)
    cell = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(cell)
    e, b, e_next, b_next = row_gather.four_at(table.each, row * COLUMNS + cell)
    e_below, b_below, e_last, b_last = row_gather.four_at(table.each, (row + 1) * COLUMNS + cell)
    albedo = ops.lerp(ops.lerp(e, e_next, x), ops.lerp(e_below, e_last, x), part)
    more = ops.lerp(ops.lerp(b, b_next, x), ops.lerp(b_below, b_last, x), part)
    away = 1.0 - cosine
    squared = away * away
    return albedo, ops.clip(more + squared * squared * away * albedo, 0.0, albedo)


@helper
def further_bounces(table: Albedo, cosine: Lane, alpha: Lane) -> Lane:
    """Return h at a cosine from 0 to 1 and a roughness α: the lobe of further bounces has the reflectance h h."""
    row, part = row_of(alpha, ROWS)
    column = column_of(cosine, alpha) * (COLUMNS - 1.0)
    cell = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(cell)
    first, next_, below, last = row_gather.four_at(table.again, row * COLUMNS + cell)
    return ops.lerp(ops.lerp(first, next_, x), ops.lerp(below, last, x), part)


@helper
def spread_alpha(alpha: Lane) -> Lane:
    """Return the roughness α of the lobe of further bounces."""
    return ops.minimum(SPREAD * ops.sqrt(alpha), 1.0)


@helper
def after_two(table: Albedo, cosine: Lane, alpha: Lane) -> tuple[Lane, Lane]:
    """(s, c) of all light of further bounces at a cosine from 0 to 1: see further_bounces.colour."""
    row, part = row_of(alpha, ROWS)
    column = column_of(cosine, alpha) * (COLUMNS - 1.0)
    left = ops.minimum(ops.floor_int(column), COLUMNS - 2)
    x = column - ops.to_float(left)
    s, c, s_next, c_next = row_gather.four_at(table.after, row * COLUMNS + left)
    s_below, c_below, s_last, c_last = row_gather.four_at(table.after, (row + 1) * COLUMNS + left)
    s = ops.lerp(ops.lerp(s, s_next, x), ops.lerp(s_below, s_last, x), part)
    return s, ops.lerp(ops.lerp(c, c_next, x), ops.lerp(c_below, c_last, x), part)


@helper
def mean_after_two(alpha: Lane) -> tuple[Lane, Lane]:
    """(s, c) of all light of further bounces from all directions, weighted by the cosine: fitted, lower bounds."""
    return 0.3 - alpha * (1.034 - alpha * (1.336 - 0.586 * alpha)), 0.98 - alpha * (0.423 + 0.023 * alpha)


@helper
def means(table: Albedo, alpha: Lane) -> tuple[Lane, Lane, Lane]:
    """(mean of E, mean of B, standard deviation of B) over the hemisphere, weighted by the cosine."""
    row, part = row_of(alpha, ROWS)
    lower, upper = row_gather.four_at(table.mean, row), row_gather.four_at(table.mean, row + 1)
    return ops.lerp(lower[0], upper[0], part), ops.lerp(lower[1], upper[1], part), ops.lerp(lower[2], upper[2], part)


@helper
def row_of(alpha: Lane, rows: int) -> tuple[Lane, Lane]:
    """(row before a roughness, fraction to the next)."""
    place = ops.maximum(ops.sqrt(ops.sqrt(alpha)) - FIRST, 0.0) * ((rows - 1.0) / (1.0 - FIRST))
    row = ops.minimum(ops.floor_int(place), rows - 2)
    return row, place - ops.to_float(row)


@helper
def column_of(cosine: Lane, alpha: Lane) -> Lane:
    """Return the position of a cosine in a row, 0 to 1: half by the cosine, half by where masking begins."""
    return ops.sqrt(0.5 * (cosine + cosine * (1.0 + alpha) / (cosine + alpha)))


# --- tabulation ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def table() -> Albedo:
    """Return the tables, computed on first use."""
    alpha = alphas(ROWS)
    cosine = cosines(alpha, COLUMNS)
    e, b = (np.stack(x) for x in zip(*(integrals(*row) for row in zip(cosine, alpha, strict=True)), strict=True))
    grazing = (1.0 - cosine) ** 5
    b = np.minimum(b, e) - grazing * e
    e = np.minimum(raise_to_bound(e) + MISSED, 1.0)
    b = np.minimum(raise_to_bound(b) + MISSED, (1.0 - grazing) * e)
    each = np.stack([e, b, np.roll(e, -1, 1), np.roll(b, -1, 1)], axis=-1).reshape(-1, 4)
    nodes, weights = _legendre(64)
    mu = np.broadcast_to(0.5 * (nodes + 1.0), (ROWS, 64))
    rows = np.repeat(alpha, 64)
    again, after = _scaling(alpha, cosine, np.maximum(1.0 - e, 0.0))
    albedo = Albedo(np.ascontiguousarray(each), np.zeros((ROWS, 4)), again, after, further.table())
    at_nodes = [x.reshape(ROWS, 64) for x in directional_albedo(albedo, mu.ravel(), rows)]
    mean_e, mean_b, mean_b2 = ((x * mu) @ weights for x in (*at_nodes, at_nodes[1] ** 2))
    deviation = np.sqrt(np.maximum(mean_b2 - mean_b**2, 0.0))
    mean_e, mean_b = mean_e - np.minimum(ROUNDED, 0.05 * (1.0 - mean_e)), np.maximum(mean_b - ROUNDED, 0.0)
    return albedo._replace(mean=np.ascontiguousarray(np.stack([mean_e, mean_b, deviation, 0.0 * deviation], axis=-1)))


def unused_table() -> Albedo:
    """A table of zeros, for kernels of scenes without microfacets."""
    empty = np.zeros((ROWS * COLUMNS, 4))
    return Albedo(empty, np.zeros((ROWS, 4)), empty, empty, np.zeros((further.ROWS * further.COLUMNS**2, further.NUMBERS)))


def _scaling(alpha: F64, cosine: F64, lost: F64) -> tuple[F64, F64]:
    """Return (ROWS · COLUMNS, 4) `Albedo.again` and `Albedo.after`."""
    sent = np.zeros((3, ROWS, COLUMNS, COLUMNS))  # what the lobe sends from a column to each; times the reflectance of grey facets; times c
    pairs = further.table()
    for row in range(ROWS):
        wide = spread_alpha(alpha[row])
        lit, away, out = over_visible_normals(cosine[row], np.full(COLUMNS, wide), 12, 8)
        into = np.asarray(column_of(np.minimum(out, 1.0), alpha[row]))
        up = np.minimum((0.5 * (out + cosine[row][:, None, None]) / np.maximum(1.0 - away, 1e-12)) ** 2, 1.0)
        y = wide * wide * up / (1.0 - up + wide * wide * up)
        factor, s, v, c = further.of_row(pairs, np.linspace(0.0, 1.0, COLUMNS)[:, None, None], into, float(alpha[row]), y)
        cell = np.minimum((into * (COLUMNS - 1.0)).astype(np.int64), COLUMNS - 2)
        part = into * (COLUMNS - 1.0) - cell
        first = np.arange(COLUMNS)[:, None, None] * COLUMNS + cell
        grey = (GREY + (1.0 - GREY) * s) ** 2 + (1.0 - GREY) ** 2 * v
        for of, kind in enumerate((lit * factor, lit * factor * grey, lit * factor * c)):
            for shift, share in ((0, 1.0 - part), (1, part)):
                sent[of, row] += np.bincount((first + shift).ravel(), (kind * share).ravel(), COLUMNS**2).reshape(COLUMNS, COLUMNS)
    h = np.sqrt(lost)
    for _ in range(SCALINGS):
        h = np.sqrt(h * lost / np.maximum((sent[0] @ h[..., None])[..., 0], 1e-12))
    total, grey, twice = np.maximum((sent @ h[..., None])[..., 0], 1e-12)
    over = np.max(np.divide(h * total, lost, out=np.ones_like(lost), where=lost > 1e-9), axis=1)
    margin = SCALED[0] + np.maximum(SCALED[1] - alpha, 0.0)
    h = h * np.sqrt((1.0 - margin) / np.maximum(over, 1.0))[:, None]
    below = np.concatenate([h[1:], h[-1:]])
    s, c = (np.sqrt(grey / total) - GREY) / (1.0 - GREY), twice / total
    tables = (h, np.roll(h, -1, 1), below, np.roll(below, -1, 1)), (s, c, np.roll(s, -1, 1), np.roll(c, -1, 1))
    first, second = (np.ascontiguousarray(np.stack(numbers, axis=-1).reshape(-1, 4)) for numbers in tables)
    return first, second


def raise_to_bound(rows: F64) -> F64:
    """Raise a table by its curvature f″ h²/8 along all axes, so that linear interpolation is an upper bound."""
    more = np.zeros_like(rows)
    for axis in range(rows.ndim):
        f = np.moveaxis(rows, axis, -1)
        bend = np.maximum(2.0 * f[..., 1:-1] - f[..., :-2] - f[..., 2:], 0.0) / 8.0
        bend = np.concatenate([bend[..., :1], bend, bend[..., -1:]], axis=-1)
        more += np.moveaxis(bend, -1, axis)
    return rows + more


def alphas(rows: int) -> F64:
    """Return (rows,) α of each row."""
    return np.linspace(FIRST, 1.0, rows) ** 4


def cosines(alpha: F64, columns: int) -> F64:
    """Return (rows, columns) cosines at even steps of `column_of`."""
    place, alpha = 2.0 * np.linspace(0.0, 1.0, columns) ** 2, alpha[:, None]
    k = 1.0 + 2.0 * alpha - place
    root = np.sqrt(k * k + 4.0 * place * alpha)
    return np.clip(np.where(k > 0.0, 2.0 * place * alpha / (np.abs(k) + root), 0.5 * (root - k)), 1e-6, 1.0)


def integrals(cosine: Any, alpha: Any, heights: int = 12, turns: int = 8) -> tuple[Any, Any]:
    """(E, B) by quadrature within 10⁻⁴, of the arrays' common shape."""
    lit, away, _ = over_visible_normals(cosine, alpha, heights, turns)
    return lit.sum(axis=(-2, -1)), (lit * away**5).sum(axis=(-2, -1))


@lru_cache
def _legendre(count: int) -> tuple[F64, F64]:
    return np.polynomial.legendre.leggauss(count)


def over_visible_normals(cosine: Any, alpha: Any, heights: int, turns: int) -> tuple[F64, F64, F64]:
    """(share of the light sent on, 1 − the facet's cosine, cosine of the reflected direction) at nodes over visible normals.

    The arrays have two more axes than the arguments. The domain is the sphere of stretched facet normals, in polar coordinates around the
    normal. At each azimuth the lit part ends at the slope τ with μ α² τ² = 2 √(1 − μ²) cos φ α τ + μ, so the integrand is smooth at all
    nodes. Nodes are denser at that end, and behind the viewer, where facets are seen edge on.
    """
    nodes, w = _legendre(heights)
    ahead, behind = _legendre(turns), _legendre(turns - 2)
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
    offset = 0.5 * (1.0 - nodes)
    tilt = end * (1.0 - offset * offset)
    sin, cos = np.sin(tilt), np.cos(tilt)
    slope = a * sin
    size = slope * slope + cos * cos
    facing = flat * slope + mu * cos
    out = np.maximum(2.0 * facing * cos / size - mu, 1e-12)
    near, far = np.sqrt(a * a + (1.0 - a * a) * mu * mu) / mu, np.sqrt(a * a + (1.0 - a * a) * out * out)
    weight = end * (w * offset) * turn_weight[:, None] * 4.0 * sin * facing / (length + mu)
    lit = weight * (1.0 + near) * out / (near * out + far)
    away = np.clip(1.0 - facing / np.sqrt(size), 0.0, 1.0)
    return lit, away, out
