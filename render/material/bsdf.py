"""BSDF of a shader: evaluation, sampling, densities and classification, over all lobes.

The classic lobes are in `phong`, microfacets in `microfacet`, rough glass in `rough_dielectric`. Shares are of a light's I = E⊥/π.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...materials.thresholds import BRIGHT, FAINT_PEAK, MAX_CAUSTIC_ALPHA, PEAK
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import ops
from ..light import lights
from ..simd.registration import overload, types
from ..types import Lane, Surface, Vec
from . import added_lobes, body_coat, fresnel, microfacet, openpbr, phong, rough_dielectric, sheen
from .shader import ONLY, Shader, Uses

NARROW = 0.04  # greatest α of a lobe that paths follow where photons light the diffuse base under it; at 0.06 neither is better


@separate_helper
def reflected(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """Return the share π f cos of a light's I = E⊥/π that goes to the viewer; directions are unit and away from the surface."""
    light = phong.reflected_classic(shader, normal, to_light, to_viewer)
    light = added_lobes.value(shader.added, light, normal, to_light, to_viewer)
    light = microfacet.reflected(shader.lobes, light, normal, to_light, to_viewer)
    light = body_coat.reflected(shader.coat, light, normal, to_light, to_viewer)
    light = openpbr.reflected(shader.slabs, light, normal, to_light, to_viewer)
    return rough_dielectric.reflected(shader.frost, light, normal, to_light, to_viewer)


