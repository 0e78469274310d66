"""Samples of rows of ir.Lights for direct illumination, and rays against lights with an extent."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper
from ..lanes import affine, ops
from ..types import Lane, Tables, Vec
from . import form_samples, light_kinds, lights
from .form_samples import DISK, RECTANGLE, Plate, Reached

SHORT = 1.0 - 1e-9  # of the distance to a light, so that its own shape does not block it


class Arriving(NamedTuple):
    """A light sample."""

    direction: Vec  # unit, to the light
    distance: Lane  # metres, the length of the shadow ray; inf for distant lights
    irradiance: Vec  # of a surface that faces it; samples of area lights average to the integral
    angle: Lane  # 1 over the solid angle density of lights with an extent


@helper
def sample(tables: Tables, light: int, position: Vec, u: Lane, v: Lane) -> Arriving:
    """Sample a light from a point; u, v in [0, 1) choose a point of one with an extent.

    Skies and domes are sampled by `lights.cosine_sample` and `lights.sky_radiance`; ambient light has no direction.
    """
    kind = tables.lights.kind[light]
    if light_kinds.is_point(kind):
        return _sample_point(tables, light, position)
    if light_kinds.is_distant(kind):
        return _sample_distant(tables, light, u, v)
    if light_kinds.is_sphere(kind):
        way, radius = _ball(tables, light, position)
        return _shaped(tables, light, form_samples.sample_ball(way, radius + 0.0 * u, u, v))
    plate, way = _plate(tables, light, position)
    reached = form_samples.sample_plate(plate, way, u, v)
    if light_kinds.is_disk(kind):
        reached = form_samples.sample_disk(reached, plate, way, u, v)
    return _shaped(tables, light, reached)


@helper
def sample_sharp(tables: Tables, light: int, position: Vec) -> Arriving:
    """`sample` for lights without an extent, except ambient ones."""
    if light_kinds.is_point(tables.lights.kind[light]):
        return _sample_point(tables, light, position)
    middle = ops.full_like(position[0], 0.5)
    return _sample_distant(tables, light, middle, middle)


@helper
def is_shaped(tables: Tables, light: int) -> bool:
    """Whether a light's emission depends on the direction."""
    return light_kinds.is_profiled(tables.lights.kind[light]) or lights.has_profile(tables, light)


@helper
def _shaped(tables: Tables, light: int, reached: Reached) -> Arriving:
    """The sample of a light with its factors by direction."""
    strength = reached.angle
    if light_kinds.is_profiled(tables.lights.kind[light]):
        strength = strength * light_kinds.profile(tables.lights, tables.lights.kind[light], light, reached.cosine)
    irradiance = lights.color_of(tables, light, strength)
    if lights.has_profile(tables, light):
        irradiance = ops.mul(irradiance, lights.profile(tables, light, reached.direction))
    return Arriving(reached.direction, reached.distance * SHORT, irradiance, reached.angle)


@helper
def _sample_point(tables: Tables, light: int, position: Vec) -> Arriving:
    rows = tables.lights
    way = ops.sub((rows.position[light, 0], rows.position[light, 1], rows.position[light, 2]), position)
    reached = form_samples.sample_point(rows, light, way, 0.0 * way[0] + 1.0)
    cosine = -ops.dot(reached.direction, (rows.direction[light, 0], rows.direction[light, 1], rows.direction[light, 2]))
    return _shaped(tables, light, Reached(reached.direction, reached.distance, reached.angle, cosine))


@helper
def _sample_distant(tables: Tables, light: int, u: Lane, v: Lane) -> Arriving:
    rows, zero = tables.lights, 0.0 * u
    axis = (rows.direction[light, 0] + zero, rows.direction[light, 1] + zero, rows.direction[light, 2] + zero)
    strength, solid = zero + 1.0, zero
    if rows.angle[light] > 0.0:
        half = math.sin(0.5 * rows.angle[light])
        axis, strength = form_samples.sample_distant(axis, half * half + zero, u, v)
        solid = zero + 4.0 * math.pi * half * half
    return Arriving(axis, zero + lights.FAR, lights.color_of(tables, light, strength), solid)


@helper
def _ball(tables: Tables, light: int, position: Vec) -> tuple[Vec, float]:
    """(way to the center, radius) of a spherical light."""
    row, matrix = tables.lights.transform[light], tables.transforms.matrix
    radius = tables.lights.size[light, 0] * ops.length(affine.transform_vector(matrix, row, (1.0, 0.0, 0.0)))
    return ops.sub(affine.transform_point(matrix, row, (0.0, 0.0, 0.0)), position), radius


