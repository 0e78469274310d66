"""Imports BasisCurves, NurbsCurves and HermiteCurves as tubes, or as ribbons where they have normals, and Points as spheres."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import UsdGeom

from ....lang.diagnostics import Diagnostics, Span
from ...ir import F64, I64
from ...mesh import strands
from ...mesh.polygon_mesh import PolyMesh
from . import stage

KINDS = ("BasisCurves", "NurbsCurves", "HermiteCurves", "Points")
# Up to so many segments, samples of a cubic segment or a span of knots.
_STEPS = ((5_000, 16), (120_000, 8), (250_000, 4), (500_000, 2), (1 << 62, 1))
MAX_ORDER = 64  # of NURBS
# Rows: powers 1, t, t², t³; columns: control points (UsdGeomBasisCurves).
_BASES = {
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 1.0,
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2.0,
}


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples of curves: each is a weighted sum of control points."""

    rows: I64  # (m, order) control points
    weights: F64  # (m, order)
    curve: I64  # (m,) row of the curve
    ends: I64  # (m, 2) values of interpolation varying before and after the sample
    share: F64  # (m,) of the second
    closed: np.ndarray  # (c,)
    varying: int  # number of values of interpolation varying

    def without(self, curves: I64) -> Samples:
        """The samples of the other curves."""
        mask = ~np.isin(self.curve, curves)
        return Samples(
            self.rows[mask], self.weights[mask], self.curve[mask], self.ends[mask], self.share[mask], self.closed, self.varying
        )  # fmt: skip

    def interpolated(self, values: np.ndarray, interpolation: str, points: int) -> np.ndarray | None:
        """Values (m, k) at the samples; None if their number does not fit."""
        if interpolation == "constant" or len(values) == 1:
            return np.broadcast_to(values[0], (len(self.rows), values.shape[1])) if len(values) else None
        if interpolation == "uniform" and len(values) == len(self.closed):
            return values[self.curve]
        if interpolation == "vertex" and len(values) == points:
            return np.einsum("mo,mok->mk", self.weights, values[self.rows])
        if interpolation in ("varying", "vertex", "faceVarying") and len(values) == self.varying:
            return values[self.ends[:, 0]] * (1 - self.share[:, None]) + values[self.ends[:, 1]] * self.share[:, None]
        return None


def mesh(
    prim: Any, time: Any, uv_name: str | None, color_name: str | None, diagnostics: Diagnostics, span: Span
) -> PolyMesh | None:  # fmt: skip
    """The mesh of a prim of a type in KINDS; None, with a warning, if its arrays do not fit each other."""
    points = stage.points(prim, time)
    if not len(points):
        return None
    kind = str(prim.GetTypeName())
    if kind == "Points":
        centers, radii, sound = balls(prim, time, diagnostics, span)
        colors = _reader_of_points(prim, time, len(points), diagnostics, span).primvar(color_name, 3)
        return strands.balls(centers, radii, None if colors is None else colors[sound]) if len(centers) else None
    counts = stage.numbers(prim.GetAttribute("curveVertexCounts"), time, np.int64)
    counts = stage.fitted_counts(counts, len(points), ("the vertex counts of the curves", "points", "curves"), diagnostics, span)
    damaged = np.unique(np.repeat(np.arange(len(counts)), counts)[~np.isfinite(points[: counts.sum()]).all(axis=1)])
    if len(damaged):
        diagnostics.warning(f"{len(damaged)} of {len(counts)} curves have points that are not finite: they are left out", span)
    control, number = np.nan_to_num(points), len(points)
    if kind == "HermiteCurves":
        tangents = stage.numbers(prim.GetAttribute("tangents"), time, np.float64, 3)
        samples = _hermite(counts) if len(tangents) == number and np.isfinite(tangents).all() else None
        control, number = np.concatenate([control, tangents]), -1  # their values of interpolation vertex are varying
    else:
        samples = _basis(prim, counts) if kind == "BasisCurves" else _nurbs(prim, time, counts, number, diagnostics, span)
    if samples is None:
        what = "tangents" if kind == "HermiteCurves" else f"knots, counts or orders (at most {MAX_ORDER})"
        diagnostics.warning(f"the {what} of this {kind} do not fit its points: it is not drawn", span)
        return None
    samples = samples.without(damaged)
    if not len(samples.rows):
        diagnostics.warning(f"the curves of this {kind} have too few points: they are not drawn", span)
        return None
    schema = UsdGeom.Curves(prim)
    read = _Reader(prim, time, number, samples, diagnostics, span)
    widths = read.values("widths", schema.GetWidthsAttr(), str(schema.GetWidthsInterpolation()), 1)
    radii = np.full(len(samples.rows), 0.5) if widths is None else np.maximum(np.nan_to_num(widths[:, 0]), 0.0) / 2
    polylines = strands.Strands(
        np.einsum("mo,mok->mk", samples.weights, control[samples.rows]), radii, np.bincount(samples.curve)[np.unique(samples.curve)],
        samples.closed[np.unique(samples.curve)],
    )  # fmt: skip
    uvs, colors = (read.primvar(name, width) for name, width in ((uv_name, 2), (color_name, 3)))
    facing = read.values("normals", schema.GetNormalsAttr(), str(schema.GetNormalsInterpolation()), 3)
    if facing is not None:
        return strands.ribbons(polylines, facing.astype(np.float64), uvs, colors)
    return strands.tubes(polylines, uvs, colors)


