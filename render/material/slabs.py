"""BSDF of OpenPBR: value, density and samples of fuzz, coat, metal, dielectric and diffuse base.

- Highlights: anisotropic GGX (module anisotropic_facets). Facets of the dielectric and of the coat reflect by Fresnel's equations, those of
  the metal by the F82-tint model (Kutz, Hašan, Edmondson 2021). What a metal loses by one bounce returns as in energy_compensation.
- The diffuse lobe (module oren_nayar) gets what both boundaries let through: (1 − R(μₒ))(1 − R(μᵢ)) over its mean, times likewise of the
  coat. So a white base under any highlight passes the furnace test, and both are reciprocal.
- The coat absorbs by the length of both ways in it, and darkens the base by light that it sends back (OpenPBR Surface 1.1, Coat).
- Fuzz (module fuzz) takes its albedo from all below, by the viewer's direction. It alone is not reciprocal.

Scenes without such materials compile nothing of it: the `slabs` of their Shader is None, which is a type.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit.kernel import helper, separate_helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import (
    anisotropic_albedo,
    anisotropic_facets,
    dielectric_albedo,
    energy_compensation,
    flakes,
    further_bounces,
    fuzz,
    microfacet,
    oren_nayar,
    rough_dielectric,
    slab_passage,
    thin_film,
)  # fmt: skip
from .anisotropic_facets import Facets
from .slab_passage import Passage

LEAST = 1e-7
ROUGH_EXCESS = 0.07  # greatest gain of a rough diffuse base under a boundary, over the deviation of the boundary's albedo


class Slabs(NamedTuple):
    """Parameters of a material of slabs at a point."""

    here: Lane  # bool: the material has slabs; else the others are unused
    color: Vec  # of the diffuse lobe; of the metal, its reflectance at normal incidence
    diffuse_roughness: Lane
    metal: Lane  # share of the metal
    bend: Vec  # factor of the metal's dip before the grazing angle
    gleam: Lane  # factor of the metal's reflectance
    step: Lane  # of the dielectric, see dielectric_albedo
    tint: Vec  # of the dielectric's highlight
    facets: Facets
    coat: Lane  # weight
    coat_step: Lane
    coat_ratio: Lane  # index of refraction
    coat_log: Vec  # half the logarithm of its colour
    coat_facets: Facets
    dark: Vec  # factor of the base by what the coat sends back
    fuzz: Lane  # weight
    fuzz_color: Vec
    fuzz_roughness: Lane
    table: energy_compensation.Albedo
    reflection: dielectric_albedo.Reflection
    film: Any = None  # Film; None in scenes without
    passage: Any = None  # slab_passage.Passage; None in scenes without
    flake: Any = None  # flakes.Flake, whose facets are those of one flake; None in scenes without
    anisotropy: Any = None  # anisotropic_albedo.Anisotropy; None in scenes where all facets are round
    coat_normal: Any = None  # Vec: of the coat, which has its own; None in scenes where all have that of the base


class Seen(NamedTuple):
    """What the slabs do with light of one direction."""

    base: Lane  # R of the dielectric
    coat: Lane  # R of the coat times its weight
    path: Lane  # length of its way through the coat, over the coat's thickness
    lost: Lane  # of a metal: 1 − E
    again: Lane  # of a metal: h, see energy_compensation
    bright: Vec  # of a metal: its albedo without further bounces
    passes: Any  # Vec: what a film lets through to a diffuse base, over 1 − R; None in scenes without


class Chances(NamedTuple):
    """Unnormalized probabilities of the lobes: about their albedos."""

    coat: Lane
    highlight: Lane
    again: Lane
    through: Lane  # refracted, or straight through a thin wall
    spread: Lane  # of further bounces at a boundary that refracts, to both sides
    fuzz: Lane
    matt: Lane
    body: Lane  # diffusely to the other side


class Values(NamedTuple):
    """π f cos of two directions, and densities of samples."""

    matt: Vec  # of the diffuse lobe and fuzz
    shine: Vec
    density: Lane  # of `draw` among all lobes
    shine_density: Lane  # of `draw` among the highlights


@helper
def seen_from(slabs: Slabs, normal: Vec, direction: Vec, far: Lane) -> Seen:
    """What the slabs do with light of a direction above the surface. `far`: it is the mirror image of one on the other side."""
    cosine = ops.clip(ops.dot(normal, direction), LEAST, 1.0)
    zero, alpha = 0.0 * cosine, slabs.facets.alpha
    base, e, b, again = dielectric_albedo.directional(slabs.reflection, cosine, alpha, slabs.step), zero + 1.0, zero, zero
    if ops.any_lane(slabs.metal > 0.0):
        e, b = energy_compensation.directional_albedo(slabs.table, cosine, alpha)
        again = energy_compensation.further_bounces(slabs.table, cosine, alpha)
    base, e, b, again = anisotropic_albedo.albedos(
        slabs.anisotropy, (base, e, b, again), slabs.table, slabs.facets, slabs.step, normal, direction
    )  # fmt: skip
    base, f0 = _within_rough(slabs.passage, base, slabs.facets, cosine, far), slabs.color
    bright = f0[0] * (e - b) + b, f0[1] * (e - b) + b, f0[2] * (e - b) + b
    coat, path = zero, zero + 1.0
    if ops.any_lane(slabs.coat > 0.0):
        outer = anisotropic_facets.coat_normal(slabs.coat_normal, normal)
        steep = ops.clip(ops.dot(outer, direction), LEAST, 1.0)
        r = dielectric_albedo.directional(slabs.reflection, steep, slabs.coat_facets.alpha, slabs.coat_step)
        covered = slabs.coat_facets, slabs.coat_step, outer, direction
        coat = slabs.coat * anisotropic_albedo.albedos(slabs.anisotropy, (r, zero, zero, zero), slabs.table, *covered)[0]
        sine = ops.maximum(1.0 - steep * steep, 0.0)
        path = 1.0 / ops.sqrt(ops.maximum(1.0 - sine / (slabs.coat_ratio * slabs.coat_ratio), 0.01))
    return Seen(base, coat, path, 1.0 - e, again, bright, thin_film.lets_through(slabs.film, None, slabs, cosine, alpha, base))


@helper
def _rough_inside(passage: Passage, base: Lane, facets: Facets, cosine: Lane, far: Lane) -> Lane:
    return ops.where(passage.inside != far, slab_passage.reflected_inside(passage, facets, cosine), base)


@helper
def _smooth_inside(passage: Passage, base: Lane, cosine: Lane) -> Lane:
    return ops.where(passage.inside, rough_dielectric.reflectance(cosine, passage.ratio), base)


_within_rough = specialize_if_present(_rough_inside)  # passage, R from outside, facets, cosine, whether on the other side: R on that side
_within = specialize_if_present(_smooth_inside)  # passage, the reflectance of facets from outside, cosine: that from the viewer's side


@helper
def _rest_of(passage: Passage, plain: Lane) -> Lane:
    return passage.opaque


_opaque = specialize_if_present(_rest_of)  # passage, 1: share of the diffuse lobe in what the boundary lets through


@helper
def _above(passage: Passage, to_light: Vec, normal: Vec) -> Vec:
    return slab_passage.mirrored(normal, to_light)


_image = specialize_if_present(_above)  # passage, a direction, normal: it, or where it is below the surface its mirror image


@helper
def _absorbed(slabs: Slabs, path: Lane) -> Vec:
    """The factor of light below the coat that goes `path` in it."""
    zero = 0.0 * path
    if ops.not_(ops.any_lane(slabs.coat > 0.0)):
        return (zero + 1.0, zero + 1.0, zero + 1.0)
    log = slabs.coat_log
    passed = ops.exp(log[0] * path), ops.exp(log[1] * path), ops.exp(log[2] * path)
    return ops.lerp3((zero + 1.0, zero + 1.0, zero + 1.0), passed, slabs.coat)


@helper
def _opening(slabs: Slabs) -> Lane:
    """The mean of what both boundaries let through, more for a rough base, which sends more light along the normal than Lambert's."""
    mean, deviation = dielectric_albedo.means(slabs.reflection, slabs.facets.alpha, slabs.step)
    mean = anisotropic_albedo.mean_reflectance(slabs.anisotropy, mean, slabs.table, slabs.facets, slabs.step)
    open_ = 1.0 - mean + ROUGH_EXCESS * slabs.diffuse_roughness * deviation
    if ops.any_lane(slabs.coat > 0.0):
        coat, coat_deviation = dielectric_albedo.means(slabs.reflection, slabs.coat_facets.alpha, slabs.coat_step)
        coat = anisotropic_albedo.mean_reflectance(slabs.anisotropy, coat, slabs.table, slabs.coat_facets, slabs.coat_step)
        open_ = open_ * (1.0 - slabs.coat * coat) + slabs.coat * deviation * coat_deviation  # both are correlated
    return ops.maximum(open_, LEAST)


