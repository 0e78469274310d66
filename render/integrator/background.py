"""Radiance of rays that leave the scene, and the environment that replaces secondary rays in backends without them."""

from __future__ import annotations

from typing import Any

from ...compiler import ir
from ...lights import SKIES
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..light import airlight, lights, links
from ..material import bsdf
from ..material.shader import Shader
from ..types import Lane, NoAirlight, Options, Surface, Tables, Vec
from .state.records import Scene


@helper
def camera_background(tables: Tables, options: Options, direction: Vec) -> Vec:
    """Return the radiance of camera rays that hit nothing."""
    zero = 0.0 * direction[0]
    if options.background == 0:
        return lights.background(tables, direction)[0]
    if options.background == 1:
        return (zero, zero, zero)
    return (zero + options.color.x, zero + options.color.y, zero + options.color.z)


def is_black(tables: Tables, options: Options) -> bool:
    """Whether camera rays that hit nothing carry no light."""
    if not isinstance(options.airlight, NoAirlight):
        return False
    skies = bool(ir.is_in(tables.lights.kind, SKIES).any())
    return not (skies if options.background == 0 else options.background == 2 and any(options.color))


@helper
def reflected_background(tables: Tables, options: Options, direction: Vec, bits: Any) -> Vec:
    """Return the radiance of secondary rays that hit nothing: the sky, or the background color in a scene without a sky.

    `bits` are the light links of the surfaces that the rays leave; None in scenes without links.
    """
    zero = 0.0 * direction[0]
    sky, has_sky = lights.background(tables, direction)
    if has_sky or options.background != 2:
        return links.background(options.links, sky, tables, direction, lights.ALL, bits)
    return (zero + options.color.x, zero + options.color.y, zero + options.color.z)


# --- environment in place of secondary rays -------------------------------------------------------------------------------


@helper
def _environment_radiance(environment: Any, tables: Tables, options: Options, point: Surface, direction: Vec) -> Vec:
    """The ground's mean radiance below the horizon, and the background above it."""
    zero = 0.0 * direction[0]
    below = ops.dot(direction, ops.like3(zero, environment.up.x, environment.up.y, environment.up.z)) < 0.0
    ground = ops.like3(zero, environment.ground.x, environment.ground.y, environment.ground.z)
    bits = links.bits_of(options.links, None, tables, point)
    above = airlight.seen_through(
        options.airlight, reflected_background(tables, options, direction, bits), tables, point.position, direction, zero + lights.FAR
    )
    return ops.where3(below, ground, above)


@helper
def _add_specular(environment: Any, light: Vec, scene: Scene, point: Surface, shader: Shader, direction: Vec) -> Vec:
    reflection, transmission, _, _ = bsdf.fresnel_split(point, shader, direction)
    mirrored = _environment_radiance(environment, scene.tables, scene.options, point, ops.reflect(direction, point.normal))
    behind = _environment_radiance(environment, scene.tables, scene.options, point, direction)
    return ops.add(light, ops.add(ops.mul(reflection, mirrored), ops.mul(transmission, behind)))


@helper
def _add_glossy(
    environment: Any, light: Vec, scene: Scene, point: Surface, shader: Shader, active: Lane, direction: Vec, share: Vec
) -> Vec:  # fmt: skip
    visible = active & bsdf.scatters_through(shader, ops.dot(direction, point.geometric) > 0.0)
    radiance = _environment_radiance(environment, scene.tables, scene.options, point, direction)
    return ops.where3(visible, ops.add(light, ops.mul(share, radiance)), light)


@helper
def _exclude_glossy(environment: Any, active: Lane, shader: Shader) -> Lane:
    return active & ops.not_(bsdf.is_glossy(shader))


add_specular_environment = specialize_if_present(_add_specular)
"""(environment, light, scene, point, shader, direction): add what mirrors and clear glass show, if no secondary rays are traced."""
add_glossy_environment = specialize_if_present(_add_glossy)
"""(environment, light, scene, point, shader, active, direction, share): add what a direction of a glossy lobe shows, likewise."""
samples_sky = specialize_if_present(_exclude_glossy)
"""(environment, active, shader): the lanes whose highlights sample skies; glossy ones already reflect the environment."""
