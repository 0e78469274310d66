"""The `ray` backend: traces camera rays through the scene's BVH and shades them with the shared integrators, tile by tile."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import intersect, ray_queries
from ..accel.formula_packets import hits
from ..accel.formula_packets.hits import REST, closer_hit, first_samples, is_used, load_pixels, load_slots, slot_of
from ..film import aov, guide_kernels, tile_queue
from ..film.accumulate import LARGEST, clamp
from ..film.deadline import Deadline
from ..film.film import TILE
from ..film.tile_queue import TileKernel
from ..integrator import background, ray_stack, whitted
from ..jit.kernel import helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops, ray_soa
from ..sampling import sobol
from ..simd import target
from ..simd.registration import overload
from ..types import Film, FirstHits, Hit, Lane, Options, Ray, Tile, View
from . import prepare

CAMERA = int(ir.Visibility.CAMERA)


class Renderer:
    """Renders tiles of a prepared scene; see film.Renderer. Thread-safe."""

    by_tile = False
    whole = None
    cell = 1  # side in pixels of the square cells whose pixels take equal samples

    def __init__(self, prepared: prepare.Prepared, plan: Plan, view: View) -> None:
        self.prepared, self.view = prepared, view
        self.frame = prepared.frame
        self.closed = plan["implicit_surfaces"] == "closed_form"
        self.packed = prepared.packed  # with this round's photon maps and what was learnt of the sky
        self.openings: Any = None  # sky_openings.Openings, from the first sample on
        self.learns = prepared.paths is not None and plan["transport.sky_visibility"] == "learnt"
        self.threads = int(plan["threads"]) or target.cores()
        self.measured, self.bounces = False, int(plan["bounces"])
        self.photon_pace: Any = None
        if prepared.photon_tracer is not None:
            from .photon_pace import PhotonPace  # few scenes have photons

            self.photon_pace = PhotonPace()
        self._lock = threading.Lock()
        self._workspaces = threading.local()  # of wavefronts and of ray packets
        self.reuses = prepared.paths is not None and plan["transport.path_reuse"] == "groups"
        if self.reuses:
            from ..sampling import pixel_groups

            self.cell = pixel_groups.CELL
        self.primes = prepared.paths is None and hits.is_needed(prepared.accel.tables)
        self.side = hits.tile_side(view.width, view.height, plan["samples"]) if self.primes else TILE
        self.black = self.primes and not prepared.accel.tables.rest & REST and background.is_black(prepared.tables, prepared.options)
        self._channel_accel, self._channel_lock = None, threading.Lock()
        if prepared.paths is None and (plan["denoise"] != "off" or plan["aov"]):
            ray_queries.load_closest(prepared.accel)
        self.has_single = self.primes and plan["samples"] == 1
        nothing, none = Tile(0, 0, 0, 0), np.zeros((0, 0), np.int64)  # an empty tile compiles the kernels
        if self.has_single:
            self._draw_single(nothing, np.zeros((0, 0, 4), np.float32))
        else:
            self.sample(nothing, none, none, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))
        if not self.primes:
            tile_queue.load(self._link(), self.side)

    @property
    def single(self) -> Callable[[Tile, NDArray[np.float32]], int] | None:
        """See film.Renderer. Not stored: a stored bound method would keep the renderer alive."""
        return self._draw_single if self.has_single else None

    @property
    def tile_kernel(self) -> TileKernel | None:
        """See film.Renderer. None in scenes with ray packets, which Python traces."""
        if self.primes:
            return None
        self._learn()
        return self._link()

    def _link(self) -> TileKernel:
        """The kernel of `sample`."""
        p = self.prepared
        if p.paths is None:
            inputs = [p.packed, p.accel, p.vertex_light, self.frame]
            return TileKernel.link(draw_tile, inputs, lambda: Handle(Workspace.of(p.options)), Handle(Workspace.of(p.options)).type)
        from ..integrator import wave_memory, wavefront

        drawn = wavefront.draw_tile_in_groups if self.reuses else wavefront.draw_tile
        inputs, kind = [p.accel, self.packed, self.frame], prepare.workspace_type(p.paths, self.reuses)
        return TileKernel.link(drawn, inputs, lambda: Handle(wave_memory.WaveMemory.of(p.paths, self.reuses)), kind)

    @property
    def round(self) -> int | None:
        """Samples that a pixel may take before photons are traced again; None without photons."""
        if self.prepared.photon_tracer is None:
            return None
        self._measure()
        return self.prepared.photon_tracer.most(self.view.width * self.view.height)

    def limit_time(self, deadline: Deadline) -> None:
        """See film.Renderer: limits the photons."""
        if self.photon_pace is not None:
            self.photon_pace.deadline = deadline

    def resize(self, width: int, height: int) -> bool:
        """See film.Renderer. Textures are filtered for the size before."""
        self.frame.put("picture.width", width)
        self.frame.put("picture.height", height)
        self.view = View(self.view.camera, width, height)
        return True

    def refresh(self, samples: int) -> None:
        """Trace photons for the next round, of this many samples of all pixels together."""
        self._measure()
        scene, tracer = self.packed.tables, self.prepared.photon_tracer
        with self.photon_pace.limited(tracer, samples):
            maps = tracer.make(samples)
        self.packed = Handle(scene._replace(light=scene.light._replace(photons=maps)))

    def _measure(self) -> None:
        """Measure how many photons the picture needs, before the first sample."""
        self._learn()
        with self._lock:
            p, tracer = self.prepared, self.prepared.photon_tracer
            if self.measured or tracer.effort < 1.0:  # faint light takes few photons
                return
            if not self.photon_pace.allows_measuring(tracer, p.frame):
                self.measured = True
                return
            from . import photon_effort

            frame = p.frame.tables._replace(options=p.frame.tables.options._replace(bounces=self.bounces))
            tracer.effort = photon_effort.measure(p.accel, self.packed.tables, frame, tracer, p.paths, self.threads, self.reuses)
            self.measured = True

    def _learn(self) -> None:
        """Learn which part of the sky each place sees, before the first sample."""
        with self._lock:
            if not self.learns:
                return
            from . import learn_openings

            p, scene = self.prepared, self.prepared.packed.tables
            if self.openings is None:
                self.openings = learn_openings.learn(p.tables, p.accel, scene, p.frame.tables, p.paths, self.threads, self.reuses)
            emitters, openings = scene.light.emitters, prepare.cast(self.openings, p.paths)
            far = emitters.tree.far.copy()
            far[emitters.sky.row] *= self.openings.seen  # beside lamps, the sky counts as what the room sees of it
            sky, tree = emitters.sky._replace(openings=openings), emitters.tree._replace(far=far)
            emitters = emitters._replace(sky=sky, tree=tree)
            self.packed = Handle(scene._replace(light=scene.light._replace(emitters=emitters)))
            self.learns = False

    def shared(self) -> tuple[int, ...]:
        """See film.Renderer."""
        tracer = self.prepared.photon_tracer
        return () if tracer is None else (tracer.maps, tracer.so_far)

    def share(self, state: tuple[int, ...]) -> None:
        """See film.Renderer."""
        tracer = self.prepared.photon_tracer
        if tracer is not None:
            tracer.maps, tracer.so_far = state

    def limit(self, bounces: int) -> None:
        """Set the limit on bounces. No thread may be drawing."""
        p = self.prepared
        self.frame.put("options.bounces", bounces)
        self.prepared = replace(p, options=p.options._replace(bounces=bounces))
        if self.primes:
            self._workspaces = threading.local()  # ray stacks depend on the limit

    def sample(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int, film: Film) -> None:
        """Add samples first … first + count - 1, (h, w) each, of the pixels of a tile to the film."""
        p = self.prepared
        if p.paths is not None:
            from ..integrator import wave_memory, wavefront

            if self.learns and first.size:
                self._learn()
            if not hasattr(self._workspaces, "wavefront"):
                self._workspaces.wavefront = Handle(wave_memory.WaveMemory.of(p.paths, self.reuses))
            drawn = wavefront.draw_tile_in_groups if self.reuses else wavefront.draw_tile
            drawn(p.accel, self.packed, self.frame, tile, first, count, total, film, self._workspaces.wavefront)
            return
        workspace = self._primed(tile, first, count, total) if self.primes else Handle(Workspace.of(p.options))
        draw_tile(p.packed, p.accel, p.vertex_light, self.frame, tile, first, count, total, film, workspace)

    def _primed(self, tile: Tile, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> Handle:
        """The thread's workspace for a tile, with the implicit-surface hits of its samples."""
        p = self.prepared
        if not hasattr(self._workspaces, "packets"):
            from ..accel.formula_packets import camera_rays  # only scenes with implicit surfaces load it

            self._workspaces.packets = camera_rays.CameraPackets(p.accel, p.packed, Workspace.of(p.options), p.packet_lights, self.black)
        return self._workspaces.packets.prime(p.packed, self.frame, tile, first, count, total)

    def _draw_single(self, tile: Tile, rgba: NDArray[np.float32]) -> int:
        """See film.Renderer.single; without film sums, which take a tenth of the time."""
        p, shape = self.prepared, rgba.shape[:2]
        if getattr(self._workspaces, "shape", None) != shape:
            self._workspaces.shape, self._workspaces.counts = shape, (np.zeros(shape, np.int64), np.ones(shape, np.int64))
        first, count = self._workspaces.counts
        workspace = self._primed(tile, first, count, 1)
        return draw_single(p.packed, p.accel, p.vertex_light, self.frame, rgba, workspace)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of a tile, (h, w, k) each."""
        tables = self.prepared.tables
        x, y = aov.pixel_centers(tile)
        with np.errstate(all="ignore"):
            ray = camera.pinhole_ray(tables, self.view, x, y)
        hit = Hit(*self._find_hits(ray))
        aov.channels_of(tables, self.view, ray, hit, names, out, self._find_unproved(ray) if "issues" in names else None)

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of samples of each pixel, at the shutter's opening; all at once, for the calls of numpy take long."""
        rays = self._camera_rays.trace(tile, samples, total)
        hit = Hit(*ray_queries.closest(self._accel_of_channels(), *rays, CAMERA))
        origin, direction = (tuple(np.ascontiguousarray(vector.T)) for vector in (rays.origin, rays.direction))
        yield FirstHits(self.prepared.tables, Ray(origin, direction, rays.begin, rays.end), hit)

    @functools.cached_property
    def _camera_rays(self) -> guide_kernels.CameraRays:
        frame = self.prepared.frame
        return guide_kernels.CameraRays(self.prepared.tables, self.view, frame.tables if isinstance(frame, Handle) else frame)

    def _find_hits(self, ray: Ray) -> ray_queries.Hits:
        """The first hits of camera rays, among all instances."""
        origin, direction = _stack_rays(ray)
        return ray_queries.closest(self._accel_of_channels(), origin, direction, ray.t_min, ray.t_max, CAMERA)

    def _accel_of_channels(self) -> Handle:
        """The BVH of all instances; that of paths lacks some. It is traversed by general kernels, which every scene shares."""
        if self.prepared.paths is None:
            return self.prepared.accel
        with self._channel_lock:
            if self._channel_accel is None:
                self._channel_accel = ray_queries.build(self.prepared.tables, general=True)
        return self._channel_accel

    def _find_unproved(self, ray: Ray) -> NDArray[np.bool_]:
        """Whether the absence of a nearer implicit-surface hit is unproved, by ray; counted by a BVH of this thread's own."""
        if not hasattr(self._workspaces, "counting"):
            self._workspaces.counting = ray_queries.build(self.prepared.tables, closed=self.closed)
        return ray_queries.find_unproved(self._workspaces.counting, *_stack_rays(ray), ray.t_min, ray.t_max)


