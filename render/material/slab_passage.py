"""Light that passes slabs: refracted by rough facets, straight through a thin wall, or diffusely into a body or through a wall.

- Refraction: Walter et al. 2007, by visible normals of both roughnesses, with the height-correlated shadowing of rough_dielectric. Light
  of further bounces leaves diffusely on both sides, by the tables of rough_dielectric; of a wall by those of energy_compensation.
- A thin wall has one boundary: what it does not reflect leaves mirrored about the wall, so that its roughness blurs what lies behind.
- A body gets what its boundary lets through, 1 − R(μₒ), in all directions of the cosine. From inside, light leaves in proportion to
  (1 − R(μᵢ)) over its mean, as in `body_coat`.

Scenes without such materials compile nothing of it: the `passage` of their Slabs is None, which is a type.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..jit.kernel import helper, make_replace
from ..lanes import ops
from ..types import Lane, Vec
from . import anisotropic_albedo, anisotropic_facets, energy_compensation, rough_dielectric
from .anisotropic_facets import Facets

LEAST = 1e-7
TABLED = 0.01, 0.05  # α of facets whose reflection from inside is that of a smooth boundary, and tabulated
SAME = 0.005  # a relative index nearer to 1 than this does not refract


class Passage(NamedTuple):
    """How light passes at a point, from the viewer's side."""

    share: Lane  # of what the boundary lets through: refracted, or straight through a thin wall
    diffuse: Lane  # likewise: into a body, or diffusely through a wall
    opaque: Lane  # likewise: to the diffuse lobe
    tint: Vec  # of refracted light
    diffuse_tint: Vec
    straight: Lane  # bool: a thin wall, or a boundary that does not refract
    inside: Lane  # bool: the viewer is inside of a solid
    ratio: Lane  # index of the other side over this side's
    rough: rough_dielectric.RoughGlass  # the boundary, for light of further bounces


_of_alpha = make_replace(rough_dielectric.RoughGlass, "alpha")


@helper
def lost_share(passage: Passage, slabs: Any, normal: Vec, direction: Vec, other: Lane) -> Lane:
    """The share of light that a single bounce of the base of Slabs loses in a direction of this side, or of the other."""
    cosine, facets = ops.clip(ops.absolute(ops.dot(normal, direction)), LEAST, 1.0), slabs.facets
    rough = _of_alpha(passage.rough, ops.minimum(facets.alpha, 1.0))
    side = ops.where(other, rough.other, rough.row)
    glass = rough_dielectric.lost_share(rough, side, cosine)
    wall = 1.0 - energy_compensation.directional_albedo(slabs.table, cosine, rough.alpha)[0]
    wall, glass = anisotropic_albedo.lost(slabs.anisotropy, (wall, glass), facets, side, normal, direction)
    return ops.where(passage.straight, wall, glass)


@helper
def mean_lost_shares(passage: Passage, slabs: Any) -> tuple[Lane, Lane, Lane]:
    """(mean loss on this side, on the other, share of the loss that passes)."""
    rough = passage.rough
    this, other, through = rough_dielectric.mean_lost_shares(rough)
    wall = 1.0 - energy_compensation.means(slabs.table, rough.alpha)[0]
    wall, this, other, through = anisotropic_albedo.mean_lost(
        slabs.anisotropy, (wall, this, other, through), slabs.facets, rough.row
    )  # fmt: skip
    step = (passage.ratio - 1.0) / (passage.ratio + 1.0)
    return (
        ops.where(passage.straight, wall, this), ops.where(passage.straight, wall, other),
        ops.where(passage.straight, 1.0 - ops.minimum(2.0 * step * step, 1.0), through),
    )  # fmt: skip


@helper
def reflected_inside(passage: Passage, facets: Facets, cosine: Lane) -> Lane:
    """The share of light that the boundary reflects back into the solid: by Fresnel's equations, of a rough one by tables."""
    rough = _of_alpha(passage.rough, ops.minimum(facets.alpha, 1.0))
    index = ops.where(passage.inside, passage.ratio, 1.0 / passage.ratio)
    smooth = rough_dielectric.reflectance(cosine, index)
    tabled = rough_dielectric.reflected_share(rough, ops.where(passage.inside, rough.row, rough.other), cosine)
    plain = ops.absolute(index - 1.0) < SAME
    return ops.where(plain, smooth, ops.lerp(smooth, tabled, _roughened(rough.alpha)))