def balls(prim: Any, time: Any, diagnostics: Diagnostics, span: Span) -> tuple[F64, F64, np.ndarray]:
    """The centers (n, 3) and radii (n,) of a Points prim, and which points they are of: those that are finite and have a width."""
    points = stage.points(prim, time)
    schema = UsdGeom.Points(prim)
    read = _reader_of_points(prim, time, len(points), diagnostics, span)
    widths = read.values("widths", schema.GetWidthsAttr(), str(schema.GetWidthsInterpolation()), 1)
    radii = np.full(len(points), 0.5) if widths is None else np.maximum(np.nan_to_num(widths[:, 0]), 0.0) / 2
    sound = np.isfinite(points).all(axis=1) & (radii > 0)
    if not sound.all():
        lost = int(np.count_nonzero(~sound))
        diagnostics.warning(f"{lost} of {len(points)} points are not finite or have no width: they are left out", span)
    return points[sound], radii[sound], sound


def _reader_of_points(prim: Any, time: Any, n: int, diagnostics: Diagnostics, span: Span) -> _Reader:
    rows = np.arange(n)
    alone = Samples(rows[:, None], np.ones((n, 1)), rows, np.stack([rows, rows], axis=1), np.zeros(n), np.zeros(n, bool), n)
    return _Reader(prim, time, n, alone, diagnostics, span)


@dataclass(frozen=True, slots=True, eq=False)
class _Reader:
    """Reads values of a prim at samples, with a warning for a number of values that does not fit."""

    prim: Any
    time: Any
    points: int
    samples: Samples
    diagnostics: Diagnostics
    span: Span

    def values(self, name: str, attribute: Any, interpolation: str, width: int) -> np.ndarray | None:
        """A primvar of this name, else the attribute."""
        primvar = UsdGeom.PrimvarsAPI(self.prim).GetPrimvar(name)
        if primvar and primvar.HasValue():
            return self.primvar(name, width)
        return self._fitted(name, stage.numbers(attribute, self.time, np.float64, width), interpolation)

    def primvar(self, name: str | None, width: int) -> np.ndarray | None:
        primvar = UsdGeom.PrimvarsAPI(self.prim).FindPrimvarWithInheritance(name) if name else None
        if not primvar or not primvar.HasValue():
            return None
        try:
            values = np.array(stage.flattened(primvar, self.time), np.float64).reshape(-1, width)
        except (TypeError, ValueError):
            values = np.zeros((0, width))
        return self._fitted(str(name), stage.linear(primvar.GetAttr(), np.nan_to_num(values)), str(primvar.GetInterpolation()))

    def _fitted(self, name: str, values: np.ndarray, interpolation: str) -> np.ndarray | None:
        if not len(values):
            return None
        sampled = self.samples.interpolated(values, interpolation, self.points)
        if sampled is None:
            message = f"`{name}` has {len(values)} values, which do not fit its interpolation `{interpolation}`: it is left out"
            self.diagnostics.warning(message, self.span)
        return sampled


