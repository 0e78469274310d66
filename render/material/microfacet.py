"""Microfacet highlights: GGX over a matt base and under a clear coat, with all the light that bounces between facets kept.

- Facets: GGX with Smith's height-correlated shadowing (Walter et al. 2007; Heitz 2014, Understanding the Masking-Shadowing Function),
  drawn as they are seen (Dupuy and Benyoub 2023, Sampling Visible GGX Normals with Spherical Caps), so that no sample weighs above 1.
- Fresnel: Schlick's law, and for metals Lazányi and Szirmay-Kalos' term less, which gives the dip before the grazing angle as it is
  (Hoffman 2019, Fresnel Equations Considered Harmful): f0 + (f90 − f0)(1 − c)⁵ − bend c (1 − c)⁶.
- Light that bounces more than once between facets comes back as a matt lobe (Kulla and Conty 2017, Revisiting Physically Based Shading).
- What lies under the highlight gets what that lets in, and gives what that lets out: ρ/π (1 − E(μₒ))(1 − E(μᵢ))/(1 − Ē), as in Kelemen
  and Szirmay-Kalos 2001. So a white base under any highlight is white in a white room, and each part is reciprocal.
- A coat is a highlight of index 1.5 over all that; the highlight under it counts by the lesser of what the coat lets through on both ways.

All of it is for materials whose rows say so; scenes without such compile nothing of it: their Shader's `lobes` is None, which is a type.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ...compiler.plan import scene_facts
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..types import Lane, Vec
from . import energy_compensation

SHARP = 1e-3  # α below which a highlight is a mirror's: nothing in a picture is so narrow
POLISHED = scene_facts.POLISHED**2  # α below which things can be told in a highlight
METALLIC = 0.1  # reflectance along the normal beyond that of what is no metal: of an index of 1.92
COAT = 0.04  # reflectance of a coat along its normal: index 1.5
GRAZING = 50.0  # times f0 is the most that a highlight reflects at grazing angles: what has no boundary has no highlight
LEAST = 1e-7


class Lobes(NamedTuple):
    """What a material with microfacets is at a point."""

    here: Lane  # bool: the material is one; else nothing of this counts
    sharp: Lane  # bool: its highlight is a mirror's, and followed as such
    base: Vec  # matt reflectance under the highlights
    f0: Vec  # reflectance of facets along their normal
    f90: Lane
    bend: Vec  # see above
    alpha: Lane  # roughness of facets
    coat: Lane  # 0 to 1: how much of a coat there is
    coat_alpha: Lane
    table: energy_compensation.Albedo


class Sight(NamedTuple):
    """What highlights do with light of one direction."""

    highlight: Vec  # reflectance of the highlight by one and by more bounces
    lost: Lane  # 1 − E: what one bounce alone would lose of it
    coat: Lane  # reflectance of the coat


# --- facets --------------------------------------------------------------------------------------------------------------


@helper
def fresnel(lobes: Lobes, cosine: Lane) -> Vec:
    """What facets reflect of light that meets them under this cosine."""
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
    """GGX: facets a steradian about `half`, by their area as seen along the normal. The sine comes from a cross product, which keeps
    its digits where facets are nearly flat."""
    across = ops.cross(normal, half)
    cosine = ops.dot(normal, half)
    square = alpha * alpha
    size = ops.dot(across, across) + square * cosine * cosine
    return ops.where(cosine > 0.0, square / (math.pi * ops.maximum(size * size, 1e-30)), 0.0)


@helper
def _reach(cosine: Lane, alpha: Lane) -> Lane:
    """√(α² + (1 − α²) cos²): cos times 1 + 2 Λ of Smith's function."""
    square = alpha * alpha
    return ops.sqrt(square + (1.0 - square) * cosine * cosine)


@helper
def smith_visibility(out: Lane, into: Lane, alpha: Lane) -> Lane:
    """What is neither hidden nor in shadow of facets, over 4 times both cosines."""
    return 0.5 / ops.maximum(out * _reach(into, alpha) + into * _reach(out, alpha), LEAST * LEAST)


@helper
def sample_visible_normal(normal: Vec, to_viewer: Vec, alpha: Lane, u: Lane, v: Lane) -> Vec:
    """The normal of a facet as the viewer sees them (Dupuy and Benyoub 2023)."""
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
def _bounced(lobes: Lobes, mean: Lane) -> Vec:
    """What of the light that one bounce loses comes back by further ones: F̄² Ē / (1 − F̄ (1 − Ē)) over its own mean, 1 − Ē."""
    f0, bend = lobes.f0, lobes.bend
    return _of_mean(f0[0], lobes.f90, bend[0], mean), _of_mean(f0[1], lobes.f90, bend[1], mean), _of_mean(f0[2], lobes.f90, bend[2], mean)


