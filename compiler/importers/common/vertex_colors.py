"""Colours of vertices and faces as mesh files write them: sRGB, from 0 to 1 or to 255 or 65535, and no file says which."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_WHOLE = 16  # a whole number above it is none of 0 to 1


def linear(tints: np.ndarray) -> np.ndarray:
    """Linear colours from sRGB colours, clipped to 0…1."""
    clipped = np.clip(np.nan_to_num(tints), 0.0, 1.0)
    return np.where(clipped <= 0.04045, clipped / 12.92, ((clipped + 0.055) / 1.055) ** 2.4)


def from_numbers(values: np.ndarray, warn: Callable[[str], None]) -> np.ndarray:
    """Linear colours (n, 3) of the numbers (n, 3) of a file, whose range all of them show.

    Numbers are counted to 255 or 65535 if most of those above 0 are above 1, or if all are whole and one is above 16. Others are from 0
    to 1: few numbers above 1 are clipped, with a warning.
    """
    finite = np.nan_to_num(np.asarray(values, np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    positive = finite[finite > 0]
    top = float(positive.max(initial=0.0))
    if top > 1 and (np.count_nonzero(positive > 1) * 2 > len(positive) or (top > _WHOLE and not (finite % 1).any())):
        return linear(finite / (255.0 if top < 256 else 65535.0))
    beyond = int(np.count_nonzero(((finite < 0) | (finite > 1)).any(axis=1)))
    if beyond:
        warn(f"{beyond:,} of {len(finite):,} colours are not between 0 and 1: they are clipped")
    return linear(finite)


def from_column(values: np.ndarray, kind: np.dtype, warn: Callable[[str], None]) -> np.ndarray:
    """As `from_numbers`, for numbers (n, 3) that a file has as a type; bytes are counted to 255."""
    if kind.itemsize == 1 and kind.kind in "iu":
        return linear(np.asarray(values, np.float64) % 256 / 255.0)
    return from_numbers(values, warn)
