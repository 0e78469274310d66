"""From a first hit to radiance: emission, ambient and direct light, and the rays that mirrors, glass and matt surfaces send on.

Whitted's tree (Whitted 1980) with, when asked, a cosine-sampled ray from matt surfaces: rays wait on a stack, each with the weight
its radiance will be given. One source for numpy lanes and for kernels; all lanes walk the same tree, each with its own mask.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from ...compiler import ir
from ..accel import intersect  # fmt: skip
from ..accel.formula_packets import shadow_rays
from ..accel.traverse import motion_alpha
from ..geometry import instance_transform
from ..jit.function_pointer import KernelPointer
from ..jit.kernel import HELPER, helper, specialize_either, specialize_if_present
from ..jit.packed_struct import Handle
from ..lanes import crosslane, ops
from ..lanes.kinds import FLOAT, INT, VEC
from ..light import lights, shadow_map
from ..material import bsdf, medium_stack, microfacet
from ..material.bsdf import Shader
from ..sampling import sobol
from ..surface import alpha as surface_alpha
from ..surface import blend, interaction, normal_map, texture_footprint
from ..types import Hit, Lane, Options, Ray, Surface, Tables, Vec, VertexLight
from . import glossy_lights

CAMERA_RAY = int(ir.Visibility.CAMERA)
OTHER_RAY = int(ir.Visibility.REFLECTION)
GOURAUD = int(ir.Shading.GOURAUD)
FIELDS = 15  # of a waiting ray: origin, direction, weight, bounces left, kind, key of its random numbers, media that it is in, and
CONE = 13  # how wide it is, and wider a metre on
DIFFUSE_RAY = 0.0  # kinds of waiting rays: after a matt surface lights are not counted again where they are met
SPECULAR_RAY = 1.0
STRAIGHT_RAY = 2.0  # has met nothing but passages of index 1: still the camera's own ray, which lowers alpha where it escapes
BRANCHES = 3  # rays a surface sends on at the most: reflected, refracted, diffuse
MIN_WEIGHT = 1e-4  # rays that could add less than this share are not followed: the error stays below it for each ray cut
BESIDE = 4096.0  # roundings of a place before which rays to lamps end: at lamps that are met more steeply than at 1/4096 none is left
_KEYS = 0x7FFFFFFF
_BLEND = 4094  # of a surface's random dimensions, that which chooses among the parts of a blend
_LIGHTS = 2048  # a surface's random dimensions: two a light, before them one for its diffuse ray


def stack_for(options: Options, count: int = 1) -> NDArray[np.float64]:
    """(rays, FIELDS, count) room for the rays that wait in each of `count` lanes."""
    return np.zeros((_room(options.bounces) + BRANCHES * options.layers, FIELDS, count))


@helper
def _room(bounces: Lane) -> Lane:
    """How many rays wait at the most where one has so many bounces left."""
    return (BRANCHES - 1) * (bounces + 1) + 1


@helper
def _drawn_part(tables: Tables, point: Surface, pixel: Lane, sample: Lane, key: Lane, seed: int) -> Surface:
    return blend.choose_part(tables, point, sobol.pair(pixel, sample, key * _LIGHTS * 2 + _BLEND, seed)[0])


_part = blend.if_blended(_drawn_part)


def radiance(
    tables: Tables,
    accel: Any,
    gouraud: VertexLight,
    options: Options,
    ray: Ray,
    hit: Hit,
    pixel: Lane,
    sample: Lane,
    stack: Any,
    known: Any = None,
) -> tuple[Vec, Lane, Lane]:
    """(radiance, coverage, sound) of a camera ray that meets `hit`, where this much is `known` of lamps (hidden.py); what is not finite
    is left out and not `sound`.

    Coverage is less than 1 where something lets the ray straight through (by its opacity, or with an index of refraction of 1) to nothing.
    """
    zero = ops.full_like(hit.t, 0.0)
    seen = hit.instance >= 0
    alpha = ops.where(seen, zero + 1.0, zero)
    total = ops.where3(seen, (zero, zero, zero), camera_background(tables, options, ray.direction))
    weight = (zero + 1.0, zero + 1.0, zero + 1.0)
    left = ops.int_like(hit.t, options.bounces)
    kind = zero + STRAIGHT_RAY
    key = ops.int_like(hit.t, 1)
    waiting = ops.int_like(hit.t, 0)  # rays on each lane's stack
    inside = medium_stack.outside(tables, hit.t)
    cone = texture_footprint.cone_of_eye(tables, ray)
    while True:
        weight = medium_stack.faded(inside, weight, tables, ops.where(seen, hit.t, 0.0))
        rest = seen
        while ops.any_lane(rest):
            instance, here = crosslane.uniform_group(hit.instance, rest)
            meeting = Hit(hit.t, instance, hit.primitive, hit.u, hit.v)
            point = texture_footprint.on_surface(tables, ray, meeting, interaction.make_interaction(tables, ray, meeting), cone)
            point = _part(tables, point, pixel, sample, key, options.seed)
            point = interaction.override_interaction(known, normal_map.apply_maps(tables, point, meeting, ray.direction))
            shader = bsdf.evaluate_shader_inside(tables, point, inside)
            viewer = ops.negate(ray.direction)
            specular = kind >= SPECULAR_RAY
            light = local_light(tables, accel, gouraud, options, point, shader, viewer, meeting, here, specular, inside, pixel, sample, key)
            there = shown(accel, tables, options, point, left, pixel, sample, key, stack, waiting)
            share = ops.scale(weight, there)
            going = here & (left > 0)
            if ops.any_lane(going):
                waiting = spawn_secondary_rays(
                    tables, options, point, shader, ray.direction, share, going, left, kind, inside, pixel, sample, key, stack, waiting
                )  # fmt: skip
            light = _around_in(options.environment, light, tables, options, point, shader, ray.direction)
            total = ops.where3(here, ops.add(total, ops.mul(share, light)), total)
            waiting = continue_through(waiting, accel, point, ray.direction, weight, there, here, left, kind, inside, key, stack)
            rest = rest & ops.not_(here)
        active = waiting > 0
        if ops.not_(ops.any_lane(active)):
            break
        waiting = ops.where(active, waiting - 1, waiting)
        inside, cone = inside_of(inside, None, stack, waiting), texture_footprint.take_cone(cone, None, stack, waiting, CONE)
        ray, weight, left, kind, key = _pop(stack, waiting, ray.time)
        hit, known = intersect.closest_hit(accel, tables, ray, active, OTHER_RAY), shadow_rays.forget_hidden(known)
        seen = active & (hit.instance >= 0)
        missed = active & ops.not_(hit.instance >= 0) & (kind >= SPECULAR_RAY)
        if ops.any_lane(missed):
            behind = reflected_background(tables, options, ray.direction)
            straight = missed & (kind == STRAIGHT_RAY)
            if ops.any_lane(straight):
                behind = ops.where3(straight, camera_background(tables, options, ray.direction), behind)
                alpha = ops.where(straight, alpha - (weight[0] + weight[1] + weight[2]) / 3.0, alpha)
            total = ops.where3(missed, ops.add(total, ops.mul(weight, behind)), total)
    sound = ops.is_finite(total[0] + total[1] + total[2])
    return ops.where3(sound, total, (zero, zero, zero)), ops.clip(alpha, 0.0, 1.0), sound


def _radiance(tables, accel, gouraud, options, origin, direction, t, instance, primitive, u, v, pixel, sample, stack, time, known):
    ray = Ray(origin, direction, 0.0 * t, 0.0 * t + np.inf, time)
    return _walk(tables, accel, gouraud, options, ray, Hit(t, instance, primitive, u, v), pixel, sample, stack, known)


_walk = helper(radiance)
linked = KernelPointer(_radiance)  # one compiled body for all backends, kept on disk by itself
call = linked.call


def link(frame: Handle, tables: Handle, accel: Handle, gouraud: Handle, told: bool = False) -> None:
    """Compile or load `radiance` for what a picture is drawn from, and tell its frame where it is; `told` as hidden.py tells."""
    frame.put("radiance", linked.link(*kinds(frame, tables, accel, gouraud, told)))


def kinds(frame: Handle, tables: Handle, accel: Handle, gouraud: Handle, told: bool) -> tuple[types.Type, ...]:
    """Numba's types of what `radiance` is then called with."""
    stack = types.Array(types.float64, 3, "C")
    packed = tables.numba_type, accel.numba_type, gouraud.numba_type, frame.part("options")
    time, known = FLOAT if instance_transform.is_open(frame.part("shutter")) else types.none, INT if told else types.none
    return (*packed, VEC, VEC, FLOAT, INT, INT, FLOAT, FLOAT, INT, INT, stack, time, known)


