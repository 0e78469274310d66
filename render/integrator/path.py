"""Path tracing: at each surface a path looks for light at an emitter and goes on in one direction; both ways of finding light are weighed.

Kajiya 1986; multiple importance sampling by Veach's power heuristic (1997, §9.2.4); long paths end by chance, in proportion to what
they could still bring. One source for numpy lanes (`radiance`, the reference backend) and for kernels (waves.py): `arrive` does all
that happens where a ray meets something, and what it wants traced it gives back.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from ...compiler import ir
from ...compiler.plan import scene_facts
from ..accel import intersect
from ..jit.kernel import HELPER, helper, noinline_helper
from ..lanes import ops
from ..light import emitters, environment_map, light_tree, lights
from ..light.emitters import Emitters
from ..material import bsdf, medium_stack, principled, rough_dielectric
from ..material.bsdf import ONLY, Shader, Uses
from ..sampling import sobol
from ..surface import alpha as surface_alpha
from ..surface import blend, interaction, normal_map
from ..types import Hit, Lane, Options, Ray, Surface, Tables, Vec, VertexLight
from . import photon_map, whitted

CAMERA_RAY = int(ir.Visibility.CAMERA)
OTHER_RAY = int(ir.Visibility.REFLECTION)
GOURAUD = int(ir.Shading.GOURAUD)
FIRST = 8  # dimension of random numbers: those before are the camera's
PAIRS = 4  # of random numbers a surface takes: light, direction, choices, end
LAYERS = 1 << 20  # first dimension of those that let paths pass what is not wholly there
SPREAD = 3  # surfaces of a path whose numbers are Sobol points; beyond them good spread gains nothing
END_FROM = 3  # surfaces before a path may end by chance
MOST_GOING = 0.95  # of the paths that go on, however bright
SPARED = 2.0  # times its weight is what a path goes on with: far ends are few rays, and as noisy as near ones
WEIGHINGS = ("power", "balance", "light", "bsdf")  # of the two ways to light: by one of Veach's heuristics, or one way alone
BALANCE, LIGHTS_ALONE, SURFACES_ALONE = 1, 2, 3
GATHERED = 4.0 * ONLY  # density of a mirror's or glass's direction on the way from something matt: photons bring what lamps send there
SLANTED = 1e-3  # cosine at an emitter below which rays to it end no earlier
LIT = 1e-18  # density of a direction from where light was computed at vertices: all that looking for light finds has been found


class Path(NamedTuple):
    """A ray that is on its way, and what it may bring."""

    origin: Vec
    direction: Vec
    weight: Vec
    density: Lane  # of its direction, when it was drawn
    straight: Lane  # bool: it has met nothing but passages of index 1; where it escapes, alpha is lowered
    inside: Any  # the media it is in, see media.py; None in scenes without
    phase: Lane  # what it has met, as photon_map.phase_after counts
    facing: Any = None  # where it comes from, as light_tree.facing says


class Connection(NamedTuple):
    """A ray to a sample of an emitter, and what it brings if nothing stands in its way."""

    origin: Vec
    direction: Vec
    distance: Lane
    light: Vec
    wanted: Lane  # bool


class NoVertices(NamedTuple):
    """No light is computed at vertices."""


class Light(NamedTuple):
    """What a picture's paths read beside its tables."""

    emitters: Emitters
    uses: Uses
    vertices: Any = NoVertices()  # or VertexLight
    weighing: int = 0  # one of WEIGHINGS
    photons: Any = photon_map.NoMaps()  # or photon_map.Maps
    covered: Any = photon_map.NoMaps()  # or (emitters,) bool: those whose light photons bring
    gleaming: Any = photon_map.NoMaps()  # or (instances,) about what highlights over something matt reflect, where photons bring that


