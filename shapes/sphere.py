"""A sphere about the origin. An ellipsoid is a sphere under a transform."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.solid_fields import length
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CENTER, RADIUS, shape_entry
from . import closed_meshes, surfaces
from .contract import Element, Emitting, Frame, Lane, Measure, Mitsuba, MitsubaShape, Point, Text, Vec
from .lanes import INF, TURN, helper, nearest, ops, ordered_roots
from .surfaces import Tessellation

KIND = ir.GeometryKind.SPHERE
_RADII = Arg("radii", "size3", (1.0, 1.0, 1.0), "its half axes", above=0.0)
ELEMENTS = (
    Element(
        shape_entry("sphere", "all points at `radius` from `center`", RADIUS, CENTER, example="sphere(1, center: [0, 1, 0])"),
        lambda args: (args["radius"],),
    ),
    Element(
        shape_entry("ellipsoid", "a sphere stretched along the axes", _RADII, CENTER),
        lambda args: (1.0,),
        lambda args: Frame(args["center"], stretch=args["radii"]),
    ),
)
MEASURES = (Measure("radius", above=0.0),)
EXACT, FLAT, WRAPS = False, False, False
OPEN = ("has gaps", "")
USD = {"Sphere": lambda number, axis: (number("radius"),)}
has_sense = deviation = None


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0], p[0], p[0]))


def support(p: Sequence[float], form: np.ndarray) -> float:
    return p[0] * float(np.linalg.norm(form))


@helper
def sphere_interval(radius: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane]:
    """The interval of t inside a sphere centered at the origin.

    The discriminant is r² minus the squared distance of the line, not b² - a c, which cancels for a distant sphere.
    """
    a = ops.dot(direction, direction)
    b = -ops.dot(origin, direction)
    foot = b / a
    x = origin[0] + foot * direction[0]
    y = origin[1] + foot * direction[1]
    z = origin[2] + foot * direction[2]
    distance = ops.sqrt(x * x + y * y + z * z)
    away = ops.sqrt(ops.dot(origin, origin))
    discriminant = a * (radius - distance) * (radius + distance)
    lo, hi = ordered_roots(a, b, (away - radius) * (away + radius), discriminant)
    hit = discriminant >= 0.0
    return ops.where(hit, lo, INF), ops.where(hit, hi, -INF)


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    lo, hi = sphere_interval(parameters[g, 0], origin, direction)
    return nearest(lo, hi, t_min, t_max), kind * 0


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    return point


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Longitude, 0.5 at +z and the seam at -z, and latitude, 0 at the south pole."""
    radius = parameters[g, 0]
    return (longitude, 0.5 + ops.atan2(point[1], rho) / math.pi), (TURN * radius, math.pi * radius)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    return b.offset(length(b, point), -p[0])


def is_closed(p: Sequence[float]) -> bool:
    return True


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((p[0], 0.5), (p[0], 0.5))


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    return surfaces.revolve([surfaces.sphere_profile(p[0], tolerance)], surfaces.segments(p[0], tolerance / 2))


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float]:
    count = closed_meshes.chords(p[0], 0.5 * tolerance)
    arc = closed_meshes.arc(p[0], 0.0, count // 2)
    return *closed_meshes.revolved(arc, count), 2 * closed_meshes.sagitta(p[0], count)


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    return "sphere", [f"  0, {text.number(p[0])}"]


def mitsuba(p: Sequence[float]) -> Mitsuba:
    return Mitsuba("even", (MitsubaShape("sphere", radius=p[0], points={"center": (0.0, 0.0, 0.0)}),))


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("sphere", (p[0], p[0]))
