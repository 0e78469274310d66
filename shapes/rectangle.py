"""A rectangle of the plane y = 0 about the origin, normal +y: of area lights and of USD's Plane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.solid_fields import NoSolid
from . import surfaces
from .contract import Emitting, Lane, Measure, Mitsuba, MitsubaShape, Point, Vec
from .lanes import INF, helper, ops, plane_root
from .lanes import up as normal  # noqa: F401
from .surfaces import Tessellation

KIND = ir.GeometryKind.RECTANGLE
ELEMENTS = ()
MEASURES = (Measure("half x", above=0.0), Measure("half z", above=0.0))
EXACT, FLAT, WRAPS = True, True, False
OPEN = ("has no thickness", "a thin `box` has an inside")
USD = {"Plane": lambda number, axis: tuple(number(side) / 2 for side in (("length", "width") if axis == "X" else ("width", "length")))}
has_sense = support = deviation = closed_mesh = povray = None


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0], 0.0, p[1]))


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    t = plane_root(origin, direction, t_min, t_max)
    x = origin[0] + t * direction[0]
    z = origin[2] + t * direction[2]
    return ops.where((abs(x) <= parameters[g, 0]) & (abs(z) <= parameters[g, 1]), t, INF), kind * 0


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """x and -z, from 0 to 1."""
    x, z = parameters[g, 0], parameters[g, 1]
    return (0.5 + 0.5 * point[0] / x, 0.5 + 0.5 * -point[2] / z), (2.0 * x, 2.0 * z)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    raise NoSolid("a rectangle has no inside")


def is_closed(p: Sequence[float]) -> bool:
    return False


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ()


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    """Two triangles."""
    positions = np.stack([surfaces.CORNERS[:, 0] * p[0], np.zeros(4), surfaces.CORNERS[:, 1] * p[1]], axis=1)
    return surfaces.flat(positions, surfaces.HALVES, np.tile([0.0, 1.0, 0.0], (4, 1)))


def mitsuba(p: Sequence[float]) -> Mitsuba:
    return Mitsuba("orthogonal", (MitsubaShape("rectangle", surfaces.LEVEL @ np.diag([p[0], p[1], 1.0, 1.0])),))


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("rectangle", (p[0], p[1]))
