"""Reflectance of metals from measured complex indices of refraction, as linear Rec.709 under D65.

n + ik of gold, silver and copper: Johnson and Christy 1972, Optical Constants of the Noble Metals. Of iron, titanium, chromium and
nickel: Johnson and Christy 1974, Optical constants of transition metals. Of aluminium: Rakić 1995, Algorithm for the determination of
intrinsic optical constants of metal films. Data from refractiveindex.info's database (public domain, CC0).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...compiler.scene.row_records import Color
from .spectrum import color_of

F64 = NDArray[np.float64]

_NOBLE = (397.4, 413.3, 430.5, 450.9, 471.4, 495.9, 520.9, 548.6, 582.1, 616.8, 659.5, 704.5, 756.0)  # nm
_OTHERS = (397, 413, 431, 451, 471, 496, 521, 549, 582, 617, 659, 704, 756)
_RAKIC = (364.66, 413.28, 442.8, 476.87, 516.6, 563.57, 619.93, 652.25, 688.81, 729.32, 774.91)
MEASURED: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = {  # wavelengths, n, k
    "gold": (
        _NOBLE, (1.47, 1.46, 1.45, 1.38, 1.31, 1.04, 0.62, 0.43, 0.29, 0.21, 0.14, 0.13, 0.14),
        (1.952, 1.958, 1.948, 1.914, 1.849, 1.833, 2.081, 2.455, 2.863, 3.272, 3.697, 4.103, 4.542),
    ),
    "silver": (
        _NOBLE, (0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05, 0.06, 0.05, 0.06, 0.05, 0.04, 0.03),
        (2.070, 2.275, 2.462, 2.657, 2.869, 3.093, 3.324, 3.586, 3.858, 4.152, 4.483, 4.838, 5.242),
    ),
    "copper": (
        _NOBLE, (1.32, 1.28, 1.25, 1.24, 1.25, 1.22, 1.18, 1.02, 0.70, 0.30, 0.22, 0.21, 0.24),
        (2.116, 2.207, 2.305, 2.397, 2.483, 2.564, 2.608, 2.577, 2.704, 3.205, 3.747, 4.205, 4.665),
    ),
    "aluminium": (
        _RAKIC, (0.39877, 0.52135, 0.60790, 0.72780, 0.87340, 1.0728, 1.3660, 1.5724, 1.8301, 2.1606, 2.6154),
        (4.3957, 5.0008, 5.3676, 5.7781, 6.2418, 6.7839, 7.4052, 7.7354, 8.0601, 8.3565, 8.4914),
    ),
    "iron": (
        _OTHERS, (2.24, 2.35, 2.48, 2.59, 2.67, 2.74, 2.86, 2.95, 2.94, 2.88, 2.92, 2.86, 2.87),
        (2.58, 2.65, 2.71, 2.77, 2.82, 2.88, 2.91, 2.93, 2.99, 3.05, 3.10, 3.19, 3.28),
    ),
    "titanium": (
        _OTHERS, (2.08, 2.14, 2.21, 2.27, 2.32, 2.36, 2.44, 2.54, 2.60, 2.67, 2.76, 2.86, 3.00),
        (2.95, 2.98, 3.01, 3.04, 3.10, 3.19, 3.30, 3.43, 3.58, 3.72, 3.84, 3.96, 4.01),
    ),
    "chromium": (
        _OTHERS, (2.00, 2.08, 2.19, 2.33, 2.51, 2.75, 2.94, 3.18, 3.22, 3.17, 3.09, 3.05, 3.08),
        (2.83, 2.93, 3.04, 3.14, 3.24, 3.30, 3.33, 3.33, 3.30, 3.30, 3.34, 3.39, 3.42),
    ),
    "nickel": (
        _OTHERS, (1.72, 1.70, 1.71, 1.73, 1.78, 1.82, 1.85, 1.92, 1.96, 1.99, 1.99, 2.06, 2.13),
        (2.57, 2.69, 2.82, 2.95, 3.09, 3.25, 3.42, 3.61, 3.80, 4.02, 4.26, 4.50, 4.73),
    ),
}  # fmt: skip
ALIASES = {"steel": "iron", "chrome": "chromium"}  # steel equals iron within 1 or 2 %
LOWEST = 1.0 / 7.0  # cosine at which the reflectance of metals is least (render/material/principled.py)

@cache
def reflectance(name: str) -> tuple[Color, Color]:
    """(f0, edge) of a metal: its reflectance along the normal, and the factor that scales Schlick's law at LOWEST.

    Both are integrated over wavelengths, so each colour is exact at both angles. Values are clipped to 0…1.
    """
    waves = np.arange(380.0, 781.0, 5.0)
    n, k = index(name, waves)
    f0, least = (np.clip(color_of(waves, conductor(n, k, cosine)), 0.0, 1.0) for cosine in (1.0, LOWEST))
    schlick = f0 + (1.0 - f0) * (1.0 - LOWEST) ** 5
    r, g, b = f0.tolist()
    er, eg, eb = np.clip(least / schlick, 0.0, 1.0).tolist()
    return (r, g, b), (er, eg, eb)


def index(name: str, waves: F64) -> tuple[F64, F64]:
    """(n, k) of a metal at wavelengths in nm, linearly interpolated."""
    wavelengths, n, k = MEASURED[ALIASES.get(name, name)]
    return np.interp(waves, wavelengths, n), np.interp(waves, wavelengths, k)


def conductor(n: F64, k: F64, cosine: float) -> F64:
    """Fresnel reflectance of a conductor in air for unpolarised light (Born and Wolf, Principles of Optics, §14.2)."""
    inside = np.sqrt((n + 1j * k) ** 2 - (1.0 - cosine * cosine))
    across = (cosine - inside) / (cosine + inside)
    square = (n + 1j * k) ** 2
    along = (square * cosine - inside) / (square * cosine + inside)
    return 0.5 * (np.abs(across) ** 2 + np.abs(along) ** 2)
