"""Emission of photons: rays from emitters toward their targets, with the power of each."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...jit.kernel import helper
from ...lanes import ops
from ...light import dome_spots, emitter_points, emitters, lights, round_emitters
from ...light.emitter_table import Emitters
from ...light.form_samples import DISTANT, SKY, SPHERE
from ...sampling import sobol
from ...types import Lane, Ray, Tables, Vec
from .aims import Aims

ORIGIN, PLACE, AIM = 1 << 16, 1 << 17, 1 << 18  # dimensions of random numbers
OFFSET = 32.0  # units of roundoff of its coordinates, by which a photon starts off an emitter


class EmitterKind(NamedTuple):
    """Groups of emitter kinds, as bool lanes."""

    far: Lane  # without a position
    flat: Lane  # a rectangle, disk or triangle
    ball: Lane  # a sphere or another round surface


@helper
def emit(tables: Tables, table: Emitters, spots: Any, aims: Aims, number: Lane, index: Lane, seed: int) -> tuple[Ray, Vec]:
    """(rays, power over the density of both choices) of photons `index` of map `number`."""
    like = ops.to_float(index)
    a, b = _emitter_numbers(number, index, seed)
    place_numbers = sobol.pair(number, index, ops.int_like(like, PLACE), seed)
    aim_numbers = sobol.pair(number, index, ops.int_like(like, AIM), seed)
    e = _choose_emitter(aims.upto, a)
    t = ops.int_like(like, 0)
    for k in range(aims.targets - 1):
        t = ops.where(b >= aims.within[e * aims.targets + k], k + 1, t)
    kind = table.kind[e]
    groups = EmitterKind(
        (kind == DISTANT) | (kind == SKY),
        emitter_points.is_plate(kind),
        (kind == SPHERE) | round_emitters.is_round(kind),
    )
    start, normal = emitter_points.surface_point(table, e, *place_numbers)
    color = (table.color[e, 0], table.color[e, 1], table.color[e, 2])
    color = emitters.shape_radiance(table.wide.textures, color, tables, table, e, ops.add(start, normal), ops.negate(normal), 1.0 + 0.0 * a)
    normal, color = dome_spots.emission(spots, (normal, color), tables, e, *place_numbers)
    row = ops.maximum(ops.to_int(table.light[e]), 0)
    zero = 0.0 * a
    half = zero
    if ops.any_lane(kind == DISTANT):  # a scene with shapes alone has no table of lights
        half = ops.sin(0.5 * (tables.lights.angle[row] + zero))
        half = ops.where(kind == DISTANT, half * half, zero)
    start, direction = _sample_direction(aims, t, groups, start, normal, half, place_numbers, aim_numbers)
    density = _density(aims, e, t, groups.far, start, direction)
    cosine = ops.dot(normal, direction)
    shines = ops.where(table.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0))
    shines = shines * round_emitters.area_of(table, e, ops.sub(start, (table.place[e, 0], table.place[e, 1], table.place[e, 2])))
    strength = ops.where(groups.flat | groups.ball, shines, zero + 1.0)
    strength = emitters.apply_profile(tables, table, e, cosine, strength)
    strength = ops.where(groups.far, 1.0 / (1.0 - half), strength)
    wide = ops.absolute(start[0]) + ops.absolute(start[1]) + ops.absolute(start[2]) + ops.sqrt(table.area[e])
    step = OFFSET * ops.roundoff(zero) * wide
    step = ops.where(groups.flat | groups.ball, step * ops.sign_of(cosine), 0.0)
    start = ops.add(start, ops.scale(normal, step))
    return Ray(start, direction, zero, zero + np.inf, None), ops.scale(color, strength / ops.maximum(density, lights.TINY))


@helper
def _sample_direction(
    aims: Aims, t: Lane, groups: EmitterKind, start: Vec, normal: Vec, half: Lane, place_numbers: Any, aim_numbers: Any
) -> tuple[Vec, Vec]:
    """(start, direction) toward target t: in the cone around it or, from far emitters, through a point of its disk."""
    pu, pv = place_numbers
    du, dv = aim_numbers
    centre, radius = (aims.centre[t, 0], aims.centre[t, 1], aims.centre[t, 2]), aims.radius[t]
    way = ops.sub(centre, start)
    height = lights.ball_height(ops.dot(way, way), radius)
    axis = ops.where3(ops.dot(way, way) > 0.0, ops.normalize(way), _up(pu))
    near_by = lights.cone_direction(axis, du * height, dv)
    to_far = lights.cone_direction(normal, pu * 2.0 * half, pv)
    s, r = ops.basis(to_far)
    wide, turn = ops.where(groups.far, radius, 0.0) * ops.sqrt(du), 2.0 * math.pi * dv
    beside = ops.add(ops.scale(s, wide * ops.cos(turn)), ops.scale(r, wide * ops.sin(turn)))
    from_far = ops.add(ops.add(centre, beside), ops.scale(to_far, aims.reach))
    return ops.where3(groups.far, from_far, start), ops.where3(groups.far, ops.negate(to_far), near_by)


@helper
def _density(aims: Aims, e: Lane, t: Lane, far: Lane, start: Vec, direction: Vec) -> Lane:
    """The density of a ray over all targets that it passes through."""
    zero = 0.0 * ops.to_float(t)
    density = zero
    for k in range(aims.targets):
        to = (aims.centre[k, 0] - start[0], aims.centre[k, 1] - start[1], aims.centre[k, 2] - start[2])
        size, chance = aims.radius[k], aims.chance[e * aims.targets + k]
        along, square = ops.dot(to, direction), ops.dot(to, to)
        off = ops.sub(to, ops.scale(direction, along))
        passes = (ops.dot(off, off) <= size * size) & (far | (along > 0.0) | (square <= size * size))
        hits = (t == k) | passes
        area = ops.where(far, math.pi * size * size, 2.0 * math.pi * lights.ball_height(square, zero + size))
        density = density + ops.where(hits, chance / ops.maximum(area, lights.TINY), 0.0)
    return density


@helper
def _up(like: Lane) -> Vec:
    zero = 0.0 * like
    return (zero, zero, zero + 1.0)


@helper
def _emitter_numbers(number: Lane, index: Lane, seed: int) -> tuple[Lane, Lane]:
    return sobol.pair(number, index, ops.int_like(ops.to_float(index), ORIGIN), seed)


@helper
def emitter_of(aims: Aims, number: Lane, index: Lane, seed: int) -> Lane:
    """The emitter of photons `index` of map `number`."""
    return _choose_emitter(aims.upto, _emitter_numbers(number, index, seed)[0])


@helper
def _choose_emitter(upto: Any, u: Lane) -> Lane:
    """The first row whose cumulative probability is above u."""
    low = ops.int_like(u, 0)
    high = ops.int_like(u, len(upto) - 1)
    step = len(upto)
    while step > 0:
        middle = (low + high) >> 1
        beyond = u >= upto[middle]
        low, high = ops.where(beyond & (low < high), middle + 1, low), ops.where(beyond, high, middle)
        step >>= 1
    return ops.minimum(low, len(upto) - 1)
