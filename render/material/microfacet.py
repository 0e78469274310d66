"""Microfacet lobes: GGX over a diffuse base and under a clear coat, with energy compensation.

- Facets: GGX with Smith's height-correlated shadowing (Walter et al. 2007; Heitz 2014, Understanding the Masking-Shadowing Function),
  sampled by visible normals (Dupuy and Benyoub 2023, Sampling Visible GGX Normals with Spherical Caps): no sample weighs above 1.
- Fresnel: Schlick's approximation, for metals minus Lazányi and Szirmay-Kalos' term, which gives the dip before the grazing angle
  (Hoffman 2019, Fresnel Equations Considered Harmful): f0 + (f90 − f0)(1 − c)⁵ − bend c (1 − c)⁶.
- Light of further bounces between facets leaves in a wider GGX lobe, which returns what one bounce loses (module energy_compensation). Its
  shape and its colour are fitted to random walks (module further_bounces).
- The base is scaled by the transmission of the highlight both ways: ρ/π (1 − E(μₒ))(1 − E(μᵢ))/(1 − Ē), as in Kelemen and Szirmay-Kalos
  2001. So a white base under any highlight passes the furnace test, and each part is reciprocal.
- Sheen (module sheen) lies over the highlight and the base; it is evaluated and sampled with the diffuse lobe.
- A coat is a highlight of index 1.5 over all that; the highlight under it is scaled by the lesser of the coat's two transmissions.

Scenes without such materials compile nothing of it: the `lobes` of their Shader is None, which is a type.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

from ...materials import thresholds
from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import energy_compensation, further_bounces, sheen

SHARP, COAT, MAX_REFLECTION_ALPHA = thresholds.SHARP, thresholds.COAT, thresholds.MAX_REFLECTION_ALPHA
METALLIC = 0.1  # reflectance at normal incidence above that of dielectrics: of an index of 1.92
GRAZING = 50.0  # times f0 is the greatest f90: a material of f0 = 0 has no highlight
LEAST = 1e-7


class Lobes(NamedTuple):
    """Microfacet parameters of a material at a point."""

    here: Lane  # bool: the material has microfacets; else the others are unused
    sharp: Lane  # bool: its highlight is specular
    base: Vec  # diffuse reflectance under the highlights
    f0: Vec  # reflectance of facets at normal incidence
    f90: Lane
    bend: Vec  # factor of the dip before the grazing angle
    alpha: Lane  # roughness of facets
    coat: Lane  # weight of the coat, 0 to 1
    coat_alpha: Lane
    table: energy_compensation.Albedo
    sheen: Any = None  # sheen.Sheen, or None in scenes without sheen


class Albedos(NamedTuple):
    """Directional albedos of the highlights."""

    highlight: Vec  # of the highlight, with multiple scattering
    lost: Lane  # 1 − E: energy that single scattering loses
    again: Lane  # h: the lobe of further bounces has the reflectance h h, times further_bounces.pair
    bounced: Vec  # share of the lost energy that further bounces return
    coat: Lane  # of the coat
    sheen: Any  # of sheen of colour 1, or None


# --- facets --------------------------------------------------------------------------------------------------------------


@helper
def fresnel(lobes: Lobes, cosine: Lane) -> Vec:
    """Return the Fresnel reflectance of facets at this cosine."""
    away = ops.maximum(1.0 - cosine, 0.0)
    square = away * away
    fifth = square * square * away
    dip = cosine * fifth * away
    f0, bend = lobes.f0, lobes.bend
    return (
        f0[0] + (lobes.f90 - f0[0]) * fifth - bend[0] * dip, f0[1] + (lobes.f90 - f0[1]) * fifth - bend[1] * dip,
        f0[2] + (lobes.f90 - f0[2]) * fifth - bend[2] * dip,
    )  # fmt: skip


@helper
def _coat_fresnel(cosine: Lane) -> Lane:
    away = ops.maximum(1.0 - cosine, 0.0)
    square = away * away
    return COAT + (1.0 - COAT) * square * square * away


@helper
def ggx_distribution(half: Vec, normal: Vec, alpha: Lane) -> Lane:
    """Return the GGX normal distribution at `half`. The sine comes from a cross product, which is precise for nearly flat facets."""
    across = ops.cross(normal, half)
    cosine = ops.dot(normal, half)
    square = alpha * alpha
    size = ops.dot(across, across) + square * cosine * cosine
    return ops.where(cosine > 0.0, square / (math.pi * ops.maximum(size * size, 1e-30)), 0.0)


@helper
def _reach(cosine: Lane, alpha: Lane) -> Lane:
    """√(α² + (1 − α²) cos²), which is cos (1 + 2 Λ) with Smith's Λ."""
    square = alpha * alpha
    return ops.sqrt(square + (1.0 - square) * cosine * cosine)


