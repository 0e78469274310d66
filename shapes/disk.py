"""A disk of the plane y = 0 about the origin, normal +y."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.solid_fields import NoSolid
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CENTER, RADIUS, shape_entry
from . import surfaces
from .contract import Element, Emitting, Frame, Lane, Measure, Mitsuba, MitsubaShape, Point, Text, Vec
from .lanes import INF, helper, ops, plane_root
from .lanes import up as normal  # noqa: F401
from .surfaces import Tessellation

KIND = ir.GeometryKind.DISK
ELEMENTS = (
    Element(
        shape_entry("disk", "a flat disk", RADIUS, CENTER, Arg("normal", "direction", (0.0, 1.0, 0.0), "its normal"), example="disk(1)"),
        lambda args: (args["radius"],),
        lambda args: Frame(args["center"], args["normal"]),
    ),
)
MEASURES = (Measure("radius", above=0.0),)
EXACT, FLAT, WRAPS = False, True, False
OPEN = ("has no thickness", "a flat `cylinder` has an inside")
USD = {}
has_sense = deviation = closed_mesh = None


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0], 0.0, p[0]))


def support(p: Sequence[float], form: np.ndarray) -> float:
    return p[0] * math.hypot(form[0], form[2])


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    radius, t = parameters[g, 0], plane_root(origin, direction, t_min, t_max)
    x = origin[0] + t * direction[0]
    z = origin[2] + t * direction[2]
    return ops.where(x * x + z * z <= radius * radius, t, INF), kind * 0


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """x and -z, from 0 to 1."""
    radius = parameters[g, 0]
    return (0.5 + 0.5 * point[0] / radius, 0.5 + 0.5 * -point[2] / radius), (2.0 * radius, 2.0 * radius)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    raise NoSolid("a disk has no inside")


def is_closed(p: Sequence[float]) -> bool:
    return False


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((p[0], 1.0),)


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    tessellation = surfaces.revolve([surfaces.disk_profile(p[0], 0.0, 1.0, 0)], surfaces.segments(p[0], tolerance))
    return surfaces.without_uvs(tessellation)


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    return "disc", [f"  0, <0, 1, 0>, {text.number(p[0])}"]


def mitsuba(p: Sequence[float]) -> Mitsuba:
    return Mitsuba("even", (MitsubaShape("disk", surfaces.LEVEL @ np.diag([p[0], p[0], 1.0, 1.0])),))


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("disk", (p[0], p[0]))
