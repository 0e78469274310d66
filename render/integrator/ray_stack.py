"""Secondary rays of the Whitted integrator: spawning them at surfaces, and the stack of those to be traced."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..accel.traverse import motion_alpha
from ..jit.kernel import helper, specialize_if_present
from ..lanes import crosslane, ops
from ..light import links
from ..material import bsdf, medium_stack
from ..sampling import sobol
from ..simd.registration import overload
from ..surface import alpha as surface_alpha
from ..surface import texture_footprint
from ..types import Lane, Options, Ray, Surface, Vec
from .state.records import RayState, SampleIndex, Scene, ShadingContext

FIELDS = 16  # of a ray on the stack: origin, direction, weight, bounces left, kind, key, medium stack, and
CONE = 13  # the width of its cone and its spread a metre, and
LINKS = 15  # its light links
DIFFUSE_RAY = 0.0  # kinds of rays; direct light has sampled the emitters that these hit
SPECULAR_RAY = 1.0
STRAIGHT_RAY = 2.0  # has passed only boundaries of index 1, as the camera's own ray: it lowers alpha where it escapes
BRANCHES = 3  # rays that a surface spawns at most: reflected, refracted, diffuse
MIN_WEIGHT = 1e-4  # rays of less weight are not traced: the error of each stays below it
LIGHT_DIMENSIONS = 2048  # random dimensions of a surface: two a light, before them one for its diffuse ray
_KEYS = 0x7FFFFFFF


def stack_for(options: Options, count: int = 1) -> NDArray[np.float64]:
    """Allocate (rays, FIELDS, count): the stacks of `count` lanes."""
    return np.zeros((_depth(options.bounces) + BRANCHES * options.layers, FIELDS, count))


@helper
def _depth(bounces: Lane) -> Lane:
    """Rays on the stack at most, if one has so many bounces left."""
    return (BRANCHES - 1) * (bounces + 1) + 1


@helper
def spawn_ray(point: Surface, direction: Vec, distance: Lane) -> Ray:
    """A ray from a surface, with its origin off the surface by the rounding error of the hit."""
    side = ops.sign_of(ops.dot(direction, point.geometric))
    origin = ops.along(point.position, point.geometric, side * point.offset)
    return Ray(origin, direction, 0.0 * point.offset, distance, point.time)


@helper
def spawn_secondary_rays(
    scene: Scene, shading: ShadingContext, ray: RayState, going: Lane, sampler: SampleIndex, stack: Any, waiting: Lane
) -> Lane:
    """Push the reflected, refracted and diffuse rays of a surface that `ray` hit; return how many are on each stack."""
    options, point, shader = scene.options, shading.point, shading.shader
    tables, inside, remaining, key, weight = scene.tables, ray.inside, ray.left, ray.key, ray.weight
    reflection, transmission, refracted, _ = bsdf.fresnel_split(point, shader, ray.direction)
    zero = ops.full_like(point.offset, 0.0)
    through = ops.where((ray.kind == STRAIGHT_RAY) & (shader.ior == 1.0), STRAIGHT_RAY, zero + SPECULAR_RAY)
    bits = links.bits_of(options.links, None, tables, point)
    mirrored = ops.reflect(ray.direction, point.normal)
    outside = ops.dot(mirrored, point.geometric) > 0.0  # an interpolated normal may mirror a grazing ray into the surface
    mirrored = ops.where3(outside, mirrored, ops.reflect(ray.direction, point.geometric))
    child = RayState(mirrored, ops.mul(weight, reflection), remaining, zero + SPECULAR_RAY, inside, key, bits)
    waiting = _push(stack, waiting, point, child, going, 0)
    beyond = medium_stack.cross_boundary(inside, None, tables, point, refracted)
    further = links.bits_beyond(options.links, None, tables, point, ray.links, shader.ior == 1.0)
    child = RayState(refracted, ops.mul(weight, transmission), remaining, through, beyond, key, further)
    waiting = _push(stack, waiting, point, child, going, 1)
    if options.interreflection or (bsdf.has_facets(shader) and ops.any_lane(going & bsdf.facets_of(shader))):
        u, v = sobol.pair(sampler.pixel, sampler.sample, key * LIGHT_DIMENSIONS * 2 + 1, options.seed)
        which = sobol.pair(sampler.pixel, sampler.sample, key * LIGHT_DIMENSIONS * 2, options.seed)[1]
        onward, share = bsdf.sample_glossy_or_diffuse(shader, point.normal, shading.viewer, u, v, which, options.interreflection)
        above = going & bsdf.scatters_through(shader, ops.dot(onward, point.geometric) > 0.0)
        beyond = medium_stack.cross_boundary(inside, None, tables, point, onward)
        child = RayState(onward, ops.mul(weight, share), remaining, zero + DIFFUSE_RAY, beyond, key, bits)
        waiting = _push(stack, waiting, point, child, above, 2)
    return waiting


@helper
def _coverage(accel: Any, scene: Scene, point: Surface, remaining: Lane, sampler: SampleIndex, stack: Any, waiting: Lane) -> Lane:
    if motion_alpha.has_no_instances(accel):
        return 0.0 * point.offset + 1.0
    opacity = surface_alpha.opacity_at(scene.tables, point)
    fits = waiting + ops.where(remaining > 0, BRANCHES, 0) + _depth(remaining - 1) <= stack.shape[0]
    by_chance = sobol.pair(sampler.pixel, sampler.sample, sampler.key * LIGHT_DIMENSIONS * 2, scene.options.seed)[0] < opacity
    return ops.where(fits, opacity, ops.where(by_chance, 1.0, 0.0))


@helper
def _continue(waiting: Lane, accel: Any, point: Surface, ray: RayState, coverage: Lane, lanes: Lane, stack: Any) -> Lane:
    if motion_alpha.has_no_instances(accel):
        return waiting
    passing = lanes & (coverage < 1.0)
    child = RayState(ray.direction, ops.scale(ray.weight, 1.0 - coverage), ray.left + 1, ray.kind, ray.inside, ray.key, ray.links)
    return _push(stack, waiting, point, child, passing, BRANCHES)


def coverage_of(accel: Any, *arguments: Any) -> Lane:
    """(accel, scene, point, left, sampler, stack, waiting): the coverage of a hit surface, 0 to 1.

    It is the surface's alpha, or, where the stack has no space for a ray behind it, 0 or 1 with that probability. Kernels of opaque
    scenes leave it out.
    """
    return _coverage(accel, *arguments)


@overload(coverage_of)
def _coverage_in_kernels(accel, *arguments):
    return (lambda accel, *arguments: _coverage(accel, *arguments)) if motion_alpha.has_opacity(accel) else lambda accel, *arguments: 1.0


def continue_through(waiting: Lane, accel: Any, *arguments: Any) -> Lane:
    """(waiting, accel, point, ray, coverage, here, stack): push the ray that passes a partly transparent surface unchanged.

    Return how many rays are on each stack. Kernels of opaque scenes leave it out.
    """
    return _continue(waiting, accel, *arguments)


@overload(continue_through)
def _continue_in_kernels(waiting, accel, *arguments):
    if motion_alpha.has_opacity(accel):
        return lambda waiting, accel, *arguments: _continue(waiting, accel, *arguments)
    return lambda waiting, accel, *arguments: waiting


@helper
def _push(stack: Any, waiting: Lane, point: Surface, ray: RayState, going: Lane, branch: int) -> Lane:
    active = going & (ops.largest(ray.weight) > MIN_WEIGHT)
    if ops.any_lane(active):
        origin = spawn_ray(point, ray.direction, point.offset).origin
        crosslane.stack_store3(stack, waiting, 0, origin, active)
        crosslane.stack_store3(stack, waiting, 3, ray.direction, active)
        crosslane.stack_store3(stack, waiting, 6, ray.weight, active)
        crosslane.stack_store(stack, waiting, 9, ops.to_float(ray.left - 1), active)
        crosslane.stack_store(stack, waiting, 10, ray.kind, active)
        crosslane.stack_store(stack, waiting, 11, ops.to_float((ray.key * BRANCHES + 1 + branch) & _KEYS), active)
        push_medium(ray.inside, None, stack, waiting, active)
        _push_links(ray.links, None, stack, waiting, active)
        texture_footprint.put_cone(point, ray.direction, stack, waiting, CONE, active)
    return ops.where(active, waiting + 1, waiting)


@helper
def pop(stack: Any, place: Lane, time: Any) -> tuple[Ray, Vec, Lane, Lane, Lane]:
    """(ray, weight, bounces left, kind, key) of the stack's entry at `place`."""
    origin, direction, weight = (
        crosslane.stack_load3(stack, place, 0),
        crosslane.stack_load3(stack, place, 3),
        crosslane.stack_load3(stack, place, 6),
    )
    zero = 0.0 * origin[0]
    ray = Ray(origin, direction, zero, zero + np.inf, time)
    remaining, key = ops.to_int(crosslane.stack_load(stack, place, 9)), ops.to_int(crosslane.stack_load(stack, place, 11))
    return ray, weight, remaining, crosslane.stack_load(stack, place, 10), key


@helper
def _pop_medium(inside: Lane, default: Any, stack: Any, place: Lane) -> Lane:
    return ops.to_int(crosslane.stack_load(stack, place, 12))


@helper
def _push_medium(inside: Lane, default: Any, stack: Any, place: Lane, active: Lane) -> None:
    crosslane.stack_store(stack, place, 12, ops.to_float(inside), active)


@helper
def _load_links(linked: Any, default: Any, stack: Any, place: Lane) -> Lane:
    return ops.to_int(crosslane.stack_load(stack, place, LINKS))


@helper
def _store_links(bits: Lane, default: Any, stack: Any, place: Lane, active: Lane) -> None:
    crosslane.stack_store(stack, place, LINKS, ops.to_float(bits), active)


_push_links = specialize_if_present(_store_links)
pop_links = specialize_if_present(_load_links)
"""(links, None, stack, place): the light links of a ray on the stack; None in scenes without links."""
pop_medium = specialize_if_present(_pop_medium)
"""(inside, None, stack, place): the medium stack of a ray on the stack; None in scenes without media."""
push_medium = specialize_if_present(_push_medium)
