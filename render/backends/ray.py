"""The ray backend: camera rays through the trees of bvh.py, shaded by the shared integrator, a tile at a time in kernels."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import intersect, ray_queries
from ..accel.formula_packets import hits
from ..accel.formula_packets.hits import REST, first_samples, is_used, nearer_in, pixels, slot_of, taken
from ..film import aov
from ..film.accumulate import LARGEST, held
from ..film.film import TILE
from ..integrator import whitted
from ..jit.kernel import HELPER, helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops, ray_soa
from ..sampling import sobol
from ..types import Film, First, Hit, Lane, Options, Ray, Tile, View
from . import prepare

CAMERA = int(ir.Visibility.CAMERA)


class Renderer:
    """Draws tiles of a prepared scene; see film.Renderer. Safe to use from many threads."""

    by_tile = False
    whole = None
    block = 1  # pixels of the side of what takes the same samples

    def __init__(self, prepared: prepare.Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        self.frame = prepared.frame
        self.closed = plan["formulas"] == "closed"
        self.packed = prepared.packed  # with the photons of this round, where there are any
        self._rooms = threading.local()  # of waves and of bundles, one a thread
        self.reuses = prepared.paths is not None and plan["transport.reuse"] == "blocks"
        if self.reuses:
            from ..integrator import path_reuse

            self.block = path_reuse.SIDE
        self.primes = prepared.paths is None and hits.is_needed(prepared.accel.tables)
        self.side = hits.side(view.width, view.height, plan["samples"]) if self.primes else TILE
        self.black = self.primes and not prepared.accel.tables.rest & REST and whitted.is_black(prepared.tables, prepared.options)
        self.everything = None  # trees of all things, where waves' own leave some out
        self.has_single = self.primes and plan["samples"] == 1
        nothing, none = Tile(0, 0, 0, 0), np.zeros((0, 0), np.int64)  # compiles
        if self.has_single:
            self._draw_single(nothing, np.zeros((0, 0, 4), np.float32))
        else:
            self.sample(nothing, none, none, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))

    @property
    def single(self) -> Callable[[Tile, NDArray[np.float32]], int] | None:
        """See film.Renderer; not kept, as it keeps the renderer."""
        return self._draw_single if self.has_single else None

    @property
    def round(self) -> int | None:
        """Samples a pixel may take before photons are drawn anew; None: there are none."""
        crop = self.view.width * self.view.height
        return None if self.prepared.photons is None else self.prepared.photons.most(crop)

    def refresh(self, samples: int) -> None:
        """Draw photons for the next round of so many samples of all pixels together."""
        scene = self.prepared.packed.tables
        maps = self.prepared.photons.make(samples)
        self.packed = Handle(scene._replace(light=scene.light._replace(photons=maps)))

    def limit(self, bounces: int) -> None:
        """Follow rays for so many bounces from now on, while no thread draws."""
        p = self.prepared
        self.frame.put("options.bounces", bounces)
        self.prepared = replace(p, options=p.options._replace(bounces=bounces))
        if self.primes:
            self._rooms = threading.local()  # bundles have room for as many rays as wait

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1, (h, w) each, of the pixels of the tile to the film."""
        p = self.prepared
        if p.paths is not None:
            from ..integrator import wavefront, wavefront_blocks

            if not hasattr(self._rooms, "room"):
                self._rooms.room = Handle(wavefront.Room.of(p.paths, self.reuses))
            drawn = wavefront_blocks.draw_tile if self.reuses else wavefront.draw_tile
            drawn(p.accel, self.packed, self.frame, tile, first, count, total, film, self._rooms.room)
            return
        room = self._primed(tile, first, count, total) if self.primes else Handle(Room.of(p.options))
        draw_tile(p.packed, p.accel, p.gouraud, self.frame, tile, first, count, total, film, room)

    def _primed(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> Handle:
        """The thread's room for a tile, with what its samples meet of formulas."""
        p = self.prepared
        if not hasattr(self._rooms, "bundles"):
            from ..accel.formula_packets import camera_rays  # what other scenes do not load

            self._rooms.bundles = camera_rays.Bundles(p.accel, p.packed, Room.of(p.options), p.lamps, self.black)
        return self._rooms.bundles.prime(p.packed, self.frame, tile, first, count, total)

    def _draw_single(self, tile: Tile, rgba: NDArray[np.float32]) -> int:
        """As Renderer.single: without sums, which take as long as a tenth of the rest."""
        p, shape = self.prepared, rgba.shape[:2]
        if getattr(self._rooms, "shape", None) != shape:
            self._rooms.shape, self._rooms.counts = shape, (np.zeros(shape, np.int64), np.ones(shape, np.int64))
        first, count = self._rooms.counts
        room = self._primed(tile, first, count, 1)
        return draw_single(p.packed, p.accel, p.gouraud, self.frame, rgba, room)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of the tile, (h, w, k) each."""
        tables = self.prepared.tables
        x, y = aov.centres(tile)
        with np.errstate(all="ignore"):
            ray = camera.pinhole_ray(tables, self.view, x, y)
        hit = Hit(*self._met(ray))
        aov.channels_of(tables, self.view, ray, hit, names, out, self._unproved(ray) if "issues" in names else None)

    def first(self, tile: Tile, sample: int, total: int) -> First:
        """What a sample of each pixel sees first, at the shutter's opening."""
        with np.errstate(all="ignore"):
            ray = aov.sample_rays(self.prepared.tables, self.view, self.prepared.frame.tables, tile, sample, total)
        return First(self.prepared.tables, ray, Hit(*self._met(ray)))

    def _met(self, ray: Ray) -> ray_queries.Met:
        """What the camera's rays meet first, of all things."""
        origin, direction = _rows(ray)
        if self.everything is None:
            self.everything = self.prepared.accel if self.prepared.paths is None else ray_queries.trees(self.prepared.tables)
        return ray_queries.closest(self.everything, origin, direction, ray.t_min, ray.t_max, CAMERA)

    def _unproved(self, ray: Ray) -> NDArray[np.bool_]:
        """Whether what rays meet of formulas' surfaces could not be proved, by trees of this thread's own that count it."""
        if not hasattr(self._rooms, "counting"):
            self._rooms.counting = ray_queries.trees(self.prepared.tables, closed=self.closed)
        return ray_queries.unproved(self._rooms.counting, *_rows(ray), ray.t_min, ray.t_max)


def _rows(ray: Ray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and directions, (n, 3) each."""
    n = ray.direction[0].shape
    origin, direction = (np.stack([np.broadcast_to(c, n) for c in v], axis=1) for v in (ray.origin, ray.direction))
    return origin, direction


class Room(NamedTuple):
    """What a thread's kernel writes to: the lanes' samples, their light, and the rays that wait."""

    items: NDArray[np.int64]  # (3, lanes) x, y and number of each sample
    light: NDArray[np.float64]  # (5, lanes) red, green, blue, coverage, and 1 where it is sound
    stack: NDArray[np.float64]
    primed: Any = hits.Nothing()  # or a primed.Primed

    @classmethod
    def of(cls, options: Options) -> Room:
        width = crosslane.WIDTH
        return cls(np.zeros((3, width), np.int64), np.zeros((5, width)), whitted.stack_for(options, width))


@kernel
def draw_tile(tables, accel, gouraud, frame, tile, first, count, total, film, room):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film, as many at once as there are lanes.

    A pixel's samples fill the lanes as often as they can; what is left over waits for that of other pixels.
    """
    if draw_found(room.primed, tables, accel, gouraud, frame, film, room):
        return
    waiting = 0
    for y in range(tile.y0, tile.y1):
        for x in range(tile.x0, tile.x1):
            row, column = y - tile.y0, x - tile.x0
            s, end = first[row, column], first[row, column] + count[row, column]
            if end - s >= crosslane.WIDTH:
                at = crosslane.lane_indices(s)
                column_x, row_y = ops.int_like(at, x), ops.int_like(at, y)
                red, green, blue = ops.like3(at, 0.0, 0.0, 0.0)
                cover = red
                bad = 0
                while end - s >= crosslane.WIDTH:
                    color, alpha, sound = light_of(tables, accel, gouraud, frame, total, column_x, row_y, crosslane.lane_indices(s), room)
                    red, green, blue, cover = red + color[0], green + color[1], blue + color[2], cover + alpha
                    bad += crosslane.WIDTH - crosslane.count(sound)
                    s += crosslane.WIDTH
                film.color[row, column, 0] += crosslane.total(red)
                film.color[row, column, 1] += crosslane.total(green)
                film.color[row, column, 2] += crosslane.total(blue)
                film.alpha[row, column] += crosslane.total(cover)
                film.issues[row, column] += bad
            while s < end:
                room.items[0, waiting], room.items[1, waiting], room.items[2, waiting] = x, y, s
                waiting += 1
                s += 1
                if waiting == crosslane.WIDTH:
                    draw_waiting(tables, accel, gouraud, frame, total, room)
                    _add(tile, film, room, waiting)
                    waiting = 0
    if waiting > 0:  # the lanes beyond hold samples that were drawn already, or none: 0, 0
        draw_waiting(tables, accel, gouraud, frame, total, room)
        _add(tile, film, room, waiting)


def draw_found(primed: Any, tables: Any, accel: Any, gouraud: Any, frame: Any, film: Film, room: Any) -> bool:
    """Whether each pixel of a tile has one sample of which it is known what it meets of formulas; adds those, in the order of bundles."""
    raise NotImplementedError("in kernels only")


@overload(draw_found, jit_options=HELPER)
def _draw_found(primed, tables, accel, gouraud, frame, film, room):
    if not is_used(primed):
        return lambda primed, tables, accel, gouraud, frame, film, room: False

    def drawn(primed, tables, accel, gouraud, frame, film, room):
        if primed.rounds != 1:
            return False
        n = len(primed.t)
        for start in range(0, n, crosslane.WIDTH):
            if primed.black and not ops.any_lane(taken(primed.t, start) < np.inf):
                continue
            if draw_row(tables, accel, gouraud, frame, start, room):
                for k in range(min(crosslane.WIDTH, n - start)):
                    _add_one(film, room, k, primed.items[n + start + k], primed.items[start + k])
        return True

    return drawn


@kernel
def draw_single(tables, accel, gouraud, frame, rgba, room):
    """Set the pixels of a tile (h, w, 4), which are 0, by their one sample each, of which it is known what it meets of formulas; how many
    samples are no numbers that a picture can hold."""
    found, light, issues = room.primed, room.light, 0
    n = len(found.t)
    for start in range(0, n, crosslane.WIDTH):
        if found.black and not ops.any_lane(taken(found.t, start) < np.inf):
            continue
        if draw_row(tables, accel, gouraud, frame, start, room):
            for k in range(min(crosslane.WIDTH, n - start)):
                row, column = found.items[n + start + k], found.items[start + k]
                red, green, blue = light[0, k] + 0.0, light[1, k] + 0.0, light[2, k] + 0.0
                if not (abs(red) <= LARGEST and abs(green) <= LARGEST and abs(blue) <= LARGEST and light[4, k] > 0.5):
                    red, green, blue = held(red), held(green), held(blue)
                    issues += 1
                rgba[row, column, 0], rgba[row, column, 1] = red, green
                rgba[row, column, 2], rgba[row, column, 3] = blue, light[3, k]
    return issues


@noinline_helper
def draw_row(tables, accel, gouraud, frame, start, room):
    """Write the light of samples that were met beforehand, from number `start` on, to the room: as `light_of`, by their known rays;
    whether there is any."""
    view, options, found = frame.picture, frame.options, room.primed
    x, y, _ = pixels(found.items, start)
    s = first_samples(found.corner, found.first, found.columns, x, y)
    pixel, s = sobol.zorder_index(x + found.corner[0], y + found.corner[1], s, view.width, frame.order)
    origin, direction, t_min, t_max = ray_soa.get_of(found.rays, len(found.rays) // 8, start)
    ray = Ray(origin, direction, t_min, t_max, sobol.sample_time(pixel, s, options.seed, frame.shutter))
    hit, known = first_of_both(accel, tables, ray, found, start)
    return _put_light(room, whitted.call(frame.radiance, (  # pyright: ignore[reportCallIssue]
        tables, accel, gouraud, options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive, hit.u, hit.v, pixel, s, room.stack,
        ray.time, known,
    )))  # fmt: skip


@helper
def _put_light(room: Any, light: Any) -> bool:
    """Write samples' light to the room; whether adding it changes anything."""
    color, alpha, sound = light
    for k in range(3):
        crosslane.store(room.light, k, color[k])
    crosslane.store(room.light, 3, alpha)
    crosslane.store(room.light, 4, ops.where(sound, 1.0, 0.0))
    dark = (color[0] == 0.0) & (color[1] == 0.0) & (color[2] == 0.0) & (alpha == 0.0) & sound
    return ops.any_lane(ops.not_(dark))


@noinline_helper
def draw_waiting(tables, accel, gouraud, frame, total, room):
    """Write the light of the room's samples to the room."""
    x, y, s = crosslane.load(room.items, 0), crosslane.load(room.items, 1), crosslane.load(room.items, 2)
    _put_light(room, light_of(tables, accel, gouraud, frame, total, x, y, s, room))


@helper
def _add(tile: Tile, film: Film, room: Any, count: int) -> None:
    """Add the light of the room's first `count` samples to the film, in their order."""
    for k in range(count):
        _add_one(film, room, k, room.items[1, k] - tile.y0, room.items[0, k] - tile.x0)


@helper
def _add_one(film: Film, room: Any, k: int, row: int, column: int) -> None:
    """Add the light of the room's sample k to a pixel."""
    film.color[row, column, 0] += room.light[0, k]
    film.color[row, column, 1] += room.light[1, k]
    film.color[row, column, 2] += room.light[2, k]
    film.alpha[row, column] += room.light[3, k]
    if not room.light[4, k] > 0.5:  # seldom: memory that nobody reads or writes need not come near
        film.issues[row, column] += 1


def met_first(primed: Any, accel: Any, tables: Any, ray: Ray, x: Lane, y: Lane, s: Lane) -> tuple[Hit, Any]:
    """What rays of samples s of pixels x, y meet first, beforehand or in trees; what is known there of lamps, or None."""
    raise NotImplementedError("in kernels only")


@overload(met_first, jit_options=HELPER)
def _met_first(primed, accel, tables, ray, x, y, s):
    if not is_used(primed):
        return lambda primed, accel, tables, ray, x, y, s: (intersect.closest_hit(accel, tables, ray, ops.bool_like(x, True), CAMERA), None)

    def of_both(primed, accel, tables, ray, x, y, s):
        near, far = ops.full_like(ray.direction[0], ray.t_min), ops.full_like(ray.direction[0], ray.t_max)
        origin = ops.add(ray.origin, ops.like3(near, 0.0, 0.0, 0.0))
        return first_of_both(accel, tables, Ray(origin, ray.direction, near, far, ray.time), primed, slot_of(primed, x, y, s))

    return of_both


@noinline_helper
def first_of_both(accel, tables, ray, found, slot):
    """`met_first` for samples in these slots, or from this one on."""
    zero, none = ops.full_like(ray.t_min, 0.0), ops.int_like(ray.t_min, -1)
    hit = Hit(zero + np.inf, none, none, zero, zero)
    if accel.rest & REST != 0:
        hit = intersect.closest_hit(accel, tables, ray, ops.bool_like(ray.t_min, True), REST)
    return nearer_in(found, slot, hit)


@noinline_helper
def light_of(tables, accel, gouraud, frame, total, x, y, s, room):
    """(radiance, coverage, sound) of samples s of pixels x, y."""
    view, options = frame.picture, frame.options
    column, row, number = x, y, s
    pixel, s = sobol.zorder_index(x, y, s, view.width, frame.order)
    dx, dy = sobol.offset(pixel, s, total, options.seed, frame.filter)
    time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
    x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
    ray = camera.generate_ray(tables, view, frame.lens, x, y, pixel, s, options.seed, time)
    hit, known = met_first(room.primed, accel, tables, ray, column, row, number)
    return whitted.call(frame.radiance, (  # pyright: ignore[reportCallIssue]
        tables, accel, gouraud, options, ray.origin, ray.direction, hit.t, hit.instance, hit.primitive, hit.u, hit.v, pixel, s, room.stack,
        ray.time, known,
    ))  # fmt: skip
