"""Fields of simple polygons: minima and maxima of the distances to their edges' lines, each of which occurs once.

A polygon is cut into chains that go to infinity at both ends. A chain is split at a vertex of its convex hull: where it turns left, with
the inside on its left, the inside is common to both parts, else it is that of either (Dobkin, Guibas, Hershberger and Snoeyink, "An
efficient algorithm for finding the CSG representation of a simple polygon", 1988).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..ir import F64
from .builder import Builder
from .opcodes import Op
from .solid_fields import Point, untwist

MOST_EDGES = 64  # of a profile with a field; with more, a mesh is faster
Edge = Callable[[Builder, F64, float], int | None]  # of the unit outward normal n and c: the field n · p − c, or None: below 0 everywhere


class Node(NamedTuple):
    """A part of a formula: the edge of a number, or the minimum or maximum (`op`) of `parts`."""

    op: Op | None
    edge: int = -1
    parts: tuple[Node, ...] = ()


def without_straight_corners(loop: F64) -> F64:
    """A polygon without the vertices at which it does not turn."""
    before, after = loop - np.roll(loop, 1, axis=0), np.roll(loop, -1, axis=0) - loop
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return loop[np.abs(cross) > 1e-12 * np.ptp(loop, axis=0).max() ** 2]


def formula(loop: F64) -> Node:
    """The formula of a simple polygon (n, 2), counter-clockwise, without straight corners. Edge k leads from vertex k to the next."""
    count = len(loop)
    left, right = int(np.lexsort((loop[:, 1], loop[:, 0]))[0]), int(np.lexsort((loop[:, 1], loop[:, 0]))[-1])
    lower = [(left + k) % count for k in range((right - left) % count)]
    upper = [(right + k) % count for k in range((left - right) % count)]
    return _join(Op.MAX, _chain(loop, lower), _chain(loop, upper))


def _chain(loop: F64, edges: list[int]) -> Node:
    """The formula of a chain of edges whose first and last go on to infinity."""
    if len(edges) == 1:
        return Node(None, edges[0])
    ways = {k: _unit(loop[(k + 1) % len(loop)] - loop[k]) for k in (edges[0], edges[-1])}
    back, forth = -ways[edges[0]], ways[edges[-1]]  # where the two rays go
    opposite = float(back @ forth) < -1 + 1e-12
    away = np.array([-forth[1], forth[0]]) if opposite else _unit(-(back + forth))
    inner = loop[edges[1:]] - loop[edges[1]]
    heights = np.round(inner @ away / np.ptp(loop, axis=0).max(), 12)
    if opposite and heights.max() < -heights.min():
        heights = -heights
    along = np.where(heights == heights.max(), inner @ (-away[1], away[0]), -np.inf)
    split = 1 + int(np.argmax(along))
    before, after = loop[edges[split]] - loop[edges[split - 1]], loop[(edges[split] + 1) % len(loop)] - loop[edges[split]]
    turns_left = before[0] * after[1] - before[1] * after[0] > 0
    return _join(Op.MAX if turns_left else Op.MIN, _chain(loop, edges[:split]), _chain(loop, edges[split:]))


def _unit(way: F64) -> F64:
    return way / np.linalg.norm(way)


def _join(op: Op, first: Node, second: Node) -> Node:
    parts = [inner for part in (first, second) for inner in (part.parts if part.op == op else (part,))]
    return Node(op, -1, tuple(parts))


def field(b: Builder, loop: F64, edge: Edge) -> int | None:
    """The field of a polygon, counter-clockwise; None if it is below 0 everywhere."""
    loop = without_straight_corners(loop)
    ways = np.roll(loop, -1, axis=0) - loop
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    normals = np.stack([ways[:, 1], -ways[:, 0]], axis=1)
    offsets = (normals * loop).sum(axis=1)
    return _value(b, formula(loop), lambda k: edge(b, normals[k], float(offsets[k])))


def _value(b: Builder, node: Node, edge: Callable[[int], int | None]) -> int | None:
    if node.op is None:
        return edge(node.edge)
    values = [_value(b, part, edge) for part in node.parts]
    defined = [value for value in values if value is not None]
    if node.op == Op.MIN and len(defined) < len(values):
        return None
    return b.reduce(node.op, defined) if defined else None


# --- swept ------------------------------------------------------------------------------------------------------------


def revolved(b: Builder, profile: F64, angle: float, point: Point) -> int:
    """The field of a profile [radius, y] revolved about y by `angle` from +x towards -z; 2π or more is a whole turn."""
    x, y, z = point
    radius, far = b.op(Op.HYPOT, x, z), 2.0 * float(np.abs(profile).max())

    def edge(b: Builder, normal: F64, offset: float) -> int | None:
        if normal[0] < -0.5 and offset > 0.9 * far:  # beyond the axis
            return None
        return b.linear([(float(normal[0]), radius), (float(normal[1]), y)], -offset)

    outline = field(b, _beyond_axis(profile, -far), edge)
    assert outline is not None  # a profile has edges away from the axis
    if angle >= 2 * np.pi:
        return outline
    begin, end = z, b.linear([(-float(np.sin(angle)), x), (-float(np.cos(angle)), z)])
    return b.op(Op.MAX, outline, b.op(Op.MAX if angle <= np.pi else Op.MIN, begin, end))


def _beyond_axis(profile: F64, far: float) -> F64:
    """The polygon with each edge on the axis moved to radius `far` < 0, where it bounds nothing."""
    vertices = []
    for before, vertex, after in zip(np.roll(profile, 1, axis=0), profile, np.roll(profile, -1, axis=0), strict=True):
        if vertex[0] == 0 and after[0] == 0 and before[0] == 0:
            continue
        if vertex[0] == 0 and before[0] == 0:
            vertices.append((far, vertex[1]))
        vertices.append((vertex[0], vertex[1]))
        if vertex[0] == 0 and after[0] == 0:
            vertices.append((far, vertex[1]))
    return np.array(vertices)


class Prism(NamedTuple):
    """A prism along y: its outline and holes, counter-clockwise in [x, -z], and how they are swept."""

    loops: tuple[F64, ...]
    base: float
    height: float
    twist: float
    taper: float


def prism(b: Builder, shape: Prism, point: Point) -> int:
    """The field of a prism."""
    middle = shape.base + 0.5 * shape.height
    slab = b.offset(b.op(Op.ABS, b.offset(point[1], -middle)), -0.5 * shape.height)
    x, y, z = point
    if shape.twist:
        x, _, z = untwist(b, (x, b.offset(y, -shape.base), z), shape.twist / shape.height)
    slope = (shape.taper - 1.0) / shape.height

    def edge(b: Builder, normal: F64, offset: float) -> int:
        # n · p ≤ c (1 + slope (y − base)), with a gradient of length 1.
        steep = offset * slope
        terms = [(float(normal[0]), x), (-float(normal[1]), z), (-steep, y)]
        return b.scale(b.linear([t for t in terms if t[0]], -offset + steep * shape.base), 1.0 / float(np.hypot(1.0, steep)))

    fields = [field(b, loop, edge) for loop in shape.loops]
    defined = [loop_field for loop_field in fields if loop_field is not None]
    return b.reduce(Op.MAX, [slab, defined[0], *(b.op(Op.NEGATE, hole) for hole in defined[1:])])
