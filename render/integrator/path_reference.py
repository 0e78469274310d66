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
from ..material import medium_stack
from ..material.shader import ONLY
from ..surface import alpha as surface_alpha
from ..surface import interaction
from ..types import Hit, Options, Ray, Vec
from .path import shade_vertex
from .path_emission import environment_radiance
from .path_state import CAMERA_RAY, OTHER_RAY, PathInputs, PathSample, PathState, alpha_number


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
    one: Any = zero + 1.0
    path: Any = PathState(origin, direction, (one, one, one), zero + ONLY, active, medium_stack.initial_stack(tables, zero), zero)
    path = path._replace(facing=light_tree.facing(inputs.emitters.tree.below, path.direction, active))
    path = path._replace(links=links.bits_of_eye(options.links, None, zero))
    depth = 0
    while True:
        onward = Ray(path.origin, path.direction, zero, zero + np.inf, ray.time)
        if options.layers:
            visible = OTHER_RAY if depth else CAMERA_RAY
            index = PathSample(pixel, sample, depth, options.seed)
            hit = _pass_transparent(accel, tables, onward if depth else ray, hit, active, visible, index)
        missed = active & (hit.instance < 0)
        if missed.any():
            behind, less = environment_radiance(tables, inputs, options, path, missed, depth)
            total, alpha = ops.add(total, behind), alpha - less
        here = active & (hit.instance >= 0)
        if depth > options.bounces + 1 or not here.any():
            break
        point = interaction.make_interaction(tables, onward, hit)
        index = PathSample(pixel, sample, depth, options.seed)
        sent, connection, path, active, _ = shade_vertex(tables, inputs, options, path, hit, point, here, index, index)
        total = ops.add(total, sent)
        if connection.wanted.any():
            blocking = connection.wanted & (connection.distance > 0.0) & options.shadows
            shadow = Ray(connection.origin, connection.direction, zero, zero + connection.distance, ray.time)
            given = ops.scale(connection.light, _unblocked(options.links, accel, tables, shadow, blocking, connection.blockers))
            total = ops.where3(connection.wanted, ops.add(total, given), total)
        if not active.any():
            break
        hit = intersect.closest_hit(accel, tables, Ray(path.origin, path.direction, zero, zero + np.inf, ray.time), active, OTHER_RAY)
        depth += 1
    sound = np.isfinite(total[0] + total[1] + total[2])
    return ops.where3(sound, total, (zero, zero, zero)), alpha, sound


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
        asked = passed & (hit.instance >= 0) & partial[np.maximum(hit.instance, 0)]
        there = surface_alpha.opacity_at(tables, interaction.make_interaction(tables, ray, hit))
        passed = asked & (alpha_number(index, layer) >= there)
        if not passed.any():
            return hit
        again = intersect.closest_hit(accel, tables, ray._replace(t_min=intersect.next_t_min(tables, ray, hit)), passed, visible)
        hit = Hit(*(np.where(passed, new, old) for new, old in zip(again, hit, strict=True)))
        layer += 1
