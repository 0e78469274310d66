"""Motion for a backend that draws things where they stand: a renderer for each of several moments, and samples that take turns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.plan import RASTER_MOMENTS, Plan
from . import placed
from .records import Film, Tile, View


class Renderer:
    """Draws a scene that moves; see film.Renderer. `still` makes the renderer of a scene in which nothing does."""

    by_tile = True
    whole = None

    def __init__(self, scene: ir.Scene, plan: Plan, view: View, still: Callable[[ir.Scene], Any]) -> None:
        cameras = scene.tables.cameras
        share = float(cameras.shutter[view.camera] / cameras.shutter.max())
        count = min(RASTER_MOMENTS, plan["samples"])
        self.moments = [still(standing(scene, share * (k + 0.5) / count)) for k in range(count)]
        self.opening = still(standing(scene, 0.0)) if plan["aov"] else None

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1, the same for every pixel of the tile, to the film."""
        n = len(self.moments)
        for s in range(int(first[0, 0]), int(first[0, 0] + count[0, 0])):
            turn = (s + s // n + s // (n * n)) % n  # not s % n: that is where in the pixel a sample lies, too
            self.moments[turn].sample(tile, np.full_like(first, s), np.ones_like(count), total, film)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of the tile, as they are at the shutter's opening."""
        assert self.opening is not None
        self.opening.channels(tile, names, out)


def standing(scene: ir.Scene, time: float) -> ir.Scene:
    """The scene as it is at a time from 0, the shutter's opening, to 1; nothing in it moves."""
    transforms = scene.tables.transforms
    rows = np.flatnonzero(transforms.first_key >= 0)
    place = placed.at(scene.tables, rows, np.full(len(rows), time))
    matrix, inverse = transforms.matrix.copy(), transforms.inverse.copy()
    matrix[rows], inverse[rows] = (np.stack(m, axis=1).reshape(-1, 3, 4) for m in place)
    still = {"matrix": matrix, "inverse": inverse, "flips": transforms.flips}
    nothing = {"first_key": np.full(len(matrix), -1), "keys": np.zeros(len(matrix))}
    return replace(scene, tables=scene.tables._replace(transforms=ir.table_of("transforms", {**still, **nothing})))


def notes(scene: ir.Scene, plan: Plan) -> list[tuple[str, str, int]]:
    """What is not drawn as it is."""
    return [(f"raster draws what moves at {min(RASTER_MOMENTS, plan['samples'])} moments", "cameras", plan["camera"])]