# --- where rays leave the scene -----------------------------------------------------------------------------------------


@helper
def camera_background(tables: Tables, options: Options, direction: Vec) -> Vec:
    """What the camera sees where nothing is."""
    zero = 0.0 * direction[0]
    if options.background == 0:
        return lights.background(tables, direction)[0]
    if options.background == 1:
        return (zero, zero, zero)
    return (zero + options.color.x, zero + options.color.y, zero + options.color.z)


def is_black(tables: Tables, options: Options) -> bool:
    """Whether the camera sees no light where nothing is."""
    skies = bool(((tables.lights.kind == lights.SKY) | (tables.lights.kind == lights.DOME)).any())
    return not (skies if options.background == 0 else options.background == 2 and any(options.color))


@helper
def reflected_background(tables: Tables, options: Options, direction: Vec) -> Vec:
    """What mirrors and glass show where nothing is: the sky, or the background's colour in a scene without one."""
    zero = 0.0 * direction[0]
    sky, there = lights.background(tables, direction)
    if there or options.background != 2:
        return sky
    return (zero + options.color.x, zero + options.color.y, zero + options.color.z)


# --- what stands for rays that are not followed ---------------------------------------------------------------------------


@helper
def _shown_around(around: Any, tables: Tables, options: Options, direction: Vec) -> Vec:
    """The light that comes from a direction in which nothing is looked for."""
    zero = 0.0 * direction[0]
    below = ops.dot(direction, ops.like3(zero, around.up.x, around.up.y, around.up.z)) < 0.0
    ground = ops.like3(zero, around.ground.x, around.ground.y, around.ground.z)
    return ops.where3(below, ground, reflected_background(tables, options, direction))


