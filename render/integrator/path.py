"""Path integrator: emission, next event estimation and BSDF sampling at each surface of a path.

Kajiya 1986; light and BSDF samples are combined by multiple importance sampling (Veach 1997, §9.2.4); long paths end by Russian roulette.
One source serves numpy lanes (`path_reference`) and kernels (`wavefront`): `shade_vertex` handles a hit and returns the rays to trace.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..jit.kernel import helper
from ..lanes import ops
from ..light import lights, links
from ..material import bsdf, dispersion, medium_stack
from ..material.bsdf import Scattered
from ..material.shader import ONLY, evaluate_shader_filtered
from ..simd.registration import overload
from ..surface import blend, interaction, normal_map, tangent_frame
from ..types import Hit, Lane, Options, Surface, Tables, Vec, VertexLight
from . import gouraud
from .light_sampling import facing, sample_direct
from .path_emission import emitted_radiance
from .photon_maps import photon_map, photon_volume
from .photon_maps.photon_coverage import photon_covers_lobe, split_lobe, splits_lobe
from .state import flights
from .state.path_state import (
    GATHERED,
    LIT,
    Connection,
    NoVertices,
    PathInputs,
    PathSample,
    PathState,
    Vertex,
    lobe_number,
    numbers,
    photon_number,
)
from .state.records import ShadingContext

END_FROM = 3  # surfaces before Russian roulette begins
MOST_GOING = 0.95  # greatest probability to go on
SPARED = 2.0  # weights below 1 / SPARED end by chance, and survivors have this one: distant surfaces get few rays, as noisy as near ones


@helper
def _sample_part(tables: Tables, point: Surface, index: PathSample) -> Surface:
    return blend.choose_part(tables, point, numbers(index, 3)[1])


_part = blend.if_blended(_sample_part)


@helper
def shade_vertex(
    tables: Tables, inputs: PathInputs, options: Options, path: PathState, hit: Hit, point: Surface, lanes: Lane,
    index: PathSample, direct: PathSample, event: Any,
) -> tuple[Vec, Connection, PathState, Lane, Vertex]:  # fmt: skip
    """(light sent along the path, shadow ray, continuation of the path, whether it continues, its vertex) at the hits of a mask.

    `event` is a flights.Event of vertices that are no surfaces; the mask `lanes` has those in media, not those at invisible boundaries.
    `index` gives the path its numbers, `direct` its light samples and photons. Their `depth` counts surfaces from 0. At options.bounces
    light is sampled for the last time, and later rays add only emission.
    """
    zero = 0.0 * path.density
    uses, depth = inputs.uses, index.depth
    faded = medium_stack.attenuate(path.inside, path.weight, tables, hit.t)
    point = normal_map.apply_maps(tables, _part(tables, point, index), hit, path.direction)
    point = tangent_frame.attach(tables, point, hit)
    surfaces = flights.surfaces(event, lanes)
    component = dispersion.of_sample(dispersion.of(tables), None, index.pixel, index.sample, index.seed)
    shader = evaluate_shader_filtered(tables, point, uses, path.inside, component)
    weight, divided = dispersion.divide_before(component, (faded, path.divided), tables, point, shader, surfaces)
    path = PathState(
        path.origin, path.direction, weight, path.density, path.straight, path.inside, path.phase, path.facing, path.links, path.near,
        path.body, path.leaving, divided, path.axis,
    )  # fmt: skip
    ahead = photon_volume.wall(photon_volume.of(inputs.photons), None, tables, path, point, hit.t)
    point = flights.place(event, point, path)
    viewer, sent = ops.negate(path.direction), (zero, zero, zero)
    if uses.shines:
        sent = emitted_radiance(tables, inputs, options.links, path, point, shader, hit, surfaces, depth > options.bounces)
    nothing = ops.bool_like(zero, False)
    bits = links.bits_of(options.links, None, tables, point)
    inside = flights.carried(event, None, path.inside)
    connection = Connection(point.position, path.direction, zero, sent, nothing, (zero, zero, zero), bits, inside, path.body)
    shading = ShadingContext(point, shader, viewer, path.inside, event)
    if depth > options.bounces:
        ended = Scattered(path.direction, (zero, zero, zero), zero + ONLY, nothing)
        return sent, connection, path, nothing, Vertex(shading, ended, photon_map.no_estimate(inputs.photons, shading))
    lit, interpolated = vertex_light(inputs.vertices, tables, point, hit, surfaces)
    sent = _add_local(tables, inputs, options.links, sent, shading, path, surfaces, lit, interpolated)
    base = flights.surfaces(event, splits_lobe(inputs.photons, path.phase, shader))
    gathered = _gather(inputs, shading, path, lanes, surfaces, base, direct, ahead)
    ending = depth == options.bounces
    last = ops.bool_like(zero, False)
    if ending:  # BSDF samples after the last bounce find only skies, and emitters of glossy surfaces
        last = ops.bool_like(zero, ops.not_(uses.sky) & ops.not_(uses.glossy))
    if len(inputs.emitters.kind) > 0:
        connection = sample_direct(tables, inputs, options.links, shading, path, lanes, last, lit, ending, direct)
    scattered = _scatter(shading, uses, path, index)
    weight, divided = ops.mul(path.weight, scattered.weight), path.divided
    weight, divided = dispersion.divide_after(component, (weight, divided), tables, point, scattered.direction, surfaces)
    if uses.open_sky:
        sent = _add_open_sky(tables, options.links, sent, weight, scattered, bits, lanes & ops.not_(lit))
    weight, lobe = split_lobe(inputs.photons, (weight, nothing), base, shading, scattered, lobe_number(index))
    going = lanes & ops.not_(last) & (ops.largest(weight) > 0.0)
    if ending:
        going = going & (scattered.density < ONLY)
    if depth >= END_FROM:
        weight, going = _survive(event, weight, path.weight, going, index)
    onward = _continue(tables, inputs, options.links, path, shading, lit, scattered, weight, lobe, divided)
    onward, going = flights.pass_boundary(event, (onward, going), tables, path, point, hit.t)
    return sent, connection, onward, going, Vertex(shading, scattered, gathered)


@helper
def _add_open_sky(tables: Tables, linked: Any, sent: Vec, weight: Vec, scattered: Scattered, bits: Any, lanes: Lane) -> Vec:
    """Add the light of skies without shadows that a BSDF sample meets."""
    soft = lanes & (scattered.density < ONLY)
    seen = lights.background(tables, scattered.direction, lights.OPEN)[0]
    above = ops.mul(weight, links.background(linked, seen, tables, scattered.direction, lights.OPEN, bits))
    return ops.where3(soft, ops.add(sent, above), sent)


@helper
def _gather(
    inputs: PathInputs, shading: ShadingContext, path: PathState, lanes: Lane, surfaces: Lane, base: Lane, direct: PathSample, ahead: Any
) -> Any:  # fmt: skip
    """The light of photons near the vertices of a mask, some of which are surfaces."""
    gathers, number = surfaces & (path.phase < photon_map.MATT), photon_number(direct)
    gathered = photon_map.estimate(inputs.photons, shading, inputs.uses, path.weight, gathers, base, direct.sample, number)
    return photon_volume.at_collisions(photon_volume.of(inputs.photons), gathered, shading, path, lanes, direct, ahead)


@helper
def _scatter(shading: ShadingContext, uses: Any, path: PathState, index: PathSample) -> Scattered:
    """A sample of the BSDF, or in media of the phase function."""
    u, v = numbers(index, 1)
    which = 0.0 * path.density
    if uses.glossy or uses.sharp:
        which = numbers(index, 2)[1]
    sampled = bsdf.sample_bsdf(shading.shader, uses, shading.point, shading.viewer, u, v, which)
    return flights.scatter(shading.event, sampled, path.direction, u, v, numbers(index, 2)[1])


@helper
def _survive(event: Any, weight: Vec, before: Vec, going: Lane, index: PathSample) -> tuple[Vec, Lane]:
    """(weight, whether a path goes on) after Russian roulette; `before` is the weight before its direction was chosen."""
    survival = ops.minimum(SPARED * ops.largest(weight), MOST_GOING)
    survival = flights.survival(event, survival, SPARED * ops.largest(weight), SPARED * ops.largest(before))
    return ops.scale(weight, 1.0 / ops.maximum(survival, lights.TINY)), going & (numbers(index, 3)[0] < survival)


@helper
def _add_local(
    tables: Tables, inputs: PathInputs, linked: Any, sent: Vec, shading: ShadingContext, path: PathState, lanes: Lane, lit: Lane,
    vertex_radiance: Vec
) -> Vec:  # fmt: skip
    """Add vertex light and ambient light."""
    sent = ops.where3(lit, ops.add(sent, ops.mul(path.weight, vertex_radiance)), sent)
    if inputs.uses.ambient:
        bits = links.bits_of(linked, None, tables, shading.point)
        ambient = links.ambient(linked, lights.ambient(tables), tables, path.density, bits)
        always = ops.mul(ops.mul(path.weight, shading.shader.ambient), ambient)
        sent = ops.where3(lanes & ops.not_(lit), ops.add(sent, always), sent)
    return sent


@helper
def _continue(
    tables: Tables, inputs: PathInputs, linked: Any, path: PathState, shading: ShadingContext, lit: Lane, scattered: Scattered, weight: Vec,
    lobe: Lane, divided: Any,
) -> PathState:  # fmt: skip
    """The state of a path after a BSDF sample."""
    point, shader = shading.point, shading.shader
    straight = path.straight & scattered.through
    density = ops.where(lit & (scattered.density < ONLY), LIT, scattered.density)
    after_matt = ((path.density < ONLY) | (path.density > 2.0 * ONLY)) & (path.phase != photon_map.LOBE)
    density = ops.where((density >= ONLY) & after_matt, GATHERED, density)
    inside = medium_stack.cross_boundary(path.inside, None, tables, point, scattered.direction)
    covered = photon_covers_lobe(inputs.caustic_reflectance, point, shader)
    phase = photon_map.phase_after(inputs.photons, path.phase, shader, scattered.density >= ONLY, covered, lobe)
    phase = photon_volume.phase_after(photon_volume.of(inputs.photons), phase, shading)
    on_surface = flights.or_scattered(shading.event, bsdf.scatters_through(shader, scattered.density >= ONLY))
    place = ops.where3(on_surface, point.position, interaction.shadow_origin(point))  # the origin of shadow rays: equal both ways
    origin = interaction.offset_origin_at(point, place, scattered.direction)
    bits = links.bits_beyond(linked, None, tables, point, path.links, scattered.through)
    body = medium_stack.enter_body(path.body, None, tables, point, inside, scattered.direction)
    return PathState(
        origin, scattered.direction, weight, density, straight, inside, phase, facing(inputs, point, shader, shading.event), bits,
        flights.at_start(shading.event, None, density), body,
        photon_volume.leaving(photon_volume.of(inputs.photons), None, point, scattered.direction, path.inside, inside), divided,
        flights.turn(shading.event, None, path.axis, point),
    )  # fmt: skip


def vertex_light(vertices: Any, tables: Tables, point: Surface, hit: Hit, lanes: Lane) -> tuple[Lane, Vec]:
    """(where light is computed at vertices, that light)."""
    if isinstance(vertices, NoVertices):
        return np.zeros_like(lanes), (0.0 * point.offset, 0.0 * point.offset, 0.0 * point.offset)
    return _vertex_light(vertices, tables, point, hit, lanes)


@helper
def _vertex_light(vertices: VertexLight, tables: Tables, point: Surface, hit: Hit, lanes: Lane) -> tuple[Lane, Vec]:
    zero = ops.full_like(point.offset, 0.0)
    lit = lanes & gouraud.is_vertex_lit(tables, vertices, point)
    interpolated = (zero, zero, zero)
    if ops.any_lane(lit):
        interpolated = ops.where3(lit, gouraud.interpolate_vertex_light(tables, vertices, point, hit, lit), interpolated)
    return lit, interpolated


@overload(vertex_light)
def _vertex_light_in_kernels(vertices, tables, point, hit, lanes):
    if vertices.layout:
        return lambda vertices, tables, point, hit, lanes: _vertex_light(vertices, tables, point, hit, lanes)

    def nowhere(vertices, tables, point, hit, lanes):
        zero = ops.full_like(point.offset, 0.0)
        return ops.bool_like(zero, False), (zero, zero, zero)

    return nowhere
