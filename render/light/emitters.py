"""Sampling of emitters, and the densities of their samples.

`sample` draws a point of one emitter, or a direction to it, for each lane; `density` is the density of the same direction, for multiple
importance sampling (Veach 1997, chapter 9).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Tables, Vec
from . import emitter_points, environment_map, lights, rectangle_solid_angle, round_emitters, shape_solid_angle
from .emitter_table import DIRECTIONAL, DISK, DOME, POINT, RECTANGLE, SPHERE, SPOT, SUN, TRIANGLE, TUBE, Emitters


class Reached(NamedTuple):
    """A sampled point of an emitter, seen from a surface."""

    direction: Vec
    distance: Lane
    angle: Lane  # 1 over the solid angle density of the direction; 0 where no light comes from
    cosine: Lane  # at the emitter, between its surface and the direction


class Arriving(NamedTuple):
    """A light sample: its direction, irradiance and density."""

    direction: Vec
    distance: Lane  # inf for distant lights
    light: Vec  # irradiance of a surface facing it, over the density: samples average to the irradiance
    density: Lane  # over solid angle; inf if the direction is the only one
    cosine: Lane  # at the emitter; 1 without a surface


@helper
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
        reached = _select(flat, reached, _sample_plate(emitters, e, way, normal, u, v))
    reached = _sample_tubes(emitters.wide.tubes, reached, emitters, e, way, u, v)
    reached = _sample_rounds(emitters.wide.rounds, reached, emitters, e, way, u, v)
    flat = flat | round_emitters.is_round(kind)
    density = ops.where(flat, 1.0 / ops.maximum(reached.angle, lights.TINY), density)
    round_ = kind == SPHERE
    if ops.any_lane(round_):
        ball = _sample_ball(emitters, e, way, u, v)
        reached = _select(round_, reached, ball)
        density = ops.where(round_, 1.0 / ball.angle, density)
    small = (kind == POINT) | (kind == SPOT)
    if ops.any_lane(small):
        reached = _select(small, reached, _sample_point(tables, emitters, e, way, normal, reached.cosine))
    color = shape_radiance(emitters.wide.textures, color, tables, emitters, e, position, reached.direction, reached.distance)
    direction, strength = reached.direction, reached.angle
    far = (kind == DIRECTIONAL) | (kind == SUN)
    if ops.any_lane(far):
        row = ops.maximum(emitters.light[e], 0)
        half = ops.sin(0.5 * (tables.lights.angle[row] + zero))
        half = ops.where(kind == SUN, half * half, zero)
        towards = lights.cone_direction(normal, u * 2.0 * half, v)  # `color` is the irradiance of a surface that faces all of it
        direction = ops.where3(far, towards, direction)
        strength = ops.where(far, 1.0 / (1.0 - half), strength)
    light = _shape_light(emitters.wide.profiles, ops.scale(color, strength), tables, emitters, e, direction)
    above = kind == DOME
    if ops.any_lane(above):
        towards, radiance, likely = environment_map.sample(emitters.sky, tables, position, u, v)
        direction, density = ops.where3(above, towards, direction), ops.where(above, likely, density)
        light = ops.where3(above, ops.scale(radiance, 1.0 / ops.maximum(likely, lights.TINY)), light)
    return Arriving(direction, reached.distance, light, density, reached.cosine)


@helper
def _profiled(plain: Vec, tables: Tables, emitters: Emitters, e: Lane, direction: Vec) -> Vec:
    """Return `plain` times the factors of lights whose emission depends on the direction."""
    light = emitters.light[e]
    listed = (light >= 0) & (emitters.kind[e] != DOME)
    if ops.any_lane(listed):  # otherwise the table of lights may be empty
        row = ops.maximum(light, 0)
        shaped = listed & (tables.lights.image[row] >= 0)
        if ops.any_lane(shaped):
            plain = ops.where3(shaped, ops.mul(plain, lights.profile(tables, row, direction)), plain)
    return plain


_shape_light = shape_solid_angle.specialize_if_some(_profiled)
shape_radiance = shape_solid_angle.specialize_if_some(emitter_points.textured_radiance)
"""(mark, plain, …): emitter_points.textured_radiance in scenes with such emitters."""


@helper
def _sample_plate(emitters: Emitters, e: Lane, way: Vec, normal: Vec, u: Lane, v: Lane) -> Reached:
    """Sample a rectangle, disk or triangle: by area, or by solid angle where it is near."""
    kind, zero = emitters.kind[e], ops.full_like(u, 0.0)
    a, b = emitter_points.plate_coordinates(kind, u, v)
    side_u = (emitters.side_u[e, 0], emitters.side_u[e, 1], emitters.side_u[e, 2])
    side_v = (emitters.side_v[e, 0], emitters.side_v[e, 1], emitters.side_v[e, 2])
    wide = (kind == RECTANGLE) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    filled = zero
    if ops.any_lane(wide):
        rect = _rectangle(emitters, e, way)
        x, y = rectangle_solid_angle.sample_noinline(rect, u, v)
        a, b, filled = ops.where(wide, x, a), ops.where(wide, y, b), rect.solid
    to = ops.add(way, ops.add((side_u[0] * a, side_u[1] * a, side_u[2] * a), (side_v[0] * b, side_v[1] * b, side_v[2] * b)))
    squared = ops.maximum(ops.dot(to, to), lights.TINY)
    inverse = 1.0 / ops.sqrt(squared)
    towards = ops.scale(to, inverse)
    cosine = -ops.dot(towards, normal)
    cosine = ops.where(emitters.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0))
    angle = emitters.area[e] * cosine * inverse * inverse
    angle = ops.where(wide, ops.where(cosine > 0.0, filled, 0.0), angle)
    reached = _sample_wide_disks(emitters.wide.disks, Reached(towards, squared * inverse, angle, cosine), emitters, e, way, u, v)
    return _sample_wide_triangles(emitters.wide.triangles, reached, emitters, e, way, u, v)


@helper
def _sample_ball(emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    radius = emitters.side_u[e, 0] + ops.full_like(u, 0.0)
    towards, reach, angle = lights.sample_ball(way, radius, u, v)
    middle = ops.absolute(ops.dot(way, towards) - reach)
    return Reached(towards, reach, angle, middle / ops.maximum(radius, lights.TINY))


@helper
def _sample_point(tables: Tables, emitters: Emitters, e: Lane, way: Vec, normal: Vec, cosine: Lane) -> Reached:
    """The direction to a point light or spotlight, with its falloff in place of the solid angle."""
    reach = ops.length(way)
    towards = ops.scale(way, 1.0 / ops.maximum(reach, lights.TINY))
    row = ops.maximum(emitters.light[e], 0)
    c = tables.lights.coefficients
    left = lights.falloff(tables.lights.falloff[row], c[row, 0], c[row, 1], c[row, 2], reach)
    cone = lights.spot_share(ops.dot(towards, normal), tables.lights.cos_cone[row], tables.lights.cos_full[row])
    return Reached(towards, reach, left * ops.where(emitters.kind[e] == SPOT, cone, ops.full_like(reach, 1.0)), cosine)


@helper
def _sample_disk(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `plain`, or a sample by solid angle of near circular disks."""
    wide = (emitters.kind[e] == DISK) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        seen = _ellipse(emitters, e, way)
        towards, reach, angle = shape_solid_angle.sample_disk(seen, u, v)
        angle = ops.where(_emits_toward(emitters, e, towards), angle, 0.0)
        plain = _select(wide, plain, Reached(towards, reach, angle, ops.dot(towards, seen.toward)))
    return plain


