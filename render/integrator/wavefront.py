"""Waves: thousands of paths at a time as structure of arrays, stage by stage, with all lanes of the machine in each.

A wave holds consecutive samples, pixel by pixel, few enough to stay in the cache. At each depth all rays are met with the scene
(`meet`), all surfaces shaded (`_shade`), which closes up the rays that go on and those to emitters, and these are tested (`_test`).
Rays for the trees are gathered by themselves, so that no lane waits for one that missed. Laine, Karras, Aila 2013, "Megakernels
Considered Harmful".
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from .. import camera, simd
from ..accel import intersect, primitive_hits
from ..accel.traverse import motion_alpha
from ..jit.kernel import HELPER, helper, kernel, noinline_helper, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, SIZE, add, gather3, keep, keep3, load3, store3
from ..material import bsdf, medium_stack
from ..sampling import sobol
from ..surface import interaction, triangle_records
from ..types import Hit, Lane, Ray, Surface, Vec
from . import path as integrator_path
from . import path_reuse
from .path import Connection, Path
from .ray_queue import as_searched, enters, for_search, from_search, pad, queue_up

CAMERA, OTHER = int(ir.Visibility.CAMERA), integrator_path.OTHER_RAY
STATE = 11  # rows of a path: origin, direction, weight, density, and its phase, or 1 where it is straight
ASKED = 10  # rows of a connection: origin, direction, distance, light
_WIDTH64 = simd.WIDTH64


class Room(NamedTuple):
    """What a thread's waves are kept in, each row of ROW numbers; `float` is float32 or float64, and `int` as wide."""

    state: Any  # (2 · STATE · ROW,) float: rays on their way, and those that go on from them
    whose: Any  # (2 · 3 · ROW,) int: place in the wave, pixel (y · width + x) and sample of those
    met: Any  # (3 · ROW,) float: t, u, v of what they met
    what: Any  # (3 · ROW,) int: piece or -1, instance or -1, primitive
    asked: Any  # (ASKED · ROW,) float: rays to emitters
    asker: Any  # (ROW,) int: whose they are
    queue: Any  # (ROW,) int64: rays for the trees
    light: Any  # (4 · ROW,) float: what paths found, red, green, blue and coverage
    items: Any  # (4 · ROW,) int: x, y, sample and place in the tile of each path
    near: Any  # (ROW,) float: where camera rays begin
    inside: Any  # (2 · ROW,) int: the media that rays are in, where a scene has any
    facing: Any  # (2 · 3 · ROW,) float: the normals of where rays come from, where there are many lamps
    shared: Any  # reuse.Shared, or reuse.Alone

    @classmethod
    def of(cls, kind: type, reuses: bool = False) -> Room:
        """Room for waves of float32 or float64, whose paths may be shared by the pixels of a block."""
        whole = np.int32 if kind == np.float32 else np.int64

        def row(count: int, what: type) -> NDArray[Any]:
            made = simd.aligned_empty(count * ROW, what)
            made[:] = 0
            return made

        return cls(
            row(2 * STATE, kind), row(2 * 3, whole), row(3, kind), row(3, whole), row(ASKED, kind), row(1, whole), row(1, np.int64),
            row(4, kind), row(4, whole), row(1, kind), row(2, whole), row(2 * 3, kind),
            path_reuse.Shared.of(kind) if reuses else path_reuse.Alone(),
        )  # fmt: skip


class NoTrees(NamedTuple):
    """Stands for trees where all things are pieces."""


class Scene(NamedTuple):
    """What waves are drawn from."""

    tables: Any  # as narrow as the waves' numbers
    tried: Any  # pieces.Tried
    light: Any  # paths.Light
    trees: bool  # whether there are any
    low: Any  # (3,) float64: the box around it; inf: endless
    high: Any


