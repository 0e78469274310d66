"""Lights hit by sampled directions of glossy lobes, for the Whitted integrator.

Light samples seldom fall into narrow lobes. Both strategies are combined by multiple importance sampling (Veach and Guibas 1995,
"Optimally Combining Sampling Techniques", power heuristic).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...lights import PROFILED, SUNS, SURFACES
from ..jit.kernel import helper, specialize_either
from ..lanes import ops
from ..light import light_samples, lights
from ..light.light_samples import Arriving
from ..material import bsdf, principled
from ..material.shader import Shader
from ..types import Lane, NoGlossyLights, Tables, Vec


class GlossyLights(NamedTuple):
    """The lights with an extent."""

    rows: NDArray[np.int64]  # of lights


def find_glossy_lights(tables: ir.Tables, general: bool = False) -> GlossyLights | NoGlossyLights:
    """Return the lights that lobe samples can hit; none in scenes without microfacets, unless `general`."""
    if not isinstance(tables.materials, principled.Layered):
        return NoGlossyLights()
    kinds = tables.lights.kind
    wide = ir.is_in(kinds, SURFACES) | (ir.is_in(kinds, SUNS) & (tables.lights.angle > 0.0))
    rows = np.flatnonzero(wide & (tables.lights.image < 0) & ~ir.is_in(kinds, PROFILED))  # lights with a profile have light samples alone
    return GlossyLights(rows.astype(np.int64)) if len(rows) or general else NoGlossyLights()


@helper
def _reflected(shader: Shader, tables: Tables, light: int, normal: Vec, arriving: Arriving, viewer: Vec, active: Lane) -> Vec:
    return bsdf.reflected(shader, normal, arriving.direction, viewer)


@helper
def _weighted_reflected(
    sources: Any, shader: Shader, tables: Tables, light: int, normal: Vec, arriving: Arriving, viewer: Vec, active: Lane
) -> Vec:  # fmt: skip
    """`bsdf.reflected` of a light sample, with the MIS weight against lobe samples."""
    glossy = active & bsdf.is_glossy(shader)
    if lights.is_soft(tables, light) and not light_samples.is_shaped(tables, light) and ops.any_lane(glossy):
        diffuse, shine, density = bsdf.eval_lobes_pdf(shader, normal, arriving.direction, viewer)
        ratio = density * arriving.angle
        weight = ops.where(glossy, 1.0 / (1.0 + ratio * ratio), 1.0)
        return ops.add(diffuse, ops.scale(shine, weight))
    return bsdf.reflected(shader, normal, arriving.direction, viewer)


@helper
def weight(density: Lane, solid: Lane) -> Lane:
    """Return the MIS weight of a lobe sample of this density; 0 where it misses the light."""
    ratio = density * solid
    return ratio * ratio / (1.0 + ratio * ratio)


reflected = specialize_either(_weighted_reflected, _reflected)