@helper
def _sample_triangle(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `plain`, or a sample by solid angle of near triangles."""
    one, other = _sides(emitters, e, way)
    wide = (emitters.kind[e] == TRIANGLE) & shape_solid_angle.fills_much(way, one, other)
    if ops.any_lane(wide):
        seen = shape_solid_angle.corners(way, one, other)
        towards = shape_solid_angle.sample_triangle(seen, u, v)
        normal = (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2])
        along = ops.dot(towards, normal)
        reach = ops.dot(way, normal) / ops.where(ops.absolute(along) > lights.TINY, along, lights.TINY)
        angle = ops.where(_emits_toward(emitters, e, towards), seen.solid, 0.0)
        plain = _select(wide, plain, Reached(towards, reach, angle, ops.absolute(along)))
    return plain


@helper
def _sample_tube(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `plain`, or a sample by solid angle of cylinder sides."""
    here = emitters.kind[e] == TUBE
    if ops.any_lane(here):
        direction, distance, angle, cosine = shape_solid_angle.sample_tube(_tube(emitters, e, way), u, v)
        plain = _select(here, plain, Reached(direction, distance, angle, cosine))
    return plain


@helper
def _sample_round(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `plain`, or a sample by area of cones, tori, capsules and ellipsoids."""
    kind = emitters.kind[e]
    here = round_emitters.is_round(kind) & (kind != TUBE)
    if ops.any_lane(here):
        place = round_emitters.point(emitters, e, u, v)
        to = ops.add(way, place)
        squared = ops.maximum(ops.dot(to, to), lights.TINY)
        inverse = 1.0 / ops.sqrt(squared)
        towards = ops.scale(to, inverse)
        cosine = -ops.dot(towards, round_emitters.normal(emitters, e, place))
        cosine = ops.where(emitters.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0))
        angle = round_emitters.area_of(emitters, e, place) * cosine * inverse * inverse
        plain = _select(here, plain, Reached(towards, squared * inverse, angle, cosine))
    return plain


_sample_wide_disks, _sample_wide_triangles, _sample_tubes, _sample_rounds = (
    shape_solid_angle.specialize_if_some(each) for each in (_sample_disk, _sample_triangle, _sample_tube, _sample_round)
)


@helper
def _select(here: Lane, plain: Reached, other: Reached) -> Reached:
    return Reached(
        ops.where3(here, other.direction, plain.direction), ops.where(here, other.distance, plain.distance),
        ops.where(here, other.angle, plain.angle), ops.where(here, other.cosine, plain.cosine),
    )  # fmt: skip


@helper
def _emits_toward(emitters: Emitters, e: Lane, direction: Vec) -> Lane:
    """Whether an emitter hit in a direction emits to this side."""
    cosine = ops.dot(direction, (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2]))
    return ops.where(emitters.both[e], cosine != 0.0, cosine < 0.0)


@helper
def _sides(emitters: Emitters, e: Lane, like: Vec) -> tuple[Vec, Vec]:
    zero = 0.0 * like[0]
    u = (emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero, emitters.side_u[e, 2] + zero)
    return u, (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)


@helper
def _ellipse(emitters: Emitters, e: Lane, way: Vec) -> shape_solid_angle.Ellipse:
    zero = 0.0 * way[0]
    normal = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    radius = ops.sqrt(ops.maximum(emitters.area[e] * (1.0 / math.pi) + zero, lights.TINY))
    return shape_solid_angle.ellipse(way, normal, radius)


@helper
def _tube(emitters: Emitters, e: Lane, way: Vec) -> shape_solid_angle.Tube:
    zero = 0.0 * way[0]
    axis = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    half = ops.sqrt(ops.dot(_sides(emitters, e, way)[1], _sides(emitters, e, way)[1]))
    return shape_solid_angle.tube(way, axis, emitters.side_u[e, 0] + zero, half)


@helper
def _rectangle(emitters: Emitters, e: Lane, way: Vec) -> rectangle_solid_angle.SphericalRectangle:
    """The solid angle of a rectangle whose center is `way` off."""
    zero = 0.0 * way[0]
    u = (emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero, emitters.side_u[e, 2] + zero)
    v = (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)
    half_u, half_v = ops.length(u), ops.length(v)
    unit_u = ops.scale(u, 1.0 / ops.maximum(half_u, lights.TINY))
    unit_v = ops.scale(v, 1.0 / ops.maximum(half_v, lights.TINY))
    return rectangle_solid_angle.spherical_rectangle_noinline(
        way, unit_u, unit_v, ops.maximum(half_u, lights.TINY), ops.maximum(half_v, lights.TINY)
    )


@helper
def density(emitters: Emitters, e: Lane, origin: Vec, direction: Vec, distance: Lane) -> Lane:
    """Return the solid angle density of `sample` for a direction in which emitter e is hit at a distance."""
    kind = emitters.kind[e]
    cosine = ops.dot(direction, (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2]))
    pdf = distance * distance / ops.maximum(ops.absolute(cosine) * emitters.area[e], lights.TINY)
    round_ = kind == SPHERE
    way = ops.sub((emitters.place[e, 0], emitters.place[e, 1], emitters.place[e, 2]), origin)
    if ops.any_lane(round_):
        angle = 2.0 * math.pi * lights.ball_height(ops.dot(way, way), emitters.side_u[e, 0])
        pdf = ops.where(round_, 1.0 / angle, pdf)
    wide = (kind == RECTANGLE) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        pdf = ops.where(wide, 1.0 / _rectangle(emitters, e, way).solid, pdf)
    pdf = _pdf_wide_disks(emitters.wide.disks, pdf, emitters, e, way, direction)
    pdf = _pdf_wide_triangles(emitters.wide.triangles, pdf, emitters, e, way)
    pdf = _pdf_tubes(emitters.wide.tubes, pdf, emitters, e, way, direction, distance)
    return _pdf_rounds(emitters.wide.rounds, pdf, emitters, e, way, direction, distance)


@helper
def _pdf_disk(plain: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec) -> Lane:
    wide = (emitters.kind[e] == DISK) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        plain = ops.where(wide, shape_solid_angle.disk_density(_ellipse(emitters, e, way), direction), plain)
    return plain


@helper
def _pdf_triangle(plain: Lane, emitters: Emitters, e: Lane, way: Vec) -> Lane:
    one, other = _sides(emitters, e, way)
    wide = (emitters.kind[e] == TRIANGLE) & shape_solid_angle.fills_much(way, one, other)
    if ops.any_lane(wide):
        plain = ops.where(wide, 1.0 / shape_solid_angle.corners(way, one, other).solid, plain)
    return plain


@helper
def _pdf_tube(plain: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec, distance: Lane) -> Lane:
    here = emitters.kind[e] == TUBE
    if ops.any_lane(here):
        plain = ops.where(here, shape_solid_angle.tube_density(_tube(emitters, e, way), direction, distance), plain)
    return plain


@helper
def _pdf_round(plain: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec, distance: Lane) -> Lane:
    kind = emitters.kind[e]
    here = round_emitters.is_round(kind) & (kind != TUBE)
    if ops.any_lane(here):
        place = ops.sub(ops.scale(direction, distance), way)
        cosine = ops.absolute(ops.dot(direction, round_emitters.normal(emitters, e, place)))
        area = round_emitters.area_of(emitters, e, place)
        plain = ops.where(here, distance * distance / ops.maximum(cosine * area, lights.TINY), plain)
    return plain


_pdf_wide_disks, _pdf_wide_triangles, _pdf_tubes, _pdf_rounds = (
    shape_solid_angle.specialize_if_some(each) for each in (_pdf_disk, _pdf_triangle, _pdf_tube, _pdf_round)
)
