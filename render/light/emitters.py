"""Sampling of emitters, and the densities of their samples.

`sample` draws a point of one emitter, or a direction to it, for each lane; `density` is the density of the same direction, for multiple
importance sampling (Veach 1997, chapter 9).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper, separate_helper
from ..lanes import ops
from ..types import Lane, Tables, Vec
from . import emitter_points, environment_map, form_samples, light_kinds, lights, round_emitters, shape_solid_angle
from .emitter_table import TUBE, Emitters
from .form_samples import DISTANT, POINT, SKY, SPHERE, Plate, Reached


class Arriving(NamedTuple):
    """A light sample: its direction, irradiance and density."""

    direction: Vec
    distance: Lane  # inf for distant lights
    light: Vec  # irradiance of a surface facing it, over the density: samples average to the irradiance
    density: Lane  # over solid angle; inf if the direction is the only one
    cosine: Lane  # at the emitter; 1 without a surface


@separate_helper
def sample(tables: Tables, emitters: Emitters, e: Lane, position: Vec, u: Lane, v: Lane) -> Arriving:
    """Sample emitter e (a row for each lane, or one for all) from a point; u, v in [0, 1) choose a point on it."""
    kind = emitters.kind[e]
    zero = ops.full_like(u, 0.0)
    color = (emitters.color[e, 0] + zero, emitters.color[e, 1] + zero, emitters.color[e, 2] + zero)
    place = (emitters.place[e, 0] + zero, emitters.place[e, 1] + zero, emitters.place[e, 2] + zero)
    normal = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    way = ops.sub(place, position)
    reached, density = Reached(normal, zero + math.inf, zero, zero + 1.0), zero + math.inf
    flat = emitter_points.is_plate(kind)
    if ops.any_lane(flat):
        plate = _plate(emitters, e)
        flat_sample = form_samples.sample_plate(plate, way, u, v)
        flat_sample = _sample_wide_disks(emitters.wide.disks, flat_sample, plate, way, u, v)
        flat_sample = _sample_wide_triangles(emitters.wide.triangles, flat_sample, plate, way, u, v)
        reached = form_samples.select(flat, reached, flat_sample)
    reached = _sample_tubes(emitters.wide.tubes, reached, emitters, e, way, u, v)
    reached = _sample_rounds(emitters.wide.rounds, reached, emitters, e, way, u, v)
    flat = flat | round_emitters.is_round(kind)
    density = ops.where(flat, 1.0 / ops.maximum(reached.angle, lights.TINY), density)
    round_ = kind == SPHERE
    if ops.any_lane(round_):
        ball = form_samples.sample_ball(way, emitters.side_u[e, 0] + zero, u, v)
        reached = form_samples.select(round_, reached, ball)
        density = ops.where(round_, 1.0 / ball.angle, density)
    small = kind == POINT
    if ops.any_lane(small):
        row = ops.maximum(emitters.light[e], 0)
        reached = form_samples.select(small, reached, form_samples.sample_point(tables.lights, row, way, reached.cosine))
    color = shape_radiance(emitters.wide.textures, color, tables, emitters, e, position, reached.direction, reached.distance)
    direction, strength = reached.direction, reached.angle
    strength = apply_profile(tables, emitters, e, -ops.dot(direction, normal), strength)
    far = kind == DISTANT
    if ops.any_lane(far):
        row = ops.maximum(emitters.light[e], 0)
        half = ops.sin(0.5 * (tables.lights.angle[row] + zero))
        towards, distant_angle = form_samples.sample_distant(normal, half * half, u, v)
        direction = ops.where3(far, towards, direction)
        strength = ops.where(far, distant_angle, strength)
    light = _shape_light(emitters.wide.profiles, ops.scale(color, strength), tables, emitters, e, direction)
    above = kind == SKY
    if ops.any_lane(above):
        towards, radiance, likely = environment_map.sample(emitters.sky, tables, position, u, v)
        direction, density = ops.where3(above, towards, direction), ops.where(above, likely, density)
        light = ops.where3(above, ops.scale(radiance, 1.0 / ops.maximum(likely, lights.TINY)), light)
    return Arriving(direction, reached.distance, light, density, reached.cosine)


@helper
def apply_profile(tables: Tables, emitters: Emitters, e: Lane, cosine: Lane, strength: Lane) -> Lane:
    """`strength` times the share of the emission of lights by the angle from their axis."""
    kind = emitters.profile[e]
    shaped = kind >= 0
    if ops.any_lane(shaped):
        share = light_kinds.profile(tables.lights, kind, ops.maximum(emitters.light[e], 0), cosine)
        strength = ops.where(shaped, strength * share, strength)
    return strength


@helper
def _profiled(radiance: Vec, tables: Tables, emitters: Emitters, e: Lane, direction: Vec) -> Vec:
    """Return `radiance` times the factors of lights whose emission depends on the direction."""
    light = emitters.light[e]
    listed = (light >= 0) & (emitters.kind[e] != SKY)
    if ops.any_lane(listed):  # otherwise the table of lights may be empty
        row = ops.maximum(light, 0)
        shaped = listed & (tables.lights.image[row] >= 0)
        if ops.any_lane(shaped):
            radiance = ops.where3(shaped, ops.mul(radiance, lights.profile(tables, row, direction)), radiance)
    return radiance


_shape_light = shape_solid_angle.specialize_if_some(_profiled)
shape_radiance = shape_solid_angle.specialize_if_some(emitter_points.textured_radiance)
"""(mark, radiance, …): emitter_points.textured_radiance in scenes with such emitters."""


@helper
def _plate(emitters: Emitters, e: Lane) -> Plate:
    """The rectangle, disk or triangle of a row."""
    return Plate(
        emitters.kind[e],
        (emitters.side_u[e, 0], emitters.side_u[e, 1], emitters.side_u[e, 2]),
        (emitters.side_v[e, 0], emitters.side_v[e, 1], emitters.side_v[e, 2]),
        (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2]),
        emitters.area[e], emitters.both[e], emitters.square[e],
    )  # fmt: skip


@helper
def _sample_tube(reached: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `reached`, or a sample by solid angle of cylinder sides."""
    is_tube = emitters.kind[e] == TUBE
    if ops.any_lane(is_tube):
        direction, distance, angle, cosine = shape_solid_angle.sample_tube(_tube(emitters, e, way), u, v)
        reached = form_samples.select(is_tube, reached, Reached(direction, distance, angle, cosine))
    return reached


