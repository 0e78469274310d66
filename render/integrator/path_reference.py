"""Path integrator of the reference backend: all samples of a tile in numpy lanes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler import ir
from ...materials import traits
from ..accel import intersect
from ..jit.kernel import specialize_either
from ..lanes import ops
from ..light import light_tree, links
from ..material import dispersion, medium_stack
from ..material.shader import ONLY
from ..medium import emitting_cells, free_flight, guides, tracking
from ..surface import alpha as surface_alpha
from ..surface import interaction
from ..types import Hit, Options, Ray, Vec
from . import wave_media
from .path import shade_vertex
from .path_emission import environment_radiance, weigh_glow
from .state import flights
from .state.path_state import CAMERA_RAY, OTHER_RAY, PathInputs, PathSample, PathState, alpha_number


def radiance(
    tables: ir.Tables, accel: Any, inputs: PathInputs, options: Options, ray: Ray, hit: Hit, pixel: Any, sample: Any
) -> tuple[Vec, Any, Any]:
    """(radiance, coverage, sound) of camera rays and their hits; radiance that is not finite is 0 and not `sound`."""
    shape = np.shape(hit.t)
    zero = np.zeros(shape)
    total: Vec = (zero, zero, zero)
    alpha = zero + 1.0
    active = np.ones(shape, bool)
    origin: Any = tuple(np.broadcast_to(c, shape) for c in ray.origin)
    direction: Any = tuple(np.broadcast_to(c, shape) for c in ray.direction)
    ones: Any = zero + 1.0
    path: Any = PathState(origin, direction, (ones, ones, ones), zero + ONLY, active, medium_stack.initial_stack(tables, zero), zero)
    path = path._replace(facing=light_tree.facing(inputs.emitters.tree.below, path.direction, active))
    path = path._replace(divided=dispersion.undivided(dispersion.of(tables), None, zero))
    path = path._replace(links=links.bits_of_eye(options.links, None, zero))
    media = medium_stack.scattering(tables)
    if media is not None:
        path = path._replace(near=zero + ray.t_min, body=medium_stack.initial_body(tables, zero))
        path = path._replace(axis=guides.start(media.guides, None, zero))
    depth = 0
    while True:
        onward = Ray(path.origin, path.direction, zero if path.near is None else path.near, zero + np.inf, ray.time)
        if options.layers:
            visible = OTHER_RAY if depth else CAMERA_RAY
            index = PathSample(pixel, sample, depth, options.seed)
            hit = _pass_transparent(accel, tables, onward if depth else ray, hit, active, visible, index)
        missed, surfaces = active & (hit.instance < 0), active & (hit.instance >= 0)
        index = PathSample(pixel, sample, depth, options.seed)
        flown = flights.fly(media, None, tables, path, active, np.where(surfaces, hit.t, np.inf), index, ray.time)
        path = flights.weighted(flown, path)
        missed, surfaces = flights.without_scattered(flown, missed), flights.without_scattered(flown, surfaces)
        if missed.any():
            behind, less = environment_radiance(tables, inputs, options, path, missed, depth)
            total, alpha = ops.add(total, behind), alpha - less
        flown = weigh_glow(inputs.emitters.media, flown, tables, inputs, path, depth > options.bounces)
        if flown is not None:
            total = ops.where3(active, ops.add(total, flown.emitted), total)
        if depth > options.bounces + 1 or not flights.any_vertex(flown, surfaces).any():
            break
        point = interaction.make_interaction(tables, onward, hit)
        event = flights.event_of(flown, None, tables, path, point, surfaces)
        surfaces = flights.vertices(event, surfaces)
        sent, connection, path, active, _ = shade_vertex(tables, inputs, options, path, hit, point, surfaces, index, index, event)
        total = ops.add(total, sent)
        if connection.wanted.any():
            blocking = connection.wanted & (connection.distance > 0.0) & options.shadows
            shadow = Ray(connection.origin, connection.direction, zero, zero + connection.distance, ray.time)
            radiance = ops.scale(connection.light, _unblocked(options.links, accel, tables, shadow, blocking, connection.blockers))
            if media is not None:
                radiance = ops.mul(radiance, _through_media(media, inputs, accel, tables, shadow, connection, index))
            total = ops.where3(connection.wanted, ops.add(total, radiance), total)
        if not active.any():
            break
        near = zero if path.near is None else path.near
        hit = intersect.closest_hit(accel, tables, Ray(path.origin, path.direction, near, zero + np.inf, ray.time), active, OTHER_RAY)
        depth += 1
    sound = np.isfinite(total[0] + total[1] + total[2])
    return ops.where3(sound, total, (zero, zero, zero)), alpha, sound


def _through_media(
    media: Any, inputs: PathInputs, accel: Any, tables: ir.Tables, shadow: Ray, connection: Any, index: PathSample
) -> Vec:  # fmt: skip
    """The share of light in red, green and blue that passes the media along shadow rays, or the light that they collect in one medium.

    See wave_media.py.
    """
    cells = inputs.emitters.media
    collects = wave_media.collecting(cells, np.zeros(np.shape(connection.distance), bool), np.abs(connection.distance))
    collected_number = emitting_cells.collected(np.abs(connection.distance)) if np.any(collects) else 0
    intersects, total = media.walled[0] | emitting_cells.exist(cells, False), np.zeros((3, *np.shape(connection.distance)))
    distance = np.abs(connection.distance)
    going, inside = connection.wanted, connection.inside
    near, passed, segment = np.zeros(np.shape(distance)), np.ones((3, *np.shape(distance))), 0
    while going.any():
        ray = Ray(shadow.origin, shadow.direction, near, np.where(going, distance, 0.0), shadow.time)
        hit = intersect.closest_hit(accel, tables, ray, going & intersects, OTHER_RAY)
        hits = going & (hit.instance >= 0) & (hit.t < distance)
        far = np.maximum(np.where(hits, hit.t, distance), near)
        number = np.where(going, medium_stack.top(inside), 0)
        of_segment = tracking.depth_of_segment(index.depth, segment)
        key = tracking.Key(index.pixel, index.sample, of_segment, index.seed, 1, connection.body, shadow.time, None)
        white = tuple(np.ones(np.shape(distance)) for _ in range(3))
        share = free_flight.transmit(media, white, tables, np.where(collects, 0, number), ray.origin, ray.direction, near, far, key)
        if np.any(collects):
            way = ray.origin, ray.direction, near, far
            of_medium, emitted = wave_media.pass_and_collect(media, tables, np.where(collects, number, 0), way, key)
            total += np.where(collects & going & (number == collected_number), passed * np.array(emitted), 0.0)
            share = ops.where3(collects, of_medium, share)
        passed = np.where(number > 0, passed * np.array(share), passed)
        point = interaction.make_interaction(tables, ray, hit)
        inside = np.where(hits, medium_stack.cross_boundary(inside, None, tables, point, ray.direction), inside)
        near, segment = np.where(hits, flights.behind(point, ray.direction, hit.t), near), segment + 1
        going = hits & ~(collects & ~media.clear[point.material])
    light = np.where(collects, total, passed)
    return light[0], light[1], light[2]


def _pass_all(accel: Any, tables: ir.Tables, shadow: Ray, blocking: Any, blockers: Any) -> Any:
    return intersect.transmittance(accel, tables, shadow, blocking)


def _pass_blockers(linked: Any, accel: Any, tables: ir.Tables, shadow: Ray, blocking: Any, blockers: Any) -> Any:
    """The transmittance of shadow rays whose lights have different blockers."""
    share = np.ones(np.shape(blocking))
    for mask in linked.sets.tolist():
        share *= intersect.transmittance(accel, tables, shadow, blocking & (blockers == mask), mask)
    return share


_unblocked = specialize_either(_pass_blockers, _pass_all)


def _pass_transparent(accel: Any, tables: ir.Tables, ray: Ray, hit: Hit, active: Any, visible: int, index: PathSample) -> Hit:
    """The first hit behind partly transparent surfaces that rays pass by chance."""
    partial = traits.partial(tables)[tables.instances.material]
    passed, layer = active, 0
    while True:
        tested = passed & (hit.instance >= 0) & partial[np.maximum(hit.instance, 0)]
        opacity = surface_alpha.opacity_at(tables, interaction.make_interaction(tables, ray, hit))
        passed = tested & (alpha_number(index, layer) >= opacity)
        if not passed.any():
            return hit
        again = intersect.closest_hit(accel, tables, ray._replace(t_min=intersect.next_t_min(tables, ray, hit)), passed, visible)
        hit = Hit(*(np.where(passed, new, old) for new, old in zip(again, hit, strict=True)))
        layer += 1
