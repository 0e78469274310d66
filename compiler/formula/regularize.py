"""Regularizes a solid: removes parts without interior, such as sheets.

The result is the closure of the interior: Requicha, "Representations for Rigid Solids", 1980.

(y − 1)² · y ≤ 0 holds where y ≤ 0, and on the plane y = 1, where no sign changes. Squares and magnitudes as factors change no sign, and a
part that is never negative has no interior.
"""

from __future__ import annotations

from .graph import Graph
from .opcodes import Op, arity
from .tape import INPUTS

SMOOTH = frozenset({Op.COPY, Op.ADD, Op.SUBTRACT, Op.MULTIPLY, Op.NEGATE, Op.SQUARE, Op.CUBE, Op.EXP, Op.SIN, Op.COS, Op.ATAN, Op.HYPOT})
Regularized = tuple[int | None, bool]  # the field, None if it has no interior; whether sheets are left out


def regularize(b: Graph, field: int) -> Regularized:
    """A field that is at most 0 in the closure of the interior of the solid where `field` ≤ 0."""
    done: dict[int, Regularized] = {}
    waiting = [field]
    while waiting:  # without recursion: fields may be deep; each value once
        name = waiting[-1]
        op, first, second = b.row(name)
        parts = [part for part in (first, second) if part not in done] if op in (Op.MIN, Op.MAX) else []
        if parts:
            waiting += parts
            continue
        waiting.pop()
        done[name] = _combine(b, op, name, done[first], done[second]) if op in (Op.MIN, Op.MAX) else _regularize_product(b, name)
    return done[field]


def _combine(b: Graph, op: Op, field: int, regular_a: Regularized, regular_b: Regularized) -> Regularized:
    """A minimum or maximum of two fields, by their regularized ones."""
    (first, left_out), (second, left_out_too) = regular_a, regular_b
    if first is None or second is None:
        remaining = None if op == Op.MAX else second if first is None else first
        return remaining, remaining is not None
    return (field if (first, second) == b.row(field)[1:] else b.op(op, first, second)), left_out or left_out_too


def _regularize_product(b: Graph, field: int) -> Regularized:
    """Reduces each odd power of a factor to the factor, and drops even powers."""
    powers: dict[int, int] = {}
    negative, waiting = False, [(field, 1)]
    while waiting:
        name, count = waiting.pop()
        op, operand, second = b.row(name)
        number = b.number(name)
        if number == 0.0:
            return field, False
        if op == Op.NEGATE or (number or 0.0) < 0.0:
            negative ^= count % 2 == 1
        if op == Op.MULTIPLY:
            waiting += [(second, count), (operand, count)]
        elif op in (Op.SQUARE, Op.ABS) and is_smooth(b, operand):
            waiting.append((operand, 2 * count))
        elif op == Op.CUBE:
            waiting.append((operand, 3 * count))
        elif op == Op.NEGATE:
            waiting.append((operand, count))
        elif number is None:
            powers[name] = powers.get(name, 0) + count
    if all(count == 1 for count in powers.values()):
        return field, False
    factors = [name for name, count in powers.items() if count % 2]
    even = [name for name, count in powers.items() if count % 2 == 0]
    left_out = any(is_smooth(b, name) for name in even)
    factors += [b.op(Op.SQUARE, name) for name in even if not is_smooth(b, name)]
    if not factors:
        return (b.constant(-1.0), False) if negative else (None, False)
    product = factors[0]
    for name in factors[1:]:
        product = b.multiply(product, name)
    return b.op(Op.NEGATE, product) if negative else product, left_out


def is_smooth(b: Graph, name: int) -> bool:
    """Whether a value is defined everywhere and 0 over no region: of sums and products of smooth functions."""
    waiting, seen = [name], {name}
    while waiting:
        name = waiting.pop()
        if name < INPUTS:
            continue
        op, *operands = b.rows[name - INPUTS]
        used = operands[: arity(op)]
        by_constant = op == Op.DIVIDE and b.number(used[1])
        if not (by_constant or op in SMOOTH) or (op == Op.HYPOT and (used[0] == used[1] or min(used) < 0)):
            return False
        waiting += [other for other in used if other not in seen]
        seen.update(used)
    return True