@helper
def _of_mean(f0: Lane, f90: Lane, bend: Lane, mean: Lane) -> Lane:
    reflected = f0 + (f90 - f0) * (1.0 / 21.0) - bend * (1.0 / 126.0)
    return reflected * reflected * mean / (1.0 - reflected * (1.0 - mean))


@helper
def _split(lobes: Lobes, e: Lane, b: Lane, bounced: Vec) -> Vec:
    """What a highlight reflects, from its E and B."""
    a, lost, f0 = e - b, 1.0 - e, lobes.f0
    return (
        f0[0] * a + lobes.f90 * b + bounced[0] * lost, f0[1] * a + lobes.f90 * b + bounced[1] * lost,
        f0[2] * a + lobes.f90 * b + bounced[2] * lost,
    )  # fmt: skip


@helper
def directional_albedo(lobes: Lobes, cosine: Lane, bounced: Vec) -> Sight:
    """What the highlights do with light under a cosine."""
    e, b = energy_compensation.seen(lobes.table, cosine, lobes.alpha)
    coat = 0.0 * cosine
    if ops.any_lane(lobes.coat > 0.0):
        whole, grazing = energy_compensation.seen(lobes.table, cosine, lobes.coat_alpha)
        coat = lobes.coat * (COAT * (whole - grazing) + grazing)
    return Sight(_split(lobes, e, b, bounced), 1.0 - e, coat)


class Layers(NamedTuple):
    """What is the same for all directions."""

    mean: Lane  # Ē of the highlight
    bounced: Vec
    open: Vec  # mean of what highlights let in and out again


@helper
def layers(lobes: Lobes) -> Layers:
    """The means of a material's highlights."""
    mean, grazing, deviation = energy_compensation.means(lobes.table, lobes.alpha)
    bounced = _bounced(lobes, mean)
    whole = _split(lobes, mean, grazing, bounced)
    one = 1.0 + 0.0 * mean
    passes = ops.sub((one, one, one), whole)
    if ops.any_lane(lobes.coat > 0.0):
        coat_mean, coat_grazing, coat_deviation = energy_compensation.means(lobes.table, lobes.coat_alpha)
        of_coat = 1.0 - lobes.coat * (COAT * (coat_mean - coat_grazing) + coat_grazing)
        together = lobes.coat * (1.0 - COAT) * deviation * coat_deviation  # both let less in where the other does
        f0 = lobes.f0
        passes = (
            passes[0] * of_coat + together * (lobes.f90 - f0[0]), passes[1] * of_coat + together * (lobes.f90 - f0[1]),
            passes[2] * of_coat + together * (lobes.f90 - f0[2]),
        )  # fmt: skip
    return Layers(mean, bounced, passes)


@helper
def _under(lobes: Lobes, all_: Layers, out: Sight, into: Sight) -> Vec:
    """Reflectance of the matt part for two directions: of the base, and of light that bounced between facets."""
    coats = (1.0 - out.coat) * (1.0 - into.coat)
    least = 1.0 - ops.maximum(out.coat, into.coat)
    again = least * out.lost * into.lost / ops.maximum(1.0 - all_.mean, LEAST)
    matt = lobes.base
    return (
        _matt(matt[0], coats, out.highlight[0], into.highlight[0], all_.open[0]) + all_.bounced[0] * again,
        _matt(matt[1], coats, out.highlight[1], into.highlight[1], all_.open[1]) + all_.bounced[1] * again,
        _matt(matt[2], coats, out.highlight[2], into.highlight[2], all_.open[2]) + all_.bounced[2] * again,
    )


@helper
def _matt(base: Lane, coats: Lane, out: Lane, into: Lane, open_: Lane) -> Lane:
    return base * coats * (1.0 - out) * (1.0 - into) / ops.maximum(open_, LEAST)


# --- what surfaces do with light -----------------------------------------------------------------------------------------


class Found(NamedTuple):
    """Shares of the parts of a material for two directions, π f cos each, and densities with which they are drawn."""

    matt: Vec
    highlight: Vec
    coat: Lane
    matt_density: Lane
    highlight_density: Lane
    coat_density: Lane


