"""Slabs of OpenPBR Surface: fuzz over a coat over a base, which is a mix of a metal and of a dielectric over a diffuse lobe.

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

from ..jit.kernel import helper, noinline_helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import anisotropic_facets, dielectric_albedo, energy_compensation, fuzz, microfacet, oren_nayar, thin_film
from .anisotropic_facets import Facets

LEAST = 1e-7
UNEVEN = 0.28, 0.03  # greatest gain by round facets in place of lines: of further bounces of a metal, of what passes a dielectric
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


class Film(NamedTuple):
    """A thin film between the coat and the base."""

    weight: Lane
    thickness: Lane  # micrometres
    ratio: Lane  # index of refraction relative to what lies over it
    f0: Vec  # √ of the metal's reflectance at normal incidence, below 1


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
    fuzz: Lane
    matt: Lane


class Values(NamedTuple):
    """π f cos of two directions, and densities of samples."""

    matt: Vec  # of the diffuse lobe and fuzz
    shine: Vec
    density: Lane  # of `draw` among all lobes
    shine_density: Lane  # of `draw` among the highlights


@helper
def seen_from(slabs: Slabs, normal: Vec, direction: Vec) -> Seen:
    """What the slabs do with light of a direction; below the surface, as of a grazing one."""
    cosine = ops.clip(ops.dot(normal, direction), LEAST, 1.0)
    zero, alpha = 0.0 * cosine, anisotropic_facets.alpha_seen(slabs.facets, normal, direction)
    base = dielectric_albedo.directional(slabs.reflection, cosine, alpha, slabs.step)
    coat, path, lost, again, bright = zero, zero + 1.0, zero, zero, (zero, zero, zero)
    if ops.any_lane(slabs.coat > 0.0):
        over = anisotropic_facets.alpha_seen(slabs.coat_facets, normal, direction)
        coat = slabs.coat * dielectric_albedo.directional(slabs.reflection, cosine, over, slabs.coat_step)
        sine = ops.maximum(1.0 - cosine * cosine, 0.0)
        path = 1.0 / ops.sqrt(ops.maximum(1.0 - sine / (slabs.coat_ratio * slabs.coat_ratio), 0.01))
    if ops.any_lane(slabs.metal > 0.0):
        e, b = energy_compensation.directional_albedo(slabs.table, cosine, alpha)
        lost, again = 1.0 - e, energy_compensation.further_bounces(slabs.table, cosine, alpha)
        f0 = slabs.color
        bright = f0[0] * (e - b) + b, f0[1] * (e - b) + b, f0[2] * (e - b) + b
    return Seen(base, coat, path, lost, again, bright, _film_passes(slabs.film, None, slabs, cosine, alpha, base))


@helper
def _absorbed(slabs: Slabs, path: Lane) -> Vec:
    """The factor of light below the coat that goes `path` in it."""
    zero = 0.0 * path
    if ops.not_(ops.any_lane(slabs.coat > 0.0)):
        return (zero + 1.0, zero + 1.0, zero + 1.0)
    log, dark = slabs.coat_log, slabs.dark
    passed = ops.exp(log[0] * path), ops.exp(log[1] * path), ops.exp(log[2] * path)
    return ops.mul(dark, ops.lerp3((zero + 1.0, zero + 1.0, zero + 1.0), passed, slabs.coat))


@helper
def _opening(slabs: Slabs) -> Lane:
    """The mean of what both boundaries let through, more for a rough base, which sends more light along the normal than Lambert's."""
    mean, deviation = dielectric_albedo.means(slabs.reflection, slabs.facets.alpha, slabs.step)
    open_ = 1.0 - mean + ROUGH_EXCESS * slabs.diffuse_roughness * deviation
    if ops.any_lane(slabs.coat > 0.0):
        coat, coat_deviation = dielectric_albedo.means(slabs.reflection, slabs.coat_facets.alpha, slabs.coat_step)
        open_ = open_ * (1.0 - slabs.coat * coat) + slabs.coat * deviation * coat_deviation  # both are correlated
    return ops.maximum(open_ * (1.0 + UNEVEN[1] * _unevenness(slabs.facets)), LEAST)


