"""Imports NurbsPatch prims as meshes: a grid of each span of knots, with the normals of the surface.

Control points are row by row, u fastest (UsdGeomNurbsPatch).
"""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from ....lang.diagnostics import Diagnostics, Span
from ...ir import F64
from ...mesh.polygon_mesh import PolyMesh, flip
from ...scene.row_records import MeshAttribute
from . import stage
from .curves import MAX_ORDER, clamped, de_boor
from .geometry import Faces, Reads

_STEPS = 8  # of a span of knots, fewer for many spans
MOST_CELLS = 1 << 22


@dataclass(frozen=True, slots=True, eq=False)
class _Spans:
    """Knots along one parameter, number of control points, order, and the different knots (n + 1,) of its range."""

    knots: F64
    count: int
    order: int
    inner: F64


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """Samples along one parameter: the basis (m, count), its derivative, and the parameter from 0 to 1."""

    basis: F64
    slope: F64
    share: F64


def faces(prim: Any, time: Any, reads: Reads, diagnostics: Diagnostics, span: Span) -> Faces | None:
    """The mesh of a NurbsPatch; None, with a warning, if its numbers do not fit. Texture coordinates are the parameters, 0 to 1."""
    points = stage.numbers(prim.GetAttribute("points"), time, np.float64, 3)
    spans = [_spans(prim, time, letter, diagnostics, span) for letter in "uv"]
    sizes = [each.count for each in spans if each is not None]
    if len(sizes) < 2 or len(points) != sizes[0] * sizes[1] or not np.isfinite(points).all():
        diagnostics.warning(
            f"the knots, orders (at most {MAX_ORDER}) and points of this NurbsPatch do not fit each other: it is not drawn", span
        )
        return None
    cells = math.prod(len(each.inner) - 1 for each in spans if each is not None)
    steps = min(_STEPS, math.isqrt(MOST_CELLS // cells))
    if not steps:
        diagnostics.warning(f"this NurbsPatch needs more than {MOST_CELLS:,} faces: it is not drawn", span)
        return None
    u, v = (_axis(each, steps) for each in spans if each is not None)
    heavy = stage.numbers(prim.GetAttribute("pointWeights"), time, np.float64)
    heavy = heavy if len(heavy) == len(points) else np.ones(len(points))
    grid = (v.basis.shape[1], u.basis.shape[1])
    weighted = np.concatenate([points * heavy[:, None], heavy[:, None]], axis=1).reshape(*grid, 4)

    def mixed(along_v: F64, along_u: F64, values: F64) -> F64:
        rows = np.tensordot(along_v, values, 1)  # (i, u, k)
        return np.tensordot(rows, along_u, ([1], [1])).transpose(0, 2, 1)

    surface, du, dv = mixed(v.basis, u.basis, weighted), mixed(v.basis, u.slope, weighted), mixed(v.slope, u.basis, weighted)
    w = np.where(surface[..., 3:] != 0, surface[..., 3:], 1.0)
    positions = surface[..., :3] / w
    normal = np.cross((du[..., :3] - du[..., 3:] * positions) / w, (dv[..., :3] - dv[..., 3:] * positions) / w)
    colors = None
    if reads.color is not None:
        color_points = np.array(stage.flattened(UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(reads.color), time), np.float64)
        if color_points.shape == points.shape:
            colors = MeshAttribute(np.maximum(mixed(v.basis, u.basis, color_points.reshape(*grid, 3)).reshape(-1, 3), 0.0))
        else:
            diagnostics.warning(f"`{reads.color}` of a NurbsPatch is drawn with one value a control point: it is left out", span)
    uvs = np.stack([np.broadcast_to(u.share, positions.shape[:2]), np.broadcast_to(v.share[:, None], positions.shape[:2])], axis=-1)
    n, m = len(u.share), len(v.share)
    corner = (np.arange(m - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    quads = np.stack([corner, corner + 1, corner + n + 1, corner + n], axis=1)
    mesh = PolyMesh(
        positions.reshape(-1, 3), np.full(len(quads), 4), quads.reshape(-1), MeshAttribute(normal.reshape(-1, 3)),
        MeshAttribute(uvs.reshape(-1, 2).astype(np.float32)), colors,
    )  # fmt: skip
    if str(prim.GetAttribute("orientation").Get(time)) == "leftHanded":
        mesh = flip(mesh)
    return Faces(mesh, np.arange(len(quads)), False)


def _spans(prim: Any, time: Any, letter: str, diagnostics: Diagnostics, span: Span) -> _Spans | None:
    """The spans of knots along u or v, in its range; None if the knots do not fit. Without knots they are clamped and uniform."""
    count, order = (int(stage.number(prim.GetAttribute(f"{letter}{name}"), time)) for name in ("VertexCount", "Order"))
    knots = stage.numbers(prim.GetAttribute(f"{letter}Knots"), time, np.float64)
    if not len(knots) and 2 <= order <= min(count, MAX_ORDER):
        knots = clamped(count, order)
        diagnostics.warning(f"this NurbsPatch has no knots along {letter}: clamped uniform ones are taken", span)
    if not 2 <= order <= MAX_ORDER or count < order or len(knots) != count + order or not (np.diff(knots) >= 0).all():
        return None
    low, high = knots[order - 1], knots[count]
    authored = stage.numbers(prim.GetAttribute(f"{letter}Range"), time, np.float64)
    if len(authored) == 2:
        low, high = max(low, authored[0]), min(high, authored[1])
    if not low < high:
        return None
    return _Spans(knots, count, order, np.unique(np.clip(knots[order - 1 : count + 1], low, high)))


def _axis(spans: _Spans, steps: int) -> _Axis:
    knots, count, order, inner = spans.knots, spans.count, spans.order, spans.inner
    t = np.interp(np.arange((len(inner) - 1) * steps + 1) / steps, np.arange(len(inner)), inner)
    return _Axis(_spread(knots, t, count, order), _slopes(knots, t, count, order), (t - inner[0]) / (inner[-1] - inner[0]))


def _spread(knots: F64, t: F64, count: int, order: int) -> F64:
    """The B-spline basis (m, count) at parameters."""
    basis = np.zeros((len(t), count))
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, order - 1, count - 1)
    rows = span[:, None] - order + 1 + np.arange(order)
    np.put_along_axis(basis, rows, de_boor(knots, span, t, order), axis=1)
    return basis


def _slopes(knots: F64, t: F64, count: int, order: int) -> F64:
    """The derivative (m, count) of the basis: p (N_i,p−1 / (t_i+p − t_i) − N_i+1,p−1 / (t_i+p+1 − t_i+1)) (The NURBS Book, 2.3)."""
    p = order - 1
    lower = np.zeros((len(t), count + 1))
    span = np.clip(np.searchsorted(knots, t, side="right") - 1, p, count - 1)
    rows = span[:, None] - p + 1 + np.arange(p)
    np.put_along_axis(lower, rows, de_boor(knots, span, t, p) if p > 1 else np.ones((len(t), 1)), axis=1)
    width = knots[p : p + count + 1] - knots[: count + 1]
    scaled = lower * np.where(width > 0, p / np.where(width > 0, width, 1.0), 0.0)
    return scaled[:, :-1] - scaled[:, 1:]
