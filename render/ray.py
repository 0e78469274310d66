"""The ray backend: camera rays through the trees of bvh.py, shaded by the shared integrator, a tile at a time in kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.plan import Plan
from . import aov, camera, integrate, prepare, sampler, trace
from .kernels import kernel
from .records import Film, Hit, Tile, View

CAMERA = int(ir.Visibility.CAMERA)


class Renderer:
    """Draws tiles of a prepared scene; see film.Renderer. Safe to use from many threads."""

    by_tile = False

    def __init__(self, prepared: prepare.Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        self.filter = sampler.filter_table(plan["filter"])
        nothing, none = Tile(0, 0, 0, 0), np.zeros((0, 0), np.int64)
        self.sample(nothing, none, none, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1, (h, w) each, of the pixels of the tile to the film."""
        p = self.prepared
        stack = integrate.stack_for(p.options)
        draw_tile(p.packed, p.accel, p.gouraud, p.options, self.view, self.filter, tile, first, count, total, film, stack)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of the tile, (h, w, k) each."""
        tables = self.prepared.tables
        x, y = aov.centres(tile)
        n = len(x)
        t, u, v = np.empty((3, n))
        instance, primitive = np.empty((2, n), np.int64)
        with np.errstate(all="ignore"):
            ray = camera.ray(tables, self.view, x, y)
        first_hits(self.prepared.packed, self.prepared.accel, self.view, x, y, t, instance, primitive, u, v)
        aov.channels_of(tables, self.view, ray, Hit(t, instance, primitive, u, v), names, out)


@kernel
def draw_tile(tables, accel, gouraud, options, view, filter_table, tile, first, count, total, film, stack):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film."""
    for y in range(tile.y0, tile.y1):
        for x in range(tile.x0, tile.x1):
            row, column = y - tile.y0, x - tile.x0
            pixel = y * view.width + x
            red, green, blue, cover, bad = 0.0, 0.0, 0.0, 0.0, 0
            for s in range(first[row, column], first[row, column] + count[row, column]):
                dx, dy = sampler.offset(pixel, s, total, options.seed, filter_table)
                ray = camera.ray(tables, view, x + 0.5 + dx, y + 0.5 + dy)
                hit = trace.closest(accel, tables, ray, True, CAMERA)
                rgb, alpha, sound = integrate.radiance(tables, accel, gouraud, options, ray, hit, pixel, s, stack)
                red += rgb[0]
                green += rgb[1]
                blue += rgb[2]
                cover += alpha
                bad += 0 if sound else 1
            film.color[row, column, 0] += red
            film.color[row, column, 1] += green
            film.color[row, column, 2] += blue
            film.alpha[row, column] += cover
            film.issues[row, column] += bad


@kernel
def first_hits(tables, accel, view, x, y, t, instance, primitive, u, v):
    """What the camera sees at n picture coordinates, written to (n,) arrays."""
    for k in range(len(x)):
        hit = trace.closest(accel, tables, camera.ray(tables, view, x[k], y[k]), True, CAMERA)
        t[k], instance[k], primitive[k], u[k], v[k] = hit