@helper
def parts(lobes: Lobes, normal: Vec, to_light: Vec, to_viewer: Vec, out: Sight, all_: Layers) -> Found:
    """All parts for a pair of directions; 0 where the light is below."""
    cos_in = ops.dot(normal, to_light)
    lit = cos_in > 0.0
    cos_in = ops.clip(cos_in, LEAST, 1.0)
    cos_out = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    into = directional_albedo(lobes, cos_in, all_.bounced)
    half = ops.normalize(ops.add(to_light, to_viewer))
    along = ops.clip(ops.dot(half, to_viewer), 0.0, 1.0)
    zero = 0.0 * cos_in
    strength = ops.where(lit & ops.not_(lobes.sharp), ggx_distribution(half, normal, lobes.alpha), zero)
    least = 1.0 - ops.maximum(out.coat, into.coat)
    shine = math.pi * cos_in * strength * smith_visibility(cos_out, cos_in, lobes.alpha) * least
    density = strength * 0.5 / (cos_out + _reach(cos_out, lobes.alpha))
    coat, coat_density = zero, zero
    if ops.any_lane(lobes.coat > 0.0):
        strength = ops.where(lit, ggx_distribution(half, normal, lobes.coat_alpha), zero)
        coat = lobes.coat * math.pi * cos_in * strength * smith_visibility(cos_out, cos_in, lobes.coat_alpha) * _coat_fresnel(along)
        coat_density = strength * 0.5 / (cos_out + _reach(cos_out, lobes.coat_alpha))
    cos_lit = ops.where(lit, cos_in, zero)
    matt = ops.scale(_under(lobes, all_, out, into), cos_lit)
    return Found(matt, ops.scale(fresnel(lobes, along), shine), coat, cos_lit * (1.0 / math.pi), density, coat_density)


@helper
def viewed(lobes: Lobes, normal: Vec, to_viewer: Vec) -> tuple[Layers, Sight]:
    """What depends on the viewer alone."""
    all_ = layers(lobes)
    return all_, directional_albedo(lobes, ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0), all_.bounced)


@helper
def chances(lobes: Lobes, all_: Layers, out: Sight) -> tuple[Lane, Lane, Lane]:
    """How much the matt part, the highlight and the coat reflect to the viewer: they are followed in this proportion.

    Where the highlight is a mirror's it is not among them.
    """
    again = ops.mean3(all_.bounced) * out.lost
    whole = ops.mean3(out.highlight)
    matt = ops.mean3(lobes.base) * (1.0 - out.coat) * (1.0 - whole) + again * (1.0 - out.coat)
    shiny = ops.where(lobes.sharp, 0.0, (whole - again) * (1.0 - out.coat))
    return matt, ops.maximum(shiny, 0.0), out.coat


