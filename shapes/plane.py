"""The plane y = 0: endless, normal +y."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import shape_entry
from . import surfaces
from .contract import Element, Frame, Lane, Point, ShapeError, Text, Vec
from .lanes import helper, plane_root
from .lanes import up as normal  # noqa: F401
from .surfaces import Tessellation

KIND = ir.GeometryKind.PLANE
MEASURES = ()
EXACT, FLAT, WRAPS = True, True, False
OPEN = ("has no end", "")
USD = {}  # its Plane is a rectangle
has_sense = support = deviation = closed_mesh = mitsuba = emitting = None
_FORMS = (("y",), ("normal", "point"), ("a", "b", "c", "d"))


def _frame(args: Mapping[str, Any]) -> Frame:
    """The plane of one of three forms. Raises ShapeError."""
    forms = [form for form in _FORMS if any(args[name] is not None for name in form)]
    if len(forms) > 1:
        first, second = (next(f"`{name}`" for name in form if args[name] is not None) for form in forms[:2])
        message = f"a plane is given one way: {first} does not go with {second}"
        raise ShapeError(message, "write y, or normal and point, or a, b, c and d")
    if forms and "normal" in forms[0]:
        return Frame(args["point"] or (0.0, 0.0, 0.0), args["normal"] or (0.0, 1.0, 0.0))
    if forms and "a" in forms[0]:
        normal = np.array([args[name] or 0.0 for name in "abc"])
        if not normal.any():
            raise ShapeError("the plane's normal (a, b, c) is 0", "give at least one of a, b and c")
        return Frame(tuple(-(args["d"] or 0.0) * normal / float(normal @ normal)), tuple(normal))
    return Frame((0.0, args["y"] or 0.0, 0.0), (0.0, 1.0, 0.0))


ELEMENTS = (
    Element(
        shape_entry(
            "plane",
            "an infinite plane",
            Arg("y", "length", None, "its height, for a level plane"),
            Arg("normal", "direction", None, "its normal, with `point`", keyword=True),
            Arg("point", "point", None, "a point of it, with `normal`", keyword=True),
            Arg("a", "number", None, "a of a x + b y + c z + d = 0", keyword=True),
            Arg("b", "number", None, "b of a x + b y + c z + d = 0", keyword=True),
            Arg("c", "number", None, "c of a x + b y + c z + d = 0", keyword=True),
            Arg("d", "length", None, "d of a x + b y + c z + d = 0", keyword=True),
            exclusive=(("y", "normal", "a"), ("y", "point", "b"), ("y", "c")),
            example="plane(y: 0)",
        ),
        lambda args: (),
        _frame,
    ),
)


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of((math.inf, 0.0, math.inf))


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    return plane_root(origin, direction, t_min, t_max), kind * 0


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """x and -z, in metres."""
    unit = 1.0 + 0.0 * point[0]
    return (point[0], -point[2]), (unit, unit)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    return point[1]


def is_closed(p: Sequence[float]) -> bool:
    return False


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ()


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    return surfaces.endless()


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    return "plane", ["  <0, 1, 0>, 0"]
