"""Whitted integrator: direct light, and reflected, refracted and, on request, one diffuse ray of each surface.

Whitted 1980. Rays to be traced wait on a stack, each with the weight of its radiance. One source serves numpy lanes and kernels; all lanes
trace the same tree of rays, each with its own mask.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiler import ir
from ..accel import intersect
from ..accel.formula_packets import shadow_rays
from ..geometry import instance_transform
from ..jit.function_pointer import KernelPointer
from ..jit.kernel import helper
from ..jit.packed_struct import Handle
from ..jit.value_types import NONE, ValueType, array_type, tuple_of
from ..lanes import crosslane, ops
from ..lanes.kinds import FLOAT, INT, VEC
from ..light import airlight, lights, links
from ..material import medium_stack
from ..material.shader import evaluate_shader_inside
from ..sampling import sobol
from ..surface import blend, interaction, normal_map, tangent_frame, texture_footprint
from ..types import Hit, Lane, Options, Ray, Surface, Tables, Vec
from . import background, direct_light, ray_stack
from .ray_stack import LIGHT_DIMENSIONS, SPECULAR_RAY, STRAIGHT_RAY
from .state.records import RayState, SampleIndex, Scene, ShadingContext

OTHER_RAY = int(ir.Visibility.REFLECTION)
_BLEND = 4094  # the random dimension of a surface that chooses among the parts of a blend


@helper
def _sample_part(tables: Tables, group: tuple[Surface, Lane], sampler: SampleIndex, seed: int) -> tuple[Surface, Lane]:
    """(surface with a material of its blend, lanes of the group that share this material)."""
    point, lanes = group
    if blend.depth(tables) == 0:
        return blend.with_material(point, ops.to_int(point.material)), lanes
    number = sobol.pair(sampler.pixel, sampler.sample, sampler.key * LIGHT_DIMENSIONS * 2 + _BLEND, seed)[0]
    point = blend.choose_part(tables, point, number)
    material, lanes = crosslane.uniform_group(point.material, lanes)
    return blend.with_material(point, material), lanes


_part = blend.if_blended(_sample_part)


def radiance(
    scene: Scene, ray: Ray, hit: Hit, pixel: Lane, sample: Lane, stack: Any, hidden: Any = None
) -> tuple[Vec, Lane, Lane]:  # fmt: skip
    """(radiance, coverage, sound) of a camera ray and its hit; radiance that is not finite is 0 and not `sound`.

    `hidden` is what formula_packets.shadow_rays found of lights. Coverage is less than 1 where a surface lets the ray straight through,
    by its opacity or with an index of refraction of 1, to the background.
    """
    tables, options = scene.tables, scene.options
    zero = ops.full_like(hit.t, 0.0)
    seen = hit.instance >= 0
    alpha = ops.where(seen, zero + 1.0, zero)
    behind = background.camera_background(tables, options, ray.direction)
    total, far = ops.where3(seen, (zero, zero, zero), behind), ops.where(seen, hit.t, lights.FAR)
    total = airlight.seen_through(options.airlight, total, tables, ray.origin, ray.direction, far)
    alpha = ops.where(seen, alpha, airlight.opacity(options.airlight, alpha, ray.origin, ray.direction, zero + lights.FAR))
    reach = ops.where(seen, hit.t, 0.0)
    weight = (zero + 1.0, zero + 1.0, zero + 1.0)
    remaining = ops.int_like(hit.t, options.bounces)
    kind = zero + STRAIGHT_RAY
    key = ops.int_like(hit.t, 1)
    waiting = ops.int_like(hit.t, 0)  # rays on each lane's stack
    inside = medium_stack.initial_stack(tables, hit.t)
    cone = texture_footprint.cone_of_eye(tables, ray)
    bits = links.bits_of_eye(options.links, None, hit.t)
    while True:
        weight = medium_stack.attenuate(inside, weight, tables, reach)
        weight = airlight.transmit(options.airlight, weight, ray.origin, ray.direction, reach)
        state = RayState(ray.direction, weight, remaining, kind, inside, key, bits)
        pending = seen
        while ops.any_lane(pending):
            instance, lanes = crosslane.uniform_group(hit.instance, pending)
            group = Hit(hit.t, instance, hit.primitive, hit.u, hit.v)
            point = texture_footprint.on_surface(tables, ray, group, interaction.make_interaction(tables, ray, group), cone)
            sampler = SampleIndex(pixel, sample, key)
            point, lanes = _part(tables, (point, lanes), sampler, options.seed)
            point = tangent_frame.attach(tables, normal_map.apply_maps(tables, point, group, ray.direction), group)
            point = interaction.override_interaction(hidden, point)
            share, light, waiting = _shade(scene, point, group, lanes, state, sampler, stack, waiting)
            total = ops.where3(lanes, ops.add(total, ops.mul(share, light)), total)
            pending = pending & ops.not_(lanes)
        active = waiting > 0
        if ops.not_(ops.any_lane(active)):
            break
        waiting = ops.where(active, waiting - 1, waiting)
        inside = ray_stack.pop_medium(inside, None, stack, waiting)
        bits = ray_stack.pop_links(options.links, None, stack, waiting)
        cone = texture_footprint.take_cone(cone, None, stack, waiting, ray_stack.CONE)
        ray, weight, remaining, kind, key = ray_stack.pop(stack, waiting, ray.time)
        hit, hidden = intersect.closest_hit(scene.accel, tables, ray, active, OTHER_RAY), shadow_rays.forget_hidden(hidden)
        seen = active & (hit.instance >= 0)
        reach = ops.where(seen, hit.t, 0.0)
        total, weight = airlight.after_bounce(options.airlight, (total, weight), tables, ray, reach, active, seen)
        missed = active & ops.not_(hit.instance >= 0) & (kind >= SPECULAR_RAY)
        if ops.any_lane(missed):
            behind, alpha = _escape(tables, options, ray.direction, weight, missed & (kind == STRAIGHT_RAY), alpha, bits)
            total = ops.where3(missed, ops.add(total, ops.mul(weight, behind)), total)
    sound = ops.is_finite(total[0] + total[1] + total[2])
    return ops.where3(sound, total, (zero, zero, zero)), ops.clip(alpha, 0.0, 1.0), sound


@helper
def _shade(
    scene: Scene, point: Surface, hit: Hit, lanes: Lane, ray: RayState, sampler: SampleIndex, stack: Any, waiting: Lane
) -> tuple[Vec, Vec, Lane]:
    """(weight, light, rays on the stack) of the surfaces that a mask's lanes hit, with their secondary rays on the stack."""
    accel = scene.accel
    shader = evaluate_shader_inside(scene.tables, point, ray.inside)
    shading = ShadingContext(point, shader, ops.negate(ray.direction), ray.inside, None)
    light = direct_light.local_light(scene, shading, hit, lanes, ray.kind >= SPECULAR_RAY, sampler, ray.links)
    coverage = ray_stack.coverage_of(accel, scene, point, ray.left, sampler, stack, waiting)
    share = ops.scale(ray.weight, coverage)
    going = lanes & (ray.left > 0)
    if ops.any_lane(going):
        visible = RayState(ray.direction, share, ray.left, ray.kind, ray.inside, ray.key, ray.links)
        waiting = ray_stack.spawn_secondary_rays(scene, shading, visible, going, sampler, stack, waiting)
    light = background.add_specular_environment(scene.options.environment, light, scene, point, shading.shader, ray.direction)
    waiting = ray_stack.continue_through(waiting, accel, point, ray, coverage, lanes, stack)
    return share, light, waiting