@helper
def _open_viewed(passage: Passage, open_: Lane, slabs: Slabs) -> Lane:
    return ops.where(passage.inside, ops.maximum(slab_passage.mean_open_inside(passage, slabs.facets, open_), LEAST), open_)


_open_on_side = specialize_if_present(_open_viewed)  # passage, the mean of what passes from outside, slabs: that from the viewer's side


@helper
def _further(slabs: Slabs, cosines: tuple[Lane, Lane], facing: Lane, wide: Lane) -> Vec:
    """π f cos of further bounces in a metal, from that of the wide lobe of reflectance h h; see microfacet."""
    alpha, zero = slabs.facets.alpha, 0.0 * wide
    out, into = energy_compensation.column_of(cosines[0], alpha), energy_compensation.column_of(cosines[1], alpha)
    spread = energy_compensation.spread_alpha(alpha)
    up = ops.minimum(facing * facing, 1.0)
    y = spread * spread * up / (1.0 - up + spread * spread * up)
    factor, s, v, c = further_bounces.pair(slabs.table.pairs, out, into, alpha, y)
    color = further_bounces.colour(slabs.color, zero + 1.0, slabs.bend, alpha, s, v, c)
    return ops.scale(color, wide * factor)


@helper
def metal_reflectance(slabs: Slabs, cosine: Lane) -> Vec:
    """The F82-tint model: Schlick's approximation without its part before the grazing angle that the tint absorbs."""
    away = ops.maximum(1.0 - cosine, 0.0)
    square = away * away
    fifth = square * square * away
    dip, f0, bend = cosine * fifth * away, slabs.color, slabs.bend
    return (
        ops.maximum(f0[0] + (1.0 - f0[0]) * fifth - bend[0] * dip, 0.0), ops.maximum(f0[1] + (1.0 - f0[1]) * fifth - bend[1] * dip, 0.0),
        ops.maximum(f0[2] + (1.0 - f0[2]) * fifth - bend[2] * dip, 0.0),
    )  # fmt: skip


