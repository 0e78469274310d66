"""The daylight sky of Preetham, Shirley and Smits 1999, "A Practical Analytic Model for Daylight" (SIGGRAPH), as a picture all around.

Its zenith and Perez's five-parameter course give luminance and chromaticity for a clear to hazy sky while the sun is up. `luminance` gives
the paper's absolute luminances. Pictures here are scaled so that the irradiance of a level surface is π.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
HEIGHT, WIDTH = 256, 512  # of the picture
HORIZON = 0.01  # cosine with the zenith below which the course is held, lest it divide by 0

# Rows Y, x, y; each of A to E is slope · T + constant (the paper's table 2).
_SLOPES = np.array([
    [0.1787, -0.3554, -0.0227, 0.1206, -0.0670],
    [-0.0193, -0.0665, -0.0004, -0.0641, -0.0033],
    [-0.0167, -0.0950, -0.0079, -0.0441, -0.0109],
])  # fmt: skip
_CONSTANTS = np.array([
    [-1.4630, 0.4275, 5.3251, -2.5771, 0.3703],
    [-0.2592, 0.0008, 0.2125, -0.8989, 0.0452],
    [-0.2608, 0.0092, 0.2102, -1.6537, 0.0529],
])  # fmt: skip
# Chromaticity of the zenith: (T², T, 1) · matrix · (θ³, θ², θ, 1).
_ZENITH_X = np.array([[0.00166, -0.00375, 0.00209, 0.0], [-0.02903, 0.06377, -0.03202, 0.00394], [0.11693, -0.21196, 0.06052, 0.25886]])
_ZENITH_Y = np.array([[0.00275, -0.00610, 0.00317, 0.0], [-0.04214, 0.08970, -0.04153, 0.00516], [0.15346, -0.26756, 0.06670, 0.26688]])
# CIE XYZ to linear Rec.709.
_TO_RGB = np.array([[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]])


def zenith(sun: float, turbidity: float) -> tuple[float, float, float]:
    """(luminance in nit, x, y) straight up, the sun `sun` radians from there."""
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * sun)
    luminance = (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192
    haze, angle = np.array([turbidity**2, turbidity, 1.0]), np.array([sun**3, sun**2, sun, 1.0])
    return 1000.0 * max(luminance, 0.0), float(haze @ _ZENITH_X @ angle), float(haze @ _ZENITH_Y @ angle)


def luminance(cosine: F64, to_sun: F64, sun: float, turbidity: float) -> tuple[F64, F64, F64]:
    """(luminance in nit, x, y) in directions by their cosine with the zenith and with the sun."""
    a, b, c, d, e = (_SLOPES * turbidity + _CONSTANTS).T[..., None]
    at_zenith = np.array(zenith(sun, turbidity))[:, None]

    def course(up: F64 | float, gamma: F64 | float) -> F64:
        return (1.0 + a * np.exp(b / up)) * (1.0 + c * np.exp(d * gamma) + e * np.cos(gamma) ** 2)

    gamma = np.arccos(np.clip(np.ravel(to_sun), -1.0, 1.0))
    values = at_zenith * course(np.maximum(np.ravel(cosine), HORIZON), gamma) / course(1.0, sun)
    shaped = values.reshape(3, *np.shape(cosine))
    return np.maximum(shaped[0], 0.0), shaped[1], shaped[2]


def picture(sun: F64, turbidity: float, ground: tuple[float, float, float]) -> NDArray[np.float32]:
    """(HEIGHT, WIDTH, 4) linear, as a dome's picture: its middle toward +z, +y up. `sun` is the unit direction it stands in.

    Below the horizon lies matt ground of this colour, lit in white with the illuminance of the sky.
    """
    latitude = np.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)[:, None]
    turn = 2.0 * np.pi * (0.5 - (np.arange(WIDTH) + 0.5) / WIDTH)[None]
    up = np.sin(latitude) + 0.0 * turn
    to_sun = np.cos(latitude) * (np.sin(turn) * sun[0] + np.cos(turn) * sun[2]) + up * sun[1]
    y, chroma_x, chroma_y = luminance(up, to_sun, math.acos(min(max(float(sun[1]), 0.0), 1.0)), turbidity)
    xyz = np.stack([chroma_x / chroma_y * y, y, (1.0 - chroma_x - chroma_y) / chroma_y * y], axis=-1)
    rgb = np.maximum(xyz @ _TO_RGB.T, 0.0)
    edges = np.sin(np.pi * (0.5 - np.arange(HEIGHT + 1) / HEIGHT))
    share = (2.0 * np.pi / WIDTH) * 0.5 * (np.maximum(edges[:-1], 0.0) ** 2 - np.maximum(edges[1:], 0.0) ** 2)  # cosine times solid angle
    level = np.einsum("h,hwc->c", share, rgb)  # irradiance of a level surface
    rgb = rgb / max(float(level @ LUMINANCE), 1e-300) * math.pi
    # E · ρ / π, where E's luminance is π: the ground lies in the sun, too, and both together are about white
    rgb = np.where(up[..., None] > 0.0, rgb, np.array(ground))
    return np.concatenate([rgb, np.ones((HEIGHT, WIDTH, 1))], axis=-1).astype(np.float32)


LUMINANCE = np.array([0.2126729, 0.7151522, 0.0721750])  # of linear Rec.709
