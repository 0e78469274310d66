"""Views by closed forms, which need no configuration: three roll highlights off; white balance adapts colours to daylight."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from ...lang import colors
from .srgb import encode_srgb

F64 = NDArray[np.float64]
STANDARD = "sRGB"  # no curve: light is clipped at 1

# AgX by Sobotka, its curve by a polynomial of degree 6 (Wrensch 2023).
_AGX_IN = np.array([
    [0.842479062253094, 0.0784335999999992, 0.0792237451477643],
    [0.0423282422610123, 0.878468636469772, 0.0791661274605434],
    [0.0423756549057051, 0.0784336, 0.879142973793104],
])  # fmt: skip
_AGX_LOW, _AGX_HIGH = -12.47393, 4.026069  # stops
_AGX_CURVE = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)
# The reference rendering and the output transform of ACES 1.0 by a rational function (Hill 2017).
_ACES_IN = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
_ACES_OUT = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
# Linear Rec.709 to XYZ, and XYZ to the cone responses of Bradford (Lindbloom).
_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]])
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


# The shoulder of Khronos PBR Neutral (2024), without its offset for the reflectance of dielectrics, which darkens shadows.
_SHOULDER, _FADING = np.float32(0.8), np.float32(0.15)
STEPS = 4096  # of the table from the display of AgX, which has a gamma of 2.2, to sRGB
_ENCODED = encode_srgb(np.linspace(0.0, 1.0, STEPS + 1) ** 2.2)


def agx(rgb: F64) -> F64:
    """Linear Rec.709 (…, 3) as sRGB, 0 to 1: highlights fade to white over 6.5 stops above middle grey."""
    light = _finite(rgb).astype(np.float32).reshape(-1, 3) @ _AGX_IN.T.astype(np.float32)
    place = (np.log2(np.maximum(light, np.float32(2.0**_AGX_LOW))) - np.float32(_AGX_LOW)) * np.float32(1.0 / (_AGX_HIGH - _AGX_LOW))
    place = np.minimum(place, np.float32(1.0))
    curve = np.full_like(place, _AGX_CURVE[0])
    for coefficient in _AGX_CURVE[1:]:
        curve = curve * place + np.float32(coefficient)
    display = np.clip(curve @ np.linalg.inv(_AGX_IN).T.astype(np.float32), 0.0, 1.0) * np.float32(STEPS)
    low = np.minimum(display.astype(np.int32), STEPS - 1)
    below = _ENCODED[low]
    return (below + (display - low) * (_ENCODED[low + 1] - below)).reshape(rgb.shape)


def rolloff(rgb: F64) -> F64:
    """Linear Rec.709 (…, 3) as sRGB, 0 to 1: colours up to 0.8 stay, brighter ones are compressed and fade to white."""
    light = np.maximum(_finite(rgb), 0.0).astype(np.float32)
    peak, room = np.maximum(light.max(axis=-1, keepdims=True), np.float32(1e-9)), np.float32(1.0) - _SHOULDER
    rolled = np.float32(1.0) - room * room / np.maximum(peak + room - _SHOULDER, room)
    white = np.float32(1.0) - np.float32(1.0) / (_FADING * (peak - rolled) + np.float32(1.0))
    faded = light * (rolled / peak)
    return encode_srgb(np.where(peak < _SHOULDER, light, faded + (rolled - faded) * white))


def aces(rgb: F64) -> F64:
    """Linear Rec.709 (…, 3) as sRGB, 0 to 1."""
    v = np.maximum(_finite(rgb), 0.0) @ _ACES_IN.T
    return encode_srgb(((v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)) @ _ACES_OUT.T)


CURVES = {"standard": encode_srgb, STANDARD: encode_srgb, "rolloff": rolloff, "agx": agx, "aces": aces}
"""Functions of linear light by the names of views."""


def _finite(rgb: F64) -> F64:
    return np.nan_to_num(np.asarray(rgb, np.float64), nan=0.0, posinf=1e6, neginf=0.0)


@functools.lru_cache(maxsize=16)
def white_balance(temperature: float) -> F64:
    """(3, 3) matrix on columns of linear Rec.709 that makes the light of a black body at `temperature` kelvin white, of equal luminance.

    Bradford's adaptation to D65.
    """
    cones = _BRADFORD @ _XYZ
    return np.linalg.inv(cones) @ np.diag((cones @ np.ones(3)) / (cones @ np.array(colors.kelvin(temperature)))) @ cones