@helper
def _dielectric_reflectance(slabs: Slabs, cosine: Lane) -> Lane:
    return _within(slabs.passage, dielectric_albedo.reflectance(cosine, slabs.step), cosine)


@helper
def _base_reflectance(slabs: Slabs, cosine: Lane) -> Vec:
    """Fresnel's reflectance of the base's facets."""
    plain = (1.0 - slabs.metal) * _dielectric_reflectance(slabs, cosine)
    metal, share, tint = metal_reflectance(slabs, cosine), slabs.metal * slabs.gleam, slabs.tint
    bare = share * metal[0] + plain * tint[0], share * metal[1] + plain * tint[1], share * metal[2] + plain * tint[2]
    return thin_film.reflected(slabs.film, bare, slabs, cosine, metal)


@helper
def _mean_passing(passes: Vec, base: Lane) -> Lane:
    return ops.minimum(ops.mean3(passes) * base, 1.0)


_passing = specialize_if_present(_mean_passing)  # Seen.passes, 1 − R: what the boundary lets through, with a film


@helper
def _passing_from_inside(passage: Passage, plain: Lane, alpha: Lane) -> Lane:
    return ops.where(passage.inside, ops.lerp(plain, 0.0 * plain + 0.5, ops.minimum(ops.sqrt(alpha), 0.9)), plain)


_blurred = specialize_if_present(_passing_from_inside)  # passage, share that passes, α: for probabilities, also past the critical angle


@helper
def _passage_chances(
    passage: Passage, plain: tuple[Lane, Lane, Lane], slabs: Slabs, past: Lane, below: Lane, normal: Vec, to_viewer: Vec
) -> tuple[Lane, Lane, Lane]:
    tint, sides = ops.mean3(passage.tint), slab_passage.mean_lost_shares(passage, slabs)[2]
    lost = slab_passage.lost_share(passage, slabs, normal, to_viewer, ops.bool_like(past, False))
    lost = lost * below * passage.share
    through = ops.maximum(past * passage.share - lost, 0.05 * past * passage.share)
    return through * tint, lost * (1.0 - sides + sides * tint), past * passage.diffuse * ops.mean3(passage.diffuse_tint)


_passing_chances = specialize_if_present(_passage_chances)
"""passage, zeros, slabs, what gets past the boundary, what arrives there, normal, viewer: (through, spread, body)."""