@helper
def _in_mirrors(around: Any, light: Vec, tables: Tables, options: Options, point: Surface, shader: Shader, direction: Vec) -> Vec:
    """More light: what mirrors and clear glass show, in the mirrored direction and straight behind."""
    reflection, transmission, _, _ = bsdf.fresnel_split(point, shader, direction)
    mirrored = _shown_around(around, tables, options, ops.reflect(direction, point.normal))
    behind = _shown_around(around, tables, options, direction)
    return ops.add(light, ops.add(ops.mul(reflection, mirrored), ops.mul(transmission, behind)))


@helper
def _on_highlights(
    around: Any, light: Vec, tables: Tables, options: Options, point: Surface, shader: Shader, active: Lane, direction: Vec, share: Vec
) -> Vec:  # fmt: skip
    """More light: what metals, polish and rough glass show in a direction of their highlight."""
    open_ = active & bsdf.is_rough_glass(shader, ops.dot(direction, point.geometric) > 0.0)
    return ops.where3(open_, ops.add(light, ops.mul(share, _shown_around(around, tables, options, direction))), light)


@helper
def _but_glossy(around: Any, active: Lane, shader: Shader) -> Lane:
    return active & ops.not_(bsdf.is_glossy(shader))


_around_in = specialize_if_present(_in_mirrors)
_around_on = specialize_if_present(_on_highlights)
_lit_by_skies = specialize_if_present(_but_glossy)  # whose highlights look for skies: those of others have what is around them already


# --- light at a point ---------------------------------------------------------------------------------------------------


@helper
def local_light(
    tables: Tables, accel: Any, gouraud: VertexLight, options: Options, point: Surface, shader: Shader, viewer: Vec, hit: Hit,
    active: Lane, specular: Lane, inside: Any, pixel: Lane, sample: Lane, key: Lane,
) -> Vec:  # fmt: skip
    """What a point sends to the viewer by itself: emission, ambient and direct light, or light computed at vertices.

    Area lights are left out where a diffuse ray meets them: there they have been sampled already.
    """
    zero = ops.full_like(hit.t, 0.0)
    light = tables.instances.light[point.instance]
    shines = ops.bool_like(zero, True)
    if ops.any_lane(light >= 0):
        both_sides = tables.lights.kind[ops.maximum(light, 0)] == lights.SPHERE  # as it is sampled from inside, too
        shines = ops.where(light >= 0, (point.front | both_sides) & specular, shines)
    total = ops.where3(shines, shader.emission, (zero, zero, zero))
    at_vertices = (tables.materials.shading[point.material] == GOURAUD) & (gouraud.first[point.instance] >= 0)
    if ops.any_lane(active & at_vertices):
        there = active & at_vertices
        total = ops.where3(there, ops.add(total, from_vertices(tables, gouraud, point, hit, there)), total)
    here = active & ops.not_(at_vertices)
    if ops.any_lane(here):
        lit = direct_light(tables, accel, options, point, shader, viewer, here, inside, pixel, sample, key)
        total = ops.where3(here, ops.add(total, lit), total)
    return total


