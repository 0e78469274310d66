"""Samples and densities of the forms of lights and emissive shapes: points, distant disks, plates and balls.

`light_samples.sample` draws them by rows of ir.Lights, `emitters.sample` by rows of the emitter table.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...lights.contract import Form
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Vec
from . import lights, rectangle_solid_angle, shape_solid_angle

POINT, DISTANT, RECTANGLE = int(Form.POINT), int(Form.DISTANT), int(Form.RECTANGLE)
DISK, SPHERE, SKY = int(Form.DISK), int(Form.SPHERE), int(Form.SKY)
TRIANGLE = 20  # of an emissive mesh; further forms are those of round_emitters


class Reached(NamedTuple):
    """A sampled point of a light, seen from a surface."""

    direction: Vec
    distance: Lane
    angle: Lane  # 1 over the solid angle density of the direction; 0 where no light comes from
    cosine: Lane  # at the light, between its surface and the direction


class Plate(NamedTuple):
    """A rectangle, disk or triangle."""

    form: Lane
    side_u: Vec  # half edges, radii of a disk, or edges of a triangle
    side_v: Vec
    normal: Vec
    area: Lane
    both: Lane  # it emits to both sides
    square: Lane  # a rectangle with right angles; a circular disk


@helper
def plate_coordinates(form: Lane, u: Lane, v: Lane) -> tuple[Lane, Lane]:
    """Map u, v uniformly over the area of a plate, in units of its half edges, radii or a triangle's edges."""
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    if ops.any_lane(form == DISK):
        radius, turn = ops.sqrt(u), 2.0 * math.pi * v
        a = ops.where(form == DISK, radius * ops.cos(turn), a)
        b = ops.where(form == DISK, radius * ops.sin(turn), b)
    if ops.any_lane(form == TRIANGLE):
        root = ops.sqrt(u)
        a = ops.where(form == TRIANGLE, root * (1.0 - v), a)
        b = ops.where(form == TRIANGLE, root * v, b)
    return a, b


@helper
def sample_point(lights_: Any, row: Lane, way: Vec, cosine: Lane) -> Reached:
    """The direction to a point, with its fall-off in place of the solid angle."""
    distance = ops.length(way)
    c = lights_.coefficients
    strength = lights.falloff(lights_.falloff[row], c[row, 0], c[row, 1], c[row, 2], distance)
    return Reached(ops.scale(way, 1.0 / ops.maximum(distance, lights.TINY)), distance, strength, cosine)


@helper
def sample_distant(axis: Vec, half: Lane, u: Lane, v: Lane) -> tuple[Vec, Lane]:
    """(direction, irradiance over that of a surface that faces all of it) of a disk about `axis`; half: (1 - cos angle) / 2."""
    return lights.cone_direction(axis, u * 2.0 * half, v), 1.0 / (1.0 - half)


@helper
def sample_ball(way: Vec, radius: Lane, u: Lane, v: Lane) -> Reached:
    """A direction to a ball whose center is `way` off, by solid angle."""
    towards, reach, angle = lights.sample_ball(way, radius, u, v)
    middle = ops.absolute(ops.dot(way, towards) - reach)
    return Reached(towards, reach, angle, middle / ops.maximum(radius, lights.TINY))


@helper
def sample_plate(plate: Plate, way: Vec, u: Lane, v: Lane) -> Reached:
    """Sample a rectangle, disk or triangle `way` off by area, and a near rectangle by solid angle."""
    zero = ops.full_like(u, 0.0)
    a, b = plate_coordinates(plate.form, u, v)
    side_u, side_v = plate.side_u, plate.side_v
    wide = (plate.form == RECTANGLE) & plate.square & rectangle_solid_angle.is_near(way, plate.area)
    filled = zero
    if ops.any_lane(wide):
        rect = _rectangle(plate, way)
        x, y = rectangle_solid_angle.sample(rect, u, v)
        a, b, filled = ops.where(wide, x, a), ops.where(wide, y, b), rect.solid
    to = ops.add(way, ops.add((side_u[0] * a, side_u[1] * a, side_u[2] * a), (side_v[0] * b, side_v[1] * b, side_v[2] * b)))
    squared = ops.maximum(ops.dot(to, to), lights.TINY)
    inverse = 1.0 / ops.sqrt(squared)
    towards = ops.scale(to, inverse)
    cosine = -ops.dot(towards, plate.normal)
    cosine = ops.where(plate.both, ops.absolute(cosine), ops.maximum(cosine, 0.0))
    angle = plate.area * cosine * inverse * inverse
    angle = ops.where(wide, ops.where(cosine > 0.0, filled, 0.0), angle)
    return Reached(towards, squared * inverse, angle, cosine)


