"""Denoiser guides: kernels that trace camera rays, and add the albedo and normals of first hits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import camera
from ..jit.kernel import helper, kernel
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..sampling import sobol
from ..surface import interaction
from ..surface.material_inputs import color_of
from ..types import FirstHits, Frame, Hit, Lane, Lens, Ray, StraightMedia, Tile, Vec, View

DIFFUSE, SPECULAR, REFLECTION, TRANSMISSION, EMISSION = (
    int(slot) for slot in (ir.Slot.DIFFUSE, ir.Slot.SPECULAR, ir.Slot.REFLECTION, ir.Slot.TRANSMISSION, ir.Slot.EMISSION)
)


def plain_tables(tables: ir.Tables) -> Handle:
    """Tables without the parts that a scene adds to materials and images, so that one kernel serves all scenes."""
    materials = ir.Materials._make(tables.materials[: len(ir.Materials._fields)])
    return Handle(tables._replace(materials=materials, images=ir.Images._make(tables.images[: len(ir.Images._fields)])))


class Rays(NamedTuple):
    """Rays, (n, 3) and (n,) each."""

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    begin: NDArray[np.float64]
    end: NDArray[np.float64]


class _Sampling(NamedTuple):
    """What numbers of samples become."""

    picture: View
    seed: int
    order: int
    filter: NDArray[np.float64]
    lens: Lens
    total: int


class CameraRays:
    """The camera rays of a scene, at shutter opening."""

    def __init__(self, tables: ir.Tables, view: View, frame: Frame) -> None:
        self.tables = plain_tables(tables)
        self.of = view, int(frame.options.seed), int(frame.order), frame.filter, camera.lens_of(tables, view, general=True)

    def trace(self, tile: Tile, samples: range, total: int) -> Rays:
        """The rays of samples of each pixel of a tile, sample by sample."""
        rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
        n = rows * columns * len(samples)
        rays = Rays(np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n))
        _generate(self.tables, Handle(_Sampling(*self.of, total)), tile, samples.start, rays)
        return rays


class Surfaces:
    """Albedo and normals of first hits. Keeps the tables that it was given."""

    def __init__(self) -> None:
        self._tables: dict[int, tuple[ir.Tables, Handle]] = {}

    def add(self, first: FirstHits, count: int, out: NDArray[np.float64]) -> None:
        """Add albedo and normals over `count` to `out`, (2, pixels, 3), sample by sample; nothing for misses.

        The albedo of mirrors and glass is their specular color. Behind media, the surface counts by the share of its light that passes
        them, and they by the rest.
        """
        ray, hit = first.ray, first.hit
        if not len(hit.t) or not len(first.tables.instances.geometry):
            return
        entry = self._tables.get(id(first.tables))
        if entry is None:
            entry = self._tables[id(first.tables)] = first.tables, plain_tables(first.tables)
        n = len(hit.t)
        origin, direction = (np.stack([np.broadcast_to(c, n) for c in vector], axis=1) for vector in (ray.origin, ray.direction))
        hits = Hit(*map(np.ascontiguousarray, hit))
        if first.media is None:
            _add(entry[1], origin, direction, hits, float(count), out)
            return
        of_rays = np.zeros((2, n, 3))
        _add(entry[1], origin, direction, hits, 1.0, of_rays)
        media: StraightMedia = first.media()
        of_rays[0] = of_rays[0] * media.transmittance.T + media.albedo.T
        of_rays[1] *= media.transmittance.mean(axis=0)[:, None]
        out += of_rays.reshape(2, -1, out.shape[1], 3).sum(axis=1) / count


@kernel
def _generate(tables, sampling, tile, first, rays):
    """Write the camera rays of samples `first` on of a tile's pixels."""
    n, columns = len(rays.begin), tile.x1 - tile.x0
    pixels = columns * (tile.y1 - tile.y0)
    for start in range(0, n, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), n - 1)
        place = k % pixels
        x, y = tile.x0 + place % columns, tile.y0 + place // columns
        pixel, s = sobol.zorder_index(x, y, first + k // pixels, sampling.picture.width, sampling.order)
        dx, dy = sobol.offset(pixel, s, sampling.total, sampling.seed, sampling.filter)
        x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
        ray = camera.generate_ray(tables, sampling.picture, sampling.lens, x, y, pixel, s, sampling.seed, None)
        zero = ops.full_like(dx, 0.0)
        _store(rays.origin, start, n, ops.add(ray.origin, (zero, zero, zero)))
        _store(rays.direction, start, n, ops.add(ray.direction, (zero, zero, zero)))
        begin, end = ray.t_min + zero, ray.t_max + zero
        for j in range(min(crosslane.WIDTH, n - start)):
            rays.begin[start + j], rays.end[start + j] = crosslane.lane(begin, j), crosslane.lane(end, j)


@helper
def _store(rows: Any, start: int, n: int, vector: Vec) -> None:
    for j in range(min(crosslane.WIDTH, n - start)):
        for k in range(3):
            rows[start + j, k] = crosslane.lane(vector[k], j)


@kernel
def _add(tables, origin, direction, hits, count, out):
    """See Surfaces.add."""
    n, pixels = len(hits.t), out.shape[1]
    for start in range(0, n, crosslane.WIDTH):
        k = ops.minimum(crosslane.lane_indices(start), n - 1)
        hit_lanes = ops.to_int(hits.instance[k]) >= 0
        if not ops.any_lane(hit_lanes):
            continue
        ray = Ray(_load(origin, k), _load(direction, k), 0.0, np.inf, None)
        hit = Hit(hits.t[k], ops.to_int(hits.instance[k]), ops.to_int(hits.primitive[k]), hits.u[k], hits.v[k])
        albedo, normal = _seen(tables, ray, hit)
        for j in range(min(crosslane.WIDTH, n - start)):
            if crosslane.lane(hit.instance, j) >= 0:
                place = (start + j) % pixels
                for c in range(3):
                    out[0, place, c] += _finite(crosslane.lane(albedo[c], j)) / count
                    out[1, place, c] += _finite(crosslane.lane(normal[c], j)) / count


@helper
def _load(rows: Any, k: Lane) -> Vec:
    return rows[k, 0], rows[k, 1], rows[k, 2]


@helper
def _seen(tables: Any, ray: Ray, hit: Hit) -> tuple[Vec, Vec]:
    """Albedo and normal at hits."""
    surface = interaction.make_interaction(tables, ray, hit)
    albedo = ops.mul(color_of(tables, surface, DIFFUSE), surface.color)
    for slot in (SPECULAR, REFLECTION, TRANSMISSION):
        albedo = ops.add(albedo, color_of(tables, surface, slot))
    shines = ops.largest(color_of(tables, surface, EMISSION)) > 0.0
    ones = ops.full_like(hit.t, 1.0)
    return ops.where3(shines, (ones, ones, ones), albedo), surface.normal


@helper
def _finite(value: Lane) -> Lane:
    return value if abs(value) < np.inf else 0.0