def _stack_rays(ray: Ray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Origins and directions, (n, 3) each."""
    n = ray.direction[0].shape
    origin, direction = (np.stack([np.broadcast_to(c, n) for c in v], axis=1) for v in (ray.origin, ray.direction))
    return origin, direction


class Workspace(NamedTuple):
    """Memory of one thread: a vector of samples, their light, and the ray stack."""

    items: NDArray[np.int64]  # (3, lanes) x, y and number of each sample
    light: NDArray[np.float64]  # (5, lanes) red, green, blue, coverage, and 1 if finite
    stack: NDArray[np.float64]
    primed: Any = hits.Nothing()  # or a hits.TileHits

    @classmethod
    def of(cls, options: Options) -> Workspace:
        """A workspace of zeros."""
        width = crosslane.WIDTH
        return cls(np.zeros((3, width), np.int64), np.zeros((5, width)), ray_stack.stack_for(options, width))


@kernel
def draw_tile(tables, accel, vertex_light, frame, tile, first, count, total, film, workspace):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film.

    A pixel's samples fill whole vectors; those left over share vectors with other pixels'.
    """
    if draw_primed(workspace.primed, tables, accel, vertex_light, frame, film, workspace):
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
                    number = crosslane.lane_indices(s)
                    color, alpha, sound = shade_samples(tables, accel, vertex_light, frame, total, column_x, row_y, number, workspace)
                    red, green, blue, cover = red + color[0], green + color[1], blue + color[2], cover + alpha
                    bad += crosslane.WIDTH - crosslane.count(sound)
                    s += crosslane.WIDTH
                film.color[row, column, 0] += crosslane.total(red)
                film.color[row, column, 1] += crosslane.total(green)
                film.color[row, column, 2] += crosslane.total(blue)
                film.alpha[row, column] += crosslane.total(cover)
                film.issues[row, column] += bad
            while s < end:
                workspace.items[0, waiting], workspace.items[1, waiting], workspace.items[2, waiting] = x, y, s
                waiting += 1
                s += 1
                if waiting == crosslane.WIDTH:
                    shade_queue(tables, accel, vertex_light, frame, total, workspace)
                    _add_queue(tile, film, workspace, waiting)
                    waiting = 0
    if waiting > 0:  # the other lanes hold earlier samples, or (0, 0)
        shade_queue(tables, accel, vertex_light, frame, total, workspace)
        _add_queue(tile, film, workspace, waiting)


def draw_primed(primed: Any, tables: Any, accel: Any, vertex_light: Any, frame: Any, film: Film, workspace: Any) -> bool:
    """Draw a tile whose pixels have one sample each with known implicit-surface hits, in packet order; False for other tiles."""
    raise NotImplementedError("in kernels only")


@overload(draw_primed)
def _draw_primed(primed, tables, accel, vertex_light, frame, film, workspace):
    if not is_used(primed):
        return lambda primed, tables, accel, vertex_light, frame, film, workspace: False

    def drawn(primed, tables, accel, vertex_light, frame, film, workspace):
        if primed.rounds != 1:
            return False
        n = len(primed.t)
        for start in range(0, n, crosslane.WIDTH):
            if primed.black and not ops.any_lane(load_slots(primed.t, start) < np.inf):
                continue
            if shade_primed(tables, accel, vertex_light, frame, start, workspace):
                for k in range(min(crosslane.WIDTH, n - start)):
                    _add_sample(film, workspace, k, primed.items[n + start + k], primed.items[start + k])
        return True

    return drawn


@kernel
def draw_single(tables, accel, vertex_light, frame, rgba, workspace):
    """Write the pixels of a tile, (h, w, 4) zeros, from one sample each, whose implicit-surface hits are known.

    Returns the number of samples that are not finite or too large for a picture.
    """
    found, light, issues = workspace.primed, workspace.light, 0
    n = len(found.t)
    for start in range(0, n, crosslane.WIDTH):
        if found.black and not ops.any_lane(load_slots(found.t, start) < np.inf):
            continue
        if shade_primed(tables, accel, vertex_light, frame, start, workspace):
            for k in range(min(crosslane.WIDTH, n - start)):
                row, column = found.items[n + start + k], found.items[start + k]
                red, green, blue = light[0, k] + 0.0, light[1, k] + 0.0, light[2, k] + 0.0
                if not (abs(red) <= LARGEST and abs(green) <= LARGEST and abs(blue) <= LARGEST and light[4, k] > 0.5):
                    red, green, blue = clamp(red), clamp(green), clamp(blue)
                    issues += 1
                rgba[row, column, 0], rgba[row, column, 1] = red, green
                rgba[row, column, 2], rgba[row, column, 3] = blue, light[3, k]
    return issues


@noinline_helper
def shade_primed(tables, accel, vertex_light, frame, start, workspace):
    """Write the light of samples with known rays and implicit-surface hits, from number `start` on, to the workspace.

    Returns whether any of it is not black.
    """
    view, options, found = frame.picture, frame.options, workspace.primed
    x, y, _ = load_pixels(found.items, start)
    s = first_samples(found.corner, found.first, found.columns, x, y)
    pixel, s = sobol.zorder_index(x + found.corner[0], y + found.corner[1], s, view.width, frame.order)
    origin, direction, t_min, t_max = ray_soa.get_of(found.rays, len(found.rays) // 8, start)
    ray = Ray(origin, direction, t_min, t_max, sobol.sample_time(pixel, s, options.seed, frame.shutter))
    hit, known = merge_first_hits(accel, tables, ray, found, start)
    return _store_light(workspace, whitted.linked_radiance(frame, tables, accel, vertex_light, ray, hit, pixel, s, workspace.stack, known))


@helper
def _store_light(workspace: Any, light: Any) -> bool:
    """Write samples' light to the workspace; returns whether adding it changes the film."""
    color, alpha, sound = light
    for k in range(3):
        crosslane.store(workspace.light, k, color[k])
    crosslane.store(workspace.light, 3, alpha)
    crosslane.store(workspace.light, 4, ops.where(sound, 1.0, 0.0))
    dark = (color[0] == 0.0) & (color[1] == 0.0) & (color[2] == 0.0) & (alpha == 0.0) & sound
    return ops.any_lane(ops.not_(dark))


@noinline_helper
def shade_queue(tables, accel, vertex_light, frame, total, workspace):
    """Shade the workspace's samples and write their light there."""
    x, y, s = crosslane.load(workspace.items, 0), crosslane.load(workspace.items, 1), crosslane.load(workspace.items, 2)
    _store_light(workspace, shade_samples(tables, accel, vertex_light, frame, total, x, y, s, workspace))


@helper
def _add_queue(tile: Tile, film: Film, workspace: Any, count: int) -> None:
    """Add the light of the workspace's first `count` samples to the film, in their order."""
    for k in range(count):
        _add_sample(film, workspace, k, workspace.items[1, k] - tile.y0, workspace.items[0, k] - tile.x0)


@helper
def _add_sample(film: Film, workspace: Any, k: int, row: int, column: int) -> None:
    """Add the light of the workspace's sample k to a pixel."""
    film.color[row, column, 0] += workspace.light[0, k]
    film.color[row, column, 1] += workspace.light[1, k]
    film.color[row, column, 2] += workspace.light[2, k]
    film.alpha[row, column] += workspace.light[3, k]
    if not workspace.light[4, k] > 0.5:  # rare: otherwise the array stays out of the cache
        film.issues[row, column] += 1


def find_first_hits(primed: Any, accel: Any, tables: Any, ray: Ray, x: Lane, y: Lane, s: Lane) -> tuple[Hit, Any]:
    """The first hits of the rays of samples s of pixels (x, y), and what is known of lights' shadows there, or None."""
    raise NotImplementedError("in kernels only")


@overload(find_first_hits)
def _find_first_hits(primed, accel, tables, ray, x, y, s):
    if not is_used(primed):
        return lambda primed, accel, tables, ray, x, y, s: (intersect.closest_hit(accel, tables, ray, ops.bool_like(x, True), CAMERA), None)

    def merged(primed, accel, tables, ray, x, y, s):
        near, far = ops.full_like(ray.direction[0], ray.t_min), ops.full_like(ray.direction[0], ray.t_max)
        origin = ops.add(ray.origin, ops.like3(near, 0.0, 0.0, 0.0))
        return merge_first_hits(accel, tables, Ray(origin, ray.direction, near, far, ray.time), primed, slot_of(primed, x, y, s))

    return merged


@noinline_helper
def merge_first_hits(accel, tables, ray, found, slot):
    """The nearer of known implicit-surface hits, in these slots, and BVH hits."""
    zero, none = ops.full_like(ray.t_min, 0.0), ops.int_like(ray.t_min, -1)
    hit = Hit(zero + np.inf, none, none, zero, zero)
    if accel.rest & REST != 0:
        hit = intersect.closest_hit(accel, tables, ray, ops.bool_like(ray.t_min, True), REST)
    return closer_hit(found, slot, hit)


@noinline_helper
def shade_samples(tables, accel, vertex_light, frame, total, x, y, s, workspace):
    """(radiance, coverage, sound) of samples s of pixels x, y."""
    view, options = frame.picture, frame.options
    column, row, number = x, y, s
    pixel, s = sobol.zorder_index(x, y, s, view.width, frame.order)
    dx, dy = sobol.offset(pixel, s, total, options.seed, frame.filter)
    time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
    x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
    ray = camera.generate_ray(tables, view, frame.lens, x, y, pixel, s, options.seed, time)
    hit, known = find_first_hits(workspace.primed, accel, tables, ray, column, row, number)
    return whitted.linked_radiance(frame, tables, accel, vertex_light, ray, hit, pixel, s, workspace.stack, known)
