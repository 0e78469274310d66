"""Tables of the light that GGX facets send on after two bounces and more: where it leaves, and its colour.

The lobe of further bounces is a wide GGX lobe (`energy_compensation.spread_alpha`) times h(μₒ) h(μᵢ) exp(r₀ + r₁ y + r₂ y²), where
y = α₂² cos²/(sin² + α₂² cos²) of the half vector and of the wide lobe's roughness α₂. The coefficients depend on α, μₒ and μᵢ. They are
fitted to random walks on the microsurface (Heitz et al. 2016) by tools/further_bounces.py, which writes further_bounces.json.

The colour is G (c + (1 − c) F (1 − ρ)/(1 − ρ F)): walks of two bounces are the share c of further ones, and those of three and more a
geometric series. G is the mean product of the reflectances of walks of two bounces, and F the mean reflectance of further facets. So a
white metal has the colour 1.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..jit.kernel import helper
from ..lanes import ops, row_gather
from ..types import Lane, Vec

COLUMNS = 10  # of directions
ROWS = 9  # of roughness, by its root √√α
FIRST = 0.5  # root of the first row; less rough facets use it
NUMBERS = 8  # of a pair: r₀ r₁ r₂ s₀ s₁ c₀ c₁ v

F64 = NDArray[np.float64]
Eight = tuple[Lane, Lane, Lane, Lane, Lane, Lane, Lane, Lane]


def alphas() -> F64:
    """Return (ROWS,) α of each row."""
    return np.linspace(FIRST, 1.0, ROWS) ** 4


@lru_cache(maxsize=1)
def table() -> F64:
    """Return (ROWS · COLUMNS · COLUMNS, NUMBERS) coefficients by roughness and the columns of both directions."""
    rows = np.array(json.loads((Path(__file__).parent / "further_bounces.json").read_text(encoding="utf-8")), np.float64)
    return np.ascontiguousarray(rows.reshape(-1, NUMBERS))


@helper
def pair(coefficients: Any, out: Lane, into: Lane, alpha: Lane, y: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(factor of the wide lobe, s, v, c) for the columns, 0 to 1, of two directions: see `colour`."""
    place = ops.maximum(ops.sqrt(ops.sqrt(alpha)) - FIRST, 0.0) * ((ROWS - 1.0) / (1.0 - FIRST))
    row = ops.minimum(ops.floor_int(place), ROWS - 2)
    out, into = out * (COLUMNS - 1.0), into * (COLUMNS - 1.0)
    i, j = ops.minimum(ops.floor_int(out), COLUMNS - 2), ops.minimum(ops.floor_int(into), COLUMNS - 2)
    part, x, z = place - ops.to_float(row), out - ops.to_float(i), into - ops.to_float(j)
    first = (row * COLUMNS + i) * COLUMNS + j
    upper = _row(coefficients, first, x, z)
    below = _row(coefficients, first + COLUMNS * COLUMNS, x, z)
    r0, r1, r2, s0, s1, c0, c1, v = _lerp(upper, below, part)
    return ops.exp(r0 + y * (r1 + y * r2)), ops.clip(s0 + y * s1, 0.0, 1.0), v, ops.clip(c0 + y * c1, 0.0, 1.0)


@helper
def _row(coefficients: Any, first: Lane, x: Lane, z: Lane) -> Eight:
    near = _lerp(row_gather.eight_at(coefficients, first, 0), row_gather.eight_at(coefficients, first + 1, 0), z)
    first = first + COLUMNS
    return _lerp(near, _lerp(row_gather.eight_at(coefficients, first, 0), row_gather.eight_at(coefficients, first + 1, 0), z), x)


@helper
def _lerp(a: Eight, b: Eight, x: Lane) -> Eight:
    return (
        ops.lerp(a[0], b[0], x), ops.lerp(a[1], b[1], x), ops.lerp(a[2], b[2], x), ops.lerp(a[3], b[3], x), ops.lerp(a[4], b[4], x),
        ops.lerp(a[5], b[5], x), ops.lerp(a[6], b[6], x), ops.lerp(a[7], b[7], x),
    )  # fmt: skip


def of_row(coefficients: F64, out: F64, into: F64, alpha: float, y: F64) -> tuple[F64, F64, F64, F64]:
    """As `pair`, for one roughness and (n, 1, 1) `out` beside (n, …) `into` and y."""
    place = max(alpha**0.25 - FIRST, 0.0) * ((ROWS - 1.0) / (1.0 - FIRST))
    row = min(int(place), ROWS - 2)
    rows = coefficients.reshape(ROWS, COLUMNS, COLUMNS, NUMBERS)
    values = rows[row] + (rows[row + 1] - rows[row]) * (place - row)
    at = out.ravel() * (COLUMNS - 1.0)
    i = np.minimum(at.astype(np.int64), COLUMNS - 2)
    lines = (values[i] + (values[i + 1] - values[i]) * (at - i)[:, None, None]).reshape(-1, NUMBERS)
    at = into * (COLUMNS - 1.0)
    j = np.minimum(at.astype(np.int64), COLUMNS - 2)
    first = (np.arange(len(out)) * COLUMNS)[:, None, None] + j
    r0, r1, r2, s0, s1, c0, c1, v = np.moveaxis(lines[first] + (lines[first + 1] - lines[first]) * (at - j)[..., None], -1, 0)
    return np.exp(r0 + y * (r1 + y * r2)), np.clip(s0 + y * s1, 0.0, 1.0), v, np.clip(c0 + y * c1, 0.0, 1.0)


@helper
def colour(f0: Vec, f90: Lane, bend: Vec, alpha: Lane, s: Lane, v: Lane, c: Lane) -> Vec:
    """Return the share of the light of further bounces that is not absorbed: 1 at reflectance 1.

    s is the mean of Schlick's (1 − cos)⁵ over the facets of walks of two bounces, v the mean product of both terms less s², and c the share
    of such walks. The Schlick term of longer walks, the dip of metals and the ratio of the series are fitted to walks.
    """
    later = ops.minimum(0.204 - 0.126 * alpha + (2.337 - 1.45 * alpha) * s, 1.0)
    dip, dip_later = s * ops.maximum(0.185 - 0.265 * s, 0.0), later * ops.maximum(0.185 - 0.265 * later, 0.0)
    terms = s, later, v, dip, dip_later, c
    return _share(f0[0], f90, bend[0], terms), _share(f0[1], f90, bend[1], terms), _share(f0[2], f90, bend[2], terms)


@helper
def _share(f0: Lane, f90: Lane, bend: Lane, terms: tuple[Lane, Lane, Lane, Lane, Lane, Lane]) -> Lane:
    s, later, v, dip, dip_later, c = terms
    rise, again = f90 - f0, 0.739 * (1.0 - c)
    first, more = ops.maximum(f0 + rise * s - bend * dip, 0.0), ops.maximum(f0 + rise * later - bend * dip_later, 0.0)
    twice = ops.maximum(first * first + rise * rise * v, 0.0)
    return twice * (c + (1.0 - c) * more * (1.0 - again) / (1.0 - more * again))