def uses_of(tables: ir.Tables) -> Uses:
    """What materials and lights of a scene hold."""
    values, slot = tables.materials.values, ir.Slot
    model = tables.materials.model

    sky = ir.is_in(tables.lights.kind, (ir.LightKind.SKY, ir.LightKind.DOME))

    def any_of(*slots: int) -> bool:
        return bool(values[:, list(slots)].max(initial=0.0) > 0.0)

    return Uses(
        glossy=any_of(slot.SPECULAR) or bool(ir.is_in(model, principled.MODELS).any()) or rough_dielectric.is_rough(tables),
        sharp=any_of(slot.REFLECTION, slot.TRANSMISSION) or bool((model == ir.MaterialModel.GLASS).any()) or principled.has_sharp(tables),
        shines=any_of(slot.EMISSION),
        ambient=bool((tables.lights.kind == ir.LightKind.AMBIENT).any()),
        sky=bool((sky & tables.lights.shadows).any()),
        open_sky=bool((sky & ~tables.lights.shadows).any()),
    )


@helper
def numbers(pixel: Lane, sample: Lane, depth: int, pair: int, seed: int) -> tuple[Lane, Lane]:
    """Two random numbers for the surface that a path meets at a depth."""
    dimension = ops.int_like(pixel, FIRST + depth * PAIRS + pair)
    if depth < SPREAD:
        return sobol.pair(pixel, sample, dimension, seed)
    return sobol.hashed_pair(pixel, sample, dimension, seed)


@helper
def passing(pixel: Lane, sample: Lane, depth: int, layer: int, seed: int) -> Lane:
    """The random number that lets a path pass a layer of what is not wholly there."""
    return sobol.hashed_pair(pixel, sample, ops.int_like(pixel, LAYERS + depth * 1024 + layer), seed)[0]


@helper
def environment_radiance(tables: Tables, light_of: Light, options: Options, path: Path, missed: Lane, depth: int) -> tuple[Vec, Lane]:
    """(light, what alpha loses) of paths that leave the scene."""
    zero = 0.0 * path.density
    light, less = (zero, zero, zero), zero
    if depth == 0:
        light = whitted.camera_background(tables, options, path.direction)
        return ops.where3(missed, light, (zero, zero, zero)), ops.where(missed, zero + 1.0, zero)
    light = whitted.reflected_background(tables, options, path.direction)
    soft = missed & (path.density < ONLY)
    if ops.any_lane(soft):
        seen = _sky_found(tables, light_of, path, light)
        light = ops.where3(soft, seen, light)
    straight = missed & path.straight
    if ops.any_lane(straight):
        light = ops.where3(straight, whitted.camera_background(tables, options, path.direction), light)
        less = ops.where(straight, (path.weight[0] + path.weight[1] + path.weight[2]) / 3.0, less)
    return ops.where3(missed, ops.mul(path.weight, light), (zero, zero, zero)), less


@helper
def _sky_found(tables: Tables, light_of: Light, path: Path, all_of_it: Vec) -> Vec:
    """What of the skies counts where paths find them by chance: those that cast shadows, weighed against looking for them."""
    zero = 0.0 * path.density
    if ops.not_(light_of.uses.sky):
        return (zero, zero, zero)
    seen = all_of_it
    if light_of.uses.open_sky:
        seen = lights.background(tables, path.direction, lights.SHADOWED)[0]
    table = light_of.emitters
    row = environment_map.row_of(table.sky)
    share = ops.where(path.density > LIT * 8.0, zero + 1.0, 0.0)
    if row >= 0:
        found = environment_map.density(table.sky, path.direction)
        if len(table.kind) > 1:
            found = found * light_tree.chance(table.tree, ops.int_like(zero, row), path.origin, path.facing)
        share = share * power(path.density, found)
    return ops.scale(seen, share)


