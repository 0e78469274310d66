"""Shapes asked directly, by numpy and in their own frame: what rays meet, and the equations of their surfaces."""

from __future__ import annotations

import math

import numpy as np
from maquette.compiler import ir
from maquette.render.geometry import analytic_shapes

K = ir.GeometryKind
INF = math.inf


def table(*rows: list[float]) -> np.ndarray:
    """Geometries.parameters with these rows."""
    parameters = np.zeros((len(rows), ir.PARAMETERS))
    for k, row in enumerate(rows):
        parameters[k, : len(row)] = row
    return parameters


def hit(kind: int, parameters: list[float], origin, direction, t_min: float = 0.0, t_max: float = INF) -> tuple[np.ndarray, np.ndarray]:
    """(t, part) of rays (n, 3) with one shape, by numpy."""
    o, d = np.broadcast_arrays(np.atleast_2d(np.asarray(origin, float)), np.atleast_2d(np.asarray(direction, float)))
    n = np.zeros(len(o))
    with np.errstate(all="ignore"):
        t, part = analytic_shapes.intersect(int(kind), table(parameters), 0, tuple(o.T), tuple(d.T), n + t_min, n + t_max)
    return np.broadcast_to(t, n.shape), np.broadcast_to(part, n.shape)


def after(kind: int, parameters: list[float], o: np.ndarray, d: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(t, part) of what rays meet beyond `start`."""
    with np.errstate(all="ignore"):
        t, part = analytic_shapes.intersect(int(kind), table(parameters), 0, tuple(o.T), tuple(d.T), start, np.full(len(o), INF))
    return np.broadcast_to(t, start.shape), np.broadcast_to(part, start.shape)


def equation(kind: int, p: list[float], points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """What is 0 on the surface at points (n, 3), in units of length; inside is negative."""
    x, y, z = points.T
    rho = np.hypot(x, z)
    if kind == K.SPHERE:
        return np.linalg.norm(points, axis=1) - p[0]
    if kind == K.BOX:
        side = np.where(part % 2 == 1, 1.0, -1.0) * np.choose(part // 2, [x, y, z])
        return side - np.choose(part // 2, p[:3])
    if kind in (K.PLANE, K.RECTANGLE, K.DISK):
        return y
    if kind in (K.CYLINDER, K.CONE):
        bottom, top, half = (p[0], p[0], p[1]) if kind == K.CYLINDER else p[:3]
        slope = 0.5 * (top - bottom) / half
        side = (rho - (0.5 * (bottom + top) + slope * y)) / math.hypot(1.0, slope)
        return np.choose(part, [side, -half - y, y - half])
    if kind == K.TORUS:
        return np.hypot(rho - p[0], y) - p[1]
    if kind == K.CAPSULE:
        return np.linalg.norm(np.stack([x, y - np.clip(y, -p[1], p[1]), z]), axis=0) - p[0]
    a, b, c, d, e, f, g, h, i, j = p[:10]
    return a * x * x + b * y * y + c * z * z + d * x * y + e * y * z + f * x * z + g * x + h * y + i * z + j