@separate_helper
def eval_lobes_pdf(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    """`reflected` as (share of diffuse and added lobes, share of highlights, solid angle density of `sample_lobe`)."""
    diffuse, highlight, density = phong.eval_lobes_pdf(shader, normal, to_light, to_viewer)
    classic = added_lobes.value(shader.added, diffuse, normal, to_light, to_viewer), highlight, density
    values = microfacet.eval_lobes_pdf(shader.lobes, classic, normal, to_light, to_viewer)
    values = openpbr.eval_lobes_pdf(shader.slabs, values, normal, to_light, to_viewer)
    return rough_dielectric.eval_lobes_pdf(shader.frost, values, normal, to_light, to_viewer)


@helper
def is_lit(shader: Shader) -> Lane:
    """Whether it reflects or transmits the light of lights: not only specular."""
    classic = added_lobes.or_has(shader.added, ops.largest(shader.diffuse) + ops.largest(shader.specular) > 0.0)
    return rough_dielectric.or_rough(shader.frost, openpbr.or_slabs(shader.slabs, reflects(shader.lobes, classic)))


@helper
def has_matt(shader: Shader) -> Lane:
    """Whether it has a diffuse lobe."""
    return openpbr.or_matt(shader.slabs, has_base(shader.lobes, added_lobes.or_has(shader.added, ops.largest(shader.diffuse) > 0.0)))


@helper
def _has_base(lobes: microfacet.Lobes, default: Lane) -> Lane:
    return default | (lobes.here & sheen.or_has(lobes.sheen, ops.largest(lobes.base) > 0.0))


has_base = specialize_if_present(_has_base)


@helper
def is_polished(shader: Shader) -> Lane:
    """Whether all its lobes are narrow: metals and glass of α up to MAX_CAUSTIC_ALPHA."""
    plain = openpbr.or_polished(shader.slabs, _are_narrow(shader.lobes, ops.bool_like(shader.ior, False)), MAX_CAUSTIC_ALPHA)
    return rough_dielectric.is_fine(shader.frost, plain, MAX_CAUSTIC_ALPHA)


@helper
def _narrow(lobes: microfacet.Lobes, default: Lane) -> Lane:
    has_base = sheen.or_has(lobes.sheen, ops.largest(lobes.base) > 0.0)
    alone = ops.not_(has_base) & ((lobes.coat <= 0.0) | (lobes.coat_alpha <= MAX_CAUSTIC_ALPHA))
    return lobes.here & ops.not_(lobes.sharp) & alone & (lobes.alpha <= MAX_CAUSTIC_ALPHA)


_are_narrow = specialize_if_present(_narrow)


@helper
def has_bright_narrow_lobe(shader: Shader) -> Lane:
    """Whether it is diffuse under a bright, narrow highlight: one whose peak exceeds a diffuse surface's radiance.

    That holds where 4 α² is below the reflectance at normal incidence; α² of classic lobes is 2/(n + 2) (Walter et al. 2007).
    """
    clear = ops.largest(shader.reflection) + ops.largest(shader.transmission) <= 0.0
    bright = ops.largest(shader.specular)
    narrow = bright * (shader.shininess + 2.0) >= ops.where(bright >= BRIGHT, PEAK, FAINT_PEAK)
    plain = _have_bright_lobe(shader.lobes, narrow & shader.normalized & (ops.largest(shader.diffuse) > 0.0))
    return clear & openpbr.bright(shader.slabs, plain)


@helper
def _bright(lobes: microfacet.Lobes, default: Lane) -> Lane:
    bright = (lobes.alpha <= MAX_CAUSTIC_ALPHA) & (4.0 * lobes.alpha * lobes.alpha <= ops.largest(lobes.f0))
    coated = (lobes.coat_alpha <= MAX_CAUSTIC_ALPHA) & (4.0 * lobes.coat_alpha * lobes.coat_alpha <= microfacet.COAT * lobes.coat)
    is_bright = ops.not_(lobes.sharp) & (ops.largest(lobes.base) > 0.0) & (bright | coated)
    return ops.where(lobes.here, is_bright, default)


_have_bright_lobe = specialize_if_present(_bright)


@helper
def has_narrow_lobe(shader: Shader) -> Lane:
    """Whether it is diffuse under a glossy lobe of α up to NARROW."""
    classic = (ops.largest(shader.specular) > 0.0) & (shader.shininess + 2.0 >= 2.0 / NARROW**2)
    return openpbr.narrow_over_base(shader.slabs, _have_narrow_lobe(shader.lobes, classic & (ops.largest(shader.diffuse) > 0.0)))


@helper
def _narrow_over_base(lobes: microfacet.Lobes, default: Lane) -> Lane:
    narrow = (lobes.alpha <= NARROW) | ((lobes.coat > 0.0) & (lobes.coat_alpha <= NARROW))
    return ops.where(lobes.here, narrow & (ops.largest(lobes.base) > 0.0), default)


_have_narrow_lobe = specialize_if_present(_narrow_over_base)


@helper
def eval_diffuse(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """Return the diffuse part of `reflected`."""
    cosine = ops.maximum(ops.dot(normal, to_light), 0.0)
    diffuse = ops.scale(microfacet.matt_share(shader.lobes, shader.diffuse, normal, to_light, to_viewer), cosine)
    diffuse = added_lobes.value(shader.added, diffuse, normal, to_light, to_viewer)
    return openpbr.eval_matt(shader.slabs, diffuse, normal, to_light, to_viewer)


@helper
def matt_share(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """Return π f of the diffuse lobe alone, without those that materials add."""
    plain = microfacet.matt_share(shader.lobes, shader.diffuse, normal, to_light, to_viewer)
    return openpbr.matt_share(shader.slabs, plain, normal, to_light, to_viewer)


@helper
def is_shiny(shader: Shader) -> Lane:
    """Whether it has a highlight that is not specular."""
    plain = openpbr.or_slabs(shader.slabs, reflects(shader.lobes, ops.largest(shader.specular) > 0.0))
    return rough_dielectric.or_rough(shader.frost, plain)


@helper
def has_more_than_diffuse(shader: Shader) -> Lane:
    """Whether it has a highlight that is not specular, or an added lobe."""
    return added_lobes.or_has(shader.added, is_shiny(shader))


@helper
def _reflects(lobes: microfacet.Lobes, default: Lane) -> Lane:
    return default | lobes.here


reflects = specialize_if_present(_reflects)


@separate_helper
def sample_lobe(shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> tuple[Vec, Vec]:
    """(direction, weight) of a sample of the highlight: `weight` is the share of its radiance that goes to the viewer."""
    classic = microfacet.sample_shine(shader.lobes, phong.sample_classic_lobe(shader, normal, to_viewer, u, v), normal, to_viewer, u, v)
    classic = openpbr.sample(shader.slabs, classic, normal, to_viewer, u, v, which, False)
    return rough_dielectric.sample(shader.frost, classic, normal, to_viewer, u, v, which)


@helper
def sample_glossy_or_diffuse(
    shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, interreflection: bool
) -> tuple[Vec, Vec]:
    """(direction, weight) of one ray for all lobes that are not specular; the diffuse lobe only with interreflection."""
    factor = 1.0 if interreflection else 0.0
    sampled = lights.cosine_sample(normal, u, v)[0], ops.scale(shader.diffuse, factor)
    sampled = added_lobes.sample_beside_diffuse(shader.added, sampled, normal, to_viewer, u, v, which, factor)
    sampled = microfacet.sample_all(shader.lobes, sampled, normal, to_viewer, u, v, which, interreflection)
    sampled = openpbr.sample(shader.slabs, sampled, normal, to_viewer, u, v, which, interreflection)
    return rough_dielectric.sample(shader.frost, sampled, normal, to_viewer, u, v, which)


@helper
def refracts(shader: Shader, plain: Lane) -> Lane:
    """Return `plain`, or True for rough glass and slabs that refract."""
    return rough_dielectric.or_rough(shader.frost, openpbr.or_refracts(shader.slabs, plain))


@helper
def relative_index(shader: Shader, plain: Lane) -> Lane:
    """Return the index of this side over the other's: of rough glass and slabs that refract, else `plain`."""
    return rough_dielectric.eta(shader.frost, openpbr.eta(shader.slabs, plain))


@helper
def is_rough_glass(shader: Shader, default: Lane) -> Lane:
    """Return `default`, or True for rough glass."""
    return rough_dielectric.or_rough(shader.frost, default)


@helper
def scatters_through(shader: Shader, default: Lane) -> Lane:
    """Return `default`, or True for what scatters light to its other side: rough glass and translucent sheets."""
    default = openpbr.or_through(shader.slabs, added_lobes.or_through(shader.added, default))
    return rough_dielectric.or_rough(shader.frost, default)


@helper
def is_glossy(shader: Shader) -> Lane:
    """Whether its highlight shows surroundings: metals, polish and rough glass (of plan.glossy_materials)."""
    plain = openpbr.glossy(shader.slabs, microfacet.glossy(shader.lobes, ops.bool_like(shader.ior, False)))
    return rough_dielectric.or_rough(shader.frost, plain)


def has_facets(shader: Shader) -> bool:
    """Whether a scene has microfacets or rough glass; a constant in kernels."""
    return shader.lobes is not None or shader.frost is not None or shader.slabs is not None


def have_facets(shader: Any) -> bool:
    """`has_facets` of the Numba type of a Shader."""
    return any(not isinstance(shader.types[shader.fields.index(name)], types.NoneType) for name in ("lobes", "frost", "slabs"))


@overload(has_facets)
def _has_facets(shader):
    facets = have_facets(shader)
    return lambda shader: facets


@helper
def facets_of(shader: Shader) -> Lane:
    """Where the material has microfacets or is rough glass."""
    return rough_dielectric.or_rough(shader.frost, openpbr.or_slabs(shader.slabs, reflects(shader.lobes, ops.bool_like(shader.ior, False))))


# --- sampling for paths -------------------------------------------------------------------------------------------------


class Scattered(NamedTuple):
    """A BSDF sample."""

    direction: Vec
    weight: Vec  # f cos over the density
    density: Lane  # over solid angle; ONLY for mirrors and smooth glass
    through: Lane  # bool: straight through a boundary of index 1


@helper
def _chances(shader: Shader, uses: Uses) -> tuple[Lane, Lane]:
    """Return the unnormalized probabilities of the diffuse lobe and the highlight: their reflectances."""
    diffuse = ops.mean3(shader.diffuse)
    if ops.not_(uses.glossy):
        return diffuse, 0.0 * diffuse
    of_lobe = ops.where(shader.normalized, 0.0 * diffuse + 1.0, 2.0 / (shader.shininess + 1.0))
    return diffuse, ops.mean3(shader.specular) * of_lobe


@helper
def diffuse_part(shader: Shader, uses: Uses, normal: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    """(albedo of a Lambertian surface near the diffuse lobe, probability that `sample_bsdf` samples this lobe).

    The albedo does not depend on the viewer. What the BSDF has beyond it may be of either sign. Rough glass has none.
    """
    albedo, chance = shader.diffuse, 0.0 * shader.ior + 1.0
    if uses.glossy or uses.sharp:
        diffuse, glossy = _chances(shader, uses)
        sharp = 0.0 * diffuse
        if uses.sharp:
            sharp = ops.mean3(shader.reflection) + ops.mean3(shader.transmission)
        chance = diffuse / ops.maximum(added_lobes.chance(shader.added, diffuse + glossy + sharp, normal, to_viewer), lights.TINY)
        albedo, chance = microfacet.diffuse_part(shader.lobes, (albedo, chance), normal, to_viewer, sharp)
        albedo, chance = openpbr.diffuse_part(shader.slabs, (albedo, chance), normal, to_viewer)
        glass, zero = is_rough_glass(shader, ops.bool_like(shader.ior, False)), 0.0 * shader.ior
        albedo, chance = ops.where3(glass, (zero, zero, zero), albedo), ops.where(glass, zero, chance)
    return albedo, chance


@separate_helper
def eval_bsdf_pdf(shader: Shader, uses: Uses, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Lane]:
    """(`reflected`, solid angle density of `sample_bsdf`) of the lobes that are not specular."""
    cosine = ops.maximum(ops.dot(normal, to_light), 0.0)
    share, density = ops.scale(shader.diffuse, cosine), cosine * (1.0 / math.pi)
    if uses.glossy or uses.sharp:
        diffuse, glossy = _chances(shader, uses)
        share = reflected(shader, normal, to_light, to_viewer)
        density = density * diffuse
        if uses.glossy:
            density = density + glossy * ops.where(cosine > 0.0, phong.lobe_density(shader, normal, to_light, to_viewer), 0.0)
        density = added_lobes.density(shader.added, density, normal, to_light, to_viewer)
        sharp = 0.0 * diffuse
        if uses.sharp:
            sharp = ops.mean3(shader.reflection) + ops.mean3(shader.transmission)
        density = density / ops.maximum(added_lobes.chance(shader.added, diffuse + glossy + sharp, normal, to_viewer), lights.TINY)
        share, density = microfacet.eval_pdf(shader.lobes, (share, density), normal, to_light, to_viewer, sharp)
        density = body_coat.density(shader.coat, density, shader.added, normal, to_light, to_viewer, sharp)
        share, density = openpbr.eval_pdf(shader.slabs, (share, density), normal, to_light, to_viewer)
        share, density = rough_dielectric.eval_pdf(shader.frost, (share, density), normal, to_light, to_viewer)
    return share, density


@helper
def sample_bsdf(shader: Shader, uses: Uses, point: Surface, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> Scattered:
    """Sample the BSDF; u, v choose the direction in a lobe, `which` the lobe."""
    normal = point.normal
    direction, cosine = lights.cosine_sample(normal, u, v)
    zero = 0.0 * u
    through = ops.bool_like(zero, False)
    weight, density = shader.diffuse, cosine * (1.0 / math.pi)
    if uses.glossy or uses.sharp:
        diffuse, glossy = _chances(shader, uses)
        mirror, clear = zero, zero
        if uses.sharp:
            mirror, clear = ops.mean3(shader.reflection), ops.mean3(shader.transmission)
        classic = added_lobes.chance(shader.added, diffuse + glossy, normal, to_viewer)
        blunt = body_coat.whole(shader.coat, microfacet.whole(shader.lobes, classic, normal, to_viewer), shader.added, normal, to_viewer)
        blunt = rough_dielectric.one(shader.frost, openpbr.one(shader.slabs, blunt))
        total = ops.maximum(blunt + mirror + clear, lights.TINY)
        which = which * total
        if uses.glossy:
            lobed = (which >= diffuse) & (which < diffuse + glossy)
            if ops.any_lane(lobed):
                direction = ops.where3(lobed, phong.sample_classic_lobe(shader, normal, to_viewer, u, v)[0], direction)
        direction = added_lobes.draw(shader.added, direction, normal, to_viewer, u, v, which - diffuse - glossy)
        direction = microfacet.draw(shader.lobes, direction, normal, to_viewer, u, v, which)
        drawn = body_coat.draw(shader.coat, (direction, ops.bool_like(zero, True)), shader.added, normal, to_viewer, u, v, which)
        drawn = openpbr.draw(shader.slabs, drawn, normal, to_viewer, u, v, which)
        direction, is_valid = rough_dielectric.draw(shader.frost, drawn, normal, to_viewer, u, v, which)
        share, density = eval_bsdf_pdf(shader, uses, normal, direction, to_viewer)
        weight = ops.scale(share, ops.where(is_valid, 1.0 / (math.pi * ops.maximum(density, lights.TINY)), 0.0))
        if uses.sharp:
            sharp = which >= blunt
            if ops.any_lane(sharp):
                direction, weight, through = _sample_specular(shader, point, to_viewer, direction, weight, which - blunt, total, sharp)
                density = ops.where(sharp, zero + ONLY, density)
    sinks = (ops.dot(direction, point.geometric) <= 0.0) & (density < ONLY)
    sinks = sinks & ops.not_(scatters_through(shader, ops.bool_like(zero, False)))
    weight = ops.where3(sinks, (zero, zero, zero), weight)
    return Scattered(direction, weight, density, through)


@helper
def _sample_specular(
    shader: Shader, point: Surface, to_viewer: Vec, direction: Vec, weight: Vec, which: Lane, total: Lane, lanes: Lane
) -> tuple[Vec, Vec, Lane]:
    """(direction, weight, straight through) where the specular lobes were chosen; `which` counts from their start."""
    arriving = ops.negate(to_viewer)
    reflection, transmission, refracted, _ = fresnel_split(point, shader, arriving)
    mirror, clear = ops.mean3(shader.reflection), ops.mean3(shader.transmission)
    bounce = ops.mean3(reflection)
    both = ops.maximum(bounce + ops.mean3(transmission), lights.TINY)
    back = which * both < bounce * (mirror + clear)  # reflect in proportion to Fresnel reflectance
    mirrored = ops.reflect(arriving, point.normal)
    outside = ops.dot(mirrored, point.geometric) > 0.0  # an interpolated normal may mirror a grazing ray into the surface
    mirrored = ops.where3(outside, mirrored, ops.reflect(arriving, point.geometric))
    chance = ops.where(back, bounce, both - bounce) / both * (mirror + clear) / total
    factor = ops.scale(ops.where3(back, reflection, transmission), 1.0 / ops.maximum(chance, lights.TINY))
    through = lanes & ops.not_(back) & (shader.ior == 1.0)
    return ops.where3(lanes, ops.where3(back, mirrored, refracted), direction), ops.where3(lanes, factor, weight), through


@helper
def fresnel_split(point: Surface, shader: Shader, direction: Vec) -> tuple[Vec, Vec, Vec, Lane]:
    """(reflected share, transmitted share, refracted direction, total reflection) of a ray that arrives at a surface.

    Radiance is not scaled by the square of the index in a medium; pictures from outside are the same.
    """
    cosine = ops.clip(-ops.dot(direction, point.normal), 0.0, 1.0)
    eta = ops.where(point.front, 1.0 / shader.ior, shader.ior)
    share, bent, total = fresnel.fresnel(cosine, eta)
    refracted = fresnel.refract(direction, point.normal, cosine, bent, eta)
    let_through = ops.where(shader.glass, 1.0 - share, ops.where(total, 0.0, 1.0))
    transmission = ops.scale(shader.transmission, let_through)
    by_fresnel = (share, share, share)
    reflection = ops.where3(shader.glass, by_fresnel, shader.reflection)
    turned_back = total & ops.not_(shader.glass)
    reflection = ops.where3(turned_back, ops.add(reflection, shader.transmission), reflection)
    viewer = ops.negate(direction)
    reflection = microfacet.specular_reflectance(shader.lobes, reflection, point.normal, viewer)
    reflection = body_coat.specular_reflectance(shader.coat, reflection, point.normal, viewer)
    transmission = microfacet.transmit(shader.lobes, transmission, point.normal, viewer)
    return reflection, transmission, refracted, total
