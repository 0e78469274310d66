"""Signed distance fields of solids (at most 0 inside, approximate distances) and their CSG and deformation operators.

Points are three values of a tape. Distances: Quilez, "Distance functions" (2008–).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from .. import ir
from .builder import Builder
from .opcodes import Op

Kind = ir.GeometryKind
Point = tuple[int, int, int]


class NoSolid(ValueError):
    """A shape without an interior; the message says why."""


def transform_point(b: Builder, point: Point, inverse: np.ndarray) -> Point:
    """A point in another frame; `inverse` (3, 4) leads there."""
    x, y, z = (b.linear([(float(row[k]), point[k]) for k in range(3)], float(row[3])) for row in inverse)
    return x, y, z


def shape_field(b: Builder, kind: int, p: Sequence[float], point: Point) -> int:
    """The field of an analytic shape of the IR in its own frame. Raises NoSolid."""
    maker = _FIELDS.get(Kind(kind))
    if maker is None:
        raise NoSolid(f"a {Kind(kind).name.lower()} has no inside")
    return maker(b, p, point)


def _sphere(b: Builder, p: Sequence[float], point: Point) -> int:
    return b.offset(length(b, point), -p[0])


def length(b: Builder, point: Sequence[int]) -> int:
    squares = [b.op(Op.SQUARE, name) for name in point]
    return b.op(Op.SQRT, b.add(b.add(squares[0], squares[1]), squares[2]))


def _slab(b: Builder, name: int, half: float) -> int:
    return b.offset(b.op(Op.ABS, name), -half)


def _box(b: Builder, p: Sequence[float], point: Point) -> int:
    return b.reduce(Op.MAX, [_slab(b, name, half) for name, half in zip(point, p, strict=False)])


def _plane(b: Builder, p: Sequence[float], point: Point) -> int:
    return point[1]


def _cylinder(b: Builder, p: Sequence[float], point: Point) -> int:
    if not p[2]:
        raise NoSolid("a cylinder that is not capped has no inside")
    side = b.offset(b.op(Op.HYPOT, point[0], point[2]), -p[0])
    return b.op(Op.MAX, side, _slab(b, point[1], p[1]))


def _cone(b: Builder, p: Sequence[float], point: Point) -> int:
    low, high, half, capped = p[:4]
    if not capped:
        raise NoSolid("a cone that is not capped has no inside")
    slope = (high - low) / (2 * half)
    side = b.linear([(1.0, b.op(Op.HYPOT, point[0], point[2])), (-slope, point[1])], -0.5 * (low + high))
    return b.op(Op.MAX, b.scale(side, 1 / math.hypot(1.0, slope)), _slab(b, point[1], half))


def _torus(b: Builder, p: Sequence[float], point: Point) -> int:
    ring = b.offset(b.op(Op.HYPOT, point[0], point[2]), -p[0])
    return b.offset(b.op(Op.HYPOT, ring, point[1]), -p[1])


def _capsule(b: Builder, p: Sequence[float], point: Point) -> int:
    cut = b.op(Op.MAX, b.op(Op.MIN, point[1], b.constant(p[1])), b.constant(-p[1]))
    return b.offset(length(b, (point[0], b.subtract(point[1], cut), point[2])), -p[0])


def _quadric(b: Builder, p: Sequence[float], point: Point) -> int:
    """A … J over their largest, cut by the box."""
    if not all(map(math.isfinite, p[10:13])):
        raise NoSolid("an endless quadric has no end: give it within:")
    x, y, z = point
    squares = [b.op(Op.SQUARE, name) for name in point]
    products = [b.multiply(x, y), b.multiply(y, z), b.multiply(x, z)]
    largest = max(map(abs, p[:9]))
    terms = [(c / largest, name) for c, name in zip(p[:9], [*squares, *products, x, y, z], strict=True)]
    return b.op(Op.MAX, b.linear(terms, p[9] / largest), _box(b, p[10:13], point))


_FIELDS: dict[Kind, Callable[[Builder, Sequence[float], Point], int]] = {
    Kind.SPHERE: _sphere, Kind.BOX: _box, Kind.PLANE: _plane, Kind.CYLINDER: _cylinder, Kind.CONE: _cone, Kind.TORUS: _torus,
    Kind.CAPSULE: _capsule, Kind.QUADRIC: _quadric,
}  # fmt: skip


# --- combined -----------------------------------------------------------------------------------------------------------


def shell(b: Builder, field: int, thickness: float) -> int:
    """The outermost `thickness` of a solid."""
    return b.op(Op.MAX, field, b.subtract(b.constant(-thickness), field))


# --- deformations ---------------------------------------------------------------------------------------------------------


def untwist(b: Builder, point: Point, rate: float) -> Point:
    """The inverse of a twist about y by `rate` radians per unit of height."""
    x, y, z = point
    angle = b.scale(y, -rate)
    c, s = b.op(Op.COS, angle), b.op(Op.SIN, angle)
    return b.add(b.multiply(c, x), b.multiply(s, z)), y, b.subtract(b.multiply(c, z), b.multiply(s, x))


def unbend(b: Builder, point: Point, rate: float) -> Point:
    """The inverse of a bend of the x axis towards +y into a circle, by `rate` radians per unit of length."""
    x, y, z = point
    radius = 1 / rate
    down = b.subtract(b.constant(radius), y)
    if radius < 0:
        x_, down = b.op(Op.NEGATE, x), b.op(Op.NEGATE, down)
        turned = b.op(Op.ATAN2, x_, down)
        return b.scale(turned, radius), b.add(b.constant(radius), b.op(Op.HYPOT, x, down)), z
    turned = b.op(Op.ATAN2, x, down)
    return b.scale(turned, radius), b.subtract(b.constant(radius), b.op(Op.HYPOT, x, down)), z
