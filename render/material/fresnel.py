"""Fresnel reflection and refraction at smooth dielectric boundaries."""

from __future__ import annotations

from ..jit.kernel import helper
from ..lanes import ops
from ..light import lights
from ..types import Lane, Vec


@helper
def fresnel(cosine: Lane, eta: Lane) -> tuple[Lane, Lane, Lane]:
    """(reflectance, cosine of the refracted ray, total) of unpolarised light between dielectrics.

    `cosine` is that of the incoming ray, `eta` = n₁/n₂. One quantity, k = 1 - η²(1 - cos²), decides between refraction and
    total reflection, so that the two always add up to one (Hecht, Optics, §4.6).
    """
    k = 1.0 - eta * eta * ops.maximum(1.0 - cosine * cosine, 0.0)
    total = ops.not_(k > 0.0)
    bent = ops.sqrt(ops.where(total, 0.0, k))
    across = (eta * cosine - bent) / ops.maximum(eta * cosine + bent, lights.TINY)
    along = (cosine - eta * bent) / ops.maximum(cosine + eta * bent, lights.TINY)
    return ops.where(total, 1.0, 0.5 * (across * across + along * along)), bent, total


@helper
def refract(direction: Vec, normal: Vec, cosine: Lane, bent: Lane, eta: Lane) -> Vec:
    """Refract a direction by Snell's law: D₂ = η D₁ + (η cos θ₁ - cos θ₂) N, `normal` on the incoming side."""
    return ops.normalize(ops.add(ops.scale(direction, eta), ops.scale(normal, eta * cosine - bent)))
