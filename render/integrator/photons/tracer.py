"""Photon tracing: caustics of small lights, which paths find too seldom.

Photons follow specular reflections and refractions by chance. Those that a diffuse or glossy surface receives after one are stored. So are
those that a polished metal, rough glass or a narrow highlight over a diffuse surface reflects first, where they hit a diffuse surface.
Paths leave out that light: of a light with photons, hit by way of specular surfaces after a diffuse or glossy one, and hit or sampled by
way of metals or in highlights after a diffuse one. Media are as diffuse surfaces: see `media.py`. Random numbers are keyed by (map, photon,
dimension, seed).
"""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import simd
from ...accel import photon_grid
from ...accel.photon_grid import MAPS
from ...jit import thread_pool
from ...jit.kernel import helper, kernel, noinline_helper, specialize_if_present
from ...jit.packed_struct import Handle
from ...lanes import crosslane, ops
from ...lanes.soa import PAD, ROW, SIZE, compress_store, compress_store3, load3
from ...light import lights
from ...material import bsdf, dispersion, medium_stack
from ...material.bsdf import Scattered
from ...material.shader import ONLY, Shader, evaluate_shader_filtered
from ...medium.tracking import Key
from ...sampling import sobol
from ...simd.registration import overload, types
from ...surface import blend, interaction, normal_map, tangent_frame
from ...types import Lane, Surface, Tables, Vec
from ..photon_maps import photon_beams, photon_map, photon_volume
from ..photon_maps.photon_coverage import photon_covers_lobe
from ..photon_maps.photon_map import COLUMNS
from ..state import flights
from ..state.path_state import PathState
from ..wave_intersection import intersect_stage, load_hits, surface_at
from ..wave_memory import STATE, WaveMemory, load_body, load_medium, load_near, store_body, store_optional
from . import adjoint, media
from .aims import Aims
from .emission import emit

BLOCK = 8192  # photons of a thread's job
LEAST, FEWEST, MOST = 1 << 18, 1 << 14, 1 << 22  # of a round; FEWEST also where their light is faint
PILOT, FIRST_PILOT = 1 << 17, 1 << 26  # photons of pilot maps, which only measure, and the number of the first of them
SOUNDING = 1 << 12  # photons that tell how many are stored in media
PER_SAMPLE = 0.25  # photons for each sample of a round, times the tracer's `effort`
WIDEST = 0.1  # of the scene: the coarsest cells
SPACE = 4  # stored photons of each that is emitted, on average, for which memory is allocated at first
PART, BEND = 1 << 19, 1 << 20  # dimensions of random numbers
WELL_SPREAD = 6  # pairs of numbers that are Sobol points; surfaces take two each
BENT, SPREAD, THROWN = 1, 2, 4  # flags: after a specular surface; then a glossy one; after a polished metal, and no diffuse surface yet
DIVIDED = 8  # flag: has a wavelength


class Batch(NamedTuple):
    """Photons first … first + count - 1 of the `total` of a map."""

    number: int  # of the map
    first: int
    count: int
    total: int
    share: float  # of the photons in media that is stored


class Bounce(NamedTuple):
    """How a photon goes on from a surface."""

    direction: Vec
    weight: Vec
    chance: Lane  # probability to go on


class Record(NamedTuple):
    """Photons to be stored."""

    lands: Lane  # bool
    place: Vec
    normal: Vec
    power: Vec
    code: Lane  # 1, or -1: for diffuse surfaces alone; from photon_volume.CODE on, of a medium


