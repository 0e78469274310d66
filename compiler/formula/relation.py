"""Relations to surfaces: an inequality is a solid, an equality is a sheet."""

from __future__ import annotations

from typing import NamedTuple

from ...lang.formula_graph import Formula
from . import regularize
from .builder import Builder
from .from_formula import NotASurface, Translator
from .opcodes import Op
from .tape import INPUTS, Tape, X, Y, Z

EQUAL_OVER_A_REGION = "both sides of this `==` are equal all over a region: that is not a surface", "write <= for the solid that it is"
NO_INTERIOR = "this relation holds on a surface alone, which has no inside", "write how thick it is to be, like abs(y) <= 0.01"
_NEVER_NEGATIVE = frozenset({Op.SQUARE, Op.ABS, Op.SQRT, Op.HYPOT})


class Surface(NamedTuple):
    """The field of a relation.

    A solid is where the field is at most 0; a sheet is where it is 0. `left_out`: the relation also holds on sheets that have no interior.
    """

    tape: Tape
    sheet: bool
    left_out: bool = False


def surface(formula: Formula, may_tie: bool = False) -> Surface:
    """The surface of a relation of x, y and z. Raises NotASurface.

    A sheet comes from `==`, except of whole numbers, and from a `<= 0` whose left side is never negative. With `may_tie` the caller knows
    that both sides are equal over a region: see Graph.
    """
    if len(formula.parameters) != 3:
        raise NotASurface(f"a surface's formula has three parameters, x, y and z, not {len(formula.parameters)}", "write |x, y, z| …")
    if formula.kind != "truth":
        message = f"a surface's formula is a relation, and this one gives a {formula.kind}"
        raise NotASurface(message, "write … <= 0 for a solid, … == 0 for a sheet")
    builder = Builder(may_tie=may_tie)
    top = formula.nodes[formula.results[0]]
    translator = Translator(builder, formula, (X, Y, Z))
    if top.op == "equal" and not translator.compares_truths(top):
        difference = builder.subtract(*(translator.number(i) for i in top.args))
        if builder.is_integer(difference):
            return Surface(builder.finish(builder.integer_is_zero(difference)), False)
        if may_tie:
            raise NotASurface(*EQUAL_OVER_A_REGION)
    else:
        difference = translator.field(formula.results[0])
        if may_tie:
            return Surface(builder.finish(difference), False)
        if top.op not in ("at_most", "at_least") or not _is_never_negative(builder, difference):
            solid, left_out = regularize.regularize(builder, difference)
            if solid is None:
                raise NotASurface(*NO_INTERIOR)
            return Surface(builder.finish(solid), False, left_out)
    return Surface(_sheet(builder, difference), True)


def _sheet(builder: Builder, field: int) -> Tape:
    field = _change_sign(builder, field)
    values = builder.constant_values(field)
    if values is not None and 0.0 in values:
        raise NotASurface(*EQUAL_OVER_A_REGION)
    if builder.row(field)[0] == Op.MOD:
        hint = "half a period on it passes through what it is compared with: mod(a + b / 2, b) == b / 2"
        raise NotASurface("a `mod` that is compared with 0 jumps where it is 0, and passes through it nowhere", hint)
    return builder.finish(field)


def _is_never_negative(builder: Builder, name: int) -> bool:
    """Whether a value is a square, magnitude or root, or a product or the least of such; HYPOT is 0 on no surface."""
    waiting = [name]
    while waiting:
        op, a, b = builder.row(waiting.pop())
        if op in (Op.MULTIPLY, Op.MIN):
            waiting += [a, b]
        elif op not in (Op.SQUARE, Op.ABS, Op.SQRT):
            return False
    return True


def _change_sign(builder: Builder, field: int) -> int:
    """A field with the same zeros that changes its sign there.

    Factors replace their squares and magnitudes. A minimum of values that are never negative is 0 where their product is; a root is 0
    where its operand is.
    """
    factors: dict[int, None] = {}
    waiting = [field]
    while waiting:
        name = waiting.pop()
        op, a, b, _ = builder.rows[name - INPUTS] if name >= INPUTS else (Op.COPY, 0, 0, 0)
        if name >= INPUTS and op in (Op.SQUARE, Op.CUBE, Op.ABS, Op.NEGATE):
            waiting.append(a)
        elif op == Op.MULTIPLY or (op == Op.MIN and all(builder.row(part)[0] in _NEVER_NEGATIVE for part in (a, b))):
            waiting += [b, a]
        elif op == Op.SQRT and name == field:
            waiting.append(a)
        elif builder.number(name) in (None, 0.0):
            factors[name] = None
    first, *others = factors or {field: None}
    for other in others:
        first = builder.multiply(first, other)
    return first
