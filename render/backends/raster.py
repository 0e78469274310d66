"""The `raster` backend: a z-buffer finds each sample's surface, then a deferred pass shades it.

The z-buffer holds triangles of meshes and tessellated shapes. A sample of a tessellated shape moves to the point where its ray hits the
true surface; on the outline, where the ray misses that, to the tessellation. Implicit surfaces, quadrics and round shapes too near to the
eye for the tolerance have no triangles: a ray for each sample enters them into the z-buffer.

No ray follows the first hit except shadow rays, unless `raster.secondary_rays` is `trace`. Mirrors show the sky in the mirrored direction,
glass the sky straight behind; both show the ground's mean light below the horizon.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...lights import SUNS
from ...materials import traits
from ...materials.contract import Lobes
from .. import camera
from ..accel import ray_queries
from ..film import aov, tile_queue
from ..film.film import TILE, Unshared
from ..film.tile_queue import TileKernel
from ..integrator import ray_stack, whitted
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..raster import band_renderer, coverage, sample_hits, scalar_raster
from ..raster.alternative_fills import ClusterRasterizer
from ..sampling import sobol
from ..types import Film, FirstHits, Hit, Lane, NoAirlight, Ray, Tile, View
from . import raster_tiles, straight_rays
from .prepare import Prepared, build_bvh

BATCH = 1 << 16  # samples of a tile held in the z-buffer at a time


class Renderer(Unshared):
    """Renders one view. Thread-safe."""

    by_tile = True
    cell = 1
    side = TILE

    def __init__(self, prepared: Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.plan, self.view = prepared, plan, view
        self.how = coverage.NAMES[plan["raster.coverage"]]
        self.reach = math.ceil(sobol.FILTER_RADIUS[plan["filter"]] * coverage.ONE)
        self.whole = band_renderer.BandRenderer(prepared, plan, view) if band_renderer.can_draw(plan) else None
        nothing = Tile(0, 0, 0, 0)
        if self.whole is None:
            self._add(nothing, 0, 1, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))
            tile_queue.load(self._linked, self.side)
        if plan["aov"]:
            self.centres(nothing)

    @functools.cached_property
    def _accel(self) -> Any:
        """The BVH; channels need it even if the picture traces no rays."""
        return self.prepared.accel or build_bvh(self.prepared.tables, self.plan)

    @functools.cached_property
    def _rasterizer(self) -> ClusterRasterizer:
        p, margin = self.prepared, -(-self.reach // coverage.ONE)
        assert p.raster is not None
        return ClusterRasterizer(p.tables, p.packed, self.view, p.raster.model, p.raster.ranges, self.how, margin)

    @property
    def tile_kernel(self) -> TileKernel | None:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See film.Renderer; None for pictures in bands."""
        return None if self.whole is not None else self._linked

    @functools.cached_property
    def _linked(self) -> TileKernel:
        kernels = place_samples, draw_untessellated, shade
        return raster_tiles.TileDrawing(self.prepared, self.view, self._rasterizer, self.reach, BATCH, kernels).link()

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1 of `total` of every pixel of a tile to the film; all pixels take the same."""
        self._add(tile, int(first[0, 0]), int(count[0, 0]), total, film)

    def _add(self, tile: Tile, first: int, count: int, total: int, film: Film) -> None:
        prepared = self.prepared
        stack = ray_stack.stack_for(prepared.options, crosslane.WIDTH)
        batch = max(1, BATCH // max(1, (tile.y1 - tile.y0) * (tile.x1 - tile.x0)))
        for start in range(first, first + count, batch):
            scratch = self._rasterize(tile, start, min(batch, first + count - start), total)
            model, light = self._rasterizer.model, prepared.vertex_light
            shade(model, prepared.packed, prepared.accel, light, prepared.frame, tile, start, scratch, stack, film)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels at a tile's pixel centres, (h, w, k) each."""
        ray, hit = self.centres(tile)
        aov.channels_of(self.prepared.tables, self.view, ray, hit, names, out, media=self._first_hits(ray, hit).media)

    def centres(self, tile: Tile) -> tuple[Ray, Hit]:
        """The rays through a tile's pixel centres, and their hits, in lanes (h · w,)."""
        return self._hits(self._rasterize(tile, 0, 1, 1))

    def _hits(self, scratch: Handle) -> tuple[Ray, Hit]:
        """The rays through a scratch's samples, and their hits."""
        samples = scratch.tables.samples
        count = len(samples.x)
        hit = Hit(np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count), np.empty(count))
        resolve(self._rasterizer.model, self.prepared.packed, self._accel, self.prepared.frame, scratch, hit)
        ray = camera.generate_pinhole_ray(self.prepared.tables, self.view, samples.x / coverage.ONE, samples.y / coverage.ONE)
        if self.plan["opacity"]:
            self._trace_transparent(ray, hit)
        return ray, hit

    def _trace_transparent(self, ray: Ray, hit: Hit) -> None:
        """Trace rays that hit partly transparent surfaces, and replace their hits."""
        tables = self.prepared.tables
        partial = traits.partial(tables)[tables.instances.material]
        rows = np.flatnonzero((hit.instance >= 0) & partial[hit.instance])
        origin, direction = (np.stack(aov.take_lanes(v, rows, len(hit.t)), axis=1) for v in (ray.origin, ray.direction))
        t_min, t_max = (np.broadcast_to(t, len(hit.t))[rows] for t in (ray.t_min, ray.t_max))
        for column, values in zip(hit, ray_queries.closest(self._accel, origin, direction, t_min, t_max), strict=True):
            column[rows] = values

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of samples of each pixel."""
        for s in samples:
            yield self._first_hits(*self._hits(self._rasterize(tile, s, 1, total)))

    def _first_hits(self, ray: Ray, hit: Hit) -> FirstHits:
        """Hits, with the fog before them."""
        air = self.prepared.options.airlight
        if isinstance(air, NoAirlight):
            return FirstHits(self.prepared.tables, ray, hit)
        end = np.where(hit.instance >= 0, hit.t, np.inf)
        return FirstHits(self.prepared.tables, ray, hit, lambda: straight_rays.through_fog(air, ray, end))

    def _rasterize(self, tile: Tile, first: int, count: int, total: int) -> Handle:
        """A handle of scalar_raster.Scratch: samples first … first + count - 1 of a tile, and their depth buffer."""
        work = scalar_raster.workspace_for(self.prepared.tables)
        scratch = Handle(scalar_raster.scratch_for(tile, count, self.reach if total > 1 else 0, work))
        place_samples(tile, self.prepared.frame, first, total, scratch)
        self._rasterizer.draw(tile, scratch)
        scene = self.prepared.raster
        overlaps = (
            (scene.boxes[:, 0] < tile.x1) & (scene.boxes[:, 2] > tile.x0) & (scene.boxes[:, 1] < tile.y1) & (scene.boxes[:, 3] > tile.y0)
        )
        if overlaps.any():
            draw_untessellated(self._rasterizer.model, scene.untessellated[overlaps], self.prepared.packed, self._accel, self.view, scratch)
        return scratch


def notes(scene: ir.Scene, plan: Plan) -> list[tuple[str, str, int]]:
    """Effects of a scene that the raster backend does not draw: (message, table, row), once for each material and light."""
    tables, messages = scene.tables, []
    used = np.unique(tables.instances.material[tables.instances.visible & ir.Visibility.CAMERA != 0])
    glass, clear, mirrors, glossy = traits.has(tables, Lobes.GLASS), traits.clear(tables), traits.mirrors(tables), traits.glossy(tables)
    perfect, slabs = traits.has(tables, Lobes.MIRROR), traits.slabs(tables)
    for row in used.tolist():
        if plan["raster.secondary_rays"] == "trace":
            continue
        if clear[row]:
            name = "glass" if glass[row] or slabs[row] else "k_t"
            messages.append((f"raster draws {name} without refraction: the sky and the ground's mean light show", "materials", row))
        elif mirrors[row]:
            name = "mirrors" if perfect[row] else "k_r"
            messages.append((f"raster draws {name} without reflected objects: the sky and the ground's mean light show", "materials", row))
        elif glossy[row]:
            messages.append(("raster draws highlights of lights and the sky only: objects are not reflected", "materials", row))
    if plan["raster.shadows"] == "map":
        lights = tables.lights
        for row in np.flatnonzero(ir.is_in(lights.kind, SUNS) & (lights.angle > 0.0) & lights.shadows).tolist():
            messages.append(("raster draws the sun's shadows from a map, without their penumbra", "lights", row))
    return messages


@kernel
def place_samples(tile, frame, first, total, scratch):
    """Write the positions of samples first, first + 1, … of a tile's pixels."""
    samples = scratch.samples
    for k in range(samples.rows * samples.columns):
        x, y = tile.x0 + k % samples.columns, tile.y0 + k // samples.columns
        for s in range(samples.count):
            pixel, index = sobol.zorder_index(x, y, first + s, frame.picture.width, frame.order)
            dx, dy = sobol.offset(pixel, index, total, frame.options.seed, frame.filter)
            samples.x[k * samples.count + s] = x * coverage.ONE + coverage.HALF + round(dx * coverage.ONE)
            samples.y[k * samples.count + s] = y * coverage.ONE + coverage.HALF + round(dy * coverage.ONE)


