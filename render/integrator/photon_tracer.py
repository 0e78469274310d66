"""Photons: light that goes from small lamps by way of mirrors and glass to what spreads it, the part of paths that they find too seldom.

They are aimed at balls round what gathers light, by a mixture whose whole density weighs them (Veach 1997, §9.2.3), follow sharp
reflections and refractions by chance, and are kept wherever something that spreads light is met after one; and those that a polished metal
or rough glass throws first, or a narrow highlight over something matt, where that is something matt. Paths leave out just that: a lamp with
photons that they meet by way of mirrors and glass from what spreads light, or find by way of metals or in highlights, too, from something
matt. Random numbers are of (map, photon, dimension, seed).
"""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import caustic_casters
from .. import simd
from ..jit import thread_pool
from ..jit.kernel import HELPER, helper, kernel, noinline_helper
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..lanes.soa import PAD, ROW, SIZE, keep, keep3, load3
from ..light import emitters, lights
from ..material import bsdf, medium_stack, rough_dielectric
from ..sampling import sobol
from ..surface import blend, interaction, normal_map
from ..types import Lane, Ray, Surface, Tables, Vec
from . import path, photon_map, wavefront
from .photon_map import COLUMNS, MAPS
from .wavefront import STATE

F64 = NDArray[np.float64]
TARGETS = 32  # balls that lamps aim at; more are put together
BLOCK = 8192  # photons that a thread draws at a time
PER_SAMPLE = 0.25  # photons for each sample of a round
LEAST, FEWEST, MOST = 1 << 18, 1 << 14, 1 << 22  # of a round; FEWEST also where their light is faint
SPACE = 4  # photons kept of each that is drawn, on the average, for which there is room at first
ORIGIN, PLACE, AIM, PART, BEND = 1 << 16, 1 << 17, 1 << 18, 1 << 19, 1 << 20  # dimensions of random numbers
WELL_SPREAD = 6  # of the pairs of numbers that surfaces take, two each, that are Sobol points
OFF = 32.0  # units of roundoff of its coordinates, by which a photon starts off what shines
BENT, SPREAD, THROWN = 1, 2, 4  # by a mirror or glass; then by what is neither; by a polished metal first, and by nothing matt yet
LARGEST = 16.0  # of what normals between those of corners do to a photon's weight


class Aims(NamedTuple):
    """Which lamp sends how many photons to which ball."""

    upto: F64  # (emitters,) chances of the rows of emitters, added up
    within: F64  # (emitters · targets,) of a row's targets, added up to 1
    chance: F64  # (emitters · targets,) of both together
    centre: F64  # (targets, 3)
    radius: F64  # (targets,) inf: all directions
    targets: int
    reach: float  # metres beyond which there is nothing
    effort: float  # share of the usual number of photons: faint light needs fewer for the same noise, by the square of what is reflected


def covered(tables: ir.Tables, table: emitters.Emitters, all_sizes: bool) -> NDArray[np.bool_]:
    """(emitters,) those whose light photons carry."""
    lamps, shining = caustic_casters.lamps(tables, all_sizes)
    found = np.zeros(len(table.kind), bool)
    light = table.light >= 0
    found[light] = lamps[table.light[light]] & (table.kind[light] != emitters.DOME)
    for i in np.flatnonzero(shining & (table.first >= 0)):
        later = table.first[table.first > table.first[i]]
        lamp = np.flatnonzero((np.arange(len(light)) > table.first[i]) & light)
        end = min([len(found), *later.tolist(), *lamp.tolist()])
        found[table.first[i] : end] = True
    return found


