"""Reflectances of generalized_schlick_bsdf as the F82 model of metals: a colour, a tint at 81.8° and a scale of all angles.

Its reflectance is that of MaterialX (mx_fresnel_hoffman_schlick): F₀ + (F₉₀ − F₀)(1 − c)^p − a c (1 − c)⁶, where a makes it F₈₂ times the
first two terms at c = 1/7. With F₉₀ grey and p = 5 the model of metals is the same, scaled by F₉₀.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ....scene.row_records import Color, as_color
from .arithmetic import numbers

KEY = "schlick"  # of a slab: (reflectance at normal incidence, whether grazing light is white by a power of 5, weight)
VISIBLE = 0.01  # a smaller error of a reflectance is not told
_EDGE = 1.0 / 7.0
_COSINES = np.linspace(0.0, 1.0, 65)[:, None]


@dataclass(frozen=True, slots=True)
class Fit:
    """A metal. `error` is its greatest difference of reflectance over angles and colours."""

    color: Color
    tint: Color
    scale: float
    error: float


def is_plain(grazing: Any, exponent: Any) -> bool:
    """Whether grazing light is reflected whole, by a power of 5."""
    white, power = numbers(grazing), numbers(exponent)
    return white is not None and power is not None and np.abs(white - 1.0).max() < 1e-6 and abs(float(power.max()) - 5.0) < 1e-6


def fitted(normal: Any, edge: Any, grazing: Any, exponent: Any) -> Fit | None:
    """The metal that has the reflectances at 0° and 81.8°, and at 90° the greatest channel of `grazing`; None beside textures."""
    values = [numbers(source) for source in (normal, edge, grazing, exponent)]
    if any(value is None for value in values):
        return None
    f0, f82, f90 = (np.maximum(np.broadcast_to(np.asarray(value), 3), 0.0) for value in values[:3])
    power = max(float(np.max(np.asarray(values[3]))), 1e-3)
    scale = float(np.clip(max(f90.max(), f0.max()), 1e-6, 1.0))
    color = np.clip(f0 / scale, 0.0, 1.0)
    white = np.ones(3)
    target = reflectance(np.array([[_EDGE]]), f0, f82, f90, power)[0]
    tint = np.clip(target / scale / reflectance(np.array([[_EDGE]]), color, white, white, 5.0)[0], 0.0, 1.0)
    drawn = scale * reflectance(_COSINES, color, tint, white, 5.0)
    error = float(np.abs(drawn - np.clip(reflectance(_COSINES, f0, f82, f90, power), 0.0, 1.0)).max())
    return Fit(as_color(color.tolist()), as_color(tint.tolist()), scale, error)


def reflectance(cosine: Any, f0: Any, f82: Any, f90: Any, power: float) -> np.ndarray:
    """MaterialX' reflectances (n, 3) at cosines (n, 1)."""
    at_edge = f0 + (f90 - f0) * (1.0 - _EDGE) ** power
    dip = at_edge * (1.0 - f82) / (_EDGE * (1.0 - _EDGE) ** 6)
    return f0 + (f90 - f0) * (1.0 - cosine) ** power - dip * cosine * (1.0 - cosine) ** 6