@helper
def chances(slabs: Slabs, normal: Vec, to_viewer: Vec) -> tuple[Chances, Seen]:
    """(the probabilities by which lobes are sampled for a viewer, what the slabs do with light from it)."""
    cosine = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    out = seen_from(slabs, normal, to_viewer, ops.bool_like(cosine, False))
    fibres = slabs.fuzz * fuzz.albedo(cosine, slabs.fuzz_roughness)
    under = 1.0 - fibres
    below = under * (1.0 - out.coat) * ops.mean3(ops.mul(slabs.dark, _absorbed(slabs, 2.0 * out.path)))
    share = slabs.metal * slabs.gleam
    passes = _blurred(slabs.passage, _passing(out.passes, 1.0 - out.base), slabs.facets.alpha)
    shine = share * ops.mean3(out.bright) + (1.0 - slabs.metal) * (1.0 - passes) * ops.mean3(slabs.tint)
    past = below * (1.0 - slabs.metal) * passes
    matt, again = _opaque(slabs.passage, 0.0 * cosine + 1.0) * past * ops.mean3(slabs.color), share * out.lost * ops.mean3(slabs.color)
    dielectric, none = below * (1.0 - slabs.metal), (0.0 * cosine, 0.0 * cosine, 0.0 * cosine)
    through, spread, body = _passing_chances(slabs.passage, none, slabs, past, dielectric, normal, to_viewer)
    fuzzy = fibres * ops.mean3(slabs.fuzz_color)
    return Chances(under * out.coat, below * shine, below * again, through, spread, fuzzy, matt, body), out


@helper
def shine_total(chance: Chances) -> Lane:
    """The sum of the chances of the highlights."""
    return chance.coat + chance.highlight + chance.again + chance.through + chance.spread


@helper
def total(chance: Chances) -> Lane:
    """The sum of all chances."""
    return shine_total(chance) + chance.fuzz + chance.matt + chance.body


@separate_helper
def evaluate(slabs: Slabs, normal: Vec, to_light: Vec, to_viewer: Vec) -> Values:
    """All lobes for a pair of directions; 0 where the light is below the surface."""
    cos_in, cos_out = ops.dot(normal, to_light), ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    lit = cos_in > 0.0
    cos_in, zero = ops.clip(cos_in, LEAST, 1.0), 0.0 * cos_in
    cos_lit = ops.where(lit, cos_in, zero)
    chance, out = chances(slabs, normal, to_viewer)
    into = seen_from(slabs, normal, _image(slabs.passage, to_light, normal), ops.not_(lit))
    half = ops.normalize(ops.add(to_light, to_viewer))
    along = ops.clip(ops.dot(half, to_viewer), 0.0, 1.0)
    under = 1.0 - slabs.fuzz * fuzz.albedo(cos_out, slabs.fuzz_roughness)
    below = ops.scale(ops.mul(slabs.dark, _absorbed(slabs, out.path + into.path)), under)
    least = 1.0 - ops.maximum(out.coat, into.coat)

    strength, reach_out, seen = _facets_seen(slabs.facets, normal, half, to_light, to_viewer, (cos_out, cos_in))
    strength, size = flakes.shifted(slabs.flake, (strength, cos_out + reach_out), slabs.facets, normal, half, to_viewer)
    strength = ops.where(lit, strength, zero)
    shine = ops.scale(_base_reflectance(slabs, along), math.pi * cos_in * strength * seen * least)
    glossy = chance.highlight * strength * 0.5 / size
    if ops.any_lane(slabs.metal > 0.0):
        wide = energy_compensation.spread_alpha(slabs.facets.alpha)
        spread = ops.where(lit, microfacet.ggx_distribution(half, normal, wide), zero)
        more = math.pi * cos_in * spread * microfacet.smith_visibility(cos_out, cos_in, wide) * out.again * into.again
        again = _further(slabs, (cos_out, cos_in), ops.dot(half, normal), more * least * slabs.metal * slabs.gleam)
        shine = ops.add(shine, again)
        glossy = glossy + chance.again * spread * 0.5 / (cos_out + ops.sqrt(wide * wide + (1.0 - wide * wide) * cos_out * cos_out))
    shine = ops.mul(shine, below)
    if ops.any_lane(slabs.coat > 0.0):
        outer = anisotropic_facets.coat_normal(slabs.coat_normal, normal)
        above, steep = ops.dot(outer, to_light), ops.clip(ops.dot(outer, to_viewer), LEAST, 1.0)
        into_coat = ops.clip(above, LEAST, 1.0)
        strength, reach_out, seen = _facets_seen(slabs.coat_facets, outer, half, to_light, to_viewer, (steep, into_coat))
        strength = ops.where(above > 0.0, strength, zero)
        coat = slabs.coat * under * math.pi * into_coat * strength * seen * dielectric_albedo.reflectance(along, slabs.coat_step)
        shine = ops.add(shine, (coat, coat, coat))
        glossy = glossy + chance.coat * strength * 0.5 / (steep + reach_out)

    opening = _open_on_side(slabs.passage, _opening(slabs), slabs)
    passed = (1.0 - slabs.metal) * (1.0 - out.base) * (1.0 - into.base) * (1.0 - out.coat) * (1.0 - into.coat) / opening
    matt = oren_nayar.value(slabs.color, slabs.diffuse_roughness, cos_in, cos_out, ops.dot(to_light, to_viewer))
    matt = thin_film.past(out.passes, ops.mul(ops.scale(matt, passed * cos_lit), below), into.passes)
    matt = ops.scale(matt, _opaque(slabs.passage, zero + 1.0))
    directions = normal, to_light, to_viewer
    shine, matt, glossy, body = _passed(slabs.passage, (shine, matt, glossy, zero), slabs, directions, (out, into), chance, under)
    density = glossy + body + chance.matt * cos_lit * (1.0 / math.pi)
    if ops.any_lane(slabs.fuzz > 0.0):
        spread = fuzz.density(slabs.fuzz_roughness, normal, to_light, to_viewer)
        matt = ops.add(matt, ops.scale(slabs.fuzz_color, (1.0 - under) * math.pi * spread))
        density = density + chance.fuzz * spread
    return Values(
        matt, shine, density / ops.maximum(total(chance), LEAST), glossy / ops.maximum(shine_total(chance), LEAST)
    )  # fmt: skip