def _basis(prim: Any, counts: I64) -> Samples | None:
    """Samples of BasisCurves. Pinned ends have phantom points 2 P0 − P1, as sums of the control points."""
    schema = UsdGeom.BasisCurves(prim)
    cubic = str(schema.GetTypeAttr().Get()) == "cubic"
    basis, wrap = str(schema.GetBasisAttr().Get()), str(schema.GetWrapAttr().Get())
    if cubic and basis not in _BASES:
        return None
    order, step = (4, 3 if basis == "bezier" else 1) if cubic else (2, 1)
    pinned = cubic and wrap == "pinned" and basis != "bezier"
    closed = wrap == "periodic"
    if closed:
        segments = counts // step
    else:
        segments = np.maximum((counts - 1 if pinned else (counts - order) // step + 1), 0)
    segments = np.where(counts < (2 if not closed or not cubic else 3), 0, segments)
    if not segments.any():
        return Samples(np.zeros((0, order), np.int64), np.zeros((0, order)), *_NOTHING, np.zeros(len(counts), bool), 0)
    steps = _steps(int(segments.sum())) if cubic else 1
    curve, segment, t = _grid(segments, steps, closed)
    first = (np.cumsum(counts) - counts)[curve]
    number = counts[curve]
    powers = t[:, None] ** np.arange(order)
    weights = powers @ _BASES[basis] if cubic else np.stack([1 - t, t], axis=1)
    local = segment[:, None] * step + np.arange(order) - (1 if pinned else 0)
    if closed:
        local = local % number[:, None]
    elif pinned:
        low, high = local[:, 0] < 0, local[:, 3] >= number
        for mask, out, near, far in ((low, 0, 1, 2), (high, 3, 2, 1)):
            weights[mask, near] += 2 * weights[mask, out]
            weights[mask, far] -= weights[mask, out]
            weights[mask, out] = 0.0
        local = np.clip(local, 0, number[:, None] - 1)
    ends_of = segments if closed else np.where(segments > 0, segments + 1, 0)
    offset = (np.cumsum(ends_of) - ends_of)[curve]
    after = (segment + 1) % segments[curve] if closed else segment + 1
    ends = np.stack([offset + segment, offset + after], axis=1)
    return Samples(first[:, None] + local, weights, curve, ends, t, np.full(len(counts), closed), int(ends_of.sum()))


def _hermite(counts: I64) -> Samples:
    """Samples of HermiteCurves: cubic between two points and their tangents. The rows of tangents follow those of points."""
    segments = np.maximum(counts - 1, 0)
    total = int(counts.sum())
    curve, segment, t = _grid(segments, _steps(int(segments.sum())), False)
    start = (np.cumsum(counts) - counts)[curve] + segment
    rows = np.stack([start, start + 1, total + start, total + start + 1], axis=1)
    square, cube = t * t, t * t * t
    weights = np.stack([2 * cube - 3 * square + 1, 3 * square - 2 * cube, cube - 2 * square + t, cube - square], axis=1)
    ends = np.stack([start, start + 1], axis=1)
    return Samples(rows, weights, curve, ends, t, np.zeros(len(counts), bool), total)


def _steps(segments: int) -> int:
    return next(steps for most, steps in _STEPS if segments <= most)


_NOTHING = (np.zeros(0, np.int64), np.zeros((0, 2), np.int64), np.zeros(0))


def _grid(segments: I64, steps: int, closed: bool) -> tuple[I64, I64, F64]:
    """(curve, segment, parameter in it) of the samples of curves; open curves have a last sample at the end of their last segment."""
    total = segments * steps + np.where(segments > 0, 0 if closed else 1, 0)
    curve = np.repeat(np.arange(len(segments)), total)
    k = np.arange(len(curve)) - np.repeat(np.cumsum(total) - total, total)
    segment = np.minimum(k // steps, segments[curve] - 1)
    return curve, segment, (k - segment * steps) / steps


def _nurbs(prim: Any, time: Any, counts: I64, points: int, diagnostics: Diagnostics, place: Span) -> Samples | None:
    """Samples of NurbsCurves, over the range of each curve (Cox and de Boor). Without knots they are clamped and uniform."""
    orders = stage.numbers(prim.GetAttribute("order"), time, np.int64)
    knots = stage.numbers(prim.GetAttribute("knots"), time, np.float64)
    ranges = stage.numbers(prim.GetAttribute("ranges"), time, np.float64, 2)
    heavy = stage.numbers(prim.GetAttribute("pointWeights"), time, np.float64)
    heavy = heavy if len(heavy) == points else np.ones(points)
    if not len(orders):
        orders = np.clip(counts, 2, 4)
        diagnostics.warning("this NurbsCurves has no order: its curves are cubic, or as their points allow", place)
    orders = np.repeat(orders, len(counts)) if len(orders) == 1 else orders
    if not len(knots) and len(orders) == len(counts) and (orders >= 1).all() and (orders <= np.minimum(counts, MAX_ORDER)).all():
        knots = np.concatenate([clamped(count, order) for count, order in zip(counts.tolist(), orders.tolist(), strict=True)])
        diagnostics.warning("this NurbsCurves has no knots: clamped uniform ones are taken", place)
    if len(orders) != len(counts) or (counts + orders).sum() != len(knots):
        return None
    if (orders < 2).any() or (orders > np.minimum(counts, MAX_ORDER)).any():
        return None
    width = int(orders.max())
    rows, weights, curves, ends, shares = [], [], [], [], []
    first_knot = first_point = 0
    for k, (count, order) in enumerate(zip(counts.tolist(), orders.tolist(), strict=True)):
        curve_knots = knots[first_knot : first_knot + count + order]
        low, high = curve_knots[order - 1], curve_knots[count]
        if len(ranges) == len(counts):
            low, high = max(low, ranges[k, 0]), min(high, ranges[k, 1])
        if not low < high or (np.diff(curve_knots) < 0).any():
            return None
        t = np.linspace(low, high, (count - order + 1) * _steps(points) + 1)
        span = np.clip(np.searchsorted(curve_knots, t, side="right") - 1, order - 1, count - 1)
        basis = de_boor(curve_knots, span, t, order)
        row = span[:, None] - order + 1 + np.arange(order) + first_point
        basis = basis * heavy[row]
        basis = basis / np.where(basis.sum(axis=1, keepdims=True) != 0, basis.sum(axis=1, keepdims=True), 1.0)
        rows.append(np.pad(row, ((0, 0), (0, width - order))))
        weights.append(np.pad(basis, ((0, 0), (0, width - order))))
        curves.append(np.full(len(t), k))
        ends.append(np.tile([2 * k, 2 * k + 1], (len(t), 1)))
        shares.append((t - low) / (high - low))
        first_knot, first_point = first_knot + count + order, first_point + count
    none = np.zeros(len(counts), bool)
    joined = [np.concatenate(parts) for parts in (rows, weights, curves, ends, shares)]
    return Samples(joined[0], joined[1], joined[2], joined[3], joined[4], none, 2 * len(counts))


def clamped(count: int, order: int) -> F64:
    """The knots of a curve that begins at its first point and ends at its last, one apart between."""
    return np.clip(np.arange(count + order, dtype=np.float64) - (order - 1), 0, count - order + 1)


def de_boor(knots: F64, span: I64, t: F64, order: int) -> F64:
    """The B-spline basis (m, order) that is not 0 at parameters t in knot spans (The NURBS Book, A2.2)."""
    basis = np.zeros((len(t), order))
    basis[:, 0] = 1.0
    for j in range(1, order):
        saved = np.zeros(len(t))
        for r in range(j):
            right, left = knots[span + r + 1] - t, t - knots[span + 1 - j + r]
            total = np.where(right + left != 0, right + left, 1.0)
            term = basis[:, r] / total
            basis[:, r] = saved + right * term
            saved = left * term
        basis[:, j] = saved
    return basis
