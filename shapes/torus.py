"""A torus about the y axis: the distance from the axis to the middle of the tube, and the radius of the tube."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CENTER, shape_entry
from . import closed_meshes, surfaces
from .contract import Element, Emitting, Lane, Measure, Point, Text, Vec
from .lanes import TURN, helper, ops
from .surfaces import Profile, Tessellation
from .torus_roots import torus

KIND = ir.GeometryKind.TORUS
ELEMENTS = (
    Element(
        shape_entry(
            "torus",
            "a ring about its y axis",
            Arg("radius", "length", 1.0, "from the axis to the middle of the tube", above=0.0),
            Arg("tube", "length", 0.25, "radius of the tube", above=0.0),
            CENTER,
            example="torus(1, 0.25)",
        ),
        lambda args: (args["radius"], args["tube"]),
    ),
)
MEASURES = (Measure("radius of the ring", above=0.0), Measure("radius of the tube", above=0.0))
EXACT, FLAT, WRAPS = False, False, False
OPEN = ("has gaps", "")
USD = {}
has_sense = deviation = mitsuba = None


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0] + p[1], p[1], p[0] + p[1]))


def support(p: Sequence[float], form: np.ndarray) -> float:
    return p[0] * math.hypot(form[0], form[2]) + p[1] * float(np.linalg.norm(form))


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    return torus(parameters[g, 0], parameters[g, 1], origin, direction, t_min, t_max), kind * 0


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    x, y, z = point
    inner = parameters[g, 0] / ops.sqrt(x * x + z * z)
    return x - inner * x, y, z - inner * z


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Longitude, and around the tube: 0.5 outermost, 0.75 on top."""
    ring, tube = parameters[g, 0], parameters[g, 1]
    return (longitude, 0.5 + ops.atan2(point[1], rho - ring) / TURN), (TURN * (ring + tube), TURN * tube)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    ring = b.offset(b.op(Op.HYPOT, point[0], point[2]), -p[0])
    return b.offset(b.op(Op.HYPOT, ring, point[1]), -p[1])


def is_closed(p: Sequence[float]) -> bool:
    return True


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((p[0] + p[1], 0.5), (p[1], 0.5))


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    return surfaces.revolve([_profile(p[0], p[1], tolerance)], surfaces.segments(p[0] + p[1], tolerance / 2))


def _profile(ring: float, tube: float, tolerance: float) -> Profile:
    """The tube's circle from its innermost point, downwards first; of a spindle torus only the outer part."""
    count = surfaces.segments(tube, tolerance / 2)
    if tube <= ring:
        cos, sin = surfaces.circle(count)
        angle = np.linspace(-np.pi, np.pi, count + 1)
        normal = np.stack([-cos, -sin], axis=1)
    else:
        end = math.acos(-ring / tube)
        angle = np.linspace(-end, end, count + 1)
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = ring + tube * normal[:, 0]
    if tube >= ring:
        radius[[0, -1]] = 0.0
    return Profile(radius, tube * normal[:, 1], normal, 0.5 + angle / (2 * np.pi), 0)


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    if p[1] >= p[0]:
        return None
    around, tube = closed_meshes.chords(p[0] + p[1], 0.5 * tolerance), closed_meshes.chords(p[1], 0.5 * tolerance)
    angle = 2 * math.pi * np.arange(tube) / tube
    circle = np.stack([p[0] + p[1] * np.cos(angle), p[1] * np.sin(angle)], axis=1)
    off = closed_meshes.sagitta(p[0] + p[1], around) + closed_meshes.sagitta(p[1], tube)
    return *closed_meshes.ring(circle, around), off


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    return "torus", [f"  {text.number(p[0])}, {text.number(p[1])} sturm"]


def emitting(p: Sequence[float]) -> Emitting | None:
    return Emitting("torus", (p[0], p[1])) if p[1] <= p[0] else None
