"""Lights hit by sampled directions of glossy lobes, for the Whitted integrator.

Light samples seldom fall into narrow lobes. Both strategies are combined by multiple importance sampling (Veach and Guibas 1995,
"Optimally Combining Sampling Techniques", power heuristic).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ..jit.kernel import helper, specialize_either
from ..lanes import affine, ops
from ..light import lights
from ..light.lights import Arriving
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
    wide = ir.is_in(kinds, (lights.RECTANGLE, lights.DISK, lights.SPHERE)) | ((kinds == lights.SUN) & (tables.lights.angle > 0.0))
    rows = np.flatnonzero(wide & (tables.lights.image < 0))  # lights with a profile have light samples alone
    return GlossyLights(rows.astype(np.int64)) if len(rows) or general else NoGlossyLights()


@helper
def _reflected(shader: Shader, tables: Tables, light: int, normal: Vec, arriving: Arriving, viewer: Vec, active: Lane) -> Vec:
    return bsdf.reflected(shader, normal, arriving.direction, viewer)


@helper
def _weighted_reflected(
    found: Any, shader: Shader, tables: Tables, light: int, normal: Vec, arriving: Arriving, viewer: Vec, active: Lane
) -> Vec:  # fmt: skip
    """`bsdf.reflected` of a light sample, with the MIS weight against lobe samples."""
    glossy = active & bsdf.is_glossy(shader)
    if lights.is_soft(tables, light) and not lights.has_profile(tables, light) and ops.any_lane(glossy):
        matt, shine, density = bsdf.eval_lobes_pdf(shader, normal, arriving.direction, viewer)
        ratio = density * solid_angle(tables, light, arriving)
        weight = ops.where(glossy, 1.0 / (1.0 + ratio * ratio), 1.0)
        return ops.add(matt, ops.scale(shine, weight))
    return bsdf.reflected(shader, normal, arriving.direction, viewer)


@helper
def solid_angle(tables: Tables, light: int, arriving: Arriving) -> Lane:
    """Return 1 over the density of a sample of a light with an extent, in sr."""
    color = tables.lights.color
    brightest = max(color[light, 0], max(color[light, 1], color[light, 2]))
    found = ops.largest(arriving.irradiance) / max(brightest, lights.TINY)
    if tables.lights.kind[light] == lights.SUN:
        return 0.0 * found + 4.0 * math.pi * _half_chord(tables, light) ** 2
    return found


@helper
def _half_chord(tables: Tables, light: int) -> float:
    """Half the chord of a sun's disk on the unit sphere: its square is (1 - cos of half the disk's angle) / 2."""
    return math.sin(0.5 * tables.lights.angle[light])


@helper
def intersect_lights(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    """(distance, solid angle of its sampling, radiance over its color) of a light hit in a direction; solid angle 0 for misses."""
    kind = tables.lights.kind[light]
    if kind == lights.SUN:
        return _intersect_sun(tables, light, direction)
    if kind == lights.SPHERE:
        return _intersect_sphere(tables, light, place, direction)
    return _intersect_plate(tables, light, place, direction)


@helper
def _intersect_sun(tables: Tables, light: int, direction: Vec) -> tuple[Lane, Lane, Lane]:
    axis = (tables.lights.direction[light, 0], tables.lights.direction[light, 1], tables.lights.direction[light, 2])
    half = _half_chord(tables, light)
    off = ops.sub(direction, axis)
    inside = ops.dot(off, off) <= 4.0 * half * half  # by the chord, without cancellation
    solid = 4.0 * math.pi * half * half
    zero = 0.0 * off[0]
    return zero + lights.FAR, ops.where(inside, zero + solid, zero), zero + 1.0 / (solid * (1.0 - half * half))


@helper
def _intersect_sphere(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    row, matrix = tables.lights.transform[light], tables.transforms.matrix
    radius = tables.lights.size[light, 0] * ops.length(affine.transform_vector(matrix, row, (1.0, 0.0, 0.0)))
    way = ops.sub(affine.transform_point(matrix, row, (0.0, 0.0, 0.0)), place)
    squared, middle = ops.dot(way, way), ops.dot(way, direction)
    off = ops.sub(way, ops.scale(direction, middle))
    left = radius * radius - ops.dot(off, off)
    outside = squared > radius * radius
    reach = ops.sqrt(ops.maximum(left, 0.0))
    distance = ops.where(outside, middle - reach, middle + reach)
    solid = 2.0 * math.pi * lights.ball_height(squared, radius + 0.0 * squared)
    hit = (left >= 0.0) & (distance > 0.0)
    return distance * lights.SHORT, ops.where(hit, solid, 0.0), 0.0 * distance + 1.0


@helper
def _intersect_plate(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    row, inverse = tables.lights.transform[light], tables.transforms.inverse
    half_x, half_z = tables.lights.size[light, 0], tables.lights.size[light, 1]
    start, along = affine.transform_point(inverse, row, place), affine.transform_vector(inverse, row, direction)
    towards = ops.absolute(along[1]) > lights.TINY
    distance = ops.where(towards, -start[1] / ops.where(towards, along[1], 1.0), 0.0)
    x, z = start[0] + distance * along[0], start[2] + distance * along[2]
    face, area = lights.face_of(tables, light)
    if tables.lights.kind[light] == lights.DISK:
        inside = x * x + z * z <= half_x * half_x
    else:
        inside = (ops.absolute(x) <= half_x) & (ops.absolute(z) <= half_z)
    cosine = -ops.dot(direction, face)
    hit = inside & (distance > 0.0) & (cosine > 0.0)
    solid = cosine * area / ops.maximum(distance * distance, lights.TINY)
    return distance * lights.SHORT, ops.where(hit, solid, 0.0), 0.0 * distance + 1.0


@helper
def weight(density: Lane, solid: Lane) -> Lane:
    """Return the MIS weight of a lobe sample of this density; 0 where it misses the light."""
    ratio = density * solid
    return ratio * ratio / (1.0 + ratio * ratio)


reflected = specialize_either(_weighted_reflected, _reflected)