@helper
def direct_light(
    tables: Tables, accel: Any, options: Options, point: Surface, shader: Shader, viewer: Vec,
    active: Lane, inside: Any, pixel: Lane, sample: Lane, key: Lane,
) -> Vec:  # fmt: skip
    """k_a L_a and the light of every lamp that nothing blocks; of lamps less what the media that a ray is `inside` of take on the way."""
    total = ops.mul(shader.ambient, lights.ambient(tables))
    active = active & bsdf.is_lit(shader)
    middle = ops.full_like(point.offset, 0.5)
    horizon = ops.like3(point.offset, options.horizon.x, options.horizon.y, options.horizon.z)
    above_ground = (point.instance != options.ground) & (options.ground >= 0)
    for light in range(len(tables.lights.kind)):
        kind = tables.lights.kind[light]
        if kind == lights.AMBIENT:
            continue
        dimension = (key * _LIGHTS + light) * 2 + 2
        u, v = middle, middle
        if lights.is_soft(tables, light):
            u, v = sobol.pair(pixel, sample, dimension, options.seed)
        if kind in (lights.SKY, lights.DOME):
            bounded = above_ground & tables.lights.shadows[light]
            direction, share = lights.cosine_sample_above(point.normal, horizon, bounded, u, v)
            matt = microfacet.matt_share(shader.lobes, shader.diffuse, point.normal, direction, viewer)
            given = ops.scale(ops.mul(matt, lights.sky_radiance(tables, light, direction)), share)
            open_ = _sees(tables, point, shader, direction, active)
            place = _beside(point, direction)
            total = ops.add(total, _unblocked(tables, accel, options, point, place, light, direction, lights.FAR, given, open_))
            shiny = _lit_by_skies(options.environment, active & bsdf.is_shiny(shader), shader)
            if ops.any_lane(shiny):
                u, v = sobol.pair(pixel, sample, dimension + 1, options.seed)
                which = lobe_sample(shader, pixel, sample, key, options.seed)
                direction, share = bsdf.sample_lobe(shader, point.normal, viewer, u, v, which)
                given = ops.mul(share, lights.sky_radiance(tables, light, direction))
                open_ = _sees(tables, point, shader, direction, shiny)
                place = _beside(point, direction)
                total = ops.add(total, _unblocked(tables, accel, options, point, place, light, direction, lights.FAR, given, open_))
        else:
            place = _lit_place(tables, options, point, shader, light)
            arriving = lights.sample(tables, light, place, u, v)
            share = glossy_lights.reflected(options.lamps, shader, tables, light, point.normal, arriving, viewer, active)
            given = ops.scale(ops.mul(share, arriving.irradiance), 1.0 / np.pi)
            given = medium_stack.faded(
                medium_stack.crossed(inside, None, tables, point, arriving.direction), given, tables, arriving.distance
            )
            open_ = _sees(tables, point, shader, arriving.direction, active)
            found = _unblocked(tables, accel, options, point, place, light, arriving.direction, arriving.distance, given, open_)
            total = ops.add(total, found)
    if bsdf.has_facets(shader):
        total = _along_highlights(total, tables, accel, options, point, shader, viewer, active, inside, pixel, sample, key)
    return total


@helper
def _along_highlights(
    total: Vec, tables: Tables, accel: Any, options: Options, point: Surface, shader: Shader, viewer: Vec, active: Lane, inside: Any,
    pixel: Lane, sample: Lane, key: Lane,
) -> Vec:  # fmt: skip
    """More light: that from a direction drawn as a narrow highlight spreads, of lamps and of what stands for rays that are not followed."""
    glossy = active & bsdf.is_glossy(shader)
    if ops.any_lane(glossy):
        u, v = sobol.pair(pixel, sample, key * _LIGHTS * 2 + 1, options.seed)
        direction, share = bsdf.sample_lobe(shader, point.normal, viewer, u, v, lobe_sample(shader, pixel, sample, key, options.seed))
        total = _lamps_on(options.lamps, total, tables, accel, options, point, shader, viewer, glossy, inside, direction, share)
        total = _around_on(options.environment, total, tables, options, point, shader, glossy, direction, share)
    return total


