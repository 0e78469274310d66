"""A cone about the y axis: its radius at each end, half its height, and whether disks cap it. Parts: side, bottom, top."""

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
from . import closed_meshes, surfaces
from .contract import Element, Emitting, Lane, Measure, Point, Text, Vec
from .lanes import INF, TURN, helper, nearest, ops, ordered_roots, slab
from .surfaces import Profile, Tessellation

KIND = ir.GeometryKind.CONE
CYLINDER = int(ir.GeometryKind.CYLINDER)  # whose rays and coordinates are those of a cone with equal radii
ELEMENTS = (
    Element(
        shape_entry(
            "cone",
            "a cone about its y axis, tip up",
            RADIUS,
            Arg("height", "length", 2.0, "its height", above=0.0),
            CENTER,
            Arg("top", "length", 0.0, "radius at the top, for a truncated cone", minimum=0.0, keyword=True),
            CAPPED,
            example="cone(0.5, 1)",
        ),
        lambda args: (args["radius"], args["top"], args["height"] / 2, args["capped"]),
    ),
)
MEASURES = (
    Measure("radius at the bottom", minimum=0.0), Measure("radius at the top", minimum=0.0), Measure("half height", above=0.0),
    Measure("capped"),
)  # fmt: skip
EXACT, FLAT, WRAPS = False, False, False
OPEN = ("has no caps", "leave out `capped: false`")
deviation = mitsuba = None
_RIM = 1e-12  # of the larger radius: an end below it is a tip


def _of_usd(number: Any, axis: str) -> tuple[float, ...] | None:
    """Of different radii."""
    bottom, top = number("radiusBottom"), number("radiusTop")
    return None if bottom == top else (bottom, top, number("height") / 2, 1.0)


USD = {"Cone": lambda number, axis: (number("radius"), 0.0, number("height") / 2, 1.0), "Cylinder_1": _of_usd}


def has_sense(rows: np.ndarray) -> np.ndarray:
    """One of the ends has a radius."""
    return rows[:, :2].max(axis=1, initial=0.0) > 0


def bounds(p: Sequence[float]) -> np.ndarray:
    radius = max(p[0], p[1])
    return surfaces.box_of((radius, p[2], radius))


def support(p: Sequence[float], form: np.ndarray) -> float:
    around, along = math.hypot(form[0], form[2]), float(form[1])
    return max(p[2] * along + p[1] * around, -p[2] * along + p[0] * around)


