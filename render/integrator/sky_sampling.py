"""Sampling of skies for the Whitted integrator: directions of a lobe, and of the map of an uneven dome.

One-sample multiple importance sampling, balance heuristic (Veach 1997, "Robust Monte Carlo Methods", §9.2.4). The share of directions
from the map is the share of the dome's light above its mean. Uniform skies, and domes that lobes sample as well, have no map.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from ...lights import PICTURED
from ..jit.kernel import helper, specialize_if_present
from ..lanes import ops
from ..light import environment_map, lights
from ..light.environment_map import SkyMap
from ..material import added_lobes, bsdf
from ..material.shader import Shader
from ..types import Lane, NoDomeMap, Vec

LARGEST_SHARE = 0.9  # share of the samples of the map: others find what the map lacks, the mean light
LARGEST_RATIO = 0.5  # of second moments: a dome is sampled by lobes alone where its map gains less


class DomeMap(NamedTuple):
    """The dome that gains most by samples of its map."""

    light: int  # -1: none, in general kernels
    share: float  # of the samples that are drawn from the map
    map: SkyMap  # of its light above the mean


def find_dome_map(tables: ir.Tables, horizon: np.ndarray | None, general: bool = False) -> DomeMap | NoDomeMap:
    """Return the map of the dome with the most uneven light; below a `horizon`, its unit normal, one with shadows has no samples."""
    lit, best = tables.lights, None
    for light in np.flatnonzero(ir.is_in(lit.kind, PICTURED) & (lit.image >= 0) & lit.color.any(axis=1)):
        dome, share, ratio = environment_map.of_dome(tables, int(light), horizon if lit.shadows[light] else None)
        if isinstance(dome, SkyMap) and ratio < LARGEST_RATIO and (best is None or dome.power > best.map.power):
            best = DomeMap(int(light), min(share, LARGEST_SHARE), dome)
    if best is None and general:
        return DomeMap(-1, 0.0, environment_map.empty_map())
    return NoDomeMap() if best is None else best


@helper
def _choose(dome: DomeMap, light: int, u: Lane) -> tuple[float, Lane, Lane]:
    """(share of the map, whether the map gives the direction, u anew for either) for samples of a light."""
    share = dome.share if dome.light == light else 0.0
    from_map = u < share
    return share, from_map, ops.where(from_map, u / max(share, lights.TINY), (u - share) / (1.0 - share))


@helper
def _sample_diffuse(
    dome: DomeMap, default: tuple[Vec, Lane], light: int, normal: Vec, horizon: Vec, bounded: Lane, u: Lane, v: Lane
) -> tuple[Vec, Lane]:  # fmt: skip
    """(direction, cosine over π density) of a sample of a sky; `default` is `lights.cosine_sample_above`."""
    share, from_map, narrowed = _choose(dome, light, u)
    if share <= 0.0:
        return default
    direction, part = lights.cosine_sample_above(normal, horizon, bounded, narrowed, v)
    direction = ops.where3(from_map, environment_map.sample_map(dome.map, narrowed, v)[0], direction)
    cosine = ops.maximum(ops.dot(normal, direction), 0.0)
    above = ops.not_(bounded) | (ops.dot(direction, horizon) > 0.0)
    around = ops.where(above, cosine / part, 0.0)
    density = math.pi * share * environment_map.map_density(dome.map, direction) + (1.0 - share) * around
    return direction, ops.where(cosine > 0.0, cosine / ops.maximum(density, lights.TINY), 0.0)


@helper
def _sample_highlight(
    dome: DomeMap, default: tuple[Vec, Vec], light: int, shader: Shader, normal: Vec, viewer: Vec, numbers: tuple[Lane, Lane, Lane]
) -> tuple[Vec, Vec]:  # fmt: skip
    """(direction, weight) of a sample of a sky for highlights; `default` is `bsdf.sample_lobe`."""
    u, v, which = numbers
    share, from_map, narrowed = _choose(dome, light, u)
    if share <= 0.0:
        return default
    direction, _ = bsdf.sample_lobe(shader, normal, viewer, narrowed, v, which)
    direction = ops.where3(from_map, environment_map.sample_map(dome.map, narrowed, v)[0], direction)
    _, reflected, density = bsdf.eval_lobes_pdf(shader, normal, direction, viewer)
    density = math.pi * (share * environment_map.map_density(dome.map, direction) + (1.0 - share) * density)
    return direction, ops.scale(reflected, 1.0 / ops.maximum(density, lights.TINY))


@helper
def _sample_added(
    dome: DomeMap, default: tuple[Vec, Vec], light: int, added: Any, normal: Vec, viewer: Vec, numbers: tuple[Lane, Lane]
) -> tuple[Vec, Vec]:  # fmt: skip
    """(direction, weight) of a sample of a sky for the lobe that a material adds; `default` is `added_lobes.sample_lobe`."""
    u, v = numbers
    share, from_map, narrowed = _choose(dome, light, u)
    if share <= 0.0:
        return default
    direction, _ = added_lobes.sample_lobe(added, default, normal, viewer, narrowed, v)
    direction = ops.where3(from_map, environment_map.sample_map(dome.map, narrowed, v)[0], direction)
    zero = 0.0 * u
    reflected = added_lobes.value(added, (zero, zero, zero), normal, direction, viewer)
    density = added_lobes.density(added, zero, normal, direction, viewer)
    density = density / ops.maximum(added_lobes.chance(added, zero, normal, viewer), lights.TINY)
    density = math.pi * (share * environment_map.map_density(dome.map, direction) + (1.0 - share) * density)
    return direction, ops.scale(reflected, 1.0 / ops.maximum(density, lights.TINY))


# Each takes the dome's map, the sample of a scene without one, and what its function names.
sample_diffuse = specialize_if_present(_sample_diffuse)
sample_highlight = specialize_if_present(_sample_highlight)
sample_added = specialize_if_present(_sample_added)
