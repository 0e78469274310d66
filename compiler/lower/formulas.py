"""`implicit`: a relation between x, y and z becomes the surface of a solid, or a sheet, with its tape and a box that holds it."""

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
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

MARGIN = 1e-3  # of its size, that a box is larger than the solid that its faces cut
WITHIN = 2.0**-41  # of the largest coordinate, that these faces lie further in: a formula may jump right on them


def implicit(lowering: Context, element: Element) -> list[Piece]:
    """The surface of an `implicit`; nothing, after a diagnostic, where there is none that could be drawn."""
    formula, within = element.args["formula"], element.args["within"]
    try:
        tape, sheet, left_out = relation.surface(formula)
    except NotASurface as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    unit = formula.unit
    cut = None if within is None else np.array(within[:2]) / unit
    known = None if sheet or (within is not None and within[2][3] > 0) else _known(tape, cut)
    if known is not None:
        row = lowering.builder.geometry(ir.GeometryKind.SPHERE, (1.0,), element.span)
        return [Piece(row, transforms.scaling((unit,) * 3) @ known)]
    bounds = bounding_box.find(sheet_field(tape) if sheet else tape) if cut is None else cut
    if bounds is None:
        hint = "write within: and how far from the origin it is to be drawn, like within: 2"
        return lowering.refuse(element, "it is not known how far this surface reaches: it may be endless", hint)
    places, values = bounding_box.some_of(tape, bounds)
    if bounding_box.zero_all_over(tape, places, values):
        try:
            tape, sheet, left_out = relation.surface(formula, may_tie=True)
        except NotASurface as unfit:
            return lowering.refuse(element, str(unfit), unfit.hint)
    if left_out:
        hint = "write < instead of <= if none is meant; if it is, draw it beside this with =="
        lowering.warn(element, "where a squared factor is 0 this holds on a sheet, too, of which nothing is drawn", hint)
    ball = (0.0, 0.0, 0.0, 0.0)
    if within is not None:
        if not sheet and bounding_box.all_inside(tape, bounds, values):
            hint = "give `within` more room, or write a box or sphere"
            lowering.warn(element, "all within these bounds is inside: what is drawn is their own box or ball", hint)
        ball = np.array(within[2]) / unit
        wider = bounds if sheet else _wider(bounds)
        tight = bounding_box.tightened(sheet_field(tape) if sheet else tape, bounds, wider)
        if not sheet and tight is not None:
            if ball[3]:
                tape = _cut(tape, bounds, ball)
                tight = bounding_box.tightened(tape, wider, wider)
            elif ((tight[0] <= bounds[0]) | (tight[1] >= bounds[1])).any() and bounding_box.leaves_open(tape, bounds):
                tape = _cut(tape, bounds, ball)
            else:
                tight = np.clip(tight, *bounds)
        ball = ball if sheet else (0.0, 0.0, 0.0, 0.0)
        if tight is None:
            lowering.warn(element, "there is no surface within these bounds: nothing is drawn")
            return []
        bounds = tight
    tape, bounds, ball = in_metres(tape, unit), bounds * unit, tuple(number * unit for number in ball)
    return drawn(lowering, element, tape, bounds, (float(sheet), *ball))


def drawn(lowering: Context, element: Element, tape: Tape, bounds: np.ndarray, parameters: Sequence[float]) -> list[Piece]:
    """A field's surface in a box; nothing, after a diagnostic, where it takes more than evaluators have room for."""
    live = most_live(tape)
    if live > MOST_LIVE:
        hint = "so large a sum of things that hang together is drawn in parts: write several of them"
        return lowering.refuse(
            element, f"the formula needs {live:,} values at a time, and there is room for {MOST_LIVE}", hint
        )
    return [Piece(lowering.builder.formula(tape, bounds, parameters, element.span), transforms.identity())]


def _known(tape: Tape, bounds: np.ndarray | None) -> np.ndarray | None:
    """The transform of the unit ball to a solid that is an ellipsoid, whole within its bounds."""
    matrix = quadric_recognition.ellipsoid(tape)
    if matrix is None:
        return None
    reach = np.linalg.norm(matrix[:3, :3], axis=1)  # the extreme of a linear form on the unit ball
    inside = bounds is None or bool((matrix[:3, 3] - reach > bounds[0]).all() and (matrix[:3, 3] + reach < bounds[1]).all())
    return matrix if inside else None


def in_metres(tape: Tape, unit: float) -> Tape:
    """A field of coordinates, and about a distance, in metres, of one in a file's unit."""
    if unit == 1.0:
        return tape
    builder = Builder()
    (field,) = builder.inline(tape, [builder.scale(name, 1.0 / unit) for name in (X, Y, Z)])
    return builder.finish(builder.scale(field, unit))


def sheet_field(tape: Tape) -> Tape:
    """A field that is at most 0 on a sheet alone."""
    builder = Builder()
    return builder.finish(builder.op(Op.ABS, *builder.inline(tape, (X, Y, Z))))


def _wider(bounds: np.ndarray) -> np.ndarray:
    """A box that holds what is cut by another, and its faces."""
    margin = MARGIN * (bounds[1] - bounds[0])
    return np.stack([bounds[0] - margin, bounds[1] + margin])


def _cut(tape: Tape, bounds: np.ndarray, ball: np.ndarray) -> Tape:
    """A solid cut by its box, or by the ball in it."""
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
