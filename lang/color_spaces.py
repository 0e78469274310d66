"""Colour spaces by name: their primaries, white points and transfer functions, and the matrices between them in closed form.

Names are those of the Color Interop Forum (OpenUSD, OpenEXR), of MaterialX, and of the configurations of ACES and Blender.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]  # on columns of red, green and blue
Chromaticities = tuple[float, float, float, float, float, float, float, float]  # x and y of red, green, blue and white

D65, ACES_WHITE = (0.3127, 0.3290), (0.32168, 0.33767)
REC709: Chromaticities = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *D65)
REC2020: Chromaticities = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *D65)
P3: Chromaticities = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *D65)
ADOBE: Chromaticities = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *D65)
AP1: Chromaticities = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *ACES_WHITE)
AP0: Chromaticities = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, *ACES_WHITE)
SAME = 2e-4  # difference of chromaticities that files round away
LINEAR, SRGB = 1.0, 0.0  # transfer functions; others are the exponent of a power
_ADOBE_GAMMA = 563 / 256
_BRADFORD: Matrix = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))


@dataclass(frozen=True, slots=True)
class ColorSpace:
    """A colour space: linear light is encoded by `transfer`. Data have no primaries: their numbers are read as they are."""

    name: str
    primaries: Chromaticities | None
    transfer: float = LINEAR


_ROWS = (
    (
        ColorSpace("lin_rec709", REC709),
        "linear rec709 lin_srgb lin_rec709_scene linear_srgb linear_rec709 linear_rec709_srgb utility_linear_srgb",
    ),
    (ColorSpace("srgb", REC709, SRGB), "srgb_texture srgb_rec709_scene srgb_encoded_rec709_srgb utility_srgb_texture srgb_rec709_display"),
    (ColorSpace("lin_rec2020", REC2020), "rec2020 lin_rec2020_scene linear_rec2020 utility_linear_rec2020"),
    (ColorSpace("acescg", AP1), "lin_ap1 lin_ap1_scene aces_acescg linear_ap1"),
    (ColorSpace("aces2065_1", AP0), "lin_ap0 lin_ap0_scene aces_aces2065_1 aces linear_ap0"),
    (ColorSpace("lin_p3d65", P3), "lin_p3d65_scene lin_displayp3 linear_p3_d65 utility_linear_p3_d65 linear_dci_p3_d65"),
    (ColorSpace("lin_adobergb", ADOBE), "lin_adobergb_scene linear_adobergb utility_linear_adobergb"),
    (ColorSpace("srgb_p3d65", P3, SRGB), "srgb_p3d65_scene srgb_displayp3 display_p3 srgb_p3d65_display"),
    (ColorSpace("srgb_ap1", AP1, SRGB), "srgb_ap1_scene srgb_encoded_ap1"),
    (ColorSpace("g22_rec709", REC709, 2.2), "g22_rec709_scene gamma_2_2_rec709 gamma_2_2_encoded_rec709 gamma22"),
    (ColorSpace("g18_rec709", REC709, 1.8), "g18_rec709_scene gamma_1_8_rec709 gamma_1_8_encoded_rec709 gamma18"),
    (ColorSpace("rec709_display", REC709, 2.4), "g24_rec709_scene rec1886 rec_1886_rec709 gamma_2_4_rec709 gamma24"),
    (ColorSpace("g22_ap1", AP1, 2.2), "g22_ap1_scene gamma_2_2_encoded_ap1"),
    (ColorSpace("g18_ap1", AP1, 1.8), "g18_ap1_scene gamma_1_8_encoded_ap1"),
    (ColorSpace("adobergb", ADOBE, _ADOBE_GAMMA), "g22_adobergb_scene adobe_rgb_1998"),
    (ColorSpace("raw", None), "data non_color noncolor utility_raw identity none"),
)  # fmt: skip


def _plain(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())


_BY_NAME = {_plain(name): space for space, others in _ROWS for name in (space.name, *others.split())}
NAMES = ("srgb", "linear", "rec2020", "acescg", "raw", *(space.name for space, _ in _ROWS[4:-1]))
"""Names to write in scenes."""
WORKING = {"rec709": REC709, "rec2020": REC2020, "acescg": AP1}
"""Primaries of the spaces in which light is computed."""


def find(name: str) -> ColorSpace | None:
    """The space of a name, whose case, blanks and punctuation do not count; None where it is not known."""
    return _BY_NAME.get(_plain(name))


@lru_cache(maxsize=64)
def matrix(source: Chromaticities, target: Chromaticities) -> Matrix:
    """From linear colours of some primaries to those of others; white stays white, by Bradford's adaptation.

    Raises ValueError for chromaticities that are not of a colour space.
    """
    if source == target:
        return ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    adapted = _adaptation(source[6:], target[6:])
    return _product(_inverse(to_xyz(target)), _product(adapted, to_xyz(source)))


def are_same(a: Chromaticities, b: Chromaticities) -> bool:
    """Whether two sets of chromaticities differ by rounding alone."""
    return all(abs(p - q) <= SAME for p, q in zip(a, b, strict=True))


def named(chromaticities: Chromaticities) -> str:
    """The name of a linear space of these primaries; "" where it has none."""
    return next((s.name for s, _ in _ROWS if s.primaries and s.transfer == LINEAR and are_same(s.primaries, chromaticities)), "")


def to_xyz(primaries: Chromaticities) -> Matrix:
    """From linear red, green and blue to CIE XYZ, in which white has a Y of 1."""
    if not all(math.isfinite(v) and abs(v) <= 10.0 for v in primaries) or min(abs(y) for y in primaries[1::2]) < 1e-6:
        raise ValueError("chromaticities are not of a colour space")
    r, g, b, white = ((x / y, 1.0, (1.0 - x - y) / y) for x, y in zip(primaries[::2], primaries[1::2], strict=True))
    columns: Matrix = ((r[0], g[0], b[0]), (r[1], g[1], b[1]), (r[2], g[2], b[2]))
    scale = _times(_inverse(columns), white)
    if min(abs(s) for s in scale) < 1e-6:
        raise ValueError("chromaticities are not of a colour space")
    return _product(columns, _diagonal(scale))


def _adaptation(source: Sequence[float], target: Sequence[float]) -> Matrix:
    (sx, sy), (tx, ty) = source, target
    if not math.isfinite(sx + sy) or abs(sy) < 1e-6:
        raise ValueError("chromaticities are not of a colour space")
    before, after = (_times(_BRADFORD, (x / y, 1.0, (1.0 - x - y) / y)) for x, y in ((sx, sy), (tx, ty)))
    if min(map(abs, before)) < 1e-9:
        raise ValueError("chromaticities are not of a colour space")
    ratios = _diagonal((after[0] / before[0], after[1] / before[1], after[2] / before[2]))
    return _product(_inverse(_BRADFORD), _product(ratios, _BRADFORD))


def _diagonal(values: Row) -> Matrix:
    return ((values[0], 0.0, 0.0), (0.0, values[1], 0.0), (0.0, 0.0, values[2]))


def _times(m: Matrix, v: Row) -> Row:
    x, y, z = (sum(a * b for a, b in zip(row, v, strict=True)) for row in m)
    return (x, y, z)


def _product(a: Matrix, b: Matrix) -> Matrix:
    x, y, z = (_times(a, (b[0][k], b[1][k], b[2][k])) for k in range(3))
    return ((x[0], y[0], z[0]), (x[1], y[1], z[1]), (x[2], y[2], z[2]))


def _inverse(m: Matrix) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = m
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if abs(determinant) < 1e-9:
        raise ValueError("chromaticities are not of a colour space")
    s = 1.0 / determinant
    return (
        ((e * i - f * h) * s, (c * h - b * i) * s, (b * f - c * e) * s),
        ((f * g - d * i) * s, (a * i - c * g) * s, (c * d - a * f) * s),
        ((d * h - e * g) * s, (b * g - a * h) * s, (a * e - b * d) * s),
    )
