"""Writer of render/sampling/flake_tilts.json: quantiles of the tilts that turn narrow GGX facets into wider ones.

python tools/flake_tilts.py

Slopes of GGX facets are a bivariate t distribution, which is self-decomposable (Halgreen 1979): for each c < 1 some law of slopes S makes
S + c X of the same law as X. Its characteristic function is K₁(k)/(c K₁(c k)) for α = 1, and P(|S| < r) = r ∫ of it J₁(k r) dk.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from maquette.render.sampling import flake_tilts
from numpy.typing import NDArray

F64 = NDArray[np.float64]
FILE = Path(flake_tilts.__file__).with_suffix(".json")
STEPS = 60_000  # of the integral over k
DECAY = 24.0  # exponent at its end


def bessel_j1(x: F64) -> F64:
    """Return J₁ (Abramowitz and Stegun 9.4.4 and 9.4.6)."""
    y = (x / 3.0) ** 2
    small = x * (0.5 + y * (-0.56249985 + y * (0.21093573 + y * (-0.03954289 + y * (0.00443319 + y * (-0.00031761 + y * 0.00001109))))))
    z = 3.0 / np.maximum(x, 3.0)
    size = 0.79788456 + z * (0.00000156 + z * (0.01659667 + z * (0.00017105 + z * (-0.00249511 + z * (0.00113653 - z * 0.00020033)))))
    turn = -2.35619449 + z * (0.12499612 + z * (0.0000565 + z * (-0.00637879 + z * (0.00074348 + z * (0.00079824 - z * 0.00029166)))))
    return np.where(x < 3.0, small, size * np.cos(np.maximum(x, 3.0) + turn) / np.sqrt(np.maximum(x, 3.0)))


def bessel_k1(x: F64) -> F64:
    """Return x K₁(x) eˣ (Abramowitz and Stegun 9.8.3, 9.8.7 and 9.8.8)."""
    t = (np.minimum(x, 2.0) / 3.75) ** 2
    i1 = np.minimum(x, 2.0) * (
        0.5 + t * (0.87890594 + t * (0.51498869 + t * (0.15084934 + t * (0.02658733 + t * (0.00301532 + t * 0.00032411)))))
    )
    y = (np.minimum(x, 2.0) / 2.0) ** 2
    near = 1.0 + y * (0.15443144 + y * (-0.67278579 + y * (-0.18156897 + y * (-0.01919402 + y * (-0.00110404 - y * 0.00004686)))))
    small = np.exp(x.clip(max=2.0)) * (np.minimum(x, 2.0) * np.log(np.minimum(x, 2.0) / 2.0) * i1 + near)
    z = 2.0 / np.maximum(x, 2.0)
    large = np.sqrt(np.maximum(x, 2.0)) * (
        1.25331414 + z * (0.23498619 + z * (-0.0365562 + z * (0.01504268 + z * (-0.00780353 + z * (0.00325614 - z * 0.00068245)))))
    )
    return np.where(x <= 2.0, small, large)


def radial(c: float, radius: F64) -> F64:
    """P(|S| < radius) of the tilts that take facets from α = c to α = 1."""
    step = DECAY / (1.0 - c) / STEPS
    k: F64 = (np.arange(STEPS, dtype=np.float64) + 0.5) * step
    ratio = bessel_k1(k) / np.maximum(bessel_k1(c * k), 1e-300) * np.exp(-(1.0 - c) * k)
    return np.array([r * float(np.sum(ratio * bessel_j1(k * r))) * step for r in radius])


def row(c: float) -> list[float]:
    """The quantiles of one c, over those of a t distribution of the same tail."""
    places = flake_tilts.places()
    if c < 1e-6:
        return [1.0] * len(places)
    tail = np.sqrt(1.0 - c * c)
    radius = np.concatenate([[0.0], np.geomspace(1e-3 * (1.0 - c), 60.0 * tail, 500)])
    share = np.maximum.accumulate(np.clip(radial(c, radius), 0.0, 1.0))
    keep = np.concatenate([[True], np.diff(share) > 1e-7])
    plain = np.sqrt(places[1:-1] / (1.0 - places[1:-1])) * tail
    scales = np.interp(places[1:-1], share[keep], radius[keep]) / plain
    return [float(scales[0]), *scales.tolist(), 1.0]


def main() -> None:
    """Write the table."""
    table = [[round(value, 4) for value in row(float(c))] for c in flake_tilts.shares()]
    FILE.write_text(json.dumps(table, separators=(",", ":")) + "\n", encoding="utf-8")
    print(FILE.name, FILE.stat().st_size)


if __name__ == "__main__":
    main()
