"""Light that a surface sends to the viewer without secondary rays: emission, ambient light, and light of lights through shadow tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..accel import intersect
from ..accel.formula_packets import shadow_rays
from ..jit.kernel import helper, specialize_either, specialize_if_present
from ..lanes import ops
from ..light import airlight, light_kinds, light_samples, lights, links, shadow_map
from ..material import added_lobes, bsdf, medium_stack
from ..material.shader import Shader
from ..sampling import sobol
from ..surface import interaction, normal_map, tangent_frame
from ..types import Hit, Lane, Ray, Surface, Vec
from . import background, glossy_lights, gouraud, sky_sampling
from .ray_stack import LIGHT_DIMENSIONS
from .state.records import LightSample, SampleIndex, Scene, ShadingContext

SHADOW_MARGIN = 4096.0  # roundings of a position before which shadow rays end: lights hit more steeply than at 1/4096 block nothing


@helper
def local_light(scene: Scene, shading: ShadingContext, hit: Hit, active: Lane, specular: Lane, sampler: SampleIndex, bits: Any) -> Vec:
    """Return the emission, ambient and direct light, or interpolated vertex light, of a surface.

    Area lights that a diffuse ray hits count nothing: direct light has sampled them. `bits` are the light links of the surface before.
    """
    tables, point = scene.tables, shading.point
    zero = ops.full_like(hit.t, 0.0)
    light = tables.instances.light[point.instance]
    shines = ops.bool_like(zero, True)
    if ops.any_lane(light >= 0):
        both_sides = light_kinds.is_sphere(tables.lights.kind[ops.maximum(light, 0)])  # sampled from inside, too
        shown = links.receives_lamp(scene.options.links, (point.front | both_sides) & specular, light, bits)
        shines = ops.where(light >= 0, shown, shines)
    total = ops.where3(shines, shading.shader.emission, (zero, zero, zero))
    at_vertices = gouraud.is_vertex_lit(tables, scene.vertex_light, point)
    if ops.any_lane(active & at_vertices):
        interpolated = active & at_vertices
        total = ops.where3(
            interpolated, ops.add(total, gouraud.interpolate_vertex_light(tables, scene.vertex_light, point, hit, interpolated)), total
        )
    lit = active & ops.not_(at_vertices)
    if ops.any_lane(lit):
        total = ops.where3(lit, ops.add(total, direct_light(scene, shading, lit, sampler)), total)
    return total


@helper
def direct_light(scene: Scene, shading: ShadingContext, active: Lane, sampler: SampleIndex) -> Vec:
    """Return k_a L_a and the light of every light that nothing blocks, attenuated by the media of the ray's medium stack."""
    tables, shader = scene.tables, shading.shader
    linked = scene.options.links
    bits = links.bits_of(linked, None, tables, shading.point)
    total = ops.mul(shader.ambient, links.ambient(linked, lights.ambient(tables), tables, shading.point.offset, bits))
    active = active & bsdf.is_lit(shader)
    for light in range(len(tables.lights.kind)):
        kind = tables.lights.kind[light]
        if light_kinds.is_ambient(kind):
            continue
        receiving = links.receives(linked, active, light, bits)
        if light_kinds.is_sky(kind):
            total = _add_sky(total, scene, shading, light, receiving, sampler)
        else:
            total = _add_light(total, scene, shading, light, receiving, sampler)
    if bsdf.has_facets(shader):
        total = _add_along_lobes(total, scene, shading, active, sampler)
    return total


@helper
def _sample_numbers(scene: Scene, point: Surface, light: int, sampler: SampleIndex) -> tuple[Lane, Lane]:
    """Random numbers of a light with an extent; 0.5 for others."""
    middle = ops.full_like(point.offset, 0.5)
    u, v = middle, middle
    if lights.is_soft(scene.tables, light):
        u, v = sobol.pair(sampler.pixel, sampler.sample, _dimension(sampler, light), scene.options.seed)
    return u, v


