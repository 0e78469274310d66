"""Sampling of disks, triangles and cylinders by solid angle.

A disk is a spherical ellipse (Guillén, Ureña, King, Fajardo, Georgiev, López-Moreno, Jarabo 2017, "Area-Preserving Parameterizations for
Spherical Ellipses", whose polar map inverts elliptic integrals). Here the azimuth is sampled as on a flat ellipse that is exact at both
axes, and the height exactly: densities are exact, and uniform to some per cent. Triangles: Peters 2021, "BRDF Importance Sampling for
Polygonal Lights" (§3.1), after Arvo 1995. The side of a cylinder: the rectangle in front of it (Gamito 2016, "Solid Angle Sampling of
Disk and Cylinder Lights"); some directions miss the cylinder at its ends.

Scenes without such emitters compile none of it: the fields of `Wide` are types.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from ..jit.kernel import helper, noinline_helper
from ..lanes import ops
from ..simd.registration import overload
from ..types import Lane, Vec
from . import lights, rectangle_solid_angle

CAP = 0.02  # steradians below which a cylinder's rectangle is sampled by area, against cancellation


class NoLights(NamedTuple):
    """A scene has no such emitters."""


class HasLights(NamedTuple):
    """A scene has such emitters."""

    count: int


class Wide(NamedTuple):
    """The shapes among a scene's emitters: NoLights or Some each."""

    disks: Any
    triangles: Any
    tubes: Any
    rounds: Any  # cones, tori and capsules
    profiles: Any  # lights of any shape whose emission depends on the direction by an image
    textures: Any  # shapes whose material emits by a texture


