"""Lowers formulas of patterns to tapes: of the point alone, or graphs with texture coordinates, normals and pictures."""

from __future__ import annotations

from collections.abc import Callable

from ...lang.elements import Element
from ...lang.formula_graph import PATTERN_INPUTS, Formula
from ..formula.builder import Builder
from ..formula.from_formula import NotASurface, add_formula
from ..formula.opcodes import Op
from ..formula.tape import Tape, X, Y, Z
from ..texture_graph.from_formula import GraphTranslator, PictureRow
from ..texture_graph.graph_builder import GraphBuilder, TooLarge
from ..texture_graph.opcodes import NORMAL_X, NORMAL_Y, NORMAL_Z, U, V
from .context import Context

MOST_OPERATIONS = 509  # of a pattern of the point, the limit of the kernels (render/texture/procedural.py)
_STREAMS = dict(zip(PATTERN_INPUTS[-1], (X, Y, Z, U, V, NORMAL_X, NORMAL_Y, NORMAL_Z), strict=True))
_FORMS = "write |x, y, z|, |u, v|, |x, y, z, u, v| or |x, y, z, u, v, nx, ny, nz|"


def of_point(context: Context, element: Element, formula: Formula, color: bool, unit: float, what: str = "pattern") -> Tape | None:
    """The tape of a pattern, whose coordinates are divided by `unit`; None after a diagnostic. A density is 0 where it is negative."""
    builder = Builder()
    point = [builder.scale(name, 1.0 / unit) for name in (X, Y, Z)]
    try:
        if len(formula.parameters) != 3:
            message = f"a {what}'s formula has three parameters, x, y and z, not {len(formula.parameters)}"
            raise NotASurface(message, "write |x, y, z| …")
        _check_kind(formula, color, what)
        results = add_formula(builder, formula, point, exact=True)
    except NotASurface as unfit:
        context.error(element, str(unfit), unfit.hint)
        return None
    if formula.kind == "truth":
        results = (builder.op(Op.CHOOSE, results[0], builder.constant(1.0), builder.constant(0.0)),)
    if what == "density":
        results = (builder.op(Op.MAX, results[0], builder.constant(0.0)),)
    tape = builder.finish(*results)
    if len(tape.code) > MOST_OPERATIONS:
        context.error(element, f"the {what} has {len(tape.code)} operations: {MOST_OPERATIONS} at the most")
        return None
    return tape


def graph(
    context: Context, element: Element, formula: Formula, color: bool, picture: Callable[[Element], PictureRow | None]
) -> Tape | None:
    """The tape of a texture graph; None after a diagnostic. The point is in the unit of the formula's file."""
    builder = GraphBuilder()
    try:
        inputs = [_STREAMS[name] for name in _inputs(formula)]
        _check_kind(formula, color, "pattern")
        pictures = [picture(image) for image in formula.pictures]
        rows = [row for row in pictures if row is not None]
        if len(rows) < len(pictures):
            return None
        placed = [builder.scale(name, 1.0 / formula.unit) if name in (X, Y, Z) else name for name in inputs]
        return builder.finish(*GraphTranslator(builder, formula, placed, rows).results())
    except (NotASurface, TooLarge) as unfit:
        context.error(element, str(unfit), unfit.hint if isinstance(unfit, NotASurface) else "")
        return None


def _inputs(formula: Formula) -> tuple[str, ...]:
    """The inputs that the parameters are. Raises NotASurface for others, and for the name of an input at the place of another."""
    for inputs in PATTERN_INPUTS:
        if len(inputs) == len(formula.parameters):
            for name, place in zip(formula.parameters, inputs, strict=True):
                if name != place and name in _STREAMS:
                    listed = ", ".join(inputs)
                    raise NotASurface(f"the parameters of this pattern are {listed}: `{name}` stands at the place of {place}", _FORMS)
            return inputs
    raise NotASurface(f"a pattern's formula has two, three, five or eight parameters, not {len(formula.parameters)}", _FORMS)


def _check_kind(formula: Formula, color: bool, what: str) -> None:
    """Raises NotASurface for a result that is not drawn."""
    if formula.kind == "list" or (formula.kind == "color" and not color):
        wanted = "a number or a colour" if color else "a number"
        raise NotASurface(f"a {what} here gives {wanted}, not a {formula.kind}", "write rgb(r, g, b)" if color else "")
