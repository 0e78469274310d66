"""The sRGB curve: exactly, both ways, and at once to the 256 codes of an 8-bit picture."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_STOPS = 64.0  # of exposure, either way, within which thresholds are ordinary float32
AT_ONCE = 1 << 17  # numbers, which stay in the processor's cache
NEAR = 4  # float32 values on either side of where the inverse curve says that a code begins


def encode_srgb(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Linear light to sRGB, 0..1 clipped (IEC 61966-2-1)."""
    v = np.clip(np.nan_to_num(np.asarray(linear, dtype=np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)


def decode_srgb(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """sRGB 0..1 to linear light: the inverse of `encode_srgb`."""
    v = np.asarray(encoded, dtype=np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def codes(rgb: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """What `encode_srgb` of `rgb`, so many stops brighter, comes to in whole 255ths: the same numbers, without its powers.

    The upper half of a float32's bits leaves at most two codes, since nowhere do two of them begin within 1/128 of each other's
    light; one comparison tells which.
    """
    if rgb.dtype != np.float32 or not abs(exposure) <= MOST_STOPS:
        return _by_the_curve(rgb, 2.0**exposure)
    table = _table(exposure)
    code = np.empty(rgb.shape, np.uint8)
    rows = max(1, AT_ONCE // max(1, rgb[:1].size))
    for begin in range(0, len(rgb), rows):
        part = slice(begin, begin + rows)
        light = np.fmax(rgb[part], np.float32(0.0))  # 0, too, for what is no number
        cell = (light.view(np.uint32) >> 16).astype(np.intp)
        np.add(table.lower.take(cell), light > table.last.take(cell), out=code[part])
    return code


def codes_with_alpha(rgba: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """The same of light that is multiplied by its coverage, and the coverage: light is divided by it where it is a part of a pixel."""
    coverage = rgba[..., 3]
    found = np.empty(rgba.shape, np.uint8)
    found[..., :3] = codes(rgba[..., :3], exposure)
    found[..., 3] = np.where(coverage >= 1.0, 255, 0)
    parts = (coverage > 0.0) & (coverage < 1.0)
    if parts.any():
        light = rgba[parts].astype(np.float64)
        found[parts, :3] = _by_the_curve(light[:, :3] * 2.0**exposure / light[:, 3:], 1.0)
        found[parts, 3] = np.rint(light[:, 3] * 255)
    return found


class Table(NamedTuple):
    """By the upper half of a float32's bits: the lower of the codes that light with these bits can have, and the brightest light of it."""

    lower: NDArray[np.uint8]
    last: NDArray[np.float32]  # inf where there is only one


@lru_cache(maxsize=8)
def _table(exposure: float) -> Table:
    """Where codes begin is found by the curve itself, among the float32 values around."""
    brighter = 2.0**exposure
    code = np.arange(1, 256)
    about = (decode_srgb((code - 0.5) / 255) / brighter).astype(np.float32)
    around = (about.view(np.int32)[:, None] + np.arange(-NEAR, NEAR + 1, dtype=np.int32)).view(np.float32)
    first = np.argmax(_by_the_curve(around, brighter) >= code[:, None], axis=1)
    before = around[code - 1, first - 1]
    cell = around[code - 1, first].view(np.int32) >> 16
    cells = int(np.float32(np.inf).view(np.int32) >> 16) + 1
    last = np.full(cells, np.inf, np.float32)
    last[cell] = before
    return Table(np.searchsorted(cell, np.arange(cells)).astype(np.uint8), last)


def _by_the_curve(rgb: NDArray[np.floating], brighter: float) -> NDArray[np.uint8]:
    return np.rint(encode_srgb(np.asarray(rgb, dtype=np.float64) * brighter) * 255).astype(np.uint8)
