"""A rectangular box about the origin. Its parts are the faces -x, +x, -y, +y, -z, +z."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..compiler.formula.solid_fields import slab as slab_field
from ..lang.schema.argument_types import Arg
from ..lang.schema.shapes import CENTER, shape_entry
from . import surfaces
from .contract import Element, Emitting, Lane, Measure, Mitsuba, MitsubaShape, Point, Text, Vec
from .lanes import INF, component, helper, nearest, ops, slab
from .surfaces import Tessellation

KIND = ir.GeometryKind.BOX
ELEMENTS = (
    Element(
        shape_entry(
            "box", "a rectangular box", Arg("size", "size3", (1.0, 1.0, 1.0), "its edge lengths", above=0.0), CENTER,
            example="box([1, 2, 1])",
        ),
        lambda args: tuple(edge / 2 for edge in args["size"]),
    ),
)  # fmt: skip
MEASURES = (Measure("half x", above=0.0), Measure("half y", above=0.0), Measure("half z", above=0.0))
EXACT, FLAT, WRAPS = True, False, False
OPEN = ("has gaps", "")
USD = {"Cube": lambda number, axis: (number("size") / 2,) * 3}
has_sense = support = deviation = None
_POINTS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)]) * 2.0 - 1.0
_SIDES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])


def bounds(p: Sequence[float]) -> np.ndarray:
    return surfaces.box_of(p[:3])


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    half = parameters[g, 0], parameters[g, 1], parameters[g, 2]
    x0, x1 = slab(origin[0], direction[0], half[0])
    y0, y1 = slab(origin[1], direction[1], half[1])
    z0, z1 = slab(origin[2], direction[2], half[2])
    lo = ops.maximum(x0, ops.maximum(y0, z0))
    hi = ops.minimum(x1, ops.minimum(y1, z1))
    t = ops.where(lo <= hi, nearest(lo, hi, t_min, t_max), INF)
    entering = t == lo
    axis_in = ops.where(lo == x0, 0, ops.where(lo == y0, 1, 2))
    axis_out = ops.where(hi == x1, 0, ops.where(hi == y1, 1, 2))
    axis = ops.where(entering, axis_in, axis_out)
    d = component(direction, axis)
    positive = ops.where(entering, d < 0.0, d > 0.0)
    return t, 2 * axis + ops.where(positive, 1, 0)


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    sign, zero = ops.where(part % 2 == 1, 1.0, -1.0), 0.0 * point[0]
    return ops.where(part // 2 == 0, sign, zero), ops.where(part // 2 == 1, sign, zero), ops.where(part // 2 == 2, sign, zero)


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Across and up each face, upright on its sides; on top towards -z, below towards +z."""
    half = parameters[g, 0], parameters[g, 1], parameters[g, 2]
    axis = part // 2
    side = ops.where(part % 2 == 1, 1.0, -1.0)
    across = ops.where(axis == 0, -side * point[2], ops.where(axis == 1, point[0], side * point[0]))
    up = ops.where(axis == 1, -side * point[2], point[1])
    width = component(half, ops.where(axis == 0, 2, 0))
    height = component(half, ops.where(axis == 1, 2, 1))
    return (0.5 + 0.5 * across / width, 0.5 + 0.5 * up / height), (2.0 * width, 2.0 * height)


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    return b.reduce(Op.MAX, [slab_field(b, name, half) for name, half in zip(point, p, strict=False)])


def is_closed(p: Sequence[float]) -> bool:
    return True


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ()


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    """Six faces of four vertices each, in the order of parts."""
    positions, normals = np.empty((6, 4, 3)), np.zeros((6, 4, 3))
    for face in range(6):
        axis, side = face // 2, 2.0 * (face % 2) - 1.0
        positions[face, :, axis] = side
        positions[face][:, [(axis + 1) % 3, (axis + 2) % 3]] = surfaces.CORNERS
        normals[face, :, axis] = side
    rows = (4 * np.arange(6)[:, None, None] + surfaces.HALVES).reshape(-1, 3)
    tessellation = surfaces.flat(positions.reshape(-1, 3) * np.array(p[:3]), rows, normals.reshape(-1, 3))
    return tessellation._replace(parts=np.repeat(np.arange(6, dtype=np.int32), 2))


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float]:
    return _POINTS * np.array(p[:3]), np.concatenate([_SIDES[:, [0, 1, 2]], _SIDES[:, [0, 2, 3]]]), 0.0


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    return "box", [f"  {text.vector([-v for v in p[:3]])}, {text.vector(p[:3])}"]


def mitsuba(p: Sequence[float]) -> Mitsuba:
    return Mitsuba("any", (MitsubaShape("cube", np.diag([*p[:3], 1.0])),))


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("box", tuple(p[:3]))