@helper
def _dimension(sampler: SampleIndex, light: int) -> Lane:
    return (sampler.key * LIGHT_DIMENSIONS + light) * 2 + 2


@helper
def _sky_radiance(scene: Scene, point: Surface, light: int, direction: Vec) -> Vec:
    """The radiance of a sky as it arrives at a point, with the airlight before it."""
    radiance = lights.sky_radiance(scene.tables, light, direction)
    return airlight.sky(scene.options.airlight, radiance, light, point.position, direction)


@helper
def _add_sky(total: Vec, scene: Scene, shading: ShadingContext, light: int, active: Lane, sampler: SampleIndex) -> Vec:
    """Add a sky's light: one direction for the diffuse part, and another for the highlight."""
    tables, options, point, shader, viewer = scene.tables, scene.options, shading.point, shading.shader, shading.viewer
    u, v = _sample_numbers(scene, point, light, sampler)
    horizon = ops.like3(point.offset, options.horizon.x, options.horizon.y, options.horizon.z)
    bounded = ((point.instance != options.ground) & (options.ground >= 0)) & tables.lights.shadows[light]
    sample = lights.cosine_sample_above(point.normal, horizon, bounded, u, v)
    direction, share = sky_sampling.sample_diffuse(options.dome_map, sample, light, point.normal, horizon, bounded, u, v)
    diffuse = bsdf.matt_share(shader, point.normal, direction, viewer)
    radiance = ops.scale(ops.mul(diffuse, _sky_radiance(scene, point, light, direction)), share)
    visible = _faces(scene, point, shader, direction, active)
    sample = LightSample(light, _shadow_origin(point, direction), direction, lights.FAR, radiance)
    total = ops.add(total, _unoccluded(scene, point, sample, visible))
    glossy = background.samples_sky(options.environment, active & bsdf.is_shiny(shader), shader)
    if ops.any_lane(glossy):
        u, v = sobol.pair(sampler.pixel, sampler.sample, _dimension(sampler, light) + 1, options.seed)
        number = lobe_number(scene, shader, sampler)
        lobe = bsdf.sample_lobe(shader, point.normal, viewer, u, v, number)
        direction, share = sky_sampling.sample_highlight(options.dome_map, lobe, light, shader, point.normal, viewer, (u, v, number))
        radiance = ops.mul(share, _sky_radiance(scene, point, light, direction))
        visible = _faces(scene, point, shader, direction, glossy)
        sample = LightSample(light, _shadow_origin(point, direction), direction, lights.FAR, radiance)
        total = ops.add(total, _unoccluded(scene, point, sample, visible))
    return _add_sky_of_lobe(shader.added, total, scene, shading, light, active, sampler)


@helper
def _add_sky_by_lobe(added: Any, total: Vec, scene: Scene, shading: ShadingContext, light: int, active: Lane, sampler: SampleIndex) -> Vec:
    """Add a sky's light of the lobe that a material adds to the classic ones, from one direction of it."""
    point, viewer = shading.point, shading.viewer
    lanes = active & added_lobes.or_has(added, ops.bool_like(point.offset, False))
    if ops.any_lane(lanes):
        u, v = sobol.pair(sampler.pixel, sampler.sample, _dimension(sampler, light) + 1, scene.options.seed)
        default = (point.normal, (0.0 * u, 0.0 * u, 0.0 * u))
        lobe = added_lobes.sample_lobe(added, default, point.normal, viewer, u, v)
        direction, share = sky_sampling.sample_added(scene.options.dome_map, lobe, light, added, point.normal, viewer, (u, v))
        radiance = ops.mul(share, _sky_radiance(scene, point, light, direction))
        visible = _faces(scene, point, shading.shader, direction, lanes)
        sample = LightSample(light, _shadow_origin(point, direction), direction, lights.FAR, radiance)
        total = ops.add(total, _unoccluded(scene, point, sample, visible))
    return total


_add_sky_of_lobe = specialize_if_present(_add_sky_by_lobe)