@helper
def _lamps_met(
    lamps: Any, total: Vec, tables: Tables, accel: Any, options: Options, point: Surface, shader: Shader, viewer: Vec,
    active: Lane, inside: Any, direction: Vec, share: Vec,
) -> Vec:  # fmt: skip
    """More light: that of lamps in a direction of a highlight, as far as it is not left to samples of them."""
    _, _, density = bsdf.eval_lobes_pdf(shader, point.normal, direction, viewer)
    open_ = _sees(tables, point, shader, direction, active)
    for k in range(len(lamps.rows)):
        light = lamps.rows[k]
        place = _lit_place(tables, options, point, shader, light)
        distance, solid, bright = glossy_lights.intersect_lights(tables, light, place, direction)
        color = (tables.lights.color[light, 0], tables.lights.color[light, 1], tables.lights.color[light, 2])
        given = ops.mul(ops.scale(share, bright * glossy_lights.weight(density, solid)), color)
        given = medium_stack.faded(medium_stack.crossed(inside, None, tables, point, direction), given, tables, distance)
        total = ops.add(total, _unblocked(tables, accel, options, point, place, light, direction, distance, given, open_))
    return total


_lamps_on = specialize_if_present(_lamps_met)


@helper
def _lit_place(tables: Tables, options: Options, point: Surface, shader: Shader, light: int) -> Vec:
    """Where a lamp is looked for from: what nothing blocks is not looked for from elsewhere, nor through rough glass."""
    blocked = options.shadows and tables.lights.shadows[light]
    here = bsdf.is_rough_glass(shader, ops.bool_like(point.offset, not blocked))
    return ops.where3(here, point.position, interaction.shadow_origin(point))


@helper
def _sees(tables: Tables, point: Surface, shader: Shader, direction: Vec, active: Lane) -> Lane:
    """Where light may come from a direction: not from behind, but through rough glass."""
    return active & bsdf.is_rough_glass(shader, normal_map.mask_behind(tables, point, direction, active))


@helper
def lobe_sample(shader: Shader, pixel: Lane, sample: Lane, key: Lane, seed: int) -> Lane:
    """A number that chooses among the parts of facets; where there are none, nobody asks."""
    if bsdf.has_facets(shader):
        return sobol.pair(pixel, sample, key * _LIGHTS * 2, seed)[1]
    return ops.full_like(shader.ior, 0.0)


@helper
def _beside(point: Surface, direction: Vec) -> Vec:
    """From where light of a direction is looked for, on either side of a surface."""
    return ops.where3(ops.dot(direction, point.normal) > 0.0, interaction.shadow_origin(point), point.position)


@helper
def _unblocked(
    tables: Tables, accel: Any, options: Options, point: Surface, place: Vec, light: int, direction: Vec, distance: Lane, given: Vec,
    active: Lane,
) -> Vec:  # fmt: skip
    """What a light gives, looked for from a `place`, where nothing that casts shadows stands before it; 0 elsewhere."""
    zero = ops.full_like(point.offset, 0.0)
    open_ = active & (ops.largest(given) > 0.0)
    if options.shadows and tables.lights.shadows[light] and ops.any_lane(open_):
        return _past_shadows(options.maps, tables, accel, point, place, light, direction, zero + distance, given, open_)
    return ops.where3(open_, given, (zero, zero, zero))


@helper
def _past_rays(
    tables: Tables, accel: Any, point: Surface, place: Vec, light: int, direction: Vec, distance: Lane, given: Vec, open_: Lane
) -> Vec:  # fmt: skip
    reach = ops.maximum(distance - BESIDE * point.offset, 0.0)  # a lamp's own shape does not block its light
    ray = Ray(interaction.offset_shadow_origin(point, place, direction), direction, 0.0 * point.offset, reach, point.time)
    return shadow_rays.attenuate_light(point, accel, tables, light, ray, open_, given)


