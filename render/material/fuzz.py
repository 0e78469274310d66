"""Fuzz of fibres: linearly transformed cosines (Zeltner, Burley, Chiang 2022, Practical Multiple-Scattering Sheen).

The lobe is a clamped cosine under a linear map, times a directional albedo. Map and albedo are the rational fits of MaterialX to the
tables of the paper. Samples follow the lobe. The map depends on the viewer alone, so that the lobe is not reciprocal.
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

LEAST_ROUGHNESS = 0.02
LEAST = 1e-4


@helper
def albedo(cosine: Lane, roughness: Lane) -> Lane:
    """Share of the light that white fuzz sends on."""
    x, y = ops.clip(cosine, LEAST, 1.0), ops.clip(roughness, LEAST_ROUGHNESS, 1.0)
    s = y * (0.0206607 + 1.58491 * y) / (0.0379424 + y * (1.32227 + y))
    m = y * (-0.193854 + y * (-1.14885 + y * (1.7932 - 0.95943 * y * y))) / (0.046391 + y)
    o = y * (0.000654023 + (-0.0207818 + 0.119681 * y) * y) / (1.26264 + y * (-1.92021 + y))
    off = (x - m) / s
    return ops.clip(ops.exp(-0.5 * off * off) / (s * math.sqrt(2.0 * math.pi)) + o, 0.0, 1.0)


@helper
def _map(cosine: Lane, roughness: Lane) -> tuple[Lane, Lane]:
    """Both coefficients of the inverse map."""
    x, y = ops.clip(cosine, LEAST, 1.0), ops.clip(roughness, LEAST_ROUGHNESS, 1.0)
    a = (2.58126 * x + 0.813703 * y) * y / (1.0 + 0.310327 * x * x + 2.60994 * x * y)
    b = ops.sqrt(ops.maximum(1.0 - x, 0.0)) * (y - 1.0) * y * y * y / (0.0000254053 + 1.71228 * x - 1.71506 * x * y + 1.34174 * y * y)
    return a, b


@helper
def _frame(normal: Vec, to_viewer: Vec) -> tuple[Vec, Vec]:
    """Axes of the plane of the normal and the viewer, and across it."""
    s, _ = ops.basis(normal)
    flat = ops.sub(to_viewer, ops.scale(normal, ops.dot(to_viewer, normal)))
    size = ops.dot(flat, flat)
    along = ops.where3(size > 1e-10, ops.scale(flat, 1.0 / ops.sqrt(ops.maximum(size, 1e-20))), s)
    return along, ops.cross(normal, along)


@helper
def density(roughness: Lane, normal: Vec, to_light: Vec, to_viewer: Vec) -> Lane:
    """The solid angle density of `sample`: f cos over the albedo."""
    a, b = _map(ops.dot(normal, to_viewer), roughness)
    along, across = _frame(normal, to_viewer)
    z = ops.dot(to_light, normal)
    x, y = a * ops.dot(to_light, along) + b * z, a * ops.dot(to_light, across)
    size = ops.maximum(x * x + y * y + z * z, 1e-12)
    share = a / size
    return ops.maximum(z, 0.0) * share * share * (1.0 / math.pi)


@helper
def sample(roughness: Lane, normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> Vec:
    """A direction to the light, by two numbers from 0 to 1."""
    a, b = _map(ops.dot(normal, to_viewer), roughness)
    along, across = _frame(normal, to_viewer)
    radius, turn = ops.sqrt(u), (2.0 * math.pi) * v
    z = ops.sqrt(ops.maximum(1.0 - u, 1e-12))
    x, y = (radius * ops.cos(turn) - b * z) / a, radius * ops.sin(turn) / a
    return ops.normalize(ops.in_basis(along, across, normal, x, y, z))