@kernel
def draw_untessellated(model, untessellated, tables, accel, view, scratch):
    """Draw shapes without triangles into the z-buffer: intersects a ray for each sample."""
    samples, buffer = scratch.samples, scratch.depth
    count = len(buffer.key)
    for start in range(0, count, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), count - 1)
        x, y = ops.to_float(samples.x[k]) / coverage.ONE, ops.to_float(samples.y[k]) / coverage.ONE
        ray = camera.generate_pinhole_ray(tables, view, x, y)
        for instance in untessellated:
            hit = sample_hits.intersect(accel, instance, ray, ops.bool_like(ray.t_max, True))
            depth = hit.t * sample_hits.axis_cosine(tables, view, ray)
            for j in range(min(count - start, crosslane.WIDTH)):
                if crosslane.lane(hit.instance, j) < 0:
                    continue
                key = 1.0 / crosslane.lane(depth, j) if model.perspective else -crosslane.lane(depth, j)
                if key > buffer.key[start + j] or (key == buffer.key[start + j] and instance < buffer.instance[start + j]):
                    buffer.key[start + j], buffer.instance[start + j], buffer.triangle[start + j] = key, instance, -1


@helper
def _find_hits(model: Any, tables: Any, accel: Any, view: View, scratch: Any, k: Lane) -> tuple[Ray, Hit]:
    """The rays of samples k, and their hits."""
    samples, buffer = scratch.samples, scratch.depth
    x, y = ops.to_float(samples.x[k]), ops.to_float(samples.y[k])
    ray = camera.generate_pinhole_ray(tables, view, x / coverage.ONE, y / coverage.ONE)
    instance, triangle = ops.to_int(buffer.instance[k]), ops.to_int(buffer.triangle[k])
    return ray, sample_hits.find_hits(model, tables, accel, view, ray, x, y, instance, triangle)


