"""Bounds of the analytic shapes in their own frame, and bounds under transforms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .. import ir

Kind = ir.GeometryKind


def bounds_of(kind: int, parameters: Sequence[float]) -> np.ndarray:
    """(2, 3) bounds of a shape other than a mesh; ±inf for an unbounded shape."""
    if kind == Kind.QUADRIC:
        return quadric(parameters)
    half = np.array(_half(kind, parameters), dtype=np.float64)
    return np.stack([-half, half])


def _half(kind: int, p: Sequence[float]) -> tuple[float, float, float]:
    if kind == Kind.SPHERE:
        return (p[0], p[0], p[0])
    if kind == Kind.BOX:
        return (p[0], p[1], p[2])
    if kind == Kind.PLANE:
        return (math.inf, 0.0, math.inf)
    if kind == Kind.RECTANGLE:
        return (p[0], 0.0, p[1])
    if kind == Kind.DISK:
        return (p[0], 0.0, p[0])
    if kind == Kind.CYLINDER:
        return (p[0], p[1], p[0])
    if kind == Kind.CONE:
        radius = max(p[0], p[1])
        return (radius, p[2], radius)
    if kind == Kind.TORUS:
        return (p[0] + p[1], p[1], p[0] + p[1])
    if kind == Kind.CAPSULE:
        return (p[0], p[1] + p[0], p[0])
    raise ValueError(f"no analytic shape has the kind {kind}")


def quadric(p: Sequence[float]) -> np.ndarray:
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


def boxes_under(boxes: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """(n, 2, 3) bounds of boxes (n, 2, 3) under matrices (n, 3, 4); ±inf along each axis that an unbounded box extends to."""
    linear, moved = matrices[:, :, :3], matrices[:, :, 3]
    with np.errstate(invalid="ignore"):
        ends = linear[:, :, :, None] * np.swapaxes(boxes, 1, 2)[:, None]  # (n, out, in, low or high)
        ends = np.where(linear[:, :, :, None] == 0, 0.0, ends)
        return np.stack([ends.min(axis=3).sum(axis=2) + moved, ends.max(axis=3).sum(axis=2) + moved], axis=1)
