"""Energy-preserving diffuse reflection of rough surfaces (EON).

Portsmouth, Kutz, Hill 2025, EON: A Practical Energy-Preserving Rough Diffuse BRDF: Fujii's form of Oren and Nayar's model for single
scattering, and a lobe of further bounces that returns what it loses. It is reciprocal. A roughness of 0 is Lambert's law.
"""

from __future__ import annotations

import math

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec

LOSS = 0.5 - 2.0 / (3.0 * math.pi)
MEAN = 2.0 / 3.0 - 28.0 / (15.0 * math.pi)
LEAST = 1e-7


@helper
def directional_albedo(cosine: Lane, roughness: Lane) -> Lane:
    """The albedo of single scattering by a white surface: the fit of the paper, within 10⁻³."""
    x = 1.0 - cosine
    g = x * (0.0571085289 + x * (0.491881867 + x * (-0.332181442 + x * 0.0714429953)))
    return (1.0 + roughness * g) / (1.0 + LOSS * roughness)


@helper
def value(color: Vec, roughness: Lane, cos_in: Lane, cos_out: Lane, between: Lane) -> Vec:
    """π f of a surface of a colour; `between` is the cosine between both directions."""
    s = between - cos_in * cos_out
    over = ops.where(s > 0.0, s / ops.maximum(ops.maximum(cos_in, cos_out), LEAST), s)
    flat = 1.0 / (1.0 + LOSS * roughness)
    single = flat * (1.0 + roughness * over)
    mean = flat * (1.0 + MEAN * roughness)
    lost_in = ops.maximum(1.0 - directional_albedo(cos_in, roughness), 0.0)
    lost_out = ops.maximum(1.0 - directional_albedo(cos_out, roughness), 0.0)
    again = lost_in * lost_out / ops.maximum(1.0 - mean, LEAST)
    return (
        color[0] * (single + color[0] * mean / (1.0 - color[0] * (1.0 - mean)) * again),
        color[1] * (single + color[1] * mean / (1.0 - color[1] * (1.0 - mean)) * again),
        color[2] * (single + color[2] * mean / (1.0 - color[2] * (1.0 - mean)) * again),
    )  # fmt: skip
