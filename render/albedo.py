"""What rough microfacets send on after one bounce, tabled: energy compensation and layers need it of every direction.

E(μ, α) = ∫ f cos dω of a GGX highlight that reflects everything (Smith's shadowing, height-correlated) seen under the cosine μ, and B(μ, α)
the part of it that Schlick's (1 − cos)⁵ weighs, so that a highlight of Schlick's law reflects f0 (E − B) + f90 B: the split sum (Karis
2013, Real Shading in Unreal Engine 4). Both are integrated over the microfacets that are seen (Dupuy and Benyoub 2023, Sampling Visible
GGX Normals with Spherical Caps), which takes some 80 ms, once a process and only where a scene has such materials.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import gather, lanes
from .kernels import helper
from .records import Lane

COLUMNS = 64  # of directions
ROWS = 48  # of roughness √α
SMOOTHEST = 1e-4  # α of the first row
_NODES = 20  # of each integral, over the microfacets' two dimensions

F64 = NDArray[np.float64]


class Albedo(NamedTuple):
    """Tables as kernels read them; row j is for √α = j / (ROWS - 1)."""

    each: F64  # (ROWS · COLUMNS, 4) of a column and of the one after it E, and what B is more than (1 − μ)⁵ E, all that it is where smooth
    mean: F64  # (ROWS, 4) cosine-weighted means of E and B, standard deviation of B, 0


@helper
def seen(table: Albedo, cosine: Lane, alpha: Lane) -> tuple[Lane, Lane]:
    """(E, B) under a cosine from 0 to 1, at a roughness α."""
    row, part = _row(alpha)
    square = cosine * cosine
    spread = lanes.over_root(alpha * alpha * (1.0 - square) + square)
    column = lanes.sqrt(0.5 * (cosine + cosine * spread)) * (COLUMNS - 1.0)
    left = lanes.minimum(lanes.floor_int(column), COLUMNS - 2)
    x = column - lanes.to_float(left)
    e, b, e_next, b_next = gather.four_at(table.each, row * COLUMNS + left)
    e_below, b_below, e_last, b_last = gather.four_at(table.each, (row + 1) * COLUMNS + left)
    whole = lanes.lerp(lanes.lerp(e, e_next, x), lanes.lerp(e_below, e_last, x), part)
    more = lanes.lerp(lanes.lerp(b, b_next, x), lanes.lerp(b_below, b_last, x), part)
    away = 1.0 - cosine
    squared = away * away
    return whole, lanes.clip(more + squared * squared * away * whole, 0.0, whole)


@helper
def means(table: Albedo, alpha: Lane) -> tuple[Lane, Lane, Lane]:
    """(mean of E, mean of B, standard deviation of B) over a hemisphere weighed by the cosine."""
    row, part = _row(alpha)
    one, next_ = gather.four_at(table.mean, row), gather.four_at(table.mean, row + 1)
    return lanes.lerp(one[0], next_[0], part), lanes.lerp(one[1], next_[1], part), lanes.lerp(one[2], next_[2], part)


@helper
def _row(alpha: Lane) -> tuple[Lane, Lane]:
    place = lanes.sqrt(alpha) * (ROWS - 1.0)
    row = lanes.minimum(lanes.floor_int(place), ROWS - 2)
    return row, place - lanes.to_float(row)


# --- making them ---------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def table() -> Albedo:
    """The tables, made when first asked for."""
    alpha = np.maximum(np.linspace(0.0, 1.0, ROWS) ** 2, SMOOTHEST)
    cosine = _cosines(alpha)
    e, b = integrals(cosine, alpha[:, None])
    b = b - (1.0 - cosine) ** 5 * e
    each = np.stack([e, b, np.roll(e, -1, 1), np.roll(b, -1, 1)], axis=-1).reshape(-1, 4)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    mu = np.broadcast_to(0.5 * (nodes + 1.0), (ROWS, 64))
    rows = np.repeat(alpha, 64)
    made = Albedo(np.ascontiguousarray(each), np.zeros((ROWS, 4)))
    at_nodes = [x.reshape(ROWS, 64) for x in seen(made, mu.ravel(), rows)]
    mean_e, mean_b, mean_b2 = ((x * mu) @ weights for x in (*at_nodes, at_nodes[1] ** 2))
    deviation = np.sqrt(np.maximum(mean_b2 - mean_b**2, 0.0))
    return made._replace(mean=np.ascontiguousarray(np.stack([mean_e, mean_b, deviation, 0.0 * deviation], axis=-1)))


def _cosines(alpha: F64) -> F64:
    """(ROWS, COLUMNS) the cosine of each column: half of its place is the cosine, half that in the space in which facets are a sphere."""
    place = np.linspace(0.0, 1.0, COLUMNS) ** 2
    low, high = np.zeros((len(alpha), COLUMNS)), np.ones((len(alpha), COLUMNS))
    for _ in range(50):
        middle = 0.5 * (low + high)
        stretched = middle / np.sqrt((alpha[:, None] ** 2) * (1.0 - middle**2) + middle**2)
        less = 0.5 * (middle + stretched) < place
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    return np.clip(0.5 * (low + high), 1e-6, 1.0)


def integrals(cosine: Any, alpha: Any, nodes: int = _NODES) -> tuple[Any, Any]:
    """(E, B) by quadrature: Gauss–Legendre over the caps' heights, evenly around. Both of the arrays' common shape."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    turn = 2.0 * np.pi * (np.arange(nodes) + 0.5) / nodes
    u, phi = np.meshgrid(0.5 * (x + 1.0), turn, indexing="ij")
    weight = np.broadcast_to(0.5 * w[:, None] / nodes, u.shape)
    mu, a = (y[..., None, None] for y in np.broadcast_arrays(np.asarray(cosine, float), np.asarray(alpha, float)))
    sine = np.sqrt(1.0 - mu * mu)
    length = np.sqrt((a * sine) ** 2 + mu * mu)
    z = (1.0 - u) * (1.0 + mu / length) - mu / length
    flat = np.sqrt(np.clip(1.0 - z * z, 0.0, 1.0))
    h = np.stack([a * (flat * np.cos(phi) + a * sine / length), a * (flat * np.sin(phi)), z + mu / length])
    h /= np.sqrt((h * h).sum(axis=0))
    along = sine * h[0] + mu * h[2]
    out = 2.0 * along * h[2] - mu

    def hidden(c: Any) -> Any:
        return 0.5 * (np.sqrt(1.0 + a * a * (1.0 - c * c) / (c * c)) - 1.0)

    lit = np.where(out > 0.0, (1.0 + hidden(mu)) / (1.0 + hidden(mu) + hidden(np.clip(out, 1e-9, 1.0))), 0.0) * weight
    return lit.sum(axis=(-2, -1)), (lit * np.clip(1.0 - along, 0.0, 1.0) ** 5).sum(axis=(-2, -1))