def specialize_if_some(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `chosen(mark, default, …)`: `default` in scenes without such emitters, else function(default, …)."""

    def chosen(mark: Any, default: Any, *arguments: Any) -> Any:
        return function(default, *arguments) if isinstance(mark, HasLights) else default

    @overload(chosen)
    def _in_kernels(mark, default, *arguments):
        if mark.layout:
            return lambda mark, default, *arguments: function(default, *arguments)
        return lambda mark, default, *arguments: default

    return chosen


# --- disks ---------------------------------------------------------------------------------------------------------------


class Ellipse(NamedTuple):
    """A spherical ellipse: the cone around `axis` with the half angles of cot_x and cot_y along x and y."""

    axis: Vec
    x: Vec
    y: Vec
    cot_x: Lane
    cot_y: Lane
    sin_x: Lane  # of half the half angle
    sin_y: Lane
    toward: Vec  # normal of the disk's plane, away from the viewpoint
    height: Lane  # of the viewpoint above the plane


@helper
def ellipse(way: Vec, normal: Vec, radius: Lane) -> Ellipse:
    """Return the spherical ellipse of a disk centered at `way`.

    In the plane of symmetry the axis bisects the angle between the vectors d₁, d₂ to the nearest and farthest points. It intersects the
    disk where the half chord is 2 R √(|d₁| |d₂|) / (|d₁| + |d₂|), by the angle bisector theorem.
    """
    off = ops.dot(way, normal)
    toward = ops.scale(normal, ops.where(off < 0.0, -1.0, 1.0))
    height = ops.maximum(ops.absolute(off), 1e-6 * radius)
    flat = ops.sub(way, ops.scale(toward, ops.absolute(off)))
    aside2 = ops.dot(flat, flat)
    off_axis = aside2 > 1e-12 * radius * radius
    aside = ops.where(off_axis, ops.sqrt(ops.where(off_axis, aside2, 1.0)), 0.0)
    side = ops.where3(off_axis, ops.scale(flat, 1.0 / ops.where(off_axis, aside, 1.0)), ops.basis(toward)[0])
    near, far = aside - radius, aside + radius
    to_near, to_far = ops.sqrt(near * near + height * height), ops.sqrt(far * far + height * height)
    both = to_near * to_far
    crossed, along = 2.0 * height * radius, near * far + height * height
    # tan (γ/2) = sin γ / (1 + cos γ) = (1 - cos γ) / sin γ of the whole angle γ, whichever is free of cancellation
    cot_x = ops.where(along > 0.0, (both + along) / crossed, crossed / ops.maximum(both - along, lights.TINY))
    middle = (near * to_far + far * to_near) / (to_near + to_far)
    reach = ops.sqrt(middle * middle + height * height)
    cot_y = 0.5 * reach * (to_near + to_far) / (radius * ops.sqrt(both))
    inverse = 1.0 / reach
    axis = ops.scale(ops.add(ops.scale(side, middle), ops.scale(toward, height)), inverse)
    x = ops.scale(ops.sub(ops.scale(side, height), ops.scale(toward, middle)), inverse)
    return Ellipse(axis, x, ops.cross(axis, x), cot_x, cot_y, _half_sine(cot_x), _half_sine(cot_y), toward, height)


@helper
def _half_sine(cot: Lane) -> Lane:
    """sin (α/2), from cot α: of 1 - cos α = 2 sin² (α/2)."""
    return ops.sqrt(0.5 * _depth(cot))


@helper
def _depth(cot: Lane) -> Lane:
    """1 - cos α, from cot α, without cancellation."""
    root = ops.sqrt(1.0 + cot * cot)
    return 1.0 / (root * (root + cot))


@helper
def _inverse_density(seen: Ellipse, c: Lane, s: Lane) -> tuple[Lane, Lane]:
    """(1 over the density, 1 - cos of the cone) at the azimuth of cosine c and sine s."""
    a, b = c * seen.cot_x, s * seen.cot_y
    depth = _depth(ops.sqrt(a * a + b * b))
    p, q = seen.sin_y * c, seen.sin_x * s
    return depth * 2.0 * math.pi * (p * p + q * q) / (seen.sin_x * seen.sin_y), depth


@noinline_helper
def sample_disk(seen: Ellipse, u: Lane, v: Lane) -> tuple[Vec, Lane, Lane]:
    """(direction, distance, 1 over the density) of a sampled point of a disk."""
    turn = 2.0 * math.pi * v
    p, q = seen.sin_x * ops.cos(turn), seen.sin_y * ops.sin(turn)
    inverse = 1.0 / ops.sqrt(ops.maximum(p * p + q * q, lights.TINY))
    c, s = p * inverse, q * inverse
    angle, depth = _inverse_density(seen, c, s)
    below = u * depth
    sine = ops.sqrt(below * (2.0 - below))
    direction = ops.in_basis(seen.x, seen.y, seen.axis, sine * c, sine * s, 1.0 - below)
    return direction, seen.height / ops.maximum(ops.dot(direction, seen.toward), lights.TINY), angle


@noinline_helper
def disk_density(seen: Ellipse, direction: Vec) -> Lane:
    """Return the solid angle density of `draw_disk`."""
    x, y = ops.dot(direction, seen.x), ops.dot(direction, seen.y)
    inverse = 1.0 / ops.sqrt(ops.maximum(x * x + y * y, lights.TINY))
    return 1.0 / ops.maximum(_inverse_density(seen, x * inverse, y * inverse)[0], lights.TINY)


# --- triangles -----------------------------------------------------------------------------------------------------------


class Corners(NamedTuple):
    """A spherical triangle: directions to its corners, and the terms of its solid angle Ω."""

    a: Vec
    b: Vec
    c: Vec
    volume: Lane  # |a · (b × c)|
    across: Lane  # (a + b) · c
    between: Lane  # 1 + a · b
    solid: Lane  # Ω: tan Ω/2 = volume / (between + across) (van Oosterom and Strackee 1983)


@helper
def fills_much(way: Vec, u: Vec, v: Vec) -> Lane:
    """Whether a triangle with a corner at `way` and edges u, v is so near that solid angle sampling pays."""
    middle = ops.add(way, ops.scale(ops.add(u, v), 1.0 / 3.0))
    return ops.dot(middle, middle) < ops.dot(u, u) + ops.dot(v, v)


@helper
def corners(way: Vec, u: Vec, v: Vec) -> Corners:
    """Return the spherical triangle of one with a corner at `way` and edges u, v."""
    to_b, to_c = ops.add(way, u), ops.add(way, v)
    far_a, far_b, far_c = ops.length(way), ops.length(to_b), ops.length(to_c)
    inverse_a, inverse_b = 1.0 / ops.maximum(far_a, lights.TINY), 1.0 / ops.maximum(far_b, lights.TINY)
    inverse_c = 1.0 / ops.maximum(far_c, lights.TINY)
    a, b, c = ops.scale(way, inverse_a), ops.scale(to_b, inverse_b), ops.scale(to_c, inverse_c)
    volume = ops.absolute(ops.dot(way, ops.cross(u, v))) * inverse_a * inverse_b * inverse_c
    across, between = ops.dot(ops.add(a, b), c), 1.0 + ops.dot(a, b)
    solid_angle = 2.0 * ops.atan2(volume, between + across)
    return Corners(a, b, c, volume, across, between, ops.maximum(solid_angle, lights.TINY))


@noinline_helper
def sample_triangle(seen: Corners, u: Lane, v: Lane) -> Vec:
    """Sample a direction uniformly: u moves the corner c along its arc to the solid angle u Ω, v goes along the arc from b."""
    half = 0.5 * u * seen.solid
    sine, cosine = ops.sin(half), ops.cos(half)
    middle = ops.add(
        ops.scale(seen.a, seen.volume * cosine - seen.across * sine), ops.scale(seen.c, seen.between * sine)
    )  # half-way from a to the moved corner
    twice = 2.0 * ops.dot(seen.a, middle) / ops.maximum(ops.dot(middle, middle), lights.TINY)
    moved = ops.sub(ops.scale(middle, twice), seen.a)
    s2 = ops.dot(seen.b, moved)
    s = 1.0 + v * (s2 - 1.0)
    below = 1.0 - s2 * s2
    t = ops.where(below > 1e-12, ops.sqrt(ops.maximum(1.0 - s * s, 0.0) / ops.maximum(below, 1e-12)), v)
    return ops.normalize(ops.add(ops.scale(seen.b, s - t * s2), ops.scale(moved, t)))


# --- cylinders -----------------------------------------------------------------------------------------------------------


class Tube(NamedTuple):
    """The side of a cylinder, seen through the rectangle in front of it."""

    rect: rectangle_solid_angle.SphericalRectangle
    onward: Vec  # unit, toward the axis, perpendicular to it
    sideways: Vec
    axis: Vec
    aside: Vec  # to the nearest point of the axis
    middle: Vec  # of the rectangle
    half_width: Lane
    half_height: Lane
    plane: Lane  # the rectangle's distance
    apart: Lane  # D, the axis's distance
    radius: Lane  # R
    low: Lane  # the cylinder's ends along its axis
    high: Lane
    outside: Lane  # bool: whether D > R
    even: Lane  # bool: uniform by the rectangle's solid angle; else by its area


@helper
def tube(way: Vec, axis: Vec, radius: Lane, half: Lane) -> Tube:
    """Return the record of a cylinder centered at `way`."""
    along = ops.dot(way, axis)
    aside = ops.sub(way, ops.scale(axis, along))
    apart_ = ops.length(aside)
    outside = apart_ > radius * 1.00001
    apart_ = ops.where(outside, apart_, 2.0 * radius)
    onward = ops.where3(outside, ops.scale(aside, 1.0 / apart_), ops.basis(axis)[0])
    sideways = ops.cross(axis, onward)
    beyond = (apart_ - radius) * (apart_ + radius)
    plane, half_width = beyond / apart_, radius * ops.sqrt(beyond) / apart_
    low, high = along - half, along + half
    nearer = (apart_ + radius) / apart_  # perspective scale of the nearest line in the rectangle's plane
    bottom, top = ops.minimum(low, low * nearer), ops.maximum(high, high * nearer)
    half_height = 0.5 * (top - bottom)
    middle = ops.add(ops.scale(onward, plane), ops.scale(axis, 0.5 * (bottom + top)))
    rect = rectangle_solid_angle.spherical_rectangle(middle, sideways, axis, half_width, half_height)
    return Tube(
        rect, onward, sideways, axis, aside, middle, half_width, half_height, plane, apart_, radius, low, high, outside, rect.solid > CAP
    )  # fmt: skip


@helper
def _inverse_density_through(seen: Tube, direction: Vec) -> Lane:
    """1 over the density of a direction through the rectangle."""
    forth = ops.maximum(ops.dot(direction, seen.onward), lights.TINY)
    by_area = 4.0 * seen.half_width * seen.half_height * forth * forth * forth / (seen.plane * seen.plane)
    return ops.where(seen.even, seen.rect.solid, by_area)


@helper
def _inverse_density_inside(seen: Tube, out: Vec, direction: Vec, reach2: Lane) -> Lane:
    """1 over the density of a direction from inside the cylinder, where sampling is by area; `out` is the normal there."""
    area = 2.0 * math.pi * seen.radius * (seen.high - seen.low)
    between = (seen.low < 0.0) & (seen.high > 0.0)
    return ops.where(between, area * ops.absolute(ops.dot(direction, out)) / reach2, 0.0)


@noinline_helper
def sample_tube(seen: Tube, u: Lane, v: Lane) -> tuple[Vec, Lane, Lane, Lane]:
    """(direction, distance, 1 over the density, cosine) of a sample of a cylinder's side; 0 in place of 1 over the density for misses."""
    x, y = rectangle_solid_angle.sample(seen.rect, u, v)
    x, y = ops.where(seen.even, x, 2.0 * u - 1.0), ops.where(seen.even, y, 2.0 * v - 1.0)
    across = ops.add(ops.scale(seen.sideways, x * seen.half_width), ops.scale(seen.axis, y * seen.half_height))
    direction = ops.normalize(ops.add(seen.middle, across))
    forth, sideways = ops.dot(direction, seen.onward), ops.dot(direction, seen.sideways)
    flat2 = forth * forth + sideways * sideways
    most, off = seen.radius * ops.sqrt(flat2), seen.apart * ops.absolute(sideways)
    root = ops.sqrt(ops.maximum((most - off) * (most + off), 0.0))
    distance = (seen.apart * forth - root) / flat2
    height = distance * ops.dot(direction, seen.axis)
    angle = ops.where((height >= seen.low) & (height <= seen.high), _inverse_density_through(seen, direction), 0.0)
    cosine = root / seen.radius
    inside = ops.not_(seen.outside)
    if ops.any_lane(inside):
        turn = 2.0 * math.pi * u
        out = ops.add(ops.scale(seen.onward, ops.cos(turn)), ops.scale(seen.sideways, ops.sin(turn)))
        up = ops.scale(seen.axis, seen.low + v * (seen.high - seen.low))
        point = ops.add(ops.add(seen.aside, ops.scale(out, seen.radius)), up)
        reach2 = ops.maximum(ops.dot(point, point), lights.TINY)
        reach = ops.sqrt(reach2)
        to = ops.scale(point, 1.0 / reach)
        direction, distance = ops.where3(inside, to, direction), ops.where(inside, reach, distance)
        angle = ops.where(inside, _inverse_density_inside(seen, out, to, reach2), angle)
        cosine = ops.where(inside, ops.absolute(ops.dot(to, out)), cosine)
    return direction, distance, angle, cosine


@noinline_helper
def tube_density(seen: Tube, direction: Vec, distance: Lane) -> Lane:
    """Return the solid angle density of `draw_tube`."""
    point = ops.sub(ops.scale(direction, distance), seen.aside)
    out = ops.sub(point, ops.scale(seen.axis, ops.dot(point, seen.axis)))
    out = ops.scale(out, 1.0 / seen.radius)
    inside = _inverse_density_inside(seen, out, direction, distance * distance)
    angle = ops.where(seen.outside, _inverse_density_through(seen, direction), inside)
    return 1.0 / ops.maximum(angle, lights.TINY)
