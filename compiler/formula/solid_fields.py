"""Signed distance fields of solids (at most 0 inside, approximate distances) and their CSG and deformation operators.

Points are three values of a tape. Distances: Quilez, "Distance functions" (2008–).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .builder import Builder
from .opcodes import Op

Point = tuple[int, int, int]


class NoSolid(ValueError):
    """A shape without an interior; the message says why."""


def transform_point(b: Builder, point: Point, inverse: np.ndarray) -> Point:
    """A point in another frame; `inverse` (3, 4) leads there."""
    x, y, z = (b.linear([(float(row[k]), point[k]) for k in range(3)], float(row[3])) for row in inverse)
    return x, y, z


def length(b: Builder, point: Sequence[int]) -> int:
    squares = [b.op(Op.SQUARE, name) for name in point]
    return b.op(Op.SQRT, b.add(b.add(squares[0], squares[1]), squares[2]))


def slab(b: Builder, name: int, half: float) -> int:
    """The field of |value| <= half."""
    return b.offset(b.op(Op.ABS, name), -half)


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
