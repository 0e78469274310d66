"""Draws tiles of the rasterizer in one kernel, which calls the kernels of each step by address.

The kernels take handles whose integers and lengths of arrays are those of a tile. `draw_tile` writes them before it calls a kernel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..film.tile_queue import FILM, TILE, TileKernel
from ..integrator import ray_stack
from ..jit.function_pointer import DeclaredPointer, compiled_address
from ..jit.kernel import Kernel, helper, kernel
from ..jit.packed_struct import Handle
from ..jit.value_types import INT64, NONE, array_type, tuple_type, typeof
from ..lanes import crosslane
from ..raster import scalar_raster
from ..raster.alternative_fills import ClusterRasterizer
from ..types import Tile, View

_place, _fill, _fill_polygons, _enter, _shade = (DeclaredPointer(NONE).call for _ in range(5))
_ROWS = array_type(np.int64, 1)
_SIZES = ("samples.rows", "samples.columns", "samples.count", "samples.reach")
_SAMPLED = ("samples.x", "samples.y", "depth.key", "depth.instance", "depth.triangle")  # arrays of a number a sample


class Steps(NamedTuple):
    """Addresses of the kernels of a tile."""

    place: int
    fill: int
    fill_polygons: int
    enter: int
    shade: int


class TileScene(NamedTuple):
    """Inputs of `draw_tile`; addresses are those of handles."""

    steps: Steps
    model: int
    clusters: int
    tables: int
    accel: int
    light: int
    frame: int
    picture: View
    how: int  # a value of coverage.NAMES
    reach: int  # pixels around a tile
    batch: int  # samples of a tile in the z-buffer at a time
    box: NDArray[np.int32]  # (clusters, 4) pixel bounds
    by_polygon: NDArray[np.bool_]  # (clusters,)
    flat: NDArray[np.bool_]  # (polygons,)
    untessellated: NDArray[np.int64]  # rows of instances without triangles
    boxes: NDArray[np.int32]  # (len(untessellated), 4)


class TileMemory(NamedTuple):
    """Memory of a thread."""

    scratch: Handle  # of a scalar_raster.Scratch
    words: NDArray[np.int64]  # of that handle
    places: NDArray[np.int64]  # in `words`, of _SIZES and of the lengths of _SAMPLED
    key: NDArray[np.float64]  # (samples,) the z-buffer
    instance: NDArray[np.int32]
    triangle: NDArray[np.int32]
    chosen: NDArray[np.int64]  # (clusters + instances,)
    stack: NDArray[np.float64]


class TileDrawing:
    """The kernels of tiles for a picture."""

    def __init__(self, prepared: Any, view: View, rasterizer: ClusterRasterizer, reach: int, batch: int, kernels: Sequence[Kernel]) -> None:
        """`kernels` are the backend's place_samples, draw_untessellated and shade; `batch` samples fit the z-buffer."""
        self.prepared, self.rasterizer, self.batch = prepared, rasterizer, batch
        p, raster = prepared, prepared.raster
        self.scene = Handle(TileScene(
            self._steps(*kernels), rasterizer.model.address, rasterizer.clusters.address, p.packed.address, p.accel.address,
            p.vertex_light.address, p.frame.address, view, rasterizer.how, reach, batch, rasterizer.box, rasterizer.by_polygon,
            rasterizer.flat, np.ascontiguousarray(raster.untessellated, np.int64), np.ascontiguousarray(raster.boxes, np.int32),
        ))  # fmt: skip

    def _steps(self, placing: Kernel, entering: Kernel, shading: Kernel) -> Steps:
        """Load or compile the kernels that the scene needs."""
        p, scratch, flags = self.prepared, self._scratch(1).type, array_type(np.bool_, 1)
        model, clusters, stack = self.rasterizer.model.type, self.rasterizer.clusters.type, typeof(self._stack())
        view, polygons, entered = tuple_type(View, (INT64,) * 3), 0, 0
        if self.rasterizer.by_polygon.any():
            polygons = compiled_address(scalar_raster.draw_polygons, model, clusters, _ROWS, p.packed.type, flags, TILE, scratch)
        if len(p.raster.untessellated):
            entered = compiled_address(entering, model, _ROWS, p.packed.type, p.accel.type, view, scratch)
        return Steps(
            compiled_address(placing, TILE, p.frame.type, INT64, INT64, scratch),
            compiled_address(scalar_raster.draw_triangles, model, clusters, _ROWS, TILE, INT64, scratch), polygons, entered,
            compiled_address(
                shading, model, p.packed.type, p.accel.type, p.vertex_light.type, p.frame.type, TILE, INT64, scratch, stack, FILM
            ),
        )  # fmt: skip

    def _stack(self) -> NDArray[np.float64]:
        return ray_stack.stack_for(self.prepared.options, crosslane.WIDTH)

    def _scratch(self, samples: int) -> Handle:
        work = scalar_raster.workspace_for(self.prepared.tables)
        return Handle(scalar_raster.scratch_for(Tile(0, 0, 1, 1), samples, 0, work))

    def memory(self, samples: int | None = None) -> Handle:
        """Allocate the memory of a thread, for calls of at most so many samples."""
        scratch = self._scratch(self.batch if samples is None else min(samples, self.batch))
        places = np.array([scratch.place(name) for name in _SIZES] + [scratch.place(name) + 1 for name in _SAMPLED])
        count = len(self.rasterizer.box) + len(self.prepared.raster.untessellated)
        depth: scalar_raster.DepthBuffer = scratch.tables.depth
        chosen = np.zeros(count, np.int64)
        return Handle(TileMemory(scratch, scratch.words, places, depth.key, depth.instance, depth.triangle, chosen, self._stack()))

    def link(self) -> TileKernel:
        """The kernel of tiles."""
        return TileKernel.link(draw_tile, [self.scene], self.memory, self.memory().type)._replace(owners=self)


