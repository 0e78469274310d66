"""Spectra as colours: the response of linear red, green and blue to light of a wavelength, by the CIE 1931 observer and D65."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
FIRST, LAST = 380.0, 780.0  # nm

# CIE standard illuminant D65, 380 to 780 nm by 10 (CIE 15:2004, table T.1).
_D65 = (
    49.9755, 54.6482, 82.7549, 91.4860, 93.4318, 86.6823, 104.865, 117.008, 117.812, 114.861, 115.923, 108.811, 109.354, 107.802, 104.790,
    107.689, 104.405, 104.046, 100.000, 96.3342, 95.7880, 88.6856, 90.0062, 89.5991, 87.6987, 83.2886, 83.6992, 80.0268, 80.2146, 82.2778,
    78.2842, 69.7213, 71.6091, 74.3490, 61.6040, 69.8856, 75.0870, 63.5927, 46.4182, 66.8054, 63.3828,
)  # fmt: skip
_REC709 = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]])


def color_of(waves: F64, spectrum: F64) -> F64:
    """(3,) linear Rec.709 of a reflectance spectrum under D65 at wavelengths in nm; a constant 1 is exactly white."""
    matching = _lit_matching(waves)
    return (_REC709 @ (matching @ spectrum)) / (_REC709 @ matching.sum(axis=1))


def response(waves: F64) -> F64:
    """(3, n) linear Rec.709 of the light of D65 at wavelengths in nm, up to a factor."""
    return _REC709 @ _lit_matching(waves)


def _lit_matching(waves: F64) -> F64:
    return _matching(waves) * np.interp(waves, np.arange(FIRST, LAST + 1.0, 10.0), _D65)


def _matching(waves: F64) -> F64:
    """(3, n) CIE 1931 colour matching functions, approximation by Wyman, Sloan and Shirley 2013 (Simple Analytic Approximations)."""

    def bump(middle: float, below: float, above: float) -> F64:
        away = (waves - middle) * np.where(waves < middle, below, above)
        return np.exp(-0.5 * away * away)

    x = 1.056 * bump(599.8, 0.0264, 0.0323) + 0.362 * bump(442.0, 0.0624, 0.0374) - 0.065 * bump(501.1, 0.0490, 0.0382)
    y = 0.821 * bump(568.8, 0.0213, 0.0247) + 0.286 * bump(530.9, 0.0613, 0.0322)
    z = 1.217 * bump(437.0, 0.0845, 0.0278) + 0.681 * bump(459.0, 0.0385, 0.0725)
    return np.stack([x, y, z])
