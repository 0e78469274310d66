"""Phong and Blinn-Phong lobes.

With I = E⊥/π of a light (E⊥: irradiance facing it), L = I · (k_d max(0, N·L) + k_s lobe), lobe = max(0, R·V)ⁿ (Phong) or
max(0, N·H)ⁿ (Blinn-Phong), both only on the light's side. `normalized` lobes are a reflectance: times N·L and (n + 2)/2 (Phong;
Lafortune and Willems 1994) or (n + 2)(n + 4) / (8 (2^(-n/2) + n)) (Blinn-Phong; Giesen 2009), so that they reflect k_s at normal
incidence and nowhere more.
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import fast_power, ops
from ..light import lights
from ..types import Lane, Vec
from .shader import Shader


@helper
def reflected_classic(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Vec:
    """Return the reflected share of a light's I = E⊥/π by the classic lobes."""
    cosine = ops.dot(normal, to_light)
    light = eval_diffuse(shader, cosine)
    glossy = has_highlight(shader, cosine)
    if ops.any_lane(glossy):
        lobe = ops.where(glossy, highlight(shader, normal, to_light, to_viewer, cosine), 0.0)
        light = ops.add(light, ops.scale(shader.specular, lobe))
    return light


@helper
def eval_lobes_pdf(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> tuple[Vec, Vec, Lane]:
    """`reflected_classic` as (share of the diffuse lobe, share of the highlight, solid angle density of `sample_classic_lobe`)."""
    cosine = ops.dot(normal, to_light)
    lobe, density = 0.0 * cosine, 0.0 * cosine
    if ops.any_lane(ops.largest(shader.specular) > 0.0):
        lobe = ops.where(has_highlight(shader, cosine), highlight(shader, normal, to_light, to_viewer, cosine), 0.0)
        density = lobe_density(shader, normal, to_light, to_viewer)
    return eval_diffuse(shader, cosine), ops.scale(shader.specular, lobe), density


@helper
def eval_diffuse(shader: Shader, cosine: Lane) -> Vec:
    """Return the diffuse share."""
    return ops.scale(shader.diffuse, ops.maximum(cosine, 0.0))


@helper
def has_highlight(shader: Shader, cosine: Lane) -> Lane:
    """Whether there is a classic highlight on this side of the surface."""
    return (cosine > 0.0) & (ops.largest(shader.specular) > 0.0)


@helper
def highlight(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec, cosine: Lane) -> Lane:
    """Return the value of the highlight lobe for a light on this side of the surface."""
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
def sample_classic_lobe(shader: Shader, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    """(direction, weight) of a sample of the classic lobe.

    cosⁿ about the mirrored direction (Phong) or of the half vector (Blinn-Phong, whose density is that of the half vector over
    4 V·H; Walter 2005, Notes on the Ward BRDF); the weight is k_s lobe / (π density), 0 below the surface.
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
def lobe_density(shader: Shader, normal: Vec, to_light: Vec, to_viewer: Vec) -> Lane:
    """Return the solid angle density of `sample_classic_lobe`."""
    mirrored = ops.reflect(ops.negate(to_viewer), normal)
    half = ops.normalize(ops.add(to_light, to_viewer))
    base = ops.where(shader.blinn, ops.dot(normal, half), ops.dot(mirrored, to_light))
    lobe = ops.where(base > 0.0, ops.power(ops.maximum(base, lights.TINY), shader.shininess), 0.0)
    across = 4.0 * ops.maximum(ops.absolute(ops.dot(half, to_viewer)), lights.TINY)
    return lobe * (shader.shininess + 1.0) / (2.0 * math.pi) / ops.where(shader.blinn, across, 1.0)
