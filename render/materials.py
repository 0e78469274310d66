"""Materials: what a surface does with light, as the course's equations, with energy-conserving lobes beside them.

With I = E⊥/π of a light (E⊥: irradiance facing it), L = I · (k_d max(0, N·L) + k_s lobe), lobe = max(0, R·V)ⁿ (Phong) or
max(0, N·H)ⁿ (Blinn-Phong), both only on the side the light is on. `normalized` lobes are made a reflectance: times N·L and
(n + 2)/2 (Phong; Lafortune and Willems 1994) or (n + 2)(n + 4) / (8 (2^(-n/2) + n)) (Blinn-Phong; Giesen 2009), so that at normal
incidence they reflect k_s of the light and nowhere more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..compiler import ir
from . import lanes, lights, textures
from .kernels import helper
from .records import Lane, Surface, Tables, Vec

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
    glass: Lane  # bool: reflection and transmission by Fresnel's law


@helper
def at(tables: Tables, surface: Surface) -> Shader:
    """The material of a surface where it is."""
    model = tables.materials.model[surface.material]
    zero = lanes.full_like(surface.offset, 0.0)
    ambient = (zero, zero, zero)
    if lights.has_ambient(tables):
        ambient = lanes.mul(color_of(tables, surface, AMBIENT), surface.color)
    return Shader(
        ambient,
        lanes.mul(color_of(tables, surface, DIFFUSE), surface.color),
        color_of(tables, surface, SPECULAR),
        color_of(tables, surface, SHININESS)[0],
        color_of(tables, surface, REFLECTION),
        color_of(tables, surface, TRANSMISSION),
        lanes.maximum(color_of(tables, surface, IOR)[0], 1e-3),
        color_of(tables, surface, EMISSION),
        model == BLINN_PHONG,
        tables.materials.normalized[surface.material],
        model == GLASS,
    )


@helper
def color_of(tables: Tables, surface: Surface, slot: int) -> Vec:
    """A material input: its constant times its texture, if it has one."""
    m = surface.material
    values, texture = tables.materials.values, tables.materials.textures[m, slot]
    color = (values[m, slot, 0], values[m, slot, 1], values[m, slot, 2])
    textured = texture >= 0
    if lanes.any_lane(textured):
        color = lanes.where3(textured, lanes.mul(color, textures.value(tables, texture, surface)), color)
    return color


@helper
def reflected(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """What of a light's I = E⊥/π goes to the viewer; all directions unit and away from the surface."""
    cosine = lanes.dot(normal, to_light)
    light = lanes.scale(shader.diffuse, lanes.maximum(cosine, 0.0))
    shiny = (cosine > 0.0) & (lanes.largest(shader.specular) > 0.0)
    if lanes.any_lane(shiny):
        lobe = lanes.where(shiny, _lobe(shader, normal, to_light, to_viewer, cosine), 0.0)
        light = lanes.add(light, lanes.scale(shader.specular, lobe))
    return light


@helper
def _lobe(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec, cosine: Lane) -> Lane:
    """The highlight's strength, for a light on this side of the surface."""
    base = 0.0 * cosine
    if lanes.any_lane(lanes.not_(shader.blinn)):
        base = 2.0 * cosine * lanes.dot(normal, to_viewer) - lanes.dot(to_light, to_viewer)
    if lanes.any_lane(shader.blinn):
        half = lanes.normalize(lanes.add(to_light, to_viewer))
        base = lanes.where(shader.blinn, lanes.dot(normal, half), base)
    lobe = lanes.where(base > 0.0, lanes.fading(lanes.clip(base, 1e-30, 1.0), shader.shininess), 0.0)
    if lanes.any_lane(shader.normalized):
        lobe = lobe * lanes.where(shader.normalized, lobe_scale(shader.blinn, shader.shininess) * cosine, 1.0)
    return lobe


@helper
def lobe_scale(blinn: Lane, n: Lane) -> Lane:
    """What makes a lobe of exponent n reflect all of k_s at normal incidence."""
    of_half = (n + 2.0) * (n + 4.0) / (8.0 * (lanes.power(2.0, -0.5 * n) + n))
    return lanes.where(blinn, of_half, 0.5 * (n + 2.0))


@helper
def sample_lobe(shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    """A direction light may come from, spread as the lobe is, and what share of its radiance goes to the viewer.

    cosⁿ about the mirrored direction (Phong) or of the half vector (Blinn-Phong, whose density is that of the half vector over
    4 V·H; Walter 2005, Notes on the Ward BRDF); the share is k_s lobe / (π density), 0 where the direction is below the surface.
    """
    n = shader.shininess
    cosine = lanes.power(lanes.maximum(1.0 - u, 1e-300), 1.0 / (n + 1.0))
    sine = lanes.sqrt(lanes.maximum(1.0 - cosine * cosine, 0.0))
    turn = 2.0 * math.pi * v
    mirrored = lanes.reflect(lanes.negate(to_viewer), normal)
    axis = lanes.where3(shader.blinn, normal, mirrored)
    a, b = lanes.basis(axis)
    sideways = lanes.add(lanes.scale(a, sine * lanes.cos(turn)), lanes.scale(b, sine * lanes.sin(turn)))
    spread = lanes.normalize(lanes.add(lanes.scale(axis, cosine), sideways))
    across = lanes.dot(to_viewer, spread)
    direction = lanes.where3(shader.blinn, lanes.reflect(lanes.negate(to_viewer), spread), spread)
    above = lanes.dot(direction, normal)
    share = lanes.where(shader.blinn, 8.0 * lanes.maximum(across, 0.0), 2.0) / (n + 1.0)
    share = share * lanes.where(shader.normalized, lobe_scale(shader.blinn, n) * above, 1.0)
    return direction, lanes.scale(shader.specular, lanes.where(above > 0.0, share, 0.0))


@helper
def fresnel(cosine: Lane, eta: Lane) -> tuple[Lane, Lane, Lane]:
    """(reflectance, cosine of the refracted ray, total) of unpolarised light between dielectrics.

    `cosine` is that of the incoming ray, `eta` = n₁/n₂. One quantity, k = 1 - η²(1 - cos²), decides between refraction and
    total reflection, so that the two always add up to one (Hecht, Optics, §4.6).
    """
    k = 1.0 - eta * eta * lanes.maximum(1.0 - cosine * cosine, 0.0)
    total = lanes.not_(k > 0.0)
    bent = lanes.sqrt(lanes.where(total, 0.0, k))
    across = (eta * cosine - bent) / lanes.maximum(eta * cosine + bent, 1e-300)
    along = (cosine - eta * bent) / lanes.maximum(cosine + eta * bent, 1e-300)
    return lanes.where(total, 1.0, 0.5 * (across * across + along * along)), bent, total


@helper
def refract(direction: Vec, normal: Vec, cosine: Lane, bent: Lane, eta: Lane) -> Vec:
    """Snell's law as the course writes it: D₂ = η D₁ + (η cos θ₁ - cos θ₂) N, `normal` on the incoming side."""
    return lanes.normalize(lanes.add(lanes.scale(direction, eta), lanes.scale(normal, eta * cosine - bent)))