@helper
def _roughened(alpha: Lane) -> Lane:
    """0 where facets are too fine for tables that smear the critical angle, 1 where tables hold."""
    return ops.clip((alpha - TABLED[0]) * (1.0 / (TABLED[1] - TABLED[0])), 0.0, 1.0)


@helper
def mean_open_inside(passage: Passage, facets: Facets, open_: Lane) -> Lane:
    """The mean of what a boundary lets through from inside; `open_` is that from outside of the facets alone."""
    rough = _of_alpha(passage.rough, ops.minimum(facets.alpha, 1.0))
    tabled = 1.0 - rough_dielectric.mean_reflected_share(rough, ops.where(passage.inside, rough.row, rough.other))
    return ops.lerp(open_ * passage.ratio * passage.ratio, tabled, _roughened(rough.alpha))


@helper
def mirrored(normal: Vec, to_light: Vec) -> Vec:
    """A direction below the surface, mirrored above it; others as they are."""
    below = ops.minimum(ops.dot(normal, to_light), 0.0)
    return ops.sub(to_light, ops.scale(normal, 2.0 * below))


@helper
def refraction(passage: Passage, facets: Facets, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Lane, Lane]:
    """(π f |cos| without Fresnel's factor, solid angle density of `sample`) of light from the other side."""
    cos_out = ops.clip(ops.dot(normal, to_viewer), LEAST, 1.0)
    cos_in = ops.clip(-ops.dot(normal, to_light), LEAST, 1.0)
    below = ops.dot(normal, to_light) < 0.0
    half = facing_normal(passage, normal, to_light, to_viewer)
    out, into = ops.dot(half, to_viewer), ops.dot(half, to_light)
    strength = anisotropic_facets.distribution(facets, anisotropic_facets.to_frame(facets, normal, half))
    reach_out = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_viewer))
    reach_in = anisotropic_facets.reach(facets, anisotropic_facets.to_frame(facets, normal, to_light))
    size = out + passage.ratio * into
    squeezed = passage.ratio * passage.ratio * ops.absolute(into) / ops.maximum(size * size, 1e-20)
    bent = ops.where(below & (out > 0.0) & (into < 0.0), strength, 0.0)
    density = 2.0 * bent / (cos_out + reach_out) * ops.absolute(out) * squeezed
    masked = rough_dielectric.shadowing_across(_height(reach_out, cos_out), _height(reach_in, cos_in))
    flat = ops.where(below & (ops.dot(half, normal) > 0.0), strength, 0.0)
    seen = anisotropic_facets.visibility(cos_out, cos_in, reach_out, reach_in)
    return (
        ops.where(passage.straight, math.pi * cos_in * flat * seen, math.pi * density * masked),
        ops.where(passage.straight, 0.5 * flat / (cos_out + reach_out), density),
    )  # fmt: skip


@helper
def facing_normal(passage: Passage, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """The facet's normal that sends light from the other side to the viewer."""
    bent = ops.normalize(ops.add(to_viewer, ops.scale(to_light, passage.ratio)))
    bent = ops.scale(bent, ops.sign_of(ops.dot(bent, normal)))
    flat = ops.normalize(ops.add(to_viewer, mirrored(normal, to_light)))
    return ops.where3(passage.straight, flat, bent)


@helper
def _height(reach: Lane, cosine: Lane) -> Lane:
    """Smith's Λ."""
    return ops.clip(0.5 * (reach / cosine - 1.0), 0.0, rough_dielectric.STEEPEST)


@helper
def refract(passage: Passage, normal: Vec, half: Vec, to_viewer: Vec) -> Vec:
    """The direction of light that a facet sends to the viewer from the other side; where it cannot, one of this side."""
    out = ops.clip(ops.dot(half, to_viewer), LEAST, 1.0)
    eta = 1.0 / passage.ratio
    square = 1.0 - eta * eta * (1.0 - out * out)
    bent = ops.add(ops.scale(to_viewer, -eta), ops.scale(half, eta * out - ops.sqrt(ops.maximum(square, 0.0))))
    bounced = ops.reflect(ops.negate(to_viewer), half)
    straight = ops.sub(bounced, ops.scale(normal, 2.0 * ops.dot(bounced, normal)))
    straight = ops.where3(ops.dot(bounced, normal) > 0.0, straight, normal)
    return ops.where3(passage.straight, straight, ops.where3(square > 0.0, ops.normalize(bent), normal))
