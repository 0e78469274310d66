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
from . import across, aov, camera, fill, integrate, lanes, raster_setup, sampler, traverse, visibility
from .handles import Handle
from .kernels import helper, kernel
from .prepare import Prepared, analytic_seen
from .records import Film, Hit, Lane, Ray, Tile, View

BATCH = 1 << 16  # samples of a tile held in the z-buffer at a time
MESH = int(ir.GeometryKind.MESH)
CAMERA = int(ir.Visibility.CAMERA)


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
        prepared = self.prepared
        stack = integrate.stack_for(prepared.options, across.WIDTH)
        batch = max(1, BATCH // max(1, (tile.y1 - tile.y0) * (tile.x1 - tile.x0)))
        for start in range(first, first + count, batch):
            scratch = self._seen(tile, start, min(batch, first + count - start), total)
            shade(self.model, prepared.packed, prepared.accel, prepared.gouraud, prepared.frame, tile, start, scratch, stack, film)

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
        resolve(self.model, self.prepared.packed, self.prepared.accel, self.prepared.frame, scratch, hit)
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
    count = len(seen.key)
    for start in range(0, count, across.WIDTH):
        k = lanes.minimum(across.numbered(start), count - 1)
        ray = camera.ray(tables, view, lanes.to_float(samples.x[k]) / fill.ONE, lanes.to_float(samples.y[k]) / fill.ONE)
        for instance in endless:
            met = _meet(accel, instance, ray, lanes.bool_like(ray.t_max, True))
            depth = met.t * along_axis(tables, view, ray)
            for j in range(min(count - start, across.WIDTH)):
                if across.lane(met.instance, j) < 0:
                    continue
                key = 1.0 / across.lane(depth, j) if made.perspective else -across.lane(depth, j)
                if key > seen.key[start + j] or (key == seen.key[start + j] and instance < seen.instance[start + j]):
                    seen.key[start + j], seen.instance[start + j], seen.triangle[start + j] = key, instance, -1


@helper
def _meet(accel: Any, instance: int, ray: Ray, active: Lane) -> Hit:
    """Where rays meet one instance, in the active lanes."""
    zero = 0.0 * ray.direction[0]
    nothing = lanes.int_like(zero, -1)
    none = Hit(zero + np.inf, nothing, nothing, zero, zero)
    until = lanes.where(active, ray.t_max, zero - np.inf)
    return traverse.attempt(accel, instance, ray.origin, ray.direction, ray.t_min, until, CAMERA, False, none)


@helper
def along_axis(tables: Any, view: View, ray: Ray) -> Lane:
    """Metres along the camera's axis for a metre along a ray."""
    return -lanes.transform_vector(tables.transforms.inverse, tables.cameras.transform[view.camera], ray.direction)[2]


@helper
def hits_of(made: Any, tables: Any, accel: Any, view: View, ray: Ray, px: Lane, py: Lane, instances: Lane, triangle: Lane) -> Hit:
    """What the rays through samples hit, where the z-buffer saw triangles: as trace.closest gives it."""
    zero = 0.0 * ray.direction[0]
    nothing = lanes.int_like(zero, -1)
    t, instance, primitive, u, v = zero + np.inf, nothing, nothing, zero, zero
    rest = instances >= 0
    while lanes.any_lane(rest):
        i, here = across.together(instances, rest)
        hit = _hit_with(made, tables, accel, view, ray, px, py, i, triangle, here)
        found = here & (hit.t < np.inf)
        t, instance, primitive = lanes.where(found, hit.t, t), lanes.where(found, i, instance), lanes.where(found, hit.primitive, primitive)
        u, v = lanes.where(found, hit.u, u), lanes.where(found, hit.v, v)
        rest = rest & lanes.not_(here)
    return Hit(t, instance, primitive, u, v)


@helper
def _hit_with(made: Any, tables: Any, accel: Any, view: View, ray: Ray, px: Lane, py: Lane, i: int, triangle: Lane, here: Lane) -> Hit:
    """Hits of the active lanes with one instance; t is inf where the z-buffer's triangle has none."""
    zero = 0.0 * ray.direction[0]
    t, u, v, part = zero + np.inf, zero, zero, lanes.int_like(zero, -1)
    flat = here & (triangle >= 0)
    if lanes.any_lane(flat):
        row = lanes.where(flat, triangle, 0)
        depth, wu, wv = weights(made, i, row, px / fill.ONE, py / fill.ONE)
        t = lanes.where(flat, depth / along_axis(tables, view, ray), t)
        u, v = lanes.where(flat, wu, u), lanes.where(flat, wv, v)
        part = lanes.where(flat, lanes.to_int(made.parts[row]), part)
    t = lanes.where(abs(t) < np.inf, t, np.inf)  # an endless plane at its horizon
    if tables.geometries.kind[tables.instances.geometry[i]] != MESH:
        exact = _meet(accel, i, ray, here)
        met = exact.instance >= 0
        t, part = lanes.where(met, exact.t, t), lanes.where(met, exact.primitive, part)
        u, v = lanes.where(met, exact.u, u), lanes.where(met, exact.v, v)
    return Hit(t, lanes.int_like(zero, i), part, u, v)


@helper
def weights(made: Any, instance: int, triangle: Lane, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane]:
    """(depth, u, v) of triangles at pixel coordinates: perspective-correct weights of their second and third corners.

    The rows (X - x W, Y - y W) of the corners lie about the sample; the cross of two of them is the third's weight, undivided.
    A sample that snapping put just outside gets the nearest weights inside.
    """
    m, p, corners = made.matrix, made.positions, made.triangles
    x0, y0, d0, v0 = about(m, instance, p, corners[triangle, 0], x, y)
    x1, y1, d1, v1 = about(m, instance, p, corners[triangle, 1], x, y)
    x2, y2, d2, v2 = about(m, instance, p, corners[triangle, 2], x, y)
    e0, e1, e2 = x1 * y2 - y1 * x2, x2 * y0 - y2 * x0, x0 * y1 - y0 * x1
    turn = lanes.where(e0 + e1 + e2 < 0.0, -1.0, 1.0)
    e0, e1, e2 = lanes.maximum(turn * e0, 0.0), lanes.maximum(turn * e1, 0.0), lanes.maximum(turn * e2, 0.0)
    total = e0 + e1 + e2
    thin = total == 0.0  # seen exactly from its side: its first corner
    e0, total = lanes.where(thin, 1.0, e0), lanes.where(thin, 1.0, total)
    return (e0 * d0 + e1 * d1 + e2 * d2) / (e0 * v0 + e1 * v1 + e2 * v2), e1 / total, e2 / total


@helper
def about(matrix: Any, instance: int, positions: Any, row: Lane, x: Lane, y: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(X - x W, Y - y W, D, V) of vertices in clip space."""
    row = lanes.to_int(row)
    px, py, pz, pw = positions[row, 0], positions[row, 1], positions[row, 2], positions[row, 3]
    m = matrix
    w = m[instance, 2, 0] * px + m[instance, 2, 1] * py + m[instance, 2, 2] * pz + m[instance, 2, 3] * pw
    cx = m[instance, 0, 0] * px + m[instance, 0, 1] * py + m[instance, 0, 2] * pz + m[instance, 0, 3] * pw - x * w
    cy = m[instance, 1, 0] * px + m[instance, 1, 1] * py + m[instance, 1, 2] * pz + m[instance, 1, 3] * pw - y * w
    depth = m[instance, 3, 0] * px + m[instance, 3, 1] * py + m[instance, 3, 2] * pz + m[instance, 3, 3] * pw
    return cx, cy, depth, pw


@helper
def _at(made: Any, tables: Any, accel: Any, view: View, scratch: Any, k: Lane) -> tuple[Ray, Hit]:
    """The rays of samples k and what they hit."""
    samples, seen = scratch.samples, scratch.seen
    x, y = lanes.to_float(samples.x[k]), lanes.to_float(samples.y[k])
    ray = camera.ray(tables, view, x / fill.ONE, y / fill.ONE)
    return ray, hits_of(made, tables, accel, view, ray, x, y, lanes.to_int(seen.instance[k]), lanes.to_int(seen.triangle[k]))


@kernel
def resolve(made, tables, accel, frame, scratch, hit):
    """Write what every sample of a tile hits, in lanes."""
    count = len(scratch.seen.key)
    for start in range(0, count, across.WIDTH):
        _, found = _at(made, tables, accel, frame.picture, scratch, lanes.minimum(across.numbered(start), count - 1))
        for j in range(min(count - start, across.WIDTH)):
            hit.t[start + j], hit.u[start + j], hit.v[start + j] = across.lane(found.t, j), across.lane(found.u, j), across.lane(found.v, j)
            hit.instance[start + j], hit.primitive[start + j] = across.lane(found.instance, j), across.lane(found.primitive, j)


@kernel
def shade(made, tables, accel, gouraud, frame, tile, first, scratch, stack, film):
    """Add the light of all samples of a tile to its film."""
    samples = scratch.samples
    count = len(scratch.seen.key)
    for start in range(0, count, across.WIDTH):
        k = lanes.minimum(across.numbered(start), count - 1)
        ray, hit = _at(made, tables, accel, frame.picture, scratch, k)
        at = k // samples.count
        pixel = (tile.y0 + at // samples.columns) * frame.picture.width + tile.x0 + at % samples.columns
        color, alpha, sound = integrate.call(  # pyright: ignore[reportCallIssue]
            frame.radiance,
            (
                tables, accel, gouraud, frame.options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive,
                hit.u, hit.v, pixel, first + k % samples.count, stack,
            ),
        )  # fmt: skip
        for j in range(min(count - start, across.WIDTH)):
            row, column = (start + j) // samples.count // samples.columns, (start + j) // samples.count % samples.columns
            film.color[row, column, 0] += across.lane(color[0], j)
            film.color[row, column, 1] += across.lane(color[1], j)
            film.color[row, column, 2] += across.lane(color[2], j)
            film.alpha[row, column] += across.lane(alpha, j)
            film.issues[row, column] += 0 if across.lane(sound, j) else 1