@helper
def _unevenness(facets: Facets) -> Lane:
    """0 of round or polished facets, 1 of rough lines."""
    ratio = facets.second / facets.first
    return ops.minimum(facets.alpha * (1.0 / 0.3), 1.0) * ops.sqrt(ops.maximum(1.0 - ratio * ratio, 0.0))


@helper
def _bounced(slabs: Slabs) -> Vec:
    """Of a metal, the share of the lost energy that further bounces return."""
    leaves, f0, bend = energy_compensation.escape(slabs.facets.alpha), slabs.color, slabs.bend
    rest = 1.0 - UNEVEN[0] * _unevenness(slabs.facets)
    return rest * _again(f0[0], bend[0], leaves), rest * _again(f0[1], bend[1], leaves), rest * _again(f0[2], bend[2], leaves)


@helper
def _again(f0: Lane, bend: Lane, leaves: Lane) -> Lane:
    mean = ops.clip(f0 + (1.0 - f0) * (1.0 / 21.0) - bend * (1.0 / 126.0), 0.0, 1.0)
    return mean * mean * leaves / (1.0 - mean * (1.0 - leaves))


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
def _base_reflectance(slabs: Slabs, cosine: Lane) -> Vec:
    """Fresnel's reflectance of the base's facets."""
    plain = (1.0 - slabs.metal) * dielectric_albedo.reflectance(cosine, slabs.step)
    metal, share, tint = metal_reflectance(slabs, cosine), slabs.metal * slabs.gleam, slabs.tint
    bare = share * metal[0] + plain * tint[0], share * metal[1] + plain * tint[1], share * metal[2] + plain * tint[2]
    return _under_film(slabs.film, bare, slabs, cosine, metal)


@helper
def _filmed(film: Film, bare: Vec, slabs: Slabs, cosine: Lane, metal: Vec) -> Vec:
    """The reflectance of the base's facets with a film of a weight."""
    plain = _film_over_dielectric(film, slabs, cosine)
    glossy, f0 = thin_film.reflectance(cosine, film.ratio, film.thickness, _indices(film.f0)), slabs.color
    fifth = ops.power(ops.maximum(1.0 - cosine, 0.0), 5.0)
    share, tint = slabs.metal * slabs.gleam, slabs.tint
    both = (
        share * glossy[0] * _edge(metal[0], f0[0], fifth) + (1.0 - slabs.metal) * plain[0] * tint[0],
        share * glossy[1] * _edge(metal[1], f0[1], fifth) + (1.0 - slabs.metal) * plain[1] * tint[1],
        share * glossy[2] * _edge(metal[2], f0[2], fifth) + (1.0 - slabs.metal) * plain[2] * tint[2],
    )  # fmt: skip
    return ops.lerp3(bare, both, film.weight)


@helper
def _edge(metal: Lane, f0: Lane, fifth: Lane) -> Lane:
    """What the tint of a metal leaves of Schlick's reflectance."""
    return ops.minimum(metal / ops.maximum(f0 + (1.0 - f0) * fifth, 1e-4), 1.0)


@helper
def _indices(root: Vec) -> Vec:
    """The real index of refraction with a reflectance of root² at normal incidence."""
    return (1.0 + root[0]) / (1.0 - root[0]), (1.0 + root[1]) / (1.0 - root[1]), (1.0 + root[2]) / (1.0 - root[2])


@helper
def _film_over_dielectric(film: Film, slabs: Slabs, cosine: Lane) -> Vec:
    return thin_film.reflectance(cosine, film.ratio, film.thickness, _indices((slabs.step, slabs.step, slabs.step)))


@helper
def _film_lets_through(film: Film, plain: Any, slabs: Slabs, cosine: Lane, alpha: Lane, base: Lane) -> Vec:
    """What passes a film of rough facets to a diffuse base, over 1 − R: the film's reflectance at a middle angle scales R."""
    middle = cosine + 0.5 * alpha * (1.0 - cosine)
    bare = ops.maximum(dielectric_albedo.reflectance(middle, slabs.step), 1e-3)
    tinted = _film_over_dielectric(film, slabs, middle)
    scale, over = ops.maximum(base, 1e-3) / bare, 1.0 / ops.maximum(1.0 - base, LEAST)
    return (
        _let_through(tinted[0] * scale, base, over, film.weight), _let_through(tinted[1] * scale, base, over, film.weight),
        _let_through(tinted[2] * scale, base, over, film.weight),
    )  # fmt: skip


