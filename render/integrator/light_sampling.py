"""Next event estimation of the path integrator: one sample of one emitter at each surface."""

from __future__ import annotations

import math
from typing import Any

from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..light import dome_spots, emitters, light_tree, lights, links
from ..light.emitters import Arriving
from ..light.form_samples import SKY
from ..material import bsdf, medium_stack
from ..material.shader import Shader
from ..medium import emitting_cells
from ..surface import interaction, normal_map
from ..types import Lane, Surface, Tables, Vec
from .path_emission import mis_weight
from .photon_maps.photon_coverage import exclude_covered_lobe, photon_covers_mirror
from .state import flights
from .state.path_state import LIGHTS_ALONE, Connection, PathInputs, PathSample, PathState, medium_number, numbers
from .state.records import ShadingContext

GRAZING = 1e-3  # cosine at an emitter below which shadow rays are shortened no further


@helper
def facing(inputs: PathInputs, point: Surface, shader: Shader, event: Any) -> Any:
    """Return a vertex's record for light selection, see light_tree.facing."""
    both = flights.or_scattered(event, bsdf.scatters_through(shader, ops.bool_like(point.offset, False)))
    return light_tree.facing(inputs.emitters.tree.below, point.normal, both)


@helper
def _on_mirror(inputs: PathInputs, row: Any, path: PathState, shading: ShadingContext) -> Lane:
    return flights.surfaces(shading.event, photon_covers_mirror(inputs.photon_emitters, row, path, shading.shader))


@helper
def _in_medium(
    media: Any, default: Arriving, inputs: PathInputs, row: Lane, place: Vec, numbers_: tuple[Lane, Lane], index: PathSample
) -> Arriving:  # fmt: skip
    """`default`, or a direction to a point of a medium that emits: the ray in it collects the light of all its line."""
    u, v = numbers_
    rows = ops.int_like(u, 0) + row
    emits = (ops.int_like(u, 0) + inputs.emitters.kind[rows]) == emitting_cells.KIND
    if ops.not_(ops.any_lane(emits)):
        return default
    direction, density = emitting_cells.sample(media, ops.where(emits, rows, media.first), place, u, v, medium_number(index))
    inverse = ops.where(density > lights.TINY, 1.0 / ops.maximum(density, lights.TINY), 0.0)
    unit = 0.0 * u + 1.0
    return Arriving(
        ops.where3(emits, direction, default.direction), ops.where(emits, unit, default.distance),
        ops.where3(emits, (inverse, inverse, inverse), default.light), ops.where(emits, density, default.density),
        ops.where(emits, unit, default.cosine),
    )  # fmt: skip


@helper
def _mark_collecting(media: Any, default: Lane, inputs: PathInputs, row: Lane) -> Lane:
    """The distance of shadow rays, or the code of those that collect the light of a medium."""
    rows = ops.int_like(default, 0) + row
    emits = (ops.int_like(default, 0) + inputs.emitters.kind[rows]) == emitting_cells.KIND
    if ops.not_(ops.any_lane(emits)):
        return default
    number = ops.int_like(default, 0) + media.number[ops.where(emits, rows - media.first, 0)]
    return ops.where(emits, emitting_cells.code(number), default)


_sample_media, _mark = specialize_if_present(_in_medium), specialize_if_present(_mark_collecting)


@helper
def _choose_emitter(
    tables: Tables, inputs: PathInputs, shading: ShadingContext, path: PathState, lanes: Lane, lit: Lane, ending: bool, index: PathSample,
    place: Vec,
) -> tuple[Lane, Lane, Arriving, Lane, Lane, Lane]:  # fmt: skip
    """(row, its probability, its sample from a place, where light is sampled, whether BSDF samples find it, whether it casts shadows)."""
    point, shader = shading.point, shading.shader
    u, v = numbers(index, 0)
    table = inputs.emitters
    zero = ops.full_like(point.offset, 0.0)
    if len(table.kind) == 1:
        arriving = emitters.sample(tables, table, 0, place, u, v)
        arriving = _sample_media(table.media, arriving, inputs, 0, place, (u, v), index)
        is_light_row = table.light[0] >= 0
        lanes = (
            lanes
            & (ops.not_(ending) | is_light_row)
            & ops.not_(lit & is_light_row)
            & ops.not_(dome_spots.only_in_spots(inputs.spots, _on_mirror(inputs, 0, path, shading), 0, arriving.direction))
        )
        weighed, shadows = ops.bool_like(zero, table.weighed[0]), ops.bool_like(zero, table.shadows[0])
        return 0, zero + 1.0, arriving, lanes, weighed, shadows
    row, chance = light_tree.choose(table.tree, place, facing(inputs, point, shader, shading.event), numbers(index, 2)[0])
    arriving = emitters.sample(tables, table, row, place, u, v)
    arriving = _sample_media(table.media, arriving, inputs, row, place, (u, v), index)
    is_light = table.light[row] >= 0
    lanes = lanes & (chance > 0.0) & (ops.bool_like(zero, ops.not_(ending)) | is_light) & ops.not_(lit & is_light)
    lanes = lanes & ops.not_(dome_spots.only_in_spots(inputs.spots, _on_mirror(inputs, row, path, shading), row, arriving.direction))
    chance = ops.where(chance > 0.0, chance, 1.0)
    return row, chance, arriving, lanes, table.weighed[row], table.shadows[row]