@helper
def _plate(tables: Tables, light: int, position: Vec) -> tuple[Plate, Vec]:
    """(a rectangle or disk in the world, the way to its center)."""
    matrix, row = tables.transforms.matrix, tables.lights.transform[light]
    half_x, half_z = tables.lights.size[light, 0], tables.lights.size[light, 1]
    disk = light_kinds.is_disk(tables.lights.kind[light])
    half_z = half_x if disk else half_z
    side_x = affine.transform_vector(matrix, row, (1.0, 0.0, 0.0))
    side_z = affine.transform_vector(matrix, row, (0.0, 0.0, 1.0))
    face = ops.cross(side_z, side_x)
    stretch = ops.length(face)
    if tables.transforms.flips[row]:
        face = ops.negate(face)
    area = (math.pi * half_x * half_x if disk else 4.0 * half_x * half_z) * stretch
    even = abs(ops.dot(side_x, side_x) - ops.dot(side_z, side_z)) <= 1e-6 * stretch
    square = (abs(ops.dot(side_x, side_z)) <= 1e-6 * stretch) & (even | (not disk))
    normal = ops.scale(face, 1.0 / max(stretch, lights.TINY))
    plate = Plate(DISK if disk else RECTANGLE, ops.scale(side_x, half_x), ops.scale(side_z, half_z), normal, area, False, square)
    return plate, ops.sub(affine.transform_point(matrix, row, (0.0, 0.0, 0.0)), position)


@helper
def intersect(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    """(distance, 1 over the density of `sample`, radiance over its color) of a light hit in a direction; the second is 0 for misses."""
    kind = tables.lights.kind[light]
    if light_kinds.is_distant(kind):
        return _intersect_sun(tables, light, direction)
    if light_kinds.is_sphere(kind):
        return _intersect_sphere(tables, light, place, direction)
    return _intersect_plate(tables, light, place, direction)


@helper
def _intersect_sun(tables: Tables, light: int, direction: Vec) -> tuple[Lane, Lane, Lane]:
    axis = (tables.lights.direction[light, 0], tables.lights.direction[light, 1], tables.lights.direction[light, 2])
    half = math.sin(0.5 * tables.lights.angle[light])
    off = ops.sub(direction, axis)
    inside = ops.dot(off, off) <= 4.0 * half * half  # by the chord, without cancellation
    solid = 4.0 * math.pi * half * half
    zero = 0.0 * off[0]
    return zero + lights.FAR, ops.where(inside, zero + solid, zero), zero + 1.0 / (solid * (1.0 - half * half))


@helper
def _intersect_sphere(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    way, radius = _ball(tables, light, place)
    squared, middle = ops.dot(way, way), ops.dot(way, direction)
    off = ops.sub(way, ops.scale(direction, middle))
    discriminant = radius * radius - ops.dot(off, off)
    outside = squared > radius * radius
    reach = ops.sqrt(ops.maximum(discriminant, 0.0))
    distance = ops.where(outside, middle - reach, middle + reach)
    solid = 1.0 / form_samples.ball_density(way, radius + 0.0 * squared)
    hit = (discriminant >= 0.0) & (distance > 0.0)
    return distance * SHORT, ops.where(hit, solid, 0.0), 0.0 * distance + 1.0


@helper
def _intersect_plate(tables: Tables, light: int, place: Vec, direction: Vec) -> tuple[Lane, Lane, Lane]:
    row, inverse = tables.lights.transform[light], tables.transforms.inverse
    half_x, half_z = tables.lights.size[light, 0], tables.lights.size[light, 1]
    start, along = affine.transform_point(inverse, row, place), affine.transform_vector(inverse, row, direction)
    towards = ops.absolute(along[1]) > lights.TINY
    distance = ops.where(towards, -start[1] / ops.where(towards, along[1], 1.0), 0.0)
    x, z = start[0] + distance * along[0], start[2] + distance * along[2]
    disk = light_kinds.is_disk(tables.lights.kind[light])
    if disk:
        inside = x * x + z * z <= half_x * half_x
    else:
        inside = (ops.absolute(x) <= half_x) & (ops.absolute(z) <= half_z)
    plate, way = _plate(tables, light, place)
    hit = inside & (distance > 0.0) & (ops.dot(direction, plate.normal) < 0.0)
    density = form_samples.plate_density(plate, way, direction, distance)
    if disk:
        density = form_samples.disk_density(density, plate, way, direction)
    return distance * SHORT, ops.where(hit, 1.0 / ops.maximum(density, lights.TINY), 0.0), 0.0 * distance + 1.0
