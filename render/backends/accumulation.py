"""Motion blur and depth of field by accumulation: renderers of several moments and lens points, which take samples in turn.

Source: Haeberli and Akeley, The Accumulation Buffer, 1990.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ...compiler.plan.picture_rules import RASTER_MOMENTS
from ...compiler.plan.plan import Plan
from .. import camera
from ..film.film import TILE, Unshared
from ..film.tile_queue import TileKernel
from ..geometry import instance_transform
from ..sampling import sobol
from ..types import Film, FirstHits, Tile, View
from . import combined_tiles


class Renderer(Unshared):
    """Renders motion and thin lenses; see film.Renderer. `still` makes the renderer of one moment and one lens point."""

    by_tile = True
    cell = 1
    side = TILE
    whole = None

    def __init__(self, scene: ir.Scene, plan: Plan, view: View, still: Callable[[ir.Scene], Any]) -> None:
        count = min(RASTER_MOMENTS, plan["samples"])
        start, share = scene_facts.open_during(scene.tables, view.camera) if plan["motion_blur"] else (0.0, 0.0)
        numbers = np.arange(count)
        across, down = sobol.sample_lens(np.zeros(count, int), numbers, 0)
        self.moments = []
        for k in numbers.tolist():
            then = freeze(scene, start + share * (k + 0.5) / count) if plan["motion_blur"] else scene
            self.moments.append(still(shift_lens(then, view, float(across[k]), float(down[k])) if plan["lens"] == "thin" else then))
        self.opening = still(freeze(scene, start) if plan["motion_blur"] else scene) if plan["aov"] else None

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of samples of each pixel, at each sample's moment and lens point."""
        for s in samples:
            yield from self.moments[self._turn(s)].first(tile, range(s, s + 1), total)

    @property
    def tile_kernel(self) -> TileKernel | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See film.Renderer."""
        return self._linked

    @functools.cached_property
    def _linked(self) -> TileKernel | None:
        drawings = [moment.tile_kernel for moment in self.moments]
        if None in drawings:
            return None
        turns = np.array([self._turn(s) for s in range(len(self.moments) ** 3)], np.int64)
        scene = combined_tiles.MomentScene(combined_tiles.parts_of(drawings), turns)
        return combined_tiles.link(combined_tiles.draw_moments, scene, drawings, self.side, self.side**2)

    def _turn(self, s: int) -> int:
        """The moment of sample s."""
        n = len(self.moments)
        return (s + s // n + s // (n * n)) % n  # not s % n: sample positions repeat with that period, too

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1 of every pixel of a tile to the film; all pixels take the same."""
        for s in range(int(first[0, 0]), int(first[0, 0] + count[0, 0])):
            self.moments[self._turn(s)].sample(tile, np.full_like(first, s), np.ones_like(count), total, film)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of a tile, at the shutter's opening."""
        assert self.opening is not None
        self.opening.channels(tile, names, out)


def freeze(scene: ir.Scene, time: float) -> ir.Scene:
    """The scene without motion, at a time from 0, the shutter's opening, to 1."""
    transforms = scene.tables.transforms
    rows = np.flatnonzero(transforms.first_key >= 0)
    place = instance_transform.transform_at(scene.tables, rows, np.full(len(rows), time))
    matrix, inverse = transforms.matrix.copy(), transforms.inverse.copy()
    matrix[rows], inverse[rows] = (np.stack(m, axis=1).reshape(-1, 3, 4) for m in place)
    still = {"matrix": matrix, "inverse": inverse, "flips": transforms.flips}
    nothing = {"first_key": np.full(len(matrix), -1), "keys": np.zeros(len(matrix))}
    return replace(scene, tables=scene.tables._replace(transforms=ir.table_of("transforms", {**still, **nothing})))


def shift_lens(scene: ir.Scene, view: View, x: float, y: float) -> ir.Scene:
    """The scene with a pinhole camera at point (x, y) of the lens, a disk of radius 1; the plane of focus stays in place."""
    cameras, c = scene.tables.cameras, view.camera
    offset = np.array([x, y]) * float(cameras.lens[c])
    half = np.array(camera.half_extent(scene.tables, view))
    shift = cameras.shift.copy()
    shift[c] -= offset / (2.0 * float(cameras.focus[c]) * half)
    matrix, inverse = (getattr(scene.tables.transforms, name).copy() for name in ("matrix", "inverse"))
    row = len(matrix)
    moved = matrix[cameras.transform[c]].copy()
    moved[:, 3] += moved[:, :2] @ offset
    back = inverse[cameras.transform[c]].copy()
    back[:2, 3] -= offset
    old = scene.tables.transforms._asdict()
    rows = {name: np.concatenate([column, column[cameras.transform[c]][None]]) for name, column in old.items()}
    rows["matrix"], rows["inverse"] = np.concatenate([matrix, moved[None]]), np.concatenate([inverse, back[None]])
    transform = cameras.transform.copy()
    transform[c] = row
    placed_cameras = {**cameras._asdict(), "shift": shift, "transform": transform}
    return replace(scene, tables=scene.tables._replace(
        transforms=ir.table_of("transforms", rows), cameras=ir.table_of("cameras", placed_cameras)
    ))  # fmt: skip


def notes(scene: ir.Scene, plan: Plan) -> list[tuple[str, str, int]]:
    """Approximations, as (message, table, row)."""
    count, messages = min(RASTER_MOMENTS, plan["samples"]), []
    if plan["motion_blur"]:
        messages.append((f"raster draws motion at {count} moments", "cameras", plan["camera"]))
    if plan["lens"] == "thin":
        messages.append((f"raster draws depth of field from {count} points of the lens", "cameras", plan["camera"]))
    return messages
