"""Light that paths hit: emitting surfaces and the background, with multiple importance sampling weights (Veach 1997, §9.2.4)."""

from __future__ import annotations

from typing import Any

from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import ops
from ..light import emitters, environment_map, light_tree, lights, links
from ..light.emitter_table import Emitters
from ..material import medium_stack
from ..material.shader import ONLY, Shader
from ..medium import emitting_cells
from ..types import Hit, Lane, Options, Surface, Tables, Vec
from . import background
from .photon_maps.photon_coverage import photon_covers_emission, photon_covers_sky
from .state import flights
from .state.path_state import BALANCE, LIT, SURFACES_ALONE, PathInputs, PathState


@helper
def environment_radiance(
    tables: Tables, inputs: PathInputs, options: Options, path: PathState, missed: Lane, depth: int
) -> tuple[Vec, Lane]:  # fmt: skip
    """(light, loss of alpha) of paths that leave the scene."""
    zero = 0.0 * path.density
    light, less = (zero, zero, zero), zero
    if depth == 0:
        light = background.camera_background(tables, options, path.direction)
        light, share = _behind_media(path.near, (light, zero + 1.0), path)
        return ops.where3(missed, light, (zero, zero, zero)), ops.where(missed, share, zero)
    light = background.reflected_background(tables, options, path.direction, path.links)
    soft = missed & (path.density < ONLY)
    if ops.any_lane(soft):
        seen = _weigh_sky(tables, inputs, options.links, path, light)
        light = ops.where3(soft, seen, light)
    light = ops.where3(photon_covers_sky(inputs.spots, ops.bool_like(zero, False), path), (zero, zero, zero), light)
    straight = missed & path.straight
    if ops.any_lane(straight):
        light = ops.where3(straight, background.camera_background(tables, options, path.direction), light)
        less = ops.where(straight, (path.weight[0] + path.weight[1] + path.weight[2]) / 3.0, less)
    return ops.where3(missed, ops.mul(path.weight, light), (zero, zero, zero)), less


@helper
def _attenuate(near: Lane, default: tuple[Vec, Lane], path: PathState) -> tuple[Vec, Lane]:
    return ops.mul(path.weight, default[0]), default[1] * ops.mean3(path.weight)


_behind_media = specialize_if_present(_attenuate)
"""(start of the ray, (light, alpha), path): what media let pass; `near` is None in scenes without scattering media."""


@helper
def _sky_share(linked: Any, share: Lane, weighed: Lane) -> Lane:
    return ops.where(weighed, share, 0.0)


_if_weighed = specialize_if_present(_sky_share)
"""(links, share, weighed): the share of BSDF samples in the light of the sky; 0 where light samples alone find it."""


@helper
def _weigh_sky(tables: Tables, inputs: PathInputs, linked: Any, path: PathState, radiance: Vec) -> Vec:
    """Weigh the skies' radiance for BSDF samples; skies without shadows count 0, as each surface adds their light itself."""
    zero = 0.0 * path.density
    if ops.not_(inputs.uses.sky):
        return (zero, zero, zero)
    seen = radiance
    if inputs.uses.open_sky:
        seen = lights.background(tables, path.direction, lights.SHADOWED)[0]
        seen = links.background(linked, seen, tables, path.direction, lights.SHADOWED, path.links)
    table = inputs.emitters
    row = environment_map.row_of(table.sky)
    share = ops.where(path.density > LIT * 8.0, zero + 1.0, 0.0)
    if row >= 0:
        density = environment_map.density(table.sky, path.origin, path.direction)
        if len(table.kind) > 1:
            density = density * light_tree.chance(table.tree, ops.int_like(zero, row), path.origin, path.facing)
        share = _if_weighed(linked, share * power_heuristic(path.density, density), table.weighed[row])
    return ops.scale(seen, share)


