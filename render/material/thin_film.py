"""Reflectance of a boundary under a thin film, in red, green and blue.

Airy's sum of all reflections in the film is a Fourier series of the phase. Each term is integrated over the visible spectrum by Gaussian
fits of the colour matching functions (Belcour and Barla 2017, A Practical Extension to Microfacet Theory for the Modeling of Varying
Iridescence). Both polarizations count, with real indices of refraction. The spectrum is flat, and flat reflectances are grey.
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

TERMS = 3
# Gaussian fits of the colour matching functions, by wave number in 1/µm: height at an integral of 1, centre, width.
_X, _X2, _Y, _Z = (0.8461, 1.6810, 4.3278e-3), (0.1539, 2.2399, 4.5282e-3), (1.0, 1.7953, 9.3046e-3), (1.0, 2.2084, 6.6121e-3)
# XYZ to linear Rec. 709, with rows divided by their sums: a flat spectrum is grey.
_RED, _GREEN = (3.2404542 / 1.2047843, -1.5371385 / 1.2047843, -0.4985314 / 1.2047843), (-0.969266, 1.8760108, 0.041556)
_GREEN = tuple(c / 0.9483008 for c in _GREEN)
_BLUE = (0.0556434 / 0.9088427, -0.2040259 / 0.9088427, 1.0572252 / 0.9088427)
LEAST = 1e-4


@helper
def _wave(phase: Lane, height: float, centre: float, width: float) -> Lane:
    return height * ops.cos(centre * phase) * ops.exp(-width * phase * phase)


@helper
def _color(phase: Lane) -> Vec:
    """∫ cos(phase · wave number) over the spectrum, in red, green and blue; `phase` is 2 π times a path in µm."""
    x = _wave(phase, _X[0], _X[1], _X[2]) + _wave(phase, _X2[0], _X2[1], _X2[2])
    y, z = _wave(phase, _Y[0], _Y[1], _Y[2]), _wave(phase, _Z[0], _Z[1], _Z[2])
    return (
        _RED[0] * x + _RED[1] * y + _RED[2] * z, _GREEN[0] * x + _GREEN[1] * y + _GREEN[2] * z, _BLUE[0] * x + _BLUE[1] * y + _BLUE[2] * z
    )  # fmt: skip


@helper
def reflectance(cosine: Lane, film: Lane, thickness: Lane, base: Vec) -> Vec:
    """Reflectance at a cosine of a base under a film, both by their indices relative to the outside, at least 1; thickness in µm."""
    sine = ops.maximum(1.0 - cosine * cosine, 0.0)
    inside = ops.sqrt(ops.maximum(1.0 - sine / (film * film), LEAST))
    path = (4.0 * math.pi) * film * thickness * inside
    unity, two, three = _color(path), _color(2.0 * path), _color(3.0 * path)
    along, across = (film * cosine - inside) / (film * cosine + inside), (cosine - film * inside) / (cosine + film * inside)
    return (
        _channel((inside, along, across), film, base[0], sine, (unity[0], two[0], three[0])),
        _channel((inside, along, across), film, base[1], sine, (unity[1], two[1], three[1])),
        _channel((inside, along, across), film, base[2], sine, (unity[2], two[2], three[2])),
    )  # fmt: skip


@helper
def _channel(first: Vec, film: Lane, base: Lane, sine: Lane, waves: Vec) -> Lane:
    """One channel: `first` has the cosine in the film and both amplitudes of its upper boundary."""
    inside, along, across = first
    bent = ops.sqrt(ops.maximum(1.0 - sine / (base * base), LEAST))
    lower_along = (base * inside - film * bent) / (base * inside + film * bent)
    lower_across = (film * inside - base * bent) / (film * inside + base * bent)
    return ops.clip(0.5 * (_sum(along, lower_along, waves) + _sum(across, lower_across, waves)), 0.0, 1.0)


@helper
def _sum(upper: Lane, lower: Lane, waves: Vec) -> Lane:
    """Airy's series of one polarization, from the amplitudes of both boundaries."""
    top, bottom = upper * upper, lower * lower
    passed, loop = 1.0 - top, -upper * lower
    back = passed * passed * bottom / (1.0 - top * bottom)
    return top + back + 2.0 * (back - passed) * loop * (waves[0] + loop * (waves[1] + loop * waves[2]))