@kernel
def draw_tile(accel, scene, frame, tile, first, count, total, film, room):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film."""
    saved = simd.flush_denormals()
    filled = 0
    width = tile.x1 - tile.x0
    for y in range(tile.y0, tile.y1):
        for x in range(tile.x0, tile.x1):
            row, column = y - tile.y0, x - tile.x0
            for s in range(first[row, column], first[row, column] + count[row, column]):
                room.items[filled], room.items[ROW + filled] = x, y
                room.items[2 * ROW + filled], room.items[3 * ROW + filled] = s, row * width + column
                filled += 1
                if filled == SIZE:
                    filled = render_wave(accel, scene, frame, total, film, room, filled, width)
    render_wave(accel, scene, frame, total, film, room, filled, width)
    simd.restore_denormals(saved)


@helper
def render_wave(accel: Any, scene: Any, frame: Any, total: int, film: Any, room: Any, n: int, width: int) -> int:
    """Draw the room's n samples, to the film; how many wait then: 0."""
    if n > 0:
        _wave(accel, scene, frame, total, room, n)
        _collect(film, room, n, width)
    return 0


@noinline_helper
def _wave(accel, scene, frame, total, room, n):
    """The light of n samples, to the room."""
    _begin(scene.tables, frame, total, room, n)
    path_reuse.cleared(room.shared, 0, n)
    left, source = n, 0
    for depth in range(frame.options.bounces + 2):
        intersect_stage(accel, scene, frame, room, source, left, depth)
        left, asked = _shade(scene, frame, room, source, left, depth)
        _test(accel, scene, frame, room, asked)
        source = 1 - source
        if depth == 0:
            path_reuse.parted_light(room.shared, 0, room.light, n)
        if left == 0:
            break
    path_reuse.joined(room.shared, 0, accel, scene, room, frame.options.shadows, n)


@helper
def _collect(film: Any, room: Any, n: int, width: int) -> None:
    """Add what n paths found to the film, in their order; what is not finite is left out and counted, what has no place left out."""
    for k in range(n):
        place = room.items[3 * ROW + k]
        if place < 0:
            continue
        row, column = place // width, place % width
        red, green, blue = float(room.light[k]), float(room.light[ROW + k]), float(room.light[2 * ROW + k])
        if abs(red + green + blue) < np.inf:
            film.color[row, column, 0] += red
            film.color[row, column, 1] += green
            film.color[row, column, 2] += blue
        else:
            film.issues[row, column] += 1
        film.alpha[row, column] += float(room.light[3 * ROW + k])


# --- stages --------------------------------------------------------------------------------------------------------------


@noinline_helper
def _begin(tables, frame, total, room, n):
    """Camera rays of n samples."""
    view, options = frame.picture, frame.options
    step = crosslane.width(simd.load(room.state, 0))
    for i in range(0, n, step):
        x, y, s = simd.load(room.items, i), simd.load(room.items, ROW + i), simd.load(room.items, 2 * ROW + i)
        pixel, s = sobol.zorder_index(x, y, s, view.width, frame.order)
        dx, dy = sobol.offset(pixel, s, total, options.seed, frame.filter)
        x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
        time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
        ray = camera.generate_ray(tables, view, frame.lens, x, y, pixel, s, options.seed, time)
        zero = 0.0 * dx
        store3(room.state, 0, 0, i, (ray.origin[0] + zero, ray.origin[1] + zero, ray.origin[2] + zero))
        store3(room.state, 0, 3, i, ray.direction)
        store3(room.state, 0, 6, i, (zero + 1.0, zero + 1.0, zero + 1.0))
        simd.store(room.state, 9 * ROW + i, zero + bsdf.ONLY)
        simd.store(room.state, 10 * ROW + i, zero + 1.0)
        simd.store(room.near, i, zero + ray.t_min)
        simd.store(room.met, i, zero + ray.t_max)
        store3(room.whose, 0, 0, i, (simd.iota(x) + i, pixel, s))
        store3(room.light, 0, 0, i, (zero, zero, zero))
        simd.store(room.light, 3 * ROW + i, zero + 1.0)


