"""The `reference` backend: tests every primitive against every ray, in numpy float64. It defines the results of the others."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import intersect
from ..film import aov
from ..film.film import TILE, Unshared
from ..integrator import ray_stack, whitted
from ..integrator.state.records import Scene
from ..sampling import sobol
from ..types import Film, FirstHits, Ray, Tile, View
from . import straight_rays
from .prepare import Prepared


class Renderer(Unshared):
    """Renders tiles with numpy lanes, all pixels of a tile at once."""

    by_tile = True
    cell = 1
    side = TILE
    whole = None

    def __init__(self, prepared: Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1 of every pixel of a tile to the film; all pixels take the same."""
        prepared, options, frame = self.prepared, self.prepared.options, self.prepared.frame
        x, y = _pixels(tile)
        stack = ray_stack.stack_for(options, len(x))
        shape = film.alpha.shape
        with np.errstate(all="ignore"):
            for s in range(int(first[0, 0]), int(first[0, 0] + count[0, 0])):
                pixel, index = sobol.zorder_index(x, y, np.full(len(x), s), self.view.width, frame.order)
                dx, dy = sobol.offset(pixel, index, total, options.seed, frame.filter)
                time = sobol.sample_time(pixel, index, options.seed, frame.shutter)
                ray = camera.generate_ray(
                    prepared.tables, self.view, frame.lens, x + 0.5 + dx, y + 0.5 + dy, pixel, index, options.seed, time
                )
                hit = self._first_hit(ray)
                if prepared.paths is not None:
                    from ..integrator import path_reference

                    inputs = prepared.tables, prepared.accel, prepared.paths, options
                    rgb, alpha, sound = path_reference.radiance(*inputs, ray, hit, pixel, index)
                else:
                    scene = Scene(prepared.tables, prepared.accel, prepared.vertex_light, options)
                    rgb, alpha, sound = whitted.radiance(scene, ray, hit, pixel, index, stack)
                for k in range(3):
                    film.color[..., k] += np.reshape(rgb[k], shape)
                film.alpha[:] += np.reshape(alpha, shape)
                film.issues[:] += np.reshape(~sound, shape)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, Any]) -> None:
        """Write the named channels of a tile, (h, w, k) each."""
        with np.errstate(all="ignore"):
            ray = camera.pinhole_ray(self.prepared.tables, self.view, *aov.pixel_centers(tile))
        seen = self._first_surfaces(ray, straight_rays.STEPS)
        aov.channels_of(self.prepared.tables, self.view, ray, seen.hit, names, out, media=seen.media)

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of samples of each pixel, at the shutter's opening."""
        for s in samples:
            with np.errstate(all="ignore"):
                ray = aov.sample_rays(self.prepared.tables, self.view, self.prepared.frame, tile, range(s, s + 1), total)
            yield self._first_surfaces(ray, straight_rays.GUIDE_STEPS)

    def _first_surfaces(self, ray: Ray, steps: int) -> FirstHits:
        """The first hits behind invisible boundaries."""
        with np.errstate(all="ignore"):
            hit = self._first_hit(ray)
        return straight_rays.first_hits((self.prepared.tables, self.prepared.options.airlight), ray, hit, self._first_hit, steps)

    def _first_hit(self, ray: Ray) -> Any:
        active = np.ones(np.shape(ray.direction[0]), bool)
        return intersect.closest_hit(self.prepared.accel, self.prepared.tables, ray, active, int(ir.Visibility.CAMERA))


def _pixels(tile: Tile) -> tuple[np.ndarray, np.ndarray]:
    y, x = np.mgrid[tile.y0 : tile.y1, tile.x0 : tile.x1]
    return x.ravel(), y.ravel()