@helper
def emitted_radiance(
    tables: Tables, inputs: PathInputs, linked: Any, path: PathState, point: Surface, shader: Shader, hit: Hit, lanes: Lane,
    lights_only: bool,
) -> Vec:  # fmt: skip
    """Return the emission of surfaces along paths, weighed against light sampling.

    A light's emission counts as direct. An emissive shape is one more surface, which the last bounce does not reach (`lights_only`).
    """
    zero = 0.0 * path.density
    lit = lanes & (ops.largest(shader.emission) > 0.0)
    if ops.not_(ops.any_lane(lit)):
        return (zero, zero, zero)
    instance = ops.where(lit, hit.instance, 0)
    lit = links.receives_lamp(linked, lit, tables.instances.light[instance], path.links)
    table = inputs.emitters
    row = table.first[instance]
    among = lit & (row >= 0)
    if lights_only:
        lit = lit & (tables.instances.light[instance] >= 0)
    share = zero + 1.0
    if len(table.kind) == 1:
        share, dark = _emission_weight(table, 0, path, point, hit.t, inputs.weighing)
        share, lit = ops.where(among, share, 1.0), lit & ops.not_(among & dark)
        lit = lit & ops.not_(among & photon_covers_emission(inputs.photon_emitters, 0, path))
    elif len(table.kind) > 1:
        row = ops.where(among, row + ops.where(among, hit.primitive - table.parts[instance], 0), 0)
        share, dark = _emission_weight(table, row, path, point, hit.t, inputs.weighing)
        share, lit = ops.where(among, share, 1.0), lit & ops.not_(among & dark)
        lit = lit & ops.not_(among & photon_covers_emission(inputs.photon_emitters, row, path))
    return ops.where3(lit, ops.scale(ops.mul(path.weight, shader.emission), share), (zero, zero, zero))


@separate_helper
def _emission_weight(table: Emitters, row: Lane, path: PathState, point: Surface, t: Lane, weighing: int) -> tuple[Lane, Lane]:
    """(MIS weight of an emitter that a path hit, whether it hit the side that does not emit)."""
    density = emitters.density(table, row, path.origin, path.direction, t)
    if len(table.kind) > 1:
        density = density * light_tree.chance(table.tree, row, path.origin, path.facing)
    only = ops.where(path.density >= ONLY, ops.full_like(t, 1.0), 0.0)
    share = ops.where(path.density <= LIT * 8.0, 0.0, mis_weight(path.density, density, weighing, SURFACES_ALONE))
    share = ops.where(path.density >= ONLY, 1.0, share)
    behind = ops.not_(table.both[row] | point.front)
    is_light = table.light[row] >= 0
    share = ops.where(behind & ops.not_(is_light), 1.0, share)  # light samples do not find the inside of closed shapes
    return ops.where(table.weighed[row], share, only), behind & is_light


@helper
def power_heuristic(density: Lane, other_density: Lane) -> Lane:
    """Return the power heuristic's weight of the strategy of density `density`."""
    ratio = other_density / density
    return 1.0 / (1.0 + ratio * ratio)


@helper
def mis_weight(density: Lane, other_density: Lane, weighing: int, alone: int) -> Lane:
    """Return the MIS weight of the strategy of density `density`, whose index is `alone` if it is used alone."""
    if weighing == 0:
        return power_heuristic(density, other_density)
    if weighing == BALANCE:
        return 1.0 / (1.0 + other_density / density)
    return ops.full_like(density, 1.0 if weighing == alone else 0.0)


@helper
def _weigh_glow(
    media: Any, flown: flights.Flown, tables: Tables, inputs: PathInputs, path: PathState, beyond: bool
) -> flights.Flown:  # fmt: skip
    """Flights whose light of media is weighed against light samples; `beyond` the last bounce there were none from the last vertex."""
    number = medium_stack.top(path.inside)
    zero = 0.0 * path.density
    row = ops.int_like(zero, 0) + media.row[number]
    counts = (ops.largest(flown.emitted) > 0.0) & (row >= 0) & (path.density < ONLY)
    if beyond:
        counts = counts & (path.near > 0.0)
    if ops.not_(ops.any_lane(counts)):
        return flown
    row = ops.where(counts, row, media.first)
    density = emitting_cells.density(media, row, path.origin, path.direction)
    if len(inputs.emitters.kind) > 1:
        density = density * light_tree.chance(inputs.emitters.tree, row, path.origin, path.facing)
    share = ops.where(path.density <= LIT * 8.0, 0.0, mis_weight(path.density, density, inputs.weighing, SURFACES_ALONE))
    return flights.Flown(flown.weight, flown.scattered, flown.t, ops.where3(counts, ops.scale(flown.emitted, share), flown.emitted))


weigh_glow = specialize_if_present(_weigh_glow)
"""(emitting cells, flown, tables, inputs, path, whether it is beyond the last bounce) → the flights, weighed."""
