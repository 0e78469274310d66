"""Lowers `implicit`: a relation of x, y and z becomes a solid or a sheet, with its tape and bounding box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...lang.elements import Element
from .. import ir
from ..formula import bounding_box, quadric_recognition, relation
from ..formula.builder import Builder
from ..formula.from_formula import NotASurface
from ..formula.opcodes import Op
from ..formula.tape import MOST_LIVE, Tape, X, Y, Z, most_live
from ..io import stage_cache
from ..mesh import built_geometry
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

MARGIN = 1e-3  # of its size, by which a box exceeds the solid that its faces clip
WITHIN = 2.0**-41  # of the largest coordinate, by which these faces are inset: a formula may jump exactly on them


def implicit(lowering: Context, element: Element) -> list[Piece]:
    """The surface of an `implicit`; nothing, after a diagnostic, if there is none."""
    formula, within = element.args["formula"], element.args["within"]
    try:
        tape, sheet, left_out = relation.surface(formula)
    except NotASurface as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    unit = formula.unit
    cut = None if within is None else np.array(within[:2]) / unit
    frame = None if sheet or (within is not None and within[2][3] > 0) else _ellipsoid_frame(tape, cut)
    if frame is not None:
        row = lowering.builder.geometry(ir.GeometryKind.SPHERE, (1.0,), element.place)
        return [Piece(row, transforms.scaling((unit,) * 3) @ frame)]
    bounds = bounding_box.find_bounds(sheet_field(tape) if sheet else tape) if cut is None else cut
    if bounds is None:
        hint = "write within: and how far from the origin it is to be drawn, like within: 2"
        return lowering.refuse(element, "it is not known how far this surface reaches: it may be endless", hint)
    places, values = bounding_box.sample_field(tape, bounds)
    if bounding_box.is_zero_over_region(tape, places, values):
        try:
            tape, sheet, left_out = relation.surface(formula, may_tie=True)
        except NotASurface as unfit:
            return lowering.refuse(element, str(unfit), unfit.hint)
    if left_out:
        hint = "write < instead of <= if none is meant; if it is, draw it beside this with =="
        lowering.warn(element, "where a squared factor is 0 this holds on a sheet, too, of which nothing is drawn", hint)
    ball = (0.0, 0.0, 0.0, 0.0)
    if within is not None:
        if not sheet and bounding_box.is_full(tape, bounds, values):
            hint = "give `within` more room, or write a box or sphere"
            lowering.warn(element, "all points within these bounds are inside: the picture shows the box or ball itself", hint)
        ball = np.array(within[2]) / unit
        wider = bounds if sheet else _wider(bounds)
        tight = bounding_box.shrink_bounds(sheet_field(tape) if sheet else tape, bounds, wider)
        if not sheet and tight is not None:
            if ball[3]:
                tape = _cut(tape, bounds, ball)
                tight = bounding_box.shrink_bounds(tape, wider, wider)
            elif ((tight[0] <= bounds[0]) | (tight[1] >= bounds[1])).any() and bounding_box.crosses_faces(tape, bounds):
                tape = _cut(tape, bounds, ball)
            else:
                tight = np.clip(tight, *bounds)
        ball = ball if sheet else (0.0, 0.0, 0.0, 0.0)
        if tight is None:
            lowering.warn(element, "there is no surface within these bounds: nothing is drawn")
            return []
        bounds = tight
    tape, bounds, ball = to_metres(tape, unit), bounds * unit, tuple(number * unit for number in ball)
    return implicit_piece(lowering, element, tape, bounds, (float(sheet), *ball))


def shrunk(tape: Tape, bounds: np.ndarray) -> np.ndarray | None:
    """The box of a field's surface within bounds (2, 3); None without a surface. The bounds themselves where geometry is left out."""
    if built_geometry.is_left_out():
        return bounds
    with built_geometry.part("bounded"):
        return stage_cache.cached("formulas bounded", (tape, bounds), lambda: bounding_box.shrink_bounds(tape, bounds))


def implicit_piece(lowering: Context, element: Element, tape: Tape, bounds: np.ndarray, parameters: Sequence[float]) -> list[Piece]:
    """A field's surface in a box; nothing, after a diagnostic, if it needs more registers than evaluators have."""
    live = most_live(tape)
    if live > MOST_LIVE:
        hint = "this formula is too large for one surface: write several"
        return lowering.refuse(
            element, f"the formula needs {live:,} values at a time, and there is room for {MOST_LIVE}", hint
        )
    return [Piece(lowering.builder.formula(tape, bounds, parameters, element.place), transforms.identity())]


def _ellipsoid_frame(tape: Tape, bounds: np.ndarray | None) -> np.ndarray | None:
    """The transform from the unit ball to an ellipsoid that lies within its bounds; else None."""
    matrix = quadric_recognition.ellipsoid(tape)
    if matrix is None:
        return None
    reach = np.linalg.norm(matrix[:3, :3], axis=1)  # the extreme of a linear form on the unit ball
    inside = bounds is None or bool((matrix[:3, 3] - reach > bounds[0]).all() and (matrix[:3, 3] + reach < bounds[1]).all())
    return matrix if inside else None


def to_metres(tape: Tape, unit: float) -> Tape:
    """A field of coordinates and values in metres, from one in the unit of its file."""
    if unit == 1.0:
        return tape
    builder = Builder()
    (field,) = builder.inline(tape, [builder.scale(name, 1.0 / unit) for name in (X, Y, Z)])
    return builder.finish(builder.scale(field, unit))


def sheet_field(tape: Tape) -> Tape:
    """The magnitude of a field: at most 0 on the sheet alone."""
    builder = Builder()
    return builder.finish(builder.op(Op.ABS, *builder.inline(tape, (X, Y, Z))))


def _wider(bounds: np.ndarray) -> np.ndarray:
    """Bounds with a margin, for a solid and the faces that clip it."""
    margin = MARGIN * (bounds[1] - bounds[0])
    return np.stack([bounds[0] - margin, bounds[1] + margin])


def _cut(tape: Tape, bounds: np.ndarray, ball: np.ndarray) -> Tape:
    """A solid clipped by its box, or by a ball."""
    builder, (field,) = Builder.from_tape(tape)
    if ball[3]:
        squares = [builder.op(Op.SQUARE, builder.offset(name, -float(c))) for name, c in zip((0, 1, 2), ball[:3], strict=True)]
        radius = builder.op(Op.SQRT, builder.add(builder.add(squares[0], squares[1]), squares[2]))
        cut = builder.offset(radius, -float(ball[3]))
    else:
        middle, half = bounds.mean(axis=0), 0.5 * (bounds[1] - bounds[0])
        half = half - WITHIN * np.abs(bounds).max()
        faces = [builder.offset(builder.op(Op.ABS, builder.offset(name, -float(middle[name]))), -float(half[name])) for name in (0, 1, 2)]
        cut = builder.op(Op.MAX, builder.op(Op.MAX, faces[0], faces[1]), faces[2])
    return builder.finish(builder.op(Op.MAX, field, cut))