@helper
def sample_disk(reached: Reached, plate: Plate, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `reached`, or a sample by solid angle of near circular disks."""
    wide = (plate.form == DISK) & plate.square & rectangle_solid_angle.is_near(way, plate.area)
    if ops.any_lane(wide):
        seen = _ellipse(plate, way)
        towards, reach, angle = shape_solid_angle.sample_disk(seen, u, v)
        angle = ops.where(_emits_toward(plate, towards), angle, 0.0)
        reached = select(wide, reached, Reached(towards, reach, angle, ops.dot(towards, seen.toward)))
    return reached


@helper
def sample_triangle(reached: Reached, plate: Plate, way: Vec, u: Lane, v: Lane) -> Reached:
    """Return `reached`, or a sample by solid angle of near triangles."""
    side_u, side_v = _sides(plate, way)
    wide = (plate.form == TRIANGLE) & shape_solid_angle.fills_much(way, side_u, side_v)
    if ops.any_lane(wide):
        seen = shape_solid_angle.corners(way, side_u, side_v)
        towards = shape_solid_angle.sample_triangle(seen, u, v)
        normal = plate.normal
        along = ops.dot(towards, normal)
        reach = ops.dot(way, normal) / ops.where(ops.absolute(along) > lights.TINY, along, lights.TINY)
        angle = ops.where(_emits_toward(plate, towards), seen.solid, 0.0)
        reached = select(wide, reached, Reached(towards, reach, angle, ops.absolute(along)))
    return reached


@helper
def select(mask: Lane, default: Reached, other: Reached) -> Reached:
    """`other` in the lanes `mask`, else `default`."""
    return Reached(
        ops.where3(mask, other.direction, default.direction), ops.where(mask, other.distance, default.distance),
        ops.where(mask, other.angle, default.angle), ops.where(mask, other.cosine, default.cosine),
    )  # fmt: skip


@helper
def plate_density(plate: Plate, way: Vec, direction: Vec, distance: Lane) -> Lane:
    """The solid angle density of `sample_plate` for a direction in which a plate is hit at a distance."""
    cosine = ops.dot(direction, plate.normal)
    pdf = distance * distance / ops.maximum(ops.absolute(cosine) * plate.area, lights.TINY)
    wide = (plate.form == RECTANGLE) & plate.square & rectangle_solid_angle.is_near(way, plate.area)
    if ops.any_lane(wide):
        pdf = ops.where(wide, 1.0 / _rectangle(plate, way).solid, pdf)
    return pdf


@helper
def ball_density(way: Vec, radius: Lane) -> Lane:
    """The solid angle density of `sample_ball`."""
    return 1.0 / (2.0 * math.pi * lights.ball_height(ops.dot(way, way), radius))


@helper
def disk_density(density: Lane, plate: Plate, way: Vec, direction: Vec) -> Lane:
    """Return `density`, or the density of `sample_disk`."""
    wide = (plate.form == DISK) & plate.square & rectangle_solid_angle.is_near(way, plate.area)
    if ops.any_lane(wide):
        density = ops.where(wide, shape_solid_angle.disk_density(_ellipse(plate, way), direction), density)
    return density


@helper
def triangle_density(density: Lane, plate: Plate, way: Vec) -> Lane:
    """Return `density`, or the density of `sample_triangle`."""
    side_u, side_v = _sides(plate, way)
    wide = (plate.form == TRIANGLE) & shape_solid_angle.fills_much(way, side_u, side_v)
    if ops.any_lane(wide):
        density = ops.where(wide, 1.0 / shape_solid_angle.corners(way, side_u, side_v).solid, density)
    return density


@helper
def _emits_toward(plate: Plate, direction: Vec) -> Lane:
    """Whether a plate hit in a direction emits to this side."""
    cosine = ops.dot(direction, plate.normal)
    return ops.where(plate.both, cosine != 0.0, cosine < 0.0)


@helper
def _sides(plate: Plate, like: Vec) -> tuple[Vec, Vec]:
    zero = 0.0 * like[0]
    u, v = plate.side_u, plate.side_v
    return (u[0] + zero, u[1] + zero, u[2] + zero), (v[0] + zero, v[1] + zero, v[2] + zero)


@helper
def _ellipse(plate: Plate, way: Vec) -> shape_solid_angle.Ellipse:
    zero = 0.0 * way[0]
    normal = (plate.normal[0] + zero, plate.normal[1] + zero, plate.normal[2] + zero)
    radius = ops.sqrt(ops.maximum(plate.area * (1.0 / math.pi) + zero, lights.TINY))
    return shape_solid_angle.ellipse(way, normal, radius)


@helper
def _rectangle(plate: Plate, way: Vec) -> rectangle_solid_angle.SphericalRectangle:
    """The solid angle of a rectangle whose center is `way` off."""
    u, v = _sides(plate, way)
    half_u, half_v = ops.length(u), ops.length(v)
    unit_u = ops.scale(u, 1.0 / ops.maximum(half_u, lights.TINY))
    unit_v = ops.scale(v, 1.0 / ops.maximum(half_v, lights.TINY))
    return rectangle_solid_angle.spherical_rectangle(
        way, unit_u, unit_v, ops.maximum(half_u, lights.TINY), ops.maximum(half_v, lights.TINY)
    )