@helper
def _reflected(lobes: Lobes, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    all_, out = viewed(lobes, normal, to_viewer)
    found = parts(lobes, normal, to_light, to_viewer, out, all_)
    total = ops.add(ops.add(found.matt, found.highlight), (found.coat, found.coat, found.coat))
    return ops.where3(lobes.here, total, plain)


@helper
def _shared(lobes: Lobes, plain: tuple[Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec, mirror: Lane) -> tuple[Vec, Lane]:
    all_, out = viewed(lobes, normal, to_viewer)
    found = parts(lobes, normal, to_light, to_viewer, out, all_)
    total = ops.add(ops.add(found.matt, found.highlight), (found.coat, found.coat, found.coat))
    matt, shiny, coat = chances(lobes, all_, out)
    density = matt * found.matt_density + shiny * found.highlight_density + coat * found.coat_density
    density = density / ops.maximum(matt + shiny + coat + mirror, LEAST)
    return ops.where3(lobes.here, total, plain[0]), ops.where(lobes.here, density, plain[1])


@helper
def _matt_share(lobes: Lobes, plain: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.dot(normal, to_light)
    all_, out = viewed(lobes, normal, to_viewer)
    into = directional_albedo(lobes, ops.clip(cosine, LEAST, 1.0), all_.bounced)
    zero = 0.0 * cosine
    matt = ops.where3(cosine > 0.0, _under(lobes, all_, out, into), (zero, zero, zero))
    return ops.where3(lobes.here, matt, plain)


@helper
def _sample_shine(lobes: Lobes, plain: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    all_, out = viewed(lobes, normal, to_viewer)
    _, shiny, coat = chances(lobes, all_, out)
    whole = ops.maximum(shiny + coat, LEAST)
    on_coat = u * whole < coat
    again = ops.where(on_coat, u * whole / ops.maximum(coat, LEAST), (u * whole - coat) / ops.maximum(shiny, LEAST))
    half = sample_visible_normal(normal, to_viewer, ops.where(on_coat, lobes.coat_alpha, lobes.alpha), ops.clip(again, 0.0, 1.0), v)
    direction = ops.reflect(ops.negate(to_viewer), half)
    found = parts(lobes, normal, direction, to_viewer, out, all_)
    density = (shiny * found.highlight_density + coat * found.coat_density) / whole
    share = ops.add(found.highlight, (found.coat, found.coat, found.coat))
    factor = ops.where(density > 0.0, 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return ops.where3(lobes.here, direction, plain[0]), ops.where3(lobes.here, ops.scale(share, factor), plain[1])


@helper
def _divided(lobes: Lobes, plain: tuple[Vec, Vec, Lane], normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    all_, out = viewed(lobes, normal, to_viewer)
    _, shiny, coat = chances(lobes, all_, out)
    found = parts(lobes, normal, to_light, to_viewer, out, all_)
    shine = ops.add(found.highlight, (found.coat, found.coat, found.coat))
    density = (shiny * found.highlight_density + coat * found.coat_density) / ops.maximum(shiny + coat, LEAST)
    here = lobes.here
    return ops.where3(here, found.matt, plain[0]), ops.where3(here, shine, plain[1]), ops.where(here, density, plain[2])


@helper
def _draw(lobes: Lobes, plain: Vec, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> Vec:
    all_, out = viewed(lobes, normal, to_viewer)
    matt, shiny, _ = chances(lobes, all_, out)
    shines = lobes.here & (which >= matt)
    alpha = ops.where(which < matt + shiny, lobes.alpha, lobes.coat_alpha)
    half = sample_visible_normal(normal, to_viewer, alpha, u, v)
    return ops.where3(shines, ops.reflect(ops.negate(to_viewer), half), plain)


@helper
def _whole(lobes: Lobes, plain: Lane, normal: Vec, to_viewer: Vec) -> Lane:
    all_, out = viewed(lobes, normal, to_viewer)
    matt, shiny, coat = chances(lobes, all_, out)
    return ops.where(lobes.here, matt + shiny + coat, plain)


@helper
def _mirrored(lobes: Lobes, plain: Vec, normal: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.clip(ops.dot(normal, to_viewer), 0.0, 1.0)
    out = viewed(lobes, normal, to_viewer)[1]
    found = ops.scale(fresnel(lobes, cosine), 1.0 - out.coat)
    return ops.where3(lobes.here & lobes.sharp, found, plain)


@helper
def _let_in(lobes: Lobes, plain: Vec, normal: Vec, to_viewer: Vec) -> Vec:
    out = viewed(lobes, normal, to_viewer)[1]
    rest = 1.0 - out.coat
    passed = (rest * (1.0 - out.highlight[0]), rest * (1.0 - out.highlight[1]), rest * (1.0 - out.highlight[2]))
    return ops.where3(lobes.here, ops.mul(plain, passed), plain)


@helper
def _onward(
    lobes: Lobes, plain: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, interreflection: bool
) -> tuple[Vec, Vec]:
    if ops.not_(interreflection):
        return _sample_shine(lobes, plain, normal, to_viewer, u, v)
    zero = 0.0 * u
    among = which * _whole(lobes, zero, normal, to_viewer)
    direction = _draw(lobes, plain[0], normal, to_viewer, u, v, among)
    share, density = _shared(lobes, (plain[1], zero + 1.0), normal, direction, to_viewer, zero)
    factor = ops.where(density > 0.0, 1.0 / (math.pi * ops.where(density > 0.0, density, 1.0)), 0.0)
    return direction, ops.where3(lobes.here, ops.scale(share, factor), plain[1])


@helper
def _glossy(lobes: Lobes, plain: Lane) -> Lane:
    polished = (lobes.alpha < POLISHED) | ((lobes.coat > 0.0) & (lobes.coat_alpha < POLISHED))
    return ops.where(lobes.here, polished | (ops.largest(lobes.f0) > METALLIC), plain)


# Each takes lobes, what a material without them would give, and: the normal, a direction to the light, one to the viewer.
reflected = specialize_if_present(_reflected)  # π f cos, for light of one direction
shared = specialize_if_present(
    _shared
)  # (the same, density with which `draw` takes it among all it may do): `mirror` is what is followed beside
matt_share = specialize_if_present(_matt_share)  # π f of the matt part alone
sample_shine = specialize_if_present(
    _sample_shine
)  # (direction of a highlight, its π f cos over π times its density): normal, viewer, u, v
divided = specialize_if_present(_divided)  # (π f cos of the matt part, that of the highlight, density with which `sample_shine` takes it)
draw = specialize_if_present(_draw)  # a direction: normal, viewer, u, v, and which part, from 0 to `whole`; matt where `plain` is
whole = specialize_if_present(_whole)  # what parts that `draw` follows weigh together: normal, viewer
mirrored = specialize_if_present(_mirrored)  # what sharp highlights reflect: normal, viewer
onward = specialize_if_present(
    _onward
)  # (direction, its π f cos over π times its density): normal, viewer, u, v, which part, with the matt one
glossy = specialize_if_present(_glossy)  # whether things could be told in its highlight
let_in = specialize_if_present(_let_in)  # what passes the highlights of what is under them: normal, viewer
