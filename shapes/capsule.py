"""A cylinder about the y axis with half spheres for ends: its radius, and half the height of the cylinder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..compiler.formula.solid_fields import length
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CENTER, shape_entry
from . import closed_meshes, surfaces
from .cone import cone_interval
from .contract import Element, Emitting, Lane, Measure, Point, Vec
from .lanes import TURN, helper, nearest, ops
from .sphere import sphere_interval
from .surfaces import Profile, Tessellation

KIND = ir.GeometryKind.CAPSULE
ELEMENTS = (
    Element(
        shape_entry(
            "capsule",
            "a cylinder about its y axis with half spheres for ends",
            Arg("radius", "length", 0.5, "radius", above=0.0),
            Arg("height", "length", 1.0, "height of the cylinder between the half spheres", above=0.0),
            CENTER,
            example="capsule(0.3, 1)",
        ),
        lambda args: (args["radius"], args["height"] / 2),
    ),
)
MEASURES = (Measure("radius", above=0.0), Measure("half height of the cylinder", minimum=0.0))
EXACT, FLAT, WRAPS = False, False, False
OPEN = ("has gaps", "")
has_sense = deviation = povray = mitsuba = None


def _of_usd(number: Any, axis: str) -> tuple[float, float] | None:
    """Of equal radii."""
    bottom, top = number("radiusBottom"), number("radiusTop")
    return (bottom, number("height") / 2) if bottom == top else None


USD = {"Capsule": lambda number, axis: (number("radius"), number("height") / 2), "Capsule_1": _of_usd}


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0], p[1] + p[0], p[0]))


def support(p: Sequence[float], form: np.ndarray) -> float:
    return p[1] * abs(float(form[1])) + p[0] * float(np.linalg.norm(form))


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """The interval is the hull of those of the cylinder and the two spheres, since a capsule is convex."""
    radius, half = parameters[g, 0], parameters[g, 1]
    lo, hi, _, _ = cone_interval(radius, radius, half, origin, direction)
    lo_top, hi_top = sphere_interval(radius, (origin[0], origin[1] - half, origin[2]), direction)
    lo_bottom, hi_bottom = sphere_interval(radius, (origin[0], origin[1] + half, origin[2]), direction)
    lo = ops.minimum(lo, ops.minimum(lo_top, lo_bottom))
    hi = ops.maximum(hi, ops.maximum(hi_top, hi_bottom))
    return nearest(lo, hi, t_min, t_max), kind * 0


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    x, y, z = point
    return x, y - ops.clip(y, -parameters[g, 1], parameters[g, 1]), z


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Longitude, and along the outline from pole to pole."""
    radius, half, y = parameters[g, 0], parameters[g, 1], point[1]
    outline = math.pi * radius + 2.0 * half
    middle = ops.clip(y, -half, half)
    along = middle + radius * ops.atan2(y - middle, rho)
    return (longitude, 0.5 + along / outline), (TURN * radius, outline)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    cut = b.op(Op.MAX, b.op(Op.MIN, point[1], b.constant(p[1])), b.constant(-p[1]))
    return b.offset(length(b, (point[0], b.subtract(point[1], cut), point[2])), -p[0])


def is_closed(p: Sequence[float]) -> bool:
    return True


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((p[0], 0.5), (p[0], 0.5))


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    return surfaces.revolve([_profile(p[0], p[1], tolerance)], surfaces.segments(p[0], tolerance / 2))


def _profile(radius: float, half: float, tolerance: float) -> Profile:
    """From the south pole to the north pole; v is proportional to arc length."""
    ball = surfaces.sphere_profile(radius, tolerance)
    middle = len(ball.radius) // 2
    rows = np.r_[0 : middle + 1, middle : len(ball.radius)]  # the equator twice: both ends of the cylinder
    shift = np.where(np.arange(len(rows)) <= middle, -half, half)
    outline = np.pi * radius + 2 * half
    v = (ball.v[rows] * np.pi * radius + np.where(shift > 0, 2 * half, 0.0)) / outline
    return Profile(ball.radius[rows], ball.height[rows] + shift, ball.normal[rows], v, 0)


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float]:
    count = closed_meshes.chords(p[0], 0.5 * tolerance)
    low, high = np.split(closed_meshes.arc(p[0], 0.0, count // 2), [count // 4 + 1])
    both = np.concatenate([low - (0.0, p[1]), low[-1:] + (0.0, p[1]), high + (0.0, p[1])])
    return *closed_meshes.revolved(both, count), 2 * closed_meshes.sagitta(p[0], count)


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("capsule", (p[0], 0.0), p[1])