def photon_targets(tables: ir.Tables, table: emitters.Emitters, chosen: NDArray[np.bool_]) -> Aims | None:
    """How chosen emitters aim; None where nothing is in their light."""
    centre, radius = caustic_casters.balls(tables)
    mirrors = caustic_casters.gathering(tables)
    # What shines itself and mirrors, too, is no reason to aim at it from itself: its own directions are as good as any.
    centre, radius, gain = _together(centre[mirrors], radius[mirrors], caustic_casters.gains(tables)[mirrors])
    flux = np.where(chosen[:, None], _flux(tables, table, centre, radius) * gain, 0.0)
    if not flux.any():
        return None
    known, bounds = caustic_casters.balls(tables)
    ends = np.concatenate([known[np.isfinite(bounds)], table.place])
    reach = 4.0 * float(np.abs(ends).max(initial=1.0) + bounds[np.isfinite(bounds)].max(initial=1.0))
    flux = np.where(flux > 0.0, np.maximum(flux, 1e-3 * flux.max(axis=1, keepdims=True)), 0.0)
    chance = flux / flux.sum()
    of_row = chance.sum(axis=1)
    within = np.cumsum(chance, axis=1) / np.maximum(of_row, 1e-300)[:, None]
    return Aims(_last_is_one(np.cumsum(of_row)), np.ascontiguousarray(within.ravel()), np.ascontiguousarray(chance.ravel()),
                np.ascontiguousarray(centre), radius, len(radius), reach, float(gain.max()) ** 2)  # fmt: skip


def _last_is_one(upto: F64) -> F64:
    """Sums that end at 1 wherever nothing follows."""
    return np.where(upto >= upto[-1], 1.0 + 1e-9, upto)


