"""sRGB transfer function, both ways, and a fast exact conversion to 8-bit codes."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_STOPS = 64.0  # greatest absolute exposure, at which thresholds are normal float32 numbers
AT_ONCE = 1 << 17  # numbers of a step, which fit the cache
NEAR = 4  # float32 values searched on either side of the inverse curve's threshold


def encode_srgb(linear: NDArray[np.floating]) -> NDArray[np.float64]:
    """Convert linear light to sRGB, clipped to 0..1 (IEC 61966-2-1)."""
    v = np.clip(np.nan_to_num(np.asarray(linear, dtype=np.float64), nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 0.0031308) ** (1 / 2.4) - 0.055)


def decode_srgb(encoded: NDArray[np.floating]) -> NDArray[np.float64]:
    """Convert sRGB 0..1 to linear light: the inverse of `encode_srgb`."""
    v = np.asarray(encoded, dtype=np.float64)
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def codes(rgb: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Return `encode_srgb` of exposed `rgb`, rounded to 255ths: the same codes, without computing powers.

    The upper 16 bits of a float32 leave at most two codes, as thresholds of codes are more than 1/128 apart in relative light. One
    comparison decides.
    """
    if rgb.dtype != np.float32 or not abs(exposure) <= MOST_STOPS:
        return _exact_codes(rgb, 2.0**exposure)
    table = _table(exposure)
    code = np.empty(rgb.shape, np.uint8)
    rows = max(1, AT_ONCE // max(1, rgb[:1].size))
    for begin in range(0, len(rgb), rows):
        part = slice(begin, begin + rows)
        light = np.fmax(rgb[part], np.float32(0.0))  # nan becomes 0
        cell = (light.view(np.uint32) >> 16).astype(np.intp)
        np.add(table.lower.take(cell), light > table.last.take(cell), out=code[part])
    return code


def codes_with_alpha(rgba: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """Return `codes` of rgb with associated alpha, unassociated, and of alpha."""
    coverage = rgba[..., 3]
    codes_of_all = np.empty(rgba.shape, np.uint8)
    codes_of_all[..., :3] = codes(rgba[..., :3], exposure)
    codes_of_all[..., 3] = np.where(coverage >= 1.0, 255, 0)
    parts = (coverage > 0.0) & (coverage < 1.0)
    if parts.any():
        light = rgba[parts].astype(np.float64)
        codes_of_all[parts, :3] = _exact_codes(light[:, :3] * 2.0**exposure / light[:, 3:], 1.0)
        codes_of_all[parts, 3] = np.rint(light[:, 3] * 255)
    return codes_of_all


class Table(NamedTuple):
    """Codes by the upper 16 bits of a float32: the lower possible code, and the greatest light of that code."""

    lower: NDArray[np.uint8]
    last: NDArray[np.float32]  # inf where there is only one


@lru_cache(maxsize=8)
def _table(exposure: float) -> Table:
    """Build the table; thresholds are searched with the exact curve among neighboring float32 values."""
    brighter = 2.0**exposure
    code = np.arange(1, 256)
    about = (decode_srgb((code - 0.5) / 255) / brighter).astype(np.float32)
    around = (about.view(np.int32)[:, None] + np.arange(-NEAR, NEAR + 1, dtype=np.int32)).view(np.float32)
    first = np.argmax(_exact_codes(around, brighter) >= code[:, None], axis=1)
    before = around[code - 1, first - 1]
    cell = around[code - 1, first].view(np.int32) >> 16
    cells = int(np.float32(np.inf).view(np.int32) >> 16) + 1
    last = np.full(cells, np.inf, np.float32)
    last[cell] = before
    return Table(np.searchsorted(cell, np.arange(cells)).astype(np.uint8), last)


def _exact_codes(rgb: NDArray[np.floating], brighter: float) -> NDArray[np.uint8]:
    return np.rint(encode_srgb(np.asarray(rgb, dtype=np.float64) * brighter) * 255).astype(np.uint8)