@kernel
def resolve(model, tables, accel, frame, scratch, hit):
    """Write the hits of a tile's samples, in lanes."""
    count = len(scratch.depth.key)
    for start in range(0, count, crosslane.WIDTH):
        _, lane_hit = _find_hits(model, tables, accel, frame.picture, scratch, ops.minimum(crosslane.lane_indices(start), count - 1))
        for j in range(min(count - start, crosslane.WIDTH)):
            hit.t[start + j], hit.u[start + j], hit.v[start + j] = (
                crosslane.lane(lane_hit.t, j),
                crosslane.lane(lane_hit.u, j),
                crosslane.lane(lane_hit.v, j),
            )
            hit.instance[start + j], hit.primitive[start + j] = crosslane.lane(lane_hit.instance, j), crosslane.lane(lane_hit.primitive, j)


@kernel
def shade(model, tables, accel, vertex_light, frame, tile, first, scratch, stack, film):
    """Add the light of all samples of a tile to its film."""
    samples = scratch.samples
    count = len(scratch.depth.key)
    for start in range(0, count, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), count - 1)
        ray, hit = _find_hits(model, tables, accel, frame.picture, scratch, k)
        position = k // samples.count
        x, y = tile.x0 + position % samples.columns, tile.y0 + position // samples.columns
        pixel, index = sobol.zorder_index(x, y, first + k % samples.count, frame.picture.width, frame.order)
        color, alpha, sound = whitted.linked_radiance(frame, tables, accel, vertex_light, ray, hit, pixel, index, stack, None)
        for j in range(min(count - start, crosslane.WIDTH)):
            row, column = (start + j) // samples.count // samples.columns, (start + j) // samples.count % samples.columns
            film.color[row, column, 0] += crosslane.lane(color[0], j)
            film.color[row, column, 1] += crosslane.lane(color[1], j)
            film.color[row, column, 2] += crosslane.lane(color[2], j)
            film.alpha[row, column] += crosslane.lane(alpha, j)
            film.issues[row, column] += 0 if crosslane.lane(sound, j) else 1
