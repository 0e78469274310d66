"""Wavefront path tracer: thousands of paths at a time, as structure of arrays, in stages that use all lanes of vectors.

A wave holds consecutive samples, pixel by pixel, few enough for the cache. At each depth the stages are `intersect_stage` for all rays,
`_shade_stage` for all hits, which compacts the continuing rays and the shadow rays, and `_shadow_stage`. Rays for the BVH are compacted,
too, so that no lane idles for a ray that missed. Laine, Karras, Aila 2013, "Megakernels Considered Harmful".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import camera, simd
from ..accel import intersect, primitive_hits
from ..jit.kernel import helper, kernel, noinline_helper, separate_helper, specialize_either, specialize_if_present
from ..lanes import crosslane, ops
from ..lanes.soa import ROW, SIZE, compress_store, compress_store3, gather3, load3, store3
from ..material import dispersion, medium_stack
from ..material.shader import ONLY
from ..sampling import sobol
from ..sampling.pixel_groups import CELL, GROUP, SIDE, cell_extent, place_of
from ..simd.registration import overload
from ..types import Lane, Ray
from . import path_reuse
from .path import shade_vertex
from .path_emission import environment_radiance, weigh_glow
from .photon_maps import photon_beams, photon_map, photon_volume
from .ray_queue import as_searched, attenuate_between, enters, for_search, from_search, pad, queue_up
from .state import flights
from .state.path_state import Connection, PathSample, PathState
from .wave_intersection import intersect_stage, load_hits, surface_at
from .wave_media import add_glow, deliver, deliver_share, transmit_stage
from .wave_memory import (
    BEND,
    BENT,
    END,
    LIGHT,
    START,
    STATE,
    STRAIGHT,
    load_axis,
    load_body,
    load_divided,
    load_facing,
    load_leaving,
    load_links,
    load_medium,
    load_near,
    store_body,
    store_optional,
    store_optional3,
)

BEND_HEIGHT = 0.25  # of a distance: clears the surfaces between points whose normals are FACING
_WIDTH64 = simd.WIDTH64


@kernel
def draw_tile(accel, scene, frame, tile, first, count, total, film, memory):
    """Add samples first … first + count - 1 of `total` of each pixel of a tile to its film."""
    saved = simd.flush_denormals()
    filled = 0
    width = tile.x1 - tile.x0
    for y in range(tile.y0, tile.y1):
        for x in range(tile.x0, tile.x1):
            row, column = y - tile.y0, x - tile.x0
            for s in range(first[row, column], first[row, column] + count[row, column]):
                memory.items[filled], memory.items[ROW + filled] = x, y
                memory.items[2 * ROW + filled], memory.items[3 * ROW + filled] = s, row * width + column
                memory.items[4 * ROW + filled], memory.items[5 * ROW + filled] = x, y
                filled += 1
                if filled == SIZE:
                    filled = render_wave(accel, scene, frame, total, film, memory, filled, width)
    render_wave(accel, scene, frame, total, film, memory, filled, width)
    simd.restore_denormals(saved)


@kernel
def draw_tile_in_groups(accel, scene, frame, tile, first, count, total, film, memory):
    """As draw_tile, by groups of pixels that share paths; pixels of a cell have equal first samples and counts.

    Cells are those of the picture's grid. Pixels of a cell outside the tile are traced for path reuse alone.
    """
    saved = simd.flush_denormals()
    filled = 0
    for cell_y in range(tile.y0 // CELL * CELL, tile.y1, CELL):
        for cell_x in range(tile.x0 // CELL * CELL, tile.x1, CELL):
            row, column = max(cell_y - tile.y0, 0), max(cell_x - tile.x0, 0)
            begin, end = first[row, column], first[row, column] + count[row, column]
            for y in range(cell_extent(cell_y, frame.picture.height) // SIDE):
                for x in range(cell_extent(cell_x, frame.picture.width) // SIDE):
                    for s in range(begin, end):
                        filled += _queue_group(frame, tile, memory, filled, cell_x, cell_y, x, y, s)
                        if filled == SIZE:
                            filled = render_wave(accel, scene, frame, total, film, memory, filled, tile.x1 - tile.x0)
    render_wave(accel, scene, frame, total, film, memory, filled, tile.x1 - tile.x0)
    simd.restore_denormals(saved)


@helper
def _queue_group(frame, tile, memory, filled, cell_x, cell_y, x, y, sample):
    """Queue a sample of the pixels of group x, y of the cell at left, top; return their number, 0 if none lies in the tile."""
    columns, rows = cell_extent(cell_x, frame.picture.width), cell_extent(cell_y, frame.picture.height)
    seen = False
    for k in range(GROUP):
        column, row = place_of(cell_x, cell_y, columns, rows, x, y, k)
        inside = (tile.x0 <= column) & (column < tile.x1) & (tile.y0 <= row) & (row < tile.y1)
        place = (row - tile.y0) * (tile.x1 - tile.x0) + column - tile.x0
        memory.items[filled + k], memory.items[ROW + filled + k] = column, row
        memory.items[2 * ROW + filled + k], memory.items[3 * ROW + filled + k] = sample, place if inside else -1
        memory.items[4 * ROW + filled + k] = cell_x + x * SIDE + k % SIDE
        memory.items[5 * ROW + filled + k] = cell_y + y * SIDE + k // SIDE
        seen = seen | inside
    return GROUP if seen else 0


@helper
def render_wave(accel: Any, scene: Any, frame: Any, total: int, film: Any, memory: Any, n: int, width: int) -> int:
    """Add the n samples in memory to the film; return 0, the number of samples that are left."""
    if n > 0:
        _trace_wave(accel, scene, frame, total, memory, n)
        _collect(film, memory, n, width)
    return 0


@noinline_helper
def _trace_wave(accel, scene, frame, total, memory, n):
    """Write the light of n samples to memory."""
    _generate_stage(scene.tables, frame, total, memory, n)
    path_reuse.clear(memory.shared, 0, n)
    path_count, source = n, 0
    for depth in range(frame.options.bounces + 2):
        intersect_stage(accel, scene, frame, memory, source, path_count, depth)
        path_count, shadow_count, gathered = _shade_stage(scene, frame, memory, source, path_count, depth)
        _shadow_stage(accel, scene, frame, memory, shadow_count)
        transmit_stage(medium_stack.scattering(scene.tables), None, accel, scene, frame, memory, source, shadow_count, depth)
        _photon_stage(scene.light.photons, None, accel, scene, frame, memory, gathered, depth)
        source = 1 - source
        if depth <= 1:
            path_reuse.separate_light(memory.shared, 0, memory.light, n, depth)
        if path_count == 0:
            break
    path_reuse.combine(memory.shared, 0, accel, scene, memory, frame.options.shadows, n)


@helper
def _collect(film: Any, memory: Any, n: int, width: int) -> None:
    """Add the light of n paths to the film, in their order.

    Radiance that is not finite is left out and counted; paths without a place in the tile are left out.
    """
    for k in range(n):
        place = memory.items[3 * ROW + k]
        if place < 0:
            continue
        row, column = place // width, place % width
        red, green, blue = float(memory.light[k]), float(memory.light[ROW + k]), float(memory.light[2 * ROW + k])
        if abs(red + green + blue) < np.inf:
            film.color[row, column, 0] += red
            film.color[row, column, 1] += green
            film.color[row, column, 2] += blue
        else:
            film.issues[row, column] += 1
        film.alpha[row, column] += float(memory.light[3 * ROW + k])


# --- stages --------------------------------------------------------------------------------------------------------------


@separate_helper
def _generate_stage(tables, frame, total, memory, n):
    """Write the camera rays of n samples."""
    view, options = frame.picture, frame.options
    step = crosslane.width(simd.load(memory.state, 0))
    for i in range(0, n, step):
        x, y, s = load3(memory.items, 0, 0, i)
        range_x, range_y = simd.load(memory.items, 4 * ROW + i), simd.load(memory.items, 5 * ROW + i)
        pixel, number = sobol.zorder_index(x, y, s, view.width, frame.order)
        path_pixel, s = sobol.zorder_index(range_x, range_y, s, view.width, frame.order)
        dx, dy = sobol.offset(pixel, number, total, options.seed, frame.filter)
        x, y = ops.to_float(x) + 0.5 + dx, ops.to_float(y) + 0.5 + dy
        time = sobol.sample_time(path_pixel, s, options.seed, frame.shutter)
        ray = camera.generate_ray(tables, view, frame.lens, x, y, pixel, number, options.seed, time)
        zero = 0.0 * dx
        store3(memory.state, 0, 0, i, (ray.origin[0] + zero, ray.origin[1] + zero, ray.origin[2] + zero))
        store3(memory.state, 0, 3, i, ray.direction)
        store3(memory.state, 0, 6, i, (zero + 1.0, zero + 1.0, zero + 1.0))
        simd.store(memory.state, 9 * ROW + i, zero + ONLY)
        simd.store(memory.state, 10 * ROW + i, zero + 1.0)
        simd.store(memory.near, i, zero + ray.t_min)
        simd.store(memory.hit, i, zero + ray.t_max)
        store3(memory.index, 0, 0, i, (simd.iota(x) + i, path_pixel, s))
        store3(memory.light, 0, 0, i, (zero, zero, zero))
        simd.store(memory.light, 3 * ROW + i, zero + 1.0)


def _transmittance(accel: Any, ray: Ray, active: Lane, visible_bit: int) -> Lane:
    raise NotImplementedError


@overload(_transmittance)
def _transmittance_in_kernels(accel, ray, active, visible_bit):
    """The transmittance of shadow rays through the BVH, 0 to 1."""
    if accel.field("search") is None:
        return lambda accel, ray, active, visible_bit: 0.0 * ray.t_min + 1.0
    unused: Any = None  # tables, which kernels have beside their trees
    return lambda accel, ray, active, visible_bit: intersect.transmittance(accel, unused, ray, active, visible_bit)


@helper
def _pass_all(accel: Any, ray: Ray, memory: Any, k: Lane) -> Lane:
    return _transmittance(accel, ray, ops.bool_like(ray.t_min, True), intersect.SHADOW)


@helper
def _pass_blockers(linked: Any, accel: Any, ray: Ray, memory: Any, k: Lane) -> Lane:
    """The transmittance of shadow rays whose lights have different blockers: one search for each set of these."""
    blockers = for_search(memory.blockers[k])
    share = 0.0 * ray.t_min + 1.0
    for s in range(len(linked.sets)):
        mine = ops.bool_like(ray.t_min, True) & (blockers == linked.sets[s])
        if ops.any_lane(mine):
            share = ops.where(mine, _transmittance(accel, ray, mine, linked.sets[s]), share)
    return share


_unblocked = specialize_either(_pass_blockers, _pass_all)


@noinline_helper
def _shade_stage(scene, frame, memory, source, n, depth):
    """Shade the hits of n rays; return (continuing rays, shadow rays, estimates from photons)."""
    tables, light, options = scene.tables, scene.light, frame.options
    like = simd.load(memory.state, 0)
    path_count, shadow_count, gathered = 0, 0, 0
    for i in range(0, n, crosslane.width(like)):
        active = simd.first_lanes(n - i, like)
        path = _load_path(scene, options, memory, source, i, depth)
        slot, pixel, sample = load3(memory.index, source * 3 * ROW, 0, i)
        index = PathSample(pixel, sample, depth, options.seed)
        hit, piece, surfaces = load_hits(memory, i, active)
        time = sobol.sample_time(pixel, sample, options.seed, frame.shutter)
        end = ops.where(surfaces, hit.t, np.inf)
        flown = flights.fly(medium_stack.scattering(tables), None, tables, path, active, end, index, time)
        start, path = path, flights.weighted(flown, path)
        missed = flights.without_scattered(flown, active & ops.not_(surfaces))
        surfaces = flights.without_scattered(flown, surfaces)
        if ops.any_lane(missed):
            _add_environment(tables, light, options, memory, path, missed, slot, i, depth)
        flown = weigh_glow(light.emitters.media, flown, tables, light, path, depth > options.bounces)
        flown = photon_beams.along(photon_beams.of(light.photons), flown, tables, start, active, end, index, options.bounces)
        add_glow(flown, None, memory, slot, active, depth)
        if ops.not_(ops.any_lane(flights.any_vertex(flown, surfaces))):
            continue
        point, hit = surface_at(tables, scene.primitives.records, path.origin, path.direction, hit, piece, surfaces, time)
        event = flights.event_of(flown, None, tables, path, point, surfaces)
        vertices = flights.vertices(event, surfaces)
        direct = index
        if depth == 0:  # light samples of first surfaces are not shared: those of neighbors have adjacent ranges of the sequence
            x, y, s = load3(memory.items, 0, 0, i)
            place, number = sobol.zorder_index(x, y, s, frame.picture.width, frame.order)
            direct = PathSample(place, number, depth, options.seed)
        sent, connection, onward, going, vertex = shade_vertex(tables, light, options, path, hit, point, vertices, index, direct, event)
        bright = vertices & (ops.largest(sent) > 0.0)
        if ops.any_lane(bright):
            path_reuse.add_light(memory.shared, memory.light, slot, sent, bright, depth)
        onward = path_reuse.share_vertex(memory.shared, onward, tables, light.uses, vertex, connection, i, slot, vertices, depth)
        if ops.any_lane(connection.wanted):
            _push_shadow_ray(memory, shadow_count, slot, connection)
            shadow_count += simd.count(connection.wanted)
        gathered = _push_estimate(vertex.gathered, gathered, memory, slot, vertices)
        if ops.any_lane(going):
            _push_path(memory, 1 - source, path_count, onward, (slot, pixel, sample), going)
            path_count += simd.count(going)
    return path_count, shadow_count, gathered


@helper
def _load_path(scene: Any, options: Any, memory: Any, source: int, i: int, depth: int) -> PathState:
    """The paths i … of a depth."""
    tables, base = scene.tables, source * STATE * ROW
    density = simd.load(memory.state, base + 9 * ROW + i)
    code = simd.load(memory.state, base + 10 * ROW + i)
    straight = (code > 0.5) & (code < 1.5)
    inside = load_medium(medium_stack.initial_stack(tables, density), None, memory, source * ROW + i, depth)
    return PathState(
        load3(memory.state, base, 0, i), load3(memory.state, base, 3, i), load3(memory.state, base, 6, i), density, straight, inside,
        ops.where(code > 1.5, code, 0.0), load_facing(scene.light.emitters.tree.below, memory, source * 3 * ROW + i),
        load_links(options.links, None, memory, source * ROW + i, depth),
        load_near(medium_stack.scattering(tables), None, memory, source * ROW + i),
        load_body(medium_stack.initial_body(tables, density), None, memory.body, source * 4 * ROW + i, depth),
        load_leaving(photon_volume.of(scene.light.photons), None, memory, source * ROW + i, depth),
        load_divided(dispersion.of(tables), None, memory, source * ROW + i, depth),
        load_axis(medium_stack.guides_of(tables), None, memory, source * 3 * ROW + i, depth),
    )  # fmt: skip


@helper
def _push_path(memory: Any, target: int, first: int, onward: PathState, item: Any, going: Lane) -> None:
    """Store the paths of a mask after `first` ones of the next depth; `item` is (slot, pixel, sample)."""
    base, element = target * STATE * ROW + first, target * ROW + first
    compress_store3(memory.state, base, onward.origin, going)
    compress_store3(memory.state, base + 3 * ROW, onward.direction, going)
    compress_store3(memory.state, base + 6 * ROW, onward.weight, going)
    compress_store(memory.state, base + 9 * ROW, onward.density, going)
    compress_store(memory.state, base + 10 * ROW, ops.where(onward.straight, 1.0, onward.phase), going)
    compress_store3(memory.index, target * 3 * ROW + first, item, going)
    store_optional(onward.inside, None, memory.inside, element, going)
    store_optional(onward.links, None, memory.links, element, going)
    store_optional(onward.near, None, memory.near, element, going)
    store_body(onward.body, None, memory.body, target * 4 * ROW + first, going)
    store_optional(onward.leaving, None, memory.leaving, element, going)
    store_optional(onward.divided, None, memory.divided, element, going)
    store_optional3(onward.axis, None, memory.axis, target * 3 * ROW + first, going)
    store_optional3(onward.facing, None, memory.facing, target * 3 * ROW + first, going)


@helper
def _add_environment(
    tables: Any, light: Any, options: Any, memory: Any, path: PathState, missed: Lane, slot: Lane, i: int, depth: int
) -> None:  # fmt: skip
    """Add the background to the light of paths i … that leave the scene."""
    behind, less = environment_radiance(tables, light, options, path, missed, depth)
    if depth == 0:  # slots equal lanes
        store3(memory.light, 0, 0, i, behind)
        simd.store(memory.light, 3 * ROW + i, 1.0 - less)
    elif ops.any_lane(missed & ((ops.largest(behind) > 0.0) | (less > 0.0))):
        path_reuse.add_light(memory.shared, memory.light, slot, behind, missed, depth)
        element = slot + 3 * ROW
        simd.scatter(memory.light, element, simd.gather(memory.light, element, missed) - less, missed)


@helper
def _push_shadow_ray(memory: Any, first: int, slot: Lane, connection: Connection) -> None:
    valid = connection.wanted
    compress_store3(memory.shadow, first, connection.origin, valid)
    compress_store3(memory.shadow, 3 * ROW + first, connection.direction, valid)
    compress_store(memory.shadow, 6 * ROW + first, connection.distance, valid)
    compress_store3(memory.shadow, 7 * ROW + first, connection.light, valid)
    compress_store(memory.shadow_slot, first, slot, valid)
    store_optional(connection.blockers, None, memory.blockers, first, valid)
    store_optional(connection.inside, None, memory.shadow_inside, first, valid)
    store_body(connection.body, None, memory.shadow_body, first, valid)


@helper
def _store_estimate(gathered: photon_map.Gathered, estimate_count: int, memory: Any, slot: Lane, lanes: Lane) -> int:
    valid = lanes & (ops.largest(gathered.light) > 0.0)
    if ops.any_lane(valid):
        way = ops.sub(gathered.end, gathered.start)
        bend = ops.along(ops.add(gathered.start, ops.scale(way, 0.5)), ops.normalize(gathered.up), BEND_HEIGHT * ops.length(way))
        compress_store3(memory.gathered, START * ROW + estimate_count, gathered.start, valid)
        compress_store3(memory.gathered, BEND * ROW + estimate_count, bend, valid)
        compress_store3(memory.gathered, END * ROW + estimate_count, gathered.end, valid)
        compress_store3(memory.gathered, LIGHT * ROW + estimate_count, gathered.light, valid)
        compress_store(memory.gathered_slot, estimate_count, slot, valid)
        estimate_count += simd.count(valid)
    return estimate_count


_push_estimate = specialize_if_present(_store_estimate)  # (gathered, asked, …): store estimates after `asked` ones; return their number


@helper
def _add_estimates(photons: Any, default: Any, accel: Any, scene: Any, frame: Any, memory: Any, n: int, depth: int) -> Any:
    if n > 0:
        _add_visible_photons(accel, scene, frame, memory, n, depth)
    return default


_photon_stage = specialize_if_present(_add_estimates)


@noinline_helper
def _add_visible_photons(accel, scene, frame, memory, n, depth):
    """Add the light of n estimates whose photon is visible, straight or, as over a convex surface, by a point above."""
    rows = memory.gathered
    like = simd.load(rows, 0)
    step = crosslane.width(like)
    for i in range(0, n, step):
        simd.store(rows, STRAIGHT * ROW + i, 0.0 * like + 1.0)
    if frame.options.shadows:
        attenuate_between(accel, scene, memory, rows, (START, END, STRAIGHT), n)
    for i in range(0, n, step):
        simd.store(rows, BENT * ROW + i, ops.where(simd.load(rows, STRAIGHT * ROW + i) > 0.0, 0.0 * like, 0.0 * like + 1.0))
    if frame.options.shadows:
        attenuate_between(accel, scene, memory, rows, (START, BEND, BENT), n)
        attenuate_between(accel, scene, memory, rows, (BEND, END, BENT), n)
    for i in range(0, n, step):
        share = ops.maximum(simd.load(rows, STRAIGHT * ROW + i), simd.load(rows, BENT * ROW + i))
        seen = simd.first_lanes(n - i, like) & (share > 0.0)
        if ops.any_lane(seen):
            slot = ops.where(seen, simd.load(memory.gathered_slot, i), 0)
            path_reuse.add_light(memory.shared, memory.light, slot, ops.scale(load3(rows, 0, LIGHT, i), share), seen, depth)


@noinline_helper
def _shadow_stage(accel, scene, frame, memory, n):
    """Trace n shadow rays, and add the light of those that nothing blocks to their paths."""
    options = frame.options
    like = simd.load(memory.state, 0)
    step = crosslane.width(like)
    queued = 0
    for i in range(0, n, step):
        origin, direction = load3(memory.shadow, 0, 0, i), load3(memory.shadow, 0, 3, i)
        distance = simd.load(memory.shadow, 6 * ROW + i)
        lit = simd.first_lanes(n - i, like)
        waits = ops.bool_like(like, False)
        if options.shadows:
            lit = lit & ops.not_(primitive_hits.blocked(scene.primitives.blocking, origin, direction, distance))
            if scene.trees:
                waits = lit & (distance > 0.0) & enters(scene, origin, direction, distance)
                queued += queue_up(memory, queued, i, waits)
                lit = lit & ops.not_(waits)
        deliver(medium_stack.scattering(scene.tables), memory, i, lit, waits)
    pad(memory, queued)
    wide = simd.load(memory.queue, 0)
    for j in range(0, queued, _WIDTH64):
        k = simd.load(memory.queue, j)
        origin, direction = gather3(memory.shadow, 0, 0, k), gather3(memory.shadow, 0, 3, k)
        slot = memory.shadow_slot[k]
        x, y, s = memory.items[slot + 4 * ROW], memory.items[slot + 5 * ROW], memory.items[slot + 2 * ROW]
        pixel, s = sobol.zorder_index(x, y, s, frame.picture.width, frame.order)
        time = sobol.sample_time(pixel, s, options.seed, frame.shutter)
        ray = as_searched(origin, direction, 0.0 * origin[0], memory.shadow[k + 6 * ROW], time)
        share = from_search(_unblocked(options.links, accel, ray, memory, k), origin[0])
        deliver_share(medium_stack.scattering(scene.tables), memory, k, slot, share, simd.first_lanes(queued - j, wide))