@helper
def smith_visibility(out: Lane, into: Lane, alpha: Lane) -> Lane:
    """Return the masking-shadowing term over 4 times both cosines."""
    return 0.5 / ops.maximum(out * _reach(into, alpha) + into * _reach(out, alpha), LEAST * LEAST)


@helper
def sample_visible_normal(normal: Vec, to_viewer: Vec, alpha: Lane, u: Lane, v: Lane) -> Vec:
    """Sample a visible normal (Dupuy and Benyoub 2023)."""
    s, t = ops.basis(normal)
    x, y, z = ops.dot(to_viewer, s), ops.dot(to_viewer, t), ops.maximum(ops.dot(to_viewer, normal), 0.0)
    x, y, z = ops.normalize((alpha * x, alpha * y, z))
    turn = 2.0 * math.pi * v
    height = (1.0 - u) * (1.0 + z) - z
    flat = ops.sqrt(ops.maximum(1.0 - height * height, 0.0))
    x, y, z = alpha * (flat * ops.cos(turn) + x), alpha * (flat * ops.sin(turn) + y), height + z
    return ops.normalize(ops.in_basis(s, t, normal, x, y, ops.maximum(z, LEAST)))


# --- layers --------------------------------------------------------------------------------------------------------------


@helper
def _albedo(lobes: Lobes, e: Lane, b: Lane, bounced: Vec) -> Vec:
    """The albedo of a highlight from its E and B."""
    a, lost, f0 = e - b, 1.0 - e, lobes.f0
    return (
        f0[0] * a + lobes.f90 * b + bounced[0] * lost, f0[1] * a + lobes.f90 * b + bounced[1] * lost,
        f0[2] * a + lobes.f90 * b + bounced[2] * lost,
    )  # fmt: skip


@helper
def directional_albedo(lobes: Lobes, cosine: Lane) -> Albedos:
    """Return the directional albedos at a cosine."""
    s, c = energy_compensation.after_two(lobes.table, cosine, lobes.alpha)
    bounced = further_bounces.colour(lobes.f0, lobes.f90, lobes.bend, lobes.alpha, s, 0.0 * s, c)
    e, b = energy_compensation.directional_albedo(lobes.table, cosine, lobes.alpha)
    coat = 0.0 * cosine
    if ops.any_lane(lobes.coat > 0.0):
        albedo, grazing = energy_compensation.directional_albedo(lobes.table, cosine, lobes.coat_alpha)
        coat = lobes.coat * (COAT * (albedo - grazing) + grazing)
    again = energy_compensation.further_bounces(lobes.table, cosine, lobes.alpha)
    return Albedos(_albedo(lobes, e, b, bounced), 1.0 - e, again, bounced, coat, sheen.albedo_of(lobes.sheen, None, cosine))


class Layers(NamedTuple):
    """Hemispherical means of the highlights."""

    open: Vec  # mean transmission in and out


