"""Channels beside the picture: what is seen at pixels' centres, the same for every backend."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from . import camera, image, lanes, materials, surface
from .records import Hit, Lane, Ray, Tables, Tile, Vec, View

DIFFUSE = int(ir.Slot.DIFFUSE)


def centres(tile: Tile) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Picture coordinates x, y of a tile's pixel centres, row by row."""
    y, x = np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1]
    return x.ravel() + 0.5, y.ravel() + 0.5


def channels_of(tables: Tables, view: View, ray: Ray, hit: Hit, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
    """Write the named channels, (h, w, k) each, of h · w rays and what they hit, as image.WIDTHS describes them.

    All lanes are numpy arrays, row by row.
    """
    n = len(hit.t)
    seen = np.flatnonzero(hit.instance >= 0)
    flat = {name: rows[0] for name, rows in image.blank(n, 1, names).items()}
    if len(seen):
        ray = Ray(_some(ray.origin, seen, n), _some(ray.direction, seen, n), 0.0, np.inf)
        with np.errstate(all="ignore"):
            found = _values(tables, view, ray, Hit(*(column[seen] for column in hit)), names)
        for name, columns in found.items():
            flat[name][seen] = np.stack(np.broadcast_arrays(*columns), axis=1)
    for name in names:
        out[name][...] = flat[name].reshape(out[name].shape)


def _values(tables: Tables, view: View, ray: Ray, hit: Hit, names: tuple[str, ...]) -> dict[str, tuple[Lane, ...]]:
    at = surface.at(tables, ray, hit, "uv" in names)
    values = {
        "depth": lambda: (camera.depth(tables, view, at.position),),
        "normal": lambda: at.normal,
        "position": lambda: at.position,
        "albedo": lambda: lanes.mul(materials.color_of(tables, at, DIFFUSE), at.color),
        "uv": lambda: at.uv,
        "id": lambda: (hit.instance, at.material),
    }
    return {name: values[name]() for name in names}


def _some(v: Vec, rows: NDArray[np.intp], n: int) -> Vec:
    x, y, z = (np.broadcast_to(c, n)[rows] for c in v)
    return x, y, z
