"""Pearson's test of directions against the density they claim, over equal cells of cosine and turn about +y (oracle 34)."""

from __future__ import annotations

import math

import numpy as np

BANDS, TURNS = 12, 16
FINE = 24  # points of each cell's integral, along both sides; more where densities end sharply


def chi2(directions, counted, density, least=0.01, tests=50, fine=FINE):
    """Fails where `directions` (x, y, z) of `counted` lanes are not spread as density(directions) says: p < least / tests (Šidák).

    Counts are of all lanes; the density's integral over the sphere is the share of lanes that count.
    """
    x, y, z = (np.asarray(c) for c in directions)
    total = len(y)
    band = np.minimum(((y[counted] + 1) / 2 * 2 * BANDS).astype(int), 2 * BANDS - 1)
    turn = ((np.arctan2(z, x)[counted] + math.pi) / (2 * math.pi) * TURNS).astype(int) % TURNS
    seen = np.bincount(band * TURNS + turn, minlength=2 * BANDS * TURNS)
    nodes, weights = np.polynomial.legendre.leggauss(fine)
    nodes, weights = (nodes + 1) / 2, weights / 2
    cosine = -1 + (np.arange(2 * BANDS)[:, None] + nodes) / BANDS
    phi = -math.pi + (np.arange(TURNS)[:, None] + nodes) * 2 * math.pi / TURNS
    c, p = np.meshgrid(cosine.ravel(), phi.ravel(), indexing="ij")
    sine = np.sqrt(1 - c * c)
    values = np.asarray(density((sine * np.cos(p), c, sine * np.sin(p)))).reshape(2 * BANDS, fine, TURNS, fine)
    expected = np.einsum("bitj,i,j->bt", values, weights, weights).ravel() * (1 / BANDS) * (2 * math.pi / TURNS) * total
    small = expected < 5.0  # cells of less than five count as one
    e = np.append(expected[~small], expected[small].sum())
    n = np.append(seen[~small], seen[small].sum())
    assert n[-1] <= e[-1] + 5.0 * math.sqrt(e[-1]) + 3.0, f"{n[-1]} directions where {e[-1]:.3g} were expected"
    e, n = e[:-1], n[:-1]
    statistic, freedom = float(np.sum((n - e) ** 2 / e)), len(e)
    # Wilson and Hilferty 1931: the cube root of χ²/k is nearly normal.
    normal = ((statistic / freedom) ** (1 / 3) - (1 - 2 / (9 * freedom))) / math.sqrt(2 / (9 * freedom))
    p_value = 0.5 * math.erfc(normal / math.sqrt(2))
    limit = 1 - (1 - least) ** (1 / tests)
    assert p_value > limit, f"χ² = {statistic:.1f} of {freedom}: p = {p_value:.2g}"
    off = abs(float(expected.sum()) / total - counted.mean())
    assert off < 0.005, f"the density's integral is {off:.3g} off the share of directions that count"