class Tracer:
    """Makes photon maps, round by round; see film.Renderer.refresh."""

    def __init__(self, accel: Handle, scene: Handle, frame: Handle, aims: Aims, kind: type, threads: int, beams: Any = None) -> None:
        """`accel`, `scene` and `frame` as for `wavefront.draw_tile`; `kind` is their floating-point type and that of the aims.

        `beams` are photon_beams.Beams without beams; None in scenes without scattering media.
        """
        self.accel, self.scene, self.frame, self.kind, self.threads = accel, scene, frame, kind, threads
        self.aims = Handle(aims)
        self.local = threading.local()  # WaveMemory of each thread
        self.effort = aims.effort
        self.map_count = 0  # of all rounds so far
        self.photon_count = 0  # of all rounds so far
        radii = aims.radius[np.isfinite(aims.radius)]
        self.cell_width = 0.5 * float(radii.max()) if len(radii) else 0.05 * aims.reach  # of the coarsest cells
        self.reach = float(aims.reach)
        self.scatters = isinstance(aims.inside, np.ndarray)
        self.beams = beams  # maps without any, or None
        self.medium_cell_width, self.collisions = 0.0, 0.0  # of the coarsest cells in media; there, of each photon

    def compile_kernel(self) -> None:
        """Compile or load the kernel."""
        nothing = np.zeros(3, self.kind), Handle(WaveMemory.of(self.kind)), np.zeros((COLUMNS, PAD), np.float32)
        trace_block(self.accel, self.scene, self.frame, self.aims, Batch(0, 0, 0, 1, 1.0), *nothing)

    def most_samples(self, pixels: int) -> int:
        """The most samples of each pixel in a round."""
        return max(2 * MAPS, int(MOST / (PER_SAMPLE * self.effort)) // max(pixels, 1))

    def make_maps(self, samples: int) -> photon_map.Maps:
        """Make maps for a round of so many samples of all pixels together."""
        least = max(LEAST * min(self.effort, 1.0), FEWEST)
        each = int(np.clip(samples * PER_SAMPLE * self.effort, least, MOST)) // MAPS
        landed, origin = self._trace(self.map_count, MAPS, each, self.frame)
        self.map_count += MAPS
        self.photon_count += MAPS * each
        return self._build(landed, each, self.photon_count, origin)

    def make_pilot_maps(self, number: int, frame: Handle) -> photon_map.Maps:
        """Make maps of few photons, which do not count, with the numbers of another frame."""
        each = PILOT // MAPS
        landed, origin = self._trace(FIRST_PILOT + MAPS * number, MAPS, each, frame)
        return self._build(landed, each, PILOT, origin)

    def widen(self, frame: Handle) -> None:
        """Make the coarsest cells wide enough for the disks of nearly all photons."""
        landed, _ = self._trace(FIRST_PILOT - 1, 1, int(photon_grid.FIRST), frame)
        on_surfaces = photon_volume.split(landed[0])[0] if self.scatters else landed[0]
        self.cell_width = photon_grid.coarsest_width(on_surfaces, self.cell_width, WIDEST * self.reach)

    def _build(self, landed: list[NDArray[np.float32]], each: int, so_far: int, origin: NDArray[Any]) -> photon_map.Maps:
        if not self.scatters:
            return photon_map.build(landed, each, so_far, self.cell_width, origin, self.kind, self.threads)
        parts = [photon_volume.split(rows) for rows in landed]
        maps = photon_map.build([part[0] for part in parts], each, so_far, self.cell_width, origin, self.kind, self.threads)
        of_media, beams = zip(*(photon_beams.split(part[1]) for part in parts), strict=True)
        volume = photon_volume.build([*of_media], each, so_far, self.medium_cell_width, origin, self.kind, self.threads)
        return maps._replace(volume=volume, beams=photon_beams.build([*beams], each, so_far, origin, self.beams, self.threads))

    def _measure_media(self) -> None:
        """Measure how often photons scatter in media, and choose the width of the coarsest cells there."""
        if self.scatters and self.medium_cell_width == 0.0:
            self.medium_cell_width = self.cell_width  # also ends this
            landed = photon_volume.split(self._trace(FIRST_PILOT - 2, 1, SOUNDING, self.frame)[0][0])[1]
            self.collisions = len(landed) / SOUNDING
            self.medium_cell_width = photon_grid.coarsest_width(landed, self.cell_width, WIDEST * self.reach)

    def _trace(self, first: int, count: int, each: int, frame: Handle) -> tuple[list[NDArray[np.float32]], NDArray[Any]]:
        """Trace so many photons for each of `count` maps, from number `first` on; return those to be stored, and their origin."""
        self._measure_media()
        share = min(1.0, min(media.EACH, media.MOST_STORED / (each * count)) / max(self.collisions, 1e-9))  # of these, that is stored
        jobs = [(first + k, start, min(BLOCK, each - start)) for k in range(count) for start in range(0, each, BLOCK)]
        seed = frame.tables.options.seed
        shift = np.random.default_rng([seed & 0xFFFFFFFF, first]).random(3)  # cell edges differ from round to round
        origin = ((shift - 0.5) * 2.0 * self.cell_width).astype(self.kind)
        stored: dict[tuple[int, int], NDArray[np.float32]] = {}

        def draw(job: tuple[int, int, int]) -> None:
            number, start, some = job
            if not hasattr(self.local, "memory"):
                self.local.memory = Handle(WaveMemory.of(self.kind))
            batch, space = Batch(number, start, some, each, share), SPACE * BLOCK
            while True:
                rows = np.empty((COLUMNS, space + PAD), np.float32)
                stored_count = trace_block(self.accel, self.scene, frame, self.aims, batch, origin, self.local.memory, rows)
                if stored_count <= space:
                    break
                space = int(stored_count)
            stored[number, start] = rows[:, :stored_count].T.copy()

        thread_pool.parallel_for(draw, jobs, self.threads)
        landed = [
            np.concatenate([stored.pop((first + k, start)) for start in range(0, each, BLOCK)]) for k in range(count)
        ]  # fmt: skip
        return landed, origin


# --- in lanes ------------------------------------------------------------------------------------------------------------


@kernel
def trace_block(accel, scene, frame, aims, batch, origin, memory, stored):
    """Trace a batch of photons, write those to be stored, relative to `origin`, to the columns of `stored`, and return their number.

    If `stored` is too small, photons are left out, but counted.
    """
    saved = simd.flush_denormals()
    stored_count = 0
    for start in range(0, batch.count, SIZE):
        count, share = min(batch.count - start, SIZE), 1.0 / batch.total
        active, source = _emit_stage(scene, frame, aims, memory, batch.number, batch.first + start, count, share), 0
        for depth in range(frame.options.bounces + 1):
            if active == 0:
                break
            intersect_stage(accel, scene, frame, memory, source, active, depth + 1)
            active, stored_count = _scatter_stage(scene, frame, memory, source, active, depth, origin, stored, stored_count, batch.share)
            source = 1 - source
    simd.restore_denormals(saved)
    return stored_count


@noinline_helper
def _emit_stage(scene, frame, aims, memory, number, first, n, share):
    """Emit photons first … first + n - 1; return how many have any power."""
    like = simd.load(memory.state, 0)
    emitted = 0
    for i in range(0, n, crosslane.width(like)):
        index = simd.iota(simd.load(memory.index, 0)) + (first + i)
        numbers = ops.int_like(index, number)
        ray, power = emit(scene.tables, scene.light.emitters, scene.light.spots, aims, numbers, index, frame.options.seed)
        nothing = (power, None, None)
        table, emitters = medium_stack.scattering(scene.tables), scene.light.emitters
        power, inside, near = media.start(table, nothing, scene.tables, emitters, aims, numbers, index, ray, frame.options.seed)
        going = simd.first_lanes(n - i, like) & (ops.largest(power) > 0.0)
        store_optional(inside, None, memory.inside, emitted, going)
        store_optional(near, None, memory.near, emitted, going)
        compress_store3(memory.state, emitted, ray.origin, going)
        compress_store3(memory.state, 3 * ROW + emitted, ray.direction, going)
        compress_store3(memory.state, 6 * ROW + emitted, ops.scale(power, share), going)
        compress_store3(memory.index, emitted, (ops.int_like(index, 0), numbers, index), going)
        emitted += simd.count(going)
    return emitted


@noinline_helper
def _scatter_stage(scene, frame, memory, source, n, depth, origin, stored, stored_count, share):
    """Store and scatter n photons where they hit; return (photons that go on, photons stored so far)."""
    tables, light, seed = scene.tables, scene.light, frame.options.seed
    table, like = medium_stack.scattering(tables), simd.load(memory.state, 0)
    going_on = 0
    for i in range(0, n, crosslane.width(like)):
        active = simd.first_lanes(n - i, like)
        path, number, index = _load_photon(tables, memory, source, i, depth)
        before, counts = path.weight, active & ((path.phase & (BENT | THROWN)) != 0)
        key = Key(number, index, depth, seed, 0, path.body, None, None)
        hit, piece, hits = load_hits(memory, i, active)
        flown = media.fly(table, None, tables, path, active, counts, ops.where(hits, hit.t, np.inf), key)
        stored_count = _store_beams(
            photon_beams.of(light.photons), stored_count, stored, path, active & counts, ops.where(hits, hit.t, np.inf), origin
        )
        hits = flights.without_scattered(flown, hits)
        if ops.not_(ops.any_lane(flights.any_vertex(flown, hits))):
            continue
        power = media.power_after(flown, medium_stack.attenuate(path.inside, before, tables, ops.where(hits, hit.t, 0.0)))
        path = flights.weighted(flown, path)
        time = sobol.sample_time(number, index, seed, frame.shutter)
        point, hit = surface_at(tables, scene.primitives.records, path.origin, path.direction, hit, piece, hits, time)
        event = flights.event_of(flown, None, tables, path, point, hits)
        vertices = flights.vertices(event, hits)
        point = normal_map.apply_maps(tables, _part(tables, point, number, index, depth, seed), hit, path.direction)
        point = tangent_frame.attach(tables, point, hit)
        component = dispersion.of_sample(dispersion.of(tables), None, number, index, seed)
        shader = evaluate_shader_filtered(tables, point, light.uses, path.inside, component)
        divided = dispersion.marked(dispersion.of(tables), None, (path.phase & DIVIDED) != 0)
        power, divided = dispersion.divide_before(component, (power, divided), tables, point, shader, flights.surfaces(event, vertices))
        point = flights.place(event, point, path)
        record = _landing(shader, point, flights.surfaces(event, vertices), path.phase, power)
        stored_count = _store(stored, stored_count, record, path.direction, origin)
        stored_count = _store_collisions(event, stored_count, stored, scene, path, power, share, key, origin)
        onward, going = _scatter(tables, light, event, path, (point, shader), vertices, (before, power), key, (component, divided))
        onward, going = flights.pass_boundary(event, (onward, going), tables, path, point, hit.t)
        if ops.any_lane(going):
            _push_photon(memory, 1 - source, going_on, onward, number, index, going)
            going_on += simd.count(going)
    return going_on, stored_count


@helper
def _load_photon(tables: Tables, memory: Any, source: int, i: int, depth: int) -> tuple[PathState, Lane, Lane]:
    """(photons i …, their maps, their numbers in these); the phase of a photon is its flags."""
    base, element, table = source * STATE * ROW, source * ROW + i, medium_stack.scattering(tables)
    start, direction = load3(memory.state, base, 0, i), load3(memory.state, base, 3, i)
    power = load3(memory.state, base, 6, i)
    flags, number, index = load3(memory.index, source * 3 * ROW, 0, i)
    zero, straight = 0.0 * start[0], ops.bool_like(start[0], False)
    inside = load_medium(medium_stack.initial_stack(tables, zero), None, memory, element, media.stored_depth(table, depth))
    near = load_near(table, None, memory, element)
    body = load_body(medium_stack.initial_body(tables, zero), None, memory.body, source * 4 * ROW + i, depth)
    return PathState(start, direction, power, zero, straight, inside, flags, None, None, near, body, None, None, None), number, index


@helper
def _push_photon(memory: Any, target: int, first: int, onward: PathState, number: Lane, index: Lane, going: Lane) -> None:
    """Store the photons of a mask after `first` ones of the next depth."""
    base, element = target * STATE * ROW + first, target * ROW + first
    compress_store3(memory.state, base, onward.origin, going)
    compress_store3(memory.state, base + 3 * ROW, onward.direction, going)
    compress_store3(memory.state, base + 6 * ROW, onward.weight, going)
    compress_store3(memory.index, target * 3 * ROW + first, (ops.to_int(onward.phase) + 0 * number, number, index), going)
    store_optional(onward.inside, None, memory.inside, element, going)
    store_optional(onward.near, None, memory.near, element, going)
    store_body(onward.body, None, memory.body, target * 4 * ROW + first, going)


@helper
def _landing(shader: Shader, point: Surface, surfaces: Lane, flags: Lane, power: Vec) -> Record:
    """What surfaces receive."""
    bent, spread, thrown = (flags & BENT) != 0, (flags & SPREAD) != 0, (flags & THROWN) != 0
    lands = surfaces & bsdf.is_lit(shader) & (bent | (thrown & bsdf.has_matt(shader)))
    zero = 0.0 * power[0]
    return Record(lands, point.position, point.geometric, power, ops.where(spread | thrown, zero - 1.0, zero + 1.0))


@helper
def _scatter(
    tables: Tables, light: Any, event: Any, path: PathState, shading: tuple[Surface, Shader], vertices: Lane, powers: tuple[Vec, Vec],
    key: Key,
    wavelength: Any,
) -> tuple[PathState, Lane]:  # fmt: skip
    """(photons that leave a vertex, whether they go on); `powers` are those before and after the flight, `wavelength` chosen."""
    (point, shader), (before, power) = shading, powers
    number, index, depth, seed = key.pixel, key.sample, key.depth, key.seed
    direction, flags = path.direction, path.phase
    bent, spread, thrown = (flags & BENT) != 0, (flags & SPREAD) != 0, (flags & THROWN) != 0
    u, v = _numbers(number, index, 2 * depth, seed)
    which, end = _numbers(number, index, 2 * depth + 1, seed)
    scattered = bsdf.sample_bsdf(shader, light.uses, point, ops.negate(direction), u, v, which)
    sharp = scattered.density >= ONLY
    weight = ops.scale(scattered.weight, adjoint.factor(point, shader, direction, scattered.direction, sharp))
    chance = ops.minimum(ops.largest(weight), 1.0)
    metal = bsdf.is_polished(shader) & ops.not_(sharp)
    first = flights.surfaces(event, vertices) & ops.not_(bent | thrown)
    bounce = Bounce(scattered.direction, weight, chance)
    (to, weight, chance), thrown_by_lobe = _sample_covered_lobe(
        light.caustic_reflectance, bounce, point, shader, direction, (u, v, which), first
    )
    metal = flights.surfaces(event, metal | thrown_by_lobe)
    scattered = flights.scatter(event, Scattered(to, weight, scattered.density, scattered.through), direction, u, v, which)
    to, weight, sharp = scattered.direction, scattered.weight, scattered.density >= ONLY
    chance = media.chance(event, chance, power, before)
    bent = bent | (thrown & flights.or_scattered(event, bsdf.has_matt(shader)) & ops.not_(sharp))
    going = vertices & (sharp | bent | metal) & (end < chance)
    spread = spread | (bent & ops.not_(sharp))
    thrown = ops.not_(bent) & (thrown | metal)
    bent = bent | ops.not_(thrown)
    weight = ops.mul(power, ops.scale(weight, 1.0 / ops.maximum(chance, lights.TINY)))
    weight, divided = dispersion.divide_after(wavelength[0], (weight, wavelength[1]), tables, point, to, flights.surfaces(event, vertices))
    flags = ops.where(bent, BENT, 0) | ops.where(spread, SPREAD, 0) | ops.where(thrown, THROWN, 0)
    flags = dispersion.mark(divided, flags, DIVIDED)
    inside = medium_stack.cross_boundary(path.inside, None, tables, point, to)
    body = medium_stack.enter_body(path.body, None, tables, point, inside, to)
    origin = interaction.offset_origin(point, to)
    near = flights.at_start(event, None, path.density)
    return PathState(origin, to, weight, path.density, path.straight, inside, flags, None, None, near, body, None, None, None), going


def _sample_covered_lobe(caustic_reflectance: Any, default: Any, *arguments: Any) -> Any:
    raise NotImplementedError


@overload(_sample_covered_lobe)
def _sample_covered_lobe_in_kernels(caustic_reflectance, default, *arguments):
    """(bounce, where a highlight reflects the photon first); compiled only in scenes with such highlights."""
    if isinstance(caustic_reflectance, types.Array):
        return lambda caustic_reflectance, default, *arguments: _sample_lobe(caustic_reflectance, default, *arguments)
    return lambda caustic_reflectance, default, *arguments: (default, ops.bool_like(default.chance, False))


@helper
def _sample_lobe(
    caustic_reflectance: Any, default: Bounce, point: Surface, shader: Shader, arriving: Vec, numbers: tuple[Lane, Lane, Lane], first: Lane
) -> tuple[Bounce, Lane]:  # fmt: skip
    """Sample the highlight alone: paths find the light of the diffuse part.

    The aims send fewer photons here, by their gain; reflected photons make up for it.
    """
    sampled = first & photon_covers_lobe(caustic_reflectance, point, shader)
    direction, weight, chance = default
    if ops.any_lane(sampled):
        u, v, which = numbers
        to, share = bsdf.sample_lobe(shader, point.normal, ops.negate(arriving), u, v, which)
        share = ops.scale(share, adjoint.of_normals(point, arriving, to))
        zero = 0.0 * chance
        share = ops.where3(ops.dot(to, point.geometric) > 0.0, share, (zero, zero, zero))
        direction, weight = ops.where3(sampled, to, direction), ops.where3(sampled, share, weight)
        chance = ops.where(
            sampled, ops.minimum(ops.largest(share) / ops.maximum(caustic_reflectance[point.instance], lights.TINY), 1.0), chance
        )
    return Bounce(direction, weight, chance), sampled


@helper
def _numbers(number: Lane, index: Lane, pair: int, seed: int) -> tuple[Lane, Lane]:
    dimension = ops.int_like(number, BEND + pair)
    if pair < WELL_SPREAD:
        return sobol.pair(number, index, dimension, seed)
    return sobol.hashed_pair(number, index, dimension, seed)


@helper
def _sample_part(tables: Tables, point: Surface, number: Lane, index: Lane, depth: int, seed: int) -> Surface:
    return blend.choose_part(tables, point, sobol.hashed_pair(number, index, ops.int_like(number, PART + depth), seed)[0])


_part = blend.if_blended(_sample_part)


@helper
def _store(stored: Any, stored_count: int, record: Record, direction: Vec, origin: Any) -> int:
    """Write the photons of a record, if there is space, after `stored_count` ones; return the number of all."""
    space, lands = stored.shape[1], record.lands
    if ops.not_(ops.any_lane(lands)):
        return stored_count
    if stored_count + PAD <= space:
        place = record.place
        place = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
        _store3(stored, stored_count, place, lands)
        _store3(stored, 3 * space + stored_count, ops.negate(direction), lands)
        _store3(stored, 6 * space + stored_count, record.power, lands)
        _store3(stored, 9 * space + stored_count, record.normal, lands)
        compress_store(stored, 12 * space + stored_count, record.code, lands)
    return stored_count + simd.count(lands)


@helper
def _store_scattered(
    event: Any, stored_count: int, stored: Any, scene: Any, path: PathState, power: Vec, share: float, key: Key, origin: Any
) -> int:  # fmt: skip
    lands, fluence, code = media.collision(event, None, scene.tables, path, power, share, key)
    lands = photon_beams.unbeamed(photon_beams.of(scene.light.photons), lands, path)
    zero = 0.0 * power[0]
    return _store(stored, stored_count, Record(lands, event.position, (zero, zero, zero), fluence, code), path.direction, origin)


@helper
def _store_flights(beams: Any, count: int, stored: Any, path: PathState, flying: Lane, end: Lane, origin: Any) -> int:
    lands, length, code = photon_beams.beam(beams, None, path, flying, end)
    zero = 0.0 * length
    start = ops.along(path.origin, path.direction, path.near)
    return _store(stored, count, Record(lands, start, (length, zero, zero), path.weight, code), path.direction, origin)


_store_beams = specialize_if_present(_store_flights)  # (beams, kept, …): store flights through media whose photons are beams
_store_collisions = specialize_if_present(_store_scattered)  # (event, kept, …): store photons that scatter in media


@helper
def _store3(stored: Any, element: int, v: Vec, lands: Lane) -> None:
    for k in range(3):
        compress_store(stored, element + k * stored.shape[1], v[k], lands)
