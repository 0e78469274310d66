"""Shader record: the parameters of a material at one surface point."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiler import ir
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..light import lights
from ..surface import model_tests
from ..surface.material_inputs import color_of
from ..types import Lane, Surface, Tables, Vec
from . import added_lobes, body_coat, dispersion, medium_stack, microfacet, openpbr, principled, rough_dielectric
from .slabs import Slabs

AMBIENT = int(ir.Slot.AMBIENT)
DIFFUSE = int(ir.Slot.DIFFUSE)
SPECULAR = int(ir.Slot.SPECULAR)
SHININESS = int(ir.Slot.SHININESS)
REFLECTION = int(ir.Slot.REFLECTION)
TRANSMISSION = int(ir.Slot.TRANSMISSION)
IOR = int(ir.Slot.IOR)
EMISSION = int(ir.Slot.EMISSION)
ONLY = 1e18  # density of a direction without alternative: of mirrors, smooth glass and the camera


class Uses(NamedTuple):
    """Features that a scene's materials and lights use; kernels leave out the others."""

    glossy: bool  # highlights
    sharp: bool  # mirrors, smooth glass and transmission
    shines: bool  # emissive materials
    ambient: bool
    sky: bool  # skies with shadows
    open_sky: bool = False  # skies without shadows


class Shader(NamedTuple):
    """Parameters of a material at one point, with textures evaluated."""

    ambient: Vec
    diffuse: Vec
    specular: Vec
    shininess: Lane
    reflection: Vec
    transmission: Vec
    ior: Lane
    emission: Vec
    blinn: Lane  # bool: Blinn-Phong instead of Phong
    normalized: Lane  # bool
    strength: Lane  # lobe_scale of normalized lobes, else 1
    glass: Lane  # bool: reflection and transmission by Fresnel's equations
    lobes: Any  # microfacet.Lobes (the classic lobes of their lanes are 0); None in scenes without
    frost: Any  # rough_dielectric.Frost; None in scenes without
    added: Any  # a tuple of added_lobes.AddedLobe; None in scenes without
    coat: Any  # body_coat.Coat; None in scenes without
    slabs: Any  # slabs.Slabs; None in scenes without


@helper
def evaluate_shader(tables: Tables, surface: Surface) -> Shader:
    """Evaluate the material of a surface, for a ray outside of all media."""
    return evaluate_shader_inside(tables, surface, None)


@helper
def evaluate_shader_inside(tables: Tables, surface: Surface, inside: Any) -> Shader:
    """Evaluate the material of a surface, for a ray with a medium stack."""
    return evaluate_shader_filtered(tables, surface, Uses(True, True, True, lights.has_ambient(tables), True, False), inside, None)


@helper
def evaluate_shader_filtered(tables: Tables, surface: Surface, uses: Uses, inside: Any, component: Any) -> Shader:
    """Evaluate the material of a surface in a scene that uses some features; parameters of the others are 0.

    `component` is the wavelength of a path, a dispersion.Component, or None.
    """
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
        blinn = no | model_tests.has_half_vector(tables.materials.model[surface.material])
        normalized = no | tables.materials.normalized[surface.material]
        if ops.any_lane(normalized):
            strength = ops.where(normalized, lobe_scale(blinn, shininess), strength)
    added = added_lobes.at(tables, surface)
    if uses.sharp:
        reflection = color_of(tables, surface, REFLECTION)
        transmission = color_of(tables, surface, TRANSMISSION)
        ior = zero + ops.maximum(color_of(tables, surface, IOR)[0], 1e-3)
        glass = no | model_tests.is_glass(tables.materials.model[surface.material])
        ior = dispersion.index(component, ior, tables, surface)
        ior = medium_stack.relative_ior(inside, ior, tables, surface, component)
        hidden = medium_stack.is_ignored(inside, no, tables, surface)
        transmission = ops.where3(hidden, (zero + 1.0, zero + 1.0, zero + 1.0), transmission)
        added = added_lobes.without(added, None, hidden)
    if uses.shines:
        emission = color_of(tables, surface, EMISSION)
    diffuse = ops.mul(color_of(tables, surface, DIFFUSE), surface.color)
    shader = Shader(
        ambient, diffuse, specular, shininess, reflection, transmission, ior, emission, blinn, normalized, strength, glass, None, None,
        added, None, None,
    )  # fmt: skip
    shader = _with_lobes(principled.at(tables, surface), shader)
    shader = _with_slabs(openpbr.at(tables, surface), shader)
    shader = _with_coat(body_coat.at(tables, surface, inside), shader)
    return _with_frost(rough_dielectric.at(tables, surface, shader.ior, shader.transmission), shader)