@noinline_helper
def intersect_stage(accel, scene, frame, room, source, n, depth):
    """What n rays meet first: pieces by trying each, then the rest by trees, nearer than those."""
    base, seed = source * STATE * ROW, frame.options.seed
    like = simd.load(room.state, 0)
    step = crosslane.width(like)
    queued = 0
    for i in range(0, n, step):
        origin, direction = load3(room.state, base, 0, i), load3(room.state, base, 3, i)
        near, far = 0.0 * like, 0.0 * like + np.inf
        if depth == 0:
            near, far = simd.load(room.near, i), simd.load(room.met, i)
        t, piece, a, b = primitive_hits.closest(scene.tried.seen, origin, direction, near, far)
        simd.store(room.met, i, t)
        simd.store(room.met, ROW + i, a)
        simd.store(room.met, 2 * ROW + i, b)
        simd.store(room.what, i, piece)
        simd.store(room.what, ROW + i, ops.int_like(t, -1))
        if scene.trees:
            inside = simd.first_lanes(n - i, like) & enters(scene, origin, direction, t)
            queued += queue_up(room, queued, i, inside)
    pad(room, queued)
    wide = simd.load(room.queue, 0)
    for j in range(0, queued, _WIDTH64):
        k = simd.load(room.queue, j)
        origin, direction = gather3(room.state, base, 0, k), gather3(room.state, base, 3, k)
        near = 0.0 * origin[0]
        if depth == 0:
            near = room.near[k]
        visible = CAMERA if depth == 0 else OTHER
        pixel, sample = room.whose[k + (source * 3 + 1) * ROW], room.whose[k + (source * 3 + 2) * ROW]
        time = sobol.sample_time(pixel, sample, seed, frame.shutter)
        ray = as_searched(origin, direction, near, room.met[k], time)
        hit = met_by_chance(accel, ray, np.int64(visible), for_search(pixel), for_search(sample), depth, seed)
        nearer = from_search(hit.instance, wide) >= 0
        simd.scatter(room.met, k, from_search(hit.t, near), nearer)
        simd.scatter(room.met, k + ROW, from_search(hit.u, near), nearer)
        simd.scatter(room.met, k + 2 * ROW, from_search(hit.v, near), nearer)
        instance, primitive = from_search(hit.instance, wide), from_search(hit.primitive, wide)
        simd.scatter(room.what, k, _row_of(scene, instance, primitive), nearer)
        simd.scatter(room.what, k + ROW, instance, nearer)
        simd.scatter(room.what, k + 2 * ROW, primitive, nearer)


@helper
def _row_of(scene: Any, instance: Lane, primitive: Lane) -> Lane:
    """The row of pieces.Records of what trees found, -1 where it has none; a formula's primitive tells its root, not a triangle."""
    first = scene.tried.records.first[ops.maximum(instance, 0)]
    return ops.where(first == triangle_records.NONE, -1, first + primitive)


def met_by_chance(accel: Any, ray: Ray, visible: Any, pixel: Lane, sample: Lane, depth: int, seed: int) -> Hit:
    """What rays meet first; what is not wholly there by chance."""
    raise NotImplementedError


@overload(met_by_chance, jit_options=HELPER)
def _closest_in_trees(accel, ray, visible, pixel, sample, depth, seed):
    """What rays meet in the trees; not compiled where there are none. Chance lets them pass what is not wholly there."""
    if accel.field("search") is None:

        def nothing(accel, ray, visible, pixel, sample, depth, seed):
            zero = 0.0 * ray.t_min
            none = ops.int_like(zero, -1)
            return Hit(zero, none, none, zero, zero)

        return nothing

    def first(accel, ray, visible, pixel, sample, depth, seed):
        return intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, False)

    def beyond(accel, ray, visible, pixel, sample, depth, seed):
        hit = intersect.find(accel, ray, ops.bool_like(ray.t_min, True), visible, False)
        passed, layer = ops.bool_like(ray.t_min, True), 0
        while True:
            there, onward = motion_alpha.alpha_at_hit(accel, ray, hit)
            passed = passed & (integrator_path.passing(pixel, sample, depth, layer, seed) >= there)
            if ops.not_(ops.any_lane(passed)):
                return hit
            ray = Ray(ray.origin, ray.direction, ops.where(passed, onward, ray.t_min), ray.t_max, ray.time)
            again = intersect.find(accel, ray, passed, visible, False)
            hit = Hit(
                ops.where(passed, again.t, hit.t), ops.where(passed, again.instance, hit.instance),
                ops.where(passed, again.primitive, hit.primitive), ops.where(passed, again.u, hit.u),
                ops.where(passed, again.v, hit.v),
            )  # fmt: skip
            layer += 1

    return beyond if motion_alpha.has_opacity(accel) else first