@helper
def _let_through(reflected: Lane, base: Lane, over: Lane, weight: Lane) -> Lane:
    return ops.maximum(1.0 - ops.lerp(base, reflected, weight), 0.0) * over


_under_film = specialize_if_present(_filmed)  # film, the reflectance without it, slabs, cosine, the metal's reflectance
_film_passes = specialize_if_present(_film_lets_through)  # film, None, slabs, cosine, α, R: `Seen.passes`


@helper
def _least_of(passes: Vec, light: Vec, other: Vec) -> Vec:
    least = ops.minimum(passes[0], other[0]), ops.minimum(passes[1], other[1]), ops.minimum(passes[2], other[2])
    return ops.mul(light, least)


_past_film = specialize_if_present(_least_of)  # what passes by one direction, light below, what passes by the other

@helper
def chances(slabs: Slabs, out: Seen, cosine: Lane) -> Chances:
    """The probabilities by which lobes are sampled for a viewer."""
    fibres = slabs.fuzz * fuzz.albedo(cosine, slabs.fuzz_roughness)
    under = 1.0 - fibres
    below = under * (1.0 - out.coat) * ops.mean3(_absorbed(slabs, 2.0 * out.path))
    share = slabs.metal * slabs.gleam
    shine = share * ops.mean3(out.bright) + (1.0 - slabs.metal) * out.base * ops.mean3(slabs.tint)
    matt = (1.0 - slabs.metal) * (1.0 - out.base) * ops.mean3(slabs.color)
    again = share * out.lost * ops.mean3(slabs.color)
    return Chances(under * out.coat, below * shine, below * again, fibres * ops.mean3(slabs.fuzz_color), below * matt)


@helper
def shine_total(chance: Chances) -> Lane:
    """The sum of the chances of the highlights."""
    return chance.coat + chance.highlight + chance.again


@helper
def total(chance: Chances) -> Lane:
    """The sum of all chances."""
    return chance.coat + chance.highlight + chance.again + chance.fuzz + chance.matt


