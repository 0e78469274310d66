"""Bright spots of domes: small parts of an image, as the sun in a photographed sky, that carry much of its light.

Paths find them through glass by chance alone, as they find small lamps: photons carry that light.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...lang.colors import LUMINANCE
from ...lights import PICTURED, SKIES
from .. import ir

CELLS = 1024  # greatest width of the grid
TIMES_MEAN = 30.0  # least luminance of a spot's cells over the dome's mean
WIDEST = 0.1  # steradians of a spot
LEAST = 0.01  # share of a spot in the light of the dome
WORTH = 0.05  # share of all spots in the light of the dome, below which paths suffice
MOST = 0.02  # share of all cells that may be bright: else the search is left out


class Spots(NamedTuple):
    """The spots of a dome, on a grid of directions: rows by the polar angle from +y, columns by the azimuth, as its image has them."""

    light: int  # row of the dome
    count: int
    cells: NDArray[np.bool_]  # (h, w) the spots' cells and their neighbors
    luminance: NDArray[np.float64]  # (h, w)
    solid: NDArray[np.float64]  # (h, 1) steradians of a cell of each row


def find(tables: ir.Tables) -> Spots | None:
    """Return the spots of a scene's only sky, an image without links that casts shadows; else None."""
    lit = tables.lights
    skies = np.flatnonzero(ir.is_in(lit.kind, SKIES) & lit.color.any(axis=1))
    if len(skies) != 1 or lit.kind[skies[0]] not in PICTURED or lit.image[skies[0]] < 0 or not lit.shadows[skies[0]]:
        return None
    light = int(skies[0])
    bright = _grid(tables, light)
    height, width = bright.shape
    edges = np.cos(np.pi * np.arange(height + 1) / height)
    solid = (2.0 * np.pi / width) * (edges[:-1] - edges[1:])[:, None]
    total = float((bright * solid).sum())
    above = bright > TIMES_MEAN * total / (4.0 * np.pi)
    if not above.any() or above.mean() > MOST:
        return None
    labels = _components(above)
    size = np.bincount(labels[above], np.broadcast_to(solid, above.shape)[above])
    light_of = np.bincount(labels[above], (bright * solid)[above])
    chosen = (size > 0.0) & (size < WIDEST) & (light_of >= LEAST * total)
    if light_of[chosen].sum() < WORTH * total:
        return None
    return Spots(light, int(chosen.sum()), _grown(above & chosen[labels]), bright, solid)


def _grid(tables: ir.Tables, light: int) -> NDArray[np.float64]:
    """(h, w) mean luminance of blocks of a dome's texels; the last blocks of a row may hold fewer."""
    images, image = tables.images, int(tables.lights.image[light])
    width, height, first = int(images.width[image]), int(images.height[image]), int(images.first[image])
    weights = (np.array(LUMINANCE) * tables.lights.color[light]).astype(np.float32)
    bright = np.maximum(images.texels[first : first + width * height, :3] @ weights, 0.0).reshape(height, width).astype(np.float64)
    for axis in (0, 1):
        count = bright.shape[axis]
        parts = min(count, CELLS)
        starts = (np.arange(parts) * count) // parts
        sizes = np.diff(np.append(starts, count))
        bright = np.add.reduceat(bright, starts, axis=axis) / (sizes[:, None] if axis == 0 else sizes)
    return bright


def _components(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(h, w) labels of the connected parts of a mask, by its eight neighbors, around the seam; the label is the least index of a part."""
    labels = np.where(mask, np.arange(mask.size).reshape(mask.shape), mask.size)
    while True:
        best = labels
        for across in (np.roll(labels, 1, 1), np.roll(labels, -1, 1)):
            best = np.minimum(best, across)
        padded = np.pad(best, ((1, 1), (0, 0)), constant_values=mask.size)
        best = np.where(mask, np.minimum(best, np.minimum(padded[:-2], padded[2:])), mask.size)
        if (best == labels).all():
            return np.where(mask, labels, 0)
        labels = best


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add the neighbors of a mask's cells, into which interpolation spreads their light."""
    wide = mask | np.roll(mask, 1, 1) | np.roll(mask, -1, 1)
    grown = wide.copy()
    grown[1:] |= wide[:-1]
    grown[:-1] |= wide[1:]
    return grown