@helper
def _other_side(
    passage: Passage, plain: tuple[Vec, Vec, Lane, Lane], slabs: Slabs, directions: Any, seen: tuple[Seen, Seen], chance: Chances,
    under: Lane,
) -> tuple[Vec, Vec, Lane, Lane]:  # fmt: skip
    """(highlights with refracted light, diffuse lobes with light that passes diffusely, density of highlights, of the latter)."""
    normal, to_light, to_viewer = directions
    out, into = seen
    shine, matt, glossy, _ = plain
    zero = 0.0 * glossy
    below = ops.scale(_absorbed(slabs, out.path), under * (1.0 - slabs.metal) * (1.0 - out.coat))
    value, density = slab_passage.refraction(passage, slabs.facets, normal, to_light, to_viewer)
    facing = ops.clip(ops.dot(slab_passage.facing_normal(passage, normal, to_light, to_viewer), to_viewer), 0.0, 1.0)
    rest = 1.0 - _dielectric_reflectance(slabs, facing)
    color = thin_film.rest(slabs.film, (rest, rest, rest), slabs, facing)
    shine = ops.add(shine, ops.mul(ops.scale(ops.mul(color, passage.tint), passage.share * value), below))
    cosine = ops.maximum(-ops.dot(normal, to_light), 0.0)
    gets = (1.0 - out.base) * ops.where(passage.inside, (1.0 - into.base) / _opening(slabs), 1.0)
    body = thin_film.past(out.passes, ops.mul(ops.scale(passage.diffuse_tint, passage.diffuse * gets * cosine), below), out.passes)
    lit = cosine <= 0.0
    mean, mean_other, sides = slab_passage.mean_lost_shares(passage, slabs)
    cos_in = ops.clip(ops.absolute(ops.dot(normal, to_light)), LEAST, 1.0)
    lost = slab_passage.lost_share(passage, slabs, normal, to_viewer, ops.bool_like(cos_in, False))
    lost = lost * slab_passage.lost_share(passage, slabs, normal, to_light, ops.not_(lit))
    side = ops.where(lit, 1.0 - sides, sides)
    again = passage.share * cos_in * lost * side / ops.maximum(ops.where(lit, mean, mean_other), LEAST)
    least = under * (1.0 - slabs.metal) * (1.0 - ops.maximum(out.coat, into.coat))
    above = ops.scale(ops.mul(slabs.dark, _absorbed(slabs, out.path + into.path)), least)
    shine = ops.add(shine, ops.scale(ops.where3(lit, above, ops.mul(below, passage.tint)), again))
    tint = ops.where(lit, zero + 1.0, ops.mean3(passage.tint))
    spread = chance.spread * side * tint / ops.maximum(1.0 - sides + sides * ops.mean3(passage.tint), LEAST)
    glossy = glossy + chance.through * density + spread * cos_in * (1.0 / math.pi)
    return shine, ops.add(matt, body), glossy, chance.body * cosine * (1.0 / math.pi) + zero