@helper
def emitted_radiance(
    tables: Tables, light: Light, path: Path, point: Surface, shader: Shader, hit: Hit, here: Lane, lamps_only: bool
) -> Vec:
    """What a surface sends out by itself along paths, weighed against the chance of finding it from where they come.

    A lamp's light counts as direct; a shining shape is one more surface, which the last bounce does not reach (`lamps_only`).
    """
    zero = 0.0 * path.density
    lit = here & (ops.largest(shader.emission) > 0.0)
    if ops.not_(ops.any_lane(lit)):
        return (zero, zero, zero)
    instance = ops.where(lit, hit.instance, 0)
    table = light.emitters
    row = table.first[instance]
    among = lit & (row >= 0)
    if lamps_only:
        lit = lit & (tables.instances.light[instance] >= 0)
    share = zero + 1.0
    if len(table.kind) == 1:
        share, dark = _weighed(table, 0, path, point, hit.t, light.weighing)
        share, lit = ops.where(among, share, 1.0), lit & ops.not_(among & dark)
        lit = lit & ops.not_(among & photon_covers_emission(light.covered, 0, path))
    elif len(table.kind) > 1:
        row = ops.where(among, row + ops.where(among, hit.primitive - table.parts[instance], 0), 0)
        share, dark = _weighed_each(table, row, path, point, hit.t, light.weighing)
        share, lit = ops.where(among, share, 1.0), lit & ops.not_(among & dark)
        lit = lit & ops.not_(among & photon_covers_emission(light.covered, row, path))
    return ops.where3(lit, ops.scale(ops.mul(path.weight, shader.emission), share), (zero, zero, zero))


def photon_covers_emission(covered: Any, row: Any, path: Path) -> Lane:
    """Where photons bring the light of an emitter's row, which a path meets by chance, to what sent it on."""
    return np.zeros(np.shape(path.density), bool)


@overload(photon_covers_emission, jit_options=HELPER)
def _brought_in_kernels(covered, row, path):
    if isinstance(covered, types.Array):
        return lambda covered, row, path: ((path.density > 2.0 * ONLY) | (path.phase > photon_map.CLEAN)) & covered[row]
    return lambda covered, row, path: ops.bool_like(path.density, False)


def photon_covers_mirror(covered: Any, row: Any, path: Path, shader: Shader) -> Lane:
    """Where photons bring the light of an emitter's row that a metal sends to the matt surface before it on a path."""
    return np.zeros(np.shape(path.density), bool)


@overload(photon_covers_mirror, jit_options=HELPER)
def _mirrored_in_kernels(covered, row, path, shader):
    if isinstance(covered, types.Array):
        return lambda covered, row, path, shader: (path.phase >= photon_map.CLEAN) & bsdf.is_polished(shader) & covered[row]
    return lambda covered, row, path, shader: ops.bool_like(path.density, False)


def photon_covers_lobe(gleaming: Any, point: Surface, shader: Shader) -> Lane:
    """Where photons bring what a highlight sends of small lamps, and paths find what the matt part under it does."""
    return np.zeros(np.shape(point.offset), bool)


@overload(photon_covers_lobe, jit_options=HELPER)
def _throws_in_kernels(gleaming, point, shader):
    if isinstance(gleaming, types.Array):
        return lambda gleaming, point, shader: (gleaming[point.instance] > 0.0) & bsdf.has_bright_narrow_lobe(shader)
    return lambda gleaming, point, shader: ops.bool_like(point.offset, False)


def left_to_paths(gleaming: Any, covered: Any, share: Vec, row: Any, path: Path, point: Surface, shader: Shader, *of: Any) -> Any:
    """(share of an emitter's light that paths are to find, whether they find it by looking for it alone)."""
    return share, np.zeros(np.shape(path.density), bool)


@overload(left_to_paths, jit_options=HELPER)
def _left_in_kernels(gleaming, covered, share, row, path, point, shader, viewer, direction):
    if isinstance(gleaming, types.Array):
        return lambda gleaming, covered, share, row, path, point, shader, viewer, direction: _left(
            gleaming, covered, share, row, path, point, shader, viewer, direction
        )
    return lambda gleaming, covered, share, row, path, point, shader, viewer, direction: (share, ops.bool_like(path.density, False))


