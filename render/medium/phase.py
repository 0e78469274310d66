"""Phase function of Henyey and Greenstein 1941, and its samples. Directions are unit; `cosine` is that of the angle of deflection."""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

EVEN = 1e-3  # |g| below which samples are uniform


@helper
def density(g: Lane, cosine: Lane) -> Lane:
    """The phase function, which is also the solid angle density of `sample`."""
    squared = ops.maximum(1.0 + g * g - 2.0 * g * cosine, 1e-7)
    return (1.0 - g * g) / (4.0 * math.pi * squared * ops.sqrt(squared))


@helper
def sample(g: Lane, direction: Vec, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction after scattering, its density) for light that travels along `direction`."""
    even = ops.absolute(g) < EVEN
    safe = ops.where(even, 0.5, g)
    part = (1.0 - safe * safe) / (1.0 - safe + 2.0 * safe * u)
    cosine = ops.where(even, 1.0 - 2.0 * u, (1.0 + safe * safe - part * part) / (2.0 * safe))
    cosine = ops.clip(cosine, -1.0, 1.0)
    sine = ops.sqrt(ops.maximum(1.0 - cosine * cosine, 0.0))
    s, t = ops.basis(direction)
    angle = 2.0 * math.pi * v
    onward = ops.in_basis(s, t, direction, sine * ops.cos(angle), sine * ops.sin(angle), cosine)
    return onward, density(ops.where(even, 0.0, g), cosine)
