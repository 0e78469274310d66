"""Conversion of sRGB, HSV and black-body colours to scene-linear Rec.709."""

from __future__ import annotations

import math
from functools import lru_cache

from .elements import Color

KELVIN_RANGE = (800.0, 40_000.0)

# XYZ to linear Rec.709 with its D65 white point (IEC 61966-2-1).
_XYZ_TO_RGB = (
    (3.2404542, -1.5371385, -0.4985314),
    (-0.9692660, 1.8760108, 0.0415560),
    (0.0556434, -0.2040259, 1.0572252),
)
LUMINANCE = (0.2126729, 0.7151522, 0.0721750)  # Y of the Rec.709 primaries


def srgb_to_linear(encoded: float) -> float:
    """One channel of sRGB, 0..1, to linear light (IEC 61966-2-1)."""
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def from_hex(text: str) -> Color:
    """`#rgb` or `#rrggbb`, sRGB, to linear."""
    digits = text[1:] if len(text) == 7 else "".join(c + c for c in text[1:])
    r, g, b = (srgb_to_linear(int(digits[i : i + 2], 16) / 255) for i in (0, 2, 4))
    return (r, g, b)


def hsv_to_srgb(hue: float, saturation: float, value: float) -> Color:
    """HSV to encoded sRGB; hue in radians, the rest 0..1 (Smith 1978)."""

    def channel(n: int) -> float:
        k = (n + hue / (math.pi / 3)) % 6
        return value - value * saturation * max(0.0, min(k, 4 - k, 1.0))

    return (channel(5), channel(3), channel(1))


def to_hex(color: Color) -> str:
    """Linear to `#rrggbb`, clipped to 0..1."""

    def encode(v: float) -> int:
        v = min(max(v, 0.0), 1.0)
        return round(255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055))

    return "#" + "".join(f"{encode(v):02x}" for v in color)


def _lobe(wavelength: float, peak: float, below: float, above: float) -> float:
    t = (wavelength - peak) * (below if wavelength < peak else above)
    return math.exp(-0.5 * t * t)


def _observer(nm: float) -> tuple[float, float, float]:
    """The CIE 1931 colour matching functions, by the fits of Wyman, Sloan and Shirley (JCGT 2013)."""
    x = 1.056 * _lobe(nm, 599.8, 1 / 37.9, 1 / 31.0) + 0.362 * _lobe(nm, 442.0, 1 / 16.0, 1 / 26.7)
    x -= 0.065 * _lobe(nm, 501.1, 1 / 20.4, 1 / 26.2)
    y = 0.821 * _lobe(nm, 568.8, 1 / 46.9, 1 / 40.5) + 0.286 * _lobe(nm, 530.9, 1 / 16.3, 1 / 31.1)
    z = 1.217 * _lobe(nm, 437.0, 1 / 11.8, 1 / 36.0) + 0.681 * _lobe(nm, 459.0, 1 / 26.0, 1 / 13.8)
    return x, y, z


def temperature(color: Color) -> float | None:
    """The temperature in kelvin of a colour that `kelvin` gives, to about 1e-6; None for other colours."""
    if not color[0] > 0.0:
        return None
    part = 2 if color[2] > 0.0 else 1  # blue over red rises with the temperature; where there is no blue, green over red
    low, high = KELVIN_RANGE
    for _ in range(48):
        middle = math.sqrt(low * high)
        body = kelvin(middle)
        if body[part] / body[0] < color[part] / color[0]:
            low = middle
        else:
            high = middle
    return low if all(math.isclose(a, b, rel_tol=1e-5, abs_tol=1e-6) for a, b in zip(kelvin(low), color, strict=True)) else None


@lru_cache(maxsize=256)
def kelvin(temperature: float) -> Color:
    """The colour of a black body at `temperature` kelvin, of luminance 1, linear Rec.709.

    Planck's law integrated against the CIE 1931 observer from 360 to 830 nm. Below about 1900 K blue is negative in Rec.709
    and is clipped to 0.
    """
    xyz = [0.0, 0.0, 0.0]
    for nm in range(360, 831, 5):
        metres = nm * 1e-9
        radiance = metres**-5 / math.expm1(0.01438776877 / (metres * temperature))
        for i, weight in enumerate(_observer(nm)):
            xyz[i] += radiance * weight
    rgb = [max(0.0, sum(m * v for m, v in zip(row, xyz, strict=True))) for row in _XYZ_TO_RGB]
    luminance = sum(w * v for w, v in zip(LUMINANCE, rgb, strict=True))
    return (rgb[0] / luminance, rgb[1] / luminance, rgb[2] / luminance)