@helper
def _left(
    gleaming: Any, covered: Any, share: Vec, row: Any, path: Path, point: Surface, shader: Shader, viewer: Vec, direction: Vec
) -> tuple[Vec, Lane]:
    alone = (path.phase >= photon_map.CLEAN) & covered[row] & photon_covers_lobe(gleaming, point, shader)
    if ops.any_lane(alone):
        share = ops.where3(alone, bsdf.matt_part(shader, point.normal, direction, viewer), share)
    return share, alone


@helper
def _weighed(table: Emitters, row: Lane, path: Path, point: Surface, t: Lane, weighing: int) -> tuple[Lane, Lane]:
    """(what counts of an emitter that a path met by chance, whether it met the side that does not shine)."""
    found = emitters.density(table, row, path.origin, path.direction, t)
    if len(table.kind) > 1:
        found = found * light_tree.chance(table.tree, row, path.origin, path.facing)
    only = ops.where(path.density >= ONLY, ops.full_like(t, 1.0), 0.0)
    share = ops.where(path.density <= LIT * 8.0, 0.0, mis_weight(path.density, found, weighing, SURFACES_ALONE))
    share = ops.where(path.density >= ONLY, 1.0, share)
    return ops.where(table.weighed[row], share, only), ops.not_(table.both[row] | point.front)


_weighed_each = noinline_helper(_weighed)


@helper
def power(one: Lane, other: Lane) -> Lane:
    """The power heuristic's weight of the way whose density is `one`."""
    ratio = other / one
    return 1.0 / (1.0 + ratio * ratio)


@helper
def mis_weight(one: Lane, other: Lane, weighing: int, alone: int) -> Lane:
    """The weight of the way to light whose density is `one`; it counts in full where it is `alone`."""
    if weighing == 0:
        return power(one, other)
    if weighing == BALANCE:
        return 1.0 / (1.0 + other / one)
    return ops.full_like(one, 1.0 if weighing == alone else 0.0)


@helper
def _facing(light: Light, point: Surface, shader: Shader) -> Any:
    return light_tree.facing(light.emitters.tree.below, point.normal, bsdf.is_rough_glass(shader, ops.bool_like(point.offset, False)))


_sample_each, _choose = noinline_helper(emitters.sample), noinline_helper(light_tree.choose)


