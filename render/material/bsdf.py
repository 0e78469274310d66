"""Materials: what a surface does with light, as the course's equations, with energy-conserving lobes beside them.

With I = E⊥/π of a light (E⊥: irradiance facing it), L = I · (k_d max(0, N·L) + k_s lobe), lobe = max(0, R·V)ⁿ (Phong) or
max(0, N·H)ⁿ (Blinn-Phong), both only on the side the light is on. `normalized` lobes are made a reflectance: times N·L and
(n + 2)/2 (Phong; Lafortune and Willems 1994) or (n + 2)(n + 4) / (8 (2^(-n/2) + n)) (Blinn-Phong; Giesen 2009), so that at normal
incidence they reflect k_s of the light and nowhere more. Microfacets stand in microfacet.py; here is what asks them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import types
from numba.extending import overload

from ...compiler import ir
from ...compiler.plan import caustic_casters
from ..jit.kernel import HELPER, helper, specialize_if_present
from ..lanes import fast_power, ops
from ..light import lights
from ..surface.material_inputs import color_of
from ..types import Lane, Surface, Tables, Vec
from . import medium_stack, microfacet, principled, rough_dielectric

AMBIENT = int(ir.Slot.AMBIENT)
DIFFUSE = int(ir.Slot.DIFFUSE)
SPECULAR = int(ir.Slot.SPECULAR)
SHININESS = int(ir.Slot.SHININESS)
REFLECTION = int(ir.Slot.REFLECTION)
TRANSMISSION = int(ir.Slot.TRANSMISSION)
IOR = int(ir.Slot.IOR)
EMISSION = int(ir.Slot.EMISSION)
PHONG = int(ir.MaterialModel.PHONG)
BLINN_PHONG = int(ir.MaterialModel.BLINN_PHONG)
GLASS = int(ir.MaterialModel.GLASS)
POLISHED = 0.3  # α up to which what a metal mirrors is a spot of light on what stands beside it
BRIGHT, PEAK, FAINT_PEAK = caustic_casters.BRIGHT, caustic_casters.PEAK, caustic_casters.FAINT_PEAK
ONLY = 1e18  # density of a direction that is the only one: mirrors', glass's and the camera's


class Uses(NamedTuple):
    """What a scene's materials and lights hold."""

    glossy: bool  # some material has a highlight
    sharp: bool  # some material mirrors, refracts or lets through
    shines: bool  # some material shines
    ambient: bool
    sky: bool  # that casts shadows
    open_sky: bool = False  # that casts none


class Shader(NamedTuple):
    """A material's numbers at one point, textures looked up."""

    ambient: Vec
    diffuse: Vec
    specular: Vec
    shininess: Lane
    reflection: Vec
    transmission: Vec
    ior: Lane
    emission: Vec
    blinn: Lane  # bool: lobe of the half vector
    normalized: Lane  # bool
    strength: Lane  # what makes its lobe a reflectance, but for N·L: see lobe_scale; 1 where it is not normalized
    glass: Lane  # bool: reflection and transmission by Fresnel's law
    lobes: Any  # microfacet.Lobes in scenes with such materials (in whose lanes the course's are then 0), else None
    frost: Any  # frosted.Frost in scenes with rough glass, else None


@helper
def evaluate_shader(tables: Tables, surface: Surface) -> Shader:
    """The material of a surface where it is, in the open."""
    return evaluate_shader_inside(tables, surface, None)


@helper
def evaluate_shader_inside(tables: Tables, surface: Surface, inside: Any) -> Shader:
    """The same for a ray that is inside of things: see media.py."""
    return evaluate_shader_filtered(tables, surface, Uses(True, True, True, lights.has_ambient(tables), True), inside)