@helper
def _escape(
    tables: Tables, options: Options, direction: Vec, weight: Vec, straight: Lane, alpha: Lane, bits: Any
) -> tuple[Vec, Lane]:  # fmt: skip
    """(background, alpha) of rays that leave the scene; `straight` ones lower alpha."""
    behind = background.reflected_background(tables, options, direction, bits)
    if ops.any_lane(straight):
        behind = ops.where3(straight, background.camera_background(tables, options, direction), behind)
        alpha = ops.where(straight, alpha - (weight[0] + weight[1] + weight[2]) / 3.0, alpha)
    return behind, alpha


def _radiance(tables, accel, vertex_light, options, ray, hit, index, stack, hidden):
    origin, direction, time = ray
    t, instance, primitive, u, v = hit
    ray = Ray(origin, direction, 0.0 * t, 0.0 * t + np.inf, time)
    return _traced(Scene(tables, accel, vertex_light, options), ray, Hit(t, instance, primitive, u, v), index[0], index[1], stack, hidden)


_traced = helper(radiance)
linked = KernelPointer(_radiance)  # compiled once for all backends, with a disk cache entry of its own
_call = linked.call


@helper
def linked_radiance(
    frame: Any, tables: Tables, accel: Any, vertex_light: Any, ray: Ray, hit: Hit, pixel: Lane, sample: Lane, stack: Any, hidden: Any
) -> tuple[Vec, Lane, Lane]:
    """In kernels: `radiance` by the address in the frame, see `link`."""
    start, packed_hit = (ray.origin, ray.direction, ray.time), (hit.t, hit.instance, hit.primitive, hit.u, hit.v)
    return _call(frame.radiance, (tables, accel, vertex_light, frame.options, start, packed_hit, (pixel, sample), stack, hidden))  # pyright: ignore[reportCallIssue]


def link(frame: Handle, tables: Handle, accel: Handle, vertex_light: Handle, has_known: bool = False) -> None:
    """Compile or load `radiance` for a picture's inputs, and put its address into the frame; `has_known`: its `known` is given."""
    frame.put("radiance", linked.link(*kinds(frame, tables, accel, vertex_light, has_known)))


def kinds(frame: Handle, tables: Handle, accel: Handle, vertex_light: Handle, has_known: bool) -> tuple[ValueType, ...]:
    """Types of the arguments of `_radiance`."""
    packed = tables.type, accel.type, vertex_light.type, frame.part("options")
    time, hidden = FLOAT if instance_transform.is_open(frame.part("shutter")) else NONE, INT if has_known else NONE
    ray, hit = tuple_of(VEC, VEC, time), tuple_of(FLOAT, INT, INT, FLOAT, FLOAT)
    return (*packed, ray, hit, tuple_of(INT, INT), array_type(np.float64, 3), hidden)
