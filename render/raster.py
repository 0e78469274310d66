"""The raster renderer: a z-buffer finds what each sample sees, then one pass shades it, deferred, with the shading all backends share.

Meshes are hit where their triangles are; of an analytic shape the z-buffer sees the tessellation, and the sample is then put
where its ray meets the true surface, or, on the outline, where it meets the tessellation. Quadrics without a box have no
triangles: they enter the z-buffer where each sample's ray meets them. No ray is followed after the
first hit but those that look for shadows: mirrors and glass show the sky in their mirrored direction and straight behind.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..compiler.plan import Plan
from . import aov, camera, fill, integrate, lanes, raster_setup, sampler, traverse, visibility
from .handles import Handle
from .kernels import helper, kernel
from .prepare import Prepared, analytic_seen
from .records import Film, Hit, Ray, Tile, View

BATCH = 1 << 16  # samples of a tile held in the z-buffer at a time
MESH = int(ir.GeometryKind.MESH)
CAMERA = int(ir.Visibility.CAMERA)
NOTHING = Hit(np.inf, -1, -1, 0.0, 0.0)


class Renderer:
    """Draws tiles of one view; its methods may be called from several threads at a time."""

    by_tile = True

    def __init__(self, prepared: Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        self.how = fill.NAMES[plan["raster.fill"]]
        self.filter = sampler.filter_table(plan["filter"])
        self.reach = math.ceil(float(np.abs(self.filter).max()) * fill.ONE)
        tables = prepared.tables
        self.flat = np.zeros(len(tables.polygons.first_loop), np.bool_)
        by_polygon = self.how == fill.SCANLINE
        if by_polygon:
            visibility.flat_polygons(prepared.packed, self.flat)
        model, ranges = raster_setup.model(tables, view, prepared.shells)
        self.model = Handle(model)
        clusters = raster_setup.clusters(self.model, ranges, tables, view, -(-self.reach // fill.ONE), by_polygon)
        self.endless = analytic_seen(tables, endless=True)
        self.box, self.whole, self.clusters = clusters.box, clusters.polygons, Handle(clusters)
        nothing = Tile(0, 0, 0, 0)
        self._add(nothing, 0, 1, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))
        if plan["aov"]:
            self.centres(nothing)

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1 of `total` of every pixel of a tile to the film's sums; they are the same for all."""
        self._add(tile, int(first[0, 0]), int(count[0, 0]), total, film)

    def _add(self, tile: Tile, first: int, count: int, total: int, film: Film) -> None:
        prepared, view = self.prepared, self.view
        stack = integrate.stack_for(prepared.options)
        batch = max(1, BATCH // max(1, (tile.y1 - tile.y0) * (tile.x1 - tile.x0)))
        for start in range(first, first + count, batch):
            scratch = self._seen(tile, start, min(batch, first + count - start), total)
            shade(self.model, prepared.packed, view, prepared.accel, prepared.gouraud, prepared.options, tile, start, scratch, stack, film)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of a tile's pixels, at their centres, (h, w, k) each."""
        ray, hit = self.centres(tile)
        aov.channels_of(self.prepared.tables, self.view, ray, hit, names, out)

    def centres(self, tile: Tile) -> tuple[Ray, Hit]:
        """The rays through a tile's pixel centres and what they hit, in lanes of shape (h · w,)."""
        scratch = self._seen(tile, 0, 1, 1)
        samples = scratch.tables.samples
        count = len(samples.x)
        hit = Hit(np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count), np.empty(count))
        resolve(self.model, self.prepared.packed, self.prepared.accel, self.view, scratch, hit)
        return camera.ray(self.prepared.tables, self.view, samples.x / fill.ONE, samples.y / fill.ONE), hit

    def _seen(self, tile: Tile, first: int, count: int, total: int) -> Handle:
        """A handle of visibility.Scratch with samples first … first + count - 1 of a tile and what they see."""
        room = visibility.room_for(self.prepared.tables)
        scratch = Handle(visibility.scratch_for(tile, count, self.reach if total > 1 else 0, room))
        place_samples(tile, self.view, first, total, self.prepared.options.seed, self.filter, scratch)
        box = self.box
        here = (box[:, 0] < tile.x1) & (box[:, 2] > tile.x0) & (box[:, 1] < tile.y1) & (box[:, 3] > tile.y0)
        visibility.draw(self.model, self.clusters, np.flatnonzero(here & ~self.whole), tile, self.how, scratch)
        if self.whole.any():
            whole = np.flatnonzero(here & self.whole)
            visibility.draw_whole(self.model, self.clusters, whole, self.prepared.packed, self.flat, tile, scratch)
        if len(self.endless):
            draw_endless(self.model, self.endless, self.prepared.packed, self.prepared.accel, self.view, scratch)
        return scratch