@noinline_helper
def evaluate(slabs: Slabs, normal: Vec, to_light: Vec, to_viewer: Vec) -> Values:
    """All lobes for a pair of directions; 0 where the light is below the surface."""
    cos_in, cos_out = ops.dot(normal, to_light), ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    lit = cos_in > 0.0
    cos_in, zero = ops.clip(cos_in, LEAST, 1.0), 0.0 * cos_in
    cos_lit = ops.where(lit, cos_in, zero)
    out, into = seen_from(slabs, normal, to_viewer), seen_from(slabs, normal, to_light)
    chance = chances(slabs, out, cos_out)
    half = ops.normalize(ops.add(to_light, to_viewer))
    along = ops.clip(ops.dot(half, to_viewer), 0.0, 1.0)
    under = 1.0 - slabs.fuzz * fuzz.albedo(cos_out, slabs.fuzz_roughness)
    below = ops.scale(_absorbed(slabs, out.path + into.path), under)
    least = 1.0 - ops.maximum(out.coat, into.coat)

    strength, reach_out, seen = _facets_seen(slabs.facets, normal, half, to_light, to_viewer, (cos_out, cos_in))
    strength = ops.where(lit, strength, zero)
    shine = ops.scale(_base_reflectance(slabs, along), math.pi * cos_in * strength * seen * least)
    glossy = chance.highlight * strength * 0.5 / (cos_out + reach_out)
    if ops.any_lane(slabs.metal > 0.0):
        wide = energy_compensation.spread_alpha(slabs.facets.alpha)
        spread = ops.where(lit, microfacet.ggx_distribution(half, normal, wide), zero)
        more = math.pi * cos_in * spread * microfacet.smith_visibility(cos_out, cos_in, wide) * out.again * into.again
        shine = ops.add(shine, ops.scale(_bounced(slabs), more * least * slabs.metal * slabs.gleam))
        glossy = glossy + chance.again * spread * 0.5 / (cos_out + ops.sqrt(wide * wide + (1.0 - wide * wide) * cos_out * cos_out))
    shine = ops.mul(shine, below)
    if ops.any_lane(slabs.coat > 0.0):
        strength, reach_out, seen = _facets_seen(slabs.coat_facets, normal, half, to_light, to_viewer, (cos_out, cos_in))
        strength = ops.where(lit, strength, zero)
        coat = slabs.coat * under * math.pi * cos_in * strength * seen * dielectric_albedo.reflectance(along, slabs.coat_step)
        shine = ops.add(shine, (coat, coat, coat))
        glossy = glossy + chance.coat * strength * 0.5 / (cos_out + reach_out)

    passed = (1.0 - slabs.metal) * (1.0 - out.base) * (1.0 - into.base) * (1.0 - out.coat) * (1.0 - into.coat) / _opening(slabs)
    matt = oren_nayar.value(slabs.color, slabs.diffuse_roughness, cos_in, cos_out, ops.dot(to_light, to_viewer))
    matt = _past_film(out.passes, ops.mul(ops.scale(matt, passed * cos_lit), below), into.passes)
    density = glossy + chance.matt * cos_lit * (1.0 / math.pi)
    if ops.any_lane(slabs.fuzz > 0.0):
        spread = fuzz.density(slabs.fuzz_roughness, normal, to_light, to_viewer)
        matt = ops.add(matt, ops.scale(slabs.fuzz_color, (1.0 - under) * math.pi * spread))
        density = density + chance.fuzz * spread
    return Values(
        matt, shine, density / ops.maximum(total(chance), LEAST), glossy / ops.maximum(shine_total(chance), LEAST)
    )  # fmt: skip


@helper
def _facets_seen(facets: Facets, normal: Vec, half: Vec, to_light: Vec, to_viewer: Vec, cosines: Any) -> tuple[Lane, Lane, Lane]:
    """(distribution, reach of the viewer, masking and shadowing over both cosines)."""
    strength = anisotropic_facets.distribution(facets, anisotropic_facets.to_frame(facets, normal, half))
    out = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_viewer))
    into = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_light))
    return strength, out, anisotropic_facets.visibility(cosines[0], cosines[1], out, into)


@noinline_helper
def draw(slabs: Slabs, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, all_: Lane) -> Vec:
    """A direction of a lobe that `which`, 0 to 1, chooses: among all lobes, or where not `all_`, among the highlights."""
    cosine = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    chance = chances(slabs, seen_from(slabs, normal, to_viewer), cosine)
    number = which * ops.where(all_, total(chance), shine_total(chance))
    on_coat, further, past = number < chance.coat, number - chance.coat >= chance.highlight, number - shine_total(chance)
    wide = energy_compensation.spread_alpha(slabs.facets.alpha)
    base, coat = slabs.facets, slabs.coat_facets
    round_ = further & ops.not_(on_coat)
    chosen = Facets(
        ops.where3(on_coat, coat.along, base.along), ops.where3(on_coat, coat.across, base.across),
        ops.where(round_, wide, ops.where(on_coat, coat.first, base.first)),
        ops.where(round_, wide, ops.where(on_coat, coat.second, base.second)), wide,
    )  # fmt: skip
    half = anisotropic_facets.sample_visible_normal(chosen, normal, to_viewer, u, v)
    direction = ops.reflect(ops.negate(to_viewer), half)
    s, t = ops.basis(normal)
    flat, turn, height = ops.sqrt(ops.clip(u, 0.0, 1.0)), (2.0 * math.pi) * v, ops.sqrt(ops.maximum(1.0 - u, 0.0))
    matt = ops.in_basis(s, t, normal, flat * ops.cos(turn), flat * ops.sin(turn), height)
    if ops.any_lane(slabs.fuzz > 0.0):
        matt = ops.where3(past < chance.fuzz, fuzz.sample(slabs.fuzz_roughness, normal, to_viewer, u, v), matt)
    return ops.where3(past >= 0.0, matt, direction)