def _passing(accel: Any, ray: Ray) -> Lane:
    raise NotImplementedError


@overload(_passing, jit_options=HELPER)
def _passing_in_trees(accel, ray):
    """The share of light that passes the trees, 0 to 1."""
    if accel.field("search") is None:
        return lambda accel, ray: 0.0 * ray.t_min + 1.0
    unused: Any = None  # tables, which kernels have beside their trees
    return lambda accel, ray: intersect.transmittance(accel, unused, ray, ops.bool_like(ray.t_min, True))


@helper
def load_hits(room: Any, i: int, active: Lane) -> tuple[Hit, Lane, Lane]:
    """(what rays i … met, its piece or -1, whether there is anything)."""
    piece, instance = simd.load(room.what, i), simd.load(room.what, ROW + i)
    t, u, v = load3(room.met, 0, 0, i)
    return Hit(t, instance, simd.load(room.what, 2 * ROW + i), u, v), piece, active & ((piece >= 0) | (instance >= 0))


@noinline_helper
def _in_full(tables, ray, hit):
    return interaction.make_interaction(tables, ray, hit)


@helper
def point_of(
    tables: Any, records: Any, origin: Vec, direction: Vec, hit: Hit, piece: Lane, here: Lane, time: Any
) -> tuple[Surface, Hit]:  # fmt: skip
    """The surface that rays met, and the hit with the instance and primitive of what is a piece."""
    row = ops.maximum(piece, 0)
    of_piece = here & (piece >= 0)
    x, y, z, inverse, of_instance, of_primitive, of_material, is_plain = simd.gather_rows(records.rows, row * 8, 8)
    instance = ops.where(of_piece, ops.to_int(of_instance), ops.where(here, hit.instance, -1))
    hit = Hit(hit.t, instance, ops.where(of_piece, ops.to_int(of_primitive), hit.primitive), hit.u, hit.v)
    plain = of_piece & (is_plain > 0.5)
    t = ops.where(of_piece, hit.t, 0.0)
    position = ops.along(origin, direction, t)
    outward = (x, y, z)
    if ops.any_lane(inverse > 0.0):
        curved = ops.scale(ops.sub(position, outward), inverse)
        # Of unit length again: else each surface doubles what the one before was off, and after four of them rays leave a ball from inside.
        curved = ops.scale(curved, 1.5 - 0.5 * ops.dot(curved, curved))
        outward = ops.where3(inverse > 0.0, curved, outward)
    front = ops.dot(direction, outward) < 0.0
    zero = ops.full_like(t, 0.0)
    side = ops.where(front, zero + 1.0, zero - 1.0)
    facing = ops.scale(outward, side)
    rounded = plain & (is_plain > triangle_records.PLAIN)
    shaded, lift = triangle_records.interpolate_normal(records.rounded, outward, row, rounded, hit.u, hit.v, side)
    shaded = ops.scale(shaded, side)
    size = abs(outward[0]) * (abs(origin[0]) + abs(position[0])) + abs(outward[1]) * (abs(origin[1]) + abs(position[1]))
    size = size + abs(outward[2]) * (abs(origin[2]) + abs(position[2])) + ops.maximum(-inverse, 0.0)
    white = (zero + 1.0, zero + 1.0, zero + 1.0)
    point = Surface(
        position, position, facing, shaded, outward, (zero, zero), (zero + 1.0, zero + 1.0), front, ops.maximum(instance, 0),
        ops.to_int(of_material), white, size * (interaction.ROUNDING * ops.roundoff(zero)), time, None, lift, None,
    )  # fmt: skip
    others = here & ops.not_(plain)
    if ops.any_lane(others):
        ray = Ray(origin, direction, zero, zero + np.inf, time)
        full = _in_full(tables, ray, Hit(hit.t, ops.where(others, instance, -1), hit.primitive, hit.u, hit.v))
        point = Surface(
            ops.where3(others, full.position, position), full.local, ops.where3(others, full.geometric, facing),
            ops.where3(others, full.normal, shaded), full.local_normal, full.uv, full.metric, ops.where(others, full.front, front),
            point.instance, ops.where(others, full.material, point.material), ops.where3(others, full.color, white),
            ops.where(others, full.offset, point.offset), time, None, ops.where3(others, full.lift, lift), None,
        )  # fmt: skip
    return point, hit