@helper
def layers(lobes: Lobes) -> Layers:
    """Return the means of a material's highlights."""
    mean, grazing, deviation = energy_compensation.means(lobes.table, lobes.alpha)
    s, c = energy_compensation.mean_after_two(lobes.alpha)
    albedo = _albedo(lobes, mean, grazing, further_bounces.colour(lobes.f0, lobes.f90, lobes.bend, lobes.alpha, s, 0.0 * s, c))
    ones = 1.0 + 0.0 * mean
    passes = ops.sub((ones, ones, ones), albedo)
    if ops.any_lane(lobes.coat > 0.0):
        coat_mean, coat_grazing, coat_deviation = energy_compensation.means(lobes.table, lobes.coat_alpha)
        of_coat = 1.0 - lobes.coat * (COAT * (coat_mean - coat_grazing) + coat_grazing)
        together = lobes.coat * (1.0 - COAT) * deviation * coat_deviation  # the transmissions of both are correlated
        f0 = lobes.f0
        passes = (
            passes[0] * of_coat + together * (lobes.f90 - f0[0]), passes[1] * of_coat + together * (lobes.f90 - f0[1]),
            passes[2] * of_coat + together * (lobes.f90 - f0[2]),
        )  # fmt: skip
    return Layers(passes)


@helper
def diffuse_under_layers(lobes: Lobes, all_: Layers, out: Albedos, into: Albedos) -> Vec:
    """The reflectance of the base for two directions."""
    coats = (1.0 - out.coat) * (1.0 - into.coat)
    base = lobes.base
    return (
        _matt(base[0], coats, out.highlight[0], into.highlight[0], all_.open[0]),
        _matt(base[1], coats, out.highlight[1], into.highlight[1], all_.open[1]),
        _matt(base[2], coats, out.highlight[2], into.highlight[2], all_.open[2]),
    )


@helper
def _matt(base: Lane, coats: Lane, out: Lane, into: Lane, open_: Lane) -> Lane:
    return base * coats * (1.0 - out) * (1.0 - into) / ops.maximum(open_, LEAST)


# --- evaluation and sampling ---------------------------------------------------------------------------------------------


class LobeValues(NamedTuple):
    """π f cos of each lobe for two directions, and the densities of their samples."""

    matt: Vec  # with sheen
    highlight: Vec  # with further bounces
    coat: Lane
    matt_density: Lane
    highlight_density: Lane
    again_density: Lane  # of the lobe of further bounces
    coat_density: Lane


@separate_helper
def eval_lobes(lobes: Lobes, normal: Vec, to_light: Vec, to_viewer: Vec, out: Albedos, all_: Layers) -> LobeValues:
    """Evaluate all lobes for a pair of directions; 0 where the light is below the surface."""
    cos_in = ops.dot(normal, to_light)
    lit = cos_in > 0.0
    cos_in = ops.clip(cos_in, LEAST, 1.0)
    cos_out = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    into = directional_albedo(lobes, cos_in)
    half = ops.normalize(ops.add(to_light, to_viewer))
    along = ops.clip(ops.dot(half, to_viewer), 0.0, 1.0)
    zero = 0.0 * cos_in
    strength = ops.where(lit & ops.not_(lobes.sharp), ggx_distribution(half, normal, lobes.alpha), zero)
    least = 1.0 - ops.maximum(out.coat, into.coat)
    shine = math.pi * cos_in * strength * smith_visibility(cos_out, cos_in, lobes.alpha) * least
    density = strength * 0.5 / (cos_out + _reach(cos_out, lobes.alpha))
    wide = energy_compensation.spread_alpha(lobes.alpha)
    strength = ops.where(lit & ops.not_(lobes.sharp), ggx_distribution(half, normal, wide), zero)
    again = math.pi * cos_in * strength * smith_visibility(cos_out, cos_in, wide) * least * out.again * into.again
    again_density = strength * 0.5 / (cos_out + _reach(cos_out, wide))
    coat, coat_density = zero, zero
    if ops.any_lane(lobes.coat > 0.0):
        strength = ops.where(lit, ggx_distribution(half, normal, lobes.coat_alpha), zero)
        coat = lobes.coat * math.pi * cos_in * strength * smith_visibility(cos_out, cos_in, lobes.coat_alpha) * _coat_fresnel(along)
        coat_density = strength * 0.5 / (cos_out + _reach(cos_out, lobes.coat_alpha))
    cos_lit = ops.where(lit, cos_in, zero)
    diffuse = ops.scale(diffuse_under_layers(lobes, all_, out, into), cos_lit)
    facing = ops.dot(half, normal)
    below = diffuse, ops.add(ops.scale(fresnel(lobes, along), shine), _further(lobes, cos_out, cos_in, facing, again))
    diffuse, highlight = sheen.over(lobes.sheen, below, out.sheen, into.sheen, cos_in, cos_out, facing, cos_lit * least)
    return LobeValues(diffuse, highlight, coat, cos_lit * (1.0 / math.pi), density, again_density, coat_density)