@helper
def _side_roots(middle: Lane, slope: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(lo, hi, a, c) of x² + z² = w², w = middle + slope y: an infinite double cone, a cylinder for slope 0.

    It is solved at the ray's point nearest to the frame's origin, which limits the loss of precision to that of the eye's distance. With
    d and o the direction and that point in the xz plane, D = |w d - slope d_y o|² - (o × d)². `c` is the constant term there.
    """
    shift = -ops.dot(origin, direction) / ops.dot(direction, direction)
    ox, oy, oz = ops.along(origin, direction, shift)
    dx, dy, dz = direction
    w = middle + slope * oy
    change = slope * dy
    a = dx * dx + dz * dz - change * change
    b = change * w - ox * dx - oz * dz
    rho = ops.sqrt(ox * ox + oz * oz)
    c = (rho - w) * (rho + w)
    vx, vz = w * dx - change * ox, w * dz - change * oz
    reach = ops.sqrt(vx * vx + vz * vz)
    side = abs(ox * dz - oz * dx)
    discriminant = (reach - side) * (reach + side)
    # steeper than the cone: a line through the apex touches both halves, and only rounding makes D negative
    discriminant = ops.where((a < 0.0) & (discriminant < 0.0), 0.0, discriminant)
    lo, hi = ordered_roots(a, b, c, discriminant)
    return lo + shift, hi + shift, a, c


@helper
def cone_interval(bottom: Lane, top: Lane, half: Lane, origin: Vec, direction: Vec) -> tuple[Lane, Lane, Lane, Lane]:
    """(lo, hi, part at lo, part at hi) of t inside a capped cone; parts 0 side, 1 bottom, 2 top."""
    middle = 0.5 * (bottom + top)
    slope = 0.5 * (top - bottom) / half
    lo, hi, a, c = _side_roots(middle, slope, origin, direction)
    # a < 0: the two half-lines beyond the roots are inside; the slab keeps the one where the radius is positive
    upward = slope * direction[1] > 0.0
    inside_lo = ops.where(a < 0.0, ops.where(upward, hi, -INF), lo)
    inside_hi = ops.where(a < 0.0, ops.where(upward, INF, lo), hi)
    along = (direction[0] == 0.0) & (direction[2] == 0.0) & (a == 0.0)  # a cylinder's axis
    inside_lo = ops.where(along, ops.where(c <= 0.0, -INF, INF), inside_lo)
    inside_hi = ops.where(along, ops.where(c <= 0.0, INF, -INF), inside_hi)
    y0, y1 = slab(origin[1], direction[1], half)
    start = ops.where(y0 > inside_lo, y0, inside_lo)
    end = ops.where(y1 < inside_hi, y1, inside_hi)
    hit = start <= end
    rising = direction[1] > 0.0
    part_lo = ops.where(y0 > inside_lo, ops.where(rising, 1, 2), 0)
    part_hi = ops.where(y1 < inside_hi, ops.where(rising, 2, 1), 0)
    return ops.where(hit, start, INF), ops.where(hit, end, -INF), part_lo, part_hi


@helper
def _measures(kind: Lane, parameters: Any, g: Lane) -> tuple[Lane, Lane, Lane, Lane]:
    """(radius at the bottom, at the top, half height, capped) of a cone or cylinder."""
    p0, p1, p2, straight = parameters[g, 0], parameters[g, 1], parameters[g, 2], kind == CYLINDER
    return p0, ops.where(straight, p0, p1), ops.where(straight, p1, p2), ops.where(straight, p2, parameters[g, 3])


@helper
def hit(kind: Lane, parameters: Any, g: Lane, origin: Vec, direction: Vec, t_min: Lane, t_max: Lane) -> tuple[Lane, Lane]:
    bottom, top, half, capped = _measures(kind, parameters, g)
    lo, hi, part_lo, part_hi = cone_interval(bottom, top, half, origin, direction)
    solid = nearest(lo, hi, t_min, t_max)
    part = ops.where(solid == lo, part_lo, part_hi)
    s0, s1, _, _ = _side_roots(0.5 * (bottom + top), 0.5 * (top - bottom) / half, origin, direction)
    y0 = origin[1] + s0 * direction[1]
    y1 = origin[1] + s1 * direction[1]
    s0 = ops.where(abs(y0) <= half, s0, INF)
    s1 = ops.where(abs(y1) <= half, s1, INF)
    closed = capped != 0.0
    return ops.where(closed, solid, nearest(s0, s1, t_min, t_max)), ops.where(closed, part, 0)


@helper
def normal(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec) -> Vec:
    x, _, z = point
    zero = 0.0 * x
    slope = ops.where(kind == CYLINDER, 0.0, 0.5 * (parameters[g, 1] - parameters[g, 0]) / parameters[g, 2])
    rho = ops.sqrt(x * x + z * z)
    side = ops.where3(rho > 0.0, (x, -slope * rho, z), (zero, zero - ops.where(slope > 0.0, 1.0, -1.0), zero))
    return ops.where3(part == 0, side, (zero, ops.where(part == 1, -1.0, 1.0) + zero, zero))


@helper
def uv(kind: Lane, parameters: Any, g: Lane, part: Lane, point: Vec, rho: Lane, longitude: Lane) -> Any:
    """Longitude and height; x and -z on the top, x and z on the bottom."""
    x, y, z = point
    p0, p1, straight = parameters[g, 0], parameters[g, 1], kind == CYLINDER
    half = ops.where(straight, p1, parameters[g, 2])
    widest = ops.where(straight, p0, ops.maximum(p0, p1))
    lean = ops.where(straight, 0.0, p1 - p0)
    on_side, radius = part == 0, ops.where((kind != CYLINDER) & (part == 2), p1, p0)
    up = ops.where(part == 1, z, -z)
    u, v = ops.where(on_side, longitude, 0.5 + 0.5 * x / radius), ops.where(on_side, 0.5 + 0.5 * y / half, 0.5 + 0.5 * up / radius)
    along = ops.sqrt(4.0 * half * half + lean * lean)
    return (u, v), (ops.where(on_side, TURN * widest, 2.0 * radius), ops.where(on_side, along, 2.0 * radius))


def field(b: Builder, p: Sequence[float], point: Point) -> int:
    low, high, half, capped = p[:4]
    if not capped:
        raise NoSolid("a cone that is not capped has no inside")
    slope = (high - low) / (2 * half)
    side = b.linear([(1.0, b.op(Op.HYPOT, point[0], point[2])), (-slope, point[1])], -0.5 * (low + high))
    return b.op(Op.MAX, b.scale(side, 1 / math.hypot(1.0, slope)), slab_field(b, point[1], half))


def is_closed(p: Sequence[float]) -> bool:
    return bool(p[3] > 0)


def circles(p: Sequence[float]) -> Sequence[tuple[float, float]]:
    return ((max(p[:2]), 1.0),)


def triangles(p: Sequence[float], tolerance: float) -> Tessellation:
    low, high, half, capped = p[:4]
    return surfaces.revolve(_profiles(low, high, half, bool(capped)), surfaces.segments(max(low, high), tolerance))


def _profiles(low: float, high: float, half: float, capped: bool) -> list[Profile]:
    """The side and the caps."""
    slope = np.array([2 * half, low - high]) / math.hypot(2 * half, low - high)
    side = Profile(np.array([low, high]), np.array([-half, half]), np.stack([slope, slope]), np.array([0.0, 1.0]), 0)
    tiny = _RIM * max(low, high)
    caps = [(low, -half, -1.0, 1), (high, half, 1.0, 2)] if capped else []
    return [side, *(surfaces.disk_profile(*cap) for cap in caps if cap[0] > tiny)]


def closed_mesh(p: Sequence[float], tolerance: float) -> tuple[np.ndarray, np.ndarray, float] | None:
    low, high, half, capped = p[:4]
    if not capped:
        return None
    count = closed_meshes.chords(max(low, high), tolerance)
    ends = [(radius, y) for radius, y in ((low, -half), (high, half)) if radius > 0.0]
    outline = np.array([(0.0, -half), *ends, (0.0, half)])
    return *closed_meshes.revolved(outline, count), closed_meshes.sagitta(max(low, high), count)


def povray(p: Sequence[float], text: Text) -> tuple[str, list[str]]:
    low, high = (text.vector((0, y, 0)) for y in (-p[2], p[2]))
    return "cone", [f"  {low}, {text.number(p[0])}, {high}, {text.number(p[1])}{'' if p[3] > 0 else ' open'}"]


def emitting(p: Sequence[float]) -> Emitting:
    return Emitting("cone", (p[0], p[1]), p[2], p[3] != 0.0)