@helper
def _sample_round(reached: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `reached`, or a sample by area of cones, tori, capsules and ellipsoids."""
    kind = emitters.kind[e]
    is_round = round_emitters.is_round(kind) & (kind != TUBE)
    if ops.any_lane(is_round):
        place = round_emitters.point(emitters, e, u, v)
        to = ops.add(way, place)
        squared = ops.maximum(ops.dot(to, to), lights.TINY)
        inverse = 1.0 / ops.sqrt(squared)
        towards = ops.scale(to, inverse)
        cosine = -ops.dot(towards, round_emitters.normal(emitters, e, place))
        cosine = ops.where(emitters.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0))
        angle = round_emitters.area_of(emitters, e, place) * cosine * inverse * inverse
        reached = form_samples.select(is_round, reached, Reached(towards, squared * inverse, angle, cosine))
    return reached


_sample_wide_disks, _sample_wide_triangles, _sample_tubes, _sample_rounds = (
    shape_solid_angle.specialize_if_some(each)
    for each in (form_samples.sample_disk, form_samples.sample_triangle, _sample_tube, _sample_round)
)


@helper
def _tube(emitters: Emitters, e: Lane, way: Vec) -> shape_solid_angle.Tube:
    zero = 0.0 * way[0]
    axis = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    side = (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)
    half = ops.sqrt(ops.dot(side, side))
    return shape_solid_angle.tube(way, axis, emitters.side_u[e, 0] + zero, half)


@helper
def density(emitters: Emitters, e: Lane, origin: Vec, direction: Vec, distance: Lane) -> Lane:
    """Return the solid angle density of `sample` for a direction in which emitter e is hit at a distance."""
    kind, plate = emitters.kind[e], _plate(emitters, e)
    way = ops.sub((emitters.place[e, 0], emitters.place[e, 1], emitters.place[e, 2]), origin)
    pdf = form_samples.plate_density(plate, way, direction, distance)
    round_ = kind == SPHERE
    if ops.any_lane(round_):
        pdf = ops.where(round_, form_samples.ball_density(way, emitters.side_u[e, 0]), pdf)
    pdf = _pdf_wide_disks(emitters.wide.disks, pdf, plate, way, direction)
    pdf = _pdf_wide_triangles(emitters.wide.triangles, pdf, plate, way)
    pdf = _pdf_tubes(emitters.wide.tubes, pdf, emitters, e, way, direction, distance)
    return _pdf_rounds(emitters.wide.rounds, pdf, emitters, e, way, direction, distance)


@helper
def _pdf_tube(density: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec, distance: Lane) -> Lane:
    is_tube = emitters.kind[e] == TUBE
    if ops.any_lane(is_tube):
        density = ops.where(is_tube, shape_solid_angle.tube_density(_tube(emitters, e, way), direction, distance), density)
    return density


@helper
def _pdf_round(density: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec, distance: Lane) -> Lane:
    kind = emitters.kind[e]
    is_round = round_emitters.is_round(kind) & (kind != TUBE)
    if ops.any_lane(is_round):
        place = ops.sub(ops.scale(direction, distance), way)
        cosine = ops.absolute(ops.dot(direction, round_emitters.normal(emitters, e, place)))
        area = round_emitters.area_of(emitters, e, place)
        density = ops.where(is_round, distance * distance / ops.maximum(cosine * area, lights.TINY), density)
    return density


_pdf_wide_disks, _pdf_wide_triangles, _pdf_tubes, _pdf_rounds = (
    shape_solid_angle.specialize_if_some(each) for each in (form_samples.disk_density, form_samples.triangle_density, _pdf_tube, _pdf_round)
)