def notes(scene: ir.Scene, plan: Plan) -> list[tuple[str, str, int]]:
    """What the raster backend does not draw of a scene: (message, table, row), once for each material and light it is about."""
    tables, found = scene.tables, []
    used = np.unique(tables.instances.material[tables.instances.visible & ir.Visibility.CAMERA != 0])
    values = tables.materials.values
    for row in used.tolist():
        model = tables.materials.model[row]
        refracts = model == ir.MaterialModel.GLASS or values[row, ir.Slot.TRANSMISSION].max() > 0
        reflects = model == ir.MaterialModel.MIRROR or values[row, ir.Slot.REFLECTION].max() > 0
        if refracts:
            name = "glass" if model == ir.MaterialModel.GLASS else "k_t"
            found.append((f"raster draws {name} without refraction: the sky straight behind it is seen", "materials", row))
        elif reflects:
            name = "mirrors" if model == ir.MaterialModel.MIRROR else "k_r"
            found.append((f"raster draws {name} without other things in them: only the sky is reflected", "materials", row))
    return found


@kernel
def place_samples(tile, view, first, total, seed, table, scratch):
    """Write where samples first, first + 1, … of a tile's pixels lie."""
    samples = scratch.samples
    for k in range(samples.rows * samples.columns):
        x, y = tile.x0 + k % samples.columns, tile.y0 + k // samples.columns
        for s in range(samples.count):
            dx, dy = sampler.offset(y * view.width + x, first + s, total, seed, table)
            samples.x[k * samples.count + s] = x * fill.ONE + fill.HALF + round(dx * fill.ONE)
            samples.y[k * samples.count + s] = y * fill.ONE + fill.HALF + round(dy * fill.ONE)


@kernel
def draw_endless(made, endless, tables, accel, view, scratch):
    """Draw quadrics without a box into the z-buffer: at every sample where its ray meets one of them."""
    samples, seen = scratch.samples, scratch.seen
    for k in range(len(seen.key)):
        ray = camera.ray(tables, view, samples.x[k] / fill.ONE, samples.y[k] / fill.ONE)
        for instance in endless:
            met = traverse._try(accel, instance, ray.origin, ray.direction, ray.t_min, ray.t_max, CAMERA, False, NOTHING)
            if met.instance < 0:
                continue
            depth = met.t * along_axis(tables, view, ray)
            key = 1.0 / depth if made.perspective else -depth
            if key > seen.key[k] or (key == seen.key[k] and instance < seen.instance[k]):
                seen.key[k], seen.instance[k], seen.triangle[k] = key, instance, -1


@helper
def along_axis(tables: Any, view: View, ray: Ray) -> float:
    """Metres along the camera's axis for a metre along a ray."""
    return -lanes.transform_vector(tables.transforms.inverse, tables.cameras.transform[view.camera], ray.direction)[2]