@kernel
def draw_tile(scene, tile, first, count, total, film, memory):
    """Add samples to the film of a tile, whose pixels all take the same; see film.Renderer.sample."""
    samples, pixels = count[0, 0], (tile.y1 - tile.y0) * (tile.x1 - tile.x0)
    batch = max(1, scene.batch // max(1, pixels))
    done = 0
    while done < samples:
        some, start = min(batch, samples - done), first[0, 0] + done
        _begin(scene, memory, tile, some, total)
        steps, scratch = scene.steps, memory.scratch
        _place(steps.place, (tile, scene.frame, start, total, scratch))
        chosen = memory.chosen[: _choose(scene.box, scene.by_polygon, False, tile, memory.chosen)]
        _fill(steps.fill, (scene.model, scene.clusters, chosen, tile, scene.how, scratch))
        if steps.fill_polygons != 0:
            chosen = memory.chosen[: _choose(scene.box, scene.by_polygon, True, tile, memory.chosen)]
            _fill_polygons(steps.fill_polygons, (scene.model, scene.clusters, chosen, scene.tables, scene.flat, tile, scratch))
        if steps.enter != 0:
            entered = memory.chosen[: _choose_shapes(scene, tile, memory.chosen)]
            if len(entered) > 0:
                view = View(scene.picture.camera, scene.picture.width, scene.picture.height)
                _enter(steps.enter, (scene.model, entered, scene.tables, scene.accel, view, scratch))
        _shade(steps.shade, (scene.model, scene.tables, scene.accel, scene.light, scene.frame, tile, start, scratch, memory.stack, film))
        done += some


@helper
def _begin(scene: Any, memory: Any, tile: Tile, samples: int, total: int) -> None:
    """Empty the z-buffer of a tile, and set the sizes that other kernels read."""
    rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
    words, places, count = memory.words, memory.places, rows * columns * samples
    words[places[0]], words[places[1]], words[places[2]] = rows, columns, samples
    words[places[3]] = scene.reach if total > 1 else 0
    for k in range(len(_SIZES), len(places)):
        words[places[k]] = count
    for k in range(count):
        memory.key[k], memory.instance[k], memory.triangle[k] = -np.inf, -1, -1


@helper
def _overlaps(box: Any, k: int, tile: Tile) -> bool:
    return (box[k, 0] < tile.x1) & (box[k, 2] > tile.x0) & (box[k, 1] < tile.y1) & (box[k, 3] > tile.y0)


@helper
def _choose(box: Any, by_polygon: Any, polygons: bool, tile: Tile, chosen: Any) -> int:
    """Write the clusters that overlap a tile, drawn by polygons or by triangles; returns their number."""
    count = 0
    for k in range(len(box)):
        if by_polygon[k] == polygons and _overlaps(box, k, tile):
            chosen[count] = k
            count += 1
    return count


@helper
def _choose_shapes(scene: Any, tile: Tile, chosen: Any) -> int:
    """Write the instances without triangles that overlap a tile; returns their number."""
    count = 0
    for k in range(len(scene.boxes)):
        if _overlaps(scene.boxes, k, tile):
            chosen[count] = scene.untessellated[k]
            count += 1
    return count