@noinline_helper
def _shade(scene, frame, room, source, n, depth):
    """Shade what n rays met: (how many rays go on, how many to emitters)."""
    tables, light, options = scene.tables, scene.light, frame.options
    like = simd.load(room.state, 0)
    step = crosslane.width(like)
    base, target = source * STATE * ROW, (1 - source) * STATE * ROW
    kept, asked = 0, 0
    for i in range(0, n, step):
        active = simd.first_lanes(n - i, like)
        density = simd.load(room.state, base + 9 * ROW + i)
        code = simd.load(room.state, base + 10 * ROW + i)
        straight = (code > 0.5) & (code < 1.5)
        inside = inside_of(medium_stack.outside(tables, density), None, room, source * ROW + i, depth)
        path = Path(
            load3(room.state, base, 0, i), load3(room.state, base, 3, i), load3(room.state, base, 6, i), density, straight, inside,
            ops.where(code > 1.5, code, 0.0), _facing_of(scene.light.emitters.tree.below, room, source * 3 * ROW + i),
        )  # fmt: skip
        slot, pixel, sample = load3(room.whose, source * 3 * ROW, 0, i)
        hit, piece, here = load_hits(room, i, active)
        missed = active & ops.not_(here)
        if ops.any_lane(missed):
            behind, less = integrator_path.environment_radiance(tables, light, options, path, missed, depth)
            if depth == 0:  # slots are those of the lanes
                store3(room.light, 0, 0, i, behind)
                simd.store(room.light, 3 * ROW + i, 1.0 - less)
            elif ops.any_lane(missed & ((ops.largest(behind) > 0.0) | (less > 0.0))):
                path_reuse.found(room.shared, room.light, slot, behind, missed, depth)
                at = slot + 3 * ROW
                simd.scatter(room.light, at, simd.gather(room.light, at, missed) - less, missed)
            if ops.not_(ops.any_lane(here)):
                continue
        time = sobol.sample_time(pixel, sample, options.seed, frame.shutter)
        point, hit = point_of(tables, scene.tried.records, path.origin, path.direction, hit, piece, here, time)
        sent, connection, onward, going = integrator_path.shade_vertex(tables, light, options, path, hit, point, here, pixel, sample, depth)
        bright = here & (ops.largest(sent) > 0.0)
        if ops.any_lane(bright):
            path_reuse.found(room.shared, room.light, slot, sent, bright, depth)
        onward = path_reuse.parted(room.shared, onward, i, slot, point, here, going, depth)
        wanted = connection.wanted
        if ops.any_lane(wanted):
            _ask(room, asked, slot, connection)
            asked += simd.count(wanted)
        if ops.any_lane(going):
            keep3(room.state, target + kept, onward.origin, going)
            keep3(room.state, target + 3 * ROW + kept, onward.direction, going)
            keep3(room.state, target + 6 * ROW + kept, onward.weight, going)
            keep(room.state, target + 9 * ROW + kept, onward.density, going)
            keep(room.state, target + 10 * ROW + kept, ops.where(onward.straight, 1.0, onward.phase), going)
            keep3(room.whose, (1 - source) * 3 * ROW + kept, (slot, pixel, sample), going)
            keep_inside(onward.inside, None, room, (1 - source) * ROW + kept, going)
            _keep_facing(onward.facing, None, room, (1 - source) * 3 * ROW + kept, going)
            kept += simd.count(going)
    return kept, asked