@helper
def _add_light(total: Vec, scene: Scene, shading: ShadingContext, light: int, active: Lane, sampler: SampleIndex) -> Vec:
    """Add the light of a light with a position or a direction."""
    tables, options, point, shader = scene.tables, scene.options, shading.point, shading.shader
    u, v = _sample_numbers(scene, point, light, sampler)
    origin = _light_origin(scene, point, shader, light)
    arriving = light_samples.sample(tables, light, origin, u, v)
    share = glossy_lights.reflected(options.glossy_lights, shader, tables, light, point.normal, arriving, shading.viewer, active)
    radiance = ops.scale(ops.mul(share, arriving.irradiance), 1.0 / np.pi)
    medium = medium_stack.cross_boundary(shading.inside, None, tables, point, arriving.direction)
    radiance = medium_stack.attenuate(medium, radiance, tables, arriving.distance)
    radiance = airlight.transmit(options.airlight, radiance, origin, arriving.direction, arriving.distance)
    visible = _faces(scene, point, shader, arriving.direction, active)
    sample = LightSample(light, origin, arriving.direction, arriving.distance, radiance)
    return ops.add(total, _unoccluded(scene, point, sample, visible))


@helper
def _add_along_lobes(total: Vec, scene: Scene, shading: ShadingContext, active: Lane, sampler: SampleIndex) -> Vec:
    """Add the light of area lights, and of the environment without secondary rays, from one sampled direction of a glossy lobe."""
    options, point, shader = scene.options, shading.point, shading.shader
    glossy = active & bsdf.is_glossy(shader)
    if ops.any_lane(glossy):
        u, v = sobol.pair(sampler.pixel, sampler.sample, sampler.key * LIGHT_DIMENSIONS * 2 + 1, options.seed)
        which = lobe_number(scene, shader, sampler)
        direction, share = bsdf.sample_lobe(shader, point.normal, shading.viewer, u, v, which)
        total = _add_lobe_lights(options.glossy_lights, total, scene, shading, glossy, direction, share)
        total = background.add_glossy_environment(options.environment, total, scene, point, shader, glossy, direction, share)
    return total


@helper
def _add_hit_lights(
    sources: Any, total: Vec, scene: Scene, shading: ShadingContext, active: Lane, direction: Vec, share: Vec
) -> Vec:  # fmt: skip
    """Add the light of lights that a direction of a glossy lobe hits, weighted against the samples of those lights."""
    tables, point, shader = scene.tables, shading.point, shading.shader
    _, _, density = bsdf.eval_lobes_pdf(shader, point.normal, direction, shading.viewer)
    visible = _faces(scene, point, shader, direction, active)
    bits = links.bits_of(scene.options.links, None, tables, point)
    for k in range(len(sources.rows)):
        light = sources.rows[k]
        receiving = links.receives(scene.options.links, visible, light, bits)
        origin = _light_origin(scene, point, shader, light)
        distance, solid, bright = light_samples.intersect(tables, light, origin, direction)
        color = (tables.lights.color[light, 0], tables.lights.color[light, 1], tables.lights.color[light, 2])
        radiance = ops.mul(ops.scale(share, bright * glossy_lights.weight(density, solid)), color)
        inside = medium_stack.cross_boundary(shading.inside, None, tables, point, direction)
        radiance = medium_stack.attenuate(inside, radiance, tables, distance)
        radiance = airlight.transmit(scene.options.airlight, radiance, origin, direction, distance)
        total = ops.add(total, _unoccluded(scene, point, LightSample(light, origin, direction, distance, radiance), receiving))
    return total


_add_lobe_lights = specialize_if_present(_add_hit_lights)


@helper
def lobe_number(scene: Scene, shader: Shader, sampler: SampleIndex) -> Lane:
    """Return a random number that chooses a microfacet lobe; 0 in scenes without microfacets."""
    if bsdf.has_facets(shader) and ops.any_lane(bsdf.facets_of(shader)):
        return sobol.pair(sampler.pixel, sampler.sample, sampler.key * LIGHT_DIMENSIONS * 2, scene.options.seed)[1]
    return ops.full_like(shader.ior, 0.0)


