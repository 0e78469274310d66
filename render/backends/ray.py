"""The `ray` backend: traces camera rays through the scene's BVH and shades them with the shared integrators, tile by tile."""

from __future__ import annotations

import functools
import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import ray_queries
from ..accel.formula_packets import hits
from ..accel.formula_packets.hits import REST
from ..film import aov, guide_kernels, tile_queue
from ..film.deadline import Deadline
from ..film.film import TILE
from ..film.tile_queue import TileKernel
from ..integrator import background
from ..jit.packed_struct import Handle
from ..simd import target
from ..types import Film, FirstHits, Hit, Ray, Tile, View
from . import prepare, straight_rays
from .ray_samples import Workspace, draw_tile

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
        self.black = self.primes and not prepared.accel.tables.rest_bits & REST and background.is_black(prepared.tables, prepared.options)
        self._channel_accel, self._channel_lock = None, threading.Lock()
        if prepared.paths is None and (plan["denoise"] != "off" or plan["aov"]):
            ray_queries.load_closest(prepared.accel)
        self.packets: Any = None  # a ray_packets.TileDrawing, in scenes with formulas
        if self.primes:
            from . import ray_packets  # only scenes with implicit surfaces load it

            self.packets = ray_packets.TileDrawing(prepared, self.black, self.side, int(plan["samples"]))
        else:
            nothing, none = Tile(0, 0, 0, 0), np.zeros((0, 0), np.int64)  # an empty tile compiles the kernels
            self.sample(nothing, none, none, 1, Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64)))
        tile_queue.load(self._link(), self.side)

    @property
    def tile_kernel(self) -> TileKernel:
        """See film.Renderer."""
        self._learn()
        return self._link()

    def _link(self) -> TileKernel:
        """The kernel of `sample`."""
        p = self.prepared
        if self.packets is not None:
            return self.packets.link()
        if p.paths is None:
            inputs = [p.packed, p.accel, p.vertex_light, self.frame]
            kind = Handle(Workspace.allocate(p.options)).type
            return TileKernel.link(draw_tile, inputs, lambda *_: Handle(Workspace.allocate(p.options)), kind)
        from ..integrator import wave_memory, wavefront

        drawn = wavefront.draw_tile_in_groups if self.reuses else wavefront.draw_tile
        inputs, kind = [p.accel, self.packed, self.frame], prepare.workspace_type(p.paths, self.reuses)
        return TileKernel.link(drawn, inputs, lambda *_: Handle(wave_memory.WaveMemory.of(p.paths, self.reuses)), kind)

    @property
    def round(self) -> int | None:
        """Samples that a pixel may take before photons are traced again; None without photons."""
        if self.prepared.photon_tracer is None:
            return None
        self._measure()
        return self.prepared.photon_tracer.most_samples(self.view.width * self.view.height)

    def limit_time(self, deadline: Deadline) -> None:
        """See film.Renderer: limits the photons."""
        if self.photon_pace is not None:
            self.photon_pace.deadline = deadline

    def resize(self, width: int, height: int) -> bool:
        """See film.Renderer. Textures are filtered for the size before."""
        self.frame.put("picture.width", width)
        self.frame.put("picture.height", height)
        self.view = View(self.view.camera, width, height)
        self.__dict__.pop("_camera_rays", None)  # of the size before
        return True

    def refresh(self, samples: int) -> None:
        """Trace photons for the next round, of this many samples of all pixels together."""
        self._measure()
        scene, tracer = self.packed.tables, self.prepared.photon_tracer
        with self.photon_pace.limited(tracer, samples):
            maps = tracer.make_maps(samples)
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
        return () if tracer is None else (tracer.map_count, tracer.photon_count)

    def share(self, state: tuple[int, ...]) -> None:
        """See film.Renderer."""
        tracer = self.prepared.photon_tracer
        if tracer is not None:
            tracer.map_count, tracer.photon_count = state

    def limit(self, bounces: int) -> None:
        """Set the limit on bounces. No thread may be drawing."""
        p = self.prepared
        self.frame.put("options.bounces", bounces)
        self.prepared = replace(p, options=p.options._replace(bounces=bounces))
        if self.packets is not None:
            self.packets.prepared, self._workspaces = self.prepared, threading.local()  # ray stacks depend on the limit

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
        if self.packets is not None:
            self.packets.sample(tile, first, count, total, film, self._workspaces)
            return
        workspace = Handle(Workspace.allocate(p.options))
        draw_tile(p.packed, p.accel, p.vertex_light, self.frame, tile, first, count, total, film, workspace)

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels of a tile, (h, w, k) each."""
        tables = self.prepared.tables
        x, y = aov.pixel_centers(tile)
        with np.errstate(all="ignore"):
            ray = camera.pinhole_ray(tables, self.view, x, y)
        seen = self._first_surfaces(ray, Hit(*self._find_hits(ray)), straight_rays.STEPS)
        issues = self._find_unproved(ray) if "issues" in names else None
        aov.channels_of(tables, self.view, ray, seen.hit, names, out, issues, seen.media)

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of samples of each pixel, at the shutter's opening; all at once, for the calls of numpy take long."""
        rays = self._camera_rays.trace(tile, samples, total)
        hit = Hit(*ray_queries.closest(self._accel_of_channels(), *rays, CAMERA))
        origin, direction = (tuple(np.ascontiguousarray(vector.T)) for vector in (rays.origin, rays.direction))
        yield self._first_surfaces(Ray(origin, direction, rays.begin, rays.end), hit, straight_rays.GUIDE_STEPS)

    def _first_surfaces(self, ray: Ray, hit: Hit, steps: int) -> FirstHits:
        """The first hits behind invisible boundaries."""

        def closest(rays: Ray) -> Hit:
            return Hit(*self._find_hits(rays))

        return straight_rays.first_hits((self.prepared.tables, self.prepared.options.airlight), ray, hit, closest, steps, self._march)

    @functools.cached_property
    def _march(self) -> straight_rays.March | None:
        return straight_rays.march_by_kernel(self.prepared.tables)

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