@helper
def sample_direct(
    tables: Tables, light: Light, point: Surface, shader: Shader, viewer: Vec, path: Path, here: Lane, last: Lane, lit: Lane,
    ending: bool, pixel: Lane, sample: Lane, depth: int, seed: int,
) -> Connection:  # fmt: skip
    """A ray to a sample of one emitter; where no ray goes on (`last`) that is the only way to find its light.

    Where bounces are `ending`, only lamps are left to be found, and where points are `lit` already, only what is none.
    """
    u, v = numbers(pixel, sample, depth, 0, seed)
    table = light.emitters
    zero = ops.full_like(point.offset, 0.0)
    frosted_ = bsdf.is_rough_glass(shader, ops.bool_like(zero, False))
    place = ops.where3(frosted_, point.position, interaction.shadow_origin(point))
    if len(table.kind) == 1:
        row = 0
        arriving = emitters.sample(tables, table, 0, place, u, v)
        chance = zero + 1.0
        is_lamp = table.light[0] >= 0
        here = (
            here & (ops.not_(ending) | is_lamp) & ops.not_(lit & is_lamp) & ops.not_(photon_covers_mirror(light.covered, 0, path, shader))
        )
        weighed, shadows = ops.bool_like(zero, table.weighed[0]), ops.bool_like(zero, table.shadows[0])
    else:
        row, chance = _choose(table.tree, place, _facing(light, point, shader), numbers(pixel, sample, depth, 2, seed)[0])
        arriving = _sample_each(tables, table, row, place, u, v)
        lamp = table.light[row] >= 0
        here = here & (chance > 0.0) & (ops.bool_like(zero, ops.not_(ending)) | lamp) & ops.not_(lit & lamp)
        here = here & ops.not_(photon_covers_mirror(light.covered, row, path, shader))
        chance = ops.where(chance > 0.0, chance, 1.0)
        weighed, shadows = table.weighed[row], table.shadows[row]
    share, density = bsdf.eval_bsdf_pdf(shader, light.uses, point.normal, arriving.direction, viewer)
    share, alone = left_to_paths(light.gleaming, light.covered, share, row, path, point, shader, viewer, arriving.direction)
    factor = 1.0 / (math.pi * chance)
    above = frosted_ | (ops.dot(arriving.direction, point.geometric) > 0.0)  # past its facet's edge no ray goes on by chance
    met_too = weighed & above & ops.not_(last | lit | alone)
    factor = factor * ops.where(met_too, mis_weight(arriving.density * chance, density, light.weighing, LIGHTS_ALONE), 1.0)
    given = ops.scale(ops.mul(ops.mul(path.weight, share), arriving.light), factor)
    given = medium_stack.faded(medium_stack.crossed(path.inside, None, tables, point, arriving.direction), given, tables, arriving.distance)
    origin = interaction.offset_shadow_origin(point, place, arriving.direction)
    wanted = here & (ops.largest(given) > 0.0)
    wanted = wanted & bsdf.is_rough_glass(shader, normal_map.mask_behind(tables, point, arriving.direction, wanted))
    # Things that shine block no light of their own: rays end before them by all roundings, and the shift at their beginning.
    short = 64.0 * ops.roundoff(zero) * ops.where(arriving.distance < math.inf, arriving.distance, 0.0) + 2.0 * point.offset
    reach = ops.maximum(arriving.distance - short / ops.maximum(arriving.cosine, SLANTED), 0.0)
    distance = ops.where(shadows, reach, -1.0)
    return Connection(origin, arriving.direction, distance, given, wanted)


@helper
def _drawn_part(tables: Tables, point: Surface, pixel: Lane, sample: Lane, depth: int, seed: int) -> Surface:
    return blend.choose_part(tables, point, numbers(pixel, sample, depth, 3, seed)[1])


_part = blend.if_blended(_drawn_part)


