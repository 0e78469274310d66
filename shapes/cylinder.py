"""A cylinder about the y axis: its radius, half its height, and whether disks cap it. Parts: side, bottom, top."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..compiler.formula.solid_fields import NoSolid
from ..compiler.formula.solid_fields import slab as slab_field
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CAPPED, CENTER, RADIUS, shape_entry
from . import cone, surfaces
from .cone import hit, normal, uv  # noqa: F401 - which know its row
from .contract import Element, Emitting, Measure, Mitsuba, MitsubaShape, Point, Text
from .surfaces import Tessellation

KIND = ir.GeometryKind.CYLINDER
ELEMENTS = (
    Element(
        shape_entry(
            "cylinder",
            "a cylinder about its y axis",
            RADIUS,
            Arg("height", "length", 2.0, "its height", above=0.0),
            CENTER,
            CAPPED,
            example="cylinder(0.5, 2)",
        ),
        lambda args: (args["radius"], args["height"] / 2, args["capped"]),
    ),
)
MEASURES = (Measure("radius", above=0.0), Measure("half height", above=0.0), Measure("capped"))
EXACT, FLAT, WRAPS = False, False, False
OPEN = ("has no caps", "leave out `capped: false`")
has_sense = deviation = None


def _of_usd(number: Any, axis: str) -> tuple[float, ...] | None:
    """Of equal radii."""
    bottom, top = number("radiusBottom"), number("radiusTop")
    return (bottom, number("height") / 2, 1.0) if bottom == top else None


USD = {"Cylinder": lambda number, axis: (number("radius"), number("height") / 2, 1.0), "Cylinder_1": _of_usd}


def _as_cone(p: Sequence[float]) -> tuple[float, ...]:
    return p[0], p[0], p[1], p[2]


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((p[0], p[1], p[0]))


def support(p: Sequence[float], form: np.ndarray) -> float:
    return p[1] * abs(float(form[1])) + p[0] * math.hypot(form[0], form[2])


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    if not p[2]:
        raise NoSolid("a cylinder that is not capped has no inside")
    side = b.offset(b.op(Op.HYPOT, point[0], point[2]), -p[0])
    return b.op(Op.MAX, side, slab_field(b, point[1], p[1]))


def is_closed(p: Sequence[float]) -> bool:
    return bool(p[2] > 0)


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((p[0], 1.0),)


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    return cone.triangles(_as_cone(p), tolerance)


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    return cone.closed_mesh(_as_cone(p), tolerance)


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    low, high = (text.vector((0, y, 0)) for y in (-p[1], p[1]))
    return "cylinder", [f"  {low}, {high}, {text.number(p[0])}{'' if p[2] > 0 else ' open'}"]


def mitsuba(p: Sequence[float]) -> Mitsuba:
    """The side, and a disk for each cap."""
    radius, half = p[:2]
    parts = [MitsubaShape("cylinder", radius=radius, points={"p0": (0.0, -half, 0.0), "p1": (0.0, half, 0.0)})]
    for up in (-1.0, 1.0) if p[2] > 0 else ():
        cap = np.eye(4)
        cap[1, 3] = up * half
        turned = surfaces.LEVEL if up > 0 else surfaces.LEVEL @ np.diag([1.0, -1.0, -1.0, 1.0])
        parts.append(MitsubaShape("disk", cap @ turned @ np.diag([radius, radius, 1.0, 1.0])))
    return Mitsuba("even", tuple(parts))


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("tube" if p[2] != 0.0 else "cone", (p[0], p[0]), p[1], p[2] != 0.0)
