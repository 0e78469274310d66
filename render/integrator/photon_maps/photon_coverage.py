"""Light that photons carry, which paths must not count again.

In scenes without photons kernels compile nothing of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...jit.kernel import helper, specialize_if_present
from ...lanes import ops
from ...light import dome_spots, lights
from ...material import bsdf
from ...material.bsdf import Scattered
from ...material.shader import ONLY, Shader
from ...simd.registration import overload, types
from ...types import Lane, Surface, Vec
from ..state import flights
from ..state.path_state import PathState
from ..state.records import ShadingContext
from . import photon_map


def photon_covers_emission(photon_emitters: Any, row: Any, path: PathState) -> Lane:
    """Where photons carry the light of an emitter's row that a path hits."""
    return np.zeros(np.shape(path.density), bool)


@overload(photon_covers_emission)
def _emission_in_kernels(photon_emitters, row, path):
    if isinstance(photon_emitters, types.Array):
        return lambda photon_emitters, row, path: ((path.density > 2.0 * ONLY) | (path.phase > photon_map.CLEAN)) & photon_emitters[row]
    return lambda photon_emitters, row, path: ops.bool_like(path.density, False)


@helper
def _covered_sky(spots: Any, default: Lane, path: PathState) -> Lane:
    covered = default | (path.density > 2.0 * ONLY) | (path.phase > photon_map.CLEAN)
    return dome_spots.only_in_spots(spots, covered, spots.row, path.direction)


photon_covers_sky = specialize_if_present(_covered_sky)
"""(spots, plain, path): where photons carry the light of a dome's spot that a path hits; `plain` is False."""


def photon_covers_mirror(photon_emitters: Any, row: Any, path: PathState, shader: Shader) -> Lane:
    """Where photons carry the light of an emitter's row that a metal reflects to the diffuse surface before it on a path."""
    return np.zeros(np.shape(path.density), bool)


@overload(photon_covers_mirror)
def _mirror_in_kernels(photon_emitters, row, path, shader):
    if isinstance(photon_emitters, types.Array):
        return lambda photon_emitters, row, path, shader: (path.phase >= photon_map.CLEAN) & bsdf.is_polished(shader) & photon_emitters[row]
    return lambda photon_emitters, row, path, shader: ops.bool_like(path.density, False)


def photon_covers_lobe(caustic_reflectance: Any, point: Surface, shader: Shader) -> Lane:
    """Where photons carry the light of small lights that a highlight reflects; paths carry that of the diffuse part under it."""
    return np.zeros(np.shape(point.offset), bool)


@overload(photon_covers_lobe)
def _lobe_in_kernels(caustic_reflectance, point, shader):
    if isinstance(caustic_reflectance, types.Array):
        return lambda caustic_reflectance, point, shader: (caustic_reflectance[point.instance] > 0.0) & bsdf.has_bright_narrow_lobe(shader)
    return lambda caustic_reflectance, point, shader: ops.bool_like(point.offset, False)


def exclude_covered_lobe(
    caustic_reflectance: Any, photon_emitters: Any, spots: Any, share: Vec, row: Any, path: PathState, shading: ShadingContext,
    direction: Vec,
) -> Any:  # fmt: skip
    """(BSDF share of a light sample without the lobes that photons carry, whether light sampling alone finds the rest)."""
    return share, np.zeros(np.shape(path.density), bool)


@overload(exclude_covered_lobe)
def _exclude_in_kernels(caustic_reflectance, photon_emitters, spots, share, row, path, shading, direction):
    if isinstance(caustic_reflectance, types.Array):
        return lambda caustic_reflectance, photon_emitters, spots, share, row, path, shading, direction: _exclude(
            caustic_reflectance, photon_emitters, spots, share, row, path, shading, direction
        )

    def nothing(caustic_reflectance, photon_emitters, spots, share, row, path, shading, direction):
        return share, ops.bool_like(path.density, False)

    return nothing


@helper
def _exclude(
    caustic_reflectance: Any, photon_emitters: Any, spots: Any, share: Vec, row: Any, path: PathState, shading: ShadingContext,
    direction: Vec,
) -> tuple[Vec, Lane]:  # fmt: skip
    point, shader = shading.point, shading.shader
    alone = (path.phase >= photon_map.CLEAN) & photon_emitters[row] & photon_covers_lobe(caustic_reflectance, point, shader)
    alone = dome_spots.only_in_spots(spots, flights.surfaces(shading.event, alone), row, direction)
    if ops.any_lane(alone):
        share = ops.where3(alone, bsdf.eval_diffuse(shader, point.normal, direction, shading.viewer), share)
    return share, alone


def splits_lobe(photons: Any, phase: Lane, shader: Shader) -> Lane:
    """Where photons light the diffuse base of a surface alone, and paths follow the narrow lobe over it; nowhere without photons."""
    return np.zeros(np.shape(phase), bool)


@overload(splits_lobe)
def _splits_in_kernels(photons, phase, shader):
    if photons.layout:
        return lambda photons, phase, shader: (phase == 0.0) & (photons.slots > 0) & bsdf.has_narrow_lobe(shader)
    return lambda photons, phase, shader: ops.bool_like(phase, False)


def split_lobe(photons: Any, default: tuple[Vec, Lane], *arguments: Any) -> tuple[Vec, Lane]:
    """(photons, plain, splits, shading, scattered, number): choose the diffuse base or the narrow lobe for a BSDF sample; only in kernels.

    `default` is the weight of the path and where the lobe is chosen,
    which is nowhere. The chance of the lobe is its share in the BSDF at the
    sampled direction. Photons are noisy in a narrow lobe, as few arrive in it.
    """
    return default


@overload(split_lobe)
def _split_in_kernels(photons, default, splits, shading, scattered, number):
    if photons.layout:
        return lambda photons, default, splits, shading, scattered, number: _split(default, splits, shading, scattered, number)
    return lambda photons, default, splits, shading, scattered, number: default


@helper
def _split(default: tuple[Vec, Lane], splits: Lane, shading: ShadingContext, scattered: Scattered, number: Lane) -> tuple[Vec, Lane]:
    weight, lobe = default
    splits = splits & (scattered.density < ONLY)
    if ops.any_lane(splits):
        point, shader = shading.point, shading.shader
        all_lobes = bsdf.reflected(shader, point.normal, scattered.direction, shading.viewer)
        base = bsdf.eval_diffuse(shader, point.normal, scattered.direction, shading.viewer)
        chance = ops.clip(1.0 - ops.mean3(base) / ops.maximum(ops.mean3(all_lobes), lights.TINY), 0.0, 1.0)
        lobe = splits & (number < chance)
        part = ops.where3(lobe, ops.sub(all_lobes, base), base)
        scale = 1.0 / ops.maximum(ops.where(lobe, chance, 1.0 - chance), lights.TINY)
        share = (
            part[0] * scale / ops.maximum(all_lobes[0], lights.TINY), part[1] * scale / ops.maximum(all_lobes[1], lights.TINY),
            part[2] * scale / ops.maximum(all_lobes[2], lights.TINY),
        )  # fmt: skip
        weight = ops.where3(splits, ops.mul(weight, share), weight)
    return weight, lobe