@helper
def shade_vertex(
    tables: Tables, light: Light, options: Options, path: Path, hit: Hit, point: Surface, here: Lane,
    pixel: Lane, sample: Lane, depth: int,
) -> tuple[Vec, Connection, Path, Lane]:  # fmt: skip
    """What happens at surfaces: (light sent along the path, ray to an emitter, ray that goes on, whether it does).

    `depth` counts surfaces from 0; at options.bounces light is looked for for the last time, and rays that go on beyond it only see
    what shines.
    """
    zero = 0.0 * path.density
    uses = light.uses
    faded = medium_stack.faded(path.inside, path.weight, tables, hit.t)
    path = Path(path.origin, path.direction, faded, path.density, path.straight, path.inside, path.phase, path.facing)
    point = normal_map.apply_maps(tables, _part(tables, point, pixel, sample, depth, options.seed), hit, path.direction)
    shader = bsdf.evaluate_shader_filtered(tables, point, uses, path.inside)
    viewer = ops.negate(path.direction)
    sent = (zero, zero, zero)
    if uses.shines:
        sent = emitted_radiance(tables, light, path, point, shader, hit, here, depth > options.bounces)
    nothing = ops.bool_like(zero, False)
    connection = Connection(point.position, path.direction, zero, sent, nothing)
    onward = path
    if depth > options.bounces:
        return sent, connection, onward, nothing
    lit, known = from_vertices(light.vertices, tables, point, hit, here)
    sent = ops.where3(lit, ops.add(sent, ops.mul(path.weight, known)), sent)
    if uses.ambient:
        always = ops.mul(ops.mul(path.weight, shader.ambient), lights.ambient(tables))
        sent = ops.where3(here & ops.not_(lit), ops.add(sent, always), sent)
    sent = photon_map.gathered(light.photons, sent, shader, uses, point, viewer, path.weight, here & (path.phase < photon_map.MATT), sample)
    ending = depth == options.bounces
    last = ops.bool_like(zero, False)
    if ending:  # matt surfaces are done when all light that they could meet has been looked for
        last = ops.bool_like(zero, ops.not_(uses.sky) & ops.not_(uses.glossy))
    if len(light.emitters.kind) > 0:
        connection = sample_direct(tables, light, point, shader, viewer, path, here, last, lit, ending, pixel, sample, depth, options.seed)
    u, v = numbers(pixel, sample, depth, 1, options.seed)
    which = zero
    if uses.glossy or uses.sharp:
        which = numbers(pixel, sample, depth, 2, options.seed)[1]
    taken = bsdf.sample_bsdf(shader, uses, point, viewer, u, v, which)
    weight = ops.mul(path.weight, taken.weight)
    if uses.open_sky:
        soft = here & ops.not_(lit) & (taken.density < ONLY)
        above = ops.mul(weight, lights.background(tables, taken.direction, lights.OPEN)[0])
        sent = ops.where3(soft, ops.add(sent, above), sent)
    going = here & ops.not_(last) & (ops.largest(weight) > 0.0)
    if ending:
        going = going & (taken.density < ONLY)
    if depth >= END_FROM:
        keep = ops.minimum(SPARED * ops.largest(weight), MOST_GOING)
        going = going & (numbers(pixel, sample, depth, 3, options.seed)[0] < keep)
        weight = ops.scale(weight, 1.0 / ops.maximum(keep, lights.TINY))
    straight = path.straight & taken.through
    density = ops.where(lit & (taken.density < ONLY), LIT, taken.density)
    after_matt = (path.density < ONLY) | (path.density > 2.0 * ONLY)
    density = ops.where((density >= ONLY) & after_matt, GATHERED, density)
    inside = medium_stack.crossed(path.inside, None, tables, point, taken.direction)
    thrown = photon_covers_lobe(light.gleaming, point, shader)
    phase = photon_map.phase_after(light.photons, path.phase, shader, taken.density >= ONLY, thrown)
    sunk = bsdf.is_rough_glass(shader, taken.density >= ONLY)
    place = ops.where3(sunk, point.position, interaction.shadow_origin(point))  # from where light was looked for: both ways see the same
    origin = interaction.offset_origin_at(point, place, taken.direction)
    onward = Path(origin, taken.direction, weight, density, straight, inside, phase, _facing(light, point, shader))
    return sent, connection, onward, going


def from_vertices(vertices: Any, tables: Tables, point: Surface, hit: Hit, here: Lane) -> tuple[Lane, Vec]:
    """(where light is computed at vertices, and what comes from there)."""
    if isinstance(vertices, NoVertices):
        return np.zeros_like(here), (0.0 * point.offset, 0.0 * point.offset, 0.0 * point.offset)
    return _from_vertices(vertices, tables, point, hit, here)


@helper
def _from_vertices(vertices: VertexLight, tables: Tables, point: Surface, hit: Hit, here: Lane) -> tuple[Lane, Vec]:
    zero = ops.full_like(point.offset, 0.0)
    lit = here & (tables.materials.shading[point.material] == GOURAUD) & (vertices.first[point.instance] >= 0)
    known = (zero, zero, zero)
    if ops.any_lane(lit):
        known = ops.where3(lit, whitted.from_vertices(tables, vertices, point, hit, lit), known)
    return lit, known