def _together(centre: F64, radius: F64, gain: F64) -> tuple[F64, F64, F64]:
    """At most TARGETS balls round many: halves of halves along the widest direction, each in the ball round it; the most of its gains."""
    groups = [np.arange(len(radius))]
    endless = ~np.isfinite(radius)
    if endless.any():
        return np.zeros((1, 3)), np.array([np.inf]), np.ones(1)
    while len(groups) < min(TARGETS, len(radius)):
        widest = max(range(len(groups)), key=lambda g: (len(groups[g]) > 1) * (1.0 + float(np.ptp(centre[groups[g]], axis=0).max())))
        rows = groups.pop(widest)
        axis = int(np.argmax(np.ptp(centre[rows], axis=0)))
        rows = rows[np.argsort(centre[rows, axis], kind="stable")]
        groups += [rows[: len(rows) // 2], rows[len(rows) // 2 :]]
    middles, sizes, gains = [], [], []
    for rows in groups:
        low, high = (centre[rows] - radius[rows, None]).min(axis=0), (centre[rows] + radius[rows, None]).max(axis=0)
        middle = 0.5 * (low + high)
        middles.append(middle)
        sizes.append(float((np.linalg.norm(centre[rows] - middle, axis=1) + radius[rows]).max()))
        gains.append(float(gain[rows].max()))
    return np.array(middles), np.array(sizes) * (1.0 + 1e-9), np.array(gains)


def _flux(tables: ir.Tables, table: emitters.Emitters, centre: F64, radius: F64) -> F64:
    """(emitters, targets) about what each lamp sends to each ball; 0 only where surely nothing."""
    way = centre[None] - table.place[:, None]
    away = np.linalg.norm(way, axis=2)
    size = np.where(table.area > 0, np.linalg.norm(np.abs(table.side_u) + np.abs(table.side_v), axis=1), 0.0)
    grown = radius[None] + size[:, None]
    inside = away <= grown
    sine = np.where(inside, 1.0, grown / np.maximum(away, 1e-300))
    solid = np.where(inside, 4.0 * math.pi, 2.0 * math.pi * (1.0 - np.sqrt(np.maximum(1.0 - sine * sine, 0.0))))
    color = table.color.mean(axis=1)
    found = color[:, None] * np.where(table.area > 0, table.area, 1.0)[:, None] * solid
    flat = np.isin(table.kind, (emitters.RECTANGLE, emitters.DISK, emitters.TRIANGLE)) & ~table.both
    height = np.sum(way * table.normal[:, None], axis=2)
    found = np.where(flat[:, None] & (height <= -grown), 0.0, found)
    spot = np.flatnonzero(table.kind == emitters.SPOT)
    for e in spot:
        edge = math.acos(float(np.clip(tables.lights.cos_cone[table.light[e]], -1.0, 1.0)))
        off = np.arccos(np.clip(-height[e] / np.maximum(away[e], 1e-300), -1.0, 1.0))
        found[e] = np.where(inside[e] | (off - np.arcsin(np.minimum(sine[e], 1.0)) < edge), found[e], 0.0)
    far = np.isin(table.kind, (emitters.DIRECTIONAL, emitters.SUN))
    return np.where(far[:, None], color[:, None] * math.pi * radius[None] ** 2, found)


class Tracer:
    """Makes maps of photons, round by round; see film.Renderer.refresh."""

    def __init__(self, accel: Handle, scene: Handle, frame: Handle, aims: Aims, kind: type, threads: int) -> None:
        """`accel`, `scene` and `frame` as waves have them; `kind` is the floats that those and the aims are of."""
        self.accel, self.scene, self.frame, self.kind, self.threads = accel, scene, frame, kind, threads
        self.aims = Handle(aims)
        self.rooms = threading.local()  # of waves, one a thread
        self.effort = aims.effort
        self.maps = 0  # made so far
        self.so_far = 0  # photons
        known = aims.radius[np.isfinite(aims.radius)]
        self.width = 0.5 * float(known.max()) if len(known) else 0.05 * aims.reach

    def ready(self) -> None:
        """Compile, or load, what draws photons."""
        nothing = np.zeros(3, self.kind), Handle(wavefront.Room.of(self.kind)), np.zeros((COLUMNS, PAD), np.float32)
        trace_block(self.accel, self.scene, self.frame, self.aims, 0, 0, 0, 1, *nothing)

    def most(self, pixels: int) -> int:
        """Samples of each pixel that a round may have."""
        return max(2 * MAPS, int(MOST / (PER_SAMPLE * self.effort)) // max(pixels, 1))

    def make(self, samples: int) -> photon_map.Maps:
        """Maps for a round of so many samples of all pixels together."""
        each = int(np.clip(samples * PER_SAMPLE * self.effort, max(LEAST * self.effort, FEWEST), MOST)) // MAPS
        jobs = [(self.maps + k, start, min(BLOCK, each - start)) for k in range(MAPS) for start in range(0, each, BLOCK)]
        seed = self.frame.tables.options.seed
        shift = np.random.default_rng([seed & 0xFFFFFFFF, self.maps]).random(3)  # no cell's edge stands still
        origin = ((shift - 0.5) * 2.0 * self.width).astype(self.kind)
        found: dict[tuple[int, int], NDArray[np.float32]] = {}

        def draw(job: tuple[int, int, int]) -> None:
            number, start, count = job
            if not hasattr(self.rooms, "room"):
                self.rooms.room = Handle(wavefront.Room.of(self.kind))
            space = SPACE * BLOCK
            while True:
                rows = np.empty((COLUMNS, space + PAD), np.float32)
                kept = trace_block(
                    self.accel, self.scene, self.frame, self.aims, number, start, count, each, origin, self.rooms.room, rows
                )
                if kept <= space:
                    break
                space = int(kept)
            found[number, start] = rows[:, :kept].T.copy()

        thread_pool.parallel_for(draw, jobs, self.threads)
        landed = [
            np.concatenate([found.pop((self.maps + k, start)) for start in range(0, each, BLOCK)]) for k in range(MAPS)
        ]  # fmt: skip
        self.maps += MAPS
        self.so_far += MAPS * each
        return photon_map.build(landed, each, self.so_far, self.width, origin, self.kind, self.threads)


# --- in lanes ------------------------------------------------------------------------------------------------------------


@kernel
def trace_block(accel, scene, frame, aims, number, first, count, total, origin, room, landed):
    """Draw photons first … of `total` of a map and write those that land, about `origin`, to the columns of `landed`.

    How many they are is returned, even if there is no room for all.
    """
    saved = simd.flush_denormals()
    kept = 0
    for start in range(0, count, SIZE):
        left, source = _begin(scene, frame, aims, room, number, first + start, min(count - start, SIZE), 1.0 / total), 0
        for depth in range(frame.options.bounces + 1):
            if left == 0:
                break
            wavefront.intersect_stage(accel, scene, frame, room, source, left, depth + 1)
            left, kept = _land(scene, frame, room, source, left, depth, origin, landed, kept)
            source = 1 - source
    simd.restore_denormals(saved)
    return kept


@noinline_helper
def _begin(scene, frame, aims, room, number, first, n, each):
    """Photons first … first + n - 1 as they leave their lamps; how many have any power."""
    like = simd.load(room.state, 0)
    kept = 0
    for i in range(0, n, crosslane.width(like)):
        index = simd.iota(simd.load(room.whose, 0)) + (first + i)
        numbers = ops.int_like(index, number)
        ray, power = _sent(scene.tables, scene.light.emitters, aims, numbers, index, frame.options.seed)
        going = simd.first_lanes(n - i, like) & (ops.largest(power) > 0.0)
        keep3(room.state, kept, ray.origin, going)
        keep3(room.state, 3 * ROW + kept, ray.direction, going)
        keep3(room.state, 6 * ROW + kept, ops.scale(power, each), going)
        keep3(room.whose, kept, (ops.int_like(index, 0), numbers, index), going)
        kept += simd.count(going)
    return kept


@noinline_helper
def _land(scene, frame, room, source, n, depth, origin, landed, kept):
    """What n photons do where they arrive: (how many go on, how many have landed so far)."""
    tables, light, seed = scene.tables, scene.light, frame.options.seed
    like = simd.load(room.state, 0)
    base, target, going_on = source * STATE * ROW, (1 - source) * STATE * ROW, 0
    for i in range(0, n, crosslane.width(like)):
        zero = 0.0 * like
        start, direction = load3(room.state, base, 0, i), load3(room.state, base, 3, i)
        power = load3(room.state, base, 6, i)
        flags, number, index = load3(room.whose, source * 3 * ROW, 0, i)
        bent, spread, thrown = (flags & BENT) != 0, (flags & SPREAD) != 0, (flags & THROWN) != 0
        inside = wavefront.inside_of(medium_stack.outside(tables, zero), None, room, source * ROW + i, depth)
        hit, piece, here = wavefront.load_hits(room, i, simd.first_lanes(n - i, like))
        if ops.not_(ops.any_lane(here)):
            continue
        power = medium_stack.faded(inside, power, tables, ops.where(here, hit.t, 0.0))
        time = sobol.sample_time(number, index, seed, frame.shutter)
        point, hit = wavefront.point_of(tables, scene.tried.records, start, direction, hit, piece, here, time)
        point = normal_map.apply_maps(tables, _part(tables, point, number, index, depth, seed), hit, direction)
        shader = bsdf.evaluate_shader_filtered(tables, point, light.uses, inside)
        matt = bsdf.has_matt(shader)
        lands = here & bsdf.is_lit(shader) & (bent | (thrown & matt))
        if ops.any_lane(lands):
            _write(landed, kept, lands, spread | thrown, point, direction, power, origin)
            kept += simd.count(lands)
        u, v = _numbers(number, index, 2 * depth, seed)
        which, end = _numbers(number, index, 2 * depth + 1, seed)
        taken = bsdf.sample_bsdf(shader, light.uses, point, ops.negate(direction), u, v, which)
        sharp = taken.density >= bsdf.ONLY
        weight = ops.scale(taken.weight, _adjoint(point, shader, direction, taken.direction, sharp))
        chance = ops.minimum(ops.largest(weight), 1.0)
        metal = bsdf.is_polished(shader) & ops.not_(sharp)
        first = here & ops.not_(bent | thrown)
        (to, weight, chance), gleams = _by_highlight(
            light.gleaming, (taken.direction, weight, chance), point, shader, direction, u, v, which, first
        )
        metal = metal | gleams
        bent = bent | (thrown & matt & ops.not_(sharp))
        going = here & (sharp | bent | metal) & (end < chance)
        if ops.not_(ops.any_lane(going)):
            continue
        spread = spread | (bent & ops.not_(sharp))
        thrown = ops.not_(bent) & (thrown | metal)
        bent = bent | ops.not_(thrown)
        weight = ops.mul(power, ops.scale(weight, 1.0 / ops.maximum(chance, lights.TINY)))
        flags = ops.where(bent, BENT, 0) | ops.where(spread, SPREAD, 0) | ops.where(thrown, THROWN, 0)
        keep3(room.state, target + going_on, interaction.offset_origin(point, to), going)
        keep3(room.state, target + 3 * ROW + going_on, to, going)
        keep3(room.state, target + 6 * ROW + going_on, weight, going)
        keep3(room.whose, (1 - source) * 3 * ROW + going_on, (ops.to_int(flags) + 0 * number, number, index), going)
        inside = medium_stack.crossed(inside, None, tables, point, to)
        wavefront.keep_inside(inside, None, room, (1 - source) * ROW + going_on, going)
        going_on += simd.count(going)
    return going_on, kept


def _by_highlight(gleaming: Any, plain: Any, *of: Any) -> Any:
    raise NotImplementedError


@overload(_by_highlight, jit_options=HELPER)
def _by_highlight_in_kernels(gleaming, plain, *of):
    """((direction, weight, chance to go on), where that is so) of photons that a highlight throws first; not compiled where none does."""
    if isinstance(gleaming, types.Array):
        return lambda gleaming, plain, *of: _thrown(gleaming, plain, *of)
    return lambda gleaming, plain, *of: (plain, ops.bool_like(plain[2], False))


@helper
def _thrown(
    gleaming: Any, plain: tuple[Vec, Vec, Lane], point: Surface, shader: bsdf.Shader, arriving: Vec, u: Lane, v: Lane, which: Lane,
    first: Lane,
) -> tuple[tuple[Vec, Vec, Lane], Lane]:  # fmt: skip
    """The matt part's light is found by paths; fewer photons were aimed here, as the gain says, which those that are thrown make up for."""
    here = first & path.photon_covers_lobe(gleaming, point, shader)
    direction, weight = plain[0], plain[1]
    chance = plain[2]
    if ops.any_lane(here):
        to, share = bsdf.sample_lobe(shader, point.normal, ops.negate(arriving), u, v, which)
        share = ops.scale(share, _leaning(point, arriving, to))
        zero = 0.0 * chance
        share = ops.where3(ops.dot(to, point.geometric) > 0.0, share, (zero, zero, zero))
        direction, weight = ops.where3(here, to, direction), ops.where3(here, share, weight)
        chance = ops.where(here, ops.minimum(ops.largest(share) / ops.maximum(gleaming[point.instance], lights.TINY), 1.0), chance)
    return (direction, weight, chance), here


@helper
def _numbers(number: Lane, index: Lane, pair: int, seed: int) -> tuple[Lane, Lane]:
    dimension = ops.int_like(number, BEND + pair)
    if pair < WELL_SPREAD:
        return sobol.pair(number, index, dimension, seed)
    return sobol.hashed_pair(number, index, dimension, seed)


@helper
def _drawn_part(tables: Tables, point: Surface, number: Lane, index: Lane, depth: int, seed: int) -> Surface:
    return blend.choose_part(tables, point, sobol.hashed_pair(number, index, ops.int_like(number, PART + depth), seed)[0])


_part = blend.if_blended(_drawn_part)


@helper
def _adjoint(point: Surface, shader: bsdf.Shader, arriving: Vec, leaving: Vec, sharp: Lane) -> Lane:
    """What light that goes on is multiplied by beside the share that what is seen is.

    Radiance is not scaled by the square of the index here, and so light that enters a medium is: what leaves it again is as it was.
    """
    passes = ops.dot(arriving, point.geometric) * ops.dot(leaving, point.geometric) > 0.0
    through = bsdf.is_rough_glass(shader, sharp) & passes
    eta = rough_dielectric.eta(shader.frost, ops.where(point.front, 1.0 / shader.ior, shader.ior))
    eta = ops.where(through, eta, 1.0)
    return eta * eta * _leaning(point, arriving, leaving)


@helper
def _leaning(point: Surface, arriving: Vec, leaving: Vec) -> Lane:
    """What normals that lean do to light, but not to what is seen (Veach 1997, §5.3)."""
    bent = ops.absolute(ops.dot(arriving, point.normal) * ops.dot(leaving, point.geometric))
    true = ops.absolute(ops.dot(arriving, point.geometric) * ops.dot(leaving, point.normal))
    return ops.minimum(bent / ops.maximum(true, 1e-12), LARGEST)


@helper
def _write(landed: Any, kept: int, lands: Lane, spread: Lane, point: Surface, direction: Vec, power: Vec, origin: Any) -> None:
    """Write the photons of a mask's lanes, if there is room."""
    room = landed.shape[1]
    if kept + PAD > room:
        return
    place, normal = point.position, point.geometric
    place = (place[0] - origin[0], place[1] - origin[1], place[2] - origin[2])
    _write3(landed, kept, place, lands)
    _write3(landed, 3 * room + kept, ops.negate(direction), lands)
    _write3(landed, 6 * room + kept, power, lands)
    _write3(landed, 9 * room + kept, normal, lands)
    keep(landed, 12 * room + kept, ops.where(spread, -1.0 + 0.0 * place[0], 1.0), lands)


@helper
def _write3(landed: Any, at: int, v: Vec, lands: Lane) -> None:
    for k in range(3):
        keep(landed, at + k * landed.shape[1], v[k], lands)


@helper
def _sent(tables: Tables, table: emitters.Emitters, aim: Aims, number: Lane, index: Lane, seed: int) -> tuple[Ray, Vec]:
    """(rays from lamps to what gathers light, their power over the density of both)."""
    like = ops.to_float(index)
    a, b = sobol.pair(number, index, ops.int_like(like, ORIGIN), seed)
    pu, pv = sobol.pair(number, index, ops.int_like(like, PLACE), seed)
    du, dv = sobol.pair(number, index, ops.int_like(like, AIM), seed)
    e = _emitter(aim.upto, a)
    t = ops.int_like(like, 0)
    for k in range(aim.targets - 1):
        t = ops.where(b >= aim.within[e * aim.targets + k], k + 1, t)
    zero = 0.0 * a
    kind = table.kind[e]
    centre, radius = (aim.centre[t, 0], aim.centre[t, 1], aim.centre[t, 2]), aim.radius[t]
    place = (table.place[e, 0], table.place[e, 1], table.place[e, 2])
    normal = (table.normal[e, 0], table.normal[e, 1], table.normal[e, 2])
    color = (table.color[e, 0], table.color[e, 1], table.color[e, 2])
    row = ops.maximum(ops.to_int(table.light[e]), 0)
    far = (kind == emitters.DIRECTIONAL) | (kind == emitters.SUN)
    flat = (kind == emitters.RECTANGLE) | (kind == emitters.DISK) | (kind == emitters.TRIANGLE)
    ball = kind == emitters.SPHERE
    # Where on what has an area:
    x, y = emitters._on_plate(kind, pu, pv)
    side_u = (table.side_u[e, 0], table.side_u[e, 1], table.side_u[e, 2])
    side_v = (table.side_v[e, 0], table.side_v[e, 1], table.side_v[e, 2])
    on_plate = ops.add(place, ops.add(ops.scale(side_u, x), ops.scale(side_v, y)))
    up = (zero, zero, zero + 1.0)
    around = lights.in_cone(up, 2.0 * pu, pv)
    on_ball = ops.add(place, ops.scale(around, side_u[0]))
    start = ops.where3(flat, on_plate, ops.where3(ball, on_ball, place))
    normal = ops.where3(ball, around, normal)
    # Where to: a direction in the cone of the target, or for what is far a place on its disk.
    way = ops.sub(centre, start)
    height = lights.ball_height(ops.dot(way, way), radius)
    axis = ops.where3(ops.dot(way, way) > 0.0, ops.normalize(way), up)
    near_by = lights.in_cone(axis, du * height, dv)
    half = ops.sin(0.5 * (tables.lights.angle[row] + zero))
    half = ops.where(kind == emitters.SUN, half * half, zero)
    to_far = lights.in_cone(normal, pu * 2.0 * half, pv)
    s, r = ops.basis(to_far)
    wide, turn = ops.where(far, radius, 0.0) * ops.sqrt(du), 2.0 * math.pi * dv
    beside = ops.add(ops.scale(s, wide * ops.cos(turn)), ops.scale(r, wide * ops.sin(turn)))
    from_far = ops.add(ops.add(centre, beside), ops.scale(to_far, aim.reach))
    direction = ops.where3(far, ops.negate(to_far), near_by)
    start = ops.where3(far, from_far, start)
    density = zero
    for k in range(aim.targets):
        to = (aim.centre[k, 0] - start[0], aim.centre[k, 1] - start[1], aim.centre[k, 2] - start[2])
        size, chance = aim.radius[k], aim.chance[e * aim.targets + k]
        along, square = ops.dot(to, direction), ops.dot(to, to)
        off = ops.sub(to, ops.scale(direction, along))
        passes = (ops.dot(off, off) <= size * size) & (far | (along > 0.0) | (square <= size * size))
        hits = (t == k) | passes
        area = ops.where(far, math.pi * size * size, 2.0 * math.pi * lights.ball_height(square, zero + size))
        density = density + ops.where(hits, chance / ops.maximum(area, lights.TINY), 0.0)
    cosine = ops.dot(normal, direction)
    shines = ops.where(table.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0)) * table.area[e]
    cone = lights.spot_share(-cosine, tables.lights.cos_cone[row] + zero, tables.lights.cos_full[row] + zero)
    strength = ops.where(kind == emitters.SPOT, cone, zero + 1.0)
    strength = ops.where(flat | ball, shines, strength)
    strength = ops.where(far, 1.0 / (1.0 - half), strength)
    wide = ops.absolute(start[0]) + ops.absolute(start[1]) + ops.absolute(start[2]) + ops.sqrt(table.area[e])
    step = OFF * ops.roundoff(zero) * wide
    step = ops.where(flat | ball, step * ops.sign_of(cosine), 0.0)
    start = ops.add(start, ops.scale(normal, step))
    return Ray(start, direction, zero, zero + np.inf, None), ops.scale(color, strength / ops.maximum(density, lights.TINY))


@helper
def _emitter(upto: Any, u: Lane) -> Lane:
    """The first row whose sum is above u."""
    low = ops.int_like(u, 0)
    high = ops.int_like(u, len(upto) - 1)
    step = len(upto)
    while step > 0:
        middle = (low + high) >> 1
        beyond = u >= upto[middle]
        low, high = ops.where(beyond & (low < high), middle + 1, low), ops.where(beyond, high, middle)
        step >>= 1
    return ops.minimum(low, len(upto) - 1)