@helper
def _sample_linked(
    linked: Any, default: tuple[Arriving, Lane, Any], tables: Tables, inputs: PathInputs, row: Lane, point: Surface
) -> tuple[Arriving, Lane, Lane]:
    """(sample, where light is sampled, mask of the instances that block it) of emitters by their links; `default` is without links."""
    arriving, lanes, _ = default
    table, zero = inputs.emitters, ops.full_like(point.offset, 0.0)
    bits = links.bits_of(linked, None, tables, point)
    light_row = ops.int_like(zero, 0) + table.light[row]
    sky = ops.bool_like(zero, False) | (table.kind[row] == SKY)
    light = arriving.light
    if ops.any_lane(sky):
        radiance = links.background(linked, light, tables, arriving.direction, lights.SHADOWED, bits)
        light = ops.where3(sky, ops.scale(radiance, 1.0 / ops.maximum(arriving.density, lights.TINY)), light)
    lanes = ops.where(sky, lanes, links.receives_lamp(linked, lanes, light_row, bits))
    blockers = ops.where(light_row >= 0, ops.int_like(zero, 0) + linked.blockers[ops.maximum(light_row, 0)], links.CASTS)
    return Arriving(arriving.direction, arriving.distance, light, arriving.density, arriving.cosine), lanes, blockers


_follow_links = specialize_if_present(_sample_linked)


@helper
def sample_direct(
    tables: Tables, inputs: PathInputs, linked: Any, shading: ShadingContext, path: PathState, lanes: Lane, last: Lane, lit: Lane,
    ending: bool, index: PathSample,
) -> Connection:  # fmt: skip
    """Sample one emitter and return the shadow ray to it.

    Where no ray goes on (`last`) its light counts in full. At the last bounce (`ending`) only lights are sampled, and at surfaces with
    vertex light (`lit`) only emissive shapes.
    """
    point, shader, viewer = shading.point, shading.shader, shading.viewer
    zero = ops.full_like(point.offset, 0.0)
    rough = flights.or_scattered(shading.event, bsdf.scatters_through(shader, ops.bool_like(zero, False)))
    place = ops.where3(rough, point.position, interaction.shadow_origin(point))
    row, chance, arriving, lanes, weighed, shadows = _choose_emitter(tables, inputs, shading, path, lanes, lit, ending, index, place)
    arriving, lanes, blockers = _follow_links(linked, (arriving, lanes, None), tables, inputs, row, point)
    share, density = bsdf.eval_bsdf_pdf(shader, inputs.uses, point.normal, arriving.direction, viewer)
    share, density = flights.evaluate(shading.event, (share, density), arriving.direction, viewer)
    photons = inputs.caustic_reflectance, inputs.photon_emitters, inputs.spots
    share, alone = exclude_covered_lobe(*photons, share, row, path, shading, arriving.direction)
    factor = 1.0 / (math.pi * chance)
    above = rough | (ops.dot(arriving.direction, point.geometric) > 0.0)  # BSDF samples do not go below the geometric surface
    both_ways = weighed & above & ops.not_(last | lit | alone)
    factor = factor * ops.where(both_ways, mis_weight(arriving.density * chance, density, inputs.weighing, LIGHTS_ALONE), 1.0)
    radiance = ops.scale(ops.mul(ops.mul(path.weight, share), arriving.light), factor)
    inside = medium_stack.cross_boundary(path.inside, None, tables, point, arriving.direction)
    radiance = medium_stack.attenuate(inside, radiance, tables, arriving.distance)
    origin = interaction.offset_shadow_origin(point, place, arriving.direction)
    connects = lanes & (ops.largest(radiance) > 0.0)
    above = bsdf.scatters_through(shader, normal_map.mask_behind(tables, point, arriving.direction, connects))
    connects = connects & flights.or_scattered(shading.event, above)
    # Emitters do not block their own light: rays end before them by all rounding errors, and by the offset of their origin.
    short = 64.0 * ops.roundoff(zero) * ops.where(arriving.distance < math.inf, arriving.distance, 0.0) + 2.0 * point.offset
    reach = ops.maximum(arriving.distance - short / ops.maximum(arriving.cosine, GRAZING), 0.0)
    distance = ops.where(shadows, reach, flights.untested(shading.event, ops.full_like(reach, -1.0), reach))
    distance = _mark(inputs.emitters.media, distance, inputs, row)
    body = medium_stack.enter_body(path.body, None, tables, point, inside, arriving.direction)
    inside = flights.carried(shading.event, None, inside)
    return Connection(origin, arriving.direction, distance, radiance, connects, share, blockers, inside, body)