@helper
def _further(lobes: Lobes, cos_out: Lane, cos_in: Lane, facing: Lane, wide: Lane) -> Vec:
    """π f cos of further bounces from that of the wide lobe of reflectance h h."""
    if ops.not_(ops.any_lane(wide > 0.0)):
        return wide, wide, wide
    alpha = lobes.alpha
    out, into = energy_compensation.column_of(cos_out, alpha), energy_compensation.column_of(cos_in, alpha)
    spread = energy_compensation.spread_alpha(alpha)
    up = ops.minimum(facing * facing, 1.0)
    y = spread * spread * up / (1.0 - up + spread * spread * up)
    factor, s, v, c = further_bounces.pair(lobes.table.pairs, out, into, alpha, y)
    return ops.scale(further_bounces.colour(lobes.f0, lobes.f90, lobes.bend, alpha, s, v, c), wide * factor)


@separate_helper
def viewer_albedo(lobes: Lobes, normal: Vec, to_viewer: Vec) -> tuple[Layers, Albedos]:
    """(means, directional albedos) of the viewer's direction."""
    all_ = layers(lobes)
    return all_, directional_albedo(lobes, ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0))


class Chances(NamedTuple):
    """Unnormalized probabilities of the lobes: their albedos, 0 for specular ones."""

    matt: Lane
    highlight: Lane
    again: Lane  # the lobe of further bounces
    coat: Lane


@helper
def chances(lobes: Lobes, all_: Layers, out: Albedos) -> Chances:
    """Return the probabilities by which lobes are sampled."""
    under = 1.0 - out.coat
    again, reflectance = ops.mean3(out.bounced) * out.lost, ops.mean3(out.highlight)
    diffuse = sheen.reflects(lobes.sheen, ops.mean3(lobes.base) * under * (1.0 - reflectance), out.sheen, under)
    glossy = ops.maximum(ops.where(lobes.sharp, 0.0, (reflectance - again) * under), 0.0)
    return Chances(diffuse, glossy, ops.where(lobes.sharp, 0.0, again * under), out.coat)


@helper
def _total(chance: Chances) -> Lane:
    return chance.matt + chance.highlight + chance.again + chance.coat


@helper
def _glossy_density(chance: Chances, values: LobeValues) -> Lane:
    """The density of samples of all lobes but the diffuse one, times their probabilities."""
    return chance.highlight * values.highlight_density + chance.again * values.again_density + chance.coat * values.coat_density