@helper
def _past_maps(
    maps: Any, tables: Tables, accel: Any, point: Surface, place: Vec, light: int, direction: Vec, distance: Lane, given: Vec,
    open_: Lane,
) -> Vec:  # fmt: skip
    if maps.first[light] < 0:
        return _past_rays(tables, accel, point, place, light, direction, distance, given, open_)
    zero = 0.0 * point.offset
    return ops.where3(open_, ops.scale(given, shadow_map.lit(maps, tables, light, point)), (zero, zero, zero))


_past_shadows = specialize_either(_past_maps, _past_rays)


@helper
def from_vertices(tables: Tables, gouraud: VertexLight, point: Surface, hit: Hit, here: Lane) -> Vec:
    """What was computed at the vertices of the triangles that rays met, in between them."""
    g = tables.instances.geometry[point.instance]
    triangle = ops.where(here, hit.primitive, 0)
    triangles, color = tables.pools.triangles, gouraud.color
    base = gouraud.first[point.instance] - tables.geometries.first_vertex[g] + ops.where(point.front, 0, len(color) // 2)
    base = ops.where(here, base, 0)
    a = base + ops.where(here, triangles[triangle, 0], 0)
    b = base + ops.where(here, triangles[triangle, 1], 0)
    c = base + ops.where(here, triangles[triangle, 2], 0)
    w = 1.0 - hit.u - hit.v
    return (
        w * color[a, 0] + hit.u * color[b, 0] + hit.v * color[c, 0],
        w * color[a, 1] + hit.u * color[b, 1] + hit.v * color[c, 1],
        w * color[a, 2] + hit.u * color[b, 2] + hit.v * color[c, 2],
    )


@helper
def leaving(point: Surface, direction: Vec, distance: Lane) -> Ray:
    """A ray from a surface that does not meet the place it leaves."""
    side = ops.sign_of(ops.dot(direction, point.geometric))
    origin = ops.along(point.position, point.geometric, side * point.offset)
    return Ray(origin, direction, 0.0 * point.offset, distance, point.time)


# --- rays that go on ----------------------------------------------------------------------------------------------------


@helper
def spawn_secondary_rays(
    tables: Tables, options: Options, point: Surface, shader: Shader, direction: Vec, weight: Vec, going: Lane, left: Lane,
    kind: Lane, inside: Any, pixel: Lane, sample: Lane, key: Lane, stack: Any, waiting: Lane,
) -> Lane:  # fmt: skip
    """Put the rays a surface sends on upon the lanes' stacks; how many wait on each."""
    reflection, transmission, refracted, _ = bsdf.fresnel_split(point, shader, direction)
    plain = ops.full_like(point.offset, 0.0)
    through = ops.where((kind == STRAIGHT_RAY) & (shader.ior == 1.0), STRAIGHT_RAY, plain + SPECULAR_RAY)
    mirrored = ops.reflect(direction, point.normal)
    outside = ops.dot(mirrored, point.geometric) > 0.0  # an interpolated normal may mirror a grazing ray into the surface
    mirrored = ops.where3(outside, mirrored, ops.reflect(direction, point.geometric))
    waiting = _push(stack, waiting, point, mirrored, ops.mul(weight, reflection), going, left, plain + SPECULAR_RAY, inside, key, 0)
    beyond = medium_stack.crossed(inside, None, tables, point, refracted)
    waiting = _push(stack, waiting, point, refracted, ops.mul(weight, transmission), going, left, through, beyond, key, 1)
    if options.interreflection or bsdf.has_facets(shader):
        u, v = sobol.pair(pixel, sample, key * _LIGHTS * 2 + 1, options.seed)
        which = sobol.pair(pixel, sample, key * _LIGHTS * 2, options.seed)[1]
        onward, share = bsdf.sample_glossy_or_diffuse(shader, point.normal, ops.negate(direction), u, v, which, options.interreflection)
        above = going & bsdf.is_rough_glass(shader, ops.dot(onward, point.geometric) > 0.0)
        beyond = medium_stack.crossed(inside, None, tables, point, onward)
        waiting = _push(stack, waiting, point, onward, ops.mul(weight, share), above, left, plain + DIFFUSE_RAY, beyond, key, 2)
    return waiting


@helper
def _shown(
    accel: Any, tables: Tables, options: Options, point: Surface, left: Lane, pixel: Lane, sample: Lane, key: Lane, stack: Any,
    waiting: Lane,
) -> Lane:  # fmt: skip
    """How much of a surface a ray meets, 0 to 1: its opacity, or, where rays that pass have no room to wait, 0 or 1 by that chance."""
    there = surface_alpha.opacity_at(tables, point)
    room = waiting + ops.where(left > 0, BRANCHES, 0) + _room(left - 1) <= stack.shape[0]
    by_chance = sobol.pair(pixel, sample, key * _LIGHTS * 2, options.seed)[0] < there
    return ops.where(room, there, ops.where(by_chance, 1.0, 0.0))


@helper
def _pass_on(
    waiting: Lane, accel: Any, point: Surface, direction: Vec, weight: Vec, there: Lane, here: Lane, left: Lane, kind: Lane, inside: Any,
    key: Lane, stack: Any,
) -> Lane:  # fmt: skip
    """Put the ray that passes a surface which is not wholly `there` on top of the stack, as what it was; how many wait."""
    passing = here & (there < 1.0)
    return _push(stack, waiting, point, direction, ops.scale(weight, 1.0 - there), passing, left + 1, kind, inside, key, BRANCHES)


def shown(accel: Any, *of: Any) -> Lane:
    """`_shown`, which kernels leave out where everything is wholly there."""
    return _shown(accel, *of)


@overload(shown, jit_options=HELPER)
def _shown_in_kernels(accel, *of):
    return (lambda accel, *of: _shown(accel, *of)) if motion_alpha.has_opacity(accel) else lambda accel, *of: 1.0


def continue_through(waiting: Lane, accel: Any, *of: Any) -> Lane:
    """`_pass_on`, which kernels leave out where everything is wholly there."""
    return _pass_on(waiting, accel, *of)


@overload(continue_through, jit_options=HELPER)
def _pass_on_in_kernels(waiting, accel, *of):
    if motion_alpha.has_opacity(accel):
        return lambda waiting, accel, *of: _pass_on(waiting, accel, *of)
    return lambda waiting, accel, *of: waiting


@helper
def _push(
    stack: Any,
    waiting: Lane,
    point: Surface,
    direction: Vec,
    weight: Vec,
    going: Lane,
    left: Lane,
    kind: Lane,
    inside: Any,
    key: Lane,
    branch: int,
) -> Lane:
    active = going & (ops.largest(weight) > MIN_WEIGHT)
    if ops.any_lane(active):
        origin = leaving(point, direction, point.offset).origin
        crosslane.put3(stack, waiting, 0, origin, active)
        crosslane.put3(stack, waiting, 3, direction, active)
        crosslane.put3(stack, waiting, 6, weight, active)
        crosslane.stack_store(stack, waiting, 9, ops.to_float(left - 1), active)
        crosslane.stack_store(stack, waiting, 10, kind, active)
        crosslane.stack_store(stack, waiting, 11, ops.to_float((key * BRANCHES + 1 + branch) & _KEYS), active)
        keep_inside(inside, None, stack, waiting, active)
        texture_footprint.put_cone(point, direction, stack, waiting, CONE, active)
    return ops.where(active, waiting + 1, waiting)


@helper
def _pop(stack: Any, place: Lane, time: Any) -> tuple[Ray, Vec, Lane, Lane, Lane]:
    origin, direction, weight = crosslane.take3(stack, place, 0), crosslane.take3(stack, place, 3), crosslane.take3(stack, place, 6)
    zero = 0.0 * origin[0]
    ray = Ray(origin, direction, zero, zero + np.inf, time)
    left, key = ops.to_int(crosslane.stack_load(stack, place, 9)), ops.to_int(crosslane.stack_load(stack, place, 11))
    return ray, weight, left, crosslane.stack_load(stack, place, 10), key


@helper
def _taken(inside: Lane, plain: Any, stack: Any, place: Lane) -> Lane:
    return ops.to_int(crosslane.stack_load(stack, place, 12))


@helper
def _kept(inside: Lane, plain: Any, stack: Any, place: Lane, active: Lane) -> None:
    crosslane.stack_store(stack, place, 12, ops.to_float(inside), active)


inside_of = specialize_if_present(_taken)  # the media that a waiting ray is in: stack, place
keep_inside = specialize_if_present(_kept)
