"""Albedos of participating media: of single scattering, and of all scattering in a thick body.

Kulla and Conty 2017, Revisiting Physically Based Shading at Imageworks, §"Volumes": an albedo of single scattering from the colour that a
body has, as in glTF's KHR_materials_volume_scatter.
"""

from __future__ import annotations

import math

from .row_records import Color, MediumData


def extinction(medium: MediumData) -> Color:
    """Scattering and absorption together, per metre."""
    (a, b, c), (d, e, f) = medium.scattering, medium.absorption
    return (a + d, b + e, c + f)


def albedo(medium: MediumData) -> Color:
    """The share of scattering in the extinction; 0 where there is neither."""
    r, g, b = (s / t if t > 0.0 else 0.0 for s, t in zip(medium.scattering, extinction(medium), strict=True))
    return (r, g, b)


def by_extinction(extinction: Color, single: Color, anisotropy: float = 0.0) -> MediumData:
    """The medium of an extinction per metre and an albedo of single scattering."""
    (a, b, c), (r, g, s) = extinction, single
    return MediumData((a * r, b * g, c * s), (a * (1.0 - r), b * (1.0 - g), c * (1.0 - s)), anisotropy=anisotropy)


def single_from_multiple(color: Color, anisotropy: float = 0.0) -> Color:
    """The albedo of single scattering of a body of a colour from 0 to 1."""
    r, g, b = (_single(min(max(c, 0.0), 1.0), anisotropy) for c in color)
    return (r, g, b)


def multiple_from_single(single: Color, anisotropy: float = 0.0) -> Color:
    """The colour of a body, by its albedo of single scattering: the inverse of `single_from_multiple`."""
    r, g, b = (_multiple(c, anisotropy) for c in single)
    return (r, g, b)


_A, _B, _C, _D, _E = 4.09712, 4.20863, 9.59217, 41.6808, 17.7126


def _single(color: float, anisotropy: float) -> float:
    root = _A + _B * color - math.sqrt(_C + _D * color + _E * color * color)
    square = min(max(root, 0.0), 1.0) ** 2
    return (1.0 - square) / (1.0 - anisotropy * square)


def _multiple(single: float, anisotropy: float) -> float:
    """The root of a quadratic equation whose first coefficient is almost 0: the one that is bounded."""
    root = math.sqrt(max(1.0 - single, 0.0) / max(1.0 - anisotropy * single, 1e-12))
    a, b, c = _B * _B - _E, 2.0 * _B * (_A - root) - _D, (_A - root) ** 2 - _C
    return min(max(2.0 * c / (-b + math.sqrt(max(b * b - 4.0 * a * c, 0.0))), 0.0), 1.0)
