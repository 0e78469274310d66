"""Factors of the adjoint BSDF: how photons scatter otherwise than radiance, by refraction and by interpolated normals."""

from __future__ import annotations

from ...jit.kernel import helper
from ...lanes import ops
from ...material import bsdf
from ...material.shader import Shader
from ...types import Lane, Surface, Vec

LARGEST = 16.0  # greatest factor of a photon's weight by interpolated normals


@helper
def factor(point: Surface, shader: Shader, arriving: Vec, leaving: Vec, sharp: Lane) -> Lane:
    """The factor of photons against the radiance BSDF.

    Radiance here is not scaled by the square of the index; so photons that enter a medium are, and lose the factor on leaving it.
    """
    passes = ops.dot(arriving, point.geometric) * ops.dot(leaving, point.geometric) > 0.0
    through = bsdf.refracts(shader, sharp) & passes
    eta = bsdf.relative_index(shader, ops.where(point.front, 1.0 / shader.ior, shader.ior))
    eta = ops.where(through, eta, 1.0)
    return eta * eta * of_normals(point, arriving, leaving)


@helper
def of_normals(point: Surface, arriving: Vec, leaving: Vec) -> Lane:
    """The correction for shading normals of the adjoint BSDF (Veach 1997, §5.3)."""
    bent = ops.absolute(ops.dot(arriving, point.normal) * ops.dot(leaving, point.geometric))
    true = ops.absolute(ops.dot(arriving, point.geometric) * ops.dot(leaving, point.normal))
    return ops.minimum(bent / ops.maximum(true, 1e-12), LARGEST)