@helper
def evaluate_shader_filtered(tables: Tables, surface: Surface, uses: Uses, inside: Any) -> Shader:
    """The same for a scene that holds no more than `uses` says: what it does not is not looked up, and 0."""
    zero = ops.full_like(surface.offset, 0.0)
    no = ops.bool_like(zero, False)
    black = (zero, zero, zero)
    ambient, specular, shininess, blinn, normalized, strength = black, black, zero, no, no, zero + 1.0
    reflection, transmission, ior, glass, emission = black, black, zero + 1.0, no, black
    if uses.ambient:
        ambient = ops.mul(color_of(tables, surface, AMBIENT), surface.color)
    if uses.glossy:
        specular = color_of(tables, surface, SPECULAR)
        shininess = shininess + color_of(tables, surface, SHININESS)[0]
        blinn = no | (tables.materials.model[surface.material] == BLINN_PHONG)
        normalized = no | tables.materials.normalized[surface.material]
        if ops.any_lane(normalized):
            strength = ops.where(normalized, lobe_scale(blinn, shininess), strength)
    if uses.sharp:
        reflection = color_of(tables, surface, REFLECTION)
        transmission = color_of(tables, surface, TRANSMISSION)
        ior = zero + ops.maximum(color_of(tables, surface, IOR)[0], 1e-3)
        glass = no | (tables.materials.model[surface.material] == GLASS)
        ior = medium_stack.ratio(inside, ior, tables, surface)
        unseen = medium_stack.hidden(inside, no, tables, surface)
        transmission = ops.where3(unseen, (zero + 1.0, zero + 1.0, zero + 1.0), transmission)
    if uses.shines:
        emission = color_of(tables, surface, EMISSION)
    diffuse = ops.mul(color_of(tables, surface, DIFFUSE), surface.color)
    plain = Shader(
        ambient, diffuse, specular, shininess, reflection, transmission, ior, emission, blinn, normalized, strength, glass, None, None
    )
    plain = _with_lobes(principled.at(tables, surface), plain)
    return _with_frost(rough_dielectric.at(tables, surface, plain.ior, plain.transmission), plain)


@helper
def _in_place(lobes: microfacet.Lobes, plain: Shader) -> Shader:
    """A material's numbers where lanes with microfacets do nothing by the course's equations, but for what is a mirror and passes."""
    zero = 0.0 * plain.ior
    black = (zero, zero, zero)
    here = lobes.here
    reflection = ops.where3(lobes.sharp, ops.lerp3(lobes.f0, (zero + 1.0, zero + 1.0, zero + 1.0), zero + 0.05), black)
    return Shader(
        ops.where3(here, ops.mul(plain.ambient, lobes.base), plain.ambient), ops.where3(here, black, plain.diffuse),
        ops.where3(here, black, plain.specular), plain.shininess, ops.where3(here, reflection, plain.reflection), plain.transmission,
        ops.where(here, zero + 1.0, plain.ior), plain.emission, plain.blinn, plain.normalized, plain.strength, plain.glass, lobes, None,
    )  # fmt: skip


_with_lobes = specialize_if_present(_in_place)


@helper
def _rough(frost: rough_dielectric.Frost, plain: Shader) -> Shader:
    """The same where rough glass is not smooth glass."""
    zero = 0.0 * plain.ior
    here, black = frost.here, (zero, zero, zero)
    return Shader(
        plain.ambient, plain.diffuse, plain.specular, plain.shininess, ops.where3(here, black, plain.reflection),
        ops.where3(here, black, plain.transmission), ops.where(here, zero + 1.0, plain.ior), plain.emission, plain.blinn,
        plain.normalized, plain.strength, plain.glass & ops.not_(here), plain.lobes, frost,
    )  # fmt: skip


_with_frost = specialize_if_present(_rough)