_passed = specialize_if_present(_other_side)  # see there


@helper
def _facets_seen(facets: Facets, normal: Vec, half: Vec, to_light: Vec, to_viewer: Vec, cosines: Any) -> tuple[Lane, Lane, Lane]:
    """(distribution, reach of the viewer, masking and shadowing over both cosines)."""
    strength = anisotropic_facets.distribution(facets, anisotropic_facets.to_frame(facets, normal, half))
    out = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_viewer))
    into = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_light))
    return strength, out, anisotropic_facets.visibility(cosines[0], cosines[1], out, into)


@separate_helper
def draw(slabs: Slabs, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, all_: Lane) -> tuple[Vec, Lane]:
    """(direction, whether it counts) of a lobe that `which`, 0 to 1, chooses: among all, or where not `all_`, among the highlights."""
    chance = chances(slabs, normal, to_viewer)[0]
    number = which * ops.where(all_, total(chance), shine_total(chance))
    on_coat, further, past = number < chance.coat, number - chance.coat >= chance.highlight, number - shine_total(chance)
    wide = energy_compensation.spread_alpha(slabs.facets.alpha)
    base, coat = slabs.facets, slabs.coat_facets
    passing = number - chance.coat >= chance.highlight + chance.again
    round_ = further & ops.not_(on_coat | passing)
    chosen = Facets(
        ops.where3(on_coat, coat.along, base.along), ops.where3(on_coat, coat.across, base.across),
        ops.where(round_, wide, ops.where(on_coat, coat.first, base.first)),
        ops.where(round_, wide, ops.where(on_coat, coat.second, base.second)), wide,
    )  # fmt: skip
    outer = anisotropic_facets.facets_normal(slabs.coat_normal, normal, on_coat)
    half = anisotropic_facets.sample_visible_normal(chosen, outer, to_viewer, u, v)
    half = flakes.tilted(slabs.flake, half, base, normal, to_viewer, u, v, on_coat | further)
    direction = _through(slabs.passage, ops.reflect(ops.negate(to_viewer), half), passing, normal, half, to_viewer)
    sinks = (past >= chance.fuzz + chance.matt) & (chance.body > 0.0)
    s, t = ops.basis(normal)
    flat, turn, height = ops.sqrt(ops.clip(u, 0.0, 1.0)), (2.0 * math.pi) * v, ops.sqrt(ops.maximum(1.0 - u, 0.0))
    spread = passing & (past < 0.0) & (past >= -chance.spread)
    leaves = spread & _goes_through(slabs.passage, sinks, slabs, past, chance.spread)
    matt = ops.in_basis(s, t, normal, flat * ops.cos(turn), flat * ops.sin(turn), ops.where(sinks | leaves, -height, height))
    if ops.any_lane(slabs.fuzz > 0.0):
        matt = ops.where3((past < chance.fuzz) & ops.not_(spread), fuzz.sample(slabs.fuzz_roughness, normal, to_viewer, u, v), matt)
    direction = ops.where3((past >= 0.0) | spread, matt, direction)
    meant = sinks | (passing & (past < 0.0) & ops.not_(spread)) | leaves
    return direction, (ops.dot(direction, outer) < 0.0) == meant


@helper
def _is_through(passage: Passage, plain: Lane, slabs: Slabs, past: Lane, chance: Lane) -> Lane:
    tint, sides = ops.mean3(passage.tint), slab_passage.mean_lost_shares(passage, slabs)[2]
    return past + chance < chance * sides * tint / ops.maximum(1.0 - sides + sides * tint, LEAST)


_goes_through = specialize_if_present(_is_through)  # passage, a mask, slabs, number below 0, chance: whether to the other side


@helper
def _refracted(passage: Passage, direction: Vec, passing: Lane, normal: Vec, half: Vec, to_viewer: Vec) -> Vec:
    return ops.where3(passing, slab_passage.refract(passage, normal, half, to_viewer), direction)


_through = specialize_if_present(_refracted)  # passage, the reflected direction, whether it passes, normal, facet, viewer