@kernel
def hit_of(made, tables, accel, view, ray, px, py, instance, triangle):
    """What the ray through a sample hits, where the z-buffer saw a triangle: as trace.closest gives it."""
    if instance < 0:
        return NOTHING
    at = NOTHING
    if triangle >= 0:
        depth, u, v = weights(made, instance, triangle, px / fill.ONE, py / fill.ONE)
        at = Hit(depth / along_axis(tables, view, ray), np.int64(instance), np.int64(made.parts[triangle]), u, v)
    if tables.geometries.kind[tables.instances.geometry[instance]] == MESH:
        return at
    exact = traverse._try(accel, instance, ray.origin, ray.direction, ray.t_min, ray.t_max, CAMERA, False, NOTHING)
    if exact.instance >= 0:
        return exact
    return at if abs(at.t) < np.inf else NOTHING  # an endless plane at its horizon


@helper
def weights(made: Any, instance: int, triangle: int, x: float, y: float) -> tuple[float, float, float]:
    """(depth, u, v) of a triangle at pixel coordinates: perspective-correct weights of its second and third corner.

    The rows (X - x W, Y - y W) of the corners lie about the sample; the cross of two of them is the third's weight, undivided.
    A sample that snapping put just outside gets the nearest weights inside.
    """
    m, p, corners = made.matrix, made.positions, made.triangles
    x0, y0, d0, v0 = about(m, instance, p, corners[triangle, 0], x, y)
    x1, y1, d1, v1 = about(m, instance, p, corners[triangle, 1], x, y)
    x2, y2, d2, v2 = about(m, instance, p, corners[triangle, 2], x, y)
    e0, e1, e2 = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
    if e0 + e1 + e2 < 0.0:
        e0, e1, e2 = -e0, -e1, -e2
    e0, e1, e2 = max(e0, 0.0), max(e1, 0.0), max(e2, 0.0)
    total = e0 + e1 + e2
    if total == 0.0:
        return d0 / v0, 0.0, 0.0
    return (e0 * d0 + e1 * d1 + e2 * d2) / (e0 * v0 + e1 * v1 + e2 * v2), e1 / total, e2 / total


@helper
def about(matrix: Any, instance: int, positions: Any, row: int, x: float, y: float) -> tuple[float, float, float, float]:
    """(X - x W, Y - y W, D, V) of a vertex in clip space."""
    px, py, pz, pw = positions[row, 0], positions[row, 1], positions[row, 2], positions[row, 3]
    m = matrix[instance]
    w = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3] * pw
    cx = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3] * pw - x * w
    cy = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3] * pw - y * w
    return cx, cy, m[3, 0] * px + m[3, 1] * py + m[3, 2] * pz + m[3, 3] * pw, pw


@kernel
def resolve(made, tables, accel, view, scratch, hit):
    """Write what every sample of a tile hits, in lanes."""
    samples, seen = scratch.samples, scratch.seen
    for k in range(len(seen.key)):
        ray = camera.ray(tables, view, samples.x[k] / fill.ONE, samples.y[k] / fill.ONE)
        found = hit_of(made, tables, accel, view, ray, samples.x[k], samples.y[k], seen.instance[k], seen.triangle[k])
        hit.t[k], hit.instance[k], hit.primitive[k], hit.u[k], hit.v[k] = found


@kernel
def shade(made, tables, view, accel, gouraud, options, tile, first, scratch, stack, film):
    """Add the light of all samples of a tile to its film."""
    samples, seen = scratch.samples, scratch.seen
    for j in range(samples.rows):
        for i in range(samples.columns):
            pixel = (tile.y0 + j) * view.width + tile.x0 + i
            for s in range(samples.count):
                k = (j * samples.columns + i) * samples.count + s
                ray = camera.ray(tables, view, samples.x[k] / fill.ONE, samples.y[k] / fill.ONE)
                hit = hit_of(made, tables, accel, view, ray, samples.x[k], samples.y[k], seen.instance[k], seen.triangle[k])
                color, alpha, sound = integrate.radiance(tables, accel, gouraud, options, ray, hit, pixel, first + s, stack)
                film.color[j, i, 0] += color[0]
                film.color[j, i, 1] += color[1]
                film.color[j, i, 2] += color[2]
                film.alpha[j, i] += alpha
                film.issues[j, i] += 0 if sound else 1