@overload(from_vertices, jit_options=HELPER)
def _from_vertices_in_kernels(vertices, tables, point, hit, here):
    if vertices.layout:
        return lambda vertices, tables, point, hit, here: _from_vertices(vertices, tables, point, hit, here)

    def nowhere(vertices, tables, point, hit, here):
        zero = ops.full_like(point.offset, 0.0)
        return ops.bool_like(zero, False), (zero, zero, zero)

    return nowhere


# --- the reference: all samples of a tile in numpy lanes -----------------------------------------------------------------


def radiance(
    tables: ir.Tables, accel: Any, light: Light, options: Options, ray: Ray, hit: Hit, pixel: Any, sample: Any
) -> tuple[Vec, Any, Any]:
    """(radiance, coverage, sound) of camera rays that meet `hit`; what is not finite is left out and not `sound`."""
    shape = np.shape(hit.t)
    zero = np.zeros(shape)
    total: Vec = (zero, zero, zero)
    alpha = zero + 1.0
    active = np.ones(shape, bool)
    origin, direction = (tuple(np.broadcast_to(c, shape) for c in v) for v in (ray.origin, ray.direction))
    path = Path(origin, direction, (zero + 1.0, zero + 1.0, zero + 1.0), zero + ONLY, active, medium_stack.outside(tables, zero), zero)  # pyright: ignore[reportArgumentType]
    path = path._replace(facing=light_tree.facing(light.emitters.tree.below, path.direction, active))
    depth = 0
    while True:
        onward = Ray(path.origin, path.direction, zero, zero + np.inf, ray.time)
        if options.layers:
            bit = OTHER_RAY if depth else CAMERA_RAY
            hit = _beyond(accel, tables, options, onward if depth else ray, hit, active, bit, pixel, sample, depth)
        missed = active & (hit.instance < 0)
        if missed.any():
            behind, less = environment_radiance(tables, light, options, path, missed, depth)
            total, alpha = ops.add(total, behind), alpha - less
        here = active & (hit.instance >= 0)
        if depth > options.bounces + 1 or not here.any():
            break
        point = interaction.make_interaction(tables, onward, hit)
        sent, connection, path, active = shade_vertex(tables, light, options, path, hit, point, here, pixel, sample, depth)
        total = ops.add(total, sent)
        if connection.wanted.any():
            blocking = connection.wanted & (connection.distance > 0.0) & options.shadows
            shadow = Ray(connection.origin, connection.direction, zero, zero + connection.distance, ray.time)
            given = ops.scale(connection.light, intersect.transmittance(accel, tables, shadow, blocking))
            total = ops.where3(connection.wanted, ops.add(total, given), total)
        if not active.any():
            break
        hit = intersect.closest_hit(accel, tables, Ray(path.origin, path.direction, zero, zero + np.inf, ray.time), active, OTHER_RAY)
        depth += 1
    sound = np.isfinite(total[0] + total[1] + total[2])
    return ops.where3(sound, total, (zero, zero, zero)), alpha, sound


def _beyond(
    accel: Any, tables: ir.Tables, options: Options, ray: Ray, hit: Hit, active: Any, visible: int, pixel: Any, sample: Any, depth: int
) -> Hit:  # fmt: skip
    """What rays meet beyond that which chance lets them pass."""
    partial = scene_facts.partial(tables)[tables.instances.material]
    passed, layer = active, 0
    while True:
        asked = passed & (hit.instance >= 0) & partial[np.maximum(hit.instance, 0)]
        there = surface_alpha.opacity_at(tables, interaction.make_interaction(tables, ray, hit))
        passed = asked & (passing(pixel, sample, depth, layer, options.seed) >= there)
        if not passed.any():
            return hit
        again = intersect.closest_hit(accel, tables, ray._replace(t_min=intersect.next_t_min(tables, ray, hit)), passed, visible)
        hit = Hit(*(np.where(passed, new, old) for new, old in zip(again, hit, strict=True)))
        layer += 1