# --- shadow tests -------------------------------------------------------------------------------------------------------


@helper
def _light_origin(scene: Scene, point: Surface, shader: Shader, light: int) -> Vec:
    """Origin of rays to a light: the surface itself for lights without shadows and for rough glass, else `interaction.shadow_origin`."""
    blocked = scene.options.shadows and scene.tables.lights.shadows[light]
    at_surface = bsdf.scatters_through(shader, ops.bool_like(point.offset, not blocked))
    return ops.where3(at_surface, point.position, interaction.shadow_origin(point))


@helper
def _shadow_origin(point: Surface, direction: Vec) -> Vec:
    """Origin of rays to a sky, on either side of the surface."""
    above = _or_above_coat(tangent_frame.coat_of(point.tangent), ops.dot(direction, point.normal) > 0.0, direction)
    return ops.where3(above, interaction.shadow_origin(point), point.position)


@helper
def _is_above_coat(coat: Vec, above: Lane, direction: Vec) -> Lane:
    return above | (ops.dot(direction, coat) > 0.0)


_or_above_coat = specialize_if_present(_is_above_coat)  # a coat's own normal, whether a direction is above the base's, the direction


@helper
def _faces(scene: Scene, point: Surface, shader: Shader, direction: Vec, active: Lane) -> Lane:
    """Whether light may arrive from a direction: from the front, or through rough glass."""
    return active & bsdf.scatters_through(shader, normal_map.mask_behind(scene.tables, point, direction, active))


@helper
def _unoccluded(scene: Scene, point: Surface, sample: LightSample, active: Lane) -> Vec:
    """Return the radiance of a light sample where no shadow caster blocks it; 0 elsewhere."""
    zero = ops.full_like(point.offset, 0.0)
    active = active & (ops.largest(sample.radiance) > 0.0)
    if scene.options.shadows and scene.tables.lights.shadows[sample.light] and ops.any_lane(active):
        return _shadowed(scene.options.maps, scene, point, sample, active)
    return ops.where3(active, sample.radiance, (zero, zero, zero))


@helper
def _shadow_by_rays(scene: Scene, point: Surface, sample: LightSample, active: Lane) -> Vec:
    reach = ops.maximum((0.0 * point.offset + sample.distance) - SHADOW_MARGIN * point.offset, 0.0)  # a light's shape does not block it
    origin = interaction.offset_shadow_origin(point, sample.origin, sample.direction)
    ray = Ray(origin, sample.direction, 0.0 * point.offset, reach, point.time)
    return _attenuated(scene.options.links, scene, point, sample.light, ray, active, sample.radiance)


@helper
def _attenuate_by_all(scene: Scene, point: Surface, light: int, ray: Ray, active: Lane, radiance: Vec) -> Vec:
    return shadow_rays.attenuate_light(point, scene.accel, scene.tables, light, ray, active, radiance)


@helper
def _attenuate_by_blockers(linked: Any, scene: Scene, point: Surface, light: int, ray: Ray, active: Lane, radiance: Vec) -> Vec:
    return intersect.attenuate(scene.accel, scene.tables, ray, active, radiance, linked.blockers[light])


_attenuated = specialize_either(_attenuate_by_blockers, _attenuate_by_all)


@helper
def _shadow_by_maps(maps: Any, scene: Scene, point: Surface, sample: LightSample, active: Lane) -> Vec:
    if maps.first[sample.light] < 0:
        return _shadow_by_rays(scene, point, sample, active)
    zero = 0.0 * point.offset
    lit = shadow_map.lit(maps, scene.tables, sample.light, point)
    return ops.where3(active, ops.scale(sample.radiance, lit), (zero, zero, zero))


_shadowed = specialize_either(_shadow_by_maps, _shadow_by_rays)