@helper
def _reflected(lobes: Lobes, default: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    values = eval_lobes(lobes, normal, to_light, to_viewer, out, all_)
    total = ops.add(ops.add(values.matt, values.highlight), (values.coat, values.coat, values.coat))
    return ops.where3(lobes.here, total, default)


@helper
def _eval_pdf(lobes: Lobes, default: tuple[Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec, mirror: Lane) -> tuple[Vec, Lane]:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    values = eval_lobes(lobes, normal, to_light, to_viewer, out, all_)
    total = ops.add(ops.add(values.matt, values.highlight), (values.coat, values.coat, values.coat))
    chance = chances(lobes, all_, out)
    density = chance.matt * values.matt_density + _glossy_density(chance, values)
    density = density / ops.maximum(_total(chance) + mirror, LEAST)
    return ops.where3(lobes.here, total, default[0]), ops.where(lobes.here, density, default[1])


@helper
def _matt_share(lobes: Lobes, default: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.dot(normal, to_light)
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    cos_in, cos_out = ops.clip(cosine, LEAST, 1.0), ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    into = directional_albedo(lobes, cos_in)
    zero = 0.0 * cosine
    dark = (zero, zero, zero)
    facing = ops.dot(ops.normalize(ops.add(to_light, to_viewer)), normal)
    below = diffuse_under_layers(lobes, all_, out, into), dark
    least = 1.0 - ops.maximum(out.coat, into.coat)
    diffuse = sheen.over(lobes.sheen, below, out.sheen, into.sheen, cos_in, cos_out, facing, least)[0]
    diffuse = ops.where3(cosine > 0.0, diffuse, dark)
    return ops.where3(lobes.here, diffuse, default)


@helper
def _sample_shine(lobes: Lobes, default: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    chance = chances(lobes, all_, out)
    coat, glossy = chance.coat, chance.highlight
    total = ops.maximum(coat + glossy + chance.again, LEAST)
    number = u * total
    on_coat, further = number < coat, number >= coat + glossy
    rescaled = ops.where(further, (number - coat - glossy) / ops.maximum(chance.again, LEAST), (number - coat) / ops.maximum(glossy, LEAST))
    rescaled = ops.clip(ops.where(on_coat, number / ops.maximum(coat, LEAST), rescaled), 0.0, 1.0)
    alpha = ops.where(further, energy_compensation.spread_alpha(lobes.alpha), ops.where(on_coat, lobes.coat_alpha, lobes.alpha))
    half = sample_visible_normal(normal, to_viewer, alpha, rescaled, v)
    direction = ops.reflect(ops.negate(to_viewer), half)
    values = eval_lobes(lobes, normal, direction, to_viewer, out, all_)
    density = _glossy_density(chance, values) / total
    share = ops.add(values.highlight, (values.coat, values.coat, values.coat))
    factor = ops.where(density > 0.0, 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return ops.where3(lobes.here, direction, default[0]), ops.where3(lobes.here, ops.scale(share, factor), default[1])


@helper
def _eval_lobes_pdf(lobes: Lobes, default: tuple[Vec, Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    chance = chances(lobes, all_, out)
    values = eval_lobes(lobes, normal, to_light, to_viewer, out, all_)
    shine = ops.add(values.highlight, (values.coat, values.coat, values.coat))
    density = _glossy_density(chance, values) / ops.maximum(chance.highlight + chance.again + chance.coat, LEAST)
    lanes = lobes.here
    return ops.where3(lanes, values.matt, default[0]), ops.where3(lanes, shine, default[1]), ops.where(lanes, density, default[2])


@helper
def _draw(lobes: Lobes, default: Vec, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> Vec:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    chance = chances(lobes, all_, out)
    shines, past = lobes.here & (which >= chance.matt), which - chance.matt - chance.highlight
    wide = energy_compensation.spread_alpha(lobes.alpha)
    alpha = ops.where(past < 0.0, lobes.alpha, ops.where(past < chance.again, wide, lobes.coat_alpha))
    half = sample_visible_normal(normal, to_viewer, alpha, u, v)
    return ops.where3(shines, ops.reflect(ops.negate(to_viewer), half), default)


@helper
def _whole(lobes: Lobes, default: Lane, normal: Vec, to_viewer: Vec) -> Lane:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    return ops.where(lobes.here, _total(chances(lobes, all_, out)), default)


@helper
def _specular_reflectance(lobes: Lobes, default: Vec, normal: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.clip(ops.dot(normal, to_viewer), 0.0, 1.0)
    out = viewer_albedo(lobes, normal, to_viewer)[1]
    reflectance = ops.scale(fresnel(lobes, cosine), sheen.rest(lobes.sheen, 1.0 - out.coat, out.sheen))
    return ops.where3(lobes.here & lobes.sharp, reflectance, default)


@helper
def _transmit(lobes: Lobes, default: Vec, normal: Vec, to_viewer: Vec) -> Vec:
    out = viewer_albedo(lobes, normal, to_viewer)[1]
    share = sheen.rest(lobes.sheen, 1.0 - out.coat, out.sheen)
    passed = (share * (1.0 - out.highlight[0]), share * (1.0 - out.highlight[1]), share * (1.0 - out.highlight[2]))
    return ops.where3(lobes.here, ops.mul(default, passed), default)


@helper
def _sample_all(
    lobes: Lobes, default: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, interreflection: bool
) -> tuple[Vec, Vec]:
    if ops.not_(interreflection):
        return _sample_shine(lobes, default, normal, to_viewer, u, v)
    zero = 0.0 * u
    among = which * _whole(lobes, zero, normal, to_viewer)
    direction = _draw(lobes, default[0], normal, to_viewer, u, v, among)
    share, density = _eval_pdf(lobes, (default[1], zero + 1.0), normal, direction, to_viewer, zero)
    factor = ops.where(density > 0.0, 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return direction, ops.where3(lobes.here, ops.scale(share, factor), default[1])


@helper
def _diffuse_part(lobes: Lobes, default: tuple[Vec, Lane], normal: Vec, to_viewer: Vec, mirror: Lane) -> tuple[Vec, Lane]:
    all_, out = viewer_albedo(lobes, normal, to_viewer)
    probabilities = chances(lobes, all_, out)
    chance = probabilities.matt / ops.maximum(_total(probabilities) + mirror, LEAST)
    return ops.where3(lobes.here, ops.mul(lobes.base, all_.open), default[0]), ops.where(lobes.here, chance, default[1])


@helper
def _glossy(lobes: Lobes, default: Lane) -> Lane:
    polished = (lobes.alpha < MAX_REFLECTION_ALPHA) | ((lobes.coat > 0.0) & (lobes.coat_alpha < MAX_REFLECTION_ALPHA))
    return ops.where(lobes.here, polished | (ops.largest(lobes.f0) > METALLIC), default)


@helper
def is_active(lobes: Lobes) -> bool:
    """Whether the material of some lane has microfacets."""
    return ops.any_lane(lobes.here)


_if_active = functools.partial(specialize_if_present, is_active=is_active)


# Each takes lobes, the result for materials without them, and: the normal, the direction to the light, the direction to the viewer.
reflected = _if_active(_reflected)  # π f cos
eval_pdf = _if_active(_eval_pdf)  # (π f cos, density of `draw`); `mirror` is the weight of specular lobes
diffuse_part = _if_active(_diffuse_part)  # see bsdf.diffuse_part; `mirror` as for eval_pdf
matt_share = _if_active(_matt_share)  # π f of the diffuse lobe alone
sample_shine = _if_active(_sample_shine)  # (direction in a highlight, f cos / density): normal, viewer, u, v
eval_lobes_pdf = _if_active(_eval_lobes_pdf)  # (π f cos of the diffuse lobe, of the highlights, density of `sample_shine`)
draw = _if_active(_draw)  # a direction: normal, viewer, u, v, and a lobe number, 0 to `whole`; `plain` for the diffuse lobe
whole = _if_active(_whole)  # the total of `chances`: normal, viewer
specular_reflectance = _if_active(_specular_reflectance)  # reflectance of specular highlights: normal, viewer
sample_all = _if_active(_sample_all)  # (direction, f cos / density): normal, viewer, u, v, lobe number, whether diffuse, too
glossy = _if_active(_glossy)  # whether its highlight shows surroundings
transmit = _if_active(_transmit)  # transmission through the highlights: normal, viewer
