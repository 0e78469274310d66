"""Closed meshes of analytic shapes for mesh CSG: boxes exactly, round shapes as surfaces of revolution within a tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .. import ir
from . import mesh_csg
from .mesh_csg import Solid

MOST = 2048  # chords of a circle
_CORNERS = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)]) * 2.0 - 1.0
_SIDES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])
_Kind = ir.GeometryKind


def solid(kind: int, p: Sequence[float], tolerance: float) -> Solid | None:
    """The solid of an analytic shape in its own frame; None of kinds that have no mesh here, and of shapes without an inside."""
    match kind:
        case _Kind.BOX:
            faces = np.concatenate([_SIDES[:, [0, 1, 2]], _SIDES[:, [0, 2, 3]]])
            return Solid(mesh_csg.of_triangles(_CORNERS * np.array(p[:3]), faces))
        case _Kind.SPHERE:
            count = _chords(p[0], 0.5 * tolerance)
            return Solid(_revolved(_arc(p[0], 0.0, count // 2), count), 2 * _off(p[0], count))
        case _Kind.CAPSULE:
            count = _chords(p[0], 0.5 * tolerance)
            low, high = np.split(_arc(p[0], 0.0, count // 2), [count // 4 + 1])
            both = np.concatenate([low - (0.0, p[1]), low[-1:] + (0.0, p[1]), high + (0.0, p[1])])
            return Solid(_revolved(both, count), 2 * _off(p[0], count))
        case _Kind.CYLINDER | _Kind.CONE:
            low, high, half, capped = (p[0], *p[:3]) if kind == _Kind.CYLINDER else p[:4]
            if not capped:
                return None
            count = _chords(max(low, high), tolerance)
            ends = [(radius, y) for radius, y in ((low, -half), (high, half)) if radius > 0.0]
            return Solid(_revolved(np.array([(0.0, -half), *ends, (0.0, half)]), count), _off(max(low, high), count))
        case _Kind.TORUS if p[1] < p[0]:
            around, tube = _chords(p[0] + p[1], 0.5 * tolerance), _chords(p[1], 0.5 * tolerance)
            angle = 2 * math.pi * np.arange(tube) / tube
            circle = np.stack([p[0] + p[1] * np.cos(angle), p[1] * np.sin(angle)], axis=1)
            return Solid(_ring(circle, around), _off(p[0] + p[1], around) + _off(p[1], tube))
    return None


def _chords(radius: float, tolerance: float) -> int:
    """Chords of a circle, a multiple of 4, that keep the tolerance or are MOST."""
    share = min(tolerance / radius, 1.0) if radius > 0.0 else 1.0
    needed = MOST if share < 1e-9 else math.pi / math.acos(1.0 - share)
    return min(max(24, 4 * math.ceil(needed / 4)), MOST)


def _off(radius: float, count: int) -> float:
    return radius * (1.0 - math.cos(math.pi / count))


def _arc(radius: float, y: float, count: int) -> np.ndarray:
    """(count + 1, 2) points of half a circle, from its lowest to its highest."""
    cos, sin = _circle(2 * count)
    return np.stack([radius * sin[: count + 1], y - radius * cos[: count + 1]], axis=1)


def _circle(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosines and sines of even steps of a turn, exact at quarters."""
    angle = 2 * math.pi * np.arange(count) / count
    quarter = np.arange(count) * 4 % count == 0
    return (np.where(quarter, np.round(f(angle)), f(angle)) for f in (np.cos, np.sin))  # type: ignore[return-value]


def _revolved(profile: np.ndarray, count: int) -> object:
    """A profile (n, 2) of [radius, y] about y, which begins and ends on the axis."""
    cos, sin = _circle(count)
    rings = profile[1:-1]
    points = np.stack([rings[:, :1] * cos, np.broadcast_to(rings[:, 1:], (len(rings), count)), -rings[:, :1] * sin], axis=2)
    ends = np.array([[0.0, profile[0, 1], 0.0], [0.0, profile[-1, 1], 0.0]])
    k = np.arange(count)
    after = (k + 1) % count
    last = (len(rings) - 1) * count
    south, north = len(rings) * count, len(rings) * count + 1
    fans = [np.stack([np.full(count, south), after, k], axis=1), np.stack([np.full(count, north), last + k, last + after], axis=1)]
    return mesh_csg.of_triangles(np.concatenate([points.reshape(-1, 3), ends]), np.concatenate([_between(len(rings), count), *fans]))


def _ring(profile: np.ndarray, count: int) -> object:
    """A closed counter-clockwise profile (n, 2) of [radius, y] about y, which does not meet the axis."""
    cos, sin = _circle(count)
    points = np.stack([profile[:, :1] * cos, np.broadcast_to(profile[:, 1:], (len(profile), count)), -profile[:, :1] * sin], axis=2)
    return mesh_csg.of_triangles(points.reshape(-1, 3), _between(len(profile) + 1, count) % (len(profile) * count))


def _between(rings: int, count: int) -> np.ndarray:
    """The triangles between rings of `count` vertices, one after the other."""
    first = np.arange(rings - 1)[:, None] * count
    column = np.arange(count)[None]
    after = (column + 1) % count
    a, b, c, d = (x.ravel() for x in (first + column, first + after, first + count + after, first + count + column))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
