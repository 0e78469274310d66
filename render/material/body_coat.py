"""Smooth or rough dielectric over a body that light scatters in: its highlight, and what passes it inwards and outwards.

From outside the highlight is that of microfacets, with the albedo E(μ). The rest, 1 − E(μ), enters diffusely. From inside light leaves in
proportion to (1 − E(μ))/(1 − Ē), whose mean is 1. So a body that absorbs nothing passes the furnace test, and the boundary is reciprocal
(Kelemen and Szirmay-Kalos 2001 for a base under a highlight; see `microfacet`). Reflection from inside is part of the colour of the body.
Scenes without such bodies compile nothing of it: the `coat` of their Shader is None, which is a type.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from ...compiler import ir
from ...materials import traits
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..simd.registration import overload
from ..surface.material_inputs import number_of
from ..types import Lane, Surface, Tables, Vec
from . import added_lobes, energy_compensation, medium_stack, microfacet, sheen

IOR, ROUGHNESS = int(ir.Slot.IOR), int(ir.Slot.ROUGHNESS)
BODY = int(ir.MaterialModel.SUBSURFACE)
LEAST = microfacet.LEAST


class NoCoats(NamedTuple):
    """No body has a highlight."""


class Coats(NamedTuple):
    """Some body has a highlight."""

    count: int


class Coat(NamedTuple):
    """The boundary of a body at a point."""

    here: Lane  # bool: the material is a body with a highlight
    front: Lane  # bool: seen from outside; else it has no highlight
    lobes: microfacet.Lobes  # the highlight alone


def tables_of(tables: ir.Tables, general: bool = False) -> Coats | NoCoats:
    """Coats if a material of an instance is a body with a highlight, or with `general`."""
    return Coats(1) if general or bool((traits.coated(tables) & traits.used(tables)).any()) else NoCoats()


def at(tables: Tables, surface: Surface, inside: Any) -> Any:
    """Return the Coat of a surface for a ray with a medium stack; None in scenes without any."""
    return _at(tables, surface, inside) if isinstance(getattr(tables.materials, "coats", None), Coats) else None


@overload(at)
def _at_in_kernels(tables, surface, inside):
    part = tables.field("materials.coats") if isinstance(tables, HandleType) else None
    if part is not None and part[1] != ():
        return lambda tables, surface, inside: _at(tables, surface, inside)
    return lambda tables, surface, inside: None


@helper
def _at(tables: Tables, surface: Surface, inside: Any) -> Coat:
    materials: Any = tables.materials
    zero = ops.full_like(surface.offset, 0.0)
    no = ops.bool_like(zero, False)
    body = (no | (materials.model[surface.material] == BODY)) & ops.not_(medium_stack.is_ignored(inside, no, tables, surface))
    f0, alpha = zero, zero + 1.0
    if ops.any_lane(body):
        ior = ops.maximum(number_of(tables, surface, IOR), 1e-3)
        boundary = (ior - 1.0) / (ior + 1.0)
        f0 = ops.where(body, boundary * boundary, zero)
        roughness = ops.clip(number_of(tables, surface, ROUGHNESS), 0.0, 1.0)
        alpha = ops.where(body, roughness * roughness, alpha)
    coated = body & (f0 > 0.0)
    front = coated & surface.front
    f90 = ops.minimum(microfacet.GRAZING * f0, 1.0)
    black, without = (zero, zero, zero), sheen.without(materials.sheen, None, zero)
    lobes = microfacet.Lobes(
        front, front & (alpha < microfacet.SHARP), black, (f0, f0, f0), f90, black, ops.maximum(alpha, microfacet.SHARP), zero, zero + 1.0,
        materials.albedo, without,
    )  # fmt: skip
    return Coat(coated, front, lobes)


@helper
def _passes(coat: Coat, out: microfacet.Albedos, all_: microfacet.Layers, normal: Vec, to_light: Vec) -> Lane:
    """The factor of light that passes the boundary diffusely, by the side of the viewer."""
    outside = ops.clip(-ops.dot(normal, to_light), LEAST, 1.0)
    leaves = microfacet.directional_albedo(coat.lobes, outside).highlight[0]
    return ops.where(coat.front, 1.0 - out.highlight[0], (1.0 - leaves) / ops.maximum(all_.open[0], LEAST))


@helper
def _enters(coat: Coat, out: microfacet.Albedos) -> Lane:
    """The chance by which a sample passes the boundary, over that of a body without a highlight."""
    return ops.where(coat.front, 1.0 - out.highlight[0], 1.0 + 0.0 * out.lost)


@helper
def _reflected(coat: Coat, default: Vec, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    all_, out = microfacet.viewer_albedo(coat.lobes, normal, to_viewer)
    shine = microfacet.eval_lobes(coat.lobes, normal, to_light, to_viewer, out, all_).highlight
    shine = ops.scale(shine, ops.where(coat.front, 1.0 + 0.0 * out.lost, 0.0))
    return ops.where3(coat.here, ops.add(shine, ops.scale(default, _passes(coat, out, all_, normal, to_light))), default)


@helper
def _density(coat: Coat, default: Lane, added: Any, normal: Vec, to_light: Vec, to_viewer: Vec, mirror: Lane) -> Lane:
    all_, out = microfacet.viewer_albedo(coat.lobes, normal, to_viewer)
    lobes = microfacet.eval_lobes(coat.lobes, normal, to_light, to_viewer, out, all_)
    chance = microfacet.chances(coat.lobes, all_, out)
    zero, seen = 0.0 * out.lost, ops.where(coat.front, 1.0 + 0.0 * out.lost, 0.0)
    glossy = seen * (chance.highlight * lobes.highlight_density + chance.again * lobes.again_density)
    through = added_lobes.density(added, zero, normal, to_light, to_viewer) * _enters(coat, out)
    total = seen * (chance.highlight + chance.again) + added_lobes.chance(added, zero, normal, to_viewer) * _enters(coat, out)
    return ops.where(coat.here, (glossy + through) / ops.maximum(total + mirror, LEAST), default)


@helper
def _whole(coat: Coat, default: Lane, added: Any, normal: Vec, to_viewer: Vec) -> Lane:
    all_, out = microfacet.viewer_albedo(coat.lobes, normal, to_viewer)
    chance = microfacet.chances(coat.lobes, all_, out)
    through = added_lobes.chance(added, 0.0 * default, normal, to_viewer) * _enters(coat, out)
    return ops.where(coat.here, through + ops.where(coat.front, chance.highlight + chance.again, 0.0), default)


@helper
def _draw(coat: Coat, default: tuple[Vec, Lane], added: Any, normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane) -> Any:
    all_, out = microfacet.viewer_albedo(coat.lobes, normal, to_viewer)
    chance = microfacet.chances(coat.lobes, all_, out)
    past = which - added_lobes.chance(added, 0.0 * which, normal, to_viewer) * _enters(coat, out)
    wide = energy_compensation.spread_alpha(coat.lobes.alpha)
    half = microfacet.sample_visible_normal(normal, to_viewer, ops.where(past < chance.highlight, coat.lobes.alpha, wide), u, v)
    shines, mirrored = coat.front & (past >= 0.0), ops.reflect(ops.negate(to_viewer), half)
    sinks = shines & (ops.dot(mirrored, normal) <= 0.0)  # they do not count: what passes has other samples there
    return ops.where3(shines, mirrored, default[0]), default[1] & ops.not_(sinks)


@helper
def _specular_reflectance(coat: Coat, default: Vec, normal: Vec, to_viewer: Vec) -> Vec:
    cosine = ops.clip(ops.dot(normal, to_viewer), 0.0, 1.0)
    return ops.where3(coat.lobes.sharp, microfacet.fresnel(coat.lobes, cosine), default)


@helper
def _mirrors(coat: Coat, default: Vec) -> Vec:
    zero = 0.0 * default[0]
    return ops.where3(coat.lobes.sharp, ops.lerp3(coat.lobes.f0, (zero + 1.0, zero + 1.0, zero + 1.0), zero + 0.05), default)


@helper
def _is_coated(coat: Coat) -> bool:
    return ops.any_lane(coat.here)


_if_coated = functools.partial(specialize_if_present, is_active=_is_coated)

# Each takes a coat, the result for other materials, and:
reflected = _if_coated(_reflected)  # π f cos: normal, direction to the light, to the viewer
density = _if_coated(_density)  # of `draw`: added lobes, then as for `reflected`, and the weight of specular lobes
whole = _if_coated(_whole)  # the total of the chances: added lobes, normal, viewer
draw = _if_coated(_draw)  # (direction, whether it counts): added lobes, normal, viewer, u, v, a number from 0 to `whole`; `plain` to pass
specular_reflectance = _if_coated(_specular_reflectance)  # reflectance of a polished boundary: normal, viewer
mirrors = _if_coated(_mirrors)  # the chance of a polished boundary's reflection, as the input k_r
