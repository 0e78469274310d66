"""Quadric surface: the zeros of a polynomial of degree 2 in x, y and z, clipped to a box about the origin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.formula.builder import Builder
from ..compiler.formula.opcodes import Op
from ..compiler.formula.solid_fields import NoSolid
from ..compiler.formula.solid_fields import slab as slab_field
from ..lang.schema.argument_types import REQUIRED, Arg
from ..lang.schema.shapes import shape_entry
from . import quadric_triangles, surfaces
from .contract import Element, Frame, Lane, Measure, Point, ShapeError, Text, Vec
from .lanes import INF, helper, nearest, ops, ordered_roots
from .surfaces import Tessellation

KIND = ir.GeometryKind.QUADRIC
MEASURES = (
    *(Measure(name) for name in "ABCDEFGHIJ"),
    *(Measure(f"half {axis} of the box", above=0.0, may_be_infinite=True) for axis in "xyz"),
)
EXACT, FLAT, WRAPS = False, False, True
OPEN = ("is a surface that ends at its box", "as `implicit(|x, y, z| ... <= 0, within: ...)` it is a solid")
USD = {}
support = closed_mesh = mitsuba = emitting = None


def _parameters(args: Mapping[str, Any]) -> tuple[float, ...]:
    coefficients, within = args["coefficients"], args["within"]
    if len(coefficients) != 10:
        raise ShapeError(f"a quadric has the ten coefficients A … J, got {len(coefficients)}")
    if not any(coefficients[:9]):
        raise ShapeError("the quadric's coefficients A … I are all 0: there is no surface")
    return *coefficients, *((math.inf,) * 3 if within is None else (edge / 2 for edge in within))


ELEMENTS = (
    Element(
        shape_entry(
            "quadric",
            "A x² + B y² + C z² + D xy + E yz + F xz + G x + H y + I z + J = 0, in metres",
            Arg("coefficients", "numbers", REQUIRED, "the ten numbers A … J"),
            Arg("within", "size3", None, "edge lengths of the box about the origin that clips it; unbounded by default", above=0.0),
            example="quadric([1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2], within: 2)",
        ),
        _parameters,
        lambda args: Frame((0.0, 0.0, 0.0)),
    ),
)


def has_sense(rows: np.ndarray) -> np.ndarray:
    """Some coefficient but J is not 0."""
    return np.asarray(rows[:, :9].any(axis=1))


def bounds(p: Sequence[float]) -> np.ndarray:
    """Bounds of a quadric clipped to its box; tight for an ellipsoid.

    xᵀQx + 2bᵀx + J = 0 with definite Q is the ellipsoid with center c = −Q⁻¹b and half extents √(k (Q⁻¹)ᵢᵢ), k = bᵀQ⁻¹b − J. These are
    the extremes of linear forms on the ellipsoid, by Lagrange. For k of the opposite sign it is empty, and its bounds are the center.
    """
    a, b, c, d, e, f, g, h, i, j = p[:10]
    cut = np.array([-np.array(p[10:13]), np.array(p[10:13])])
    q = np.array([[a, d / 2, f / 2], [d / 2, b, e / 2], [f / 2, e / 2, c]])
    if not np.isfinite(q).all():
        return cut
    eigenvalues = np.linalg.eigvalsh(q)
    if not (eigenvalues[0] * eigenvalues[2] > 0 and abs(eigenvalues).min() > 1e-12 * abs(eigenvalues).max()):
        return cut
    linear = np.array([g, h, i]) / 2
    inverse = np.linalg.inv(q)
    center = -inverse @ linear
    squares = (linear @ inverse @ linear - j) * np.diag(inverse)
    extent = np.sqrt(np.maximum(squares, 0.0)) * (1 + 1e-9)  # conservative for rounded ray roots at the silhouette
    low, high = np.maximum(center - extent, cut[0]), np.minimum(center + extent, cut[1])
    return np.stack([np.minimum(low, high), high])


@helper
def quadric_value(parameters, g: Lane, p: Vec) -> Lane:
    """A x² + B y² + C z² + D x y + E y z + F x z + G x + H y + I z + J."""
    x, y, z = p
    return _quadratic_part(parameters, g, p) + parameters[g, 6] * x + parameters[g, 7] * y + parameters[g, 8] * z + parameters[g, 9]


@helper
def _quadratic_part(parameters, g: Lane, p: Vec) -> Lane:
    x, y, z = p
    second = parameters[g, 0] * x * x + parameters[g, 1] * y * y + parameters[g, 2] * z * z
    return second + (parameters[g, 3] * x * y + parameters[g, 4] * y * z + parameters[g, 5] * x * z)


@helper
def quadric_gradient(parameters, g: Lane, p: Vec) -> Vec:
    """The gradient of `quadric_value`."""
    x, y, z = p
    d, e, f = parameters[g, 3], parameters[g, 4], parameters[g, 5]
    return (
        2.0 * parameters[g, 0] * x + d * y + f * z + parameters[g, 6],
        2.0 * parameters[g, 1] * y + d * x + e * z + parameters[g, 7],
        2.0 * parameters[g, 2] * z + e * y + f * x + parameters[g, 8],
    )


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    """The nearest root in range that lies in the box."""
    shift = -ops.dot(origin, direction) / ops.dot(direction, direction)
    o = (origin[0] + shift * direction[0], origin[1] + shift * direction[1], origin[2] + shift * direction[2])
    c = quadric_value(parameters, g, o)
    b = -0.5 * ops.dot(quadric_gradient(parameters, g, o), direction)
    a = _quadratic_part(parameters, g, direction)  # not from values, whose constant term would cancel it
    lo, hi = ordered_roots(a, b, c, b * b - a * c)
    lo = ops.where(_in_box(parameters, g, o, direction, lo), lo + shift, INF)
    hi = ops.where(_in_box(parameters, g, o, direction, hi), hi + shift, INF)
    return nearest(lo, hi, t_min, t_max), kind * 0


@helper
def _in_box(parameters, g: Lane, o: Vec, d: Vec, t: Lane) -> Lane:
    x = abs(o[0] + t * d[0]) <= parameters[g, 10]
    y = abs(o[1] + t * d[1]) <= parameters[g, 11]
    z = abs(o[2] + t * d[2]) <= parameters[g, 12]
    return x & y & z & (abs(t) < INF)


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    """The gradient."""
    return quadric_gradient(parameters, g, point)


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Longitude, and y from 0 to 1 in the box, in metres without one."""
    half, y = parameters[g, 11], point[1]
    cut, unit = half < INF, 1.0 + 0.0 * point[0]
    return (longitude, ops.where(cut, 0.5 + 0.5 * y / half, y)), (unit, ops.where(cut, 2.0 * half, 1.0))


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    """A … J over their largest, cut by the box."""
    if not all(map(math.isfinite, p[10:13])):
        raise NoSolid("an endless quadric has no end: give it within:")
    x, y, z = point
    squares = [b.op(Op.SQUARE, name) for name in point]
    products = [b.multiply(x, y), b.multiply(y, z), b.multiply(x, z)]
    largest = max(map(abs, p[:9]))
    terms = [(c / largest, name) for c, name in zip(p[:9], [*squares, *products, x, y, z], strict=True)]
    box = b.reduce(Op.MAX, [slab_field(b, name, half) for name, half in zip(point, p[10:13], strict=True)])
    return b.op(Op.MAX, b.linear(terms, p[9] / largest), box)


def is_closed(p: Sequence[float]) -> bool:
    return False


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ()


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    """Of a quadric with finite bounds; see quadric_triangles.march."""
    matrix = quadric_triangles.matrix(p)
    positions, rows = quadric_triangles.march(matrix, quadric_triangles.box_grid(p, tolerance, bounds(p)))
    return surfaces.flat(positions, rows, quadric_triangles.normals(matrix, positions))


def deviation(p: Sequence[float], tessellation: Tessellation) -> float:
    """To first order."""
    return quadric_triangles.deviation(quadric_triangles.matrix(p), tessellation.positions[:, :3], tessellation.triangles)


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    """POV-Ray orders A … J as x² y² z², xy xz yz, x y z, 1."""
    a, b, c, d, e, f, g, h, i, j = p[:10]
    line = f"  {text.vector([a, b, c])}, {text.vector([d, f, e])}, {text.vector([g, h, i])}, {text.number(j)}"
    half = np.array(p[10:13])
    if not np.isfinite(half).all():
        return "quadric", [line]
    return "quadric", [line, f"  clipped_by {{ box {{ {text.vector(-half)}, {text.vector(half)} }} }}"]
