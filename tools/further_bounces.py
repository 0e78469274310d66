"""Tabulates where light of further bounces between GGX facets leaves, by random walks on the microsurface.

python tools/further_bounces.py writes render/material/further_bounces.json. It takes 15 minutes of CPU.

Walks: Heitz, Hanika, d'Eon, Dachsbacher 2016, Multiple-Scattering Microfacet BSDFs with the Smith Model. Each facet that a walk meets adds
its chance to send light to each of many directions. Per row of roughness, coefficients at pairs of columns are fitted to the sums by least
squares, symmetric in both directions. Columns are those of `energy_compensation.column_of`. With y = α₂² cos²/(sin² + α₂² cos²) of the
half vector and α₂ of the wide lobe, the fitted quantities are:

- log(walks/wide lobe) = h(μₒ) + h(μᵢ) + r₀ + r₁ y + r₂ y², where h is free: Sinkhorn's scaling solves it again;
- the mean of Schlick's (1 − cos)⁵ over the facets of walks of two bounces: s₀ + s₁ y;
- the share of walks of two bounces among all further ones: c₀ + c₁ y;
- the mean product of both Schlick terms, less the squared mean: v.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numba
import numpy as np
from maquette.render.material import energy_compensation as table
from maquette.render.material import further_bounces

WALKS = 800_000  # a direction
COSINES, TURNS = 16, 12
MOST = 16  # bounces
FLOOR = 1e-3  # least cosine
SMOOTH = 2e-4  # weight of second differences between columns
PATH = Path(__file__).parents[1] / "render" / "material" / "further_bounces.json"

F64 = np.ndarray[Any, Any]


@numba.njit
def _smith(z: float, alpha: float) -> float:
    return 0.5 * (math.copysign(math.sqrt(1.0 + alpha * alpha * (1.0 - z * z) / (z * z)), z) - 1.0)


@numba.njit
def _walks(cosine: float, alpha: float, count: int, seed: int, cosines: F64, turns: F64, sums: F64) -> None:
    """Add to sums (cosines, turns, 4): f cos of two bounces, of three and more, of two by their mean Schlick term, by its product."""
    np.random.seed(seed)
    shadow = np.array([_smith(z, alpha) for z in cosines])
    flat = np.sqrt(1.0 - cosines * cosines)
    for _ in range(count):
        x, y, z = -math.sqrt(1.0 - cosine * cosine), 0.0, -cosine
        below, first = 1.0, 0.0  # share of heights below; Schlick term of the first facet
        for bounce in range(1, MOST + 1):
            draw = 1.0 - np.random.random()
            if abs(z) > 1e-7:
                smith = _smith(z, alpha)
                if z > 0.0 and draw < below**smith:
                    break
                below = min(below * draw ** (-1.0 / smith), 1.0)
            a, b, c = -x, -y, -z
            seen = max((1.0 + _smith(c, alpha)) * c, 1e-12) if abs(c) > 1e-7 else 0.5 * alpha
            if bounce > 1:
                log = math.log(max(below, 1e-300))
                for i in range(len(cosines)):
                    leaves = math.exp(shadow[i] * log) / (4.0 * seen)
                    for j in range(len(turns)):
                        h0, h1, h2 = a + flat[i] * math.cos(turns[j]), b + flat[i] * math.sin(turns[j]), c + cosines[i]
                        size = h0 * h0 + h1 * h1 + h2 * h2
                        along = a * h0 + b * h1 + c * h2
                        if h2 <= 0.0 or along <= 0.0:
                            continue
                        q = (h0 * h0 + h1 * h1 + alpha * alpha * h2 * h2) / size
                        f = leaves * alpha * alpha / (math.pi * q * q)
                        if bounce == 2:
                            sums[i, j, 0] += f
                            second = max(1.0 - along / math.sqrt(size), 0.0) ** 5
                            sums[i, j, 2] += f * 0.5 * (first + second)
                            sums[i, j, 3] += f * first * second
                        else:
                            sums[i, j, 1] += f
            s0, s1, s2 = alpha * a, alpha * b, c
            size = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
            s0, s1, s2 = s0 / size, s1 / size, s2 / size
            turn, up = 2.0 * math.pi * np.random.random(), (1.0 - np.random.random()) * (1.0 + s2) - s2
            side = math.sqrt(max(1.0 - up * up, 0.0))
            m0, m1, m2 = alpha * (side * math.cos(turn) + s0), alpha * (side * math.sin(turn) + s1), max(up + s2, 1e-12)
            size = math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
            m0, m1, m2 = m0 / size, m1 / size, m2 / size
            along = min(max(a * m0 + b * m1 + c * m2, 0.0), 1.0)
            if bounce == 1:
                first = (1.0 - along) ** 5
            x, y, z = 2.0 * along * m0 - a, 2.0 * along * m1 - b, 2.0 * along * m2 - c
            size = math.sqrt(x * x + y * y + z * z)
            x, y, z = x / size, y / size, z / size


def _sums(alpha: float, cosines: F64, turns: F64, count: int) -> F64:
    """(cosines, cosines, turns, 4) means of `_walks`, over the outgoing cosine and symmetric: BSDFs."""
    sums = np.zeros((COSINES, COSINES, TURNS, 4))
    for k, cosine in enumerate(cosines):
        _walks(cosine, alpha, count, k + 1, cosines, turns, sums[k])
    sums /= count * cosines[:, None, None]
    return 0.5 * (sums + sums.transpose(1, 0, 2, 3))


def _ggx(out: F64, into: F64, size: F64, alpha: float) -> F64:
    """GGX of reflectance 1 for `size` = sin² + α² cos² of the half vector."""
    smith = [0.5 * (np.sqrt(1.0 + alpha * alpha * (1.0 / (z * z) - 1.0)) - 1.0) for z in (out, into)]
    return alpha * alpha / (math.pi * size * size) / (4.0 * out * into * (1.0 + smith[0] + smith[1]))


def _between(columns: F64) -> F64:
    """(columns, COLUMNS) weights of linear interpolation."""
    place = columns * (further_bounces.COLUMNS - 1.0)
    return np.maximum(1.0 - np.abs(place[:, None] - np.arange(further_bounces.COLUMNS)), 0.0)


def _solve(parts: list[F64], values: F64, weight: F64, free: F64 | None = None) -> F64:
    """(len(parts), COLUMNS, COLUMNS) symmetric coefficients of `parts`, each (pairs, COLUMNS²); `free` are columns that are left out."""
    n = further_bounces.COLUMNS
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    fold = np.zeros((n * n, len(upper)))
    for k, (i, j) in enumerate(upper):
        fold[i * n + j, k] = fold[j * n + i, k] = 1.0
    bend = np.array([
        [(row == i * n + j - 1) + (row == i * n + j + 1) - 2.0 * (row == i * n + j) for row in range(n * n)]
        for i in range(n) for j in range(1, n - 1)
    ]) @ fold  # fmt: skip
    extra = np.zeros((len(values), 0)) if free is None else free
    left = np.concatenate([*(part @ fold for part in parts), extra], axis=1) * weight[:, None]
    smooth = np.kron(np.eye(len(parts)), bend) * math.sqrt(SMOOTH * np.sum(weight**2) / len(bend))
    ridge = np.eye(len(parts) * len(upper)) * math.sqrt(1e-6 * np.sum(weight**2) / len(upper))
    rest = np.concatenate([smooth, ridge])
    left = np.concatenate([left, np.pad(rest, ((0, 0), (0, extra.shape[1])))])
    right = np.concatenate([values * weight, np.zeros(len(rest))])
    solved = np.linalg.lstsq(left, right, rcond=None)[0]
    return np.stack([(fold @ solved[k * len(upper) : (k + 1) * len(upper)]).reshape(n, n) for k in range(len(parts))])


def row(alpha: float, count: int) -> F64:
    """(COLUMNS, COLUMNS, 8) coefficients of a roughness: r₀ r₁ r₂ s₀ s₁ c₀ c₁ v."""
    columns = 0.5 - 0.5 * np.cos(math.pi * (np.arange(COSINES) + 0.5) / COSINES)
    fine = table.cosines(np.array([alpha]), 4096)[0]
    cosines = np.maximum(np.interp(columns, np.linspace(0.0, 1.0, 4096), fine), FLOOR)
    columns = np.asarray(table.column_of(cosines, alpha))
    turns = math.pi * (1.0 - ((np.arange(TURNS) + 0.5) / TURNS) ** 1.5)
    twice, more, schlick, product = np.moveaxis(_sums(alpha, cosines, turns, count), -1, 0)
    out, into, turn = (x.reshape(shape) for x, shape in ((cosines, (-1, 1, 1)), (cosines, (1, -1, 1)), (turns, (1, 1, -1))))
    flat = np.sqrt(1.0 - out * out), np.sqrt(1.0 - into * into)
    side = flat[0] ** 2 + flat[1] ** 2 + 2.0 * flat[0] * flat[1] * np.cos(turn)
    up = (out + into) ** 2
    wide = float(table.spread_alpha(np.float64(alpha)))
    sizes = [(side + a * a * up) / (side + up) for a in (alpha, wide)]
    total, once = twice + more, _ggx(out, into, sizes[0], alpha)
    y = wide * wide * up / (side + up) / sizes[1]
    weight = (total / (total + once)).ravel()
    of = _between(columns)
    pairs = np.einsum("ik,jl->ijkl", of, of).reshape(COSINES, COSINES, 1, -1) * np.ones((TURNS, 1))
    parts = [(pairs * (y**k)[..., None]).reshape(len(weight), -1) for k in range(3)]
    free = np.eye(COSINES)[:, None, None, :] + np.eye(COSINES)[None, :, None, :] + np.zeros((TURNS, 1))
    ratio = np.log(np.maximum(total, 1e-12) / _ggx(out, into, sizes[1], wide)).ravel()
    r = _solve(parts, ratio, weight, free.reshape(len(weight), -1))
    mean = schlick / np.maximum(twice, 1e-12)
    s = _solve(parts[:2], mean.ravel(), weight)
    v = _solve(parts[:1], (product / np.maximum(twice, 1e-12) - mean * mean).ravel(), weight)
    c = _solve(parts[:2], (twice / np.maximum(total, 1e-12)).ravel(), weight)
    return np.moveaxis(np.concatenate([r, s, c, v]), 0, -1)


def main() -> None:
    """Write the tables."""
    rows = [np.round(row(float(alpha), WALKS), 3).tolist() for alpha in further_bounces.alphas()]
    PATH.write_text(json.dumps(rows, separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