@helper
def _replace_lobes(lobes: microfacet.Lobes, default: Shader) -> Shader:
    """Clear the classic lobes in lanes with microfacets, except for perfect mirrors and transmission."""
    zero = 0.0 * default.ior
    black = (zero, zero, zero)
    lanes = lobes.here
    reflection = ops.where3(lobes.sharp, ops.lerp3(lobes.f0, (zero + 1.0, zero + 1.0, zero + 1.0), zero + 0.05), black)
    return Shader(
        ops.where3(lanes, ops.mul(default.ambient, lobes.base), default.ambient), ops.where3(lanes, black, default.diffuse),
        ops.where3(lanes, black, default.specular), default.shininess, ops.where3(lanes, reflection, default.reflection),
        default.transmission,
        ops.where(lanes, zero + 1.0, default.ior), default.emission, default.blinn, default.normalized, default.strength, default.glass,
        lobes, None,
        default.added, None, None,
    )  # fmt: skip


_with_lobes = specialize_if_present(_replace_lobes)


@helper
def _replace_slabs(slabs: Slabs, plain: Shader) -> Shader:
    """Clear the classic lobes in lanes with slabs."""
    zero = 0.0 * plain.ior
    lanes, black = slabs.here, (zero, zero, zero)
    ambient = ops.scale(slabs.color, 1.0 - slabs.metal)
    return Shader(
        ops.where3(lanes, ambient, plain.ambient), ops.where3(lanes, black, plain.diffuse), ops.where3(lanes, black, plain.specular),
        plain.shininess, ops.where3(lanes, black, plain.reflection), ops.where3(lanes, black, plain.transmission),
        ops.where(lanes, zero + 1.0, plain.ior), plain.emission, plain.blinn, plain.normalized, plain.strength, plain.glass, plain.lobes,
        None, plain.added, None, slabs,
    )  # fmt: skip


_with_slabs = specialize_if_present(_replace_slabs)


@helper
def _replace_glass(frost: rough_dielectric.RoughGlass, default: Shader) -> Shader:
    """Clear specular reflection and transmission in lanes with rough glass."""
    zero = 0.0 * default.ior
    lanes, black = frost.here, (zero, zero, zero)
    return Shader(
        default.ambient, default.diffuse, default.specular, default.shininess, ops.where3(lanes, black, default.reflection),
        ops.where3(lanes, black, default.transmission), ops.where(lanes, zero + 1.0, default.ior), default.emission, default.blinn,
        default.normalized, default.strength, default.glass & ops.not_(lanes), default.lobes, frost,
        default.added, default.coat, default.slabs,
    )  # fmt: skip


_with_frost = specialize_if_present(_replace_glass)


@helper
def _add_coat(coat: body_coat.Coat, default: Shader) -> Shader:
    """Add the highlight of bodies; their index of refraction is that of the highlight alone."""
    return Shader(
        default.ambient, default.diffuse, default.specular, default.shininess,
        body_coat.mirrors(coat, default.reflection), default.transmission,
        ops.where(coat.here, 1.0 + 0.0 * default.ior, default.ior), default.emission, default.blinn, default.normalized, default.strength,
        default.glass,
        default.lobes, None, default.added, coat, default.slabs,
    )  # fmt: skip


_with_coat = specialize_if_present(_add_coat)


@helper
def lobe_scale(blinn: Lane, n: Lane) -> Lane:
    """Return the factor by which a lobe of exponent n reflects k_s at normal incidence."""
    of_half = (n + 2.0) * (n + 4.0) / (8.0 * (ops.power(2.0, -0.5 * n) + n))
    return ops.where(blinn, of_half, 0.5 * (n + 2.0))