@helper
def _carried(outside: Any, plain: Any, room: Any, at: int, depth: int) -> Lane:
    return outside if depth == 0 else simd.load(room.inside, at)


@helper
def _carry(inside: Lane, plain: Any, room: Any, at: int, going: Lane) -> None:
    keep(room.inside, at, inside, going)


@helper
def _carry_facing(facing: Vec, plain: Any, room: Any, at: int, going: Lane) -> None:
    keep3(room.facing, at, facing, going)


_keep_facing = specialize_if_present(_carry_facing)


def _facing_of(below: Any, room: Any, at: int) -> Any:
    raise NotImplementedError


@overload(_facing_of, jit_options=HELPER)
def _facing_of_kernel(below, room, at):
    """The normals of where rays come from; None where lamps are few."""
    if below.layout:
        return lambda below, room, at: load3(room.facing, at, 0, 0)
    return lambda below, room, at: None


inside_of = specialize_if_present(_carried)  # the media that rays are in, of camera rays what is outside: room, place, depth
keep_inside = specialize_if_present(_carry)


@helper
def _ask(room: Any, asked: int, slot: Lane, connection: Connection) -> None:
    wanted = connection.wanted
    keep3(room.asked, asked, connection.origin, wanted)
    keep3(room.asked, 3 * ROW + asked, connection.direction, wanted)
    keep(room.asked, 6 * ROW + asked, connection.distance, wanted)
    keep3(room.asked, 7 * ROW + asked, connection.light, wanted)
    keep(room.asker, asked, slot, wanted)


@noinline_helper
def _test(accel, scene, frame, room, n):
    """Give n connections' light to their paths where nothing stands in the way."""
    options = frame.options
    like = simd.load(room.state, 0)
    step = crosslane.width(like)
    queued = 0
    for i in range(0, n, step):
        origin, direction = load3(room.asked, 0, 0, i), load3(room.asked, 0, 3, i)
        distance = simd.load(room.asked, 6 * ROW + i)
        lit = simd.first_lanes(n - i, like)
        if options.shadows:
            lit = lit & ops.not_(primitive_hits.blocked(scene.tried.blocking, origin, direction, distance))
            if scene.trees:
                inside = lit & (distance > 0.0) & enters(scene, origin, direction, distance)
                queued += queue_up(room, queued, i, inside)
                lit = lit & ops.not_(inside)
        if ops.any_lane(lit):
            add(room.light, ops.where(lit, simd.load(room.asker, i), 0), load3(room.asked, 0, 7, i), lit)
    pad(room, queued)
    wide = simd.load(room.queue, 0)
    for j in range(0, queued, _WIDTH64):
        k = simd.load(room.queue, j)
        origin, direction = gather3(room.asked, 0, 0, k), gather3(room.asked, 0, 3, k)
        slot = room.asker[k]
        x, y, s = room.items[slot], room.items[slot + ROW], room.items[slot + 2 * ROW]
        pixel, s = sobol.zorder_index(x, y, s, frame.picture.width, frame.order)
        time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
        ray = as_searched(origin, direction, 0.0 * origin[0], room.asked[k + 6 * ROW], time)
        share = from_search(_passing(accel, ray), origin[0])
        lit = (share > 0.0) & simd.first_lanes(queued - j, wide)
        if ops.any_lane(lit):
            for c in range(3):
                at = slot + c * ROW
                light = room.asked[k + (7 + c) * ROW] * share
                simd.scatter(room.light, at, room.light[at] + light, lit)