@helper
def reflected(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """What of a light's I = E⊥/π goes to the viewer; all directions unit and away from the surface."""
    light = _by_course(shader, normal, to_light, to_viewer)
    light = microfacet.reflected(shader.lobes, light, normal, to_light, to_viewer)
    return rough_dielectric.reflected(shader.frost, light, normal, to_light, to_viewer)


@helper
def eval_lobes_pdf(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    """`reflected` as (what no highlight reflects, what one does, the density with which `sample_lobe` takes the direction).

    Highlights of the course's equations stand among the first.
    """
    none = 0.0 * normal[0]
    plain = _by_course(shader, normal, to_light, to_viewer), (none, none, none), none
    found = microfacet.divided(shader.lobes, plain, normal, to_light, to_viewer)
    return rough_dielectric.divided(shader.frost, found, normal, to_light, to_viewer)


@helper
def _by_course(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.dot(normal, to_light)
    light = matt(shader, cosine)
    shiny = has_highlight(shader, cosine)
    if ops.any_lane(shiny):
        lobe = ops.where(shiny, highlight(shader, normal, to_light, to_viewer, cosine), 0.0)
        light = ops.add(light, ops.scale(shader.specular, lobe))
    return light


@helper
def matt(shader: Shader, cosine: Lane) -> Vec:
    """What of it is spread evenly, by the course's equations."""
    return ops.scale(shader.diffuse, ops.maximum(cosine, 0.0))


@helper
def has_highlight(shader: Shader, cosine: Lane) -> Lane:
    """Whether it has one, by the course's equations, on this side of a surface."""
    return (cosine > 0.0) & (ops.largest(shader.specular) > 0.0)


@helper
def is_lit(shader: Shader) -> Lane:
    """Whether light of lamps goes from it to the viewer."""
    return rough_dielectric.also(shader.frost, lights_up(shader.lobes, ops.largest(shader.diffuse) + ops.largest(shader.specular) > 0.0))


@helper
def has_matt(shader: Shader) -> Lane:
    """Whether part of it spreads light evenly."""
    return has_base(shader.lobes, ops.largest(shader.diffuse) > 0.0)


@helper
def _lobes_have_base(lobes: microfacet.Lobes, plain: Lane) -> Lane:
    return plain | (lobes.here & (ops.largest(lobes.base) > 0.0))


has_base = specialize_if_present(_lobes_have_base)


@helper
def is_polished(shader: Shader) -> Lane:
    """Whether all that it sends on goes about where a mirror or smooth glass would send it: metals and glass that are not rough."""
    return rough_dielectric.is_fine(shader.frost, _are_narrow(shader.lobes, ops.bool_like(shader.ior, False)), POLISHED)


@helper
def _narrow(lobes: microfacet.Lobes, plain: Lane) -> Lane:
    alone = (ops.largest(lobes.base) <= 0.0) & ((lobes.coat <= 0.0) | (lobes.coat_alpha <= POLISHED))
    return lobes.here & ops.not_(lobes.sharp) & alone & (lobes.alpha <= POLISHED)


_are_narrow = specialize_if_present(_narrow)


@helper
def has_bright_narrow_lobe(shader: Shader) -> Lane:
    """Whether it is matt under a highlight that is bright and narrow: one at whose peak is more light than an even surface would send.

    That is where 4 α² is below its reflectance along the normal; α² of the course's lobes is 2/(n + 2) (Walter et al. 2007).
    """
    clear = ops.largest(shader.reflection) + ops.largest(shader.transmission) <= 0.0
    bright = ops.largest(shader.specular)
    narrow = bright * (shader.shininess + 2.0) >= ops.where(bright >= BRIGHT, PEAK, FAINT_PEAK)
    return clear & _have_gleam(shader.lobes, narrow & shader.normalized & (ops.largest(shader.diffuse) > 0.0))


@helper
def _gleam(lobes: microfacet.Lobes, plain: Lane) -> Lane:
    bright = (lobes.alpha <= POLISHED) & (4.0 * lobes.alpha * lobes.alpha <= ops.largest(lobes.f0))
    coated = (lobes.coat_alpha <= POLISHED) & (4.0 * lobes.coat_alpha * lobes.coat_alpha <= microfacet.COAT * lobes.coat)
    found = ops.not_(lobes.sharp) & (ops.largest(lobes.base) > 0.0) & (bright | coated)
    return ops.where(lobes.here, found, plain)


_have_gleam = specialize_if_present(_gleam)


@helper
def matt_part(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """What of `reflected` is not a highlight's."""
    cosine = ops.maximum(ops.dot(normal, to_light), 0.0)
    return ops.scale(microfacet.matt_share(shader.lobes, shader.diffuse, normal, to_light, to_viewer), cosine)


@helper
def is_shiny(shader: Shader) -> Lane:
    """Whether it has a highlight that is not a mirror's."""
    return rough_dielectric.also(shader.frost, lights_up(shader.lobes, ops.largest(shader.specular) > 0.0))


@helper
def _lit_by_lobes(lobes: microfacet.Lobes, plain: Lane) -> Lane:
    return plain | lobes.here


lights_up = specialize_if_present(_lit_by_lobes)


@helper
def highlight(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec, cosine: Lane) -> Lane:
    """The highlight's strength, for a light on this side of the surface."""
    base = 0.0 * cosine
    if ops.any_lane(ops.not_(shader.blinn)):
        base = 2.0 * cosine * ops.dot(normal, to_viewer) - ops.dot(to_light, to_viewer)
    if ops.any_lane(shader.blinn):
        half = ops.normalize(ops.add(to_light, to_viewer))
        base = ops.where(shader.blinn, ops.dot(normal, half), base)
    lobe = ops.where(base > 0.0, fast_power.fast_pow(ops.clip(base, lights.TINY, 1.0), shader.shininess), 0.0)
    if ops.any_lane(shader.normalized):
        lobe = lobe * ops.where(shader.normalized, shader.strength * cosine, 1.0)
    return lobe


@helper
def lobe_scale(blinn: Lane, n: Lane) -> Lane:
    """What makes a lobe of exponent n reflect all of k_s at normal incidence."""
    of_half = (n + 2.0) * (n + 4.0) / (8.0 * (ops.power(2.0, -0.5 * n) + n))
    return ops.where(blinn, of_half, 0.5 * (n + 2.0))


@helper
def sample_lobe(shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Vec]:
    """A direction light may come from, spread as the highlight is, and what share of its radiance goes to the viewer."""
    plain = microfacet.sample_shine(shader.lobes, _of_lobe(shader, normal, to_viewer, u, v), normal, to_viewer, u, v)
    return rough_dielectric.onward(shader.frost, plain, normal, to_viewer, u, v, which)


@helper
def _of_lobe(shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    """The same of the course's lobes.

    cosⁿ about the mirrored direction (Phong) or of the half vector (Blinn-Phong, whose density is that of the half vector over
    4 V·H; Walter 2005, Notes on the Ward BRDF); the share is k_s lobe / (π density), 0 where the direction is below the surface.
    """
    n = shader.shininess
    cosine = ops.power(ops.maximum(1.0 - u, lights.TINY), 1.0 / (n + 1.0))
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    turn = 2.0 * math.pi * v
    mirrored = ops.reflect(ops.negate(to_viewer), normal)
    axis = ops.where3(shader.blinn, normal, mirrored)
    a, b = ops.basis(axis)
    sideways = ops.add(ops.scale(a, sine * ops.cos(turn)), ops.scale(b, sine * ops.sin(turn)))
    spread = ops.normalize(ops.add(ops.scale(axis, cosine), sideways))
    across = ops.dot(to_viewer, spread)
    direction = ops.where3(shader.blinn, ops.reflect(ops.negate(to_viewer), spread), spread)
    above = ops.dot(direction, normal)
    share = ops.where(shader.blinn, 8.0 * ops.maximum(across, 0.0), 2.0) / (n + 1.0)
    share = share * ops.where(shader.normalized, shader.strength * above, 1.0)
    return direction, ops.scale(shader.specular, ops.where(above > 0.0, share, 0.0))


@helper
def sample_glossy_or_diffuse(
    shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, interreflection: bool
) -> tuple[Vec, Vec]:
    """A direction for the one ray in which all but what is followed by itself goes on, and its weight: matt with interreflection alone."""
    matt = ops.scale(shader.diffuse, 1.0 if interreflection else 0.0)
    plain = lights.cosine_sample(normal, u, v)[0], matt
    plain = microfacet.onward(shader.lobes, plain, normal, to_viewer, u, v, which, interreflection)
    return rough_dielectric.onward(shader.frost, plain, normal, to_viewer, u, v, which)


@helper
def is_rough_glass(shader: Shader, plain: Lane) -> Lane:
    """`plain`, or whether it is rough glass, which light goes through."""
    return rough_dielectric.also(shader.frost, plain)


@helper
def is_glossy(shader: Shader) -> Lane:
    """Whether things could be told in its highlight, or through it: metals, polish and rough glass (of plan.glossy_materials)."""
    return rough_dielectric.also(shader.frost, microfacet.glossy(shader.lobes, ops.bool_like(shader.ior, False)))


def has_facets(shader: Shader) -> bool:
    """Whether a scene has microfacets: known when kernels are compiled."""
    return shader.lobes is not None or shader.frost is not None


def have_facets(shader: Any) -> bool:
    """The same of Numba's type of a Shader."""
    return any(not isinstance(shader.types[shader.fields.index(name)], types.NoneType) for name in ("lobes", "frost"))


@overload(has_facets, jit_options=HELPER)
def _has_facets(shader):
    found = have_facets(shader)
    return lambda shader: found


# --- for paths: how directions are drawn, and how likely each is ----------------------------------------------------------


class Scattered(NamedTuple):
    """A direction in which a path goes on."""

    direction: Vec
    weight: Vec  # share of the radiance from there, over the density
    density: Lane  # ONLY for mirrors and glass
    through: Lane  # bool: straight on through a passage of index 1


@helper
def _chances(shader: Shader, uses: Uses) -> tuple[Lane, Lane]:
    """How likely the matt part and the highlight are followed among the two: in proportion to what they reflect."""
    matt = ops.mean3(shader.diffuse)
    if ops.not_(uses.glossy):
        return matt, 0.0 * matt
    of_lobe = ops.where(shader.normalized, 0.0 * matt + 1.0, 2.0 / (shader.shininess + 1.0))
    return matt, ops.mean3(shader.specular) * of_lobe


@helper
def eval_bsdf_pdf(shader: Shader, uses: Uses, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    """(`reflected`, density with which `scatter` takes this direction, but for what mirrors and glass take)."""
    cosine = ops.maximum(ops.dot(normal, to_light), 0.0)
    share, density = ops.scale(shader.diffuse, cosine), cosine * (1.0 / math.pi)
    if uses.glossy or uses.sharp:
        matt, shiny = _chances(shader, uses)
        share = reflected(shader, normal, to_light, to_viewer)
        density = density * matt
        if uses.glossy:
            density = density + shiny * ops.where(cosine > 0.0, lobe_density(shader, normal, to_light, to_viewer), 0.0)
        sharp = 0.0 * matt
        if uses.sharp:
            sharp = ops.mean3(shader.reflection) + ops.mean3(shader.transmission)
        density = density / ops.maximum(matt + shiny + sharp, lights.TINY)
        share, density = microfacet.shared(shader.lobes, (share, density), normal, to_light, to_viewer, sharp)
        share, density = rough_dielectric.shared(shader.frost, (share, density), normal, to_light, to_viewer)
    return share, density


@helper
def lobe_density(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Lane:
    """The density of directions as `sample_lobe` spreads them."""
    mirrored = ops.reflect(ops.negate(to_viewer), normal)
    half = ops.normalize(ops.add(to_light, to_viewer))
    base = ops.where(shader.blinn, ops.dot(normal, half), ops.dot(mirrored, to_light))
    lobe = ops.where(base > 0.0, ops.power(ops.maximum(base, lights.TINY), shader.shininess), 0.0)
    across = 4.0 * ops.maximum(ops.absolute(ops.dot(half, to_viewer)), lights.TINY)
    return lobe * (shader.shininess + 1.0) / (2.0 * math.pi) / ops.where(shader.blinn, across, 1.0)


@helper
def sample_bsdf(shader: Shader, uses: Uses, point: Surface, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> Scattered:
    """A direction in which light is followed; u, v spread it, `which` chooses the part of the material that sends it there."""
    normal = point.normal
    direction, cosine = lights.cosine_sample(normal, u, v)
    zero = 0.0 * u
    through = ops.bool_like(zero, False)
    weight, density = shader.diffuse, cosine * (1.0 / math.pi)
    if uses.glossy or uses.sharp:
        matt, shiny = _chances(shader, uses)
        mirror, clear = zero, zero
        if uses.sharp:
            mirror, clear = ops.mean3(shader.reflection), ops.mean3(shader.transmission)
        blunt = rough_dielectric.one(shader.frost, microfacet.whole(shader.lobes, matt + shiny, normal, to_viewer))
        whole = ops.maximum(blunt + mirror + clear, lights.TINY)
        which = which * whole
        if uses.glossy:
            lobed = (which >= matt) & (which < matt + shiny)
            if ops.any_lane(lobed):
                direction = ops.where3(lobed, _of_lobe(shader, normal, to_viewer, u, v)[0], direction)
        direction = microfacet.draw(shader.lobes, direction, normal, to_viewer, u, v, which)
        direction, meant = rough_dielectric.draw(shader.frost, (direction, ops.bool_like(zero, True)), normal, to_viewer, u, v, which)
        share, density = eval_bsdf_pdf(shader, uses, normal, direction, to_viewer)
        weight = ops.scale(share, ops.where(meant, 1.0 / (math.pi * ops.maximum(density, lights.TINY)), 0.0))
        if uses.sharp:
            sharp = which >= blunt
            if ops.any_lane(sharp):
                direction, weight, through = _sharp(shader, point, to_viewer, direction, weight, which - blunt, whole, sharp)
                density = ops.where(sharp, zero + ONLY, density)
    sinks = (ops.dot(direction, point.geometric) <= 0.0) & (density < ONLY)
    sinks = sinks & ops.not_(is_rough_glass(shader, ops.bool_like(zero, False)))
    weight = ops.where3(sinks, (zero, zero, zero), weight)
    return Scattered(direction, weight, density, through)


@helper
def _sharp(
    shader: Shader, point: Surface, to_viewer: Vec, direction: Vec, weight: Vec, which: Lane, whole: Lane, here: Lane
) -> tuple[Vec, Vec, Lane]:
    """(direction, weight, straight through) where a mirror or a passage was chosen: `which` counts on from the matt part."""
    arriving = ops.negate(to_viewer)
    reflection, transmission, refracted, _ = fresnel_split(point, shader, arriving)
    mirror, clear = ops.mean3(shader.reflection), ops.mean3(shader.transmission)
    bounce = ops.mean3(reflection)
    both = ops.maximum(bounce + ops.mean3(transmission), lights.TINY)
    back = which * both < bounce * (mirror + clear)  # of those that were chosen, as many as Fresnel's law turns back
    mirrored = ops.reflect(arriving, point.normal)
    outside = ops.dot(mirrored, point.geometric) > 0.0  # an interpolated normal may mirror a grazing ray into the surface
    mirrored = ops.where3(outside, mirrored, ops.reflect(arriving, point.geometric))
    chance = ops.where(back, bounce, both - bounce) / both * (mirror + clear) / whole
    given = ops.scale(ops.where3(back, reflection, transmission), 1.0 / ops.maximum(chance, lights.TINY))
    through = here & ops.not_(back) & (shader.ior == 1.0)
    return ops.where3(here, ops.where3(back, mirrored, refracted), direction), ops.where3(here, given, weight), through


@helper
def fresnel_split(point: Surface, shader: Shader, direction: Vec) -> tuple[Vec, Vec, Vec, Lane]:
    """(reflected share, transmitted share, refracted direction, total reflection) of a ray that arrives at a surface.

    Radiance is not scaled by the square of the index when it enters a medium: what a camera outside sees is unchanged by that.
    """
    cosine = ops.clip(-ops.dot(direction, point.normal), 0.0, 1.0)
    eta = ops.where(point.front, 1.0 / shader.ior, shader.ior)
    share, bent, total = fresnel(cosine, eta)
    refracted = refract(direction, point.normal, cosine, bent, eta)
    let_through = ops.where(shader.glass, 1.0 - share, ops.where(total, 0.0, 1.0))
    transmission = ops.scale(shader.transmission, let_through)
    by_fresnel = (share, share, share)
    reflection = ops.where3(shader.glass, by_fresnel, shader.reflection)
    turned_back = total & ops.not_(shader.glass)
    reflection = ops.where3(turned_back, ops.add(reflection, shader.transmission), reflection)
    viewer = ops.negate(direction)
    reflection = microfacet.mirrored(shader.lobes, reflection, point.normal, viewer)
    transmission = microfacet.let_in(shader.lobes, transmission, point.normal, viewer)
    return reflection, transmission, refracted, total


@helper
def fresnel(cosine: Lane, eta: Lane) -> tuple[Lane, Lane, Lane]:
    """(reflectance, cosine of the refracted ray, total) of unpolarised light between dielectrics.

    `cosine` is that of the incoming ray, `eta` = n₁/n₂. One quantity, k = 1 - η²(1 - cos²), decides between refraction and
    total reflection, so that the two always add up to one (Hecht, Optics, §4.6).
    """
    k = 1.0 - eta * eta * ops.maximum(1.0 - cosine * cosine, 0.0)
    total = ops.not_(k > 0.0)
    bent = ops.sqrt(ops.where(total, 0.0, k))
    across = (eta * cosine - bent) / ops.maximum(eta * cosine + bent, lights.TINY)
    along = (cosine - eta * bent) / ops.maximum(cosine + eta * bent, lights.TINY)
    return ops.where(total, 1.0, 0.5 * (across * across + along * along)), bent, total


@helper
def refract(direction: Vec, normal: Vec, cosine: Lane, bent: Lane, eta: Lane) -> Vec:
    """Snell's law as the course writes it: D₂ = η D₁ + (η cos θ₁ - cos θ₂) N, `normal` on the incoming side."""
    return ops.normalize(ops.add(ops.scale(direction, eta), ops.scale(normal, eta * cosine - bent)))
